"""What is seen of a deformed energy membrane: heights, stretches, profiles and maps."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .basis import CONTACT_POINTS, ORDERS, Grid, Vector, at_points, contact_axes
from .sheet import local, stretching

COMPRESSED = 1e-7
"""What is narrower than its natural width by less than this part of it counts as flat: stretches that are nearly equal
are known to the root of rounding."""
LEAST_ROOT = 1e-30
"""It keeps a square root away from zero whose derivative nobody asks for."""
MEAN_OVER = 0.6
"""Width of the weights, in half sides per polynomial of w: what polynomials cannot follow is left out."""
LARGEST_GAP = 2.0
"""Walls: an outer face that is further off does not touch, whatever is pressed around it. Nearer ones may have to
take what polynomials smear over the contact's edge."""
PRESSED = 0.05
"""A map shows contact where its mean presses at least so much of what the air does."""
THICKEST = 1.5
"""A sheet is drawn no thicker than so many times its thickness at rest: next to a clamp polynomials may leave a strip
of next to no area, and a wrinkled sheet folds in place of growing thicker."""


def _larger(trace: Array, determinant: Array) -> Array:
    """The larger principal stretch."""
    mean = 0.5 * trace
    return jnp.sqrt(mean + jnp.sqrt(jnp.maximum(mean**2 - determinant, LEAST_ROOT)))


def _strains(scene: Any, e: Array, points: Any) -> tuple[Any, Array, Array]:
    """The deformation, tr C and det C at points."""
    at = jax.vmap(local, in_axes=(0, 0, None))(e, jnp.asarray(points), scene.shell.a / scene.shell.b)
    return at, *jax.vmap(lambda at: (at.trace, at.determinant))(at)


def shape_observables(scene: Any, y: Vector) -> dict[str, Array]:
    """Height, stretches and slope of the membrane."""
    work = scene.functional
    ends = work.deformed_at(y, at_points(scene.grid, [(0.0, 0.0), (1.0, 0.0)]))
    top = local(ends[0], jnp.zeros(2), scene.shell.a / scene.shell.b)
    _, trace, determinant = _strains(scene, work.deformed(y), work.inside.points)
    larger = _larger(trace, determinant)
    return {
        "inflation": scene.shell.a * top.place[2],
        "stretch": jnp.linalg.norm(top.along_x),
        "length_stretch": jnp.linalg.norm(top.along_y),
        "largest_stretch": jnp.max(larger),
        "clamp_angle": jnp.arctan2(-ends[1, 2, 1], 1 + ends[1, 0, 1]),
        "wrinkled_share": jnp.dot(work.inside.weights, (determinant < (1 - COMPRESSED) * larger).astype(y.dtype)) / 4,
    }


def contact_average(grid: Grid, points: Any) -> Float[np.ndarray, "p k"]:
    """Weights of the contact pressures at any points (xi, eta): their mean over about half a wave of the polynomials.

    The polynomials of w touch in waves; over one of them they press evenly. The weights are Gaussian along each axis;
    an even pressure stays what it is.
    """
    sides = []
    for axis, (nodes, weights) in enumerate(contact_axes(grid)):
        at, width = np.asarray(points, dtype=float)[:, axis, None], MEAN_OVER * CONTACT_POINTS / len(nodes)
        right, left = (weights * np.exp(-(((at - side * nodes) / width) ** 2) / 2) for side in (1, -1))
        even = grid.symmetry in ("both", ("across", "along")[axis])
        found = right + left if even else np.concatenate([left[:, ::-1], right], axis=1)
        sides.append(found / found.sum(axis=1, keepdims=True))
    return (sides[0][:, :, None] * sides[1][:, None, :]).reshape(len(sides[0]), -1)


def places(scene: Any, y: Vector, points: Any) -> Float[Array, "m 3"]:
    """The middle surface at the points (xi, eta), in a."""
    e = scene.functional.deformed_at(y, at_points(scene.grid, points))
    return _strains(scene, e, points)[0].place


