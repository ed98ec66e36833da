"""The states and the curves of the comparison as pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .. import plots
from ..plots import Curve, Diagram
from ..results import Solution, Status
from ..units import degree, kPa, mm
from . import printed as thesis
from . import shells as shell_rows
from .cell import ByCell
from .fingers import AT_31, Fingers
from .rows import member
from .shells import Shells


def pictures(shells: Shells, fingers: Fingers, by_cell: ByCell) -> Iterator[tuple[str, str, Any]]:
    """(name, caption, figure) of each."""
    yield "figure_5_1", "Figure 5.1: free inflation, 15 kPa.", plots.draw(member(shells.free["figure"], 0))
    yield "figure_5_2", "Figure 5.2: a plane at 5 mm, 15 kPa.", plots.draw(member(shells.flat["figure"], 0))
    yield "figure_5_3", "Figure 5.3: a cylinder at 5 mm, 15 kPa.", plots.draw(member(shells.cylinder["figure"], 0))
    yield "figure_5_4", "Figure 5.4: the grasp of the cylinder of 137 g at 5 mm.", plots.draw(member(shells.held, 0))
    yield "figure_5_5", "Figure 5.5: type A in free space, 31 kPa.", plots.draw(member(fingers.free["A"], AT_31))
    yield "figure_5_6", "Figure 5.6: type A, tip held, 31 kPa.", plots.draw(member(fingers.blocked["A 0"], AT_31))
    yield (
        "figure_5_7",
        "Figure 5.7: three fingers of type A around the cylinder of 26 g.",
        plots.draw(member(fingers.held, 0)),
    )
    yield (
        "shell_curves",
        "The shell over pressure and offset (figures 6.4, 6.6 to 6.9), with the printed values.",
        plots.diagrams(_shell(shells)),
    )
    yield (
        "finger_curves",
        "The finger over pressure (figures 6.13, 6.19, 6.21), with the printed value.",
        plots.diagrams(_finger(fingers)),
    )
    yield (
        "finger_cell",
        "The finger over pressure by the thesis's chambers and by the cell law, types A and B: above free and held "
        "fingers by both, below the held ones at several tip offsets (figure 6.21) by the cell law alone.",
        plots.diagrams(_by_cell(fingers, by_cell)),
    )
    yield "table_6_2", "What the rows of table 6.2 need.", plots.diagrams(_tilt(shells))


def _curve(label: str, solution: Solution, name: str, unit: float) -> Curve:
    y = np.where(np.asarray(solution.status) == Status.OK, np.asarray(solution.observables[name]) / unit, np.nan)
    return Curve(label, np.asarray(solution.pressure) / kPa, y)


def _mark(printed: thesis.Printed, unit: float, pressure: float = thesis.FIGURE_PRESSURE) -> list[Curve]:
    return [Curve("printed", np.array([pressure / kPa]), np.array([printed.value / unit]))]


def _shell(found: Shells) -> list[Diagram]:
    p = "pressure (kPa)"
    near, over_gap = found.cylinder["5"], found.cylinder["gaps"]
    scene: Any = over_gap.scene
    gap = np.asarray(scene.gap) / mm
    e, theta = np.asarray(over_gap.flat_length) / mm, np.asarray(over_gap.contact_angle) / degree
    forces = [_curve(f"{g / mm:g} mm", found.cylinder[f"{g / mm:g}"], "force_z", 1.0) for g in thesis.GAPS]
    planes = [_curve(f"{g} mm", found.flat[str(g)], "force", 1.0) for g in (5, 10)]
    free = [_curve("", found.free["pressures"], "inflation", mm)]
    angles, lengths = "contact angle (deg)", "flat length e (mm)"
    return [
        Diagram("figure 6.4", p, "inflation (mm)", free, _mark(thesis.FIGURE_5_1, mm)),
        Diagram("figure 6.6: plane, by distance", p, "force (N)", planes, _mark(thesis.FIGURE_5_2, 1.0)),
        Diagram("figure 6.7: cylinder, by $d - r$", p, "$F_z$ (N)", forces, _mark(thesis.FIGURE_5_3, 1.0)),
        Diagram("figure 6.8: 5 mm", p, angles, [_curve("", near, "contact_angle", degree)]),
        Diagram("figure 6.8: 5 mm", p, lengths, [_curve("", near, "flat_length", mm)]),
        Diagram(
            "figure 6.9: 20 kPa",
            "offset $d - r$ (mm)",
            "deg or mm",
            [Curve("contact angle (deg)", gap, theta), Curve("e (mm)", gap, e)],
        ),
    ]


def _finger(found: Fingers) -> list[Diagram]:
    p = "pressure (kPa)"
    angles = [_curve(f"type {k}", found.free[k], "tip_angle", degree) for k in thesis.KINDS]
    forces = [_curve(f"type {k}", found.blocked[f"{k} 0"], "tip_force", 1.0) for k in thesis.KINDS]
    mark = _mark(thesis.FIGURE_5_6, 1.0, thesis.FINGER_PRESSURE)

    def offsets(kind: str) -> list[Curve]:
        order = sorted(thesis.TIP_OFFSETS)
        return [_curve(f"{y / mm:.0f} mm", found.blocked[f"{kind} {y / mm:.0f}"], "tip_force", 1.0) for y in order]

    return [
        Diagram("figure 6.13: free", p, "tip angle (deg)", angles),
        Diagram("figure 6.19: tip held", p, "tip force (N)", forces, mark),
        Diagram("figure 6.21: type A, by tip offset", p, "tip force (N)", offsets("A")),
        Diagram("figure 6.21: type B, by tip offset", p, "tip force (N)", offsets("B")),
    ]


def _by_cell(found: Fingers, by_cell: ByCell) -> list[Diagram]:
    p = "pressure (kPa)"
    mark = _mark(thesis.FIGURE_5_6, 1.0, thesis.FINGER_PRESSURE)

    def both(old: dict[str, Solution], new: dict[str, Solution], suffix: str, name: str, unit: float) -> list[Curve]:
        pairs = ((kind, words, group) for kind in "AB" for words, group in (("thesis", old), ("cell", new)))
        return [_curve(f"{kind}, {words}", group[kind + suffix], name, unit) for kind, words, group in pairs]

    def offsets(kind: str) -> list[Curve]:
        order = sorted(thesis.TIP_OFFSETS)
        return [_curve(f"{y / mm:.0f} mm", by_cell.held[f"{kind} {y / mm:.0f}"], "tip_force", 1.0) for y in order]

    return [
        Diagram("tip free", p, "tip angle (deg)", both(found.free, by_cell.free, "", "tip_angle", degree)),
        Diagram("tip held", p, "tip force (N)", both(found.blocked, by_cell.held, " 0", "tip_force", 1.0), mark),
        Diagram("cell law: type A, by tip offset", p, "tip force (N)", offsets("A")),
        Diagram("cell law: type B, by tip offset", p, "tip force (N)", offsets("B")),
    ]


def _tilt(found: Shells) -> list[Diagram]:
    t: Any = shell_rows.tilt(found)
    force = np.geomspace(t.force.min(), t.force.max(), 60)
    light, heavy = slice(1, 4), slice(5, 8)
    return [
        Diagram(
            "friction by the printed traction",
            "normal force $F_c$ (N)",
            "$F_t / F_c$",
            [Curve(f"{t.constant:.2f} $F_c^{{{t.exponent:.3f}}}$", force, t.law(force))],
            [Curve("table 6.2", t.force, t.traction)],
        ),
        Diagram(
            "friction that (3.41) needs",
            "normal force $F_c$ (N)",
            r"$\mu_f$",
            [Curve("263 g", t.force[light], t.rim[light]), Curve("563 g", t.force[heavy], t.rim[heavy])],
        ),
    ]
