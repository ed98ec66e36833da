"""The finger's beam equations: against SciPy's shooting, their invariant, their order, and where shooting is hard."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from fingers import TYPE_A, contact, free, pneunet, solved
from scipy.integrate import solve_bvp

import softgrip_jax as sg
from softgrip_jax.pneunet.section.exact import ExactNeoHookean
from softgrip_jax.units import mm

OK = int(sg.Status.OK)
FOLD = {"exact": 6.278, "thesis": 5.342, "inextensible": 6.371}
"""M_T L / EI of the limit point of a tip held at y = 0 without other loads (an independent solution)."""


def bending_stiffness(f):
    """EI = mu B H^3 / 3, N mm^2."""
    return f["mu"] * f["B"] * f["H"] ** 3 / 3


def random_finger(rng):
    """A type A finger with every dimension changed by up to 30 %."""
    return {name: value * rng.uniform(0.7, 1.3) for name, value in TYPE_A.items()}


def random_contacts(law, count):
    """(finger, M_T, offset, pull, weight) at random: up to 9 tenths of the fold of the unloaded finger."""
    rng = np.random.default_rng(7)
    cases = []
    for _ in range(count):
        f = random_finger(rng)
        moment = rng.uniform(0.3, 0.9) * FOLD[law] * bending_stiffness(f) / f["L"]
        offset, pull = rng.uniform(-20, 20), rng.uniform(-0.1, 0.2)
        size, angle = rng.uniform(0, 3e-3), rng.uniform(0, 2 * np.pi)
        cases.append((f, moment, offset, pull, (size * np.cos(angle), size * np.sin(angle))))
    return cases


@pytest.mark.parametrize("law", ["exact", "thesis", "inextensible"])
def test_held_tip_matches_scipy_at_random_fingers(law):
    cases = random_contacts(law, 9)
    pressures = [ref.pressure_of(f, moment) for f, moment, *_ in cases]
    found = solved([contact(f, law, *loads) for f, _, *loads in cases], pressures)
    np.testing.assert_array_equal(found["status"], OK)
    for i, (f, _, *loads) in enumerate(cases):
        _, force, end = ref.held_tip(f, law, [(f["L"], ref.end_moment(f, pressures[i]))], *loads)
        np.testing.assert_allclose(found["tip_force"][i], force, rtol=1e-7)
        np.testing.assert_allclose(found["tip"][i], end[2:], rtol=0, atol=1e-7 * f["L"])
        np.testing.assert_allclose(found["tip_angle"][i], -end[0], rtol=1e-7)


@pytest.mark.slow
def test_strong_tension_in_a_batch_stays_on_the_branch_from_zero_load():
    """A pull of 23 EI/L^2: Newton's method once jumped from here to a loop, turned by 6.7 rad, and called it OK."""
    f, _, *loads = random_contacts("inextensible", 7)[6]
    assert loads[1] * f["L"] ** 2 / bending_stiffness(f) > 20
    pressures = np.linspace(1e-3, 9.4e-3, 16)
    found = solved([contact(f, "inextensible", *loads)] * 16, pressures)
    np.testing.assert_array_equal(found["status"], OK)
    steps = np.diff(found["tip_angle"])
    assert np.all((steps > 0) & (steps < 0.1))


def test_free_finger_under_loads_matches_scipy():
    f = TYPE_A
    cases = [  # weight N/mm, tip load N, clamp angle, pressure MPa
        ((0.0, -2e-3), (0.0, 0.0), 0.0, 0.031),
        ((1e-3, 1e-3), (0.05, -0.03), 0.0, 0.025),
        ((0.0, -2e-3), (0.0, 0.02), 0.7, 0.02),
        ((-1.5e-3, 2e-3), (0.1, 0.02), -1.0, 0.0),
    ]
    found = solved([free(f, "exact", *loads, inclination="none") for *loads, _ in cases], [c[-1] for c in cases])
    np.testing.assert_array_equal(found["status"], OK)
    for i, (weight, tip_load, clamp, p) in enumerate(cases):
        moment = ref.end_moment(f, p) if p > 0 else 0.0
        end = ref.cantilever(f, "exact", [(f["L"], moment)], weight, tip_load, clamp)[-1]
        np.testing.assert_allclose(found["tip"][i], end[2:], rtol=0, atol=1e-7 * f["L"])
        np.testing.assert_allclose(found["tip_angle"][i], clamp - end[0], rtol=1e-7)


