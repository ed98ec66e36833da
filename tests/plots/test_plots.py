"""Pictures: what is drawn is where the solution says, to one scale, and nothing is cut."""

import dataclasses
import warnings
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from helpers import ROD, shell
from matplotlib.collections import PolyCollection
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

import softgrip_jax as sg
from softgrip_jax import plots
from softgrip_jax.errors import CellRangeWarning
from softgrip_jax.geometry import walls
from softgrip_jax.plots import figures
from softgrip_jax.pneunet.finger import SEGMENT_FIELDS
from softgrip_jax.results import Status
from softgrip_jax.solvers.path_limits import JUST_BEFORE, branch_marks
from softgrip_jax.study.dataset import DESIGN
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
    [plane] = [p for p in ax.patches if isinstance(p, Polygon) and len(p.get_xy()) == 5]
    (x0, z0), (x1, z1) = plane.get_xy()[:2]
    assert np.arctan2(z0 - z1, x1 - x0) == pytest.approx(0.17)
    normal = np.array([np.sin(0.17), np.cos(0.17)])
    assert np.max(membrane(ax) @ normal) == pytest.approx(np.array([x0, z0]) @ normal)


@pytest.mark.parametrize("name", MAKE)
def test_nothing_is_cut_and_labels_have_units(solved, name, tmp_path):
    figure = plots.draw(solved[name])
    check_no_word_is_cut(figure)
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


def texts_of(figure):
    """All words in a figure that are drawn: ticks outside of what an axis shows are not."""
    for ax in figure.axes:
        if not (ax.axison and ax.get_visible()):
            continue
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            room = 1e-9 * (high - low)
            yield from (t.label1 for t in axis.get_major_ticks() if low - room <= t.get_loc() <= high + room)
            yield axis.label
        yield from (ax.title, ax._left_title, ax._right_title, *ax.texts)
        if ax.get_legend():
            yield from ax.get_legend().get_texts()


def check_no_word_is_cut(figure):
    """Every word lies on the canvas: nothing depends on how the figure is saved."""
    figure.draw_without_rendering()
    seen = [text for text in texts_of(figure) if text.get_visible() and text.get_text().strip()]
    assert len(seen) > 4
    for text in seen:
        box = text.get_window_extent()
        assert box.x0 >= -1, text
        assert box.y0 >= -1, text
        assert box.x1 <= figure.bbox.x1 + 1, text
        assert box.y1 <= figure.bbox.y1 + 1, text


def parallel_figure():
    """Four numbers and two quantities at random, some without an answer."""
    rng, count = np.random.default_rng(0), 900
    units = {"units": "m", "kind": "length"}
    coords = {
        f"gripper.finger.{name}_x": (DESIGN, rng.uniform(1e-3, 9e-3, count), units) for name in ("a", "b", "h", "t_m")
    }
    values = 50 * sum(values for _, values, _ in coords.values())
    status = np.where(values > 1.3, int(sg.Status.BEYOND_LIMIT), int(sg.Status.OK))
    data = {}
    for name in ("largest tip force at 31 kPa", "end moment at 31 kPa"):
        known = np.where(status == 0, values, np.nan)
        data[name] = (DESIGN, known, {"long_name": name, "kind": "force", "status": "status_31_kPa"})
    data["status_31_kPa"] = (DESIGN, status, {})
    return plots.study(xr.Dataset(data, coords))


def grid_figure(varied):
    sizes = {"shell.a": 7, "shell.t_m": 5}
    axes = {name: (name, np.linspace(1e-3, 9e-3, n), {"kind": "length"}) for name, n in sizes.items()}
    values = np.arange(35.0).reshape(7, 5)
    status = np.where(values > 20, int(sg.Status.BEYOND_LIMIT), int(sg.Status.OK))
    words = {"long_name": "required pressure at 12 kPa", "kind": "pressure", "status": "status"}
    data = xr.Dataset({"p": (tuple(sizes), values, words), "status": (tuple(sizes), status, {})}, axes)
    return plots.study(data if varied == 2 else data.isel({"shell.t_m": [2]}))


