"""Minima under a growing load and with contact, against quadratic programs and energies solved by hand."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softgrip_jax.numerics.minimise import Expansion, minimise

RANDOM = settings(max_examples=40, deadline=None, derandomize=True)


def expansion_of(energy, gaps, weights, rho):
    """The augmented Lagrangian of energy(y, load) under gaps(y) >= 0, by JAX."""

    def lagrangian(y, multipliers, load):
        pressed = jnp.maximum(0, multipliers - rho * gaps(y))
        return energy(y, load) + jnp.sum(weights * (pressed**2 - multipliers**2)) / (2 * rho)

    def expansion(y, multipliers, load):
        gradient = jax.grad(lagrangian)
        return Expansion(
            lagrangian(y, multipliers, load),
            gradient(y, multipliers, load),
            jax.hessian(lagrangian)(y, multipliers, load),
            jax.jacfwd(gradient, 2)(y, multipliers, load),
            gaps(y),
            jax.jacfwd(gaps)(y),
            jnp.maximum(0, multipliers - rho * gaps(y)),
            weights,
        )

    return expansion


# --- one unknown, without contact -------------------------------------------------------------------------------------


@partial(jax.jit, static_argnums=2)
def _softening(powers, load, largest_step):
    """The energy sum of powers[k] y^(k + 2) - load y from rest, along the slope that it has there."""

    def energy(y, load):
        return jnp.sum(powers * y[0] ** jnp.arange(2, 6)) - load * y[0]

    expansion = expansion_of(energy, lambda y: jnp.zeros(0), jnp.zeros(0), 1.0)
    rest = jnp.zeros(1), jnp.zeros(0)
    guess = jnp.reshape(load / (2 * powers[0]), 1), jnp.zeros(0)
    return minimise(expansion, rest, jnp.zeros(()), guess, load, largest_step)


def softening(*powers, load, largest_step=10.0):
    padded = jnp.asarray([*powers, *[0.0] * (4 - len(powers))])
    return _softening(padded, jnp.asarray(load, float), largest_step)


@pytest.mark.parametrize(("load", "most"), [(1e-6, 4), (0.3, 8), (0.9, 14), (0.999, 30), (0.9999999, 120), (-2.0, 12)])
def test_a_softening_spring_up_to_its_largest_load(load, most):
    """y^2 - y^3 / 3: the load 2 y - y^2 is largest, 1, at y = 1."""
    found = softening(1.0, -1 / 3, load=load)
    assert found.reached
    assert not found.lost
    assert float(found.load) == load
    assert float(found.y[0]) == pytest.approx(1 - np.sqrt(1 - load), rel=1e-15 / np.sqrt(1 - load) + 1e-14)
    assert float(found.slope[0][0]) == pytest.approx(0.5 / np.sqrt(1 - load), rel=1e-6 / np.sqrt(1 - load))
    assert found.evaluations <= most


@pytest.mark.parametrize("load", [1.0001, 1.5, 100.0])
def test_beyond_the_largest_load_nothing_is_found_and_that_load_is_known(load):
    found = softening(1.0, -1 / 3, load=load)
    assert found.lost
    assert not found.reached
    assert 1 - 1e-4 < float(found.load) <= 1
    assert float(found.y[0]) == pytest.approx(1 - np.sqrt(1 - float(found.load)), rel=1e-10)
    assert found.evaluations < 500


@pytest.mark.parametrize("load", [0.5, 0.7, 3.0, 10.0])
def test_a_minimum_that_lies_behind_a_largest_load_is_not_leapt_to(load):
    """The load is 2 y - 9 y^2 / 4 + y^3 / 3: it has a largest value at y = 1/2, and rises again from y = 4."""
    highest = 1 - 9 / 16 + 1 / 24
    found = softening(1.0, -3 / 4, 1 / 12, load=load)
    behind = np.roots([1 / 3, -9 / 4, 2, -load])
    assert np.any((abs(behind.imag) < 1e-9) & (behind.real > 4))  # there is one
    assert found.lost
    assert highest - 1e-3 < float(found.load) <= highest
    assert float(found.y[0]) < 0.5
    assert softening(1.0, -3 / 4, 1 / 12, load=0.4).reached


@pytest.mark.parametrize("largest_step", [0.05, 0.2, 10.0])
def test_how_far_a_step_of_the_load_goes_does_not_matter(largest_step):
    """A stiffening spring: y + y^3 = load."""
    found = softening(0.5, 0.0, 0.25, load=1.7, largest_step=largest_step)
    real = np.roots([1, 0, 1, -1.7])
    assert found.reached
    assert float(found.y[0]) == pytest.approx(real[abs(real.imag) < 1e-12].real[0], rel=1e-15)
    assert (found.evaluations > 1.7 / largest_step) or largest_step > 1.7


@pytest.mark.parametrize("guess", [1.4, -1.4, 1.9, -1.9, 2.5, -2.5])
def test_newtons_method_does_not_run_away_from_a_poor_guess(guess):
    """sqrt(1 + y^2): full steps from beyond y = 1 lead ever farther; each must lower the energy."""

    @jax.jit
    def softer(guess, load):
        def energy(y, load):
            return jnp.sqrt(1 + y[0] ** 2) - load * y[0]

        expansion = expansion_of(energy, lambda y: jnp.zeros(0), jnp.zeros(0), 1.0)
        none = jnp.zeros(0)
        return minimise(expansion, (jnp.zeros(1), none), jnp.zeros(()), (guess[None], none), load, 1.0)

    found = softer(jnp.asarray(guess), jnp.asarray(0.1))
    assert found.reached
    assert float(found.y[0]) == pytest.approx(0.1 / np.sqrt(1 - 0.01), rel=1e-14)
    assert found.evaluations <= 12


def test_a_step_that_hardly_lowers_the_energy_is_cut():
    """From y = 1 - e Newton's method for sqrt(1 + y^2) leads to -(1 - 3 e), lower by nothing to speak of, and so on."""

    @jax.jit
    def softer(guess):
        def energy(y, load):
            return jnp.sqrt(1 + y[0] ** 2) - load * y[0]

        expansion = expansion_of(energy, lambda y: jnp.zeros(0), jnp.zeros(0), 1.0)
        none, load = jnp.zeros(0), jnp.asarray(1e-9)
        return minimise(expansion, (jnp.zeros(1), none), jnp.zeros(()), (guess[None], none), load, 1.0)

    found = softer(jnp.asarray(1 - 1e-7))
    assert found.reached
    assert float(found.y[0]) == pytest.approx(1e-9, rel=1e-6)
    assert found.evaluations <= 12


