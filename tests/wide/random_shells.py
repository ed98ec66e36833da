"""Random shells of every kind and material: dictionaries of numbers for the reference, scenes for the package."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import reference as ref

import softgrip_jax as sg

Numbers = dict[str, Any]


def decades(draw: np.random.Generator, low: float, high: float, n: int) -> np.ndarray:
    """n numbers, log-uniform."""
    return np.exp(draw.uniform(np.log(low), np.log(high), n))


# --- materials: constants over the shear modulus mu -------------------------------------------------------------------


def _neo(draw, n):
    return {}


def _mooney(draw, n):
    second = draw.uniform(-0.3, 0.5, n)  # of C_2 / (C_1 + C_2): Mooney's constants of rubbers, and softening ones
    return {"c1": 0.5 * (1 - second), "c2": 0.5 * second}


def _yeoh(draw, n):
    return {"c1": np.full(n, 0.5), "c2": draw.uniform(-0.05, 0.05, n), "c3": decades(draw, 1e-5, 1e-2, n)}


def _gent(draw, n):
    return {"j_m": decades(draw, 1.0, 300.0, n)}


def _ogden(draw, n):
    first, second = draw.uniform(1.2, 3.4, n), draw.uniform(-4.0, -0.5, n)
    part = draw.uniform(-0.1, 0.3, n)  # of the shear modulus that the second term has
    return {
        "mu": np.stack([2 * (1 - part) / first, 2 * part / second], -1),
        "alpha": np.stack([first, second], -1),
    }


class Law(NamedTuple):
    kind: str
    draw: Callable[[np.random.Generator, int], Numbers]
    make: Callable[[Numbers], sg.materials.Material]
    moduli: tuple[str, ...]
    """Constants that are in units of mu."""


LAWS = {
    "NeoHookean": Law(ref.NEO, _neo, lambda m: sg.NeoHookean(mu=m["mu"]), ()),
    "MooneyRivlin": Law(ref.MOONEY, _mooney, lambda m: sg.MooneyRivlin(c1=m["c1"], c2=m["c2"]), ("c1", "c2")),
    "Yeoh": Law(ref.YEOH, _yeoh, lambda m: sg.Yeoh(c1=m["c1"], c2=m["c2"], c3=m["c3"]), ("c1", "c2", "c3")),
    "Gent": Law(ref.GENT, _gent, lambda m: sg.Gent(mu=m["mu"], j_m=m["j_m"]), ()),
    "Ogden": Law(ref.OGDEN, _ogden, lambda m: sg.Ogden(mu=m["mu"], alpha=m["alpha"]), ("mu",)),
}


def material(law: Law, draw: np.random.Generator, n: int) -> Numbers:
    mu = decades(draw, 2e4, 2e6, n)
    constants = law.draw(draw, n)
    scaled = {k: v * (mu[:, None] if v.ndim > 1 else mu) if k in law.moduli else v for k, v in constants.items()}
    return {"mu": mu} | scaled


# --- scenes -----------------------------------------------------------------------------------------------------------


class Kind(NamedTuple):
    """A kind of scene: how to draw its own numbers (over a), to make it, and what the reference knows of it."""

    draw: Callable[[np.random.Generator, int], Numbers]
    make: Callable[[sg.FlatShell, Numbers], sg.Scene]
    load: Callable[[Any, Numbers], Any]
    """Of the reference: load(theta, numbers) -> pressure, margins."""
    touch: Callable[[Numbers], Any] | None
    """The angle at which the free membrane touches; None for the free one."""
    square: bool = False


def _rod(draw, n):
    return {"radius": decades(draw, 0.1, 10, n), "gap": decades(draw, 0.02, 2, n)}


def _offset(draw, n):
    return _rod(draw, n) | {"height": draw.uniform(0.3, 1.7, n)}  # over b


def _to_gap(p):
    return 2 * np.arctan(p["gap"] / p["a"])


KINDS = {
    "Free": Kind(lambda draw, n: {}, lambda s, p: sg.shell.Free(s), ref.free, None),
    "FlatContact": Kind(
        lambda draw, n: {"distance": decades(draw, 0.02, 2, n)},
        lambda s, p: sg.shell.FlatContact(s, distance=p["distance"]),
        ref.flat,
        lambda p: 2 * np.arctan(p["distance"] / p["a"]),
    ),
    "InclinedContact": Kind(
        lambda draw, n: {"distance": decades(draw, 0.02, 2, n), "angle": draw.uniform(0, 0.6, n)},
        lambda s, p: sg.shell.InclinedContact(s, distance=p["distance"], angle=p["angle"]),
        ref.inclined,
        lambda p: ref.touch_angle(p["distance"] / p["a"], p["angle"]),
        square=True,
    ),
    "CylinderContact": Kind(
        _rod,
        lambda s, p: sg.shell.CylinderContact(s, radius=p["radius"], gap=p["gap"]),
        ref.cylinder,
        _to_gap,
    ),
    "AxialOffset": Kind(
        _offset,
        lambda s, p: sg.shell.AxialOffset(s, radius=p["radius"], gap=p["gap"], height=p["height"]),
        ref.cylinder,
        _to_gap,
    ),
    "Grasp": Kind(
        _rod,
        lambda s, p: sg.shell.Grasp(s, radius=p["radius"], gap=p["gap"]),
        ref.cylinder,
        _to_gap,
    ),
}


def designs(kind: Kind, law: Law, draw: np.random.Generator, n: int) -> tuple[Numbers, Numbers]:
    """(numbers of the scenes, constants of the materials), arrays of n."""
    a = decades(draw, 2e-3, 2e-1, n)
    numbers = {"a": a, "b": a if kind.square else a * decades(draw, 1, 10, n), "t_m": a * decades(draw, 5e-3, 0.5, n)}
    for name, values in kind.draw(draw, n).items():
        numbers[name] = values * {"angle": 1.0, "height": numbers["b"]}.get(name, a)
    return numbers, material(law, draw, n)


def scene_of(kind: Kind, law: Law, numbers: Numbers, constants: Numbers) -> sg.Scene:
    """One scene (inside vmap: of one design)."""
    made = sg.FlatShell(a=numbers["a"], b=numbers["b"], t_m=numbers["t_m"], material=law.make(constants))
    return kind.make(made, numbers)


def for_reference(law: Law, numbers: Numbers, constants: Numbers) -> Numbers:
    """The same numbers as the reference wants them."""
    return numbers | {"material": {"kind": law.kind} | constants}
