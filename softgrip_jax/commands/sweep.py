"""`softgrip sweep CONFIG.toml`: a parameter study in a folder, which may be stopped and continued.

    [sweep]                                   [[sweep.variables]]           [[sweep.observables]]
    method = "grid"                           name = "shell.a_mm"           name = "force_N"     # or a list of names
    gradients = true                          low = 10                      at = { pressure_kPa = [10, 15] }
                                              high = 20
                                              points = 21

method: "grid" (points per variable, or a list `values`), "latin_hypercube" or "sobol" (`samples`, `seed`; low and high
per variable), or "csv" (`file`, beside the config; its columns are named as variables are, units and all; with
[[sweep.variables]] only those columns are read). Names and states are those of `softgrip_jax.config.keys`.

The folder: config.toml, study.nc (read it with `sg.load_study`), study.csv, and a picture.
"""

from __future__ import annotations

import csv
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pydantic
import xarray as xr
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .. import config as configs
from ..config.keys import Table, Varied, quantity, states_of, varied
from ..errors import ConfigError, InputError, located
from ..folders import check_folder, contents, free_name, write_whole
from ..parameters import Parameter
from ..progress import LINE_SECONDS
from ..quantities import State, solution_at
from ..reasons import Reason
from ..results import Status, in_units
from ..study import Designs, Grid, LatinHypercube, Range, Sobol, Study, load_study, run_in
from ..study import Table as TableOfDesigns
from ..study.dataset import status_name
from ..study.store import MANIFEST
from ..tables import Table as PrintedTable
from .files import plain


class SweptVariable(Table):
    name: str | list[str]
    low: float | None = None
    high: float | None = None
    points: int | None = pydantic.Field(default=None, ge=2, le=1_000_000)
    values: list[float] | None = pydantic.Field(default=None, min_length=1)
    scale: Literal["linear", "log"] = "linear"


class ObservableTable(Table):
    name: str | list[str]
    at: str | dict[str, float | list[float]] | None = None


class SweepTable(Table):
    method: Literal["grid", "latin_hypercube", "sobol", "csv"]
    variables: list[SweptVariable] = []
    observables: list[ObservableTable] = pydantic.Field(min_length=1)
    samples: int | None = pydantic.Field(default=None, ge=1, le=1_000_000_000)
    seed: int = pydantic.Field(default=0, ge=0)
    file: str | None = None
    gradients: bool = False


def read(config: configs.Config) -> tuple[Study, str]:
    """(the study of the section [sweep], the text that tells it from others); ConfigError for what is wrong in it."""
    where = f"{config.path}, [sweep]"
    if "sweep" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [sweep], which says what to vary.")
    table: SweepTable = configs.validated(SweepTable, config.tables["sweep"], where)
    identity = configs.standalone(config.path).decode()
    _check_keys(table, where)
    numbers = [varied(config.scenes, v.name, where) for v in table.variables]
    if table.method == "csv":
        path = config.path.parent / str(table.file)
        numbers, designs = _from_csv(config, path, numbers, where)
        identity += path.read_text(encoding="utf-8")
    else:
        designs = _spread(table, numbers, where)
    quantities = []
    for observed in table.observables:
        for name in [observed.name] if isinstance(observed.name, str) else observed.name:
            quantities += [quantity(config.scenes, name, at, where)[0] for at in states_of(observed.at)]
    with located(where):
        study = Study(config.scenes, [Parameter(v.name) for v in numbers], quantities, designs, table.gradients)
    return study, identity


def _check_keys(table: SweepTable, where: str) -> None:
    """Keys that belong to another method, or are missing for this one."""
    sampled = table.method in ("latin_hypercube", "sobol")
    if sampled != (table.samples is not None):
        words = "needs samples" if sampled else "has no samples"
        raise ConfigError(f"{where}: the method {table.method!r} {words}.")
    if (table.method == "csv") != (table.file is not None):
        words = "needs a file" if table.method == "csv" else "reads no file"
        raise ConfigError(f"{where}: the method {table.method!r} {words}.")
    if table.method != "csv" and not table.variables:
        raise ConfigError(f"{where}: there is no [[sweep.variables]]; name at least one number to vary.")
    for variable in table.variables:
        given = [k for k in ("low", "high", "points", "values") if getattr(variable, k) is not None]
        allowed: dict[str, list[list[str]]] = {"grid": [["low", "high", "points"], ["values"]], "csv": [[]]}
        ways = allowed.get(table.method, [["low", "high"]])
        if given not in ways:
            words = " or ".join(", ".join(way) or "its name alone" for way in ways)
            raise ConfigError(f"{where}: {variable.name} has {', '.join(given) or 'its name alone'}; give {words}.")


