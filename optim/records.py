"""What run folders say of designs and of the run itself."""

from __future__ import annotations

import csv
import platform
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

import softgrip_jax as sg
from softgrip_jax.units import DISPLAY, unit_key

from .objectives import Problem
from .search import Design


def design_row(problem: Problem, design: Design) -> dict[str, Any]:
    """A row of designs.csv: units in the names of the columns."""
    row: dict[str, Any] = {"feasible": design.feasible, "objective": design.objective}
    row["status"] = " ".join(dict.fromkeys(s.name for s in design.statuses))
    row["violation"] = design.violation
    for key, kind, x in zip(problem.space.names, problem.space.kinds, design.x, strict=True):
        row[unit_key(key, kind)] = x / DISPLAY[kind][1]
    for quantity, kind, value in zip(problem.quantities, problem.kinds, design.values, strict=True):
        row[unit_key(problem.label(quantity).replace(" ", "_"), kind)] = value / DISPLAY[kind][1]
    return row | {"active": "; ".join(design.active)}


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows under the names of the first."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def in_si(problem: Problem, design: Design) -> dict[str, Any]:
    """A design for result.json."""
    values = {problem.label(q): float(v) for q, v in zip(problem.quantities, design.values, strict=True)}
    return {
        "feasible": design.feasible,
        "objective": design.objective,
        "violation": design.violation,
        "variables": dict(zip(problem.space.names, map(float, design.x), strict=True)),
        "quantities": {name: v if np.isfinite(v) else None for name, v in values.items()},
        "status": [s.name for s in design.statuses],
        "active": list(design.active),
    }


def versions() -> dict[str, Any]:
    """When, with what and on what a run was made."""
    return {
        "finished": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "versions": {
            "softgrip_jax": sg.__version__,
            "jax": jax.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "device": jax.devices()[0].device_kind,
    }
