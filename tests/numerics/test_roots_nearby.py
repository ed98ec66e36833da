"""Roots from roots nearby, of equations that are solved by hand: what is good, what is not, and what it takes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.nearby import (
    CHORDS,
    KEPT,
    NEAR,
    Known,
    fold_nearby,
    known_fold,
    known_root,
    root_by_chords,
    root_nearby,
)


def bent(u, t):
    """u0^2 = t0, u1 = t1 u0; what is observed is u0 u1 and u1 + t0."""
    residual, observed = jnp.stack([u[0] ** 2 - t[0], u[1] - t[1] * u[0]]), jnp.stack([u[0] * u[1], u[1] + t[0]])
    return (residual, observed), 3 * u


def closed(t):
    root = jnp.sqrt(t[0])
    return jnp.stack([t[1] * t[0], t[1] * root + t[0]]), jnp.stack([root, t[1] * root])


near = jax.jit(lambda t, known: root_nearby(bent, t, known))
chords = jax.jit(lambda t, known: root_by_chords(bent, t, known))
T = jnp.array([1.0, 2.0])


def known_at(t, side=1.0):
    _, u = closed(t)
    inverse = jnp.linalg.inv(jax.jacfwd(lambda u: bent(u, t)[0][0])(u))
    return Known(u, inverse, jnp.asarray(side), t, jnp.zeros((2, 2)))


def test_at_a_root_itself_all_is_exact():
    found = near(T, known_root(jnp.array([1.0, 2.0]), T))
    assert found.good
    assert found.count == 1
    np.testing.assert_allclose(found.observed, [2.0, 3.0], rtol=1e-15)
    np.testing.assert_allclose(found.slopes, jax.jacfwd(lambda t: closed(t)[0])(T), rtol=1e-14)
    np.testing.assert_allclose(found.known.u, [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(found.known.inverse, known_at(T).inverse, atol=1e-15)
    assert found.known.side == 1


@pytest.mark.parametrize("t", [(1.02, 2.1), (0.9, 1.5), (1.3, 2.0)])
def test_a_root_next_door_with_its_slopes(t):
    t = jnp.array(t)
    found = near(t, known_at(T))
    assert found.good
    assert 2 < found.count < CHORDS
    observed, u = closed(t)
    np.testing.assert_allclose(found.observed, observed, rtol=1e-13)
    np.testing.assert_allclose(found.known.u, u, rtol=1e-13)
    np.testing.assert_allclose(found.slopes, jax.jacfwd(lambda t: closed(t)[0])(t), rtol=1e-6)
    np.testing.assert_allclose(found.told, 3 * u, rtol=3 * NEAR)
    observed, u, good, told = chords(t, known_at(T))
    assert good
    np.testing.assert_allclose(u, closed(t)[1], rtol=1e-9)
    np.testing.assert_array_equal(observed, bent(u, t)[0][1])
    np.testing.assert_array_equal(told, 3 * u)


def test_a_slope_leads_on():
    """What is found says how the root moves: u0 = sqrt(t0), u1 = t1 u0. The error left is of second order."""
    found = near(T, known_at(T)).known
    np.testing.assert_allclose(found.moved, jax.jacfwd(lambda t: closed(t)[1])(T), rtol=1e-13)
    np.testing.assert_array_equal(found.t, T)
    along = jnp.array([0.01, 0.02])
    still = found._replace(moved=jnp.zeros((2, 2)))
    assert near(T + along, found).count < near(T + along, still).count
    # With an inverse of zero nothing is corrected but by the prediction: Euler's step, off by t0'' h^2 / 2.
    led = chords(T + along, found._replace(inverse=jnp.zeros((2, 2))))[1]
    np.testing.assert_allclose(led, closed(T)[1] + found.moved @ along, rtol=1e-15)


def test_an_inverse_serves_the_next_roots_until_the_moves_are_many():
    for t, is_kept in (((1 + 1e-4, 2.0), True), ((1.3, 2.0), False)):
        found = near(jnp.array(t), known_at(T))
        assert found.good
        assert (found.count <= KEPT) == is_kept
        of = T if is_kept else jnp.array(t)
        np.testing.assert_allclose(found.known.inverse, known_at(of).inverse, rtol=1e-6)
        np.testing.assert_allclose(found.slopes, jax.jacfwd(lambda t: closed(t)[0])(jnp.array(t)), rtol=1e-6)
        np.testing.assert_allclose(found.known.moved, jax.jacfwd(lambda t: closed(t)[1])(jnp.array(t)), rtol=1e-6)
    # What has not come near enough begins with a new one.
    lost = near(T, known_at(T)._replace(u=jnp.array([2.0, 2.0])))
    assert not lost.good
    assert not np.allclose(lost.known.inverse, known_at(T).inverse, rtol=0.01)
    for _ in range(3):
        lost = near(T, lost.known)
    assert lost.good


def test_the_last_correction_is_that_of_what_is_observed_too():
    """A place that is off by less than NEAR, and nothing known of its Jacobian: the errors left are squared."""
    off = known_root(jnp.array([1.0, 2.0]) + 0.5 * NEAR, T)
    found = near(T, off)
    assert found.good
    np.testing.assert_allclose(found.observed, [2.0, 3.0], rtol=1e-13)
    np.testing.assert_allclose(found.known.u, [1.0, 2.0], rtol=1e-13)


def test_what_is_farther_off_is_not_good_but_the_next_trial_from_there_is():
    found = near(T, known_root(jnp.array([1.0, 2.0]) + 30 * NEAR, T))
    assert not found.good
    assert near(T, found.known).good


def test_the_side_tells_roots_apart():
    """u0 = -1 is a root, too, where the determinant, 2 u0, is negative."""
    other = jnp.array([-1.0, -2.0])
    assert near(T, known_root(other, T)).known.side == -1
    for side, good in ((0.0, True), (-1.0, True), (1.0, False)):
        found = near(T, known_root(other, T)._replace(side=jnp.asarray(side)))
        assert bool(found.good) == good
        again = near(T, found.known)  # what is no answer once is none the next time
        assert bool(again.good) == good


def test_chords_alone_need_a_jacobian():
    assert chords(T, known_at(T))[2]
    assert not chords(T, known_root(jnp.array([1.0, 2.0]), T))[2]  # though it is the root
    assert not chords(T + 10, known_at(T))[2]


@jax.jit
def straight(share, t, u):
    """u = t with an inverse that is too small: moves shrink by 1 - share."""
    known = Known(u[None], share * jnp.ones((1, 1)), jnp.asarray(1.0), t[None], jnp.zeros((1, 1)))

    def equations(u, t):
        return (u - t, 3 * u), None

    return root_nearby(equations, t[None], known), root_by_chords(equations, t[None], known)


def test_moves_that_hardly_shrink_are_not_followed():
    """By 0.55 each: the second move is not made. By 0.45 each they all are, CHORDS of them and no more."""
    found, (observed, u, good, _) = straight(0.45, 1e3, 1e3 + 1)
    assert found.count == 2
    assert float(u[0]) == pytest.approx(1e3 + 0.55, rel=1e-12)
    assert float(observed[0]) == pytest.approx(3 * float(u[0]))
    assert not good
    found, (_, u, good, _) = straight(0.55, 1e3, 1e3 + 1)
    assert found.count == CHORDS == 12
    assert float(u[0]) - 1e3 == pytest.approx(0.45**12, rel=1e-6)
    assert not good


@pytest.mark.parametrize("size", [1.0, 1e6, -1e6])
def test_moves_end_below_their_bounds_which_are_relative(size):
    """By 0.1 each from u = 2 size, the k-th move is 0.9 size / 10^(k-1), of 1 + size or so."""
    found, (_, u, good, _) = straight(0.9, size, 2 * size)
    assert good
    last = 0.9 * abs(size) / (1 + abs(size))
    assert found.count == 1 + np.ceil(np.log10(last / 1e-7))
    assert 5e-11 < abs(float(u[0]) / size - 1) < 2e-10
    assert found.good
    assert float(found.observed[0]) == pytest.approx(3 * size, rel=1e-15)


def test_what_is_not_a_number_is_not_good():
    nowhere = Known(jnp.array([jnp.nan, 1.0]), jnp.eye(2), jnp.asarray(1.0), T, jnp.zeros((2, 2)))
    assert not near(T, nowhere).good
    assert not chords(T, nowhere)[2]
    assert not chords(T, known_at(T)._replace(inverse=jnp.full((2, 2), jnp.nan)))[2]


def arch(u, t):
    """The load u2 is t0 at most, where u0 = t1: u2 = t0 - (u0 - t1)^2 - (u0 - t1)^3 / 4, u1 = t1 u0 + u2."""
    away = u[0] - t[1]
    return jnp.stack([away**2 + away**3 / 4 + u[2] - t[0], u[1] - t[1] * u[0] - u[2]])


def top(t):
    return jnp.stack([t[1], t[1] ** 2 + t[0], t[0]])


fold = jax.jit(lambda t, known: fold_nearby(arch, t, known))


def test_a_limit_point_itself_tells_its_slopes():
    found, good = fold(T, known_fold(top(T), T))
    assert good
    np.testing.assert_allclose(found.u, top(T), rtol=1e-12)
    np.testing.assert_allclose(found.moved[-1], [1.0, 0.0], atol=1e-12)
    assert abs(found.tangent[-1]) < 1e-12
    # What lies elsewhere on the path is none.
    assert not fold(T, known_fold(jnp.array([2.5, 2.5 * 2 + 0.71875, 0.71875]), T))[1]


@pytest.mark.parametrize("t", [(1.02, 2.1), (0.7, 1.9), (1.5, 2.6)])
def test_a_limit_point_next_door_with_its_slopes(t):
    t, known = jnp.array(t), fold(T, known_fold(top(T), T))[0]
    found, good = fold(t, known)
    assert good
    np.testing.assert_allclose(found.u[-1], t[0], rtol=1e-7)
    np.testing.assert_allclose(found.u, top(t), rtol=1e-3)
    np.testing.assert_allclose(found.moved[-1], [1.0, 0.0], atol=1e-3)
    # As well from one of which the place alone is known.
    found, good = fold(t, known_fold(top(T), T))
    assert good
    np.testing.assert_allclose(found.u[-1], t[0], rtol=1e-7)
    # The next one has a bend to begin with.
    again, good = fold(t + jnp.array([0.05, 0.05]), found)
    assert good
    np.testing.assert_allclose(again.u[-1], t[0] + 0.05, rtol=1e-7)


def test_a_path_without_a_limit_point_has_none():
    straight = jax.jit(lambda t, known: fold_nearby(lambda u, t: u[:-1] - u[-1] * t, t, known))
    known = known_fold(jnp.array([1.0, 2.0, 1.0]), T)._replace(tangent=jnp.array([0.6, 0.8, 0.0]))
    assert not straight(T, known)[1]
