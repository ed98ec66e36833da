"""The limit point of a held finger: its pressure, the curve through it, and no loop on the way there."""

import dataclasses
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fingers import TYPES, MPa, contact, stacked
from reference_beam import end_moment, held_tip, integrate
from scipy.optimize import brentq, minimize_scalar, root

import softgrip_jax as sg
from softgrip_jax.units import N_mm, mm

HELD_TO = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-11}
PUBLISHED = {"inextensible": (6.371, 42.1), "exact": (6.278, 41.7), "thesis": (5.342, 37.4)}
"""M_T L / (mu B H^3 / 3) at the fold of types A and B, and its pressure for type A, kPa."""
SHARES = np.array([0.02, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 0.999, 1 - 1e-6, 1 + 1e-6])
"""Of the limit pressure: the pressures of all checks, so that one program serves them."""
STABLE = SHARES < 0.9995


@jax.jit
def _up_to_the_limit(scenes):
    def one(scene):
        limit = sg.limit_pressure(scene)
        return limit, jax.vmap(lambda share: sg.solve(scene, share * limit))(jnp.asarray(SHARES))

    return jax.vmap(one)(scenes)


def up_to_the_limit(law, cases, lanes=20):
    """(limits in MPa, solutions at SHARES of each) for (type, offset in mm); batches of one size: one program a law."""
    scenes = [contact(TYPES[kind], law, offset=offset) for kind, offset in cases]
    if law == "thesis":  # 16 points leave 1.2e-8 of its limit pressure, 12 leave 9e-7
        scenes = [dataclasses.replace(scene, points=24) for scene in scenes]
    limits, solutions = _up_to_the_limit(stacked(scenes + scenes[:1] * (lanes - len(scenes))))
    solutions = jax.tree.map(lambda leaf: np.asarray(leaf)[: len(cases)], solutions)
    return np.asarray(limits)[: len(cases)] / MPa, solutions


