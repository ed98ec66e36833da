"""What the cell law gives beside the rows of the comparison that are about fingers and grippers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..results import Solution, Status, in_units
from ..units import gram, kPa, mm
from . import printed as thesis
from .cell import PRESSURES, ByCell, has_limit_point, last_pressure, place, touched_radius
from .finger_rows import largest_stretch
from .fingers import AT_21, AT_31, RADII, Fingers
from .rows import Row
from .shells import all_rising, rising

P_11, P_21, P_31, P_41 = (place(p * kPa) for p in (11, 21, 31, 41))


class Beside(NamedTuple):
    """What stands beside one row: see `Row`."""

    cell: str
    ratio: str = ""
    remark: str = ""


def beside(rows: Sequence[Row], found: Fingers, by_cell: ByCell) -> list[Row]:
    """The same rows with what the cell law gives."""
    known = _figures(found, by_cell) | _grasps(found, by_cell) | _reach(found, by_cell) | _trends(found, by_cell)
    missed = known.keys() - {(row.source, row.quantity) for row in rows}
    assert not missed, f"no such rows: {missed}"
    return [
        row._replace(cell=it.cell, ratio=it.ratio, cell_remark=it.remark)
        if (it := known.get((row.source, row.quantity)))
        else row
        for row in rows
    ]


def text(by_cell: ByCell) -> str:
    """What the table means, in words."""
    beyond = {kind: by_cell.outside[kind] for kind in thesis.KINDS if by_cell.outside[kind]}
    fitted = "All four types of table 5.1 are within the dimensions that the cell law was fitted to."
    if beyond:
        said = "; ".join(f"type {kind}: {', '.join(what)}" for kind, what in beyond.items())
        fitted = f"The cell law was not fitted to all of these fingers ({said}), so their numbers may be further off."
    return (
        'Two laws push a finger in this package, the thesis\'s chambers (`drive="thesis"`, all of the table above) and '
        'the [cell law](theory/cell.md) (`drive="cell"`). The tip forces that the thesis measured lie near its own '
        "model, finite elements of chamber, walls, rims and cover lie near the cell law, and nobody knows yet why "
        f"([limits](limits.md)). {fitted} The ratio is that of the cell law to the thesis's chambers. Rows in which "
        "the law has no part are left out: moduli, what the thesis's finite elements took, nodes and seconds."
    )


def _number(ours: Any, chambers: Any, kind: str, why: str) -> Beside:
    """A number (SI) beside that of the thesis's chambers; `why` is said where there is none."""
    ours = float(ours)
    if not np.isfinite(ours):
        return Beside("-", "", why)
    return Beside(in_units(ours, kind), _ratio(ours, chambers))


def _ratio(ours: Any, chambers: Any) -> str:
    ratio = float(ours) / float(chambers)
    return f"{ratio:.2f}" if np.isfinite(ratio) else ""


def _reason(state: Solution, k: int = 0) -> str:
    """Why a state of a batch is none."""
    return "" if state.status[k] == Status.OK else state.reason_text()[k]


def _figures(found: Fingers, by_cell: ByCell) -> dict[tuple[str, str], Beside]:
    free, held = by_cell.free["A"], by_cell.held["A 0"]
    turn, turned = (float(angle) for angle in (free.tip_angle[P_31], found.free["A"].tip_angle[AT_31]))
    if free.status[P_31] == Status.OK:
        remark = f"the tip turns by {in_units(turn, 'angle')} in place of {in_units(turned, 'angle')}"
        if turn > WHOLE:
            remark += ": curled up so far a finger meets its own clamp, which neither model sees"
        shape = Beside(f"tip at {in_units(free.tip[P_31], 'position')}", _ratio(turn, turned) + " (turn)", remark)
    else:
        shape = Beside("-", "", _reason(free, P_31))
    force = _number(held.tip_force[P_31], found.blocked["A 0"].tip_force[AT_31], "force", _reason(held, P_31))
    last = last_pressure(by_cell.held_end["A 0"])
    if force.ratio and PRESSURES[P_31] < last < NEAR * PRESSURES[P_31]:
        near = f"just below the last pressure, {in_units(last, 'pressure')}, where the force rises steeply"
        force = force._replace(remark=near)
    at_21 = _number(held.tip_force[P_21], found.blocked["A 0"].tip_force[AT_21], "force", _reason(held, P_21))
    measured = at_21._replace(
        cell=f"type A at 21 kPa {at_21.cell}",
        remark=at_21.remark or ("more than was measured" if held.tip_force[P_21] > MEASURED else "as was measured"),
    )
    around = by_cell.grasps["circular cylinder"]
    where = max(by_cell.stretch, key=lambda name: by_cell.stretch[name])
    stretch = by_cell.stretch[where] - 1
    return {
        ("figure 5.5", "shape of type A in free space, 31 kPa"): shape,
        ("figure 5.6", "tip force of type A, 31 kPa"): force,
        ("figure 5.7", "pressure of type A around the cylinder of 26 g"): _number(
            around.pressure[0], found.held.pressure[0], "pressure", _reason(around)
        ),
        ("section 6.3.2", "measured tip forces below 30 kPa are under"): measured,
        ("section 5.2.3", "the axial stretch stays below 10 %"): Beside(
            f"at most {100 * stretch:.1f} %, at 11, 21, 31 and 41 kPa",
            _ratio(stretch, largest_stretch(found) - 1),
            f"{_holds(stretch < 0.1)}: the most is of {where}",
        ),
        ("section 5.2.3", "without it the tip moves by less than 5 %"): Beside(
            "-", "", "the cell law has no cover that does not stretch"
        ),
    }


