"""Where fingers are hard to solve: random batches, lanes without an answer, first contact, no gap, soft and heavy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from fingers import TYPE_A, contact, free, pneunet, solved, stacked
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax.units import gram, kPa, mm

OK = int(sg.Status.OK)
BEYOND = int(sg.Status.BEYOND_LIMIT)
LANES = 512


def random_contacts(rng):
    """Fingers of every build, offsets of a quarter of their length, weights and pulls that may be too much."""
    cases = []
    for _ in range(LANES):
        f = {name: value * np.exp(rng.uniform(-0.4, 0.4)) for name, value in TYPE_A.items()}
        stiffness = f["mu"] * f["B"] * f["H"] ** 3 / 3
        size, angle = rng.uniform(0, 4) * stiffness / f["L"] ** 3, rng.uniform(0, 2 * np.pi)
        pull = rng.uniform(-4, 6) * stiffness / f["L"] ** 2
        offset = rng.uniform(-0.25, 0.25) * f["L"]
        cases.append(contact(f, "exact", offset, pull, (size * np.cos(angle), size * np.sin(angle))))
    return stacked(cases)


@pytest.mark.slow
def test_random_fingers_are_solved_up_to_their_limits_and_not_beyond():
    """The limit is found by following each path to its fold, a state by following it to a pressure: they must agree."""
    rng = np.random.default_rng(11)
    scenes = random_contacts(rng)
    limits = np.array(jax.jit(lambda s: jax.lax.map(sg.limit_pressure, s, batch_size=64))(scenes))
    exists = np.isfinite(limits)
    assert np.mean(exists) > 0.85  # a few cannot carry what pulls at them at all
    share = np.where(rng.uniform(size=LANES) < 0.2, rng.choice([0.9999, 1.0001], LANES), rng.uniform(0, 1.3, LANES))
    # Two lanes that mean nothing, next to the others.
    share[5], limits[5] = 1.0, np.nan
    pressures = np.where(np.isfinite(limits), share * limits, 20 * kPa)
    pressures[6] = np.inf
    found = jax.jit(lambda *lanes: jax.lax.map(lambda lane: sg.solve(*lane), lanes, batch_size=64))(
        scenes, jnp.asarray(pressures)
    )
    status, known = np.asarray(found.status), np.isfinite(limits) & np.isfinite(pressures)
    np.testing.assert_array_equal(status[known], np.where(share[known] < 1, OK, BEYOND))
    assert status[6] not in (OK, BEYOND)
    assert np.max(np.asarray(found.residual)[status == OK]) <= 1e-12
    assert np.all(np.isnan(np.asarray(found.tip_force)[status != OK]))
    # Lanes without an answer leave their neighbours as they are alone.
    for lane in np.flatnonzero(status == OK)[:4]:
        alone = sg.solve(jax.tree.map(lambda leaf, k=lane: leaf[k], scenes), pressures[lane])
        np.testing.assert_allclose(np.asarray(found.tip_force)[lane], alone.tip_force, rtol=1e-9)


def test_first_contact_begins_smoothly():
    """c -> 0: the end moment rises from zero with the square of the pressure beyond first contact, and so does all."""
    begin = float(sg.contact_pressure(contact(TYPE_A, "exact"))) / 1e6
    excess = np.array([0.0, 1e-9, 1e-6, 1e-4, 1e-2])
    found = solved([contact(TYPE_A, "exact")] * 5, begin * (1 + excess))
    np.testing.assert_array_equal(found["status"], OK)
    moments = [ref.end_moment(TYPE_A, p) for p in begin * (1 + excess)]
    assert abs(found["tip_force"][0]) < 1e-20
    np.testing.assert_allclose(found["end_moment"][2:], moments[2:], rtol=1e-6)
    # A cantilever under a small end moment presses with 3 M / (2 L).
    np.testing.assert_allclose(found["tip_force"][2:4], 1.5 * found["end_moment"][2:4] / 77, rtol=1e-4)


def test_a_gap_that_closes_takes_the_moment_with_it():
    """h_x -> 0: M_T goes with sqrt(h_x), (4.39); derivatives stay finite down to it and are zero there."""
    gaps = np.array([0.0, 1e-12, 1e-6, 1e-3])
    fingers = [contact(TYPE_A | {"h_x": gap}, "exact") for gap in gaps]
    found = solved(fingers, [0.02] * 4)
    np.testing.assert_array_equal(found["status"], OK)
    assert abs(found["tip_force"][0]) < 1e-20
    expected = [ref.end_moment(TYPE_A | {"h_x": gap}, 0.02) for gap in gaps[2:]]
    np.testing.assert_allclose(found["end_moment"][2:], expected, rtol=1e-6)
    np.testing.assert_allclose(found["tip_force"][1] / found["tip_force"][2], 1e-3, rtol=1e-3)


@pytest.mark.slow
def test_soft_and_heavy_finger_hangs_past_vertical():
    """mu 80 kPa under 6 N/m, w L^3 / EI = 41: weight alone turns the tip down."""
    f = TYPE_A | {"mu": 0.08}
    cases = [((0.0, -6e-3), 0.0, 0.0), ((0.0, -6e-3), 1.2, 1e-3), ((0.0, -6e-3), 0.0, 2e-3)]
    scenes = [free(f, "exact", weight, clamp=clamp, inclination="none") for weight, clamp, _ in cases]
    found = solved(scenes, [p for *_, p in cases])
    np.testing.assert_array_equal(found["status"], OK)
    for i, (weight, clamp, p) in enumerate(cases):
        end = ref.cantilever(f, "exact", [(f["L"], ref.end_moment(f, p) if p else 0.0)], weight, clamp=clamp)[-1]
        np.testing.assert_allclose(found["tip"][i], end[2:], rtol=0, atol=1e-7 * f["L"])
        np.testing.assert_allclose(found["tip_angle"][i], clamp - end[0], rtol=1e-7)
    assert found["tip_angle"][0] > np.pi / 3
    assert found["tip_angle"][1] > np.pi / 2


def test_nothing_is_followed_past_eulers_load():
    """Clamped at one end, held and free to turn at the other: a column buckles at 20.19 EI/L^2 (tan x = x)."""
    f = TYPE_A | {"H": 2.0}  # slender: its shortening counts for little
    root = brentq(lambda x: np.tan(x) - x, 4.4, 4.6)
    euler = root**2 * f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"] ** 2
    shares, offsets = np.array([0.9, 0.97, 1.03, 1.5, 3.0, 6.0]), (0.0, 0.01)
    scenes = [contact(f, "exact", offset, -share * euler) for offset in offsets for share in shares]
    found = solved(scenes, [0.0] * len(scenes))
    ok, turned = (found["status"] == OK).reshape(2, -1), np.abs(found["tip_angle"]).reshape(2, -1)
    np.testing.assert_array_equal(ok[0], shares < 1)
    # One that was held a little off its axis may have buckled instead; it is not straight any more.
    assert np.all(ok[1, :3])
    assert np.all(turned[:, 0] < 0.01)
    assert np.all(turned[1, 2:][ok[1, 2:]] > 0.3)


def test_a_thick_cover_outlasts_its_chambers():
    """No fold: the largest pressure is where the walls' model ends (once NaN, for the path stopped right before it)."""
    f = TYPE_A | {"H": 20.0, "L": 30.0}
    limit = float(sg.limit_pressure(contact(f, "exact"))) / 1e6
    np.testing.assert_allclose(limit, ref.wall_limit(f), rtol=1e-9)
    found = solved([contact(f, "exact")] * 3, [0.5 * limit, (1 - 1e-6) * limit, (1 + 1e-6) * limit])
    np.testing.assert_array_equal(found["status"], [OK, OK, BEYOND])


