"""Derivatives of everything by everything: forward = reverse = finite differences, second order too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import CASES, MATERIALS, ROD, STENCIL, Case, differences, relative, shell, stencil

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm

STEP = 2e-3
"""Relative step of the differences: sixth order leaves 1e-13 of truncation, and rounding of 1e-15 / 2e-3."""


INVERSE = ("flat-yeoh", "cylinder", "grasp-eccentric")
"""Cases whose pressure_for and limit_pressure are differentiated too: one of each shape of the curve (compile time)."""


ALL = [pytest.param(case, marks=pytest.mark.slow) if case.slow else case for case in CASES]


@pytest.mark.parametrize("case", ALL, ids=str)
def test_forward_reverse_and_differences_agree(case: Case):
    check(*relative(case, inverse=False))


TWICE = [pytest.param(case, marks=pytest.mark.slow) if case.slow else case for case in CASES if case.name in INVERSE]


@pytest.mark.slow
@pytest.mark.parametrize("case", TWICE, ids=str)
def test_inverse_and_limit_can_be_differentiated_twice(case: Case):
    check(*relative(case, inverse=True))


def check(n, f):
    """Forward = reverse = differences, second derivatives = differences of gradients, for a vectorised f at zero."""

    def value_and_reverse(x):
        value, pull = jax.vjp(f, x)
        return value, jax.vmap(lambda cotangent: pull(cotangent)[0])(jnp.eye(value.size))

    # One program gives all, in one batch: tangents of the value are forward derivatives, tangents of the gradient
    # second ones; the other lanes are the stencil of the differences.
    everything = jax.jit(jax.vmap(lambda x, v: jax.jvp(value_and_reverse, (x,), (v,))))
    points = jnp.concatenate([jnp.zeros((n, n)), stencil(n, STEP)])
    directions = jnp.concatenate([jnp.eye(n), jnp.zeros((n * STENCIL.size, n))])
    (values, reverses), (forward, second) = everything(points, directions)
    value, reverse = values[0], np.asarray(reverses[0])
    forward, second = np.asarray(forward[:n]).T, np.moveaxis(np.asarray(second[:n]), 0, -1)
    np.testing.assert_allclose(value, 1, rtol=1e-9)

    size = np.maximum(1, np.abs(reverse))
    assert np.max(np.abs(forward - reverse) / size) < 1e-12
    assert np.max(np.abs(differences(values[n:], n, STEP) - reverse) / size) < 1e-8

    numeric = differences(reverses[n:], n, STEP)
    size = np.maximum(1, np.max(np.abs(numeric), axis=(1, 2), keepdims=True))
    assert np.max(np.abs(numeric - second) / size) < 1e-6
    assert np.max(np.abs(second - np.swapaxes(second, 1, 2)) / size) < 1e-9


# Lanes in every state there is, side by side. The healthy ones come first.
LANES = {
    "healthy": (16 * mm, 43 * mm, 1.1 * mm, 20 * mm, 12 * kPa, sg.Status.OK),
    "healthy too": (14 * mm, 50 * mm, 0.8 * mm, 15 * mm, 9 * kPa, sg.Status.OK),
    "too low": (16 * mm, 43 * mm, 1.1 * mm, 20 * mm, 1 * kPa, sg.Status.NO_CONTACT),
    "too high": (16 * mm, 43 * mm, 1.1 * mm, 20 * mm, 90 * kPa, sg.Status.BEYOND_LIMIT),
    "no thickness": (16 * mm, 43 * mm, 0.0, 20 * mm, 12 * kPa, sg.Status.IMPOSSIBLE),
    "not a number": (np.nan, 43 * mm, 1.1 * mm, 20 * mm, 12 * kPa, sg.Status.IMPOSSIBLE),
    "infinite": (16 * mm, 43 * mm, 1.1 * mm, np.inf, 12 * kPa, sg.Status.IMPOSSIBLE),
    "longer than long": (16 * mm, 12 * mm, 1.1 * mm, 20 * mm, 12 * kPa, sg.Status.IMPOSSIBLE),
    "negative pressure": (16 * mm, 43 * mm, 1.1 * mm, 20 * mm, -1.0, sg.Status.IMPOSSIBLE),
    "pressure not a number": (16 * mm, 43 * mm, 1.1 * mm, 20 * mm, np.nan, sg.Status.IMPOSSIBLE),
}


def lane_force(shared, lane):
    """Force and its companions of one lane; `shared` is what all lanes have in common."""
    a, b, t_m, radius, pressure = lane
    gap, material = shared
    scene = sg.shell.Grasp(
        sg.FlatShell(a=a, b=b, t_m=t_m, material=material), radius=radius, gap=gap, mass=0.3, friction=1.2
    )
    solution = sg.solve(scene, pressure)
    return jnp.stack([solution.force, solution.height, solution.security]), solution.status


@pytest.mark.slow
@pytest.mark.parametrize("material", ["neo", "gent", "ogden"])
def test_lanes_without_a_solution_pass_no_gradient_and_spoil_none(material):
    lanes = jnp.asarray([lane[:5] for lane in LANES.values()])
    wanted = np.array([lane[5] for lane in LANES.values()])
    healthy = wanted == sg.Status.OK
    shared = (jnp.asarray(5 * mm), MATERIALS[material]())
    batch = jax.vmap(lane_force, in_axes=(None, 0))

    @jax.jit
    def everything(shared, lanes):
        values, pull, status = jax.vjp(batch, shared, lanes, has_aux=True)
        reverse = pull(jnp.ones_like(values))  # a cotangent on the lanes that failed, too
        forward = jax.jvp(lambda lanes: batch(shared, lanes)[0], (lanes,), (jnp.ones_like(lanes),))[1]
        forward_shared = jax.jvp(
            lambda shared: batch(shared, lanes)[0], (shared,), (jax.tree.map(jnp.ones_like, shared),)
        )[1]
        return values, status, reverse, forward, forward_shared

    values, status, (g_shared, g_lanes), forward, forward_shared = everything(shared, lanes)
    np.testing.assert_array_equal(status, wanted)
    assert np.all(np.isfinite(values[healthy]))
    assert np.all(np.asarray(values)[wanted == sg.Status.NO_CONTACT][:, 0] == 0)
    assert np.all(np.isnan(np.asarray(values)[wanted > sg.Status.NO_CONTACT]))
    for derivative in (g_lanes, forward, forward_shared):
        assert np.all(np.asarray(derivative)[~healthy] == 0)
        assert np.all(np.isfinite(derivative))
        assert np.all(np.asarray(derivative)[healthy] != 0)

    # The healthy lanes alone give the same gradients, shared leaves included.
    alone, alone_lanes = jax.jit(jax.grad(lambda shared, lanes: jnp.sum(batch(shared, lanes)[0]), argnums=(0, 1)))(
        shared, lanes[healthy]
    )
    np.testing.assert_allclose(np.asarray(g_lanes)[healthy], alone_lanes, rtol=1e-13)
    for mixed, pure in zip(jax.tree.leaves(g_shared), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(mixed, pure, rtol=1e-12)


@pytest.mark.slow
def test_inverse_and_limit_pass_no_gradient_where_there_is_none():
    # A force that no pressure reaches, one that is reached, one that needs no contact, and an impossible shell.
    thickness = jnp.asarray([1.1 * mm, 1.1 * mm, 1.1 * mm, -1.0])
    force = jnp.asarray([1e3, 2.0, 0.0, 2.0])

    def scene(gap, t_m):
        made = sg.FlatShell(a=jnp.asarray(16 * mm), b=jnp.asarray(43 * mm), t_m=t_m, material=MATERIALS["neo"]())
        return sg.shell.CylinderContact(made, radius=jnp.asarray(20 * mm), gap=gap)

    def pressures(gap, t_m, force):
        solution = sg.pressure_for(scene(gap, t_m), force=force)
        return solution.pressure, (sg.limit_pressure(scene(gap, t_m)), solution.status)

    batch = jax.vmap(pressures, in_axes=(None, 0, 0))
    gap = jnp.asarray(5 * mm)
    (_, (limit, status)), reverse = jax.jit(
        lambda g: (batch(g, thickness, force), jax.jacrev(lambda g: batch(g, thickness, force)[0])(g))
    )(gap)
    assert [sg.Status(int(s)).name for s in status] == ["BEYOND_LIMIT", "OK", "NO_CONTACT", "IMPOSSIBLE"]
    assert np.isnan(limit[3])
    assert np.all(np.isfinite(limit[:3]))
    assert reverse[1] != 0
    assert np.all(np.asarray(reverse)[[0, 2, 3]] == 0)
    slopes = jax.jit(jax.jacrev(lambda t: jax.vmap(lambda t: sg.limit_pressure(scene(gap, t)))(t)))(thickness)
    # Pressure is proportional to thickness: d p / d t_m = p / t_m.
    np.testing.assert_allclose(np.diag(slopes)[:3], np.asarray(limit[:3]) / np.asarray(thickness[:3]), rtol=1e-10)
    assert slopes[3, 3] == 0


def test_derivative_of_the_state_grows_towards_the_limit_and_stays_finite():
    scene = sg.shell.Free(shell())
    limit = float(sg.limit_pressure(scene))
    slope = jax.jit(jax.grad(lambda p: sg.solve(scene, p).inflation))
    # d delta / d p grows as 1 / sqrt(p_max - p): a hundredth of the distance is ten times the slope.
    near, nearer = slope(limit * (1 - 1e-8)), slope(limit * (1 - 1e-10))
    assert nearer / near == pytest.approx(10, rel=1e-2)


def test_shape_can_be_differentiated():
    def height(gap):
        scene = sg.shell.CylinderContact(shell(), radius=ROD["radius"], gap=gap)
        return sg.solve(scene, 15 * kPa).shape(41)["z"]

    gap = jnp.asarray(5 * mm)
    slope = jax.jit(jax.jacfwd(height))(gap)
    numeric = (height(gap * (1 + 1e-5)) - height(gap * (1 - 1e-5))) / (2e-5 * gap)
    np.testing.assert_allclose(slope, numeric, atol=1e-6)
