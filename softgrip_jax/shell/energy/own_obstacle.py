"""Whether the distance of a user's own object is one: its contact would else press by a multiple of what it is.

A `Shape` is a class of this package, but its function is the user's.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...errors import InputError
from ...own import is_own, require_numbers
from ..obstacles import Obstacle, Shape
from .symmetry import HEIGHTS, is_known

SIDE, STEPS = 5, 20
"""Places along each side of the membrane, at HEIGHTS, from which the surface is sought, and Newton's steps to it."""
AT_SURFACE = 1e-6
"""A distance below this, in a, is zero."""
STEEP = 0.1
"""How far the slope may be from 1: blends of several distances are a little flatter."""


def require_distance(scene: Any) -> None:
    """An InputError where an object of the user's has a distance that is no number, or does not grow by a metre per
    metre at its surface; nothing where its numbers are traced, or the surface is not found."""
    obstacle = scene.obstacle
    if not (is_own(obstacle) or isinstance(obstacle, Shape)) or not is_known(scene):
        return
    where = _name(obstacle)
    if not require_numbers(where, obstacle, obstacle.distance, jnp.zeros(3)):
        return  # several objects in one, made for vmap
    with jax.ensure_compile_time_eval():  # under jit, too
        places, distances, slopes = _at_surface(scene)
    off = np.where(np.abs(distances) < AT_SURFACE * float(scene.shell.a), np.abs(np.asarray(slopes) - 1), 0.0)
    worst = int(np.argmax(np.nan_to_num(off)))
    if off[worst] > STEEP:
        at = ", ".join(f"{1e3 * x:.3g}" for x in np.asarray(places)[worst])
        raise InputError(
            f"{where} changes by {float(slopes[worst]):.3g} m per metre at "
            f"({at}) mm, on its surface; a signed distance changes by 1."
        )


def _name(obstacle: Obstacle) -> str:
    """What of it gives the distance, for messages."""
    if isinstance(obstacle, Shape) and not is_own(obstacle):
        return f"Shape.function ({getattr(obstacle.function, '__name__', repr(obstacle.function))})"
    return f"{type(obstacle).__name__}.distance"


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
