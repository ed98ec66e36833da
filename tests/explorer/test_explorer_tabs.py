"""The explorer's tabs without a browser: a search that is seen, a calibration from a file, a study that is opened."""

import dataclasses
import shutil
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr
import zarr

import optim
import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.explorer.session import PRESSURE, Session, answer
from softgrip_jax.units import kPa, mm, unit_key

pytest.importorskip("panel", reason="Panel is missing: pip install softgrip_jax[explore]")
from optim.calibration.data import heading_of
from optim.design.descent import Design, SearchResult
from optim.tabs.calibrate import LARGEST, CalibrateTab, header_of
from optim.tabs.search import KEEPING, MARGIN, NOTHING, SearchTab
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.explorer.looks import FULL, ROOM, Axis
from softgrip_jax.explorer.page import Page
from softgrip_jax.explorer.study import Studied, StudyTab, binned_mean, open_study, studies_beneath

pytestmark = pytest.mark.filterwarnings("ignore")

WALL, GAP = "shell.t_m_mm", "distance_mm"


def plane():
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    return sg.shell.FlatContact(shell, distance=5 * mm)


class StubPage(Page):
    """What tabs need of a page, with everything done at once in the thread that asks for it."""

    def __init__(self, scene):
        self.document = None
        self.session, self.after_opening, self.opened, self.threads = Session(scene, 15 * kPa), [], [], []
        self._lock = threading.RLock()

    def later(self, act):
        with self._lock:
            act()

    def in_background(self, work):
        self.threads.append(threading.Thread(target=work, args=(lambda *words: None,), daemon=True))
        self.threads[-1].start()
        return self.threads[-1]

    def open_scene(self, scene, at=None):
        self.opened.append((scene, at))
        self.session.open(scene, at)
        for act in self.after_opening:
            act()

    def wait(self):
        for thread in self.threads:
            thread.join(60)
            assert not thread.is_alive()


@pytest.fixture
def page():
    return StubPage(plane())


def search_tab(page, starts=8):
    tab = SearchTab(page)
    tab.ticks.boxes.value, tab.goal.value, tab.starts.value = [WALL, GAP], "maximise", starts
    return tab


# --- search -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_search_finds_what_optim_finds(page, monkeypatch):
    monkeypatch.setattr("optim.tabs.search.STEPS", 12)
    tab = search_tab(page)
    frames = []
    tab.points.on_change("data", lambda attribute, old, new: frames.append(len(new["x"])))
    for name in ("POINTS_SECONDS", "STEP_SECONDS"):
        monkeypatch.setattr(f"optim.tabs.search.{name}", 0.0)
    tab.run()
    assert tab.is_running
    tab.run()
    assert tab.line.text == "A search runs already; stop it first."
    page.wait()
    numbers = page.session.numbers
    bounds = {"shell.t_m": numbers[WALL], "distance": numbers[GAP]}
    moving = [optim.Variable(name, n.low, n.high, "log" if n.is_log else "linear") for name, n in bounds.items()]
    force, margin = (optim.Quantity(name, at=15 * kPa) for name in ("force", "limit_margin"))
    problem = optim.Problem(
        optim.Space({"scene": plane()}, moving), [optim.Goal("maximise", force)], [optim.Limits(margin, low=MARGIN)]
    )
    assert tab.found is not None, tab.line.text
    direct = optim.search(problem, starts=8, steps=12)
    np.testing.assert_array_equal(tab.found.best.x, direct.best.x)
    assert tab.found.best.feasible
    assert max(frames) > 1
    assert len(frames) == 12  # one a step; the last of all is that of the last step
    assert "Done after" in tab.line.text
    assert tab.shape.views
    tab.open_best()
    assert page.session.values[WALL] == pytest.approx(direct.best.x[0], rel=1e-12)
    assert page.opened[-1][1] == page.session.values[PRESSURE] == 15 * kPa
    found = sg.solve(page.session.current(), 15 * kPa)
    assert float(found.force) == pytest.approx(direct.best.values[0], rel=1e-9)
    assert list(tab.ticks.boxes.value) == [WALL, GAP]
    # A search from there has the same programs: all that differs are numbers that move.
    assert tab.ask().about() == tab.asked.about() != ""
    page.session.type_in("shell.material.mu_kPa", "176")
    assert tab.ask().about() != tab.asked.about()
    # Another scene may have other numbers: what it lacks is ticked no more, and cannot be searched.
    page.open_scene(sg.shell.Free(plane().shell))
    assert list(tab.ticks.boxes.value) == [WALL]


