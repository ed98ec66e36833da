"""The results of a study as a labelled xarray Dataset, in SI, and as CSV in the units of people.

A grid has one dimension per varied number; other sets have the one dimension "design", along which the varied numbers
are coordinates. Every quantity is a variable with its unit; every state has a variable "status_..." of small integers,
whose attributes name them (CF conventions: flag_values, flag_meanings), and in the same way a variable "reason_...",
why there is no answer (`Reason`). Where gradients were asked for, every quantity has its derivatives, "slope_of_...",
with the further dimension "by".
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
import xarray as xr

from .._version import __version__
from ..reasons import Reason
from ..results import Status
from ..units import DISPLAY, SI, unit_key
from .designs import Grid

DESIGN = "design"
SLOPE_OF, STATUS_OF, REASON_OF = "slope_of_", "status_", "reason_"


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
    leaves, asked, set_of = study.leaves, study.asked, study.designs
    is_grid = isinstance(set_of, Grid)
    dims = tuple(leaves.names) if is_grid else (DESIGN,)
    shape = set_of.shape
    coords: dict[str, Any] = {}
    for k, (name, kind) in enumerate(zip(leaves.names, leaves.kinds, strict=True)):
        axis = set_of.axes[k] if isinstance(set_of, Grid) else designs[:, k]
        coords[name] = (name if is_grid else DESIGN, axis, _attributes(name, kind))
    data: dict[str, Any] = {}
    for k, (label, kind) in enumerate(zip(asked.labels(), asked.kinds, strict=True)):
        attributes = _attributes(label, kind) | {"status": status_name(study, asked.state_of[k])}
        data[variable_name(label)] = (dims, arrays["values"][:, k].reshape(shape), attributes)
        if "slopes" in arrays:
            coords["by"] = ("by", leaves.names, {"long_name": "varied number"})
            slopes = arrays["slopes"][:, k].reshape(*shape, leaves.size)
            words = {"long_name": f"derivative of {label}", "units": f"{SI[kind] or '1'} per SI unit of what varies"}
            data[SLOPE_OF + variable_name(label)] = ((*dims, "by"), slopes, words)
    status_flags, reason_flags = _flags(Status, np.int8), _flags(Reason, np.int16)
    for k, label in enumerate(asked.state_labels()):
        statuses = arrays["statuses"][:, k].astype(np.int8).reshape(shape)
        data[status_name(study, k)] = (dims, statuses, {"long_name": f"status at {label}"} | status_flags)
        reasons = arrays["reasons"][:, k].astype(np.int16).reshape(shape)
        words = {"long_name": f"reason of the status at {label}"}
        data[REASON_OF + variable_name(label)] = (dims, reasons, words | reason_flags)
    return xr.Dataset(data, coords, {"title": "parameter study", "source": f"softgrip_jax {__version__}"})


def _flags(codes: type[IntEnum], dtype: Any) -> dict[str, Any]:
    """The numbers of an enumeration and what they mean (CF conventions)."""
    return {
        "flag_values": np.array([int(code) for code in codes], dtype=dtype),
        "flag_meanings": " ".join(code.name for code in codes),
    }


def variable_name(label: str) -> str:
    """'force at 31 kPa' as the name of a variable, 'force_at_31_kPa'."""
    return label.replace(" ", "_").replace("%", "_percent").replace("/", "_per_")


def status_name(study: Any, k: int) -> str:
    return STATUS_OF + variable_name(study.asked.state_labels()[k])


def csv_rows(study: Any, designs: np.ndarray, arrays: dict[str, np.ndarray]) -> tuple[list[str], list[list[Any]]]:
    """(names of the columns with units, rows) of some designs."""
    leaves, asked = study.leaves, study.asked
    names = [unit_key(name, kind) for name, kind in zip(leaves.names, leaves.kinds, strict=True)]
    columns: list[list[Any]] = [(designs[:, k] / DISPLAY[kind][1]).tolist() for k, kind in enumerate(leaves.kinds)]
    for k, label in enumerate(asked.state_labels()):
        names.append(STATUS_OF + variable_name(label))
        words = [s.name for s in Status]
        columns.append([words[s] for s in arrays["statuses"][:, k]])
        names.append(REASON_OF + variable_name(label))
        columns.append([Reason(int(r)).name for r in arrays["reasons"][:, k]])
    for k, (label, kind) in enumerate(zip(asked.labels(), asked.kinds, strict=True)):
        unit = DISPLAY[kind][1]
        names.append(unit_key(variable_name(label), kind))
        columns.append((arrays["values"][:, k] / unit).tolist())
        if "slopes" not in arrays:
            continue
        for j, (name, by) in enumerate(zip(leaves.names, leaves.kinds, strict=True)):
            names.append(f"d_{unit_key(variable_name(label), kind)}_by_{unit_key(name, by)}")
            columns.append((arrays["slopes"][:, k, j] * (DISPLAY[by][1] / unit)).tolist())
    return names, [list(row) for row in zip(*columns, strict=True)]


def _attributes(label: str, kind: str) -> dict[str, str]:
    return {"long_name": label.replace("_", " "), "units": SI[kind] or "1", "kind": kind}
