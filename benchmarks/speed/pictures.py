"""The pictures of the page, from the tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from softgrip_jax.plots.curves import COLOURS
from softgrip_jax.plots.figures import BODY, STYLE

from .finger_part import ENOUGH, USUAL

Rows = list[dict[str, Any]]
MARKS = "osD^vP*X"


def draw(folder: Path, tables: dict[str, Rows]) -> None:
    """All pictures that the tables allow."""
    with mpl.rc_context(STYLE | {"savefig.dpi": 130}):
        for name, make, needs in PICTURES:
            if all(part in tables for part in needs):
                make(tables).savefig(folder / f"{name}.png")


def work_precision(scenes: list[str], rows: Rows, series: Callable[[dict], str | None]) -> Figure:
    """Error over time per design: above the observable, below its gradient; a panel for each scene."""
    figure = Figure(figsize=(3.3 * len(scenes), 5.6), layout="constrained")
    axes = figure.subplots(2, len(scenes), squeeze=False, sharex=True)
    names = list(dict.fromkeys(filter(None, (series(row) for row in rows))))
    for column, scene in enumerate(scenes):
        for line, (error, seconds) in enumerate((("error", "seconds"), ("gradient_error", "gradient_seconds"))):
            ax = axes[line, column]
            for k, name in enumerate(names):
                points = [
                    (row[seconds], max(row[error], 1e-16))
                    for row in rows
                    if row["scene"] == scene and series(row) == name and _known(row, error, seconds)
                ]
                if points:
                    x, y = np.array(sorted(points)).T
                    ax.plot(x, y, MARKS[k % len(MARKS)] + "-", color=_colour(k), ms=4, lw=0.9, label=name)
            ax.set(xscale="log", yscale="log", ylim=(5e-17, 1))
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.grid(True, which="major", lw=0.3, color="0.85")
            if column == 0:
                ax.set_ylabel("error of the value" if line == 0 else "error of the gradient")
        axes[0, column].set_title(scene)
        axes[1, column].set_xlabel("seconds per design, one core")
    handles = {label: h for ax in axes.flat for h, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=min(4, len(handles)), fontsize=8)
    return figure


def _known(row: dict[str, Any], *names: str) -> bool:
    return all(isinstance(row[name], float) and np.isfinite(row[name]) for name in names)


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _shells(tables: dict[str, Rows]) -> Figure:
    def series(row):
        if row["method"] != "softgrip_jax":
            return row["method"].split(",")[0]
        return f"ours, {row['precision']}, batches of 1 to 65,536"

    rows = tables["shells"]
    return work_precision(list(dict.fromkeys(row["scene"] for row in rows)), rows, series)


def _fingers(tables: dict[str, Rows]) -> Figure:
    rows = [*tables["fingers"], *tables.get("scenes", []), *tables.get("peers", [])]

    def series(row):
        if row["method"] == "softgrip_jax":
            if row["batch"] not in (256, USUAL) or row["precision"] == "float32":
                return None
            return f"ours, {row['setting'].split(', ')[0]}"
        equal = ", equal steps" if row["setting"].endswith("steps") and "diffrax" in row["method"] else ""
        return None if "reference" in row["method"] else row["method"] + equal

    return work_precision(["finger free", "finger tip contact", "finger grasp"], rows, series)


def _throughput(tables: dict[str, Rows]) -> Figure:
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    ax = figure.subplots()
    rows = [*tables["shells"], *tables["fingers"]]
    lines = {}
    for row in rows:
        if row["method"] != "softgrip_jax" or row["precision"] != "float64":
            continue
        if row["scene"] == "finger tip contact" and row["setting"] != f"exact, {ENOUGH} points":
            continue
        lines.setdefault(row["scene"], {})[row["batch"]] = (1 / row["seconds"], 1 / row["gradient_seconds"])
    for k, (scene, known) in enumerate(lines.items()):
        sizes = sorted(known)
        for j, style in enumerate(("-", ":")):
            label = scene + (", with gradient" if j else "")
            ax.plot(sizes, [known[n][j] for n in sizes], MARKS[k] + style, color=_colour(k), ms=4, lw=1.1, label=label)
    ax.set(xscale="log", yscale="log", xlabel="designs in a batch", ylabel="designs per second, one core")
    ax.grid(True, lw=0.3, color="0.85")
    ax.legend(fontsize=7.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _methods(tables: dict[str, Rows]) -> Figure:
    """Error over time per design of all methods of the beam with all solvers, and of shells; a line for each."""
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    ax = figure.subplots()
    rows = tables["methods"]
    for k, (scene, method) in enumerate(dict.fromkeys((row["scene"], row["method"]) for row in rows)):
        line = [row for row in rows if (row["scene"], row["method"]) == (scene, method)]
        points = [row for row in line if _known(row, "error", "seconds")]
        x, y = [row["seconds"] for row in points], [max(row["error"], 1e-16) for row in points]
        label = f"{scene}: {method}"
        ax.plot(x, y, MARKS[k % len(MARKS)] + "-", color=_colour(k), ms=5, lw=0.9, label=label)
        for row, place in zip(points, zip(x, y, strict=True), strict=True):
            # One word per setting: the other solver has the same error a little beside.
            if row["setting"] and method.endswith("ArcLength"):
                ax.annotate(row["setting"], place, textcoords="offset points", xytext=(9, -2), fontsize=6.5, color=BODY)
    ax.set(xscale="log", yscale="log", ylim=(5e-17, 1e-1), xlim=(3e-7, 3e-3))
    ax.set(xlabel="seconds per design, one core, in a batch", ylabel="relative error of the force")
    ax.grid(True, which="major", lw=0.3, color="0.85")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return figure


def ordered(rows: Rows) -> Rows:
    """Comparisons of models with what belongs together side by side, in the order in which it first appears."""
    first = list(dict.fromkeys(row["quantity"].split()[0] for row in rows))
    return sorted(rows, key=lambda row: first.index(row["quantity"].split()[0]))


def named(row: dict[str, Any]) -> str:
    """'shell, free: inflation at 5 kPa'."""
    at, quantity = row["at"], row["quantity"]
    if not isinstance(at, float):
        return quantity
    unit = "kPa" if quantity.startswith(("shell", "chamber")) else "N/m" if "weight" in quantity else "N mm"
    return f"{quantity} at {at:.3g} {unit}"


def _models(tables: dict[str, Rows]) -> Figure:
    rows = ordered(tables["models"])
    labels, thesis, better = [named(row) for row in rows], [], []
    for row in rows:
        thesis.append(100 * (row["thesis_model"] / row["finite_elements"] - 1))
        ours = row["better_model"]
        better.append(100 * (ours / row["finite_elements"] - 1) if isinstance(ours, float) else np.nan)
    figure = Figure(figsize=(7.2, 0.24 * len(rows) + 0.9), layout="constrained")
    ax = figure.subplots()
    y = np.arange(len(rows))[::-1]
    ax.axvline(0, color=BODY, lw=0.8)
    ax.barh(y + 0.18, thesis, 0.34, color=COLOURS[1], label="thesis")
    ax.barh(y - 0.18, better, 0.34, color=COLOURS[0], label="energy membrane, exact section law")
    for place, value in zip(y, thesis, strict=True):
        if not np.isfinite(value):
            ax.text(0.5, place + 0.18, "no equilibrium", va="center", fontsize=6.5, color=COLOURS[1])
    ax.set_yticks(y, labels, fontsize=7.5)
    ax.set_xlabel("difference from finite elements, %")
    ax.set_ylim(-0.6, len(rows) - 0.4)
    figure.legend(fontsize=8, loc="outside upper center", ncols=2)
    return figure


def _over_time(rows: Rows, batch: str, prefixes: tuple[str, ...], label: str, limits: Any) -> Figure:
    """Model error over the time of a solve: the mean over the pressures, as a mark, and its range, as a line."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    ax = figure.subplots()
    for k, (name, words) in enumerate((("cold_s", "a solve alone"), ("designs_s", batch))):
        legend = words
        for row in rows:
            if not _known(row, name):
                continue
            off = np.abs([row[column] for column in row if column.startswith(prefixes)])
            exact = row["model"] == "finite elements"
            low, middle, high = (MESH_ERROR,) * 3 if exact else (np.nanmin(off), np.nanmean(off), np.nanmax(off))
            ax.plot([row[name]] * 2, [low, high], color=_colour(k), lw=0.9, alpha=0.6)
            ax.plot(row[name], middle, MARKS[k], color=_colour(k), ms=5, ls="", label=legend)
            legend = None
            if name == "cold_s":
                words = row["model"].replace("energy, ", "").replace(" polynomials", "")
                # Two arcs take the same time.
                place, aside = (low, -12) if "without" in words else (high, 6)
                ax.annotate(
                    words, (row[name], place), textcoords="offset points", xytext=(0, aside), ha="center", fontsize=7.5
                )
    ax.set(xscale="log", yscale="log", **limits, xlabel="seconds per solve, one core", ylabel=label)
    ax.grid(True, lw=0.3, color="0.85")
    ax.legend(fontsize=8)
    return figure


def _energy(tables: dict[str, Rows]) -> Figure:
    words = "force off finite elements, 5 to 20 kPa: mean, range (%)"
    limits = {"xlim": (3e-7, 1e3), "ylim": (0.3, 40)}
    return _over_time(tables["energy"], "in a batch of unlike designs", ("error_",), words, limits)


def _drives(tables: dict[str, Rows]) -> Figure:
    words = "tip force off finite elements,\n5 to 31 kPa: mean, range (%)"
    limits = {"xlim": (3e-6, 5e3), "ylim": (0.3, 250)}
    return _over_time(tables["drives"], "in a batch of unlike designs", ("force_",), words, limits)


MESH_ERROR = 0.5
"""Percent: what is known of the elements' own error."""

PICTURES = (
    ("energy", _energy, ("energy",)),
    ("drives", _drives, ("drives",)),
    ("work_precision_shells", _shells, ("shells",)),
    ("work_precision_fingers", _fingers, ("fingers",)),
    ("methods", _methods, ("methods",)),
    ("throughput", _throughput, ("shells", "fingers")),
    ("model_error", _models, ("models",)),
)
