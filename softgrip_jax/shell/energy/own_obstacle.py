"""Whether the distance of a user's own object is one: its contact would else press by a multiple of what it is."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...errors import InputError
from .symmetry import HEIGHTS, is_known

SIDE, STEPS = 5, 20
"""Places along each side of the membrane, at HEIGHTS, from which the surface is sought, and Newton's steps to it."""
AT_SURFACE = 1e-6
"""A distance below this, in a, is zero."""
STEEP = 0.1
"""How far the slope may be from 1: blends of several distances are a little flatter."""


def require_distance(scene: Any) -> None:
    """An InputError where an object whose class is no part of this package has a distance that does not grow by a metre
    per metre at its surface; nothing where its numbers are traced, or the surface is not found."""
    package = __name__.partition(".")[0]
    if type(scene.obstacle).__module__.partition(".")[0] == package or not is_known(scene):
        return
    with jax.ensure_compile_time_eval():  # under jit, too
        places, distances, slopes = _at_surface(scene)
    off = np.where(np.abs(distances) < AT_SURFACE * float(scene.shell.a), np.abs(np.asarray(slopes) - 1), 0.0)
    worst = int(np.argmax(np.nan_to_num(off)))
    if off[worst] > STEEP:
        where = ", ".join(f"{1e3 * x:.3g}" for x in np.asarray(places)[worst])
        raise InputError(
            f"{type(scene.obstacle).__name__}.distance changes by {float(slopes[worst]):.3g} m per metre at "
            f"({where}) mm, on its surface; a signed distance changes by 1."
        )


@jax.jit
def _at_surface(scene: Any) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Float[Array, " n"]]:
    """(places on the surface, or near to it where none is found, their distances, the slopes there)."""
    shell = scene.shell
    axes = [np.linspace(-1, 1, SIDE), np.linspace(-1, 1, SIDE), np.array(HEIGHTS)]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3) * jnp.stack([shell.a, shell.b, shell.a])[None]
    look = jax.value_and_grad(scene.obstacle.distance)

    def nearer(_, place):
        distance, slope = look(place)
        square = slope @ slope
        return place - jnp.where(square > 0, distance / jnp.where(square > 0, square, 1.0), 0.0) * slope

    places = jax.vmap(lambda place: jax.lax.fori_loop(0, STEPS, nearer, place))(places)
    distances, slopes = jax.vmap(look)(places)
    return places, distances, jnp.linalg.norm(slopes, axis=1)
