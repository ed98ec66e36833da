"""Contact of the shell on the branch from zero load; limits, widths and inverses where they used to be wrong."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from helpers import ROD, STENCIL, WEIGHTS, shell
from scipy.optimize import minimize_scalar

import softgrip_jax as sg
from softgrip_jax.membrane import contact_half_width
from softgrip_jax.objects.friction import FrictionTable
from softgrip_jax.solvers.explicit_curve import sampled, stop_of
from softgrip_jax.units import GRAVITY, kPa, mm

OK, NO_CONTACT, BEYOND = sg.Status.OK, sg.Status.NO_CONTACT, sg.Status.BEYOND_LIMIT


def status_at(scene, pressure):
    return sg.Status(int(sg.solve(scene, pressure).status))


H = 1e-3
"""Relative step of differences."""


def around(x):
    """The points of sixth-order differences, and last the one in their middle."""
    return x * (1 + np.append(STENCIL, 0.0) * H)


GENT = sg.Gent(mu=175 * kPa, j_m=50.0)
LOCKING_LATE = {
    "cylinder": (
        lambda made, reach: sg.shell.CylinderContact(sg.FlatShell(made.a, reach, made.t_m, made.material), **ROD),
        43 * mm,
    ),
    "offset": (lambda made, reach: sg.shell.AxialOffset(made, height=reach, **ROD), 38 * mm),
}


@pytest.mark.parametrize("kind", LOCKING_LATE)
def test_a_limit_that_a_locking_material_does_not_set_keeps_its_slope(kind):
    """The membrane is used up before Gent locks: the end moves with the length that is there."""
    make, reach = LOCKING_LATE[kind]
    made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=GENT)

    def limit(reach):
        return sg.limit_pressure(make(made, reach))

    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(limit)))(around(reach))
    wanted = float(np.dot(WEIGHTS, values[:-1]) / (H * reach))
    assert wanted > 1e5
    assert float(slopes[-1]) == pytest.approx(wanted, rel=1e-8)


THIN = {"a": 16e-3, "b": 43e-3, "t_m": 1.1e-3, "material": {"kind": ref.NEO, "mu": 175e3}}
SQUARE = THIN | {"b": 16e-3}


def free_limit(numbers, square=False):
    """Pa: the first maximum of free inflation, by SciPy."""

    def load(angle):
        if not square:
            return ref.free(angle, numbers)[0]
        stretch = angle / np.sin(angle)
        tension, _ = ref.tensions(numbers["material"], numbers["t_m"], stretch, stretch)
        return 2 * tension * np.sin(angle) / numbers["a"]

    return -minimize_scalar(lambda x: -load(x), bounds=(0.5, 2.5), method="bounded", options={"xatol": 1e-12}).fun


ARCS = {
    "free": lambda made, k: sg.shell.Free(made),
    "plate": lambda made, k: sg.shell.Plate(made),
    "square": lambda made, k: sg.shell.Free(sg.FlatShell(made.a, made.a, made.t_m, made.material)),
    "plane": lambda made, k: sg.shell.FlatContact(made, distance=k * made.a),
    "inclined": lambda made, k: sg.shell.InclinedContact(made, distance=k * made.a, angle=0.4 * k),
    "cylinder": lambda made, k: sg.shell.CylinderContact(made, radius=3 * k * made.a, gap=0.5 * k * made.a),
    "offset": lambda made, k: sg.shell.AxialOffset(made, 3 * k * made.a, 0.5 * k * made.a, height=0.9 * made.b),
    "grasp": lambda made, k: sg.shell.Grasp(
        made, 3 * k * made.a, 0.5 * k * made.a, mass=0.3, friction=0.9, eccentricity=0.1 * made.a, lever="rim"
    ),
}


@pytest.mark.parametrize("kind", ARCS)
def test_what_is_observed_of_arcs_rises_or_falls_along_the_whole_curve(kind):
    """Between samples that lie apart no value of a shell's is missed; those of scenes that may turn are looked for."""

    @jax.jit
    def seen(numbers):
        a, longer, thickness, near = numbers
        scene = ARCS[kind](sg.FlatShell(a, a * longer, thickness, sg.NeoHookean(mu=175 * kPa)), near)
        found = sampled(scene)
        first, last = found.scan.x[0], stop_of(scene, found)
        angles = first + (last - first) * jnp.linspace(0.0, 1.0, 301)
        return found.possible & found.touches, jax.vmap(lambda x: scene.observe(x, scene.load(x)))(angles)

    random, looked = np.random.default_rng(1), 0
    assert not any(ARCS[kind](shell(), 0.3).may_turn(name) for name in ARCS[kind](shell(), 0.3).OBSERVABLES)
    for _ in range(12):
        there, observed = seen(random.uniform([6 * mm, 1.1, 0.6 * mm, 0.1], [25 * mm, 4, 2.5 * mm, 0.9]))
        looked += bool(there)
        for name, values in observed.items() if there else []:
            steps = np.diff(values)
            assert np.all(np.isfinite(steps)), name
            assert not (np.any(steps > 1e-12) and np.any(steps < -1e-12)), name
    assert looked > 4


