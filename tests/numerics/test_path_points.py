"""What makes a point the next one of a path: its turn, its correction, its side, each at its bound."""

import jax.numpy as jnp
import numpy as np
import pytest

from softgrip_jax.numerics.continuation.newton import (
    FINE,
    Local,
    NewtonIteration,
    goes_on,
    has_converged,
    newton_step,
    next_move,
)
from softgrip_jax.numerics.continuation.points import DETOUR, POLISHED_TURN, SLACK, TURN, Point, arrived

TANGENT, ACROSS = np.array([0.6, 0.8]), np.array([0.8, -0.6])


def turned(degrees):
    angle = np.radians(degrees)
    return np.cos(angle) * TANGENT + np.sin(angle) * ACROSS


def arrive(degrees=0.0, correction=0.0, step=1.0, side=1.0, before=1.0, flip=1.0, count=1, tangent=None, **how):
    """A point `step` along the tangent and `correction` across it, where the path has turned by some degrees."""
    place = jnp.array([3.0, -1.0])
    start = Point(place, jnp.asarray(TANGENT), jnp.asarray(-3.0), jnp.asarray(before))
    guess = place + step * TANGENT
    tangent = turned(degrees) if tangent is None else tangent
    local = Local(jnp.asarray(-2.0), flip * jnp.asarray(tangent), jnp.asarray(flip * side), jnp.array([1.0, 2.0]))
    size = jnp.asarray(0.1)
    newton = NewtonIteration(guess + correction * jnp.asarray(ACROSS), size, size, jnp.asarray(count))
    return arrived(newton, local, start, guess, how.pop("within", False), **how)


def trusted(*args, **how):
    return bool(arrive(*args, **how)[2])


def test_a_path_may_turn_so_far_and_no_farther():
    most = np.degrees(np.arccos(TURN))
    assert 20 < most < 30
    for sign in (-1, 1):
        assert trusted(sign * (most - 0.5))
        assert not trusted(sign * (most + 0.5))
        assert trusted(sign * 8, turn=np.cos(np.radians(9)))
        assert not trusted(sign * 10, turn=np.cos(np.radians(9)))
    assert not trusted(90.5)


def test_a_rough_point_that_is_found_better_may_turn_more():
    most = np.degrees(np.arccos(POLISHED_TURN))
    assert 50 < most < 70
    assert trusted(most - 1, polishing=True)
    assert not trusted(most + 1, polishing=True)
    # A caller who allows more has more.
    assert trusted(most + 1, polishing=True, turn=0.1)


def test_a_correction_is_a_part_of_its_step():
    for step in (0.0, 0.1, 2.0):
        most = DETOUR * step + SLACK
        assert trusted(correction=most - 1e-6, step=step)
        assert not trusted(correction=-most - 1e-6, step=step)
        assert trusted(correction=DETOUR * step + 3 * SLACK - 1e-6, step=step, polishing=True)
        assert not trusted(correction=DETOUR * step + 3 * SLACK + 1e-6, step=step, polishing=True)
    # Arcs as far as they may turn keep to it; and SLACK is far less than a step that follows loads.
    angle = np.arccos(TURN)
    assert 1 - np.cos(angle) < DETOUR * angle < 0.15
    assert SLACK <= 0.05


def test_within_a_known_piece_of_the_path_a_correction_may_be_large_but_not_its_turn():
    assert trusted(correction=7.0, within=True)
    assert not trusted(40, correction=7.0, within=True)


def test_the_first_point_may_turn_as_it_likes_but_leads_to_growing_load():
    assert trusted(-30, correction=9.0, first=True)
    assert not trusted(-30, correction=9.0)
    # Towards growing load is the sense that the guessed tangent has; a path that only falls there has none.
    assert not trusted(tangent=np.array([1.0, -0.2]), first=True)
    assert not trusted(tangent=np.array([1.0, np.nan]), first=True)
    assert not trusted(tangent=np.array([np.nan, 1.0]), first=True)


def test_a_null_vector_of_either_sense_is_the_same_tangent():
    for flip in (-1.0, 1.0):
        new, rise, good, *_ = arrive(10, flip=flip)
        np.testing.assert_allclose(new.tangent, turned(10))
        assert float(rise) == pytest.approx(turned(10) @ [1, 2])
        assert (float(new.side), float(new.goal)) == (1.0, -2.0)
        assert good


