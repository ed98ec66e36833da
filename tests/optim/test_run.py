"""A run: its folder is complete or not there, and tells tomorrow what was found today."""

import dataclasses
import errno
import io
import json
import shlex
import signal

import numpy as np
import pytest
from conftest import ROOT
from rich.console import Console

import optim
import softgrip_jax as sg
from optim import records
from optim.design import run as runs
from optim.design import settings
from softgrip_jax import config as configs
from softgrip_jax.cli import STOPPED, run
from softgrip_jax.commands import sweep as sweeps
from softgrip_jax.config import ConfigError
from softgrip_jax.folders import new_folder
from softgrip_jax.results import Status
from softgrip_jax.units import kPa, mm

FILES = {
    "config.toml",
    "best.toml",
    "designs.csv",
    "history.csv",
    "result.json",
    "before_after.png",
    "convergence.png",
    "report.html",
    "summary.txt",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The config of the project with fewer starts: (config, run folder, what was printed, result of the search)."""
    folder = tmp_path_factory.mktemp("runs")
    text = (ROOT / "configs" / "shell_grasp.toml").read_text().replace("starts = 32", "starts = 8")
    config = folder / "small.toml"
    config.write_text(text.replace("steps = 10\n", "steps = 30\n"))
    printed, kept = io.StringIO(), []
    original = runs.search
    try:
        runs.search = lambda *args, **kwargs: kept.append(original(*args, **kwargs)) or kept[0]
        out = runs.run_design(config, folder / "one", Console(file=printed, width=120))
    finally:
        runs.search = original
    return config, out, printed.getvalue(), kept[0]


def test_the_folder_is_complete(finished):
    config, out, _, _ = finished
    assert {path.name for path in out.iterdir()} == FILES
    assert (out / "config.toml").read_bytes() == config.read_bytes()
    assert all((out / name).stat().st_size > 5000 for name in FILES if name.endswith(".png"))
    assert sorted(path.name for path in out.parent.iterdir()) == ["one", "small.toml"]


def test_the_model_s_error_is_told_of_what_is_asked(finished):
    printed = " ".join(finished[2].split())
    assert "pressure: where it is the required one, 8 to " in printed
    assert "force, force z" not in printed  # nobody asked


def test_the_best_design_solves_to_the_reported_pressure(finished):
    _, out, _, _ = finished
    scene = configs.load(out / "best.toml").scene
    solution = sg.pressure_for(scene)
    reported = json.loads((out / "result.json").read_text())["best"]
    assert int(solution.status) == Status.OK
    assert float(solution.pressure) == pytest.approx(reported["quantities"]["pressure at required"], rel=1e-9)
    assert float(sg.limit_pressure(scene) / solution.pressure) >= 1.25 * (1 - 1e-6)
    assert float(solution.stretch) <= 1.3


def test_the_search_improves_on_the_thesis(finished):
    """Its gripper gives 2.870 N at 10.901 kPa (an independent SciPy solution of its equations); 563 g need 2.877 N."""
    _, out, _, _ = finished
    result = optim.load_run(out).result
    assert result["start"]["quantities"]["pressure at required"] == pytest.approx(10.901e3, rel=1.5e-3)
    assert result["best"]["feasible"]
    assert result["best"]["quantities"]["pressure at required"] < 5e3


def test_a_run_is_opened_in_one_call(finished):
    _, out, _, result = finished
    run = optim.load_run(out)
    assert run.result["search"]["starts"] == 8
    assert run.result["versions"].keys() == {"softgrip_jax", "jax", "numpy", "python"}
    assert float(run.best.shell.a) == pytest.approx(result.best.x[0], rel=1e-14)
    assert float(run.config.scene.shell.a) == 0.016
    assert len(run.designs) == 1 + len(result.designs)
    assert float(run.designs[1]["shell.a_mm"]) == pytest.approx(result.best.x[0] * 1e3, rel=1e-14)
    np.testing.assert_array_equal(run.history["moving"], result.history["moving"])


def test_people_read_units_margins_and_the_improvement(finished):
    _, out, printed, _ = finished
    for words in (
        "10.911 kPa",
        "mm",
        "change of pressure",
        "-61",
        "limit_margin at required at least 1.25",
        "OK",
        str(out),
    ):
        assert words in printed
    assert "compiling, then 30 steps of" in printed
    assert "of 30 steps of" in printed.partition("compiling")[2].partition("\n")[2]


def test_every_file_is_named_and_what_comes_next_can_be_typed(finished, capsys):
    _, out, printed, _ = finished
    line = printed.rstrip().splitlines()[-1]
    assert all(name in line for name in FILES)
    assert line.endswith(f"Next: softgrip solve {out / 'best.toml'}")
    assert run(shlex.split(line.partition("Next: softgrip ")[2])) == 0
    assert "required" not in capsys.readouterr().err


def test_a_run_never_replaces_another(finished, monkeypatch, tmp_path):
    config, out, _, result = finished
    monkeypatch.setattr(runs, "search", lambda *args, **kwargs: result)
    monkeypatch.chdir(tmp_path)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(ConfigError, match="exists already; give --out a new name"):
        runs.run_design(config, out, Console(file=io.StringIO()))
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    numbered = [str(runs.run_design(config, None, Console(file=io.StringIO()))) for _ in range(2)]
    assert numbered == ["runs/small-001", "runs/small-002"]


@pytest.mark.parametrize("moment", ["search", "_draw", "_summary"])
def test_a_failure_leaves_nothing_behind(finished, monkeypatch, tmp_path, moment):
    config, _, _, result = finished

    def fail(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "search", lambda *args, **kwargs: result)
    monkeypatch.setattr(runs, moment, fail)
    with pytest.raises(KeyboardInterrupt):
        runs.run_design(config, tmp_path / "out" / "run", Console(file=io.StringIO()))
    assert list((tmp_path / "out").iterdir()) == []


def test_a_stopped_run_is_kept_and_says_so(finished, monkeypatch, tmp_path):
    config, _, _, result = finished
    monkeypatch.setattr(runs, "search", lambda *args, **kwargs: dataclasses.replace(result, stopped=True))
    monkeypatch.chdir(tmp_path)
    assert run(["design", str(config), "--out", "run"]) == STOPPED
    assert {path.name for path in (tmp_path / "run").iterdir()} == FILES - {"before_after.png"}
    assert json.loads((tmp_path / "run" / "result.json").read_text())["stopped"] is True
    assert "was stopped after 30 steps" in (tmp_path / "run" / "best.toml").read_text()
    assert (tmp_path / "run" / "summary.txt").read_text().startswith("Stopped after 30 steps; ")
    assert sg.pressure_for(configs.load(tmp_path / "run" / "best.toml").scene).status == Status.OK


def test_json_is_the_result_and_nothing_else(finished, monkeypatch, tmp_path, capsys):
    config, _, _, result = finished
    monkeypatch.setattr(runs, "search", lambda *args, **kwargs: result)
    monkeypatch.setattr(runs, "_draw", lambda *args: None)
    assert run(["design", str(config), "--out", str(tmp_path / "run"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["folder"] == str(tmp_path / "run")
    written = json.loads((tmp_path / "run" / "result.json").read_text())
    assert told == {"folder": told["folder"]} | written
    assert told["best"]["variables"]["shell.a"] == pytest.approx(float(result.best.x[0]), rel=1e-12)


@pytest.fixture
def ctrl_c_is_heard():
    """Tests that a script runs in the background would ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c_is_heard")
def test_ctrl_c_while_the_folder_is_written_waits(finished, monkeypatch, tmp_path):
    config, _, _, result = finished
    summary = runs._summary

    def slow(*args):
        signal.raise_signal(signal.SIGINT)
        return summary(*args)

    monkeypatch.setattr(runs, "search", lambda *args, **kwargs: result)
    monkeypatch.setattr(runs, "_draw", lambda *args: None)
    monkeypatch.setattr(runs, "_summary", slow)
    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        runs.run_design(config, tmp_path / "run", Console(file=io.StringIO()))
    assert {path.name for path in (tmp_path / "run").iterdir()} == FILES - {
        "before_after.png",
        "convergence.png",
    }
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[design]", "[desing]", "did you mean design"),
        ('name = "shell.a_mm"', 'name = "shell.a"', "did you mean shell.a_mm"),
        ('name = "shell.a_mm"', 'name = "shel.a_mm"', "did you mean shell.a_mm"),
        ('name = "gap_mm"', 'name = "shell.a_mm"', "given twice"),
        ("low = 8 ", "low = -8 ", "must be a positive finite number"),
        ("low = 8 ", "low = 80 ", "low must be below high"),
        ("low = 8 ", 'low = "8" ', "must be a positive finite number|should be a valid number"),
        ("low = 8 ", "lo = 8 ", "there is no key|is missing"),
        ('minimise = "pressure_kPa"', 'minimise = "pressure"', "there is no quantity 'pressure'"),
        ('minimise = "pressure_kPa"', "", "a goal has 0 of minimise, maximise, reach and follow"),
        ('minimise = "pressure_kPa"', 'reach = "pressure_kPa"', "the goal reach = 'pressure_kPa' needs a target"),
        ('at = "required"    #', 'at = "soon"    #', "at must be 'required'"),
        (
            'at = "required"    #',
            "at = { force_N = inf }    #",
            r"goals\.1\.at\.force_N is inf; it should be a finite number",
        ),
        ("low = 1.25", "", "keep = 'limit_margin' has no bound"),
        ("low = 1.25", "low = 2\nhigh = 1", "keep = 'limit_margin' goes from 2 to 1; low must be below high"),
        ("starts = 32", "starts = 0", "greater than or equal to 1"),
        ("starts = 32", "start = 256", "did you mean starts"),
        ('optimiser = "adam"', 'optimiser = "adma"', "adam"),
        ("mass_g = 563", "mass_g = 0", "pressure_kPa is asked at 'required', and the scene requires nothing by itself"),
    ],
)
def test_mistakes_are_one_sentence(old, new, sentence, tmp_path):
    text = (ROOT / "configs" / "shell_grasp.toml").read_text()
    assert old in text
    config = tmp_path / "config.toml"
    config.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=sentence) as caught:
        runs.run_design(config, tmp_path / "out", Console(file=io.StringIO()))
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["config.toml"]


