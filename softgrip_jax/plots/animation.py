"""A scene while its pressure rises, as a GIF."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import matplotlib as mpl
import numpy as np
from jaxtyping import Array, Float
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..errors import InputError
from ..questions import path
from ..results import Solution, Status
from ..scene import Scene
from .figures import STYLE, WIDTH, look, pressure_text

POINTS = 301
"""Points on a shape; the painters interpolate between them."""
DOTS_PER_INCH = 110
FRAMES_PER_SECOND = 12
MARGIN = 0.04
"""So much of a view's width is left for words beside what is drawn."""
HOLD = 12
"""Frames that the last state stays: one second."""


class Still(Solution):
    """One state of a curve with its shape, which was computed for all states at once."""

    stored: dict[str, Array]

    def shape(self, n: int = POINTS) -> dict[str, Array]:
        return self.stored


def stills(scene: Scene, pressures: Float[np.ndarray, " n"]) -> list[Still]:
    """The states of a scene at pressures (Pa), without those that have none."""
    states = path(scene, pressures)
    good = np.flatnonzero(np.asarray(states.status) == Status.OK)
    if good.size == 0:
        status = Status(int(states.status[0]))
        raise InputError(f"There is no state to draw at any of the {len(pressures)} pressures: {status.message}.")
    kept = jax.tree.map(lambda x: x[good], states)
    has_shape = type(scene).profile is not Scene.profile
    shapes = jax.jit(lambda solution: solution.shape(POINTS))(kept) if has_shape else {}
    # The batch has one scene per state or one for all; a still needs its own.
    single = [jax.tree.map(lambda x, k=k: x[k], (kept, shapes)) for k in range(good.size)]
    names = [field.name for field in dataclasses.fields(Solution)]
    return [Still(**{name: getattr(one, name) for name in names}, stored=shape) for one, shape in single]


def animate(
    scene: Scene, pressures: Any, file: str | Path, report: Callable[[int, int], None] = lambda k, n: None
) -> Path:
    """Write a GIF of the scene at rising pressures, on one scale.

    States that do not exist are left out.

    Args:
        scene: what to show.
        pressures: Pa, shape (n,).
        file: to write.
        report: called with (frames drawn, frames) after each.

    Returns:
        The file.

    Raises:
        InputError: where there is no state at any of the pressures.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.plots.animate(sg.shell.Free(shell), np.array([5, 15, 25]) * kPa, "shell.gif").name
        'shell.gif'
    """
    file = Path(file)
    states = stills(scene, np.asarray(pressures, dtype=float))
    painter = look(states[-1])
    settings = STYLE | {"savefig.bbox": "standard", "figure.constrained_layout.use": False}
    with mpl.rc_context(settings):
        limits = _limits([_painted(state) for state in states])
        figure, axes = _figure(limits, painter.views, painter.vertical)
        writer = PillowWriter(fps=FRAMES_PER_SECOND)
        with writer.saving(figure, str(file), DOTS_PER_INCH):
            for k, state in enumerate(states):
                for ax in axes:
                    ax.clear()
                painter.paint(state, axes)
                for ax, (x, y), view in zip(axes, limits, painter.views, strict=True):
                    ax.set(xlim=x, ylim=y, xlabel=view, aspect="equal")
                    ax.tick_params(labelleft=ax is axes[0])
                axes[0].set_ylabel(painter.vertical)
                axes[0].set_title(pressure_text(state), loc="left", fontweight="bold")
                for _ in range(HOLD if k == len(states) - 1 else 1):
                    writer.grab_frame()
                report(k + 1, len(states))
    return file


def _painted(state: Still) -> list[Axes]:
    """The views of a state on axes of their own."""
    painter = look(state)
    axes = list(Figure().subplots(1, len(painter.views), squeeze=False)[0])
    painter.paint(state, axes)
    for ax in axes:
        ax.set_aspect("equal")
    return axes


def _limits(drawn: Sequence[Sequence[Axes]]) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The limits of each view that hold all of what was drawn; one height for all views."""
    low = min(ax.get_ylim()[0] for axes in drawn for ax in axes)
    high = max(ax.get_ylim()[1] for axes in drawn for ax in axes)
    limits = []
    for axes in zip(*drawn, strict=True):
        first, last = min(ax.get_xlim()[0] for ax in axes), max(ax.get_xlim()[1] for ax in axes)
        limits.append(((first - MARGIN * (last - first), last + MARGIN * (last - first)), (low, high)))
    return limits


def _figure(limits: Sequence, views: Sequence[str], vertical: str) -> tuple[Figure, list[Axes]]:
    """Axes on one scale, as wide as what they show."""
    spans = [x[1] - x[0] for x, _ in limits]
    height = limits[0][1][1] - limits[0][1][0]
    width = WIDTH if len(views) > 1 else 0.6 * WIDTH
    figure = Figure(figsize=(width, 0.82 * width * height / sum(spans) + 0.9))
    axes = figure.subplots(1, len(views), squeeze=False, width_ratios=spans)[0]
    size = figure.get_size_inches()
    edges = {"left": 0.65 / size[0], "right": 1 - 0.12 / size[0], "bottom": 0.5 / size[1], "top": 1 - 0.3 / size[1]}
    figure.subplots_adjust(**edges, wspace=0.1)
    return figure, list(axes)
