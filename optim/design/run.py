"""`softgrip design CONFIG.toml`: search, a table of the best designs, and a folder that keeps everything.

The folder: config.toml as given (with the parts that stood in other files), best.toml (what `softgrip solve` accepts),
designs.csv, history.csv, result.json, summary.txt, report.html, convergence.png and, for every scene that has a
picture, before_after.png (of several scenes before_after_NAME.png). It appears complete or not at all, and never
replaces another. Of a search that is stopped by Ctrl-C it holds the best designs until then.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import time
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.config import ConfigError
from softgrip_jax.errors import InputError, located
from softgrip_jax.folders import DeferInterrupt, new_folder
from softgrip_jax.progress import counted, stages
from softgrip_jax.quantities import AT_REST, solution_at
from softgrip_jax.quantities import shown as in_words
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.results import Status, in_units
from softgrip_jax.scene import Scene
from softgrip_jax.spread import Spread
from softgrip_jax.tables import Table

from .. import rules
from ..drives import OtherDrive, beyond_law, by_other_drive, other_drive
from ..problem import Goal, Problem
from ..records import (
    agreed,
    as_given,
    design_row,
    in_si,
    next_command,
    said,
    seen,
    summary,
    unsolved,
    versions,
    write_csv,
)
from ..robust import report as robust_report
from ..robust.run import Robust, Scattered
from . import settings
from .descent import ACTIVE, FEASIBLE, Design, SearchResult, prepare, search
from .front_run import errors_of_shells, near_limits, of_materials, run_front
from .islands import evaluator_on
from .pareto import NoFrontError

AMPLE = 100.0
"""Room of a hundred bounds and more needs no number: a limit pressure that does not exist, for instance."""

SEEN = 5e-5
"""Less would be "broken by 0.00%"."""

DISTANCE = "distance from the curve (rms)"
"""Of a shape that is followed, in the printed table."""

LARGE_GAIN = 0.1
"""Of an objective, from which on both of its values tell more than their ratio: two digits of them differ."""

SHOWN = 5
"""Designs in the printed table; designs.csv has them all."""


def run_design(config: Path, out: Path | None, console: Console, spread: Spread | None = None) -> Path:
    """Search as the config says, print what was found, and return the folder that holds it. spread: who solves the
    designs in place of this process.

    Stopped by Ctrl-C it keeps and prints what was found until then, and raises KeyboardInterrupt again. Where no robust
    design is found it keeps and prints the nominal ones.
    """
    read = configs.load(config)
    given = configs.standalone(config)
    wanted = settings.read(read)
    wanted.problem.about = f"{given.decode()}\n{wanted.problem.held_numbers()}"
    if wanted.is_front:
        if spread is not None:
            raise ConfigError(f"{config}, [design]: a front is searched in one process; leave out --workers.")
        try:
            return run_front(given, read, wanted, out, console)
        except NoFrontError as error:
            words = "A search of all goals added up says what is in the way."
            console.print(f"{error} {words}", soft_wrap=True, markup=False)
            wanted = wanted.without_front()
    robust, scattered, missed = None, None, ""
    if wanted.uncertain is not None:
        if spread is not None:
            raise ConfigError(f"{config}, [design.uncertain]: this is searched in one process; leave out --workers.")
        with located(f"{config}, [design.uncertain]"):
            scattered = Scattered(wanted.problem, wanted.uncertain)
    with new_folder(out, config.stem) as (folder, final):
        with nullcontext(scattered.evaluator) if scattered else evaluator_on(spread, wanted.problem) as evaluator:
            result, other = _search_with_progress(wanted, console, evaluator)
        where = f"after {len(result.history['moving'])} steps"
        if scattered and not result.stopped:
            where = "after the nominal search"
            try:
                with located(f"{config}, [design.uncertain]"), stages(console) as tell:
                    result, robust = scattered.robust(result, tell)
            except KeyboardInterrupt:  # the nominal designs are there
                result = dataclasses.replace(result, stopped=True)
            except InputError as error:  # they are there, too
                missed = f"{error} The nominal designs are kept."
        with DeferInterrupt() as writing:

            def tell_all(console: Console) -> None:
                if result.stopped:
                    console.print(f"Stopped {where}; the designs until then are kept.")
                report(result, console, other)
                for sentence in wanted.remarks:
                    console.print(sentence, soft_wrap=True, markup=False, highlight=False)
                if robust:
                    robust_report.tell(wanted.problem, result, robust, console)
                if missed:
                    console.print(missed, style="bold", soft_wrap=True, markup=False)

            tell_and_keep(folder, console, tell_all)  # at once: pictures take a while
            if robust:
                robust_report.write(folder, read, wanted.problem, result, robust)
            _write(folder, given, read, wanted, result, where, robust, missed)
            write_report(folder, final.name)
    command = next_command(wanted.problem, final / "best.toml", result.best)
    console.print(summary("run", final, command), soft_wrap=True)
    if result.stopped or writing.asked:
        raise KeyboardInterrupt
    return final


@dataclasses.dataclass(frozen=True)
class Run:
    """A run folder, opened again."""

    folder: Path
    config: configs.Config
    """As it was given, with the scenes that the search started from."""
    best_scenes: dict[str, Scene]
    """Empty, as is the history, for a front, which has designs alone."""
    result: dict[str, Any]
    designs: list[dict[str, str]]
    history: dict[str, np.ndarray]

    @property
    def best(self) -> Scene:
        """The scene of the best design, where there is one scene."""
        if len(self.best_scenes) != 1:
            names = ", ".join(self.best_scenes) or "none: it is a front"
            raise InputError(f"This run has no single best scene; best_scenes holds {names}.")
        return next(iter(self.best_scenes.values()))


def load_run(folder: str | Path) -> Run:
    """A run folder of `softgrip design`, opened in Python.

    Args:
        folder: of the run.

    Returns:
        Its config, scenes, designs and history.

    Raises:
        ConfigError: where the folder is not a run.

    Examples:
        >>> optim.load_run("nowhere")
        Traceback (most recent call last):
        softgrip_jax.errors.ConfigError: nowhere is not a run: there is no result.json in it.
    """
    folder = Path(folder)
    if not (folder / "result.json").is_file():
        raise ConfigError(f"{folder} is not a run: there is no result.json in it.")
    with (folder / "designs.csv").open(newline="", encoding="utf-8") as file:
        designs = list(csv.DictReader(file))
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    config = configs.load(folder / "config.toml")
    if not (folder / "best.toml").is_file():  # a front has no best design
        return Run(folder, config, {}, result, designs, {})
    with (folder / "history.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    history = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    return Run(folder, config, configs.load(folder / "best.toml").scenes, result, designs, history)


# --- the folder -------------------------------------------------------------------------------------------------------


def _write(
    folder: Path,
    given: bytes,
    read: configs.Config,
    wanted: settings.Settings,
    result: SearchResult,
    where: str,
    robust: Robust | None,
    missed: str,
) -> None:
    """where: a search that was stopped was stopped there."""
    problem, best = wanted.problem, result.best
    (folder / "config.toml").write_bytes(given)
    comment = f"The best design of a search with softgrip_jax {sg.__version__}, seed {wanted.arguments['seed']}."
    if result.stopped:
        comment += f"\nThe search was stopped {where}."
    if not best.feasible:
        comment += "\nIt is NOT feasible: no design that keeps every constraint was found."
    for sentence in filter(None, (*wanted.remarks, missed)):
        comment += f"\n{sentence}"
    scenes, kept = as_given(read, best_scenes(result))
    name, at = settings.asked_first(problem)
    text = configs.dump(scenes, comment, **settings.question(at, scenes[name]), **kept)
    (folder / "best.toml").write_text(text, encoding="utf-8")
    write_csv(folder / "designs.csv", _design_rows(problem, result))
    steps = len(result.history["moving"])
    write_csv(
        folder / "history.csv",
        [{"step": k + 1} | {name: float(v[k]) for name, v in result.history.items()} for k in range(steps)],
    )
    # The robust design stands before the nominal best, to which the steps led.
    _draw(folder, read.scenes, scenes, result, result.designs[-1] if robust else best)
    summed = _summary(problem, wanted, result)
    if robust:
        summed["robust"] = robust_report.record(problem, result, robust)
    if missed:
        summed["no_robust_design"] = missed
        summed["remarks"].append(missed)
    (folder / "result.json").write_text(json.dumps(summed, indent=2), encoding="utf-8")


def best_scenes(result: SearchResult) -> dict[str, Scene]:
    """The scenes of the best design."""
    return result.problem.scenes_at(result.best.x)


def _draw(
    folder: Path, before: dict[str, Scene], after: dict[str, Scene], result: SearchResult, descended: Design
) -> None:
    """descended: the best design of the steps that convergence.png shows, once it is finished."""
    # matplotlib takes a second to load: only a run that draws waits for it.
    from softgrip_jax import plots

    sign, title = _sense(result.problem)
    history = result.history | {"best_objective": sign * result.history["best_objective"]}
    start = f"{sign * result.reference.objective:.3g}" if result.reference.answered else "no answer"
    label = f"best\n(start: {start})"
    finished = sign * descended.objective if descended.answered and not result.stopped else None
    plots.convergence(history, label, title, finished, sign * result.paths).savefig(folder / "convergence.png")
    if result.stopped:
        return  # nobody who stops a run waits for two more programs to be compiled
    # The first state that is asked of every scene.
    states = {name: at for name, at in reversed(result.problem.asked.states) if at not in (None, AT_REST)}
    for name, at in states.items():
        if not plots.has_picture(after[name]):
            continue
        if (name, at) in result.solutions:
            solutions, place = result.solutions[name, at], result.problem.asked.states.index((name, at))
            statuses = [design.statuses[place] for design in (result.reference, result.best)]
        else:
            solutions = [solution_at(scenes[name], at) for scenes in (before, after)]
            statuses = [int(solution.status) for solution in solutions]
        labelled = zip(("before", "after"), solutions, statuses, strict=True)
        solved = {label: solution for label, solution, status in labelled if status == Status.OK}
        if solved:
            suffix = f"_{name}" if len(after) > 1 else ""
            plots.compare(solved).savefig(folder / f"before_after{suffix}.png")


def _design_rows(problem: Problem, result: SearchResult) -> list[dict[str, Any]]:
    """The start and every distinct design."""
    named = [("start", result.reference), *((k + 1, d) for k, d in enumerate(result.designs))]
    return [{"design": name} | design_row(problem, design) for name, design in named]


def _summary(problem: Problem, wanted: settings.Settings, result: SearchResult) -> dict[str, Any]:
    return {
        "units": "SI",
        "best": in_si(problem, result.best),
        "start": in_si(problem, result.reference),
        "distinct_designs": len(result.designs),
        "remarks": [*wanted.remarks, *result.remarks, *beyond_law(problem, result.best.x)],
        "stopped": result.stopped,
        "search": wanted.arguments,
        "solves": result.solves,
        "seconds": result.seconds,
        "reached": list(result.reached),
        "merged": result.merged,
        "best_objective_of_the_descent_alone": result.descended,
    } | (agreed(problem) | versions())


def _sense(problem: Problem) -> tuple[int, str]:
    """(-1 where the objective is that of one goal to be maximised, how people call the objective)."""
    if problem.goals[1:]:
        return 1, "sum of the goals"
    goal = problem.goals[0]
    name = problem.label(goal.quantity).replace("_", " ")
    return (-1 if goal.kind == "maximise" else 1), f"deviation of {name}" if goal.kind == "reach" else name


# --- what people see --------------------------------------------------------------------------------------------------


def _search_with_progress(
    wanted: settings.Settings, console: Console, evaluator: Any
) -> tuple[SearchResult, OtherDrive | None]:
    """The search, and what tells of its designs by the other drive, which is compiled at the same time."""
    steps, starts = wanted.arguments["steps"], wanted.arguments["starts"]

    goals = wanted.problem.goals
    of_start = len(goals) == 1 and goals[0].kind != "reach" and not goals[0].scale
    sign, _ = _sense(wanted.problem)
    has_answer = [True]
    """Of the start, until the search remarks that it has none."""

    def words(best: float, feasible: int, moving: int) -> str:
        value = f"best {sign * best:.4g}" + (" of the start" if of_start and has_answer[0] else "")
        return f"{value if feasible else 'none yet'}, {feasible} of {starts} feasible, {moving} moving"

    def remark(sentence: str) -> None:
        has_answer[0] = False
        console.print(sentence, soft_wrap=True)

    with counted(console, f"steps of {starts} designs", steps) as count:
        count(0)

        def show(step: int, best: float, feasible: int, moving: int) -> None:
            count(step if moving else steps, words(best, feasible, moving))

        # What is needed last is traced last, while the programs of the search are being compiled.
        began = time.perf_counter()
        prepare(wanted.problem, starts, wanted.arguments["finishes"], evaluator)
        other = other_drive(wanted.problem, 1 + SHOWN)
        before = time.perf_counter() - began
        result = search(wanted.problem, report=show, remark=remark, evaluator=evaluator, **wanted.arguments)
    seconds = result.seconds | {"compile": before + result.seconds["compile"]}
    return dataclasses.replace(result, seconds=seconds), other


def report(result: SearchResult, console: Console, of_other: OtherDrive | None = None) -> None:
    """The start and the best distinct designs, side by side. of_other: for `by_other_drive`."""
    problem, shown = result.problem, [result.reference, *result.designs[:SHOWN]]
    table = Table(title=f"the best of {len(result.designs)} distinct designs", title_justify="left")
    table.add_column("")
    for name in ("start", *range(1, len(shown))):
        table.add_column(str(name), justify="right")
    for k, (name, kind) in enumerate(zip(problem.space.names, problem.space.kinds, strict=True)):
        table.add_row(name, *(in_units(d.x[k], kind) for d in shown))
    table.add_section()
    for k, (quantity, kind) in enumerate(zip(problem.quantities, problem.kinds, strict=True)):
        if quantity.along is None:  # the points of a shape are in designs.csv
            table.add_row(problem.label(quantity), *(in_words(seen(problem, d)[k], kind) for d in shown))
    followed = [goal for goal in problem.goals if goal.quantity.along is not None]
    if followed:
        places = [problem.asked.index(goal.quantity) for goal in followed]
        table.add_row(DISTANCE, *(in_units(_distance(followed, d.values[places]), "length") for d in shown))
    # Nobody who stops a search waits for one more program to be compiled.
    beside = None if result.stopped else by_other_drive(problem, [design.x for design in shown], of_other)
    for name, values in beside.rows(problem) if beside else []:
        table.add_row(name, *values)
    for drive, goals, rows in beside.of_goals(followed) if beside else []:
        table.add_row(f"{DISTANCE}, drive {drive}", *(in_units(_distance(goals, row), "length") for row in rows))
    for quantity in dict.fromkeys(goal.quantity for goal in problem.goals if goal.kind != "reach"):
        k = problem.quantities.index(quantity)
        start, name = seen(problem, result.reference)[k], problem.label(quantity)
        table.add_row(f"change of {name}", "", *(_change(start, seen(problem, d)[k]) for d in shown[1:]))
        compared = beside.compared(quantity) if beside else None
        if compared is not None:
            other, drive, (first, *others) = compared
            label = f"change of {problem.label(other)}, drive {drive}"
            table.add_row(label, "", *(_change(first, value) for value in others))
    if len(problem.goals) > 1:
        table.add_row("objective", *(f"{d.objective:.5g}" if d.answered else "-" for d in shown))
    if problem.constrained:
        table.add_section()
    for k, (label, (of, *_)) in enumerate(zip(problem.constraint_labels(), problem.sides, strict=False)):
        table.add_row(label, *("-" if np.isnan(d.values[of]) else _room(d.violations[k]) for d in shown))
    for line in rules.summary(problem.rules, [d.margins for d in shown], len(problem.space.scenes) > 1):
        table.add_row(line.label, *(rules.words(margin) for margin in line.margins))
    table.add_row("status", *(" ".join(dict.fromkeys(s.name for s in d.statuses)) for d in shown))
    console.print(table)
    for number, design in enumerate(shown):
        name = f"Design {number}" if number else "The start"
        for words in unsolved(design):
            console.print(f"{name} has no answer: {words}.", soft_wrap=True)
        for words in beside.reasons[number] if beside else []:
            console.print(f"{name} by the other drive, {words}.", soft_wrap=True, markup=False)
        if number and design.active:
            console.print(f"{number} is held by: {', '.join(design.active)}", soft_wrap=True)
        for words in near_limits(design):
            console.print(f"{name}, {words}", soft_wrap=True)
    told = [*said(problem), *(beside.remarks if beside else []), *beyond_law(problem, result.best.x)]
    told += [*errors_of_shells(problem, result.best), *of_materials(problem, result.solutions, 1, 1), *result.remarks]
    for sentence in dict.fromkeys(told):
        console.print(sentence, soft_wrap=True, markup=False)
    if not result.best.answered:
        console.print(_without_answer(result), style="bold", soft_wrap=True)
    elif not result.best.feasible:
        console.print("No design that keeps every constraint was found.", style="bold")
    console.print(_batch(result), soft_wrap=True)
    times = ", ".join(f"{name} {value:.0f} s" for name, value in result.seconds.items())
    console.print(f"{result.solves} designs solved ({times})", soft_wrap=True)


def _batch(result: SearchResult) -> str:
    """What became of all the starts, and what the finish added."""
    starts = result.paths.shape[1] if result.paths.ndim == 2 else 0
    ends = [f"{n} near design {k + 1}" for k, n in enumerate(result.reached[:SHOWN]) if n]
    met = f", {result.merged} of them until they met a better one and stayed beside it" if result.merged else ""
    where = ", ".join(ends) if ends else "none ended near a design of the table"
    said = f"{starts} designs descended at once{met}: {where}."
    # No finish was asked for, or Ctrl-C came before it, where nothing was gained.
    if result.best.feasible and np.isfinite(result.descended) and result.best.objective < result.descended:
        said += f" The finish improved the objective of the best of them {_improvement(result)}."
    return said


def _improvement(result: SearchResult) -> str:
    """What the finish gained, in words: a small gain as a share of the value before, a large one by both values."""
    before, after = result.descended, result.best.objective
    share = (before - after) / max(abs(before), 1e-300)
    if share < LARGE_GAIN:
        return f"by {share:.1%}" if share >= 1e-3 else f"by {100 * share:.1g}%"
    sign, _ = _sense(result.problem)
    return f"from {sign * before:.2g} to {sign * after:.2g}"


def _change(start: float, value: float) -> str:
    """Of a quantity, relative to the start."""
    known = np.isfinite(start) and np.isfinite(value) and start != 0
    return f"{(value - start) / abs(start):+.1%}" if known else "-"


def _without_answer(result: SearchResult) -> str:
    """What kept every design that came nearest from having an answer."""
    problem, designs = result.problem, result.designs
    reasons = []
    for k, label in enumerate(problem.asked.state_labels()):
        counts = Counter(design.statuses[k] for design in designs if design.statuses[k] != Status.OK)
        words = ", ".join(f"{n} {status.name}" for status, n in counts.most_common())
        reasons += [f"{label}: {words}"] if words else []
    return f"No design with an answer was found. Of the {len(designs)} that came nearest, {'; '.join(reasons)}."


def _distance(followed: list[Goal], values: np.ndarray) -> float:
    """Root of the mean square distance of a shape from the points that it shall go through, m: two goals to a point.
    values: of the goals' quantities, in SI."""
    missed = values - np.array([goal.target or 0.0 for goal in followed])
    return float(np.sqrt(2 * np.mean(np.square(missed))))


def _room(violation: float) -> str:
    """What is left to a bound, relative to it."""
    if violation > FEASIBLE:
        return f"broken by {violation:.2%}" if violation >= SEEN else f"broken by {violation:.1e} of it"
    if violation < -AMPLE:
        return "ample room"
    return "on it" if violation > -ACTIVE else f"room {-violation:.1%}"
