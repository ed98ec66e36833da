"""Rules of parts and scenes: every margin against geometry written again in NumPy, its derivatives, its words.

The geometry here is brute: outlines as corners of boxes and points along lines, distances between them.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fingers import TYPE_A, pneunet

import softgrip_jax as sg
from softgrip_jax.reasons import Reason
from softgrip_jax.shell.obstacles import Cylinder as Rod
from softgrip_jax.shell.obstacles import Plane, Sphere
from softgrip_jax.units import gram, kPa, mm

OK, IMPOSSIBLE = int(sg.Status.OK), int(sg.Status.IMPOSSIBLE)
A = pneunet(TYPE_A)
CYLINDER = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
CONE = sg.objects.Cone(radius=26 * mm, height=45 * mm, mass=25 * gram, friction=0.96)


def finger(**changed):
    """Type A with some of its lengths changed, mm."""
    return dataclasses.replace(A, **{name: np.asarray(value) * mm for name, value in changed.items()})


def gripper(touch="face", n=3, base_radius=19.61, **changed):
    return sg.pneunet.Gripper(finger(**changed), n=n, base_radius=base_radius * mm, touch=touch)


# --- parts ------------------------------------------------------------------------------------------------------------

SCENES = {
    "free": lambda f: sg.pneunet.Free(f, weight=(0.0, 0.0), inclination="none"),
    "tip contact": sg.pneunet.TipContact,
    "grasp": lambda f: sg.pneunet.Grasp(sg.pneunet.Gripper(f), CYLINDER),
    "linear": sg.pneunet.Linear,
    "chamber": lambda f: sg.pneunet.Chamber(f, 0.0),
    "small strain": sg.pneunet.SmallStrainChamber,
}
BROKEN_PARTS = {
    "walls_fit": ({"t_m": 3.0}, -1.8, "two walls of a chamber are 1.8 mm too thick for its length"),
    "chamber_on_cover": ({"b": 20.0}, -20.0, "a chamber is 20 mm wider than the cover that carries it"),
    "one_segment": ({"L": 5.0}, -1.0, "the finger is 1 mm shorter than one segment"),
}


@pytest.mark.parametrize("scene", SCENES)
def test_parts_have_margins_in_every_scene_of_a_finger(scene):
    margins = SCENES[scene](A).margins_at_rest()
    by_hand = {"walls_fit": 4.2 - 2 * 1.1, "chamber_on_cover": 20 - 2 * 8, "one_segment": 77 - (2 * 0.9 + 4.2)}
    for name, margin in by_hand.items():
        np.testing.assert_allclose(margins[name] / mm, margin, rtol=1e-12)
    assert bool(SCENES[scene](A).can_exist())
    for rule, (changed, margin, _) in BROKEN_PARTS.items():
        broken = SCENES[scene](finger(**changed))
        np.testing.assert_allclose(broken.margins_at_rest()[rule] / mm, margin, rtol=1e-12)
        assert not bool(broken.can_exist())
        assert bool(dataclasses.replace(broken, ignored_rules=tuple(BROKEN_PARTS)).can_exist())


@pytest.mark.parametrize("rule", BROKEN_PARTS)
@pytest.mark.parametrize("scene", ["free", "linear", "chamber"])
def test_a_broken_part_is_impossible_in_words_and_may_be_ignored(scene, rule):
    changed, margin, words = BROKEN_PARTS[rule]
    broken = SCENES[scene](finger(**changed))
    solution = sg.solve(broken, 15 * kPa)
    assert (int(solution.status), Reason(int(solution.reason)).rule) == (IMPOSSIBLE, rule)
    assert solution.reason_text() == words
    np.testing.assert_allclose(solution.detail / mm, margin, rtol=1e-12)
    assert np.isnan(solution.end_moment)
    assert np.isnan(sg.limit_pressure(broken))
    ignoring = sg.solve(dataclasses.replace(broken, ignored_rules=(rule,)), 15 * kPa)
    assert (int(ignoring.status), int(ignoring.reason)) == (OK, 0)
    assert ignoring.end_moment > 0
    np.testing.assert_allclose(ignoring.margins[rule], solution.margins[rule], rtol=1e-15)


def test_of_a_nonuniform_finger_the_least_counts():
    f = finger(h_L=[4.2, 4.0, 4.4], t_m=[1.1, 1.3, 1.1], b=[8.0, 9.0, 8.5], h_x=[0.9, 0.8, 1.0])
    margins = sg.pneunet.Free(f).margins_at_rest()
    np.testing.assert_allclose(margins["walls_fit"] / mm, 4.0 - 2.6, rtol=1e-12)
    np.testing.assert_allclose(margins["chamber_on_cover"] / mm, 2.0, rtol=1e-12)
    np.testing.assert_allclose(margins["one_segment"] / mm, 77 - 6.4, rtol=1e-12)
    # Twenty segments of 6 mm squeezed onto 77 mm: each keeps 3.85 mm, of which the gap takes 1.8 mm.
    squeezed = sg.pneunet.Free(finger(t_m=np.full(20, 1.1)))
    np.testing.assert_allclose(squeezed.margins_at_rest()["walls_fit"] / mm, 77 / 20 - 1.8 - 2.2, rtol=1e-12)


def test_margins_of_parts_have_derivatives_on_both_sides_of_the_rule():
    def margins(t_m, b, h_x, h_L, B, L):
        f = dataclasses.replace(A, t_m=t_m, b=b, h_x=h_x, h_L=h_L, B=B, L=L)
        found = sg.solve(sg.pneunet.Linear(f), 15 * kPa).margins
        return jnp.stack([found[name] for name in BROKEN_PARTS])

    wanted = np.array([[-2, 0, 0, 1, 0, 0], [0, -2, 0, 0, 1, 0], [0, 0, -2, -1, 0, 1]])
    for dimensions in ([1.1, 8, 0.9, 4.2, 20, 77], [3.0, 20, 0.9, 4.2, 20, 5]):
        slopes = jax.jacrev(margins, argnums=range(6))(*np.array(dimensions) * mm)
        np.testing.assert_allclose(np.stack(slopes, axis=1), wanted, atol=1e-12)


def test_walls_of_a_chamber_that_lean_on_each_other():
    """theta_s < 0: the outer edges come nearer by 2a sin(theta_s) each."""
    solution = sg.solve(sg.pneunet.Chamber(A, -0.1), 15 * kPa)
    np.testing.assert_allclose(solution.margins["chambers_apart"] / mm, 2 * (0.9 - 10 * np.sin(0.1)), rtol=1e-12)
    assert Reason(int(solution.reason)) is Reason.CHAMBERS_APART
    assert sg.Status(int(solution.status)) is sg.Status.IMPOSSIBLE


# --- objects at rest --------------------------------------------------------------------------------------------------


def at_rest(scene):
    return {name: float(value) / mm for name, value in scene.margins_at_rest().items()}


def test_at_rest_fingers_stand_outside_of_the_object():
    margins = at_rest(sg.pneunet.Grasp(gripper(), CYLINDER))
    assert margins["clear_of_object_at_rest"] == pytest.approx(1.61)
    # The sides of a triangle around a circle of 19.61 mm are 67.93 mm long.
    assert margins["fingers_apart_at_rest"] == pytest.approx(2 * np.sqrt(3) * 19.61 - 20)
    assert at_rest(sg.pneunet.Grasp(gripper(n=2), CYLINDER))["fingers_apart_at_rest"] == pytest.approx(2 * 19.61)
    assert at_rest(sg.pneunet.Grasp(gripper(n=12), CYLINDER))["fingers_apart_at_rest"] < -9
    # The thesis's mid-lines touch: they stand on the same circle, the faces half a thickness further in.
    assert at_rest(sg.pneunet.Grasp(gripper("midline"), CYLINDER))["clear_of_object_at_rest"] == pytest.approx(1.61)
    # Where the offset itself is given, it says where the surface is: an offset outwards is inside the cover.
    given = sg.pneunet.Grasp(gripper(), CYLINDER, tip_offset=0.5 * mm)
    assert at_rest(given)["clear_of_object_at_rest"] == pytest.approx(-0.5)


def test_at_rest_beside_an_object_that_tapers():
    """The widest place beside the finger is the lowest, at its tip: here 18 mm above the base of the cone."""
    margins = at_rest(sg.pneunet.Grasp(gripper(), CONE, stand_distance=95 * mm))
    heights = 95 - np.linspace(0, 77, 1001)
    radii = np.where(heights <= 45, 26 * (1 - heights / 45), 0.0)
    assert margins["clear_of_object_at_rest"] == pytest.approx(19.61 - radii.max())
    assert margins["clear_of_palm"] == pytest.approx(95 - 45)
    assert margins["clear_of_ground"] == pytest.approx(95 - 77)
    assert at_rest(sg.pneunet.Grasp(gripper(), CONE, stand_distance=40 * mm))["clear_of_palm"] == pytest.approx(-5)
    assert at_rest(sg.pneunet.Grasp(gripper(), CONE, stand_distance=70 * mm))["clear_of_ground"] == pytest.approx(-7)


def test_an_obstacle_inside_the_flat_membrane():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))

    def margin(obstacle):
        scene = sg.shell.ObstacleContact(shell, obstacle, across=2, lengthwise=2)
        return scene, float(scene.margins_at_rest()["membrane_clear_at_rest"]) / mm

    assert margin(Sphere(20 * mm, 3 * mm))[1] == pytest.approx(3)
    assert margin(Rod(20 * mm, 3 * mm))[1] == pytest.approx(3)
    # A plane that falls by 16 tan(0.1) towards one edge; nearest along its normal.
    assert margin(Plane(2 * mm, tilt_y=0.1))[1] == pytest.approx(2 * np.cos(0.1) - 16 * np.sin(0.1))
    # A rod along the membrane whose axis falls: at the edge its surface is lower by 43 sin(incline).
    tilted, clear = margin(Rod(20 * mm, 3 * mm, heading=np.pi / 2, incline=0.1))
    axis_height = 23 - 43 * np.tan(0.1)
    assert clear == pytest.approx(axis_height * np.cos(0.1) - 20)
    solution = sg.solve(tilted, 5 * kPa)
    assert sg.Status(int(solution.status)) is sg.Status.IMPOSSIBLE
    assert solution.reason_text() == f"the flat membrane is {-clear:.4g} mm inside the object at rest"
