"""What a search along a path does next: every case by hand, on paths that are parabolas where guesses are exact."""

import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.continuation.newton import newton_from
from softgrip_jax.numerics.continuation.points import Point
from softgrip_jax.numerics.continuation.search import (
    BIFURCATION,
    ENDED,
    FLAT,
    FOLD,
    LARGEST_STEP,
    LEVEL,
    LONGER,
    REACHED,
    SHORT,
    SHORTER,
    SMALLEST_STEP,
    STEPPING,
    TO_FOLD,
    TO_GOAL,
    after_fold_trial,
    after_goal_trial,
    after_step,
    beginning,
    first_of,
    guess_of,
)


def point(u=(0.0, 0.0), tangent=(0.6, 0.8), goal=-1.0):
    return Point(jnp.asarray(u), jnp.asarray(tangent), jnp.asarray(goal), jnp.asarray(1.0))


def search(**changes):
    """A search on its way: two points are known, the next is half a unit ahead."""
    known = beginning(jnp.zeros(2), 0.5)._replace(before=point(), count=jnp.asarray(2))
    return known._replace(**{k: v if isinstance(v, Point) else jnp.asarray(v) for k, v in changes.items()})


def chosen(cases):
    """The state of the first case that holds; one of them must."""
    number, state = first_of(*cases, (True, search(mode=-1)))
    assert int(number) < len(cases)
    return state


def step(new, good=True, *, rise=1.0, roughly=False, crossed=False, largest=LARGEST_STEP, **state):
    now = search(**state)
    good, roughly, crossed = (jnp.asarray(v) for v in (good, roughly, crossed))
    return now, chosen(after_step(now, new, jnp.asarray(rise), good, roughly, crossed, largest))


# --- steps ------------------------------------------------------------------------------------------------------------


def test_a_good_step_goes_on_twice_as_far_up_to_the_largest():
    new = point((0.3, 0.4), (0.0, 1.0), -90.0)
    for length, following in ((0.5, 1.0), (0.9 * LARGEST_STEP, LARGEST_STEP)):
        _, on = step(new, length=length, roughly=True, far=[9.0, 9.0], high=3.0)
        assert (int(on.mode), float(on.length), float(on.stride)) == (STEPPING, following, following)
        np.testing.assert_array_equal(on.before.u, new.u)
        np.testing.assert_allclose(on.bend, np.array([-0.6, 0.2]) / length)
        assert on.roughly
        assert on.high == 0
    assert float(step(new, length=0.5, largest=0.7)[1].length) == 0.7
    # The step of length zero at the beginning only finds the tangent: it tells of no bend.
    _, on = step(new, length=0.5, count=0)
    assert float(on.length) == 0.5
    assert np.all(on.bend == 0)


@pytest.mark.parametrize(("crossed", "end"), [(True, BIFURCATION), (False, ENDED)])
def test_a_step_that_fails_is_tried_again_shorter_until_it_is_too_short(crossed, end):
    now, again = step(point(), False, crossed=crossed, length=0.5)
    assert (int(again.mode), float(again.length)) == (STEPPING, pytest.approx(SHORTER * 0.5))
    np.testing.assert_array_equal(again.before.u, now.before.u)
    assert int(step(point(), False, crossed=crossed, length=2 * SMALLEST_STEP / SHORTER)[1].mode) == STEPPING
    assert int(step(point(), False, crossed=crossed, length=0.9 * SMALLEST_STEP / SHORTER)[1].mode) == end
    # Where nothing is found at the beginning there is no path.
    assert int(step(point(), False, crossed=crossed, count=0)[1].mode) == end


def test_a_short_step_that_fails_from_a_rough_point_finds_that_point_better_first():
    for roughly, length, polishing in ((True, 0.9, True), (True, 1.1, False), (False, 0.9, False)):
        now = search(length=length * SHORT / SHORTER, roughly=roughly)
        missed = search(stride=now.length, roughly=roughly, mode=TO_GOAL, high=1.0)
        none = jnp.asarray(False)
        for after in (
            chosen(after_step(now, point(), jnp.asarray(1.0), none, none, none, LARGEST_STEP)),
            chosen(after_goal_trial(missed, point(), jnp.asarray(1.0), none)),
        ):
            assert bool(after.polishing) == polishing
            assert bool(after.roughly) == (roughly and not polishing)
            assert float(after.length) == pytest.approx(length * SHORT)


def test_while_a_point_is_found_better_no_step_is_made():
    found = point((0.01, 0.0), (0.0, 1.0), -3.0)
    now, after = step(found, True, polishing=True, length=0.1)
    np.testing.assert_array_equal(guess_of(now), now.before.u)
    np.testing.assert_array_equal(after.before.u, found.u)
    assert (bool(after.polishing), float(after.length), int(after.mode)) == (False, pytest.approx(0.1), STEPPING)
    # What is not good, or beyond a limit point, leaves the point as it was.
    for new, good in ((found, False), (point((0.01, 0.0), (1.0, -0.1)), True)):
        now, after = step(new, good, polishing=True, length=0.1)
        np.testing.assert_array_equal(after.before.u, now.before.u)
        assert not after.polishing