@pytest.mark.slow
def test_coupled_free_finger_matches_scipy():
    """13 parts, each inclined by half of its turn over one pitch; the chambers' moments follow from it."""
    f, p, count, weight = TYPE_A, 0.031, 13, (0.0, -2e-3)
    found = solved([free(f, "inextensible", weight)], [p])
    part = f["L"] / count
    share = 0.5 * (2 * f["h_x"] + f["h_L"]) / part
    unit = bending_stiffness(f) / f["L"]

    def shot(y, how):
        parts = [(part, ref.end_moment(f, p, th_s)) for th_s in y[1:]]
        ends = ref.integrate(f, "inextensible", parts, [0.0, y[0] * unit, 0.0, 0.0], ((0.0, 0.0), weight), how)
        turned = -np.diff(np.concatenate([[0.0], ends[:, 0]]))
        return ends, np.concatenate([[ends[-1, 1] / unit], y[1:] - share * turned]), parts

    inclined = np.full(count, 0.05)
    y = ref.solved(lambda y: shot(y, ref.FINE)[1], np.append(5.0, inclined))
    ends, _, parts = shot(y, ref.FINE)
    assert found["status"][0] == OK
    np.testing.assert_allclose(found["tip"][0], ends[-1, 2:], rtol=0, atol=1e-7 * f["L"])
    np.testing.assert_allclose(found["tip_angle"][0], -ends[-1, 0], rtol=1e-7)
    np.testing.assert_allclose(found["inclination"][0], np.mean(y[1:]), rtol=1e-7)
    np.testing.assert_allclose(found["end_moment"][0], parts[-1][1], rtol=1e-7)


