"""The results of a study as a labelled xarray Dataset, in SI, and as CSV in the units of people.

A grid has one dimension per varied number; other sets have the one dimension "design", along which the varied numbers
are coordinates. Every quantity is a variable with its unit; every state has a variable "status_..." of small integers,
whose attributes name them (CF conventions: flag_values, flag_meanings), and in the same way a variable "reason_...",
why there is no answer (`Reason`), or which range a state is beyond that is OK: `ONE_TURN`, for instance. A limit that a
design has not is inf. Where gradients were asked for, every quantity has its derivatives, "slope_of_...", with the
further dimension "by".
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from .._version import __version__
from ..errors import ConfigError
from ..reasons import Reason
from ..results import Status
from ..units import DISPLAY, SI, unit_key
from .blocks import Block, Blocks, spread_over
from .designs import Grid

DESIGN, BY = "design", "by"
SLOPE_OF, STATUS_OF, REASON_OF = "slope_of_", "status_", "reason_"
TIED = "tied"
"""The attribute of a varied number that names all that moves with it, joined by '='; stores of before have none."""
TITLE = {"title": "parameter study", "source": f"softgrip_jax {__version__}"}

PIECE = 1 << 18
"""Designs that are read at a time: a few megabytes per quantity."""


class Column(NamedTuple):
    """A variable of the Dataset that has a value, or one per varied number, for every design."""

    name: str
    dims: tuple[str, ...]
    dtype: Any
    attributes: dict[str, Any]
    of: Callable[[np.ndarray, dict[str, np.ndarray]], np.ndarray]
    """Its values, from some designs (one per row) and what `Study.evaluate` says of them."""


def dims_of(study: Any) -> tuple[str, ...]:
    return tuple(study.leaves.names) if isinstance(study.designs, Grid) else (DESIGN,)


def columns(study: Any) -> list[Column]:
    """What is stored of every design, in the order of the Dataset: coordinates first where designs are no grid."""
    leaves, asked, dims = study.leaves, study.asked, dims_of(study)
    found = []
    if not isinstance(study.designs, Grid):
        for k, (name, words) in enumerate(_of_varied(leaves).items()):
            found.append(Column(name, dims, float, words, lambda rows, _, k=k: rows[:, k]))
    for k, (label, kind) in enumerate(zip(asked.labels(), asked.kinds, strict=True)):
        words = _attributes(label, kind) | {"status": status_name(study, asked.state_of[k])}
        found.append(Column(variable_name(label), dims, float, words, lambda _, part, k=k: part["values"][:, k]))
        if study.gradients:
            words = {"long_name": f"derivative of {label}", "units": f"{SI[kind] or '1'} per SI unit of what varies"}
            name = SLOPE_OF + variable_name(label)
            found.append(Column(name, (*dims, BY), float, words, lambda _, part, k=k: part["slopes"][:, k]))
    status_flags, reason_flags = _flags(Status, np.int8), _flags(Reason, np.int16)
    for k, label in enumerate(asked.state_labels()):
        words = {"long_name": f"status at {label}"} | status_flags
        found.append(Column(status_name(study, k), dims, np.int8, words, lambda _, part, k=k: part["statuses"][:, k]))
        words = {"long_name": f"reason of the status at {label}"} | reason_flags
        name = REASON_OF + variable_name(label)
        found.append(Column(name, dims, np.int16, words, lambda _, part, k=k: part["reasons"][:, k]))
    return found


def axes(study: Any) -> dict[str, tuple[str, Any, dict[str, Any]]]:
    """Coordinates that are known beforehand: the axes of a grid."""
    leaves, found = study.leaves, {}
    if isinstance(study.designs, Grid):
        for (name, words), axis in zip(_of_varied(leaves).items(), study.designs.axes, strict=True):
            found[name] = (name, axis, words)
    return found


def by_names(names: list[str]) -> dict[str, Any]:
    """The coordinate of what the derivatives are taken by."""
    return {BY: (BY, np.array(names), {"long_name": "varied number"})}


def labelled(study: Any, designs: np.ndarray, arrays: dict[str, Any]) -> xr.Dataset:
    """The results of a study as a labelled Dataset in SI.

    Args:
        study: whose results they are.
        designs: SI values, shape (designs, varied numbers).
        arrays: one row per design: values, statuses, reasons and perhaps slopes.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> walls = sg.study.Table(np.array([[1.1 * mm]]))
        >>> study = sg.Study(sg.shell.Free(shell), ["shell.t_m"], [sg.Quantity("inflation", at=15 * kPa)], walls)
        >>> arrays = {"values": np.array([[13.4 * mm]]), "statuses": np.array([[0]]), "reasons": np.array([[0]])}
        >>> sg.study.labelled(study, walls.rows(0, 1), arrays).inflation_at_15_kPa.attrs["units"]
        'm'
    """
    coords: dict[str, Any] = axes(study) | (by_names(study.leaves.names) if study.gradients else {})
    data: dict[str, Any] = {}
    for column in columns(study):
        values = column.of(designs, arrays)
        values = values.reshape(*study.designs.shape, *values.shape[1:]).astype(column.dtype, copy=False)
        place = coords if column.name in study.leaves.names else data
        place[column.name] = (column.dims, values, column.attributes)
    return xr.Dataset(data, coords, TITLE)


def _flags(codes: type[IntEnum], dtype: Any) -> dict[str, Any]:
    """The numbers of an enumeration and what they mean (CF conventions)."""
    return {
        "flag_values": np.array([int(code) for code in codes], dtype=dtype),
        "flag_meanings": " ".join(code.name for code in codes),
    }


def variable_name(label: str) -> str:
    """'force at 31 kPa' as the name of a variable, 'force_at_31_kPa'."""
    return label.replace(" ", "_").replace("%", "_percent").replace("/", "_per_").replace("^", "")


def status_name(study: Any, k: int) -> str:
    return STATUS_OF + variable_name(study.asked.state_labels()[k])


def _attributes(label: str, kind: str) -> dict[str, str]:
    return {"long_name": label.replace("_", " "), "units": SI[kind] or "1", "kind": kind}


def _of_varied(leaves: Any) -> dict[str, dict[str, str]]:
    """The attributes of every varied number by its name, which is that of the first where several are tied."""
    return {
        name: _attributes(name, kind) | ({TIED: tied} if tied != name else {})
        for name, tied, kind in zip(leaves.names, leaves.tied, leaves.kinds, strict=True)
    }


# --- a Dataset of any size, in parts ----------------------------------------------------------------------------------


def quantities_of(data: xr.Dataset) -> list[str]:
    return [str(name) for name, variable in data.data_vars.items() if "status" in variable.attrs]


def varied_in(data: xr.Dataset) -> list[str]:
    return [str(name) for name in data.coords if name != BY]


def tied_in(data: xr.Dataset, name: str) -> str:
    """A varied number with all that is tied to it, "shell.a = shell.b"; a name that is not tied as it is."""
    return data[name].attrs.get(TIED, name)


def tied_keys(tied: str, kind: str) -> str:
    """The same with units, as a column of a CSV is called and read: "shell.a_mm = shell.b_mm"."""
    return " = ".join(unit_key(part, kind) for part in tied.split(" = "))


def column_of(data: xr.Dataset, name: str) -> str:
    """What CSV calls a variable, with its unit."""
    return tied_keys(tied_in(data, name), data[name].attrs["kind"])


def states_of(data: xr.Dataset) -> list[str]:
    """The names of the variables that hold statuses."""
    return [str(name) for name in data.data_vars if str(name).startswith(STATUS_OF)]


def reason_of(status: str) -> str:
    """The name of the variable of the reasons, from that of the statuses."""
    return REASON_OF + status.removeprefix(STATUS_OF)


def blocks_of(data: xr.Dataset, most: int = PIECE) -> Blocks:
    """Runs of designs of a Dataset, none of which shares a chunk of the disk with another."""
    like = data[quantities_of(data)[0]]
    chunk = like.encoding.get("chunks") if like.encoding.get("chunks") else None
    return Blocks(like.shape, chunk).joined(most) if chunk else Blocks.of(like.shape, most)


def read(data: xr.Dataset, block: Block, names: list[str]) -> dict[str, np.ndarray]:
    """Some variables of the designs of a block: one row per design."""
    dims = data[quantities_of(data)[0]].dims
    where = dict(zip(dims, block.box, strict=True))
    found = {}
    for name in names:
        variable = data[name]
        if variable.dims == (name,):
            found[name] = spread_over(block, variable.values, dims.index(name))
        else:
            values = _values(data, name, variable.variable.isel(where))
            found[name] = values.reshape(block.stop - block.start, *values.shape[len(dims) :])
    return found


def _values(data: xr.Dataset, name: str, variable: xr.Variable) -> np.ndarray:
    """A part of a variable, in memory; a ConfigError where its chunks are damaged or not there."""
    try:
        values = variable.load().values
        why = "a chunk is missing" if values.dtype.kind == "i" and np.any(values < 0) else ""
    except Exception as error:  # the codecs of a store have no exception in common
        why = " ".join(str(error).split())
    if why:
        place = f"{data.encoding['source']}/{name}" if "source" in data.encoding else f"{name} of the study"
        raise ConfigError(f"{place} cannot be read: {why.rstrip('.')}; softgrip sweep computes it again in its place.")
    return values


def loaded(data: xr.Dataset) -> xr.Dataset:
    """The same in memory; a ConfigError where it is damaged."""
    for name, variable in data.variables.items():
        _values(data, str(name), variable)
    return data


def answers(data: xr.Dataset, part: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Where a quantity has an answer in a part that was read: its state is OK, and "no limit" (inf) is one, too."""
    return (part[data[name].attrs["status"]] == Status.OK) & ~np.isnan(part[name])


