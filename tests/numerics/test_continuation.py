"""Equilibrium paths against curves whose roots, limit points and ends are known in closed form.

One program follows them all: the residual is a polynomial in one unknown y and the load p, whose coefficients are
arguments, and it does not exist beyond a given y.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from softgrip_jax.numerics.continuation import (
    BIFURCATION,
    ENDED,
    FOLD,
    LARGEST_STEP,
    MAX_STEPS,
    REACHED,
    Climb,
    Steps,
    fold_load,
    follow,
    trace,
)
from softgrip_jax.numerics.continuation.newton import FINE, NewtonIteration, goes_on, has_converged, value_and_jacobian
from softgrip_jax.numerics.continuation.points import TURN

DEGREE = 4
RANDOM = settings(max_examples=60, deadline=None, derandomize=True)


def coefficients(**terms: float) -> np.ndarray:
    """Of y^i p^j from y1p0=..., in rows i and columns j."""
    table = np.zeros((DEGREE, DEGREE))
    for name, value in terms.items():
        table[int(name[1]), int(name[3])] = value
    return table


def polynomial(u, args):
    table, end = args
    of_y, of_p = jnp.stack([u**k for k in range(DEGREE)], axis=1)
    return jnp.where(u[0] > end, jnp.nan, of_y @ table @ of_p)[None]


def equations(u, args):
    *curve, target = args
    return polynomial(u, curve), u[1] - target


@jax.jit
def _followed(u, table, target, end, first):
    return follow(equations, u, (table, end, target), first)


def followed(table, y, p, target, end=np.inf, first=0.3):
    """(y, p, reason, iterations) of the search from (y, p) for the load `target`."""
    found = _followed(jnp.array([y, p], float), jnp.asarray(table), target, end, first)
    return float(found.u[0]), float(found.u[1]), int(found.reason), int(found.iterations)


CUBIC = coefficients(y0p1=1, y1p0=-1, y3p0=1 / 3)
"""p = y - y^3 / 3: limit points at y = 1 and -1, p = 2/3 and -2/3."""


# --- goals and limit points -------------------------------------------------------------------------------------------


def test_a_straight_path_takes_few_steps_however_long():
    """Steps double up to the largest, each with one correction; what is left of the way is one step."""
    table = coefficients(y0p1=1, y1p0=-2)
    for target, most in ((0.01, 3), (1.0, 6), (100.0, 40)):
        y, p, reason, iterations = followed(table, 0, 0, target)
        assert reason == REACHED
        assert (y, p) == pytest.approx((target / 2, target), rel=1e-15)
        assert np.hypot(y, p) / LARGEST_STEP <= iterations <= most


@pytest.mark.parametrize("length", [10.0, 100.0, 1000.0])
def test_steps_by_default_begin_with_a_third_and_double_up_to_four(length):
    """0.3 + 0.6 + 1.2 + 2.4 = 4.5, then 4 each; one iteration for each of them, for the start and for the goal."""
    args = jnp.asarray(coefficients(y0p1=1, y1p0=-1)), jnp.inf, length / np.sqrt(2)
    found = jax.jit(lambda *args: follow(equations, jnp.zeros(2), args))(*args)
    assert found.reason == REACHED
    assert found.iterations == 1 + 4 + (length - 4.5) // 4 + 1


@pytest.mark.parametrize("below", [0.03, 0.01, 1e-3, 1e-5])
def test_a_goal_next_to_a_sharp_top_is_met_where_it_rises(below):
    """Newton's method from below may land where the goal falls, behind the top."""

    @jax.jit
    @jax.vmap
    def met(top):
        def peak(u, top):
            place = u[1] / top
            return u[:1] - u[1:], jnp.where(place < 1, place**2, 1.4 - 0.4 * place) - (1 - below)

        return follow(peak, jnp.zeros(2), top)

    tops = np.array([1.0, 2.0, 5.0])
    end = met(tops)
    assert np.all(end.reason == REACHED)
    np.testing.assert_allclose(end.u[:, 1] / tops, np.sqrt(1 - below), rtol=1e-12)