def test_vanishing_weight_is_the_closed_form():
    """Arrays of zeros keep the beam equations; without them every part is an arc."""
    arcs = sg.solve(sg.pneunet.Free(pneunet(TYPE_A), weight=(0.0, 0.0), inclination="none"), 31e3)
    found = solved([free(TYPE_A, "exact", inclination="none")], [0.031])
    np.testing.assert_allclose(found["tip"][0] * mm, arcs.tip, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["tip_angle"][0], arcs.tip_angle, rtol=1e-11)
    # Rivlin: M / (mu B) = (z sqrt(1 + z^2) - asinh z) / (2 theta'^2), and a circle of length lambda L.
    z = float(arcs.tip_angle) * 5 / 77
    moment = 0.136 * 20 * (z * np.sqrt(1 + z**2) - np.arcsinh(z)) / 2 * (5 / z) ** 2
    np.testing.assert_allclose(moment, ref.end_moment(TYPE_A, 0.031), rtol=1e-10)
    angle, length = z * 77 / 5, 77 * (1 + z**2) ** 0.25
    expected = [length * np.sin(angle) / angle, -length * (1 - np.cos(angle)) / angle]
    np.testing.assert_allclose(arcs.tip / mm, expected, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("segments", [1, 6])
def test_collocation_meets_diffrax_geometrically(segments):
    """Against adaptive shooting by diffrax from the clamp, with the moment and the force there from the solution."""
    f = TYPE_A if segments == 1 else per_segment(TYPE_A, segments, b=np.linspace(8.0, 9.0, segments))
    errors = []
    for points in (6, 14) if segments == 1 else (36,):
        scene = dataclasses.replace(contact(f, "exact", -3.0, 0.05, (1e-3, -1e-3)), points=points)
        solution = sg.solve(scene, 31e3)
        assert solution.status == OK
        errors.append(float(sg.pneunet.shooting_error(solution)))
    assert errors[-1] < 1e-8
    assert errors[0] < 1e-3
    assert segments > 1 or errors[-1] < 1e-2 * errors[0]


def test_arcs_need_no_shooting():
    arcs = sg.solve(sg.pneunet.Free(pneunet(TYPE_A), weight=(0.0, 0.0), inclination="none"), 31e3)
    with pytest.raises(ValueError, match="not Free"):
        sg.pneunet.shooting_error(arcs)


def test_hamiltonian_of_the_elastica_is_constant():
    """Terminal loads only: the energy w(lambda, theta') - lambda (P cos theta + Q sin theta) does not know X, so

    theta' M + lambda N - w   (M = dw/dtheta', N = dw/dlambda = P cos theta + Q sin theta)   is the same everywhere.
    """
    law = ExactNeoHookean()
    scene = contact(TYPE_A, "exact", -5.0, 0.1)
    solution = sg.solve(scene, 31e3)

    @jax.jit
    def state(unknowns, pressure):
        """(moment, normal force, curvature, stretch, energy) at the points."""
        bent = scene.bent(unknowns, jnp.asarray(1.0), pressure)
        line, loads = bent.line, bent.cover.loads
        m, theta = line.external[0] + bent.active[0], line.theta[0]
        n = loads.p_tip * jnp.cos(theta) + loads.q_tip * jnp.sin(theta)
        z, stretch = jax.vmap(law)(m, n)
        return m, n, z, stretch, jax.vmap(law.energy)(z, stretch)

    m, n, z, stretch, energy = state(solution.unknowns, solution.pressure)
    invariant = z * m + stretch * n - energy
    assert np.ptp(np.asarray(z * m)) > 0.5 * np.abs(invariant[0])  # the sum is constant, what it is made of is not
    assert np.ptp(np.asarray(invariant)) < 1e-9 * np.abs(invariant[0])


@pytest.mark.slow
def test_slender_finger_under_tension_bends_in_thin_layers():
    """P L^2 / EI = 794: a perturbation grows by e^28 along the beam."""
    f, p = TYPE_A | {"L": 300.0}, 0.02
    scene = contact(f, "exact", pull=1.0)
    solution = sg.solve(scene, p * 1e6)
    assert solution.scene.points > scene.points
    assert solution.status == OK
    force, active = f["mu"] * f["B"] * f["H"], ref.end_moment(f, p)

    def rhs(X, y, held):
        theta, moment = y[0], y[1]
        z, stretch = ref.exact_law((moment - active) / (force * f["H"]), (np.cos(theta) + held * np.sin(theta)) / force)
        return np.stack(
            [
                z / f["H"],
                stretch * (np.sin(theta) - held * np.cos(theta)),
                stretch * np.cos(theta),
                stretch * np.sin(theta),
            ]
        )

    def ends(at_clamp, at_tip, held):
        return np.array([at_clamp[0], at_clamp[2], at_clamp[3], at_tip[1], at_tip[3]])

    mesh = 150 * (1 - np.cos(np.linspace(0, np.pi, 400)))
    start = np.stack([0 * mesh, 0 * mesh, mesh, 0 * mesh])
    found = solve_bvp(rhs, ends, mesh, start, p=[0.01], tol=1e-10, max_nodes=100_000)
    assert found.success
    np.testing.assert_allclose(solution.tip_force, found.p[0], rtol=1e-8)
    np.testing.assert_allclose(solution.tip / mm, found.y[2:, -1], rtol=0, atol=1e-8 * f["L"])
    np.testing.assert_allclose(solution.tip_angle, -found.y[0, -1], rtol=1e-7)
    # A batch cannot look at its loads. Too few points do not tell the layers, and that is said; more do, as above.
    few, usual = (solved([dataclasses.replace(scene, points=points)], [p]) for points in (8, scene.points))
    assert few["status"][0] != OK
    np.testing.assert_allclose(usual["tip_force"][0], found.p[0], rtol=1e-6)


def per_segment(f, count, **fields):
    """The finger with arrays of `count` values."""
    return f | {name: np.full(count, f[name]) for name in ("a", "b", "h_x", "t_m", "h_L")} | fields


@pytest.mark.slow
def test_nonuniform_finger_is_a_chain():
    f, p, loads = TYPE_A, 0.031, (-3.0, 0.05, (1e-3, -1e-3))
    denser = per_segment(
        f,
        6,
        h_L=np.linspace(5.5, 3.0, 6),
        h_x=np.linspace(0.9, 0.7, 6),
        b=np.linspace(8.0, 9.0, 6),
        a=np.array([5.0, 5.2, 5.1, 4.9, 5.0, 5.3]),
        t_m=np.array([1.1, 1.2, 1.15, 1.1, 1.0, 1.1]),
    )
    found = solved([contact(per_segment(f, 6), "exact", *loads), contact(denser, "exact", *loads)], [p, p])
    uniform = solved([contact(f, "exact", *loads)], [p])
    np.testing.assert_array_equal(found["status"], OK)
    for name in ("tip_force", "tip", "tip_angle", "end_moment"):
        np.testing.assert_allclose(found[name][0], uniform[name][0], rtol=1e-8)
    moments = [ref.end_moment({k: v[i] if np.ndim(v) else v for k, v in denser.items()}, p) for i in range(6)]
    pitch = 2 * denser["h_x"] + denser["h_L"]
    _, force, end = ref.held_tip(f, "exact", list(zip(f["L"] * pitch / pitch.sum(), moments, strict=True)), *loads)
    np.testing.assert_allclose(found["tip_force"][1], force, rtol=1e-7)
    np.testing.assert_allclose(found["tip"][1], end[2:], rtol=0, atol=1e-7 * f["L"])
    np.testing.assert_allclose(found["tip_angle"][1], -end[0], rtol=1e-7)
    np.testing.assert_allclose(found["end_moment"][1], moments[-1], rtol=1e-9)


def test_the_larger_moment_of_chambers_and_weight_by_hand():
    """(4.40), (4.42): M_T = max(M_p, g x_L^2 / 2) per segment, x_L from its middle to the tip; a chain of arcs."""
    f, p = per_segment(TYPE_A, 4), 0.015
    scene = sg.pneunet.Free(
        pneunet(f), weight=(0.0, -2.0), section="inextensible", inclination="none", combination="larger"
    )
    solution = sg.solve(scene, p * 1e6)
    chambers = ref.end_moment(TYPE_A, p)
    angle, x, y, larger = 0.0, 0.0, 0.0, []
    for i in range(4):
        moment = max(chambers, 2e-3 * (77 * (1 - (i + 0.5) / 4)) ** 2 / 2)
        larger.append(moment > chambers)
        curvature = moment / bending_stiffness(TYPE_A)
        turned = angle + curvature * 77 / 4
        x += (np.sin(turned) - np.sin(angle)) / curvature
        y -= (np.cos(angle) - np.cos(turned)) / curvature
        angle = turned
    assert any(larger)
    assert not all(larger)
    np.testing.assert_allclose(solution.tip / mm, [x, y], rtol=1e-10)
    np.testing.assert_allclose(solution.tip_angle, angle, rtol=1e-10)
