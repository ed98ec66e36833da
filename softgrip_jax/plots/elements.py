"""A shape by finite elements with those of our models over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ..units import mm
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
        figure = Figure(figsize=(WIDTH, height + 1.0))
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