def test_a_path_that_is_too_long_is_given_up():
    y, p, reason, iterations = followed(coefficients(y0p1=1, y1p0=-2), 0, 0, 5000.0)
    assert reason == ENDED
    assert p == pytest.approx(2 * y, rel=1e-13)
    assert MAX_STEPS <= iterations <= MAX_STEPS + 5 < 500
    assert 0.9 * MAX_STEPS * LARGEST_STEP < np.hypot(y, p) <= MAX_STEPS * LARGEST_STEP


def test_points_on_the_way_are_known_to_about_a_hundredth():
    """Where a search is given up it is at such a point; the path bends as p = y + y^2 does."""

    @jax.jit
    @jax.vmap
    def given_up(first):
        args = jnp.asarray(coefficients(y0p1=1, y1p0=-1, y2p0=-1)), jnp.inf, 50.0
        return follow(equations, jnp.zeros(2), args, first, Steps(most=4)).u

    y, p = given_up(np.linspace(0.05, 1.0, 20)).T
    assert np.all(y > 0.1)
    left = np.abs(p - y - y**2) / np.hypot(1, 1 + 2 * y)  # the distance from the path, nearly
    assert 1e-4 < np.max(left) < 0.015


@jax.jit
def _by_steps(table, target, is_there):
    """From rest, with steps of a caller's own."""
    steps = Steps(largest=0.25, turn=0.999, most=100)
    return follow(equations, jnp.zeros(2), (table, jnp.inf, target), 0.25, steps, is_there)


def test_a_caller_says_how_long_steps_are_how_far_they_turn_and_how_many_there_may_be():
    line = jnp.asarray(coefficients(y0p1=1, y1p0=-2))
    found = _by_steps(line, 8.0, False)
    assert found.reason == REACHED
    assert np.hypot(4, 8) / 0.25 <= found.iterations <= np.hypot(4, 8) / 0.25 + 4
    assert _by_steps(line, 80.0, False).reason == ENDED
    # A turn by arctan(1.5) in steps of 2.6 degrees, where the default takes steps of 26.
    bent = coefficients(y0p1=1, y1p0=-1, y2p0=-1)
    found = _by_steps(jnp.asarray(bent), 2.0, False)
    assert found.reason == REACHED
    assert float(found.u[0]) == pytest.approx(1, rel=1e-14)
    assert found.iterations > 2 * followed(bent, 0, 0, 2.0)[3]


def test_what_is_there_already_is_handed_back():
    found = _by_steps(jnp.asarray(CUBIC), 5.0, True)
    assert (int(found.reason), int(found.iterations)) == (REACHED, 0)
    assert found.u.tolist() == [0.0, 0.0]


@jax.jit
def _climbed(target, most, end=jnp.inf, table=CUBIC, to=None):
    """From rest, with a climb to the goal's load or another one, believed where |y| is less than `most`; the goal lies
    at y = `end` or at the load `target`, whatever comes first."""
    top = target if to is None else to
    climb = Climb(jnp.zeros(2), top, jnp.asarray(True), lambda u, args: jnp.abs(u[0]) < args[-1])

    def with_most(u, args):
        residual, goal = equations(u, args[:-2])
        return residual, jnp.maximum(goal, u[0] - args[-2])

    args = (jnp.asarray(table), jnp.inf, target, end, most)
    return follow(with_most, jnp.zeros(2), args, 0.01, Steps(largest=0.01), climb=climb)


def test_newtons_method_gives_the_answer_where_it_is_sure_and_else_where_the_path_begins():
    root = brentq(lambda y: y - y**3 / 3 - 0.3, 0, 1, xtol=1e-15)
    believed, doubted, never = (_climbed(0.3, most) for most in (1.0, 0.3, 0.0))
    for found in (believed, doubted, never):
        assert found.reason == REACHED
        assert float(found.u[0]) == pytest.approx(root, rel=1e-14)
    # Steps of 0.01 go from the last load at which |y| < 0.3, or from rest.
    assert believed.iterations <= 5
    assert never.iterations > 50
    assert believed.iterations < doubted.iterations < 0.7 * never.iterations
    # At a load beyond the limit point there is a root all the same, -2.6, which is not believed.
    beyond = _climbed(3.0, 0.9)
    assert beyond.reason == FOLD
    assert beyond.u.tolist() == pytest.approx([1.0, 2 / 3], rel=1e-7)
    assert beyond.iterations < 0.4 * _climbed(3.0, 0.0).iterations  # between what it found and what it lost, too


