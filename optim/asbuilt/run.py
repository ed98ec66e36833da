"""`softgrip measure CONFIG.toml MEASURED.toml`: the design as built, what it does, and what a search would change.

The folder: as_built.toml (the config with the numbers as built and the moduli of the curves), measured.toml as given,
config.toml, numbers.csv, result.json, summary.txt and report.html.
"""

from __future__ import annotations

import dataclasses
import json
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from softgrip_jax import config as configs
from softgrip_jax.errors import InputError, located
from softgrip_jax.folders import new_folder
from softgrip_jax.progress import Tell, stages
from softgrip_jax.questions import pressure_for, solve
from softgrip_jax.report.inputs import named_files, renamed
from softgrip_jax.report.run import tell_and_keep, write_report
from softgrip_jax.results import Solution, Status, in_units
from softgrip_jax.tables import Table
from softgrip_jax.units import DISPLAY, unit_key

from ..calibration.provenance import provenance
from ..calibration.run import plain
from ..calibration.settings import TEST
from ..design import settings as design_settings
from ..design.run import run_design
from ..records import summary, versions, write_csv
from ..space import Space, Variable
from . import settings as measured_settings
from .settings import Settings
from .update import AsBuilt, calibrated, updated

GIVEN = 1e-9
"""What has less of a standard deviation, relative, does not depend on the parts."""
MOST_NAMED = 5
"""Variables of a search that are named, those that the goal changes most with."""


@dataclasses.dataclass(frozen=True)
class Compared:
    """An observable of the drawn design and of the one that was built, SI."""

    name: str
    kind: str
    drawn: float
    built: float
    deviation: float
    """Of the built one, by what is not known of its numbers."""
    low_95: float
    high_95: float

    @property
    def half(self) -> float:
        """Half of the 95 % interval."""
        return (self.high_95 - self.low_95) / 2


class Answer(NamedTuple):
    """Whether the design as built has an answer, and why not, in words."""

    status: Status
    reason: str


def run_measure(config: Path, measured: Path, out: Path | None, console: Console, search: bool = False) -> Path:
    """Update a design by what was measured of it, and return the folder that holds it."""
    read = configs.load(config)
    if search and "design" not in read.tables:
        raise InputError(f"{config} has no section [design], so there is nothing to search again; leave out --search.")
    wanted = measured_settings.read(read, measured)
    with new_folder(out, f"{config.stem}_built") as (folder, final):
        with located(str(measured)), stages(console) as tell:
            if wanted.table.masses:
                tell("volumes of the parts")
            known = updated(wanted)
            if wanted.calibration is not None:
                tell("compiling once, then the curves")
                known = calibrated(wanted, known)
            scenes = scenes_built(wanted, known)
            compared, answer = compare(wanted, known, tell)
            helps = elasticities(wanted, scenes, tell)
        (folder / "config.toml").write_bytes(configs.standalone(config))
        (folder / "measured.toml").write_bytes(measured.read_bytes())
        comment = f"{provenance(measured.name)}\nThe design of {config.name} as it was built."
        text = configs.dump(scenes, comment, **found_from_elsewhere(read))
        (folder / "as_built.toml").write_text(text, encoding="utf-8")
        write_csv(folder / "numbers.csv", rows(wanted, known))
        (folder / "result.json").write_text(
            json.dumps(record(wanted, known, compared, answer, helps), indent=2), encoding="utf-8"
        )
        tell_and_keep(folder, console, partial(report, wanted, known, compared, answer, helps))
        write_report(folder, final.name)
    file = final / "as_built.toml"
    command = f"softgrip {'design' if 'design' in read.tables else 'solve'} {file}"
    console.print(summary("design as built", final, "" if search else command), soft_wrap=True)
    if search:
        run_design(file, final / "search", console)
    return final


def found_from_elsewhere(read: configs.Config) -> dict[str, Any]:
    """The sections of a config for a file in another folder: files in them, as a posterior, by their whole paths."""
    paths = {name: str((read.path.parent / name).resolve()) for name in named_files(read.tables)}
    return renamed(read.tables, paths)


def keys(settings: Settings) -> list[tuple[str, str]]:
    """(key, kind) of the numbers, and then of the parameters of the fit."""
    found = [(number.key, number.kind) for number in settings.numbers]
    if settings.calibration is not None:
        space = settings.calibration.fitting.space
        found += [(unit_key(name, kind), kind) for name, kind in zip(space.names, space.kinds, strict=True)]
    return found


