"""The larger and the smaller of values: NumPy's values, and the derivative of the one that was chosen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softgrip_jax.numerics.choice import larger, largest, smaller, smallest

RANDOM = settings(max_examples=60, deadline=None, derandomize=True)
NUMBERS = st.floats(-3, 3) | st.just(float("nan"))


@RANDOM
@given(NUMBERS, NUMBERS)
def test_of_two(a, b):
    np.testing.assert_equal(float(larger(jnp.asarray(a), b)), float(np.maximum(a, b)))
    np.testing.assert_equal(float(smaller(jnp.asarray(a), b)), float(np.minimum(a, b)))


@RANDOM
@given(st.lists(NUMBERS, min_size=1, max_size=6))
def test_of_several(values):
    np.testing.assert_equal(float(largest(jnp.asarray(values))), np.max(values))
    np.testing.assert_equal(float(smallest(jnp.asarray(values))), np.min(values))


@pytest.mark.parametrize(("function", "winner"), [(larger, 1), (smaller, 0)])
def test_the_derivative_is_that_of_the_chosen(function, winner):
    slopes = jax.grad(lambda v: function(v[0], v[1]))(jnp.array([1.0, 2.0]))
    assert slopes.tolist() == [float(winner == 0), float(winner == 1)]
    # Of equals one has it, never both and never none.
    assert jax.grad(lambda v: function(v[0], v[1]))(jnp.array([2.0, 2.0])).tolist() == [1.0, 0.0]
    assert jax.jacfwd(lambda x: function(x, 0.0))(jnp.array([-1.0, 3.0])).sum() == 1


@pytest.mark.parametrize(("function", "place"), [(largest, 2), (smallest, 1)])
def test_the_derivative_is_that_of_the_first_extreme(function, place):
    values = jnp.array([[0.5, -1.0], [3.0, 3.0]])
    assert jax.grad(function)(values).reshape(-1).tolist() == [float(k == place) for k in range(4)]


@pytest.mark.parametrize("shape", [(2048, 2), (512, 20), (3, 5000)])
@pytest.mark.parametrize("function", [largest, smallest])
def test_what_is_not_known_is_kept_in_large_batches(function, shape):
    """jnp.max and jnp.min of jax 0.11 and 0.12 forget it there, on a CPU."""
    values = np.random.default_rng(0).random(shape)
    values[1, 1], values[2] = np.nan, np.nan
    found = jax.jit(jax.vmap(function))(values)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found)), [1, 2])