def pieces(data: xr.Dataset, names: list[str]) -> Iterator[dict[str, np.ndarray]]:
    """Some variables of all designs, in parts that take little memory."""
    return (read(data, block, names) for block in blocks_of(data))


def rows_of(data: xr.Dataset, chosen: np.ndarray) -> xr.Dataset:
    """Some designs of a study, by their numbers, in memory, along the one dimension "design"."""
    like = data[quantities_of(data)[0]]
    places = np.unravel_index(np.asarray(chosen), like.shape)
    where = {dim: xr.DataArray(place, dims=DESIGN) for dim, place in zip(like.dims, places, strict=True)}
    return loaded(data.isel(where))


def designs_in(data: xr.Dataset) -> int:
    return math.prod(data[quantities_of(data)[0]].shape)


def write_csv(data: xr.Dataset, path: Path) -> None:
    """All designs as CSV: one row per design, units in the names of the columns, statuses and reasons by name. The
    column of tied numbers names them all, as the reader of designs takes it."""
    numbers, names = varied_in(data), quantities_of(data)
    states = states_of(data)
    slopes = [SLOPE_OF + name for name in names if SLOPE_OF + name in data]
    words = {Status: [s.name for s in Status], Reason: {int(r): r.name for r in Reason}}
    every = [*numbers, *states, *map(reason_of, states), *names, *slopes]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for number, part in enumerate(pieces(data, every)):
            table: dict[str, list[Any]] = {}
            for name in numbers:
                kind = data[name].attrs["kind"]
                table[column_of(data, name)] = (part[name] / DISPLAY[kind][1]).tolist()
            for name in states:
                table[name] = [words[Status][s] for s in part[name]]
                table[reason_of(name)] = [words[Reason][r] for r in part[reason_of(name)].tolist()]
            for name in names:
                kind = data[name].attrs["kind"]
                unit, key = DISPLAY[kind][1], unit_key(name, kind)
                table[key] = (part[name] / unit).tolist()
                for j, by in enumerate(numbers if SLOPE_OF + name in data else ()):
                    by_kind = data[by].attrs["kind"]
                    slope = part[SLOPE_OF + name][:, j] * (DISPLAY[by_kind][1] / unit)
                    table[f"d_{key}_by_{column_of(data, by)}"] = slope.tolist()
            if number == 0:
                writer.writerow(table)
            writer.writerows(zip(*table.values(), strict=True))