def bars_figure():
    numbers = [f"gripper.finger.number_{k}" for k in range(8)]
    found = np.linspace(-2, 2.5, 24).reshape(3, 8)
    quantities = ["required pressure", "limit margin at required", "tip force at 31 kPa"]
    return plots.elasticities(
        xr.Dataset({"elasticity": (("quantity", "by"), found)}, {"quantity": quantities, "by": numbers})
    )


def search_figure():
    steps = np.arange(12)
    history = {
        "best_objective": 1.0 / (1 + steps),
        "with_equilibrium": 4 + steps,
        "feasible": steps,
        "moving": 16 - steps,
    }
    return plots.convergence(
        history,
        "pressure at required (kPa), least",
        "minimise the pressure at which the gripper just holds its object",
        finished=0.05,
    )


def long_search_figure():
    """Numbers of four digits beside the axis, whose name has two lines."""
    steps = np.arange(40)
    history = {"best_objective": 0.65 + 0.1 / (1 + steps), "with_equilibrium": 16 + 0 * steps}
    history |= {"feasible": 16 + 0 * steps, "moving": 16 - steps // 3}
    return plots.convergence(history, "best\n(start: 1)", "pressure", 0.64, np.linspace(1.35, 0.65, 40)[:, None])


def robust_figure():
    parts = np.linspace(0.9, 1.1, 50)
    casts = {name: plots.Cast(parts, parts - 1, 1.0) for name in ("nominal best", "robust best")}
    return plots.robust(casts, "tip force", "force", prices={"base_radius_mm": 0.1, "friction": 0.3})


def fit_figure():
    x = np.linspace(0, 20, 12)
    points = plots.Points("specimen one", x, 0.1 * x**2, x < 15)
    line = plots.Line("fitted: mu = 171 kPa", x, 0.1 * x**2, 0.1 * x)
    return plots.measured_and_fitted(
        [plots.Panel("free inflation", "pressure (kPa)", "inflation (mm)", [points], [line])] * 2
    )


OTHER_FIGURES = {
    "parallel": parallel_figure,
    "grid of one": lambda: grid_figure(1),
    "grid of two": lambda: grid_figure(2),
    "bars": bars_figure,
    "search": search_figure,
    "long search": long_search_figure,
    "parts of designs": robust_figure,
    "fit": fit_figure,
    "front of two": lambda: plots.front(
        np.array([[2e3, 1.2], [3e3, 1.4]]),
        ["required pressure", "limit margin"],
        ["pressure", "number"],
        ["minimise", "maximise"],
    ),
    "front of three": lambda: plots.front(
        np.array([[2e3, 1.2, 1.0], [3e3, 1.4, 2.0]]),
        ["required pressure", "limit margin", "tip force at 31 kPa"],
        ["pressure", "number", "force"],
        ["minimise", "maximise", "maximise"],
    ),
    "limit": lambda: plots.pressure_curve(MAKE["free"]()).figure,
    "diagrams": lambda: plots.diagrams(
        [plots.Diagram("force", "pressure (kPa)", "force (N)", [plots.Curve("model", np.arange(5.0), np.arange(5.0))])]
        * 3
    ),
}


@pytest.mark.parametrize("name", OTHER_FIGURES)
def test_no_word_of_any_other_figure_is_cut(name):
    figure = OTHER_FIGURES[name]()
    assert isinstance(figure, Figure)
    check_no_word_is_cut(figure)


def test_no_word_beside_tall_pictures_is_cut(solved, monkeypatch):
    """As of two grippers: the size of the figure, by which its ticks are chosen, is known last."""

    def paint(solution, axes):
        axes[0].set(xlim=(-48, 48), ylim=(-103.3, 11.2))

    monkeypatch.setattr(plots.figures, "look", lambda solution: plots.figures.Look(("x (mm)",), "height (mm)", paint))
    check_no_word_is_cut(plots.compare({"before": solved["free"], "after": solved["free"]}))


def test_designs_of_many_numbers_are_lines_through_parallel_axes():
    (ax,) = parallel_figure().axes
    labels = [text.get_text().replace("\n", " ") for text in ax.get_xticklabels()]
    assert labels[0] == "gripper. finger.a_x (mm)"
    assert labels[4] == "largest tip force at 31 kPa (N)"
    (lines,) = ax.collections
    answered = np.array(lines.get_segments())
    assert ax.get_title(loc="left") == "400 of 900 designs, coloured by largest tip force at 31 kPa"
    assert len(answered) + sum(len(line.get_xdata()) == 4 for line in ax.lines) == 400
    # The first quantity is the sum of the four numbers: the order of the lines on its axis is that of the sums.
    total = answered[:, :4, 1].sum(axis=1)
    assert np.corrcoef(total, answered[:, 4, 1])[0, 1] > 0.999
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["grey: beyond limit"]


def test_designs_without_a_limit_cross_their_axis_above_its_numbers():
    limit, status = np.array([20e3, np.inf, 30e3]), np.zeros(3, int)
    words = {"long_name": "limit pressure", "kind": "pressure", "status": "status_limit"}
    data = {"limit_pressure": (DESIGN, limit, words), "status_limit": (DESIGN, status, {})}
    figure = plots.study(xr.Dataset(data, {"shell.a": (DESIGN, np.array([1.0, 2.0, 3.0]) * mm, {"kind": "length"})}))
    (ax,) = figure.axes
    check_no_word_is_cut(figure)
    (lines,) = ax.collections
    ends = np.array(lines.get_segments())[:, 1, 1]
    np.testing.assert_allclose(ends[[0, 2]], [0, 1])
    assert 1 < ends[1] < ax.get_ylim()[1]
    assert [text.get_text() for text in ax.texts if text.get_position()[1] > 1] == ["no limit"]


def test_a_grid_over_three_numbers_has_a_picture():
    values = np.arange(24.0).reshape(2, 3, 4)
    axes = {
        name: (name, np.linspace(1e-3, 4e-3, n), {"kind": "length"})
        for name, n in zip("abc", values.shape, strict=True)
    }
    words = {"long_name": "force", "kind": "force", "status": "status"}
    status = np.zeros(values.shape, int)
    figure = plots.study(xr.Dataset({"f": (tuple("abc"), values, words), "status": (tuple("abc"), status, {})}, axes))
    (lines,) = figure.axes[0].collections
    seen = np.array(lines.get_segments())[:, :, 1]
    np.testing.assert_allclose(sorted(seen[:, 3]), np.linspace(0, 1, 24), atol=1e-12)
    np.testing.assert_allclose(np.unique(np.round(seen[:, 2], 9)), np.linspace(0, 1, 4), atol=1e-9)


def test_the_hatches_of_a_map_are_its_cells():
    """A design without an answer takes nothing of the cells beside it, and leaves nothing of its own."""
    x, y = np.array([1.0, 2.0, 4.0]), np.array([10.0, 20.0, 30.0])
    status = np.zeros((3, 3), int)
    status[1, 1] = Status.BEYOND_LIMIT
    values = np.where(status == 0, 1.0, np.nan)
    axes = {"a": ("a", x * mm, {"kind": "length"}), "b": ("b", y * mm, {"kind": "length"})}
    words = {"long_name": "force", "kind": "force", "status": "status"}
    data = xr.Dataset({"f": (("a", "b"), values, words), "status": (("a", "b"), status, {})}, axes)
    ax = plots.study(data).axes[0]
    hatched = [c for c in ax.collections if c.get_hatch() or isinstance(c, ContourSet)]
    assert hatched
    for drawn in hatched:
        corners = np.concatenate([path.vertices for path in drawn.get_paths() if len(path.vertices)])
        found = set(map(tuple, np.unique(np.round(corners, 9), axis=0).tolist()))
        assert found == {(1.5, 15.0), (3.0, 15.0), (1.5, 25.0), (3.0, 25.0)}


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


def sheet_of(ax):
    """The outline of the membrane: face and back, so many points each."""
    outline = max((p for p in ax.patches if isinstance(p, Polygon)), key=lambda p: len(p.get_xy())).get_xy()[:-1]
    return np.split(outline, 2)


@pytest.mark.parametrize("name", ["free", "flat", "cylinder", "inclined"])
def test_a_membrane_is_as_thick_as_its_stretches_leave_it(solved, name):
    """Its material keeps its volume, and the face that touches is the model's surface."""
    solution = solved[name]
    for ax in plots.draw(solution).axes:
        face, back = sheet_of(ax)
        np.testing.assert_allclose(face, membrane(ax))
        across = np.hypot(*(face - back[::-1]).T)
        stretches = np.asarray(
            solution.scene.stretches(solution.clamp_angle if name != "cylinder" else solution.contact_angle)
        )
        np.testing.assert_allclose(across, 1.1 / np.prod(stretches), rtol=1e-9)
        assert np.all(across < 1.1)
        middle = len(face) // 2
        assert face[middle, 1] > back[::-1][middle, 1]


@pytest.mark.slow
def test_an_energy_membrane_touches_its_plane_with_its_outer_face():
    """The middle surface does not: it is half the thickness below. The plane is drawn where the scene has it."""
    scene = sg.shell.FlatContact(shell(), distance=5 * mm, model="energy").prepared()
    solution = sg.solve(scene, 12 * kPa)
    figure = plots.draw(solution)
    check_no_word_is_cut(figure)
    for ax in figure.axes[:2]:
        face, back = sheet_of(ax)
        # Between the points where the contact is asked for, the polynomials go a little further.
        pressed = np.abs(face[:, 0]) < (25 if ax is figure.axes[0] else 5)
        assert np.all(np.abs(face[pressed, 1] - 5) < 0.12)
        assert np.median(face[pressed, 1]) == pytest.approx(5, abs=0.03)
        assert np.max(face[:, 1]) < 5.3
        across = np.hypot(*(face - back[::-1]).T)
        assert np.all((across[pressed] > 0.5) & (across[pressed] < 1.05))
        # The edge of the object that is drawn, by its contour.
        edges = [path.vertices for line in ax.collections for path in line.get_paths() if len(path.vertices)]
        assert min(np.min(vertices[:, 1]) for vertices in edges) == pytest.approx(5, abs=1e-6)
    assert [ax.get_aspect() for ax in figure.axes[:4]] == [1, 1, 1, 1]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in ("offset", "grasp") else name for name in MAKE]
)
def test_a_curve_through_the_limit_marks_it_and_dashes_what_is_unstable(name):
    """Dashed exactly where the pressure falls along the curve; the limit is one of its points."""
    scene = MAKE[name]()
    curve, limit = sg.branch(scene, 60), float(sg.limit_pressure(scene))
    pressure = np.asarray(curve.pressure)
    assert np.all(np.asarray(curve.status) == sg.Status.OK)
    assert np.max(pressure) == pytest.approx(limit, rel=1e-5)
    observable = next(iter(type(scene).OBSERVABLES))
    (ax,) = plots.curve_of(curve, observable, limit).axes
    check_no_word_is_cut(ax.figure)
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert f"limit {limit / kPa:.4g} kPa" in words
    (mark,) = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "o"]
    assert mark[0] == pytest.approx(limit / kPa, rel=1e-5)
    dashed = [line.get_xdata() for line in ax.lines if line.get_linestyle() == "--"]
    falls = np.diff(pressure) < 0
    assert sum(len(x) - 1 for x in dashed) == np.sum(falls)
    assert all(np.all(np.diff(x) < 0) for x in dashed)
    assert ("unstable at a given pressure" in words) == (name == "free") == bool(np.any(falls))


