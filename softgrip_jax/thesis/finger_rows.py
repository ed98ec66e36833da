"""The rows of the comparison that are about fingers and grippers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..results import Status, in_units
from ..units import gram, mm
from . import printed as thesis
from .fingers import AT_21, AT_31, NODES, PRESSURES, RADII, STEP, Fingers
from .rows import Row, Verdict, deviation, missing, number, statement
from .shells import MEASURED, all_rising, rising


def rows(found: Fingers) -> list[Row]:
    """All numbers and trends of the finger."""
    return [*_figures(found), *_table_6_3(found), *_reach(found), *_statements(found), *_trends(found)]


def _figures(found: Fingers) -> list[Row]:
    modulus = {kind: printed.value / 3 for kind, printed in thesis.YOUNG.items()}  # (6.1) with nu = 1/2
    table = [
        number("table 5.1", f"mu of types {kinds} from E, (6.1)", thesis.SHEAR[kind], modulus[kind])
        for kind, kinds in (("A", "A and C"), ("B", "B and D"))
    ]
    tip = in_units(found.free["A"].tip[AT_31], "position")
    blocked, held = found.blocked["A 0"], found.held
    return [
        *table,
        *(
            missing("table 5.1", f"E of types {kinds}", str(thesis.YOUNG[kind]), MEASURED)
            for kind, kinds in (("A", "A and C"), ("B", "B and D"))
        ),
        missing("figure 5.5", "shape of type A in free space, 31 kPa", "", "a figure without numbers", f"tip at {tip}"),
        number("figure 5.6", "tip force of type A, 31 kPa", thesis.FIGURE_5_6, blocked.tip_force[AT_31]),
        _stepped("figure 5.7", "pressure of type A around the cylinder of 26 g", thesis.FIGURE_5_7, held.pressure[0]),
    ]


def overshoots(printed: Any, ours: Any) -> Any:
    """Whether a printed pressure is what algorithm 7 makes of ours (Pa)."""
    return (printed - ours > 0) & (printed - ours <= 2 * STEP)


def _stepped(source: str, what: str, printed: thesis.Printed, ours: Any) -> Row:
    reason = (
        "algorithm 7 raises the pressure before it tests, so it reports a step more than it found, and found up to a "
        "step "
        "too much; steps of 1 kPa are enough"
    )
    return number(source, what, printed, ours, reason, bool(overshoots(printed.value, float(ours))))


def touching_radii(found: Fingers, name: str) -> np.ndarray:
    """Radii (m) at which the tips would have to touch an object for all its printed pressures to be overshoots."""
    radii, known = RADII[name], thesis.TABLE_6_3[name]
    fine = np.linspace(radii[0], radii[-1], 701)
    fits = np.ones(fine.shape, dtype=bool)
    for k, printed in enumerate(known.values()):
        if printed is not None:
            fits &= overshoots(printed.value, np.interp(fine, radii, found.needed[name][k, : len(radii)]))
    return fine[fits]


def _table_6_3(found: Fingers) -> list[Row]:
    rows = []
    for name, known in thesis.TABLE_6_3.items():
        what = f"pressure, {name} of {thesis.MASSES[name] / gram:.0f} g, type"
        if name == "circular cylinder":
            rows += [
                _stepped("table 6.3", f"{what} {kind}", p, found.needed[name][k, 0])
                for k, (kind, p) in enumerate(known.items())
                if p
            ]
            continue
        radii = touching_radii(found, name)
        for k, (kind, printed) in enumerate(known.items()):
            if name == "hexagonal cylinder":
                rows.append(_hexagon(found, f"{what} {kind}", k, printed, radii))
            elif printed is not None:
                ours = np.interp(radii.mean(), RADII[name], found.needed[name][k]) if radii.size else np.nan
                rows.append(
                    missing(
                        "table 6.3",
                        f"{what} {kind}",
                        str(printed),
                        _cone(name, radii),
                        in_units(ours, "pressure"),
                        deviation(printed, ours),
                    )
                )
    return rows


def _hexagon(found: Fingers, what: str, k: int, printed: thesis.Printed | None, radii: np.ndarray) -> Row:
    ours = float(found.needed["hexagonal cylinder"][k, -1])
    if printed is None:
        reason = "the thesis's solver found nothing; there is a solution"
        exists = np.isfinite(ours)
        verdict = Verdict.EXPLAINED if exists else Verdict.DIFFERS
        return Row("table 6.3", what, thesis.NO_SOLUTION, in_units(ours, "pressure"), "", verdict, reason)
    faces = in_units(thesis.apothem() - thesis.BASE_RADIUS, "length")
    reason = f"its y_c is not printed; ours is where the faces of the hexagon are ({faces})"
    if radii.size:
        low, high = (in_units(r - thesis.BASE_RADIUS, "length") for r in (radii[0], radii[-1]))
        reason += (
            f"; a y_c of {low} to {high}, behind these faces, makes all three printed pressures overshoots of up to "
            "two steps of 1 kPa (algorithm 7)"
        )
    return missing("table 6.3", what, str(printed), reason, in_units(ours, "pressure"), deviation(printed, float(ours)))


def _cone(name: str, radii: np.ndarray) -> str:
    if not radii.size:
        return "where the tips touch is not printed"
    wide, high = thesis.CONES[name]
    levels = [in_units(high * (1 - r / wide), "length") for r in (radii[-1], radii[0])]
    return (
        f"where the tips touch is not printed; {levels[0]} to {levels[1]} above the base makes all four pressures "
        "overshoots of "
        "up to two steps (algorithm 7); ours is in the middle of that"
    )


def _reach(found: Fingers) -> list[Row]:
    """How far in pressure the thesis's solver went."""
    rows = []
    for kind, printed in thesis.FREE_UP_TO.items():
        status = np.asarray(found.free[kind].status)
        ours = PRESSURES[status == Status.OK].max()
        reason = (
            "the equations have equilibria to the end of our list, steps of ten to 71 kPa: the printed pressure is "
            "where the thesis's solver stopped"
        )
        what, said = f"type {kind} in free space is predicted up to", in_units(ours, "pressure")
        if np.all(status == Status.OK) and ours >= printed.value:
            row = Row("section 6.3.1", what, str(printed), f"at least {said}", "", Verdict.EXPLAINED, reason)
        else:
            row = Row("section 6.3.1", what, str(printed), said, deviation(printed, ours), Verdict.DIFFERS, "")
        rows.append(row)
    for kind, printed in thesis.BLOCKED_UP_TO.items():
        limit = found.limits[kind][0]
        reason = (
            "the printed law has a fold here: no equilibrium above it is connected to zero load. The thesis puts the "
            "end "
            "down to the solver, and says itself that the solver's solutions can be infeasible (section 6.3.2)"
        )
        rows.append(
            number(
                "section 6.3.2",
                f"type {kind}, tip held, is predicted up to",
                printed,
                limit,
                reason,
                bool(limit < printed.value),
            )
        )
    fe = {"free, B": "51", "free, D": "61", "tip held, A": "30", "tip held, C": "51", "tip held, B and D": "71"}
    rows += [
        missing(
            "section 6.3", f"FE model reaches, {what}", f"{p} kPa", "needs the thesis's FE model of the whole finger"
        )
        for what, p in fe.items()
    ]
    rows.append(
        missing(
            "section 6.3.2",
            "measured tip forces below 30 kPa are under",
            "0.1 N",
            MEASURED,
            f"type A at 21 kPa {in_units(found.blocked['A 0'].tip_force[1], 'force')}",
        )
    )
    return rows


