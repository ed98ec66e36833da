"""Rules of parts and scenes: every margin against geometry written again in NumPy, its derivatives, its words.

The geometry here is brute: outlines as corners of boxes and points along lines, distances between them.
"""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_beam as ref
from conftest import ROOT
from fingers import TYPE_A, TYPES, pneunet, stacked
from helpers import shell
from typer.testing import CliRunner

import softgrip_jax as sg
from optim.design.descent import search
from optim.problem import Goal, Problem
from optim.space import Space, Variable
from softgrip_jax import plots
from softgrip_jax.cad.finger_parts import chambers_of as moulded_chambers
from softgrip_jax.cli import NO_ANSWER, app, run
from softgrip_jax.errors import InputError
from softgrip_jax.geometry.finger import chamber_places
from softgrip_jax.pneunet.rules import after_chambers
from softgrip_jax.quantities import Quantity, QuantitySet, all_rules
from softgrip_jax.reasons import BROKEN, FIRST_RULE, Reason
from softgrip_jax.scene import with_rules
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
    by_hand |= {"wall_law_range": 2.5 - 1.1, "mould_range": 4.2 - 2 * 1.1 - 1}
    for name, margin in by_hand.items():
        np.testing.assert_allclose(margins[name] / mm, margin, rtol=1e-12)
    for changed, rule, margin in (
        ({"a": 9.0}, "wall_law_range", -1.0),
        ({"a": 2.0}, "wall_law_range", -0.1),
        ({"t_m": 1.7}, "mould_range", -0.2),
        ({"b": 9.8}, "mould_range", -0.3),
    ):
        beyond = SCENES[scene](finger(**changed))
        np.testing.assert_allclose(beyond.margins_at_rest()[rule] / mm, margin, rtol=1e-9)
        assert bool(beyond.can_exist())  # nothing forbids it; searches keep away
    assert bool(SCENES[scene](A).can_exist())
    for rule, (changed, margin, _) in BROKEN_PARTS.items():
        broken = SCENES[scene](finger(**changed))
        np.testing.assert_allclose(broken.margins_at_rest()[rule] / mm, margin, rtol=1e-12)
        assert not bool(broken.can_exist())
        assert bool(dataclasses.replace(broken, ignored_rules=tuple(BROKEN_PARTS)).can_exist())


def test_what_cannot_be_moulded_has_an_answer_and_a_remark(tmp_path):
    path = tmp_path / "thin.toml"
    path.write_text(
        '[scene]\ntype = "pneunet.Linear"\n[scene.finger]\npreset = "table_5_1_A"\nh_L_mm = 2.5\na_mm = 9\n'
    )
    done = CliRunner().invoke(app, ["solve", str(path), "--pressure-kPa", "5"])
    said = " ".join(done.stdout.split())
    assert done.exit_code == 0
    assert "A chamber's wall is 1 mm too high for its width or too thick for its height" in said
    assert (
        "What is left of a chamber's air or side walls is 0.7 mm less than a mould and liquid silicone can do" in said
    )


@pytest.mark.parametrize(
    "scene",
    [
        sg.pneunet.Linear(A),
        pytest.param(sg.pneunet.TipContact(A, inclination="none", points=6), marks=pytest.mark.slow),
        pytest.param(
            sg.pneunet.TipContact(A, drive="small_strain", inclination="none", points=6), marks=pytest.mark.slow
        ),
    ],
    ids=["linear", "thesis", "small_strain"],
)
def test_a_search_keeps_air_and_side_walls(scene):
    """It would take all of both: a wider and longer chamber pushes more."""
    bounds = {"b": (5, 15), "h_L": (1, 8), "a": (2, 12), "t_m": (0.5, 3)}
    space = Space({"held": scene}, [Variable(f"finger.{k}", *(v * mm for v in ends)) for k, ends in bounds.items()])
    problem = Problem(space, [Goal("maximise", Quantity("tip_force", 3 * kPa))])
    kept = [rule.rule for rule in problem.rules]
    assert {"wall_law_range", "mould_range"} <= set(kept)
    best = search(problem, starts=8, steps=30, finishes=1).best
    assert best.feasible
    a, b, t_m, h_L = (best.x[space.names.index(f"finger.{name}")] / mm for name in ("a", "b", "t_m", "h_L"))
    assert h_L - 2 * t_m > 1 - 1e-3
    assert 0.5 * 20 - b > 0.5 - 1e-3
    assert b - a > -1e-3
    assert 0.5 * a - t_m > -1e-3


