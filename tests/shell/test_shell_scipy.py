"""The thesis's own systems of equations, solved by SciPy at random designs, against the package: 1e-9.

Every system is written down as the thesis prints it, with all of its unknowns; nothing is eliminated by hand, and
nothing comes from the package but the values that are compared. The start of each solve is the published thinking:
a scan of the angle for scalar equations, and a crude guess that is then accepted only on the physical branch.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from helpers import FRICTION, ROD, shell
from scipy.integrate import dblquad, quad
from scipy.optimize import brentq, root
from scipy.special import elliprg

import softgrip_jax as sg
from softgrip_jax.membrane import plate_coefficient
from softgrip_jax.units import GRAVITY, kPa, mm

RTOL = 1e-9
DESIGNS = 6


def designs(seed, **extra):
    """Random shells with their neighbourhood, and pressures between contact and the limit, as plain dictionaries."""
    rng = np.random.default_rng(seed)
    for _ in range(DESIGNS):
        a = rng.uniform(5e-3, 30e-3)
        p = {"a": a, "b": a * rng.uniform(1.5, 4), "t_m": a * rng.uniform(0.02, 0.1), "mu": rng.uniform(5e4, 5e5)}
        p["material"] = {"kind": ref.NEO, "mu": p["mu"]}
        yield p | {name: a * rng.uniform(*bounds) for name, bounds in extra.items()}, rng


def made(p):
    return sg.FlatShell(a=p["a"], b=p["b"], t_m=p["t_m"], material=sg.NeoHookean(mu=p["mu"]))


def tension(l1, l2, p):
    """(2.6), (3.2)."""
    l3 = 1 / (l1 * l2)
    return p["mu"] * p["t_m"] * l3 * (l1**2 - l3**2), p["mu"] * p["t_m"] * l3 * (l2**2 - l3**2)


def polished(equations, start):
    """A root of a square system to the last digits: SciPy's hybrid Powell method, started again from its own answer."""
    for _ in range(3):
        found = root(equations, start, method="hybr", options={"xtol": 1e-15})
        start = found.x
    assert np.max(np.abs(found.fun)) < 1e-12, found.message
    return found.x


def between_contact_and_limit(load, p, start, rng, lowest=0.05, highest=0.95):
    """A pressure somewhere on the rising branch, and a rough angle for it, by a scan."""
    angle, pressure, stop = ref.first_rise(load, p, np.array([start]), np.array([np.pi - 1e-9]))
    low, high = np.nan_to_num(pressure[0, 0]), pressure[min(stop[0], len(angle)) - 1, 0]
    wanted = low + rng.uniform(lowest, highest) * (high - low)
    return wanted, angle[np.argmax(pressure[:, 0] >= wanted), 0]


def test_free_space():
    """Algorithm 1: (3.7) with (2.6), (3.1), (3.2), (3.4), (3.5) as five equations."""
    for p, rng in designs(1):
        a, b = p["a"], p["b"]
        pressure, theta = between_contact_and_limit(ref.free, p, 1e-6, rng)

        def equations(y, p=p, a=a, b=b, pressure=pressure):
            theta, radius, l1, l2 = y[0], y[1] * a, y[2], y[3]
            t1, t2 = tension(l1, l2, p)
            return [
                radius / a - 1 / np.sin(theta),
                l1 - theta / np.sin(theta),
                l2 - (1 + a / b * (l1 - 1)),
                (t1 / radius + theta / (radius * theta + b - a) * t2) / pressure - 1,
            ]

        y = polished(equations, [theta, 1 / np.sin(theta), theta / np.sin(theta), 1.05])
        solution = sg.solve(sg.shell.Free(made(p)), pressure)
        assert float(solution.inflation) == pytest.approx(a * np.tan(y[0] / 2), rel=RTOL)
        assert float(solution.length_stretch) == pytest.approx(y[3], rel=RTOL)


