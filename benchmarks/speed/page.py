"""docs/speed-and-error.md and docs/hard-cases.md: their tables are made from the CSV files, between markers.

What stands around them stays as it was written.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from . import measure, pictures

Rows = list[dict[str, Any]]
Tables = dict[str, Rows]
MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def write_page(page: Path, folder: Path) -> None:
    """Fill the tables of the page from the folder's files, and draw its pictures beside them."""
    tables = {file.stem: measure.read(file) for file in sorted(folder.glob("*.csv"))}
    told = {file.stem: json.loads(file.read_text()) for file in sorted(folder.glob("*.json"))}
    for file in sorted((folder / "gpu").glob("*.csv")):
        tables[file.stem] = measure.read(file)
        told[file.stem] = json.loads(file.with_suffix(".json").read_text())
    pictures.draw(folder, tables)

    def filled(found: re.Match) -> str:
        begin, name, end = found.groups()
        make, needs = TABLES[name]
        if any(part not in tables for part in needs):
            return found.group(0)
        lines = make(tables, told)
        return begin + "\n" + "\n".join(lines) + "\n\n" + end

    page.write_text(MARKED.sub(filled, page.read_text(encoding="utf-8")), encoding="utf-8")


def grid(head: list[str], body: list[list[str]]) -> list[str]:
    """A table in Markdown; the first column is text, the others are numbers."""
    return [
        f"| {' | '.join(head)} |",
        "|---" + "|---:" * (len(head) - 1) + "|",
        *[f"| {' | '.join(line)} |" for line in body],
    ]


def time_text(seconds: Any) -> str:
    """'1.9 ns', '1.2 µs', '340 ms', '2.1 s'; nothing for nothing."""
    if not isinstance(seconds, float) or not np.isfinite(seconds):
        return ""
    if 0 < seconds < 1e-7:
        return f"{seconds / 1e-9:.3g} ns"
    unit, name = next(((u, n) for u, n in ((1.0, "s"), (1e-3, "ms")) if seconds >= u), (1e-6, "µs"))
    return f"{seconds / unit:.3g} {name}"


def megabytes(value: Any) -> str:
    """'0.012 MB', '33,400 MB'; nothing for nothing."""
    if not isinstance(value, float):
        return ""
    return f"{whole(value)} MB" if value >= 100 else f"{value:.2g} MB"


def small(value: Any) -> str:
    """'1e-12'."""
    if not isinstance(value, float) or not np.isfinite(value):
        return ""
    return "0" if value == 0 else f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")


def whole(value: float) -> str:
    """'1,234,000' to three digits."""
    if not value:
        return "0"
    digits = max(0, int(np.floor(np.log10(abs(value)))) - 2)
    return f"{round(value / 10**digits) * 10**digits:,.0f}"