@pytest.mark.parametrize("model", ["arc", pytest.param("energy", marks=pytest.mark.slow)])
def test_membranes_of_opposite_shells_stay_on_their_sides(model):
    made = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))

    def held(radius, fingers=2):
        return sg.shell.Grasp(made, radius=radius, gap=3 * mm, friction=0.96, model=model, fingers=fingers)

    @jax.jit
    def with_slope(radius):

        def margin(radius):
            found = sg.solve(held(radius), 12 * kPa)
            return found.margins["membranes_apart"], found

        (_, found), slope = jax.value_and_grad(margin, has_aux=True)(radius)
        return found, slope

    (thin, _), (thick, slope) = with_slope(3 * mm), with_slope(20 * mm)
    assert Reason(int(thin.reason)) is Reason.MEMBRANES_APART
    assert "pass through each other beside the cylinder: each is" in thin.reason_text()
    assert int(thick.status) == OK
    passing = sg.solve(dataclasses.replace(held(3 * mm), ignored_rules=("membranes_apart",)), 12 * kPa)
    for found, middle in ((passing, 6 * mm), (thick, 23 * mm)):
        shape = found.shape(4001)
        crest = np.max(np.asarray(shape["z_length"] if "z_length" in shape else shape["z"]))
        assert float(found.margins["membranes_apart"]) == pytest.approx(middle - crest, abs=0.7 * mm)
    assert float(thin.margins["membranes_apart"]) == pytest.approx(float(passing.margins["membranes_apart"]), rel=1e-9)
    if model == "arc":
        assert float(thick.margins["membranes_apart"]) == pytest.approx(23 * mm - crest, abs=1e-3 * mm)
    alone = sg.solve(held(3 * mm, fingers=1), 12 * kPa)
    assert int(alone.status) == OK
    assert "membranes_apart" not in alone.margins
    ends = [float(with_slope(20 * mm + step)[0].margins["membranes_apart"]) for step in (-1e-6, 1e-6)]
    assert float(slope) == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-5)


@pytest.mark.parametrize("rule", BROKEN_PARTS)
@pytest.mark.parametrize("scene", [pytest.param("free", marks=pytest.mark.slow), "linear", "chamber"])
def test_a_broken_part_is_impossible_in_words_and_may_be_ignored(scene, rule):
    changed, margin, words = BROKEN_PARTS[rule]
    broken = SCENES[scene](finger(**changed))
    solution = sg.solve(broken, 15 * kPa)
    assert (int(solution.status), Reason(int(solution.reason)).rule) == (IMPOSSIBLE, rule)
    assert solution.reason_text() == words
    np.testing.assert_allclose(solution.detail / mm, margin, rtol=1e-12)
    assert np.isnan(solution.end_moment)
    assert np.isnan(sg.limit_pressure(broken))
    # Each choice of rules is a program of its own: one by one they are ignored in the cheapest scene alone.
    ignored = (rule,) if scene == "linear" else tuple(BROKEN_PARTS)
    ignoring = sg.solve(dataclasses.replace(broken, ignored_rules=ignored), 15 * kPa)
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

    reverse = jax.jit(jax.jacrev(margins, argnums=range(6)))
    wanted = np.array([[-2, 0, 0, 1, 0, 0], [0, -2, 0, 0, 1, 0], [0, 0, -2, -1, 0, 1]])
    for dimensions in ([1.1, 8, 0.9, 4.2, 20, 77], [3.0, 20, 0.9, 4.2, 20, 5]):
        slopes = reverse(*np.array(dimensions) * mm)
        np.testing.assert_allclose(np.stack(slopes, axis=1), wanted, atol=1e-12)


