"""Why a finger has no answer: which load, which limit, what could be held; and that a tip never pulls at an object."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from fingers import TYPE_A, contact, free, pneunet, stacked
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax.reasons import Reason
from softgrip_jax.scene import Found
from softgrip_jax.units import gram, kPa, mm

OK, NO_CONTACT, BEYOND, IMPOSSIBLE = (
    int(sg.Status[name]) for name in ("OK", "NO_CONTACT", "BEYOND_LIMIT", "IMPOSSIBLE")
)
EI = TYPE_A["mu"] * TYPE_A["B"] * TYPE_A["H"] ** 3 / 3  # N mm^2
UNIT = EI / TYPE_A["L"] ** 2  # N
SOLVE = jax.jit(jax.vmap(sg.solve))


def grasp(radius=18.0, mass=26.0, **options):
    gripper = sg.pneunet.Gripper(pneunet(TYPE_A), n=3, base_radius=19.61 * mm, touch="midline")
    thing = sg.objects.Cylinder(radius=radius * mm, mass=mass * gram, friction=0.96)
    return sg.pneunet.Grasp(gripper, thing, **options)


@pytest.mark.slow
def test_a_grasp_never_pulls():
    """Below contact_pressure the force is exactly zero, above it rises; SciPy's beam is free of force there."""
    scene = grasp()
    begin = float(sg.contact_pressure(scene))
    pressures = [0.0, 0.5 * begin, begin * (1 - 1e-6), begin * (1 + 1e-6), 26 * kPa]
    seen = sg.path(scene, pressures)
    np.testing.assert_array_equal(seen.status, [NO_CONTACT] * 3 + [OK] * 2)
    assert np.all(np.asarray(seen.tip_force)[:3] == 0)
    assert np.all(np.diff(np.asarray(seen.tip_force)[2:]) > 0)
    assert all(int(r) == Reason.TIPS_APART for r in seen.reason[:3])
    moment = ref.end_moment(TYPE_A, begin * 1e-6)
    _, force, _ = ref.held_tip(TYPE_A, "exact", [(77.0, moment)], 18 - 19.61, 26e-3 * 9.81 / 3, (2e-3, 0.0))
    assert abs(force) < 1e-6 * UNIT
    # No force is asked for, or one that pulls: no pressure answers that.
    assert int(sg.pressure_for(scene, tip_force=0.0).status) == NO_CONTACT


def test_a_force_that_is_rounding_is_not_told_as_a_pull():
    """`pressure_for` of no force said that the tip would have to be pulled with 3.7e-31 N."""
    scene = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), hold="press")

    def told(force):
        held = Found(jnp.array([force]) / scene.held_unit(), jnp.asarray(2e4), jnp.asarray(OK), jnp.asarray(0))
        apart = scene.tip().verified(scene, held)
        assert int(apart.status) == NO_CONTACT
        return Reason(int(apart.reason)).text(float(apart.detail))

    assert told(-4e-31) == told(0.0) == "the tip does not press, and the force is exactly zero"
    assert "pulled with 0.0003 N" in told(-3e-4)


def limits_of(cases):
    """(status, reason, detail) of cases (offset mm, pull, weight N/mm, pressure MPa) in one batch."""
    # Next to the fold chambers overlap, which is not what is asked here.
    made = [contact(TYPE_A, "exact", *loads) for *loads, _ in cases]
    scenes = stacked([dataclasses.replace(scene, ignored_rules=("chambers_apart",)) for scene in made])
    found = SOLVE(scenes, jnp.array([p * 1e6 for *_, p in cases]))
    return np.asarray(found.status), np.asarray(found.reason), np.asarray(found.detail), found


NONE = (0.0, 0.0)
CASES = {
    "fold": ((0.0, 0.0, NONE, 0.045), BEYOND, Reason.LIMIT_POINT),
    "negative": ((0.0, 0.0, NONE, -0.001), IMPOSSIBLE, Reason.PRESSURE_RULE),
    "buckles": ((0.0, -60 * UNIT, NONE, 0.02), IMPOSSIBLE, Reason.LOAD_NOT_HELD),
    "snaps": ((-19.0, -27 * UNIT, NONE, 0.02), IMPOSSIBLE, Reason.LOAD_NOT_HELD),
    "too heavy": ((0.0, 85.0, NONE, 0.02), IMPOSSIBLE, Reason.COVER_BEARS_PULL),
    "too far": ((80.0, 0.0, NONE, 0.02), IMPOSSIBLE, Reason.TIP_IN_REACH),
    "too far down": ((-300.0, 0.0, NONE, 0.02), IMPOSSIBLE, Reason.TIP_IN_REACH),
}