def test_a_correction_that_comes_back_from_far_away_is_no_point_of_the_path():
    """A step of the path wanders here by 4, 2 and 0.7 and comes by its guess: it once counted as found."""
    f = {"a": 4.583, "b": 6.086, "h_x": 0.966, "t_m": 1.195, "h_L": 4.21, "H": 4.153, "B": 16.467, "L": 62.509}
    f, p, loads = f | {"mu": 0.15925}, 0.024407, (-17.991, 0.03206, (0.0002934, 0.0023916))
    found = solved([contact(f, "exact", *loads)], [p])
    np.testing.assert_array_equal(found["status"], OK)
    _, force, end = ref.held_tip(f, "exact", [(f["L"], ref.end_moment(f, p))], *loads)
    np.testing.assert_allclose(found["tip_force"][0], force, rtol=1e-7)
    np.testing.assert_allclose(found["tip"][0], end[2:], rtol=0, atol=1e-7 * f["L"])


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.016, 0.012])
def test_very_heavy_finger_is_a_boundary_layer_at_the_clamp(mu):
    """w L^3 / EI = 205 and 274: the finger hangs down from a bend of 5 mm whose moment is 0.39 and 0.43 mu B H^2; no
    cover can carry 0.5."""
    f, weight = TYPE_A | {"mu": mu}, -6e-3
    found = solved([free(f, "exact", (0.0, weight), inclination="none", points=32)], [0.0])
    assert found["status"][0] == OK
    force = mu * f["B"] * f["H"]

    def rhs(X, y):
        theta, moment = y[0], y[1]
        hanging = weight * (f["L"] - X)
        z, stretch = ref.exact_law(moment / (force * f["H"]), hanging * np.sin(theta) / force)
        return np.stack(
            [z / f["H"], -stretch * hanging * np.cos(theta), stretch * np.cos(theta), stretch * np.sin(theta)]
        )

    def ends(at_clamp, at_tip):
        return np.array([at_clamp[0], at_clamp[2], at_clamp[3], at_tip[1]])

    mesh = f["L"] * np.linspace(0, 1, 300) ** 2
    decay = np.exp(-mesh / 6)
    start = np.stack([-np.pi / 2 * (1 - decay), -0.35 * force * f["H"] * decay, 6 * (1 - decay), -mesh])
    reference = solve_bvp(rhs, ends, mesh, start, tol=1e-9, max_nodes=100_000)
    assert reference.success
    np.testing.assert_allclose(found["tip"][0], reference.y[2:, -1], rtol=0, atol=1e-5 * f["L"])
    np.testing.assert_allclose(found["tip_angle"][0], -reference.y[0, -1], rtol=1e-5)


