"""The chambers of a finger: published numbers, finite differences, and the limits theta_s -> 0, h_x -> 0, c -> 0."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import softgrip_jax as sg
from softgrip_jax.pneunet.finger import PneuNet
from softgrip_jax.pneunet.tip_contact import TipContact
from softgrip_jax.pneunet.wall.pressures import chamber, contact_pressure, end_moment, pressure_of_moment, wall_limit
from softgrip_jax.pneunet.wall.small_strain import small_strain_end_moment
from softgrip_jax.units import N_mm, kPa, mm

moment = jax.jit(end_moment)
small_strain_moment = jax.jit(small_strain_end_moment)
slopes = jax.jit(jax.grad(end_moment, argnums=(0, 1, 2)))
A = PneuNet.table_5_1("A")


@pytest.mark.parametrize(("kind", "expected"), [("A", 5.93261), ("B", 4.75070), ("C", 5.73751), ("D", 4.72028)])
def test_parallel_walls_match_an_independent_solution(kind, expected):
    # The models of thesis 4.3.3, 4.3.4 solved apart from this code, 31 kPa, N mm.
    solution = chamber(PneuNet.table_5_1(kind), 31 * kPa)
    assert solution.status == sg.Status.OK
    np.testing.assert_allclose(solution.end_moment / N_mm, expected, rtol=2e-6)
    np.testing.assert_allclose(moment(PneuNet.table_5_1(kind), 31 * kPa, 0.0), solution.end_moment, rtol=1e-12)


def test_wall_matches_scipy_written_from_the_equations():
    p, th_s, mu, t, a, b, h, d = 31e3, 0.07, 136e3, 1.1e-3, 5e-3, 8e-3, 5e-3, 0.9e-3
    s, c = np.sin(th_s), np.cos(th_s)
    th_i = brentq(lambda x: 1 / np.sin(x) - c / np.tan(x) - s - d / a, 0.1, 3.0, xtol=1e-15)  # (4.18)
    assert 1 / np.sin(th_i) - c / np.tan(th_i) - s == pytest.approx(d / a)
    rho = a * th_s / th_i

    def stretch(th):
        return c + (d + 2 * a * s) / (2 * (a + rho)) * (th / np.sin(th / 2) ** 2 - 2 / np.tan(th / 2))

    def balance(th):  # (4.30)
        return 1 - stretch(th) ** -6 - p * (d + 2 * a * s) / (4 * mu * t * np.sin(th / 2) ** 2)

    th = brentq(balance, 0.3, 3.1, xtol=1e-15)
    radius = (d + 2 * a * s) / (2 * np.sin(th / 2) ** 2)
    c_2 = (a + rho) * c - (d + 2 * a * s) / np.tan(th / 2)
    c_1 = 2 * a * stretch(th) - radius * (np.arccos(1 - d / radius) + th) - c_2
    force = p * np.pi / 4 * (c_1 + c_2) ** 2 * b * (a - rho) / a**2
    arm = (h / 2 + a - rho) * c
    solution = chamber(A, p, th_s)
    np.testing.assert_allclose(solution.clamp_angle, th, rtol=1e-10)
    np.testing.assert_allclose(solution.force, force, rtol=1e-9)
    np.testing.assert_allclose(solution.lever_arm, arm, rtol=1e-12)
    np.testing.assert_allclose(solution.end_moment, force * arm * np.sqrt(1.8 / 6.0), rtol=1e-9)
    np.testing.assert_allclose(solution.end_moment / N_mm, 2.55724, rtol=2e-6)


def test_contact_of_parallel_walls_begins_where_the_free_wall_reaches_the_plane():
    th = 2 * np.arctan(0.9 / 5)  # (4.18) at theta_s = 0
    expected = 2 * 136e3 * 1.1e-3 / 5e-3 * (np.sin(th) - np.sin(th) ** 7 / th**6)  # (4.16)
    begin = contact_pressure(A)
    np.testing.assert_allclose(begin, expected, rtol=1e-10)
    assert chamber(A, 0.999 * begin).status == sg.Status.NO_CONTACT
    assert moment(A, 0.999 * begin, 0.0) == 0
    assert 0 < moment(A, 1.001 * begin, 0.0) < 1e-5 * N_mm  # the area is quadratic in c
    # Inclined, contact begins later.
    assert contact_pressure(A, 0.1) > begin


def test_model_ends_at_the_half_circle():
    limit = wall_limit(A)
    lam = 1 + 0.9 / 10 * np.pi  # (4.28) at theta_m2 = pi
    np.testing.assert_allclose(limit, 4 * 136e3 * 1.1e-3 * (1 - lam**-6) / 0.9e-3, rtol=1e-12)
    assert np.isfinite(moment(A, 0.999 * limit, 0.0))
    assert np.isnan(moment(A, 1.001 * limit, 0.0))


def test_a_finger_that_bends_until_its_walls_have_closed_has_a_limit():
    """The moment had no slope next to the half circle, so that a stiff finger's limit pressure was NaN."""
    limit = wall_limit(A)
    slope = slopes(A, (1 - 1e-9) * limit, 0.0)[1] * limit
    difference = (moment(A, limit * (1 - 1e-9), 0.0) - moment(A, limit * (1 - 2e-5), 0.0)) / (2e-5 - 1e-9)
    np.testing.assert_allclose(slope, difference, rtol=1e-3)
    # A path may end some rounding beyond the last wall: so did a quarter of them with XLA's own optimisations.
    stiff = sg.pneunet.Free(A, weight=None, inclination="none")
    limits = jax.vmap(lambda H: sg.limit_pressure(dataclasses.replace(stiff, finger=dataclasses.replace(A, H=H))))
    np.testing.assert_allclose(limits(np.linspace(24e-3, 28e-3, 40)), limit, rtol=1e-9)


