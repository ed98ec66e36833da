"""The beam by shooting against the beam by collocation: two methods, one set of equations; and bad choices."""

from dataclasses import replace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fingers import ALL_RULES, TYPE_A, contact, pneunet, stacked
from jax.flatten_util import ravel_pytree

import softgrip_jax as sg
from softgrip_jax import config
from softgrip_jax.pneunet import Collocation, Shooting
from softgrip_jax.units import gram, kPa, mm

OK, BEYOND = sg.Status.OK, sg.Status.BEYOND_LIMIT


# --- fingers ----------------------------------------------------------------------------------------------------------

# offset (mm), pull (N), weight (N/mm), pressure (kPa)
STATES = [
    (0.0, 0.0, (0.0, 0.0), 30.0, OK),
    (-3.0, 0.05, (5e-4, -1e-3), 25.0, OK),
    (20.0, 0.0, (0.0, 0.0), 31.0, OK),
    (0.0, 0.0, (0.0, -2e-3), 41.0, OK),
    (0.0, 0.0, (0.0, 0.0), 41.6, OK),  # just below the fold
    (0.0, 0.0, (0.0, 0.0), 42.0, BEYOND),
    (-20.0, 0.0, (0.0, 0.0), 45.0, BEYOND),
    (0.0, 0.0, (0.0, 0.0), 0.0, OK),
]
solve = jax.jit(jax.vmap(sg.solve))


def states(beam):
    scenes = [replace(contact(TYPE_A, "exact", *state[:3]), beam=beam) for state in STATES]
    return solve(stacked(scenes), jnp.array([state[3] * kPa for state in STATES]))


@pytest.mark.parametrize(
    "beam",
    [
        Shooting(),
        pytest.param(Shooting(segments=3), marks=pytest.mark.slow),
        pytest.param(Shooting(steps=8), marks=pytest.mark.slow),
        pytest.param(Shooting(diffrax.Tsit5(), rtol=1e-9, max_steps=100), marks=pytest.mark.slow),
    ],
    ids=["adaptive", "three segments", "equal steps", "Tsit5"],
)
def test_shooting_agrees_with_collocation(beam):
    other, ours = states(None), states(beam)
    np.testing.assert_array_equal(ours.status, [state[-1] for state in STATES])
    np.testing.assert_array_equal(other.status, ours.status)
    np.testing.assert_array_equal(ours.reason, other.reason)
    # Next to a fold the force moves with the square root of what an error moves the fold by.
    allowed = np.where(np.arange(len(STATES)) == 4, 1e-6, 1e-7)
    for name in ("tip_force", "tip_angle"):
        a, b = (np.asarray(s.observables[name]) for s in (ours, other))
        ok = np.asarray(other.status) == OK
        assert np.all(np.abs(a - b)[ok] <= (allowed * np.maximum(np.abs(b), 1e-3))[ok])
    np.testing.assert_allclose(ours.detail, other.detail, rtol=1e-7)  # the limit pressures
    for name, margin in other.margins.items():
        np.testing.assert_allclose(ours.margins[name], margin, rtol=0, atol=1e-7 * 77 * mm)


def hanging(beam, **options):
    """A grasp, whose rules look at the whole shape."""
    gripper = sg.pneunet.Gripper(pneunet(TYPE_A), base_radius=19.61 * mm, touch="midline")
    held = sg.objects.Cylinder(radius=18 * mm, mass=30 * gram, friction=0.96)
    return sg.pneunet.Grasp(gripper, held, beam=beam, **options, **ALL_RULES)


