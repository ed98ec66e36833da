"""Where the parts of a finger are in its plane: the bent cover, its chambers with their walls, and what it touches.

Lengths in mm, x along the unloaded finger from the clamp, y away from the side that the chambers stand on.
"""

from __future__ import annotations

import dataclasses
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..objects.grasped import Taper
from ..pneunet.finger import SEGMENT_FIELDS, PneuNet
from ..pneunet.finger_scene import FingerScene
from ..pneunet.linear import Linear
from ..pneunet.wall.small_strain import SmallStrainChamber, small_strain_inflation
from ..results import Solution
from ..units import mm
from .walls import TOUCHES, outlines, small_strain_outline, thick, wall_behind, walls_at

POINTS = 201
"""Points along a finger: a chord is off the line by less than 0.01 mm."""
Line = dict[str, np.ndarray]


def line_of(solution: Solution) -> Line:
    """The deformed middle line: X, x, y in mm, theta in rad."""
    shape = {name: np.asarray(value) for name, value in solution.shape(POINTS).items()}
    return {"theta": shape["theta"]} | {name: shape[name] / mm for name in ("X", "x", "y")}


def straight(finger: PneuNet, angle: float) -> Line:
    """The middle line without any load."""
    along = np.linspace(0.0, float(finger.L) / mm, POINTS)
    turned = np.full(POINTS, angle)
    return {"X": along, "x": along * np.cos(angle), "y": along * np.sin(angle), "theta": turned}


def clamp_angle(scene: Any) -> float:
    """The direction in which a finger leaves its clamp, rad."""
    return float(scene.clamp()) if isinstance(scene, FingerScene) else 0.0


def band(line: Line, thickness: float) -> np.ndarray:
    """The outline of the cover."""
    middle = np.stack([line["x"], line["y"]], axis=-1)
    normal = np.stack([-np.sin(line["theta"]), np.cos(line["theta"])], axis=-1)
    return np.concatenate([middle + 0.5 * thickness * normal, (middle - 0.5 * thickness * normal)[::-1]])


class Place(NamedTuple):
    """A chamber on a finger without pressure, mm along the middle line, and its own numbers."""

    begin: float
    """The plane that its first wall presses on."""
    first: float
    last: float
    end: float
    """The plane that its last wall presses on."""
    fields: dict[str, float]
    """Its a, b, h_x, t_m, h_L, m."""
    has_neighbour: bool = True
    """Whether another chamber follows: the last wall at the tip presses on nothing."""

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
        """Whether the chamber has room between its walls."""
        return self.fields["h_L"] > 2 * self.fields["t_m"]


def chamber_places(finger: PneuNet) -> list[Place]:
    """Every chamber: whole ones in the middle of their segment, as a mould has them; one that is squeezed fills it. A
    uniform finger is one segment."""
    lengths = np.asarray(finger.segment_lengths) / mm
    counts = np.maximum(np.asarray(finger.whole_chambers).astype(int), 1)
    pitches = np.minimum(np.broadcast_to(finger.pitch / mm, counts.shape), lengths)
    before = np.cumsum(lengths) - lengths + 0.5 * (lengths - counts * pitches)
    each = zip(before, pitches, counts, strict=True)
    starts = np.concatenate([at + pitch * np.arange(count) for at, pitch, count in each])
    pitches = np.repeat(pitches, counts)
    numbers = {name: np.broadcast_to(getattr(finger, name), counts.shape) for name in SEGMENT_FIELDS}
    fields = {name: np.repeat(values, counts) for name, values in numbers.items()}
    gaps = pitches * fields["h_x"] / (2 * fields["h_x"] + fields["h_L"])
    firsts, lasts, ends = starts + gaps, starts + pitches - gaps, starts + pitches
    places = zip(starts.tolist(), firsts.tolist(), lasts.tolist(), ends.tolist(), strict=True)
    each = zip(*(values.tolist() for values in fields.values()), strict=True)
    every = [Place(*at, dict(zip(fields, own, strict=True))) for at, own in zip(places, each, strict=True)]
    return [place._replace(has_neighbour=number < len(every)) for number, place in enumerate(every, 1)]


def boxes(line: Line, finger: PneuNet, places: list[Place]) -> np.ndarray:
    """The corners of chambers without pressure, standing on the cover, shape (chambers, 4, 2)."""
    numbers = [(0.5 * (p.first + p.last), 0.5 * (p.last - p.first), p.height) for p in places]
    at, half, height = np.reshape(numbers, (-1, 3)).T
    origin, along, normal = (v[:, None] for v in _frame(line, at, 0.5 * float(finger.H) / mm))
    s, z = (np.outer(size, signs)[..., None] for size, signs in ((half, [-1, 1, 1, -1]), (height, [0, 0, 1, 1])))
    return origin + s * along + z * normal


