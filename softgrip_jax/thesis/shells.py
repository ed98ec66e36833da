"""The thesis's numbers of the flat shell, recomputed."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from ..questions import pressure_for
from ..results import Solution, in_units
from ..shell.arc.grasp import tilt_moment
from ..units import GRAVITY, gram, kPa, mm
from . import printed as thesis
from .rows import Batch, Row, deviation, missing, number, stacked, statement

PRESSURES = np.arange(1.0, 25.01, 0.5) * kPa
"""Of the curves; the thesis goes to 20 kPa."""
MODULI = np.arange(174.5, 175.5, 0.01) * kPa
"""All that 175 kPa may stand for."""


class Shells(NamedTuple):
    """Solutions by group."""

    free: dict[str, Solution]
    flat: dict[str, Solution]
    cylinder: dict[str, Solution]
    grasp: dict[str, Solution]
    held: Solution
    """The rows of table 6.1 at the pressure that holds them."""
    friction: np.ndarray
    """Of the rows of table 6.1."""
    seconds: float
    """Of one state among a batch, compiled."""


def compute() -> Shells:
    """Every state of the shell that the rows and the pictures need."""
    at_15 = [thesis.FIGURE_PRESSURE] * len(MODULI)
    free, flat, cylinder, grasp = Batch(), Batch(), Batch(), Batch()
    free.add("figure", [thesis.free_shell()], [thesis.FIGURE_PRESSURE])
    free.add("moduli", [thesis.free_shell(mu) for mu in MODULI], at_15)
    free.add("pressures", [thesis.free_shell()] * len(PRESSURES), PRESSURES)
    flat.add("figure", [thesis.flat_contact()], [thesis.FIGURE_PRESSURE])
    flat.add("moduli", [thesis.flat_contact(mu) for mu in MODULI], at_15)
    for gap in (5 * mm, 10 * mm):
        flat.add(f"{gap / mm:g}", [thesis.flat_contact(gap=gap)] * len(PRESSURES), PRESSURES)
    cylinder.add("figure", [thesis.cylinder_contact()], [thesis.FIGURE_PRESSURE])
    cylinder.add("moduli", [thesis.cylinder_contact(mu) for mu in MODULI], at_15)
    for gap in thesis.GAPS:
        cylinder.add(f"{gap / mm:g}", [thesis.cylinder_contact(gap=gap)] * len(PRESSURES), PRESSURES)
    gaps = np.linspace(3, 10, 15) * mm
    cylinder.add("gaps", [thesis.cylinder_contact(gap=gap) for gap in gaps], [20 * kPa] * len(gaps))
    cylinder.add(
        "tilt", [thesis.cylinder_contact()] * len(thesis.TABLE_6_2), [r.pressure.value for r in thesis.TABLE_6_2]
    )
    # Table 6.1: the pressure at 5 mm says which friction was meant; all else of the object then follows.
    near = [row for row in thesis.TABLE_6_1 if row.gap == thesis.GAP]
    grasp.add("near", [thesis.shell_grasp()] * len(near), [row.pressure.value for row in near])
    misprint = thesis.TABLE_6_1[3]
    grasp.add("misprint", [thesis.shell_grasp(gap=misprint.gap)], [misprint.pressure.value + misprint.pressure.digit])
    pushed = grasp.solve()
    needed = {row.mass: row.mass * GRAVITY / 2 / float(f) for row, f in zip(near, pushed["near"].force, strict=True)}
    friction = np.array([needed[row.mass] for row in thesis.TABLE_6_1])
    rows = zip(thesis.TABLE_6_1, friction, strict=True)
    held = jax.jit(jax.vmap(pressure_for))(stacked([thesis.shell_grasp(row.gap, row.mass, mu) for row, mu in rows]))
    touched = cylinder.solve(timed=True)
    return Shells(free.solve(), flat.solve(), touched, pushed, held, friction, cylinder.seconds)


def rows(found: Shells) -> list[Row]:
    """All numbers and trends of the shell."""
    return [*_figures(found), *_table_6_1(found), *_table_6_2(found), *_trends(found), *_statements(found)]


# --- figures 5.1 to 5.3 -----------------------------------------------------------------------------------------------


def common_moduli(found: Shells) -> np.ndarray:
    """The moduli (Pa) that give all three figures to their printed digits."""
    values = (
        (thesis.FIGURE_5_1, found.free["moduli"].inflation),
        (thesis.FIGURE_5_2, found.flat["moduli"].force),
        (thesis.FIGURE_5_3, found.cylinder["moduli"].force_z),
    )
    fits = [np.abs(np.asarray(ours) - printed.value) <= 0.5 * printed.digit for printed, ours in values]
    return MODULI[np.all(fits, axis=0)]


def _figures(found: Shells) -> list[Row]:
    moduli = common_moduli(found) / kPa
    explained = moduli.size > 0
    reason = (
        f"mu is printed as {thesis.SHELL_MU}: {moduli.mean():.2f} kPa, which rounds to it, gives figures 5.1, 5.2 and "
        "5.3 "
        "to all their digits"
        if explained
        else ""
    )
    return [
        number(
            "figure 5.1", "inflation at 15 kPa", thesis.FIGURE_5_1, found.free["figure"].inflation[0], reason, explained
        ),
        number(
            "figure 5.2",
            "force on a plane at 5 mm, 15 kPa",
            thesis.FIGURE_5_2,
            found.flat["figure"].force[0],
            reason,
            explained,
        ),
        number(
            "figure 5.3",
            "F_z on a cylinder at 5 mm, 15 kPa",
            thesis.FIGURE_5_3,
            found.cylinder["figure"].force_z[0],
            reason,
            explained,
        ),
    ]


# --- tables 6.1 and 6.2 -----------------------------------------------------------------------------------------------


def _table_6_1(found: Shells) -> list[Row]:
    rows = []
    for k, row in enumerate(thesis.TABLE_6_1):
        source = "table 6.1" if k else "table 6.1, figure 5.4"
        what = f"{row.mass / gram:.0f} g at {row.gap / mm:.0f} mm"
        pressure, height = float(found.held.pressure[k]), float(found.held.height[k])
        if row.gap == thesis.GAP:
            reason = (
                f"mu_f is another for each object and not printed; {found.friction[k]:.3f} gives this pressure, and is "
                "used for the other three numbers of this object"
            )
            rows.append(missing(source, f"pressure, {what}", str(row.pressure), reason))
        else:
            rows.append(number(source, f"pressure, {what}", row.pressure, pressure))
        most = float(found.grasp["misprint"].height[0])
        misprint = k == 3 and most < row.height.value - row.height.digit
        reason = (
            f"a misprint, most likely: no pressure printed as {row.pressure} gives more than "
            f"{in_units(most, 'length')}, "
            "and every other row agrees"
        )
        rows.append(number(source, f"height h, {what}", row.height, height, reason, misprint))
    return rows


class Tilt(NamedTuple):
    """What the rows of table 6.2 imply."""

    force: np.ndarray
    """Normal force F_c at the printed pressure, N."""
    traction: np.ndarray
    """F_t / F_c: the coefficient by which the printed traction follows from that force."""
    rim: np.ndarray
    """mu_f that (3.41) needs with the moment (3.40); without eccentricity mu_f = m g / (2 F_c)."""
    exact: np.ndarray
    """The same with the exact moment."""
    constant: float
    exponent: float
    """F_t / F_c = constant (F_c / 1 N)^exponent, fitted to all rows."""

    def law(self, force: Any) -> Any:
        return self.constant * force**self.exponent


def tilt(found: Shells) -> Tilt:
    """Table 6.2: which friction coefficient each row needs."""
    state = found.cylinder["tilt"]
    force, pressure = np.asarray(state.force), state.pressure
    weight = np.array([row.mass for row in thesis.TABLE_6_2]) * GRAVITY
    away = np.array([row.eccentricity for row in thesis.TABLE_6_2])

    def needed(lever: str) -> np.ndarray:
        moments = jax.vmap(lambda a, b, p: tilt_moment(a, b, p, lever))(
            state.contact_half_width, state.contact_half_length, pressure
        )
        return np.where(away > 0, weight * away / np.asarray(moments), weight / 2 / force)

    traction = np.array([row.traction.value for row in thesis.TABLE_6_2]) / force
    exponent, logarithm = np.polyfit(np.log(force), np.log(traction), 1)
    return Tilt(force, traction, needed("rim"), needed("exact"), float(np.exp(logarithm)), float(exponent))


def _table_6_2(found: Shells) -> list[Row]:
    implied, rows = tilt(found), []
    for k, row in enumerate(thesis.TABLE_6_2):
        what = f"{row.mass / gram:.0f} g, x_e {row.eccentricity / mm:.0f} mm"
        ours = implied.law(implied.force[k]) * implied.force[k]
        rows.append(
            missing(
                "table 6.2",
                f"traction F_t, {what}",
                str(row.traction),
                f"mu_f is not printed; F_t is {implied.traction[k]:.3f} times our F_c ({implied.force[k]:.3g} N) at "
                "the "
                "printed pressure; ours is from the one law fitted to all rows",
                in_units(ours, "force"),
                deviation(row.traction, ours),
            )
        )
        if row.eccentricity > 0:
            reason = (
                f"mu_f is not printed; (3.41) needs {implied.rim[k]:.3f} with (3.40), {implied.exact[k]:.3f} with the "
                "exact moment"
            )
        else:
            reason = f"mu_f is not printed; lifting, (6.2), would need {implied.rim[k]:.2f}"
        rows.append(missing("table 6.2", f"pressure, {what}", str(row.pressure), reason))
    return rows


def tilt_text(found: Shells) -> str:
    """The answer to table 6.2 in words."""
    t = tilt(found)
    off = np.max(np.abs(t.law(t.force) / t.traction - 1))
    light, heavy = slice(1, 4), slice(5, 8)
    eccentric = np.array([row.eccentricity > 0 for row in thesis.TABLE_6_2])
    above = (t.law(t.force) / t.rim - 1)[eccentric]
    return (
        "**The friction of table 6.2.** The text gives no coefficient. Two questions have different answers. (i) *The "
        "traction.* "
        f"The printed F_t over our normal force at the printed pressure falls steadily from {t.traction.max():.2f} at "
        f"{t.force.min():.2f} N to {t.traction.min():.2f} at {t.force.max():.2f} N, the same for both objects: one "
        "law, "
        f"mu_f = {t.constant:.3f} (F_c / 1 N)^({t.exponent:.3f}), gives all eight F_t within {100 * off:.1f} %. "
        "(F_c depends on the pressure alone here, so this says that F_t was computed as a friction force, not that it "
        "balances a load.) "
        "(ii) *The pressure.* The coefficient that (3.41) needs with the thesis's own moment (3.40), all of m g x_e "
        "on one "
        f"finger, is {t.rim[light].min():.2f} to {t.rim[light].max():.2f} in the three rows of 263 g, so one constant "
        "explains "
        f"them; but {t.rim[heavy][0]:.2f}, {t.rim[heavy][1]:.2f} and {t.rim[heavy][2]:.2f} in those of 563 g. At "
        "nearly the same "
        f"normal force ({t.force[3]:.2f} and {t.force[5]:.2f} N) the two objects need {t.rim[3]:.2f} and "
        f"{t.rim[5]:.2f}, so no "
        f"law of the normal force explains both; that of (i) is {100 * above.min():.0f} to {100 * above.max():.0f} % "
        "above. Without eccentricity, (6.2) would need "
        f"{t.rim[0]:.1f} and {t.rim[4]:.1f}, more than table 6.1 implies for the same objects "
        f"({found.friction[1]:.2f} and {found.friction[2]:.2f}): those two pressures cannot come from lifting by "
        "(6.2). With half "
        "of the moment on each finger all coefficients of (ii) are half as large, and the conclusion is the same."
    )


# --- trends and statements --------------------------------------------------------------------------------------------


def rising(values: Any) -> bool:
    """Whether every value is above the one before; NaN (no state) is left out."""
    values = np.asarray(values)
    return bool(np.all(np.diff(values[np.isfinite(values)]) > 0))


def all_rising(values: Any) -> bool:
    """Rising, and every one of them there."""
    return bool(np.all(np.isfinite(np.asarray(values)))) and rising(values)


def touching(solution: Solution) -> np.ndarray:
    return np.asarray(solution.status) == 0


def _range(values: Any, kind: str) -> str:
    values = np.asarray(values)
    return f"{in_units(values[0], kind)} to {in_units(values[-1], kind)}"


def _trends(found: Shells) -> list[Row]:
    free = found.free["pressures"]
    rows = [
        statement(
            "figure 6.4",
            "the inflation rises with the pressure",
            _range(free.inflation[touching(free)], "length"),
            rising(free.inflation),
        )
    ]
    near, far = found.flat["5"], found.flat["10"]
    both = touching(near) & touching(far)
    rows.append(
        statement(
            "figure 6.6",
            "a plane at 5 mm feels more force than one at 10 mm, and both more with pressure",
            f"at 15 kPa {in_units(near.force[28], 'force')} and {in_units(far.force[28], 'force')}",
            rising(near.force[touching(near)]) and np.all(near.force[both] > far.force[both]),
        )
    )
    curves = [found.cylinder[f"{gap / mm:g}"] for gap in thesis.GAPS]
    forces = np.stack([np.where(touching(c), c.force_z, np.nan) for c in curves])
    shared = np.all(np.isfinite(forces), axis=0)
    rows.append(
        statement(
            "figure 6.7",
            "at one pressure the force on a cylinder is larger at a smaller offset (3, 5, 8, 10 mm)",
            "at 20 kPa " + ", ".join(in_units(f, "force") for f in forces[:, 38]),
            np.all(np.diff(forces[:, shared], axis=0) < 0),
        )
    )
    over_pressure, over_gap = found.cylinder["5"], found.cylinder["gaps"]
    on = touching(over_pressure)
    theta, flat = np.asarray(over_pressure.contact_angle)[on], np.asarray(over_pressure.flat_length)[on]
    theta_gap, flat_gap = np.asarray(over_gap.contact_angle), np.asarray(over_gap.flat_length)
    return [
        *rows,
        statement("figure 6.8", "theta_c rises with the pressure (5 mm)", _range(theta, "angle"), rising(theta)),
        statement("figure 6.8", "e falls with the pressure (5 mm)", _range(flat, "length"), rising(-flat)),
        statement(
            "figure 6.9",
            "theta_c falls with the offset (20 kPa, 3 to 10 mm)",
            _range(theta_gap, "angle"),
            rising(-theta_gap),
        ),
        statement(
            "figure 6.9", "e rises with the offset (20 kPa, 3 to 10 mm)", _range(flat_gap, "length"), rising(flat_gap)
        ),
    ]


MEASURED = "measured; the data are only in a figure"


def _statements(found: Shells) -> list[Row]:
    errors = (
        ("figure 6.4", "inflation", "0.56 mm"),
        ("figure 6.6", "force, 5 mm", "1.32 N"),
        ("figure 6.6", "force, 10 mm", "2.44 N"),
    )
    errors += tuple(
        ("figure 6.7", f"F_z, {gap / mm:g} mm", value)
        for gap, value in zip(thesis.GAPS, ("1.33 N", "1.59 N", "2.36 N", "0.63 N"), strict=True)
    )
    rows = [missing(source, f"RMSE from experiment, {what}", value, MEASURED) for source, what, value in errors]
    rows.append(missing("section 6.2", "mu tuned to the measured inflation", str(thesis.SHELL_MU), MEASURED))
    rows.append(missing("appendix B", "mu tuned to the measured force", "111 kPa", MEASURED))
    spent = f"{1e6 * found.seconds:.0f} microseconds a state in a batch, compiled"
    rows.append(statement("section 5.1", "a solution takes 1.57 s on average", spent, found.seconds < 1.57))
    return rows
