"""Pictures: what is drawn is where the solution says, to one scale, and nothing is cut."""

import jax
import numpy as np
import pytest
from helpers import ROD, shell
from matplotlib.patches import Circle, Polygon, Rectangle

import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.units import gram, kPa, mm

MAKE = {
    "free": lambda: sg.shell.Free(shell()),
    "flat": lambda: sg.shell.FlatContact(shell(), distance=5 * mm),
    "inclined": lambda: sg.shell.InclinedContact(shell(a=7.5 * mm, b=7.5 * mm), distance=5 * mm, angle=0.17),
    "cylinder": lambda: sg.shell.CylinderContact(shell(), **ROD),
    "offset": lambda: sg.shell.AxialOffset(shell(), height=38 * mm, **ROD),
    "grasp": lambda: sg.shell.Grasp(shell(), mass=563 * gram, friction=0.96, **ROD),
}
PRESSURE = {"inclined": 50 * kPa}


@pytest.fixture(scope="module")
def solved():
    return {name: sg.solve(make(), PRESSURE.get(name, 12 * kPa)) for name, make in MAKE.items()}


def membrane(ax):
    """The points of the membrane: the line with the most of them."""
    return max((line.get_xydata() for line in ax.lines), key=len)


@pytest.mark.parametrize("name", ["cylinder", "offset", "grasp"])
def test_the_membrane_wraps_the_cylinder_that_is_drawn(solved, name):
    """Every point is outside of the circle, and the contact, 2 r theta_c long, is on it."""
    solution = solved[name]
    ax = plots.draw(solution).axes[0]
    [circle] = [patch for patch in ax.patches if isinstance(patch, Circle)]
    points = membrane(ax)
    away = np.hypot(*(points - np.array(circle.center)).T) - 20
    assert circle.radius == pytest.approx(20)
    assert np.min(away) == pytest.approx(0, abs=1e-6)
    on = points[away < 1e-6]
    angle = float(solution.contact_angle)
    assert np.ptp(on[:, 0]) == pytest.approx(2 * 20 * np.sin(angle), rel=0.05)


def test_the_plane_is_where_it_is(solved):
    ax = plots.draw(solved["flat"]).axes[1]
    slab = max((p for p in ax.patches if isinstance(p, Rectangle)), key=lambda p: p.get_y())
    assert slab.get_y() == pytest.approx(5)
    assert membrane(ax)[:, 1].max() == pytest.approx(5, rel=1e-9)


def test_the_inclined_plane_leans_and_touches(solved):
    ax = plots.draw(solved["inclined"]).axes[0]
    [plane] = [p for p in ax.patches if isinstance(p, Polygon)]
    (x0, z0), (x1, z1) = plane.get_xy()[:2]
    assert np.arctan2(z0 - z1, x1 - x0) == pytest.approx(0.17)
    normal = np.array([np.sin(0.17), np.cos(0.17)])
    assert np.max(membrane(ax) @ normal) == pytest.approx(np.array([x0, z0]) @ normal)