def test_a_goal_that_the_task_fixes_is_no_goal():
    """It searched for the largest force at the pressure that gives this force, to the end, and said "Done"."""
    page = StubPage(plane())
    page.session = Session(plane(), None, {"force": 4.0})
    tab = SearchTab(page)
    assert (tab.goal.value, tab.observable.value) == ("minimise", "pressure")
    tab.ticks.boxes.value, tab.starts.value = [WALL], 8
    tab.goal.value, tab.observable.value = "maximise", "force"
    tab.run()
    page.wait()
    assert tab.found is None
    assert tab.line.is_wrong
    assert "force is 4 N at the pressure that the task needs, whatever is ticked; choose another" in tab.line.text


def test_the_best_is_opened_as_it_was_sought():
    """A pressure that was moved after the search held for the best of the task, too: another state than was told."""
    page = StubPage(plane())
    page.session = Session(plane(), None, {"force": 4.0})
    tab = SearchTab(page)
    tab.ticks.boxes.value = [WALL]
    tab.asked = tab.ask()
    problem = tab.asked.problem()
    tab.found = SimpleNamespace(problem=problem, best=SimpleNamespace(x=problem.space.reference))
    page.session.type_in(PRESSURE, "15")
    assert not page.session.own_task
    tab.open_best()
    assert page.session.own_task
    assert page.session.task == {"force": 4.0}


def test_stop_keeps_the_best(page):
    tab = search_tab(page)
    seen = []

    def watch(attribute, old, new):
        seen.append(new)
        if len(seen) == 3:
            tab.stop()

    tab.points.on_change("data", watch)
    tab.run()
    page.wait()
    assert tab.found.stopped
    assert len(tab.found.paths) < 100
    assert "Stopped, and not finished" in tab.line.text
    assert tab.found.best.feasible
    assert tab.found.best.values[0] > tab.found.reference.values[0]
    assert not tab.open_button.disabled
    tab.open_best()
    assert page.session.values[GAP] == pytest.approx(tab.found.best.x[1], rel=1e-12)


def test_a_search_of_nothing_is_told(page):
    tab = SearchTab(page)
    tab.run()
    assert tab.line.text == "Nothing may move; tick at least one number."
    tab.ticks.boxes.value = [WALL]
    tab.goal.value = "reach"
    assert tab.target.visible
    for text in ("", "abc", "__import__('os')", "nan"):
        tab.target.value = text
        tab.run()
        assert tab.line.text == f"The target is {text!r}; it must be a finite number in N."
    assert tab.line.is_wrong
    assert not page.threads


@pytest.mark.slow
def test_a_search_keeps_another_observable_within_a_bound(page, monkeypatch):
    """The largest force that has a contact no wider than 12 mm: the bound decides, and the best lies on it."""
    monkeypatch.setattr("optim.tabs.search.STEPS", 60)
    tab = search_tab(page)
    row, other = tab.keeps
    assert not row.bound.visible
    row.observable.value = "contact_half_width"
    assert row.bound.visible
    assert row.bound.name == "value (mm)"
    row.side.value = "most"
    for text in ("", "wide"):
        row.bound.value = text
        tab.run()
        assert tab.line.text == f"The bound of contact half width is {text!r}; it must be a finite number in mm."
    row.bound.value = "6"
    tab.run()
    page.wait()
    best = tab.found.best
    assert best.feasible
    tab.open_best()
    found = sg.solve(page.session.current(), 15 * kPa)
    assert float(found.contact_half_width) == pytest.approx(6 * mm, rel=1e-6)
    # What another scene does not have is no longer asked for.
    page.open_scene(sg.shell.Free(plane().shell))
    assert row.observable.value == NOTHING == other.observable.value