def _machine(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = []
    for part, one in told.items():
        body.append([part, one["sample"], one["date"], one["machine"], one["device"], one["jax"],
                     one["commit"], str(one["load"]), f"{one['seconds']:g} s",
                     f"{one['peak_memory_MB']:,.0f} MB" if one["peak_memory_MB"] else ""])  # fmt: skip
    head = ["part", "sample", "date", "machine", "device", "jax", "commit", "load", "took", "peak memory"]
    return grid(head, body)


def _measured(rows: Rows) -> list[str]:
    body = []
    for row in rows:
        setting = ", ".join(filter(None, [row["setting"], row["precision"] if row["precision"] != "float64" else ""]))
        per_second = whole(1 / row["seconds"]) if np.isfinite(row["seconds"]) else ""
        ratio = row["gradient_seconds"] / row["seconds"] if isinstance(row["gradient_seconds"], float) else np.nan
        body.append([
            row["method"] + (f": {setting}" if setting else ""), f"{int(row['batch']):,}", small(row["error"]),
            small(row["gradient_error"]), time_text(row["seconds"]), per_second,
            f"{ratio:.1f}" if np.isfinite(ratio) else "", time_text(row["compile_seconds"]),
            megabytes(row["memory_MB"]),
        ])  # fmt: skip
    head = ["method", "batch", "error", "of the gradient", "time per design", "per second", "with gradient: times",
            "compile", "memory"]  # fmt: skip
    return grid(head, body)


def _of_scene(part: str, scene: str) -> Callable[[Tables, Any], list[str]]:
    return lambda tables, told: _measured([row for row in tables[part] if row["scene"] == scene])


def _all_of(part: str) -> Callable[[Tables, Any], list[str]]:
    def make(tables, told):
        body = []
        for scene in dict.fromkeys(row["scene"] for row in tables[part]):
            body += [f"**{scene}**", "", *_measured([row for row in tables[part] if row["scene"] == scene]), ""]
        return body[:-1]

    return make


def ours(rows: Rows, scene: str, setting: str = "") -> Rows:
    """Our rows in float64."""
    return [
        row for row in rows
        if row["scene"] == scene and row["method"] == "softgrip_jax" and row["precision"] == "float64"
        and row["setting"].startswith(setting)
    ]  # fmt: skip


def _targets(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = []

    def add(what: str, wanted: str, measured: str, held: bool) -> None:
        body.append([what, wanted, measured, "yes" if held else "**no**"])

    for needs, judge in (
        (("shells",), add_shells),
        (("fingers",), add_fingers),
        (("peers",), add_peers),
        (("start",), add_start),
        (("fidelity",), add_fidelity),
        (("energy",), add_energy),
        (("explorer",), add_explorer),
        (("gpu_shells", "gpu_fingers", "gpu_search"), add_gpu),
    ):
        if all(part in tables for part in needs):
            judge(add, tables)
    return grid(["what", "wanted", "measured", "held"], body)


def add_shells(add: Callable[..., None], tables: Tables) -> None:
    """States per second, and what a gradient costs."""
    for scene in ("shell free", "shell flat", "shell cylinder"):
        rows = [row for row in ours(tables["shells"], scene) if row["error"] <= 1e-12]
        if rows:
            speed = max(1 / row["seconds"] for row in rows)
            add(f"{scene}: states per second, error under 1e-12", "500,000", whole(speed), speed >= 5e5)
    add_ratio(add, tables["shells"], "shell cylinder")


def add_fingers(add: Callable[..., None], tables: Tables) -> None:
    """States per second at an error of 1e-6, and what a gradient costs."""
    good = [row for row in ours(tables["fingers"], "finger tip contact", "exact") if row["error"] <= 1e-6]
    if good:
        speed = max(1 / row["seconds"] for row in good)
        add("finger, tip held: states per second, force to 1e-6", "100,000", whole(speed), speed >= 1e5)
    add_ratio(add, tables["fingers"], "finger tip contact")


def add_gpu(add: Callable[..., None], tables: Tables) -> None:
    """Batches and a search on a GPU."""
    for scene in ("shell free", "shell flat", "shell cylinder"):
        speed = max(1 / row["seconds"] for row in ours(tables["gpu_shells"], scene))
        add(f"GPU, {scene}: states per second", "300,000,000", whole(speed), speed >= 3e8)
    for setting in dict.fromkeys(row["setting"] for row in tables["gpu_fingers"]):
        speed = max(1 / row["seconds"] for row in ours(tables["gpu_fingers"], "finger tip contact", setting))
        add(f"GPU, finger, tip held, {setting}: states per second", "10,000,000", whole(speed), speed >= 1e7)
    seconds = float(np.median([row["seconds"] for row in tables["gpu_search"] if row["run"] != "first"]))
    add("GPU: a search of 512 designs, compiled", "at most 1 s", time_text(seconds), seconds <= 1)


def add_ratio(add: Callable[..., None], rows: Rows, scene: str) -> None:
    """Value and gradient over the value alone, in batches."""
    ratios = [row["gradient_seconds"] / row["seconds"] for row in ours(rows, scene) if row["batch"] >= 256]
    if ratios:
        ratio = float(np.median(ratios))
        add(f"{scene}: value and full gradient over value", "at most 3", f"{ratio:.2f}", ratio <= 3)


def add_start(add: Callable[..., None], tables: Tables) -> None:
    """Imports and first answers."""
    start = {(row["what"], row["time"]): row for row in tables["start"]}
    theirs, all_of_ours = (
        start[words, ""]["seconds"] for words in ("import jax, diffrax", "import softgrip_jax, all that solve needs")
    )
    ratio = all_of_ours / theirs
    add("import softgrip_jax, all that solve needs, over jax and diffrax", "at most 1.2", f"{ratio:.2f}", ratio <= 1.2)
    for (what, when), row in start.items():
        wanted = {"first": 4, "second": 2}.get(when)
        if wanted:
            took = f"{row['seconds']:.1f} s (CPU {row['cpu_seconds']:.1f} s)"
            add(f"{what}, {when} time", f"at most {wanted} s", took, row["seconds"] <= wanted)


def add_fidelity(add: Callable[..., None], tables: Tables) -> None:
    """The estimate as a bound, and dear choices."""
    row = tables["fidelity"][0]
    share, dear = row["share"], row["needlessly_dearest"]
    add("fidelity.choose: estimates that bound the error", "99 %", f"{100 * share:.2f} %", share >= 0.99)
    add("... the dearest model where a cheaper one suffices", "never", f"{dear:g} times", dear == 0)


def add_energy(add: Callable[..., None], tables: Tables) -> None:
    """The energy membrane with 48 unknowns."""
    for row in tables["energy"]:
        if row["unknowns"] == ENERGY_UNKNOWNS:
            for words, name, most in (
                ("from the one before", "warm_s", 1e-3),
                ("from the flat membrane", "cold_s", 1e-2),
            ):
                took = row[name]
                add(f"energy membrane, 48 unknowns: a solve {words}", f"at most {time_text(most)}", time_text(took),
                    took <= most)  # fmt: skip
            for words, name in (("pressures", "pressures_s"), ("unlike designs", "designs_s")):
                speed = 1 / row[name]
                add(f"energy membrane, 48 unknowns: solves per second, batch of {words}", "2,000", whole(speed),
                    speed >= 2000)  # fmt: skip


def add_explorer(add: Callable[..., None], tables: Tables) -> None:
    """From a key to the picture, and the first view."""
    for row in tables["explorer"]:
        most = (200, 200) if "energy" in row["scene"] else (60, 150)
        names = (("in the median", "median_ms"), ("in 99 of 100", "of_100_99_ms"))
        for (words, name), limit in zip(names, most, strict=True):
            add(f"explorer, {row['scene']}: from a key to its picture, {words}", f"{limit} ms", f"{row[name]:.0f} ms",
                row[name] <= limit)  # fmt: skip
        took = row["first_view_s"]
        add(f"explorer, {row['scene']}: first view, nothing kept", "8 s", f"{took:.1f} s", took <= 8)


ENERGY_UNKNOWNS = 48
"""Of the default basis on a symmetric object."""


def add_peers(add: Callable[..., None], tables: Tables) -> None:
    """How many times faster than the peers, at an error of 1e-6 of the tip force."""
    rows = tables["peers"]
    for words, method, law, wanted in (
        ("the thesis's algorithms with SciPy", "thesis,", "thesis", 3000),
        ("diffrax and optimistix under vmap", "diffrax in", "exact", 30),
        ("SciPy's shooting", "SciPy,", "exact", None),
    ):
        good = [
            r
            for r in rows
            if r["method"].startswith(method) and r["error"] <= 1e-6 and law in r["setting"] + r["method"]
        ]
        mine = [r for r in ours(rows, "finger tip contact", law) if r["error"] <= 1e-6]
        if good and mine:
            ratio = min(r["seconds"] for r in good) / min(r["seconds"] for r in mine)
            add(f"finger, tip held, force to 1e-6: faster than {words}", f"{wanted:,} times" if wanted else "",
                f"{ratio:,.{0 if ratio >= 10 else 2}f} times", wanted is None or ratio >= wanted)  # fmt: skip


def _start(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = [
        [row["what"], str(row["time"]), time_text(row["seconds"]), time_text(row["cpu_seconds"]),
         f"{row['peak_memory_MB']:,.0f} MB"]
        for row in tables["start"]
    ]  # fmt: skip
    return grid(["what", "time", "on the wall", "CPU", "peak memory"], body)


def _fidelity(tables: Tables, told: dict[str, Any]) -> list[str]:
    row = tables["fidelity"][0]
    return [
        f"{row['fingers']:,.0f} random fingers, {row['with_equilibrium']:,.0f} with an equilibrium, {row['models']:g}"
        " models:"
        f" the estimate bounds the error in {row['bounds']:,.0f} of {row['estimates']:,.0f} cases"
        f" ({100 * row['share']:.2f} %). In {row['over_tolerance']:g} choices the error is over the tolerance that was"
        f" thought to be kept, and in {row['needlessly_dearest']:g} the dearest model was taken where a cheaper one was"
        " good enough."
    ]


def _models(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = []
    for row in pictures.ordered(tables["models"]):
        cells = [f"{row['finite_elements']:.4g}"]
        for name in ("thesis_model", "better_model"):
            value = row[name]
            known = isinstance(value, float) and np.isfinite(value)
            cells.append(f"{value:.4g} ({100 * (value / row['finite_elements'] - 1):+.1f} %)" if known else "none")
        body.append([pictures.named(row), str(row["unit"]), *cells, str(row["better"])])
    return grid(["quantity", "unit", "finite elements", "thesis", "better", "which is"], body)


def _arcs(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = [
        [row["quantity"], f"{row['shells']:g}", *(f"{100 * row[name]:+.0f} %" for name in ("low", "median", "high"))]
        for row in tables["arcs"]
    ]
    return grid(["quantity", "shells", "5 in 100 are below", "median", "5 in 100 are above"], body)


def _energy(tables: Tables, told: dict[str, Any]) -> list[str]:
    rows = tables["energy"]
    errors = [name for name in rows[0] if name.startswith("error_")]
    body = [
        [row["model"], f"{row['unknowns']:g}" if row["unknowns"] else ""]
        + [time_text(row[name]) for name in ("cold_s", "warm_s", "pressures_s", "designs_s", "compile_s")]
        + [f"{row[name]:+.1f} %" if row[name] else "0" for name in errors]
        for row in rows
    ]
    head = [
        "model",
        "unknowns",
        "alone",
        "from the one before",
        "in a batch of pressures",
        "of unlike designs",
        "compile",
    ]
    at = [f"force at {name.split('_')[1]} kPa" for name in errors]
    return grid([*head, *at], body)


def _drives(tables: Tables, told: dict[str, Any]) -> list[str]:
    rows = tables["drives"]
    errors = [name for name in rows[0] if name.startswith(("force_", "moment_"))]
    body = [
        [row["model"], *(time_text(row[name]) for name in ("cold_s", "designs_s"))]
        + [f"{row['gradient']:.1f}" if row["gradient"] else "", time_text(row["compile_s"])]
        + ["no state" if np.isnan(row[name]) else f"{row[name]:+.0f} %" if row[name] else "0" for name in errors]
        for row in rows
    ]
    words = {"force": "tip force", "moment": "straight moment"}
    parts = [name.split("_") for name in errors]
    head = ["model", "alone", "in a batch of 256", "with gradient: times", "compile"]
    return grid([*head, *(f"{words[what]} at {at} kPa" for what, at, _ in parts)], body)


def _explorer(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = [
        [row["scene"], f"{row['first_view_s']:.1f} s", f"{row['second_view_s']:.1f} s",
         *(f"{row[name]:.0f} ms" for name in ("median_ms", "of_100_99_ms", "slowest_ms")),
         f"{row['fast_drawn']:g} of {row['fast_keys']:g}", row["last_drawn"]]
        for row in tables["explorer"]
    ]  # fmt: skip
    head = ["scene", "first view, nothing kept", "second", "key to picture, median", "99 of 100 within", "slowest",
            "drawn of keys in a row", "the last one drawn"]  # fmt: skip
    return grid(head, body)


def _hard(tables: Tables, told: dict[str, Any]) -> list[str]:
    body = [
        [row["case"], row["hard"], row["thesis_solver"], row["ours"], small(row["error"]), f"{row['iterations']:g}"]
        for row in tables["hard"]
    ]
    return grid(["case", "what is hard", "fsolve, solve_bvp", "here", "error", "iterations"], body)


def _methods_told(rows: Rows) -> list[str]:
    """What the rows say in words: Newton's time over the default solver's, shooting's over collocation's."""
    times = {(row["scene"], row["method"], row["setting"]): row["seconds"] for row in rows}
    shares = {True: [], False: []}
    for (scene, method, setting), seconds in times.items():
        if method.endswith("Newton"):
            usual = method.replace("Newton", "ArcLength" if scene.startswith("finger") else "ExplicitCurve")
            shares[scene.startswith("finger")].append(seconds / times[scene, usual, setting])

    def span(values: list[float]) -> str:
        return f"{100 * min(values):.0f} to {100 * max(values):.0f} %"

    def cheapest(beam: str) -> float:
        good = [row for row in rows if row["method"] == f"{beam}, ArcLength" and row["error"] <= 1e-6]
        return min(row["seconds"] for row in good)

    times_longer = cheapest("shooting") / cheapest("collocation")
    return [
        f"From so near, Newton's method takes {span(shares[True])} of the time of `ArcLength` for a finger and",
        f"{span(shares[False])} of that of `ExplicitCurve` for a shell, and its errors are the same.",
        f"At an error of at most 1e-6 shooting takes {times_longer:.0f} times as long as collocation.",
    ]


def _methods(tables: Tables, told: dict[str, Any]) -> list[str]:
    rows = tables["methods"]
    lines = [
        "The [methods of the beam and the solvers](guides/solvers.md), each with each: type A with its tip held and",
        "designs within 5 % of it and of 31 kPa, and the thesis's shell on a plane and on a cylinder at 15 kPa.",
        "Newton's method begins at the state of the same design at 96 % of the pressure, whose time is not counted.",
        "Errors are the largest of 16 designs against codes that share nothing with the package: SciPy's DOP853 at",
        "1e-12 for fingers, 80-bit arithmetic for shells. *Found* counts the designs that are OK; where points are too",
        "few for the shape, the state is refused. An energy membrane has one solver, whose bases are",
        "[below](#shells-by-energy).",
        "",
        *_methods_told(rows),
        "",
        "![Error over time of every method with every solver](benchmarks/methods.png)",
        "",
    ]
    for scene in dict.fromkeys(row["scene"] for row in rows):
        body = [
            [", ".join(filter(None, [row["method"], row["setting"]])), f"{row['found']:g} of {row['batch']:g}",
             small(row["error"]), f"{row['iterations']:.1f}", time_text(row["seconds"]), whole(1 / row["seconds"]),
             time_text(row["compile_seconds"])]
            for row in rows if row["scene"] == scene
        ]  # fmt: skip
        head = ["method, solver", "found", "error", "iterations", "time per design", "per second", "compile"]
        lines += [f"**{scene}**", "", *grid(head, body), ""]
    return lines[:-1]


def _gpu_search(tables: Tables, told: dict[str, Any]) -> list[str]:
    head = ["search", "designs", "run", "all of it", "descent", "finish", "designs solved"]
    body = [
        [row["search"], f"{row['designs']:g}", row["run"], time_text(row["seconds"]), time_text(row["descent_seconds"]),
         time_text(row["finish_seconds"]), f"{row['solves']:,.0f}"]
        for row in tables["gpu_search"]
    ]  # fmt: skip
    return grid(head, body)


def _gpu_same(tables: Tables, told: dict[str, Any]) -> list[str]:
    head = ["question", "designs", "OK", "statuses that differ", "values", "limit pressures", "derivatives"]
    body = [
        [row["question"].replace(" ", ", drive "), *(f"{row[key]:g}" for key in ("designs", "ok", "statuses_differ")),
         *(small(row[key]) or "differ" for key in ("value", "limit", "derivative"))]
        for row in tables["gpu_same"]
    ]  # fmt: skip
    return grid(head, body)


TABLES: dict[str, tuple[Callable[[Tables, Any], list[str]], tuple[str, ...]]] = {
    "machine": (_machine, ()),
    "targets": (_targets, ()),
    "shells": (_all_of("shells"), ("shells",)),
    "fingers": (_all_of("fingers"), ("fingers",)),
    "scenes": (_all_of("scenes"), ("scenes",)),
    "methods": (_methods, ("methods",)),
    "peers": (_all_of("peers"), ("peers",)),
    "elastica": (_all_of("elastica"), ("elastica",)),
    "start": (_start, ("start",)),
    "fidelity": (_fidelity, ("fidelity",)),
    "models": (_models, ("models",)),
    "arcs": (_arcs, ("arcs",)),
    "hard": (_hard, ("hard",)),
    "energy": (_energy, ("energy",)),
    "drives": (_drives, ("drives",)),
    "explorer": (_explorer, ("explorer",)),
    "gpu_same": (_gpu_same, ("gpu_same",)),
    "gpu_shells": (_all_of("gpu_shells"), ("gpu_shells",)),
    "gpu_fingers": (_all_of("gpu_fingers"), ("gpu_fingers",)),
    "gpu_energy": (_all_of("gpu_energy"), ("gpu_energy",)),
    "gpu_search": (_gpu_search, ("gpu_search",)),
}