@pytest.mark.parametrize("name", MAKE)
def test_nothing_is_cut_and_labels_have_units(solved, name, tmp_path):
    figure = plots.draw(solved[name])
    figure.savefig(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5000
    box = figure.bbox
    for ax in figure.axes:
        assert "(mm)" in ax.get_xlabel()
        assert ax.get_aspect() == 1
        tight = ax.get_tightbbox()
        assert tight is not None
        assert tight.x0 >= box.x0 - 1
        assert tight.y0 >= box.y0 - 1
        assert tight.x1 <= box.x1 + 1
        assert tight.y1 <= box.y1 + 1
    assert f"{float(solved[name].pressure) / kPa:.3g} kPa" in figure.axes[0].get_title(loc="left")


def test_before_and_after_share_one_scale(solved):
    wide = sg.solve(sg.shell.CylinderContact(shell(a=20 * mm, b=50 * mm), **ROD), 8 * kPa)
    figure = plots.compare({"before": solved["cylinder"], "after": wide})
    figure.draw_without_rendering()
    grid = np.array(figure.axes).reshape(2, 2)
    for column in grid.T:
        assert column[0].get_xlim() == column[1].get_xlim()
    per_mm = [ax.get_window_extent().width / np.ptp(ax.get_xlim()) for ax in figure.axes]
    np.testing.assert_allclose(per_mm, per_mm[0], rtol=0.02)
    assert [ax.get_title(loc="left").split(":")[0] for ax in grid[:, 0]] == ["before", "after"]


def test_the_curve_goes_through_the_limit_point():
    scene = sg.shell.Free(shell())
    ax = plots.pressure_curve(scene)
    rising, falling, mark = (line.get_xydata() for line in ax.lines)
    limit = float(sg.limit_pressure(scene)) / kPa
    assert mark[0, 1] == pytest.approx(limit, rel=1e-9)
    assert np.all(np.diff(rising[:, 1]) > 0)
    assert np.all(np.diff(falling[:, 1]) < 0)
    assert rising[-1, 1] == pytest.approx(limit, rel=1e-3)
    # 20.1756 kPa and 13.4067 mm at 15 kPa: independent solutions of the thesis's equations.
    assert limit == pytest.approx(20.1756, rel=1e-5)
    assert np.interp(15, rising[:, 1], rising[:, 0]) == pytest.approx(13.4067, rel=1e-3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("inflation (mm)", "pressure (kPa)")


def test_convergence_shows_the_history():
    history = {
        "best_objective": np.array([np.nan, 1.0, 0.5]),
        "with_equilibrium": np.array([3, 5, 8]),
        "feasible": np.array([0, 1, 8]),
        "moving": np.array([8, 8, 0]),
    }
    above, below = plots.convergence(history).axes
    np.testing.assert_array_equal(above.lines[0].get_ydata(), history["best_objective"])
    drawn = {line.get_label(): line.get_ydata() for line in below.lines}
    np.testing.assert_array_equal(drawn["moving"], history["moving"])
    np.testing.assert_array_equal(drawn["solved"], history["with_equilibrium"])

    # What came of one step only is seen, and where it was finished.
    one = {name: values[2:] for name, values in history.items()}
    above, below = plots.convergence(one, finished=0.4).axes
    assert [(*line.get_xdata(), *line.get_ydata(), line.get_marker()) for line in above.lines] == [
        (1, 0.5, "o"),
        (2, 0.4, "o"),
    ]
    assert {line.get_marker() for line in below.lines} == {"o"}


def test_what_cannot_be_drawn_says_so():
    beyond = sg.solve(MAKE["free"](), 40 * kPa)
    with pytest.raises(ValueError, match="There is no state to draw: no equilibrium"):
        plots.draw(beyond)
    batch = jax.tree.map(lambda x: np.repeat(x[None], 2, axis=0), beyond)
    with pytest.raises(ValueError, match="is a batch"):
        plots.draw(batch)
    with pytest.raises(ValueError, match="Free has no observable 'force'; it has: inflation"):
        plots.pressure_curve(MAKE["free"](), "force")


def test_a_scene_of_another_kind_brings_its_own_painter(solved):
    class Marked(sg.shell.Free):
        """A scene with a look of its own."""

    @plots.paints(Marked, "marks")
    def paint(solution, axes):
        axes[0].plot([0, 1], [0, 1], label="mine")

    solution = sg.solve(Marked(shell()), 12 * kPa)
    assert [line.get_label() for line in plots.draw(solution).axes[0].lines] == ["mine"]
    assert len(plots.draw(solved["free"]).axes) == 2


def test_chambers_stand_where_they_belong():
    """Type A: 12.8 pitches of 6 mm, the first chamber from 0.9 to 5.1 mm, the last one cut by the end at 77 mm."""
    places = plots.finger.chamber_places(sg.PneuNet.table_5_1("A"))
    assert len(places) == 13
    np.testing.assert_allclose(places[0], (0.9, 5.1, 10.0, 1.1))
    np.testing.assert_allclose(places[-1], (72.9, 77.0, 10.0, 1.1))


def test_the_finger_is_drawn_where_it_is():
    """A free finger without weight is an arc of the angle that it reports; its cover ends there, H thick."""
    finger = sg.PneuNet.table_5_1("A")
    solution = sg.solve(sg.pneunet.Free(finger, weight=None, inclination="none"), 25 * kPa)
    figure = plots.draw(solution)
    (ax,) = figure.axes
    cover = max((p for p in ax.patches if isinstance(p, Polygon) and p.get_fill()), key=lambda p: len(p.get_xy()))
    corners = cover.get_xy()
    outer, inner = corners[len(corners) // 2 - 1], corners[len(corners) // 2]
    np.testing.assert_allclose(0.5 * (outer + inner), np.asarray(solution.tip) / mm, rtol=1e-9)
    assert np.hypot(*(outer - inner)) == pytest.approx(5.0)
    angle = float(solution.tip_angle)
    np.testing.assert_allclose((outer - inner) / 5, [np.sin(angle), np.cos(angle)], atol=1e-9)
    figure.draw_without_rendering()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("along the finger, x (mm)", "y (mm)")


@pytest.mark.parametrize("inclination", [0.0, 0.12, -0.05])
def test_a_chamber_s_walls_go_from_edge_to_edge_and_lie_on_each_other(inclination):
    finger = sg.PneuNet.table_5_1("A")
    solution = sg.pneunet.chamber(finger, 31 * kPa, inclination)
    ax = plots.draw(solution).axes[0]
    left, right = (line.get_xydata() for line in ax.lines if len(line.get_xydata()) > 50 and line.get_linewidth() == 2)
    np.testing.assert_allclose(left, right * [-1, 1], atol=1e-12)
    # The edges of a wall are 2 a apart on a line that leans by theta_s; the one on the cover is h_x from the plane.
    cover, outer = sorted((right[0], right[-1]), key=lambda point: point[1])
    np.testing.assert_allclose(cover[0], float(finger.h_x) / mm, rtol=1e-12)
    leaning = 2 * float(finger.a) / mm * np.array([np.sin(inclination), np.cos(inclination)])
    np.testing.assert_allclose(outer - cover, leaning, rtol=1e-12)
    assert np.all(right[:, 0] >= -1e-12)
    on_plane = right[right[:, 0] < 1e-9]
    if inclination == 0:
        np.testing.assert_allclose(np.ptp(on_plane[:, 1]), float(solution.contact_width) / mm, rtol=1e-9)
        # Arc, flat and arc are as long as the stretched wall.
        wall = sg.pneunet.Chamber(finger, 0.0).wall(solution.clamp_angle)
        length = np.sum(np.hypot(*np.diff(right, axis=0).T))
        np.testing.assert_allclose(length, 2 * float(finger.a * wall.stretch) / mm, rtol=1e-4)
