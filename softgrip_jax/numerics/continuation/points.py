"""Points of a path, and whether where a Newton iteration has led is the next one."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool

from .newton import Local, NewtonIteration, Scalar, Vector

TURN = 0.9
"""Cosine of the largest turn of the tangent in one step (26 degrees): keeps a step from jumping between branches."""
POLISHED_TURN = 0.5
"""And where a point that was known roughly is found better."""
DETOUR = 0.25
"""A correction is at most this part of its step: an arc that turns by 26 degrees leaves its tangent by 0.22."""
SLACK = 0.05
"""What a correction may be in any case: no more than the point before may be off."""


class Point(NamedTuple):
    """A point of a path with its unit tangent, and how far it is from the goal."""

    u: Vector
    tangent: Vector
    goal: Scalar
    side: Scalar
    """Sign of det [Jacobian; tangent]: it is one and the same along a path, through limit points too, and another on
    the far side of a bifurcation or on the next branch. 0 where it is not known yet."""


def arrived(
    newton: NewtonIteration,
    local: Local,
    before: Point,
    guess: Vector,
    within: Bool[Array, ""] | bool,
    first: Bool[Array, ""] | bool = False,
    polishing: Bool[Array, ""] | bool = False,
    turn: float = TURN,
    detour: Scalar | float = DETOUR,
) -> tuple[Point, Scalar, Bool[Array, ""], Scalar, Bool[Array, ""]]:
    """Where a Newton iteration is, how the goal rises along the path there, whether that can be trusted to be the
    path's next point once it has converged, about how far from there it was left by its first correction, and whether
    all that is wrong with it is that it lies beyond a bifurcation.

    It can if the tangent has not turned too far since `before`, no branch point was passed, and the correction was
    small (`within` a known piece of the path it may be large). At the first point the tangent was only guessed: it may
    turn as it likes, but must point to growing load; and more than usual where a rough point is found better.
    """
    along = jnp.where(jnp.dot(local.tangent, before.tangent) < 0, -1.0, 1.0)
    tangent, side = along * local.tangent, along * local.sign
    rise = jnp.dot(local.rise, tangent)
    same_side = (before.side == 0) | (side == before.side)
    straight = jnp.dot(tangent, before.tangent)
    correction = jnp.linalg.norm(newton.u - guess)
    slack = jnp.minimum(SLACK, detour)
    near = correction <= detour * jnp.linalg.norm(guess - before.u) + jnp.where(polishing, 3 * SLACK, slack)
    ahead = jnp.all(jnp.isfinite(tangent)) & (tangent[-1] > 0)
    least = jnp.where(polishing, min(POLISHED_TURN, turn), turn)
    trusted = jnp.where(first, ahead, (straight > least) & (near | within))
    # Only the first correction tells: a Newton iteration that wanders may come back to its guess from far away.
    left = jnp.where(newton.count > 1, jnp.inf, correction * jnp.sqrt(jnp.maximum(1 - straight**2, 0.0)))
    return Point(newton.u, tangent, local.goal, side), rise, trusted & same_side, left, trusted & ~same_side