@pytest.mark.parametrize("material", ["half", "snaps", "size", "stiff"])
def test_a_branch_ends_at_a_sensible_size(material):
    """Against a scan of the load: half the limit, the limit again, ten half widths, or 20 mu t / a without a limit."""
    law = {
        "half": sg.NeoHookean(mu=175e3),
        "snaps": sg.Ogden(mu=[80e3, 200.0], alpha=[2.0, 5.0]),
        "size": sg.Ogden(mu=[150e3], alpha=[2.6]),
        "stiff": sg.Gent(mu=175e3, j_m=2.0),
    }[material]
    scene = sg.shell.Free(dataclasses.replace(shell(), material=law))
    curve = sg.branch(scene, 80)
    angles = np.linspace(1e-3, 2 * np.arctan(10), 20001)
    load = np.asarray(jax.jit(jax.vmap(scene.load))(angles))
    falls = np.flatnonzero(np.diff(load) < 0)
    top = falls[0] if falls.size else 0
    limit, behind = load[top], load[top + 1 :]
    most = 20 * float(scene.shell.pressure_scale())
    ends = {
        "half": np.flatnonzero(behind < 0.5 * limit) + top + 1,
        "snaps": np.flatnonzero(behind > limit) + top + 1,
        "size": np.array([20000]),
        "stiff": np.flatnonzero(~(load < most)),
    }
    if material != "stiff":
        assert falls.size
        del ends["stiff"]
    else:
        assert not np.any(np.diff(load[: ends["stiff"][0]]) < 0)
        ends = {"stiff": ends["stiff"]}
    first = min((found[0], name) for name, found in ends.items() if found.size)
    assert first[1] == material
    assert float(curve.clamp_angle[-1]) == pytest.approx(angles[first[0]], abs=0.006)
    assert np.all(np.asarray(curve.status) == sg.Status.OK)


