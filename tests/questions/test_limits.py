"""Where equilibrium ends: limit pressures against SciPy's own maximisation, labels next to them, their derivatives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from helpers import MATERIALS, ROD, shell
from jax.flatten_util import ravel_pytree
from scipy.optimize import brentq, minimize_scalar

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.units import kPa, mm

REFERENCE = {
    "neo": {"kind": ref.NEO, "mu": 175e3},
    "mooney": {"kind": ref.MOONEY, "c1": 80e3, "c2": 7e3},
    "yeoh": {"kind": ref.YEOH, "c1": 85e3, "c2": -1.5e3, "c3": 0.4e3},
    "gent": {"kind": ref.GENT, "mu": 170e3, "j_m": 40.0},
    "ogden": {"kind": ref.OGDEN, "mu": [120e3, 4e3, -6e3], "alpha": [1.6, 5.0, -2.1]},
}


def design(material, **neighbour):
    return {"a": 16e-3, "b": 43e-3, "t_m": 1.1e-3, "material": REFERENCE[material]} | neighbour


def first_maximum(load, p, start, end=np.pi - 1e-7, points=20001):
    """(pressure, whether it is a maximum inside): the first maximum by a fine scan, then SciPy's bounded search."""
    angle = np.linspace(start, end, points)[1:]
    with np.errstate(all="ignore"):
        pressure, margins = load(angle, p)
    inside = np.all([m > 0 for m in margins], axis=0) if margins else np.ones_like(angle, bool)
    rising = np.append(pressure[1:] > pressure[:-1], False) & inside & np.isfinite(pressure)
    k = int(np.argmin(rising))
    if not inside[k]:
        # The model ends first: where a margin is zero.
        ends = [
            brentq(lambda x, i=i: float(load(x, p)[1][i]), angle[k - 1], angle[k], xtol=1e-16)
            for i in range(len(margins))
            if margins[i][k] <= 0
        ]
        return float(load(min(ends), p)[0]), False
    if k == len(angle) - 1 or not np.isfinite(pressure[k + 1]):
        return np.inf, False  # it rises to the end, or to where the material locks
    best = minimize_scalar(
        lambda x: -float(load(x, p)[0]), bounds=(angle[k - 1], angle[k + 1]), method="bounded", options={"xatol": 1e-12}
    )
    return -best.fun, True


def status_at(scene, pressure):
    return sg.Status(int(sg.solve(scene, pressure).status))


@pytest.mark.parametrize("material", REFERENCE)
@pytest.mark.parametrize("kind", ["free", "cylinder"])
def test_limit_pressure_and_its_neighbourhood(kind, material):
    if kind == "free":
        wanted, _ = first_maximum(ref.free, design(material), 1e-3)
        scene = sg.shell.Free(shell(material))
    else:
        p = design(material, radius=20e-3, gap=5e-3)
        wanted, _ = first_maximum(ref.cylinder, p, 2 * np.arctan(5 / 16))
        scene = sg.shell.CylinderContact(shell(material), **ROD)
    limit = float(sg.limit_pressure(scene))
    if np.isinf(wanted):
        assert np.isinf(limit)
        assert status_at(scene, 300 * kPa) is sg.Status.OK
        return
    assert limit == pytest.approx(wanted, rel=1e-10)
    assert status_at(scene, limit * (1 - 1e-6)) is sg.Status.OK
    assert status_at(scene, limit * (1 + 1e-6)) is sg.Status.BEYOND_LIMIT


def test_stiffening_and_locking_remove_the_limit():
    """Yeoh with a strong third constant and Gent never let go: inf, and the pressure can be anything."""
    for material in (sg.Yeoh(c1=85 * kPa, c2=0.0, c3=20 * kPa), sg.Gent(mu=170 * kPa, j_m=2.0)):
        made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=material)
        assert np.isinf(float(sg.limit_pressure(sg.shell.Free(made))))
        assert status_at(sg.shell.Free(made), 1000 * kPa) is sg.Status.OK


def test_table_value_of_the_free_shell():
    """32 x 86 x 1.1 mm, 175 kPa: 20.1756 kPa."""
    assert float(sg.limit_pressure(sg.shell.Free(shell()))) / kPa == pytest.approx(20.1756, abs=5e-5)


def end_of_cylinder(scene, observable):
    """The observable where the model of a cylinder ends."""
    limit = float(sg.limit_pressure(scene))
    solution = sg.solve(scene, limit * (1 - 1e-13))
    assert sg.Status(int(solution.status)) is sg.Status.OK
    return float(getattr(solution, observable))