@cache
def largest_moment(law, offset=0.0):
    """(M_T / (EI / L), tip angle) at the fold of type A: the largest end moment over the tip angle, by SciPy."""
    f = TYPES["A"]
    unit = np.array([f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"] ** k for k in (1, 2)])
    state = {"y": np.array([3.5, 3.5]), "angle": 1.0}

    def moment_at(angle):
        """Shooting from the tip, where the angle is known: the clamp and the offset fix M_T and the force."""

        def residual(y):
            # Seen from the tip the finger runs backwards: s -> L - s turns theta by pi and the moment's sign.
            start = [-angle + np.pi, 0.0, 0.0, 0.0]
            parts = [(f["L"], -y[0] * unit[0])]
            end = integrate(f, law, parts, start, ((0.0, -y[1] * unit[1]), (0.0, 0.0)), HELD_TO)[-1]
            return [end[0] - np.pi, (end[3] + offset) / f["L"]]

        found = root(residual, state["y"], method="hybr", options={"xtol": 1e-12})
        assert np.max(np.abs(found.fun)) < 1e-10
        state["y"] = found.x
        return found.x[0]

    for angle in np.linspace(1.0, 2.2, 7):  # along the branch from low load
        moment_at(angle)
    best = minimize_scalar(
        lambda angle: -moment_at(angle), bounds=(1.8, 2.9), method="bounded", options={"xatol": 1e-5}
    )
    return -best.fun, best.x


def fold_pressure(f, moment):
    """The pressure (MPa) at which parallel walls apply a moment in EI / L."""
    wanted = moment * f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"]
    return brentq(lambda p: end_moment(f, p) - wanted, 0.02, 0.1, xtol=1e-15, rtol=1e-14)


@pytest.mark.parametrize(
    "law", ["exact", *(pytest.param(law, marks=pytest.mark.slow) for law in ("thesis", "inextensible"))]
)
def test_limit_pressure_is_where_the_end_moment_is_largest(law):
    limits, solutions = up_to_the_limit(law, [("A", 0.0), ("B", 0.0)])
    moment, angle = largest_moment(law)
    assert moment == pytest.approx(PUBLISHED[law][0], abs=1e-3)
    assert limits[0] * 1e3 == pytest.approx(PUBLISHED[law][1], abs=0.06)
    for kind, limit in zip("AB", limits, strict=True):
        assert limit == pytest.approx(fold_pressure(TYPES[kind], moment), rel=1e-8)
    below, above = solutions.status[:, -2], solutions.status[:, -1]
    assert np.all(below == sg.Status.OK)
    assert np.all(above == sg.Status.BEYOND_LIMIT)
    assert np.all(np.isnan(solutions.tip_force[:, -1]))
    # Next to the fold the angle differs by the square root of the distance: about 1e-3.
    np.testing.assert_allclose(solutions.tip_angle[:, -2], angle, atol=5e-3)


def check_branch_from_zero(cases):
    limits, solutions = up_to_the_limit("exact", cases)
    status = solutions.status
    assert np.all(status[:, :-1] == sg.Status.OK), [c for c, s in zip(cases, status, strict=True) if np.any(s[:-1])]
    assert np.all(status[:, -1] == sg.Status.BEYOND_LIMIT)
    assert np.all(solutions.residual[:, :-1] < 1e-12)
    # Along the stable branch the tip turns further with every rise of the pressure that bends it; a loop, or a jump to
    # another branch, would show as a turn back or as more than the turn at the fold, which is under 3/4 of a circle.
    turned = solutions.tip_angle[:, :-1]
    pushed = solutions.end_moment[:, 1:-1] > 0
    assert np.all(np.diff(turned, axis=1)[pushed] > 0)
    assert np.all(np.diff(turned, axis=1) > -1e-9)
    assert np.all(np.abs(turned) < 1.5 * np.pi)
    return limits, solutions


def same_as_ramped_from_zero(cases, limits, solutions, columns):
    """Each state is where a SciPy ramp of all loads from zero ends."""
    for i, (kind, offset) in enumerate(cases):
        f = TYPES[kind]
        for k in columns:
            moment = end_moment(f, SHARES[k] * limits[i])
            _, force, end = held_tip(f, "exact", [(f["L"], moment)], offset)
            assert solutions.end_moment[i, k] / N_mm == pytest.approx(moment, rel=1e-9)
            assert solutions.tip_force[i, k] == pytest.approx(force, rel=1e-6, abs=1e-9)
            assert solutions.tip_angle[i, k] == pytest.approx(-end[0], rel=1e-6)


@pytest.mark.slow
def test_tip_offsets_up_to_the_limit_stay_on_the_branch_from_zero():
    cases = [(kind, offset) for kind in "AD" for offset in (-20.0, -10.0, 0.0, 10.0, 20.0)]
    limits, solutions = check_branch_from_zero(cases)
    # Negative offsets reach the fold sooner.
    assert np.all(np.diff(limits[:5]) > 0)
    ends = [0, 4]
    same_as_ramped_from_zero([cases[i] for i in ends], limits[ends], jax.tree.map(lambda v: v[ends], solutions), [7])


@pytest.mark.slow
@pytest.mark.parametrize("kind", TYPES)
def test_every_tip_offset_of_every_type_is_the_end_of_a_ramp_from_zero(kind):
    cases = [(kind, offset) for offset in np.arange(-20.0, 21.0, 5.0)]
    same_as_ramped_from_zero(cases, *check_branch_from_zero(cases), columns=[4, 7])


@pytest.mark.slow
def test_branch_shows_the_fold_and_what_is_behind_it():
    cases = [(kind, offset) for kind in TYPES for offset in (-20.0, -10.0, 0.0, 10.0, 20.0)]
    scenes = [dataclasses.replace(contact(TYPES[kind], "exact", offset=offset), points=24) for kind, offset in cases]
    points = jax.tree.map(np.asarray, jax.jit(jax.vmap(lambda scene: sg.branch(scene, 120)))(stacked(scenes)))
    # Of the same scenes: next to a limit 16 points leave 5e-9 of it.
    limits = np.asarray(jax.jit(jax.vmap(sg.limit_pressure))(stacked(scenes))) / MPa
    for i, case in enumerate(cases):
        good = points.status[i] == sg.Status.OK
        pressure, angle, length = points.pressure[i] / MPa, points.tip_angle[i], np.sum(good)
        assert np.all(good[:length]), case  # no gaps
        pressure, angle = pressure[:length], angle[:length]
        assert np.all(points.residual[i][:length] < 1e-12)
        top = np.argmax(pressure)
        # The tip turns on through the fold (much further behind it, past half a circle, the finger curls up instead).
        assert np.all(np.diff(angle[: top + 20]) > -1e-9), case
        assert 20 < top < length - 20, case
        # It is one of the points, and the last one has half of its pressure: nothing is spent behind that.
        assert pressure[top] == pytest.approx(limits[i], rel=1e-9), case
        assert length == 120, case
        assert pressure[-1] == pytest.approx(0.5 * pressure[top], rel=0.1), case
        assert np.all(np.diff(pressure[: top + 1]) > -1e-12), case
        assert np.all(np.diff(pressure[top:])[:20] < 0), case
        # A parabola through the three highest points has the limit as its top, to the fourth order of their distance.
        near = slice(top - 1, top + 2)
        centre = np.polynomial.Polynomial.fit(angle[near], pressure[near], 2)
        peak = centre(centre.deriv().roots()[0])
        assert peak == pytest.approx(limits[i], rel=1e-3), case
        assert np.max(pressure) <= limits[i] * (1 + 1e-9)
    # Independent equations at a point behind the fold: the beam from the reported moment and force ends where it must.
    f, i = TYPES["A"], cases.index(("A", 0.0))
    for k in (int(np.argmax(points.pressure[i])) + 15, 40):
        unit = f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"]
        start = [0.0, points.tip_force[i, k] * points.tip[i, k, 0] / mm, 0.0, 0.0]
        part = [(f["L"], end_moment(f, points.pressure[i, k] / MPa))]
        tip = integrate(f, "exact", part, start, ((0.0, points.tip_force[i, k]), (0.0, 0.0)), HELD_TO)[-1]
        assert abs(tip[1]) < 1e-7 * unit
        assert abs(tip[3]) < 1e-7
        np.testing.assert_allclose(tip[2:], points.tip[i, k] / mm, atol=1e-6)
        assert points.tip_angle[i, k] == pytest.approx(-tip[0], rel=1e-7)