def names(settings: Settings) -> list[str]:
    """The same without their units, as scenes have them: what stands beside a value in SI."""
    calibration = settings.calibration
    return [*settings.space.names, *(calibration.fitting.space.names if calibration is not None else [])]


def values(settings: Settings, known: AsBuilt) -> tuple[np.ndarray, np.ndarray]:
    """(drawn, built) of the numbers, and then of the parameters of the fit."""
    drawn, built = known.drawn, known.built
    if known.fit is not None and settings.calibration is not None:
        drawn = np.concatenate([drawn, settings.calibration.fitting.space.reference])
        built = np.concatenate([built, known.fit.x[len(built) :]])
    return drawn, built


def intervals(settings: Settings, known: AsBuilt) -> list[tuple[float, float]]:
    """The 95 % intervals of the same; of a parameter that is fitted by its logarithm they are of that, so that they
    hold nothing negative."""
    built = values(settings, known)[1]
    halves = known.half_widths(np.eye(len(built)))
    is_log = space_of(settings).is_log
    with np.errstate(over="ignore"):
        return [
            (float(now * np.exp(-half / now)), float(now * np.exp(half / now)))
            if log
            else (float(now - half), float(now + half))
            for now, half, log in zip(built, halves, is_log, strict=True)
        ]


def space_of(settings: Settings) -> Space:
    """All numbers that are known anew, in the scenes of the config."""
    variables = list(settings.space.variables)
    if settings.calibration is not None:
        scenes = settings.config.scenes
        for one in settings.calibration.fitting.space.variables:
            own = [name for name in one.name.split(" = ") if not name.startswith(TEST)]
            variables.append(Variable(" = ".join(own), one.low, one.high, one.scale))
        return Space(scenes, variables)
    return settings.space


def scenes_built(settings: Settings, known: AsBuilt) -> dict[str, Any]:
    """The scenes with the numbers as built."""
    return space_of(settings).scenes_at(jnp.asarray(values(settings, known)[1]))


def compare(settings: Settings, known: AsBuilt, tell: Tell) -> tuple[list[Compared], Answer | None]:
    """What the config asks, of the drawn design and of the one that was built, and whether that has an answer; None
    where the config asks nothing."""
    name = settings.table.scene or next(iter(settings.config.scenes))
    scene = settings.config.scenes[name]
    one = dataclasses.replace(settings.config, scenes={name: scene})
    asked = configs.question(one) if "solve" in one.tables else {}
    if not asked:
        try:
            scene.target()
        except InputError:
            return [], None
    tell("solving the design as built")
    space = space_of(settings)

    def solved(x: Any) -> Solution:
        one = space.scenes_at(x)[name]
        return solve(one, asked["pressure"]) if "pressure" in asked else pressure_for(one, **asked)

    def observed(solution: Solution) -> dict[str, Any]:
        return solution.observables | {"pressure": solution.pressure}

    program = jax.jit(jax.vmap(solved))
    slopes = jax.jit(jax.jacfwd(lambda x: observed(solved(x))))
    drawn, built = values(settings, known)
    found = program(jnp.stack([drawn, built]))
    answer = Answer(Status(int(found.status[1])), found.reason_text()[1])
    if answer.status != Status.OK:
        return [], answer
    J = slopes(jnp.asarray(built))
    compared, numbers = [], observed(found)
    for one, kind in (scene.prepared().OBSERVABLES | {"pressure": "pressure"}).items():
        if kind == "position" or ("pressure" in asked and one == "pressure"):
            continue
        j = np.asarray(J[one])
        was, now = map(float, np.asarray(numbers[one]))
        half = float(known.half_widths(j[None])[0])
        compared.append(Compared(one, kind, was, now, float(np.sqrt(j @ known.joint @ j)), now - half, now + half))
    return compared, answer


