"""Few linear equations with as many unknowns, in large batches: where a call of LAPACK costs more than the model.

Libraries that were looked at: `jnp.linalg.solve` and lineax call LAPACK once for every member of a batch, and neither
gives the sign of the determinant, by which a path knows its branch, from the same factorisation.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float


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
"""Up to so many unknowns batch members are eliminated side by side: a quarter of LAPACK's time with ten. With more,
writing out every step takes long to compile."""


@custom_vmap
def solve_and_sign(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, ""]]:
    """matrix @ x = right by one LU factorisation, and the sign of the determinant from it.

    The right sides are factorised along with the matrix: what is left of them is solved for by the upper part alone.
    """
    n = matrix.shape[0]
    factors, pivots, _ = lax.linalg.lu(jnp.concatenate([matrix, right], axis=1))
    x = lax.linalg.triangular_solve(factors[:, :n], factors[:, n:], left_side=True, lower=False)
    return x, _sign(factors, pivots)


def by_square_factors(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, ""]]:
    """The same from factors of the matrix alone: a GPU's library factorises square matrices of a batch side by side,
    and others one after the other, which takes a batch of 512 some twenty milliseconds."""
    factors, pivots, order = lax.linalg.lu(matrix)
    below = lax.linalg.triangular_solve(factors, right[order], left_side=True, lower=True, unit_diagonal=True)
    x = lax.linalg.triangular_solve(factors, below, left_side=True, lower=False)
    return x, _sign(factors, pivots)


def _sign(factors: Float[Array, "n m"], pivots: Array) -> Float[Array, ""]:
    """Of the determinant, from the factors of a matrix and the rows that were swapped."""
    swaps = jnp.sum(pivots != jnp.arange(len(factors), dtype=pivots.dtype))
    return jnp.prod(jnp.sign(jnp.diagonal(factors))) * jnp.where(swaps % 2 == 0, 1.0, -1.0)


@solve_and_sign.def_vmap
def _of_batch(size, is_batched, matrix, right):
    """By Gaussian elimination with row pivoting, the batch along the last axis, where a CPU's vectors run."""
    matrix, right = (
        v if batched else jnp.broadcast_to(v, (size, *v.shape))
        for v, batched in zip((matrix, right), is_batched, strict=True)
    )
    n = matrix.shape[1]
    if n > ELIMINATED:
        one = solve_and_sign.fun if jax.default_backend() == "cpu" else by_square_factors
        return jax.vmap(one)(matrix, right), (True, True)
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
