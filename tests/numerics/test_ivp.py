"""Initial-value problems whose solution is known, and what a step of a Runge-Kutta method is by its formula."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.ivp import Tolerance, adaptive, end_of, replay, steps_of


def growth(s, y, rate):
    """y' = rate s y: y(1) = y(0) exp(rate / 2)."""
    return rate * s * y


@pytest.mark.parametrize(
    ("solver", "equal"), [(diffrax.Dopri8(), None), (diffrax.Tsit5(), 20)], ids=["adaptive", "equal"]
)
def test_initial_value_problem_has_derivatives_of_any_order(solver, equal):
    how = Tolerance(solver, 1e-11, 1e-11, 64, equal)

    def end(rate):
        return replay(growth, jnp.asarray([2.0]), rate, steps_of(growth, jnp.asarray([2.0]), rate, how), solver).end[0]

    rate = jnp.asarray(1.3)
    true = 2 * np.exp(0.65)
    both = jax.jit(lambda r: (end(r), jax.grad(end)(r), jax.jvp(end, (r,), (jnp.ones(()),))[1]))(rate)
    np.testing.assert_allclose(both, [true, true / 2, true / 2], rtol=1e-8)
    orders = jax.jit(lambda r: (jax.jacfwd(jax.grad(end))(r), jax.grad(jax.jacfwd(end))(r)))(rate)
    np.testing.assert_allclose(orders, true / 4, rtol=1e-8)
    once = jax.jit(lambda r: jax.jvp(lambda r: end_of(growth, jnp.asarray([2.0]), r, how)[0], (r,), (jnp.ones(()),)))
    np.testing.assert_allclose(once(rate), both[:2], rtol=1e-9)


def test_steps_that_do_not_arrive_are_not_a_number():
    how = Tolerance(diffrax.Dopri8(), 1e-12, 1e-12, 3)

    def steep(s, y, _):
        return 400 * jnp.cos(400 * s) * y

    start = jnp.asarray([1.0])
    assert np.all(np.isnan(steps_of(steep, start, None, how)))
    assert np.all(np.isnan(end_of(steep, start, None, how)))


def test_an_error_estimate_tells_of_too_few_steps():
    errors = [
        float(replay(growth, jnp.asarray([2.0]), jnp.asarray(9.0), jnp.linspace(0, 1, n + 1), diffrax.Tsit5()).error)
        for n in (2, 32)
    ]
    assert errors[0] > 1
    assert errors[1] < 1e-3  # of 180


def test_two_steps_of_heun_by_hand():
    """y' = y from 2: each step of h gives y (1 + h + h^2 / 2), with y h^2 / 2 more than Euler's; none by zero."""
    places = jnp.array([0.0, 0.25, 0.25, 1.0])
    found = replay(lambda s, y, _: y, {"y": jnp.asarray(2.0)}, None, places, diffrax.Heun())
    middle = 2 * (1 + 0.25 + 0.25**2 / 2)
    end = middle * (1 + 0.75 + 0.75**2 / 2)
    assert float(found.end["y"]) == pytest.approx(end, rel=1e-15)
    np.testing.assert_allclose(found.ys["y"], [2.0, middle, middle], rtol=1e-15)
    assert float(found.error) == pytest.approx(2 * 0.25**2 / 2 + middle * 0.75**2 / 2, rel=1e-14)
    # Where the stages are taken shows in what depends on s alone: by the trapezoidal rule here.
    found = replay(lambda s, y, _: jnp.stack([s, s**2]), jnp.zeros(2), None, places, diffrax.Heun())
    np.testing.assert_allclose(found.end, [0.5, 0.25**3 / 2 + 0.75 * (0.25**2 + 1) / 2], rtol=1e-15)
    # The largest of the errors counts: that of s^2.
    assert float(found.error) == pytest.approx(0.25 * 0.25**2 / 2 + 0.75 * (1 - 0.25**2) / 2, rel=1e-14)


def test_the_places_of_steps():
    """Equal ones, or those that a tolerance asks for: from 0 to 1, then 1 for ever; fewer where it is looser."""
    start = jnp.asarray([2.0])
    equal = steps_of(growth, start, 1.0, Tolerance(diffrax.Tsit5(), 1e-9, 1e-9, 64, 4))
    np.testing.assert_allclose(equal, [0, 0.25, 0.5, 0.75, 1], rtol=1e-15)
    counts = []
    for tolerance in (1e-4, 1e-10):
        places = np.asarray(steps_of(growth, start, 9.0, Tolerance(diffrax.Tsit5(), tolerance, tolerance, 500)))
        assert (places[0], places[-1]) == (0, 1)
        count = int(np.argmax(places == 1))
        assert np.all(np.diff(places[: count + 1]) > 0)
        assert np.all(places[count:] == 1)
        counts.append(count)
    assert 4 <= counts[0] < counts[1] / 3


def test_a_whole_curve_by_adaptive_steps():
    """y' = rate s y from 0.5 to 2, its end or wherever it is asked for, and its slope by the rate."""

    def end(rate):
        return adaptive(growth, jnp.asarray(2.0), rate, 0.5, 2.0, 1e-10)

    value, slope = jax.jvp(end, (jnp.asarray(0.7),), (jnp.ones(()),))
    true = 2 * np.exp(0.7 * (4 - 0.25) / 2)
    assert (float(value), float(slope)) == pytest.approx((true, true * (4 - 0.25) / 2), rel=1e-9)
    places = jnp.array([0.5, 1.0, 1.7])
    found = adaptive(growth, jnp.asarray(2.0), 0.7, 0.5, 2.0, 1e-10, diffrax.SaveAt(ts=places))
    np.testing.assert_allclose(found, 2 * np.exp(0.35 * (places**2 - 0.25)), rtol=1e-7)  # interpolated
