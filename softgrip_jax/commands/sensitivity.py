"""`softgrip sensitivity CONFIG.toml`: which numbers of a design matter for what, and what tolerances do.

    [sensitivity]                     [[sensitivity.variables]]        [[sensitivity.observables]]
    samples = 20000                   name = "shell.t_m_mm"            name = ["force_z_N", "limit_margin"]
    seed = 0                          tolerance = 0.05                 at = { pressure_kPa = 12 }

All of it may be left out: then every number of the scene counts that is not zero, and every observable in the state
that [solve] asks for. A tolerance of 0.05 means 0.05 up or down, evenly distributed, in the unit of the name.
`posterior`, a file of `softgrip calibrate --posterior`, scatters the numbers that it knows as its draws do. Names and
states are those of `softgrip_jax.config.keys`.

The folder: config.toml, sensitivity.nc (an xarray Dataset in SI), elasticities.csv, elasticities.png, summary.txt,
report.html and, where there are tolerances, tolerances.csv.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pydantic
import xarray as xr
from rich.console import Console

from .. import config as configs
from ..config.keys import ObservableTable, Seed, Table, Varied, all_numbers, observed, varied
from ..draws import Drawn, other_laws, read_draws
from ..errors import ConfigError, located
from ..folders import contents, new_folder
from ..parameters import Parameter, Scenes
from ..progress import stages
from ..quantities import (
    AT_REST,
    LIMIT_MARGIN,
    REQUIRED,
    Quantity,
    QuantitySet,
    State,
    observables_of,
    shown,
    solution_at,
)
from ..report.run import tell_and_keep, write_report
from ..results import Status, in_units
from ..study import sensitivity
from ..tables import Table as PrintedTable
from .files import one_scene, plain


class ToleratedVariable(Table):
    name: str | list[str]
    tolerance: float | None = pydantic.Field(default=None, gt=0)


class SensitivityTable(Table):
    variables: list[ToleratedVariable] = []
    observables: list[ObservableTable] = []
    posterior: str | None = None
    samples: int = pydantic.Field(default=10_000, ge=100, le=100_000_000)
    seed: Seed = 0


class Wanted(NamedTuple):
    """The section [sensitivity] as read."""

    numbers: list[Varied]
    tolerances: list[float | None]
    """In SI."""
    quantities: list[Quantity]
    samples: int
    seed: int
    draws: dict[str, np.ndarray]
    """Of the posterior, by the name of the number, SI."""
    remarks: list[str]
    """Of which laws its numbers are, where these scenes have others."""


def read(config: configs.Config) -> Wanted:
    """What a config asks for; ConfigError for anything that is wrong in it."""
    where = f"{config.path}, [sensitivity]"
    table: SensitivityTable = configs.validated(SensitivityTable, config.tables.get("sensitivity", {}), where)
    variables = table.variables or [ToleratedVariable(name=key) for key in all_numbers(config.scenes)]
    numbers = [varied(config.scenes, v.name, where) for v in variables]
    tolerances = [
        None if v.tolerance is None else v.tolerance * number.unit for v, number in zip(variables, numbers, strict=True)
    ]
    drawn = _drawn(config, table, numbers, tolerances, where)
    quantities = observed(config.scenes, table.observables, where)
    return Wanted(
        numbers,
        tolerances,
        quantities or _asked_by_solve(config),
        table.samples,
        table.seed,
        {one.number.name: one.values for one in drawn},
        other_laws(config.scenes, drawn),
    )


def _drawn(
    config: configs.Config,
    table: SensitivityTable,
    numbers: list[Varied],
    tolerances: list[float | None],
    where: str,
) -> list[Drawn]:
    """What the posterior knows of the numbers."""
    if table.posterior is None:
        return []
    found = {one.number.name: one for one in read_draws(config.scenes, config.path.parent / table.posterior, where)}
    known = [number.name for number in numbers]
    if not set(found) & set(known):
        raise ConfigError(f"{where}: the posterior knows {', '.join(found)}, and none of it is among the variables.")
    for number, tolerance in zip(numbers, tolerances, strict=True):
        if tolerance is not None and number.name in found:
            raise ConfigError(f"{where}: {number.key} has a tolerance beside the posterior; leave one of them out.")
    return [one for name, one in found.items() if name in known]


def _asked_by_solve(config: configs.Config) -> list[Quantity]:
    """What [solve] asks for, and after it whatever else is known of that state: the pressure comes first where it is
    what `softgrip solve` finds, and is left out where it is given."""
    if len(config.scenes) > 1:
        raise ConfigError(
            f"{config.path} has several scenes; say which with --scene, one of {', '.join(config.scenes)}, or name "
            "observables of them in [sensitivity]."
        )
    asked = configs.question(config)
    [(name, value)] = asked.items() or [("", 0.0)]
    at: State = value if name == "pressure" else (name, value) if name else REQUIRED
    names = [n for n in dict.fromkeys(["pressure", *observables_of(config.scene)]) if n != name]
    return [Quantity(n, at) for n in names if not (n == LIMIT_MARGIN and at == 0.0)]


def run_sensitivity(config: Path, out: Path | None, console: Console, scene: str | None = None) -> tuple[Path, bool]:
    """Analyse what the config says, print it, and return the folder that holds it, and whether any quantity has a
    value. scene: which of several scenes is meant; None for all of those that [sensitivity] names."""
    read_config = configs.load(config) if scene is None else one_scene(config, scene)
    wanted = read(read_config)
    with new_folder(out, config.stem) as (folder, final):
        with located(f"{config}, [sensitivity]"), stages(console) as tell:
            data = sensitivity(
                read_config.scenes,
                [Parameter(number.name) for number in wanted.numbers],
                wanted.quantities,
                _per_entry(read_config, wanted),
                wanted.samples,
                wanted.seed,
                tell,
                _joint(read_config, wanted),
            )
        chosen = [] if scene is None else [f"These are numbers of the scene {scene}."]
        said = [*chosen, *_unanswered(read_config.scenes, wanted.quantities, data["status"].values), *wanted.remarks]
        data.attrs["remarks"] = "\n".join(said)
        (folder / "config.toml").write_bytes(configs.standalone(config))
        # HDF5 itself, on a disk that is full, would end the process.
        (folder / "sensitivity.nc").write_bytes(data.to_netcdf(engine="h5netcdf"))
        _write(folder, data)
        _draw(folder, data)
        tell_and_keep(folder, console, partial(report, data, remarks=said))
        write_report(folder, final.name)
    console.print(f"The analysis is in {final}: {contents(final)}.", soft_wrap=True)
    return final, bool(np.any(data["status"].values == Status.OK))


def _unanswered(scenes: Scenes, quantities: list[Quantity], statuses: np.ndarray) -> list[str]:
    """A sentence for every state that the design itself does not have."""
    asked, found = QuantitySet(scenes, quantities), {}
    for one, status in zip(asked.quantities, statuses, strict=True):
        if status != Status.OK and one.at is not None and one.at != AT_REST:
            why = solution_at(scenes[str(one.scene)], one.at).reason_text()
            found[one.state] = f"{one.state_label()}: {Status(int(status)).name}, {why.rstrip('.')}."
    return list(found.values())


def _joint(config: configs.Config, wanted: Wanted) -> np.ndarray | None:
    """The draws as the columns of the varied numbers, NaN where the posterior knows nothing; None without one."""
    if not wanted.draws:
        return None
    from ..parameters import Parameters

    sizes = Parameters(config.scenes, [Parameter(number.name) for number in wanted.numbers]).sizes
    count = len(next(iter(wanted.draws.values())))
    columns = [
        wanted.draws.get(number.name, np.full(count, np.nan))
        for number, size in zip(wanted.numbers, sizes, strict=True)
        for _ in range(size)
    ]
    return np.stack(columns, axis=1)


def _per_entry(config: configs.Config, wanted: Wanted) -> list[float | None]:
    """Tolerances of leaves as those of the entries of the vector: a list of numbers shares one."""
    from ..parameters import Parameters

    sizes = Parameters(config.scenes, [Parameter(number.name) for number in wanted.numbers]).sizes
    return [t for t, size in zip(wanted.tolerances, sizes, strict=True) for _ in range(size)]


def _write(folder: Path, data: xr.Dataset) -> None:
    with (folder / "elasticities.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["quantity", "value_SI", *map(str, data["by"].values)])
        for name in data["quantity"].values:
            row = data.sel(quantity=name)
            writer.writerow([name, float(row["value"]), *map(float, row["elasticity"])])
    if "share" not in data:
        return
    columns = [str(v) for v in data if data[v].dims == ("quantity",) and v != "status"]
    with (folder / "tolerances.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["quantity_SI", *columns, *(f"share_of_{by}" for by in data["by"].values)])
        for name in data["quantity"].values:
            row = data.sel(quantity=name)
            writer.writerow([name, *(float(row[c]) for c in columns), *map(float, row["share"])])


def _draw(folder: Path, data: xr.Dataset) -> None:
    answered = data.isel(quantity=np.flatnonzero(data["status"].values == Status.OK))
    if answered.sizes["quantity"]:
        from .. import plots

        plots.elasticities(answered).savefig(folder / "elasticities.png")


def report(data: xr.Dataset, console: Console, remarks: Sequence[str] = ()) -> None:
    """Tables for people, and what is to be said of them: why quantities have no value, whose numbers these are."""
    names = [str(name) for name in data["quantity"].values]
    table = PrintedTable(title="elasticities: % for 1 % of", title_justify="left")
    table.add_column("")
    for name in names:
        # Spaces are where a heading may be broken into lines.
        table.add_column(name.replace("_", " "), justify="right")
    values = zip(data["value"].values, data["kind"].values, data["status"].values, strict=True)
    table.add_row("value", *(_shown(v, str(k), s) for v, k, s in values))
    table.add_section()
    for by in data["by"].values:
        table.add_row(str(by), *(_signed(v) for v in data["elasticity"].sel(by=by).values))
    console.print(table)
    for sentence in remarks:
        console.print(sentence, soft_wrap=True, markup=False)
    if "share" not in data:
        return
    table = PrintedTable(title="standard deviation from the tolerances", title_justify="left")
    for head in ("", "value", "by gradient", "by sampling", "answered", "most from"):
        table.add_column(head, justify="right" if head else "left", overflow="fold")
    for k, name in enumerate(names):
        row, kind = data.isel(quantity=k), str(data["kind"].values[k])
        share = np.nan_to_num(row["share"].values)
        sampled, error = row["deviation_by_sampling"].values, row["deviation_error"].values
        table.add_row(
            name.replace("_", " "),
            _shown(row["value"].values, kind, row["status"]),
            in_units(row["deviation_by_gradient"].values, kind),
            # Of a design without the state, the samples that have it say nothing.
            f"{in_units(sampled, kind)} ± {_number(error, kind)}" if row["status"] == Status.OK else "-",
            f"{float(row['answered']):.1%}",
            f"{data['by'].values[share.argmax()]} ({share.max():.0%})" if share.max() > 0 else "-",
        )
    console.print(table)


def _shown(value: Any, kind: str, status: Any) -> str:
    """A value, or why there is none; how far a limit is is known beyond it, too."""
    return shown(value, kind) if np.isfinite(value) or status == Status.OK else Status(int(status)).name


NO_DIGIT = 0.5e-3
"""Elasticities below this have no digit in the table, and a sign of rounding only."""


def _signed(value: Any) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{value:+.3f}" if abs(value) >= NO_DIGIT else "0.000"


def _number(value: Any, kind: str) -> str:
    return in_units(float(f"{float(value):.1e}"), kind).split(" ")[0]


def as_data(folder: Path) -> dict[str, Any]:
    """Values and elasticities of the quantities of an analysis, in SI, and what is to be said of them."""
    found: dict[str, Any] = {}
    with xr.open_dataset(folder / "sensitivity.nc", engine="h5netcdf") as data:
        for one in map(str, data["quantity"].values):
            row = data.sel(quantity=one)
            slopes = zip(map(str, row["by"].values), map(plain, row["elasticity"].values), strict=True)
            unit = str(row["unit"].values)
            found[one] = {"value": plain(row["value"]), "unit": unit, "elasticity": dict(slopes)}
        return {"quantities": found, "remarks": data.attrs["remarks"].splitlines()}