@pytest.mark.parametrize("scene", ["linear", "chamber", "free"])
def test_no_random_finger_under_ok_breaks_a_rule(scene):
    """Dimensions over a decade around type A: about half of them do not fit together."""
    random = np.random.default_rng(0)
    names = ("a", "b", "h_x", "t_m", "h_L", "H", "B", "L")
    spread = {name: np.exp(random.uniform(-1.2, 1.2, 400)) * TYPE_A[name] * mm for name in names}
    fingers = sg.PneuNet(**spread, material=sg.NeoHookean(mu=np.full(400, 136 * kPa)))
    one = jax.jit(jax.vmap(lambda f: sg.solve(SCENES[scene](f), 15 * kPa)))
    found = one(fingers)
    f = {name: value / mm for name, value in spread.items()}
    least = np.minimum(f["h_L"] - 2 * f["t_m"], f["B"] - 2 * f["b"])
    least = np.minimum(least, f["L"] - 2 * f["h_x"] - f["h_L"])
    status, reason = np.asarray(found.status), np.asarray(found.reason)
    assert 100 < np.sum(least < 0) < 300
    np.testing.assert_array_equal(status == IMPOSSIBLE, least < 0)
    np.testing.assert_array_equal(reason >= FIRST_RULE, least < 0)
    np.testing.assert_allclose(np.asarray(found.detail)[least < 0] / mm, least[least < 0], rtol=1e-9)


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
    assert margins["clear_of_ground_at_rest"] == pytest.approx(95 - 77)
    assert at_rest(sg.pneunet.Grasp(gripper(), CONE, stand_distance=40 * mm))["clear_of_palm"] == pytest.approx(-5)
    low = at_rest(sg.pneunet.Grasp(gripper(), CONE, stand_distance=70 * mm))
    assert low["clear_of_ground_at_rest"] == pytest.approx(-7)


def test_an_obstacle_inside_the_flat_membrane():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))

    @jax.jit
    def clearance(scene):
        return scene.margins_at_rest()["membrane_clear_at_rest"]

    def margin(obstacle):
        scene = sg.shell.ObstacleContact(shell, obstacle, across=2, lengthwise=2)
        return scene, float(clearance(scene)) / mm

    assert margin(Sphere(20 * mm, 3 * mm))[1] == pytest.approx(3)
    assert margin(Rod(20 * mm, 3 * mm))[1] == pytest.approx(3)
    # A plane that falls by 16 tan(0.1) towards one edge; nearest along its normal.
    assert margin(Plane(2 * mm, tilt_y=0.1))[1] == pytest.approx(2 * np.cos(0.1) - 16 * np.sin(0.1))
    # A thin rod between the points of a grid: it falls along the membrane, and is lowest where the membrane ends.
    thin = Rod(1 * mm, 1 * mm, heading=np.pi / 2, incline=np.pi / 6)
    lying, clear = margin(thin)
    assert clear == pytest.approx(-1, abs=1e-3)  # its axis meets the plane of the membrane
    assert float(jax.jit(jax.grad(clearance))(lying).obstacle.radius) == pytest.approx(-1, abs=0.9)
    # A rod along the membrane whose axis falls: at the edge its surface is lower by 43 sin(incline).
    tilted, clear = margin(Rod(20 * mm, 3 * mm, heading=np.pi / 2, incline=0.1))
    axis_height = 23 - 43 * np.tan(0.1)
    assert clear == pytest.approx(axis_height * np.cos(0.1) - 20)
    solution = sg.solve(tilted, 5 * kPa)
    assert sg.Status(int(solution.status)) is sg.Status.IMPOSSIBLE
    assert solution.reason_text() == f"the flat membrane is {-clear:.4g} mm inside the object at rest"


def test_a_membrane_that_bulges_back_through_its_clamp():
    """A long shell of a material that stiffens: two bulges at its ends push the middle down, and it was OK so."""
    wall = sg.FlatShell(a=19 * mm, b=55 * mm, t_m=0.76 * mm, material=sg.Gent(mu=170 * kPa, j_m=40.0))
    scene = sg.shell.Free(wall, model="energy", bending=False)
    seen = sg.path(scene, np.array([5, 10, 20, 30]) * kPa)
    margins = np.asarray(seen.margins["membrane_above_clamp"]) / mm
    assert np.all(margins[:2] > 0.3)
    assert np.all(margins[2:] < -1)
    assert list(seen.status) == [sg.Status.OK, sg.Status.OK, sg.Status.IMPOSSIBLE, sg.Status.IMPOSSIBLE]
    assert np.all(np.isnan(seen.inflation[2:]))
    text = f"the membrane bulges {-margins[3]:.4g} mm too far back through the plane of its clamp"
    assert seen[3].reason_text() == text
    ignored = dataclasses.replace(scene, ignored_rules=("membrane_above_clamp",))
    assert sg.solve(ignored, 30 * kPa).inflation < 0


def test_a_height_below_the_flat_membrane_is_said():
    """The parts were blamed."""
    found = sg.pressure_for(sg.shell.Free(shell()), inflation=-1 * mm)
    assert int(found.status) == sg.Status.IMPOSSIBLE
    assert "it is passed already at 0 kPa" in found.reason_text()


