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
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Float, Int

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
        part = jnp.clip(jnp.where(smooth & jnp.isfinite(inverse), inverse, 0.5), least, 1 - least)
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
        verified = (size <= jnp.sqrt(eps) * jnp.abs(x)) & (size**3 <= eps * jnp.abs(x) * newton**2)
        verified |= size <= eps * jnp.abs(x)
        new = jnp.where(good, x - move, 0.5 * (low + high))
        last = jnp.where(good, size, -jnp.abs(new - x))
        new = jnp.where(verified, jnp.clip(x - move, low, high), new)
        return new, low, high, jnp.where(verified, 0.0, last), count + 1

    def busy(state):
        x, low, high, last, count = state
        return (last != 0) & (high - low > 2 * eps * jnp.abs(x)) & (count < MAX_BRACKET_STEPS)

    inside = (guess >= low) & (guess <= high)
    start = (jnp.where(inside, guess, 0.5 * (low + high)), low, high, low - high, jnp.asarray(0))
    x, *_, count = lax.while_loop(busy, step, start)
    return Root(x, count)


def select(condition: Bool[Array, ""], a: Any, b: Any) -> Any:
    """The tree a where the condition holds, else b."""
    return jax.tree.map(lambda x, y: jnp.where(condition, x, y), a, b)


def solve_small(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """matrix @ x = right; Cramer's rule for up to three unknowns, where a batched LU costs more than the model."""
    n = right.shape[0]
    if n == 1:
        return right / matrix[0]
    if n == 2:
        (a, b), (c, d) = matrix
        return jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)
    if n == 3:
        (a, b, c), (d, e, f), (g, h, i) = matrix
        p, q, r = right
        ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
        x = p * ei + q * (c * h - b * i) + r * (b * f - c * e)
        y = p * fg + q * (a * i - c * g) + r * (c * d - a * f)
        z = p * dh + q * (b * g - a * h) + r * (a * e - b * d)
        return jnp.stack([x, y, z]) / (a * ei + b * fg + c * dh)
    return jnp.linalg.solve(matrix, right)


ELIMINATED = 12
"""Up to so many unknowns lanes are eliminated side by side: a quarter of LAPACK's time with ten. With more, writing
out every step takes long to compile."""


@custom_vmap
def solve_and_sign(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, ""]]:
    """matrix @ x = right by one LU factorisation, and the sign of the determinant from it.

    The right sides are factorised along with the matrix: what is left of them is solved for by the upper part alone.
    """
    n = matrix.shape[0]
    factors, pivots, _ = lax.linalg.lu(jnp.concatenate([matrix, right], axis=1))
    upper = factors[:, :n]
    swaps = jnp.sum(pivots != jnp.arange(n, dtype=pivots.dtype))
    sign = jnp.prod(jnp.sign(jnp.diagonal(upper))) * jnp.where(swaps % 2 == 0, 1.0, -1.0)
    return lax.linalg.triangular_solve(upper, factors[:, n:], left_side=True, lower=False), sign


@solve_and_sign.def_vmap
def _of_lanes(size, is_batched, matrix, right):
    """By Gaussian elimination with row pivoting, the lanes along the last axis, where a CPU's vectors run."""
    matrix, right = (
        v if batched else jnp.broadcast_to(v, (size, *v.shape))
        for v, batched in zip((matrix, right), is_batched, strict=True)
    )
    n = matrix.shape[1]
    if n > ELIMINATED:
        return jax.vmap(solve_and_sign.fun)(matrix, right), (True, True)
    rest = jnp.moveaxis(jnp.concatenate([matrix, right], axis=2), 0, -1)
    sign, rows = jnp.ones(size, matrix.dtype), []
    for _ in range(n):
        largest = jnp.argmax(jnp.abs(rest[:, 0]), axis=0)
        chosen = jnp.arange(len(rest))[:, None] == largest[None]
        row = jnp.sum(jnp.where(chosen[:, None], rest, 0.0), axis=0)
        sign = sign * jnp.sign(row[0]) * jnp.where(largest == 0, 1.0, -1.0)
        row = row[1:] / row[:1]
        others = jnp.where(chosen[1:, None], rest[:1], rest[1:])
        rest = others[:, 1:] - others[:, :1] * row[None]
        rows.append(row)
    x = []
    for k in reversed(range(n)):
        coefficients, value = jnp.split(rows[k], [n - 1 - k])
        x.insert(0, value - sum(c[None] * later for c, later in zip(coefficients, x, strict=True)))
    return (jnp.moveaxis(jnp.stack(x), -1, 0), sign), (True, True)


def implicit(residual: Callable[[Any, Any], Any], y: Float[Array, "*n"], args: Any) -> Float[Array, "*n"]:
    """`y`, which solves residual(y, args) = 0, with its derivative by `args`: dy = -(dr/dy)^-1 (dr/dargs) dargs.

    `y` is a scalar or a vector and the residual has its shape; `args` is any pytree of arrays. Where dr/dy is
    singular (a limit point) the derivative does not exist; a scalar root is then given derivative zero.
    `residual` must take every traced value through `args`: one that it closes over would outlive its trace.

    Not inside a `lax.scan`: where one is differentiated in reverse JAX drops custom rules from what it keeps for the
    next derivative (its partial evaluation keeps those of known arguments only; seen in 0.10.1), and that one would be
    wrong without a word.
    """

    @jax.custom_jvp
    def root(y, args):
        return y

    @root.defjvp
    def root_jvp(primals, tangents):
        y, args = primals
        y = root(y, args)  # differentiable again: second and higher derivatives

        def jacobian(y, args):
            if y.ndim:
                return jax.jacfwd(residual)(y, args)
            _, slope = jax.jvp(lambda x: residual(x, args), (y,), (jnp.ones_like(y),))
            return slope

        def move(jacobian, value):
            if y.ndim:
                return solve_small(jacobian, value)
            return jnp.where(jacobian == 0, 0.0, value / jnp.where(jacobian == 0, 1.0, jacobian))

        _, along_args = jax.jvp(lambda a: residual(y, a), (args,), (tangents[1],))
        return y, -move(jacobian(y, args), along_args)

    return root(lax.stop_gradient(y), args)


def with_derivatives_of(function: Callable[[Any], Any], value: Any, args: Any) -> Any:
    """`value`, which is function(args) and known already, with that function's derivatives; it runs for those alone.

    As in `implicit`, `function` must take every traced value through `args`.
    """

    @jax.custom_jvp
    def same(value, args):
        return value

    @same.defjvp
    def rule(primals, tangents):
        return jax.jvp(function, (primals[1],), (tangents[1],))

    return same(lax.stop_gradient(value), args)