def _spread(table: SweepTable, numbers: list[Varied], where: str) -> Designs:
    axes, ranges = [], []
    for variable, number in zip(table.variables, numbers, strict=True):
        if variable.values is not None:
            axes.append(np.array([number.checked(value, "a value", where) for value in variable.values]))
            continue
        low, high = number.checked(variable.low, "low", where), number.checked(variable.high, "high", where)
        try:
            ranges.append(Range(low, high, variable.scale))
        except InputError:
            raise ConfigError(
                f"{where}: {number.key} goes from {variable.low:g} to {variable.high:g}; low must be below high, and "
                "above zero on a log scale."
            ) from None
        axes.append(ranges[-1].points(variable.points or 2))
    if table.method == "grid":
        return Grid(axes)
    return {"sobol": Sobol, "latin_hypercube": LatinHypercube}[table.method](ranges, table.samples or 1, table.seed)


def _from_csv(
    config: configs.Config, path: Path, numbers: list[Varied], where: str
) -> tuple[list[Varied], TableOfDesigns]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *lines = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{where}: {path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    header = [name.strip() for name in header]
    missing = [number.key for number in numbers if number.key not in header]
    if missing:
        raise ConfigError(f"{where}: there is no column {missing[0]!r} in {path}; it has {', '.join(header)}.")
    places = [header.index(number.key) for number in numbers]
    if not numbers:
        numbers = [varied(config.scenes, [k.strip() for k in name.split("=")], f"{path}, line 1") for name in header]
        places = list(range(len(header)))
    rows = []
    for count, line in enumerate(lines, start=2):
        if not any(cell.strip() for cell in line):
            continue
        spot, row = f"{path}, line {count}", []
        for place, number in zip(places, numbers, strict=True):
            cell = line[place].strip() if place < len(line) else ""
            try:
                value = float(cell)
            except ValueError:
                raise ConfigError(f"{spot}: {number.key} is {cell!r}; it must be a number.") from None
            row.append(number.checked(value, "the value", spot))
        rows.append(row)
    if not rows:
        raise ConfigError(f"{path} has no rows of designs below its header.")
    return numbers, TableOfDesigns(np.array(rows))


QUICK = 100_000
"""Designs a second of the quickest scenes on a common machine, without derivatives: what a study takes at least."""

LONGEST_DAYS = 30
"""At that speed: nobody waits for what would take longer."""

BYTES = 44
"""Of disk per number of a design while the files are written: 8 in its chunk, 8 in the arrays that are collected, 8 in
study.nc and about 20 in study.csv."""


def refuse_what_cannot_end(study: Study, folder: Path, where: str) -> None:
    """A ConfigError, with the least time and the disk that it takes, for a study that no disk or patience holds."""
    if (folder / MANIFEST).is_file():
        return  # it goes on, and what it needs is partly there
    count, quantities = study.designs.count, len(study.asked.quantities)
    numbers = study.leaves.size + quantities * (1 + study.leaves.size * study.gradients) + len(study.asked.states)
    days, size = count / QUICK / 86_400, float(BYTES * numbers * count)
    place = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = float(shutil.disk_usage(place).free)
    if days > LONGEST_DAYS or size > free:
        raise ConfigError(
            f"{where}: these are {count:,} designs; at {QUICK:,} a second, which only simple scenes reach, they "
            f"take {_duration(days)} and about {_bytes(size)} of disk, of which {_bytes(free)} are free; give fewer "
            "points, or samples of a Sobol set in place of a grid."
        )


def _duration(days: float) -> str:
    for name, unit in (("years", 365.25), ("days", 1.0), ("hours", 1 / 24), ("minutes", 1 / 1440)):
        if days >= 2 * unit:
            return f"{days / unit:,.0f} {name}"
    return f"{days * 86_400:.0f} seconds"


def _bytes(count: float) -> str:
    names = ("bytes", "kB", "MB", "GB", "TB", "PB")
    power = min(int(np.log10(max(count, 1)) / 3), len(names) - 1)
    return f"{count / 1000.0**power:,.3g} {names[power]}"


LOOKED_AT = 16
"""Designs that are solved again to say why none has an answer."""


# --- the run ----------------------------------------------------------------------------------------------------------


def run_sweep(config: Path, out: Path | None, console: Console) -> tuple[Path, list[str]]:
    """Run the study of a config, or go on with it where `out` holds it already, and report; returns the folder, and
    sentences that say why where nothing in the study has an answer."""
    study, identity = read(configs.load(config))
    folder = free_name(config.stem) if out is None else out
    refuse_what_cannot_end(study, folder, f"{config}, [sweep]")
    check_folder(folder)
    if out is None:
        console.print(f"The study goes to {folder}; if it is stopped, --out {folder} goes on with it.", soft_wrap=True)
    with _progress(study.designs.count, console) as report:
        run_in(folder, study, identity, report, lambda sentence: console.print(sentence, soft_wrap=True))
    write_whole(folder / "config.toml", configs.standalone(config))
    with load_study(folder) as data:
        _draw(study, data, folder)
        _report(study, data, console)
        reasons = why_nothing(study, data)
    console.print(f"The study is in {folder}: {contents(folder)}.", soft_wrap=True)
    console.print(f"In Python: softgrip_jax.load_study({str(folder)!r})", soft_wrap=True)
    return folder, reasons


@contextmanager
def _progress(total: int, console: Console) -> Iterator[Callable[[int, int], None]]:
    """What `run_in` reports to: a bar with the time left, or a line now and then where there is no terminal."""
    if not console.is_terminal:
        # The first chunk compiles: the speed is that of what follows it.
        first, last = [0.0, 0.0], [0.0]

        def tell(done: int, skipped: int) -> None:
            now = time.monotonic()
            if done == skipped:
                words = f"going on with {done} of {total} designs" if done else f"compiling, then {total} designs"
                console.print("all designs are there" if done == total else words)
            elif done == total or now - last[0] >= LINE_SECONDS:
                known = first[0] and done > first[1]
                left = (now - first[0]) * (total - done) / (done - first[1]) if known else 0.0
                console.print(f"{done} of {total} designs" + (f", {left:.0f} s left" if known and left else ""))
                last[0] = now
            if done > skipped and not first[0]:
                first[:] = now, done

        yield tell
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
    # The speed of the last minutes: a chunk of slow designs may take a while.
    with Progress(TextColumn("designs"), *columns, console=console, speed_estimate_period=300) as progress:
        task = progress.add_task("", total=total)
        yield lambda done, skipped: progress.update(task, completed=done)


def _draw(study: Study, data: xr.Dataset, folder: Path) -> None:
    if study.designs.count < 2:
        return
    from .. import plots

    plots.study(data).savefig(folder / "study.png")


def _report(study: Study, data: xr.Dataset, console: Console) -> None:
    """How many designs have an answer, and how far every quantity spreads over them."""
    for k, label in enumerate(study.asked.state_labels()):
        seen = np.asarray(data[status_name(study, k)])
        counts = {Status(int(v)).name: int(n) for v, n in zip(*np.unique(seen, return_counts=True), strict=True)}
        words = ", ".join(f"{n} {name}" for name, n in counts.items())
        console.print(f"{label}: {words}", soft_wrap=True)
    table = PrintedTable(title=f"{study.designs.count} designs", title_justify="left")
    for name in ("", "least", "median", "most"):
        table.add_column(name, justify="right" if name else "left")
    for label, kind, name in zip(study.asked.labels(), study.asked.kinds, _quantity_names(data), strict=True):
        values = np.asarray(data[name])
        values = values[np.isfinite(values)]
        numbers = [values.min(), np.median(values), values.max()] if values.size else [np.nan] * 3
        table.add_row(label, *(in_units(v, kind) for v in numbers))
    console.print(table)


def why_nothing(study: Study, data: xr.Dataset) -> list[str]:
    """A sentence for every state that no design has, with its statuses and the most frequent reason; nothing where one
    design has an answer in one state.

    The reason is that of LOOKED_AT designs, spread over the study.
    """
    statuses = [np.asarray(data[status_name(study, k)]).ravel() for k in range(len(study.asked.states))]
    if any(np.any(seen == Status.OK) for seen in statuses):
        return []
    count = study.designs.count
    places = np.unique(np.linspace(0, count - 1, min(LOOKED_AT, count)).astype(int)).tolist()
    designs = np.concatenate([study.designs.rows(k, k + 1) for k in places])
    sentences = []
    for (name, at), label, seen in zip(study.asked.states, study.asked.state_labels(), statuses, strict=True):
        counts = Counter(Status(int(v)).name for v in seen)
        words = ", ".join(f"{n} {status}" for status, n in counts.most_common())
        sentence = f"{label}: none of {count} designs has an answer ({words})"
        if at is not None:
            sentence += f"; the most frequent reason: {_reason(study, name, at, designs)}"
        sentences.append(f"{sentence}.")
    return sentences


def _reason(study: Study, scene: str, at: State, designs: np.ndarray) -> str:
    """The most frequent reason, as the first design says it that has it."""

    def ask(x):
        solution = solution_at(study.leaves.scenes_at(x)[scene], at)
        return solution.reason, solution.detail

    reasons, details = (np.asarray(v) for v in jax.jit(jax.vmap(ask))(jnp.asarray(designs)))
    [(most, _)] = Counter(reasons.tolist()).most_common(1)
    return Reason(most).text(float(details[reasons == most][0])).rstrip(".")


def _quantity_names(data: xr.Dataset) -> list[str]:
    return [str(name) for name, variable in data.data_vars.items() if "status" in variable.attrs]


def spread(folder: Path) -> dict[str, Any]:
    """How far the quantities of a study spread, in SI."""
    found: dict[str, Any] = {}
    with load_study(folder) as data:
        for name, values in data.data_vars.items():
            if "status" in values.attrs:
                known = np.asarray(values)[np.isfinite(values)]
                ends = [known.min(), np.median(known), known.max()] if known.size else [np.nan] * 3
                found[str(name)] = {"unit": values.attrs["units"], "answered": int(known.size)}
                found[str(name)] |= dict(zip(("least", "median", "most"), map(plain, ends), strict=True))
    return found
