"""Fingers of several circular arcs: what one part does no other part knows of."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Status
from softgrip_jax.units import kPa, mm

A = sg.PneuNet.table_5_1("A")


def segments(*a, **changed):
    """Type A with a height for every segment, mm."""
    return dataclasses.replace(A, a=jnp.array(a) * mm, **changed)


@pytest.fixture(scope="module")
def short():
    """The same finger written uniformly and as two segments, with walls that incline, and its limit pressure."""
    made = [dataclasses.replace(A, L=30 * mm), segments(5, 5, L=30 * mm)]
    scenes = [sg.pneunet.Free(finger, weight=None) for finger in made]
    return scenes, float(sg.limit_pressure(scenes[0]))


def test_equal_segments_are_a_uniform_finger_up_to_its_limit(short):
    """From 0.95 of it on they had no state."""
    (uniform, listed), limit = short
    pressures = limit * np.array([0.5, 0.95, 1 - 1e-6, 1.001])
    one, two = sg.path(uniform, pressures), sg.path(listed, pressures)
    np.testing.assert_array_equal(one.status, [Status.OK] * 3 + [Status.BEYOND_LIMIT])
    np.testing.assert_array_equal(two.status, one.status)
    np.testing.assert_allclose(two.tip_angle[:3], one.tip_angle[:3], rtol=1e-7)
    assert int(two.reason[3]) == int(one.reason[3]) == Reason.LIMIT_POINT
    np.testing.assert_allclose(two.detail[3], limit, rtol=1e-9)


def test_parts_near_their_limit_are_the_first_roots_of_scipy():
    """M = M_p(theta_s(M)) of each part, the least of two roots close to each other: at 0.997 of the limit."""
    finger, pressure = segments(5, 5.2, L=30 * mm), 109.5 * kPa
    stiffness, length = float(A.material.mu * A.B * A.H**3 / 3), 15 * mm
    expected, seen = 0.0, []
    for a in (5 * mm, 5.2 * mm):
        one = dataclasses.replace(A, a=a)

        def surplus(moment, one=one):
            inclination = 0.5 * float(2 * A.h_x + A.h_L) * moment / stiffness
            return moment - float(sg.pneunet.chamber(one, pressure, inclination=inclination).end_moment)

        grid = np.linspace(0, 0.06, 121)
        found = np.array([surplus(moment) for moment in grid])
        seen.append(int(np.sum(np.diff(np.sign(found[np.isfinite(found)])) != 0)))
        first = int(np.argmax(found > 0))
        expected += brentq(surplus, grid[first - 1], grid[first], xtol=1e-15) * length / stiffness
    state = sg.solve(sg.pneunet.Free(finger, weight=None, section="inextensible"), pressure)
    assert int(state.status) == Status.OK, state.reason_text()
    assert float(state.tip_angle) == pytest.approx(expected, rel=1e-7)
    assert max(seen) == 2


@pytest.mark.slow
def test_the_first_part_to_end_sets_the_limit(short):
    """Its own dimensions alone move it, exactly; of equal parts the limit was NaN."""

    def limit(a):
        return sg.limit_pressure(sg.pneunet.Free(dataclasses.replace(A, L=30 * mm, a=a), weight=None))

    assert float(limit(jnp.array([5.0, 5.0]) * mm)) == pytest.approx(short[1], rel=1e-10)
    a, step = jnp.array([5.0, 5.4]) * mm, 1e-4 * mm
    alone = float(sg.limit_pressure(sg.pneunet.Free(dataclasses.replace(A, L=30 * mm, a=5.4 * mm), weight=None)))
    assert float(limit(a)) == pytest.approx(alone, rel=1e-9)
    assert alone < short[1]
    slopes = jax.grad(limit)(a)
    np.testing.assert_allclose(jax.jacfwd(limit)(a), slopes, rtol=1e-9, atol=1e-6)
    ends = [float(limit(a.at[1].add(side * step))) for side in (1, -1)]
    assert float(slopes[1]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)
    assert abs(float(slopes[0])) < 1e-9 * abs(float(slopes[1]))


@pytest.mark.slow
def test_a_finger_of_segments_that_curls_up_first():
    """Without inclination: the limit is where it has turned twice, which a root over `solve` finds, too."""
    scene = sg.pneunet.Free(segments(5, 6, 5), weight=None, inclination="none")
    found = float(sg.limit_pressure(scene))

    def excess(pressure):
        turned = sg.solve(scene, pressure)
        return (float(turned.tip_angle) if int(turned.status) == Status.OK else 5 * np.pi) - 4 * np.pi

    assert found == pytest.approx(brentq(excess, 10 * kPa, 100 * kPa, xtol=1e-6), rel=1e-9)
    assert sg.solve(scene, found * (1 + 1e-6)).reason_text().startswith("no equilibrium that a finger could have")


@pytest.mark.parametrize("pressure", [15 * kPa, 31 * kPa])
def test_the_larger_moment_where_walls_incline(pressure):
    """M = max(M_p(theta_s(M)), M_g) of every part, by SciPy: where weight ruled any part there was no state."""
    parts, length = 4, float(A.L) / 4
    stiffness = float(A.material.mu * A.B * A.H**3 / 3)
    expected, ruled = 0.0, []
    for k in range(parts):
        weight = 0.5 * 2.0 * (float(A.L) * (1 - (k + 0.5) / parts)) ** 2

        def chambers(moment):
            inclination = 0.5 * float(2 * A.h_x + A.h_L) * moment / stiffness
            return float(sg.pneunet.chamber(A, pressure, inclination=inclination).end_moment)

        ruled.append(chambers(weight) <= weight)
        moment = weight if ruled[-1] else brentq(lambda m: m - chambers(m), weight, chambers(0.0), xtol=1e-14)
        expected += moment * length / stiffness
    scene = sg.pneunet.Free(segments(*[5] * parts), weight=(0.0, -2.0), combination="larger", section="inextensible")
    found = sg.solve(scene, pressure)
    assert int(found.status) == Status.OK
    assert float(found.tip_angle) == pytest.approx(expected, rel=1e-8)
    assert any(ruled)
    assert not all(ruled)


def test_the_larger_moment_knows_no_tip_load():
    """It had no part in the answer."""
    with pytest.raises(InputError, match="leave out tip_load"):
        sg.pneunet.Free(A, combination="larger", tip_load=(0.0, -0.05))


@pytest.mark.slow
def test_the_larger_moment_has_a_limit():
    """It was NaN."""
    scene = sg.pneunet.Free(segments(5, 5), weight=(0.0, -2.0), combination="larger", inclination="none")
    alone = sg.pneunet.Free(segments(5, 5), weight=None, inclination="none")
    assert float(sg.limit_pressure(scene)) == pytest.approx(float(sg.limit_pressure(alone)), rel=1e-9)


def test_a_weight_that_alone_curls_the_finger_up_is_not_held():
    """By (4.42) each half has turned by M L / 2 EI, 20 rad and more. The limit was minus infinity."""
    scene = sg.pneunet.Free(segments(5, 5.2, L=200 * mm), weight=(0.0, -2.0), combination="larger", inclination="none")
    assert np.isnan(float(sg.limit_pressure(scene)))
    found = sg.solve(scene, 20 * kPa)
    assert (int(found.status), int(found.reason)) == (Status.IMPOSSIBLE, Reason.LOAD_NOT_HELD)


def test_no_gap_is_the_limit_of_small_ones_without_the_root():
    """The moment was divided by the root of (4.39), which vanishes with the gap."""
    made = [dataclasses.replace(A, h_x=h) for h in (0.0, 1e-9)]
    angles = [
        float(
            sg.solve(sg.pneunet.Free(finger, weight=None, inclination="none", moment_spread="none"), 5 * kPa).tip_angle
        )
        for finger in made
    ]
    assert angles[0] == pytest.approx(angles[1], rel=1e-4)


@pytest.mark.parametrize("drive", ["small_strain", "thesis"])
def test_derivative_by_a_gap_that_is_none(drive):
    """It was zero, where a gap of ten nanometres had it whole."""
    none = sg.pneunet.Free(A, weight=None, inclination="none", drive=drive, moment_spread="none")
    chamber = jax.tree.map(lambda leaf: leaf[0], none.chambers()[0].chamber)

    def pushed(gap):
        fields = chamber.fields | {"h_x": gap}
        return none.push(chamber._replace(fields=fields), jnp.asarray(8e3), jnp.zeros(()))

    gaps = jnp.array([0.0, 2e-6, 4e-6])
    value, slope = jax.jit(jax.vmap(jax.value_and_grad(pushed)))(gaps)
    one_sided = (4 * value[1] - value[2] - 3 * value[0]) / 4e-6
    assert float(slope[0]) == pytest.approx(float(one_sided), rel=1e-5)


@pytest.mark.parametrize("gap", [0.0, 1e-7])
def test_narrow_chambers_that_incline(gap):
    """Their moment falls steeply as they begin to incline: Newton's method from parallel walls found no first state."""
    finger = dataclasses.replace(A, h_x=gap)
    scene = sg.pneunet.Free(finger, weight=None, moment_spread="none")
    found = sg.solve(scene, 15 * kPa)
    assert found.status == Status.OK
    assert float(found.inclination) == pytest.approx(float(found.tip_angle * finger.pitch / (2 * finger.L)), rel=1e-9)
    if gap:
        wall = sg.pneunet.chamber(finger, 15 * kPa, inclination=found.inclination)
        share = np.sqrt(2 * gap / finger.pitch)
        assert float(found.end_moment) == pytest.approx(float(wall.end_moment / share), rel=1e-9)
    assert float(sg.limit_pressure(scene)) > 15 * kPa
