"""`softgrip design` with a front: the trade-off, a table, a picture, and a folder that keeps everything.

The folder: config.toml as given, designs.csv (the front, in the order of the first goal), designs/01.toml and so on
(each design as `softgrip solve` accepts it), result.json, summary.txt, report.html, front.png. It appears complete or
not at all; stopped by Ctrl-C it holds the best designs until then.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.errors import located
from softgrip_jax.folders import DeferInterrupt, new_folder
from softgrip_jax.model_error import of_material, of_shell
from softgrip_jax.progress import stages
from softgrip_jax.quantities import REQUIRED, State
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.results import Solution, Status
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from ..drives import beyond_law, by_other_drive
from ..problem import Problem
from ..records import agreed, as_given, design_row, in_si, next_command, said, seen, versions, write_csv
from ..records import summary as summary_line
from . import settings
from .descent import Design
from .pareto import Front, pareto

STOPPED = "Stopped before the front was found"
"""By Ctrl-C."""

SHOWN = 9
"""Designs in the printed table, spread over the front; designs.csv has them all."""


def run_front(
    given: bytes, read: configs.Config, wanted: settings.Settings, out: Path | None, console: Console
) -> Path:
    """Find the front, print it, and return the folder that holds it; Ctrl-C as in `run.run_design`."""
    name = read.path.stem
    with new_folder(out, name) as (folder, final):
        with located(f"{read.path}, [design]"), stages(console) as tell:
            tell("compiling")
            front = pareto(
                wanted.problem,
                report=lambda stage, solves: tell(f"{stage}, {solves} designs solved before"),
                **wanted.arguments,
            )
        with DeferInterrupt() as writing:
            tell_and_keep(folder, console, partial(report, front))
            _write(folder, given, read, wanted, front)
            write_report(folder, final.name)
    command = next_command(wanted.problem, final / "designs" / "01.toml", front.designs[0])
    console.print(summary_line("run", final, command), soft_wrap=True)
    if front.stopped or writing.asked:
        raise KeyboardInterrupt
    return final


def _write(folder: Path, given: bytes, read: configs.Config, wanted: settings.Settings, front: Front) -> None:
    from softgrip_jax import plots

    problem = front.problem
    (folder / "config.toml").write_bytes(given)
    rows = [{"design": k + 1} | design_row(problem, d) for k, d in enumerate(front.designs)]
    write_csv(folder / "designs.csv", [_without_objective(row) for row in rows])
    (folder / "designs").mkdir()
    name, at = settings.asked_first(problem)
    for k, design in enumerate(front.designs):
        scenes, kept = as_given(read, problem.scenes_at(design.x))
        comment = f"Design {k + 1} of a front." + (f"\n{STOPPED}." if front.stopped else "")
        text = configs.dump(scenes, comment, **settings.question(at, scenes[name]), **kept)
        (folder / "designs" / f"{k + 1:02d}.toml").write_text(text, encoding="utf-8")
    places = [problem.asked.index(goal.quantity) for goal in problem.goals]
    plots.front(
        np.stack([d.values for d in front.designs])[:, places],
        [problem.label(goal.quantity) for goal in problem.goals],
        [problem.kinds[k] for k in places],
        [goal.kind for goal in problem.goals],
    ).savefig(folder / "front.png")
    summary = {
        "units": "SI",
        "front": [_without_objective(in_si(problem, design)) for design in front.designs],
        "remarks": list(front.notes),
        "search": wanted.arguments,
        "solves": front.solves,
        "stopped": front.stopped,
        "seconds": front.seconds,
    } | (agreed(problem) | versions())
    (folder / "result.json").write_text(json.dumps(summary, indent=2), encoding="utf-8")


def _without_objective(row: dict[str, Any]) -> dict[str, Any]:
    """What is told of a design of a front: the sum of the goals means nothing there."""
    return {name: value for name, value in row.items() if name != "objective"}


def report(front: Front, console: Console) -> None:
    """Some designs of the front, from one end to the other."""
    problem = front.problem
    if front.stopped:
        console.print(f"{STOPPED}; the best designs until then are kept.")
    rows = sorted({round(k) for k in np.linspace(0, len(front.designs) - 1, SHOWN)})
    count = len(front.designs)
    table = Table(title=f"a front of {count} design{'' if count == 1 else 's'}", title_justify="left")
    table.add_column("design", justify="right")
    for quantity, kind in zip(problem.quantities, problem.kinds, strict=True):
        table.add_column(f"{problem.label(quantity)} {DISPLAY[kind][0]}".replace("_", " "), justify="right")
    for name, kind in zip(problem.space.names, problem.space.kinds, strict=True):
        table.add_column(f"{name.replace('.', ' ')} {DISPLAY[kind][0]}", justify="right")
    # Nobody who stops a search waits for one more program to be compiled.
    beside = None if front.stopped else by_other_drive(problem, [front.designs[k].x for k in rows])
    others = [] if beside is None else zip(beside.quantities, beside.kinds, beside.drives, beside.values.T, strict=True)
    columns = []
    for quantity, kind, drive, column in others:
        if quantity.along is None:
            name = f"{problem.label(quantity)} {DISPLAY[kind][0]}, drive {drive}"
            table.add_column(name.replace("_", " "), justify="right")
            columns.append([_number(value, kind) for value in column])
    for place, k in enumerate(rows):
        design = front.designs[k]
        values = [_number(v, kind) for v, kind in zip(seen(problem, design), problem.kinds, strict=True)]
        values += [_number(x, kind) for x, kind in zip(design.x, problem.space.kinds, strict=True)]
        table.add_row(str(k + 1), *values, *(column[place] for column in columns))
    console.print(table)
    for k, lost in zip(rows, beside.reasons if beside else [], strict=False):
        for words in lost:
            console.print(f"Design {k + 1} by the other drive, {words}.", soft_wrap=True, markup=False)
    for k in rows:
        for words in near_limits(front.designs[k]):
            console.print(f"Design {k + 1}, {words}", soft_wrap=True)
        for sentence in of_materials(problem, front.solutions, k, k + 1):
            console.print(sentence, soft_wrap=True, markup=False)
    told = [*said(problem), *(beside.remarks if beside else [])]
    ends = [[*beyond_law(problem, d.x), *errors_of_shells(problem, d)] for d in (front.designs[0], front.designs[-1])]
    if ends[0] == ends[1]:
        told += ends[0]
    else:
        told += [f"Design {k}: {words}" for k, end in zip((1, len(front.designs)), ends, strict=True) for words in end]
    for sentence in dict.fromkeys([*told, *front.notes]):
        console.print(sentence, soft_wrap=True, markup=False)
    times = ", ".join(f"{name} {value:.0f} s" for name, value in front.seconds.items())
    console.print(f"{front.solves} designs solved ({times})", soft_wrap=True)


def _number(value: float, kind: str) -> str:
    """In the unit that people read, which the column names."""
    return "none" if np.isinf(value) else "-" if np.isnan(value) else f"{value / DISPLAY[kind][1]:.5g}"


CLOSE = 0.05
"""Part of a pressure that its limit should be above it: what a regulator keeps to, and what silicones scatter by."""


def near_limits(design: Design) -> list[str]:
    """Which states of a design are hardly below their limit pressure."""
    return [
        f"{label}: the limit pressure is {100 * (margin - 1):.2g}% above it. A constraint on a state at a higher "
        "pressure keeps room."
        for label, margin in design.limit_margins.items()
        if 0 < margin - 1 < CLOSE
    ]


def of_materials(
    problem: Problem, solutions: Mapping[tuple[str, State], Sequence[Solution]], place: int, number: int
) -> list[str]:
    """Where a design is stretched further than its material's law is trusted; place: of it in the solutions, number: by
    which it is called."""
    asked = problem.asked
    return [
        f"Design {number}, {label}: {name} {words}."
        for state, label in zip(asked.states, asked.state_labels(), strict=True)
        if state in solutions
        for name, words in of_material(solutions[state][place]).items()
    ]


def errors_of_shells(problem: Problem, design: Design) -> list[str]:
    """How far the models of a design's shells are from finite elements, in what is asked of their states and in what a
    sought pressure gives."""
    sentences = []
    known = dict(zip(problem.asked.states, design.statuses, strict=True))
    for name, scene in problem.scenes_at(design.x).items():
        asked = [q for q in problem.quantities if q.scene == name and q.along is None and known[q.state] == Status.OK]
        names = [q.observable for q in asked if q.observable != "pressure" or q.at == REQUIRED]
        names += [q.at[0] for q in asked if isinstance(q.at, tuple)]
        scene_is = f"{name}: " if len(problem.space.scenes) > 1 else ""
        sentences += [f"{scene_is}{sentence}" for sentence in of_shell(scene, dict.fromkeys(names))]
    return sentences