def test_every_failure_says_why():
    status, reason, detail, _ = limits_of([case for case, *_ in CASES.values()])
    for i, (name, (_, wanted, why)) in enumerate(CASES.items()):
        assert (int(status[i]), Reason(int(reason[i]))) == (wanted, why), name
    detail = dict(zip(CASES, detail, strict=True))
    np.testing.assert_allclose(detail["fold"], float(sg.limit_pressure(contact(TYPE_A, "exact"))), rtol=1e-10)

    # A column that is clamped and held buckles at tan x = x. Shortened by lambda, lambda^3 (lambda - n) = 1, it bends
    # with m = z / (3 lambda^6), and the force has an arm that is shorter by lambda: P lambda^7 = x^2 EI / L^2.
    def shortened(load):
        return brentq(lambda x: x**3 * (x + load * UNIT / 13.6) - 1, 0.5, 1.0, xtol=1e-15)

    euler = brentq(lambda load: load * shortened(load) ** 7 - 4.493409457909064**2, 20.0, 25.0)
    np.testing.assert_allclose(60 * detail["buckles"], euler, rtol=1e-5)
    np.testing.assert_allclose(detail["too far"], -3e-3, rtol=1e-9)
    # lambda - lambda^-3 = n = 85 N / (mu B H)
    stretch = brentq(lambda x: x - x**-3 - 85 / 13.6, 1.0, 10.0, xtol=1e-14)
    np.testing.assert_allclose(detail["too heavy"], (2 - stretch) * 77e-3, rtol=1e-9)


@pytest.mark.slow
def test_the_share_of_a_load_that_can_be_held_is_where_scipy_ends():
    (offset, pull, weight, _), *_ = CASES["snaps"]
    share = limits_of([CASES["snaps"][0]])[2][0]
    assert 0.05 < share < 0.95

    def held(part):
        return ref.held_tip(TYPE_A, "exact", [(77.0, 0.0)], part * offset, part * pull, tuple(part * np.array(weight)))

    held(0.98 * share)
    with pytest.raises(AssertionError):
        held(1.02 * share)


@pytest.mark.slow
def test_far_offsets_are_reached():
    """Nine tenths of the length aside and more (once NOT_CONVERGED, for a rough point was off the path): all loads at
    once, SciPy's beam."""
    cases = [(0.9 * 77, 0.0, NONE, 0.012), (-0.714 * 77, -1.26 * UNIT, NONE, 0.0067), (-0.53 * 77, 0.13, NONE, 0.0073)]
    *_, found = limits_of(cases)
    np.testing.assert_array_equal(found.status, OK)
    for i, (offset, pull, weight, p) in enumerate(cases):
        moment = ref.end_moment(TYPE_A, p)
        _, force, _ = ref.held_tip(TYPE_A, "exact", [(77.0, moment)], offset, pull, weight)
        np.testing.assert_allclose(np.asarray(found.tip_force)[i], force, rtol=1e-5)


@pytest.mark.slow
def test_shooting_does_not_cry_wolf():
    """A heavy free finger, which one shot from the clamp misses by 0.34 of its length, and states that are wrong."""
    solution = sg.solve(sg.pneunet.Free(pneunet(TYPE_A), weight=(0.0, -6.0)), 12 * kPa)
    assert int(solution.status) == OK
    assert float(sg.pneunet.shooting_error(solution)) < 1e-6
    for wrong in (solution.unknowns * (1 + 1e-3), solution.unknowns.at[-5].add(1e-3)):
        assert float(sg.pneunet.shooting_error(dataclasses.replace(solution, unknowns=wrong))) > 1e-4


