"""Parameter studies as pictures: curves over one varied number, maps over two, parallel axes of more or of designs that
are no grid, bars of elasticities.

Where a design has no answer nothing is drawn: the region is hatched, and the legend says what its status is. So is it
where the answer is that there is no limit (inf): axes and colours are those of the finite values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..errors import InputError
from ..results import Status
from ..study.dataset import DESIGN, tied_in
from ..units import DISPLAY
from .figures import BLUE, GREEN, ORANGE, STYLE, VERMILION, WIDTH

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, "#CC79A7", "#56B4E9", "#4D4D4D")
LINES = ("-", (0, (5, 2)), (0, (1, 1)), (0, (5, 1, 1, 1)))
NO_LIMIT = -1
"""Beside the statuses: there is an answer, and it is that a scene has no limit."""
HATCHES: dict[int, str] = {
    NO_LIMIT: "\\\\\\\\",
    Status.NO_CONTACT: "....",
    Status.BEYOND_LIMIT: "////",
    Status.IMPOSSIBLE: "xxxx",
    Status.NOT_CONVERGED: "++++",
}
HATCH_FACE, HATCH_EDGE = "#F2F2F2", "#9A9A9A"
PANEL_HEIGHT = 2.3
"""Height of a panel, inches."""


def study(data: xr.Dataset) -> Figure:
    """A picture of a study.

    A grid over one or two numbers has a panel for every observable or, of maps, quantity. A grid over more numbers, or
    designs that are no grid, have one axis for every varied number and every quantity, and a line through them for
    every design.

    Args:
        data: the Dataset of a study (`softgrip_jax.study`).

    Raises:
        InputError: for a study of one design.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> walls = sg.study.Grid([np.array([1.0, 1.1]) * mm])
        >>> data = sg.Study(sg.shell.Free(shell), ["shell.t_m"], [sg.Quantity("inflation", at=15 * kPa)], walls).run()
        >>> len(sg.plots.study(data).axes)
        1
    """
    names = [str(name) for name, variable in data.data_vars.items() if "status" in variable.attrs]
    sizes = {name: data.sizes[name] for name in data[names[0]].dims}
    axes = [str(name) for name, size in sizes.items() if size > 1]
    if DESIGN in sizes:
        return _parallel(data, [str(name) for name in data.coords if data[name].dims == (DESIGN,)], names)
    if len(axes) > 2:
        flat = data[[*names, *{data[name].attrs["status"] for name in names}]].stack({DESIGN: axes}, create_index=False)
        return _parallel(flat, axes, names)
    data = data.isel({name: 0 for name in sizes if name not in axes})
    if not axes:
        raise InputError("A picture of a study needs a number that varies; this study is of one design.")
    data = data.sortby(axes)
    if len(axes) == 2:
        return _figure(len(names), lambda k, ax: _map(data, names[k], axes, ax))
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(data[name].attrs["long_name"].partition(" at ")[0], []).append(name)
    members = list(groups.items())
    return _figure(len(members), lambda k, ax: _curves(data, members[k][0], members[k][1], axes[0], ax))


def _figure(panels: int, paint: Any) -> Figure:
    columns = min(panels, 2)
    rows = -(-panels // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * (0.6 if columns == 1 else 1.0), rows * PANEL_HEIGHT + 0.3))
        grid = figure.subplots(rows, columns, squeeze=False)
        for k, ax in enumerate(grid.ravel()):
            if k < panels:
                paint(k, ax)
            else:
                ax.set_axis_off()
    return figure


def _curves(data: xr.Dataset, observable: str, names: Sequence[str], axis: str, ax: Axes) -> None:
    """One observable against one number, a line per state."""
    x, x_label = _axis(data, axis)
    unit = DISPLAY[data[names[0]].attrs["kind"]]
    ends: dict[int, Any] = {}
    for k, name in enumerate(names):
        values, status = _drawn(data, name)
        state = data[name].attrs["long_name"].partition(" at ")[2]
        colour = COLOURS[k % len(COLOURS)]
        label = state if len(names) > 1 else None
        ax.plot(x, values, color=colour, linestyle=LINES[k % len(LINES)], label=label)
        if len(names) == 1:
            ends |= _shade(ax, x, status)
            continue
        # Several lines end at several places: each says itself why.
        for i in range(len(x) - 1):
            before, after = status[i], status[i + 1]
            if (before == Status.OK) != (after == Status.OK):
                kind, at = (after, i) if before == Status.OK else (before, i + 1)
                marker = {Status.NO_CONTACT: "o", Status.BEYOND_LIMIT: "X", NO_LIMIT: "^"}.get(int(kind), "s")
                (point,) = ax.plot(x[at], values[at], marker, color=colour, markersize=5)
                ends.setdefault(int(kind), point)
    ax.set_xlim(x[0], x[-1])
    if data[axis].size > 2 and _is_log(x):
        ax.set_xscale("log")
    ax.set_xlabel(x_label)
    ax.set_ylabel(_words(observable, unit[0]))
    if state and len(names) == 1:
        ax.set_title(f"at {state}", loc="left")
    handles, labels = ax.get_legend_handles_labels()
    handles, labels = handles + list(ends.values()), labels + [status_words(s) for s in ends]
    if handles:
        ax.legend(handles, labels)


def _drawn(data: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(values of a quantity in the unit of people, NaN where nothing is drawn; why that is: a status, or NO_LIMIT)."""
    status, values = np.asarray(data[data[name].attrs["status"]]), np.asarray(data[name])
    status = np.where((status == Status.OK) & np.isinf(values), NO_LIMIT, status)
    return np.where(status == Status.OK, values, np.nan) / DISPLAY[data[name].attrs["kind"]][1], status


