"""Curves y(x) with limit points, dips and crossings, against polynomials whose roots are known."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from softgrip_jax.numerics.curves import (
    first_crossing,
    first_maximum,
    first_maximum_before,
    samples_with_turns,
    scan_curve,
    slope_of,
)

RANDOM = settings(max_examples=60, deadline=None, derandomize=True)


def curve(powers):
    return lambda x: jnp.polyval(powers[::-1], x)


@partial(jax.jit, static_argnums=2)
def peak_of(powers, end, look):
    scan = scan_curve(curve(powers), jnp.zeros_like(end), end, look)
    return first_maximum(curve(powers), scan, scan.falls), scan


@partial(jax.jit, static_argnums=2)
def peak_before(powers, end, may_dip):
    return first_maximum_before(curve(powers), jnp.zeros_like(end), end, may_dip)


@jax.jit
def crossed(powers, target, end, stop):
    scan = scan_curve(curve(powers), jnp.zeros_like(end), end)
    return first_crossing(curve(powers), target, scan.x, scan.y, stop)


def of_slopes(*roots, scale=1.0):
    """A polynomial through zero that rises at first and turns at the roots; always five coefficients."""
    slope = scale * Polynomial.fromroots(roots) * (-1) ** len(roots)
    whole = slope.integ()
    return np.pad(whole.coef, (0, 5 - len(whole.coef))), whole


@RANDOM
@given(first=st.floats(0.1, 0.9), gap=st.floats(0.06, 0.9), end=st.floats(1.0, 1.5))
def test_the_first_of_two_turns_is_the_maximum(first, gap, end):
    powers, _ = of_slopes(first, first + gap)
    for look in ("cells", "dips"):
        x, scan = peak_of(powers, end, look)
        assert scan.falls
        assert float(x) == pytest.approx(first, abs=1e-9)
        assert scan.x[scan.sure] <= first + end / 48  # at most in the cell of the maximum
    x, falls = peak_before(powers, end, True)
    assert falls
    assert float(x) == pytest.approx(first, abs=1e-9)


def test_a_maximum_and_a_minimum_between_two_samples_of_which_the_first_is_higher():
    """The curve rises again before the second sample: its slope there says nothing of the maximum."""
    powers, whole = of_slopes(24.1 / 48, 24.9 / 48)
    assert whole(25 / 48) < whole(0.5)
    x, scan = peak_of(powers, 1.0, "cells")
    assert scan.falls
    assert float(x) == pytest.approx(24.1 / 48, abs=1e-9)


@RANDOM
@given(place=st.floats(0.1, 0.85), width=st.floats(-3.5, -1.7))
def test_a_dip_that_is_narrower_than_a_cell_is_seen(place, width):
    powers, _ = of_slopes(place, place + 10**width)
    x, scan = peak_of(powers, 1.0, "dips")
    assert scan.falls
    assert float(x) == pytest.approx(place, abs=1e-7 if width > -3 else 1e-5)
    assert not np.any(np.asarray(scan.x)[: int(scan.sure) + 1] > place)


@RANDOM
@given(turn=st.floats(0.02, 0.99))
def test_one_maximum_is_found_from_a_few_samples(turn):
    powers, _ = of_slopes(turn)
    for x, falls in (
        peak_before(powers, 1.0, False),
        (lambda found: (found[0], found[1].falls))(peak_of(powers, 1.0, "single")),
    ):
        assert falls
        assert float(x) == pytest.approx(turn, rel=1e-12)


@pytest.mark.parametrize("look", ["cells", "dips"])
@pytest.mark.parametrize("turn", [0.3 / 48, 1.5 / 48, 47.6 / 48])
def test_a_maximum_in_the_first_or_last_cells(turn, look):
    powers, _ = of_slopes(turn)
    x, scan = peak_of(powers, 1.0, look)
    # The last sample is higher than the one before: that the curve falls at the end, slopes tell.
    assert scan.falls == (turn < 0.9 or look == "dips")
    if scan.falls:
        assert float(x) == pytest.approx(turn, rel=1e-12)
    x, falls = peak_before(powers, 1.0, True)
    assert falls == (turn > 1 / 48)  # a curve is taken to rise over its first cell
    if falls:
        assert float(x) == pytest.approx(turn, rel=1e-12)


def test_a_curve_that_rises_to_its_end_has_no_maximum_there():
    powers, _ = of_slopes(1.3)
    for look in ("cells", "dips", "single"):
        assert not peak_of(powers, 1.0, look)[1].falls
    for may_dip in (True, False):
        x, falls = peak_before(powers, 1.0, may_dip)
        assert not falls
        assert x == 1.0


def test_what_is_not_a_number_ends_a_curve():
    scan = scan_curve(lambda x: jnp.where(x > 0.4, jnp.nan, x), jnp.asarray(0.0), jnp.asarray(1.0))
    assert scan.falls
    assert 0.35 < scan.x[scan.last] <= 0.4


@RANDOM
@given(
    turns=st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), share=st.floats(-0.2, 1.2), stop=st.floats(0.3, 1.0)
)
def test_the_first_crossing_of_a_value(turns, share, stop):
    assume(abs(turns[0] - turns[1]) > 0.1)
    powers, whole = of_slopes(*turns)
    samples = whole(np.linspace(0, stop, 500))
    target = samples.min() + share * np.ptp(samples)
    # Nothing is asked where a curve just touches the value: whether it crosses would be rounding.
    assume(min(abs(whole(np.array([0.0, stop, *turns])) - target)) > 2e-3 * np.ptp(samples))
    roots = (whole - target).roots()
    roots = roots[abs(roots.imag) < 1e-9].real
    roots = roots[(roots > 0) & (roots <= stop)]
    found = crossed(powers, target, 1.0, stop)
    assert bool(found.exists) == (roots.size > 0)
    if roots.size:
        assert float(found.x) == pytest.approx(min(roots), rel=1e-9, abs=1e-12)
        assert found.iterations <= 8
        assert float(found.swing) == pytest.approx(max(min(roots), 1.0) * abs(whole.deriv()(min(roots))), rel=1e-2)
        cell = 1 / 48
        near = np.clip(np.array([min(roots) - cell, min(roots) + cell]), 0, stop)
        fine = whole(np.linspace(*near, 50))
        assert 0 < found.scale <= np.ptp(fine) + 1e-12


def test_slopes():
    assert float(slope_of(lambda x: x**3)(2.0)) == pytest.approx(12.0)


@pytest.mark.parametrize(("target", "exists"), [(0.505, True), (0.51, True), (0.5101, False), (0.6, False)])
def test_a_value_between_the_last_sample_and_the_stop_is_crossed_and_none_behind_it(target, exists):
    """The curve is x, known in 48 cells, and may be followed to 0.51: the last sample before is 1/2."""
    x = jnp.linspace(0.0, 1.0, 49)
    found = first_crossing(lambda x: x, jnp.asarray(target), x, x, jnp.asarray(0.51))
    assert bool(found.exists) == exists
    if exists:
        assert float(found.x) == pytest.approx(target, rel=1e-15)
        assert float(found.scale) == pytest.approx(0.01)  # of this piece of a cell
    else:
        assert found.iterations == 0  # nothing is searched for


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("turn", [0.07, 0.31, 0.66, 0.99])
def test_a_value_that_is_taken_only_around_a_turn_within_a_cell_is_found(turn, sign):
    """The curve is known in three cells, and turns once."""

    def curve(x):
        return sign * (x - turn) ** 2 * (1 + 0.2 * x)

    x, y = samples_with_turns(curve, jnp.linspace(0.0, 1.0, 4))
    assert np.all(np.diff(x) > 0)
    assert np.array_equal(y, curve(x))
    assert float(jnp.min(jnp.abs(x - turn))) < 1e-9  # a cubic is its own
    target = sign * jnp.asarray(1e-6)
    found = first_crossing(curve, target, x, y, jnp.asarray(1.0))
    assert found.exists
    assert float(found.x) == pytest.approx(turn - 1e-3 / np.sqrt(1 + 0.2 * turn), abs=1e-6)


def test_samples_of_a_straight_line_have_their_middles_between():
    x, y = samples_with_turns(lambda x: 2 * x, jnp.linspace(0.0, 1.0, 3))
    assert x.tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert y.tolist() == [0, 0.5, 1, 1.5, 2]


def test_what_a_scan_says_of_a_parabola():
    """Its top is at 0.3, between the samples 14 and 15 of 48, and between 3 and 4 of 12."""
    start, end = 5.0, 7.0  # a curve may count from anywhere
    for look, cells, last in (("cells", 48, 14), ("dips", 48, 14), ("single", 12, 4)):
        scan = scan_curve(lambda x: -(((x - start) / 2 - 0.3) ** 2), jnp.asarray(start), jnp.asarray(end), look)
        np.testing.assert_allclose(scan.x, np.linspace(start, end, cells + 1), rtol=1e-15)
        np.testing.assert_allclose(scan.y, -(((scan.x - start) / 2 - 0.3) ** 2), atol=1e-15)
        assert (int(scan.last), int(scan.sure), bool(scan.falls), scan.single) == (last, last, True, look == "single")
        assert (float(scan.low), float(scan.high)) == (scan.x[last - 1], scan.x[last + 1])
        assert scan.x[last] < scan.clearly_after < scan.x[last] + 0.002 * 2 / cells
    rising = scan_curve(lambda x: x, jnp.asarray(start), jnp.asarray(end))
    assert (int(rising.last), int(rising.sure), bool(rising.falls)) == (48, 48, False)


@pytest.mark.parametrize("look", ["cells", "dips", "single"])
def test_a_curve_may_begin_anywhere(look):
    powers, _ = of_slopes(0.37)
    start = jnp.asarray(-3.0)
    scan = scan_curve(lambda x: curve(powers)(x - start), start, start + 1.0, look)
    x = first_maximum(lambda x: curve(powers)(x - start), scan, scan.falls)
    assert float(x) == pytest.approx(-3 + 0.37, rel=1e-12)
    for may_dip in (True, False):
        x, falls = first_maximum_before(lambda x: curve(powers)(x - start), start, start + 1.0, may_dip)
        assert falls
        assert float(x) == pytest.approx(-3 + 0.37, rel=1e-12)
        x, falls = first_maximum_before(lambda x: curve(powers)(x - start), start, start + 0.3, may_dip)
        assert (float(x), bool(falls)) == (float(start + 0.3), False)


@pytest.mark.parametrize("power", [0, 3])
def test_dips_down_to_the_140th_part_of_a_cell_are_seen_wherever_they_are(power):
    """And what a scan says of them: the rising piece before, a place inside, and the samples that are surely before.

    A curve that begins with the fourth power of x rises least in its first cell, which is no dip.
    """

    places = np.linspace(0.07, 0.93, 300)
    width = 1 / 140 / 48

    @jax.jit
    @jax.vmap
    def scans(place):
        def function(x):
            parts = x**2 / (power + 3), -(2 * place + width) * x / (power + 2), place * (place + width) / (power + 1)
            return x ** (power + 1) * sum(parts)

        return scan_curve(function, jnp.asarray(0.0), jnp.asarray(1.0), "dips")

    scan = scans(places)
    assert np.all(scan.falls)
    assert np.all((scan.high >= places) & (scan.high <= places + width))
    np.testing.assert_array_equal(scan.clearly_after, scan.high)
    cell = np.floor(places * 48)
    assert np.all(scan.low < places)
    assert np.all(scan.low >= (cell - 2) / 48 - 1e-12)
    assert np.all((scan.sure <= cell) & (scan.sure >= cell - 2))


def test_a_slope_that_is_not_a_number_at_the_start_hides_no_dip():
    """x^(3/2) as x sqrt(x) has none at zero, and the dip is in the second cell."""
    powers, _ = of_slopes(1.2 / 48, 1.25 / 48)
    scan = scan_curve(lambda x: curve(powers)(x) + 1e-9 * x * jnp.sqrt(x), jnp.asarray(0.0), jnp.asarray(1.0), "dips")
    assert 1.2 / 48 <= scan.high <= 1.25 / 48


def test_a_curve_with_one_maximum_rises_over_a_thousandth_of_its_length():
    """From there on it is looked for: a maximum just behind is found, and a curve that only falls ends there."""
    powers, _ = of_slopes(1.5e-3)
    x, falls = peak_before(powers, 1.0, False)
    assert falls
    assert float(x) == pytest.approx(1.5e-3, rel=1e-9)
    x, falls = first_maximum_before(lambda x: -x, jnp.asarray(2.0), jnp.asarray(3.0), False)
    assert falls
    assert float(x) == pytest.approx(2 + 1e-3, rel=1e-12)


def test_the_parabola_through_three_samples_is_where_newtons_method_begins():
    """Of a curve that is one it is the maximum itself: one look at its slope tells."""
    looks = []

    def function(x):
        return -((x - 4.5) ** 2)

    def watched(x):
        jax.debug.callback(lambda: looks.append(1))
        return function(x)

    scan = scan_curve(function, jnp.asarray(0.0), jnp.asarray(24.0), "single")
    x = first_maximum(watched, scan, jnp.asarray(True))
    jax.effects_barrier()
    assert x == 4.5
    assert len(looks) == 1


@pytest.mark.parametrize("look", ["cells", "single"])
def test_a_maximum_that_is_not_wanted_is_not_sought(look):
    powers, _ = of_slopes(0.37)
    scan = scan_curve(curve(powers), jnp.asarray(0.0), jnp.asarray(1.0), look)
    assert first_maximum(curve(powers), scan, jnp.asarray(False)) == scan.low < 0.37


def test_no_derivative_passes_through_a_search():
    powers = jnp.asarray(of_slopes(0.37)[0])

    def found(powers, start, end, target):
        scan = scan_curve(curve(powers), start, end)
        maxima = [first_maximum_before(curve(powers), start, end, may_dip)[0] for may_dip in (True, False)]
        crossing = first_crossing(curve(powers), target, scan.x, scan.y, end)
        return sum(maxima) + crossing.x + crossing.swing

    for end in (0.3, 1.0):
        slopes = jax.jit(jax.grad(found, argnums=(0, 1, 2, 3)))(powers, 0.0, end, 0.01)
        assert all(np.all(slope == 0) for slope in slopes)


@pytest.mark.parametrize(("sign", "stop"), [(1, 8.0), (-1, 8.0), (1, 2.75)])
def test_on_a_straight_line_the_crossing_is_known_beforehand(sign, stop):
    """4 x = 10, in cells of one: one look; the curve changes by 4 a cell, and by 10 over as much as x itself."""
    x = jnp.arange(9.0)
    found = first_crossing(lambda x: sign * 4 * x, jnp.asarray(sign * 10.0), x, sign * 4 * x, jnp.asarray(stop))
    assert found.exists
    assert (float(found.x), int(found.iterations)) == (2.5, 1)
    assert float(found.scale) == (4 if stop == 8 else 3)
    assert float(found.swing) == 10
    near = first_crossing(lambda x: 4 * x, jnp.asarray(2.0), x, 4 * x, jnp.asarray(stop))
    assert float(near.swing) == 4