def test_flat_contact():
    """Algorithm 2: (3.7) with (3.8), (3.11), then (3.9), (3.10), (3.12), (3.13)."""
    for p, rng in designs(2, distance=(0.1, 1.0)):
        pressure, rough = between_contact_and_limit(ref.flat, p, 2 * np.arctan(p["distance"] / p["a"]), rng)
        theta = brentq(lambda x, p=p, q=pressure: ref.flat(x, p)[0] / q - 1, rough - 0.1, rough + 0.1, xtol=1e-15)
        solution = sg.solve(sg.shell.FlatContact(made(p), distance=p["distance"]), pressure)
        assert float(solution.clamp_angle) == pytest.approx(theta, rel=RTOL)
        assert float(solution.force) == pytest.approx(float(ref.flat_force(theta, p)), rel=RTOL)


def cylinder_system(y, p, pressure):
    """(2.4), (3.15), (3.16), (3.18), (3.27) with (3.14), (3.19)-(3.22), (3.26), (3.30)."""
    a, b, r = p["a"], p["b"], p["radius"]
    d = p["gap"] + r
    th_c, th_ma, big_r, th_m, e = y[0], y[1], y[2] * a, y[3], y[4] * b
    l1, l2 = big_r * th_m / a, (r * th_c + big_r * th_c + e + big_r * th_m) / b
    t1, t2 = tension(l1, l2, p)
    k1, k2 = 1 / big_r, (th_m + th_c) / (big_r * th_c + e + big_r * th_m)
    r_a = (d - r) / (1 - np.cos(th_ma))
    c_a = a - r_a * np.sin(th_ma)
    th_me = 2 * np.arctan(big_r * (np.cos(th_c) - np.cos(th_m)) / a)
    return [
        (k1 * t1 + k2 * t2) / pressure - 1,
        (r * np.sin(th_c) + big_r * np.sin(th_c) + e + big_r * np.sin(th_m)) / b - 1,
        (r * np.cos(th_c) + big_r * np.cos(th_c) - big_r * np.cos(th_m) - d) / a,
        big_r * np.sin(th_m) / a - 1,
        (c_a + r_a * th_ma) / a - th_me / np.sin(th_me),
    ]


def cylinder_guess(theta_m, p):
    """A start for the five unknowns near a given clamp angle."""
    a, b, r, gap = p["a"], p["b"], p["radius"], p["gap"]
    big_r = a / np.sin(theta_m)
    th_c = np.arccos(min(1.0, (gap + r + big_r * np.cos(theta_m)) / (r + big_r)))
    return [th_c + 1e-3, theta_m, big_r / a, theta_m, (b - a - (r + big_r) * np.sin(th_c)) / b]


def test_cylinder_contact():
    """Algorithm 3: five equations in theta_c, theta_ma, R, theta_m, e; then (3.28), (3.29)."""
    for p, rng in designs(3, radius=(0.5, 2.5), gap=(0.1, 0.6)):
        start = 2 * np.arctan(p["gap"] / p["a"])
        pressure, rough = between_contact_and_limit(ref.cylinder, p, start, rng, lowest=0.2)
        y = polished(lambda y, p=p, q=pressure: cylinder_system(y, p, q), cylinder_guess(rough, p))
        th_c, th_ma, e = y[0], y[1], y[4] * p["b"]
        c_a = p["a"] - p["gap"] / np.tan(th_ma / 2)
        assert th_c > 0
        assert e > 0
        assert 0 < c_a < p["a"]
        solution = sg.solve(sg.shell.CylinderContact(made(p), radius=p["radius"], gap=p["gap"]), pressure)
        assert float(solution.contact_angle) == pytest.approx(th_c, rel=RTOL)
        assert float(solution.flat_length) == pytest.approx(e, rel=RTOL)
        assert float(solution.contact_half_width) == pytest.approx(c_a, rel=RTOL)
        force = pressure * np.pi * c_a * p["radius"]
        assert float(solution.force) == pytest.approx(force * th_c, rel=RTOL)
        assert float(solution.force_z) == pytest.approx(force * np.sin(th_c), rel=RTOL)


