"""Exported solids are what the config says, moulds leave exactly the part, and what cannot be made is one sentence."""

import dataclasses
import html
import json
import locale
import math
import re
import shutil
import subprocess
import sys
from collections import Counter
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import softgrip_jax as sg
from softgrip_jax.cli import MISTAKE, run
from softgrip_jax.errors import InputError
from softgrip_jax.units import kPa, mm

pytest.importorskip("build123d", reason="the extra cad is not installed")
trimesh = pytest.importorskip("trimesh", reason="the extra cad is not installed")

from softgrip_jax import cad  # noqa: E402
from softgrip_jax.cad import solids  # noqa: E402
from softgrip_jax.cad.checks import check_mould, undercut  # noqa: E402
from softgrip_jax.cad.finger_parts import chambers_of  # noqa: E402
from softgrip_jax.cad.pdf import widths_of  # noqa: E402
from softgrip_jax.cad.plates import solid_of  # noqa: E402
from softgrip_jax.cad.solids import kernel, volume  # noqa: E402

TABLE = cad.ManufactureTable()


def a_shell(a=16.0, b=43.0, t_m=1.1):
    return sg.FlatShell(a=a * mm, b=b * mm, t_m=t_m * mm, material=sg.NeoHookean(mu=175 * kPa))


def a_finger(**changed):
    return dataclasses.replace(
        sg.PneuNet.table_5_1("A", L=20 * mm), **{name: np.asarray(value) * mm for name, value in changed.items()}
    )


@pytest.fixture(scope="module")
def shell():
    return cad.shell_export(a_shell(), TABLE, True)


@pytest.fixture(scope="module")
def finger():
    return cad.finger_export(a_finger(), TABLE, True)


def named(export, name):
    return next(piece for piece in export.pieces if piece.name == name)


def test_the_picture_of_a_mould_has_the_sizes_that_are_printed(shell, tmp_path, monkeypatch):
    from softgrip_jax.commands import export

    drawn = {}

    class Figure:
        def __init__(self, shown, title):
            drawn[title] = [np.ptp(np.array(points), axis=0) for _, (points, _), _ in shown]

        def savefig(self, path, **_):
            pass

    monkeypatch.setattr("softgrip_jax.plots.solids.solids_figure", Figure)
    table = cad.ManufactureTable(shrinkage_percent=5)
    export.draw_all(tmp_path, shell, cad.growth(table))
    [mould] = shell.moulds
    for size, piece in zip(drawn[f"mould of the {mould.casts}"], mould.pieces, strict=True):
        np.testing.assert_allclose(np.sort(size), np.sort(solids.extent(piece.solid)) / 0.95, rtol=1e-6)
    for size, piece in zip(drawn[""], shell.pieces, strict=True):
        np.testing.assert_allclose(np.sort(size), np.sort(solids.extent(piece.solid)), rtol=1e-6)


def test_all_checks_of_a_shell_hold(shell):
    found = cad.check_solids(shell) + list(cad.check_thicknesses(shell, {p.name: p.solid for p in shell.pieces}))
    assert [check for check in found if not check.good] == []
    assert {"undercut in the pull direction", "volume", "membrane, in the middle"} <= {check.what for check in found}
    # 44 x 98 x 1.1 for the sheet, and a ring 2 mm wide and high below its edge.
    assert solids.volume(named(shell, "membrane").solid) == pytest.approx(44 * 98 * 1.1 + 2 * (44 * 98 - 40 * 94))


@pytest.mark.parametrize("name", ["frame", "ring"])
def test_screws_go_through_the_middle_of_the_border_of_a_frame(shell, name):
    """Six of them, at the corners and half-way along the long sides."""
    (solid,) = solids.solids_of(named(shell, name).solid)
    rings = solid.edges().filter_by(lambda edge: edge.is_closed)
    screws = [ring.arc_center for ring in rings if ring.radius == pytest.approx(TABLE.screw_mm / 2)]
    half = np.sort(solids.extent(solid))[1:] / 2
    places = {(round(screw.X, 6), round(screw.Y, 6)) for screw in screws}
    x, y = half - TABLE.frame_mm / 2
    assert places == {(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 0, 1)}
    heights = {round(screw.Z, 6) for screw in screws}
    assert np.ptp(list(heights)) == pytest.approx(np.min(solids.extent(solid)))