# --- calibration ------------------------------------------------------------------------------------------------------


def measured(mu=160 * kPa, unit="kPa"):
    """A curve of a softer shell with a ripple, as CSV."""
    scene = sg.shell.FlatContact(
        sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=mu)), 5 * mm
    )
    pressures = np.linspace(8, 20, 9) * kPa
    forces = np.asarray(sg.path(scene, pressures).force) * (1 + 0.01 * np.cos(7 * np.arange(9)))
    factor = {"kPa": kPa, "mbar": 100.0}[unit]
    rows = "\n".join(f"{p / factor!r};{force!r}" for p, force in zip(pressures.tolist(), forces.tolist(), strict=True))
    return f"# a test\nrig 3\npressure_{unit};force (N)\n{rows}\n", pressures, forces


@pytest.mark.slow
def test_a_calibration_from_text_is_that_of_optim(page):
    text, pressures, forces = measured(unit="mbar")
    tab = CalibrateTab(page)
    tab.upload("rig.csv", text.encode())
    assert (tab.x_column.value, tab.x_unit.value) == ("pressure_mbar", "mbar")
    assert (tab.y_column.value, tab.y_unit.value) == ("force (N)", "N")
    tab.ticks.boxes.value = ["shell.material.mu_kPa"]
    tab.run()
    page.wait()
    assert tab.findings is not None, tab.line.text
    number = page.session.numbers["shell.material.mu_kPa"]
    moving = [optim.Variable("shell.material.mu", number.low, number.high, "log")]
    curve = optim.Curve("rig", "scene", "force", "force", pressures, forces)
    direct = optim.calibrate(optim.Fitting({"scene": plane()}, moving, [curve]))
    fit = tab.findings.fit
    np.testing.assert_allclose(fit.x, direct.x, rtol=1e-9)
    np.testing.assert_allclose([fit.low, fit.high], [direct.low, direct.high], rtol=1e-6)
    assert f"{direct.low[0] / kPa:.5g} to {direct.high[0] / kPa:.5g} kPa" in tab.table.object
    assert "9 of 9 points" in tab.line.text
    assert len(tab.pictures.objects) == 2
    tab.use()
    assert page.session.values["shell.material.mu_kPa"] == pytest.approx(direct.x[0], rel=1e-9)
    assert abs(page.session.values["shell.material.mu_kPa"] / (160 * kPa) - 1) < 0.02


@pytest.mark.parametrize(
    ("header", "units"),
    [
        ("Pressure (PSI),Force (mN)", ("psi", "mN")),
        ("p (mBar),force_N", ("mbar", "N")),
        ("p / kPa,F/kN", ("kPa", "kN")),
        ("P_MPA,force n", ("MPa", "N")),
    ],
)
def test_units_are_read_from_headings_in_any_case(page, header, units):
    tab = CalibrateTab(page)
    tab.upload("rig.csv", f"{header}\n1,2\n2,3\n")
    assert (tab.x_unit.value, tab.y_unit.value) == units
    assert tab.line.text.endswith(f"is read in {units[0]}. {header.split(',')[1]!r} is read in {units[1]}.")
    assert not tab.line.is_wrong