def test_the_security_of_a_friction_that_falls_is_found_where_it_is_largest():
    """mu F = F (1 - F / 6 N) is largest at 3 N, between two samples."""
    law = FrictionTable(force=[0.06, 5.94, 60.0], coefficient=[0.99, 0.01, 0.01])
    held = sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, mass=0.3, friction=law)
    largest = 3.0 * (1 - 3.0 / 6.0) / (0.3 * GRAVITY / 2)
    found = sg.pressure_for(held, security=0.9999 * largest)
    assert found.status == OK
    assert float(found.force) == pytest.approx(2.97, rel=1e-6)


FAR = {
    "plane": (lambda made: sg.shell.FlatContact(made, distance=30 * mm), THIN),
    "cylinder": (lambda made: sg.shell.CylinderContact(made, radius=20 * mm, gap=30 * mm), THIN),
    "inclined": (lambda made: sg.shell.InclinedContact(made, distance=30 * mm, angle=0.1), SQUARE),
}


@pytest.mark.parametrize("kind", FAR)
def test_what_is_touched_only_beyond_the_free_limit_is_never_touched(kind):
    """The free membrane stands below its limit at every pressure up to it, and touches nothing there."""
    make, numbers = FAR[kind]
    scene = make(shell(b=numbers["b"]))
    wanted = free_limit(numbers, numbers is SQUARE)
    assert float(sg.limit_pressure(scene)) == pytest.approx(wanted, rel=1e-12)
    assert float(sg.contact_pressure(scene)) == pytest.approx(wanted, rel=1e-12)
    for below in (0.3, 0.93, 0.99, 1 - 1e-6):
        assert status_at(scene, below * wanted) is NO_CONTACT
    beyond = sg.solve(scene, wanted * (1 + 1e-6))
    assert sg.Status(int(beyond.status)) is BEYOND
    assert sg.Reason(int(beyond.reason)) is sg.Reason.LIMIT_BEFORE_CONTACT
    assert float(beyond.detail) == pytest.approx(wanted, rel=1e-12)
    pressed = sg.pressure_for(scene, force=0.5)
    assert sg.Status(int(pressed.status)) is BEYOND


@pytest.mark.parametrize("question", [sg.limit_pressure, sg.contact_pressure])
def test_the_limit_before_contact_has_derivatives(question):
    def asked(t_m):
        return question(sg.shell.FlatContact(shell(t_m=t_m), distance=30 * mm))

    # The free limit is in proportion to the thickness.
    assert float(jax.grad(asked)(1.1 * mm)) == pytest.approx(free_limit(THIN) / (1.1 * mm), rel=1e-10)


def test_thesis_shell_and_a_plane_at_30_mm():
    """At 19.98 kPa the free membrane stands at 22.0 mm: nothing is touched."""
    solution = sg.solve(sg.shell.FlatContact(shell(), distance=30 * mm), 19.98 * kPa)
    assert sg.Status(int(solution.status)) is NO_CONTACT
    assert float(solution.force) == 0
    free = sg.solve(sg.shell.Free(shell()), 19.98 * kPa)
    assert float(free.inflation) == pytest.approx(22.0 * mm, abs=0.05 * mm)


def test_a_softening_mooney_shell_has_a_positive_limit():
    made = sg.FlatShell(a=8 * mm, b=10.4 * mm, t_m=0.6 * mm, material=sg.MooneyRivlin(c1=6e5, c2=-1.74e5))
    limit = float(sg.limit_pressure(sg.shell.FlatContact(made, distance=12 * mm)))
    numbers = {"a": 8e-3, "b": 10.4e-3, "t_m": 0.6e-3, "material": {"kind": ref.MOONEY, "c1": 6e5, "c2": -1.74e5}}
    assert limit == pytest.approx(free_limit(numbers), rel=1e-10)


def test_a_material_that_locks_before_it_touches_holds_any_pressure():
    made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.Gent(mu=175 * kPa, j_m=0.5))
    scene = sg.shell.FlatContact(made, distance=20 * mm)
    assert np.isinf(float(sg.limit_pressure(scene)))
    assert np.isinf(float(sg.contact_pressure(scene)))
    assert status_at(scene, 1000 * kPa) is NO_CONTACT