def test_axial_offset():
    """(3.31)-(3.34) with e_1, e_2 as separate unknowns; kappa_2 of (3.30) with the mean of the two."""
    for p, rng in designs(4, radius=(0.5, 2.0), gap=(0.1, 0.6)):
        a, b, r = p["a"], p["b"], p["radius"]
        d = p["gap"] + r
        p["height"] = height = a + (b - a) * rng.uniform(0.6, 1.3)
        start = 2 * np.arctan(p["gap"] / a)
        pressure, rough = between_contact_and_limit(ref.cylinder, p, start, rng, lowest=0.2, highest=0.9)

        def equations(y, p=p, a=a, b=b, r=r, d=d, height=height, pressure=pressure):
            th_c, big_r, th_m, e_1, e_2 = y[0], y[1] * a, y[2], y[3] * b, y[4] * b
            l1 = big_r * th_m / a
            l2 = (2 * r * th_c + 2 * big_r * th_c + e_1 + 2 * big_r * th_m + e_2) / (2 * b)
            t1, t2 = tension(l1, l2, p)
            k2 = (th_m + th_c) / (big_r * th_c + (e_1 + e_2) / 2 + big_r * th_m)
            reach = r * np.sin(th_c) + big_r * np.sin(th_c) + big_r * np.sin(th_m)
            return [
                (t1 / big_r + k2 * t2) / pressure - 1,
                (2 * b - height - reach - e_1) / b,
                (height - reach - e_2) / b,
                (r * np.cos(th_c) + big_r * np.cos(th_c) - big_r * np.cos(th_m) - d) / a,
                big_r * np.sin(th_m) / a - 1,
            ]

        guess = cylinder_guess(rough, p)
        y = polished(equations, [guess[0], guess[2], guess[3], guess[4], guess[4]])
        scene = sg.shell.AxialOffset(made(p), radius=r, gap=p["gap"], height=height)
        solution = sg.solve(scene, pressure)
        assert float(solution.contact_angle) == pytest.approx(y[0], rel=RTOL)
        assert float(solution.flat_length_far) == pytest.approx(y[3] * b, rel=RTOL)
        assert float(solution.flat_length_near) == pytest.approx(y[4] * b, rel=RTOL)


def test_grasp_needs_no_stepping():
    """Algorithm 4 as one system: e_2 = 0, h and p unknown, F_c = F_ext of (6.2)."""
    for p, rng in designs(5, radius=(0.5, 2.0), gap=(0.1, 0.6)):
        a, r = p["a"], p["radius"]
        start = 2 * np.arctan(p["gap"] / a)
        pressure, rough = between_contact_and_limit(ref.cylinder, p, start, rng, lowest=0.3, highest=0.9)
        friction = rng.uniform(0.5, 1.5)
        guess = [*cylinder_guess(rough, p), 1.0]
        y = polished(lambda y, p=p, q=pressure: cylinder_system(y, p, q), guess[:5])
        force = pressure * np.pi * (a - p["gap"] / np.tan(y[1] / 2)) * r * y[0]
        mass = 2 * friction * force * 0.9 / GRAVITY
        needed = mass * GRAVITY / 2 / friction

        def equations(y, p=p, a=a, r=r, needed=needed, pressure=pressure):
            q = pressure * y[5]
            c_a = a - p["gap"] / np.tan(y[1] / 2)
            return [*cylinder_system(y[:5], p, q), q * np.pi * c_a * r * y[0] / needed - 1]

        y = polished(equations, [*y, 0.97])
        # (3.33) with e_2 = 0.
        height = r * np.sin(y[0]) + y[2] * a * np.sin(y[0]) + y[2] * a * np.sin(y[3])
        scene = sg.shell.Grasp(made(p), radius=r, gap=p["gap"], mass=mass, friction=friction)
        grasp = sg.pressure_for(scene)
        assert float(grasp.pressure) == pytest.approx(pressure * y[5], rel=RTOL)
        assert float(grasp.height) == pytest.approx(height, rel=RTOL)
        assert float(grasp.required_force) == pytest.approx(needed, rel=1e-13)


def law(force):
    """mu_f of a force, N: it carries 14 N at most."""
    return 1.4 / (1 + 0.1 * force)


def test_required_force_with_a_friction_law():
    """mu_f(F) F = m g / 2 (6.2) for a measured table and for a law given as a function."""

    def table(force):
        return np.interp(force, FRICTION.force, FRICTION.coefficient)

    for friction, check in ((FRICTION, table), (law, law)):
        for mass in (0.137, 0.563, 1.1):
            share = mass * GRAVITY / 2
            wanted = brentq(lambda f, check=check, share=share: check(f) * f - share, 1e-6, 100, xtol=1e-14)
            scene = sg.shell.Grasp(shell(), mass=mass, friction=friction, **ROD)
            grasp = sg.pressure_for(scene)
            assert float(grasp.required_force) == pytest.approx(wanted, rel=1e-11)
            assert float(grasp.force) == pytest.approx(wanted, rel=RTOL)