def test_on_the_other_side_there_is_a_bifurcation_between():
    *_, good, _, crossed = arrive(5, side=-1.0)
    assert (bool(good), bool(crossed)) == (False, True)
    *_, good, _, crossed = arrive(5, side=1.0)
    assert (bool(good), bool(crossed)) == (True, False)
    *_, good, _, crossed = arrive(80, side=-1.0)  # another branch, whatever its side
    assert (bool(good), bool(crossed)) == (False, False)
    for side in (-1.0, 1.0):
        assert trusted(5, side=side, before=0.0)  # not known at the start


def test_what_a_first_correction_leaves_is_itself_times_the_sine_of_the_turn():
    assert float(arrive(20, correction=0.2)[3]) == pytest.approx(0.2 * np.sin(np.radians(20)))
    assert float(arrive(0, correction=0.2)[3]) == pytest.approx(0, abs=1e-8)
    assert np.isinf(arrive(20, correction=0.2, count=2)[3])


# --- Newton's method --------------------------------------------------------------------------------------------------


def moves(before_last, last, count=2, u=1.0):
    return NewtonIteration(jnp.full(2, u), jnp.asarray(before_last), jnp.asarray(last), jnp.asarray(count))


@pytest.mark.parametrize(
    ("before_last", "last", "expected"),
    [
        (1e-2, 1e-3, 1e-5),  # a tenth each, of the square of the ratio
        (1e-3, 1e-2, 1e-2),  # never more than the last
        (np.inf, 0.5, 0.5),  # one move tells nothing
        (1e-1, 1e-7, 1e-16),  # what bends is at least LEAST_BEND, a hundredth
    ],
)
def test_the_next_move_by_the_last_two(before_last, last, expected):
    assert float(next_move(moves(before_last, last))) == pytest.approx(expected)


def test_an_iteration_goes_on_while_its_moves_contract():
    assert goes_on(moves(1.0, 0.69), 8, FINE)
    assert not goes_on(moves(1.0, 0.71), 8, FINE)
    assert not goes_on(moves(1.0, 0.69, count=8), 8, FINE)
    assert not goes_on(moves(1.0, 0.1, u=np.nan), 8, FINE)
    # Near rounding they need not.
    assert goes_on(moves(0.5e-8, 0.9e-8), 8, FINE)
    assert not goes_on(moves(2e-8, 1.9e-8), 8, FINE)
    # Two moves of zero are an end, though their ratio is not a number; so is one small move after a large one.
    assert not goes_on(moves(0.0, 0.0), 8, FINE)
    assert not goes_on(moves(np.inf, 1e-17), 8, FINE)


def test_what_counts_as_converged():
    assert has_converged(moves(np.inf, 1e-17), FINE)
    assert has_converged(moves(0.9e-13, 0.9e-13), FINE)  # rounding, of one size from the first move on
    assert not has_converged(moves(2e-13, 2e-13), FINE)
    assert has_converged(moves(1e-2, 5e-8), FINE)
    assert not has_converged(moves(1e-5, 1e-6), FINE)
    assert not has_converged(moves(np.inf, 1e-6), FINE)
    assert not has_converged(moves(np.inf, np.inf), FINE)


def test_one_step_in_the_plane_across_the_tangent_and_one_to_the_goal():
    """Linear equations: y = 2 p + 1 and y = 100 are solved by one step; its size is relative for large unknowns."""

    def equations(u):
        return (u[0] - 2 * u[1] - 1)[None], u[0] - 100

    start, far = jnp.array([7.0, 4.0]), jnp.asarray(jnp.inf)
    newton = NewtonIteration(start, far, far, jnp.asarray(0))
    across, local = newton_step(equations, jnp.asarray(TANGENT), start, False, newton)
    np.testing.assert_allclose(TANGENT @ (across.u - start), 0, atol=1e-14)
    np.testing.assert_allclose(across.u[0], 2 * across.u[1] + 1)
    np.testing.assert_allclose(np.abs(local.tangent), np.array([2, 1]) / np.sqrt(5))
    # The goal is that of the place where the step leads, not of where it began.
    assert float(local.goal) == pytest.approx(float(across.u[0]) - 100)
    there, _ = newton_step(equations, jnp.asarray(TANGENT), start, True, newton)
    np.testing.assert_allclose(there.u, [100, 49.5])
    assert float(there.last) == pytest.approx(max(93 / 8, 45.5 / 5))
    assert (int(there.count), float(there.before_last)) == (1, np.inf)
    nowhere, _ = newton_step(lambda u: (u[:1] * jnp.nan, u[0]), jnp.asarray(TANGENT), start, False, newton)
    assert np.isinf(nowhere.last)
