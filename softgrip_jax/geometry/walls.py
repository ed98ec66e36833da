"""The walls of chambers as the model has them at a pressure, in the frame of the plane that they press on.

The plane of contact is the mirror between two neighbours. In its frame a point is (distance from the plane, height
above the cover), in m. At rest a wall is straight, h_x from the plane on the cover; a chamber that has turned away from
the plane by theta_s leans by as much. The faces that are drawn are the outer ones, which touch.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..membrane import angle_over_sine, first_contact_angle, tensions
from ..pneunet.finger import SEGMENT_FIELDS, PneuNet
from ..pneunet.linear import Linear
from ..pneunet.wall.arc import Chamber
from ..pneunet.wall.small_strain import SmallStrainChamber

ARC_POINTS = 60
"""Points on each arc of a wall."""
GRID = 1024
"""Angles among which the one of a pressure is interpolated: right to a few hundred-thousandths."""
INNER_POINTS = 41
"""Points on the inner face of a wall."""
FLAT = 1e-12
"""m: a wall that is so near to its plane from edge to edge cannot bulge."""


class Walls(NamedTuple):
    """Several walls at one pressure; angle is theta_m2 of those that touch, half the turn of a free arc of others."""

    near: np.ndarray
    """Distance of the plane from the wall's nearer edge, m; negative where the wall would be behind the plane."""
    lean: np.ndarray
    """Inclination of the wall away from its nearer edge, rad."""
    angle: np.ndarray
    touches: np.ndarray
    stretch: np.ndarray


@jax.jit
def _sampled(fields: dict[str, Array], finger: PneuNet, inclination: Float[Array, " n"]) -> tuple[Any, Any, Any]:
    """Of every wall: (near edge, lean); (theta_m2, pressure, contact width, stretch) of walls on the plane; and
    (angle, pressure, stretch) of free ones up to where they would touch, each on a grid of angles."""

    def one(fields, inclination):
        chamber = Chamber(dataclasses.replace(finger, **fields), inclination)
        f, (near, lean) = chamber.finger, chamber.nearer_edge()
        share = jnp.linspace(0.0, 1.0, GRID)
        low, end = chamber.search_interval()
        angles = low + (end - low) * share

        def pressed(angle):
            wall = chamber.wall(angle)
            return angle, wall.pressure, wall.contact_width, wall.stretch

        reach = first_contact_angle(jnp.maximum(near, 0.0) / f.a, lean)
        free = reach * share
        stretch = jax.vmap(angle_over_sine)(free)
        tension = jax.vmap(lambda x: tensions(f.material, f.t_m, x, x)[0])(stretch)
        loads = 2 * tension * jnp.sin(free) / f.a  # (4.7) with R = a / sin(theta)
        return (near, lean), jax.vmap(pressed)(angles), (free, loads, stretch)

    return jax.vmap(one)(fields, inclination)


def first_reached(x: np.ndarray, y: np.ndarray, value: float) -> float:
    """The first x at which y(x), sampled, reaches a value; the last before y falls where it does not."""
    reached = np.flatnonzero(y >= value)
    if reached.size == 0:
        return float(x[np.nanargmax(y)])
    k = int(reached[0])
    return float(x[0] if k == 0 else np.interp(value, y[k - 1 : k + 1], x[k - 1 : k + 1]))


def walls_at(finger: PneuNet, inclinations: np.ndarray, pressure: float, fields: dict[str, np.ndarray]) -> Walls:
    """The walls of chambers at a pressure (Pa) and inclinations (rad, one each); fields: the finger's, one each.

    Below contact a wall is a free arc. It is drawn as touching at most: where the walls are inclined the model lets
    them press a little after the free arc would touch, see `pneunet.contact_pressure`.
    """
    arrays = {name: jnp.asarray(fields[name], dtype=float) for name in SEGMENT_FIELDS}
    (near, lean), pressed, free = jax.tree.map(np.asarray, _sampled(arrays, finger, jnp.asarray(inclinations)))
    angles, touches, stretches = [], [], []
    for k in range(len(near)):
        theta, loads, width, stretch = (v[k] for v in pressed)
        on = width >= 0
        touching = bool(near[k] >= 0 and on.any() and pressure > loads[on][0])
        if touching:
            angle = first_reached(theta[on], loads[on], pressure)
            stretches.append(np.interp(angle, theta, stretch))
        elif near[k] >= 0 and pressure > 0:
            angle = first_reached(free[0][k], free[1][k], pressure)
            stretches.append(np.interp(angle, free[0][k], free[2][k]))
        else:
            angle = 0.0
            stretches.append(1.0)
        angles.append(angle)
        touches.append(touching)
    return Walls(near, lean, np.array(angles), np.array(touches), np.array(stretches))


