"""Measured curves beside what was fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .figures import BLUE, BODY, GREEN, ORANGE, STYLE, VERMILION, WIDTH

MARKS = "osD^vP*X<>"
"""Marks of the specimens, in their order."""

LINES = ("-", (0, (5, 2)), (0, (1, 1)), (0, (5, 2, 1, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (8, 3)))
SKY = "#56B4E9"
"""Colour of the last of several fitted lines."""


HEADROOM, FOOTROOM = 0.5, 0.1
"""A line is shown above and below the data by these parts of their range."""


class Points(NamedTuple):
    """Measured points in a diagram.

    Args:
        label: for the legend.
        x, y: in the units of the axes, shape (n,).
        used: False for points that were left out, shape (n,).

    Examples:
        >>> x = np.array([5.0, 10.0])
        >>> sg.plots.Points("measured", x, 0.1 * x, np.array([True, True])).label
        'measured'
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    used: np.ndarray


class Line(NamedTuple):
    """A fitted curve in a diagram, with its interval.

    Args:
        label: for the legend.
        x, y: in the units of the axes, shape (n,).
        half: half width of the interval, in the unit of y, shape (n,); NaN for none.

    Examples:
        >>> x = np.array([5.0, 10.0])
        >>> sg.plots.Line("fitted", x, 0.1 * x, 0.01 * x).label
        'fitted'
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    half: np.ndarray


class Panel(NamedTuple):
    """One diagram of measured points and fitted lines.

    Args:
        title: above it.
        x_label, y_label: of the axes, with units.
        points: the measurements.
        lines: the fits.

    Examples:
        >>> sg.plots.Panel("force", "pressure (kPa)", "force (N)", [], []).title
        'force'
    """

    title: str
    x_label: str
    y_label: str
    points: Sequence[Points]
    lines: Sequence[Line]


def measured_and_fitted(panels: Sequence[Panel]) -> Figure:
    """Data, fit and its 95 % interval, one diagram per curve.

    Args:
        panels: the diagrams, two in a row at most.

    Examples:
        >>> x = np.array([5.0, 10.0])
        >>> measured = sg.plots.Points("measured", x, 0.1 * x, np.array([True, True]))
        >>> fitted = sg.plots.Line("fitted", x, 0.1 * x, 0.01 * x)
        >>> panel = sg.plots.Panel("force", "pressure (kPa)", "force (N)", [measured], [fitted])
        >>> len(sg.plots.measured_and_fitted([panel]).axes)
        1
    """
    return two_in_a_row(panels, _draw)


def two_in_a_row(panels: Sequence[Any], draw: Callable[[Any, Any], None]) -> Figure:
    """A figure of diagrams, each drawn by draw(axes, panel)."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * (1.0 if columns > 1 else 0.6), 2.9 * rows))
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        for ax, panel in zip(axes, panels, strict=False):
            draw(ax, panel)
    return figure


def _draw(ax, panel: Panel) -> None:
    colours = (BLUE, ORANGE, GREEN, VERMILION, BODY, SKY)
    for k, line in enumerate(panel.lines):
        colour, style = colours[k % len(colours)], LINES[k % len(LINES)]
        if np.isfinite(line.half).any():
            ax.fill_between(line.x, line.y - line.half, line.y + line.half, color=colour, alpha=0.25, linewidth=0)
        ax.plot(line.x, line.y, color=colour, linestyle=style, label=line.label, zorder=3)
    left_out = False
    shades = (BODY, GREEN, VERMILION, ORANGE) if len(panel.lines) == 1 else (BODY,)
    for k, points in enumerate(panel.points):
        small = 2.0 if len(points.x) > 60 else 3.5
        colour = shades[k % len(shades)]
        mark = {"marker": MARKS[k % len(MARKS)], "markersize": small, "linestyle": "none", "color": colour}
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
    # A line may leave the data behind (a material that locks): the data set the scale. Down to zero it is shown.
    shown = panel.points or panel.lines
    measured = np.concatenate([one.y for one in shown])
    low = min(measured.min() - FOOTROOM * np.ptp(measured), 0.0)
    high = measured.max() + HEADROOM * np.ptp(measured)
    if high > low:
        ax.set_ylim(max(ax.get_ylim()[0], low), min(ax.get_ylim()[1], high))
    ax.legend(loc="best")
