"""Shells: the membrane along its length and across its width, and what it touches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from ..geometry.walls import thick
from ..results import Solution
from ..shell.arc.cylinder import AxialOffset, CylinderContact
from ..shell.arc.flat import FlatContact
from ..shell.arc.grasp import Grasp
from ..shell.arc.inclined import InclinedContact
from ..shell.flat_shell import ShellScene
from ..units import mm
from .figures import BLUE, BODY, OBJECT_EDGE, OBJECT_FACE, paints

RIM = 4.0
"""mm of the rigid shell that a picture shows around and under the membrane."""

FACE = 0.8
"""Width in points of the line along the outer face of a membrane: without it a thin one would not be seen."""

POINTS = 301
"""Points on a membrane: a corner of its profile is off by less than a line's width."""


@paints(ShellScene, "along the length, y (mm)", "across the width, x (mm)")
def _paint_shell(solution: Solution, axes: Sequence[Axes]) -> None:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    _paint_section(axes[0], solution, "length", shape["y"], shape["z_length"])
    _paint_section(axes[1], solution, "width", shape["x"], shape["z"])


def thickness_of(solution: Solution) -> float:
    """Of the stretched membrane, mm: its material keeps its volume, t_m / (lambda_1 lambda_2)."""
    scene: Any = solution.scene
    return float(scene.shell.t_m) / mm / float(np.prod([float(x) for x in scene.stretches(solution.unknowns)]))


def _paint_section(ax: Axes, solution: Solution, view: str, s: np.ndarray, z: np.ndarray) -> None:
    scene: Any = solution.scene
    half = float(scene.shell.b if view == "length" else scene.shell.a) / mm
    _paint_surroundings(scene, solution, ax, view, half, s, z)
    # The rigid shell holds the edges of the membrane; the dashes are where it lies without pressure.
    body = {"facecolor": BODY, "edgecolor": "none", "zorder": 1}
    ax.add_patch(Rectangle((-half - RIM, -RIM), 2 * (half + RIM), RIM, **body))
    ax.plot([-half, half], [0, 0], color="white", linewidth=1, linestyle=(0, (4, 3)), zorder=2)
    # The model's surface is the one that touches: the membrane is drawn below it, as thick as its stretches leave it.
    sheet = thick(np.stack([s, z], axis=-1), thickness_of(solution))
    ax.add_patch(Polygon(sheet, closed=True, facecolor=BLUE, edgecolor="none", zorder=3))
    ax.plot(s, z, color=BLUE, linewidth=FACE, solid_capstyle="round", zorder=4)
    ax.plot([-half, half], [0, 0], "s", color="black", markersize=3.5, zorder=5)


def _paint_surroundings(scene, solution, ax, view, half, s, z) -> None:
    """What the membrane touches: a plane as a slab, a cylinder as its section."""
    look = {"facecolor": OBJECT_FACE, "edgecolor": OBJECT_EDGE, "linewidth": 1.0, "zorder": 0}
    slab = 2 * RIM
    if isinstance(scene, FlatContact):
        ax.add_patch(Rectangle((-half - RIM, float(scene.distance) / mm), 2 * (half + RIM), slab, **look))
    elif isinstance(scene, InclinedContact) and view == "width":
        lean = float(scene.angle)
        along, normal = np.array([np.cos(lean), -np.sin(lean)]), np.array([np.sin(lean), np.cos(lean)])
        middle = np.max(s * normal[0] + z * normal[1]) * normal
        reach = 1.3 * half
        corners = [middle - reach * along, middle + reach * along]
        ax.add_patch(Polygon([*corners, corners[1] + slab * normal, corners[0] + slab * normal], closed=True, **look))
    elif isinstance(scene, CylinderContact | AxialOffset | Grasp):
        radius, gap = float(scene.radius) / mm, float(scene.gap) / mm
        if view == "length":
            ax.add_patch(Circle((half - _axis_height(solution), gap + radius), radius, **look))
        else:
            ax.add_patch(Rectangle((-half - RIM, gap), 2 * (half + RIM), 2 * radius, **look))


def _axis_height(solution: Solution) -> float:
    """Distance (mm) of the cylinder's axis from the near end of the membrane: b where the state is symmetric."""
    scene: Any = solution.scene
    height = solution.observables.get("height", getattr(scene, "height", scene.shell.b))
    return float(height) / mm


@paints(InclinedContact, "across the width, x (mm)")
def _paint_inclined(solution: Solution, axes: Sequence[Axes]) -> None:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    _paint_section(axes[0], solution, "width", shape["x"], shape["z"])