# --- bent states ------------------------------------------------------------------------------------------------------

FINE = 2001
"""Points along a finger from which outlines are built."""


class Outline:
    """The bent finger of a solution in mm: its line, as finely as `shape` gives it, without stretch of the pitch."""

    def __init__(self, solution):
        # States that a rule forbids are drawn, too: that the rule is right is what is asked.
        solution = dataclasses.replace(solution, status=jnp.zeros_like(solution.status))
        self.shape = {name: np.asarray(value) for name, value in solution.shape(FINE).items()}
        self.X, self.x, self.y = (self.shape[name] / mm for name in ("X", "x", "y"))

    def at(self, X):
        """Centre and directions (along, across) of the section at X."""
        x, y, theta = (np.interp(X, self.X, values) for values in (self.x, self.y, self.shape["theta"]))
        return np.array([x, y]), np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])

    def corner(self, X, along, across):
        centre, tangent, normal = self.at(X)
        return centre + along * tangent + across * normal

    def gap(self, X, f):
        """Distance between the tops of two boxes whose neighbouring faces are h_x from the section at X each, along
        the direction of that section."""
        pitch, top = 2 * f["h_x"] + f["h_L"], f["H"] / 2 + 2 * f["a"]
        before = self.corner(X - pitch / 2, f["h_L"] / 2, top)
        after = self.corner(X + pitch / 2, -f["h_L"] / 2, top)
        return (after - before) @ self.at(X)[1]


def chambers_apart(solution, f):
    outline, pitch = Outline(solution), 2 * f["h_x"] + f["h_L"]
    return min(outline.gap(X, f) for X in np.linspace(pitch, f["L"] - pitch, 60))


STEP = 1e-4
MOVED = np.concatenate([np.zeros((1, 4)), STEP * np.eye(4), -STEP * np.eye(4)])
"""Relative changes of h_x, a, H and the pressure, for differences."""
CASES = [(kind, p, np.zeros(4)) for kind in TYPES for p in (20.0, 31.0)]
CASES += [("A", p, change) for p in (25.0, 35.0) for change in MOVED]


@pytest.fixture(scope="module")
def held():
    """((margin, solution), slopes of the margin) of blocked fingers of table 5.1, some of which lean into each other:
    margins in mm by relative changes."""

    def margin(change, scene, pressure):
        f = scene.finger
        f = dataclasses.replace(f, h_x=f.h_x * (1 + change[0]), a=f.a * (1 + change[1]), H=f.H * (1 + change[2]))
        solution = sg.solve(dataclasses.replace(scene, finger=f), pressure * (1 + change[3]))
        return solution.margins["chambers_apart"] / mm, solution

    changes = jnp.asarray(np.array([change for *_, change in CASES]))
    scenes = stacked([sg.pneunet.TipContact(pneunet(TYPES[kind])) for kind, *_ in CASES])
    pressures = jnp.array([p for _, p, _ in CASES]) * kPa
    return jax.jit(jax.vmap(jax.value_and_grad(margin, has_aux=True)))(changes, scenes, pressures)


@pytest.mark.slow
def test_chambers_of_blocked_fingers_by_their_corners(held):
    (margin, solutions), _ = held
    for k, (kind, _, change) in enumerate(CASES):
        if np.any(change):
            continue
        one = jax.tree.map(lambda value, k=k: value[k], solutions)
        # The turn is taken from the curvature in the middle, and the stretch of the cover, 0.5 %, is left out.
        np.testing.assert_allclose(margin[k], chambers_apart(one, TYPES[kind]), atol=0.06)
    broken = np.asarray(margin) * mm < -BROKEN
    assert [case[:2] for case, out in zip(CASES[:8], broken[:8], strict=True) if out] == [("C", 31.0)]
    np.testing.assert_array_equal(solutions.status, np.where(broken, IMPOSSIBLE, OK))
    np.testing.assert_array_equal(np.asarray(solutions.reason)[broken], int(Reason.CHAMBERS_APART))
    np.testing.assert_allclose(np.asarray(solutions.detail)[broken] / mm, np.asarray(margin)[broken], rtol=1e-12)
    assert solutions.reason_text()[5].startswith("neighbouring chambers overlap by 0.0")
    np.testing.assert_array_equal(np.isnan(solutions.tip_force), broken)


