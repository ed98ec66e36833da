"""Designs whose parts scatter, side by side: what the parts do, how many of them are good, what a yield costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..units import DISPLAY
from .figures import BLUE, GREEN, ORANGE, STYLE, VERMILION, WIDTH

BINS = 60
SHOWN = (0.002, 0.998)
"""Parts of a histogram: the few farthest ones would make all others narrow."""
HEIGHT = 2.7
"""Inches."""


class Cast(NamedTuple):
    """The parts of one design.

    Args:
        values: of the goal in SI, one per part; NaN where a part has no equilibrium.
        broken: the worst scaled violation of each part, dimensionless; positive where it fails, -inf where it has
            nothing to keep. Where that is so of every part the picture has no panel of them.
        nominal: the goal of the design itself, SI.

    Examples:
        >>> sg.plots.Cast(np.array([1.0, 1.1]), np.array([-0.1, 0.2]), 1.05).nominal
        1.05
    """

    values: np.ndarray
    broken: np.ndarray
    nominal: float


def robust(
    casts: Mapping[str, Cast],
    label: str,
    kind: str,
    front: Sequence[tuple[float, float]] = (),
    prices: Mapping[str, float] | None = None,
) -> Figure:
    """Designs side by side, with all their parts.

    Args:
        casts: the parts of each design, by its name.
        label: of the goal.
        kind: of the goal, a key of `units.DISPLAY`.
        front: (yield, dimensionless; goal, SI) of best designs.
        prices: what the goal gains where the tolerance of a number alone is halved, dimensionless, by the number.

    Examples:
        >>> parts = np.linspace(0.9, 1.1, 50)
        >>> casts = {"best": sg.plots.Cast(parts, parts - 1, 1.0)}
        >>> len(sg.plots.robust(casts, "tip force", "force").axes)
        2
    """
    unit, factor = DISPLAY[kind]
    words = f"{label} ({unit})" if unit else label
    has_edge = bool(np.any(np.isfinite(_broken(casts))))
    panels = 1 + has_edge + bool(front) + bool(prices)
    rows, columns = (2, 2) if panels == 4 else (1, panels)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * (1.3 if columns == 3 else 1), HEIGHT * rows))
        axes = list(np.ravel(figure.subplots(rows, columns)))
        _goal(axes[0], casts, words, factor)
        rest = axes[1:]
        if has_edge:
            _edge(rest.pop(0), casts)
        if front:
            _front(rest.pop(0), front, casts, words, factor)
        if prices:
            _prices(rest.pop(0), prices)
    return figure


def _goal(ax: Axes, casts: Mapping[str, Cast], words: str, factor: float) -> None:
    known = [cast.values[np.isfinite(cast.values)] / factor for cast in casts.values()]
    both = np.concatenate(known)
    low, high = np.quantile(both, SHOWN)
    bins = np.linspace(low, high, BINS)
    for (name, cast), values, colour in zip(casts.items(), known, (VERMILION, BLUE, GREEN), strict=False):
        ax.hist(values, bins, histtype="stepfilled", color=colour, alpha=0.35)
        ax.axvline(cast.nominal / factor, color=colour, linewidth=1.2, label=f"{name}, as drawn")
    ax.set_xlabel(words)
    ax.set_ylabel("parts")
    ax.set_ylim(top=1.35 * ax.get_ylim()[1])
    ax.legend(loc="upper left", frameon=True, edgecolor="none")


def _broken(casts: Mapping[str, Cast]) -> np.ndarray:
    return np.concatenate([cast.broken for cast in casts.values()])


def _edge(ax: Axes, casts: Mapping[str, Cast]) -> None:
    known = _broken(casts)
    ends = np.quantile(known[np.isfinite(known)], SHOWN)
    for (name, cast), colour in zip(casts.items(), (VERMILION, BLUE, GREEN), strict=False):
        room = np.sort(-cast.broken)
        share = np.mean(cast.broken <= 0)
        ax.plot(room, 1 - np.arange(len(room)) / len(room), color=colour, label=f"{name}: yield {share:.1%}")
    ax.axvline(0, color="#4D4D4D", linewidth=0.8)
    if ends[1] > ends[0]:
        ax.set_xlim(-ends[1], -ends[0])
    ax.set_ylim(0, 1.3)
    ax.set_yticks(np.linspace(0, 1, 5))
    ax.set_xlabel("room to the worst requirement (scaled)\nparts left of 0 fail")
    ax.set_ylabel("share of parts with more room")
    ax.legend(loc="upper right", frameon=True, edgecolor="none")


def _front(
    ax: Axes, front: Sequence[tuple[float, float]], casts: Mapping[str, Cast], words: str, factor: float
) -> None:
    shares, goals = np.array(front).T
    ax.plot(100 * shares, goals / factor, "o-", color="#4D4D4D", markersize=4, linewidth=1.0, label="robust designs")
    for (name, cast), colour in zip(casts.items(), (VERMILION, BLUE, GREEN), strict=False):
        ax.plot(100 * np.mean(cast.broken <= 0), cast.nominal / factor, "D", color=colour, markersize=6, label=name)
    ax.set_xlabel("yield (% of the parts)")
    ax.set_ylabel(words)
    ax.legend(loc="lower left")


def _prices(ax: Axes, prices: Mapping[str, float]) -> None:
    names = sorted(prices, key=lambda name: prices[name])
    ax.barh(range(len(names)), [100 * prices[name] for name in names], color=ORANGE, height=0.6)
    ax.set_yticks(range(len(names)), names)
    ax.axvline(0, color="#4D4D4D", linewidth=0.8)
    ax.set_xlabel("goal gained where this\ntolerance alone is halved,\nat the same yield (%)")
