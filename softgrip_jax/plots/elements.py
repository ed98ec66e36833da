"""A shape by finite elements with those of our models over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ..results import Solution
from ..units import mm
from .chamber import wall_outline
from .figures import BLUE, BODY, OBJECT_EDGE, OBJECT_FACE, ORANGE, STYLE, VERMILION, WIDTH

MODEL_LINES = (VERMILION, ORANGE, BODY)


def elements_and_models(
    views: Sequence[str],
    solids: Sequence[np.ndarray],
    models: Mapping[str, Sequence[np.ndarray | None]],
    objects: Sequence[Sequence[np.ndarray]] = (),
    title: str = "",
) -> Figure:
    """Sections through a solid as surfaces, and what models say as lines over them.

    Args:
        views: labels of the horizontal axes, with units, one for each section.
        solids: closed outline of the solid in each view, m, shape (points, 2).
        models: name -> line in each view, m, shape (points, 2), or None where it says nothing there.
        objects: closed outlines of rigid things in each view, m.
        title: above all.

    Returns:
        The figure, lengths in mm.

    Examples:
        >>> outline = 1e-3 * np.array([[0, 0], [10, 0], [10, 1], [0, 1]])
        >>> figure = sg.plots.elements.elements_and_models(["x (mm)"], [outline], {"ours": [outline[:2]]})
        >>> figure.get_axes()[0].get_xlabel()
        'x (mm)'
    """
    with mpl.rc_context(STYLE):
        height = 0.6 + WIDTH * max(
            (np.ptp(one[:, 1]) + 6 * mm) / sum(np.ptp(other[:, 0]) + 12 * mm for other in solids) for one in solids
        )
        widths = [float(np.ptp(one[:, 0])) + 12 * mm for one in solids]
        figure = Figure(figsize=(WIDTH, height + 0.7))
        axes = np.atleast_1d(figure.subplots(1, len(views), width_ratios=widths, sharey=True))
        for k, (ax, view, solid) in enumerate(zip(axes, views, solids, strict=True)):
            low, high = solid.min(axis=0) / mm - 6, solid.max(axis=0) / mm + 6
            for thing in objects[k] if objects else ():
                ax.add_patch(Polygon(thing / mm, closed=True, facecolor=OBJECT_FACE, edgecolor=OBJECT_EDGE, zorder=0))
            look: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.45, "edgecolor": BLUE, "linewidth": 0.6}
            ax.add_patch(Polygon(solid / mm, closed=True, label="finite elements", zorder=2, **look))
            for (name, lines), colour in zip(models.items(), MODEL_LINES, strict=False):
                line = lines[k]
                if line is not None:
                    dashes = "-" if colour == VERMILION else "--"
                    ax.plot(*(line.T / mm), dashes, color=colour, linewidth=1.3, label=name, zorder=3)
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=view, aspect="equal")
        axes[0].set_ylabel("z (mm)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), title=title or None)
        return figure


def cells_and_walls(
    cells: Sequence[tuple[str, Sequence[np.ndarray], np.ndarray, Solution | None]], title: str
) -> Figure:
    """Sections through the middle of a finger's cell, and the wall of the thesis's chamber over each.

    Args:
        cells: (words above, outlines of the elements, two points of the plane in the gap, the chamber's state or None);
            x along the finger and y up, m, shapes (points, 2) and (2, 2).
        title: above all.

    Returns:
        The figure, lengths in mm.

    Examples:
        >>> box = 1e-3 * np.array([[0, 0], [2, 0], [2, 5], [0, 5]])
        >>> plane = 1e-3 * np.array([[3, 0], [3, 5]])
        >>> figure = sg.plots.elements.cells_and_walls([("straight", [box], plane, None)], "")
        >>> len(figure.get_axes())
        1
    """
    with mpl.rc_context(STYLE):
        everything = [np.concatenate([*outlines, plane]) / mm for _, outlines, plane, _ in cells]
        low, high = (pick([pick(points, axis=0) for points in everything], axis=0) for pick in (np.min, np.max))
        size = high - low + 1.0
        figure = Figure(figsize=(WIDTH, min(1.2 + WIDTH / len(cells) / size[0] * size[1], 6.0)))
        axes = np.atleast_1d(figure.subplots(1, len(cells), sharey=True, sharex=True))
        look: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.35, "edgecolor": BLUE, "linewidth": 0.4}
        for ax, (words, outlines, plane, wall) in zip(axes, cells, strict=True):
            for place, outline in enumerate(outlines):
                ax.add_patch(
                    Polygon(outline / mm, closed=True, label=None if place else "finite elements", zorder=2, **look)
                )
            ax.plot(*(plane.T / mm), color=BODY, linewidth=0.8, linestyle=(0, (8, 2, 1, 2)), zorder=1)
            if wall is not None:
                ax.plot(*_wall(wall).T, color=VERMILION, linewidth=1.3, label="thesis's wall", zorder=3)
            ax.set(title=words, aspect="equal", xlabel="x (mm)", xlim=(low[0], high[0] + 0.5), ylim=(low[1], high[1]))
        axes[0].set_ylabel("y (mm)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), title=title or None)
        return figure


def _wall(solution: Solution) -> np.ndarray:
    """The outer face of the thesis's wall in the frame of the cell, mm: its foot stays where it is at rest."""
    scene: Any = solution.scene
    finger, lean = scene.finger, float(scene.inclination)
    line = wall_outline(scene, float(solution.clamp_angle))
    n, t = np.array([np.cos(lean), -np.sin(lean)]), np.array([np.sin(lean), np.cos(lean)])
    foot = np.array([0.5 * float(finger.h_L), 0.5 * float(finger.H)]) / mm
    return foot + (line[:1, :1] - line[:, :1]) * n + (line[:, 1:] - line[:1, 1:]) * t
