"""Doubts about units: numbers that can be meant, but hardly in the SI unit that they were given in.

Constructors take metres, pascals and kilograms, and people type what they measured: millimetres, kilopascals, grams. A
dimension of 16 m is no mistake that can be refused, but it is told, with the unit that was probably meant. That happens
outside of jit only, where numbers are known. The keys of a config and of the command line carry their units: there the
doubt is about numbers that are a thousand times too small for theirs (`warn_of_key`).
"""

from __future__ import annotations

import contextlib
import sys
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from .errors import UnitWarning
from .units import DISPLAY, SI

LARGEST_LENGTH = 1.0
"""m. No finger, shell or object that a soft gripper holds is longer, and hardly a dimension in mm is below 1."""
LARGEST_MASS = 100.0
"""kg. Soft grippers lift a few kilograms; what they lift weighs hundreds of grams."""
LARGEST_ANGLE = 6.5
"""rad, more than a full turn."""
LARGEST = {"length": (LARGEST_LENGTH, "mm"), "mass": (LARGEST_MASS, "gram"), "angle": (LARGEST_ANGLE, "degree")}
"""Kind -> (the largest plausible number in SI, the unit that a larger one was probably meant in)."""
SMALLEST_LENGTH = 2e-5
"""m, of what must be positive in a config: the thinnest silicone films that are cast are some tens of micrometres."""
SMALLEST_MODULUS = 1e3
"""Pa, of what must be stiff by itself. The softest silicones and gels that are moulded have some kPa."""

ON_THE_WAY = ("softgrip_jax", "equinox", "dataclasses", "jaxtyping", "beartype")
"""Packages whose frames lie between a constructor as it is typed and the check of its fields."""

_is_stated: ContextVar[bool] = ContextVar("units_are_stated", default=False)


@contextlib.contextmanager
def units_are_stated() -> Iterator[None]:
    """No doubts inside: the numbers come from where every one carries its unit."""
    token = _is_stated.set(True)
    try:
        yield
    finally:
        _is_stated.reset(token)


class Doubt(NamedTuple):
    """A number in SI, and the unit that it was probably meant in."""

    name: str
    value: float
    kind: str
    unit: str


def doubts(name: str, values: np.ndarray, kind: str, rule: str) -> list[Doubt]:
    """The doubt about one number, or about many where none of them is plausible (a batch may span decades)."""
    if kind in LARGEST:
        largest, unit = LARGEST[kind]
        if not values.size or np.min(np.abs(values)) <= largest:
            return []
        return [Doubt(name, float(values.flat[0]), kind, unit)]
    # Constants of a material that may have either sign may also be small.
    if kind != "pressure" or rule != "positive" or not values.size:
        return []
    size = np.max(np.abs(values))
    if 0 < size < SMALLEST_MODULUS:
        return [Doubt(name, float(size), kind, "kPa" if size * 1e3 >= SMALLEST_MODULUS else "MPa")]
    return []


def warn_of_key(place: str, value: float, kind: str, rule: str) -> None:
    """A warning about a number of a config in the unit of its key, where it was probably meant in one that is a
    thousand times larger: a length in metres, a modulus in MPa."""
    if rule != "positive" or kind not in ("length", "pressure"):
        return
    label, unit = DISPLAY[kind]
    if 0 < value * unit < (SMALLEST_LENGTH if kind == "length" else SMALLEST_MODULUS):
        sentence = f"{place} is {value:.6g}, and that is {value:.6g} {label}; did you mean {value * 1e3:.6g}?"
        warnings.warn(sentence, UnitWarning, stacklevel=2)


def warn(found: list[Doubt]) -> None:
    """One warning about everything that is in doubt, at the line that gave the numbers."""
    if not found or _is_stated.get():
        return
    # Level 2 is what called this function.
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ON_THE_WAY:
        level, frame = level + 1, frame.f_back
    seen = ", ".join(f"{one.name} is {one.value:.6g} {SI[one.kind]}" for one in found)
    likely = ", ".join(f"{one.value:.6g} {'g' if one.unit == 'gram' else one.unit}" for one in found)
    value, unit = found[0].value, found[0].unit
    warnings.warn(
        f"{seen}; did you mean {likely}? Numbers are in SI units: write {value:.6g} * softgrip_jax.units.{unit}.",
        UnitWarning,
        stacklevel=level,
    )
