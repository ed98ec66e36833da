"""The thesis's contacts and grasps by the energy membrane, against integrals over the maps that it reports."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import shell
from scipy.integrate import trapezoid

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.results import Status
from softgrip_jax.shell.energy.basis import at_points
from softgrip_jax.shell.energy.resting import HALF_SIDE, Resting, half_axis
from softgrip_jax.shell.energy.sheet import local
from softgrip_jax.units import GRAVITY, gram, kPa, mm

MASS, FRICTION, ECCENTRICITY = 563 * gram, 0.9, 8 * mm
SMALL = {"across": 2, "lengthwise": 3}


def grasp(**changed) -> sg.Scene:
    given = {"mass": MASS, "friction": FRICTION, "eccentricity": ECCENTRICITY} | changed
    return sg.shell.Grasp(shell(), radius=20 * mm, gap=5 * mm, model="energy", **given)


@pytest.mark.slow
def test_security_and_tilt_resistance_are_integrals_over_the_map():
    """The normal force and the moment of friction, summed in NumPy over the map of the contact pressure."""
    solution = sg.solve(grasp(), 15 * kPa)
    maps = {k: np.asarray(v) for k, v in solution.scene.surface(solution.unknowns, solution.pressure, 161).items()}
    sides = [maps["X"][:, 0], maps["Y"][0]]
    # Deformed area per flat area.
    stretched = maps["larger_stretch"] * maps["smaller_stretch"]

    def integral(density):
        return trapezoid(trapezoid(density * stretched, sides[1]), sides[0])

    pressure = maps["contact_pressure"]
    force = integral(pressure)
    arm = np.hypot(maps["place"][..., 0], maps["place"][..., 1])
    tilt = FRICTION * integral(pressure * arm)
    assert force == pytest.approx(float(solution.force), rel=0.02)
    # The map is smoothed over the distance between the contact points, which spreads it: by an eighth here.
    assert 1 < tilt / float(solution.tilt_resistance) < 1.15
    lift, turn = FRICTION * force / (MASS * GRAVITY / 2), tilt / (MASS * GRAVITY * ECCENTRICITY)
    assert turn < lift
    assert 1 < turn / float(solution.security) < 1.15
    light = sg.solve(grasp(eccentricity=1 * mm), 15 * kPa)
    assert float(light.security) == pytest.approx(lift, rel=0.02)
    assert float(solution.required_force) == pytest.approx(MASS * GRAVITY / 2 / FRICTION)
    # Half of the contact's length: where the map has fallen to half, along the middle.
    line = pressure[80]
    angle = np.arctan2(maps["place"][80, :, 1], 25 * mm - maps["place"][80, :, 2])
    edge = np.max(angle[line > line.max() / 2])
    assert float(solution.contact_angle) == pytest.approx(edge, rel=0.2)
    assert float(solution.contact_half_length) == pytest.approx(20 * mm * float(solution.contact_angle))


@pytest.mark.slow
def test_the_pressure_that_holds_has_derivatives():
    """By the thickness, the mass and the friction: forward, reverse, and central differences."""
    ready = dataclasses.replace(grasp(eccentricity=4 * mm).prepared(), **SMALL)

    def needed(change):
        changed = dataclasses.replace(
            ready,
            shell=dataclasses.replace(ready.shell, t_m=ready.shell.t_m * change[0]),
            mass=ready.mass * change[1],
            friction=ready.friction * change[2],
        )
        return sg.pressure_for(changed).pressure / kPa

    one = jnp.ones(3)
    assert int(sg.pressure_for(ready).status) == Status.OK
    value, forward, reverse = jax.jit(lambda x: (needed(x), jax.jacfwd(needed)(x), jax.jacrev(needed)(x)))(one)
    np.testing.assert_allclose(forward, reverse, rtol=1e-10)
    step, program = 1e-5, jax.jit(jax.vmap(needed))
    ends = program(1 + step * np.concatenate([np.eye(3), -np.eye(3)]))
    np.testing.assert_allclose(forward, (ends[:3] - ends[3:]) / (2 * step), rtol=1e-5)
    # More weight needs more pressure; mass over friction is all that counts.
    assert forward[1] > 0
    assert float(forward[1] + forward[2]) == pytest.approx(0, abs=1e-8)
    assert 5 < float(value) < 30


def test_half_axes_of_an_even_pressure_on_an_ellipse():
    x, y = (v.ravel() for v in np.meshgrid(*(np.linspace(-2, 2, 801),) * 2, indexing="ij"))
    inside = (((x - 0.3) / 1.2) ** 2 + (y / 0.7) ** 2 < 1).astype(float)
    resting = Resting(jnp.stack([x, y, 0 * x], axis=1), jnp.asarray(inside), jnp.asarray(inside / inside.sum()))
    assert float(half_axis(resting, jnp.asarray(x), False)) == pytest.approx(1.2, rel=1e-3)
    assert float(half_axis(resting, jnp.asarray(y), True)) == pytest.approx(0.7, rel=1e-3)
    nothing = resting._replace(shares=jnp.zeros_like(resting.shares))
    assert float(jax.grad(lambda at: half_axis(nothing, at, True))(jnp.asarray(x))[0]) == 0


@pytest.mark.slow
def test_a_plane_that_leans_by_nothing_is_a_plane():
    """The same contact from two scenes, one of them without symmetry across."""
    square = shell(a=12 * mm, b=16 * mm)
    leaning = sg.shell.InclinedContact(square, distance=3 * mm, angle=0.0, model="energy")
    flat = sg.shell.FlatContact(square, distance=3 * mm, model="energy")
    one, two = (sg.solve(dataclasses.replace(s.prepared(), across=3, lengthwise=3), 20 * kPa) for s in (leaning, flat))
    np.testing.assert_allclose(one.force, two.force, rtol=1e-8)
    # The same second moments, once as those of an ellipse and once as those of a rectangle.
    ellipse = np.array([one.contact_width, one.contact_length]) / 2
    np.testing.assert_allclose([two.contact_half_width, two.contact_half_length], ellipse * np.sqrt(0.75), rtol=1e-6)


def test_a_sheet_is_drawn_no_thicker_next_to_its_clamp():
    """Under a leaning plane polynomials leave next to no area in a strip at the clamp, drawn 11 times as thick."""
    square = sg.FlatShell(a=16 * mm, b=16 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    leaning = sg.shell.InclinedContact(square, distance=5 * mm, angle=np.deg2rad(10), model="energy")
    solution = sg.solve(leaning, 15 * kPa)
    shape = {name: np.asarray(values) for name, values in solution.shape(301).items()}
    for across, up in (("x", "z"), ("y", "z_length")):
        lifted = shape[f"{up}_face"] - shape[up] + 0.55 * mm
        assert np.hypot(shape[f"{across}_face"] - shape[across], lifted).max() < 1.51 * 0.55 * mm


def test_half_sides_of_an_even_pressure_on_a_rectangle():
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-3, 3, 601), np.linspace(-0.5, 0.5, 101), indexing="ij"))
    even = np.full(len(x), 1 / len(x))
    resting = Resting(jnp.stack([x, y, 0 * x], axis=1), jnp.asarray(even), jnp.asarray(even))
    assert float(HALF_SIDE * half_axis(resting, jnp.asarray(x), True)) == pytest.approx(3, rel=1e-2)
    assert float(HALF_SIDE * half_axis(resting, jnp.asarray(y), True)) == pytest.approx(0.5, rel=2e-2)


def test_a_flat_contact_reaches_to_where_the_membrane_leaves_the_plane():
    """An integral along a line, as it once was, takes the waves of the pressure for edges: 17 % short at 10 kPa."""
    flat = sg.shell.FlatContact(shell(), distance=5 * mm, model="energy")
    aspect, wall = jnp.asarray(16 / 43), jnp.asarray(1.1 / 16)
    for pressure in (10 * kPa, 20 * kPa):
        found = sg.solve(flat, pressure)
        for axis, half in enumerate((found.contact_half_width, found.contact_half_length)):
            points = np.zeros((401, 2))
            points[:, axis] = np.linspace(0, 1, 401)
            e = found.scene.functional.deformed_at(found.unknowns, at_points(found.scene.grid, points))
            faces = 16 * mm * jax.vmap(lambda e, at: local(e, at, aspect).face(wall))(e, jnp.asarray(points))
            reach = np.max(np.asarray(faces)[np.asarray(faces[:, 2]) > 5 * mm - 0.044 * mm, axis])
            assert float(half) == pytest.approx(reach, rel=0.06)


@pytest.mark.slow
def test_a_known_scene_may_be_solved_under_jit():
    """Its symmetry is looked for in known numbers, though the pressure is traced."""
    plane = sg.shell.obstacles.Plane(5 * mm)
    scene = sg.shell.ObstacleContact(shell(), plane, across=2, lengthwise=2)
    found = jax.jit(lambda pressure: sg.solve(scene, pressure))(12 * kPa)
    assert found.scene.symmetry == "both"
    np.testing.assert_allclose(found.force, sg.solve(scene, 12 * kPa).force, rtol=1e-12)


def test_the_thesis_s_lever_is_for_ellipses():
    with pytest.raises(ValueError, match=r"Grasp\.lever is 'rim'; with model 'energy' there is only 'exact'"):
        grasp(lever="rim")
    with pytest.raises(ValueError, match=r"has no observable 'height'; it has: force, "):
        sg.pressure_for(grasp(), height=30 * mm)
    with pytest.raises(ValueError, match=r"needs Grasp\.mass > 0"):
        sg.pressure_for(grasp(mass=0.0))


class Ball(sg.shell.obstacles.Obstacle):
    """Over the middle, by a distance that is one or not."""

    kind: str = eqx.field(static=True, default="signed")

    def distance(self, place):
        off = place - jnp.array([0.0, 0.0, 25 * mm])
        signed = sg.shell.obstacles.length(off) - 20 * mm
        return {"signed": signed, "twice": 2 * signed, "level set": off @ off - (20 * mm) ** 2}[self.kind]


@pytest.mark.parametrize(("kind", "slope"), [("twice", "2"), ("level set", "0.04")])
def test_an_object_of_ones_own_has_a_signed_distance(kind, slope):
    """Contact pressed by a multiple of what it should, under OK."""
    assert sg.shell.ObstacleContact(shell(), Ball()).obstacle == Ball()
    with pytest.raises(InputError, match=rf"Ball.distance changes by {slope} m per metre at .* on its surface"):
        sg.shell.ObstacleContact(shell(), Ball(kind))


def level_set(place, gap):
    """Of a ball over the middle: its slope on the surface is 2 R."""
    off = place - jnp.stack([0.0 * gap, 0.0 * gap, gap + 20 * mm])
    return off @ off - (20 * mm) ** 2


def measured(place, factor):
    """Of the same ball, times a factor."""
    return factor * (sg.shell.obstacles.length(place - jnp.array([0.0, 0.0, 25 * mm])) - 20 * mm)


@pytest.mark.parametrize(
    ("function", "given", "slope"),
    [(measured, 2.0, "2"), (measured, jnp.asarray(0.5), "0.5"), (level_set, jnp.asarray(5 * mm), "0.04")],
)
def test_a_shape_has_a_signed_distance_too(function, given, slope):
    """Its class is of the package, and its function is not: half of the force, or twice as much, was OK."""
    Shape = sg.shell.obstacles.Shape
    assert sg.shell.ObstacleContact(shell(), Shape(measured, 1.0)).obstacle.parameters == 1.0
    with pytest.raises(InputError, match=rf"Shape\.function \({function.__name__}\) changes by {slope} m per metre"):
        sg.shell.ObstacleContact(shell(), Shape(function, given))


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda place, _: 5 * mm - place[2:], r"gives an array of the shape \(1,\); it must be one number"),
        (lambda place, _: None, "gives None; it must be one number"),
        (lambda place, _: np.linalg.norm(place), r"cannot be differentiated by JAX \(line \d+ of test_energy_c"),
        (
            lambda place, _: 0.0 if place[2] > 0 else 1.0,
            "cannot be .*; use jax.numpy in place of math and NumPy, and jnp.where in place of if",
        ),
        (lambda place: 5 * mm - place[2], "raises TypeError: .* takes 1 positional argument but 2 were given"),
    ],
)
def test_what_is_no_distance_is_one_sentence(function, said):
    with pytest.raises(InputError, match=rf"^Shape\.function \(<lambda>\) {said}"):
        sg.shell.ObstacleContact(shell(), sg.shell.obstacles.Shape(function))


def test_opposite_membranes_are_apart_by_their_outer_faces():
    """The cylinder stands off the outer face, so flat membranes keep all of gap + r; half a wall was taken off."""
    thick = sg.shell.Grasp(shell(t_m=3 * mm), radius=4 * mm, gap=5 * mm, model="energy").prepared()
    scene = dataclasses.replace(thick, **SMALL)
    apart = jax.jit(lambda unknowns: scene.margins_of_state(unknowns, jnp.asarray(5 * kPa))["membranes_apart"])
    assert float(apart(scene.unloaded_state())) == pytest.approx(9 * mm, rel=1e-12)
    bulged = scene.first_guess(jnp.asarray(1.0))
    crest = float(np.max(scene.profile(bulged, 5 * kPa, 2001)["z_length_face"]))
    assert float(apart(bulged)) == pytest.approx(9 * mm - crest, abs=0.02 * mm)