def test_all_checks_of_a_finger_hold(finger):
    found = cad.check_solids(finger) + list(cad.check_thicknesses(finger, {p.name: p.solid for p in finger.pieces}))
    assert [check for check in found if not check.good] == []


def test_the_volume_of_a_finger_is_that_of_its_walls(finger):
    """By hand: 3 chambers of 4.2 x 20 x 12 mm with 2 x 16 x 10 mm of air, 1.1 mm walls, a 2 mm channel."""
    start = (20 - 3 * 6) / 2 + 0.9
    chambers = 3 * (4.2 * 20 * 12 - 2 * 16 * 10)
    tunnels = (start + 2 * 1.8) * (5 * 3.5 - 2 * 2)
    foot = 12 * (20 * 5 - 2 * 2)
    through_walls = 5 * 1.1 * 2 * 2
    expected = chambers + tunnels + foot - through_walls + (20 + 12) * 20 * 5
    assert solids.volume(named(finger, "finger").solid) == pytest.approx(expected, rel=1e-9)


def test_the_air_of_a_finger_is_one_space(finger):
    """What the finger leaves of its own outline has one part with all chambers in it: 3 cavities, and the channel."""
    air = solids.Block((-12, -1, 5), (1.9 + 2 * 6 + 2, 1, 7)).solid()
    (left,) = solids.solids_of(solids.without(air, [named(finger, "finger").solid]))
    assert pytest.approx(-12) == left.bounding_box().min.X
    assert pytest.approx(1.9 + 2 * 6 + 2) == left.bounding_box().max.X


def test_checks_see_what_is_wrong(shell):
    """A thinner membrane is not what the mould leaves, nor as large or as thick as the config says."""
    thin = cad.shell_export(a_shell(t_m=1.0995), TABLE, False)
    wrong = named(thin, "membrane").solid
    said = [check.what for check in check_mould(shell.moulds[0], wrong) if not check.good]
    assert "what the closed mould leaves, beside the part" in said
    said = [check.what for check in cad.check_thicknesses(shell, {"membrane": wrong}) if not check.good]
    assert said == []  # 1e-6 m is what is allowed
    wrong = named(cad.shell_export(a_shell(t_m=1.09), TABLE, False), "membrane").solid
    said = [check.what for check in cad.check_thicknesses(shell, {"membrane": wrong}) if not check.good]
    assert "membrane, in the middle" in said


def test_an_undercut_is_seen():
    """A hook under a ledge: free where it is, caught where it is pulled up, free where it is pulled down."""
    ledge = solids.Block((0, 0, 0), (10, 10, 1)).solid()
    hook = solids.Block((8, 0, -2), (12, 10, -1)).solid()
    assert undercut(hook, ledge, 1.0) == pytest.approx(2 * 10 * 0.5)  # half-way between two meetings of faces
    assert undercut(hook, ledge, -1.0) == 0


@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_base_has_holes_for_all_fingers(n):
    base = cad.gripper_base(sg.pneunet.Gripper(a_finger(), n=n, base_radius=30 * mm), TABLE)
    (solid,) = solids.solids_of(base.solid)
    assert solid.is_valid
    rings = solid.edges().filter_by(lambda edge: edge.is_closed)
    assert len(rings) == 2 * (1 + 5 * n)
    assert {round(ring.center().Z, 9) for ring in rings} == {0.0, TABLE.floor_mm}  # every hole goes through
    rim = max(rings, key=lambda ring: ring.radius).arc_center
    assert pytest.approx((0, 0), abs=1e-9) == (rim.X, rim.Y)
    assert solid.volume == pytest.approx(base.volume, rel=1e-9)
    with pytest.raises(InputError, match="the clamps of 4 fingers would overlap"):
        cad.gripper_base(sg.pneunet.Gripper(a_finger(), n=4, base_radius=15 * mm), TABLE)


