"""Few linear equations with as many unknowns, in large batches: where a call of LAPACK costs more than the model.

Libraries that were looked at: `jnp.linalg.solve` and lineax call LAPACK once for every member of a batch, and neither
gives the sign of the determinant, by which a path knows its branch, from the same factorisation.

On a CPU LAPACK is called for one member of a batch after the other. jaxlib before 0.11 gives a batch in pieces to the
threads that run the program; where each of them has such a batch and waits for its pieces, none is left to work on
them, and the program hangs (seen with two threads).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jax.scipy.linalg import lu_factor, lu_solve
from jaxtyping import Array, Bool, Float

from .batching import in_turn, one_at_a_time


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
    return solve(matrix, right)


# Without the defaults of SciPy's signatures, which a rule for batches would take for arrays.
_factors = in_turn(lambda matrix: lu_factor(matrix))
_by_factors = in_turn(lambda factors, right: lu_solve(factors, right))
_by_transposed = in_turn(lambda factors, right: lu_solve(factors, right, trans=1))


def solve(matrix: Float[Array, "n n"], right: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """matrix @ x = right, as `jnp.linalg.solve`, by LAPACK; with derivatives of any order."""
    factors = _factors(lax.stop_gradient(matrix))
    return lax.custom_linear_solve(
        lambda x: matrix @ x,
        right,
        lambda _, b: _by_factors(factors, b),
        lambda _, b: _by_transposed(factors, b),
    )


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
    x, diagonal, pivots = _by_lapack(jnp.concatenate([matrix, right], axis=1))
    return x, _sign(diagonal, pivots)


def _by_lapack(rows: Float[Array, "n m"]) -> tuple[Float[Array, "n k"], Float[Array, " n"], Array]:
    """From a matrix with its right sides: x, the diagonal of the factors, and the rows that were swapped."""
    n = len(rows)
    factors, pivots, _ = lax.linalg.lu(rows)
    x = lax.linalg.triangular_solve(factors[:, :n], factors[:, n:], left_side=True, lower=False)
    return x, jnp.diagonal(factors), pivots


@custom_vmap
def solve_and_renew(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"], inverse: Float[Array, "n n"], wanted: Bool[Array, ""]
) -> tuple[Float[Array, "n k"], Float[Array, ""], Float[Array, "n n"]]:
    """`solve_and_sign`, and the inverse of the matrix: a new one where that is wanted, which takes twice the time with
    many unknowns, else the one that is given (in a batch it may be new all the same)."""
    x, inverse, diagonal, pivots = _renewed(matrix, right, inverse, wanted)
    return x, _sign(diagonal, pivots), inverse


def _renewed(matrix, right, inverse, wanted) -> tuple[Array, Array, Array, Array]:
    """(x, inverse, the diagonal of the factors, the rows that were swapped)."""
    n, k = right.shape

    def anew(_):
        x, *signs = _by_lapack(jnp.concatenate([matrix, right, jnp.eye(n, dtype=matrix.dtype)], axis=1))
        return x[:, :k], x[:, k:], *signs

    def kept(inverse):
        x, *signs = _by_lapack(jnp.concatenate([matrix, right], axis=1))
        return x, inverse, *signs

    return lax.cond(wanted, anew, kept, inverse)


@solve_and_renew.def_vmap
def _renewed_of_batch(size, is_batched, *given):
    """On a CPU, where LAPACK takes one member after the other, each has its own choice."""
    matrix, right, inverse, wanted = (
        v if batched else jnp.broadcast_to(v, (size, *jnp.shape(v)))
        for v, batched in zip(given, is_batched, strict=True)
    )
    n, k = right.shape[1:]
    if n > ELIMINATED and one_at_a_time():
        x, inverse, *signs = lax.map(lambda one: _renewed(*one), (matrix, right, inverse, wanted))
        return (x, jax.vmap(_sign)(*signs), inverse), (True, True, True)
    unit = jnp.broadcast_to(jnp.eye(n, dtype=matrix.dtype), (size, n, n))
    x, sign = jax.vmap(solve_and_sign)(matrix, jnp.concatenate([right, unit], axis=2))
    return (x[:, :, :k], sign, x[:, :, k:]), (True, True, True)


def by_square_factors(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, ""]]:
    """The same from factors of the matrix alone: a GPU's library factorises square matrices of a batch side by side,
    and others one after the other, which takes a batch of 512 some twenty milliseconds."""
    factors, pivots, order = lax.linalg.lu(matrix)
    below = lax.linalg.triangular_solve(factors, right[order], left_side=True, lower=True, unit_diagonal=True)
    x = lax.linalg.triangular_solve(factors, below, left_side=True, lower=False)
    return x, _sign(jnp.diagonal(factors), pivots)


def _sign(diagonal: Float[Array, " n"], pivots: Array) -> Float[Array, ""]:
    """Of the determinant, from the diagonal of the factors and the rows that were swapped."""
    swaps = jnp.sum(pivots != jnp.arange(len(diagonal), dtype=pivots.dtype))
    return jnp.prod(jnp.sign(diagonal)) * jnp.where(swaps % 2 == 0, 1.0, -1.0)


@solve_and_sign.def_vmap
def _of_batch(size, is_batched, matrix, right):
    """By Gaussian elimination with row pivoting, the batch along the last axis, where a CPU's vectors run."""
    matrix, right = (
        v if batched else jnp.broadcast_to(v, (size, *v.shape))
        for v, batched in zip((matrix, right), is_batched, strict=True)
    )
    n = matrix.shape[1]
    if n > ELIMINATED:
        if one_at_a_time():
            x, *signs = lax.map(_by_lapack, jnp.concatenate([matrix, right], axis=2))
            return (x, jax.vmap(_sign)(*signs)), (True, True)
        return jax.vmap(by_square_factors)(matrix, right), (True, True)
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
