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
from ..pneunet.wall.arc import Chamber

ARC_POINTS = 60
"""Points on each arc of a wall."""
GRID = 1024
"""Angles among which the one of a pressure is interpolated: right to a few hundred-thousandths."""
INNER_POINTS = 41
"""Points on the inner face of a wall."""
TOUCHES = 1e-4
"""A point of a membrane counts as touching where it is nearer to the object than this part of its thickness."""
Number = float | np.ndarray
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
def _at_pressure(fields: dict[str, Array], finger: PneuNet, inclination: Float[Array, " n"], pressure: Any) -> Walls:
    """Each wall on a grid of angles, on its plane and free up to where it would touch; the angle is where the load
    first reaches the pressure."""

    def one(fields, inclination):
        chamber = Chamber(dataclasses.replace(finger, **fields), inclination)
        f, (near, lean) = chamber.finger, chamber.nearer_edge()
        share = jnp.linspace(0.0, 1.0, GRID)
        low, end = chamber.search_interval()
        angles = low + (end - low) * share

        def pressed(angle):
            wall = chamber.wall(angle)
            return wall.pressure, wall.contact_width, wall.stretch

        loads, width, stretches = jax.vmap(pressed)(angles)
        loads = jnp.where(width >= 0, loads, jnp.nan)
        touches = (near >= 0) & (pressure > loads[jnp.argmax(width >= 0)])
        held = first_reached(loads, pressure, angles, stretches)

        reach = first_contact_angle(jnp.maximum(near, 0.0) / f.a, lean)
        free = reach * share
        stretch = jax.vmap(angle_over_sine)(free)
        tension = jax.vmap(lambda x: tensions(f.material, f.t_m, x, x)[0])(stretch)
        arc = first_reached(2 * tension * jnp.sin(free) / f.a, pressure, free, stretch)  # (4.7), R = a / sin(theta)
        bulges = ~touches & (near >= 0) & (pressure > 0)
        angle, stretch = (
            jnp.select([touches, bulges], [on, off], rest) for on, off, rest in zip(held, arc, (0.0, 1.0), strict=True)
        )
        return Walls(near, lean, angle, touches, stretch)

    return jax.vmap(one)(fields, inclination)


def first_reached(load: Float[Array, " n"], value: Any, *others: Float[Array, " n"]) -> list[Array]:
    """Others, sampled as the load is, at the first point at which the load reaches a value, interpolated; where it does
    not, at its largest. A load that is no number is none."""
    load = jnp.where(jnp.isfinite(load), load, -jnp.inf)
    reached = load >= value
    k = jnp.where(jnp.any(reached), jnp.argmax(reached), jnp.argmax(load))
    before = jnp.maximum(k - 1, 0)
    low, high = load[before], load[k]
    between = (low < value) & (value <= high) & jnp.isfinite(low)
    share = (value - jnp.where(between, low, 0.0)) / jnp.where(between, high - low, 1.0)
    return [jnp.where(between, y[before] + share * (y[k] - y[before]), y[k]) for y in others]


def walls_at(finger: PneuNet, inclinations: np.ndarray, pressure: float, fields: dict[str, np.ndarray]) -> Walls:
    """The walls of chambers at a pressure (Pa) and inclinations (rad, one each); fields: the finger's, one each.

    Below contact a wall is a free arc. It is drawn as touching at most: where the walls are inclined the model lets
    them press a little after the free arc would touch, see `pneunet.contact_pressure`.
    """
    arrays = {name: np.asarray(fields[name], dtype=float) for name in SEGMENT_FIELDS}
    return jax.device_get(_at_pressure(arrays, finger, np.asarray(inclinations, dtype=float), float(pressure)))


# Every number below may be an array, one for each of several walls: then so is the outline, shape (walls, points, 2).