def test_model_ends_where_the_membrane_is_used_up():
    """A short, wide shell on a large cylinder: e = 0 before any maximum."""
    made = sg.FlatShell(a=16 * mm, b=20 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    scene = sg.shell.CylinderContact(made, radius=40 * mm, gap=2 * mm)
    p = {"a": 16e-3, "b": 20e-3, "t_m": 1.1e-3, "material": REFERENCE["neo"], "radius": 40e-3, "gap": 2e-3}
    wanted, is_maximum = first_maximum(ref.cylinder, p, 2 * np.arctan(2 / 16), points=200001)
    assert not is_maximum
    assert float(sg.limit_pressure(scene)) == pytest.approx(wanted, rel=1e-10)
    assert end_of_cylinder(scene, "flat_length") == pytest.approx(0, abs=1e-12)


def test_model_ends_where_the_contact_is_as_wide_as_the_shell():
    """A long shell close to a large cylinder: c_a = a before any maximum."""
    made = sg.FlatShell(a=10 * mm, b=90 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    scene = sg.shell.CylinderContact(made, radius=60 * mm, gap=0.5 * mm)
    p = {"a": 10e-3, "b": 90e-3, "t_m": 1.1e-3, "material": REFERENCE["neo"], "radius": 60e-3, "gap": 0.5e-3}
    wanted, is_maximum = first_maximum(ref.cylinder, p, 2 * np.arctan(0.05), points=200001)
    assert not is_maximum
    assert float(sg.limit_pressure(scene)) == pytest.approx(wanted, rel=1e-10)
    assert end_of_cylinder(scene, "contact_half_width") == pytest.approx(10 * mm, rel=1e-9)


def test_offset_ends_where_the_near_side_is_used_up():
    scene = sg.shell.AxialOffset(shell(), height=30 * mm, **ROD)
    p = design("neo", radius=20e-3, gap=5e-3, height=30e-3)
    wanted, _ = first_maximum(ref.cylinder, p, 2 * np.arctan(5 / 16), points=200001)
    assert float(sg.limit_pressure(scene)) == pytest.approx(wanted, rel=1e-10)
    assert end_of_cylinder(scene, "flat_length_near") == pytest.approx(0, abs=1e-11)
    unstable = sg.shell.AxialOffset(shell(), height=10 * mm, **ROD)
    assert status_at(unstable, 15 * kPa) is sg.Status.IMPOSSIBLE
    assert np.isnan(float(sg.limit_pressure(unstable)))


def test_flat_contact_ends_at_pi():
    """theta_m = pi: the free arcs are half circles of radius d / 2 and the contact is as wide as the shell."""
    limit = float(sg.limit_pressure(sg.shell.FlatContact(shell(), distance=5 * mm)))
    assert limit == pytest.approx(float(ref.flat(np.pi, design("neo", distance=5e-3))[0]), rel=1e-12)


def test_branch_goes_through_the_limit():
    scene = sg.shell.Free(shell())
    branch = sg.branch(scene, 400)
    pressure, limit = np.asarray(branch.pressure), float(sg.limit_pressure(scene))
    top = int(np.argmax(pressure))
    assert 0 < top < 399
    assert np.all(np.diff(pressure[: top + 1]) > 0)
    assert np.all(np.diff(pressure[top:]) < 0)
    assert pressure[top] == pytest.approx(limit, rel=1e-4)
    assert np.all(pressure <= limit)
    theta = np.asarray(branch.clamp_angle)[1:]
    np.testing.assert_allclose(pressure[1:], ref.free(theta, design("neo"))[0], rtol=1e-9)


def relative_limit(change, scene, scale):
    """The limit pressure by relative changes of all numbers of a scene. These come as arguments: scenes of one kind,
    with other numbers, are one program."""
    leaves, rebuild = ravel_pytree(scene)
    return sg.limit_pressure(rebuild(leaves * (1 + change))) / scale


both_modes = jax.jit(lambda *args: (jax.grad(relative_limit)(*args), jax.jacfwd(relative_limit)(*args)))
many_limits = jax.jit(jax.vmap(relative_limit, (0, None, None)))


@pytest.mark.parametrize("case", ["maximum", "used up", "covered"])
def test_limit_pressure_can_be_differentiated(case):
    """At a maximum and at both ends of the model: forward = reverse = finite differences."""
    scene = {
        "maximum": lambda: sg.shell.Free(shell("neo")),
        "used up": lambda: sg.shell.CylinderContact(shell("neo", b=20 * mm), radius=40 * mm, gap=2 * mm),
        "covered": lambda: sg.shell.CylinderContact(shell("neo", a=10 * mm, b=90 * mm), radius=60 * mm, gap=0.5 * mm),
    }[case]()
    n, scale = ravel_pytree(scene)[0].size, float(sg.limit_pressure(scene))
    reverse, forward = both_modes(jnp.zeros(n), scene, scale)
    np.testing.assert_allclose(forward, reverse, rtol=1e-12, atol=1e-13)
    h = 1e-4
    points = np.concatenate([k * h * np.eye(n) for k in (-2, -1, 1, 2)])
    values = np.asarray(many_limits(jnp.asarray(points), scene, scale)).reshape(4, -1)
    np.testing.assert_allclose(reverse, np.array([1, -8, 8, -1]) @ values / (12 * h), rtol=1e-8, atol=1e-9)
    assert set(MATERIALS) == set(REFERENCE)


@pytest.mark.parametrize("angle", [0.0, 0.17])
def test_contact_pressure_is_where_contact_begins(angle):
    """Just below nothing is touched, just above something is; derivative by the distance against differences."""
    square = shell(a=7.5 * mm, b=7.5 * mm)

    def scene(distance):
        return sg.shell.InclinedContact(square, distance=distance, angle=angle)

    begin = sg.contact_pressure(scene(5 * mm))
    below, above = sg.path(scene(5 * mm), [begin * (1 - 1e-9), begin * (1 + 1e-9)]).status
    assert (sg.Status(int(below)), sg.Status(int(above))) == (sg.Status.NO_CONTACT, sg.Status.OK)
    slope = jax.grad(lambda d: sg.contact_pressure(scene(d)))(5 * mm)
    step = 5 * mm * 1e-4
    difference = (sg.contact_pressure(scene(5 * mm + step)) - sg.contact_pressure(scene(5 * mm - step))) / (2 * step)
    assert slope == pytest.approx(float(difference), rel=1e-7)


@pytest.mark.parametrize("kind", ["free", "flat", "cylinder", "inclined"])
def test_a_neo_hookean_membrane_has_one_maximum_at_most(kind):
    """What looking at its curve in a few cells rests on: over 5,000 designs the pressure never rises again."""
    rng, lanes = np.random.default_rng(5), 5000
    a = 10 ** rng.uniform(-2.5, -1.2, lanes)
    near, wide = a * 10 ** rng.uniform(-2, 0.3, lanes), 10 ** rng.uniform(-0.7, 0.8, lanes)
    p = {"a": a, "b": a * (1 + 10 ** rng.uniform(-1, 1, lanes)), "t_m": 0.05 * a, "material": REFERENCE["neo"]}
    p |= {"distance": near, "gap": near, "radius": a * wide, "angle": rng.uniform(0.0, 0.6, lanes)}
    start = {"free": 1e-3 + 0 * a, "inclined": p["angle"] + 1e-2}.get(kind, 2 * np.arctan(near / a))
    angle = start + (np.pi - 1e-4 - start) * np.linspace(1e-4, 1.0, 600)[:, None]
    with np.errstate(all="ignore"):
        pressure, margins = getattr(ref, kind)(angle, p)
    inside = np.logical_and.reduce([np.isfinite(pressure), *[margin >= 0 for margin in margins]])
    rise = np.diff(pressure, axis=0)
    known = inside[1:] & inside[:-1] & (np.abs(rise) > 1e-12 * np.abs(pressure[1:]))
    fallen = np.maximum.accumulate(known & (rise < 0), axis=0)
    assert np.mean(np.sum(known, axis=0) > 20) > 0.5
    assert not np.any(known & fallen & (rise > 0))


@pytest.mark.parametrize("way", [jax.grad, jax.jacfwd, lambda f: lambda x: jax.jvp(f, (x,), (1.0,))])
def test_a_branch_is_not_differentiated(way):
    """Its points move with the scene: derivatives of a cylinder's were off by a factor of two to eleven."""

    def at(a):
        return sg.branch(sg.shell.Free(dataclasses.replace(shell(), a=a)), 5).pressure[2]

    with pytest.raises(InputError, match="branch has no derivatives"):
        way(at)(16 * mm)
    assert np.isfinite(jax.jit(at)(16 * mm))
    assert np.isfinite(jax.vmap(at)(jnp.array([15 * mm, 16 * mm]))).all()


@pytest.mark.parametrize("n", [0, 1, -3, True])
def test_a_branch_of_no_points_is_refused(n):
    with pytest.raises(ValueError, match=r"it must be a whole number, 2 or more\."):
        sg.branch(sg.shell.Free(shell()), n)