FIELDS = ["a", "b", "h_x", "t_m", "h_L", "H"]


def by_numbers(x):
    """The end moment (N mm) by the fields of the finger, its shear modulus, the pressure and the inclination."""
    finger = dataclasses.replace(A, **dict(zip(FIELDS, x[:6], strict=True)), material=sg.NeoHookean(x[6]))
    return end_moment(finger, x[7], x[8]) / N_mm


@jax.jit
def derivatives(x):
    """(value, gradient in reverse, gradient forward, second derivatives) of `by_numbers`."""

    def reverse(x):
        both = jax.value_and_grad(by_numbers)(x)
        return both, both

    (forward, second), (value, gradient) = jax.jacfwd(reverse, has_aux=True)(x)
    return value, gradient, forward, second


@pytest.mark.parametrize("inclination", [0.0, 0.05])
def test_derivatives_are_those_of_finite_differences(inclination):
    x = jnp.array([*(getattr(A, name) for name in FIELDS), 136e3, 31e3, inclination])
    size = np.array([*np.asarray(x[:8]), 0.1])
    _, reverse, forward, second = derivatives(x)
    np.testing.assert_allclose(forward, reverse, rtol=1e-10, atol=1e-12)
    for i in range(9):
        if i == 8 and inclination == 0:
            continue  # theta_s < 0 is another formula: one-sided there, see below
        step = np.zeros(9)
        step[i] = 1e-5 * size[i]
        (more, slope_of_more, *_), (less, slope_of_less, *_) = derivatives(x + step), derivatives(x - step)
        np.testing.assert_allclose(forward[i] * size[i], (more - less) / 2e-5, rtol=2e-6, atol=1e-8)
        change = (slope_of_more - slope_of_less) / 2e-5
        np.testing.assert_allclose(second[i] * size[i] * size, change * size, rtol=1e-4, atol=1e-6)


def test_parallel_walls_are_a_regular_limit_of_the_opening_side():
    h = 1e-4
    m0, m1, m2, m3 = (float(moment(A, 31 * kPa, i * h)) for i in range(4))
    # In reverse; `derivatives` has the second one of all numbers, in N mm.
    slope = slopes(A, 31 * kPa, 0.0)[2]
    curve = derivatives(jnp.array([*(getattr(A, name) for name in FIELDS), 136e3, 31e3, 0.0]))[3][8, 8] * N_mm
    np.testing.assert_allclose(slope, (-11 * m0 + 18 * m1 - 9 * m2 + 2 * m3) / (6 * h), rtol=1e-5)
    np.testing.assert_allclose(curve, (2 * m0 - 5 * m1 + 4 * m2 - m3) / h**2, rtol=1e-3)