def test_a_weight_that_no_force_can_carry_needs_an_infinite_force():
    """The law carries at most 14 N however hard the shell presses; each of two carries half of 3 kg."""
    scene = sg.shell.Grasp(shell(), mass=3.0, friction=law, **ROD)
    assert np.isinf(float(sg.solve(scene, 15 * kPa).required_force))
    assert sg.Status(int(sg.pressure_for(scene).status)) is sg.Status.BEYOND_LIMIT


@pytest.mark.parametrize(("c_a", "c_b"), [(8e-3, 8e-3), (3e-3, 17e-3), (12e-3, 2e-3)])
def test_tilt_moment_is_the_integral_over_the_ellipse(c_a, c_b):
    """(3.36)-(3.38): the integral of the distance over the ellipse; (3.40): the thesis's, with the arm at the rim."""
    shear = 1.1 * 15e3
    area = dblquad(
        lambda r, phi: r * np.hypot(c_a * r * np.cos(phi), c_b * r * np.sin(phi)) * c_a * c_b,
        0, np.pi / 2, 0, 1, epsabs=1e-20, epsrel=1e-12,
    )[0]  # fmt: skip

    def rim(y):
        x2 = c_a**2 * (1 - y**2 / c_b**2)
        return np.sqrt(x2 + y**2) * np.sqrt(x2)

    # y = c_b sin(phi) takes the square root's end out of the integrand.
    edge = quad(lambda phi: rim(c_b * np.sin(phi)) * c_b * np.cos(phi), 0, np.pi / 2, epsabs=1e-20, epsrel=1e-13)[0]
    args = [np.asarray(v) for v in (c_a, c_b, shear)]
    moment = {lever: float(sg.shell.tilt_moment(*map(jnp.asarray, args), lever)) for lever in ("exact", "rim")}
    assert moment["exact"] == pytest.approx(4 * shear * area, rel=RTOL)
    assert moment["rim"] == pytest.approx(4 * shear * edge, rel=RTOL)
    if c_a == c_b:
        assert moment["exact"] == pytest.approx(2 * np.pi * c_a**3 / 3 * shear, rel=1e-12)
        assert moment["rim"] / moment["exact"] == pytest.approx(1.5, rel=1e-12)


@pytest.mark.parametrize("ratio", [1e-4, 0.01, 0.3, 1 - 1e-9, 1.0, 1 + 1e-5, 7.0, 1e2, 1e4])
def test_tilt_moment_of_any_ellipse(ratio):
    """From needles across to needles along, to 1e-13: Carlson's R_G, and the midpoint rule, which is exact to rounding
    for a periodic function that is sampled finely enough."""
    moment = {lever: float(TILT(np.asarray(1.0), np.asarray(ratio), np.asarray(1.0), lever)) for lever in LEVERS}
    assert moment["exact"] == pytest.approx(4 / 3 * ratio * 2 * elliprg(0, 1, ratio**2), rel=1e-13)
    n = int(200 * max(ratio, 1 / ratio)) + 64
    phi = (np.arange(n) + 0.5) * (np.pi / 2 / n)
    arm = np.hypot(np.cos(phi), ratio * np.sin(phi)) * np.pi / 2 / n
    assert moment["exact"] == pytest.approx(4 / 3 * ratio * arm.sum(), rel=1e-13)
    assert moment["rim"] == pytest.approx(4 * ratio * (arm * np.cos(phi) ** 2).sum(), rel=1e-13)


LEVERS = ("exact", "rim")
TILT = jax.jit(sg.shell.tilt_moment, static_argnames="lever")