@pytest.mark.parametrize(("touch", "more"), [("face", 0.0), ("midline", 2.5)])
def test_the_base_radius_that_is_named_is_that_of_the_config(touch, more):
    """The least one, typed into the config, is enough; with "midline" it is H/2 larger."""
    gripper = sg.pneunet.Gripper(a_finger(), n=4, base_radius=15 * mm, touch=touch)
    with pytest.raises(InputError, match="base_radius_mm is 15 mm; it must be at least") as caught:
        cad.gripper_base(gripper, TABLE)
    (least,) = re.findall(r"at least ([\d.]+) mm", str(caught.value))
    assert float(least) == pytest.approx(10 + 0.2 + 7 + 0.2 + 7 + more)
    cad.gripper_base(dataclasses.replace(gripper, base_radius=float(least) * mm), TABLE)


def test_segments_hold_whole_chambers():
    finger = a_finger(h_x=[0.9, 1.1], L=30.0)
    chambers = chambers_of(finger)
    lengths = 30 * np.array([6.0, 6.4]) / 12.4
    assert [sum(one.segment == k for one in chambers) for k in (1, 2)] == [int(lengths[0] // 6), int(lengths[1] // 6.4)]
    for one, other in pairwise(chambers):
        assert other.start - one.end >= (one.gap + other.gap) / 2 - 1e-9


@pytest.mark.parametrize(
    ("changed", "table", "says"),
    [
        ({"h_L": 3.0}, {}, "The core of segment 1, h_L_mm - 2 t_m_mm, is 0.8 mm thick, too thin to hold"),
        ({"h_L": 3.3, "a": 10.0}, {}, "too slender to hold: 18.2 to 1"),
        ({"h_x": 0.2}, {}, "The fin of the mould of segment 1, 2 h_x_mm, is 0.4 mm thick"),
        ({"H": 0.4}, {}, "H_mm is 0.4 mm; it must be at least 0.5 mm"),
        ({}, {"channel_mm": 0}, "channel_mm is 0 mm: the chambers of segment 1 would have no way for air"),
        ({"b": 0.9}, {}, "would have no way for air"),
        ({"a": 1.5, "b": 4 / 3, "h_x": 1.0, "h_L": 3.2, "t_m": 1.0}, {}, "would be higher than the air (2 a_mm)"),
        ({"L": 5.0}, {}, "Segment 1 is 5 mm long, shorter than its chamber with its gap (6 mm)"),
        ({"L": 250.0}, {}, "larger than the printer's bed of 220 x 220 x 250 mm"),
        ({"b": 10.5}, {}, "it must be at least 0.5 mm: liquid silicone does not fill a thinner wall"),
        ({}, {"side_wall_mm": 3}, "wider than the cover (B_mm = 20)"),
        ({}, {"mould_wall_mm": 4}, "mould_wall_mm is 4 mm; it must be at least 6 mm"),
        (
            {"h_x": 1.5, "L": 14.4},
            {"foot_mm": 5},
            "the foot between its end (foot_mm) and the fin behind the first chamber",
        ),
        ({"h_x": 1.5, "L": 14.4}, {"foot_mm": 1.4}, "is -0.1 mm; it must be at least 4 mm"),
    ],
)
def test_fingers_that_cannot_be_made(changed, table, says):
    with pytest.raises(InputError) as caught:
        cad.export_of(sg.pneunet.Free(a_finger(**changed)), cad.ManufactureTable(**table))
    assert says in str(caught.value)
    assert str(caught.value).count(". ") == 0


@pytest.mark.parametrize(
    ("shell", "table", "says"),
    [
        (a_shell(t_m=0.3), {}, "t_m_mm is 0.3 mm; it must be at least 0.5 mm"),
        (a_shell(), {"rim_mm": 2.5}, "rim_mm is 2.5 mm; it must be at least 3 mm"),
        (a_shell(), {"ring_mm": 6}, "ring_mm is 6 mm; it must be less than 5 mm, where the object begins"),
        (a_shell(a=1.5), {}, "the air has no way in"),
        (a_shell(b=120), {}, "larger than the printer's bed"),
    ],
)
def test_shells_that_cannot_be_made(shell, table, says):
    with pytest.raises(InputError) as caught:
        cad.export_of(sg.shell.FlatContact(shell, distance=5 * mm), cad.ManufactureTable(**table))
    assert says in str(caught.value)


SMALL_PAD = a_shell(a=7.5, b=7.5)


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        (sg.shell.CylinderContact(a_shell(), radius=20 * mm, gap=1 * mm), "it must be less than 1 mm"),
        # At the outer edge, 20.7 mm from the middle, the plane is at 5 - 20.7 tan 0.35 mm, behind the membrane.
        (sg.shell.InclinedContact(SMALL_PAD, distance=5 * mm, angle=0.35), r"touches even a ring of 0\.8 mm"),
        (sg.shell.Plate(a_shell()), "A Plate does not say what its membrane touches"),
        (sg.shell.CylinderContact(a_shell(), radius=20 * mm, gap=5 * mm), ""),
        (sg.shell.Free(a_shell()), ""),
    ],
)
def test_the_ring_is_clear_of_the_object(scene, says):
    if not says:
        cad.export_of(scene, cad.ManufactureTable())
        return
    with pytest.raises(InputError, match=says):
        cad.export_of(scene, cad.ManufactureTable())