def _frame(line: Line, at: float | np.ndarray, above: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A point `above` the middle line, mm, and the directions along the finger and away from the cover there."""
    x, y, theta = (np.interp(at, line["X"], line[name]) for name in ("x", "y", "theta"))
    along = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    normal = np.stack([-np.sin(theta), np.cos(theta)], axis=-1)
    return np.stack([x, y], axis=-1) + above * normal, along, normal


class Inflated(NamedTuple):
    """A chamber under pressure: the outer faces of its walls from the cover upwards, and the walls behind them and the
    roof between them, mm."""

    place: Place
    near_clamp: np.ndarray
    near_tip: np.ndarray
    walls: list[np.ndarray]
    """The roof is the last."""
    presses: tuple[np.ndarray, np.ndarray]
    """Which points of its two faces lie on the planes between it and its neighbours."""

    def outline(self) -> np.ndarray:
        return np.concatenate([self.near_clamp, self.near_tip[::-1]])


def has_small_strain_walls(scene: Any) -> bool:
    """Whether the walls of a scene's chambers are plates of small strain."""
    return isinstance(scene, SmallStrainChamber | Linear) or getattr(scene, "drive", None) == "small_strain"


def inflated(scene: Any, line: Line, pressure: float) -> list[Inflated]:
    """The chambers of a finger at a pressure (Pa)."""
    finger = scene.finger
    places, foot = chamber_places(finger), 0.5 * float(finger.H) / mm
    if not places:
        return []
    theta = np.interp([(p.begin, 0.5 * (p.first + p.last), p.end) for p in places], line["X"], line["theta"])
    # Two walls for every chamber: towards the clamp, towards the tip. Chambers that bend forwards open.
    leans = np.stack([theta[:, 0] - theta[:, 1], theta[:, 1] - theta[:, 2]], axis=1).ravel()
    fields = {name: np.repeat([p.fields[name] for p in places], 2) for name in SEGMENT_FIELDS}
    if has_small_strain_walls(scene):
        inflation = _small_strain_inflations(fields, finger, jnp.asarray(pressure))
        faces, stretch = small_strain_outline(fields["a"], fields["h_x"], np.asarray(inflation), leans), 1.0
    else:
        walls = walls_at(finger, leans, pressure, fields)
        faces, stretch = outlines(walls, fields["a"], leans), walls.stretch
    behind = wall_behind(faces, fields["t_m"] / stretch**2)
    presses = faces[..., 0] < TOUCHES * fields["t_m"][:, None]
    origin, along, normal = (
        v[:, None] for v in _frame(line, np.array([(p.begin, p.end) for p in places]).ravel(), foot)
    )
    away = along * np.tile([1.0, -1.0], len(places))[:, None, None]
    faces, bodies = (origin + p[..., :1] / mm * away + p[..., 1:] / mm * normal for p in (faces, behind))
    chambers = []
    for k, place in enumerate(places):
        near_clamp, near_tip, body = faces[2 * k], faces[2 * k + 1], bodies[2 * k + 1]
        touching = presses[2 * k], presses[2 * k + 1]
        if not place.has_neighbour:
            middle, ahead, upwards = _frame(line, 0.5 * (place.first + place.last), foot)
            corner = middle + 0.5 * (place.last - place.first) * ahead
            near_tip = corner + np.linspace(0.0, place.height, 2)[:, None] * upwards
            body, touching = thick(near_tip, place.wall, -1.0), (touching[0], np.zeros(2, bool))
        chambers.append(Inflated(place, near_clamp, near_tip, [bodies[2 * k], body], touching))
    tops = np.array([[chamber.near_clamp[-1], chamber.near_tip[-1]] for chamber in chambers])
    for chamber, roof in zip(chambers, thick(tops, np.array([[p.wall] for p in places])), strict=True):
        chamber.walls.append(roof)
    return chambers


@partial(jax.vmap, in_axes=(0, None, None))
def _small_strain_inflations(fields: dict[str, Any], finger: PneuNet, pressure: Any) -> Any:
    return small_strain_inflation(dataclasses.replace(finger, **fields), pressure)


def contacts(chambers: list[Inflated]) -> list[np.ndarray]:
    """For every chamber but the first: which points of its face towards the clamp touch the chamber before: where both
    press on the plane between them."""
    return [chamber.presses[0] & before.presses[1].any() for before, chamber in pairwise(chambers)]


def chambers_of(solution: Solution, line: Line) -> list[Inflated]:
    """The chambers of a solved finger."""
    return inflated(solution.scene, line, float(solution.pressure))


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
