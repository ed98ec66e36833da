"""The command `softgrip calibrate`: its folder, what it writes is accepted elsewhere, and one sentence for bad data."""

import contextlib
import csv
import io
import json
import shlex
import shutil

import numpy as np
import pytest
from conftest import ROOT

import softgrip_jax as sg
from optim.calibration import report as calibrate_report
from optim.calibration.data import UNITS, Column, read_columns
from optim.calibration.settings import ColumnTable, column, read_specimens
from optim.design import settings
from softgrip_jax import config as configs
from softgrip_jax.cli import STOPPED, run

FILES = {
    "config.toml",
    "data.csv",
    "calibrated.toml",
    "material.toml",
    "points.csv",
    "result.json",
    "fit.png",
    "report.html",
    "summary.txt",
}

CONFIG = """
[scene]
type = "shell.Free"

[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
material = {{ type = "NeoHookean", mu_kPa = 120 }}

[manufacture]
rim_mm = 5

[calibrate]

[[calibrate.parameters]]
name = "shell.material.mu_kPa"
low = {low}
high = 2000
scale = "log"

[[calibrate.curves]]
name = "free"
file = "data.csv"
pressure = {{ column = "p", unit = "{unit}" }}
measured = {{ quantity = "inflation", column = "h", unit = "mm" }}
"""

GOOD = (ROOT / "configs" / "data" / "synthetic_free_2.csv").read_text().replace("pressure_kPa,inflation_mm", "p,h")


def written(folder, data=GOOD, low=20, unit="kPa"):
    (folder / "data.csv").write_text(data)
    (folder / "fit.toml").write_text(CONFIG.format(low=low, unit=unit))
    return folder / "fit.toml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibrate")
    data = GOOD + "16,\n15,NaN\n" + GOOD.splitlines()[-1] + "\n"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = run(["calibrate", str(written(folder, data)), "--out", str(folder / "out")])
    return code, folder / "out", printed.getvalue()


