"""The thesis's numbers of the finger and of the three-finger gripper, recomputed with its own section law."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..pneunet.finger import SEGMENT_FIELDS, PneuNet
from ..pneunet.free import Free
from ..progress import Tell, silent
from ..questions import limit_pressure, pressure_for
from ..results import Solution, Status
from ..units import kPa, mm
from . import printed as thesis
from .rows import Batch, stacked

PRESSURES = np.array([11.0, 21, 31, 41, 51, 61, 71]) * kPa
"""The thesis's steps of ten (sections 6.3.1 and 6.3.2)."""
AT_21, AT_31 = 1, 2
"""Places among them."""
SEGMENTS = 13
"""Chambers of a finger as arrays: uniform and nonuniform ones then share a program."""
NODES = 121
"""The thesis's 120 intervals; every fourth node makes 31."""
STEP = 1 * kPa
"""Of the thesis's algorithm 7, which raises the pressure before it tests: the printed pressure, a whole number of kPa,
is above the needed one by more than nothing and by two steps at most. Its step is not printed."""
RADII = {
    "hexagonal cylinder": np.linspace(6, 13.5, 16) * mm,
    "3-face cone": np.linspace(3, 14, 8) * mm,
    "circular cone": np.linspace(10, 26, 8) * mm,
}
"""Where the tips might touch objects whose y_c is not printed."""


class Fingers(NamedTuple):
    """Solutions by group."""

    free: dict[str, Solution]
    unstretched: dict[str, Solution]
    """Free fingers whose cover does not stretch."""
    free_shape: dict[str, dict[str, np.ndarray]]
    blocked: dict[str, Solution]
    blocked_stretch: float
    """Largest stretch of all blocked fingers."""
    limits: dict[str, np.ndarray]
    """Limit pressure (Pa) of a blocked finger by type, over the tip offsets."""
    held: Solution
    needed: dict[str, np.ndarray]
    """Pressure (Pa) by object: types first; radii of RADII last where there are some."""
    seconds: float
    """Of one blocked state among a batch, compiled."""


def segmented(finger: PneuNet, **fields: Any) -> PneuNet:
    """The same finger with one value per chamber; `fields` replace some."""
    same = {name: jnp.full(SEGMENTS, getattr(finger, name)) for name in SEGMENT_FIELDS}
    return dataclasses.replace(finger, **(same | fields))


def free(kind: str, length: Any = 77 * mm, section: str = "thesis", **fields: Any) -> Free:
    scene = thesis.free_finger(kind, length, section)
    return dataclasses.replace(scene, finger=segmented(scene.finger, **fields))


def nonuniform() -> Free:
    """Chambers ever closer towards the tip, as in figure 6.17; the thesis does not print its own."""
    return free("A", h_L=jnp.linspace(5.1, 3.3, SEGMENTS) * mm)


def compute(tell: Tell = silent) -> Fingers:
    """Every state of the finger that the rows and the pictures need; `tell` hears of every part."""
    parts = 5
    states, unstretched, blocked = Batch(), Batch(), Batch()
    for kind in thesis.KINDS:
        states.add(kind, [free(kind)] * len(PRESSURES), PRESSURES)
        unstretched.add(kind, [free(kind, section="inextensible")] * len(PRESSURES), PRESSURES)
    for length in thesis.LENGTHS.values():
        states.add(f"C {length / mm:.0f}", [free("C", length)], [PRESSURES[AT_31]])
        states.add(f"D {length / mm:.0f}", [free("D", length)], [PRESSURES[AT_31]])
    states.add("nonuniform", [nonuniform()], [PRESSURES[AT_21]])
    shapes = jax.jit(lambda solution: solution.shape(NODES))
    tell("fingers in free space", 0, parts)
    found = states.solve()
    free_shape = {name: {k: np.asarray(v) for k, v in shapes(found[name]).items()} for name in thesis.KINDS}
    free_shape["nonuniform"] = {k: np.asarray(v) for k, v in shapes(found["nonuniform"]).items()}

    scenes = []
    for kind in thesis.KINDS:
        for offset in thesis.TIP_OFFSETS:
            scenes.append(thesis.blocked_finger(kind, offset))
            blocked.add(f"{kind} {offset / mm:.0f}", [scenes[-1]] * len(PRESSURES), PRESSURES)
    for length in thesis.LENGTHS.values():
        for kind in "CD":
            blocked.add(f"{kind} L {length / mm:.0f}", [thesis.blocked_finger(kind, 0.0, length)], [PRESSURES[AT_31]])
    tell("held fingers", 1, parts)
    tips = blocked.solve(timed=True)
    tell("their limits", 2, parts)
    limits = np.asarray(jax.jit(jax.vmap(limit_pressure))(stacked(scenes))).reshape(len(thesis.KINDS), -1)
    stretch = _largest_stretch([tips[f"{kind} {y / mm:.0f}"] for kind in thesis.KINDS for y in thesis.TIP_OFFSETS])
    tell("grasps", 3, parts)
    held, needed = _grasps()
    tell("fingers that do not stretch", 4, parts)
    by_kind = dict(zip(thesis.KINDS, limits, strict=True))
    return Fingers(found, unstretched.solve(), free_shape, tips, stretch, by_kind, held, needed, blocked.seconds)


def _largest_stretch(solutions: Sequence[Solution]) -> float:
    """Of all states that exist; the solutions are of one size, so that one program does."""
    stretches = jax.jit(lambda solution: solution.shape(NODES)["stretch"])
    found = [np.asarray(stretches(s))[np.asarray(s.status) == Status.OK] for s in solutions]
    return max(float(stretch.max()) for stretch in found if stretch.size)


def _grasps() -> tuple[Solution, dict[str, np.ndarray]]:
    """(the circular cylinder held by each type, the pressure for every object)."""
    scenes, sizes = [], {}
    for name, mass in thesis.MASSES.items():
        radii = RADII.get(name, np.array([18 * mm]))
        if name == "hexagonal cylinder":
            radii = np.append(radii, thesis.apothem())
        wide, high = thesis.CONES.get(name, (0.0, 1.0))
        scenes += [thesis.finger_grasp(kind, mass, r, 1 + (wide / high) ** 2) for kind in thesis.KINDS for r in radii]
        sizes[name] = len(radii)
    found = jax.jit(jax.vmap(pressure_for))(stacked(scenes))
    needed, first = {}, 0
    held = found
    for name, size in sizes.items():
        last = first + size * len(thesis.KINDS)
        needed[name] = np.asarray(found.pressure[first:last]).reshape(len(thesis.KINDS), size)
        if name == "circular cylinder":
            held = jax.tree.map(lambda x, s=slice(first, last): x[s], found)
        first = last
    return held, needed
