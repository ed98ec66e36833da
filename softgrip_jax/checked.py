"""Modules that say at once when a value cannot be meant.

A field declares its rule where it is defined (``t_m = positive("length")``). Outside of jit a value that breaks
it is a ValueError in one sentence; inside jit, where nothing can be raised, the same rules become a boolean
(:func:`admissible`) and the lane is labelled IMPOSSIBLE.
"""

from __future__ import annotations

import dataclasses
import numbers
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from .errors import InputError
from .reasons import RULE_NAMES
from .units import SI

# rule -> (what is allowed, in words; the test, for NumPy and for traced arrays alike)
RULES = {
    "positive": ("a positive finite number", lambda x: (x > 0) & (x < np.inf)),
    "nonnegative": ("a finite number, zero or more", lambda x: (x >= 0) & (x < np.inf)),
    "nonzero": ("a finite number other than zero", lambda x: (x != 0) & (x > -np.inf) & (x < np.inf)),
    "finite": ("a finite number", lambda x: (x > -np.inf) & (x < np.inf)),
    "right_angle": ("an angle from zero to less than a right angle", lambda x: (x >= 0) & (x < np.pi / 2)),
}


def wanted(rule: str, unit: str) -> str:
    """What a field accepts, in words: 'a positive finite number in mm'."""
    return RULES[rule][0] + (f" in {unit}" if unit else "")


def to_float_array(value: Any) -> Any:
    """Numbers, arrays and lists of numbers become float arrays; anything else is left for the check to name."""
    listed = isinstance(value, list | tuple) and len(value) > 0 and all(_is_number(v) for v in value)
    if listed or _is_number(value):
        dtype = jnp.result_type(value) if isinstance(value, jax.Array | np.ndarray) else float
        # A type that is named is not weak: a scene made of Python numbers and one made of arrays share one program.
        return jnp.asarray(value, dtype=dtype if jnp.issubdtype(dtype, jnp.inexact) else float)
    return value


def _is_number(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return np.issubdtype(value.dtype, np.number) and not np.iscomplexobj(value)
    return isinstance(value, jax.Array | numbers.Real) and not isinstance(value, bool | np.bool)


def _rule_field(rule: str, kind: str, **kwargs: Any) -> Any:
    return eqx.field(converter=to_float_array, metadata={"rule": rule, "kind": kind}, **kwargs)


def positive(kind: str, **kwargs: Any) -> Any:
    """A float leaf greater than zero, in SI."""
    return _rule_field("positive", kind, **kwargs)


def nonnegative(kind: str, **kwargs: Any) -> Any:
    """A float leaf, zero or more, in SI."""
    return _rule_field("nonnegative", kind, **kwargs)


def finite(kind: str, **kwargs: Any) -> Any:
    """A float leaf of either sign, in SI."""
    return _rule_field("finite", kind, **kwargs)


def nonzero(kind: str, **kwargs: Any) -> Any:
    """A float leaf of either sign, but not zero, in SI."""
    return _rule_field("nonzero", kind, **kwargs)


def right_angle(**kwargs: Any) -> Any:
    """A float leaf in [0, pi/2)."""
    return _rule_field("right_angle", "angle", **kwargs)


def vector(kind: str, converter: Any, **kwargs: Any) -> Any:
    """A leaf of two components (x, y), or None; `converter` says what a written value becomes."""
    return eqx.field(converter=converter, metadata={"rule": "finite", "kind": kind, "size": 2}, **kwargs)


def choice(*allowed: str, **kwargs: Any) -> Any:
    """A static choice by name."""
    return eqx.field(static=True, metadata={"allowed": allowed}, **kwargs)


def count(**kwargs: Any) -> Any:
    """A static whole number, one or more."""
    return eqx.field(static=True, metadata={"least": 1}, **kwargs)


def to_names(value: Any) -> Any:
    """A name or a list of names as a tuple of names."""
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


def rule_names(**kwargs: Any) -> Any:
    """A static tuple of names of rules (see `reasons`)."""
    return eqx.field(static=True, converter=to_names, metadata={"names": RULE_NAMES}, **kwargs)


def part(*types: type, **kwargs: Any) -> Any:
    """Another module (a shell in a scene, a material in a shell)."""
    return eqx.field(metadata={"types": types}, **kwargs)


def is_concrete(*values: Any) -> bool:
    """True where the values are known numbers (not traced by jit, vmap or grad)."""
    return all(isinstance(v, jax.Array) and not isinstance(v, Tracer) for v in values)


def require(name: str, value: Any, rule: str, kind: str) -> Any:
    """`value` as a float array, or a ValueError that names the field, the value and the rule."""
    test, words = RULES[rule][1], wanted(rule, SI[kind])
    array = to_float_array(value)
    if not isinstance(array, jax.Array):
        raise InputError(f"{name} is {value!r}; it must be {words}.")
    if is_concrete(array):
        seen = np.asarray(array)
        if not np.all(test(seen)):
            raise InputError(f"{name} is {_first_bad(seen, test)}; it must be {words}.")
    return array


def _first_bad(values: np.ndarray, test: Any) -> str:
    bad = np.atleast_1d(values)[~np.atleast_1d(test(values))]
    return f"{bad.flat[0]:.6g}" + (f" (in an array of {values.size})" if values.size > 1 else "")


class Checked(eqx.Module):
    """A module whose fields are checked by the rule they declare."""

    def __check_init__(self) -> None:
        owner = type(self).__name__
        for field in dataclasses.fields(self):
            meta, value = field.metadata, getattr(self, field.name)
            where = f"{owner}.{field.name}"
            if "rule" in meta:
                # Placeholders that JAX puts into trees while it rebuilds them carry no numbers to check.
                if type(value) is object or (value is None and (field.default is None or "size" in meta)):
                    continue
                require(where, value, meta["rule"], meta["kind"])
                if "size" in meta and jnp.shape(value)[-1:] != (meta["size"],):
                    raise InputError(f"{where} is {value!r}; it must be a pair of numbers (x, y).")
            elif meta.get("friction") and not callable(value):
                require(where, value, "positive", "number")
            elif "allowed" in meta and value not in meta["allowed"]:
                raise InputError(f"{where} is {value!r}; it must be one of {', '.join(map(repr, meta['allowed']))}.")
            elif "names" in meta and not (isinstance(value, tuple) and set(value) <= set(meta["names"])):
                raise InputError(f"{where} is {value!r}; it must be a list of names from {', '.join(meta['names'])}.")
            elif "least" in meta and not (type(value) is int and value >= meta["least"]):
                raise InputError(f"{where} is {value!r}; it must be a whole number, {meta['least']} or more.")
            elif "types" in meta and not isinstance(value, meta["types"]):
                names = " or ".join(t.__name__ for t in meta["types"])
                raise InputError(f"{where} is {value!r}; it must be a {names}.")


def admissible(tree: Any) -> Bool[Array, ""]:
    """True where every field of every checked module in `tree` keeps its rule (for use inside jit)."""
    good = jnp.asarray(True)
    nodes = jax.tree.leaves(tree, is_leaf=lambda node: isinstance(node, Checked))
    for node in nodes:
        if not isinstance(node, Checked):
            continue
        for field in dataclasses.fields(node):
            value = getattr(node, field.name)
            if "rule" in field.metadata:
                if value is None:
                    continue
                good &= jnp.all(RULES[field.metadata["rule"]][1](value))
            elif field.metadata.get("friction") and not callable(value):
                good &= jnp.all(RULES["positive"][1](value))
            elif isinstance(value, eqx.Module):
                good &= admissible(value)
    return good
