"""Where the parts of a finger are in its plane: the bent cover, its chambers with their walls, and what it touches.

Lengths in mm, x along the unloaded finger from the clamp, y away from the side that the chambers stand on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..objects.grasped import Taper
from ..pneunet.finger import SEGMENT_FIELDS, PneuNet
from ..pneunet.linear import Linear
from ..pneunet.wall.small_strain import SmallStrainChamber
from ..results import Solution
from ..units import mm
from .walls import outline, small_strain_outline, thick, wall_behind, walls_at

POINTS = 201
"""Points along a finger: a chord is off the line by less than 0.01 mm."""
Line = dict[str, np.ndarray]
NOTHING = 1e-9
"""mm: a chamber that the end of the finger cuts to less is none."""


def line_of(solution: Solution) -> Line:
    """The deformed middle line: X, x, y in mm, theta in rad."""
    shape = {name: np.asarray(value) for name, value in solution.shape(POINTS).items()}
    return {"theta": shape["theta"]} | {name: shape[name] / mm for name in ("X", "x", "y")}


def straight(finger: PneuNet, angle: float) -> Line:
    """The middle line without any load."""
    along = np.linspace(0.0, float(finger.L) / mm, POINTS)
    turned = np.full(POINTS, angle)
    return {"X": along, "x": along * np.cos(angle), "y": along * np.sin(angle), "theta": turned}


def band(line: Line, thickness: float) -> np.ndarray:
    """The outline of the cover."""
    middle = np.stack([line["x"], line["y"]], axis=-1)
    normal = np.stack([-np.sin(line["theta"]), np.cos(line["theta"])], axis=-1)
    return np.concatenate([middle + 0.5 * thickness * normal, (middle - 0.5 * thickness * normal)[::-1]])


class Place(NamedTuple):
    """A chamber on a finger without pressure, mm along the middle line, and its own numbers."""

    begin: float
    """Where its segment begins, and so the plane that its first wall presses on."""
    first: float
    last: float
    end: float
    """Where its segment ends, or the finger."""
    fields: dict[str, float]
    """Its a, b, h_x, t_m, h_L, m."""

    @property
    def height(self) -> float:
        """mm."""
        return 2 * self.fields["a"] / mm

    @property
    def wall(self) -> float:
        """mm."""
        return self.fields["t_m"] / mm

    @property
    def fits(self) -> bool:
        """Whether the chamber, where the end of the finger does not cut it, has room between its walls."""
        return self.fields["h_L"] > 2 * self.fields["t_m"]

    @property
    def has_neighbour(self) -> bool:
        """Whether another chamber follows: the wall at the tip presses on nothing."""
        return self.last < self.end - NOTHING


def chamber_places(finger: PneuNet) -> list[Place]:
    """Every chamber; the last one of a uniform finger may be cut by its end."""
    length = float(finger.L) / mm
    if finger.segments is None:
        pitch = float(finger.pitch) / mm
        starts = np.arange(0.0, length - NOTHING, pitch)
        pitches = np.full(starts.shape, pitch)
    else:
        pitches = np.asarray(finger.segment_lengths) / mm
        starts = np.cumsum(pitches) - pitches
    fields = {name: np.broadcast_to(np.asarray(getattr(finger, name)), starts.shape) for name in SEGMENT_FIELDS}
    places = []
    for k, (start, pitch) in enumerate(zip(starts.tolist(), pitches.tolist(), strict=True)):
        own = {name: float(values[k]) for name, values in fields.items()}
        gap = pitch * own["h_x"] / (2 * own["h_x"] + own["h_L"])
        first, last = start + gap, min(start + pitch - gap, length)
        if last - first > NOTHING:
            places.append(Place(start, first, last, min(start + pitch, length), own))
    return places


def box(line: Line, finger: PneuNet, place: Place) -> np.ndarray:
    """The corners of a chamber without pressure, standing on the cover."""
    at, half, foot = 0.5 * (place.first + place.last), 0.5 * (place.last - place.first), 0.5 * float(finger.H) / mm
    origin, along, normal = _frame(line, at, foot)
    corners = [(-half, 0.0), (half, 0.0), (half, place.height), (-half, place.height)]
    return np.array([origin + s * along + z * normal for s, z in corners])


def _frame(line: Line, at: float, above: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A point `above` the middle line, mm, and the directions along the finger and away from the cover there."""
    x, y, theta = (np.interp(at, line["X"], line[name]) for name in ("x", "y", "theta"))
    along, normal = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
    return np.array([x, y]) + above * normal, along, normal