def test_a_curve_without_length_is_told_by_its_points(tmp_path):
    """A scale that nobody had given was said to be zero."""
    text = (ROOT / "configs" / "finger_tip_force.toml").read_text()
    config = tmp_path / "config.toml"
    goal = 'follow = [[1, 1], [1, 1]]\nscene = "free"'
    config.write_text(text.replace('maximise = "blocked.tip_force_N"', goal, 1))
    with pytest.raises(ConfigError, match=r"the points of follow are all \[1, 1\]; two must differ"):
        settings.read(configs.load(config))


def test_points_of_a_curve_are_for_their_parts_of_its_length(tmp_path):
    """Points that are not evenly spaced were taken as if they were, and the first one was never looked at."""
    text = (ROOT / "configs" / "finger_tip_force.toml").read_text()
    config = tmp_path / "config.toml"

    def goals(points):
        goal = f'follow = {points}\nscene = "free"'
        config.write_text(text.replace('maximise = "blocked.tip_force_N"', goal, 1))
        return settings.read(configs.load(config)).problem.goals

    points = [[0, 0], [3, -4], [3, -14], [8, -26]]  # 5, 10 and 13 mm apart
    along = [goal.quantity.along for goal in goals(points) if goal.quantity.along is not None]
    np.testing.assert_allclose(along, np.repeat([5 / 28, 15 / 28, 1.0], 2))
    with pytest.raises(ConfigError, match=r"the first point of follow is \[3, -4\]; it must be \[0, 0\]"):
        goals(points[1:])