@pytest.mark.parametrize(
    ("header", "unknown", "known"),
    [
        ("p_kPa,Force (lbf)", "'Force (lbf)': 'lbf'", "N, mN, kN"),
        ("p_hPa,force_N", "'p_hPa': 'hPa'", "kPa, Pa, MPa, bar, mbar, psi"),
        ("p (mPa),force_N", "'p (mPa)': 'mPa'", "kPa, Pa, MPa, bar, mbar, psi"),
        ("p_kPa,force_MN", "'force_MN': 'MN'", "N, mN, kN"),
        ("p_kPa,force_kPa", "'force_kPa': 'kPa'", "N, mN, kN"),
    ],
)
def test_a_unit_that_is_not_known_is_asked_for(page, header, unknown, known):
    """Such a column was read in kPa or N without a word."""
    tab = CalibrateTab(page)
    tab.upload("rig.csv", f"{header}\n1,2\n2,3\n")
    sentence = f"{unknown} is none of the units {known}; choose one of them."
    assert sentence in tab.line.text
    assert tab.line.is_wrong
    with pytest.raises(InputError, match="choose one of them"):
        tab.curve()
    column = next(one for one in (tab.x_unit, tab.y_unit) if one.value == "?")
    column.value = column.options[2]
    assert tab.curve().x.shape == (2,)


def test_a_heading_without_a_unit_is_told(page):
    """The unit that it is read in is that of the menu; another column leaves what was chosen."""
    tab = CalibrateTab(page)
    tab.upload("rig.csv", "pressure,force,force 2\n1,2,3\n2,3,4\n")
    assert "'pressure' names no unit and is read in kPa. 'force' names no unit and is read in N." in tab.line.text
    tab.x_unit.value = "psi"
    tab.y_column.value = "force 2"
    assert tab.x_unit.value == "psi"
    assert "'pressure' names no unit and is read in psi." in tab.line.text


def test_units_of_headings_are_those_of_their_kind():
    for name, kind, unit in (
        ("moment_N_mm", "moment", "N mm"),
        ("M (N·m)", "moment", "N m"),
        ("area_mm2", "area", "mm^2"),
        ("A (cm²)", "area", "cm^2"),
        ("angle [°]", "angle", "deg"),
        ("weight_N_per_m", "force_per_length", "N/m"),
        ("Pressure (gauge) [kPa]", "pressure", "kPa"),
        ("strain %", "number", "%"),
    ):
        assert heading_of(name, kind).unit == unit, name
        assert (unit_key("x", kind) == "x") or heading_of(unit_key("x", kind), kind).unit is not None
    for name in ("pressure", "p_in", "pressure_left", "p", "run.1"):
        assert heading_of(name, "pressure") == (None, ""), name


POINTS = "decimals need a point."


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe\x00", "rig.csv: this is not a text file in UTF-8 (byte 0)."),
        (
            b"",
            "rig.csv: there is no header line with two names of columns above a line of numbers; " + POINTS,
        ),
        (
            b"1,2\n3,4\n",
            "rig.csv: there is no header line with two names of columns above a line of numbers; " + POINTS,
        ),
        (b"x" * (LARGEST + 1), "rig.csv: the file has 2,097,153 bytes; it may have 2,097,152 at most."),
    ],
)
def test_a_file_that_is_no_curve_is_told(page, content, words):
    tab = CalibrateTab(page)
    tab.upload("rig.csv", content)
    assert (tab.line.text, tab.line.is_wrong) == (words, True)
    tab.run()
    assert tab.line.is_wrong
    assert not page.threads


def test_a_fit_of_bad_numbers_is_told(page):
    tab = CalibrateTab(page)
    tab.run()
    assert tab.line.text == "Nothing may move; tick at least one number."
    tab.ticks.boxes.value = ["shell.material.mu_kPa"]
    tab.run()
    assert tab.line.text == "There is no measured curve; drop a CSV file first."
    tab.upload("rig.csv", "p_kPa,force_N\n5,1\n10,two\n")
    tab.run()
    assert tab.line.text == "rig.csv, line 3: force_N is 'two'; it must be a finite number."
    tab.upload("rig.csv", "p_kPa,force_N\n-5,1\n10,2\n")
    tab.run()
    assert "a pressure of curve 'rig' is -5 kPa" in tab.line.text
    tab.y_column.value = "p_kPa"
    tab.run()
    assert tab.line.text == "Column 'p_kPa' is both pressure and measurement; choose another one."