@pytest.mark.parametrize("shape", ["turns", "ends", "dies behind", "rises again"])
def test_where_a_followed_path_turns_and_ends(shape):
    """Against the closed form of the load along the path."""
    s = np.arange(200.0)
    load = {
        "turns": 1 - ((s - 60.3) / 120) ** 2,
        "ends": s / 200,
        "dies behind": 1 - ((s - 60.3) / 120) ** 2,
        "rises again": 0.5 + (s / 50 - 1) * (s / 50 - 2) * (s / 50 - 3),
    }[shape]
    good = s < {"ends": 150, "dies behind": 90}.get(shape, 1000)
    fold, end = (float(v) for v in branch_marks(jnp.asarray(load), jnp.asarray(load), jnp.asarray(good)))
    if shape == "ends":
        assert fold == end == 149
    elif shape == "rises again":
        assert fold == pytest.approx(50 * (2 - 3**-0.5), abs=0.02)
        # It has fallen to half of the turn before it rises again, or stops at the lowest point.
        assert load[int(end)] >= 0.5 * np.max(load[:100])
    else:
        assert fold == pytest.approx(60.3, abs=1e-6)
        half = 60.3 + 120 * 0.5**0.5
        assert end == (89 if shape == "dies behind" else np.floor(half))


def test_a_path_behind_its_turn_ends_before_a_shape_that_is_not_told():
    s = np.arange(200.0)
    load = jnp.asarray(1 - ((s - 60.3) / 120) ** 2)
    fold, end = branch_marks(load, load, jnp.asarray(s < 1000), told=jnp.asarray((s < 90) & (s != 30)))
    assert (fold, end) == (pytest.approx(60.3, abs=1e-6), 89)