def _shade(ax: Axes, x: np.ndarray, status: np.ndarray) -> dict[int, Any]:
    """Hatched spans where nothing is drawn; returns what the legend names."""
    middles = _ends_of_cells(x)
    kinds = [s for s in HATCHES if np.any(status == s)]
    for kind in kinds:
        edges = np.diff(np.concatenate([[0], status == kind, [0]]).astype(int))
        for low, high in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            look = {"facecolor": HATCH_FACE, "edgecolor": HATCH_EDGE, "hatch": HATCHES[kind], "linewidth": 0.0}
            ax.axvspan(middles[low], middles[high], **look, zorder=0)
    return {s: _patch(s) for s in kinds}


def _ends_of_cells(x: np.ndarray) -> np.ndarray:
    """From the first number to the last: in the middle between two of them one cell ends and the next begins."""
    return np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])


def _map(data: xr.Dataset, name: str, axes: Sequence[str], ax: Axes) -> None:
    """One quantity over two numbers."""
    (x, x_label), (y, y_label) = _axis(data, axes[0]), _axis(data, axes[1])
    label = DISPLAY[data[name].attrs["kind"]][0]
    values, status = _drawn(data.transpose(axes[1], axes[0], ...), name)
    mesh = ax.pcolormesh(x, y, values, shading="nearest", cmap="viridis", rasterized=True)
    kinds = [s for s in HATCHES if np.any(status == s)]
    # The cells of the mesh, each with a value at both of its ends: a contour between them is where they meet.
    cells = np.repeat(_ends_of_cells(x), 2)[1:-1], np.repeat(_ends_of_cells(y), 2)[1:-1]
    for kind in kinds:
        lost = np.repeat(np.repeat(status == kind, 2, axis=0), 2, axis=1).astype(float)
        ax.contourf(*cells, lost, [0.5, 1.5], colors=[HATCH_FACE], zorder=2)
        with mpl.rc_context({"hatch.color": HATCH_EDGE, "hatch.linewidth": 0.6}):
            ax.contourf(*cells, lost, [0.5, 1.5], colors="none", hatches=[HATCHES[kind]], zorder=3)
    if np.any(np.isfinite(values)):
        bar = ax.figure.colorbar(mesh, ax=ax)
        bar.set_label(label or "", rotation=90)
    ax.set_xlim(x[0], x[-1])
    ax.set_ylim(y[0], y[-1])
    if _is_log(x):
        ax.set_xscale("log")
    if _is_log(y):
        ax.set_yscale("log")
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    ax.set_title(data[name].attrs["long_name"], loc="left", pad=18 if kinds else None)
    if kinds:
        ax.legend(
            [_patch(s) for s in kinds],
            [status_words(s) for s in kinds],
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=len(kinds),
            borderaxespad=0.1,
        )


