"""Posteriors of parameters: a corner plot, and what draws predict over the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .figures import BLUE, BODY, GREEN, ORANGE, STYLE, VERMILION
from .fits import MARKS, Points, two_in_a_row

BINS = 40
SHOWN = 2000
"""Points of a cloud."""
PART = 1.7
"""Inches of one panel of a corner plot."""
SHADES = (BODY, GREEN, VERMILION, ORANGE)
INSIDE = [0.025, 0.975]


class Band(NamedTuple):
    """What the draws of a posterior say of one measured curve.

    Args:
        title: above the diagram.
        x_label, y_label: of the axes, with units.
        points: the measurements.
        x: in the unit of the axis, shape (n,).
        model: of the model alone, one row per draw, in the unit of y, shape (draws, n); NaN where it has no state.
        data: the same with model error and noise, in the unit of y, shape (draws, n).

    Examples:
        >>> x, model = np.array([5.0, 10.0]), np.ones((20, 2))
        >>> sg.plots.Band("force", "pressure (kPa)", "force (N)", [], x, model, model).title
        'force'
    """

    title: str
    x_label: str
    y_label: str
    points: Sequence[Points]
    x: np.ndarray
    model: np.ndarray
    data: np.ndarray


def corner(names: Sequence[str], draws: Any, prior: Any = None) -> Figure:
    """The draws of each parameter, and of each two.

    Args:
        names: of the parameters, with units.
        draws: one row per draw, in the units of the names, shape (draws, n).
        prior: draws of the prior, shown as a line beside those of each parameter, in the same units, shape (any, n).

    Examples:
        >>> draws = np.random.default_rng(0).normal(size=(200, 2))
        >>> len(sg.plots.corner(["mu (kPa)", "t_m (mm)"], draws).axes)
        4
    """
    draws = np.asarray(draws)
    n = draws.shape[1]
    some = draws[:: max(len(draws) // SHOWN, 1)]
    with mpl.rc_context(STYLE):
        side = max(PART * n, 3.4)
        figure = Figure(figsize=(side, side * (0.75 if n == 1 else 1.0)))
        axes = figure.subplots(n, n, squeeze=False)
        for i in range(n):
            for j in range(n):
                ax = axes[i, j]
                if j > i:
                    ax.set_visible(False)
                elif i == j:
                    _one(ax, draws[:, i], None if prior is None else np.asarray(prior)[:, i], i == 0)
                else:
                    ax.plot(some[:, j], some[:, i], ".", color=BLUE, markersize=1.5, alpha=0.3, rasterized=True)
                    ax.plot(np.median(draws[:, j]), np.median(draws[:, i]), "+", color=VERMILION, markersize=8)
                if i == n - 1:
                    ax.set_xlabel(names[j])
                else:
                    ax.set_xticklabels([])
                if j == 0 and i > 0:
                    ax.set_ylabel(names[i])
                elif j > 0:
                    ax.set_yticklabels([])
                ax.set_xlim(*_range(draws[:, j]))
                if i > j:
                    ax.set_ylim(*_range(draws[:, i]))
    return figure


def _range(values: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(values, [0.001, 0.999])
    return float(low - 0.05 * (high - low)), float(high + 0.05 * (high - low))


def _one(ax: Any, values: np.ndarray, prior: np.ndarray | None, with_legend: bool) -> None:
    bins = np.linspace(*_range(values), BINS + 1)
    ax.hist(values, bins, density=True, color=BLUE, alpha=0.5, label="posterior")
    if prior is not None:
        share = np.mean((prior >= bins[0]) & (prior <= bins[-1]))
        wide = np.linspace(bins[0], bins[-1], BINS // 4 + 1)
        heights, _ = np.histogram(prior, wide)
        height = heights / max(heights.sum(), 1) * share / np.diff(wide)
        ax.plot(0.5 * (wide[1:] + wide[:-1]), height, color=BODY, linewidth=1, label="prior")
    for end in np.quantile(values, INSIDE):
        ax.axvline(end, color=VERMILION, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_yticks([])
    if with_legend and prior is not None:
        ax.set_ylim(top=1.35 * ax.get_ylim()[1])
        ax.legend(loc="upper right", fontsize="x-small")


def predictive(bands: Sequence[Band]) -> Figure:
    """Measured curves, and the 95 % bands of what a posterior predicts.

    Args:
        bands: one diagram each, two in a row at most.

    Examples:
        >>> x, model = np.array([5.0, 10.0]), np.linspace(0.9, 1.1, 20)[:, None] * np.ones(2)
        >>> band = sg.plots.Band("force", "pressure (kPa)", "force (N)", [], x, model, model)
        >>> len(sg.plots.predictive([band]).axes)
        1
    """
    return two_in_a_row(bands, _band)


def _band(ax: Any, band: Band) -> None:
    known = np.mean(np.isfinite(band.model), axis=0) >= 0.5
    x = band.x[known]
    for rows, alpha, words in ((band.data, 0.15, "with model error and noise"), (band.model, 0.4, "the model")):
        low, high = np.nanquantile(rows[:, known], INSIDE, axis=0)
        ax.fill_between(x, low, high, color=BLUE, alpha=alpha, linewidth=0, label=f"95 %: {words}")
    ax.plot(x, np.nanmedian(band.model[:, known], axis=0), color=BLUE, label="median")
    for k, points in enumerate(band.points):
        mark = {"marker": MARKS[k % len(MARKS)], "markersize": 3.5, "linestyle": "none"}
        used = points.used
        ax.plot(points.x[used], points.y[used], label=points.label, color=SHADES[k % len(SHADES)], **mark)
        if not used.all():
            mark |= {"markerfacecolor": "none", "color": SHADES[k % len(SHADES)]}
            ax.plot(points.x[~used], points.y[~used], label="left out", **mark)
    ax.set_title(band.title, loc="left", fontweight="bold")
    ax.set_xlabel(band.x_label)
    ax.set_ylabel(band.y_label)
    ax.set_xlim(left=0)
    ax.legend(loc="best", fontsize="x-small")
