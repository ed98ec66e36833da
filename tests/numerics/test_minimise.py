"""Minima under a growing load and with contact, against quadratic programs and energies solved by hand."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softgrip_jax.numerics import minimise as module
from softgrip_jax.numerics.minimise import FINEST, Expansion, minimise

RANDOM = settings(max_examples=40, deadline=None, derandomize=True)


def expansion_of(energy, gaps=None, stiffness=1.0):
    """Of energy(y, load) with a layer of some stiffness that presses where gaps(y) < 0, by JAX."""

    def whole(y, load):
        layer = 0.0 if gaps is None else jnp.sum(stiffness * jnp.maximum(0, -gaps(y)) ** 2) / 2
        return energy(y, load) + layer

    def expansion(y, load):
        return Expansion(
            whole(y, load),
            jax.grad(whole)(y, load),
            jax.hessian(whole)(y, load),
            jax.jacfwd(jax.grad(whole), 1)(y, load),
            jnp.asarray(False) if gaps is None else jnp.any(gaps(y) < 0),
        )

    return expansion


def followed(expansion, start, start_load, guess, load, largest_step):
    """`minimise` of an energy whose expansion may hold traced values."""
    one, traced = jax.closure_convert(expansion, start, jnp.asarray(load, float))
    return minimise(lambda args, y, load: one(y, load, *args), traced, start, start_load, guess, load, largest_step)


# --- one unknown, without contact -------------------------------------------------------------------------------------


@partial(jax.jit, static_argnums=2)
def _softening(powers, load, largest_step):
    """The energy sum of powers[k] y^(k + 2) - load y from rest, along the slope that it has there."""

    def energy(y, load):
        return jnp.sum(powers * y[0] ** jnp.arange(2, 6)) - load * y[0]

    guess = jnp.reshape(load / (2 * powers[0]), 1)
    return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), guess, load, largest_step)


def softening(*powers, load, largest_step=10.0):
    padded = jnp.asarray([*powers, *[0.0] * (4 - len(powers))])
    return _softening(padded, jnp.asarray(load, float), largest_step)


@pytest.mark.parametrize(("load", "most"), [(1e-6, 1), (0.3, 3), (0.9, 5), (0.999, 8), (0.9999999, 14), (-2.0, 4)])
def test_a_softening_spring_up_to_its_largest_load(load, most):
    """y^2 - y^3 / 3: the load 2 y - y^2 is largest, 1, at y = 1."""
    found = softening(1.0, -1 / 3, load=load)
    assert found.reached
    assert not found.lost
    assert float(found.load) == load
    assert float(found.y[0]) == pytest.approx(1 - np.sqrt(1 - load), rel=1e-15 / np.sqrt(1 - load) + 1e-14)
    assert float(found.slope[0]) == pytest.approx(0.5 / np.sqrt(1 - load), rel=1e-6 / np.sqrt(1 - load))
    assert found.evaluations <= most


@pytest.mark.parametrize("load", [1.0001, 1.5, 100.0])
def test_beyond_the_largest_load_nothing_is_found_and_that_load_is_known(load):
    found = softening(1.0, -1 / 3, load=load)
    assert found.lost
    assert not found.reached
    assert 1 - 2 * FINEST * load < float(found.load) <= 1
    assert float(found.y[0]) == pytest.approx(1 - np.sqrt(1 - float(found.load)), rel=1e-10)
    assert found.evaluations < 450


@pytest.mark.parametrize("load", [0.5, 0.7, 3.0, 10.0])
def test_a_minimum_that_lies_behind_a_largest_load_is_not_leapt_to(load):
    """The load is 2 y - 9 y^2 / 4 + y^3 / 3: it has a largest value at y = 1/2, and rises again from y = 4."""
    highest = 1 - 9 / 16 + 1 / 24
    found = softening(1.0, -3 / 4, 1 / 12, load=load)
    behind = np.roots([1 / 3, -9 / 4, 2, -load])
    assert np.any((abs(behind.imag) < 1e-9) & (behind.real > 4))  # there is one
    assert found.lost
    assert highest - 1e-6 < float(found.load) <= highest
    assert float(found.y[0]) < 0.5
    assert found.evaluations < 410
    assert softening(1.0, -3 / 4, 1 / 12, load=0.4).reached


def test_a_minimum_somewhat_larger_than_the_guess_is_no_leap():
    """y^2 - y^3 / 9 to 97 % of its largest load, 3: at y = 2.45, where the guess is 1.45."""
    found = softening(1.0, -1 / 9, load=2.9)
    assert found.reached
    assert float(found.y[0]) == pytest.approx(3 - np.sqrt(0.3), rel=1e-14)
    assert found.evaluations <= 6


@pytest.mark.parametrize("largest_step", [0.05, 0.2, 10.0])
def test_how_far_a_step_of_the_load_goes_does_not_matter(largest_step):
    """A stiffening spring: y + y^3 = load."""
    found = softening(0.5, 0.0, 0.25, load=1.7, largest_step=largest_step)
    real = np.roots([1, 0, 1, -1.7])
    assert found.reached
    assert float(found.y[0]) == pytest.approx(real[abs(real.imag) < 1e-12].real[0], rel=1e-15)
    assert (found.evaluations > 1.7 / largest_step) or largest_step > 1.7


@pytest.mark.parametrize(
    ("load", "largest_step", "most"), [(0.9, 1.0, 2), (0.1, 1.0, 2), (0.5, 1.0, 1), (0.1, 0.1, 12)]
)
def test_a_search_may_begin_under_load_and_lead_to_a_lower_one(load, largest_step, most):
    """The softening spring from y = 1 - sqrt(1/2) at half its largest load, with a guess that is right to 1e-4."""

    @jax.jit
    def moved(start, load, guess, largest_step):
        def energy(y, load):
            return y[0] ** 2 - y[0] ** 3 / 3 - load * y[0]

        return followed(expansion_of(energy), start[None], jnp.asarray(0.5), guess[None], load, largest_step)

    there = 1 - np.sqrt(1 - load)
    found = moved(1 - np.sqrt(0.5), load, there + 1e-4, largest_step)
    assert found.reached
    assert float(found.load) == load
    assert float(found.y[0]) == pytest.approx(there, rel=1e-14)
    assert found.evaluations <= most + 1
    assert found.evaluations >= abs(load - 0.5) / largest_step


@pytest.mark.parametrize("guess", [1.4, -1.4, 1.9, -1.9, 2.5, -2.5])
def test_newtons_method_does_not_run_away_from_a_poor_guess(guess):
    """sqrt(1 + y^2): full steps from beyond y = 1 lead ever farther; each must lower the energy."""

    @jax.jit
    def softer(guess, load):
        def energy(y, load):
            return jnp.sqrt(1 + y[0] ** 2) - load * y[0]

        return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), guess[None], load, 1.0)

    found = softer(jnp.asarray(guess), jnp.asarray(0.1))
    assert found.reached
    assert float(found.y[0]) == pytest.approx(0.1 / np.sqrt(1 - 0.01), rel=1e-14)
    assert found.evaluations <= 12


@pytest.mark.parametrize("e", [1e-5, 1e-7])
def test_a_step_that_hardly_lowers_the_energy_is_cut(e):
    """From y = 1 - e Newton's method for sqrt(1 + y^2) leads to -(1 - 3 e), lower by nothing to speak of, and so on."""

    @jax.jit
    def softer(guess):
        def energy(y, load):
            return jnp.sqrt(1 + y[0] ** 2) - load * y[0]

        return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), guess[None], jnp.asarray(1e-9), 1.0)

    found = softer(jnp.asarray(1 - e))
    assert found.reached
    assert float(found.y[0]) == pytest.approx(1e-9, rel=1e-6)
    assert found.evaluations <= 12