def test_headers_are_found_beneath_preambles():
    assert header_of("made by hand\nat 20 C\np, bar\th\n1\t2\n3\t\n", "f") == ["p, bar", "h"]
    with pytest.raises(ConfigError, match="no header line"):
        header_of("a b c\n1 2 3\n", "f")


# --- study ------------------------------------------------------------------------------------------------------------

SWEEP = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
[scene.shell.material]
type = "NeoHookean"
mu_kPa = 175
[sweep]
method = "grid"
[[sweep.variables]]
name = "shell.t_m_mm"
values = [0.9, 1.1, 1.3]
[[sweep.variables]]
name = "distance_mm"
values = [4, 5]
[[sweep.observables]]
name = "force_N"
at = { pressure_kPa = 12 }
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A folder with a study, as `softgrip sweep` leaves it, a link to one outside, and things that are none."""
    from softgrip_jax.commands.sweep import read

    base = tmp_path_factory.mktemp("base")
    root, outside = base / "here", base / "outside"
    for folder in (root / "runs" / "walls", outside):
        folder.mkdir(parents=True)
        (folder / "config.toml").write_text(SWEEP, encoding="utf-8")
        study, identity = read(configs.load(folder / "config.toml"))
        sg.study.run_in(folder, study, identity)
    (root / "runs" / "link").symlink_to(outside)
    (root / "runs" / "sly").mkdir()
    (root / "runs" / "sly" / "study.zarr").symlink_to(outside / "study.zarr")
    (root / ".hidden").mkdir()
    return root


def test_studies_are_listed_inside_the_folder_only(root):
    assert list(studies_beneath(root)) == ["runs/walls"]
    for place in (root / "runs" / "link", root / "runs" / "sly", root / ".." / "outside"):
        with pytest.raises(ConfigError, match="where the explorer was started"):
            open_study(place, root)


def test_a_click_opens_the_design(page, root):
    page.session.type_in(PRESSURE, "20")
    tab = StudyTab(page, root)
    assert list(tab.menu.options) == ["runs/walls"]
    tab.open()
    page.wait()
    assert tab.study is not None, tab.line.text
    assert tab.line.text.startswith("6 designs")
    k = 4
    tab.points.selected.indices = [k]
    scene, pressure = page.opened[-1]
    wall, gap = tab.study.rows["shell.t_m"][k], tab.study.rows["distance"][k]
    assert (wall, gap) == (pytest.approx(1.3 * mm), pytest.approx(4 * mm))
    assert pressure == pytest.approx(12 * kPa)
    assert float(scene.shell.t_m) == wall
    assert float(scene.distance) == gap
    stored = tab.study.rows["force_at_12_kPa"][k]
    assert float(sg.solve(scene, 12 * kPa).force) == pytest.approx(stored, rel=1e-9)
    assert tab.points.data["y"][k] == pytest.approx(stored)
    # Marks on a parallel axis: the others are faint.
    tab.brush([{"dimensions[0].constraintrange": [[1.0, 1.2]]}, [0]])
    faint = np.asarray(tab.points.data["alpha"]) < 0.5
    np.testing.assert_array_equal(faint, np.abs(tab.study.rows["shell.t_m"] - 1.1 * mm) > 1e-6)
    tab.brush([{"dimensions[0].constraintrange": None}, [0]])
    assert np.all(np.asarray(tab.points.data["alpha"]) > 0.5)


def test_a_map_has_the_means(root):
    study = open_study(root / "runs" / "walls", root)
    x_edges, y_edges, mean, count = binned_mean(study, "shell.t_m", "distance", "force_at_12_kPa")
    np.testing.assert_allclose(x_edges, np.array([0.8, 1.0, 1.2, 1.4]) * mm)
    np.testing.assert_allclose(y_edges, np.array([3.5, 4.5, 5.5]) * mm)
    np.testing.assert_array_equal(count, 1)
    np.testing.assert_allclose(mean, study.data["force_at_12_kPa"].values)
    study.data.close()


TWO_SCENES = """
[scenes.free]
type = "shell.Free"
[scenes.flat]
type = "shell.FlatContact"
distance_mm = 5
[sweep]
method = "csv"
file = "designs.csv"
observables = [
    { name = "free.inflation_mm", at = { pressure_kPa = 12 } },
    { name = "flat.force_N", at = { pressure_kPa = 12 } },
    { name = "flat.pressure_kPa", at = { force_N = 4 } },
]
"""
SHELL = 'a_mm = 16\nb_mm = 43\nt_m_mm = 1.1\nmaterial = { type = "NeoHookean", mu_kPa = 175 }\n'


@pytest.fixture(scope="module")
def of_csv(tmp_path_factory):
    """A study of two scenes that share what a CSV varies."""
    from softgrip_jax.commands.sweep import read
    from softgrip_jax.report.inputs import keep_inputs

    given, folder = tmp_path_factory.mktemp("given"), tmp_path_factory.mktemp("csv")
    shells = "".join(f"[scenes.{name}.shell]\n{SHELL}" for name in ("free", "flat"))
    (given / "config.toml").write_text(TWO_SCENES + shells, encoding="utf-8")
    # With the mark that spreadsheets put before a text.
    (given / "designs.csv").write_text("shell.t_m_mm\n1.0\n1.3\n", encoding="utf-8-sig")
    study, identity = read(configs.load(given / "config.toml"))
    sg.study.run_in(folder, study, identity)
    keep_inputs(folder, given / "config.toml")
    return folder


def test_a_design_of_a_csv_is_opened_in_every_scene(page, of_csv):
    """Of numbers that scenes share only that of the first scene moved."""
    tab = StudyTab(page, of_csv)
    tab._show(open_study(of_csv, of_csv))
    for name, observable in (("free.inflation", "inflation"), ("flat.force", "force")):
        [quantity] = [one for one in tab.study.quantities if one.startswith(name)]
        tab.y.value = quantity
        for row, wall in enumerate((1.0 * mm, 1.3 * mm)):
            tab.open_design(row)
            scene, pressure = page.opened[-1]
            assert float(scene.shell.t_m) == pytest.approx(wall)
            found = sg.solve(scene, pressure)
            assert float(found.observables[observable]) == pytest.approx(tab.study.rows[quantity][row], rel=1e-9)


def test_a_csv_outside_of_the_folder_is_not_read(of_csv, tmp_path):
    root = tmp_path / "here"
    shutil.copytree(of_csv, root)
    (root / "designs.csv").rename(tmp_path / "designs.csv")
    (root / "designs.csv").symlink_to(tmp_path / "designs.csv")
    with pytest.raises(ConfigError, match="where the explorer was started"):
        open_study(root, root)


def test_a_design_at_a_task_is_opened_at_that_task(of_csv):
    """The page's scene, which has no force, was asked whether it can be looked for."""
    page = StubPage(sg.shell.Free(plane().shell))
    tab = StudyTab(page, of_csv)
    tab._show(open_study(of_csv, of_csv))
    [tab.y.value] = [one for one in tab.study.quantities if one.startswith("flat.pressure")]
    tab.open_design(1)
    session = page.session
    assert (session.own_task, session.task) == (True, {"force": 4.0})
    question = session.question()
    session.take(question, next(answer(question)))
    assert session.values[PRESSURE] == pytest.approx(tab.study.rows[tab.y.value][1], rel=1e-9)