NOTHING = 1e-6
"""Elasticities below this are the rounding of derivatives: a number that does not matter gets no bar."""


def _parallel(data: xr.Dataset, numbers: Sequence[str], names: Sequence[str]) -> Figure:
    """One axis for every varied number and, to the right, for every quantity; a line for every design, in the colour of
    its first quantity. Grey lines are designs that have no answer; of many designs some are drawn."""
    count = data.sizes[DESIGN]
    chosen = np.linspace(0, count - 1, min(count, LINES_DRAWN)).round().astype(int)
    # Evenly spaced rows of a grid would all have the same last number.
    if count > LINES_DRAWN:
        chosen = np.sort(np.random.default_rng(0).choice(count, LINES_DRAWN, replace=False))
    columns, labels = [], []
    for name in [*numbers, *names]:
        unit = DISPLAY[data[name].attrs["kind"]]
        columns.append(np.asarray(data[name], dtype=float)[chosen] / unit[1])
        labels.append(_stacked(data[name].attrs["long_name"] if name in names else tied_in(data, name), unit[0]))
    rows = np.stack(columns, axis=1)
    status = np.stack([np.asarray(data[data[name].attrs["status"]])[chosen] for name in names], axis=1)
    answered = np.all(status == Status.OK, axis=1) & ~np.any(np.isnan(rows), axis=1)
    spans = [_ends(column) for name, column in zip([*numbers, *names], rows.T, strict=True)]
    logs = [k < len(numbers) and _spread_by_factors(column) for k, column in enumerate(rows.T)]
    places = np.stack([_place(c, s, log) for c, s, log in zip(rows.T, spans, logs, strict=True)], axis=1)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(0.6 * WIDTH, 1.0 + 1.15 * rows.shape[1]), 3.6))
        ax = figure.subplots()
        steps = np.arange(rows.shape[1])
        for line in places[~answered]:
            shown = ~np.isnan(line)
            ax.plot(steps[shown], line[shown], color="#BBBBBB", linewidth=0.5, alpha=0.6, zorder=1)
        if answered.any():
            by = rows[:, len(numbers)]
            low, high = spans[len(numbers)]
            colours = mpl.colormaps["viridis"]((by[answered] - low) / (high - low))
            lines = LineCollection(
                [np.stack([steps, line], axis=1) for line in places[answered]],
                colors=colours,
                linewidths=0.7,
                alpha=0.75,
                zorder=2,
            )
            ax.add_collection(lines)
        endless = np.any(np.isinf(rows), axis=0)
        for step, (low, high), log in zip(steps, spans, logs, strict=True):
            ax.axvline(step, color="black", linewidth=0.8, zorder=3)
            for tick in [*np.linspace(0, 1, TICKS), *([ABOVE] if endless[step] else [])]:
                value = low * (high / low) ** tick if log else low + tick * (high - low)
                words = f"{value:.3g}" if tick <= 1 else status_words(NO_LIMIT)
                box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8}
                side = -1 if step == steps[-1] else 1
                where = {"ha": "right" if side < 0 else "left", "va": "center", "fontsize": 7}
                ax.plot([step, step + 0.03 * side], [tick, tick], color="black", linewidth=0.8, zorder=3)
                ax.text(step + 0.05 * side, tick, words, bbox=box, zorder=4, **where)
        ax.set(xlim=(-0.35, steps[-1] + 0.35), ylim=(-0.04, 0.04 + (ABOVE if endless.any() else 1.0)), yticks=[])
        ax.set_xticks(steps, labels)
        ax.tick_params(axis="x", length=0)
        ax.spines[:].set_visible(False)
        ax.set_title(_title_of(data, names[0], data.attrs.get("designs", count), len(chosen)), loc="left")
        kinds = [s for s in HATCHES if np.any(status == s)]
        if kinds:
            words = "grey: " + ", ".join(status_words(s) for s in kinds)
            ax.legend([Line2D([], [], color="#BBBBBB")], [words], loc="lower right", bbox_to_anchor=(1, 1))
    return figure


