"""Two neighbouring chambers across their gap, seen from the side: the walls that press on each other, and the force.

The plane of contact is the mirror between the walls, so the picture is drawn in its frame: each wall leans away from
it by the inclination theta_s. The cover, whose side is the nearer one as long as the finger bends forwards, is below.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from ..geometry.walls import ARC_POINTS, pressed_outline, wall_behind
from ..pneunet.wall.arc import Chamber
from ..results import Solution
from ..units import mm
from .figures import BLUE, BODY, VERMILION, paints
from .finger import GREY, PALE

UNLOADED, TOUCHING = "without pressure", "when they begin to touch"


def wall_outline(scene: Any, angle: float) -> np.ndarray:
    """A wall at theta_m2: (distance from the plane, height) in mm from its nearer edge on."""
    near, lean = (float(v) for v in scene.nearer_edge())
    return pressed_outline(float(scene.finger.a), near, lean, angle) / mm


@paints(Chamber, "along the finger, from the plane of contact (mm)", vertical="height of the wall (mm)")
def _paint(solution: Solution, axes: Sequence[Axes]) -> None:
    scene: Any = solution.scene
    (ax,) = axes
    finger = scene.finger
    depth = float(finger.h_L) / mm
    # What the walls are at this pressure, and where they begin to touch.
    now, begin = (wall_outline(scene, float(angle)) for angle in (solution.clamp_angle, scene.interval()[0]))
    span = now[-1, 1]
    closing = float(scene.inclination) < 0
    edges = np.stack([now[0], now[-1]])
    along = (edges[1] - edges[0]) / np.linalg.norm(edges[1] - edges[0])
    back = depth * np.array([along[1], -along[0]])

    def placed(points: np.ndarray, side: int) -> np.ndarray:
        height = span - points[:, 1] if closing else points[:, 1]
        return np.stack([side * points[:, 0], height], axis=-1)

    for side in (-1, 1):
        room = np.concatenate([now, [edges[1] + back, edges[0] + back]])
        ax.add_patch(Polygon(placed(room, side), closed=True, facecolor=PALE, edgecolor="none", zorder=1))
        for edge in edges:
            ax.plot(*placed(np.stack([edge, edge + back]), side).T, color=BODY, linewidth=2.5, zorder=2)
        ax.plot(*placed(edges, side).T, color=GREY, linewidth=1.0, zorder=3, label=UNLOADED if side > 0 else None)
        dots = {"color": BLUE, "linewidth": 0.9, "linestyle": (0, (2, 2)), "zorder": 4}
        ax.plot(*placed(begin, side).T, label=TOUCHING if side > 0 else None, **dots)
        # The face is what the model knows; the wall behind it thins as it stretches.
        wall = wall_behind(now, float(finger.t_m) / mm / float(solution.stretch) ** 2)
        ax.add_patch(Polygon(placed(wall, side), closed=True, facecolor=BLUE, alpha=0.55, edgecolor="none", zorder=3))
        ax.plot(*placed(now, side).T, color=BLUE, linewidth=2, solid_capstyle="round", zorder=5)
    middle = placed(now[[ARC_POINTS - 1, ARC_POINTS]], 1)[:, 1].mean()
    reach = float(np.max(np.abs(room[:, 0])))
    arrow = {"arrowstyle": "-|>", "color": VERMILION, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    for side in (-1, 1):
        ax.annotate("", (0, middle), (side * 0.55 * reach, middle), arrowprops=arrow, zorder=8)
    words = f"{float(solution.force):.3g} N"
    ax.text(0.6 * reach, middle, words, color=VERMILION, ha="left", va="center", zorder=9)
    ax.plot([0, 0], [-0.08 * span, 1.08 * span], color=BODY, linewidth=0.7, linestyle=(0, (8, 2, 1, 2)), zorder=6)
    ax.autoscale_view()
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.1, handlelength=1.6)