def largest_stretch(found: Fingers) -> float:
    """Of all states of fingers that exist, free or held."""
    stretched = [
        found.free_shape[kind]["stretch"][np.asarray(found.free[kind].status) == Status.OK] for kind in thesis.KINDS
    ]
    return max(found.blocked_stretch, *(float(s.max()) for s in stretched))


def _statements(found: Fingers) -> list[Row]:
    """Section 5.2.3."""
    largest = largest_stretch(found) - 1
    moves = []
    for kind in thesis.KINDS:
        with_stretch, without = (np.asarray(s[kind].tip) for s in (found.free, found.unstretched))
        # As far as the thesis predicts free fingers: curled up beyond it, the tip comes back to the clamp.
        there = min(limit.value for limit in thesis.FREE_UP_TO.values()) >= PRESSURES
        there &= np.asarray(found.free[kind].tip_angle) < np.pi
        moves.append((np.linalg.norm(with_stretch - without, axis=1) / np.linalg.norm(with_stretch, axis=1))[there])
    move = max(np.nanmax(m) for m in moves)
    coarse, fine = _by_nodes(found, 4), _by_nodes(found, 1)
    nodes = np.nanmax(np.linalg.norm(coarse - fine, axis=-1) / np.linalg.norm(fine, axis=-1))
    spent = f"{1e3 * found.seconds:.2g} ms a state in a batch, compiled"
    return [
        statement(
            "section 5.2.3", "the axial stretch stays below 10 %", f"at most {100 * largest:.1f} %", largest < 0.1
        ),
        statement(
            "section 5.2.3",
            "without it the tip moves by less than 5 %",
            f"at most {100 * move:.1f} % of its distance, up to 61 kPa and half a turn",
            move < 0.05,
        ),
        statement(
            "section 5.2.3",
            "beyond 30 nodes the solution varies by less than 1 %",
            f"{100 * nodes:.2g} % from 30 to 120 intervals",
            nodes < 0.01,
            "trapezoidal (4.61), (4.62) as the thesis's",
        ),
        statement("section 5.2.3", "a solution takes less than 60 s", spent, found.seconds < 60),
        missing(
            "section 5.3", "an FE solution takes", "several hours", "needs the thesis's FE model of the whole finger"
        ),
    ]