def profile(scene: Any, unknowns: Vector, n: int) -> dict[str, Array]:
    """x, z across the width at the middle, y, z_length along the length, m: the middle surface. With `_face` the outer
    face, which touches, seen from where it is at rest, as objects are placed: half the thickness above the middle, as
    THICKEST allows."""
    line, zero = np.linspace(-1, 1, n), np.zeros(n)
    shell = scene.shell
    found = {}
    for axis, names, points in (
        (0, ("x", "z"), np.stack([line, zero], axis=1)),
        (1, ("y", "z_length"), np.stack([zero, line], axis=1)),
    ):
        e = scene.functional.deformed_at(unknowns, at_points(scene.grid, points))
        at = _strains(scene, e, points)[0]
        ratio = jnp.maximum(jnp.linalg.norm(at.normal, axis=1, keepdims=True), LEAST_ROOT)
        drawn = at._replace(normal=at.normal * jnp.maximum(1.0, 1 / (THICKEST * ratio)))
        faces = jax.vmap(lambda at: at.face(shell.t_m / shell.a))(drawn)
        for name, component in zip(names, (axis, 2), strict=True):
            found[name] = shell.a * at.place[:, component]
            found[f"{name}_face"] = shell.a * faces[:, component]
    return found


def surface(scene: Any, unknowns: Vector, pressure: Array, n: int) -> dict[str, Array]:
    """Maps on n x n points of the membrane, m and Pa: X, Y of the flat membrane, place, principal stretches, and the
    pressure of the contact per deformed area."""
    line = np.linspace(-1, 1, n)
    points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    shell = scene.shell
    e = scene.functional.deformed_at(unknowns, at_points(scene.grid, points, ORDERS))
    at, trace, determinant = _strains(scene, e, points)
    larger = _larger(trace, determinant)
    maps = {
        "X": shell.a * points[:, 0],
        "Y": shell.b * points[:, 1],
        "larger_stretch": larger,
        "smaller_stretch": jnp.sqrt(determinant) / larger,
    }
    if scene.body is not None:
        load, layer = pressure / scene.unit(), scene.contact_pressures(unknowns, pressure)
        thickness = shell.t_m / shell.a
        gaps = jax.vmap(lambda at: scene.body.distance(shell.a * at.face(thickness)))(at)
        near = (contact_average(scene.grid, points) @ layer > PRESSED * load) & (gaps < LARGEST_GAP * shell.t_m)
        borne = jax.vmap(_borne, in_axes=(0, None))(e, scene)
        pressed = jnp.where(near, jnp.maximum(0.0, load - borne), 0.0)
        areas = jnp.sqrt(determinant) * np.outer(*2 * [np.r_[1, np.full(n - 2, 2), 1] / (n - 1)]).ravel()
        areas = areas * (shell.b / shell.a)
        whole = jnp.dot(layer, scene.functional.contact_weights(scene))
        maps["contact_pressure"] = scene.unit() * _trimmed(pressed, areas, whole)
    maps = {name: jnp.reshape(value, (n, n)) for name, value in maps.items()}
    return maps | {"place": jnp.reshape(shell.a * at.place, (n, n, 3))}


def _trimmed(pressed: Vector, areas: Vector, whole: Array) -> Vector:
    """Pressures without their least ones: what polynomials smear over the contact's edge. What is left sums to the
    force `whole`."""
    order = jnp.argsort(-pressed)
    before = jnp.cumsum((pressed * areas)[order]) - (pressed * areas)[order]
    return jnp.where(before < whole, pressed[order], 0.0)[jnp.argsort(order)]


def _borne(e: Float[Array, "3 6"], scene: Any) -> Array:
    """What the membrane's tension bears by its curvature, per deformed area, in mu t_m / a: -n . Div P / sqrt(det C).

    What the air presses more, the contact bears. The pressures of the layer's points, whose sums are right, rise and
    fall with the waves in which polynomials touch; a tension hardly does. What bending bears is left out.
    """
    shell, aspect = scene.shell, scene.shell.a / scene.shell.b

    def energy(f):
        found = stretching(shell.material, scene.bending, jnp.sum(f * f), jnp.sum(jnp.cross(f[0], f[1]) ** 2))
        return found / shell.material.shear_modulus()

    at = local(e, jnp.zeros(2), aspect)
    tangents = jnp.stack([at.along_x, at.along_y])
    changes = jnp.stack([e[:, 3], aspect * e[:, 4]]), jnp.stack([aspect * e[:, 4], aspect**2 * e[:, 5]])
    divergence = sum(jax.jvp(jax.grad(energy), (tangents,), (change,))[1][k] for k, change in enumerate(changes))
    return -(at.normal @ divergence) / at.determinant
