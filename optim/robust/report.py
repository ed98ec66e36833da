"""What people see of a robust design: the nominal best beside it, promise and count, tolerances, a front."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.quantities import shown
from softgrip_jax.results import in_units
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from ..design.descent import SearchResult
from ..problem import Goal, Problem
from ..records import as_given, write_csv
from .count import Count
from .improve import ASCENT, DERIVATIVES
from .run import Robust, words
from .statistics import NOTHING_ASKED, Wanted

NOMINAL, ROBUST = "nominal best", "robust best"
LOW, HIGH = 0.05, 0.95
"""Quantiles of a goal over parts that are told."""


def tell(problem: Problem, result: SearchResult, robust: Robust, console: Console) -> None:
    """The comparison, how it was found, and how the check came out."""
    table = Table(title=f"{NOMINAL} and {ROBUST}, side by side", title_justify="left")
    for name in ("", NOMINAL, ROBUST):
        table.add_column(name, justify="right" if name else "left")
    for name, *cells in side_by_side(problem, result, robust):
        table.add_row(name, *cells)
    console.print(table)
    for sentence in sentences(robust):
        console.print(sentence, soft_wrap=True, markup=False, highlight=False)
    if robust.budget is not None:
        console.print(_budget_table(robust))
        console.print(_allocation(robust), soft_wrap=True, markup=False, highlight=False)
    if robust.front:
        console.print(_front_table(problem, robust))
    times = ", ".join(f"{name} {robust.solves[name]:,} in {value:.1f} s" for name, value in robust.seconds.items())
    console.print(
        f"Parts and designs solved after the nominal search ({robust.solves['nominal']:,}): {times}.", soft_wrap=True
    )


def asked_share(wanted: Wanted, goal: Goal) -> float | None:
    """The quantile of a goal's quantity that was asked for; of what is maximised it is counted from above."""
    if wanted.goal != "quantile":
        return None
    return round(1 - wanted.share, 12) if goal.kind == "maximise" else wanted.share


def side_by_side(problem: Problem, result: SearchResult, robust: Robust) -> list[tuple[str, str, str]]:
    """Rows of the comparison."""
    best, nominal = result.designs[0], result.designs[1]
    rows = [
        (name, in_units(nominal.x[k], kind), in_units(best.x[k], kind))
        for k, (name, kind) in enumerate(zip(problem.space.names, problem.space.kinds, strict=True))
    ]
    for j, goal in enumerate(problem.goals):
        k = problem.quantities.index(goal.quantity)
        kind, label = problem.kinds[k], problem.label(goal.quantity)
        change = (best.values[k] - nominal.values[k]) / abs(nominal.values[k] or np.nan)
        rows.append((label, in_units(nominal.values[k], kind), f"{in_units(best.values[k], kind)} ({change:+.1%})"))
        asked = asked_share(robust.uncertain.wanted, goal)
        for share in sorted({LOW, HIGH} | ({asked} if asked is not None else set())):
            each = [
                shown(quantile_of(count.values[:, j], share, goal), kind)
                for count in (robust.of_nominal, robust.of_best)
            ]
            words = " (the goal)" if share == asked else ""
            rows.append((f"... of {100 * share:.4g}% of the parts it is below{words}", each[0], each[1]))
    counts = (robust.of_nominal, robust.of_best)
    rows.append(("yield counted", *(f"{count.share:.2%}" for count in counts)))
    if robust.share is not None:
        rows.append(("yield promised", "", f"{robust.share:.2%}"))
    rows.append(("parts without equilibrium", *(f"{count.lost:.2%}" for count in counts)))
    for k, label in enumerate(robust.wants.requirements.labels):
        if max(count.failures[k] for count in counts) > 0:
            rows.append((f"parts that break {label}", *(f"{count.failures[k]:.2%}" for count in counts)))
    if robust.share is None:
        what = robust.uncertain.wanted.goal
        rows.append((f"{what} objective counted (scaled)", *(f"{count.goal:.5g}" for count in counts)))
        rows.append((f"{what} objective promised (scaled)", "", f"{robust.goal:.5g}"))
        rows.append(("worst constraint counted (scaled)", *(f"{count.violation:+.2e}" for count in counts)))
    return rows