def _by_nodes(found: Fingers, every: int) -> np.ndarray:
    """Tips of the free fingers by the trapezoidal rule (4.61), (4.62) on every so many nodes."""
    tips = []
    for kind in thesis.KINDS:
        shape = {name: value[:, ::every] for name, value in found.free_shape[kind].items()}
        rates = (shape["stretch"] * np.cos(shape["theta"]), shape["stretch"] * np.sin(shape["theta"]))
        tips.append(np.stack([np.trapezoid(rate, shape["X"], axis=1) for rate in rates], axis=-1))
    return np.array(tips)


def _bends(shapes: dict[str, np.ndarray], k: int) -> tuple[float, float]:
    """Mean theta' of the inner and of the outer third of a finger, 1/m, in the bending direction."""
    bend = -np.gradient(shapes["theta"][k], shapes["X"][k])
    return float(bend[: NODES // 3].mean()), float(bend[-NODES // 3 :].mean())


def _trends(found: Fingers) -> list[Row]:
    at_31 = {kind: found.free[kind].tip_angle[AT_31] for kind in thesis.KINDS}
    lengths = {
        k: [found.free[f"{k} {length / mm:.0f}"].tip_angle[0] for length in thesis.LENGTHS.values()] for k in "CD"
    }
    forces = {
        k: [found.blocked[f"{k} L {length / mm:.0f}"].tip_force[0] for length in thesis.LENGTHS.values()] for k in "CD"
    }
    dense, even = (_bends(found.free_shape[name], k) for name, k in (("nonuniform", 0), ("A", AT_21)))
    limits = {kind: found.limits[kind][[0, 3, 4]] for kind in thesis.KINDS}
    pitch = 2 * 0.75 + 4.5
    spare = {length / mm - count * pitch for count, length in thesis.LENGTHS.items()}
    return [
        statement(
            "figure 6.13",
            "every type bends more with more pressure",
            f"type B {in_units(found.free['B'].tip_angle[0], 'angle')} at 11 kPa, "
            f"{in_units(found.free['B'].tip_angle[4], 'angle')} at 51 kPa",
            all(rising(found.free[k].tip_angle) for k in thesis.KINDS),
        ),
        statement(
            "figure 6.13",
            "the stiffer silicone bends less (31 kPa)",
            ", ".join(f"{k} {in_units(v, 'angle')}" for k, v in at_31.items()),
            at_31["B"] < at_31["A"] and at_31["D"] < at_31["C"],
        ),
        statement(
            "figures 6.14-6.16",
            "fingers of 66, 78, 90 mm bend alike, the longer the more (31 kPa)",
            "; ".join(f"{k} {', '.join(in_units(v, 'angle') for v in row)}" for k, row in lengths.items()),
            all(all_rising(row) for row in lengths.values()),
        ),
        statement(
            "section 6.3.1",
            "9, 11 and 13 chambers make 66, 78 and 90 mm",
            f"{pitch:g} mm a chamber leaves {', '.join(f'{s:g}' for s in spare)} mm of each without chambers",
            len(spare) == 1,
            "the model spreads the chambers' moment over all of L",
        ),
        missing("figure 6.17", "the nonuniform finger's chambers", "", "its dimensions are not printed"),
        statement(
            "figure 6.17",
            "denser chambers towards the tip move the bending there (ours: 5.1 to 3.3 mm long, 21 kPa)",
            f"outer third {dense[1]:.1f}/m, evenly spaced {even[1]:.1f}/m; inner third {dense[0]:.1f}/m, "
            f"{even[0]:.1f}/m",
            dense[1] > even[1] and dense[0] < even[0],
        ),
        statement(
            "figure 6.19",
            "the tip force rises with the pressure, up to the fold",
            f"type A {in_units(found.blocked['A 0'].tip_force[0], 'force')} at 11 kPa, "
            f"{in_units(found.blocked['A 0'].tip_force[AT_31], 'force')} at 31 kPa",
            all(rising(found.blocked[f"{k} 0"].tip_force) for k in thesis.KINDS),
        ),
        statement(
            "figure 6.21",
            "at negative tip offsets there is no force beyond some pressure, sooner than at none",
            "limits at 0, -10, -20 mm: "
            + "; ".join(f"{k} " + ", ".join(in_units(p, "pressure") for p in row) for k, row in limits.items()),
            all(all_rising(-row) for row in limits.values()),
            "a fold of the equilibrium, no fault of the solver",
        ),
        statement(
            "figure 6.22",
            "the model applies to fingers of 66, 78, 90 mm; the longer press less (31 kPa)",
            "; ".join(f"{k} {', '.join(in_units(v, 'force') for v in row)}" for k, row in forces.items()),
            all(all_rising(-np.array(row)) for row in forces.values()),
        ),
        missing("figure 6.23", "the model bends more than experiment, FE less", "", MEASURED),
    ]
