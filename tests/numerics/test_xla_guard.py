"""What is to be computed once is computed once in the program that XLA makes, and not in the one without the guard."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.xla import cos_and_sin, differentiated_once, materialised


def program(function, *args):
    """The text of what XLA compiles."""
    return jax.jit(function).lower(*args).compile().as_text()


def count(text, operation):
    return text.count(f" {operation}(")


def used_ten_times(x, guard):
    """One cosine, of which ten arrays of different shapes are made that XLA stores."""
    value = guard(jnp.cos(x))
    return [jnp.sum(jnp.outer(value, value + k), axis=0) / (k + 2) for k in range(10)]


def test_the_guard_is_still_there_when_xla_is_done():
    """x / (1 + 0 x) is no identity for what is not finite, which is why XLA must keep it."""
    x = jnp.linspace(0.0, 1.0, 40)
    guarded = program(lambda x: materialised(x + 1) * 2, x)
    assert count(guarded, "divide") == 1
    assert count(program(lambda x: (x + 1) * 2, x), "divide") == 0


def test_a_derivative_is_guarded_as_its_value_is():
    x = jnp.linspace(0.0, 1.0, 40)
    assert count(program(lambda x, v: jax.jvp(lambda x: materialised(x + 1) * 2, (x,), (v,)), x, x), "divide") == 2


def test_a_guarded_value_is_computed_in_one_place():
    x = jnp.linspace(0.0, 1.0, 40)
    assert count(program(lambda x: used_ten_times(x, materialised), x), "cosine") == 1


def test_so_are_cosines_and_sines_and_their_derivatives():
    x = jnp.linspace(0.0, 1.0, 40)

    def derivatives(x):
        def both(x):
            cosine, sine = cos_and_sin(x)
            return [jnp.sum(jnp.outer(cosine, sine + k)) for k in range(4)]

        return jax.jacfwd(both)(x), jax.jacrev(both)(x)

    text = program(derivatives, x)
    assert count(text, "cosine") <= 2
    assert count(text, "sine") <= 2


def test_the_guard_changes_no_bit_and_no_derivative():
    x = jnp.concatenate([jnp.linspace(-3, 3, 101) ** 3, jnp.array([0.0, 1e-300, 1e300])])
    np.testing.assert_array_equal(jax.jit(materialised)(x), x)
    assert np.isnan(materialised(jnp.asarray(jnp.nan)))
    slope = jax.vmap(jax.grad(lambda x: materialised(materialised(x) ** 2)))(x[:101])
    np.testing.assert_array_equal(slope, 2 * x[:101])


def test_a_function_is_differentiated_once_for_all_directions():
    """However many operations it has, what is left for every direction is one product for each of its arguments."""

    def long(a, b):
        for _ in range(20):
            a = jnp.sin(a * b) + b
        return a

    def of_every_direction(function):
        """How many results of nine directions there are on the way."""
        directions = jax.vmap(lambda t: jax.jvp(function, (0.3, 0.4), (t, 2 * t))[1])
        text = program(directions, jnp.arange(9.0))
        return len(re.findall(r"= f64\[9\]\S* (?:multiply|add|divide|negate)\(", text))

    assert of_every_direction(differentiated_once(long)) <= 6 < 40 < of_every_direction(long)
    slopes = jax.grad(differentiated_once(long), argnums=(0, 1))(0.3, 0.4)
    np.testing.assert_allclose(slopes, jax.grad(long, argnums=(0, 1))(0.3, 0.4), rtol=1e-13)
    with pytest.raises(TypeError):
        differentiated_once(long)()