@pytest.mark.slow
def test_grasps_without_an_answer_leave_their_neighbours_alone():
    held = [(18.0, 26.0, 0.96), (18.0, 5000.0, 0.96), (18.0, 26.0, 1e-4), (90.0, 26.0, 0.96), (18.5, 30.0, 0.8)]

    def grasp(radius, mass, friction):
        gripper = sg.pneunet.Gripper(pneunet(TYPE_A), n=3, base_radius=19.61 * mm)
        thing = sg.objects.Cylinder(radius=radius * mm, mass=mass * gram, friction=friction)
        return sg.pneunet.Grasp(gripper, thing)

    answer = jax.jit(jax.vmap(sg.pressure_for))
    batch = answer(stacked([grasp(*h) for h in held]))
    healthy = answer(stacked([grasp(*held[i]) for i in (0, 4, 0, 4, 0)]))
    status, pressure = np.asarray(batch.status), np.asarray(batch.pressure)
    np.testing.assert_array_equal(status == OK, [True, False, False, False, True])
    np.testing.assert_allclose(pressure[[0, 4]], np.asarray(healthy.pressure)[:2], rtol=1e-9)
    np.testing.assert_allclose(np.asarray(batch.security)[[0, 4]], 1, rtol=1e-9)
    # The widest one is where the fingers stand.
    assert status[3] == int(sg.Status.IMPOSSIBLE)
    assert batch.reason_text()[3] == "the cover is 70.39 mm inside the object at rest"
    assert np.all(np.isnan(np.asarray(batch.tip_force)[[1, 2]]))
