"""The thesis's fingers and grippers once more, pushed by the cell law in place of the thesis's chambers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..pneunet.cell.law import outside
from ..pneunet.drives import with_other_drive
from ..progress import Tell, silent
from ..questions import pressure_for, solve
from ..reasons import Reason
from ..results import Solution, Status
from ..units import kPa, mm
from . import printed as thesis
from .finger_rows import touching_radii
from .fingers import NODES, RADII, Fingers, nonuniform

PRESSURES = np.arange(1.0, 48, 2) * kPa
"""Of the curves: up to where the cell law ends for the stiffer silicone. The thesis's steps of ten are among them."""
BEYOND = 71 * kPa
"""No finger has a state there by the cell law: what is solved says where its states end, and why."""
DRAWN = "AB"
"""Types whose curves are drawn at every tip offset."""
SHAPE_PRESSURES = (11 * kPa, 21 * kPa, 31 * kPa, 41 * kPa)
"""At which the stretch is looked at."""


class ByCell(NamedTuple):
    """Solutions by group, named as in `Fingers`."""

    free: dict[str, Solution]
    held: dict[str, Solution]
    """Of fingers whose tip is held."""
    free_end: dict[str, Solution]
    """The same finger BEYOND its last state."""
    held_end: dict[str, Solution]
    stretch: dict[str, float]
    """A finger in words -> its largest stretch at SHAPE_PRESSURES."""
    grasps: dict[str, Solution]
    """By object, at the pressure that holds it: one state for each type."""
    outside: dict[str, list[str]]
    """Type -> its dimensions that the cell law was not fitted to, in words; also of the nonuniform finger."""


def place(pressure: float) -> int:
    """Where a pressure (Pa) is among PRESSURES."""
    return int(np.argmin(np.abs(PRESSURES - pressure)))


def compute(fingers: Fingers, tell: Tell = silent) -> ByCell:
    """Every state by the cell law that the rows and the pictures need; `tell` hears of every part.

    Three programs do for all of them, one for each kind of scene: one by one its states take some milliseconds each,
    and a program for a whole batch would take three times as long to compile.
    """
    parts = 3
    tell("the same fingers by the cell law: free", 0, parts)
    loose, loose_end = {}, {}
    for kind in thesis.KINDS:
        scene = with_other_drive(thesis.free_finger(kind))
        loose[kind], loose_end[kind] = curve(scene)
    for kind in "CD":
        for length in thesis.LENGTHS.values():
            scene = with_other_drive(thesis.free_finger(kind, length))
            loose[f"{kind} {length / mm:.0f}"] = one(scene, thesis.FINGER_PRESSURE)

    tell("the same fingers by the cell law: held", 1, parts)
    held, held_end = {}, {}
    for kind in thesis.KINDS:
        for offset in thesis.TIP_OFFSETS:
            if offset > 0 and kind not in DRAWN:
                continue
            scene, name = with_other_drive(thesis.blocked_finger(kind, offset)), f"{kind} {offset / mm:.0f}"
            held[name], held_end[name] = curve(scene)
    for kind in "CD":
        for length in thesis.LENGTHS.values():
            scene = with_other_drive(thesis.blocked_finger(kind, 0.0, length))
            held[f"{kind} L {length / mm:.0f}"] = one(scene, thesis.FINGER_PRESSURE)
    stretch = {f"type {kind}, tip free": _largest_stretch(loose[kind]) for kind in thesis.KINDS}
    stretch |= {f"type {kind}, tip held": _largest_stretch(held[f"{kind} 0"]) for kind in thesis.KINDS}

    tell("the same grippers by the cell law", 2, parts)
    grasps = {}
    for name, mass in thesis.MASSES.items():
        wide, high = thesis.CONES.get(name, (0.0, 1.0))
        around = [
            thesis.finger_grasp(kind, mass, touched_radius(fingers, name), 1 + (wide / high) ** 2)
            for kind in thesis.KINDS
        ]
        grasps[name] = _together(pressure_for(with_other_drive(scene)) for scene in around)
    drawn = {kind: thesis.finger(kind) for kind in thesis.KINDS} | {"nonuniform": nonuniform().finger}
    beyond = {name: outside(finger) for name, finger in drawn.items()}
    return ByCell(loose, held, loose_end, held_end, stretch, grasps, beyond)


def curve(scene: Any) -> tuple[Solution, Solution]:
    """(a finger at PRESSURES, as a batch; the same BEYOND its last state, as a batch of one).

    Beyond the end that the latter tells nothing is computed: there it stands for every state.
    """
    end = solve(scene, BEYOND)
    last = last_pressure(_together([end]))
    batch = (
        dataclasses.replace(end, pressure=jnp.asarray(pressure)) if pressure > last else solve(scene, float(pressure))
        for pressure in PRESSURES
    )
    return _together(batch), _together([end])


def one(scene: Any, pressure: float) -> Solution:
    """A scene at one pressure (Pa), as a batch of one."""
    return _together([solve(scene, pressure)])


def _together(solutions: Iterable[Solution]) -> Solution:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *map(jax.device_get, solutions))


def touched_radius(fingers: Fingers, name: str) -> float:
    """Where the tips touch an object, m, as in the rows of the thesis's chambers: on the faces of the cylinders, and on
    cones in the middle of where the printed pressures allow it to be."""
    if name == "hexagonal cylinder":
        return thesis.apothem()
    if name not in RADII:
        return thesis.BASE_RADIUS + thesis.CYLINDER_OFFSET
    radii = touching_radii(fingers, name)
    return float((radii if radii.size else RADII[name]).mean())


def _largest_stretch(states: Solution) -> float:
    """Of the states of a curve at SHAPE_PRESSURES that exist."""
    there = [k for k in map(place, SHAPE_PRESSURES) if states.status[k] == Status.OK]
    shapes = (jax.tree.map(lambda leaf, k=k: leaf[k], states).shape(NODES) for k in there)
    return max(float(np.max(shape["stretch"])) for shape in shapes)


ENDS = (Reason.LIMIT_POINT, Reason.CELL_LAW_ENDS, Reason.CURLED_UP)
"""Reasons whose number is the last pressure."""


def last_pressure(end: Solution) -> float:
    """The pressure (Pa) at which the states of a finger end, known from one BEYOND; NaN where it is not known."""
    return float(end.detail[0]) if Reason(int(end.reason[0])) in ENDS else np.nan


def has_limit_point(end: Solution) -> bool:
    """Whether the states of a finger end at a limit point, and not where the cell law does."""
    return Reason(int(end.reason[0])) is Reason.LIMIT_POINT