def test_a_goal_that_comes_before_the_one_that_was_climbed_to_is_found():
    """Newton's method arrives at the load 0.3, where the other goal, y = 0.1, has been passed."""
    found = _climbed(0.3, 1.0, 0.1)
    assert found.reason == REACHED
    assert found.u.tolist() == pytest.approx([0.1, 0.1 - 0.1**3 / 3], rel=1e-12)


def test_a_goal_that_is_passed_on_the_way_and_not_at_the_largest_load_is_found():
    """y = (p - p^2) / 10 reaches 0.02 at p = (1 - sqrt(0.2)) / 2, and is back at 0 where Newton's method arrives."""
    hump = jnp.asarray(coefficients(y1p0=1, y0p1=-0.1, y0p2=0.1))
    found = _climbed(9.0, 1.0, 0.02, table=hump, to=1.0)
    assert found.reason == REACHED
    assert float(found.u[1]) == pytest.approx(0.5 * (1 - np.sqrt(0.2)), rel=1e-12)


def test_what_newtons_method_does_not_find_is_lost_and_the_path_is_followed():
    """From y = 0, where the slope is nearly level, its first step goes a thousand times too far, to where nothing is
    believed."""
    late = coefficients(y0p1=1, y1p0=-0.001, y3p0=-1)
    found = _climbed(0.3, 1.0, table=late)
    assert found.reason == REACHED
    assert float(found.u[0]) == pytest.approx(brentq(lambda y: 0.001 * y + y**3 - 0.3, 0, 1, xtol=1e-15), rel=1e-12)


@pytest.mark.parametrize("target", [0.05, 0.3, 0.6, 0.66, 0.6666, 0.666666, 0.66666666])
def test_a_goal_before_a_limit_point_is_found_on_the_near_side(target):
    y, p, reason, iterations = followed(CUBIC, 0, 0, target)
    expected = 2 * np.sin(np.arcsin(1.5 * target) / 3)  # of the three roots, the one in (0, 1)
    assert reason == REACHED
    assert p == pytest.approx(target, rel=1e-15)
    assert y == pytest.approx(expected, abs=1e-15 / np.sqrt(2 / 3 - target))
    assert iterations <= (8 if target < 0.665 else 45)


@pytest.mark.parametrize("target", [0.66666667, 0.667, 1.0, 30.0])
def test_a_goal_beyond_a_limit_point_ends_at_the_limit_point(target):
    y, p, reason, iterations = followed(CUBIC, 0, 0, target)
    assert reason == FOLD
    assert p == pytest.approx(2 / 3, rel=1e-15)
    assert y == pytest.approx(1, abs=1e-7)  # the load is right to the square of it
    assert iterations < 40


def test_the_first_limit_point_of_two_ends_the_path_even_where_the_load_comes_back():
    """p rises to 2/3, falls to -2/3 and rises again to the goal: what is beyond the first fall is never reached."""
    back = coefficients(y0p1=1, y1p0=-1.25, y2p0=1, y3p0=-0.2)  # p' = 1.25 - 2 y + 0.6 y^2
    top = (2 - np.sqrt(4 - 4 * 0.6 * 1.25)) / 1.2
    y, p, reason, _ = followed(back, 0, 0, 5.0)
    assert reason == FOLD
    assert (y, p) == pytest.approx((top, 1.25 * top - top**2 + 0.2 * top**3), abs=1e-7)