def sentences(robust: Robust) -> list[str]:
    """How it was found and whether the check holds."""
    wanted, best = robust.uncertain.wanted, robust.best
    found = [f"What scatters: {'; '.join(robust.uncertain.labels)}."]
    if best.method == ASCENT:
        found.append("Worst cases were found by an inner ascent for the objective and for every constraint.")
    elif best.method == DERIVATIVES:
        found.append(
            "Parts were known by derivatives, of the second order and most of the third; beside parts that were solved "
            f"{words(best.error)}."
        )
    else:
        found.append(
            f"{len(robust.wants.solved_parts)} quasi-random parts of each design were solved: {robust.switched}."
        )
    check = "holds" if robust.holds else "does NOT hold"
    # A design that does not keep what is wanted promises nothing.
    what, past = ("promise", "promised") if best.kept else ("prediction", "predicted")
    if wanted.promised is not None:
        found.append(
            f"The edge of the yield was smoothed over {best.width:.2g} standard deviations of the worst requirement at "
            "last."
        )
        assert robust.share is not None
        off = abs(robust.share - robust.of_best.share)
        found.append(
            f"The {what} {check}: {robust.share:.2%} were {past} and {robust.of_best.share:.2%} of "
            f"{robust.of_best.parts:,} fresh parts are good, {off:.2%} apart."
        )
    else:
        found.append(
            f"The {what} {check}: an objective of {robust.goal:.5g} in the {wanted.goal} case was {past}, and "
            f"{robust.of_best.parts:,} fresh parts have {robust.of_best.goal:.5g} (scaled), with "
            f"{robust.of_best.lost:.2%} of them without equilibrium and a worst constraint of "
            f"{robust.of_best.violation:+.2e}."
        )
    if not best.kept:
        reached = (
            "" if wanted.promised is None else f" of {wanted.promised:.4g}; the best has {robust.of_best.share:.4g}"
        )
        found.append(f"No design was found that keeps what is wanted of its parts{reached}.")
    return found


def record(problem: Problem, result: SearchResult, robust: Robust) -> dict[str, Any]:
    """For result.json."""
    error, best = robust.best.error, robust.best
    return {
        "numbers": list(robust.uncertain.labels),
        "wanted": robust.uncertain.wanted._asdict(),
        "method": best.method,
        "why_parts_were_solved": robust.switched,
        "error_of_expansion": None if error is None else error._asdict(),
        "width_of_edge": best.width,
        "kept": best.kept,
        "yield_promised": robust.share,
        "promise_holds": robust.holds,
        "objective_promised": robust.goal,
        "nominal_best": _count(problem, robust.of_nominal, robust.wants.requirements.labels)
        | {"variables": dict(zip(problem.space.names, map(float, result.designs[1].x), strict=True))},
        "robust_best": _count(problem, robust.of_best, robust.wants.requirements.labels),
        "front": [
            {"yield": p.wanted, "promised": p.promised, "counted": p.counted, "objective": p.objective}
            | {"variables": dict(zip(problem.space.names, map(float, _x(problem, p.best.t)), strict=True))}
            for p in robust.front
        ],
        "tolerances": None if robust.budget is None else _budget(robust),
        "solves": robust.solves,
        "seconds": robust.seconds,
    }


def write(folder: Path, read: configs.Config, problem: Problem, result: SearchResult, robust: Robust) -> None:
    """nominal_best.toml, robust.csv, robust.png, and with a front robust_front.csv."""
    from softgrip_jax import plots

    comment = "The nominal best design, beside which best.toml is the robust one."
    scenes, kept = as_given(read, problem.scenes_at(result.designs[1].x))
    (folder / "nominal_best.toml").write_text(configs.dump(scenes, comment, **kept), encoding="utf-8")
    rows = side_by_side(problem, result, robust)
    write_csv(
        folder / "robust.csv", [{"": a, NOMINAL.replace(" ", "_"): b, ROBUST.replace(" ", "_"): c} for a, b, c in rows]
    )
    if robust.front:
        write_csv(folder / "robust_front.csv", [_front_row(problem, p) for p in robust.front])
    goal = problem.goals[0].quantity
    k = problem.quantities.index(goal)
    casts = {
        name: plots.Cast(
            count.values[:, 0], np.where(count.broken > NOTHING_ASKED, count.broken, -np.inf), design.values[k]
        )
        for name, count, design in (
            (NOMINAL, robust.of_nominal, result.designs[1]),
            (ROBUST, robust.of_best, result.designs[0]),
        )
    }
    front = [(p.counted, p.values[k]) for p in robust.front]
    prices = None
    if robust.budget is not None and len(problem.goals) == 1:
        names = [label.split(" (")[0].split(".")[-1] for label in robust.uncertain.labels]
        prices = {n: v for n, v in zip(names, relative_gain(robust), strict=True) if np.isfinite(v)}
    plots.robust(casts, problem.label(goal).replace("_", " "), problem.kinds[k], front, prices).savefig(
        folder / "robust.png"
    )


