"""Roots of one unknown in a bracket, against functions whose roots are known; what they take is bounded."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize.elementwise import find_root

from softgrip_jax.numerics.choice import select
from softgrip_jax.numerics.scalar_roots import MAX_BRACKET_STEPS, bracketed_root, newton_bracketed

RANDOM = settings(max_examples=60, deadline=None, derandomize=True)
EPS = np.finfo(float).eps

FUNCTIONS = (
    lambda x, root: x - root,
    lambda x, root: x**3 - root**3,
    lambda x, root: jnp.exp(x) - jnp.exp(root),
    lambda x, root: jnp.arctan(50 * (x - root)),
    lambda x, root: (x - root) ** 5,
    lambda x, root: jnp.sign(x - root) * jnp.sqrt(jnp.abs(x - root)),
    lambda x, root: jnp.log(x + 4) - jnp.log(root + 4),
)
SINGLE_STEP = 0
FLAT = (1, 4)
"""No slope at the root, or none at a root of zero: only as good as their rounding."""
KINKED = 5


@jax.jit
def bracketed(which, root, low, high):
    return bracketed_root(lambda x: jax.lax.switch(which, FUNCTIONS, x, root), low, high)


@jax.jit
def newton(which, root, low, high, guess):
    return newton_bracketed(lambda x: jax.lax.switch(which, FUNCTIONS, x, root), low, high, guess)


ROOTS = st.floats(-2.0, 2.0).map(lambda x: round(x, 6))
WAYS = st.floats(1e-3, 1.9)


@RANDOM
@given(which=st.integers(0, len(FUNCTIONS) - 1), root=ROOTS, below=WAYS, above=WAYS)
@example(which=1, root=0.0, below=1.0, above=0.5)
def test_bracketed_roots_to_the_last_bits(which, root, below, above):
    found = bracketed(which, root, root - below, root + above)
    if which in FLAT:
        assert abs(FUNCTIONS[which](found.x, root)) <= 1e-15
    else:
        assert abs(found.x - root) <= 8 * EPS * (1 + abs(root))
    assert root - below <= found.x <= root + above
    assert found.iterations <= (MAX_BRACKET_STEPS if which in FLAT or root == 0 else 70)


def test_a_smooth_root_takes_few_steps_and_bisection_the_rest():
    """Exponential: nine steps from a bracket of order one; a jump: as many as there are bits."""
    assert bracketed(2, 0.3, -1.0, 1.5).iterations <= 10
    jump = jax.jit(lambda low, high: bracketed_root(lambda x: jnp.where(x < 1 / 3, -1.0, 1.0), low, high))
    found = jump(0.0, 1.0)
    assert 45 <= found.iterations <= 60
    assert jump(0.5, 0.75).x == pytest.approx(0.5, rel=4 * EPS)  # no change of sign: the end that is nearest to one
    assert jump(-1.0, 0.25).x == pytest.approx(0.25, rel=4 * EPS)
    assert jump(-1.0, 0.25).iterations <= MAX_BRACKET_STEPS


def test_the_ends_of_a_bracket_are_never_evaluated():
    """1/x between poles, where the ends are infinite or not a number."""
    found = jax.jit(lambda low, high: bracketed_root(lambda x: 1 / (1 - x) - 1 / x, low, high))(0.0, 1.0)
    assert float(found.x) == pytest.approx(0.5, rel=2 * EPS)
    found = jax.jit(lambda low, high: bracketed_root(lambda x: jnp.log(x) - jnp.log(2 - x), low, high))(0.0, 2.0)
    assert float(found.x) == pytest.approx(1.0, rel=2 * EPS)


def test_what_is_not_a_number_ends_a_search():
    found = jax.jit(lambda low, high: bracketed_root(lambda x: x * jnp.nan, low, high))(0.0, 1.0)
    assert found.iterations < MAX_BRACKET_STEPS
    assert bracketed(0, np.nan, 0.0, 1.0).iterations < MAX_BRACKET_STEPS
    assert newton(0, np.nan, 0.0, 1.0, 0.5).iterations <= MAX_BRACKET_STEPS


@RANDOM
@given(which=st.sampled_from([0, 1, 2, 3, 6]), root=ROOTS, below=WAYS, above=WAYS, share=st.floats(-0.5, 1.5))
def test_newtons_method_stays_in_its_bracket(which, root, below, above, share):
    """From any guess, one outside of the bracket too: arctan alone would run away, x^3 stand still at zero."""
    low, high = root - below, root + above
    found = newton(which, root, low, high, low + share * (high - low))
    assert low <= found.x <= high
    if which in FLAT:
        assert abs(found.x**3 - root**3) <= 1e-14
    else:
        assert abs(found.x - root) <= 1e-15 + 8 * EPS * abs(root) + EPS
    assert found.iterations <= (12 if which == SINGLE_STEP and abs(root) > 1e-3 else MAX_BRACKET_STEPS)


def test_newtons_method_takes_few_steps_from_a_good_guess_and_none_in_an_empty_bracket():
    found = newton(2, 0.7, -1.0, 2.0, 0.71)
    assert float(found.x) == pytest.approx(0.7, rel=EPS)
    assert found.iterations <= 3
    # A guess outside is not tried, be it another root.
    low, high, outside = (jnp.asarray(x) for x in (0.0, 3.0, -1.0))
    assert float(newton_bracketed(lambda x: x**2 - 1, low, high, outside).x) == pytest.approx(1, rel=2 * EPS)
    beyond = newton_bracketed(lambda x: (x - 1) * (5 - x), low, high, jnp.asarray(5.0))
    assert float(beyond.x) == pytest.approx(1, rel=2 * EPS)
    empty = newton(2, 0.7, 0.4, 0.4, 0.4)
    assert (float(empty.x), int(empty.iterations)) == (0.4, 0)


def test_a_short_first_move_does_not_tell_that_the_search_is_over():
    """Next to a pole of p(x) = 1 / (POLE - x) a guess that is off by a hundredth of the distance needs three steps."""
    pole = 1.0 + 1e-6

    def off_target(x):
        return 1 / (pole - x) - 1e6

    found = newton_bracketed(off_target, jnp.asarray(0.5), jnp.asarray(1.0 + 5e-7), jnp.asarray(1.0 + 1e-8))
    assert abs(float(found.x) - 1) < 1e-15
    assert float(found.iterations) > 2


def test_nor_does_one_that_follows_a_halving():
    """As above, and level from 6/5 on: the first step leads far away, and half the bracket to 1e-8 from the root."""

    def off_target(x):
        return jnp.where(x > 1.2, 1e6 + 1e-6 * x, 1 / (1.0 + 1e-6 - x) - 1e6)

    found = newton_bracketed(off_target, jnp.asarray(0.5), jnp.asarray(2.0), jnp.asarray(1.5 + 2e-8))
    assert abs(float(found.x) - 1) < 1e-15


def test_no_derivative_passes_through_a_search():
    def root(c):
        def function(x):
            return x**2 - c

        low, high = 0 * c, 1 + c
        return bracketed_root(function, low, high).x + newton_bracketed(function, low, high, c).x

    value, slope = jax.jit(jax.value_and_grad(root))(2.0)
    assert float(value) == pytest.approx(2 * np.sqrt(2), rel=4 * EPS)
    assert slope == 0


def test_lanes_of_a_batch_are_what_they_are_alone():
    roots = jnp.linspace(-1.5, 1.5, 7)
    for which in range(len(FUNCTIONS)):
        lanes = jax.vmap(lambda root, which=which: bracketed(which, root, root - 0.7, root + 1.1))(roots)
        alone = [bracketed(which, root, root - 0.7, root + 1.1) for root in roots]
        np.testing.assert_allclose(lanes.x, [one.x for one in alone], rtol=1e-3 if which in FLAT else 1e-14, atol=1e-15)


def test_a_choice_between_trees():
    one, other = {"a": jnp.arange(2.0), "b": (jnp.asarray(1),)}, {"a": -jnp.arange(2.0), "b": (jnp.asarray(5),)}
    for condition, expected in ((True, one), (False, other)):
        chosen = select(jnp.asarray(condition), one, other)
        jax.tree.map(np.testing.assert_array_equal, chosen, expected)


def test_a_newton_step_out_of_the_bracket_is_not_made():
    """(x + 1/10) (x - 7/10) falls at the guess: its slope leads to the root below the bracket."""
    low, high, guess = (jnp.asarray(x) for x in (0.0, 1.0, 0.05))
    assert float(newton_bracketed(lambda x: (x + 0.1) * (x - 0.7), low, high, guess).x) == pytest.approx(
        0.7, rel=4 * EPS
    )


def test_where_newtons_steps_shrink_slowly_the_bracket_is_halved_to_the_end():
    """(x - 3/10)^5: Newton's steps shrink by a fifth each, and a hundred of them would leave 1e-10."""
    low, high, guess = (jnp.asarray(x) for x in (0.0, 1.0, 0.9))
    found = newton_bracketed(lambda x: (x - 0.3) ** 5, low, high, guess)
    assert float(found.x) == pytest.approx(0.3, rel=1e-12)
    assert found.iterations < 100