@RANDOM
@given(
    slope=st.floats(0.05, 5),
    bends=st.tuples(st.integers(-30, 30), st.integers(-30, 30)),
    share=st.floats(0.01, 1.5),
    first=st.floats(0.01, 4),
)
@example(slope=1.0, bends=(0, -10), share=1.0 - 1e-8, first=0.3)
def test_random_cubics(slope, bends, share, first):
    """p = slope y + b y^2 + c y^3 from the origin: the first root of the polynomial, or its first limit point."""
    b, c = bends[0] / 10, bends[1] / 10
    turns = np.roots([3 * c, 2 * b, slope])
    turns = turns[np.isreal(turns) & (turns.real > 0)].real
    top = min(turns, default=np.inf)
    assume(np.isfinite(top) or 3 * c >= 0)
    highest = slope * top + b * top**2 + c * top**3 if top < 50 else np.inf
    target = share * min(highest, 20.0)
    assume(abs(target / highest - 1) > 1e-9)
    y, p, reason, _ = followed(coefficients(y0p1=1, y1p0=-slope, y2p0=-b, y3p0=-c), 0, 0, target, first=first)
    if target > highest:
        assert reason == FOLD
        assert p == pytest.approx(highest, rel=1e-13)
        return
    roots = np.roots([c, b, slope, -target])
    expected = min(roots[(abs(roots.imag) < 1e-7) & (roots.real > 0)].real)
    assert reason == REACHED
    assert p == pytest.approx(target, rel=1e-14)
    assert y == pytest.approx(expected, rel=1e-6)
    assert slope * y + b * y**2 + c * y**3 == pytest.approx(target, rel=1e-12)


def test_the_start_need_not_be_on_the_path():
    for y, p in ((0.1, 0.0), (-0.1, 0.02), (0.25, 0.3)):
        found = followed(CUBIC, y, p, 0.5)
        assert found[2] == REACHED
        assert found[:2] == pytest.approx(followed(CUBIC, 0, 0, 0.5)[:2], rel=1e-14)


def test_what_is_counted_are_newton_iterations_and_not_steps():
    """p = y^2 - 1 at p = 0 from y = 3/2: 13/12, 313/312, then rounding by the next one."""
    table = coefficients(y0p1=1, y0p0=1, y2p0=-1)
    off, on = followed(table, 1.5, 0, 0.5), followed(table, 1.0, 0, 0.5)
    assert off[:3] == pytest.approx((np.sqrt(1.5), 0.5, REACHED), rel=1e-14)
    assert off[3] >= on[3] + 2


def test_a_goal_that_lies_a_little_behind_the_start_is_found():
    y, p, reason, _ = followed(CUBIC, 0.2, 0.2 - 0.008 / 3, 0.18)
    assert reason == REACHED
    assert (y, p) == pytest.approx((2 * np.sin(np.arcsin(1.5 * 0.18) / 3), 0.18), rel=1e-14)


@pytest.mark.parametrize(("moves", "more"), [((1.3e-2, 2.4e-7), True), ((1e-3, 1e-6), True), ((1e-2, 9e-8), False)])
def test_two_moves_tell_of_the_next_but_a_long_first_one_may_hide_what_bends(moves, more):
    """By the ratio of the first pair 8e-17 is left; 2e-13 was, in a finger whose first move lay along the path."""
    newton = NewtonIteration(jnp.ones(2), *map(jnp.asarray, moves), jnp.asarray(2))
    assert bool(goes_on(newton, 8, FINE)) == more
    assert bool(has_converged(newton, FINE)) != more
    # One unknown that is lost is enough to give up.
    assert not goes_on(newton._replace(u=jnp.array([1.0, jnp.nan])), 8, FINE)


# --- branches ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("critical", [0.01, 0.3, 1.0, 7.7])
def test_the_straight_path_of_a_pitchfork_ends_where_it_loses_its_stability(critical):
    """y (p - critical - y^2) = 0: beyond `critical` y = 0 is an equilibrium still, but another one crosses it."""
    pitchfork = coefficients(y1p1=1, y1p0=-critical, y3p0=-1)
    y, p, reason, iterations = followed(pitchfork, 0, 0, critical + 5)
    assert reason == BIFURCATION
    assert y == 0
    assert critical - 2e-7 < p <= critical
    assert iterations < 115
    assert followed(pitchfork, 0, 0, critical - 1e-3)[1:3] == pytest.approx((critical - 1e-3, REACHED))


