"""Linear systems in batches: LAPACK's answers member by member, with derivatives, and no batch waits for another."""

import os
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.small_linear import solve_and_sign, solve_linear

SIZES = [(4, 7), (17, 40), (17, 64), (17, 129), (40, 9)]
"""Unknowns and members: one chunk, whole chunks, and some left over."""


def systems(n, size, k=None):
    rng = np.random.default_rng(n)
    right = (size, n) if k is None else (size, n, k)
    return rng.normal(size=(size, n, n)), rng.normal(size=right)


@pytest.mark.parametrize(("n", "size"), SIZES)
def test_a_batch_is_solved_member_by_member(n, size):
    matrices, right = systems(n, size)
    found = jax.vmap(solve_linear)(jnp.asarray(matrices), jnp.asarray(right))
    np.testing.assert_allclose(found, np.linalg.solve(matrices, right[..., None])[..., 0], rtol=1e-8)
    both, sign = jax.vmap(solve_and_sign)(jnp.asarray(matrices), jnp.asarray(right)[..., None])
    np.testing.assert_allclose(both[..., 0], found, rtol=1e-8)
    np.testing.assert_array_equal(sign, np.linalg.slogdet(matrices)[0])


@pytest.mark.parametrize("shared", ["matrix", "right", "none"])
def test_batches_of_batches(shared):
    """3 times 5 systems, of which all share the matrix, the right side, or nothing."""
    matrices, right = (v.reshape(3, 5, *v.shape[1:]) for v in systems(17, 15))
    axes = {"matrix": (None, 0), "right": (0, None), "none": (0, 0)}[shared]
    given = [v if axis == 0 else v[0, 0] for v, axis in zip((matrices, right), axes, strict=True)]
    found = jax.vmap(jax.vmap(solve_linear, axes), axes)(*map(jnp.asarray, given))
    every = [np.broadcast_to(v, (3, 5, *v.shape[-k:])) for v, k in zip(given, (2, 1), strict=True)]
    np.testing.assert_allclose(found, np.linalg.solve(every[0], every[1][..., None])[..., 0], rtol=1e-9)


def test_derivatives_are_those_of_the_solution():
    """x = A^-1 b: dx = A^-1 (db - dA x), forward, reverse, twice, and in a batch."""
    (a, da, *_), (b, db, *_) = systems(6, 4)
    x = np.linalg.solve(a, b)
    slope = np.linalg.solve(a, db - da @ x)
    along = lambda t: solve_linear(jnp.asarray(a) + t * da, jnp.asarray(b) + t * db)  # noqa: E731
    np.testing.assert_allclose(jax.jacfwd(along)(0.0), slope, rtol=1e-9)
    np.testing.assert_allclose(jax.vmap(jax.jacrev(along))(jnp.zeros(2)), [slope, slope], rtol=1e-9)
    # Twice: A x'' = -2 A' x', with A'' = b'' = 0.
    curved = -2 * np.linalg.solve(a, da @ slope)
    for second in (jax.jacfwd(jax.jacfwd(along)), jax.jacrev(jax.jacfwd(along)), jax.jacfwd(jax.jacrev(along))):
        np.testing.assert_allclose(second(0.0), curved, rtol=1e-8)


def test_no_batch_waits_for_another():
    """Two of XLA's threads, and four programs at once that hold six large batches each: by `jnp.linalg.solve` (jaxlib
    0.10) they wait for ever."""
    code = textwrap.dedent("""
        import threading, jax, jax.numpy as jnp
        from softgrip_jax.numerics.small_linear import solve_and_sign, solve_linear

        @jax.jit
        def program(a, b):
            found = [jax.vmap(solve_linear)(a + k, b).sum() for k in range(3)]
            return found + [jax.vmap(solve_and_sign)(a + k, b[..., None])[0].sum() for k in range(3)]

        a, b = jax.random.normal(jax.random.key(0), (256, 40, 40)), jnp.ones((256, 40))

        def work():
            for _ in range(10):
                jax.block_until_ready(program(a, b))

        threads = [threading.Thread(target=work, daemon=True) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        print("done")
    """)
    environment = os.environ | {"PJRT_NPROC": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "done", done.stderr[-3000:]
