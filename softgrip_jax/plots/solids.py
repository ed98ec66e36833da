"""Pictures of solids: shaded surfaces and the edges that nothing hides."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

LIGHT = np.array([-0.25, -0.55, 0.8])
"""Where the light comes from."""
COLOURS = ((0.52, 0.70, 0.86), (0.90, 0.71, 0.48), (0.64, 0.79, 0.58), (0.82, 0.66, 0.80), (0.74, 0.74, 0.74))
PIXELS = 520
"""Width of the picture of one solid."""


def solids_figure(solids: Sequence[tuple[str, Any, Any]], title: str = "") -> Figure:
    """A row of solids, each to its own scale: (name, (vertices, triangles), edges as lines of points), mm."""
    figure = Figure(figsize=(4.0 * len(solids), 3.6), layout="constrained")
    axes = figure.subplots(1, len(solids), squeeze=False)[0]
    for place, (ax, (name, (vertices, triangles), lines)) in enumerate(zip(axes, solids, strict=True)):
        points = np.asarray(vertices, dtype=float)
        ax.imshow(rendered(points, np.asarray(triangles, dtype=int), lines, COLOURS[place % len(COLOURS)]))
        ax.set_axis_off()
        size = " x ".join(f"{length:.4g}" for length in np.ptp(points, axis=0))
        ax.set_title(f"{name}\n{size} mm", fontsize=10)
    if title:
        figure.suptitle(title, fontweight="bold")
    return figure


def rendered(
    points: np.ndarray,
    triangles: np.ndarray,
    lines: Any,
    colour: Sequence[float],
    azimuth: float = -55,
    height: float = 35,
) -> np.ndarray:
    """A parallel projection, seen from `azimuth` and `height` above the horizon (degrees): every pixel shows the
    nearest triangle."""
    turn, rise = np.deg2rad(azimuth), np.deg2rad(height)
    towards = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    view = np.stack([right, np.cross(towards, right), towards])
    flat = points @ view.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = (PIXELS - 20) / max(high[0] - low[0], high[1] - low[1])
    rows = int((high[1] - low[1]) * scale) + 20

    def pixels(at: np.ndarray) -> np.ndarray:
        placed = (at - low) * scale
        return np.stack([placed[:, 0] + 10, rows - 10 - placed[:, 1], placed[:, 2]], axis=1)

    depth = np.full((rows, PIXELS), -np.inf)
    picture = np.ones((rows, PIXELS, 3))
    seen = pixels(flat)
    for one in triangles:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = seen[one]
        normal = np.cross(points[one[1]] - points[one[0]], points[one[2]] - points[one[0]])
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-9:
            continue
        x0, x1 = int(min(ax, bx, cx)), int(max(ax, bx, cx)) + 2
        y0, y1 = int(min(ay, by, cy)), int(max(ay, by, cy)) + 2
        x, y = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
        u = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        v = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        z = az + u * (bz - az) + v * (cz - az)
        window = (slice(y0, y1), slice(x0, x1))
        nearer = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (z > depth[window])
        shade = 0.5 + 0.5 * max(0.0, float(normal @ LIGHT) / max(float(np.linalg.norm(normal)), 1e-12))
        depth[window][nearer] = z[nearer]
        picture[window][nearer] = shade * np.asarray(colour)
    for line in lines:
        at = pixels(np.asarray(line) @ view.T)
        for start, end in pairwise(at):
            steps = max(2, int(2 * np.max(np.abs(end - start)[:2])))
            x, y, z = (start + np.linspace(0, 1, steps)[:, None] * (end - start)).T
            x, y = np.round(x).astype(int), np.round(y).astype(int)
            around = np.max([depth[y + k, x + j] for k in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)
            open_to_view = z >= np.minimum(around, depth[y, x] + 1.5) - 3.0
            picture[y[open_to_view], x[open_to_view]] = 0.15
    return picture