@partial(jax.jit, static_argnums=1)
def _steep(load, center, slope=1e-3):
    """F(y) = 1 + s (y - c) + k (y - c)^3 = load, with F(0) = 0: near the load 1, y rises by more than half of c."""
    cubic = (1 - center * slope) / center**3

    def energy(y, load):
        z = y[0] - center
        return y[0] + slope * z**2 / 2 + cubic * z**4 / 4 - load * y[0]

    guess = jnp.reshape(load / (slope + 3 * cubic * center**2), 1)
    return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), guess, load, 1.3)


@pytest.mark.parametrize("center", [6.0, 12.0])
def test_what_rises_steeply_has_no_largest_load(center):
    """Steps that lead so far are cut as if there were none; nearer to it that is tried again."""
    for load in np.linspace(0.9, 1.3, 21):
        found = _steep(jnp.asarray(load), center)
        assert found.reached
        assert found.load == load
        z = float(found.y[0]) - center
        assert 1 + 1e-3 * z + (1 - 1e-3 * center) * (z / center) ** 3 == pytest.approx(load, abs=1e-12)
        assert found.evaluations < 250


def test_a_member_that_has_ended_makes_room_for_the_next(monkeypatch):
    """70 members in eight places, as on a GPU: each ends as it does alone."""
    monkeypatch.setattr(module, "BLOCK", 8)
    loads = jnp.linspace(-2.0, 1.1, 70)  # beyond 1 there is no equilibrium
    powers = jnp.asarray([1.0, -1 / 3, 0.0, 0.0])

    def expansion(powers, y, load):
        return expansion_of(lambda y, load: jnp.sum(powers * y[0] ** jnp.arange(2, 6)) - load * y[0])(y, load)

    def one(load):
        return module.minimise(expansion, powers, jnp.zeros(1), jnp.zeros(()), load[None] / 2, load, 10.0)

    together, alone = jax.jit(jax.vmap(one))(loads), jax.jit(one)
    assert 0 < int(jnp.sum(together.lost)) < 70
    for k in range(70):
        for mine, its in zip(jax.tree.leaves(alone(loads[k])), jax.tree.leaves(together), strict=True):
            np.testing.assert_allclose(its[k], mine, rtol=1e-12, atol=1e-12)