@pytest.mark.parametrize("lever", LEVERS)
def test_tilt_moment_can_be_differentiated_twice_at_a_circle(lever):
    """At equal half axes, where k = 0: against differences of fourth order, and Euler's theorem."""

    def resistance(x):
        return sg.shell.tilt_moment(x[0], x[1], jnp.asarray(1.0), lever)

    here, h = jnp.array([1.0, 1.0]), 1e-3
    hessian = jax.jit(jax.hessian(resistance))
    gradient = jax.jit(jax.grad(resistance))
    steps = h * np.eye(2)
    differences = [
        (8 * (gradient(here + e) - gradient(here - e)) - (gradient(here + 2 * e) - gradient(here - 2 * e))) / (12 * h)
        for e in steps
    ]
    np.testing.assert_allclose(hessian(here), np.stack(differences), rtol=1e-10)
    # Homogeneous of degree three: x . H x = 6 T.
    np.testing.assert_allclose(here @ hessian(here) @ here, 6 * resistance(here), rtol=1e-13)
    # A contact without width has no moment, and no NaN.
    assert resistance(jnp.array([0.0, 1.0])) == 0
    assert np.all(np.isfinite(gradient(jnp.array([0.0, 1.0]))))


def test_pressure_that_an_eccentricity_needs():
    """(3.41) with equality, or the lifting force (6.2), whichever needs more."""
    shear_of = {"exact": 0.0, "rim": 0.0}
    for lever in shear_of:
        for eccentricity in (0.1e-3, 5e-3, 10e-3):
            mass, friction = 0.263, 1.3
            scene = sg.shell.Grasp(shell(), mass=mass, friction=friction, eccentricity=eccentricity, lever=lever, **ROD)
            grasp = sg.pressure_for(scene)
            lift = friction * float(grasp.force) / (mass * GRAVITY / 2)
            c_a, c_b = float(grasp.contact_half_width), float(grasp.contact_half_length)
            arm = (
                quad(lambda phi, c_a=c_a, c_b=c_b: np.hypot(c_a * np.cos(phi), c_b * np.sin(phi)), 0, np.pi / 2)[0] / 3
            )
            if lever == "rim":
                arm = quad(
                    lambda phi, c_a=c_a, c_b=c_b: np.hypot(c_a * np.cos(phi), c_b * np.sin(phi)) * np.cos(phi) ** 2,
                    0, np.pi / 2,
                )[0]  # fmt: skip
            resistance = 4 * friction * float(grasp.pressure) * c_a * c_b * arm
            tilt = resistance / (mass * GRAVITY * eccentricity)
            assert min(lift, tilt) == pytest.approx(1, rel=1e-9)
            assert float(grasp.least_security) == pytest.approx(1 / (1 / lift + 1 / tilt), rel=1e-9)
            assert float(grasp.tilt_resistance) == pytest.approx(resistance, rel=1e-9)


def test_one_friction_lifts_and_tilts():
    """Slip about points across the width, friction summed over the ellipse: the load that slips is between the two."""
    scene = sg.shell.Grasp(shell(), mass=0.263, friction=1.3, eccentricity=8 * mm, **ROD)
    grasp = sg.solve(scene, 14 * kPa)
    c_a, c_b, weight = float(grasp.contact_half_width), float(grasp.contact_half_length), 0.263 * GRAVITY
    x, y = (half * side for half, side in zip((c_a, c_b), np.meshgrid(*2 * [np.linspace(-1, 1, 401)]), strict=True))
    inside = (x / c_a) ** 2 + (y / c_b) ** 2 < 1
    x, y = x[inside], y[inside]
    shear = 1.3 * 14 * kPa * np.pi * c_a * c_b / x.size

    def slips(centre):
        r = np.hypot(x - centre, y)
        return shear * np.sum((x - centre) / r), shear * np.sum((x * (x - centre) + y * y) / r)

    def surplus(centre):
        force, moment = slips(centre)
        return moment * weight / 2 + force * weight * 8 * mm  # force points down where the centre is to the right

    centre = brentq(surplus, 1e-9, 100 * c_a)
    both = -slips(centre)[0] / (weight / 2)
    assert 1.1 * float(grasp.least_security) < both < float(grasp.security) / 1.1
    # Without eccentricity they are one, and the slope by it is there, too.
    least = jax.jit(lambda e: sg.solve(dataclasses.replace(scene, eccentricity=e), 14 * kPa).least_security)
    assert float(least(0.0)) == pytest.approx(float(grasp.force) * 1.3 / (weight / 2), rel=1e-12)
    assert float(jax.grad(least)(0.0)) == pytest.approx(float(least(1e-9) - least(0.0)) / 1e-9, rel=1e-4)