def test_a_margin_of_undeformed_parts_has_no_task(of_csv, page):
    """Its state, "rest", was taken for the task of the scene."""
    page.session = Session(plane(), None, {"force": 4.0})
    tab = StudyTab(page, of_csv)
    tab._show(open_study(of_csv, of_csv))
    rest = sg.Quantity("margins.walls_fit", "rest", "flat")
    tab.study = dataclasses.replace(tab.study, asked={tab.y.value: rest})
    tab.open_design(0)
    assert (page.session.own_task, page.session.task) == (True, {"force": 4.0})


def test_starts_that_have_come_to_one_corner_are_no_fault(page, monkeypatch):
    """Only at the first step is a goal that all of them share one that nothing changes."""

    def converging(problem, report, evaluator, **_):
        batch = evaluator(problem, 8).batch
        batch.t[:], batch.state[:] = 0.5, KEEPING
        for step, spread in ((1, 1.0), (2, 0.0)):
            batch.value[:] = 4.0 + spread * np.arange(len(batch.value))
            report(step, 4.0, 8, 8)
        raise InputError("It came to the second step.")

    monkeypatch.setattr("optim.tabs.search.search", converging)
    tab = search_tab(page)
    tab.run()
    page.wait()
    assert tab.line.text == "It came to the second step."


