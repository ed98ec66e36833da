"""`softgrip sweep CONFIG.toml`: a parameter study in a folder, which may be stopped and continued.

    [sweep]                                   [[sweep.variables]]           [[sweep.observables]]
    method = "grid"                           name = "shell.a_mm"           name = "force_N"     # or a list of names
    gradients = true                          low = 10                      at = { pressure_kPa = [10, 15] }
                                              high = 20
                                              points = 21

method: "grid" (points per variable, or a list `values`), "latin_hypercube" or "sobol" (`samples`, `seed`; low and high
per variable), or "csv" (`file`, beside the config; its columns are named as variables are, units and all, tied ones
"shell.a_mm = shell.b_mm"; with [[sweep.variables]] only those columns are read; commas, semicolons or tabs part them,
and lines that begin with # are comments). Names and states are those of `softgrip_jax.config.keys`.

The folder: config.toml, study.zarr (read it with `sg.load_study`), a picture, summary.txt, report.html and,
where asked for, study.csv.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import tomllib
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pydantic
import xarray as xr
from rich.console import Console

from .. import config as configs
from ..config.csv_text import MARKS, cells_of, uncommented
from ..config.keys import ObservableTable, Seed, Table, Varied, observed, varied
from ..errors import ConfigError, InputError, located
from ..folders import check_folder, contents, free_name, write_whole
from ..parameters import Parameter
from ..progress import counted
from ..quantities import State, rules_at_rest, solution_at
from ..reasons import BROKEN, Reason
from ..report.inputs import keep_inputs
from ..report.run import NAME, WORDS, tell_and_keep, write_report
from ..results import Status
from ..study import Designs, Grid, LatinHypercube, Range, Sobol, Study, run_in
from ..study import Table as TableOfDesigns
from ..study.dataset import status_name, tied_keys, write_csv
from ..study.store import BEGUN, STORE, address_of, opened
from ..study.summary import reason_counts
from ..units import number_of
from .summary import draw, tell_quantities


class SweptVariable(Table):
    name: str | list[str]
    low: float | None = None
    high: float | None = None
    points: int | None = pydantic.Field(default=None, ge=2, le=1_000_000)
    values: list[float] | None = pydantic.Field(default=None, min_length=1)
    scale: Literal["linear", "log"] = "linear"


class SweepTable(Table):
    method: Literal["grid", "latin_hypercube", "sobol", "csv"]
    variables: list[SweptVariable] = []
    observables: list[ObservableTable] = pydantic.Field(min_length=1)
    samples: int | None = pydantic.Field(default=None, ge=1, le=1_000_000_000)
    seed: Seed = 0
    file: str | None = None
    gradients: bool = False


def read(config: configs.Config) -> tuple[Study, str]:
    """(the study of the section [sweep], the text that tells it from others); ConfigError for what is wrong in it."""
    where = f"{config.path}, [sweep]"
    if "sweep" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [sweep], which says what to vary.")
    table: SweepTable = configs.validated(SweepTable, config.tables["sweep"], where)
    identity = _meaning(configs.read_sections(config.path))
    _check_keys(table, where)
    numbers = [varied(config.scenes, v.name, where) for v in table.variables]
    if table.method == "csv":
        path = config.path.parent / str(table.file)
        numbers, designs = _from_csv(config, path, numbers, where)
        identity += "\n".join(filter(str.strip, uncommented(path.read_text(encoding="utf-8-sig"))))
    else:
        designs = _spread(table, numbers, where)
    quantities = observed(config.scenes, table.observables, where)
    with located(where):
        study = Study(config.scenes, [Parameter(v.name) for v in numbers], quantities, designs, table.gradients)
    return study, identity


def _meaning(tables: dict[str, Any]) -> str:
    """What a config says, without its comments and whatever the order of its keys: they make no other study."""
    return json.dumps(tables, sort_keys=True, default=str)


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
            twice = [value for value in variable.values if variable.values.count(value) > 1]
            if twice:
                raise ConfigError(
                    f"{where}: the values of {number.key} hold {twice[0]:g} twice; each may be there once."
                )
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
    (first, header), *lines = table_of_designs(path, where)
    places = [_place(number, header, f"{path}, line {first}") for number in numbers]
    if not numbers:
        numbers = [_of_column(config, name, f"{path}, line {first}") for name in header]
        places = list(range(len(header)))
    rows = []
    for count, line in lines:
        spot, row = f"{path}, line {count}", []
        if any(line[len(header) :]):
            raise ConfigError(
                f"{spot}: there are {len(line)} cells below {len(header)} columns; a decimal comma must be a point."
            )
        for place, number in zip(places, numbers, strict=True):
            cell = line[place] if place < len(line) else ""
            value = number_of(cell)
            if value is None:
                hint = " with a decimal point" if number_of(cell.replace(",", ".", 1)) is not None else ""
                raise ConfigError(f"{spot}: {number.key} is {cell!r}; it must be a number{hint}.")
            row.append(number.checked(value, "the value", spot))
        rows.append(row)
    if not rows:
        raise ConfigError(f"{path} has no rows of designs below its header.")
    return numbers, TableOfDesigns(np.array(rows))


def table_of_designs(path: Path, where: str) -> list[tuple[int, list[str]]]:
    """The header of a CSV of designs and then its rows, each with the number of its line; never empty. What parts the
    columns is what parts the header into most of them."""
    try:
        lines = uncommented(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{where}: {path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    table, mark = [], ""
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            widths = {} if mark else {mark: len(cells_of(line, mark)) for mark in MARKS}
            mark = mark or max(widths, key=widths.__getitem__)
            row = [cell.strip() for cell in cells_of(line, mark)]
        except InputError as error:
            raise ConfigError(f"{where}: {path}, line {number}: {error}") from None
        table += [(number, row)] if any(row) else []
    if not table:
        raise ConfigError(f"{where}: {path} is empty; its first line must name the columns.")
    header = [" = ".join(keys_in(name)) for name in table[0][1]]
    while not header[-1]:  # a comma at the end of the line
        header.pop()
    return [(table[0][0], header), *table[1:]]


def keys_in(column: str) -> list[str]:
    """The keys of a column, tied ones joined by '='."""
    return [key.strip() for key in column.split("=")]


def _place(number: Varied, header: list[str], where: str) -> int:
    """Which column is a number: by its key, or by those of all that are tied, as study.csv names them."""
    known = {number.key, " = ".join(number.keys), tied_keys(number.name, number.kind)}
    places = [place for place, name in enumerate(header) if name in known]
    if not places:
        raise ConfigError(f"{where}: there is no column {number.key!r}; there are {', '.join(header)}.")
    if places[1:]:
        raise ConfigError(
            f"{where}: {len(places)} columns are called {header[places[0]]!r}; one that is read must be there once."
        )
    return places[0]


def _of_column(config: configs.Config, column: str, where: str) -> Varied:
    try:
        return varied(config.scenes, keys_in(column), where)
    except ConfigError as error:
        raise ConfigError(
            f"{str(error).rstrip('.')} (where a table has other columns, too, [[sweep.variables]] picks those to read)."
        ) from None


QUICK = 1_000_000
"""Designs a second of the quickest scenes on a common machine, without derivatives: what a study takes at least."""

UNKNOWN_PROCESSES = 1_000_000
"""Processes of a scheduler, of which nobody knows how many may join."""

LONGEST_DAYS = 30
"""At that speed: nobody waits for what would take longer."""

BYTES, CSV_BYTES = 8, 20
"""Of disk per number of a design: in the store, and in study.csv."""


def refuse_what_cannot_end(study: Study, place: str, with_csv: bool, workers: int, where: str) -> None:
    """A ConfigError, with the least time and the disk that it takes, for a study that no disk or patience holds."""
    address = address_of(place)
    is_local = "://" not in address
    if is_local and (Path(address) / "zarr.json").is_file():
        return  # it goes on, and what it needs is partly there
    count, quantities = study.designs.count, len(study.asked.quantities)
    numbers = study.leaves.size + quantities * (1 + study.leaves.size * study.gradients) + len(study.asked.states)
    days = count / (QUICK * max(workers, 1)) / 86_400
    size = float((BYTES + CSV_BYTES * with_csv) * numbers * count)
    free = np.inf
    if is_local:
        nearest = next(path for path in Path(address).absolute().parents if path.exists())
        free = float(shutil.disk_usage(nearest).free)
    if days > LONGEST_DAYS or size > free:
        raise ConfigError(
            f"{where}: these are {count:,} designs; at {QUICK:,} a second and process, which only simple scenes reach, "
            f"they take {_duration(days)} and about {_bytes(size)} of disk"
            + (f", of which {_bytes(free)} are free" if is_local else "")
            + "; give fewer points, or samples of a Sobol set in place of a grid."
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


SOLVED_AGAIN = 16
"""Designs that are solved again to say why none has an answer."""
LOOKED_AT = 200
"""Designs whose parts are looked at."""


# --- the run ----------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Where:
    """Where a study goes, and who computes it."""

    out: Path | None = None
    to: str | None = None
    csv: bool = False
    workers: int | None = None
    scheduler: str | None = None
    insecure: bool = False


def run_sweep(config: Path, where: Where, console: Console) -> tuple[dict[str, Any], list[str]]:
    """Run the study of a config, or go on with it where it was begun, and report; returns where it is and how far its
    quantities spread in SI, and sentences that say why where nothing in the study has an answer."""
    study, identity = read(configs.load(config))
    folder = where.out
    if folder is None and where.to is None:
        folder = free_name(config.stem)
        console.print(f"The study goes to {folder}; if it is stopped, --out {folder} goes on with it.", soft_wrap=True)
    if where.csv and folder is None:
        raise ConfigError("--csv is given without --out, the folder in which the table is written.")
    place = where.to or str(folder)
    if where.to is not None and "://" not in where.to and Path(where.to).suffix != ".zarr":
        raise ConfigError(f"--to is {where.to!r}; it must be a path that ends in .zarr, or an address (s3://...).")
    processes = where.workers or (UNKNOWN_PROCESSES if where.scheduler else 1)
    for wanted in (folder, None if "://" in address_of(place) else Path(address_of(place))):
        if wanted is not None:
            check_folder(wanted)
    refuse_what_cannot_end(study, place, where.csv, processes, f"{config}, [sweep]")
    inputs = {} if folder is None else _inputs(config)
    if folder is not None and where.to is not None:
        _refuse_another_run(folder, inputs, Path(address_of(place)))
    with counted(console, "designs", study.designs.count) as count, _spread_over(where) as spread:
        run_in(
            place,
            study,
            identity,
            lambda done, skipped: count(done),
            lambda sentence: console.print(sentence, soft_wrap=True),
            spread,
        )
    with opened(place) as data:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            for name, content in inputs.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                write_whole(folder / name, content)
            if study.designs.count > 1:
                draw(data, folder / "study.png")
            if where.csv:
                write_whole(folder / "study.csv", lambda path: write_csv(data, path))
            told = tell_and_keep(folder, console, partial(tell, data, beyond=beyond_ranges(study)))
            write_report(folder)
        else:
            told = tell(data, console, beyond_ranges(study))
        reasons = why_nothing(study, data)
    if folder is not None:
        console.print(f"The study is in {folder}: {contents(folder)}.", soft_wrap=True)
    console.print(f"In Python: softgrip_jax.load_study({place!r})", soft_wrap=True)
    found = {} if folder is None else {"folder": str(folder)}
    return found | {"store": address_of(place), "quantities": told}, reasons


OUTPUTS = (STORE, "study.png", "study.csv", WORDS, NAME)
"""What a study leaves in its folder beside its inputs."""


def _refuse_another_run(folder: Path, inputs: dict[Path, bytes], store: Path) -> None:
    """A ConfigError where the folder of a study whose store is given holds anything but this very study."""
    known = {*OUTPUTS, *(name.parts[0] for name in inputs)}
    there = [
        path.name
        for path in (folder.iterdir() if folder.is_dir() else ())
        if not path.name.startswith(".") and not store.resolve().is_relative_to(path.resolve())
    ]
    same = all((folder / name).is_file() and _alike(folder / name, own) for name, own in inputs.items())
    if there and not (same and known.issuperset(there)):
        raise ConfigError(f"--out {folder} holds something else than this study; give a new folder.")


def _alike(path: Path, own: bytes) -> bool:
    """Whether a file says what an input says."""
    if path.read_bytes() == own:
        return True
    try:
        return path.name == "config.toml" and _meaning(configs.read_toml(path)) == _meaning(tomllib.loads(own.decode()))
    except ConfigError:
        return False


def _inputs(config: Path) -> dict[Path, bytes]:
    """What `keep_inputs` leaves of a config, by its name in the folder of the run: read before the work begins, which
    a file that cannot be read would else end before anything of it is told."""
    with TemporaryDirectory() as place:
        try:
            keep_inputs(Path(place), config, ["study.csv"])
        except OSError as error:
            raise ConfigError(
                f"{config}: it names {error.filename}, which cannot be read: {(error.strerror or str(error)).lower()}; "
                "the folder of a study keeps every file that its config names, those of other sections, too."
            ) from None
        return {path.relative_to(place): path.read_bytes() for path in Path(place).rglob("*") if path.is_file()}


def _spread_over(where: Where) -> Any:
    if where.workers is None and where.scheduler is None:
        if where.insecure:
            raise ConfigError("--insecure is given without --scheduler, to which it belongs.")
        return nullcontext()
    from ..study.cluster import client

    return client(where.workers, where.scheduler, where.insecure)


def tell(data: xr.Dataset, console: Console, beyond: Sequence[str] = ()) -> dict[str, Any]:
    """How many designs have an answer, and how many of these are beyond a range of their state; why others have none;
    how far every quantity spreads over them, and what `beyond_ranges` says."""
    reasons = reason_counts(data)
    for name, counts in data.attrs[BEGUN]["statuses"].items():
        label = data[name].attrs["long_name"].removeprefix("status at ")
        console.print(f"{label}: " + ", ".join(f"{n} {status}" for status, n in counts.items()), soft_wrap=True)
        for status, found in reasons[name].items():
            for reason, n in sorted(found.items(), key=lambda pair: -pair[1]):
                if reason != Reason.NONE.name:
                    console.print(f"  {n} {status}, {reason}: {Reason[reason].text()}", soft_wrap=True)
    told = tell_quantities(data, {"least": 0.0, "median": 0.5, "most": 1.0}, console)
    for sentence in beyond:
        console.print(sentence, soft_wrap=True, markup=False)
    return told


def beyond_ranges(study: Study) -> list[str]:
    """A sentence for every range of a law, or of what can be moulded, that parts of designs are beyond: such a design
    has its answer all the same. Of LOOKED_AT designs, spread over the study; ranges of states are among the reasons."""
    designs, scenes = _some(study, LOOKED_AT), study.leaves.scenes
    found_of: dict[Any, str] = {}
    for name, scene in scenes.items():
        ranges = [rule for rule in rules_at_rest(scene) if not Reason[rule.upper()].forbids]
        if not ranges:
            continue

        def margins(x, name=name, ranges=ranges):
            found = study.leaves.scenes_at(x)[name].prepared().margins_at_rest()
            return jnp.stack([found[rule] for rule in ranges])

        found = np.asarray(jax.jit(jax.vmap(margins))(jnp.asarray(designs)))
        for rule, own in zip(ranges, found.T, strict=True):
            beyond = int(np.sum(own < -BROKEN))
            if beyond:
                worst = Reason[rule.upper()].text(float(own.min()))
                of_scene = f" of the scene {name}" if len(scenes) > 1 else ""
                sentence = (
                    f"{beyond} of {len(designs)} designs that were looked at are beyond {rule}; of the worst, {worst}. "
                    f"The observable margins.{rule}_mm{of_scene} says which."
                )
                found_of.setdefault((rule, beyond, worst), sentence)  # scenes may share a finger
    return list(found_of.values())


def _some(study: Study, most: int) -> np.ndarray:
    """Designs spread over a study."""
    count = study.designs.count
    places = np.unique(np.linspace(0, count - 1, min(most, count)).astype(int)).tolist()
    return np.concatenate([study.designs.rows(k, k + 1) for k in places])


def why_nothing(study: Study, data: xr.Dataset) -> list[str]:
    """A sentence for every state that no design has, with its statuses and the most frequent reason; nothing where one
    design has an answer in one state.

    The reason is that of SOLVED_AGAIN designs, spread over the study.
    """
    statuses = [data.attrs[BEGUN]["statuses"][status_name(study, k)] for k in range(len(study.asked.states))]
    if any(Status.OK.name in counts for counts in statuses):
        return []
    count = study.designs.count
    designs = _some(study, SOLVED_AGAIN)
    sentences = []
    for (name, at), label, counts in zip(study.asked.states, study.asked.state_labels(), statuses, strict=True):
        words = ", ".join(f"{n} {status}" for status, n in sorted(counts.items(), key=lambda pair: -pair[1]))
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