@pytest.mark.slow
def test_loads_in_proportion_to_the_pressure():
    """A light finger arrives at the same state on either way; a heavy one that stands on its head is held by pressure
    only: its weight alone makes it buckle."""
    light = [contact(TYPE_A, "exact", -3.0, 0.05, (1e-3, -1e-3)), contact(TYPE_A, "exact", 0.0, -60 * UNIT, NONE)]
    together = stacked([dataclasses.replace(scene, loading="proportional") for scene in light])
    first, other = (SOLVE(s, jnp.array([25e3, 25e3])) for s in (stacked(light), together))
    assert int(first.status[0]) == int(other.status[0]) == OK
    np.testing.assert_allclose(other.tip_force[0], first.tip_force[0], rtol=1e-9)
    np.testing.assert_allclose(other.tip[0], first.tip[0], rtol=1e-9)
    assert (int(first.status[1]), int(first.reason[1])) == (IMPOSSIBLE, Reason.LOAD_NOT_HELD)
    assert int(other.reason[1]) != Reason.LOAD_NOT_HELD


@pytest.mark.slow
def test_questions_without_a_pressure_when_loads_grow_with_it():
    """The same limit, the same pressures for a value above and below the moderate pressure where they begin."""
    first = contact(TYPE_A, "exact", -3.0, 0.05, (1e-3, -1e-3))
    together = dataclasses.replace(first, loading="proportional")
    np.testing.assert_allclose(sg.limit_pressure(together), sg.limit_pressure(first), rtol=1e-9)
    for p in (12e3, 36e3):
        force = sg.solve(first, p).tip_force
        found = sg.pressure_for(together, tip_force=force)
        assert int(found.status) == OK
        np.testing.assert_allclose(found.pressure, p, rtol=1e-9)
    assert int(sg.pressure_for(together, tip_force=-5.0).status) == NO_CONTACT


def test_a_tip_that_only_leans_does_not_pull():
    scene = contact(TYPE_A, "exact", -40.0)
    both, press = (sg.solve(dataclasses.replace(scene, hold=hold), 12 * kPa) for hold in ("both", "press"))
    assert (int(both.status), int(press.status)) == (OK, NO_CONTACT)
    assert float(both.tip_force) < 0
    assert float(press.tip_force) == 0
    np.testing.assert_allclose(press.detail, -both.tip_force, rtol=1e-9)
    assert "would have to be pulled" in press.reason_text()


@pytest.mark.slow
def test_free_fingers_say_why():
    arcs = sg.pneunet.Free(pneunet(TYPE_A), weight=(0.0, 0.0), inclination="none")
    closed = sg.solve(arcs, 600 * kPa)
    assert (int(closed.status), int(closed.reason)) == (BEYOND, Reason.WALL_CLOSED)
    np.testing.assert_allclose(float(closed.detail), ref.wall_limit(TYPE_A) * 1e6, rtol=1e-9)
    # Outside of jit a negative pressure is refused at once.
    assert int(jax.jit(sg.solve)(arcs, -1.0).reason) == Reason.PRESSURE_RULE

    def free_heavy():
        return free(TYPE_A, "exact", (0.0, -2e-3), inclination="none")

    beam = stacked([free_heavy()] * 2)
    found = SOLVE(beam, jnp.array([600e3, np.inf]))
    # It has rolled up long before the walls close.
    assert [int(r) for r in found.reason] == [Reason.CURLED_UP, Reason.PRESSURE_RULE]
    np.testing.assert_allclose(float(found.detail[0]), float(sg.limit_pressure(free_heavy())), rtol=1e-9)


def test_a_finger_that_curls_up_says_so_where_loads_and_pressure_grow_together():
    """Its length is 0.6 m: under hardly any weight it ends at 17.63 kPa, however the loads grow."""
    long = sg.PneuNet.table_5_1("A", L=600 * mm)
    scene = sg.pneunet.Free(long, weight=(0.0, -1e-4), inclination="none", loading="proportional", points=6)
    found = jax.jit(lambda pressure: sg.solve(scene, pressure))
    assert found(10 * kPa).status == OK
    beyond = found(31 * kPa)
    assert (beyond.status, beyond.reason) == (BEYOND, Reason.CURLED_UP)
    assert "curled up" in beyond.reason_text()
    assert np.isnan(beyond.detail)  # the pressure on the way belongs to a part of the weight
