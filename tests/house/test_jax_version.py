"""What depends on the version of JAX: jax 0.10.2 returns wrong numbers on the CPU without a word, and this is its
reproducer (jax issue 39103); XLA's options come and go."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax import compiler

ROWS = 16_385
"""One more than 2^14: the batch from which jax 0.10.2 is wrong in float64."""

AS_USERS_COMPILE = {"xla_backend_optimization_level": 3, "xla_llvm_disable_expensive_passes": False}


def test_batched_matrix_vector_product_then_reduction():
    """A failure here is not a fault of this package: install another version of jax (0.10.1 is right)."""
    rng = np.random.default_rng(0)
    matrix, vectors = rng.normal(size=(3, 3)), rng.normal(size=(ROWS, 3))
    batch = jax.jit(jax.vmap(lambda x: jnp.sum((matrix @ x) ** 2)), compiler_options=AS_USERS_COMPILE)
    computed = np.asarray(batch(vectors))
    expected = np.sum((vectors @ matrix.T) ** 2, axis=1)
    np.testing.assert_allclose(
        computed, expected, rtol=1e-12, err_msg=f"jax {jax.__version__} computes wrong numbers on this machine"
    )


@pytest.mark.parametrize("name", ["SIDE_BY_SIDE", "QUICKLY", "MANY_CALLS", "IN_TURN"])
def test_xla_knows_the_options(name):
    """A failure here is an XLA that no longer knows one: commands work on, and compile more slowly."""
    options = getattr(compiler, name)
    assert compiler.known_options(options) == (options if jax.default_backend() == "cpu" else None)


def test_an_option_that_xla_does_not_know_is_left_alone():
    assert compiler.known_options(compiler.QUICKLY | {"xla_cpu_no_such_option": 1}) is None
    assert compiler.known_options(None) is None