def test_what_a_search_remarks_is_shown(page, monkeypatch):
    """The command printed it; the page had no word about it."""
    design = Mock(spec=Design, x=np.array([1 * mm, 5 * mm]), values=np.array([4.0, 2.0]), active=(), feasible=True)
    parts = {"best": design, "reference": design, "solves": 8, "stopped": False}

    def found(problem, evaluator, **_):
        evaluator(problem, 8)
        remarks = ("At 15 kPa a < b.", "The start is outside.")
        return Mock(spec=SearchResult, problem=problem, remarks=remarks, **parts)

    monkeypatch.setattr("optim.tabs.search.search", found)
    tab = search_tab(page)
    tab.run()
    page.wait()
    assert tab.found is not None, tab.line.text
    assert "<li>At 15 kPa a &lt; b.</li><li>The start is outside.</li>" in tab.table.object


def test_what_has_to_be_compiled_is_said(page):
    """A first pressure after a task was silent for seconds, below the error of what was typed before."""
    said, asked = [], []
    page._answered, page.say, page.work = set(), lambda *words: said.append(words), SimpleNamespace(ask=asked.append)
    greyed = page._grey, page._show_last_rows = Mock(), Mock()
    page.ask()
    page._answered.add(asked[0].form)
    page.session.type_in(WALL, "1.2")
    page.ask()
    assert asked[0].values != asked[1].values
    assert said == []  # the page says it of its first picture; other numbers go through the same program
    assert not any(call.called for call in greyed)
    page.session = Session(plane(), None, {"force": 4.0})
    page.ask()
    assert said == [("compiling ...",)]
    assert all(call.called for call in greyed)  # what is drawn until then is of the state before
    assert (
        dataclasses.replace(asked[0], pressure=None).form != asked[0].form
    )  # what a scene itself is to do has no task


def test_a_mean_leaves_out_what_has_no_limit_and_what_has_no_answer():
    """inf, and the 1e6 that studies had in its place; 1e6 of anything else is a value. A margin is known of designs
    that cannot exist, and without contact the force is 0: neither is an answer."""
    values = np.array([[2.0, 1e6], [np.inf, np.nan], [3.0, 5.0], [1.2, 0.0]])
    statuses = np.array([[0, 0], [0, 0], [0, 0], [3, 1]])
    names = ("limit_margin_at_12_kPa", "force_at_12_kPa")
    data = xr.Dataset(
        {name: (("x", "y"), values, {"status": "status_at_12_kPa"}) for name in names}
        | {"status_at_12_kPa": (("x", "y"), statuses)},
        {"x": np.arange(4.0), "y": [0, 1]},
    )
    study = Studied(data, ["x", "y"], list(names), {}, {}, None, {})
    for name, of_large in zip(names, (np.nan, 1e6), strict=True):
        mean, count = binned_mean(study, "x", "y", name)[2:]
        np.testing.assert_array_equal(mean, [[2, of_large], [np.nan, np.nan], [3, 5], [np.nan, np.nan]])
        np.testing.assert_array_equal(count, np.isfinite(mean))


