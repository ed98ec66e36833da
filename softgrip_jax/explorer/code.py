"""A scene as a line of Python that makes it again."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import softgrip_jax

from ..config.modules import type_name
from ..fields import Checked
from ..scene import Scene
from ..units import DISPLAY, kPa

UNITS = {"length": "mm", "position": "mm", "pressure": "kPa", "mass": "gram", "angle": "degree", "moment": "N_mm"}
"""Kind -> the name in softgrip_jax.units of the unit that people read; other kinds are in SI."""
PLACES = ("", "materials.", "objects.", "pneunet.", "shell.obstacles.", "solvers.")
"""Where softgrip_jax shows classes that are no scenes."""


def name_of(cls: type) -> str:
    """How a program that has imported softgrip_jax as sg names a class."""
    if issubclass(cls, Scene):
        return f"sg.{type_name(cls)}" if "." in type_name(cls) else cls.__name__
    for place in PLACES:
        node: Any = softgrip_jax
        for part in filter(None, place.split(".")):
            node = getattr(node, part)
        if getattr(node, cls.__name__, None) is cls:
            return f"sg.{place}{cls.__name__}"
    return cls.__name__


def python_of(value: Any, kind: str = "number") -> str:
    """An expression that makes a module, an array or a choice again; lengths as 16 * mm."""
    if isinstance(value, Checked):
        given = []
        for field in dataclasses.fields(value):
            one = getattr(value, field.name)
            if not field.init or (one is None and field.default is None) or _same(one, field.default):
                continue
            given.append(f"{field.name}={python_of(one, field.metadata.get('kind', 'number'))}")
        return f"{name_of(type(value))}({', '.join(given)})"
    if isinstance(value, np.ndarray | np.generic) or hasattr(value, "dtype"):
        array, unit = np.asarray(value, dtype=float), DISPLAY[kind][1] if kind in UNITS else 1.0
        numbers = [f"{one / unit:.15g}" for one in np.ravel(array)]
        if kind in UNITS:
            numbers = [f"{one} * {UNITS[kind]}" if one != "0" else one for one in numbers]
        return numbers[0] if array.ndim == 0 else f"[{', '.join(numbers)}]"
    if isinstance(value, str):
        return repr(str(value))
    return repr(value)


def _same(value: Any, default: Any) -> bool:
    if default is dataclasses.MISSING or isinstance(value, Checked):
        return False
    try:
        return bool(np.shape(value) == np.shape(default) and np.all(np.asarray(value) == np.asarray(default)))
    except (TypeError, ValueError):
        return False


def solving(scene: Scene, pressure: float | None, task: dict[str, float]) -> str:
    """The program that solves a scene at a pressure (Pa), or for a task: an observable's value in SI, or the scene's
    own where there is none."""
    wanted = "".join(f", {name}={value!r}" for name, value in task.items())
    asked = f"sg.pressure_for({python_of(scene)}{wanted})"
    if pressure is not None:
        asked = f"sg.solve({python_of(scene)}, {pressure / kPa:.12g} * kPa)"
    return f"import softgrip_jax as sg\nfrom softgrip_jax.units import degree, gram, kPa, mm, N_mm\n\nprint({asked})\n"