def test_a_config_without_a_search_says_so(tmp_path):
    with pytest.raises(ConfigError, match=r"there is no section \[design\]"):
        settings.read(configs.load(ROOT / "configs" / "shell_flat.toml"))


def test_a_folder_that_is_no_run_says_so(tmp_path):
    with pytest.raises(ConfigError, match="is not a run"):
        optim.load_run(tmp_path)


@pytest.mark.parametrize("at", [31e3, ("force", 2.0), "required", None])
def test_the_best_design_asks_what_the_search_asked(at, tmp_path):
    scene = configs.load(ROOT / "configs" / "shell_grasp.toml").scene
    path = tmp_path / "best.toml"
    path.write_text(configs.dump(scene, **settings.question(at, scene)))
    expected = {31e3: {"pressure": 31e3}, ("force", 2.0): {"force": 2.0}}.get(at, {})
    assert configs.question(configs.load(path)) == pytest.approx(expected)


NO_START = """
[scene]
type = "shell.Free"
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 0.4
[scene.shell.material]
preset = "dragon_skin_20_shell"
[design]
starts = 8
steps = 6
finishes = 2
[[design.goals]]
maximise = "inflation_mm"
at = { pressure_kPa = 15 }
[[design.constraints]]
keep = "limit_margin"
at = { pressure_kPa = 15 }
low = 1.2
[[design.variables]]
name = "shell.t_m_mm"
low = 0.3
high = 2
[[design.variables]]
name = "shell.a_mm"
low = 10
high = 20
"""


