"""Pictures of solids: shaded triangles and the edges between faces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

LIGHT = np.array([0.35, -0.55, 0.76])
"""Where the light comes from."""
COLOURS = ("#8fb8de", "#e3b47c", "#a8c79a", "#cfa6c8", "#b8b8b8", "#d9d08a")


def solids_figure(solids: Sequence[tuple[str, Any, Any]], title: str = "", elevation: float = 28.0) -> Figure:
    """A row of solids, each to its own scale: (name, (vertices, triangles), edges as lines of points), lengths in mm."""
    figure = Figure(figsize=(4.2 * len(solids), 4.0), layout="constrained")
    for place, (name, (vertices, triangles), lines) in enumerate(solids):
        ax: Any = figure.add_subplot(1, len(solids), place + 1, projection="3d")
        points = np.asarray(vertices, dtype=float)
        corners = points[np.asarray(triangles, dtype=int)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        shade = 0.55 + 0.45 * np.clip(normals @ LIGHT, 0, 1)
        base = np.array([int(COLOURS[place % len(COLOURS)][k : k + 2], 16) / 255 for k in (1, 3, 5)])
        ax.add_collection3d(Poly3DCollection(corners, facecolors=base * shade[:, None], linewidths=0))
        ax.add_collection3d(Line3DCollection([np.asarray(line) for line in lines], colors="#333333", linewidths=0.5))
        low, high = points.min(axis=0), points.max(axis=0)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        ax.set_box_aspect(high - low)
        ax.view_init(elev=elevation, azim=-60)
        ax.set_axis_off()
        size = " x ".join(f"{length:.4g}" for length in high - low)
        ax.set_title(f"{name}\n{size} mm", fontsize=10)
    if title:
        figure.suptitle(title, fontweight="bold")
    return figure