def test_the_margin_of_a_state_has_derivatives_where_it_is_broken(held):
    (margin, solutions), slopes = held
    assert set(all_rules(sg.pneunet.TipContact(A))) == set(solutions.margins)
    for first, status in ((8, OK), (17, IMPOSSIBLE)):
        assert int(solutions.status[first]) == status
        more, less = margin[first + 1 : first + 5], margin[first + 5 : first + 9]
        np.testing.assert_allclose(slopes[first], (more - less) / (2 * STEP), rtol=1e-5)


def grasped(solution, scene):
    """Margins of a grasp from outlines: (of the object, of the palm, of the fingers beside each other), mm."""
    outline, f = Outline(solution), TYPE_A
    gripper, depth = scene.gripper, f["H"] / 2 if scene.gripper.touch == "face" else 0.0
    centre = float(gripper.base_radius) / mm + depth
    face = np.array([outline.corner(X, 0.0, -depth) for X in outline.X])
    stand = np.inf if scene.stand_distance is None else float(scene.stand_distance) / mm
    if np.isinf(stand):
        wide = np.full(FINE, float(scene.object.radius) / mm)
    else:
        wide = 26 * (1 - np.maximum(stand - face[:, 0], 0) / 45)
    clear = centre + face[:, 1] - wide
    lean = outline.corner((2 * f["h_x"] + f["h_L"]) / 2, -f["h_L"] / 2, f["H"] / 2 + 2 * f["a"])[0]
    n = gripper.n
    corners = [2 * np.tan(np.pi / n) * (centre + y) - f["B"] for y in face[:, 1]]
    return clear, lean, min(corners)


def held_by_scipy(touch):
    """(force in N, place, theta) of the tip of type A on the cylinder at 28 kPa by SciPy: the offset follows from the
    tip's angle, which follows from the offset."""
    moment, theta = ref.end_moment(TYPE_A, 0.028), 0.0
    for _ in range(6 if touch == "face" else 1):
        corner = 0.5 * TYPE_A["H"] * (1 - np.cos(theta)) if touch == "face" else 0.0
        offset = 18 - 19.61 - corner
        _, force, end = ref.held_tip(TYPE_A, "exact", [(77.0, moment)], offset, 26e-3 * 9.81 / 3, (2e-3, 0.0))
        theta = end[0]
    return force, end[2:], theta


def check_grasp(solution, scene, touch):
    assert int(solution.status) == OK, solution.reason_text()
    clear, lean, beside = grasped(solution, scene)
    # The end of the line that touches is on the surface, all the rest outside of it.
    assert clear[-1] == pytest.approx(0, abs=1e-9)
    assert clear[:-1].min() > 0
    # At the last Gauss point, 0.5 % of the length before the tip.
    last = np.interp(77 * (1 - 0.0053), np.linspace(0, 77, FINE), clear)
    np.testing.assert_allclose(solution.margins["clear_of_object"] / mm, last, rtol=1e-3)
    # The stretch of the cover, 0.6 % of 3 mm, is left out.
    np.testing.assert_allclose(solution.margins["clear_of_clamp"] / mm, lean, atol=0.02)
    np.testing.assert_allclose(solution.margins["fingers_apart"] / mm, beside, rtol=1e-6)
    force, tip, theta = held_by_scipy(touch)
    np.testing.assert_allclose(solution.tip_force, force, rtol=1e-6)
    np.testing.assert_allclose(solution.tip / mm, tip, atol=1e-5)
    np.testing.assert_allclose(solution.tip_angle, abs(theta), rtol=1e-6)


@pytest.mark.slow
def test_grasps_by_their_outlines_and_by_scipy():
    """Fingers of radius 19.61 mm around 36 mm; around 60 mm; three fingers 20 mm wide around 8 mm."""
    scenes = [
        sg.pneunet.Grasp(gripper(), dataclasses.replace(CYLINDER, radius=jnp.asarray(radius * mm)))
        for radius in (18.0, 30.0, 4.0)
    ]
    solutions = jax.jit(jax.vmap(sg.solve, in_axes=(0, None)))(stacked(scenes), 28 * kPa)
    check_grasp(jax.tree.map(lambda value: value[0], solutions), scenes[0], "face")
    np.testing.assert_array_equal(solutions.status, [OK, IMPOSSIBLE, IMPOSSIBLE])
    assert solutions.reason_text()[1] == "the cover is 10.39 mm inside the object at rest"
    assert [Reason(int(r)).rule for r in solutions.reason] == [None, "clear_of_object_at_rest", "fingers_apart"]
    np.testing.assert_allclose(solutions.detail[2] / mm, 8 * np.sqrt(3) - 20, rtol=1e-6)