def test_walls_that_close_are_seen_from_their_other_edge():
    closing, other = chamber(A, 31 * kPa, -0.03), dataclasses.replace(A, h_x=A.h_x - 2 * A.a * np.sin(0.03))
    opening = chamber(other, 31 * kPa, 0.03)
    np.testing.assert_allclose(closing.force, opening.force, rtol=1e-12)
    # The contact is as far above the middle of the wall as it was below.
    np.testing.assert_allclose(closing.lever_arm + opening.lever_arm, 15 * mm * np.cos(0.03), rtol=1e-12)
    np.testing.assert_allclose(moment(A, 31 * kPa, -1e-9), moment(A, 31 * kPa, 0.0), rtol=1e-6)
    assert chamber(A, 31 * kPa, -0.1).status == sg.Status.IMPOSSIBLE
    assert np.isnan(moment(A, 31 * kPa, -0.1))


def test_chambers_without_a_gap():
    @jax.jit
    @jax.value_and_grad
    def force(h_x):
        return chamber(dataclasses.replace(A, h_x=h_x), 31 * kPa).force

    at_rest, slope = force(0.0)
    # h_x = 0, theta_s = 0: p a = 12 mu t (th - sin th) / 2 ... from (4.28), (4.30) to first order in d; lambda = 1,
    # c_1 = c_2 = a, so F_p = pi p a b.
    np.testing.assert_allclose(at_rest, np.pi * 31e3 * 5e-3 * 8e-3, rtol=1e-12)
    np.testing.assert_allclose(slope, (force(2e-8)[0] - at_rest) / 2e-8, rtol=1e-4)
    gapless = dataclasses.replace(A, h_x=0.0)
    assert moment(gapless, 31 * kPa, 0.0) == 0
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(slopes(gapless, 31e3, 0.0)))


@pytest.mark.parametrize("pressure", [0.0, 1 * kPa, 600 * kPa])
@pytest.mark.parametrize("inclination", [0.0, 0.1, -0.1])
def test_lanes_without_contact_pass_zero_gradient(pressure, inclination):
    gradient = slopes(A, pressure, inclination)
    assert all(leaf == 0 for leaf in jax.tree.leaves(gradient))


MATERIALS = [
    sg.MooneyRivlin(c1=60 * kPa, c2=8 * kPa),
    sg.Yeoh(c1=68 * kPa, c2=1 * kPa),
    sg.Gent(mu=136 * kPa, j_m=20.0),
    sg.Ogden(mu=np.array([170e3]), alpha=np.array([1.6])),
]


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: type(m).__name__)
def test_any_strain_energy(material):
    finger = dataclasses.replace(A, material=material)
    solution = chamber(finger, 31 * kPa, 0.05)
    # (4.7): p = 2 T / R with T = t (dw/dlambda)/(2 lambda) of the equal-biaxial energy, by a finite difference.
    lam, th = float(solution.stretch), float(solution.clamp_angle)
    w = [float(material.energy(x, x, x**-2)) for x in (jnp.asarray(lam - 1e-5), jnp.asarray(lam + 1e-5))]
    tension = 1.1e-3 * (w[1] - w[0]) / 2e-5 / (2 * lam)
    radius = (0.9e-3 + 10e-3 * np.sin(0.05)) / (2 * np.sin(th / 2) ** 2)
    np.testing.assert_allclose(2 * tension / radius, 31e3, rtol=1e-8)
    np.testing.assert_allclose(moment(finger, 31 * kPa, 0.05), solution.end_moment, rtol=1e-12)


def test_a_locking_wall_has_no_limit():
    finger = dataclasses.replace(A, material=sg.Gent(mu=136 * kPa, j_m=0.3))
    assert wall_limit(finger) == np.inf
    assert np.isfinite(moment(finger, 2000 * kPa, 0.0))


