"""Sums over a grid of points of products of polynomials, one axis after the other.

A polynomial of the membrane is X(xi) Y(eta), and its points are all pairs of places along both axes. A sum over the
points is therefore one over xi, then one over eta (sum factorisation): for a Hessian with n x m polynomials and
q x r points this takes n^2 q r + n^2 m^2 r products in place of n^2 m^2 q r, and far smaller tables.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Side = Float[np.ndarray, "n d q"]
"""Of n polynomials along one axis: value, slope and curvature at q places."""
Pairs = Sequence[tuple[int, int, int, int]]
"""(i, r, j, s): the second derivative by derivative r of component i and s of j; those with i > j are not looked at."""


class Patch(NamedTuple):
    """The polynomials of u, v, w on a grid of points, which are in the order of x, then y."""

    sides: tuple[tuple[Side, Side], ...]
    """Of u, v, w: along x and along y."""
    orders: tuple[tuple[int, int], ...]
    """Derivatives by (xi, eta) that are asked for."""

    @property
    def shape(self) -> tuple[int, int]:
        """Points along x and y."""
        x, y = self.sides[0]
        return x.shape[-1], y.shape[-1]

    @property
    def size(self) -> int:
        """Points."""
        return self.shape[0] * self.shape[1]


def at_grid(parts: Sequence[Array], patch: Patch) -> Float[Array, "q c r"]:
    """Derivatives of u, v, w at the points, from their coefficients."""
    columns, (across, along) = _columns(patch)
    found = []
    for (x, y), part in zip(patch.sides, parts, strict=True):
        halves = jnp.reshape(part, (len(x), len(y))) @ _flat(y[:, :along])
        both = jnp.reshape(_flat(x[:, :across]).T @ halves, (across, x.shape[-1], along, y.shape[-1]))
        by_order = jnp.reshape(jnp.transpose(both, (0, 2, 1, 3)), (across * along, -1))
        found.append(by_order[columns])
    return jnp.transpose(jnp.stack(found), (2, 0, 1))


def weighted(slopes: Float[Array, "q c r"], patch: Patch) -> Float[Array, " size"]:
    """Sum over the points of slopes by these derivatives: slopes by the coefficients."""
    columns, (across, along) = _columns(patch)
    spread = jnp.zeros((len(patch.sides), across * along, len(slopes)), slopes.dtype)
    spread = spread.at[:, columns].set(jnp.transpose(slopes, (1, 2, 0)))
    spread = jnp.transpose(jnp.reshape(spread, (-1, across, along, *patch.shape)), (0, 1, 3, 2, 4))
    rows = [
        _flat(x[:, :across]) @ jnp.reshape(part, (across * x.shape[-1], -1)) @ _flat(y[:, :along]).T
        for (x, y), part in zip(patch.sides, spread, strict=True)
    ]
    return jnp.concatenate([jnp.reshape(row, -1) for row in rows])


def assembled(found: Pairs, curved: Float[Array, "p q"], patch: Patch) -> Float[Array, "size size"]:
    """Sum over the points of second derivatives by these derivatives: the Hessian by the coefficients."""
    columns, (across, along) = _columns(patch)
    pairs = list(itertools.combinations_with_replacement(range(len(patch.sides)), 2))
    # Where each of the given derivatives belongs among all pairs of orders along x and y; the others are zero.
    places = np.full((len(pairs), across, across, along, along), len(found))
    for number, (i, r, j, s) in enumerate(found):
        if i <= j:
            (a, b), (c, d) = divmod(columns[r], along), divmod(columns[s], along)
            places[pairs.index((i, j)), a, c, b, d] = number
    values = jnp.concatenate([curved, jnp.zeros_like(curved[:1])])
    spread = jnp.reshape(values[places], (len(pairs), across**2, along**2, *patch.shape))
    spread = jnp.transpose(spread, (0, 1, 3, 2, 4))
    blocks: dict[tuple[int, int], Array] = {}
    for (i, j), part in zip(pairs, spread, strict=True):
        (x, y), (other_x, other_y) = patch.sides[i], patch.sides[j]
        halves = _crossed(x[:, :across], other_x[:, :across]) @ jnp.reshape(part, (across**2 * patch.shape[0], -1))
        sums = halves @ _crossed(y[:, :along], other_y[:, :along]).T
        sums = jnp.reshape(sums, (len(x), len(other_x), len(y), len(other_y)))
        blocks[i, j] = jnp.reshape(jnp.transpose(sums, (0, 2, 1, 3)), (len(x) * len(y), -1))
        blocks[j, i] = blocks[i, j].T
    count = range(len(patch.sides))
    return jnp.concatenate([jnp.concatenate([blocks[i, j] for j in count], axis=1) for i in count])


def _columns(patch: Patch) -> tuple[np.ndarray, tuple[int, int]]:
    """Of the orders: their numbers among all of the same number of derivatives along x and along y; and how many those
    are."""
    across, along = (int(n) for n in 1 + np.max(patch.orders, axis=0))
    return np.array([a * along + b for a, b in patch.orders]), (across, along)


def _crossed(one: Side, other: Float[np.ndarray, "m d q"]) -> Float[np.ndarray, "nm ddq"]:
    """Products of all pairs, of each pair of derivatives, at each place."""
    products = np.einsum("naq,mcq->nmacq", one, other)
    return products.reshape(len(one) * len(other), -1)


def _flat(table: Side) -> np.ndarray:
    return table.reshape(len(table), -1)
