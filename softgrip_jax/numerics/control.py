"""Equilibria under a given displacement instead of a given load: regular where the load has its largest value.

gradient(y, load) = 0 with one more equation, direction . y = place. Next to a limit point the load is then a smooth
function of `place` with a maximum, and at it the slope of y is the direction in which stiffness is lost. No derivatives
pass through (see implicit.implicit).

Libraries that were looked at: those of `continuation` and of `minimise`. It is a page of its own since the equations of
an energy come with their Hessian here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .choice import largest
from .small_linear import solve

Vector = Float[Array, " n"]
Scalar = Float[Array, ""]
Linear = Callable[[Vector, Scalar], tuple[Vector, Float[Array, "n n"], Vector]]
"""(y, load) -> gradient, Hessian, d gradient / d load."""

CONVERGED = 1e-9
"""Moves this small leave an error below rounding: the next one would be their square."""
NEWTON_STEPS = 8
TOP_STEPS = 30
FLAT = 1e-9
"""Slope of the load that counts as a limit point: the load is then right to the square of it."""


class Held(NamedTuple):
    """A point with its tangent, per unit of `place`."""

    y: Vector
    load: Scalar
    along: Vector
    """dy / dplace."""
    rise: Scalar
    """dload / dplace."""
    good: Bool[Array, ""]


def _correct(linear: Linear, y: Vector, load: Scalar, direction: Vector, place: Scalar):
    """One Newton step and the tangent: two right-hand sides of one bordered matrix."""
    gradient, hessian, by_load = linear(y, load)
    n = y.shape[0]
    matrix = jnp.zeros((n + 1, n + 1), y.dtype).at[:n, :n].set(hessian).at[:n, n].set(by_load).at[n, :n].set(direction)
    right = jnp.zeros((n + 1, 2), y.dtype)
    right = right.at[:n, 0].set(-gradient).at[n, 0].set(place - direction @ y).at[n, 1].set(1.0)
    step, tangent = solve(matrix, right).T
    return y + step[:n], load + step[n], tangent[:n], tangent[n], largest(jnp.abs(step))


def hold(linear: Linear, y: Vector, load: Scalar, direction: Vector, place: Scalar) -> Held:
    """The equilibrium with direction . y = place next to (y, load)."""

    def step(state):
        y, load, _, _, _, count = state
        return *_correct(linear, y, load, direction, place), count + 1

    def busy(state):
        return (state[4] > CONVERGED) & (state[5] < NEWTON_STEPS)

    far = jnp.asarray(jnp.inf, y.dtype)
    start = (y, load, y, load, far, jnp.asarray(0))
    y, load, along, rise, size, _ = lax.while_loop(busy, step, start)
    return Held(y, load, along, rise, size <= jnp.sqrt(CONVERGED))


class Top(NamedTuple):
    """A limit point."""

    y: Vector
    load: Scalar
    along: Vector
    good: Bool[Array, ""]
    steps: Int[Array, ""]


def top(linear: Linear, y: Vector, load: Scalar, direction: Vector, reach: Scalar) -> Top:
    """The limit point next to an equilibrium shortly below it: the secant method for dload / dplace = 0.

    Newton steps and secant steps alternate in one loop. reach: the first step, and the largest, of `place`.
    """

    def step(state):
        y, load, along, place, old_place, old_rise, rise, _, _, count = state
        y, load, along, rise, size = _correct(linear, y, load, direction, place)
        # A slope is only trusted once the point is near the path.
        near = size < 1e-2 * reach
        change = rise - old_rise
        secant = -rise * (place - old_place) / jnp.where(change == 0, 1.0, change)
        ahead = jnp.where(jnp.isfinite(old_rise) & (change != 0), secant, jnp.sign(rise) * reach)
        ahead = jnp.where(near, jnp.clip(ahead, -reach, reach), 0.0)
        y, load = y + ahead * along, load + ahead * rise
        old_place, old_rise = jnp.where(near, place, old_place), jnp.where(near, rise, old_rise)
        return y, load, along, place + ahead, old_place, old_rise, rise, size, jnp.abs(ahead), count + 1

    def busy(state):
        size, ahead, count = state[7:]
        return ((size > CONVERGED) | (ahead > CONVERGED)) & (count < TOP_STEPS)

    unknown = jnp.asarray(jnp.nan, y.dtype)
    place, far = direction @ y, jnp.asarray(jnp.inf, y.dtype)
    start = (y, load, y, place, place, unknown, unknown, far, far, jnp.asarray(0))
    y, load, along, _, _, _, _, size, ahead, count = lax.while_loop(busy, step, start)
    good = (size <= CONVERGED) & (ahead <= CONVERGED)
    return Top(y, load, along, good, count)