def spring_curve(powers, load):
    """Along sign(load): where its load curve is first level, its loads wherever it is (inf where it never is), and all
    stable states at the load."""
    side = np.sign(load)
    curve = np.polynomial.Polynomial([0, *((k + 2) * power * side**k for k, power in enumerate(powers))])
    levels = curve.deriv().roots()
    ahead = np.sort(levels[(abs(levels.imag) < 1e-12) & (levels.real > 0)].real)
    top = ahead[0] if len(ahead) else np.inf
    roots = (curve - abs(load)).roots()
    roots = roots[abs(roots.imag) < 1e-9].real
    return top, curve(ahead) if len(ahead) else np.array([np.inf]), roots[curve.deriv()(roots) > 0]


def test_random_springs_up_to_their_largest_loads():
    """Four powers, loads of either sign, steps of every length, guesses that are good, too far or on the wrong side:
    the state is the one that is connected to no load, and lost beyond the largest load. Left out are loads that have
    another minimum, to which a search may leap (LEAP), and loads next to the largest one."""
    random, count = np.random.default_rng(0), 600
    powers = np.stack([random.uniform(*ends, count) for ends in ((0.3, 1), (-1.2, 0.6), (-0.2, 0.4), (-0.05, 0.1))], 1)
    loads = random.uniform(-3, 3, count)
    steps, far = random.choice([0.1, 0.5, 10.0], count), random.choice([1.0, 1.0, 3.0, -2.0, 0.1], count)

    def solved(powers, load, step, far):
        def energy(y, load):
            return jnp.sum(powers * y[0] ** jnp.arange(2, 6)) - load * y[0]

        expansion, none = expansion_of(energy, lambda y: jnp.zeros(0), jnp.zeros(0), 1.0), jnp.zeros(0)
        guess = jnp.reshape(far * load / (2 * powers[0]), 1), none
        return minimise(expansion, (jnp.zeros(1), none), jnp.zeros(()), guess, load, step)

    found = jax.tree.map(np.asarray, jax.jit(jax.vmap(solved))(powers, loads, steps, far))
    below = above = 0
    for k, load in enumerate(loads):
        top, levels, stable = spring_curve(powers[k], load)
        highest = levels[0]
        own = stable[(stable > 0) & (stable <= top)] if abs(load) < highest else stable[:0]
        if abs(abs(load) / highest - 1) < 0.01 or len(stable) != len(own):
            continue
        if len(own):
            below += 1
            assert found.reached[k], k
            assert found.y[k, 0] == pytest.approx(np.sign(load) * own[0], rel=1e-9), k
            assert found.evaluations[k] <= 120, k
        else:
            above += found.lost[k]
            assert not found.reached[k], k
            assert found.lost[k] or found.evaluations[k] == 600, k  # at most; it happens once
            # Of a small hump, behind which the load rises again, a step may not see that it is one.
            assert len(levels) > 1 or 0.99 * highest < abs(found.load[k]) <= highest, k
    assert below > 300
    assert above > 50