@pytest.mark.slow
def test_a_grasp_with_the_mid_line():
    scene = sg.pneunet.Grasp(gripper("midline"), CYLINDER)
    check_grasp(sg.solve(scene, 28 * kPa), scene, "midline")


def test_the_end_of_the_face_is_on_the_cone():
    """Wherever the tip is and however it is turned; the corner of the band that is drawn is the end of the face."""
    scene = sg.pneunet.Grasp(gripper(), CONE, stand_distance=95 * mm)
    for x, theta in ((75.0, -0.1), (70.0, -0.6), (72.0, 0.2)):
        y = float(scene.offset_at(jnp.asarray(x * mm), jnp.asarray(theta))) / mm
        line = {"x": np.array([x]), "y": np.array([y]), "theta": np.array([theta])}
        corner = plots.finger.band(line, 5.0)[1]
        from_axis = 19.61 + 2.5 + corner[1]
        assert from_axis == pytest.approx(26 * (1 - (95 - corner[0]) / 45))
        np.testing.assert_allclose(plots.finger.touching_point(scene, line), corner, rtol=1e-12)


@pytest.mark.slow
def test_a_grasp_of_a_cone_touches_with_the_face():
    scene = sg.pneunet.Grasp(gripper(), CONE, stand_distance=95 * mm)
    solution = sg.solve(scene, 25 * kPa)
    assert int(solution.status) == OK, solution.reason_text()
    assert set(all_rules(scene)) == set(solution.margins)
    clear, *_ = grasped(solution, scene)
    assert clear[-1] == pytest.approx(0, abs=1e-8)
    assert np.min(clear[:-1]) >= -1e-3


def standing(grip, radius, stand=1000.0, **options):
    """A grasp of an upright object of a radius, mm, whose foot is that far from the palm: all of one program."""
    held = dataclasses.replace(CYLINDER, radius=jnp.asarray(radius * mm))
    return sg.pneunet.Grasp(grip, held, stand_distance=stand * mm, **options)


TURNED = standing(gripper(base_radius=30), 6.0)
"""Tips that come from far turn far before they touch."""


def test_a_tip_that_turns_past_the_face_is_impossible():
    """The edge of the end that is on the side of the chambers, H from the one that touches, would be in the object."""
    beyond, before = sg.solve(TURNED, 35 * kPa), sg.solve(TURNED, 31 * kPa)
    outline = Outline(beyond)
    assert 90 < np.rad2deg(np.abs(outline.shape["theta"][-1])) < 110
    assert int(before.status) == OK
    assert 85 < np.rad2deg(float(before.tip_angle)) < 90
    assert np.abs(Outline(before).shape["theta"][-1]) == pytest.approx(float(before.tip_angle), rel=1e-6)
    inside = 32.5 + outline.corner(77.0, 0.0, 2.5)[1] - 6
    assert beyond.margins["clear_of_object"] / mm == pytest.approx(inside, abs=2e-3)
    assert Reason(int(beyond.reason)) is Reason.CLEAR_OF_OBJECT
    assert float(beyond.detail) / mm == pytest.approx(inside, abs=2e-3)


@pytest.mark.slow
def test_a_tip_whose_mid_line_touches_is_not_turned_past_the_face_either():
    scene = dataclasses.replace(TURNED, gripper=gripper("midline", base_radius=30), ignored_rules=("clear_of_object",))
    found = sg.solve(scene, 37 * kPa)
    assert found.tip_angle > np.pi / 2
    inside = 30 + Outline(found).corner(77.0, 0.0, 2.5)[1] - 6
    assert found.margins["clear_of_object"] / mm == pytest.approx(inside, abs=2e-3)


def test_where_the_tips_touch_by_their_offset_is_the_object_s_face():
    """The same state, whether its place follows from a radius or is given; the radius itself plays no part then."""
    by_radius = sg.solve(TURNED, 35 * kPa)
    given = dataclasses.replace(TURNED, object=CYLINDER, tip_offset=Outline(by_radius).y[-1] * mm)
    found = sg.solve(given, 35 * kPa)
    assert Reason(int(found.reason)) is Reason.CLEAR_OF_OBJECT
    np.testing.assert_allclose(found.margins["clear_of_object"], by_radius.margins["clear_of_object"], rtol=1e-6)
    assert int(sg.solve(dataclasses.replace(given, tip_offset=-24 * mm), 31 * kPa).status) == OK


