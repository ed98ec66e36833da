"""Curves of several states side by side, with printed or measured points on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ..results import Solution, Status
from ..units import DISPLAY, kPa
from .figures import BLUE, BODY, GREEN, ORANGE, STYLE, VERMILION, WIDTH

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, BODY)
LINES = ("-", (0, (5, 2)), (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (3, 1, 1, 1, 1, 1)))


class Curve(NamedTuple):
    """A line in a diagram.

    Args:
        label: for the legend, or empty.
        x, y: in the units of the axes, shape (n,); NaN where there is no state.

    Examples:
        >>> sg.plots.Curve("ours", np.array([5.0, 10.0]), np.array([1.0, 2.0])).label
        'ours'
    """

    label: str
    x: np.ndarray
    y: np.ndarray


class Diagram(NamedTuple):
    """One pair of axes with its lines and points.

    Args:
        title: above it.
        x_label, y_label: of the axes, with units.
        curves: the lines.
        marks: published points.

    Examples:
        >>> line = sg.plots.Curve("ours", np.array([5.0, 10.0]), np.array([1.0, 2.0]))
        >>> sg.plots.Diagram("force", "pressure (kPa)", "force (N)", [line]).marks
        ()
    """

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    marks: Sequence[Curve] = ()


def diagrams(panels: Sequence[Diagram], columns: int = 2) -> Figure:
    """A figure of diagrams, whose lines differ in colour and in dashes.

    Args:
        panels: the diagrams.
        columns: diagrams in a row.

    Examples:
        >>> line = sg.plots.Curve("ours", np.array([5.0, 10.0]), np.array([1.0, 2.0]))
        >>> len(sg.plots.diagrams([sg.plots.Diagram("force", "pressure (kPa)", "force (N)", [line])]).axes)
        1
    """
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH if columns > 1 else 0.6 * WIDTH, 2.3 * rows + 0.2))
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        for ax, panel in zip(axes, panels, strict=False):
            for k, curve in enumerate(panel.curves):
                style = {"color": COLOURS[k % len(COLOURS)], "linestyle": LINES[k % len(LINES)]}
                # A state alone between states that are none would not show as a line.
                lonely = {"marker": "o", "markersize": 3} if len(curve.x) < 10 else {}
                ax.plot(curve.x, curve.y, label=curve.label or None, **style, **lonely)
            for mark in panel.marks:
                ax.plot(mark.x, mark.y, "D", color="black", markersize=4.5, label=mark.label or None, zorder=5)
            ax.set(xlabel=panel.x_label, ylabel=panel.y_label)
            ax.set_title(panel.title, loc="left", fontweight="bold")
            if ax.get_legend_handles_labels()[0]:
                ax.legend(handlelength=2.6)
    return figure


def curve_of(curve: Solution, observable: str, limit: float | None = None) -> Figure:
    """An observable over the pressure along a batch of states, with gaps where there is none.

    Where the pressure falls along the curve (`sg.branch` behind the limit) the states are unstable at a given pressure:
    the line is dashed.

    Args:
        curve: the batch, in the order of the curve.
        observable: its name.
        limit: the limit pressure, Pa, to be marked where it is on the curve.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> states = sg.path(sg.shell.Free(shell), [5 * kPa, 15 * kPa, 25 * kPa])
        >>> sg.plots.curve_of(states, "inflation").axes[0].get_ylabel()
        'inflation (mm)'
    """
    label, unit = DISPLAY[type(curve.scene).OBSERVABLES[observable]]
    good = np.asarray(curve.status) == Status.OK
    x = np.where(good, np.asarray(curve.pressure) / kPa, np.nan)
    y = np.where(good, np.asarray(curve.observables[observable]) / unit, np.nan)
    words = observable.replace("_", " ")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.6 * WIDTH, 2.7))
        ax = figure.subplots()
        unstable = np.diff(x) < 0
        for piece, falls in _pieces(unstable):
            style = {"linestyle": UNSTABLE} if falls else {"marker": "o" if good.sum() < 10 else None, "markersize": 3}
            ax.plot(x[piece], y[piece], color=BLUE, label=BEHIND if falls else None, **style)
        if limit is not None and good.any():
            top = int(np.nanargmax(x))
            if np.isclose(x[top], limit / kPa, rtol=AT_LIMIT):
                words_of_limit = f"limit {limit / kPa:.4g} kPa"
                ax.plot(x[top], y[top], "o", color=VERMILION, markersize=5, zorder=5, label=words_of_limit)
        ax.set(xlabel="pressure (kPa)", ylabel=f"{words} ({label})" if label else words)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="best", handlelength=2.2)
    return figure


UNSTABLE, BEHIND = (0, (3, 2)), "unstable at a given pressure"
AT_LIMIT = 1e-3
"""A state that is so near to the limit pressure, relative to it, is marked as the limit: within a line's width."""


def _pieces(falls: np.ndarray) -> list[tuple[slice, bool]]:
    """Runs of steps that fall, or do not, as slices of points: neighbours share one."""
    turns = np.flatnonzero(np.diff(falls)) + 1
    starts, ends = [0, *turns], [*turns, len(falls)]
    return [(slice(a, b + 1), bool(falls[a]) if len(falls) else False) for a, b in zip(starts, ends, strict=True)]
