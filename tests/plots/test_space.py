"""The picture in space: arrows, ghost and contact of the flat views stand where the mesh of the same solution is."""

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.units import gram, kPa, mm

pytest.importorskip("bokeh", reason="Bokeh is missing: pip install softgrip_jax[explore]")
from softgrip_jax.explorer.looks import IN_FRONT, space_figure

FINGER = sg.PneuNet.table_5_1("A")
SHELL = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))


def drawn(solution):
    """The traces of the picture by their names: of "force" the shafts, whose heads are "heads"."""
    traces = space_figure(solution.mesh(), sg.geometry.sections(solution))["data"]
    return {"heads" if t["type"] == "mesh3d" and t["name"] == "force" else t["name"]: t for t in traces}


def lines_of(trace):
    """The lines of a trace, which NaN parts, each of shape (n, 3), mm."""
    points = np.stack([trace[name] for name in "xyz"], axis=-1)
    holes = np.flatnonzero(np.isnan(points[:, 0]))
    return [line[~np.isnan(line[:, 0])] for line in np.split(points, holes) if np.isfinite(line).any()]


def arrows_of(traces):
    """Start and end of every arrow, mm."""
    return [line for line in lines_of(traces["force"]) if len(line) == 2]


def corners_of(solution, name):
    """The corners of a part of the mesh, mm."""
    mesh = solution.mesh()
    used = np.unique(mesh.triangles[mesh.part == mesh.names.index(name)])
    return mesh.points[used] / mm


def end_of_cover(solution, number):
    """The four corners of a cover's end at the tip, mm: outer, inner, outer, inner."""
    points = corners_of(solution, f"cover {number}")
    count = len(points) // 4
    return points[count - 1 :: count]


def away(points, others):
    """The distance of each point from the nearest of others."""
    return np.linalg.norm(points[:, None] - others[None], axis=-1).min(axis=1)


@pytest.fixture(scope="module")
def held():
    return sg.solve(sg.pneunet.TipContact(FINGER, points=8), 31 * kPa)


@pytest.fixture(scope="module", params=[2, 3])
def grasp(request):
    gripper = sg.pneunet.Gripper(FINGER, n=request.param, base_radius=19.61 * mm)
    rod = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
    return sg.solve(sg.pneunet.Grasp(gripper, rod, points=8), 31 * kPa)


def test_the_arrow_of_a_held_tip_begins_there(held):
    traces = drawn(held)
    [(start, end)] = arrows_of(traces)
    np.testing.assert_allclose(start, end_of_cover(held, 0).mean(axis=0), atol=0.01)
    assert end[2] < start[2] - 5  # the finger presses downwards
    np.testing.assert_allclose(end[:2], start[:2], atol=1e-9)
    assert f"{float(held.tip_force):.3g} N" in traces["force"]["text"]


def test_the_head_of_an_arrow_is_at_its_end(held):
    traces = drawn(held)
    [(start, end)] = arrows_of(traces)
    head = np.stack([traces["heads"][name] for name in "xyz"], axis=-1)
    np.testing.assert_allclose(head[0], end, atol=0.01)
    across = np.linalg.norm((head[1:] - start)[:, :2], axis=1)
    np.testing.assert_allclose(across, across[0], atol=0.01)
    assert across[0] > 1
    assert np.all((head[1:, 2] > end[2]) & (head[1:, 2] < start[2]))


def test_the_arrows_of_a_grasp_begin_where_fingers_touch(grasp):
    """At the end of the inner face of every cover, on the object, and towards the axis."""
    traces, count = drawn(grasp), grasp.scene.gripper.n
    arrows = arrows_of(traces)
    assert len(arrows) == count
    for number, (start, end) in enumerate(arrows):
        np.testing.assert_allclose(start, end_of_cover(grasp, number)[1::2].mean(axis=0), atol=0.01)
        assert np.hypot(*start[:2]) == pytest.approx(18, abs=0.2)
        assert np.hypot(*end[:2]) < 10
        assert end[2] == pytest.approx(start[2])
    assert f"each {float(grasp.tip_force):.3g} N" in traces["force"]["text"]


def test_the_ghost_of_a_finger_is_straight(held):
    """From the clamp to the length L, as wide as the cover, from its lower face to the chambers' roofs."""
    ghost = np.concatenate(lines_of(drawn(held)["ghost"]))
    length, width, height = (float(getattr(FINGER, name)) / mm for name in ("L", "B", "H"))
    assert (ghost[:, 0].min(), ghost[:, 0].max()) == pytest.approx((0, length), abs=0.01)
    assert (ghost[:, 1].min(), ghost[:, 1].max()) == pytest.approx((-width / 2, width / 2), abs=2 * IN_FRONT)
    roof = height / 2 + 2 * float(FINGER.a) / mm
    assert (ghost[:, 2].min(), ghost[:, 2].max()) == pytest.approx((-height / 2, roof), abs=0.01)