# --- quadratic energies under linear constraints: exact --------------------------------------------------------------


def quadratic_program(hessian, pull, slopes, offsets, weights):
    """Minimum of y H y / 2 - pull y under offsets - slopes y >= 0, trying every set of closed gaps."""
    n, k = len(pull), len(offsets)
    for closed in itertools.chain.from_iterable(itertools.combinations(range(k), m) for m in range(k + 1)):
        rows = list(closed)
        matrix = np.block([[hessian, slopes[rows].T], [slopes[rows], np.zeros((len(rows), len(rows)))]])
        solved = np.linalg.solve(matrix, np.concatenate([pull, offsets[rows]]))
        y, forces = solved[:n], np.zeros(k)
        forces[rows] = solved[n:]
        if np.all(forces >= -1e-12) and np.all(offsets - slopes @ y >= -1e-12):
            return y, forces / weights
    raise AssertionError


@jax.jit
def _pressed(hessian, pull, slopes, offsets, weights, rho, load):
    expansion = expansion_of(
        lambda y, load: 0.5 * y @ hessian @ y - load * pull @ y, lambda y: offsets - slopes @ y, weights, rho
    )
    rest, k = jnp.zeros(3), jnp.zeros(4)
    return minimise(expansion, (rest, k), jnp.zeros(()), (jnp.linalg.solve(hessian, load * pull), k), load, 10.0)


def random_program(seed):
    random = np.random.default_rng(seed)
    a = random.normal(size=(3, 3))
    hessian, pull = a @ a.T + 0.5 * np.eye(3), random.normal(size=3)
    return hessian, pull, random.normal(size=(4, 3)) / 2, random.uniform(0.05, 1.0, 4), random.uniform(0.2, 2.0, 4)