def test_where_the_load_has_turned_a_limit_point_is_sought_and_where_the_goal_is_passed_the_goal():
    falls, beyond = point((1.0, 0.1), (0.8, -0.6), 2.0), point((0.3, 0.4), (0.8, 0.6), 0.25)
    _, fold = step(falls, low=0.3, rise_low=0.2)
    assert int(fold.mode) == TO_FOLD  # though the goal is passed, too
    assert [float(v) for v in (fold.low, fold.high, fold.stride)] == [0, 0.5, 0.5]
    assert [float(v) for v in (fold.rise_low, fold.rise_high)] == pytest.approx([0.8, -0.6])
    assert float(fold.length) == pytest.approx(0.5 * 0.8 / 1.4)  # regula falsi
    np.testing.assert_array_equal(fold.far, falls.u)
    _, goal = step(beyond)
    assert int(goal.mode) == TO_GOAL
    assert (float(goal.length), float(goal.high)) == (pytest.approx(0.5 * 1 / 1.25), 0.5)
    assert int(step(point((0.3, 0.4), (1.0, 0.0), -1.0))[1].mode) == TO_FOLD


def test_a_goal_within_the_next_step_is_aimed_at():
    """A quarter of a unit is left at a slope of 2: an eighth."""
    new = point((0.3, 0.4), (0.6, 0.8), -0.25)
    _, aimed = step(new, rise=2.0)
    assert (int(aimed.mode), float(aimed.length), float(aimed.stride)) == (TO_GOAL, 0.125, 1.0)
    assert aimed.high == 0
    # It is farther than the next step, or the goal does not come nearer.
    assert int(step(new, rise=0.24)[1].mode) == STEPPING
    assert int(step(new, rise=-2.0)[1].mode) == STEPPING
    # Where the path begins beyond the goal it is sought behind.
    _, back = step(point(goal=0.25), rise=2.0, count=0)
    assert (int(back.mode), float(back.length)) == (TO_GOAL, -0.125)


# --- guesses ----------------------------------------------------------------------------------------------------------


def test_guesses_are_exact_on_parabolas():
    """(s - s^2, s + 2 s^2) from the origin, once by the bend that was seen before, once through a far point."""
    tangent, bend = np.array([1.0, 1.0]), np.array([-1.0, 2.0])

    def at(s):
        return s * tangent + s**2 * bend

    before = point(tangent=tangent)
    stepping = search(before=before, bend=2 * bend, length=0.3)
    np.testing.assert_allclose(guess_of(stepping), at(0.3))
    np.testing.assert_allclose(guess_of(stepping._replace(mode=jnp.asarray(TO_GOAL))), at(0.3))
    for mode in (TO_FOLD, TO_GOAL):
        between = search(before=before, far=at(0.8), high=0.8, length=0.3, mode=mode, bend=[7.0, 7.0])
        np.testing.assert_allclose(guess_of(between), at(0.3))


# --- to the goal ------------------------------------------------------------------------------------------------------


def test_a_goal_that_is_reached_counts_on_the_rising_part_alone():
    goal = {"mode": TO_GOAL, "high": 0.5, "stride": 0.5}

    def after(new, good=True, rise=1.0, **state):
        return chosen(after_goal_trial(search(**goal | state), new, jnp.asarray(rise), jnp.asarray(good)))

    there = point((0.1, 0.2), (0.6, 0.8), 0.0)
    assert int(after(there).mode) == REACHED
    np.testing.assert_array_equal(after(there).before.u, there.u)
    assert int(after(there, good=False).mode) == STEPPING
    assert int(after(point((0.1, 0.2), (0.6, -0.8), 0.0)).mode) == STEPPING
    # A limit point is level but for rounding.
    level = point((0.1, 0.2), (1.0, -0.5 * LEVEL), 0.0)
    assert int(after(level, at_fold=True).mode) == REACHED
    assert int(after(level).mode) == STEPPING
    assert int(after(point((0.1, 0.2), (1.0, -2 * LEVEL), 0.0), at_fold=True).mode) == STEPPING
    # What was known of the path up to there is forgotten, and shorter steps follow.
    again = after(there, good=False, at_fold=True, rose=1, stride=0.4)
    assert (float(again.length), bool(again.at_fold), int(again.rose)) == (pytest.approx(SHORTER * 0.4), False, 0)
    assert int(after(there, good=False, stride=SMALLEST_STEP).mode) == ENDED
    # A goal that was only predicted and is not there: the step that would have been made without it.
    on = after(there, good=False, high=0.0, length=0.1, stride=0.8)
    assert (int(on.mode), float(on.length)) == (STEPPING, pytest.approx(0.8))
    # A goal that falls through zero rose through it before, and a goal at its top is level but for rounding.
    for state in ({"high": 0.0, "stride": 0.8}, {}):
        nearer = after(point((0.06, 0.08), goal=0.0), rise=-0.3, **state)
        assert (int(nearer.mode), float(nearer.length)) == (STEPPING, pytest.approx(SHORTER * 0.1))
        np.testing.assert_array_equal(nearer.before.u, np.zeros(2))
    assert int(after(there, rise=-0.5 * LEVEL).mode) == REACHED