def pressed_outline(a: Number, near: Number, lean: Number, angle: Number) -> np.ndarray:
    """A wall on its plane at theta_m2 from its nearer edge on, m.

    Its edges are at `near` and near + 2 a sin(lean); between them are arc, flat, arc with one radius R (4.27), which
    leave the plane tangentially and meet the edges at theta_m1 and theta_m2. The flat is what the arcs leave of the
    height.
    """
    far, span = near + 2 * a * np.sin(lean), _each(2 * a * np.cos(lean))
    curved = np.asarray(far >= FLAT)[..., None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = _each(far / (2 * np.sin(0.5 * angle) ** 2))
        first = 2 * np.arcsin(np.sqrt(near / far) * np.sin(0.5 * angle))
        down, up = np.linspace(first, 0, ARC_POINTS, axis=-1), np.linspace(0, angle, ARC_POINTS, axis=-1)
        low = np.stack([radius * (1 - np.cos(down)), radius * (np.sin(_each(first)) - np.sin(down))], axis=-1)
        high = np.stack([radius * (1 - np.cos(up)), span - radius * (np.sin(_each(angle)) - np.sin(up))], axis=-1)
    points = np.concatenate([low, high], axis=-2)
    return np.where(curved, points, straight_outline(a, near, lean))


def straight_outline(a: Number, near: Number, lean: Number) -> np.ndarray:
    """A wall without pressure."""
    share = np.linspace(0.0, 2 * np.asarray(a), 2 * ARC_POINTS, axis=-1)
    return np.stack([_each(near) + share * np.sin(_each(lean)), share * np.cos(_each(lean))], axis=-1)


def free_outline(a: Number, near: Number, lean: Number, angle: Number) -> np.ndarray:
    """A wall that bulges towards its plane as a circular arc, which meets its edges at an angle (rad)."""
    a, angle, lean = _each(a), _each(angle), _each(lean)
    along = a * np.linspace(-1.0, 1.0, 2 * ARC_POINTS)
    curved = angle >= 1e-9
    radius = a / np.sin(np.where(curved, angle, 1.0))
    bulge = np.where(curved, np.sqrt(np.maximum(radius**2 - along**2, 0)) - radius * np.cos(angle), 0.0)
    return straight_outline(a[..., 0], near, lean[..., 0]) + np.stack(
        [-bulge * np.cos(lean), bulge * np.sin(lean)], axis=-1
    )


def _each(value: Number) -> np.ndarray:
    """One number for each wall, beside its points."""
    return np.asarray(value)[..., None]


def outlines(walls: Walls, a: Number, inclinations: np.ndarray) -> np.ndarray:
    """The walls from the cover upwards, m; inclinations as they were asked for, negative where the walls close."""
    angles = walls.near, walls.lean, walls.angle
    points = np.where(walls.touches[:, None, None], pressed_outline(a, *angles), free_outline(a, *angles))
    height = _each(2 * a * np.cos(inclinations))
    closing = np.stack([points[..., 0], height - points[..., 1]], axis=-1)[:, ::-1]
    return np.where(inclinations[:, None, None] < 0, closing, points)


def small_strain_outline(a: Number, near: Number, inflation: Number, inclination: Number) -> np.ndarray:
    """A wall of the small-strain model: an arc as high as its inflation (m), cut off by the plane."""
    points = free_outline(a, near, inclination, 2 * np.arctan(inflation / a))
    return np.stack([np.maximum(points[..., 0], 0.0), points[..., 1]], axis=-1)


def wall_behind(face: np.ndarray, thickness: Number) -> np.ndarray:
    """The outline of a wall whose outer face is given as (distance, height): all that is nearer to the face than its
    thickness, from one edge to the other. At the edges, where the wall is held, it is a little thicker for that."""
    faces = face.reshape(-1, *face.shape[-2:])
    thickness = np.broadcast_to(thickness, len(faces))[:, None]
    heights = np.linspace(faces[..., 1].min(axis=1), faces[..., 1].max(axis=1), INNER_POINTS, axis=-1)
    # The flat on the plane has no points but its ends.
    steps = np.diff(faces, axis=1)
    along = np.cumsum(np.hypot(steps[..., 0], steps[..., 1]), axis=1)
    along = np.concatenate([np.zeros_like(along[:, :1]), along], axis=1)
    evenly = np.linspace(0.0, along[:, -1], 2 * INNER_POINTS, axis=-1)
    x, z = (np.array([np.interp(*one) for one in zip(evenly, along, faces[..., k], strict=True)]) for k in (0, 1))
    inner = np.empty_like(heights)
    # One wall after the other: all of them at once would not stay in the processor's cache.
    for one in range(len(faces)):
        room = 1 - ((heights[one][:, None] - z[one]) / thickness[one]) ** 2
        reach = x[one] + thickness[one] * np.sqrt(np.maximum(room, 0.0))
        inner[one] = np.where(room < 0, -np.inf, reach).max(axis=1)
    behind = np.stack([inner, heights], axis=-1)
    upwards = faces[:, -1, 1] >= faces[:, 0, 1]
    behind = np.where(upwards[:, None, None], behind[:, ::-1], behind)
    return np.concatenate([faces, behind], axis=1).reshape(*face.shape[:-2], -1, 2)


def thick(face: np.ndarray, thickness: np.ndarray | float, side: float = 1.0) -> np.ndarray:
    """The outline of a sheet from one of its faces, shape (..., n, 2): the other is to its right (side 1) or left (-1).

    thickness: of the sheet, of each of its points, or of each sheet (shape (..., 1))."""
    tangent = np.gradient(face, axis=-2)
    size = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent = tangent / np.where(size > 0, size, 1.0)
    inward = side * np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    other = face + np.asarray(thickness)[..., None] * inward
    return np.concatenate([face, other[..., ::-1, :]], axis=-2)
