"""softgrip path: tables, pictures, animations and exit codes."""

import csv
import json

import pytest
from conftest import ROOT
from PIL import Image

import softgrip_jax as sg
from softgrip_jax import config, thesis
from softgrip_jax.cli import MISTAKE, NO_ANSWER, STOPPED, run
from softgrip_jax.commands import path as paths
from softgrip_jax.commands.expected import expectations
from softgrip_jax.units import kPa, mm

CYLINDER = str(ROOT / "configs" / "shell_cylinder.toml")
FREE = str(ROOT / "configs" / "shell_free.toml")


def test_the_table_is_what_solve_says_row_by_row(tmp_path, capsys):
    file = tmp_path / "curve.csv"
    assert run(["path", CYLINDER, "--to-kPa", "25", "--points", "6", "--csv", str(file)]) == 0
    assert capsys.readouterr() == (f"The table is in {file}.\n", "")
    rows = list(csv.DictReader(file.read_text().splitlines()))
    assert [float(row["pressure_kPa"]) for row in rows] == [0, 5, 10, 15, 20, 25]
    assert [row["status"] for row in rows] == ["NO_CONTACT", "OK", "OK", "OK", "OK", "BEYOND_LIMIT"]
    assert float(rows[3]["force_z_N"]) == pytest.approx(thesis.FIGURE_5_3.value, rel=5e-3)
    for row in rows[1:5]:
        state = sg.solve(thesis.cylinder_contact(), float(row["pressure_kPa"]) * kPa)
        assert float(row["flat_length_mm"]) == pytest.approx(float(state.flat_length) / mm, rel=1e-9)
    assert rows[0]["force_N"] == "0"
    assert rows[5]["force_N"] == ""