@RANDOM
@given(size=st.floats(-6, 0), sign=st.sampled_from([-1, 1]), target=st.floats(0.5, 3))
def test_beside_a_pitchfork_the_path_keeps_to_its_branch(size, sign, target):
    """y (p - y^2) = -imperfection, from p = -1: the branch bends to the side of the imperfection, next to another."""
    imperfection = sign * 10**size
    table = coefficients(y1p1=1, y3p0=-1, y0p0=imperfection)
    roots = np.roots([1, 0, 1, -imperfection])
    y, p, reason, _ = followed(table, roots[abs(roots.imag) < 1e-9].real[0], -1, target)
    expected = np.roots([1, 0, -target, -imperfection]).real
    expected = sign * max(sign * expected)
    assert reason == REACHED
    assert (y, p) == pytest.approx((expected, target), rel=1e-10)


def test_a_path_that_turns_before_another_branch_does_not_leap_to_it():
    """y (p - y) = e > 0: the branch from below turns at p = -2 sqrt(e), and another begins at 2 sqrt(e).

    What is checked of a step tells branches apart by their turn, their side and the size of the correction: one gap in
    hundreds (at 1e-4.91, 0.014 wide) is crossed where the other branch happens to be the straight continuation.
    """
    start, leapt, sizes = -3.0, 0, np.linspace(-8, 0, 150)
    for size in sizes:
        e = 10**size
        y, p, reason, _ = followed(coefficients(y1p1=1, y2p0=-1, y0p0=-e), start, start + e / start, 3.0)
        leapt += reason == REACHED
        if reason != REACHED:
            assert reason == FOLD
            assert y == pytest.approx(-np.sqrt(e), rel=1e-5)
            assert p == pytest.approx(-2 * np.sqrt(e), rel=1e-9)
    assert leapt <= len(sizes) // 100


def test_the_second_try_begins_at_a_point_that_is_known_to_the_last_bit():
    """Newton's method then moves by rounding alone from its first step on; the first try fails at the end of y."""
    table = coefficients(y0p1=1, y1p0=-1, y2p0=0.3)
    for start in -np.linspace(0.1, 3, 40):
        end = 0.01 + abs(start)
        y, p, reason, _ = followed(table, start, start - 0.3 * start**2, 9.0, end=end)
        assert reason == (FOLD if end > 1 / 0.6 else ENDED)
        assert y == pytest.approx(min(1 / 0.6, end), abs=1e-5)
        assert p == pytest.approx(y - 0.3 * y**2, rel=1e-12)


@RANDOM
@given(size=st.floats(-8, 0))
def test_and_where_the_two_have_joined_itgoes_on(size):
    """y (p - y) = -e < 0: now the branch from below rises past the corner, and the other one is its mirror image."""
    e = 10**size
    table = coefficients(y1p1=1, y2p0=-1, y0p0=e)
    start = -3.0
    y, p, reason, _ = followed(table, start, start - e / start, 3.0)
    assert reason == REACHED
    assert (y, p) == pytest.approx((-2 * e / (3 + np.sqrt(9 + 4 * e)), 3.0), rel=1e-10)


# --- ends -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("end", [0.013, 0.4, 2.5])
def test_a_path_ends_where_its_equations_do(end):
    table = coefficients(y0p1=1, y1p0=-1)
    y, p, reason, iterations = followed(table, 0, 0, 9.0, end=end)
    assert reason == ENDED
    assert end - 2e-7 < y <= end - 1e-8  # the smallest step is 1e-7
    assert iterations < 90  # the second try among them
    assert y == pytest.approx(p, rel=1e-12)
    assert followed(table, 0, 0, 0.9 * end, end=end)[2] == REACHED


def test_where_no_path_begins_none_is_followed():
    circle = coefficients(y2p0=1, y0p0=1, y0p2=1)  # y^2 + p^2 = -1
    assert followed(circle, 0.1, 0, 1.0)[2] == ENDED
    assert followed(CUBIC, np.nan, 0, 1.0)[2] == ENDED


