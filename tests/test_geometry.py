"""Sections and meshes: surfaces are closed, volumes are those of the solids, what touches is where the object is."""

import itertools
import struct
from collections import Counter

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.units import kPa, mm


@pytest.fixture(scope="module")
def bent():
    """A uniform finger without loads: closed form."""
    return sg.solve(sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None), 20 * kPa)


@pytest.fixture(scope="module")
def pressed():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    return sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa)


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


def test_the_membrane_lies_on_the_plane(pressed):
    mesh = pressed.mesh()
    membrane = mesh.points[np.unique(mesh.of_kind("membrane"))]
    plane = mesh.points[np.unique(mesh.of_kind("object"))]
    assert membrane[:, 2].max() == pytest.approx(5 * mm, rel=1e-6)
    assert plane[:, 2].min() == pytest.approx(5 * mm, rel=1e-9)


def test_what_touches_is_marked(pressed):
    """The contact is as wide and as long as the observables say."""
    views = sg.geometry.sections(pressed)
    for view, half in zip(views, (pressed.contact_half_length, pressed.contact_half_width), strict=True):
        [line] = view.of_role("contact")
        assert np.ptp(line[:, 0]) == pytest.approx(2 * float(half) / mm, rel=0.03)
        assert np.allclose(line[:, 1], 5.0, atol=0.02)
        assert f"{float(pressed.force):.3g} N" == view.forces[0].text


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
