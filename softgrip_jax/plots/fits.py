"""Measured curves beside what was fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .figures import BLUE, BODY, GREEN, ORANGE, STYLE, VERMILION, WIDTH

MARKS = "osD^vP*X<>"
"""Of specimens, in their order."""

LINES = ("-", (0, (5, 2)), (0, (1, 1)), (0, (5, 2, 1, 2)), (0, (3, 1, 1, 1, 1, 1)))
"""Of several fitted lines."""


class Points(NamedTuple):
    """Measured points, in the units of the axes."""

    label: str
    x: np.ndarray
    y: np.ndarray
    used: np.ndarray
    """False for points that were left out."""


class Line(NamedTuple):
    """A fitted curve and the half width of its interval (NaN: none), in the units of the axes."""

    label: str
    x: np.ndarray
    y: np.ndarray
    half: np.ndarray


class Panel(NamedTuple):
    """One diagram."""

    title: str
    x_label: str
    y_label: str
    points: Sequence[Points]
    lines: Sequence[Line]


def measured_and_fitted(panels: Sequence[Panel]) -> Figure:
    """Data, fit and its 95 % interval, one diagram per curve, three in a row at most."""
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(WIDTH * columns / 3, 0.55 * WIDTH), 2.6 * rows))
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        for ax, panel in zip(axes, panels, strict=False):
            _draw(ax, panel)
    return figure


def _draw(ax, panel: Panel) -> None:
    colours = (BLUE, ORANGE, GREEN, VERMILION, BODY)
    for k, line in enumerate(panel.lines):
        colour, style = colours[k % len(colours)], LINES[k % len(LINES)]
        if np.isfinite(line.half).any():
            ax.fill_between(line.x, line.y - line.half, line.y + line.half, color=colour, alpha=0.25, linewidth=0)
        ax.plot(line.x, line.y, color=colour, linestyle=style, label=line.label, zorder=3)
    left_out = False
    for k, points in enumerate(panel.points):
        small = 2.0 if len(points.x) > 60 else 3.5
        mark = {"marker": MARKS[k % len(MARKS)], "markersize": small, "linestyle": "none", "color": BODY}
        ax.plot(points.x[points.used], points.y[points.used], label=points.label, alpha=0.7, **mark)
        if not points.used.all():
            mark |= {"markerfacecolor": "none"}
            out = ~points.used
            ax.plot(points.x[out], points.y[out], label=None if left_out else "left out", alpha=0.5, **mark)
            left_out = True
    ax.set_title(panel.title, loc="left", fontweight="bold")
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)
    ax.set_xlim(left=0)
    ax.legend(loc="best")
