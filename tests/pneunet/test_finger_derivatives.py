"""Derivatives of fingers: forward = reverse = finite differences, twice, beside lanes without a solution."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import STENCIL, differences, stencil
from jax.flatten_util import ravel_pytree

import softgrip_jax as sg
from softgrip_jax.units import gram, kPa, mm

STEP = 2e-3
"""Relative step of the differences: sixth order leaves 1e-12 of truncation, and rounding of 1e-14 / 2e-3."""

FINGER = sg.PneuNet.table_5_1("A")
T_M = 3
"""Place of t_m among the leaves of a finger, which come first in every scene."""


def contact(**options):
    options = {"weight": (0.5, -1.0), "tip_pull": 0.05} | options
    return sg.pneunet.TipContact(FINGER, tip_offset=-4 * mm, **options)


def free(**options):
    return sg.pneunet.Free(FINGER, clamp_angle=0.1, **options)


def grasp():
    gripper = sg.pneunet.Gripper(FINGER, n=3)
    held = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
    return sg.pneunet.Grasp(gripper, held)


def observed(*names):
    def values(scene, number):
        solution = sg.solve(scene, number)
        return jnp.concatenate([jnp.ravel(solution.observables[name]) for name in names])

    return values


def required_pressure(scene, number):
    """The number is the security that is asked for."""
    return sg.pressure_for(scene, security=number).pressure[None]


def limit(scene, number):
    """The number plays no part."""
    return sg.limit_pressure(scene)[None] + 0 * number


HELD = ("tip_force", "tip", "tip_angle", "end_moment")
BENT = ("tip", "tip_angle", "end_moment", "inclination")
CASES = {
    "contact": (contact, observed(*HELD), 28 * kPa),
}
LONG = {
    "free-none": (lambda: free(weight=(0, 0), inclination="none"), observed(*BENT[:-1]), 28 * kPa),
    "contact-thesis": (lambda: contact(section="thesis"), observed(*HELD), 28 * kPa),
    "limit": (contact, limit, 1.0),
    "grasp": (grasp, required_pressure, 1.0),
    "free-segment": (lambda: free(weight=(0, 0)), observed(*BENT), 28 * kPa),
    "free-weight": (lambda: free(weight=(0.3, -1.5), inclination="none"), observed(*BENT[:-1]), 24 * kPa),
    "contact-segment": (lambda: contact(inclination="segment"), observed(*HELD), 28 * kPa),
    "free-weight-segment": (lambda: free(weight=(0.3, -1.5)), observed(*BENT), 28 * kPa),
}
"""Minutes to compile, each."""


@pytest.mark.parametrize("name", [*CASES, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_forward_reverse_and_differences_agree_beside_lanes_without_a_solution(name):
    make, values, number = (CASES | LONG)[name]
    leaves, rebuild = ravel_pytree(make())
    n = leaves.size + 1

    def f(change):
        """Values after relative changes of every leaf and, last, of the number."""
        return values(rebuild(leaves * (1 + change[:-1])), number * (1 + change[-1]))

    def value_and_reverse(x):
        value, pull = jax.vjp(f, x)
        return value, jax.vmap(lambda cotangent: pull(cotangent)[0])(jnp.eye(value.size))

    # One program gives all: tangents of the value are forward derivatives, tangents of the gradient second ones.
    everything = jax.jit(jax.vmap(lambda x, v: jax.jvp(value_and_reverse, (x,), (v,))))
    shifts = stencil(n, STEP)
    # No wall, one less than nothing, not a number, far too much pressure (or, for a limit, an endless wall).
    bad = jnp.zeros((4, n)).at[0, T_M].set(-1.0).at[1, T_M].set(-2.0).at[2, T_M].set(jnp.nan)
    bad = bad.at[3, T_M].set(jnp.inf) if values is limit else bad.at[3, -1].set(50.0)
    x = jnp.concatenate([jnp.zeros((n, n)), shifts, bad])
    v = jnp.concatenate([jnp.eye(n), jnp.ones((len(x) - n, n))])
    (value, reverse), (forward, second) = jax.tree.map(np.asarray, everything(x, v))

    assert np.all(np.isnan(value[-4:]))
    for derivative in (reverse, forward, second):
        assert np.all(derivative[-4:] == 0)
        assert np.all(np.isfinite(derivative))

    size = np.abs(value[0])
    assert np.all(size > 0)
    shifted = slice(n, n + n * STENCIL.size)
    reverse, by_steps = reverse / size[:, None], differences(value[shifted] / size, n, STEP)
    forward, second = forward[:n].T / size[:, None], np.moveaxis(second[:n], 0, -1) / size[:, None, None]
    scale = np.maximum(1, np.abs(reverse[0]))
    assert np.max(np.abs(forward - reverse[0]) / scale) < 1e-10
    assert np.max(np.abs(by_steps - reverse[0]) / scale) < 1e-6

    numeric = differences(reverse[shifted], n, STEP)
    scale = np.maximum(1, np.max(np.abs(numeric), axis=(1, 2), keepdims=True))
    assert np.max(np.abs(numeric - second) / scale) < 1e-4
    assert np.max(np.abs(second - np.swapaxes(second, 1, 2)) / scale) < 1e-8


def test_first_leaves_are_the_finger():
    """What the lanes above that have no wall rely on."""
    for make, *_ in (CASES | LONG).values():
        leaves, _ = ravel_pytree(make())
        assert float(leaves[T_M]) == float(FINGER.t_m)
    assert [field.name for field in dataclasses.fields(FINGER)][T_M] == "t_m"


@pytest.mark.parametrize("sought", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_unknowns_of_lanes_without_a_solution_have_no_derivatives(sought):
    """Their tangents were NaN, and so was that of every sum over the batch."""

    def unknowns(t_m, pressure):
        finger = dataclasses.replace(FINGER, t_m=t_m)
        if sought:
            return sg.pressure_for(sg.pneunet.TipContact(finger, points=4), tip_force=pressure * 1e-5).unknowns
        return sg.solve(sg.pneunet.Linear(finger), pressure).unknowns

    t_m = FINGER.t_m * jnp.array([1.0, -1.0, jnp.nan, 1.0])
    pressure = jnp.array([3.0, 3.0, 3.0, -1.0]) * kPa
    _, moved = jax.jit(jax.vmap(lambda t_m, p: jax.jvp(unknowns, (t_m, p), (t_m, 2 * p))))(t_m, pressure)
    assert np.any(np.abs(np.asarray(moved)[0]) > 1e-6)
    assert np.all(np.asarray(moved)[1:] == 0)
