"""The report of a run's folder, and of two runs side by side: from the files that the run has left."""

from __future__ import annotations

import csv
import dataclasses
import json
import platform
import shlex
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console

from .._version import __version__
from ..errors import ConfigError, InputError
from ..folders import write_whole
from ..model_error import model_error
from .document import Document, shown
from .inputs import named_files

NAME, WORDS, CONFIG, MEASURED = "report.html", "summary.txt", "config.toml", "measured.toml"
T = TypeVar("T")
SECTIONS = ("design", "calibrate", "tension", "plan", "sweep", "sensitivity")
"""Sections of configs, by which a run is told from others; the command of a tension test is calibrate."""
COMPARED = ("measured", "fitted", "error")
"""Columns of a table of points whose unit is that of the curve."""
MOST_CURVES = 8
"""Curves of a table that are drawn, each on its own."""
UNCOMPARED = ("versions", "seconds", "units", "finished")
"""How results that say nothing of what was found begin."""
ROUNDING = 1e-9
"""Changes that are relatively smaller, and numbers of no more than that, are rounding."""
LEFT = {
    "sensitivity.nc": "sensitivity",
    "study.zarr": "sweep",
    "study.csv": "sweep",
    "study.png": "sweep",
    "points.csv": "calibrate",
    "materials.csv": "calibrate",
    "plan.csv": "plan",
    MEASURED: "measure",
    "curve.csv": "",
    "sheet.html": "",
}
"""What runs of a kind leave in their folders: a config may have sections for several, or none for this one. Without a
kind: no config says all that such a run was asked."""
ROWS_ON_SIDE = 6
"""A table of at most so many rows, with more columns than that, stands on its side."""
MOST_DESIGNS = 2000
"""Designs of a study that are read for its plot."""


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """A ConfigError with its name where a file of a run is damaged."""
    try:
        yield
    except (OSError, UnicodeError, json.JSONDecodeError, tomllib.TOMLDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or str(error).rstrip(".")
        raise ConfigError(f"{path} cannot be read: {why}.") from None


def read_json(path: Path) -> dict[str, Any]:
    """A result.json; {} where there is none."""
    with _readable(path):
        found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if not isinstance(found, dict):
        raise ConfigError(f"{path} cannot be read: it holds no table of names and values.")
    return found


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """(head, rows) of a CSV."""
    with _readable(path), path.open(newline="", encoding="utf-8") as file:
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


def command_of(config: dict[str, Any], result: dict[str, Any], folder: Path) -> list[str]:
    """The words of the command that repeats a run, typed in its folder: those that it has kept in its result.json, or
    what a file says that only such a run leaves, or a section of its config."""
    kinds = [kind for name, kind in LEFT.items() if (folder / name).exists()] + [n for n in SECTIONS if n in config]
    if "command" not in result and kinds[:1] in ([], [""]):
        raise ConfigError(f"{folder} is no run that softgrip report can tell of: it has not kept its command.")
    further = [MEASURED] if kinds[:1] == ["measure"] else []
    return result.get("command") or ["softgrip", kinds[0].replace("tension", "calibrate"), CONFIG, *further]


def config_of(folder: Path) -> dict[str, Any]:
    """The config of a run; ConfigError where the folder is none."""
    path = folder / CONFIG
    if not path.is_file():
        begun = (folder / "study.zarr").exists()
        why = (
            "its study is not finished: softgrip sweep with the same --out goes on"
            if begun
            else "there is no config.toml in it"
        )
        raise ConfigError(f"{folder} is not a run: {why}.")
    with _readable(path):
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
    command = command_of(config, result, folder)
    page = Document(f"softgrip {command[1]}: {name or folder.resolve().name}")
    page.heading("What was asked")
    page.code((folder / CONFIG).read_text(encoding="utf-8"))
    page.heading("What came out")
    if (folder / WORDS).is_file():
        with _readable(folder / WORDS):
            page.printed((folder / WORDS).read_text(encoding="utf-8"))
    for picture in sorted(folder.glob("*.png")):
        page.picture(picture)
    scalars = {k: v for k, v in flat(result).items() if not isinstance(v, list) or len(v) <= 4}
    if scalars:
        page.heading("Every number")
        page.table(["", "value (SI where a unit is not said)"], [[k, v] for k, v in scalars.items() if k != "units"])
    for table in sorted(folder.glob("*.csv")):
        _add_table(page, table, with_plot=command[1] != "sweep")
    _add_study(page, folder)
    _add_model_error(page, _scenes_of(folder))
    made = result.get("versions") or {"softgrip_jax": __version__, "python": platform.python_version()}
    finished = result.get("finished", time.strftime("%Y-%m-%dT%H:%M:%S%z"))
    rows = [["finished", finished], *([name, version] for name, version in made.items())]
    rows.append(["device", result.get("device", platform.machine())])
    _add_provenance(page, rows, how_to_repeat(folder, config), shlex.join(command))
    write_whole(folder / NAME, page.html().encode())
    return folder / NAME


def how_to_repeat(folder: Path, config: dict[str, Any]) -> str:
    """What to do before a run's command is typed."""
    names = named_files(config)
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        return (
            f"The config names files that are not kept in the folder of the run ({', '.join(missing)}). They stood "
            "beside the config that was given: put them beside config.toml in the same way. Type in that folder:"
        )
    kept = " and the files that it names" if names else ""
    return f"The folder of the run holds the config above as config.toml{kept}. Type in that folder:"


def _add_provenance(page: Document, rows: list[list[Any]], sentence: str, command: str) -> None:
    """When and by what the run was made, and the command that makes it again."""
    with page.together():
        page.heading("Provenance, and how to repeat it")
        page.table(["", ""], rows)
        page.text(sentence)
        page.code(command)


def counted_words(name: str, cells: list[str], sentences: dict[str, str] | None = None) -> str:
    """How often each status or reason occurs, with the sentences that say in words what a code means."""
    counts = Counter(filter(None, cells))
    if not counts or any(isinstance(_cell(word), float) for word in counts):
        return ""
    known = sentences or {}
    parts = [f"{n} {what}" + (f" ({known[what]})" if what in known else "") for what, n in counts.most_common(8)]
    return f"{name}: " + "; ".join(parts)


def _add_table(page: Document, path: Path, with_plot: bool = True) -> None:
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
            words = counted_words(name, cells)
            if words:
                page.text(words)
    if with_plot and len(rows) > 2:
        _add_plots(page, head, rows, status)
    cells = [[_cell(cell) for cell in row] for row in rows]
    if len(rows) <= ROWS_ON_SIDE < len(head):  # a wide page is scrolled, and paper is not wide
        head, *cells = [list(column) for column in zip(head, *cells, strict=True)]
    page.table([shown(name) for name in head], cells)


def _add_plots(page: Document, head: list[str], rows: list[list[str]], status: np.ndarray | None) -> None:
    """A plot of the numbers of a table, or one for each of its curves; none where a column has many units."""
    if {"curve", "quantity", "unit"} <= set(head):
        names = [row[head.index("curve")] for row in rows]
        for curve in list(dict.fromkeys(names))[:MOST_CURVES]:
            own = [row for row, name in zip(rows, names, strict=True) if name == curve]
            quantity, unit = (own[0][head.index(name)] for name in ("quantity", "unit"))
            columns = {
                f"{quantity}, {name} ({unit})" if name in COMPARED else name: values
                for name, values in numbers_of(head, own).items()
                if name != "specimen"
            }
            with page.together():
                page.text(curve)
                page.scatter(columns, up=f"{quantity}, {COMPARED[0]} ({unit})")
    elif not any(name.endswith("_SI") for name in head) and len(_units_in(head, rows)) < 2:
        page.scatter(numbers_of(head, rows), status)


def _units_in(head: list[str], rows: list[list[str]]) -> set[str]:
    """The units of a table that has them in a column."""
    return {row[head.index("unit")] for row in rows} if "unit" in head else set()


def _cell(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _add_study(page: Document, folder: Path) -> None:
    """The designs of a study that stands beside."""
    if not (folder / "study.zarr").exists():
        return
    from ..study import load_study
    from ..study.dataset import designs_in, quantities_of, rows_of, states_of
    from ..study.summary import keys_of

    with load_study(folder) as data:
        count = designs_in(data)
        step = -(-count // MOST_DESIGNS) or 1
        rows = rows_of(data, np.arange(0, count, step))
        columns, keys = {}, {}
        for key, (name, unit) in keys_of(data).items():
            columns[key], keys[name] = rows[name].values.astype(float) / unit, key
        worst = _worst([_names_of(rows[name]) for name in states_of(data)])
        words = f"{count} designs; one in {step} is drawn." if step > 1 else f"{count} designs."
        if (worst != "OK").any():
            words += " Those in orange are not OK in one state at least."
        if any(np.isinf(column).any() for column in columns.values()):
            words += " Those without a limit are not drawn where it is asked for."
        with page.together():
            page.heading("Study")
            page.text(words)
            page.scatter(columns, worst, next(iter(columns)), keys[quantities_of(data)[0]])


def _names_of(statuses: Any) -> np.ndarray:
    """The statuses of designs by name, as the study itself calls them."""
    names = dict(zip(statuses.attrs["flag_values"], statuses.attrs["flag_meanings"].split(), strict=True))
    return np.array([names[value] for value in statuses.values])


def _worst(states: list[np.ndarray]) -> np.ndarray:
    """The status of designs that have one in each of several states: the first that is not OK."""
    return np.array([next((word for word in words if word != "OK"), "OK") for words in zip(*states, strict=True)])


def _scenes_of(folder: Path) -> dict[str, Any]:
    """The scenes of a run; none where its config is no longer understood."""
    from .. import config as configs

    try:
        return configs.load(folder / "config.toml").scenes
    except InputError:
        return {}


def _add_model_error(page: Document, scenes: dict[str, Any]) -> None:
    """What is known of the models of the scenes against finite elements."""
    if not scenes:
        return
    rows = []
    for name, scene in scenes.items():
        for observable in scene.prepared().OBSERVABLES:
            sentence = model_error(scene, observable)
            if sentence:
                rows.append([name, observable.replace("_", " "), sentence])
    words = "How far the models are from finite elements, where that is known; numerics are far more exact."
    with page.together():
        page.heading("Model error")
        page.text(words, note=True)
        if rows:
            page.table(["scene", "value", "against finite elements"], rows)
        else:
            page.text("For these scenes nothing is known.")


def compare_runs(first: Path, second: Path, out: Path) -> Path:
    """Write a page about two runs: inputs that differ, results side by side."""
    folders = (first, second)
    names = [folder.resolve().name for folder in folders]
    given = [config_of(folder) for folder in folders]
    found = [read_json(folder / "result.json") for folder in folders]
    commands = [command_of(*of_one) for of_one in zip(given, found, folders, strict=True)]
    configs_of, results = [[flat(one) for one in every] for every in (given, found)]
    page = Document(" and ".join(names))
    page.heading("Inputs that differ")
    rows = [[key, *(c.get(key) for c in configs_of)] for key in dict.fromkeys(k for c in configs_of for k in c)]
    rows = [row for row in rows if row[1] != row[2]]
    head = ["", *names]
    page.table(head, rows) if rows else page.text("The configs are the same.")
    page.heading("Results")
    every = dict.fromkeys(key for result in results for key in result)
    keys = [key for key in every if not key.startswith(UNCOMPARED)]
    rows, marked = [], set()
    for key in keys:
        pair = [r.get(key) for r in results]
        if any(isinstance(value, list) and len(value) > 4 for value in pair):
            continue
        if differs(*pair):
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
        for name, folder in zip(names, folders, strict=True):
            if (folder / picture).is_file():
                page.picture(folder / picture, name)
    with page.together():
        page.heading("How to repeat them")
        for folder, command in zip(folders, commands, strict=True):
            page.code(shlex.join([str(folder / word) if word in (CONFIG, MEASURED) else word for word in command]))
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
            seen = shown(pair[0]) != shown(pair[1]) and differs(*pair)
            if seen:
                marked.add(len(rows))
            rows.append([f"{one[0]}: {column}", *pair, change(*pair) if seen else ""])
    page.table([*names, "change"], rows, marked)


def _are_numbers(*values: Any) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def differs(before: Any, after: Any) -> bool:
    """Whether two values differ by more than rounding."""
    if _are_numbers(before, after):
        size = max(abs(before), abs(after))
        return before != after and size >= ROUNDING and not abs(after - before) <= ROUNDING * size
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        return any(map(differs, before, after))
    return before != after


def change(before: Any, after: Any) -> str:
    """By how much a number changes; nothing where that is rounding."""
    if not _are_numbers(before, after) or not differs(before, after):
        return ""
    return shown(after - before) + (f" ({100 * (after / before - 1):+.3g} %)" if before else "")


@dataclasses.dataclass(frozen=True)
class Curve:
    """What `softgrip path` has found, and what of it is drawn first."""

    head: list[str]
    rows: list[list[Any]]
    scenes: dict[str, Any]
    across: str
    up: str
    sentences: dict[str, str]
    """What the codes of reasons mean, in words."""


def report_of_curve(curve: Curve, config: Path, command: str, picture: Path | None) -> str:
    """The report of `softgrip path`: the table of a curve, its picture, and what is known of the model."""
    head, texts = curve.head, [[str(cell) for cell in row] for row in curve.rows]
    page = Document(f"softgrip path: {config.name}")
    page.heading("What was asked")
    page.code(config.read_text(encoding="utf-8"))
    page.heading("What came out")
    for name in ("status", "reason"):
        page.text(counted_words(name, [row[head.index(name)] for row in texts], curve.sentences))
    if picture is not None:
        page.picture(picture)
    status = np.array([row[head.index("status")] for row in texts])
    page.scatter(numbers_of(head, texts), status, curve.across, curve.up)
    page.table(head, [[_cell(cell) for cell in row] for row in texts])
    _add_model_error(page, curve.scenes)
    rows = [["finished", time.strftime("%Y-%m-%dT%H:%M:%S%z")], ["softgrip_jax", __version__]]
    _add_provenance(page, rows, "Type where the config is found by this name:", command)
    return page.html()
