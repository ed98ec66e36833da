"""`softgrip plan CONFIG.toml`: which measurements to make, in which order, and what is known after each.

The folder: config.toml as given, plan.csv (the list), result.json, plan.png, summary.txt and report.html.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.errors import located
from softgrip_jax.folders import new_folder
from softgrip_jax.progress import stages
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.results import NORMAL_95, in_units
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from ..records import summary, versions, write_csv
from . import settings
from .decision import LEAST_SHARE
from .plan import Plan, make


def run_plan(config: Path, out: Path | None, console: Console) -> Path:
    """Plan as the config says, print the list, and return the folder that holds it."""
    read = configs.load(config)
    given = configs.standalone(config)
    wanted = settings.read(read)
    with new_folder(out, config.stem) as (folder, final):
        with located(f"{config}, [plan]"), stages(console) as tell:
            plan = make(wanted, tell)
        (folder / "config.toml").write_bytes(given)
        write_csv(folder / "plan.csv", rows(plan))
        (folder / "result.json").write_text(json.dumps(record(plan), indent=2), encoding="utf-8")
        draw(plan, folder / "plan.png")
        tell_and_keep(folder, console, partial(report, plan))
        write_report(folder, final.name)
    console.print(summary("plan", final, ""), soft_wrap=True)
    return final


def place_of(plan: Plan, k: int) -> str:
    """'12 kPa', 'strain 0.5'; '' for a number itself."""
    one = plan.settings.measurements[plan.of[k]]
    if one.curve is None:
        return ""
    return f"strain {plan.x[k]:g}" if one.table.strains is not None else f"{plan.x[k] / DISPLAY['pressure'][1]:g} kPa"


def rows(plan: Plan) -> list[dict[str, Any]]:
    """The list, a row for every measurement, with what is known after it."""
    names = [number.key for number in plan.settings.numbers]
    found = []
    for step, (k, half) in enumerate(zip(plan.chosen, plan.steps()[1:], strict=True), 1):
        one = plan.settings.measurements[plan.of[k]]
        is_pressure = one.curve is not None and one.table.strains is None
        expected = _expected(plan, k)
        found.append(
            {
                "order": step,
                "measurement": one.table.name,
                "quantity": one.table.quantity or one.table.number,
                "pressure_kPa": plan.x[k] / DISPLAY["pressure"][1] if is_pressure else None,
                "strain": None if is_pressure or one.curve is None else plan.x[k],
                "expected": expected[0],
                "unit": one.table.unit,
                "noise": one.table.noise,
                "cost": one.table.cost,
            }
            | {f"{name} within +- %": 100 * v for name, v in zip(names, half, strict=True)}
        )
    return found


def _expected(plan: Plan, k: int) -> tuple[float, float]:
    """(mean, standard deviation) of a measurement over the draws that have a state, in its own unit; NaN if none."""
    one = plan.settings.measurements[plan.of[k]]
    values = plan.values[:, k] / plan.settings.factor(one)
    values = values[np.isfinite(values)]
    return (float(np.mean(values)), float(np.std(values))) if values.size else (np.nan, np.nan)


def record(plan: Plan) -> dict[str, Any]:
    """The plan as plain data."""
    names, widths = [number.key for number in plan.settings.numbers], plan.steps()

    def named(half: np.ndarray) -> dict[str, float]:
        return {name: float(v) for name, v in zip(names, half, strict=True)}

    verdict = plan.verdict
    found: dict[str, Any] = {
        "criterion": plan.settings.criterion,
        "half_width_95_relative": {
            "before": named(widths[0]),
            "after": named(widths[-1]),
            "evenly_spaced": {name: named(plan.half_widths(list_)) for name, list_ in plan.evenly.items()},
        },
        "cost": float(np.sum(plan.candidates.costs[plan.chosen])),
        "cannot_be_told_apart": [one.sentence() for one in plan.open],
        "without_a_state": [f"{name_of(plan, k)} {place_of(plan, k)}" for k in plan.left_out],
        "remarks": list(plan.remarks),
    }
    if verdict is not None:
        found["decision"] = {
            "about": plan.settings.decision.key if plan.settings.decision else "",
            "mean": verdict.mean,
            "standard_deviation_before": float(verdict.before),
            "standard_deviation_after": float(verdict.after),
            "right_before": verdict.right_before,
            "right_after": verdict.right_after,
        }
        if verdict.yields is not None:
            found["decision"]["expected_yield"] = float(np.mean(verdict.yields))
    return found | versions()


def name_of(plan: Plan, k: int) -> str:
    """The measurement of a candidate."""
    return plan.settings.measurements[plan.of[k]].table.name


def report(plan: Plan, console: Console) -> None:
    """The list, what is known before and after it, and what nothing here can tell."""
    names, widths = [number.key for number in plan.settings.numbers], plan.steps()
    table = Table(title="what to measure, the most telling first", title_justify="left")
    for head in ("measurement", "at", "expected", *(f"{name} then known to" for name in names)):
        table.add_column(head, justify="left" if head in ("measurement", "at") else "right")
    table.add_row("(nothing yet)", "", "", *(_percent(v) for v in widths[0]))
    for step, k in enumerate(plan.chosen, 1):
        one = plan.settings.measurements[plan.of[k]]
        mean, spread = _expected(plan, k)
        expected = f"{mean:.4g} +- {NORMAL_95 * spread:.2g} {one.table.unit}"
        table.add_row(f"{step}. {one.table.name}", place_of(plan, k), expected, *(_percent(v) for v in widths[step]))
    table.add_section()
    for name, spaced in plan.evenly.items():
        table.add_row(f"{len(spaced)} evenly spaced, {name}", "", "", *(_percent(v) for v in plan.half_widths(spaced)))
    console.print(table)
    console.print("Known to: half of the 95 % interval, relative to the number.", soft_wrap=True)
    for one in plan.open:
        console.print(one.sentence(), soft_wrap=True, markup=False, highlight=False)
    if plan.left_out:
        words = ", ".join(f"{name_of(plan, k)} at {place_of(plan, k)}" for k in plan.left_out)
        console.print(
            f"Not planned, since more than {1 - LEAST_SHARE:.0%} of what is possible has no state there: {words}.",
            soft_wrap=True,
            markup=False,
        )
    for sentence in (*decided_words(plan), *plan.remarks):
        console.print(sentence, soft_wrap=True, markup=False, highlight=False)


def decided_words(plan: Plan) -> list[str]:
    """What is decided, and how well before and after."""
    v, decision = plan.verdict, plan.settings.decision
    if v is None or decision is None:
        return []
    rightly = f"is decided rightly with a probability of {v.right_before:.1%} now, and of {v.right_after:.1%} then."
    if v.yields is not None and decision.uncertain is not None:
        low, high = np.quantile(v.yields, [0.025, 0.975])
        return [
            f"The yield is expected to be {np.mean(v.yields):.1%}; for 95 % of what is possible it lies between "
            f"{low:.1%} and {high:.1%}. Whether it is at least {decision.uncertain.wanted.promised:.4g} {rightly}"
        ]
    told = [in_units(one, decision.kind) for one in (v.mean, NORMAL_95 * v.before, NORMAL_95 * v.after)]
    return [
        f"{decision.key} is expected to be {told[0]}, known to +- {told[1]} now and to +- {told[2]} after the plan. "
        f"Whether it keeps its bounds {rightly}"
    ]


def _percent(share: float) -> str:
    return f"+- {100 * share:.2g} %"


def draw(plan: Plan, path: Path) -> None:
    """What is known after each measurement, and where on the curves they lie."""
    # matplotlib takes a second to load: only a run that draws waits for it.
    from softgrip_jax import plots

    names, widths = [number.key for number in plan.settings.numbers], plan.steps()
    steps, none = np.arange(len(widths)), np.full(len(widths), np.nan)
    lines = [plots.Line(name, steps, 100 * widths[:, j], none) for j, name in enumerate(names)]
    panels = [plots.Panel("what is known", "measurements made", "95 % interval, +- %", [], lines)]
    for m, one in enumerate(plan.settings.measurements):
        if one.curve is None:
            continue
        own = np.flatnonzero((plan.of == m) & (plan.shares > 0))
        if not len(own):
            continue
        told = np.array([_expected(plan, int(k)) for k in own])
        is_test = one.table.strains is not None
        x = plan.x[own] if is_test else plan.x[own] / DISPLAY["pressure"][1]
        chosen = np.array([int(k) in plan.chosen for k in own])
        points = [plots.Points("to be measured", x, told[:, 0], chosen)]
        line = plots.Line("expected, and 95 % of what is possible", x, told[:, 0], NORMAL_95 * told[:, 1])
        label = f"{one.curve.label} ({one.table.unit})"
        panels.append(
            plots.Panel(
                one.table.name,
                "engineering strain" if is_test else "pressure (kPa)",
                label,
                points,
                [line],
            )
        )
    plots.measured_and_fitted(panels).savefig(path)