def test_the_folder_is_complete_and_tells_what_was_left_out(finished):
    code, out, printed = finished
    assert code == 0
    line = printed.rstrip().splitlines()[-1]
    assert all(name in line for name in FILES)
    command = shlex.split(line.partition("Next: softgrip ")[2])
    assert command == ["solve", str(out / "calibrated.toml"), "--pressure-kPa", "15"]
    assert run(command) == 0
    assert {path.name for path in out.iterdir()} == FILES
    assert (out / "fit.png").stat().st_size > 5000
    result = json.loads((out / "result.json").read_text())
    assert result["parameters"]["shell.material.mu"] == pytest.approx(176e3, rel=0.02)
    assert any("2 rows with a missing value" in sentence for sentence in result["remarks"])
    assert any("1 row that stood there twice" in sentence for sentence in result["remarks"])
    with (out / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 15
    errors = np.array([float(row["fitted"]) - float(row["measured"]) for row in rows])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(result["curves"]["free"]["rmse"] * 1e3, rel=1e-6)


@pytest.mark.slow
def test_what_comes_next_is_a_pressure_that_the_model_reaches(tmp_path, capsys):
    """And not the largest that was measured, which is left out."""
    assert run(["calibrate", str(ROOT / "configs" / "calibrate_shell.toml"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "from 17.5 kPa on, left out" in printed
    command = shlex.split(printed.rstrip().splitlines()[-1].partition("Next: softgrip ")[2])
    assert command[-2:] == ["--pressure-kPa", "15"]
    assert run(command) == 0


@pytest.mark.slow
def test_an_open_interval_is_not_called_determined(tmp_path, capsys):
    """Millimetres called metres: no mu is on a bound, and its profile has no end."""
    shutil.copytree(ROOT / "configs" / "data", tmp_path / "data")
    text = (ROOT / "configs" / "calibrate_shell.toml").read_text()
    file = tmp_path / "fit.toml"
    file.write_text(text.replace('column = "inflation_mm", unit = "mm"', 'column = "inflation_mm", unit = "m"'))
    run(["calibrate", str(file), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert "is its unit right?" in printed
    assert "the data set no end to its interval" in printed
    assert "The data determine" not in printed


def test_a_run_is_repeated_from_its_folder_alone(finished, tmp_path, monkeypatch):
    """As its report says: `softgrip calibrate config.toml` there, where the first config and its data are gone."""
    _, out, _ = finished
    assert (out / "config.toml").read_bytes() == (out.parent / "fit.toml").read_bytes()
    alone = tmp_path / "alone"
    shutil.copytree(out, alone)
    assert "Type in that folder:" in (out / "report.html").read_text()
    monkeypatch.chdir(alone)
    assert run(["calibrate", "config.toml", "--out", "again"]) == 0
    results = [json.loads((folder / "result.json").read_text()) for folder in (out, alone / "again")]
    assert results[0]["parameters"] == results[1]["parameters"]


def test_stopped_after_the_fit_it_keeps_the_fit(monkeypatch, tmp_path, capsys):
    def stop(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(calibrate_report, "held_out", stop)
    config = written(tmp_path)
    assert run(["calibrate", str(config), "--out", str(tmp_path / "out")]) == STOPPED
    assert "Stopped after the fit" in capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["parameters"]["shell.material.mu"] == pytest.approx(176e3, rel=0.02)
    assert result["intervals"]["gauss_newton"]
    assert (tmp_path / "out" / "fit.png").is_file()


def test_what_is_written_is_solved_and_designed(finished, tmp_path, capsys):
    """calibrated.toml as it is; material.toml by `material = "material.toml"`, from `solve` and from `design`."""
    _, out, _ = finished
    mu = json.loads((out / "result.json").read_text())["parameters"]["shell.material.mu"]
    read = configs.load(out / "calibrated.toml")
    assert read.tables["manufacture"] == {"rim_mm": 5}
    scene = read.scene
    assert float(scene.shell.material.mu) == pytest.approx(mu, rel=1e-12)
    text = (ROOT / "configs" / "shell_grasp.toml").read_text()
    head, rest = text.split("[scene.shell.material]")
    rest = rest.split("\n", 2)[2]
    path = tmp_path / "grasp.toml"
    (tmp_path / "material.toml").write_bytes((out / "material.toml").read_bytes())
    path.write_text(head + 'material = "material.toml"\n' + rest)
    read = configs.load(path)
    assert float(read.scene.shell.material.mu) == pytest.approx(mu, rel=1e-12)
    assert settings.read(read).problem is not None
    assert run(["solve", str(path), "--json"]) == 0
    pressure = json.loads(capsys.readouterr().out)["pressure"]
    assert pressure == pytest.approx(float(sg.pressure_for(read.scene).pressure), rel=1e-9)
    # A run keeps a config that needs no other file.
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "config.toml").write_bytes(configs.standalone(path))
    assert float(configs.load(tmp_path / "alone" / "config.toml").scene.shell.material.mu) == pytest.approx(mu)


def test_a_part_that_is_not_there(tmp_path, capsys):
    path = tmp_path / "c.toml"
    path.write_text('[scene]\ntype = "shell.Free"\nshell = "mine.toml"\n')
    assert run(["solve", str(path)]) == 2
    assert "mine.toml" in capsys.readouterr().err
    (tmp_path / "mine.toml").write_text("[material]\nmu_kPa = 1\n")
    assert run(["solve", str(path)]) == 2
    assert "that file has no section [shell]" in capsys.readouterr().err


HEADER = "p,h\n"


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ("", "the file is empty"),
        ("# nothing\n\n", "the file is empty"),
        (HEADER, "there is no row with a number"),
        (HEADER + "5,7\n", "1 point for 1 parameter; more points than parameters are needed"),
        (HEADER + "5,7\n6,8\n", "2 points, too few to estimate its noise; state it"),
        (HEADER + "5,7\n6,eight\n7,9\n", "line 3: h is 'eight'; it must be a finite number"),
        (HEADER + "5,7\n6,inf\n7,9\n", "line 3: h is 'inf'; it must be a finite number"),
        (HEADER + "5,7\n6,1e300\n7,9\n", "line 3: h is '1e300'; it must be a finite number below 1e+30"),
        ("p;h\n5;7,5\n6;8\n", "line 2: h is '7,5'; it must be a finite number; write decimals with a point"),
        ("p;h\n5;1_0\n6;8\n", "line 2: h is '1_0'; it must be a finite number."),
        ("p,h\n2,5,5,794\n", "line 2: there are 4 cells, and the header has 2; write decimals with a point"),
        (HEADER + "10,-3\n12,-4\n13,-5\n", "inflation has the other sign than the model's at the values as given"),
        ("pressure,h\n5,7\n", "there is no header line with the columns 'p' and 'h'"),
        ("p,h,h\n5,7,8\n6,8,9\n7,9,9\n", "line 1: 2 columns are called 'h'; it must be one: give the others another"),
        (HEADER + '5,7\n6,"8\n7,9\n', "line 3: The quotation mark before '8' is not closed on this line; close it, or"),
        ('p,"h\n5,7\n6,8\n7,9\n', "line 1: The quotation mark before 'h' is not closed on this line"),
        ('p,h,of\n5,7,"a\n6,8,b\n7,9,c\n', "line 2: The quotation mark before 'a' is not closed on this line"),
        (HEADER + "5,7\n6,8\n7," + "1" * 131073 + "\n", "line 4: A cell has more than 131072 characters"),
        (HEADER + "-5,7\n6,8\n7,9\n", "a pressure of curve 'free' is -5 kPa; gauge pressures are zero or more"),
    ],
)
def test_bad_data_is_one_sentence_and_nothing_is_written(data, sentence, tmp_path, capsys):
    assert run(["calibrate", str(written(tmp_path, data)), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"data.csv", "fit.toml"}


def test_a_curve_that_the_model_does_not_follow_is_said(tmp_path, capsys):
    """Inflations in the wrong order, too few to tell errors of the model by their neighbours."""
    rows = "2.5,11.5\n5,9.7\n7.5,7.9\n10,5.8\n"
    assert run(["calibrate", str(written(tmp_path, HEADER + rows)), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "% of the range of the curve, so the model does not follow it; are the units and the columns right?" in said


def test_a_fit_on_the_smaller_part_of_the_points_determines_nothing(tmp_path, capsys):
    """Inflations five times those of any such shell: four of six points lie beyond the limit point of the fit."""
    rows = "".join(
        f"{p},{5 * h}\n" for p, h in ((2.5, 5.8), (5, 7.9), (7.5, 9.7), (10, 11.5), (12.5, 13.5), (15, 15.8))
    )
    assert run(["calibrate", str(written(tmp_path, HEADER + rows)), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "of 6 points: the fit stands on the smaller part of what was measured" in said
    assert "The data determine the parameter" not in said


def changed(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("low = 20", "low = -20", "low of shell.material.mu_kPa is -20; it must be a positive finite number in kPa"),
        ('column = "p", unit = "kPa"', 'column = "p", unit = "mm"', "it must be one of kPa, Pa, MPa"),
        ('"inflation"', '"force"', "measures 'force'; it must be one of inflation"),
        ('"data.csv"', "[1, 2]", "curves.1.file is [1, 2]; it must be a text or a list of texts."),
        ('"data.csv"', "[]", "[calibrate]: The list of files of curve"),
        ('"data.csv"', '"other.csv"', "no such file"),
        ('"data.csv"', '["data.csv", "./data.csv"]', "names a file twice; a specimen counts once"),
        ('column = "h"', 'column = "p"', "takes the column 'p' twice, for what is set and for what is measured"),
        ("[calibrate]", "[tension]\n[calibrate]", "has [tension] and [calibrate]; one run does one of them"),
        ('"shell.material.mu_kPa"', '"shell.material.nu_kPa"', "did you mean shell.material.mu_kPa?"),
        ("[calibrate]", '[calibrate]\nloss = "tukey"', "loss is 'tukey'"),
        ("[calibrate]", '[calibrate]\nintervals = ["jackknife"]', "jackknife"),
        ("[calibrate]", "[calibrate]\nseed = 99999999999999999999", "seed is 99999999999999999999"),
        ("[calibrate]", "[calibrate]\nposterior = { seed = 4294967296 }", "posterior.seed is 4294967296"),
        ("[calibrate]", "[calibrate]\nposterior = { chains = 1 }", "posterior.chains is 1; it should be greater"),
        ('unit = "mm" }', 'unit = "mm", noise = -1 }', "noise"),
        ('pressure = { column = "p", unit = "kPa" }\n', "", "must have either pressure"),
    ],
)
def test_a_mistake_in_the_config_is_one_sentence(old, new, sentence, tmp_path, capsys):
    path = changed(written(tmp_path), old, new)
    assert run(["calibrate", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_pressures_in_the_wrong_unit_have_no_equilibrium(tmp_path, capsys):
    """kPa read as MPa: a thousand times beyond the limit point, whatever the material."""
    assert run(["calibrate", str(written(tmp_path, unit="MPa")), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "0 of 15 points have an equilibrium within the bounds" in said
    assert "is their unit right?" in said
    assert not (tmp_path / "out").exists()


def test_a_pressure_that_falls_again_is_said(tmp_path):
    from optim.calibration.data import check_pressures

    up = np.linspace(0, 10, 11)
    assert check_pressures("free", up, tmp_path / "a.csv") == []
    (sentence,) = check_pressures("free", np.append(up, up[::-1]), tmp_path / "a.csv")
    assert "rises and falls again" in sentence
    (sentence,) = check_pressures("free", up[::-1], tmp_path / "a.csv")
    assert "the pressure falls from the first point to the last" in sentence


@pytest.mark.parametrize(
    ("names", "units", "said"),
    [
        (("p_psi", "h"), ("kPa", "mm"), ["'p_psi' says psi, and the config takes its numbers as kPa"]),
        (("p", "F (mN)"), ("kPa", "N"), ["'F (mN)' says mN, and the config takes its numbers as N"]),
        (("p [atm]", "h_mm"), ("bar", "mm"), ["'p [atm]' says atm, and the config takes its numbers as bar"]),
        (("p_kPa", "h"), ("kPa", "mm"), []),
        (("strain_1", "s (MPa)"), ("%", "MPa"), []),
    ],
)
def test_a_heading_of_another_unit_is_asked_about(names, units, said, tmp_path):
    """psi read as kPa is a factor of seven, which the values alone do not show."""
    (tmp_path / "a.csv").write_text(",".join(names) + "\n1,0.1\n2,0.2\n3,0.3\n")
    kinds = [next(kind for kind, known in UNITS.items() if unit in known) for unit in units]
    x, y = (Column(*one) for one in zip(names, kinds, units, strict=True))
    notes = read_specimens(tmp_path, "a.csv", "free", x, y)["notes"]
    assert len(notes) == len(said)
    assert all(wanted in note for note, wanted in zip(notes, said, strict=True))


def test_preambles_and_separators_do_no_harm(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text('"Machine;Instron\nSpeed;450\n;;\nTime (s);Strain;Stress (MPa)\n0.1;"0.05";0.1\n0.2;0.1;0.2\n')
    data, notes = read_columns(path, [Column("Strain", "number", "1"), Column("Stress (MPa)", "pressure", "MPa")])
    np.testing.assert_allclose(data, [[0.05, 1e5], [0.1, 2e5]])
    assert notes == []


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["s1.csv", "s2.csv"], ("s1", "s2")),
        (["day1/free.csv", "day2/free.csv", "day2/slow.csv"], ("day1/free", "day2/free", "slow")),
        (["a/day1/free.csv", "a/day2/free.csv"], ("day1/free", "day2/free")),
        (["day1/a/free.csv", "day2/a/free.csv"], ("day1/a/free", "day2/a/free")),
        (["free.csv", "day1/free.csv"], ("free", "day1/free")),
        (["free.csv", "free.txt"], ("free.csv", "free.txt")),
    ],
)
def test_specimens_of_one_file_name_are_told_apart_by_their_folders(files, names, tmp_path):
    for one in files:
        (tmp_path / one).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / one).write_text("p,h\n1,0.1\n2,0.2\n")
    pressure, height = Column("p", "pressure", "kPa"), Column("h", "length", "mm")
    found = read_specimens(tmp_path, files, "free", pressure, height)
    assert found["specimens"] == names
    np.testing.assert_array_equal(found["specimen"], np.repeat(np.arange(len(files)), 2))


def test_a_column_of_a_kind_that_no_data_have_is_one_sentence():
    with pytest.raises(sg.errors.ConfigError, match="column 'h' is of the kind 'colour'; a column must be of one of"):
        column(ColumnTable(column="h", unit="mm"), "colour", "fit.toml, [calibrate]: curve 'free'")


@pytest.mark.slow
def test_a_tension_test_names_its_material(tmp_path, capsys):
    folder = tmp_path
    text = (ROOT / "configs" / "calibrate_tension.toml").read_text()
    text = text.replace("data/", f"{ROOT / 'configs' / 'data'}/").replace(
        "window_percent = 150", 'window_percent = 200\nmaterials = ["NeoHookean", "Yeoh"]'
    )
    (folder / "tension.toml").write_text(text)
    assert run(["calibrate", str(folder / "tension.toml"), "--out", str(folder / "out")]) == 0
    printed = capsys.readouterr().out
    assert "Written is Yeoh" in printed
    assert 'Next: material = "material.toml" in a config in this folder.' in printed
    (folder / "out" / "next.toml").write_text(
        '[scene]\ntype = "shell.Free"\n[scene.shell]\na_mm = 16\nb_mm = 43\nt_m_mm = 1.1\n'
        'material = "material.toml"\n[solve]\npressure_kPa = 5\n'
    )
    assert run(["solve", str(folder / "out" / "next.toml")]) == 0
    read = configs.read_toml(folder / "out" / "material.toml")
    # The truth of the synthetic file: C1 = 60 kPa, C2 = 4 kPa; noise 3 kPa.
    assert read["material"]["type"] == "Yeoh"
    assert read["material"]["c1_kPa"] == pytest.approx(60, rel=0.05)
    assert read["material"]["c2_kPa"] == pytest.approx(4, rel=0.3)
