"""What is seen of a deformed energy membrane: heights, stretches, profiles and maps."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .basis import Grid, Vector, at_points, contact_axes
from .sheet import local

TINY = 1e-30
"""It keeps a square root away from zero whose derivative nobody asks for."""
MEAN_OVER = 0.6
"""Width of the weights, in mean distances between contact points: differences between neighbours fall to a sixth."""


def _larger(trace: Array, determinant: Array) -> Array:
    """The larger principal stretch."""
    mean = 0.5 * trace
    return jnp.sqrt(mean + jnp.sqrt(jnp.maximum(mean**2 - determinant, TINY)))


def _strains(scene: Any, e: Array, points: Any) -> tuple[Any, Array, Array]:
    """The deformation, tr C and det C at points."""
    at = jax.vmap(local, in_axes=(0, 0, None))(e, jnp.asarray(points), scene.shell.a / scene.shell.b)
    return at, *jax.vmap(lambda at: (at.trace, at.determinant))(at)


def shape_observables(scene: Any, y: Vector) -> dict[str, Array]:
    """Height, stretches and slope of the membrane."""
    work = scene.functional
    ends = work.deformed(y, at_points(scene.grid, [(0.0, 0.0), (1.0, 0.0)]))
    top = local(ends[0], jnp.zeros(2), scene.shell.a / scene.shell.b)
    _, trace, determinant = _strains(scene, work.deformed(y), work.inside.points)
    larger = _larger(trace, determinant)
    return {
        "inflation": scene.shell.a * top.place[2],
        "stretch": jnp.linalg.norm(top.along_x),
        "length_stretch": jnp.linalg.norm(top.along_y),
        "largest_stretch": jnp.max(larger),
        "clamp_angle": jnp.arctan2(-ends[1, 2, 1], 1 + ends[1, 0, 1]),
        "wrinkled_share": jnp.dot(work.inside.weights, (determinant < larger).astype(y.dtype)) / 4,
    }


def contact_average(grid: Grid, points: Any) -> Float[np.ndarray, "p k"]:
    """Weights of the contact pressures at any points (xi, eta): their mean over about the distance between them.

    Single contact points take turns in pressing; their neighbourhood presses evenly. The weights are Gaussian along
    each axis; an even pressure stays what it is.
    """
    sides = []
    for axis, (nodes, weights) in enumerate(contact_axes(grid)):
        at, width = np.asarray(points, dtype=float)[:, axis, None], MEAN_OVER / len(nodes)
        right, left = (weights * np.exp(-(((at - side * nodes) / width) ** 2) / 2) for side in (1, -1))
        even = grid.symmetry in ("both", ("across", "along")[axis])
        found = right + left if even else np.concatenate([left[:, ::-1], right], axis=1)
        sides.append(found / found.sum(axis=1, keepdims=True))
    return (sides[0][:, :, None] * sides[1][:, None, :]).reshape(len(sides[0]), -1)


def places(scene: Any, y: Vector, points: Any) -> Float[Array, "m 3"]:
    """The middle surface at the points (xi, eta), in a."""
    e = scene.functional.deformed(y, at_points(scene.grid, points))
    return _strains(scene, e, points)[0].place


def profile(scene: Any, unknowns: Vector, n: int) -> dict[str, Array]:
    """x, z across the width at the middle, y, z_length along the length, m: the middle surface. With `_face` the outer
    face, which touches, seen from where it is at rest, as objects are placed: half the thickness above the middle."""
    line, zero = np.linspace(-1, 1, n), np.zeros(n)
    y, shell = scene.split(unknowns)[0], scene.shell
    found = {}
    for axis, names, points in (
        (0, ("x", "z"), np.stack([line, zero], axis=1)),
        (1, ("y", "z_length"), np.stack([zero, line], axis=1)),
    ):
        e = scene.functional.deformed(y, at_points(scene.grid, points))
        at = _strains(scene, e, points)[0]
        faces = jax.vmap(lambda at: at.face(shell.t_m / shell.a))(at)
        for name, component in zip(names, (axis, 2), strict=True):
            found[name] = shell.a * at.place[:, component]
            found[f"{name}_face"] = shell.a * faces[:, component]
    return found


def surface(scene: Any, unknowns: Vector, n: int) -> dict[str, Array]:
    """Maps on n x n points of the membrane, m and Pa: X, Y of the flat membrane, place, principal stretches, and the
    pressure of the contact per deformed area."""
    line = np.linspace(-1, 1, n)
    points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    shell, (y, contact_pressures) = scene.shell, scene.split(unknowns)
    e = scene.functional.deformed(y, at_points(scene.grid, points))
    at, trace, determinant = _strains(scene, e, points)
    larger = _larger(trace, determinant)
    maps = {
        "X": shell.a * points[:, 0],
        "Y": shell.b * points[:, 1],
        "larger_stretch": larger,
        "smaller_stretch": jnp.sqrt(determinant) / larger,
    }
    if scene.body is not None:
        true = contact_average(scene.grid, points) @ contact_pressures / jnp.sqrt(determinant)
        maps["contact_pressure"] = scene.unit() * true
    maps = {name: jnp.reshape(value, (n, n)) for name, value in maps.items()}
    return maps | {"place": jnp.reshape(shell.a * at.place, (n, n, 3))}