@pytest.mark.parametrize("which", [2, 3, 4, 5, 6])
def test_a_bracket_takes_as_few_evaluations_as_in_scipy(which):
    """SciPy's method of Chandrupatla counts the two ends, which are not evaluated here."""
    random = np.random.default_rng(0)
    root = random.uniform(-2, 2, 300)
    low, high = root - random.uniform(1e-3, 1.9, 300), root + random.uniform(1e-3, 1.9, 300)
    ours = jax.jit(jax.vmap(lambda *args: bracketed_root(lambda x: FUNCTIONS[which](x, args[0]), *args[1:])))(
        root, low, high
    )
    exact = {"xatol": 0, "xrtol": 2 * EPS, "fatol": 0, "frtol": 0}
    theirs = find_root(
        lambda x, root: np.asarray(FUNCTIONS[which](x, root)), (low, high), args=(root,), tolerances=exact
    )
    assert np.mean(ours.iterations) <= np.mean(theirs.nfev)
    assert np.max(ours.iterations) <= np.max(theirs.nfev) + 2


@pytest.mark.parametrize(("below", "above"), [(1.0, 1e-9), (1e-9, 1.0)])
def test_of_the_last_two_points_the_one_with_the_smaller_residual_is_the_root(below, above):
    """x^2 - 2, many times as steep on one side of sqrt(2), which is no double."""

    def kinked(x):
        return (x * x - 2) * jnp.where(x * x > 2, above, below)

    low, high = jnp.linspace(0, 1.3, 40), jnp.linspace(3, 1.5, 40)
    found = jax.jit(jax.vmap(lambda low, high: bracketed_root(kinked, low, high)))(low, high).x
    assert np.all((found**2 > 2) == (above < below))
    np.testing.assert_allclose(found, np.sqrt(2), rtol=2 * EPS)


