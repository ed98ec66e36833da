"""How scenes and actuators print: every number with its unit, every choice by name.

    FlatShell(a=16 mm, b=43 mm, t_m=1.1 mm, material=NeoHookean(mu=175 kPa))

Arrays are shown by what they hold where that is short, and by their shape and range where it is not. Numbers that are
traced by JAX, and the placeholders that it puts into trees, have no value and are shown by what they are. Derivatives
by a scene come as a scene whose numbers have other units: they print in SI, without a unit.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .units import DISPLAY

DIGITS = 6
"""Significant digits of a number: what people measure and type has fewer."""
WHOLE = 6
"""An array of at most so many numbers is shown whole."""


def describe(module: Any, has_units: bool = True) -> str:
    """A module in one line, as a call of its class in which numbers carry units, or are in SI without a unit."""
    shown = []
    # As a call reads: what may be given by place comes first.
    for field in sorted(dataclasses.fields(module), key=lambda field: bool(field.kw_only)):
        # In the middle of its construction a module may not have all of its fields.
        # An empty list of names (of rules that are switched off) says nothing, nor does a method that nobody chose.
        if field.repr and field.name in vars(module) and not _is_empty(vars(module)[field.name], field):
            kind = field.metadata.get("kind", "number") if has_units else "number"
            shown.append(f"{field.name}={_describe_value(vars(module)[field.name], kind, has_units)}")
    return f"{type(module).__name__}({', '.join(shown)})"


def _is_empty(value: Any, field: dataclasses.Field[Any]) -> bool:
    return (isinstance(value, tuple) and not value) or (value is None and "methods" in field.metadata)


def is_readable(value: Any) -> bool:
    """True for arrays of plain numbers that are known and at hand."""
    if isinstance(value, Tracer) or not isinstance(value, jax.Array | np.ndarray | np.generic):
        return False
    if isinstance(value, jax.Array) and (value.is_deleted() or not value.is_fully_addressable):
        return False
    return bool(jnp.issubdtype(value.dtype, np.integer) or jnp.issubdtype(value.dtype, np.floating))


def _describe_value(value: Any, kind: str, has_units: bool) -> str:
    """One field: '16 mm', '[1, 2, 3] mm', '1000 values from 10 mm to 20 mm', 'float64[3] (traced)'."""
    if dataclasses.is_dataclass(value) and hasattr(type(value), "__check_init__"):
        return describe(value, has_units)
    if is_readable(value):
        return _describe_array(np.asarray(value, dtype=float), *DISPLAY.get(kind, DISPLAY["number"]))
    if isinstance(value, Tracer):
        return f"{value.dtype}{list(value.shape)} (traced)"
    dtype, shape = getattr(value, "dtype", None), getattr(value, "shape", None)
    if dtype is not None and shape is not None:
        return f"{dtype}{list(shape)}"
    return getattr(value, "__name__", None) or repr(value)


def _describe_array(array: np.ndarray, label: str, unit: float) -> str:
    array = array / unit
    if array.ndim == 0:
        return _with_unit(_number(array), label)
    alike = array.size > 1 and np.all(array == array.flat[0])
    if array.ndim == 1 and array.size <= WHOLE and not alike:
        return _with_unit("[" + ", ".join(map(_number, array)) + "]", label)
    shape = str(array.size) if array.ndim == 1 else " x ".join(map(str, array.shape))
    if array.size == 0 or np.all(np.isnan(array)):
        return f"{shape} values"
    low, high = (_with_unit(_number(end(array)), label) for end in (np.nanmin, np.nanmax))
    return f"{shape} values of {low}" if low == high else f"{shape} values from {low} to {high}"


def _number(value: Any) -> str:
    """A number as people write it; zero without a sign."""
    return f"{float(value) + 0.0:.{DIGITS}g}"


def _with_unit(text: str, label: str) -> str:
    return f"{text} {label}".strip()