@pytest.mark.parametrize("bend", [-0.3, 0.0, 0.3])
def test_a_path_ends_where_its_model_does(bend):
    """Between two of its points, at the root of the place's own parabola."""
    s = np.arange(50.0)
    place = jnp.asarray(s / 50 + bend * (s / 50) ** 2)
    expected = next(root.real for root in np.roots([bend / 2500, 1 / 50, -0.47]) if 0 < root.real < 50)
    fold, end = branch_marks(place, place, jnp.asarray(s < 1000), 0.47)
    assert fold == end == pytest.approx(expected - JUST_BEFORE, abs=1e-9)


def test_a_branch_ends_with_the_law_and_not_a_step_before_it():
    scene = sg.pneunet.Free(sg.PneuNet.table_5_1("A"), drive="cell")
    curve = sg.branch(scene, 12)
    assert np.all(np.asarray(curve.status) == sg.Status.OK)
    assert float(jnp.max(curve.pressure)) == pytest.approx(0.24 * 136 * kPa, rel=1e-3)


@pytest.mark.parametrize("kind", ["equal", "different"])
def test_a_branch_of_chambers_that_snap_goes_through_its_limit(kind):
    """The curve of four segments that differ is as sharp as a hairpin there; that of equal ones ends where 16 points no
    longer tell the shape, well behind it."""
    finger = sg.PneuNet.table_5_1("A")
    h_x, t_m = {
        "equal": (4 * [finger.h_x / mm], 4 * [finger.t_m / mm]),
        "different": ([0.7, 0.8, 0.9, 1.0], [1.0, 1.1, 1.15, 1.2]),
    }[kind]
    finger = dataclasses.replace(finger, h_x=jnp.array(h_x) * mm, t_m=jnp.array(t_m) * mm)
    scene = sg.pneunet.TipContact(finger, drive="cell", ignored_rules=("chambers_apart",))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)
        curve, limit = sg.branch(scene), float(sg.limit_pressure(scene))
    assert np.all(np.asarray(curve.status) == sg.Status.OK)
    pressure = np.asarray(curve.pressure)
    assert np.max(pressure) == pytest.approx(limit, rel=1e-9)
    assert pressure[-1] < 0.98 * limit


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 12])
def test_a_branch_of_few_points_on_an_object_goes_through_its_limit(n):
    """Its steps are no longer for that; points before the limit are what `solve` finds there."""
    body = sg.shell.obstacles.Cylinder(20 * mm, 5 * mm)
    scene = sg.shell.ObstacleContact(shell(), body, symmetry="both", across=2, lengthwise=3)
    curve, limit = sg.branch(scene, n), float(sg.limit_pressure(scene))
    assert not np.any(np.asarray(curve.status) == sg.Status.NOT_CONVERGED)
    pressure = np.asarray(curve.pressure)
    top = int(np.argmax(pressure))
    assert pressure[top] == pytest.approx(limit, rel=1e-12)
    assert np.all(np.diff(pressure[: top + 1]) > 0)
    if n > 2:
        assert 3 < top < n - 3
        below = sg.solve(scene, pressure[top - 3])
        np.testing.assert_allclose(curve.unknowns[top - 3], below.unknowns, atol=1e-8)


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