def test_a_root_that_is_met_ends_a_search():
    low, high = jnp.asarray(0.0), jnp.asarray(1.0)
    found = bracketed_root(lambda x: x - 0.5, low, high)
    assert (float(found.x), int(found.iterations)) == (0.5, 1)
    for sign in (1.0, -1.0):  # a guess that is off by the last bit alone
        ends = (low + 0.25, high) if sign > 0 else (-high, low - 0.25)
        guess = sign * jnp.nextafter(jnp.asarray(0.5), 1.0)
        found = newton_bracketed(lambda x, sign=sign: x - sign * 0.5, *ends, guess)
        assert (float(found.x), int(found.iterations)) == (sign * 0.5, 1)
    # Instead of a guess outside the middle is tried.
    found = newton_bracketed(lambda x: x - 0.5, low + 0.25, high - 0.25, jnp.asarray(7.0))
    assert (float(found.x), int(found.iterations)) == (0.5, 1)


def test_a_bracket_around_zero_is_halved_a_hundred_times_at_most():
    """Relative to zero no bracket is small."""
    found = jax.jit(lambda low, high: bracketed_root(lambda x: jnp.where(x < 0, -1.0, 1.0), low, high))(-1.0, 2.0)
    assert found.iterations == 100
    assert abs(found.x) <= 2