class Inflated(NamedTuple):
    """A chamber under pressure: the outer faces of its walls from the cover upwards, and the walls behind them, mm."""

    near_clamp: np.ndarray
    near_tip: np.ndarray
    walls: list[np.ndarray]

    def outline(self) -> np.ndarray:
        return np.concatenate([self.near_clamp, self.near_tip[::-1]])


def inflated(scene: Any, line: Line, pressure: float, inflation: float | None = None) -> list[Inflated]:
    """The chambers of a finger at a pressure (Pa); inflation (m): of its small-strain walls, where it has such."""
    finger = scene.finger
    places, foot = chamber_places(finger), 0.5 * float(finger.H) / mm
    if not places:
        return []
    theta = np.interp([(p.begin, 0.5 * (p.first + p.last), p.end) for p in places], line["X"], line["theta"])
    # Two walls for every chamber: towards the clamp, towards the tip. Chambers that bend forwards open.
    leans = np.stack([theta[:, 0] - theta[:, 1], theta[:, 1] - theta[:, 2]], axis=1).ravel()
    fields = {name: np.repeat([p.fields[name] for p in places], 2) for name in SEGMENT_FIELDS}
    walls = walls_at(finger, leans, pressure, fields) if inflation is None else None
    chambers = []
    for k, place in enumerate(places):
        faces, bodies = [], []
        for side, at in enumerate((place.begin, place.end)):
            wall, lean, a = 2 * k + side, float(leans[2 * k + side]), place.fields["a"]
            if side == 1 and not place.has_neighbour:
                middle, along, normal = _frame(line, 0.5 * (place.first + place.last), foot)
                corner = middle + 0.5 * (place.last - place.first) * along
                face = corner + np.linspace(0.0, place.height, 2)[:, None] * normal
                body = thick(face, place.wall, -1.0)
            else:
                if walls is None:
                    points, stretch = small_strain_outline(scene, float(inflation or 0.0), lean), 1.0
                else:
                    points, stretch = outline(walls, wall, a, lean), float(walls.stretch[wall])
                origin, along, normal = _frame(line, at, foot)
                away = along if side == 0 else -along
                behind = wall_behind(points, place.fields["t_m"] / stretch**2)
                face, body = (origin + p[:, :1] / mm * away + p[:, 1:] / mm * normal for p in (points, behind))
            faces.append(face)
            bodies.append(body)
        chambers.append(Inflated(faces[0], faces[1], bodies))
    return chambers


def chambers_of(solution: Solution, line: Line) -> list[Inflated]:
    """The chambers of a solved finger."""
    scene: Any = solution.scene
    small = isinstance(scene, SmallStrainChamber | Linear)
    inflation = float(scene.finger.a * np.tan(float(solution.unknowns))) if small else None
    return inflated(scene, line, float(solution.pressure), inflation)


def touching_point(scene: Any, line: Line) -> np.ndarray:
    """(x, y) of the point of a finger that touches the object, mm: the end of its face, or of its middle line."""
    depth, theta = float(scene.gripper.touching_depth()) / mm, line["theta"][-1]
    return np.array([line["x"][-1] + depth * np.sin(theta), line["y"][-1] - depth * np.cos(theta)])


def plate_radius(scene: Any) -> float:
    """Of the plate that carries the fingers, mm: their clamped ends are on it."""
    finger = scene.finger
    base = float(scene.gripper.midline_radius()) / mm
    return base + 0.5 * float(finger.H) / mm + max((place.height for place in chamber_places(finger)), default=0.0) + 3


def object_outline(scene: Any, tip: np.ndarray) -> list[tuple[float, float]]:
    """(radius, height) from top to bottom of the object's face, mm; `tip` is where a finger touches it.

    The height of a cylinder is no part of the model: it is drawn one diameter high.
    """
    held, radius = scene.object, float(scene.gripper.midline_radius()) / mm + tip[1]
    if isinstance(held, Taper):
        wide, high = float(held.base_radius()) / mm, float(held.height) / mm
        foot = -tip[0] - high * (1 - radius / wide)
        return [(0.0, foot + high), (wide, foot), (0.0, foot)]
    return [(0.0, -tip[0] + radius), (radius, -tip[0] + radius), (radius, -tip[0] - radius), (0.0, -tip[0] - radius)]