WHOLE = 2 * np.pi
"""A whole turn, rad."""
NEAR = 1.02
"""Up to so many times a pressure the last one is said to be near."""
MEASURED = 0.1
"""N: the tip forces that the thesis measured below 30 kPa are smaller."""


def _grasps(found: Fingers, by_cell: ByCell) -> dict[tuple[str, str], Beside]:
    """Table 6.3, with the tips where they are in its rows."""
    seen = {}
    for name, mass in thesis.MASSES.items():
        held, radius = by_cell.grasps[name], touched_radius(found, name)
        for k, kind in enumerate(thesis.KINDS):
            chambers = found.needed[name][k]
            needed = np.interp(radius, RADII[name], chambers[: len(RADII[name])]) if name in thesis.CONES else None
            chambers = chambers[-1] if needed is None else needed
            seen["table 6.3", f"pressure, {name} of {mass / gram:.0f} g, type {kind}"] = _number(
                held.pressure[k], chambers, "pressure", _reason(held, k)
            )
    return seen


def _reach(found: Fingers, by_cell: ByCell) -> dict[tuple[str, str], Beside]:
    """Up to which pressure there are states, and what ends them."""
    seen = {}
    for kind in thesis.FREE_UP_TO:
        end = by_cell.free_end[kind]
        last = last_pressure(end)
        cell = in_units(last, "pressure")
        seen["section 6.3.1", f"type {kind} in free space is predicted up to"] = Beside(cell, "", _reason(end))
    for kind in thesis.BLOCKED_UP_TO:
        end = by_cell.held_end[f"{kind} 0"]
        last = last_pressure(end)
        ratio = _ratio(last, found.limits[kind][0]) if has_limit_point(end) else ""
        what = f"type {kind}, tip held, is predicted up to"
        seen["section 6.3.2", what] = Beside(in_units(last, "pressure"), ratio, _reason(end))
    return seen


def _holds(trend: Any) -> str:
    return "holds" if bool(trend) else "does not hold"


def _angles(solutions: Sequence[Solution], k: int) -> np.ndarray:
    return np.array([float(solution.tip_angle[k]) for solution in solutions])


def _forces(solutions: Sequence[Solution], k: int) -> np.ndarray:
    return np.array([float(solution.tip_force[k]) for solution in solutions])


def _listed(values: Any, kind: str) -> str:
    return ", ".join(in_units(value, kind) for value in values)


def _span(ours: Any, chambers: Any) -> str:
    """The ratios of several numbers, from the smallest to the largest."""
    ratios = np.asarray(ours) / np.asarray(chambers)
    ratios = ratios[np.isfinite(ratios)]
    return f"{ratios.min():.2f} to {ratios.max():.2f}" if ratios.size else ""


