"""`softgrip design` with a front: the trade-off, a table, a picture, and a folder that keeps everything.

The folder: config.toml as given, designs.csv (the front, in the order of the first goal), designs/01.toml and so on
(each design as `softgrip solve` accepts it), result.json, summary.txt, report.html, front.png. It appears complete or
not at all; stopped by Ctrl-C it holds the best designs until then.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.errors import located
from softgrip_jax.folders import DeferInterrupt, new_folder
from softgrip_jax.progress import stages
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY

from ..records import agreed, as_given, design_row, in_si, next_command, said, seen, versions, write_csv
from ..records import summary as summary_line
from . import settings
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
    write_csv(folder / "designs.csv", [{"design": k + 1} | design_row(problem, d) for k, d in enumerate(front.designs)])
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
        "front": [in_si(problem, design) for design in front.designs],
        "search": wanted.arguments,
        "solves": front.solves,
        "stopped": front.stopped,
        "seconds": front.seconds,
    } | (agreed(problem) | versions())
    (folder / "result.json").write_text(json.dumps(summary, indent=2), encoding="utf-8")


def report(front: Front, console: Console) -> None:
    """Some designs of the front, from one end to the other."""
    problem = front.problem
    if front.stopped:
        console.print(f"{STOPPED}; the best designs until then are kept.")
    rows = np.unique(np.linspace(0, len(front.designs) - 1, SHOWN).round().astype(int))
    table = Table(title=f"a front of {len(front.designs)} designs", title_justify="left")
    table.add_column("design", justify="right")
    for quantity, kind in zip(problem.quantities, problem.kinds, strict=True):
        table.add_column(f"{problem.label(quantity)} {DISPLAY[kind][0]}".replace("_", " "), justify="right")
    for name, kind in zip(problem.space.names, problem.space.kinds, strict=True):
        table.add_column(f"{name.replace('.', ' ')} {DISPLAY[kind][0]}", justify="right")
    for k in rows:
        design = front.designs[k]
        values = [
            "none" if np.isinf(v) else f"{v / DISPLAY[kind][1]:.5g}"
            for v, kind in zip(seen(problem, design), problem.kinds, strict=True)
        ]
        numbers = [f"{x / DISPLAY[kind][1]:.5g}" for x, kind in zip(design.x, problem.space.kinds, strict=True)]
        table.add_row(str(k + 1), *values, *numbers)
    console.print(table)
    for sentence in said(problem):
        console.print(sentence, soft_wrap=True)
    times = ", ".join(f"{name} {value:.0f} s" for name, value in front.seconds.items())
    console.print(f"{front.solves} designs solved ({times})", soft_wrap=True)