def test_inclined_contact():
    """(4.18)-(4.34), (B.1)-(B.3): four unknowns theta_i, theta_m2, R, theta_m1 at once."""
    for p, rng in designs(6, distance=(0.2, 0.9)):
        p["angle"] = s = rng.uniform(0.02, 0.35)
        a, d = p["a"], p["distance"]
        angles = np.linspace(0.2, np.pi, 4001)
        _, (width,) = ref.inclined(angles, p)
        first = angles[np.argmax(width > 0)]
        pressure, rough = between_contact_and_limit(lambda x, q: (ref.inclined(x, q)[0], []), p, first, rng, lowest=0.1)

        def equations(y, p=p, a=a, d=d, s=s, pressure=pressure):
            th_i, th_2, radius, th_1 = y[0], y[1], y[2] * a, y[3]
            rho = a * s / th_i
            c_2 = (a + rho) * np.cos(s) - radius * np.sin(th_2)  # (4.23)
            rho_2 = (radius * th_2 * rho - a * c_2) / (radius * th_2 + c_2)  # (4.22)
            stretch = radius * th_2 / (a + rho_2)  # (4.21)
            return [
                1 / np.sin(th_i) - np.cos(s) / np.tan(th_i) - np.sin(s) - d / a,
                (radius * (1 - np.cos(th_2)) - 2 * a * np.sin(s) - d) / a,
                np.cos(th_1) - 1 + d / radius,
                2 * p["mu"] * p["t_m"] * (1 - stretch**-6) / radius / pressure - 1,
            ]

        big_r = (d + 2 * a * np.sin(s)) / (1 - np.cos(rough))
        start = [float(ref.touch_angle(d / a, s)), rough, big_r / a, np.arccos(1 - d / big_r)]
        th_i, th_2, radius, th_1 = polished(equations, start)
        radius, rho = radius * a, a * s / th_i
        c_2 = (a + rho) * np.cos(s) - radius * np.sin(th_2)
        stretch = (radius * th_2 + c_2) / (a + rho)  # (4.20), (4.21) added up
        c_1 = 2 * a * stretch - radius * (th_1 + th_2) - c_2
        force = pressure * np.pi / 4 * (c_1 + c_2) ** 2 * (a - rho) / a
        square = sg.FlatShell(a=a, b=a, t_m=p["t_m"], material=sg.NeoHookean(mu=p["mu"]))
        solution = sg.solve(sg.shell.InclinedContact(square, distance=d, angle=s), pressure)
        assert float(solution.clamp_angle) == pytest.approx(th_2, rel=RTOL)
        assert float(solution.stretch) == pytest.approx(stretch, rel=RTOL)
        assert float(solution.force) == pytest.approx(force, rel=1e-8)  # a product of differences


