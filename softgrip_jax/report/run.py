"""The report of a run's folder, and of two runs side by side: from the files that the run has left."""

from __future__ import annotations

import csv
import json
import platform
import shlex
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console

from .._version import __version__
from ..errors import ConfigError, InputError
from ..folders import write_whole
from ..model_error import model_error
from .document import Document, shown

NAME, WORDS = "report.html", "summary.txt"
T = TypeVar("T")
SECTIONS = ("design", "calibrate", "tension", "plan", "sweep", "sensitivity")
"""Sections of configs, by which a run is told from others; the command of a tension test is calibrate."""
FEW = 6
"""A table of at most so many rows, with more columns than that, stands on its side."""
MOST_DESIGNS = 2000
"""Designs of a study that are read for its plot."""


def read_json(path: Path) -> dict[str, Any]:
    """A result.json; {} where there is none."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """(head, rows) of a CSV."""
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = list(csv.reader(file)) or [[]]
    return head, rows


def numbers_of(head: list[str], rows: list[list[str]]) -> dict[str, np.ndarray]:
    """The columns of a table that hold numbers; empty cells are NaN."""
    found = {}
    for k, name in enumerate(head):
        cells = [row[k] if k < len(row) else "" for row in rows]
        try:
            numbers = [float(cell or "nan") for cell in cells]
        except ValueError:
            continue
        if np.isfinite(numbers).any():
            found[name] = np.array(numbers)
    return found


def flat(value: Any, name: str = "") -> dict[str, Any]:
    """A nested table as one of dotted keys; lists of tables are counted from 1."""
    if isinstance(value, dict):
        return {k: v for key, one in value.items() for k, v in flat(one, f"{name}.{key}" if name else key).items()}
    if isinstance(value, list) and value and any(isinstance(one, dict) for one in value):
        return {k: v for i, one in enumerate(value, 1) for k, v in flat(one, f"{name}[{i}]").items()}
    return {name: value}


def kind_of(config: dict[str, Any]) -> str:
    """What a run was: a section of its config."""
    return next((name for name in SECTIONS if name in config), "solve")


def command_of(kind: str, file: str = "config.toml") -> str:
    """The command that repeats a run."""
    return shlex.join(["softgrip", "calibrate" if kind == "tension" else kind, file])


def config_of(folder: Path) -> dict[str, Any]:
    """The config of a run; ConfigError where the folder is none."""
    path = folder / "config.toml"
    if not path.is_file():
        raise ConfigError(f"{folder} is not a run: there is no config.toml in it.")
    return tomllib.loads(path.read_text(encoding="utf-8"))


def tell_and_keep(folder: Path, console: Console, tell: Callable[[Console], T]) -> T:
    """Print what a run has found, and leave the same words in its folder, where its report begins with them."""
    console.record = True
    try:
        found = tell(console)
        write_whole(folder / WORDS, console.export_text().encode())
    finally:
        console.record = False
    return found


def write_report(folder: Path, name: str | None = None) -> Path:
    """Write report.html into the folder of a run, from its files; `name`: the folder's name in the end."""
    config, result = config_of(folder), read_json(folder / "result.json")
    kind = kind_of(config)
    page = Document(f"softgrip {'calibrate' if kind == 'tension' else kind}: {name or folder.name}")
    page.heading("What was asked")
    page.code((folder / "config.toml").read_text(encoding="utf-8"))
    page.heading("What came out")
    if (folder / WORDS).is_file():
        page.code((folder / WORDS).read_text(encoding="utf-8"))
    for picture in sorted(folder.glob("*.png")):
        page.picture(picture)
    if result:
        page.heading("Every number")
        scalars = {k: v for k, v in flat(result).items() if not isinstance(v, list) or len(v) <= 4}
        page.table(["", "value (SI where a unit is not said)"], [[k, v] for k, v in scalars.items() if k != "units"])
    for table in sorted(folder.glob("*.csv")):
        _add_table(page, table)
    _add_study(page, folder)
    _add_model_error(page, folder)
    page.heading("Provenance, and how to repeat it")
    made = result.get("versions") or {"softgrip_jax": __version__, "python": platform.python_version()}
    finished = result.get("finished", time.strftime("%Y-%m-%dT%H:%M:%S%z"))
    rows = [["finished", finished], *([name, version] for name, version in made.items())]
    page.table(["", ""], [*rows, ["device", result.get("device", platform.machine())]])
    page.text("Save the config above as config.toml, or take it from the folder, and type:")
    page.code(command_of(kind))
    write_whole(folder / NAME, page.html().encode())
    return folder / NAME