def test_a_limit_behind_states_that_cannot_be_is_not_marked():
    """The chambers of type A overlap from 33.6 kPa on; its branch ends at 41.7 kPa."""
    ax = plots.pressure_curve(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A")))
    rising, falling = ax.lines
    assert np.nanmax(rising.get_ydata()) == pytest.approx(33.6, abs=0.2)
    assert np.isnan(rising.get_ydata()[-1])
    assert np.isnan(falling.get_ydata()).all()
    assert not ax.texts


def test_a_curve_has_gaps_where_states_are_not_ok(monkeypatch):
    scene = sg.shell.Free(shell())
    curve = sg.branch(scene)
    broken = dataclasses.replace(curve, status=curve.status.at[5:9].set(int(sg.Status.IMPOSSIBLE)))
    monkeypatch.setattr(figures, "branch", lambda scene: broken)
    rising, _, mark = plots.pressure_curve(scene).lines
    gaps = np.flatnonzero(np.isnan(rising.get_xdata()))
    np.testing.assert_array_equal(gaps, [5, 6, 7, 8])
    assert mark.get_ydata()[0] == pytest.approx(20.1756, rel=1e-5)


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
    np.testing.assert_array_equal(drawn["feasible so far"], history["feasible"])

    # What came of one step only is seen, and where it was finished.
    one = {name: values[2:] for name, values in history.items()}
    above, below = plots.convergence(one, finished=0.4).axes
    assert [(*line.get_xdata(), *line.get_ydata(), line.get_marker()) for line in above.lines] == [
        (1, 0.5, "o"),
        (2, 0.4, "o"),
    ]
    assert {line.get_marker() for line in below.lines} == {"o"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["free", "flat"])
def test_the_branch_of_an_energy_membrane_ends_behind_its_limit(name):
    """Free inflation has a limit point, as for arcs; on a plane it is the free band at the sides that gives way."""
    scene = {
        "free": sg.shell.Free(shell(), model="energy"),
        "flat": sg.shell.FlatContact(shell(), distance=5 * mm, model="energy"),
    }[name].prepared()
    curve, limit = sg.branch(scene, 40), float(sg.limit_pressure(scene))
    good = np.asarray(curve.status) == sg.Status.OK
    pressure = np.asarray(curve.pressure)[good]
    assert np.sum(good) >= 30
    assert np.max(pressure) <= limit * (1 + 1e-6)
    assert np.max(pressure) > 0.8 * limit
    assert pressure[-1] < 0.99 * limit
    assert limit > (15 if name == "free" else 60) * kPa
    (ax,) = plots.curve_of(curve, "inflation", limit).axes
    dashed = [line for line in ax.lines if line.get_linestyle() == "--"]
    assert dashed


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
    """Type A: 12 whole chambers of 6 mm in the middle of 77 mm, 2.5 mm of cover and half a gap at either end."""
    places = plots.finger.chamber_places(sg.PneuNet.table_5_1("A"))
    assert len(places) == 12
    np.testing.assert_allclose(
        [(p.first, p.last, p.height, p.wall) for p in places[:: len(places) - 1]],
        [(3.4, 7.6, 10.0, 1.1), (69.4, 73.6, 10.0, 1.1)],
    )
    assert [p.has_neighbour for p in places] == [True] * 11 + [False]


def test_a_wall_that_does_not_fit_is_drawn_and_named():
    finger = dataclasses.replace(sg.PneuNet.table_5_1("A"), t_m=3 * mm)
    scene = sg.pneunet.Free(finger, weight=None, inclination="none")
    line = plots.finger.straight(finger, 0.0)
    ax = Figure().subplots()
    plots.finger.paint_finger(ax, finger, line, plots.finger.inflated(scene, line, 20 * kPa), plots.finger.as_is)
    (words,) = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words == "walls 3 mm thick do not fit\ninto chambers 4.2 mm long"


LEANS = (0.0, 0.02, 0.12, 0.3, -0.05)
leaning_chambers = jax.jit(jax.vmap(sg.pneunet.chamber, (None, None, 0)))


@pytest.mark.parametrize("pressure", [1.0, 2.0, 12.0, 31.0])
def test_drawn_walls_are_those_of_the_wall_model(pressure):
    """The angle, by interpolation in the curve of the load, is the one that `solve` finds; below contact the wall is a
    free arc that touches nothing."""
    finger, p = sg.PneuNet.table_5_1("A"), pressure * kPa
    fields = {name: np.full(len(LEANS), float(getattr(finger, name))) for name in SEGMENT_FIELDS}
    drawn = walls.walls_at(finger, np.array(LEANS), p, fields)
    model = leaning_chambers(finger, p, jnp.array(LEANS))
    touches = np.asarray(model.status) == sg.Status.OK
    np.testing.assert_array_equal(drawn.touches, touches)
    np.testing.assert_allclose(drawn.angle[touches], np.asarray(model.clamp_angle)[touches], rtol=1e-4)
    np.testing.assert_allclose(drawn.stretch[touches], np.asarray(model.stretch)[touches], rtol=1e-5)
    for k, (lean, face) in enumerate(zip(LEANS, walls.outlines(drawn, 5 * mm, np.array(LEANS)), strict=True)):
        assert np.min(face[:, 0]) > -1e-6
        # From the edge on the cover, h_x from the plane, to the one above, 2 a away on a line that leans.
        edges = np.array([[0.9, 0.0], [0.9 + 10 * np.sin(lean), 10 * np.cos(lean)]]) * mm
        np.testing.assert_allclose(face[[0, -1]], edges, atol=1e-12)
        if touches[k] and lean == 0:
            np.testing.assert_allclose(np.ptp(face[face[:, 0] < 1e-9, 1]), model.contact_width[k], rtol=1e-4)
        elif not touches[k]:
            # Pressure times the chord is what both tensions hold of it: p a = 2 T sin(angle), T = mu t (1 - 1/l^6).
            stretch = drawn.angle[k] / np.sin(drawn.angle[k])
            held = 2 * 136e3 * 1.1 * mm * (1 - stretch**-6) * np.sin(drawn.angle[k]) / (5 * mm)
            assert held == pytest.approx(p, rel=1e-4) or np.min(face[:, 0]) < 1e-6


@pytest.fixture(scope="module")
def bent():
    return sg.solve(sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None, inclination="none"), 31 * kPa)