@RANDOM
@given(seed=st.integers(0, 10**6), rho=st.floats(0.3, 30), load=st.floats(0.05, 1.2))
def test_random_programs_against_every_set_of_closed_gaps(seed, rho, load):
    hessian, pull, slopes, offsets, weights = random_program(seed)
    y, multipliers = quadratic_program(hessian, load * pull, slopes, offsets, weights)
    found = _pressed(hessian, pull, slopes, offsets, weights, rho, load)
    # A minimum that is far from the first guess counts as another branch: such a search may end before it.
    if np.max(np.abs(np.linalg.solve(hessian, load * pull))) < 1.0:
        assert found.reached
    if not found.reached:
        return
    np.testing.assert_allclose(found.y, y, atol=1e-12)
    np.testing.assert_allclose(found.multipliers, multipliers, atol=1e-11)
    # The change per load is that with the same gaps closed.
    closed = np.flatnonzero(multipliers > 0)
    on = quadratic_program(hessian, pull, slopes[closed], 0 * offsets[closed], weights[closed])
    if np.all(offsets[multipliers == 0] - slopes[multipliers == 0] @ y > 1e-9) and len(on[1]) == len(closed):
        step = 1e-6
        more, _ = quadratic_program(hessian, (load + step) * pull, slopes, offsets, weights)
        np.testing.assert_allclose(found.slope[0], (more - y) / step, atol=1e-6)


def test_what_is_found_does_not_depend_on_rho_nor_on_a_start_in_contact():
    """A spring against a wall: it is held at the wall, which takes the rest of the load."""
    hessian, pull = np.eye(3), np.array([1.0, 0.5, 0.0])
    slopes, offsets = np.eye(4, 3), np.array([0.2, 0.4, 0.3, 1.0])
    for rho in (0.1, 1.0, 100.0):
        found = _pressed(hessian, pull, slopes, offsets, 2 * np.ones(4), rho, 0.6)
        np.testing.assert_allclose(found.y, [0.2, 0.3, 0.0], atol=1e-15)
        np.testing.assert_allclose(found.multipliers, [0.2, 0, 0, 0], atol=1e-14)
        np.testing.assert_allclose(found.slope[0], [0, 0.5, 0], atol=1e-14)
        np.testing.assert_allclose(found.slope[1], [0.5, 0, 0, 0], atol=1e-14)
        assert found.evaluations < 12


def test_a_ball_in_a_bowl_whose_wall_is_curved():
    """|y|^2 / 2 - load . y inside a circle: beyond it y is on the circle in the direction of the load."""

    @jax.jit
    def pressed(load, rho):
        pull = jnp.array([0.6, 0.8])
        expansion = expansion_of(
            lambda y, load: 0.5 * y @ y - load * pull @ y, lambda y: (0.25 - y @ y)[None], jnp.array([0.7]), rho
        )
        nothing = jnp.zeros(1)
        return minimise(expansion, (jnp.zeros(2), nothing), jnp.zeros(()), (load * pull, nothing), load, 0.5)

    for load in (0.3, 0.6, 1.4):
        found = pressed(load, 5.0)
        radius = min(load, 0.5)
        np.testing.assert_allclose(found.y, radius * np.array([0.6, 0.8]), rtol=1e-13)
        np.testing.assert_allclose(found.multipliers, max(0.0, load / 0.5 - 1) / (2 * 0.7), rtol=1e-12)
        assert found.reached


def test_lanes_of_a_batch_are_what_they_are_alone():
    loads = jnp.array([0.3, 0.9, 1.2, -1.0])
    powers = jnp.array([1.0, -1 / 3, 0.0, 0.0])
    batch = jax.vmap(lambda load: _softening(powers, load, 10.0))(loads)
    for k, load in enumerate(loads):
        alone = _softening(powers, load, 10.0)
        assert (batch.reached[k], batch.lost[k]) == (alone.reached, alone.lost)
        np.testing.assert_allclose(batch.y[k], alone.y, rtol=1e-12)


# --- contact along a path of loads ------------------------------------------------------------------------------------