@pytest.mark.parametrize("method", ["bracketed", "newton"])
def test_neither_scale_nor_sign_changes_the_way_to_a_root(method):
    """f(x) = 0 and -f(-x / s) = 0 for s a power of two: the same steps, to the last bit."""

    @jax.jit
    @jax.vmap
    def found(root, low, high, scale):
        def function(x):
            x = x / scale
            return jnp.sign(scale) * (jnp.arctan(3 * (x - root)) + 0.3 * (x - root) ** 3)

        ends = jnp.where(scale < 0, scale * jnp.stack([high, low]), scale * jnp.stack([low, high]))
        if method == "bracketed":
            return bracketed_root(function, ends[0], ends[1])
        return newton_bracketed(function, ends[0], ends[1], scale * (0.3 * low + 0.7 * high))

    random = np.random.default_rng(1)
    root = random.uniform(0.1, 2, 100)
    low, high = root - random.uniform(1e-3, 1.9, 100), root + random.uniform(1e-3, 1.9, 100)
    plain = found(root, low, high, np.ones(100))
    np.testing.assert_allclose(plain.x, root, rtol=8 * EPS)
    for scale in (-1.0, 2.0**-30, -(2.0**30)):
        scaled = found(root, low, high, np.full(100, scale))
        if method == "newton" or scale > 0:
            np.testing.assert_array_equal(scaled.x, scale * plain.x)
            np.testing.assert_array_equal(scaled.iterations, plain.iterations)
        else:  # the first side of the bracket is another one
            np.testing.assert_allclose(scaled.x, scale * plain.x, rtol=4 * EPS)
            assert abs(np.mean(scaled.iterations) - np.mean(plain.iterations)) < 0.5


def test_a_newton_step_out_of_either_end_is_not_made():
    """(x - 3/10) (11/10 - x) falls at the guess: its slope leads to the root above the bracket."""
    low, high, guess = (jnp.asarray(x) for x in (0.0, 1.0, 0.95))
    found = newton_bracketed(lambda x: (x - 0.3) * (1.1 - x), low, high, guess)
    assert float(found.x) == pytest.approx(0.3, rel=4 * EPS)


def test_the_last_step_does_not_leave_the_bracket_either():
    """A root that lies half an eps before the bracket."""
    low = jnp.nextafter(jnp.asarray(0.5), 1.0)
    assert newton_bracketed(lambda x: x - 0.5, low, jnp.asarray(1.0), low).x == low


def test_a_small_step_after_a_large_one_does_not_tell_that_the_search_is_over():
    """x - 1 with a hump of 1e-4 at its root: from 100 the moves are 99 and 1e-4, and the root is 1e-8 farther."""

    def humped(x):
        return x - 1 + 1e-4 * jnp.exp(-(((x - 1) / 0.01) ** 2))

    found = newton_bracketed(humped, jnp.asarray(0.5), jnp.asarray(200.0), jnp.asarray(100.0))
    x, hump = float(found.x), 1e-4
    for _ in range(20):
        hump = 1e-4 * np.exp(-((hump / 0.01) ** 2))
    assert x == pytest.approx(1 - hump, rel=4 * EPS)


def test_newtons_method_halves_where_there_is_no_slope_and_ends_with_the_bracket():
    """A jump at 1/3: brackets of 2^-k, until 2 eps of x are left; at zero, relative to which none is small, the end."""
    jump = jax.jit(
        lambda place, low, high: newton_bracketed(
            lambda x: jnp.where(x < place, -1.0, 1.0), low, high, 0.5 * (low + high)
        )
    )
    for place, low, high in ((1 / 3, 0.0, 1.0), (-1 / 3, -1.0, 0.0)):
        found = jump(place, low, high)
        assert float(found.x) == pytest.approx(place, rel=2 * EPS)
        assert found.iterations == np.ceil(-np.log2(2 * EPS / 3))
    assert newton(4, 0.0, -1.0, 2.0, 0.7).iterations == 100