# --- to a limit point -------------------------------------------------------------------------------------------------


def trial(rise, goal=-1.0, good=True, **state):
    now = search(**{"mode": TO_FOLD, "low": 0.0, "high": 0.5, "length": 0.2, "rise_low": 0.8, "rise_high": -0.6,
                    "stride": 0.5} | state)  # fmt: skip
    new = point((0.2, 0.2), (np.sqrt(1 - rise**2), rise), goal)
    return now, new, chosen(after_fold_trial(now, new, jnp.asarray(good)))


def test_the_bracket_of_a_limit_point_closes_from_both_ends():
    _, new, inner = trial(0.4)
    assert [float(v) for v in (inner.low, inner.high, inner.rise_low, inner.rise_high)] == pytest.approx(
        [0.2, 0.5, 0.4, -0.6]
    )
    assert float(inner.length) == pytest.approx(0.2 + 0.3 * 0.4)
    assert int(inner.rose) == 1
    _, new, inner = trial(-0.3)
    assert [float(v) for v in (inner.low, inner.high, inner.rise_low, inner.rise_high)] == pytest.approx(
        [0.0, 0.2, 0.8, -0.3]
    )
    np.testing.assert_array_equal(inner.far, new.u)
    assert float(inner.length) == pytest.approx(0.2 * 0.8 / 1.1)
    # An end that stays twice counts half (Illinois).
    assert float(trial(0.4, rose=1)[2].rise_high) == pytest.approx(-0.3)
    assert float(trial(-0.3, rose=-1)[2].rise_low) == pytest.approx(0.4)
    assert float(trial(0.4, rose=-1)[2].rise_high) == pytest.approx(-0.6)


def test_a_level_point_is_the_limit_point_and_before_it_the_goal_may_lie():
    _, new, end = trial(0.9 * FLAT)
    assert int(end.mode) == FOLD
    np.testing.assert_array_equal(end.before.u, new.u)
    assert int(trial(1.1 * FLAT)[2].mode) == TO_FOLD
    # The goal is passed there by 3 after -1: three quarters are left of a parabola with its top at the limit point.
    now, new, goal = trial(0.0, goal=3.0)
    assert int(goal.mode) == TO_GOAL
    assert goal.at_fold
    np.testing.assert_array_equal(goal.before.u, now.before.u)
    np.testing.assert_array_equal(goal.far, new.u)
    assert float(goal.length) == pytest.approx(0.2 * (1 - np.sqrt(3 / 4)))
    # The goal is the limit point itself; and a first goal that is no less than the far one gives no place outside.
    assert float(trial(0.0, goal=0.0)[2].length) == pytest.approx(0.2)
    far_off, _, aimed = trial(0.0, goal=3.0, before=point(goal=5.0))
    assert 0 <= float(aimed.length) <= float(far_off.length)


def test_a_bracket_that_closes_where_the_tangent_jumps_holds_no_limit_point():
    close = {"low": 0.2 - 1e-13, "high": 0.2 + 1e-13}
    _, _, again = trial(0.4, **close)
    assert (int(again.mode), float(again.length)) == (STEPPING, pytest.approx(SHORTER * 0.5))
    assert int(trial(0.5 * FLAT, **close)[2].mode) == FOLD
    assert int(trial(0.4, good=False)[2].mode) == STEPPING
    assert int(trial(0.0, good=False)[2].mode) == STEPPING


# --- all of it --------------------------------------------------------------------------------------------------------


def test_the_first_case_that_holds_is_chosen():
    states = [search(length=float(k)) for k in range(4)]
    for held, expected in (((False, True, True), 1), ((True, True, False), 0), ((False, False, False), 3)):
        number, state = first_of(*[(jnp.asarray(h), s) for h, s in zip(held, states, strict=False)], (True, states[3]))
        assert (int(number), float(state.length)) == (expected, expected)


def test_a_search_begins_where_it_is_told():
    begun = beginning(jnp.array([0.3, 0.1]), 0.7, careful=True)
    np.testing.assert_array_equal(begun.guess, [0.3, 0.1])
    np.testing.assert_array_equal(begun.before.tangent, [0.0, 1.0])
    assert (float(begun.length), float(begun.before.side), bool(begun.careful)) == (0.7, 0.0, True)
    assert np.isinf(newton_from(begun.guess).last)
    assert LONGER > 1 > SHORTER > 0