@jax.jit
def _on_a_wall(powers, load, largest_step, hold):
    """z with the energy sum of powers[k] z^(k + 2) - load z, beside w, which the load presses on a wall at 0.01; the
    wall's force is hold * load - 0.01 (of a spring of stiffness one)."""

    def energy(y, load):
        z, w = y
        return jnp.sum(powers * z ** jnp.arange(2, 6)) - load * z + 0.5 * w**2 - hold * load * w

    expansion = expansion_of(energy, lambda y: 0.01 - y[1:], jnp.ones(1), 1.0)
    guess = jnp.stack([load / (2 * powers[0]), hold * load]), jnp.zeros(1)
    return minimise(expansion, (jnp.zeros(2), jnp.zeros(1)), jnp.zeros(()), guess, load, largest_step)


def test_in_contact_multipliers_are_foretold_from_load_to_load():
    """Linear: after the first steps every load takes one look, for y and multipliers lie on a straight line."""
    found = _on_a_wall(jnp.array([0.5, 0, 0, 0]), jnp.asarray(2.0), 0.1, 1.0)
    assert found.reached
    np.testing.assert_allclose(found.y, [2.0, 0.01], rtol=1e-14)
    np.testing.assert_allclose(found.multipliers, [1.99], rtol=1e-13)
    np.testing.assert_allclose([found.slope[0][1], found.slope[1][0]], [0, 1], atol=1e-14)
    assert 20 <= found.evaluations <= 20 + 5


FAR = [(11, 0.3038, 2.785), (35, 1.252, 2.874), (55, 0.5993, 1.563)]
"""Programs of `random_program` by their seed, with rho and the load."""


def test_contact_may_bend_into_shapes_that_the_guess_does_not_know():
    """z^2 / 40 + w^2 / 2 - load w under w <= 0.01 + z / 2: without the wall z = 0, with it z = (load - 0.01) / 0.6."""

    @jax.jit
    def pressed(load):
        expansion = expansion_of(
            lambda y, load: y[0] ** 2 / 40 + 0.5 * y[1] ** 2 - load * y[1],
            lambda y: (0.01 + 0.5 * y[0] - y[1])[None],
            jnp.ones(1),
            1.0,
        )
        none = jnp.zeros(1)
        guess = jnp.stack([0 * load, load]), none
        return minimise(expansion, (jnp.zeros(2), none), jnp.zeros(()), guess, load, 10.0)

    found = pressed(jnp.asarray(2.0))
    assert found.reached
    z = 1.99 / 0.6
    np.testing.assert_allclose(found.y, [z, 0.01 + z / 2], rtol=1e-13)
    assert found.evaluations <= 8


@pytest.mark.parametrize(("seed", "rho", "load"), FAR)
def test_where_a_guess_is_far_off_the_load_comes_in_parts(seed, rho, load):
    """Programs whose minimum is far from the first guess: a load step that fails says nothing of a largest load."""
    hessian, pull, slopes, offsets, weights = random_program(seed)
    y, multipliers = quadratic_program(hessian, load * pull, slopes, offsets, weights)
    found = _pressed(hessian, pull, slopes, offsets, weights, rho, load)
    assert found.reached
    assert found.evaluations <= 65
    np.testing.assert_allclose(found.y, y, atol=1e-12)
    np.testing.assert_allclose(found.multipliers, multipliers, atol=1e-11)


@pytest.mark.parametrize("load", [0.55, 0.7, 3.0])
def test_in_contact_too_a_minimum_behind_a_largest_load_is_not_leapt_to(load):
    """z as in the softening spring above: its load is largest at z = 1/2, and rises again from z = 4."""
    highest = 1 - 9 / 16 + 1 / 24
    found = _on_a_wall(jnp.array([1.0, -3 / 4, 1 / 12, 0]), jnp.asarray(load), 10.0, 1.0)
    assert found.lost
    assert highest - 1e-3 < float(found.load) <= highest
    assert float(found.y[0]) < 0.5
    assert float(found.y[1]) == pytest.approx(0.01, rel=1e-12)
