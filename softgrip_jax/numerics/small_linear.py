"""Few linear equations with as many unknowns, in large batches: where a call of LAPACK costs more than the model.

Libraries that were looked at: `jnp.linalg.solve` and lineax call LAPACK once for every member of a batch, and neither
gives the sign of the determinant, by which a path knows its branch, from the same factorisation. Nor can a batch of
either be used on a CPU while others are: jaxlib 0.10 hands a large batch to several of XLA's threads and waits for them
in one of them, so as many large batches at once as there are threads wait for ever (two on a laptop's two cores, which
one program may well hold; jaxlib 0.11 no longer does it). Here batches are cut into chunks that stay in one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap, sequential_vmap
from jax.scipy.linalg import lu_factor, lu_solve
from jaxtyping import Array, Float

CHUNK, CHUNK_WORK = 64, 320_000
"""Members of a chunk, and members times unknowns cubed, at most: jaxlib 0.10.1 keeps half as much again in one
thread."""


def in_chunks(size: int, function: Callable[..., Any], *members: Array) -> Any:
    """function of each member of a batch, in chunks; the first of `members` are the matrices, shape (size, n, m)."""
    if jax.default_backend() != "cpu":
        return jax.vmap(function)(*members)
    most = max(1, min(CHUNK, CHUNK_WORK // members[0].shape[1] ** 3))
    chunk = min(size, 1 << (most.bit_length() - 1))  # a power of two, as batches mostly are: then nothing is left over
    of_chunk = sequential_vmap(jax.vmap(function))  # a batch of batches has no larger chunks
    whole = size - size % chunk
    if whole == chunk:
        found = of_chunk(*(v[:whole] for v in members))
    else:
        cut = tuple(v[:whole].reshape(whole // chunk, chunk, *v.shape[1:]) for v in members)
        found = jax.tree.map(lambda v: v.reshape(whole, *v.shape[2:]), lax.map(lambda part: of_chunk(*part), cut))
    if whole == size:
        return found
    rest = of_chunk(*(v[whole:] for v in members))
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), found, rest)


def _spread(size: int, is_batched: Any, values: tuple[Array, ...]) -> list[Array]:
    """Every value with the batch as its first axis."""
    pairs = zip(values, is_batched, strict=True)
    return [v if batched else jnp.broadcast_to(v, (size, *v.shape)) for v, batched in pairs]


@custom_vmap
def _factors(matrix: Float[Array, "n n"]) -> tuple[Float[Array, "n n"], Array]:
    return lu_factor(matrix)


@_factors.def_vmap
def _factors_of_batch(size, is_batched, matrix):
    return in_chunks(size, _factors.fun, matrix), (True, True)


def _with_factors(transposed: int) -> Callable[..., Any]:
    """(factors, pivots, right (n, k)) -> solution."""

    @custom_vmap
    def one(factors, pivots, right):
        return lu_solve((factors, pivots), right, trans=transposed)

    @one.def_vmap
    def of_batch(size, is_batched, factors, pivots, right):
        if is_batched[0]:
            return in_chunks(size, one.fun, *_spread(size, is_batched, (factors, pivots, right))), True
        # Many right sides of one matrix, as derivatives have them, are its columns.
        n, k = right.shape[1:]
        columns = jnp.moveaxis(right, 0, 1).reshape(n, size * k)
        return jnp.moveaxis(one(factors, pivots, columns).reshape(n, size, k), 1, 0), True

    return one


_plain, _transposed = _with_factors(0), _with_factors(1)


def solve_linear(matrix: Float[Array, "n n"], right: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """matrix @ x = right as by `jnp.linalg.solve`, with its derivatives; batches by chunks."""
    factors, pivots = _factors(lax.stop_gradient(matrix))

    def with_factors(one: Callable[..., Any]) -> Callable[..., Any]:
        return lambda _, b: one(factors, pivots, b.reshape(len(b), -1)).reshape(b.shape)

    return lax.custom_linear_solve(
        lambda x: matrix @ x, right, with_factors(_plain), transpose_solve=with_factors(_transposed)
    )


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
    return solve_linear(matrix, right)


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
    upper = factors[:, :n]
    swaps = jnp.sum(pivots != jnp.arange(n, dtype=pivots.dtype))
    sign = jnp.prod(jnp.sign(jnp.diagonal(upper))) * jnp.where(swaps % 2 == 0, 1.0, -1.0)
    return lax.linalg.triangular_solve(upper, factors[:, n:], left_side=True, lower=False), sign


@solve_and_sign.def_vmap
def _of_batch(size, is_batched, matrix, right):
    """By Gaussian elimination with row pivoting, the batch along the last axis, where a CPU's vectors run."""
    matrix, right = _spread(size, is_batched, (matrix, right))
    n = matrix.shape[1]
    if n > ELIMINATED:
        return in_chunks(size, solve_and_sign.fun, matrix, right), (True, True)
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