@pytest.mark.slow
def test_a_grasp_by_shooting():
    ours, other = (sg.pressure_for(hanging(beam)) for beam in (Shooting(rtol=1e-10, max_steps=48), None))
    assert int(ours.status) == OK
    np.testing.assert_allclose(ours.pressure, other.pressure, rtol=1e-8)
    for name, margin in other.margins.items():
        np.testing.assert_allclose(ours.margins[name], margin, rtol=0, atol=1e-9)
    for name, values in other.shape(11).items():
        np.testing.assert_allclose(ours.shape(11)[name], values, rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("section", ["thesis", "inextensible"])
@pytest.mark.parametrize("inclination", ["none", "segment"])
def test_every_section_and_inclined_chambers(section, inclination):
    scene = sg.pneunet.Free(pneunet(TYPE_A), section=section, inclination=inclination, **ALL_RULES)
    other, ours = (sg.solve(replace(scene, beam=beam), 25 * kPa) for beam in (None, Shooting(rtol=1e-10)))
    assert int(other.status) == int(ours.status) == OK
    # 13 parts have three points each: they are the rougher ones there.
    np.testing.assert_allclose(ours.tip, other.tip, rtol=1e-5 if inclination == "segment" else 1e-8)
    np.testing.assert_allclose(ours.inclination, other.inclination, rtol=1e-5)


@pytest.mark.slow
def test_a_material_of_ones_own_by_shooting():
    """The section by quadrature of any energy: its rates come from automatic differentiation."""
    finger = replace(pneunet(TYPE_A), material=sg.Gent(mu=136 * kPa, j_m=60.0))
    scene = sg.pneunet.TipContact(finger, **ALL_RULES)
    other, ours = (sg.solve(replace(scene, beam=beam), 25 * kPa) for beam in (None, Shooting(rtol=1e-10)))
    np.testing.assert_allclose(ours.tip_force, other.tip_force, rtol=1e-8)


@pytest.mark.slow
def test_slender_finger_under_tension_is_cut_into_segments():
    """A perturbation grows by e^28 from the clamp to the tip: one shot would miss by everything."""
    slender = TYPE_A | {"L": 300.0, "H": 3.0}
    scene = replace(contact(slender, "exact", 0.0, 1.0), beam=Shooting())
    assert scene.prepared().beam.segments > 1
    ours = sg.solve(scene, 31 * kPa)
    other = sg.solve(replace(scene, beam=None), 31 * kPa)
    assert int(ours.status) == int(other.status) == OK
    np.testing.assert_allclose(ours.tip_force, other.tip_force, rtol=1e-6)


@pytest.mark.slow
def test_too_few_equal_steps_are_said():
    bent = contact(TYPE_A, "exact", 0.0, 0.3, (0.0, -6e-3))
    scene = replace(bent, beam=Shooting(diffrax.Heun(), steps=2))
    found = sg.solve(scene, 20 * kPa)
    assert int(found.status) == sg.Status.NOT_CONVERGED
    assert int(found.reason) == sg.Reason.SHAPE_NOT_RESOLVED


@pytest.mark.slow
def test_derivatives_of_shooting():
    """Forward = reverse = those of collocation, first and second, of the force and of the limit pressure."""
    ours, other = (derivatives(beam) for beam in (Shooting(rtol=1e-10, max_steps=48), None))
    for a, b in zip(ours, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-7 * np.max(np.abs(b)))


def derivatives(beam):
    """Value, gradient, and its derivative in one direction, of the force and the limit by relative changes."""
    leaves, rebuild = ravel_pytree(replace(contact(TYPE_A, "exact", -3.0, 0.05, (5e-4, -1e-3)), beam=beam))

    def both(change):
        changed = rebuild(leaves * (1 + change))
        force = sg.solve(changed, 25 * kPa).tip_force
        return jnp.stack([force / 0.1, sg.limit_pressure(changed) / (40 * kPa)])

    def reverse(change):
        return jax.vmap(jax.vjp(both, change)[1])(jnp.eye(2))[0]

    zero, along = jnp.zeros(leaves.size), jnp.linspace(-1.0, 1.0, leaves.size)
    value, forward = jax.jit(lambda x: jax.jvp(both, (x,), (along,)))(zero)
    gradient, second = jax.jit(jax.vmap(lambda x: jax.jvp(reverse, (x,), (along,))))(
        jnp.stack([zero, 1e-4 * along, -1e-4 * along])
    )
    np.testing.assert_allclose(gradient[0] @ along, forward, rtol=1e-9)
    differences = (gradient[1] - gradient[2]) / 2e-4
    np.testing.assert_allclose(second[0], differences, rtol=0, atol=1e-6 * np.max(np.abs(second)))
    return value, gradient[0], second[0]


# --- choices ----------------------------------------------------------------------------------------------------------


def test_points_are_short_for_collocation():
    finger = pneunet(TYPE_A)
    short, long = sg.pneunet.TipContact(finger, points=8), sg.pneunet.TipContact(finger, beam=Collocation(points=8))
    assert short.method() == long.method() == Collocation(points=8)
    assert sg.pneunet.TipContact(finger).method() == Collocation(points=16)
    assert short.unloaded_state().shape == long.unloaded_state().shape == (9,)
    assert sg.pneunet.TipContact(finger, beam=Shooting(segments=2)).unloaded_state().shape == (4,)


BAD = {
    "both": (
        lambda f: sg.pneunet.TipContact(f, points=8, beam=Collocation(points=12)),
        r"TipContact.points is 8 and its beam is Collocation\(points=12\); points is short for "
        r"beam=Collocation\(points=...\), so give one of them",
    ),
    "points and shooting": (lambda f: sg.pneunet.Free(f, points=8, beam=Shooting()), "so give one of them"),
    "no method": (lambda f: sg.pneunet.TipContact(f, beam=8), r"TipContact.beam is 8; it must be"),
    "no such name": (
        lambda f: sg.pneunet.TipContact(f, beam="shoot"),
        "beam is 'shoot'; it must be one of 'collocation', 'shooting'",
    ),
    "implicit": (lambda f: Shooting(diffrax.Kvaerno5()), "Shooting.solver is Kvaerno5; it must be an explicit"),
    "a class": (lambda f: Shooting(diffrax.Dopri8), "Shooting.solver is Dopri8; it must be an explicit"),
    "tolerance": (lambda f: Shooting(rtol=0.0), "Shooting.rtol is 0.0; it must be a number between 0 and 1"),
    "equal steps with a tolerance": (
        lambda f: Shooting(steps=8, rtol=1e-6),
        "^Shooting.steps is 8 and its rtol is 1e-06; equal steps have no tolerance, so give one of them.$",
    ),
    "the default, given": (lambda f: Shooting(steps=8, rtol=1e-8), "and its rtol is 1e-08; equal steps have no"),
    "equal steps with an absolute one": (lambda f: Shooting(atol=1e-6, steps=8), "and its atol is 1e-06; equal"),
    "no segments": (lambda f: Shooting(segments=0), "Shooting.segments is 0; it must be a whole number, 1 or more"),
    "no points": (lambda f: Collocation(points=0), "Collocation.points is 0; it must be a whole number"),
}


@pytest.mark.parametrize(("make", "said"), BAD.values(), ids=BAD)
def test_what_cannot_be_meant_is_said(make, said):
    with pytest.raises(ValueError, match=said):
        make(pneunet(TYPE_A))


SCENE = """
[scene]
type = "pneunet.TipContact"
{line}
[scene.finger]
preset = "table_5_1_A"
[solve]
pressure_kPa = 30
"""


@pytest.mark.parametrize(
    ("line", "method"),
    [
        ("", Collocation(16)),
        ('beam = "collocation"\npoints = 8', Collocation(8)),
        ('beam = "shooting"', Shooting()),
        ('beam = { type = "shooting", rtol = 1e-6, segments = 2 }', Shooting(rtol=1e-6, segments=2)),
        ('beam = { type = "shooting", steps = 8 }', Shooting(steps=8)),
        ('beam = { type = "collocation", points = 12 }', Collocation(12)),
    ],
)
def test_methods_in_configs(tmp_path, line, method):
    path = tmp_path / "finger.toml"
    path.write_text(SCENE.format(line=line))
    assert config.load(path).scene.method() == method


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("beam = 8", "beam is 8; it must be one of 'collocation', 'shooting'"),
        ('beam = "shot"', "beam is 'shot'; it must be one of"),
        ('beam = { type = "shooting", solver = "Euler" }', "beam has no key 'solver'; 'shooting' takes rtol"),
        ('beam = "shooting"\npoints = 8', "so give one of them"),
        ('beam = { type = "shooting", steps = 8, rtol = 1e-6 }', "Shooting.steps is 8 and its rtol is 1e-06; equal"),
    ],
)
def test_wrong_methods_in_configs(tmp_path, line, said):
    path = tmp_path / "finger.toml"
    path.write_text(SCENE.format(line=line))
    with pytest.raises(config.ConfigError, match=said):
        config.load(path)
