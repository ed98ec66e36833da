"""jax 0.10.2 returns wrong numbers on the CPU without a word; this is its reproducer (jax issue 39103)."""

import jax
import jax.numpy as jnp
import numpy as np

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
