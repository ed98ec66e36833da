"""What run folders say of designs and of the run itself."""

from __future__ import annotations

import csv
import platform
import shlex
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

import softgrip_jax as sg
from softgrip_jax.folders import contents
from softgrip_jax.quantities import LIMIT_MARGIN, NO_LIMIT_MARGIN
from softgrip_jax.results import Status
from softgrip_jax.units import DISPLAY, mm, unit_key

from . import rules
from .design.descent import Design
from .design.settings import asked_first
from .problem import Problem

OF_THE_PART = ("manufacture",)
"""Sections of a config that say of the part what the physics does not know: `export` and `measure` read them."""


def as_given(read: Any, scenes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(scenes in the order of a config, its sections that belong to the part), as `config.dump` takes them: `measure`
    and `export` take the first scene. Scenes that the config does not have come last."""
    names = [name for name in read.scenes if name in scenes]
    ordered = {name: scenes[name] for name in dict.fromkeys([*names, *scenes])}
    return ordered, {name: read.tables[name] for name in OF_THE_PART if name in read.tables}


def next_command(problem: Problem, file: Path, design: Design) -> str:
    """What may be typed next about the design in a file: what the search asked first; its curve where nothing answers
    that, or only the limit was asked for; nothing about a design that cannot exist."""
    name, at = asked_first(problem)
    if not design.answered and Status.BEYOND_LIMIT not in design.statuses:
        return ""
    words = ["softgrip", "solve" if design.answered and at is not None else "path", str(file)]
    return shlex.join(words + (["--scene", name] if len(problem.space.scenes) > 1 else []))


def summary(what: str, folder: Path, command: str) -> str:
    """The last line of a run: its folder, its files, and what may be typed next."""
    return f"The {what} is in {folder}: {contents(folder)}." + (f" Next: {command}" if command else "")


def seen(problem: Problem, design: Design) -> np.ndarray:
    """The quantities of a design, SI, as people see them: no limit is inf, and so is the margin before it, which a
    search has as a large number."""
    is_margin = np.array([q.observable == LIMIT_MARGIN for q in problem.quantities])
    return np.where(is_margin & (design.values == NO_LIMIT_MARGIN), np.inf, design.values)


def design_row(problem: Problem, design: Design) -> dict[str, Any]:
    """A row of designs.csv: units in the names of the columns."""
    known = design.answered
    row: dict[str, Any] = {"feasible": design.feasible, "objective": design.objective if known else None}
    row["status"] = " ".join(dict.fromkeys(s.name for s in design.statuses))
    row["reason"] = " ".join(f"{words}." for words in unsolved(design))
    row["violation"] = design.violation if known else None
    for key, kind, x in zip(problem.space.names, problem.space.kinds, design.x, strict=True):
        row[unit_key(key, kind)] = x / DISPLAY[kind][1]
    for quantity, kind, value in zip(problem.quantities, problem.kinds, seen(problem, design), strict=True):
        key = unit_key(problem.label(quantity).replace(" ", "_"), kind)
        row[key] = None if np.isnan(value) else value / DISPLAY[kind][1]
    row["active"] = "; ".join(design.active)
    row["rules"] = "; ".join(f"{line.label} {line.margins[0] / mm:.6g} mm" for line in _told(problem, design))
    return row


def unsolved(design: Design) -> list[str]:
    """Why states of a design are not OK, each reason once."""
    pairs = zip(design.statuses, design.reasons, strict=False)
    return list(dict.fromkeys(words for status, words in pairs if status != Status.OK))


def _told(problem: Problem, design: Design) -> list[rules.Told]:
    """The rules that a design breaks or is held by."""
    return rules.summary(problem.rules, [design.margins], len(problem.space.scenes) > 1)


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows under the names of the first."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def in_si(problem: Problem, design: Design) -> dict[str, Any]:
    """A design for result.json."""
    values = {problem.label(q): float(v) for q, v in zip(problem.quantities, seen(problem, design), strict=True)}
    return {
        "feasible": design.feasible,
        "objective": design.objective if design.answered else None,
        "violation": design.violation if design.answered else None,
        "variables": dict(zip(problem.space.names, map(float, design.x), strict=True)),
        "quantities": {name: v if np.isfinite(v) else None for name, v in values.items()},
        "status": [s.name for s in design.statuses],
        "reason": unsolved(design),
        "active": list(design.active),
        "limit_margins": design.limit_margins,
        "rules": [{"rule": line.label, "margin_mm": line.margins[0] / mm} for line in _told(problem, design)],
    }


def agreed(problem: Problem) -> dict[str, Any]:
    """What was agreed: the rules that are kept and those that are ignored, and where scenes differ in their laws."""
    return {
        "rules_kept": rules.kept(problem.rules),
        "rules_ignored": list(problem.ignored),
        "different_laws": list(problem.different_laws),
    }


def said(problem: Problem) -> list[str]:
    """The same in sentences, for people."""
    what = agreed(problem)
    lines = [f"Every design keeps these rules: {', '.join(what['rules_kept'])}."] if what["rules_kept"] else []
    if what["rules_ignored"]:
        lines.append(f"These rules were ignored: {', '.join(what['rules_ignored'])}.")
    tied = [names for names in problem.space.tied if "=" in names]
    if tied:
        lines.append(f"One number each: {'; '.join(tied)}.")
    return [*lines, *what["different_laws"]]


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