def a_step(place, edge):
    """The half space y < edge, above z = 1.3 mm."""
    return jnp.maximum(place[1] - edge, 1.3 * mm - place[2])


def a_bar(place, low):
    """A bar of 0.5 x 0.5 mm along x, at y = 10.1 mm, which begins at z = low."""
    return jnp.max(jnp.abs(place[1:] - jnp.stack([10.1 * mm, low + 0.25 * mm]))) - 0.25 * mm


def nowhere(place, parameters):
    """A distance that is no number far from the middle."""
    return jnp.sqrt(5 * mm - jnp.abs(place[1])) + 1.0


obstacles = sg.shell.obstacles


@pytest.mark.parametrize(
    ("body", "begins"),
    [
        # Rods and a bar through the ring, wherever they lie along its edge, begin over it where they begin.
        (obstacles.Cylinder(radius=0.7 * mm, gap=1 * mm), 1.0),
        (obstacles.Cylinder(radius=1.5 * mm, gap=1 * mm), 1.0),
        (obstacles.Cylinder(radius=1.5 * mm, gap=1 * mm, offset_y=0.7 * mm), 1.0),
        (obstacles.Shape(a_bar, jnp.asarray(1.1 * mm)), 1.1),
        # A ball over the middle of the border, and one that meets the inner edge x = 16 mm alone, by 0.1 mm:
        # there it begins at gap + R - sqrt(R^2 - 5^2).
        (obstacles.Sphere(radius=3 * mm, gap=1.2 * mm, offset_x=22.03 * mm, offset_y=0.09 * mm), 1.2),
        (obstacles.Sphere(radius=10 * mm, gap=0.56 * mm, offset_x=11 * mm), 10.56 - 75**0.5),
        # The ring ends at y = -43 and -56.2 mm.
        (obstacles.Shape(a_step, jnp.asarray(-43.0 * mm)), 1.3),
        (obstacles.Shape(a_step, jnp.asarray(-56.2 * mm)), 1.3),
        (obstacles.Shape(a_step, jnp.asarray(-56.21 * mm)), None),
        (obstacles.Sphere(radius=10 * mm, gap=0.67 * mm, offset_x=11 * mm), None),
        (obstacles.Cylinder(radius=0.7 * mm, gap=2.05 * mm), None),
    ],
)
def test_what_is_told_of_the_ring_is_where_the_object_begins(body, begins):
    """By hand, for a ring of 2 mm: a ring as thick as is told is clear, and 0.05 mm more is not."""
    if begins is None:
        cad.check_ring(body, a_shell(), TABLE)
        return
    with pytest.raises(InputError, match=r"^ring_mm is 2 mm; it must be less than ") as caught:
        cad.check_ring(body, a_shell(), TABLE)
    (told,) = re.findall(r"less than ([\d.]+) mm", str(caught.value))
    assert begins - 0.01 <= float(told) <= begins + 0.05
    cad.check_ring(body, a_shell(), cad.ManufactureTable(ring_mm=float(told) - 0.01))
    with pytest.raises(InputError):
        cad.check_ring(body, a_shell(), cad.ManufactureTable(ring_mm=begins + 0.05))