def test_a_folder_holds_table_picture_and_report(tmp_path, capsys):
    out, file = tmp_path / "curve", tmp_path / "same.csv"
    asked = ["path", CYLINDER, "--to-kPa", "25", "--points", "6"]
    assert run([*asked, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said == f"The curve is in {out}: config.toml, curve.csv, curve.png, report.html, result.json.\n"
    assert run([*asked, "--csv", str(file)]) == 0
    assert (out / "curve.csv").read_text() == file.read_text()
    page = (out / "report.html").read_text()
    assert "--points 6" in page
    assert "1 BEYOND_LIMIT" in page
    # Written again, and beside another, the report says the same command.
    assert run(["report", str(out)]) == 0
    page = (out / "report.html").read_text()
    assert "<h1>softgrip path: curve</h1>" in page
    assert ">softgrip path config.toml --from-kPa 0 --to-kPa 25 --points 6</pre>" in page
    both = tmp_path / "both.html"
    assert run(["report", str(out), str(out), "--out", str(both)]) == 0
    assert f"softgrip path {out}/config.toml --from-kPa 0 --to-kPa 25 --points 6</pre>" in both.read_text()
    both.unlink()
    (out / "result.json").unlink()
    assert run(["report", str(out)]) == MISTAKE
    assert (out / "report.html").read_text() == page
    capsys.readouterr()
    assert run([*asked, "--out", str(out)]) == MISTAKE
    assert f"{out} exists already" in capsys.readouterr().err
    assert run([*asked, "--out", str(tmp_path / "new"), "--csv", str(file)]) == MISTAKE
    assert "--out is given beside --csv" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"curve", "same.csv"}


def test_a_curve_without_a_state_leaves_its_table_and_the_reasons(tmp_path, capsys):
    out = tmp_path / "curve"
    assert run(["path", CYLINDER, "--to-kPa", "1", "--points", "3", "--out", str(out)]) == NO_ANSWER
    assert {path.name for path in out.iterdir()} == {"config.toml", "curve.csv", "report.html", "result.json"}
    assert "3 NO_CONTACT" in (out / "report.html").read_text()
    assert "There is no state on this curve" in capsys.readouterr().err


def test_without_an_end_the_curve_goes_to_the_limit_and_with_through_limit_beyond(capsys):
    assert run(["path", FREE, "--points", "5", "--json"]) == 0
    rising = json.loads(capsys.readouterr().out)
    limit = float(sg.limit_pressure(thesis.free_shell()))
    assert limit * (1 - 1e-9) < rising["pressure"][-1] <= limit  # as many digits as a table has, of less
    assert rising["units"]["inflation"] == "m"
    assert run(["path", FREE, "--points", "60", "--through-limit"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    pressures = [float(row["pressure_kPa"]) for row in rows]
    top = pressures.index(max(pressures))
    assert 0 < top < len(rows) - 1
    assert max(pressures) * kPa == pytest.approx(limit, rel=1e-9)
    assert pressures[-1] == pytest.approx(0.5 * pressures[top], rel=0.02)
    assert float(rows[-1]["inflation_mm"]) < 160
    assert {row["status"] for row in rows} == {"OK"}


def test_through_the_limit_from_and_to_a_pressure(tmp_path, capsys):
    limit = float(sg.limit_pressure(thesis.free_shell())) / kPa

    def pressures(*arguments):
        assert run(["path", FREE, "--points", "40", "--through-limit", *arguments]) == 0
        return [float(row["pressure_kPa"]) for row in csv.DictReader(capsys.readouterr().out.splitlines())]

    # Nothing behind the limit is asked for where the curve is to end below it.
    below = pressures("--to-kPa", "15", "--from-kPa", "5")
    assert below == pytest.approx([5 + 10 * k / 39 for k in range(40)])
    # No state has more than the limit: the curve goes through it.
    above = pressures("--to-kPa", "30", "--from-kPa", "12")
    top = above.index(max(above))
    assert above[0] >= 12
    assert max(above) == pytest.approx(limit, rel=1e-9)
    assert above[-1] == pytest.approx(0.5 * limit, rel=0.03)
    assert above[:top] == sorted(above[:top])
    picture = tmp_path / "curve.svg"
    assert run(["path", FREE, "--points", "40", "--through-limit", "--plot", str(picture)]) == 0
    drawn = picture.read_text()
    assert f"limit {limit:.4g} kPa" in drawn
    assert "unstable at a given pressure" in drawn
    assert run(["path", FREE, "--points", "40", "--through-limit", "--from-kPa", "30"]) == MISTAKE
    assert "--from-kPa is 30, the curve ends at 20.17" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--from-kPa", "30", "--to-kPa", "40", "--points", "3"], NO_ANSWER, "There is no state on this curve"),
        (["--from-kPa", "20", "--to-kPa", "10"], MISTAKE, "--from-kPa is 20, the curve ends at 10 kPa; it must rise"),
        (["--from-kPa", "-1"], MISTAKE, "--from-kPa is -1; it must be"),
        (["--points", "1"], MISTAKE, "--points"),
        (["--observable", "force"], MISTAKE, "--observable is 'force'; it must be one of force_N, force_z_N"),
        (["--plot", "curve.jpg"], MISTAKE, "--plot is 'curve.jpg'; it must be a file that ends in .png, .pdf or .svg"),
        (["--animate", "a.mp4"], MISTAKE, "--animate is 'a.mp4'; it must be a file that ends in .gif"),
        (["--csv", "no/such/folder/curve.csv"], MISTAKE, "a file cannot be written there"),
    ],
)
def test_exit_codes(arguments, code, words, capsys):
    assert run(["path", CYLINDER, *arguments]) == code
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_what_is_done_until_ctrl_c_is_kept(tmp_path, capsys, monkeypatch):
    whole, asked = sg.path, []

    def interrupted(scene, pressures):
        asked.append(len(pressures))
        if len(asked) == 3:
            raise KeyboardInterrupt
        return whole(scene, pressures)

    monkeypatch.setattr("softgrip_jax.questions.path", interrupted)
    file, plot = tmp_path / "curve.csv", tmp_path / "curve.png"
    arguments = ["--to-kPa", "20", "--points", "41", "--csv", str(file), "--plot", str(plot)]
    assert run(["path", CYLINDER, *arguments]) == STOPPED
    assert capsys.readouterr().err == "32 of 41 pressures are kept.\nstopped.\n"
    rows = list(csv.DictReader(file.read_text().splitlines()))
    assert [float(row["pressure_kPa"]) for row in rows] == pytest.approx([0.5 * k for k in range(32)])
    last = sg.solve(thesis.cylinder_contact(), 15.5 * kPa)
    assert float(rows[-1]["force_N"]) == pytest.approx(float(last.force), rel=1e-9)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_pictures_and_animation(tmp_path):
    plot, gif = tmp_path / "curve.png", tmp_path / "inflation.gif"
    arguments = ["--to-kPa", "20", "--points", "5", "--plot", str(plot), "--animate", str(gif)]
    assert run(["path", CYLINDER, *arguments]) == 0
    assert plot.read_bytes().startswith(b"\x89PNG")
    with Image.open(gif) as animation:
        # Four pressures touch; the last one stays for a second.
        assert animation.n_frames == 4
        first = animation.convert("RGB").tobytes()
        animation.seek(3)
        assert animation.convert("RGB").tobytes() != first
        assert animation.info["duration"] >= 900
    assert sorted(file.name for file in tmp_path.iterdir()) == ["curve.png", "inflation.gif"]


def test_an_impossible_scene_is_not_one_without_a_limit(tmp_path, capsys):
    """The sheet of `softgrip export` says it, too."""
    file = tmp_path / "chamber.toml"
    finger = '[scene.finger]\npreset = "table_5_1_A"\nt_m_mm = 3\n'
    file.write_text(f'[scene]\ntype = "pneunet.Chamber"\ninclination_deg = 0\n{finger}')
    assert run(["path", str(file)]) == MISTAKE
    said = " ".join(capsys.readouterr().err.split())
    assert "has no curve up to a limit pressure: two walls of a chamber are 1.8 mm too thick" in said
    assert "--to-kPa" not in said
    assert dict(expectations(config.load(file)).rows)["limit pressure"].startswith("unknown: two walls of a chamber")


@pytest.mark.parametrize("limit", [41720.2940657, 22246.73965, 0.123456789, 9.99999999996e4])
def test_the_last_pressure_of_a_curve_has_a_state(limit):
    """Rounded to what a table shows it was beyond the limit, or the limit itself."""
    last = paths.just_below(limit)
    assert limit * (1 - 1e-9) < last <= limit
    assert float(f"{last:.10g}") == pytest.approx(last, rel=1e-12)


def test_points_without_a_state_are_told(tmp_path, capsys):
    """A picture ended before its fold, without a word."""
    config = tmp_path / "rod.toml"
    shell = 'shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }'
    config.write_text(f'[scene]\ntype = "shell.Grasp"\nradius_mm = 3\ngap_mm = 3\nfriction = 0.96\n{shell}\n')
    assert run(["path", str(config), "--to-kPa", "12", "--points", "4", "--csv", str(tmp_path / "c.csv")]) == 0
    said = capsys.readouterr().err
    assert said.startswith("2 of 4 points have no state: ")
    assert "pass through each other" in said


def test_states_beyond_one_turn_are_told(tmp_path, capsys):
    """As `solve` says of one state."""
    config = tmp_path / "curled.toml"
    finger = '[scene.finger]\npreset = "table_5_1_A"\n'
    config.write_text(f'[scene]\ntype = "pneunet.Free"\ndrive = "cell"\nweight_N_per_m = [0, 0]\n{finger}')
    options = ["--from-kPa", "27", "--to-kPa", "32", "--points", "6", "--csv", str(tmp_path / "c.csv")]
    assert run(["path", str(config), *options]) == 0
    rows = list(csv.DictReader((tmp_path / "c.csv").read_text().splitlines()))
    beyond = [float(row["pressure_kPa"]) for row in rows if float(row["tip_angle_deg"]) > 360]
    said = capsys.readouterr().err
    assert f"{len(beyond)} of 6 states, from {beyond[0]:g} kPa on: the finger has curled by more than one turn" in said
    assert 0 < len(beyond) < 6