def foeppl_coefficient(ratio, n=48):
    """C of (2.1) by finite differences: a clamped Foeppl membrane of half sides 1 and 1/ratio, E t = 1, nu = 1/2.

    A quarter on n by n staggered cells, energy minimised by Newton; the energy is a sum over cells of a plane-stress
    energy of Green's strains, so this shares nothing with the fit. Second order: extrapolated by the caller.
    """
    import scipy.sparse as sp
    from scipy.sparse.linalg import spsolve

    hx, hy = 1 / n, 1 / ratio / n
    size = (n + 1) ** 2

    # Bilinear cells with 2 x 2 Gauss points; symmetry u = 0 at x = 0, v = 0 at y = 0; clamped at the far sides.
    gauss = np.array([-1, 1]) / np.sqrt(3)
    cells = np.array([[i * (n + 1) + j for i in range(n) for j in range(n)]]).T
    corner = cells + np.array([[0, 1, n + 2, n + 1]])  # (i,j), (i,j+1), (i+1,j+1), (i+1,j)
    dx, dy, mean = [], [], []
    rows = np.repeat(np.arange(n * n), 4)
    for s in gauss:
        for t in gauss:
            shape = np.array([(1 - s) * (1 - t), (1 - s) * (1 + t), (1 + s) * (1 + t), (1 + s) * (1 - t)]) / 4
            by_s = np.array([-(1 - t), -(1 + t), 1 + t, 1 - t]) / 4 * 2 / hx
            by_t = np.array([-(1 - s), 1 - s, 1 + s, -(1 + s)]) / 4 * 2 / hy
            for store, weights in ((mean, shape), (dx, by_s), (dy, by_t)):
                store.append(sp.csr_matrix((np.tile(weights, n * n), (rows, corner.ravel())), (n * n, size)))
    dx, dy, mean = (sp.vstack(m).tocsr() for m in (dx, dy, mean))
    weight = np.full(4 * n * n, hx * hy / 4)
    grid = np.arange(size).reshape(n + 1, n + 1)
    inside = grid[:-1, :-1].ravel()
    free = np.concatenate([inside, size + grid[1:-1, :-1].ravel(), 2 * size + grid[:-1, 1:-1].ravel()])
    load = np.concatenate([mean.T @ weight, np.zeros(2 * size)])
    nu, stiff = 0.5, 1 / (1 - 0.25)
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    z = np.concatenate([0.7 * ((1 - x**2) * (1 - y**2)).ravel(), np.zeros(2 * size)])
    zero = sp.csr_matrix(dx.shape)
    for _ in range(60):
        w, u, v = np.split(z, 3)
        wx, wy = dx @ w, dy @ w
        e1, e2, shear = dx @ u + wx**2 / 2, dy @ v + wy**2 / 2, dy @ u + dx @ v + wx * wy
        n1, n2, n12 = stiff * (e1 + nu * e2), stiff * (e2 + nu * e1), stiff * (1 - nu) / 2 * shear
        b1 = sp.hstack([sp.diags(wx) @ dx, dx, zero]).tocsr()
        b2 = sp.hstack([sp.diags(wy) @ dy, zero, dy]).tocsr()
        b3 = sp.hstack([sp.diags(wx) @ dy + sp.diags(wy) @ dx, dy, dx]).tocsr()
        out = b1.T @ (n1 * weight) + b2.T @ (n2 * weight) + b3.T @ (n12 * weight) - load
        d = sp.diags(stiff * weight)
        k = b1.T @ d @ b1 + b2.T @ d @ b2 + nu * (b1.T @ d @ b2 + b2.T @ d @ b1) + (1 - nu) / 2 * b3.T @ d @ b3
        g = dx.T @ sp.diags(n1 * weight) @ dx + dy.T @ sp.diags(n2 * weight) @ dy
        cross = dx.T @ sp.diags(n12 * weight) @ dy
        k = k + sp.block_diag([g + cross + cross.T, sp.csr_matrix((2 * size, 2 * size))])
        move = np.zeros_like(z)
        move[free] = spsolve(k.tocsr()[free][:, free].tocsc(), -out[free])
        z = z + move
        if np.max(np.abs(move)) < 1e-11:
            break
    assert np.max(np.abs(out[free])) < 1e-9
    return 1 / z[0] ** 3


@pytest.mark.parametrize("ratio", [1.0, 0.6, 0.35])
def test_plate_coefficient_against_finite_elements_of_the_membrane(ratio):
    coarse, fine = foeppl_coefficient(ratio, 16), foeppl_coefficient(ratio, 32)
    extrapolated = fine + (fine - coarse) / 3
    assert float(plate_coefficient(jnp.asarray(ratio))) == pytest.approx(extrapolated, rel=2.5e-3)


def test_plate_coefficient_of_a_strip():
    """An infinite strip: p = (4/3) E t / (1 - nu^2) delta^3 / a^4 exactly (a parabola under constant tension)."""
    assert float(plate_coefficient(jnp.asarray(0.0))) == pytest.approx(4 / 3 / 0.75, rel=1e-15)


def test_plate_scene_is_the_law():
    scene = sg.shell.Plate(shell())
    delta = float(sg.solve(scene, 1 * kPa).inflation)
    coefficient = float(plate_coefficient(jnp.asarray(16 / 43)))
    assert coefficient * 3 * 175e3 * 1.1 * mm * delta**3 / (16 * mm) ** 4 == pytest.approx(1e3, rel=1e-12)