def test_an_energy_that_is_rounded_is_still_minimised():
    """y^2 / 2 - load y beside a large energy, whose last bits rise and fall: steps that raise these are taken."""

    def noisy(y, load):
        value = 1e3 * (1 + 5e-14 * jnp.sin(1e12 * y[0])) + y[0] ** 2 / 2 - load * y[0]
        return Expansion(value, y - load, jnp.eye(1), -jnp.ones(1), jnp.asarray(False))

    loads = jnp.linspace(1e-6, 1e-5, 50)
    found = jax.jit(jax.vmap(lambda load: followed(noisy, jnp.zeros(1), jnp.zeros(()), 1.001 * load[None], load, 1.0)))(
        loads
    )
    assert np.all(found.reached)
    np.testing.assert_allclose(found.y[:, 0], loads, rtol=1e-14)
    assert np.all(found.evaluations <= 2)


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

        guess = jnp.reshape(far * load / (2 * powers[0]), 1)
        return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), guess, load, step)

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


# --- quadratic energies and layers on walls ---------------------------------------------------------------------------


def layered_program(hessian, pull, slopes, offsets, stiffness):
    """Minimum of y H y / 2 - pull y with layers where offsets - slopes y < 0, trying every set of pressed layers."""
    k = len(offsets)
    for pressed in itertools.chain.from_iterable(itertools.combinations(range(k), m) for m in range(k + 1)):
        on = np.isin(np.arange(k), pressed)
        held = (slopes * (stiffness * on)[:, None]).T
        y = np.linalg.solve(hessian + held @ slopes, pull + held @ offsets)
        if np.all((offsets - slopes @ y < 0) == on):
            return y, on
    raise AssertionError


@jax.jit
def _pressed(hessian, pull, slopes, offsets, stiffness, load):
    expansion = expansion_of(
        lambda y, load: 0.5 * y @ hessian @ y - load * pull @ y, lambda y: offsets - slopes @ y, stiffness
    )
    return followed(expansion, jnp.zeros(3), jnp.zeros(()), jnp.linalg.solve(hessian, load * pull), load, 10.0)


def random_program(seed):
    random = np.random.default_rng(seed)
    a = random.normal(size=(3, 3))
    hessian, pull = a @ a.T + 0.5 * np.eye(3), random.normal(size=3)
    return hessian, pull, random.normal(size=(4, 3)) / 2, random.uniform(0.05, 1.0, 4), random.uniform(0.2, 2.0, 4)


@RANDOM
@given(seed=st.integers(0, 10**6), stiffer=st.floats(0.3, 1e4), load=st.floats(0.05, 1.2))
def test_random_programs_against_every_set_of_pressed_layers(seed, stiffer, load):
    hessian, pull, slopes, offsets, stiffness = random_program(seed)
    stiffness = stiffer * stiffness
    y, on = layered_program(hessian, load * pull, slopes, offsets, stiffness)
    found = _pressed(hessian, pull, slopes, offsets, stiffness, load)
    # A minimum that is far from the first guess counts as another branch: such a search may end before it.
    if np.max(np.abs(np.linalg.solve(hessian, load * pull))) < 1.0:
        assert found.reached
    if not found.reached:
        return
    np.testing.assert_allclose(found.y, y, atol=1e-11)
    if np.min(np.abs(offsets - slopes @ y)) < 1e-9:
        return
    assert bool(found.touching) == np.any(on)
    # The change per load is that with the same layers pressed.
    held = (slopes * (stiffness * on)[:, None]).T
    np.testing.assert_allclose(found.slope, np.linalg.solve(hessian + held @ slopes, pull), atol=1e-9)


