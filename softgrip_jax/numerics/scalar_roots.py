"""Roots of one unknown in a bracket: values only, so a search may branch, bisect and stop as it likes.

`implicit.implicit` attaches the derivatives to what is found.

Libraries that were looked at: `optimistix.Bisection` halves its bracket, some 50 evaluations where interpolation needs
7, evaluates both ends, where loads may be singular, and asks for absolute tolerances; its Newton keeps no bracket and
may leave it for another root. `jaxopt.Bisection` halves, too, and JAXopt is no longer maintained. SciPy's brentq and
chandrupatla are not compiled with the equations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from .xla import materialised

MAX_BRACKET_STEPS = 100
"""Bisection alone halves a bracket to the last bit of a double in about 60 steps (more for a root at zero);
interpolation usually needs 7."""


class Root(NamedTuple):
    """A root and what it took."""

    x: Float[Array, ""]
    iterations: Int[Array, ""]


def bracketed_root(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    low: Float[Array, ""],
    high: Float[Array, ""],
) -> Root:
    """The root of a scalar `function` between `low`, where it is negative, and `high`, where it is positive.

    Inverse quadratic interpolation where three values allow it, else bisection (Chandrupatla 1997; Scherer,
    Computational Physics, 6.1.7): it needs no derivative, so it is cheap to compile, and it ends for any continuous
    function. The ends are never evaluated, so the function may be singular there; without a change of sign the answer
    is the end that is nearest to one. No derivatives pass through: see `implicit`.
    """
    low, high = lax.stop_gradient((low, high))
    # Whatever the function closes over is frozen too: a loop cannot be differentiated in reverse.
    function, constants = jax.closure_convert(function, high)
    constants = lax.stop_gradient(constants)
    eps = jnp.finfo(low.dtype).eps
    unknown = jnp.full_like(high, jnp.nan)

    # x: newest point; y: nearest point on the other side of the root; z: the point before. `above`: x is too high.
    # best: the smallest residual so far. Within rounding of the root XLA may evaluate `function` twice with different
    # signs (fused once here, once there); the bracket is then lost, but the root has been seen.
    def step(state):
        x, y, z, fx, fy, fz, above, part, best, f_best, count = state
        new = x + part * (y - x)
        f = function(new, *constants)
        same = (f > 0) == above
        z, fz = jnp.where(same, x, y), jnp.where(same, fx, fy)
        y, fy = jnp.where(same, y, x), jnp.where(same, fy, fx)
        y, fy = jnp.where(f == 0, new, y), jnp.where(f == 0, f, fy)
        x, fx, above = new, f, f > 0
        xi, phi = (x - y) / (z - y), (fx - fy) / (fz - fy)
        smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        inverse = fx / (fy - fx) * fz / (fy - fz) + (z - x) / (y - x) * fx / (fz - fx) * fy / (fz - fy)
        least = tolerance(x) / jnp.abs(y - x)
        part = jnp.clip(jnp.where(smooth, inverse, 0.5), least, 1 - least)
        closer = jnp.isnan(f_best) | (jnp.abs(f) < jnp.abs(f_best))
        best, f_best = jnp.where(closer, new, best), jnp.where(closer, f, f_best)
        return x, y, z, fx, fy, fz, above, part, best, f_best, count + 1

    def tolerance(x):
        # Two points closer than this have no midpoint left to try.
        return eps * jnp.abs(x)

    def busy(state):
        # Written so that a NaN ends the loop.
        x, y, count = state[0], state[1], state[-1]
        return (jnp.abs(y - x) > 2 * tolerance(x)) & (count < MAX_BRACKET_STEPS)

    half = jnp.full_like(high, 0.5)
    start = (high, low, high, unknown, unknown, unknown, jnp.asarray(True), half, high, unknown, jnp.asarray(0))
    x, _, _, _, fy, _, _, _, best, _, count = lax.while_loop(busy, step, start)
    # One side never evaluated: no change of sign was seen, and x has run to that end.
    return Root(jnp.where(jnp.isnan(fy), x, best), count)


def newton_bracketed(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    low: Float[Array, ""],
    high: Float[Array, ""],
    guess: Float[Array, ""],
) -> Root:
    """The root of a smooth `function` between `low`, where it is negative, and `high`, where it is positive.

    Newton's method from `guess`, with bisection where a step leaves the bracket or does not halve the last one (Press
    et al., Numerical Recipes, 9.4): fewer and cheaper steps than `bracketed_root` where there is a good guess. An empty
    bracket takes no step. It ends where a step is below sqrt(eps) of x and the next one would be below eps of x, as the
    last two steps tell. No derivatives pass through: see `implicit`.
    """
    low, high, guess = lax.stop_gradient((low, high, guess))
    function, constants = jax.closure_convert(function, high)
    constants = lax.stop_gradient(constants)
    eps = jnp.finfo(low.dtype).eps

    # last: the size of the last move, negative where it was no Newton step, and 0 once the search is over. Few arrays
    # go round the loop: in a large batch it is they that take the time.
    def step(state):
        x, low, high, last, count = state
        f, slope = map(materialised, jax.jvp(lambda x: function(x, *constants), (x,), (jnp.ones_like(x),)))
        above = f > 0
        low, high = jnp.where(above, low, x), jnp.where(above, x, high)
        move = f / slope
        size = jnp.abs(move)
        good = (x - move > low) & (x - move < high) & (size <= 0.5 * jnp.abs(last))
        # Moves e, C e^2, C (C e^2)^2: what the last two tell of the next one, for next to a pole C is anything. The
        # first move and one that follows a bisection tell nothing, however short they are.
        newton = jnp.maximum(last, 0.0)
        is_last = (size <= jnp.sqrt(eps) * jnp.abs(x)) & (size**3 <= eps * jnp.abs(x) * newton**2)
        is_last |= size <= eps * jnp.abs(x)
        new = jnp.where(good, x - move, 0.5 * (low + high))
        last = jnp.where(good, size, -jnp.abs(new - x))
        new = jnp.where(is_last, jnp.clip(x - move, low, high), new)
        return new, low, high, jnp.where(is_last, 0.0, last), count + 1

    def busy(state):
        x, low, high, last, count = state
        return (last != 0) & (high - low > 2 * eps * jnp.abs(x)) & (count < MAX_BRACKET_STEPS)

    inside = (guess >= low) & (guess <= high)
    start = (jnp.where(inside, guess, 0.5 * (low + high)), low, high, low - high, jnp.asarray(0))
    x, *_, count = lax.while_loop(busy, step, start)
    return Root(x, count)