LINES_DRAWN = 400
"""Designs in a picture with parallel axes: more lines hide each other."""
TICKS = 5
"""Marks on each parallel axis."""
ABOVE = 1.1
"""Where lines cross an axis on which they have no limit: above its largest number."""
LONGEST = 14
"""Letters in a line under a parallel axis."""


def _title_of(data: xr.Dataset, name: str, count: int, drawn: int) -> str:
    designs = f"{count} designs" if drawn == count else f"{drawn} of {count} designs"
    return f"{designs}, coloured by {data[name].attrs['long_name']}"


def _stacked(words: str, unit: str) -> str:
    """A label in short lines: names of numbers break after a dot, quantities between words."""
    lines = [""]
    for part in words.replace(".", ". ").split():
        glue = "" if not lines[-1] or lines[-1].endswith(".") else " "
        if len(lines[-1]) + len(glue) + len(part) > LONGEST and lines[-1]:
            lines.append(part)
        else:
            lines[-1] += glue + part
    return "\n".join([*lines, f"({unit})"] if unit else lines)


def _ends(values: np.ndarray) -> tuple[float, float]:
    """What an axis shows: all finite values, and some room where they are one and the same."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    return (low, high) if high > low else (low - 0.5 * max(abs(low), 1.0), high + 0.5 * max(abs(high), 1.0))


def _place(values: np.ndarray, ends: tuple[float, float], log: bool) -> np.ndarray:
    """Where on its axis a value is, 0 to 1, and above that where there is no limit."""
    low, high = ends
    places = np.log(values / low) / np.log(high / low) if log else (values - low) / (high - low)
    return np.minimum(places, ABOVE)


def _spread_by_factors(values: np.ndarray) -> bool:
    """True for positive values over more than a decade whose middle is nearer to the geometric mean of the ends."""
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    return bool(low > 0 and high > 10 * low and middle < 0.5 * (np.sqrt(low * high) + 0.5 * (low + high)))


def elasticities(data: xr.Dataset) -> Figure:
    """Bars of the elasticities of a sensitivity analysis, the strongest number on top.

    Args:
        data: what `softgrip_jax.study.sensitivity` returns; elasticities are dimensionless.

    Examples:
        >>> import xarray as xr
        >>> coords = {"quantity": ["force"], "by": ["shell.a", "shell.t_m"]}
        >>> data = xr.Dataset({"elasticity": (("quantity", "by"), [[2.0, -1.0]])}, coords)
        >>> len(sg.plots.elasticities(data).axes)
        1
    """
    quantities = [str(v) for v in data["quantity"].values]
    numbers = [str(v) for v in data["by"].values]
    rows = -(-len(quantities) // 2)
    columns = min(len(quantities), 2)
    with mpl.rc_context(STYLE):
        height = rows * (0.18 * len(numbers) + 0.6) + 0.3
        figure = Figure(figsize=(WIDTH * (0.6 if columns == 1 else 1.0), height))
        grid = figure.subplots(rows, columns, squeeze=False)
        for ax, quantity in zip(grid.ravel(), quantities, strict=False):
            values = np.asarray(data["elasticity"].sel(quantity=quantity))
            values = np.where(np.abs(values) < NOTHING, 0.0, values)
            order = np.argsort(np.nan_to_num(np.abs(values)), kind="stable")
            colours = [BLUE if v >= 0 else VERMILION for v in values[order]]
            ax.barh([numbers[k] for k in order], np.nan_to_num(values[order]), color=colours, height=0.7)
            ax.axvline(0, color="black", linewidth=0.8)
            ax.margins(x=0.3)
            labels = ["-" if np.isnan(v) else f"{v:+.2f}" if v else "0" for v in values[order]]
            ax.bar_label(ax.containers[0], labels=labels, padding=2, fontsize=7)  # type: ignore[arg-type]
            if not np.nan_to_num(values).any():
                ax.set_xlim(-1, 1)  # nothing matters: an axis of its own choice would show a scale of nothing
            ax.set_title(quantity, loc="left")
        for ax in grid.ravel()[len(quantities) :]:
            ax.set_axis_off()
        for ax in grid.ravel()[max(0, len(quantities) - columns) : len(quantities)]:
            ax.set_xlabel("elasticity (% for 1 %)")
    return figure


def front(values: np.ndarray, labels: Sequence[str], kinds: Sequence[str], senses: Sequence[str]) -> Figure:
    """A trade-off between two or three goals; a third one is the colour.

    Args:
        values: in SI, shape (designs, goals).
        labels: of the goals.
        kinds: of the goals, keys of `units.DISPLAY`.
        senses: "minimise", "maximise" or "reach" of each goal.

    Examples:
        >>> values = np.array([[0.1, 20 * mm], [0.2, 30 * mm]])
        >>> figure = sg.plots.front(values, ["tip force", "length"], ["force", "length"], ["maximise", "minimise"])
        >>> figure.axes[0].get_xlabel().splitlines()[0]
        'tip force (N)'
    """
    units = [DISPLAY[kind] for kind in kinds]
    columns = [values[:, k] / unit for k, (_, unit) in enumerate(units)]
    better = {"minimise": "less", "maximise": "more", "reach": "nearer"}
    words = [
        f"{_words(label, unit)}\n{better[sense]} is better"
        for label, (unit, _), sense in zip(labels, units, senses, strict=True)
    ]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.6 * WIDTH, 3.0))
        ax = figure.subplots()
        if len(columns) == 2:
            ax.plot(*columns, "o-", color=BLUE, markersize=4, linewidth=1.0)
        else:
            dots = ax.scatter(columns[0], columns[1], c=columns[2], cmap="viridis", s=24)
            figure.colorbar(dots, ax=ax).set_label(words[2])
        ax.set_xlabel(words[0])
        ax.set_ylabel(words[1])
    return figure


def status_words(status: int) -> str:
    """A status as the legend names it, or NO_LIMIT."""
    return "no limit" if status == NO_LIMIT else Status(status).name.lower().replace("_", " ")


def _patch(status: int) -> Patch:
    return Patch(facecolor=HATCH_FACE, edgecolor=HATCH_EDGE, hatch=HATCHES[status], linewidth=0.4)


def _axis(data: xr.Dataset, name: str) -> tuple[np.ndarray, str]:
    label, unit = DISPLAY[data[name].attrs["kind"]]
    return np.asarray(data[name]) / unit, _words(tied_in(data, name), label)


def _words(name: str, unit: str) -> str:
    words = name.replace("_", " ") if "." not in name else name
    return f"{words} ({unit})" if unit else words


def _is_log(x: np.ndarray) -> bool:
    """True for values that are evenly spaced in their logarithm."""
    if len(x) < 3 or x[0] <= 0:
        return False
    ratios = x[1:] / x[:-1]
    return bool(np.ptp(ratios) < 1e-9 * ratios[0] and ratios[0] > 1 + 1e-6)
