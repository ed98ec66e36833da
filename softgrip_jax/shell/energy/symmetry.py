"""Whether an object is its own mirror image, as the energy membrane on one side of it needs."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import own
from ...numerics.choice import largest
from ..obstacles import Shape

SYMMETRIC = 1e-9
"""Mirrored distances that differ by less than this, in a, are the same."""
HEIGHTS = (0.0, 0.5, 1.0)
"""Heights over every contact point, in a, at which an object is compared with its mirror image."""
_ACROSS, _ALONG = np.array([-1, 1, 1]), np.array([1, -1, 1])
MIRRORS = {"across": (_ACROSS,), "along": (_ALONG,), "both": (_ACROSS, _ALONG)}
"""Symmetry -> what a place is multiplied by."""


# As one program: its operations one by one would each be compiled.
@functools.partial(jax.jit, static_argnames="symmetry")
def broken_symmetry(scene: Any, symmetry: str) -> Float[Array, ""]:
    """By how much, in a, mirroring changes the distance of the object from places over the membrane."""
    shell, side = scene.shell, scene.functional.touching.points
    flat = np.concatenate([side, np.ones_like(side[:, :1])], axis=1)
    sizes = jnp.stack([shell.a, shell.b, shell.a])[None]
    places = jnp.concatenate([flat * np.array([[1, 1, height]]) * sizes for height in HEIGHTS])
    every = [places, *(places * mirror[None] for mirror in MIRRORS[symmetry])]
    distance, *mirrored = jnp.split(jax.vmap(scene.obstacle.distance)(jnp.concatenate(every)), len(every))
    return largest(jnp.abs(jnp.stack(mirrored) - distance[None])) / shell.a


def is_known(scene: Any) -> bool:
    """Whether everything about one object is known (of a user's own, parameters may be arrays)."""
    shell, obstacle = scene.shell, scene.obstacle
    leaves = jax.tree.leaves(shell if isinstance(obstacle, Shape) else (shell, obstacle))
    return own.is_known((shell, obstacle)) and all(jnp.ndim(x) == 0 for x in leaves)


def known_break(scene: Any) -> Float[Array, ""] | None:
    """By how much a symmetry that was named is broken, in a; None where none was named or that is not known."""
    if scene.obstacle is None or scene.symmetry not in MIRRORS or not is_known(scene):
        return None
    with jax.ensure_compile_time_eval():  # under jit, too
        return broken_symmetry(scene, scene.symmetry)


def symmetry_of(scene: Any) -> str:
    """The most symmetry that an object of known numbers has; "none" where they are traced."""
    if is_known(scene):
        for symmetry in ("both", "across", "along"):
            with jax.ensure_compile_time_eval():
                broken = broken_symmetry(scene, symmetry)
            if float(broken) <= SYMMETRIC:
                return symmetry
    return "none"
