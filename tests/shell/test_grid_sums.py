"""Sums over grids, one axis after the other, against the same sums point by point, in NumPy."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.shell.energy.basis import ORDERS
from softgrip_jax.shell.energy.grid_sums import Patch, assembled, at_grid, weighted
from softgrip_jax.shell.energy.sheet import chained_face, local

COUNTS = ((2, 3), (3, 2), (4, 1))
"""Polynomials of u, v, w along both axes."""


def patch(orders):
    random = np.random.default_rng(0)
    sides = tuple((random.normal(size=(n, 3, 5)), random.normal(size=(m, 3, 4))) for n, m in COUNTS)
    return Patch(sides, orders)


def dense(patch):
    """Each derivative of each component at each point, by all coefficients: (points, component, order, size)."""
    sizes = [len(x) * len(y) for x, y in patch.sides]
    found = np.zeros((patch.size, len(sizes), len(patch.orders), sum(sizes)))
    for c, (x, y) in enumerate(patch.sides):
        for r, (a, b) in enumerate(patch.orders):
            product = np.einsum("nq,mr->qrnm", x[:, a], y[:, b]).reshape(patch.size, -1)
            found[:, c, r, sum(sizes[:c]) : sum(sizes[: c + 1])] = product
    return found


ALL = pytest.mark.parametrize("orders", [ORDERS[:3], ORDERS[1:], ORDERS[1:2], ORDERS[2:3]])


@ALL
def test_derivatives_and_their_weighted_sums(orders):
    """Values and slopes, slopes and curvatures, and one slope alone, as at clamped edges."""
    grid, random = patch(orders), np.random.default_rng(1)
    table = dense(grid)
    y, slopes = random.normal(size=table.shape[3]), random.normal(size=table.shape[:3])
    parts = np.split(y, np.cumsum([n * m for n, m in COUNTS])[:-1])
    found = at_grid([jnp.asarray(part) for part in parts], grid)
    np.testing.assert_allclose(found, table @ y, rtol=0, atol=1e-12 * np.max(np.abs(table @ y)))
    sums = np.einsum("qcrk,qcr->k", table, slopes)
    np.testing.assert_allclose(weighted(jnp.asarray(slopes), grid), sums, rtol=0, atol=1e-12 * np.max(np.abs(sums)))


@ALL
@pytest.mark.parametrize("some", [False, True])
def test_hessians(orders, some):
    """From all pairs of derivatives, or from some: the others are zero."""
    grid, random = patch(orders), np.random.default_rng(2)
    table, count = dense(grid), range(len(orders))
    curved = random.normal(size=(3, len(orders), 3, len(orders), grid.size))
    curved = curved + np.transpose(curved, (2, 3, 0, 1, 4))
    if some:
        kept = random.uniform(size=curved.shape[:4]) < 0.5
        curved = curved * (kept & np.transpose(kept, (2, 3, 0, 1)))[..., None]
    pairs = [key for key in itertools.product(range(3), count, range(3), count) if not some or np.any(curved[key])]
    rows = jnp.asarray(np.reshape([curved[key] for key in pairs], (-1, grid.size)))
    whole = np.einsum("qcrk,crdsq,qdsl->kl", table, curved, table)
    np.testing.assert_allclose(assembled(pairs, rows, grid), whole, rtol=0, atol=1e-12 * np.max(np.abs(whole)))


def test_derivatives_of_a_function_of_the_outer_face():
    """Where the face presses on an object, chained by hand, as JAX finds them."""
    random = np.random.default_rng(3)
    e, point = jnp.asarray(0.4 * random.normal(size=(3, 3))), jnp.asarray([0.3, -0.6])
    aspect, thickness = jnp.asarray(0.4), jnp.asarray(0.2)
    square = random.normal(size=(3, 3))

    def energy(face):
        return jnp.sum(jnp.sin(square @ face)) + face[0] * face[2] ** 2

    def of_e(e):
        return energy(local(e, point, aspect).face(thickness))

    @jax.jit
    def both(e):
        at = local(e, point, aspect)
        face = at.face(thickness)
        found = chained_face(at, aspect, thickness, jax.grad(energy)(face), jax.hessian(energy)(face))
        return found, (jax.grad(of_e)(e), jax.hessian(of_e)(e))

    for one, other in zip(*both(e), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.max(np.abs(other)))