def test_a_leaning_face_is_known_without_a_height():
    """Where the tips touch by their offset only differences count: 26 mm in 45 mm of height."""
    x = jnp.asarray([60.0, 72.0]) * mm
    for scene in (
        sg.pneunet.Grasp(gripper(), CONE, tip_offset=-5 * mm),
        sg.pneunet.Grasp(gripper(), CONE, stand_distance=95 * mm),
    ):
        assert np.diff(scene.face_at(x))[0] / mm == pytest.approx(12 * 26 / 45, rel=1e-12)


def test_chambers_of_bent_fingers_stay_above_the_ground():
    """At rest they stand beside the fingers, higher than the tips; bent, the last one is lower than its tip."""
    whole = sg.pneunet.Gripper(finger(L=78), base_radius=19.61 * mm)
    found = sg.solve(standing(whole, 10.0, 95.0), 25 * kPa)
    outline = Outline(found)
    # Behind 13 whole chambers half a gap is bare.
    tops = max(outline.corner(X, 0.0, 12.5)[0] for X in (*outline.X[outline.X < 77.1], 77.1))
    assert tops > 77
    for length, bare in ((72.5, 1.15), (72.0, 0.9), (75.0, 2.4), (77.0, 3.4), (77.8, 3.8), (78.0, 0.9)):
        assert float(after_chambers(finger(L=length))) / mm == pytest.approx(bare)
        last = chamber_places(finger(L=length))[-1]
        assert length - last.last == pytest.approx(bare)
    listed = finger(h_x=[0.9, 0.9, 0.8, 1.0], L=24.8)
    assert float(after_chambers(listed)) / mm == pytest.approx(24.8 - chamber_places(listed)[-1].last)
    assert found.margins["clear_of_ground"] / mm == pytest.approx(95 - tops, abs=0.02)
    low = sg.solve(standing(whole, 10.0, tops - 0.5), 25 * kPa)
    assert Reason(int(low.reason)) is Reason.CLEAR_OF_GROUND
    assert low.margins["clear_of_ground_at_rest"] > 0
    assert low.reason_text() == "the bent fingers reach 0.5 mm below the plane that the object stands on"


def test_free_fingers_curl_by_one_turn_at_most_where_a_search_may_choose():
    """A state beyond has its answer, with a remark: a real finger passes beside itself."""
    scene = sg.pneunet.Free(A, weight=None, inclination="none", section="inextensible")
    steps = 20 * kPa, 45 * kPa

    @jax.jit
    def with_slopes(pressure):

        def asked(pressure):
            found = sg.solve(scene, pressure)
            return (found.margins["one_turn"], found.tip_angle), found

        return jax.jacrev(asked, has_aux=True)(pressure)

    for pressure in steps:
        (slope, turning), found = with_slopes(pressure)
        assert int(found.status) == OK
        turn = float(found.tip_angle)
        assert found.margins["one_turn"] / mm == pytest.approx(77 * (1 - turn / (2 * np.pi)), rel=1e-12)
    assert turn > 2 * np.pi
    assert float(slope) == pytest.approx(-77 * mm / (2 * np.pi) * float(turning), rel=1e-10)
    problem = Problem(
        Space({"free": scene}, [Variable("finger.t_m", 0.7 * mm, 1.6 * mm)]),
        [Goal("maximise", Quantity("tip_angle", steps[1]))],
    )
    assert "one_turn" in {rule.rule for rule in problem.rules}
    best = search(problem, starts=4, steps=30, finishes=2).best
    assert best.feasible
    assert best.values[0] == pytest.approx(2 * np.pi, rel=1e-5)


