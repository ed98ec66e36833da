"""Sections and meshes: surfaces are closed, volumes are those of the solids, what touches is where the object is."""

import dataclasses
import itertools
import struct
from collections import Counter

import jax.numpy as jnp
import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.geometry.finger import chamber_places
from softgrip_jax.geometry.mesh import _add_obstacle, _Build
from softgrip_jax.geometry.walls import free_outline, small_strain_outline, straight_outline
from softgrip_jax.shell import obstacles
from softgrip_jax.units import kPa, mm


@pytest.fixture(scope="module")
def bent():
    """A uniform finger without loads: closed form."""
    return sg.solve(sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None), 20 * kPa)


@pytest.fixture(scope="module")
def pressed():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    return sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa)


@pytest.mark.parametrize(
    "changed", [{"L": 72.0}, {"L": 72.5}, {"L": 77.0}, {"L": 20.0, "h_x": np.array([0.7, 0.8, 0.9])}]
)
def test_the_last_chamber_has_no_neighbour(changed):
    """Its wall at the tip has no plane to lie flat on, wherever the finger ends behind it."""
    finger = dataclasses.replace(sg.PneuNet.table_5_1("A"), **{name: value * mm for name, value in changed.items()})
    *others, last = chamber_places(finger)
    assert all(place.has_neighbour for place in others)
    assert not last.has_neighbour


def edges_of(mesh, name):
    """Each directed edge of a part by the places of its ends, and how often it occurs."""
    three = mesh.triangles[mesh.part == mesh.names.index(name)]
    places = np.round(mesh.points / 1e-9).astype(np.int64)
    return Counter(
        (tuple(places[a]), tuple(places[b])) for t in three for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))
    )


@pytest.mark.parametrize("name", ["cover 0", "chamber 0.0", "chamber 0.7"])
def test_solids_are_closed_and_turn_outwards(bent, name):
    """Every edge is there once in each direction, and the enclosed volume is positive."""
    edges = edges_of(bent.mesh(), name)
    assert all(edges[b, a] == count for (a, b), count in edges.items())
    assert bent.mesh().volume(name) > 0


def test_the_cover_keeps_its_volume(bent):
    """B H times the length of the middle line, by Pappus: the section is symmetric about the line."""
    shape = bent.shape(2001)
    length = np.sum(np.hypot(np.diff(shape["x"]), np.diff(shape["y"])))
    finger = bent.scene.finger
    assert bent.mesh().volume("cover 0") == pytest.approx(float(finger.B * finger.H) * length, rel=1e-3)


def test_pressure_inflates_the_chambers(bent):
    low = sg.solve(bent.scene, 1 * kPa).mesh()
    assert bent.mesh().volume("chamber 0.3") > 1.05 * low.volume("chamber 0.3")


def test_walls_that_leave_no_room_in_a_chamber_are_known():
    finger = sg.PneuNet.table_5_1("A")
    tight = dataclasses.replace(finger, t_m=0.55 * finger.h_L)
    assert all(place.fits for place in chamber_places(finger))
    assert not any(place.fits for place in chamber_places(tight))


@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_a_wall_that_touches_nothing_is_a_circular_arc_between_its_edges(lean):
    """Chord 2a, angle phi at its edges: radius a / sin(phi), height a tan(phi / 2), towards the clamp."""
    a, near, angle = 5 * mm, 2 * mm, 0.7
    points = free_outline(a, near, lean, angle)
    along, across = np.array([np.sin(lean), np.cos(lean)]), np.array([-np.cos(lean), np.sin(lean)])
    np.testing.assert_allclose(points[[0, -1]], near * np.array([1, 0]) + np.outer([0, 2 * a], along), atol=1e-12)
    centre = near * np.array([1, 0]) + a * along - a / np.tan(angle) * across
    np.testing.assert_allclose(np.hypot(*(points - centre).T), a / np.sin(angle), rtol=1e-12)
    assert np.max((points - points[0]) @ across) == pytest.approx(a * np.tan(angle / 2), rel=1e-3)
    np.testing.assert_allclose(free_outline(a, near, lean, 0.0), straight_outline(a, near, lean), atol=1e-15)
    # By the small-strain model the arc is as high as its inflation, and ends at the plane.
    free, pressed = (small_strain_outline(a, near, inflation, 0.0)[:, 0] for inflation in (1.5 * mm, 2.5 * mm))
    assert np.min(free) == pytest.approx(0.5 * mm, rel=1e-2)
    assert np.count_nonzero(pressed == 0) > 10


def test_the_membrane_lies_on_the_plane(pressed):
    mesh = pressed.mesh()
    membrane = mesh.points[np.unique(mesh.of_kind("membrane"))]
    plane = mesh.points[np.unique(mesh.of_kind("object"))]
    assert membrane[:, 2].max() == pytest.approx(5 * mm, rel=1e-6)
    assert plane[:, 2].min() == pytest.approx(5 * mm, rel=1e-9)


BODIES = {
    "plane": obstacles.Plane(height=6 * mm, tilt_x=0.1, tilt_y=0.05),
    "cylinder": obstacles.Cylinder(radius=20 * mm, gap=6 * mm, offset_x=2 * mm, heading=0.4, incline=0.05),
    "sphere": obstacles.Sphere(radius=20 * mm, gap=6 * mm, offset_y=3 * mm),
    "box": obstacles.Box(30 * mm, 5 * mm, 8 * mm, rounding=0.1 * mm, gap=6 * mm, offset_x=1 * mm, heading=0.4),
}