def test_a_damaged_study_is_told(page, tmp_path):
    (tmp_path / "study.zarr").mkdir()
    (tmp_path / "study.zarr" / "zarr.json").write_text("{}", encoding="utf-8")
    tab = StudyTab(page, tmp_path)
    assert list(tab.menu.options) == ["."]
    tab.open()
    page.wait()
    assert tab.line.is_wrong
    assert "\n" not in tab.line.text
    empty = tmp_path / "empty"
    empty.mkdir()
    tab = StudyTab(page, empty)
    tab.open()
    assert tab.line.text == "There is no study to open."


def test_a_study_of_another_version_is_told(page, root, tmp_path):
    """A status or a kind that is not known here left the line at "reading ..." for ever, and the study before on the
    axes, whose points opened designs of the new one."""
    kind = tmp_path / "kind"
    shutil.copytree(root / "runs" / "walls", kind)
    file = kind / "study.zarr" / "force_at_12_kPa" / "zarr.json"
    file.write_text(file.read_text(encoding="utf-8").replace('"force"', '"novel"'), encoding="utf-8")
    shutil.copytree(root / "runs" / "walls", tmp_path / "status")
    codes = zarr.open_group(tmp_path / "status" / "study.zarr", mode="r+")["status_12_kPa"]
    codes[:] = np.full(codes.shape, 9, codes.dtype)
    tab = StudyTab(page, tmp_path)
    for name, words in (
        ("kind", "force_at_12_kPa is of the kind 'novel'"),
        ("status", "status_12_kPa has the status 9"),
    ):
        tab.menu.value = name
        tab.open()
        page.wait()
        assert tab.study is None
        assert tab.line.text.endswith(f"{words}, which this version of softgrip_jax does not know.")
        assert tab.line.is_wrong


def test_the_study_that_was_asked_for_last_is_shown(page, root, monkeypatch):
    """One that was read slowly took the place of it."""
    from softgrip_jax.explorer import study

    gate, shown = threading.Event(), []

    def read(place, root):
        if place.name == "b":
            raise InputError("b is no study.")
        assert gate.wait(10)
        return place.name

    monkeypatch.setattr(study, "open_study", read)
    tab = StudyTab(page, root)
    tab.places, tab._show = {"a": root / "a", "b": root / "b"}, shown.append
    tab.menu.param.update(options=["a", "b"], value="a")
    tab.open()
    tab.menu.value = "b"
    tab.open()
    gate.set()
    page.wait()
    assert (shown, tab.line.text) == ([], "b is no study.")


def test_an_axis_stays_while_it_fits():
    """From 0 to 10 with 12 % of room; it moves where something leaves it, or where too little of it is used."""
    axis = Axis()
    ends = lambda: (axis.range.start, axis.range.end)  # noqa: E731
    axis.hold([0.0, 10.0, np.nan])
    assert ends() == (-10 * ROOM, 10 + 10 * ROOM) == (axis.range.reset_start, axis.range.reset_end)
    wide = 10 * (1 + 2 * ROOM)
    axis.hold([0.0, 1.01 * FULL * wide])
    assert ends() == (-10 * ROOM, 10 + 10 * ROOM)
    axis.hold([0.0, 0.99 * FULL * wide])
    assert ends()[1] == pytest.approx(0.99 * FULL * wide * (1 + ROOM))
    axis.hold([-5.0, 20.0])
    assert ends() == (-5 - 25 * ROOM, 20 + 25 * ROOM)
    axis.hold([3.0])
    assert ends() == (2.7, 3.3)
    axis.hold([])
    assert ends() == (2.7, 3.3)