def _trends(found: Fingers, by_cell: ByCell) -> dict[tuple[str, str], Beside]:
    kinds = thesis.KINDS
    types = _angles([by_cell.free[k] for k in kinds], P_31)
    chambers = _angles([found.free[k] for k in kinds], AT_31)
    at_31 = dict(zip(kinds, types, strict=True))
    names = [f"{length / mm:.0f}" for length in thesis.LENGTHS.values()]
    lengths = {k: _angles([by_cell.free[f"{k} {name}"] for name in names], 0) for k in "CD"}
    forces = {k: _forces([by_cell.held[f"{k} L {name}"] for name in names], 0) for k in "CD"}
    old_lengths = [_angles([found.free[f"{k} {name}"] for name in names], 0) for k in "CD"]
    old_forces = [_forces([found.blocked[f"{k} L {name}"] for name in names], 0) for k in "CD"]
    turn, force = by_cell.free["B"].tip_angle, by_cell.held["A 0"].tip_force
    old_turn, old_force = found.free["B"].tip_angle, found.blocked["A 0"].tip_force
    nonuniform = by_cell.outside["nonuniform"]
    last = in_units(last_pressure(by_cell.free_end["B"]), "pressure")
    limits = _limits(by_cell)
    return {
        ("figure 6.13", "every type bends more with more pressure"): Beside(
            f"type B {in_units(turn[P_11], 'angle')} at 11 kPa, {in_units(turn[P_41], 'angle')} at 41 kPa",
            _span([turn[P_11], turn[P_41]], [old_turn[0], old_turn[3]]),
            f"{_holds(all(rising(by_cell.free[k].tip_angle) for k in kinds))}; type B ends at {last}",
        ),
        ("figure 6.13", "the stiffer silicone bends less (31 kPa)"): Beside(
            ", ".join(f"{k} {in_units(v, 'angle')}" for k, v in at_31.items()),
            _span(types, chambers),
            _holds(at_31["B"] < at_31["A"] and at_31["D"] < at_31["C"]),
        ),
        ("figures 6.14-6.16", "fingers of 66, 78, 90 mm bend alike, the longer the more (31 kPa)"): Beside(
            "; ".join(f"{k} {_listed(row, 'angle')}" for k, row in lengths.items()),
            _span(list(lengths.values()), old_lengths),
            _holds(all(all_rising(row) for row in lengths.values())),
        ),
        (
            "figure 6.17",
            "denser chambers towards the tip move the bending there (ours: 5.1 to 3.3 mm long, 21 kPa)",
        ): Beside("-", "", f"the cell law was not fitted to such chambers: {'; '.join(nonuniform)}"),
        ("figure 6.19", "the tip force rises with the pressure, up to the fold"): Beside(
            f"type A {in_units(force[P_11], 'force')} at 11 kPa, {in_units(force[P_31], 'force')} at 31 kPa",
            _span([force[P_11], force[P_31]], [old_force[0], old_force[AT_31]]),
            _holds(all(rising(by_cell.held[f"{k} 0"].tip_force) for k in kinds)),
        ),
        ("figure 6.21", "at negative tip offsets there is no force beyond some pressure, sooner than at none"): limits,
        ("figure 6.22", "the model applies to fingers of 66, 78, 90 mm; the longer press less (31 kPa)"): Beside(
            "; ".join(f"{k} {_listed(row, 'force')}" for k, row in forces.items()),
            _span(list(forces.values()), old_forces),
            _holds(all(all_rising(-row) for row in forces.values())),
        ),
    }


def _limits(by_cell: ByCell) -> Beside:
    """Limit points of held fingers by offset, figure 6.21; where there is none, what ends the states in its place."""
    offsets = [thesis.TIP_OFFSETS[k] for k in (0, 3, 4)]
    said, words = [], []
    falling: dict[str, list[str]] = {}
    for kind in thesis.KINDS:
        names = {f"{offset / mm:.0f}": by_cell.held_end[f"{kind} {offset / mm:.0f}"] for offset in offsets}
        folds = {name: last_pressure(end) for name, end in names.items() if has_limit_point(end)}
        said.append(f"{kind} " + ", ".join(_limit(end) for end in names.values()))
        if len(folds) == len(offsets):
            falling.setdefault(_holds(all_rising(-np.array(list(folds.values())))), []).append(kind)
        ended: dict[str, list[str]] = {}
        for name in names:
            if name not in folds:
                ended.setdefault(_end_in_words(by_cell, kind, name), []).append(name)
        words += [f"type {kind} at {', '.join(at)} mm: {why}" for why, at in ended.items()]
    words = [f"{holds} for {' and '.join(of)}" for holds, of in falling.items()] + words
    return Beside(f"limits at 0, -10, -20 mm: {'; '.join(said)}", "", "; ".join(words))


def _limit(end: Solution) -> str:
    """The limit point of a held finger."""
    last = last_pressure(end)
    return in_units(last, "pressure") if has_limit_point(end) else "none" if np.isfinite(last) else "not known"


def _end_in_words(by_cell: ByCell, kind: str, offset: str) -> str:
    """What ends the states of a held finger that has no limit point, and up to where they were found if it is a solver
    that stopped."""
    end, curve = by_cell.held_end[f"{kind} {offset}"], by_cell.held[f"{kind} {offset}"]
    if np.isfinite(last_pressure(end)):
        return _reason(end)
    found = np.flatnonzero(curve.status == Status.OK)
    return f"{_reason(end)} (solved up to {in_units(PRESSURES[found[-1]], 'pressure')})" if found.size else _reason(end)
