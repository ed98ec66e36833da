"""Fingers: the bent cover with its chambers, and a gripper around its object.

The cover is a band of thickness H along the deformed middle line. The chambers stand on its outer side, 2a high, with
walls t_m thick that thin as they stretch; each turns with the cover under its middle. Between two chambers is the plane
of contact, across the cover where their segments meet, and their walls bulge towards it as the model has them at this
pressure, from h_x in front of it on; they lean by the angle between the drawn chamber and the drawn plane, which is the
model's own for inclination = "segment". The first wall bulges as if such a plane were before it, where a mould leaves
cover up to the clamp, too: the model's drive is everywhere. The wall at the tip has no neighbour, the roof and the
floor do not inflate in the model: they stay straight. An object is drawn up to the line that
touches it: the faces of the covers, or their middle lines where the gripper's touch is "midline".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon, Rectangle

from ..geometry.finger import (
    POINTS,
    Inflated,
    Line,
    band,
    boxes,
    chamber_places,
    chambers_of,
    clamp_angle,
    line_of,
    object_outline,
    plate_radius,
    straight,
    touching_point,
)
from ..geometry.finger import inflated as inflated
from ..objects.grasped import HexagonalCylinder, ThreeFaceCone
from ..pneunet.finger import PneuNet
from ..pneunet.finger_scene import FingerScene
from ..pneunet.grasp import Grasp
from ..pneunet.linear import Linear
from ..results import Solution
from ..units import mm
from .figures import BLUE, BODY, OBJECT_EDGE, OBJECT_FACE, VERMILION, WIDTH, composes, paints, pressure_text

PALE, GREY = "#D3E4F1", "#B5B5B5"
"""The air in a chamber; a finger without pressure."""
ARROW, WITHIN = 14.0, 0.75
"""mm: length of the arrow of a force, whatever its size, which is written beside it; at most this part of the object's
radius."""
PLATE = 6.0
"""mm: thickness of the plate that carries the fingers."""

ROUND = 48
"""What is round is drawn by so many faces."""
SPACE_POINTS = 12
"""Points on a wall in space."""
LIGHT = np.array([0.3, 0.8, -0.5196])
"""From where light falls on a gripper in space: a unit vector, to the viewer's right."""

Where = Callable[[np.ndarray], np.ndarray]
"""Points (x, y) of a finger, shape (n, 2), to where they are in the picture."""


def paint_straight(ax: Axes, finger: PneuNet, line: Line, where: Where) -> None:
    """The grey outline of a finger without pressure."""
    outlines = [*boxes(line, finger, chamber_places(finger)), band(line, float(finger.H) / mm)]
    _fill(ax, [where(outline) for outline in outlines], facecolor="none", edgecolor=GREY, linewidth=0.6, zorder=1)


def _fill(ax: Axes, outlines: Sequence[np.ndarray], **look: Any) -> None:
    """Many outlines at once: the axes take a hundred patches in a second."""
    ax.add_collection(PolyCollection(outlines, **look))


def paint_finger(ax: Axes, finger: PneuNet, line: Line, chambers: Sequence[Inflated], where: Where) -> None:
    """A finger under pressure."""
    outer = [where(chamber.outline()) for chamber in chambers]
    _fill(ax, outer, facecolor=PALE, edgecolor="none", zorder=3)
    walls = [(where(wall), BLUE if chamber.place.fits else VERMILION) for chamber in chambers for wall in chamber.walls]
    _fill(ax, [wall for wall, _ in walls], facecolor=[colour for _, colour in walls], edgecolor="none", zorder=4)
    # A white line tells two walls apart that lie on each other.
    _fill(ax, outer, facecolor="none", edgecolor="white", linewidth=0.4, zorder=4.5)
    cover = band(line, float(finger.H) / mm)
    ax.add_patch(Polygon(where(cover), closed=True, facecolor=BLUE, edgecolor="white", linewidth=0.4, zorder=5))
    tight = [chamber.place for chamber in chambers if not chamber.place.fits]
    if tight:
        room = tight[0].fields["h_L"] / mm
        words = f"walls {tight[0].wall:.3g} mm thick do not fit\ninto chambers {room:.3g} mm long"
        ax.legend([Patch(facecolor=VERMILION)], [words], loc="lower right", bbox_to_anchor=(1, 1))


def as_is(points: np.ndarray) -> np.ndarray:
    """The picture in the coordinates of the finger."""
    return points