def test_an_object_that_no_ring_is_clear_of():
    with pytest.raises(InputError, match=r"even a ring of 0\.8 mm .* keep the object farther from the frame\.$"):
        cad.check_ring(obstacles.Cylinder(radius=0.7 * mm, gap=0.4 * mm), a_shell(), TABLE)
    with pytest.raises(InputError, match=r"^The distance of the object is not a number .* 0 mm above the membrane"):
        cad.check_ring(obstacles.Shape(nowhere), a_shell(), TABLE)


def test_a_shallow_cavity_is_measured_within_its_depth():
    """The cavity is 0.5 mm deep, the bead 2 mm: the wall between them ends at the cavity's floor."""
    export = cad.shell_export(a_shell(), cad.ManufactureTable(cavity_mm=0.5), False)
    found = list(cad.check_thicknesses(export, {piece.name: piece.solid for piece in export.pieces}))
    assert [check for check in found if not check.good] == []
    (wall,) = (check for check in found if check.what == "frame between cavity and groove")
    assert wall.expected == pytest.approx(6 - 2 - 0.2)


def test_a_port_leaves_walls_of_the_end_cap():
    """By hand: foot 5 + 2 + 2 x 1.5 mm high, 7.2 mm of cap around it, the port 6 mm above its lower face: 11.2 mm to
    the upper edge, of which 0.8 mm stay."""
    free = sg.pneunet.Free(a_finger())
    cad.export_of(free, cad.ManufactureTable(port_mm=20.8), with_moulds=False)
    for port in (20.9, 22, 24, 40):
        with pytest.raises(InputError, match=f"^port_mm is {port} mm; it must be at most 20.8 mm: least_wall_mm of "):
            cad.export_of(free, cad.ManufactureTable(port_mm=port))
    # With a high tunnel the screws are next: their middles are 13.7 mm beside the port's and 9.7 mm below.
    high = {"channel_wall_mm": 5.0, "foot_mm": 20.0}
    least = 2 * (math.hypot(13.7, 9.7) - 1.6 - 0.8)
    wide = cad.ManufactureTable(**high, port_mm=30)
    with pytest.raises(InputError, match=rf"at most {min(least, 2 * (13.2 - 0.8)):.4g} mm"):
        cad.export_of(free, wide)


@pytest.mark.parametrize(
    ("radius", "most"), [(25, 2 * (math.hypot(18.5, 12.5) - 1.6 - 0.8 - 5)), (60, 2 * (math.hypot(82, 22) - 66 - 5))]
)
def test_a_port_leaves_walls_of_the_gripper_base(radius, most):
    """By hand, with 5 mm of clearance: the hole is 10 mm wider than the port, and the screws, 3.2 mm wide, stand
    18.5 mm beside its middle and 12.5 mm above it. The plate's edge is 0.8 mm beyond the end caps' corners, which are
    22 mm beside the plane of the finger and 22 mm behind its cover's face."""
    gripper = sg.pneunet.Gripper(a_finger(), n=3, base_radius=radius * mm)
    loose = {"clearance_mm": 5, "mould_wall_mm": 16}
    cad.gripper_base(gripper, cad.ManufactureTable(**loose, port_mm=most))
    with pytest.raises(InputError, match=rf"at most {most:.4g} mm: a hole for it, with clearance_mm"):
        cad.gripper_base(gripper, cad.ManufactureTable(**loose, port_mm=most + 0.1))


@pytest.mark.parametrize("fingers", [1, 2, 4])
def test_the_sheet_of_a_shell_grasp_weighs_for_all_fingers(fingers):
    """44 x 98 x 1.1 mm of sheet with its bead, 1.08 g/cm^3, 15 % more, half of it part A."""
    grasp = sg.shell.Grasp(a_shell(), radius=20 * mm, gap=5 * mm, mass=0.5, fingers=fingers)
    export = cad.export_of(grasp, TABLE, with_moulds=False)
    grams = (44 * 98 * 1.1 + 2 * (44 * 98 - 40 * 94)) / 1000 * 1.08 * 1.15 / 2
    page = cad.as_html("pad", cad.sheet(export, TABLE, [], cad.Expected([]), [], 1.001))
    assert "The masses are of one piece each" in page
    every, whole = f"{fingers}: cast and print every part as often", f"{fingers * grams:.1f} g of A"
    assert (every in page) == (whole in page) == (fingers > 1)


