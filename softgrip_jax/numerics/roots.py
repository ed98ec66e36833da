"""Roots of residual(y, args) = 0: first the number, then, apart from it, its derivative.

Finding a root and differentiating it are two steps here. The search runs on values without derivatives, so it may
branch, bisect and stop as it likes; :func:`implicit` then attaches the derivative by the implicit function theorem,
in forward and reverse mode and to any order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

MAX_BRACKET_STEPS = 80
"""Bisection alone halves a bracket to the last bit of a double in about 60 steps; Newton usually needs 5."""


class Root(NamedTuple):
    """A root and what it took."""

    x: Float[Array, ""]
    iterations: Int[Array, ""]


def bracketed_root(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    low: Float[Array, ""],
    high: Float[Array, ""],
) -> Root:
    """The root of a scalar `function` between `low` and `high`, where it changes sign: Newton kept inside a bracket.

    A step that leaves the bracket, or that shrinks too slowly, is replaced by bisection, so the search ends for any
    continuous function (Press et al., Numerical Recipes, "rtsafe"). No derivatives pass through: see `implicit`.
    """
    low, high = lax.stop_gradient((low, high))
    eps = jnp.finfo(low.dtype).eps

    def value_and_slope(x):
        return jax.jvp(function, (x,), (jnp.ones_like(x),))

    rising = function(high) > 0

    def step(state):
        x, lo, hi, before_last, last, count, _ = state
        f, slope = value_and_slope(x)
        above = (f > 0) == rising
        lo, hi = jnp.where(above, lo, x), jnp.where(above, x, hi)
        newton = -f / jnp.where(slope == 0, 1.0, slope)
        # Newton is kept while it stays inside and at least halves the step before the last one.
        good = (slope != 0) & (x + newton > lo) & (x + newton < hi) & (jnp.abs(newton) < 0.5 * jnp.abs(before_last))
        move = jnp.where(good, newton, 0.5 * (lo + hi) - x)
        # The last bit of x: a shorter step cannot change the result.
        done = (f == 0) | (jnp.abs(newton) <= eps * jnp.abs(x)) | (hi - lo <= eps * jnp.abs(hi))
        x = jnp.where(f == 0, x, jnp.where(done, jnp.where(good, x + newton, x), x + move))
        return x, lo, hi, last, move, count + 1, done

    def busy(state):
        return ~state[-1] & (state[-2] < MAX_BRACKET_STEPS)

    width = high - low
    start = (0.5 * (low + high), low, high, width, width, jnp.asarray(0), jnp.asarray(False))
    x, *_, count, _ = lax.while_loop(busy, step, start)
    return Root(x, count)


def newton_correct(function: Callable[[Float[Array, ""]], Float[Array, ""]], x: Float[Array, ""]) -> Float[Array, ""]:
    """One Newton step: removes the last rounding of a root."""
    f, slope = jax.jvp(function, (x,), (jnp.ones_like(x),))
    return x - jnp.where(slope == 0, 0.0, f / jnp.where(slope == 0, 1.0, slope))


def solve_small(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """matrix @ x = right; Cramer's rule for one and two unknowns, where a batched LU costs more than the model."""
    n = right.shape[0]
    if n == 1:
        return right / matrix[0]
    if n == 2:
        (a, b), (c, d) = matrix
        return jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)
    return jnp.linalg.solve(matrix, right)


def implicit(residual: Callable[[Any, Any], Any], y: Float[Array, "*n"], args: Any) -> Float[Array, "*n"]:
    """`y`, which solves residual(y, args) = 0, with its derivative by `args`: dy = -(dr/dy)^-1 (dr/dargs) dargs.

    `y` is a scalar or a vector and the residual has its shape; `args` is any pytree of arrays. Where dr/dy is
    singular (a limit point) the derivative does not exist; a scalar root is then given derivative zero.
    `residual` must take every traced value that it uses through `args`: one that it closes over would outlive its trace.
    """

    @jax.custom_jvp
    def root(y, args):
        return y

    @root.defjvp
    def root_jvp(primals, tangents):
        y, args = primals
        y = root(y, args)  # differentiable again: second and higher derivatives
        _, along_args = jax.jvp(lambda a: residual(y, a), (args,), (tangents[1],))
        if y.ndim == 0:
            _, slope = jax.jvp(lambda x: residual(x, args), (y,), (jnp.ones_like(y),))
            return y, jnp.where(slope == 0, 0.0, -along_args / jnp.where(slope == 0, 1.0, slope))
        return y, -solve_small(jax.jacfwd(residual)(y, args), along_args)

    return root(lax.stop_gradient(y), args)