@paints(Linear, "along the finger, x (mm)", vertical="y (mm)")
@paints(FingerScene, "along the finger, x (mm)", vertical="y (mm)")
def _paint_scene(solution: Solution, axes: Sequence[Axes]) -> None:
    scene: Any = solution.scene
    (ax,) = axes
    finger, line = scene.finger, line_of(solution)
    angle = clamp_angle(scene)
    paint_straight(ax, finger, straight(finger, angle), as_is)
    paint_finger(ax, finger, line, chambers_of(solution, line), as_is)
    _paint_clamp(ax, finger, angle)
    if isinstance(scene, FingerScene) and scene.tip() is not None:
        _paint_force(ax, np.array([line["x"][-1], line["y"][-1]]), np.array([0.0, -1.0]), float(solution.tip_force))
    ax.autoscale_view()


def _paint_clamp(ax: Axes, finger: PneuNet, angle: float) -> None:
    """A hatched wall behind the finger, and its face."""
    highest = max((place.height for place in chamber_places(finger)), default=0.0)
    foot, top = -0.5 * float(finger.H) / mm - 4, highest + 6.5
    along, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    corners = [foot * normal, top * normal, top * normal - 4 * along, foot * normal - 4 * along]
    ax.add_patch(Polygon(corners, closed=True, facecolor="none", edgecolor=BODY, hatch="/////", linewidth=0, zorder=2))
    ax.plot(*np.array(corners[:2]).T, color=BODY, linewidth=1.5, zorder=6)


