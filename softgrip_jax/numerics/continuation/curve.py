"""The curve of a path at equal arc lengths."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..choice import select
from .newton import FINE, NEWTON_STEPS, Local, Scalar, Vector, goes_on, has_converged, newton_from, newton_step
from .points import Point, arrived
from .search import FLAT, LONGER, SHORTER, SMALLEST_STEP

HUNT_STEPS = 60
"""Trials for a limit point at most, from the point that is next to it."""


class Hunt(NamedTuple):
    """A limit point between a point where the load still rises and one behind where it falls."""

    on: Bool[Array, ""]
    base: Point
    """The last point where the load rises."""
    ahead: Scalar
    """Arc length from there of the next trial."""
    high: Scalar
    """... and of the nearest point where the load falls, about; inf where none is known."""
    rise_low: Scalar
    rise_high: Scalar
    """Load components of the tangent at both; one that stays twice counts half (Illinois)."""
    rose: Int[Array, ""]
    """Whether the last trial was still rising (1) or not (-1); 0 before the first."""
    count: Int[Array, ""]


def _begun(before: Point, new: Point, step: Scalar, wanted: Bool[Array, ""]) -> Hunt:
    """From two points that are a `step` apart."""
    low, high = before.tangent[-1], new.tangent[-1]
    rising = high > 0
    share = low / jnp.where(low > high, low - high, 1.0)
    hunt = Hunt(
        on=wanted & (low > 0) & (jnp.abs(high) > FLAT),
        base=select(rising, new, before),
        ahead=step * jnp.where(rising, jnp.where(low > high, jnp.clip(share - 1, 0.0, 1.0), 1.0), share),
        high=jnp.where(rising, jnp.inf, step),
        rise_low=jnp.where(rising, high, low),
        rise_high=high,
        rose=jnp.zeros((), int),
        count=jnp.zeros((), int),
    )
    return hunt


def _after_trial(hunt: Hunt, new: Point, good: Bool[Array, ""]) -> Hunt:
    rise = new.tangent[-1]
    rising = rise > 0
    side = jnp.where(rising, 1, -1)
    again = jnp.where(side == hunt.rose, 0.5, 1.0)
    # Arc lengths are those along tangents: what is left is a little more than their difference.
    high = jnp.where(rising, hunt.high - 0.9 * hunt.ahead, hunt.ahead)
    low_rise = jnp.where(rising, rise, again * hunt.rise_low)
    high_rise = jnp.where(rising, again * hunt.rise_high, rise)
    between = high * low_rise / (low_rise - high_rise)
    closer = hunt._replace(
        on=(jnp.abs(rise) > FLAT) & (hunt.count < HUNT_STEPS),
        base=select(rising | (jnp.abs(rise) <= FLAT), new, hunt.base),
        ahead=jnp.where(jnp.isfinite(high), between, hunt.ahead),
        high=high,
        rise_low=low_rise,
        rise_high=high_rise,
        rose=side,
        count=hunt.count + 1,
    )
    shorter = SHORTER * hunt.ahead
    failed = hunt._replace(
        on=(shorter > SMALLEST_STEP**2) & (hunt.count < HUNT_STEPS), ahead=shorter, count=hunt.count + 1
    )
    return select(good, closer, failed)


def trace(
    residual: Callable[[Vector], Vector], u: Vector, step: Scalar | float, n: int, level: Int[Array, ""] | int = 0
) -> tuple[Float[Array, "k m"], Bool[Array, " k"]]:
    """n points of the path from u at equal arc lengths, through any limit point; and which are trusted.

    The point `level`, counted from 0, is to lie next to a limit point, and is moved there, by regula falsi; none where
    it is 0.
    """
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

    def next_point(state, index):
        before, length, alive = state

        def attempt(state):
            point, length, rest, hunt = state
            ahead = jnp.where(hunt.on, hunt.ahead, jnp.minimum(length, rest))
            origin = select(hunt.on, hunt.base, point)
            new, good = correct(origin, origin.u + ahead * origin.tangent)
            left = jnp.where(good & ~hunt.on, rest - ahead, rest)
            begun = _begun(before, new, zero + step, good & (left <= 0) & (index == level))
            hunted = select(hunt.on, _after_trial(hunt, new, good), begun)
            moved = jnp.where(hunt.on, length, jnp.where(good, LONGER, SHORTER) * length)
            kept = select(hunt.on, hunted.base, select(good, new, point))
            return kept, moved, left, hunted

        def busy(state):
            _, length, rest, hunt = state
            return alive & (hunt.on | ((rest > 0) & (length > SMALLEST_STEP)))

        none = _begun(before, before, zero + step, jnp.asarray(False))
        point, length, rest, _ = lax.while_loop(busy, attempt, (before, length, zero + step, none))
        alive = alive & (rest <= 0)
        return (point, length, alive), (point.u, alive)

    _, (points, alive) = lax.scan(next_point, (start, zero + step, jnp.asarray(True)), jnp.arange(1, n))
    return jnp.concatenate([start.u[None], points]), jnp.concatenate([jnp.ones(1, bool), alive])