def elasticities(settings: Settings, scenes: dict[str, Any], tell: Tell) -> list[tuple[str, str, float]]:
    """(variable of the search, what its first goal is about, per cent of it for one per cent more of the variable) of
    the design as built, the largest first; empty without a search."""
    if "design" not in settings.config.tables:
        return []
    tell("what a search would change")
    wanted = design_settings.read(dataclasses.replace(settings.config, scenes=scenes))
    problem = wanted.problem
    measured, slopes = problem.measured_with_slopes(problem.space.to_unit(problem.space.reference)[None])
    quantity = problem.goals[0].quantity
    k = problem.quantities.index(quantity)
    value = float(np.asarray(measured.values)[0, k])
    x = problem.space.reference
    by_unit = np.asarray(slopes.values)[0, k]
    space = problem.space
    # The slopes are by unit values: x is linear in them, or exponential.
    by = np.where(space.is_log, x * np.log(space.high / np.where(space.is_log, space.low, 1.0)), space.high - space.low)
    found = [
        (name, problem.label(quantity), float(slope / dx * at / value))
        for name, slope, dx, at in zip(problem.space.names, by_unit, by, x, strict=True)
        if np.isfinite(slope) and np.isfinite(value) and value
    ]
    return sorted(found, key=lambda one: -abs(one[2]))


def rows(settings: Settings, known: AsBuilt) -> list[dict[str, Any]]:
    """The table of the numbers, in the units of their keys."""
    units = [DISPLAY[kind][1] for _, kind in keys(settings)]
    return [
        {"number": key} | {name: value / unit for name, value in ends.items()}
        for (key, _), unit, ends in zip(keys(settings), units, _ends(settings, known), strict=True)
    ]


def _ends(settings: Settings, known: AsBuilt) -> list[dict[str, float]]:
    """Of each number what was drawn and what was built, with the ends of its 95 % interval, SI."""
    return [
        {"drawn": float(was), "built": float(now), "low_95": low, "high_95": high}
        for was, now, (low, high) in zip(*values(settings, known), intervals(settings, known), strict=True)
    ]


def record(
    settings: Settings, known: AsBuilt, compared: list[Compared], answer: Answer | None, helps: list[Any]
) -> dict[str, Any]:
    """All of it as plain data, SI; null for what is not known of the drawn design."""
    return {
        "units": "SI",
        "numbers": [
            {"number": name} | dict(zip(ends, plain(list(ends.values())), strict=True))
            for name, ends in zip(names(settings), _ends(settings, known), strict=True)
        ],
        "status": answer and answer.status.name,
        "reason": answer and answer.reason,
        "observables": [
            dataclasses.asdict(one) | {"drawn": one.drawn if np.isfinite(one.drawn) else None} for one in compared
        ],
        "elasticities": [{"variable": name, "of": of, "elasticity": value} for name, of, value in helps],
    } | versions()


def report(
    settings: Settings,
    known: AsBuilt,
    compared: list[Compared],
    answer: Answer | None,
    helps: list[Any],
    console: Console,
) -> None:
    """Drawn and built, side by side, and what a search would change."""
    table = Table(title="as drawn and as built", title_justify="left")
    for head in ("", "drawn", "built, and its 95 % interval", "change"):
        table.add_column(head, justify="right" if head else "left")
    is_log = space_of(settings).is_log
    for (key, kind), log, ends in zip(keys(settings), is_log, _ends(settings, known), strict=True):
        was, now, low, high = ends.values()
        lowest = f"{low / DISPLAY[kind][1]:.5g}"
        around = f"({lowest} to {in_units(high, kind)})" if log else f"+- {in_units(high - now, kind)}"
        table.add_row(key, in_units(was, kind), f"{in_units(now, kind)} {around}", f"{now / was - 1:+.1%}")
    table.add_section()
    for one in compared:
        if not one.deviation > GIVEN * abs(one.built):  # what the task asks for is given
            continue
        interval = f"{in_units(one.built, one.kind)} +- {in_units(one.half, one.kind)}"
        change = f"{one.built / one.drawn - 1:+.1%}" if one.drawn and np.isfinite(one.drawn) else "-"
        table.add_row(one.name.replace("_", " "), in_units(one.drawn, one.kind), interval, change)
    console.print(table)
    if answer is not None and answer.status != Status.OK:
        console.print(
            f"The design as built has no answer ({answer.status.name}): {answer.reason}.", style="bold", soft_wrap=True
        )
    for one, number, was, now in zip(settings.table.numbers, settings.numbers, known.drawn, known.built, strict=True):
        off = abs(now / was - 1) / one.tolerance
        if off > 2:
            console.print(f"{number.key} is {off:.1f} tolerances from the drawing.", soft_wrap=True)
    for remark in known.remarks:
        console.print(remark, soft_wrap=True, highlight=False)
    if helps:
        words = ", ".join(f"{name} {value:+.2f} %" for name, _, value in helps[:MOST_NAMED])
        console.print(
            f"One per cent more of a number changes {helps[0][1]} of the design as built by: {words}.", soft_wrap=True
        )