def _paint_force(
    ax: Axes, at: np.ndarray, direction: np.ndarray, force: float, label: bool = True, length: float = ARROW
) -> None:
    """A force at a point: an arrow that ends or starts there, with its value."""
    ahead = direction * (length if force >= 0 else -length)
    arrow = {"arrowstyle": "-|>", "color": VERMILION, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", at + ahead, at, arrowprops=arrow, zorder=8)
    ax.plot(*at, "o", color=VERMILION, markeredgecolor="white", markeredgewidth=0.6, markersize=5, zorder=9)
    end = at + 1.15 * ahead
    ax.plot(*end, alpha=0)  # the arrow's end counts for the limits of the axes
    if label:
        down = ahead[1] < 0
        ax.text(
            end[0],
            end[1],
            f"{abs(force):.3g} N",
            color=VERMILION,
            ha="center",
            va="top" if down else "bottom",
            zorder=9,
        )
        ax.plot(*(end + np.array([0.0, -6.0 if down else 6.0])), alpha=0)


# --- grippers ---------------------------------------------------------------------------------------------------------


@paints(Grasp, "distance from the axis (mm)", vertical="height (mm)")
def _paint_section(solution: Solution, axes: Sequence[Axes]) -> None:
    """Two fingers of the gripper, turned into one plane where none is opposite, and the object between them."""
    scene: Any = solution.scene
    (ax,) = axes
    finger, line = scene.finger, line_of(solution)
    base = float(scene.gripper.midline_radius()) / mm
    tip = touching_point(scene, line)
    chambers = chambers_of(solution, line)
    edge = np.array(object_outline(scene, tip))
    both = np.concatenate([edge, edge[::-1] * [-1, 1]])
    ax.add_patch(Polygon(both, closed=True, facecolor=OBJECT_FACE, edgecolor=OBJECT_EDGE, linewidth=1.0, zorder=0))
    ax.plot([0, 0], [6, both[:, 1].min() - 4], color=OBJECT_EDGE, linewidth=0.7, linestyle=(0, (8, 2, 1, 2)), zorder=2)
    for side in (1, -1):

        def where(points: np.ndarray, side=side) -> np.ndarray:
            return np.stack([side * (base + points[:, 1]), -points[:, 0]], axis=-1)

        paint_straight(ax, finger, straight(finger, 0.0), where)
        paint_finger(ax, finger, line, chambers, where)
        at = where(tip[None])[0]
        length = min(ARROW, WITHIN * (base + tip[1]))
        _paint_force(ax, at, np.array([-side, 0.0]), float(solution.tip_force), label=False, length=length)
    ax.text(
        0,
        both[:, 1].min() - 5,
        f"{float(solution.tip_force):.3g} N each",
        color=VERMILION,
        ha="center",
        va="top",
        zorder=9,
    )
    reach = plate_radius(scene)
    ax.add_patch(Rectangle((-reach, 0), 2 * reach, PLATE, facecolor=BODY, edgecolor="none", zorder=6))
    ax.autoscale_view()


def _faces_of_finger(
    finger: PneuNet, line: Line, chambers: Sequence[Inflated], base: float, around: float
) -> list[tuple[np.ndarray, str]]:
    """(corners in space, colour) of the cover in short pieces and of every chamber."""
    half = 0.5 * float(finger.B) / mm
    outward, sideways = np.array([np.cos(around), np.sin(around), 0.0]), np.array([-np.sin(around), np.cos(around), 0])

    def prism(section: np.ndarray, half: float, colour: str) -> list[tuple[np.ndarray, str]]:
        middle = (base + section[:, 1])[:, None] * outward - section[:, :1] * np.array([0.0, 0.0, 1.0])
        left, right = middle - half * sideways, middle + half * sideways
        count = len(section)
        sides = [np.array([left[k], left[(k + 1) % count], right[(k + 1) % count], right[k]]) for k in range(count)]
        return [(side, colour) for side in [*sides, left, right]]

    faces = []
    cover = band(line, float(finger.H) / mm)
    outer, inner = cover[:POINTS], cover[POINTS:][::-1]
    for k in range(0, POINTS - 1, 10):
        faces += prism(np.array([outer[k], outer[k + 10], inner[k + 10], inner[k]]), half, BLUE)
    for chamber in chambers:
        walls = [face[:: max(1, len(face) // SPACE_POINTS)] for face in (chamber.near_clamp, chamber.near_tip)]
        ends = chamber.near_clamp[-1:], chamber.near_tip[-1:]
        section = np.concatenate([walls[0], *ends, walls[1][::-1]])
        faces += prism(section, chamber.place.fields["b"] / mm, PALE)
    return faces


def _faces_around(
    outline: list[tuple[float, float]], corners: int = ROUND, colour: str = OBJECT_FACE
) -> list[tuple[np.ndarray, str]]:
    """Strips around the axis between the rings of the outline; finger 0 touches the middle of a flat face."""
    swell = 1 / np.cos(np.pi / corners)
    angles = (np.arange(corners + 1) + 0.5) * 2 * np.pi / corners
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * swell
    faces = []
    for (r0, z0), (r1, z1) in pairwise(outline):
        steps = np.linspace(0, 1, 9)
        for low, high in pairwise(steps):
            levels = [(r0 + (r1 - r0) * t, z0 + (z1 - z0) * t) for t in (low, high)]
            upper, lower = (np.column_stack([r * ring, np.full(corners + 1, z)]) for r, z in levels)
            faces += [(np.array([upper[k], upper[k + 1], lower[k + 1], lower[k]]), colour) for k in range(corners)]
    return faces


def _shaded(corners: np.ndarray, colour: str) -> np.ndarray:
    """The colour, darker the more a face turns away from the light."""
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    size = np.linalg.norm(normal)
    facing = abs(normal @ LIGHT) / size if size > 0 else 1.0
    return np.array(to_rgb(colour)) * (0.62 + 0.38 * facing)


@composes(Grasp)
def _compose_grasp(solution: Solution) -> Figure:
    """The section, and all fingers around the object in space."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    scene: Any = solution.scene
    line = line_of(solution)
    figure = Figure(figsize=(WIDTH, 0.62 * WIDTH))
    flat = figure.add_subplot(1, 2, 1)
    space: Any = figure.add_subplot(1, 2, 2, projection="3d")
    _paint_section(solution, [flat])
    flat.set_aspect("equal")
    flat.set_xlabel("distance from the axis (mm)")
    flat.set_ylabel("height (mm)")
    flat.set_title(pressure_text(solution), loc="left", fontweight="bold")

    base, tip = float(scene.gripper.midline_radius()) / mm, touching_point(scene, line)
    corners = {HexagonalCylinder: 6, ThreeFaceCone: 3}.get(type(scene.object), ROUND)
    faces = _faces_around(object_outline(scene, tip), corners)
    reach = plate_radius(scene)
    faces += _faces_around([(0.0, PLATE), (reach, PLATE), (reach, 0.0), (0.0, 0.0)], colour=BODY)
    chambers = chambers_of(solution, line)
    for k in range(scene.gripper.n):
        faces += _faces_of_finger(scene.finger, line, chambers, base, 2 * np.pi * k / scene.gripper.n)
    colours = [_shaded(corners, colour) for corners, colour in faces]
    space.add_collection3d(
        Poly3DCollection([corners for corners, _ in faces], facecolors=colours, edgecolors=colours, linewidths=0.3)
    )
    points = np.concatenate([corners for corners, _ in faces])
    low, high = points.min(axis=0), points.max(axis=0)
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low, zoom=1.15)
    space.view_init(elev=-14, azim=65)
    space.set_axis_off()
    return figure