def test_the_sheet_of_a_finger_grasp_weighs_for_all_fingers():
    gripper = sg.pneunet.Gripper(a_finger(), n=3, base_radius=30 * mm)
    grasp = sg.pneunet.Grasp(gripper, sg.objects.Cylinder(radius=18 * mm, mass=0.02, friction=1.0))
    export = cad.export_of(grasp, TABLE, with_moulds=False)
    grams = 3 * (named(export, "body").volume + named(export, "base layer").volume) / 1000 * 1.08 * 1.15 / 2
    assert f"the 3 fingers need 3 of each, {grams:.1f} g of A and" in cad.silicone_of_all(export, TABLE)
    assert export.facts["fingers"] == "3: cast and print every part but the base as often"


@pytest.mark.parametrize(
    ("changed", "table", "says"),
    [
        # Two segments of one chamber each: between them are h_x of both, 0.6 + 0.7 mm, and no fin of 2 h_x.
        (
            {"a": [9.0, 9.5], "h_x": [0.6, 0.7], "L": 5.4 + 5.6},
            {},
            "between segments 1 and 2 is 20 mm high and 1.3 mm thick",
        ),
        (
            {"a": [9.5, 9.0], "h_x": [0.7, 0.5], "L": 5.6 + 5.2},
            {},
            "between segments 1 and 2 is 20 mm high and 1.2 mm thick",
        ),
        # The foot is 18 mm high above the cover, the chamber behind it 20 mm, and the fin between them 1 mm thick.
        (
            {"a": 9.0, "h_x": 0.5, "L": 5.2},
            {"channel_wall_mm": 8.0},
            "behind the first chamber, h_x_mm, is 18 mm high and 1 mm thick",
        ),
    ],
)
def test_every_fin_of_the_mould_is_asked(changed, table, says):
    with pytest.raises(InputError) as caught:
        cad.export_of(sg.pneunet.Free(a_finger(**changed)), cad.ManufactureTable(**table))
    assert says in str(caught.value)


def test_a_fin_may_be_as_slender_as_is_allowed():
    """12 mm high and 0.8 mm thick, 15 to 1, wherever the chambers stand along the finger."""
    table = cad.ManufactureTable(least_core_mm=0.8)
    cad.export_of(sg.pneunet.Free(a_finger(h_x=0.4, L=20.3)), table, with_moulds=False)


@pytest.mark.parametrize("changed", [{"a": [9.0, 5.0], "h_x": [0.6, 0.7], "L": 11.0}, {"a": 9.0, "h_x": 0.5, "L": 5.2}])
def test_a_fin_stands_free_above_the_lower_of_two_hollows(changed):
    """Beside a chamber of 20 mm, which would be too slender for it, there is one of 12 mm, or the foot of 5 mm."""
    cad.export_of(sg.pneunet.Free(a_finger(**changed)), TABLE, with_moulds=False)


def test_a_fin_that_no_mould_has_is_not_asked():
    """Segments of one chamber have no gap of 2 h_x = 0.8 mm within them, but one of 0.4 + 1.0 mm between them."""
    finger = a_finger(h_x=[0.4, 1.0], L=5.0 + 6.2)
    one, other = chambers_of(finger)
    assert other.start - one.end == pytest.approx(1.4)
    cad.export_of(sg.pneunet.Free(finger), TABLE, with_moulds=False)


CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[solve]
pressure_kPa = 15
"""


def test_the_command_writes_a_folder(tmp_path, capsys):
    (tmp_path / "pad.toml").write_text(CONFIG + "[manufacture]\nrim_mm = 5\n")
    out = tmp_path / "pad"
    assert run(["export", str(tmp_path / "pad.toml"), "--mould", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["all_good"]
    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert {"parts/membrane.step", "parts/frame.stl", "moulds/membrane_lid.stl", "sheet.html", "parts.png"} <= names
    assert "plates/plate_1.3mf" in names
    assert told["plates"] == 2
    volume = 42 * 96 * 1.1 + 2 * (42 * 96 - 38 * 92)
    mesh = trimesh.load(out / "parts" / "membrane.stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=1e-5)
    (pour,) = told["silicone"]
    assert pour["part_A_g"] == pytest.approx(volume / 1000 * 1.08 * 1.15 / 2)
    # Moulds are larger than the part by what the silicone shrinks.
    low, high = trimesh.load(out / "moulds" / "membrane_lid.stl").bounds
    assert (high - low)[0] == pytest.approx((42 + 2 * 8) / 0.999, rel=1e-5)
    page = (out / "sheet.html").read_text()
    assert "limit pressure" in page
    assert "http" not in page


def test_both_sheets_say_the_same(shell, tmp_path):
    """Every word of the HTML page, markup aside, stands in the PDF, which is the same file each time."""
    pytest.importorskip("reportlab", reason="the extra cad is not installed")
    checks = list(cad.check_thicknesses(shell, {p.name: p.solid for p in shell.pieces}))
    wide = [(f"quantity {k}", "a value that needs more than one line of any page " * 4) for k in range(60)]
    expected = cad.Expected(
        [*wide, ("a<b&c", "1 mm")], sentences=["By both laws a<b, and neither is known to be right."]
    )
    content = cad.sheet(shell, TABLE, checks, expected, [], 1.001)
    for name in ("one.pdf", "two.pdf"):
        assert cad.write_pdf(tmp_path / name, "pad \u4e2d: shell", content)
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()
    if shutil.which("pdftotext") is None:
        pytest.skip("needs pdftotext of poppler")
    subprocess.run(["pdftotext", "-layout", "one.pdf"], cwd=tmp_path, check=True)
    seen = Counter((tmp_path / "one.txt").read_text(encoding="utf-8").split())
    page = html.unescape(re.sub("(?s)<style>.*?</style>|<[^>]*>", " ", cad.as_html("pad ?: shell", content)))
    missing = Counter(page.replace("pad ?: shell", "", 1).split()) - seen
    assert not missing


def test_without_reportlab_there_is_no_pdf(monkeypatch, tmp_path):
    for name in ("reportlab", "reportlab.lib.pagesizes"):
        monkeypatch.setitem(sys.modules, name, None)
    assert not cad.write_pdf(tmp_path / "sheet.pdf", "pad", [])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("width", [200.0, 495.0])
def test_columns_fit_the_page(width):
    pytest.importorskip("reportlab", reason="the extra cad is not installed")
    found = widths_of([["a", "long " * 50, "longer " * 50], ["word", "", ""]], width)
    assert sum(found) == pytest.approx(width)
    assert found[2] > found[1] > found[0] > 20


@pytest.mark.slow
@pytest.mark.parametrize("bed", [[300.0, 300.0, 250.0], [130.0, 75.0, 60.0]])
def test_plates_hold_every_printed_piece_once(bed, shell, tmp_path):
    """No two pieces overlap, none stands over the edge, and the file holds what was laid out."""
    table = cad.ManufactureTable(bed_mm=bed)
    pieces = cad.printed(shell, 1.001)
    found = cad.laid_out(pieces, table)
    assert sorted(p.piece.name for plate in found for p in plate) == sorted(p.name for p, _ in pieces)
    assert (len(found) > 1) == (bed[0] < 200)
    for number, plate in enumerate(found):
        boxes = [(p.x, p.y, p.x + p.size[0], p.y + p.size[1]) for p in plate]
        for k, (x0, y0, x1, y1) in enumerate(boxes):
            assert min(x0, y0) >= 0
            assert x1 <= bed[0]
            assert y1 <= bed[1]
            for u0, v0, u1, v1 in boxes[:k]:
                assert x1 < u0 or u1 < x0 or y1 < v0 or v1 < y0
        for placed in plate:
            box = solid_of(placed).bounding_box()
            assert pytest.approx((placed.x, placed.y, 0), abs=1e-5) == (box.min.X, box.min.Y, box.min.Z)
            assert pytest.approx(placed.size) == (box.size.X, box.size.Y)
        path, before = tmp_path / f"plate_{number}.3mf", locale.setlocale(locale.LC_ALL)
        cad.write_plate(plate, path)
        assert locale.setlocale(locale.LC_ALL) == before, "lib3mf sets another"
        wanted = sorted(p.piece.volume * p.scale**3 for p in plate)
        volumes = [volume(solid) for solid in kernel().Mesher().read(str(path))]
        assert sorted(volumes) == pytest.approx(wanted, rel=2e-3)


def test_cores_stand_on_the_plate_of_their_lid(finger):
    (plate,) = cad.laid_out(cad.printed(finger, 1.0), TABLE)
    lid = solid_of(next(placed for placed in plate if placed.piece.name == "body lid"))
    floor = solids.Block((-300, -300, 0), (300, 300, TABLE.mould_floor_mm)).solid()
    (below,) = solids.solids_of(lid & floor)
    assert pytest.approx(lid.bounding_box().size.X) == below.bounding_box().size.X
    assert 2 * TABLE.mould_floor_mm < lid.bounding_box().size.Z


def test_a_deck_has_no_json(tmp_path, capsys):
    (tmp_path / "pad.toml").write_text(CONFIG)
    deck = ["--fe", "abaqus", "--out", str(tmp_path / "pad.inp")]
    assert run(["export", str(tmp_path / "pad.toml"), *deck, "--json"]) == MISTAKE
    assert "leave out --step, --stl, --mould and --json" in capsys.readouterr().err


def test_nothing_is_written_where_it_cannot_be_made(tmp_path, capsys):
    file = tmp_path / "pad.toml"
    file.write_text(CONFIG.replace("t_m_mm = 1.1", "t_m_mm = 0.2"))
    assert run(["export", str(file), "--out", str(tmp_path / "pad")]) == MISTAKE
    assert capsys.readouterr().err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["pad.toml"]
    file.write_text(CONFIG + "[manufacture]\nrimm_mm = 5\n")
    assert run(["export", str(file)]) == MISTAKE
    assert "there is no key rimm_mm; did you mean rim_mm?" in capsys.readouterr().err
    file.write_text(CONFIG + "[manufacture]\nrim_mm = 1e300\n")
    assert run(["export", str(file)]) == MISTAKE
    assert "rim_mm is 1e+300; it should be less than or equal to 10000." in capsys.readouterr().err


def test_a_missing_extra_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "build123d", None)
    solids.kernel.cache_clear()
    try:
        with pytest.raises(InputError, match=r'pip install "softgrip_jax\[cad\]"'):
            cad.export_of(sg.shell.Free(a_shell()), TABLE)
    finally:
        monkeypatch.undo()
        solids.kernel.cache_clear()


def lengths(low, high):
    return st.floats(low, high, allow_nan=False).map(lambda value: round(value, 3))


@pytest.mark.slow
@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.booleans(),
    lengths(2, 20),
    lengths(1, 30),
    lengths(0.3, 3),
    lengths(0.2, 2),
    lengths(2, 9),
    lengths(6, 40),
    lengths(0.5, 4),
    lengths(1, 7),
)
def test_random_designs_are_right_or_refused(is_shell, a, b, t_m, h_x, h_L, L, channel, rim):
    table = cad.ManufactureTable(channel_mm=channel, rim_mm=rim)
    if is_shell:
        scene = sg.shell.Free(a_shell(a=a, b=max(a, 2 * b), t_m=t_m))
    else:
        sizes = {"a": a / 2, "b": b / 3, "t_m": t_m, "h_x": h_x, "h_L": h_L, "L": L, "B": 20.0, "H": 4.0}
        scene = sg.pneunet.Free(a_finger(**sizes))
    refused = ""
    try:
        export = cad.export_of(scene, table)
    except InputError as error:
        refused = str(error)
    event("refused" if refused else "built")
    if refused:
        assert re.fullmatch(r"[A-Z0-9a-z].*\.", refused)
        assert ". " not in refused
        return
    found = cad.check_solids(export) + list(cad.check_thicknesses(export, {p.name: p.solid for p in export.pieces}))
    assert [check for check in found if not check.good] == []
