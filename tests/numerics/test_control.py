"""Equilibria at a given displacement, and limit points from below, of a spring and of a shallow arch in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.control import TOP_STEPS, hold, top

MIX = jnp.array([[1.0, 0.3], [-0.2, 0.8]])
"""What is called y are two mixtures of z1, that bends, and z2 = 0.3 z1."""


def linear(y, load):
    """Of the energy whose gradient by z is (2 z1 - z1^2 - load + 0.6 k, -2 k), k = z2 - 0.3 z1 held by a spring."""

    def gradient(y, load):
        def energy(y):
            z = MIX @ y
            return z[0] ** 2 - z[0] ** 3 / 3 - load * z[0] + (z[1] - 0.3 * z[0]) ** 2

        return jax.grad(energy)(y)

    return gradient(y, load), jax.jacfwd(gradient)(y, load), jax.jacfwd(gradient, 1)(y, load)


def at(z):
    return jnp.linalg.solve(MIX, jnp.array([z, 0.3 * z]))


@pytest.mark.parametrize("z", [0.2, 0.9, 1.0, 1.3, 1.8])
def test_a_held_spring_is_known_beyond_its_largest_load_too(z):
    direction = MIX[0]  # direction . y is z1 itself
    held = jax.jit(lambda z: hold(linear, at(z - 0.15), jnp.asarray(0.5), direction, z))(z)
    assert held.good
    np.testing.assert_allclose(held.y, at(z), rtol=1e-13, atol=1e-15)
    assert float(held.load) == pytest.approx(2 * z - z**2, rel=1e-13)
    np.testing.assert_allclose(held.along, at(1.0), atol=1e-6)
    assert float(held.rise) == pytest.approx(2 - 2 * z, abs=1e-6)


def test_what_does_not_exist_is_not_good():
    assert not hold(linear, at(np.nan), jnp.asarray(0.5), MIX[0], jnp.asarray(0.5)).good
    assert not top(linear, at(np.nan), jnp.asarray(0.5), MIX[0], jnp.asarray(0.1)).good


def test_what_newtons_method_wanders_about_is_not_good():
    """Of y1 = load and y2^2 = -1 the second has no solution, at whatever load."""

    def nowhere(y, load):
        return jnp.stack([y[0] - load, y[1] ** 2 + 1]), jnp.diag(jnp.stack([1.0, 2 * y[1]])), -jnp.array([1.0, 0.0])

    held = hold(nowhere, jnp.array([0.5, 0.7]), jnp.asarray(0.5), jnp.array([1.0, 0.0]), jnp.asarray(0.5))
    assert jnp.all(jnp.isfinite(held.y))
    assert not held.good


@pytest.mark.parametrize("reach", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("z", [0.5, 0.9, 0.9999])
def test_a_limit_point_from_below(z, reach):
    found = jax.jit(lambda z, reach: top(linear, at(z), 2 * z - z**2, MIX[0], reach))(z, reach)
    assert found.good
    np.testing.assert_allclose(found.y, at(1.0), rtol=1e-8)
    assert float(found.load) == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(found.along, at(1.0), rtol=1e-6)
    assert found.steps < TOP_STEPS


def test_where_there_is_no_limit_point_none_is_found():
    """A stiffening spring: the load rises for ever."""

    def stiff(y, load):
        return y + y**3 - load, jnp.diag(1 + 3 * y**2), -jnp.ones(1)

    found = top(stiff, jnp.zeros(1), jnp.asarray(0.0), jnp.ones(1), jnp.asarray(0.1))
    assert not found.good
    assert found.steps == TOP_STEPS


def test_a_load_that_is_nearly_straight_at_first_is_not_extrapolated_far():
    """load = z - z^5 / 5: between z = 0.05 and 0.1 its slope changes by a ten-thousandth."""

    def nearly_straight(y, load):
        return y - y**5 / 5 - load, jnp.diag(1 - y**4), -jnp.ones(1)

    found = top(nearly_straight, jnp.full(1, 0.05), jnp.asarray(0.05), jnp.ones(1), jnp.asarray(0.2))
    assert found.good
    assert (float(found.y[0]), float(found.load)) == pytest.approx((1, 0.8), rel=1e-9)
