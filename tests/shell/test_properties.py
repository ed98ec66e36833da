"""Properties that every shell has, whatever its dimensions: scaling laws, symmetric cases, and what only grows.

The examples are drawn by hypothesis over the admissible space. Every number is an argument of one compiled program.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm

# The laws hold over decades, also at sizes that nobody builds.
pytestmark = pytest.mark.filterwarnings("ignore:.*did you mean")
FEW = settings(max_examples=25, deadline=None, derandomize=True)
OK, BEYOND, UNTOUCHED = (int(sg.Status[name]) for name in ("OK", "BEYOND_LIMIT", "NO_CONTACT"))

SHELLS = st.fixed_dictionaries({
    "a": st.floats(3 * mm, 60 * mm),
    "slender": st.floats(1.0, 6.0),
    "thin": st.floats(0.01, 0.2),
    "mu": st.floats(10 * kPa, 2000 * kPa),
    "near": st.floats(0.05, 0.9),
    "round": st.floats(0.3, 3.0),
})  # fmt: skip
SHARES = st.floats(0.02, 0.98)
"""Of the way from first contact to the limit pressure."""


def membrane(d):
    a = d["a"]
    return sg.FlatShell(a=a, b=a * d["slender"], t_m=a * d["thin"], material=sg.NeoHookean(mu=d["mu"]))


def on_plane(d):
    return sg.shell.FlatContact(membrane(d), distance=d["near"] * d["a"])


def on_cylinder(d):
    """Slender enough for the straight length that a cylinder leaves."""
    longer = d | {"slender": 2.5 + d["slender"]}
    return sg.shell.CylinderContact(membrane(longer), radius=d["round"] * d["a"], gap=d["near"] * d["a"])


def in_free_space(d):
    return sg.shell.Free(membrane(d))


KINDS = (in_free_space, on_plane, on_cylinder)


@jax.jit
def reach(scene):
    return sg.contact_pressure(scene), sg.limit_pressure(scene)


def pressures(scene, *shares):
    """Pressures at shares of the way from first contact to the limit."""
    low, high = reach(scene)
    return low + jnp.asarray(shares) * (high - low)


def observed(scene, pressure):
    """Everything observed, by name, with its kind of quantity."""
    solution = sg.solve(scene, pressure)
    assert int(solution.status) == OK
    return {name: float(value) for name, value in solution.observables.items()}


def changed(before, after, kinds, factors):
    """Every observable grows by the factor of its kind."""
    for name, value in before.items():
        np.testing.assert_allclose(after[name], value * factors.get(kinds[name], 1.0), rtol=1e-8, err_msg=name)


@FEW
@given(d=SHELLS, share=SHARES, factor=st.floats(0.01, 100), kind=st.sampled_from(KINDS))
def test_stiffer_means_more_pressure_and_nothing_else(d, share, factor, kind):
    """mu is the only stiffness: states at equal p / mu are equal, forces grow with mu."""
    soft, stiff = kind(d), kind(d | {"mu": factor * d["mu"]})
    (p,), (q,) = pressures(soft, share), pressures(stiff, share)
    np.testing.assert_allclose(q, factor * p, rtol=1e-9)
    changed(observed(soft, p), observed(stiff, factor * p), soft.OBSERVABLES, {"force": factor})


@FEW
@given(d=SHELLS, share=SHARES, factor=st.floats(0.01, 100), kind=st.sampled_from(KINDS))
def test_size_does_not_matter_at_equal_pressure(d, share, factor, kind):
    """All lengths times k: lengths times k, areas and forces times k^2, angles and stretches as they were."""
    small, large = kind(d), kind(d | {"a": factor * d["a"]})
    (p,), (q,) = pressures(small, share), pressures(large, share)
    np.testing.assert_allclose(q, p, rtol=1e-9)
    factors = {"length": factor, "area": factor**2, "force": factor**2}
    changed(observed(small, p), observed(large, p), small.OBSERVABLES, factors)


@FEW
@given(d=SHELLS, share=SHARES, factor=st.floats(0.1, 10), kind=st.sampled_from(KINDS))
def test_a_thicker_membrane_is_a_stiffer_one(d, share, factor, kind):
    """Membranes know mu t_m only."""
    thin, other = kind(d), kind(d | {"thin": factor * d["thin"], "mu": d["mu"] / factor})
    (p,) = pressures(thin, share)
    changed(observed(thin, p), observed(other, p), thin.OBSERVABLES, {})


@FEW
@given(d=SHELLS, shares=st.tuples(SHARES, SHARES), kind=st.sampled_from(KINDS))
def test_more_pressure_more_of_everything(d, shares, kind):
    scene = kind(d)
    lower, higher = (observed(scene, p) for p in pressures(scene, *sorted(shares)))
    names = set(lower) & {"inflation", "stretch", "length_stretch", "clamp_angle", "force", "force_z", "contact_area"}
    names |= set(lower) & {"contact_half_width", "contact_half_length", "contact_angle"}
    assert len(names) >= 4
    for name in names:
        assert higher[name] >= lower[name] * (1 - 1e-10), name


@FEW
@given(d=SHELLS, share=st.floats(1e-6, 0.5), kind=st.sampled_from(KINDS))
def test_statuses_say_where_a_pressure_lies(d, share, kind):
    scene = kind(d)
    low, high = (float(p) for p in reach(scene))
    assert 0 <= low < high < np.inf
    assert int(sg.solve(scene, high * (1 + share)).status) == BEYOND
    assert int(sg.solve(scene, high * (1 - 1e-6)).status) == OK
    if kind is not in_free_space:
        below = sg.solve(scene, low * (1 - share))
        assert (int(below.status), float(below.force)) == (UNTOUCHED, 0.0)


@FEW
@given(d=SHELLS, share=SHARES)
def test_the_middle_is_the_symmetric_place(d, share):
    """A cylinder in the middle of the membrane is the symmetric contact; one off it has a mirror image."""
    scene = on_cylinder(d)
    (p,) = pressures(scene, share)
    at = {"shell": scene.shell, "radius": scene.radius, "gap": scene.gap}
    middle = observed(sg.shell.AxialOffset(height=scene.shell.b, **at), p)
    changed(observed(scene, p), {name: middle[name] for name in scene.OBSERVABLES}, scene.OBSERVABLES, {})
    np.testing.assert_allclose(middle["flat_length_far"], middle["flat_length_near"], rtol=1e-9)
    off = 0.5 * middle["flat_length_near"]
    left, right = (observed(sg.shell.AxialOffset(height=scene.shell.b + s * off, **at), p) for s in (-1, 1))
    mirrored = right | {
        "flat_length_far": right["flat_length_near"],
        "flat_length_near": right["flat_length_far"],
    }
    changed(left, mirrored, sg.shell.AxialOffset.OBSERVABLES, {})


@FEW
@given(d=SHELLS, share=SHARES)
def test_a_plane_without_tilt_is_a_parallel_one(d, share):
    """Square membranes; theta_s = 0: c_1 = c_2, the contact is a disc of width 2 c."""
    square = membrane(d | {"slender": 1.0})
    scene = sg.shell.InclinedContact(square, distance=d["near"] * d["a"], angle=0.0)
    low, high = reach(scene)
    np.testing.assert_allclose(
        low, sg.contact_pressure(sg.shell.FlatContact(square, distance=scene.distance)), rtol=1e-8
    )
    found = observed(scene, low + share * (high - low))
    np.testing.assert_allclose(found["contact_width"], found["contact_length"], rtol=1e-8)