# --- several unknowns, batches ----------------------------------------------------------------------------------------


def mixed(u, args):
    """The cubic in z1 = p - curve(z1) = 0, z2 = z1^2, z3 = sin z1, seen through two matrices."""
    left, right, cubic, _ = args
    z, p = right @ u[:-1], u[-1]
    return left @ jnp.stack([p - z[0] * (cubic[0] + z[0] * (cubic[1] + z[0] * cubic[2])), z[1] - z[0] ** 2,
                             z[2] - jnp.sin(z[0])])  # fmt: skip


@jax.jit
def mixed_followed(*args):
    return follow(lambda u, args: (mixed(u, args), u[-1] - args[-1]), jnp.zeros(4), args)


def a_matrix(random):
    """Well conditioned, of order one."""
    q, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return q @ np.diag(random.uniform(0.5, 1.5, 3))


@RANDOM
@given(seed=st.integers(0, 10**6), share=st.floats(0.1, 1.4))
def test_what_the_unknowns_are_does_not_matter(seed, share):
    random = np.random.default_rng(seed)
    left, right, cubic = a_matrix(random), a_matrix(random), np.array([1.0, random.uniform(-0.3, 0.3), -1 / 3])
    top = (cubic[1] + np.sqrt(cubic[1] ** 2 + 1)) / 1.0
    highest = top * (1 + top * (cubic[1] - top / 3))
    assume(abs(share - 1) > 1e-9)  # at the limit point itself rounding decides whether it is reached
    target = share * highest
    found = mixed_followed(left, right, cubic, target)
    if share > 1:
        assert found.reason == FOLD
        assert float(found.u[-1]) == pytest.approx(highest, rel=1e-12)
        return
    roots = np.roots([cubic[2], cubic[1], cubic[0], -target]).real
    z = min(roots[roots > 0])
    assert found.reason == REACHED
    expected = np.linalg.solve(right, [z, z**2, np.sin(z)])
    np.testing.assert_allclose(found.u, [*expected, target], rtol=1e-6 if share > 0.999 else 1e-9, atol=1e-10)


def test_lanes_of_a_batch_are_what_they_are_alone():
    """Goals, limit points, bifurcations and ends side by side, more of them than there are slots."""
    random = np.random.default_rng(0)
    tables = [CUBIC, coefficients(y1p1=1, y1p0=-1, y3p0=-1), coefficients(y0p1=1, y1p0=-1)]
    chosen = random.integers(0, 3, 150)
    ends, targets = np.where(chosen == 2, 0.8, np.inf), random.uniform(0.1, 1.5, 150)
    batch = jnp.asarray(np.array(tables)[chosen])
    found = jax.vmap(_followed, (None, 0, 0, 0, None))(jnp.zeros(2), batch, targets, ends, 0.3)
    for k in range(150):
        y, p, reason, iterations = followed(tables[chosen[k]], 0, 0, targets[k], ends[k])
        assert (int(found.reason[k]), int(found.iterations[k])) == (reason, iterations)
        assert tuple(found.u[k]) == pytest.approx((y, p), rel=1e-12, abs=1e-12)
    assert set(np.asarray(found.reason)) == {REACHED, FOLD, BIFURCATION, ENDED}


# --- limit points under derivatives, curves ---------------------------------------------------------------------------


def test_a_limit_load_moves_as_its_closed_form():
    """p = a z - b z^2 - c z^3 in mixed unknowns: value, gradient and second derivatives by the coefficients."""
    random = np.random.default_rng(5)
    left, right = a_matrix(random), a_matrix(random)

    def closed(cubic):
        a, b, c = cubic
        top = (-b - jnp.sqrt(b**2 - 3 * a * c)) / (3 * c)
        return top * (a + top * (b + top * c))

    cubic = jnp.array([1.2, 0.1, -0.4])
    u = mixed_followed(left, right, cubic, 9.0).u

    def limit(cubic):
        return fold_load(mixed, u, (left, right, cubic, 9.0))

    assert float(limit(cubic)) == pytest.approx(float(closed(cubic)), rel=1e-13)
    for derivative in (jax.grad, jax.jacfwd, lambda f: jax.jacfwd(jax.grad(f))):
        np.testing.assert_allclose(jax.jit(derivative(limit))(cubic), derivative(closed)(cubic), rtol=1e-7)


