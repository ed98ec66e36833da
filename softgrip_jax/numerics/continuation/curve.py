"""The curve of a path at equal arc lengths."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..choice import select
from .newton import FINE, NEWTON_STEPS, Local, Scalar, Vector, goes_on, has_converged, newton_from, newton_step
from .points import Point, arrived
from .search import LONGER, SHORTER, SMALLEST_STEP


def trace(
    residual: Callable[[Vector], Vector], u: Vector, step: Scalar | float, n: int
) -> tuple[Float[Array, "k m"], Bool[Array, " k"]]:
    """n points of the path from u at equal arc lengths, through any limit point; and which are trusted."""
    zero = jnp.zeros((), u.dtype)

    def correct(point: Point, guess: Vector) -> tuple[Point, Bool[Array, ""]]:
        """The point of the path next to `guess`, in the plane across the tangent, and whether it can be trusted."""

        def step(state):
            return newton_step(lambda u: (residual(u), zero), point.tangent, guess, False, state[0])

        start = (newton_from(guess), Local(zero, 0 * u, zero, 0 * u))
        newton, local = lax.while_loop(lambda state: goes_on(state[0], NEWTON_STEPS, FINE), step, start)
        new, _, trusted, *_ = arrived(newton, local, point, guess, False)
        return new, trusted & has_converged(newton, FINE)

    start, _ = correct(Point(u, jnp.zeros_like(u).at[-1].set(1.0), zero, zero), u)

    def next_point(state, _):
        point, length, alive = state

        def attempt(state):
            point, length, rest = state
            new, good = correct(point, point.u + jnp.minimum(length, rest) * point.tangent)
            rest = jnp.where(good, rest - jnp.minimum(length, rest), rest)
            return select(good, new, point), jnp.where(good, LONGER * length, SHORTER * length), rest

        def busy(state):
            return alive & (state[2] > 0) & (state[1] > SMALLEST_STEP)

        point, length, rest = lax.while_loop(busy, attempt, (point, length, zero + step))
        alive = alive & (rest <= 0)
        return (point, length, alive), (point.u, alive)

    _, (points, alive) = lax.scan(next_point, (start, zero + step, jnp.asarray(True)), None, length=n - 1)
    return jnp.concatenate([start.u[None], points]), jnp.concatenate([jnp.ones(1, bool), alive])