def test_a_start_without_an_answer_is_a_start_like_any_other(tmp_path, capfd):
    """At 0.4 mm the shell bursts below 15 kPa. The best design is known: the widest, as thin as the margin lets it."""
    config = tmp_path / "far.toml"
    config.write_text(NO_START)
    assert run(["design", str(config), "--out", str(tmp_path / "run")]) == 0
    out = capfd.readouterr().out
    assert "The starting design has no answer (BEYOND_LIMIT); the search begins from it all the same." in out
    assert out.replace("\n", " ").count("the key scale beside it sets another") == 1
    assert "the key scale beside it sets another" in (tmp_path / "run" / "summary.txt").read_text()
    assert "of the start" not in out
    assert "nan" not in out
    assert "nan" not in (tmp_path / "run" / "designs.csv").read_text()
    best = configs.load(tmp_path / "run" / "best.toml").scene
    assert float(best.shell.a) == pytest.approx(0.02, rel=1e-4)
    assert float(sg.limit_pressure(best)) == pytest.approx(1.2 * 15e3, rel=1e-5)
    start = json.loads((tmp_path / "run" / "result.json").read_text())["start"]
    assert start["objective"] is None
    assert start["violation"] is None


def test_a_search_without_any_answer_says_so_and_exits_with_1(tmp_path, capfd):
    config = tmp_path / "never.toml"
    config.write_text(NO_START.replace("high = 2\n", "high = 0.4\n"))
    assert run(["design", str(config), "--out", str(tmp_path / "run")]) == 1
    out = capfd.readouterr().out
    assert "No design with an answer was found." in out
    assert "15 kPa: 2 BEYOND_LIMIT" in out
    assert "none yet, 0 of 8 feasible" in out
    assert "nan" not in out
    assert run(shlex.split(out.partition("Next: softgrip ")[2])) == 0


TWO_SCENES = """
[scenes.free]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { preset = "dragon_skin_20_shell" } }
[scenes.plane]
type = "shell.FlatContact"
distance_mm = 5
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { preset = "dragon_skin_20_shell" } }
[design]
starts = 2
steps = 2
finishes = 1
[[design.goals]]
GOAL
[[design.variables]]
name = "shell.t_m_mm"
low = 1
high = 2
"""


@pytest.mark.parametrize(
    ("goal", "command"),
    [
        pytest.param('maximise = "plane.limit_pressure_kPa"', "path", marks=pytest.mark.slow),
        pytest.param('minimise = "plane.stretch"\nat = { force_N = 2 }', "solve", marks=pytest.mark.slow),
    ],
)
def test_of_several_scenes_the_next_command_names_one(goal, command, tmp_path, capfd):
    """In a folder whose name has a space, too."""
    folder = tmp_path / "my runs"
    folder.mkdir()
    config = folder / "two.toml"
    config.write_text(TWO_SCENES.replace("GOAL", goal))
    assert run(["design", str(config), "--out", str(folder / "out")]) == 0
    words = shlex.split(capfd.readouterr().out.partition("Next: softgrip ")[2])
    assert words == [command, str(folder / "out" / "best.toml"), "--scene", "plane"]
    assert run(words) == 0


def test_what_is_asked_next_is_a_loaded_state():
    """A rule at rest, in a constraint, was taken for the state that the search asked first."""
    free = sg.pneunet.Free(sg.PneuNet.table_5_1("A"))
    space = optim.Space({"free": free}, [optim.Variable("finger.a", 4 * mm, 7 * mm)])
    goals = [optim.Goal("maximise", optim.Quantity("limit_pressure"))]
    at_rest = optim.Limits(optim.Quantity("margins.walls_fit"), low=0.1 * mm)
    loaded = optim.Limits(optim.Quantity("tip_angle", 5 * kPa), high=1.0)
    assert settings.asked_first(optim.Problem(space, goals, [at_rest, loaded])) == ("free", 5 * kPa)
    assert settings.asked_first(optim.Problem(space, goals, [at_rest])) == ("free", None)