def relative_gain(robust: Robust) -> np.ndarray:
    """What the objective gains for every halved tolerance, of its size."""
    assert robust.budget is not None
    return robust.budget.gained / abs(float(robust.best.values[0]))


def _budget_table(robust: Robust) -> Table:
    budget = robust.budget
    assert budget is not None
    table = Table(title="tolerances, the dearest first", title_justify="left")
    for name in ("number", "if halved alone: yield", "or goal gained at the same yield", "factor at equal cost"):
        table.add_column(name, justify="left" if name == "number" else "right")
    order = np.argsort(-np.nan_to_num(budget.gained, nan=-np.inf))
    for k in order:
        gain = relative_gain(robust)[k]
        table.add_row(
            robust.uncertain.labels[k],
            f"{budget.share:.2%} to {budget.halved[k]:.2%}",
            f"{gain:+.2%}" if np.isfinite(gain) else "-",
            f"{budget.factors[k]:.2f}",
        )
    return table


def _allocation(robust: Robust) -> str:
    budget = robust.budget
    assert budget is not None
    gain = budget.allocated_gain / abs(float(robust.best.values[0]))
    said = (
        "At equal cost (a tolerance that is twice as tight costs twice as much) the yield of the robust design goes "
        f"with these factors from {budget.share:.2%} to {budget.allocated:.2%}"
    )
    return said + (f"; improved anew for the same yield, the goal gains {gain:.2%}." if np.isfinite(gain) else ".")


def _front_table(problem: Problem, robust: Robust) -> Table:
    table = Table(title="performance against yield", title_justify="left")
    rows = [_front_row(problem, point) for point in robust.front]
    for name in rows[0]:
        table.add_column(name.replace("_", " "), justify="right")
    for row in rows:
        table.add_row(*(f"{value:.5g}" for value in row.values()))
    return table


def _front_row(problem: Problem, point: Any) -> dict[str, float]:
    row = {"yield_wanted": point.wanted, "yield_promised": point.promised, "yield_counted": point.counted}
    for goal in dict.fromkeys(goal.quantity for goal in problem.goals):
        k = problem.quantities.index(goal)
        unit, factor = DISPLAY[problem.kinds[k]]
        row[f"{problem.label(goal)} {unit}".strip().replace(" ", "_")] = float(point.values[k]) / factor
    for name, kind, x in zip(problem.space.names, problem.space.kinds, _x(problem, point.best.t), strict=True):
        unit, factor = DISPLAY[kind]
        row[f"{name}_{unit}".rstrip("_")] = float(x) / factor
    return row


def _x(problem: Problem, t: np.ndarray) -> np.ndarray:
    return np.asarray(problem.space.from_unit(t))


def _budget(robust: Robust) -> list[dict[str, Any]]:
    budget = robust.budget
    assert budget is not None
    return [
        {
            "number": label,
            "yield": budget.share,
            "yield_if_halved": float(budget.halved[k]),
            "goal_gained_if_halved": _finite(relative_gain(robust)[k]),
            "factor_at_equal_cost": float(budget.factors[k]),
        }
        for k, label in enumerate(robust.uncertain.labels)
    ]


def _count(problem: Problem, count: Count, labels: list[str]) -> dict[str, Any]:
    return {
        "parts": count.parts,
        "yield": count.share,
        "without_equilibrium": count.lost,
        "broken": dict(zip(labels, map(float, count.failures), strict=True)),
        "objective": _finite(count.goal),
        "goals": {
            problem.label(goal.quantity): [
                _finite(quantile_of(count.values[:, j], share, goal)) for share in (LOW, 0.5, HIGH)
            ]
            for j, goal in enumerate(problem.goals)
        },
    }


def quantile_of(values: np.ndarray, share: float, goal: Goal) -> float:
    """What so many of all parts are below; a part without a value (NaN) is worse than any other: inf, or -inf of what
    is maximised, where the quantile is among these."""
    worst = -np.inf if goal.kind == "maximise" else np.inf
    ordered = np.sort(np.where(np.isnan(values), worst, values))
    place = share * (len(ordered) - 1)
    below, above = ordered[int(np.floor(place))], ordered[int(np.ceil(place))]
    if below == above or not np.isfinite(above - below):
        return float(below if np.isinf(below) else above)
    return float(below + (place % 1) * (above - below))


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