def test_every_finger_has_its_ghost(grasp):
    """Turned by the angle between two fingers the ghost and the contacts are the same; they begin at the plate."""
    turn = 2 * np.pi / grasp.scene.gripper.n
    turned = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    for name in ("ghost", "contact"):
        points = np.concatenate(lines_of(drawn(grasp)[name]))
        assert away(points @ turned, points).max() < 0.01
        assert points[:, 2].max() < 0.01
        inner = np.hypot(*points[:, :2].T).min()
        assert inner > 10


def check_contacts(solution, fingers):
    """Every contact lies on both chambers: corners of the mesh are less than a millimetre apart along a wall."""
    lines = lines_of(drawn(solution)["contact"])
    assert len(lines) == 11 * fingers
    chambers = [corners_of(solution, f"chamber 0.{k}") for k in range(12)]
    for k, line in enumerate(lines[::fingers]):
        assert away(line, chambers[k]).max() < 1
        assert away(line, chambers[k + 1]).max() < 1


def test_contact_is_marked_between_the_chambers_of_a_finger(held):
    check_contacts(held, 1)


def test_contact_is_marked_between_the_chambers_of_a_grasp(grasp):
    check_contacts(grasp, grasp.scene.gripper.n)


@pytest.mark.parametrize("model", ["arc", pytest.param("energy", marks=pytest.mark.slow)])
def test_contact_of_a_membrane_lies_on_its_face(model):
    """As long and as wide as from the side, on the membrane and on the object; one force though two views show it."""
    solution = sg.solve(sg.shell.FlatContact(SHELL, distance=5 * mm, model=model), 15 * kPa)
    traces, views = drawn(solution), sg.geometry.sections(solution)
    along, across = lines_of(traces["contact"])
    assert np.ptp(along[:, 1]) == pytest.approx(np.ptp(views[0].of_role("contact")[0][:, 0]), abs=0.01)
    assert np.ptp(across[:, 0]) == pytest.approx(np.ptp(views[1].of_role("contact")[0][:, 0]), abs=0.01)
    for line in (along, across):
        assert away(line, corners_of(solution, "membrane")).max() < 1.5
    [(start, end)] = arrows_of(traces)
    np.testing.assert_allclose(start, [0, 0, 5], atol=0.1)
    assert end[2] > 10
    ghost = np.concatenate(lines_of(traces["ghost"]))
    np.testing.assert_allclose(np.abs(ghost), [[16, 43, 0]] * len(ghost), atol=2 * IN_FRONT)


def test_a_shell_on_a_cylinder_is_marked_under_it():
    """Both lines of contact lie on the cylinder, whose axis is along x and not over the middle of the membrane."""
    scene = sg.shell.Grasp(SHELL, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
    solution = sg.solve(scene, 10.9 * kPa)
    traces = drawn(solution)
    along, across = lines_of(traces["contact"])
    ghost = np.concatenate(lines_of(traces["ghost"]))
    assert np.abs(ghost).max(axis=0) == pytest.approx([16, 43, 0], abs=2 * IN_FRONT)
    assert np.ptp(along[:, 1]) > 5
    assert np.ptp(across[:, 0]) > 5
    cylinder = corners_of(solution, "object")
    middle = (cylinder.min(axis=0) + cylinder.max(axis=0)) / 2
    assert middle[1] == pytest.approx(43 - float(solution.height) / mm, abs=0.1)
    for line in (along, across):
        assert np.hypot(*(line - middle)[:, 1:].T) == pytest.approx(20, abs=1.5 * IN_FRONT)


def test_without_sections_only_the_mesh_is_drawn(held):
    """And every length has the same scale in all three directions, with and without them."""
    mesh = held.mesh()
    assert {t["name"] for t in space_figure(mesh)["data"]} == {"cover", "chamber"}
    for sections in ((), sg.geometry.sections(held)):
        figure = space_figure(mesh, sections)
        points = np.concatenate([np.stack([t[name] for name in "xyz"], axis=-1) for t in figure["data"]])
        size = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)
        scale = size / [figure["layout"]["scene"]["aspectratio"][name] for name in "xyz"]
        np.testing.assert_allclose(scale, scale[0], rtol=1e-6)