@pytest.mark.parametrize("count", [2, pytest.param(12, marks=pytest.mark.slow)])
def test_chambers_of_one_segment_are_asked_like_those_of_a_uniform_finger(count):
    """Two segments of six chambers each had one gap alone, between the two."""
    short = finger(h_x=0.75, t_m=1.5, h_L=4.5, L=72)
    uniform = sg.solve(standing(sg.pneunet.Gripper(short, base_radius=19.61 * mm), 18.0), 30 * kPa)
    whole = chambers_apart(uniform, TYPE_A | {"h_x": 0.75, "h_L": 4.5, "L": 72.0})
    listed = dataclasses.replace(short, h_x=np.full(count, 0.75 * mm))
    assert len(chamber_places(listed)) == 12
    found = sg.solve(standing(sg.pneunet.Gripper(listed, base_radius=19.61 * mm), 18.0), 30 * kPa)
    assert int(found.status) == int(uniform.status) == OK
    np.testing.assert_allclose(found.tip_force, uniform.tip_force, rtol=1e-6)
    np.testing.assert_allclose(found.margins["chambers_apart"] / mm, whole, atol=0.06)
    np.testing.assert_allclose(found.margins["chambers_apart"], uniform.margins["chambers_apart"], atol=0.04 * mm)


def test_chambers_of_segments_stand_where_a_mould_has_them():
    """In pictures, and for the palm: the first one of a long segment is far from it."""
    # Only the gaps are listed: a finger of two segments is a program of the test above.
    long = finger(h_x=[1.0, 1.0], h_L=18.0)
    for made in (
        long,
        finger(h_x=[1.0, 1.0], h_L=[18.0, 18.0]),
        finger(h_x=np.full(12, 0.9)),
        finger(h_x=np.full(3, 0.9)),
    ):
        moulded = [(one.start, one.end) for one in moulded_chambers(made)]
        np.testing.assert_allclose([(one.first, one.last) for one in chamber_places(made)], moulded, rtol=1e-12)
    found = sg.solve(standing(sg.pneunet.Gripper(long, base_radius=19.61 * mm), 19.0), 40 * kPa)
    assert int(found.status) == OK, found.reason_text()
    lean = Outline(found).corner(19.25, -9.0, 12.5)[0]
    assert found.margins["clear_of_clamp"] / mm == pytest.approx(lean, abs=0.1)


@pytest.mark.parametrize(
    ("at", "sentence"),
    [
        ("required", r"pressure_for\(TipContact\) needs a target"),
        (("nonsense", 0.1), "TipContact has no observable 'nonsense'"),
        (("tip", 0.1), "tip is a point"),
    ],
)
def test_a_margin_in_a_state_that_cannot_be_sought(at, sentence):
    scenes = {"held": sg.pneunet.TipContact(A)}
    with pytest.raises(InputError, match=sentence):
        QuantitySet(scenes, [Quantity("margins.chambers_apart", at, "held")])


# --- what people and programs read ------------------------------------------------------------------------------------


def test_solve_says_which_rule_is_broken_and_which_is_nearest(tmp_path, capsys):
    text = (ROOT / "configs" / "finger_linear.toml").read_text()
    kept, broken = tmp_path / "kept.toml", tmp_path / "broken.toml"
    kept.write_text(text)
    broken.write_text(text.replace('preset = "table_5_1_A"', 'preset = "table_5_1_A"\nt_m_mm = 3'))
    assert run(["solve", str(kept), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["reason"], found["margins"]["walls_fit"]) == ("solved", pytest.approx(2 * mm))
    assert run(["solve", str(kept)]) == 0
    assert "walls_fit: 2 mm" in capsys.readouterr().out
    assert run(["solve", str(broken), "--json"]) == NO_ANSWER
    found = json.loads(capsys.readouterr().out)
    assert found["reason"] == "two walls of a chamber are 1.8 mm too thick for its length"
    assert found["margins"]["walls_fit"] == pytest.approx(-1.8 * mm)
    assert run(["solve", str(broken)]) == NO_ANSWER
    assert "1.8 mm too thick" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("turned", [False, True])
def test_of_several_broken_rules_the_worst_is_told(turned):
    """Whatever their order; a rule that forbids nothing, and one that is kept, are not."""
    margins = [("walls_fit", -1e-3), ("chambers_apart", -2e-3), ("mould_range", -9e-3), ("one_segment", 1e-3)]
    given = [(name, jnp.asarray(margin)) for name, margin in (margins[::-1] if turned else margins)]
    solved = jnp.asarray(OK), jnp.asarray(0), jnp.asarray(jnp.nan)
    status, reason, detail = with_rules(given, jnp.asarray(True), *solved)
    assert (int(status), Reason(int(reason)), float(detail)) == (IMPOSSIBLE, Reason.CHAMBERS_APART, -2e-3)
    status, reason, _ = with_rules(given, jnp.asarray(False), *solved)
    assert (int(status), int(reason)) == (OK, 0)
