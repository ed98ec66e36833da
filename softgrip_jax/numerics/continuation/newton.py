"""Newton's method across a path or towards a goal on it: one step, and when to stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..choice import largest
from ..small_linear import solve_and_sign

Vector = Float[Array, " n"]
Scalar = Float[Array, ""]

NEWTON_STEPS = 8
"""A good predictor needs 2 to 4 corrections; a step that needs more is shortened instead."""
CONTRACTION = 0.7
"""Corrections must shrink at least this much (Deuflhard 2004, 2.1, has 1/2; next to a limit point they just halve): a
Newton iteration that wanders may settle on another branch. The start of the search is then taken closer."""
GOAL_STEPS = 20
"""Next to a limit point the last Newton iteration halves its error at first, before it squares it."""
FREE_STEPS = 3
"""Far from the path the first moves need not contract: they see a kink where rims meet."""
CONVERGED = 1e-8
"""Moves below this need not contract: they are near rounding."""
LEAST_BEND = 1e-2
"""Of the equations, as far as two moves can tell: a move of 1e-7 is the last one."""
ROUNDED = 1e-13
"""Moves below this are rounding alone: from a point of the path itself they are of one size from the first one on."""


class Accuracy(NamedTuple):
    """How well the points of a path are solved for."""

    move: Scalar | float
    """Newton's method ends where its next move would be below this."""
    left: Scalar | float
    """Or where a first correction leaves about this: itself times the turn of the tangent (its sine)."""


FINE = Accuracy(1e-16, -1.0)
ROUGH = Accuracy(1e-3, 0.05)
"""Of the steps on the way: to keep to a branch, not to know it. A search that ends on the way begins once more with
every point known well: a rough point may have been off the path."""


class NewtonIteration(NamedTuple):
    """A Newton iteration under way: where it is, and the sizes of its last two moves."""

    u: Vector
    before_last: Scalar
    last: Scalar
    count: Int[Array, ""]


def newton_from(guess: Vector) -> NewtonIteration:
    far = jnp.full((), jnp.inf, guess.dtype)
    return NewtonIteration(guess, far, far, jnp.asarray(0))


def value_and_jacobian(function: Callable[[Vector], Any], u: Vector, has_aux: bool = False) -> tuple[Any, ...]:
    """function(u), vectors or scalars, and their Jacobians, with the function's own work done once. has_aux: as of
    `jax.jvp`, where function(u) is a pair, of which the second part comes last, as it is."""
    axes = (None, -1, None) if has_aux else (None, -1)
    columns = jnp.eye(u.shape[0], dtype=u.dtype)
    return jax.vmap(lambda v: jax.jvp(function, (u,), (v,), has_aux=has_aux), out_axes=axes)(columns)


class Local(NamedTuple):
    """What one factorisation of the equations at a point tells of the path there."""

    goal: Scalar
    """Where the Newton step leads, as far as its slope tells."""

    tangent: Vector
    """A null vector of the equations' Jacobian."""
    sign: Scalar
    """Of det [Jacobian; tangent]."""
    rise: Vector
    """The gradient of the goal."""


def newton_step(
    equations: Callable[[Vector], tuple[Vector, Scalar]],
    tangent: Vector,
    guess: Vector,
    to_goal: Bool[Array, ""] | bool,
    newton: NewtonIteration,
) -> tuple[NewtonIteration, Local]:
    """One Newton step towards the path in the plane through `guess` across the tangent or, with `to_goal`, towards the
    path where goal = 0; and what is known of the path before it."""
    u = newton.u
    (value, goal), (jacobian, rise) = value_and_jacobian(equations, u)
    last = jnp.where(to_goal, goal, jnp.dot(tangent, u - guess))
    row = jnp.where(to_goal, rise, tangent)
    right = jnp.stack([jnp.append(value, last), jnp.zeros_like(u).at[-1].set(1.0)], axis=1)
    found, sign = solve_and_sign(jnp.concatenate([jacobian, row[None]]), right)
    move, null = found.T
    size = largest(jnp.abs(move) / (1 + jnp.abs(u)))
    size = jnp.where(jnp.isfinite(size), size, jnp.inf)
    local = Local(goal - jnp.dot(rise, move), null / jnp.linalg.norm(null), sign, rise)
    return NewtonIteration(u - move, newton.last, size, newton.count + 1), local


def next_move(newton: NewtonIteration) -> Scalar:
    """Quadratic convergence: moves e, C e^2, then C (C e^2)^2; never thought to be slower than halving, nor C to be
    less than LEAST_BEND: the first move may lie along the path, where nothing bends."""
    ratio = jnp.where(jnp.isfinite(newton.before_last), newton.last / newton.before_last, 1.0)
    return newton.last * jnp.maximum(jnp.minimum(ratio, 1.0) ** 2, LEAST_BEND * newton.last)


def goes_on(
    newton: NewtonIteration, limit: Int[Array, ""] | int, accuracy: Accuracy, free: Int[Array, ""] | int = 0
) -> Bool[Array, ""]:
    """Whether a Newton iteration has more to do; it is given up where its moves, after a few that are `free`, do not
    contract."""
    contracts = newton.last <= jnp.maximum(CONTRACTION * newton.before_last, CONVERGED)
    contracts |= newton.count <= free
    # Written so that a NaN, from two moves of zero or from none at all, ends the loop.
    more = ~(next_move(newton) <= accuracy.move) & (newton.last > accuracy.move)
    return more & (newton.count < limit) & contracts & jnp.all(jnp.isfinite(newton.u))


def has_converged(newton: NewtonIteration, accuracy: Accuracy) -> Bool[Array, ""]:
    return (newton.last <= accuracy.move) | (next_move(newton) <= accuracy.move) | (newton.last <= ROUNDED)