def longdouble_half_width(gap, sunk):
    """c_a / a from (3.11), (3.22) as they are written, by bisection with 64-bit mantissas."""
    gap, sunk = np.longdouble(gap), np.longdouble(sunk)
    height = gap + sunk
    wanted = (np.arctan(height) * (height + 1 / height) - 1) / gap
    low, high = np.arctan(gap), np.arctan(np.longdouble(1)) * 2
    for _ in range(80):
        half = (low + high) / 2
        if half / np.sin(half) ** 2 - np.cos(half) / np.sin(half) > wanted:
            high = half
        else:
            low = half
    return 1 - gap * np.cos(low) / np.sin(low)


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="no extended precision on this machine")
def test_a_narrow_contact_loses_no_digits():
    for gap in (0.02, 0.1, 0.5, 1.5):
        for sunk in (1e-5, 1e-3, 0.02):
            wanted = longdouble_half_width(gap, sunk)
            if wanted < 1:
                # What the reference itself loses: its rounding over the width, once more for F at small angles.
                allowed = 100 * np.finfo(np.longdouble).eps / wanted / gap**2
                assert abs(float(contact_half_width(jnp.asarray(gap), jnp.asarray(sunk))) / wanted - 1) < max(
                    allowed, 1e-14
                )


def test_the_width_of_a_narrow_contact_by_its_series():
    """To first order F'(h) dh = F'(h) sunk / (1 + gap^2) + F(h) sunk / gap, far below what differences can tell."""
    gap, sunk = 0.3125, 1e-13
    h = np.arctan(gap)
    rise, value = 2 * (1 - h / np.tan(h)) / np.sin(h) ** 2, h / np.sin(h) ** 2 - 1 / np.tan(h)
    dh = sunk / (1 + gap**2) + value * sunk / gap / rise
    wanted = dh / np.sin(h) / np.cos(h)
    assert float(contact_half_width(jnp.asarray(gap), jnp.asarray(sunk))) == pytest.approx(wanted, rel=1e-11)


@pytest.mark.parametrize("make", [sg.shell.CylinderContact, pytest.param(sg.shell.Grasp, marks=pytest.mark.slow)])
def test_pressure_for_finds_every_force_that_solve_reports(make):
    """From a hair above contact to a hair below the limit, over shells that failed."""
    designs = jnp.array([[50, 60, 40, 5], [16, 20, 20, 5], [16, 43, 20, 5], [10, 90, 60, 0.5]]) * mm
    shares = jnp.array([1e-6, 1e-4, 0.01, 0.5, 0.9, 1 - 1e-4, 1 - 1e-7])

    def one(design, share):
        a, b, radius, gap = design
        made = sg.FlatShell(a=a, b=b, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        scene = make(made, radius=radius, gap=gap)
        contact, limit = sg.contact_pressure(scene), sg.limit_pressure(scene)
        state = sg.solve(scene, contact + share * (limit - contact))
        by_force = sg.pressure_for(scene, force=state.force)
        by_force_z = sg.pressure_for(scene, force_z=state.force_z)
        return (
            state.status,
            by_force.status,
            by_force_z.status,
            jnp.stack([by_force.pressure, by_force_z.pressure]) / state.pressure,
        )

    every = jax.jit(jax.vmap(jax.vmap(one, (None, 0)), (0, None)))(designs, shares)
    assert np.all(np.asarray(every[0]) == OK)
    assert np.all(np.asarray(every[1]) == OK)
    assert np.all(np.asarray(every[2]) == OK)
    np.testing.assert_allclose(np.asarray(every[3]), 1, rtol=1e-12)


def test_no_pressure_gives_a_force_below_zero():
    """Of a stretch below that of first contact only the contact says nothing: the free membrane has it."""
    scene = sg.shell.FlatContact(shell(), distance=5 * mm)
    forces = [sg.pressure_for(scene, force=force) for force in (-1.0, 0.0)]
    found = [*forces, sg.pressure_for(scene, stretch=1.01)]
    assert [sg.Status(int(one.status)) for one in found] == [NO_CONTACT] * 3
    assert [sg.Reason(int(one.reason)).name for one in found] == ["VALUE_PASSED", "NOTHING_TOUCHED", "NOTHING_TOUCHED"]
    for one in found:
        assert float(one.pressure) == pytest.approx(float(sg.contact_pressure(scene)), rel=1e-9)


def test_no_limit_means_that_any_pressure_is_held():
    """Ogden's alpha above 3: the pressure of a free membrane rises for ever, but slowly."""
    made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.Ogden(mu=[1e5, -1e4], alpha=[3.1, -2.0]))
    scene = sg.shell.Free(made)
    limit, unit = float(sg.limit_pressure(scene)), float(scene.pressure_scale())
    for pressure in (10 * unit, 100 * unit, 1e4 * unit):
        assert status_at(scene, pressure) is (OK if pressure < limit else BEYOND)