def _add_table(page: Document, path: Path) -> None:
    """A table with its statuses and reasons counted, and a plot of its numbers."""
    head, rows = read_table(path)
    if not rows:
        return
    page.heading(path.stem.replace("_", " "))
    status = None
    for name in ("status", "reason", "feasible"):
        if name in head:
            cells = [row[head.index(name)] for row in rows]
            status = np.array(cells) if name in ("status", "feasible") and status is None else status
            counts = Counter(filter(None, cells))
            if counts and not any(isinstance(_cell(word), float) for word in counts):
                page.text(f"{name}: " + "; ".join(f"{n} {what}" for what, n in counts.most_common(8)))
    if len(rows) > 2:
        page.scatter(numbers_of(head, rows), status)
    cells = [[_cell(cell) for cell in row] for row in rows]
    if len(rows) <= FEW < len(head):  # a wide page is scrolled, and paper is not wide
        head, *cells = [list(column) for column in zip(head, *cells, strict=True)]
    page.table([str(name) for name in head], cells)


def _cell(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _add_study(page: Document, folder: Path) -> None:
    """The designs of a study that stands beside."""
    if not (folder / "study.zarr").exists() and not list(folder.glob("*.zarr")):
        return
    from ..study import load_study

    with load_study(folder) as data:
        page.heading("Study")
        dims = [name for name in data.sizes if data.sizes[name] > 1][:3]
        flattened = data.stack(point=list(data.dims)) if dims else data
        count = flattened.sizes.get("point", 1)
        part = flattened.isel(point=slice(0, None, -(-count // MOST_DESIGNS) or 1)) if dims else flattened
        columns = {}
        for name in [*part.coords, *part.data_vars]:
            values = np.asarray(part[name].values)
            if values.ndim == 1 and values.dtype.kind in "fiu" and len(values) > 1:
                unit = part[name].attrs.get("units", "")
                columns[f"{name} ({unit})" if unit and unit != "1" else str(name)] = values.astype(float)
        page.text(
            f"{count} designs" + (f", every {-(-count // MOST_DESIGNS)}. is drawn." if count > MOST_DESIGNS else ".")
        )
        page.scatter({k: v for k, v in columns.items() if not k.startswith("status")})


def _add_model_error(page: Document, folder: Path) -> None:
    """What is known of the models of the scenes against finite elements."""
    from .. import config as configs

    try:
        scenes = configs.load(folder / "config.toml").scenes
    except InputError:
        return
    rows = []
    for name, scene in scenes.items():
        for observable in scene.prepared().OBSERVABLES:
            sentence = model_error(scene, observable)
            if sentence:
                rows.append([name, observable.replace("_", " "), sentence])
    page.heading("Model error")
    page.text(
        "How far the models are from finite elements, where that is known; numerics are far more exact.", note=True
    )
    if rows:
        page.table(["scene", "value", "against finite elements"], rows)
    else:
        page.text("For these scenes nothing is known.")


def compare_runs(first: Path, second: Path, out: Path) -> Path:
    """Write a page about two runs: inputs that differ, results side by side."""
    folders = (first, second)
    configs_of = [flat(config_of(folder)) for folder in folders]
    results = [flat(read_json(folder / "result.json")) for folder in folders]
    page = Document(f"{first.name} and {second.name}")
    page.heading("Inputs that differ")
    rows = [[key, *(c.get(key) for c in configs_of)] for key in dict.fromkeys(k for c in configs_of for k in c)]
    rows = [row for row in rows if row[1] != row[2]]
    head = ["", first.name, second.name]
    page.table(head, rows) if rows else page.text("The configs are the same.")
    page.heading("Results")
    keys = [
        k for k in dict.fromkeys(k for r in results for k in r) if not k.startswith(("versions", "seconds", "units"))
    ]
    rows, marked = [], set()
    for key in keys:
        pair = [r.get(key) for r in results]
        if any(isinstance(value, list) and len(value) > 4 for value in pair):
            continue
        if pair[0] != pair[1]:
            marked.add(len(rows))
        rows.append([key, *pair, change(*pair)])
    if rows:
        page.table([*head, "change"], rows, marked)
    else:
        page.text("These runs have no result.json; their tables and pictures follow.")
    for path in sorted(first.glob("*.csv")):
        if (second / path.name).is_file() and not rows:
            page.text(path.name)
            _compare_tables(page, head, [read_table(folder / path.name) for folder in folders])
    for picture in sorted({path.name for folder in folders for path in folder.glob("*.png")}):
        page.heading(picture.removesuffix(".png").replace("_", " "))
        for folder in folders:
            if (folder / picture).is_file():
                page.text(folder.name)
                page.picture(folder / picture)
    page.heading("How to repeat them")
    for folder in folders:
        page.code(command_of(kind_of(config_of(folder)), str(folder / "config.toml")))
    write_whole(out, page.html().encode())
    return out


def _compare_tables(page: Document, names: list[str], tables: list[tuple[list[str], list[list[str]]]]) -> None:
    """Two tables value by value where their rows are of the same things, else one after the other."""
    (head, first), (other_head, second) = tables
    things = [row[:1] for row in first]
    if head != other_head or things != [row[:1] for row in second] or len(set(map(tuple, things))) < len(things):
        for name, (columns, rows) in zip(names[1:], tables, strict=True):
            page.text(name)
            page.table(columns, [[_cell(cell) for cell in row] for row in rows])
        return
    rows, marked = [], set()
    for one, other in zip(first, second, strict=True):
        for column, before, after in zip(head[1:], one[1:], other[1:], strict=True):
            pair = _cell(before), _cell(after)
            differs = shown(pair[0]) != shown(pair[1])
            if differs:
                marked.add(len(rows))
            rows.append([f"{one[0]}: {column}", *pair, change(*pair) if differs else ""])
    page.table([*names, "change"], rows, marked)


def change(before: Any, after: Any) -> str:
    """By how much a number changes."""
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (before, after))
    if not numbers or before == after:
        return ""
    return shown(after - before) + (f" ({100 * (after / before - 1):+.3g} %)" if before else "")


def report_of_curve(head: list[str], rows: list[list[Any]], config: Path, command: str, picture: Path | None) -> str:
    """The report of `softgrip path`: the table of a curve."""
    page = Document(f"softgrip path: {config.name}")
    page.heading("What was asked")
    page.code(config.read_text(encoding="utf-8"))
    page.heading("What came out")
    texts = [[str(cell) for cell in row] for row in rows]
    for name in ("status", "reason"):
        counts = Counter(row[head.index(name)] for row in texts)
        page.text(f"{name}: " + "; ".join(f"{n} {what}" for what, n in counts.most_common(8)))
    if picture is not None:
        page.picture(picture)
    page.scatter(numbers_of(head, texts), np.array([row[head.index("status")] for row in texts]))
    page.table(head, [[_cell(cell) for cell in row] for row in texts])
    page.heading("Provenance, and how to repeat it")
    page.table(["", ""], [["finished", time.strftime("%Y-%m-%dT%H:%M:%S%z")], ["softgrip_jax", __version__]])
    page.code(command)
    return page.html()