def test_scenes_are_written_in_the_order_of_the_config_with_what_belongs_to_the_part(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(TWO_SCENES.replace("GOAL", 'minimise = "plane.stretch"') + "[manufacture]\nrim_mm = 5\n")
    read = configs.load(path)
    scenes, kept = records.as_given(read, {"other": 1, "plane": 2, "free": 3})
    assert list(scenes.items()) == [("free", 3), ("plane", 2), ("other", 1)]
    assert kept == {"manufacture": {"rim_mm": 5}}
    assert records.as_given(dataclasses.replace(read, tables={}), {"plane": 2}) == ({"plane": 2}, {})


def test_a_report_names_all_that_a_tied_variable_moves(tmp_path):
    path = tmp_path / "two.toml"
    text = TWO_SCENES.replace("GOAL", 'maximise = "plane.limit_pressure_kPa"')
    path.write_text(text.replace('"shell.t_m_mm"', '["plane.shell.t_m_mm", "free.shell.t_m_mm"]'))
    assert records.said(settings.read(configs.load(path)).problem)[-1] == (
        "One number each: plane.shell.t_m = free.shell.t_m."
    )


SWEPT = """
[scene]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { preset = "dragon_skin_20_shell" } }
[sweep]
method = "grid"
[[sweep.variables]]
name = "shell.t_m_mm"
values = [1.0]
[[sweep.observables]]
name = "inflation_mm"
at = { pressure_kPa = 5 }
[calibrate]
[[calibrate.curves]]
name = "free"
file = "data.csv"
"""


def test_a_sweep_reads_the_files_that_it_keeps_before_it_begins(tmp_path, capsys, monkeypatch):
    """One that is missing ends it at once, and one that goes or changes meanwhile is kept as it was."""
    config, data, begun = tmp_path / "sweep.toml", tmp_path / "data.csv", []
    config.write_text(SWEPT)
    whole = sweeps.run_in

    def run_in(*arguments):
        begun.append(True)
        data.unlink(missing_ok=True)
        config.write_text("")
        whole(*arguments)

    monkeypatch.setattr(sweeps, "run_in", run_in)
    words = ["sweep", str(config), "--out", str(tmp_path / "out"), "--csv"]
    assert run(words) == 2
    assert f"{config}: it names {data}, which cannot be read: no such file or directory; " in capsys.readouterr().err
    assert not begun
    assert not (tmp_path / "out").exists()
    data.write_text("p,h\n1,1\n")
    assert run(words) == 0
    assert begun
    assert (tmp_path / "out" / "data.csv").read_text() == "p,h\n1,1\n"
    assert (tmp_path / "out" / "config.toml").read_text() == SWEPT
    assert {"study.csv", "summary.txt", "report.html"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_a_folder_that_cannot_be_made_is_named_before_anything_is_compiled(tmp_path, capsys, monkeypatch):
    """A file in its way, and a place where nobody may write; the name is the one that was typed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    config = str(ROOT / "configs" / "shell_grasp.toml")
    for command in ("design", "sensitivity"):
        for out, why in (("file", "file exists already"), ("file/out", "is a file"), ("/proc/out", "/proc: ")):
            monkeypatch.setattr(runs, "search", None)  # what is not reached
            assert run([command, config, "--out", out]) == 2
            said = capsys.readouterr().err
            assert why in said
            assert out in said
            assert len(said.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_file_of_a_run_that_cannot_be_written_is_named_as_people_know_it(tmp_path):
    with pytest.raises(ConfigError, match=r"one/sub/best.toml cannot be written: no such file"):  # noqa: SIM117
        with new_folder(tmp_path / "one", "name") as (folder, _):
            (folder / "sub" / "best.toml").write_text("")
    # A system that has opened a file and finds no room names none; what names it names the hidden folder.
    with pytest.raises(ConfigError, match=r"one cannot be written: no room; nothing of it is kept\.$"):  # noqa: SIM117
        with new_folder(tmp_path / "one", "name"):
            raise OSError(errno.ENOSPC, "No room")
    with pytest.raises(ConfigError, match=r"/one/report.html is too large\.$") as caught:  # noqa: SIM117
        with new_folder(tmp_path / "one", "name") as (folder, _):
            raise ConfigError(f"{folder / 'report.html'} is too large.")
    assert str(caught.value).startswith(str(tmp_path / "one"))
    assert not list(tmp_path.iterdir())


def test_two_runs_at_once_lose_nothing(tmp_path, monkeypatch):
    """The second one to end was given up where both had been given, or had chosen, the same name."""
    monkeypatch.chdir(tmp_path)
    with new_folder(None, "name") as (one, first), new_folder(None, "name") as (other, second):
        (one / "best.toml").write_text("1")
        (other / "best.toml").write_text("2")
    assert [(path.name, (path / "best.toml").read_text()) for path in (first, second)] == [
        ("name-001", "1"),
        ("name-002", "2"),
    ]
    out = tmp_path / "out"
    words = r"out has come to exist during the run, which is in .*out-001 instead\.$"
    with pytest.raises(ConfigError, match=words), new_folder(out, "name") as (one, _):  # noqa: PT012
        (one / "best.toml").write_text("1")
        with new_folder(out, "name") as (other, _):
            (other / "best.toml").write_text("2")
    assert [(tmp_path / name / "best.toml").read_text() for name in ("out", "out-001")] == ["2", "1"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "out-001", "runs"]