def test_a_state_next_to_the_lock_converges():
    """The load is so steep there that rounding of the angle alone is above the tolerance."""
    made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.Gent(mu=175 * kPa, j_m=5.0))
    scene = sg.shell.Free(made)
    assert np.isinf(float(sg.limit_pressure(scene)))
    for pressure in (30, 1e3, 1e5):
        assert status_at(scene, pressure * scene.pressure_scale()) is OK


def test_a_pressure_that_cannot_be_meant_is_named_before_any_limit():
    """Under jit, where nothing can be raised."""
    seen = jax.jit(jax.vmap(sg.solve, (None, 0)))(sg.shell.Free(shell()), jnp.array([jnp.inf, jnp.nan, -1.0, 30 * kPa]))
    named = [sg.Reason.PRESSURE_RULE] * 3 + [sg.Reason.LIMIT_POINT]
    assert [sg.Reason(int(reason)) for reason in seen.reason] == named


SNAPS = {"a": 8.505e-3, "b": 57.05e-3, "t_m": 0.7222e-3, "gap": 13.38e-3, "radius": 2.365e-3} | {
    "material": {"kind": ref.OGDEN, "mu": [1.2746e6, 7.94e4], "alpha": [2.98916, -3.69656]}
}


@pytest.mark.slow
def test_a_contact_that_begins_with_a_fall_ends_there():
    """A strongly softening shell yields a little where it touches: under pressure it snaps, and no force is reached."""
    numbers = {k: v * 1e3 for k, v in SNAPS.items() if k != "material"}
    touch = 2 * np.arctan(SNAPS["gap"] / SNAPS["a"])
    begins = float(ref.free(touch, SNAPS)[0])
    after = np.asarray(ref.cylinder(touch + np.array([0.0, 1e-5, 1e-4, 1e-2]), SNAPS)[0])
    assert after[0] == pytest.approx(begins, rel=1e-9)
    assert after[2] < after[1] < after[0] < after[3]  # a dip, and then it rises far above
    material = sg.Ogden(mu=SNAPS["material"]["mu"], alpha=SNAPS["material"]["alpha"])
    made = sg.FlatShell(*(numbers[k] * mm for k in ("a", "b", "t_m")), material=material)
    scene = sg.shell.CylinderContact(made, radius=SNAPS["radius"], gap=SNAPS["gap"])
    assert float(sg.limit_pressure(scene)) == pytest.approx(begins, rel=1e-9)
    assert float(sg.contact_pressure(scene)) == pytest.approx(begins, rel=1e-9)
    assert [status_at(scene, begins * q) for q in (1 - 1e-6, 1 + 1e-6)] == [NO_CONTACT, BEYOND]
    assert sg.Status(int(sg.pressure_for(scene, force=7e-3).status)) == BEYOND

    def limit(thickness):
        return sg.limit_pressure(sg.shell.CylinderContact(sg.FlatShell(made.a, made.b, thickness, material), *ROD_OF))

    ROD_OF = (SNAPS["radius"], SNAPS["gap"])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(limit)))(around(made.t_m))
    assert float(slopes[-1]) == pytest.approx(float(np.dot(WEIGHTS, values[:-1]) / (H * made.t_m)), rel=1e-7)


def test_states_next_to_a_closed_arc_converge():
    """A little above alpha = 3 the pressure grows like a power of the stretch: Newton's steps are no measure there."""
    material = sg.Ogden(mu=[42128.9, -44321.6], alpha=[3.25423, -0.80704])
    scene = sg.shell.Free(sg.FlatShell(a=2.2785 * mm, b=9.3434 * mm, t_m=0.77882 * mm, material=material))
    limit = float(sg.limit_pressure(scene))
    found = sg.path(scene, limit * np.array([0.1, 0.9, 1 - 1e-3, 1 - 1e-6, 1 + 1e-6]))
    np.testing.assert_array_equal(found.status, [OK, OK, OK, OK, BEYOND])
    numbers = {"a": 2.2785e-3, "b": 9.3434e-3, "t_m": 0.77882e-3} | {
        "material": {"kind": ref.OGDEN, "mu": [42128.9, -44321.6], "alpha": [3.25423, -0.80704]}
    }
    back = ref.free(np.asarray(found.clamp_angle)[:1], numbers)[0]
    np.testing.assert_allclose(back, 0.1 * limit, rtol=1e-6)