def test_neighbouring_chambers_of_a_drawn_finger_press_on_each_other(bent):
    """They lie on each other over the length of the model's contact, never in each other, and below contact apart."""
    line = plots.finger.line_of(bent)
    chambers = plots.finger.chambers_of(bent, line)
    finger = bent.scene.finger
    wall = sg.pneunet.chamber(finger, 31 * kPa, 0.5 * bent.tip_angle * finger.pitch / finger.L)
    assert len(chambers) == 12
    for k, (one, other) in enumerate(pairwise(chambers)):
        at = 2.5 + 6.0 * (k + 1)
        theta = np.interp(at, line["X"], line["theta"])
        foot = np.array([np.interp(at, line["X"], line[name]) for name in ("x", "y")])
        along = np.array([np.cos(theta), np.sin(theta)])
        before, after = (one.near_tip - foot) @ along, (other.near_clamp - foot) @ along
        assert np.max(before) == pytest.approx(0, abs=1e-6)
        assert np.min(after) == pytest.approx(0, abs=1e-6)
        flat = one.near_tip[before > -1e-6]
        # (4.33) measures the width by the stretch, the picture by what the arcs leave of the wall: they differ by 15 %.
        assert np.hypot(*np.ptp(flat, axis=0)) * mm == pytest.approx(float(wall.contact_width), rel=0.15)
    rest = plots.finger.inflated(bent.scene, plots.finger.straight(finger, 0.0), 1 * kPa)
    gaps = [np.min(other.near_clamp[:, 0]) - np.max(one.near_tip[:, 0]) for one, other in pairwise(rest)]
    assert 0.2 < np.min(gaps[:-1]) < 1.8
    (ax,) = plots.draw(bent).axes
    check_no_word_is_cut(ax.figure)
    filled = [c for c in ax.collections if isinstance(c, PolyCollection) and len(c.get_facecolor())]
    drawn = [path.vertices[:-1] for collection in filled for path in collection.get_paths()]
    for chamber in chambers:
        assert any(len(p) == len(chamber.outline()) and np.allclose(p, chamber.outline()) for p in drawn)


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


def test_parts_with_nothing_to_keep_have_no_panel_of_what_they_break():
    parts = np.linspace(0.9, 1.1, 50)
    free, some = np.full(50, -np.inf), np.where(parts < 1, -np.inf, 0.3)
    assert len(plots.robust({"best": plots.Cast(parts, free, 1.0)}, "tip force", "force").axes) == 1
    with_edge = plots.robust({"best": plots.Cast(parts, some, 1.0)}, "tip force", "force")
    assert np.all(np.isfinite(with_edge.axes[1].get_xlim()))