@pytest.mark.parametrize("stiffness", [0.1, 1.0, 1e3, 1e6])
def test_a_spring_against_a_wall(stiffness):
    """The wall takes what the spring does not: (load - offset) k / (1 + k)."""
    slopes, offsets = np.eye(4, 3), np.array([0.2, 0.4, 0.3, 1.0])
    found = _pressed(np.eye(3), np.array([1.0, 0.5, 0.0]), slopes, offsets, stiffness * np.ones(4), 0.6)
    entered = 0.4 / (1 + stiffness)
    np.testing.assert_allclose(found.y, [0.2 + entered, 0.3, 0.0], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(found.slope, [1 / (1 + stiffness), 0.5, 0], rtol=1e-9, atol=1e-14)
    assert bool(found.touching)
    assert found.evaluations < 12


def test_a_ball_in_a_bowl_whose_wall_is_curved():
    """|y|^2 / 2 - load . y in a bowl of radius 1/2 and stiffness k: r + 2 k r (r^2 - 1/4) = load outside of it."""

    @jax.jit
    def pressed(load, stiffness):
        pull = jnp.array([0.6, 0.8])
        expansion = expansion_of(
            lambda y, load: 0.5 * y @ y - load * pull @ y, lambda y: (0.25 - y @ y)[None], stiffness
        )
        return followed(expansion, jnp.zeros(2), jnp.zeros(()), load * pull, load, 0.5)

    for load, stiffness in ((0.3, 5.0), (0.6, 5.0), (1.4, 5.0), (1.4, 1e4)):
        found = pressed(load, stiffness)
        radius = load if load < 0.5 else np.roots([2 * stiffness, 0, 1 - stiffness / 2, -load]).real.max()
        np.testing.assert_allclose(found.y, radius * np.array([0.6, 0.8]), rtol=1e-12)
        assert found.reached
        assert bool(found.touching) == (load > 0.5)


def test_lanes_of_a_batch_are_what_they_are_alone():
    loads = jnp.array([0.3, 0.9, 1.2, -1.0])
    powers = jnp.array([1.0, -1 / 3, 0.0, 0.0])
    batch = jax.vmap(lambda load: _softening(powers, load, 10.0))(loads)
    for k, load in enumerate(loads):
        alone = _softening(powers, load, 10.0)
        assert (batch.reached[k], batch.lost[k]) == (alone.reached, alone.lost)
        np.testing.assert_allclose(batch.y[k], alone.y, rtol=1e-12)


# --- contact along a path of loads ------------------------------------------------------------------------------------

STIFF = 1e6
"""Of the wall: it gives way by a millionth of its force."""


@jax.jit
def _on_a_wall(powers, load, largest_step, hold):
    """z with the energy sum of powers[k] z^(k + 2) - load z, beside w, a spring of stiffness one which hold * load
    presses on a wall at 0.01."""

    def energy(y, load):
        z, w = y
        return jnp.sum(powers * z ** jnp.arange(2, 6)) - load * z + 0.5 * w**2 - hold * load * w

    guess = jnp.stack([load / (2 * powers[0]), hold * load])
    expansion = expansion_of(energy, lambda y: 0.01 - y[1:], STIFF)
    return followed(expansion, jnp.zeros(2), jnp.zeros(()), guess, load, largest_step)


def test_in_contact_each_load_is_foretold_by_the_tangent():
    """Linear: after the first steps every load takes one look, for y lies on a straight line."""
    found = _on_a_wall(jnp.array([0.5, 0, 0, 0]), jnp.asarray(2.0), 0.1, 1.0)
    assert found.reached
    np.testing.assert_allclose(found.y, [2.0, (2 + STIFF * 0.01) / (1 + STIFF)], rtol=1e-13)
    np.testing.assert_allclose(found.slope, [1, 1 / (1 + STIFF)], atol=1e-9)
    assert 20 <= found.evaluations <= 20 + 5


def test_contact_may_bend_into_shapes_that_the_guess_does_not_know():
    """z^2 / 40 + w^2 / 2 - load w with a wall at w = 0.01 + z / 2: without it z = 0, with it z is long."""

    @jax.jit
    def pressed(load):
        expansion = expansion_of(
            lambda y, load: y[0] ** 2 / 40 + 0.5 * y[1] ** 2 - load * y[1],
            lambda y: (0.01 + 0.5 * y[0] - y[1])[None],
            STIFF,
        )
        return followed(expansion, jnp.zeros(2), jnp.zeros(()), jnp.stack([0 * load, load]), load, 10.0)

    found = pressed(jnp.asarray(2.0))
    assert found.reached
    np.testing.assert_allclose(
        found.y,
        np.linalg.solve([[0.05 + STIFF / 4, -STIFF / 2], [-STIFF / 2, 1 + STIFF]], [-0.005 * STIFF, 2 + 0.01 * STIFF]),
        rtol=1e-8,
    )
    assert found.y[0] == pytest.approx(1.99 / 0.6, rel=1e-5)
    assert found.evaluations <= 3


FAR = [(1854, 8.623e5, 2.01927, 69), (369, 1.5024e5, 0.76869, 45), (3106, 4.8387e4, 2.97886, 45)]
"""Programs of `random_program` by their seed, with a factor of the stiffness and the load; and what they take."""


@pytest.mark.parametrize(("seed", "stiffer", "load", "most"), FAR)
def test_where_a_guess_is_far_off_the_load_comes_in_parts(seed, stiffer, load, most):
    """Layers that press in turn: a load step that fails says nothing of a largest load."""
    hessian, pull, slopes, offsets, stiffness = random_program(seed)
    y, _ = layered_program(hessian, load * pull, slopes, offsets, stiffer * stiffness)
    found = _pressed(hessian, pull, slopes, offsets, stiffer * stiffness, load)
    assert found.reached
    assert 0.8 * most <= found.evaluations <= most + 2
    np.testing.assert_allclose(found.y, y, atol=1e-11)


def test_most_programs_take_few_evaluations():
    """Four hundred of them, layers a tenth to a million times as stiff as what they hold, and loads far beyond."""
    random = np.random.default_rng(0)
    programs = [random_program(seed) for seed in range(400)]
    hessian, pull, slopes, offsets, stiffness = (np.array(part) for part in zip(*programs, strict=True))
    stiffness, load = stiffness * 10 ** random.uniform(-1, 6, (400, 1)), random.uniform(0.5, 3, 400)
    found = jax.jit(jax.vmap(_pressed))(hessian, pull, slopes, offsets, stiffness, load)
    assert np.all(found.reached)
    assert np.median(found.evaluations) <= 2
    assert np.percentile(found.evaluations, 99) <= 12
    for k in range(400):
        y, _ = layered_program(hessian[k], load[k] * pull[k], slopes[k], offsets[k], stiffness[k])
        np.testing.assert_allclose(found.y[k], y, atol=1e-10)


def test_where_the_first_step_meets_no_stiffness_the_load_is_cut_at_once():
    """y^4 / 4 + (1/2 - load) y^2 / 2 - load y: at the load 1 a small y has no stiffness, nor has any part of it."""

    @jax.jit
    def softened(load):
        def energy(y, load):
            return y[0] ** 4 / 4 + (0.5 - load) * y[0] ** 2 / 2 - load * y[0]

        return followed(expansion_of(energy), jnp.zeros(1), jnp.zeros(()), 0.3 * load[None], load, 10.0)

    found = softened(jnp.asarray(1.0))
    real = np.roots([1, 0, -0.5, -1])
    assert found.reached
    assert float(found.y[0]) == pytest.approx(real[abs(real.imag) < 1e-12].real[0], rel=1e-14)
    assert found.evaluations <= 14


@pytest.mark.parametrize("load", [0.55, 0.7, 3.0])
def test_in_contact_too_a_minimum_behind_a_largest_load_is_not_leapt_to(load):
    """z as in the softening spring above: its load is largest at z = 1/2, and rises again from z = 4."""
    highest = 1 - 9 / 16 + 1 / 24
    found = _on_a_wall(jnp.array([1.0, -3 / 4, 1 / 12, 0]), jnp.asarray(load), 10.0, 1.0)
    assert found.lost
    assert highest - 1e-3 < float(found.load) <= highest
    assert float(found.y[0]) < 0.5
    assert float(found.y[1]) == pytest.approx(0.01, rel=1e-3)
