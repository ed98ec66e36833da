"""What is compared of a finger: its cell, straight, at the curvatures of its solution, and bending freely."""

from __future__ import annotations

import dataclasses
import math
import warnings
from typing import Any

import numpy as np

from .. import pneunet
from ..errors import CellRangeWarning, InputError
from ..pneunet.finger_scene import FingerScene
from ..pneunet.section.choice import section_law
from ..pneunet.wall.arc import gap_share
from ..questions import solve
from ..results import Status
from .run import Target

QUANTITIES = {
    "moment": "moment",
    "contact_force": "force",
    "lever_arm": "length",
    "stretch": "number",
    "free_curvature": "curvature",
}
OF_COVER = {"tip_force": "force", "tip_angle": "angle"}
SHARES = (1 / 3, 2 / 3, 1.0)
"""Of the pressure, at which a straight cell is compared."""
APART = 0.05
"""Curvatures nearer to each other than this part of the turn of two walls' gap closing are one."""
PLACES = 101
"""Along the finger."""


def is_finger(scene: Any) -> bool:
    """Whether a scene is a finger, or a cell of one."""
    return isinstance(scene, FingerScene | pneunet.Cell)


def uniform(scene: Any) -> Any:
    """The finger of a scene.

    Raises:
        InputError: where its segments differ, and for a cell under an axial force.
    """
    if isinstance(scene, pneunet.Cell) and float(scene.axial_force) != 0:
        raise InputError(
            f"Cell.axial_force is {float(scene.axial_force):.4g} N; finite elements are there for cells without one."
        )
    if scene.finger.segments is not None:
        raise InputError("the finger has segments of its own; finite elements are there for uniform fingers.")
    return scene.finger


def curvatures_of(scene: Any, pressure: float) -> list[float]:
    """The least and the largest curvature (1/m, positive as the chambers bend) of a finger's solution; none where it
    has no state, that of the scene where it is a cell."""
    if isinstance(scene, pneunet.Cell):
        return [float(scene.curvature)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)
        solution = solve(scene, pressure)
    if int(solution.status) not in (Status.OK, Status.NO_CONTACT):
        return []
    shape = solution.shape(PLACES)
    bent = -np.gradient(np.asarray(shape["theta"]), np.asarray(shape["X"]))
    return [float(np.min(bent)), float(np.max(bent))] if np.all(np.isfinite(bent)) else []


def targets_of(scene: Any, pressure: float) -> list[Target]:
    """Straight at three pressures, bent as the solution is, and free at the last pressure."""
    finger: Any = uniform(scene)
    apart = APART * float(finger.h_x / (finger.a * (finger.h_L + 2 * finger.h_x)))
    bent: list[float] = []
    for curvature in sorted(curvatures_of(scene, pressure), key=abs):
        rounded = float(f"{curvature:.3g}")
        if all(abs(rounded - other) > apart for other in [0.0, *bent]):
            bent.append(rounded)
    straight = [Target(share * pressure, 0.0) for share in SHARES]
    return [*straight, *(Target(pressure, one) for one in bent), Target(pressure, free=True)]


def drives_of(scene: Any) -> dict[str, Any]:
    """The same finger by each of its two drives, bending freely without loads."""
    options = {"weight": None}
    if isinstance(scene, FingerScene):
        given: Any = scene
        options |= {"section": given.section, "inclination": given.inclination, "moment_spread": given.moment_spread}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)
        thesis = pneunet.Free(scene.finger, drive="thesis", **options)
        return {"thesis": thesis, "cell": dataclasses.replace(thesis, drive="cell")}


def model_values(scene: Any, targets: list[Target]) -> dict[str, list[dict[str, float]]]:
    """What both drives say at each target, in SI; empty where one says nothing."""
    free = drives_of(scene)
    found: dict[str, list[dict[str, float]]] = {"thesis": [], "cell": []}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)
        for target in targets:
            for name, values in found.items():
                if target.free:
                    values.append(_free(free[name], target.pressure))
                elif name == "thesis":
                    values.append(_thesis(free["thesis"], target))
                else:
                    values.append(_cell(scene.finger, target))
    return found


def _free(scene: Any, pressure: float) -> dict[str, float]:
    solution = solve(scene, pressure)
    if int(solution.status) != Status.OK:
        return {}
    return {"free_curvature": float(solution.tip_angle / scene.finger.L)}


def inclination_of(scene: Any, curvature: float) -> float:
    """How the walls of the thesis's chambers incline at a curvature (1/m), rad."""
    finger = scene.finger
    lengths = {"segment": 0.5 * float(finger.pitch), "gap": float(finger.h_x), "none": 0.0}
    return lengths[scene.inclination] * max(curvature, 0.0)


def chamber_at(scene: Any, curvature: float) -> Any:
    """The thesis's chamber of a finger that is bent to a curvature (1/m)."""
    return pneunet.Chamber(scene.finger, inclination=inclination_of(scene, curvature))


def _thesis(scene: Any, target: Target) -> dict[str, float]:
    """M_ext = M(kappa) of the cover alone less M_T of the chambers."""
    finger, curvature = scene.finger, target.curvature or 0.0
    wall = pneunet.chamber(finger, target.pressure, inclination_of(scene, curvature))
    if int(wall.status) not in (Status.OK, Status.NO_CONTACT):
        return {}
    pushes = float(wall.end_moment) / (float(gap_share(finger)) if scene.moment_spread == "none" else 1.0)
    law = section_law(scene.section, finger.material)
    law_moment = float(law.bent(curvature * finger.H, 0.0 * finger.H)[0]) * float(finger.moment_scale())
    found = {"moment": law_moment - pushes, "contact_force": float(wall.force)}
    if float(wall.force) > 0:
        found["lever_arm"] = float(wall.lever_arm)
    return found | {"stretch": float(law.bent(curvature * finger.H, 0.0 * finger.H)[1])}


def _cell(finger: Any, target: Target) -> dict[str, float]:
    solution = solve(pneunet.Cell(finger, curvature=target.curvature or 0.0), target.pressure)
    if int(solution.status) != Status.OK:
        return {}
    names = ("moment", "contact_force", "lever_arm", "stretch")
    values = {name: float(solution.observables[name]) for name in names}
    return {name: value for name, value in values.items() if math.isfinite(value)}


MANY_MOMENTS = (
    "The cell is compared, the beam itself is not: as the walls incline, every chamber has a moment of its own, and "
    "finite elements of the cover are there for one moment alone."
)


def held_cover(scene: Any, pressure: float) -> tuple[float, dict[str, float]] | None:
    """The chambers' moment (N m) on the cover of a finger whose tip is held at y = 0, and what our beam says of it.

    None for other fingers: with loads, the cell law, a tip that is held elsewhere, or walls that incline, which give
    every part a moment of its own.
    """
    if not isinstance(scene, pneunet.TipContact) or scene.drive != "thesis" or scene.weight is not None:
        return None
    if scene.inclines():
        return None
    given: Any = scene
    if float(given.tip_offset) != 0 or float(given.tip_pull) != 0:
        return None
    solution = solve(scene, pressure)
    if int(solution.status) != Status.OK:
        return None
    return float(solution.end_moment), {name: float(solution.observables[name]) for name in OF_COVER}