@pytest.mark.parametrize("body", BODIES.values(), ids=list(BODIES))
def test_an_object_is_drawn_where_its_distance_is_zero(body):
    """All corners are on its surface, or behind it where what is endless is cut; all of it is above the shell."""
    build = _Build()
    _add_obstacle(build, body, 20.0, 47.0)
    mesh = build.mesh()
    distance = np.array([float(body.distance(jnp.asarray(point))) for point in mesh.points])
    assert distance.max() < 0.2 * mm
    on = np.abs(distance) < 0.2 * mm
    assert on.sum() >= (4 if isinstance(body, obstacles.Plane) else len(on))
    assert mesh.volume("object") >= 0
    assert mesh.points[:, 2].min() > 0


def test_what_touches_is_marked(pressed):
    """The contact is as wide and as long as the observables say."""
    views = sg.geometry.sections(pressed)
    for view, half in zip(views, (pressed.contact_half_length, pressed.contact_half_width), strict=True):
        [line] = view.of_role("contact")
        assert np.ptp(line[:, 0]) == pytest.approx(2 * float(half) / mm, rel=0.03)
        assert np.allclose(line[:, 1], 5.0, atol=0.02)
        assert f"{float(pressed.force):.3g} N" == view.forces[0].text


def test_an_inclined_plane_is_drawn_on_the_membrane():
    """The membrane is as large as its opening; it touches the plane, and is beneath it."""
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    mesh = sg.solve(sg.shell.InclinedContact(shell, distance=5 * mm, angle=0.05), 15 * kPa).mesh()
    membrane, plane = (mesh.points[np.unique(mesh.of_kind(kind))] for kind in ("membrane", "object"))
    assert np.abs(membrane[:, :2]).max(axis=0) == pytest.approx([16 * mm, 43 * mm], rel=0.02)
    normal = np.array([np.sin(0.05), 0, np.cos(0.05)])
    assert (plane @ normal).min() == pytest.approx((membrane @ normal).max(), abs=0.1 * mm)


def test_chambers_that_touch_are_marked(bent):
    """Of a finger that bends evenly all walls touch alike, and the more the higher the pressure."""
    lengths = []
    for state in (sg.solve(bent.scene, 1 * kPa), bent, sg.solve(bent.scene, 30 * kPa)):
        [view] = sg.geometry.sections(state)
        lengths.append([np.linalg.norm(line[-1] - line[0]) for line in view.of_role("contact")])
    low, middle, high = lengths
    assert low == []
    assert len(middle) == len(high) == len(bent.mesh().names) - 2  # one less than there are chambers
    np.testing.assert_allclose(middle[:-1], middle[0], rtol=1e-6)
    assert middle[-1] == pytest.approx(middle[0], rel=0.01)  # the last chamber is cut by the finger's end
    assert min(high) > 1.05 * max(middle)


def test_files_hold_the_mesh(bent, tmp_path):
    """Binary STL in mm, read by hand, encloses the same volume; VTK and OBJ have as many points and triangles."""
    mesh = bent.mesh()
    raw = mesh.write(tmp_path / "a.stl").read_bytes()
    [count] = struct.unpack("<I", raw[80:84])
    rows = np.frombuffer(raw[84:], dtype=[("n", "<f4", 3), ("p", "<f4", (3, 3)), ("none", "<u2")])
    assert count == len(rows) == len(mesh.triangles)
    x, y, z = np.moveaxis(rows["p"].astype(float), 1, 0)
    volume = sum(mesh.volume(name) for name in mesh.names)
    assert np.sum(x * np.cross(y, z)) / 6 == pytest.approx(volume * 1e9, rel=1e-4)
    assert np.all(np.abs(np.linalg.norm(rows["n"], axis=1) - 1) < 1e-5)
    vtk = mesh.write(tmp_path / "a.vtk").read_bytes()
    assert f"POINTS {len(mesh.points)} double".encode() in vtk
    start = vtk.index(b"double\n") + 7
    points = np.frombuffer(vtk[start : start + 24 * len(mesh.points)], ">f8").reshape(-1, 3)
    np.testing.assert_array_equal(points, mesh.points)
    lines = mesh.write(tmp_path / "a.obj").read_text().splitlines()
    kinds = Counter(line.split()[0] for line in itertools.filterfalse(lambda line: line.startswith("#"), lines))
    assert kinds == {"v": len(mesh.points), "f": len(mesh.triangles), "g": len(mesh.names)}


def test_mistakes_are_told(bent, pressed, tmp_path):
    with pytest.raises(ValueError, match=r"must be a file that ends in \.vtk, \.stl or \.obj"):
        bent.mesh().write(tmp_path / "a.png")
    with pytest.raises(ValueError, match="a batch"):
        sg.path(pressed.scene, [10 * kPa, 15 * kPa]).mesh()
    with pytest.raises(ValueError, match="no state"):
        sg.geometry.sections(sg.solve(pressed.scene, 1e6 * kPa))
    with pytest.raises(ValueError, match="no part 'roof'"):
        bent.mesh().volume("roof")