def pressed_outline(a: float, near: float, lean: float, angle: float) -> np.ndarray:
    """A wall on its plane at theta_m2 from its nearer edge on, m.

    Its edges are at `near` and near + 2 a sin(lean); between them are arc, flat, arc with one radius R (4.27), which
    leave the plane tangentially and meet the edges at theta_m1 and theta_m2. The flat is what the arcs leave of the
    height.
    """
    far = near + 2 * a * np.sin(lean)
    if far < FLAT:
        return straight_outline(a, near, lean)
    radius = far / (2 * np.sin(0.5 * angle) ** 2)
    first = 2 * np.arcsin(np.sqrt(near / far) * np.sin(0.5 * angle))
    span = 2 * a * np.cos(lean)
    down, up = np.linspace(first, 0, ARC_POINTS), np.linspace(0, angle, ARC_POINTS)
    low = np.stack([radius * (1 - np.cos(down)), radius * (np.sin(first) - np.sin(down))], axis=-1)
    high = np.stack([radius * (1 - np.cos(up)), span - radius * (np.sin(angle) - np.sin(up))], axis=-1)
    return np.concatenate([low, high])


def straight_outline(a: float, near: float, lean: float) -> np.ndarray:
    """A wall without pressure."""
    share = np.linspace(0.0, 2 * a, 2 * ARC_POINTS)
    return np.stack([near + share * np.sin(lean), share * np.cos(lean)], axis=-1)


def free_outline(a: float, near: float, lean: float, angle: float) -> np.ndarray:
    """A wall that bulges towards its plane as a circular arc, which meets its edges at an angle (rad)."""
    straight = straight_outline(a, near, lean)
    if angle < 1e-9:
        return straight
    along = np.linspace(-a, a, len(straight))
    radius = a / np.sin(angle)
    bulge = np.sqrt(np.maximum(radius**2 - along**2, 0)) - radius * np.cos(angle)
    return straight + bulge[:, None] * np.array([-np.cos(lean), np.sin(lean)])


def outline(walls: Walls, k: int, a: float, inclination: float) -> np.ndarray:
    """Wall k from the cover upwards, m; inclination as it was asked for, negative where the walls close."""
    shape = pressed_outline if walls.touches[k] else free_outline
    points = shape(a, float(walls.near[k]), float(walls.lean[k]), float(walls.angle[k]))
    if inclination < 0:
        points = np.stack([points[:, 0], 2 * a * np.cos(inclination) - points[:, 1]], axis=-1)[::-1]
    return points


def small_strain_outline(scene: SmallStrainChamber | Linear, inflation: float, inclination: float) -> np.ndarray:
    """A wall of the small-strain model: an arc as high as its inflation (m), cut off by the plane."""
    a, near = float(scene.finger.a), float(scene.finger.h_x)
    points = free_outline(a, near, inclination, 2 * float(np.arctan(inflation / a)))
    return np.stack([np.maximum(points[:, 0], 0.0), points[:, 1]], axis=-1)


def wall_behind(face: np.ndarray, thickness: float) -> np.ndarray:
    """The outline of a wall whose outer face is given as (distance, height): all that is nearer to the face than its
    thickness, from one edge to the other. At the edges, where the wall is held, it is a little thicker for that."""
    heights = np.linspace(face[:, 1].min(), face[:, 1].max(), INNER_POINTS)
    # The flat on the plane has no points but its ends.
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(face, axis=0).T))])
    evenly = np.linspace(0.0, along[-1], 4 * INNER_POINTS)
    x, z = (np.interp(evenly, along, values) for values in face.T)
    apart = (heights[:, None] - z) / thickness
    reach = x + thickness * np.sqrt(np.maximum(1 - apart**2, 0.0))
    inner = np.max(np.where(np.abs(apart) <= 1, reach, -np.inf), axis=1)
    behind = np.stack([inner, heights], axis=-1)
    return np.concatenate([face, behind[::-1] if face[-1, 1] >= face[0, 1] else behind])


def thick(face: np.ndarray, thickness: np.ndarray | float, side: float = 1.0) -> np.ndarray:
    """The outline of a sheet from one of its faces, shape (n, 2): the other is to its right (side 1) or left (-1)."""
    tangent = np.gradient(face, axis=0)
    size = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = tangent / np.where(size > 0, size, 1.0)
    inward = side * np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    other = face + np.reshape(thickness, (-1, 1)) * inward
    return np.concatenate([face, other[::-1]])