def test_small_strain_chamber():
    solution = chamber(A, 31 * kPa, model="small")
    # (2.1) with C of a clamped rectangular membrane, 2a x 2b = 10 x 16: between the strip's 16/9 and the square's 3.49.
    delta = float(solution.inflation)
    assert 16 / 9 < 31e3 * 5e-3**4 / (3 * 136e3 * 1.1e-3 * delta**3) < 3.49
    force = 3 * np.pi * 5e-3**2 * delta * 31e3 / (4 * (delta + 0.9e-3))  # (4.5)
    np.testing.assert_allclose(solution.force, force, rtol=1e-12)
    np.testing.assert_allclose(solution.end_moment, force * 7.5e-3 * np.sqrt(0.3), rtol=1e-12)
    np.testing.assert_allclose(small_strain_moment(A, 31 * kPa), solution.end_moment, rtol=1e-12)
    # The simplest model is close to the finite-strain wall here.
    np.testing.assert_allclose(solution.force, chamber(A, 31 * kPa).force, rtol=0.06)
    assert small_strain_moment(A, 10.0) == 0
    with pytest.raises(ValueError, match="cannot incline"):
        chamber(A, 31 * kPa, 0.1, model="small")


def test_nonuniform_finger_is_a_batch_of_chambers():
    finger = dataclasses.replace(A, h_x=jnp.array([0.9, 0.5]) * mm, b=jnp.array([8.0, 9.0]) * mm)
    both = chamber(finger, 31 * kPa)
    for i in range(2):
        alone = chamber(dataclasses.replace(A, h_x=finger.h_x[i], b=finger.b[i]), 31 * kPa)
        np.testing.assert_allclose(both.end_moment[i], alone.end_moment, rtol=1e-12)
    assert finger.segments == 2
    np.testing.assert_allclose(finger.segment_lengths, 77e-3 * np.array([6.0, 5.2]) / 11.2)
    with pytest.raises(ValueError, match="one value per segment"):
        dataclasses.replace(finger, a=jnp.ones(3) * mm)
    with pytest.raises(ValueError, match="must be one of 'A'"):
        PneuNet.table_5_1("E")


moments_of = jax.jit(jax.vmap(end_moment, (None, 0, None)))
moments_pressure = jax.jit(jax.vmap(pressure_of_moment, (None, 0)))


@pytest.mark.parametrize("gap", [0.0, 0.05, 0.9, 5.0])
def test_the_pressure_of_a_moment(gap):
    """The inverse of `end_moment`, from where the walls touch to the end of their model, and more than that beyond."""
    finger = dataclasses.replace(A, h_x=jnp.asarray(gap * mm))
    begin, end = contact_pressure(finger), wall_limit(finger)
    pressures = begin + (end - begin) * jnp.asarray([1e-6, 1e-3, 0.1, 0.5, 0.9, 0.999])
    moments = moments_of(finger, pressures, 0.0)
    inverse = moments_pressure
    if gap == 0:  # a gap without a length has no room for a moment
        assert np.all(moments == 0)
        assert inverse(finger, jnp.ones(1)) == np.inf
        return
    np.testing.assert_allclose(inverse(finger, moments), pressures, rtol=1e-9)
    np.testing.assert_allclose(inverse(finger, jnp.zeros(1)), begin, rtol=1e-12)
    most = moment(finger, end * (1 - 1e-12), 0.0)
    assert np.all(inverse(finger, most * jnp.asarray([1.001, 2.0, 100.0])) > end)


@pytest.mark.parametrize("pressure", [1.0, 20.0, 35.0])
def test_a_beam_driven_by_the_moment_of_its_chambers_is_the_one_driven_by_their_pressure(pressure):
    """What is reported of a scene goes by the moment, as its path does; here the chambers of every part are solved."""
    scene = TipContact(A, weight=jnp.asarray([0.5, -1.0]))
    unknowns = jnp.linspace(0.3, -1.2, scene.points + 1)
    residual, observed = jax.jit(lambda p: scene.evaluated(unknowns, p))(pressure * kPa)
    wanted, seen = jax.jit(lambda p: scene.residual_and_observables(unknowns, jnp.ones_like(p), p))(pressure * kPa)
    np.testing.assert_allclose(residual, wanted, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(observed["end_moment"], seen["end_moment"], rtol=1e-13, atol=1e-20)
    assert (seen["end_moment"] == 0) == (pressure == 1.0)  # before the walls touch