def test_a_traced_curve_has_equal_steps_and_goes_through_its_limit_points():
    """A circle around the origin: steps along the tangent and back across it are equal angles, asin(step / radius)."""
    radius, step, n = 1.5, 0.3, 30
    circle = coefficients(y2p0=1, y0p2=1, y0p0=-(radius**2))
    start = jnp.array([-radius * np.sin(1.0), -radius * np.cos(1.0)])

    def points(end):
        return trace(lambda u: polynomial(u, (jnp.asarray(circle), end)), start, step, n)

    found, good = jax.jit(points)(jnp.inf)
    assert np.all(good)
    np.testing.assert_allclose(np.hypot(*np.asarray(found).T), radius, rtol=1e-14)
    angles = 1.0 + np.pi + np.arcsin(step / radius) * np.arange(n)  # clockwise, for the load grows at first
    expected = radius * np.stack([np.sin(angles), np.cos(angles)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert set(np.sign(np.diff(found[:, 1]))) == {1, -1}
    # Where the curve ends its points are not trusted, and none after them.
    found, good = jax.jit(points)(1.0)
    beyond = np.argmax(expected[:, 0] > 1.0)
    assert 0 < beyond < n
    np.testing.assert_array_equal(good, np.arange(n) < beyond)
    # Large steps are made of smaller ones, which do not leave the curve.
    found, good = jax.jit(lambda: trace(lambda u: polynomial(u, (jnp.asarray(circle), jnp.inf)), start, 2.0, 5))()
    assert np.all(good)
    np.testing.assert_allclose(np.hypot(*np.asarray(found).T), radius, rtol=1e-14)
    # None of them turns by more than 26 degrees: together they are little more than an arc of that length.
    turned = np.diff(np.unwrap(np.arctan2(*np.asarray(found).T)))
    most = np.arccos(TURN)
    assert np.all((turned > 2.0 / radius) & (turned < 2.0 / radius * most / np.sin(most)))


@pytest.mark.parametrize(("radius", "level"), [(1.0, 9), (1.0, 10), (0.01, 9), (0.01, 10), (0.01, 11)])
def test_one_point_of_a_traced_curve_is_moved_to_its_limit_point(radius, level):
    """The top of an ellipse, also of one that is as sharp as a hairpin, from before it and from behind it."""
    ellipse = coefficients(y2p0=radius**-2, y0p2=1, y0p0=-1)
    start = jnp.array([-radius * np.cos(0.1), np.sin(0.1)])
    step = {1.0: (np.pi / 2 - 0.1) / 10, 0.01: 0.9 / 10}[radius]

    def points(level):
        return trace(lambda u: polynomial(u, (jnp.asarray(ellipse), jnp.inf)), start, step, 14, level)

    found, good = jax.jit(points)(level)
    assert np.all(good)
    np.testing.assert_allclose(found[level], [0, 1], atol=1e-7)
    assert found[level, 1] == pytest.approx(1, abs=1e-14)
    plain = np.asarray(jax.jit(points)(0)[0])
    assert np.max(np.delete(plain[:, 1], level)) < 1
    np.testing.assert_array_equal(found[:level], plain[:level])
    assert np.all(np.diff(found[level:, 1]) < 0)


def test_a_value_and_its_jacobian_in_one():
    u = jnp.array([0.3, -0.7, 1.1])

    def function(u):
        return jnp.stack([u[0] * u[1], jnp.sin(u[2])]), u @ u

    (value, size), (jacobian, slope) = value_and_jacobian(function, u)
    np.testing.assert_allclose(value, [-0.21, np.sin(1.1)])
    np.testing.assert_allclose(jacobian, [[-0.7, 0.3, 0], [0, 0, np.cos(1.1)]], atol=1e-16)
    np.testing.assert_allclose((size, *slope), (1.79, 0.6, -1.4, 2.2))
