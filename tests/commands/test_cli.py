"""The command line: reports, JSON, pictures and exit codes. Expected numbers are the thesis's."""

import errno
import importlib
import json
import math
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import jax
import pytest
from conftest import ROOT

from softgrip_jax import thesis
from softgrip_jax.cli import NO_ANSWER, run
from softgrip_jax.errors import ConfigError
from softgrip_jax.folders import write_whole

CONFIGS = ROOT / "configs"
SHELL = str(CONFIGS / "shell_free.toml")


def solved(capsys, *arguments) -> tuple[int, dict]:
    code = run(["solve", *map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    assert not [line for line in err.splitlines() if not line.startswith("The picture is in ")]
    return code, json.loads(out)


@pytest.mark.parametrize(
    ("name", "observable", "expected"),
    [
        ("shell_free", "inflation", thesis.FIGURE_5_1),
        ("shell_flat", "force", thesis.FIGURE_5_2),
        ("shell_cylinder", "force_z", thesis.FIGURE_5_3),
    ],
)
def test_numbers_of_the_thesis(name, observable, expected, capsys):
    code, data = solved(capsys, CONFIGS / f"{name}.toml")
    assert (code, data["status"]) == (0, "OK")
    assert data["pressure"] == 15000.0
    assert data["observables"][observable] == pytest.approx(expected.value, rel=5e-3)


def test_json_is_si_with_null_for_what_is_not_a_number(capsys):
    code, data = solved(capsys, CONFIGS / "shell_cylinder.toml", "--pressure-kPa", "15")
    assert code == 0
    assert data["scene"] == "shell.CylinderContact"
    assert data["units"] == {"pressure": "Pa"} | {name: data["units"][name] for name in data["observables"]}
    assert data["units"]["force"] == "N"
    assert data["units"]["contact_half_width"] == "m"
    assert 0 < data["observables"]["contact_half_width"] < 16e-3
    assert set(data["model_error"]) == {"force", "force_z"}
    assert data["model_error"]["force"].startswith("31 to 67 % less than finite elements")

    code, beyond = solved(capsys, CONFIGS / "shell_cylinder.toml", "--pressure-kPa", "500")
    assert (code, beyond["status"]) == (NO_ANSWER, "BEYOND_LIMIT")
    assert set(beyond["observables"].values()) == {None}
    assert "model_error" not in beyond
    assert math.isfinite(beyond["pressure"])


def test_report_for_people(capsys):
    assert run(["solve", str(CONFIGS / "shell_cylinder.toml")]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = {line.split("│")[1].strip(): line.split("│")[2].strip() for line in out.splitlines() if "│" in line}
    assert lines["status"] == "OK"
    assert lines["pressure"] == "15 kPa"
    number, unit = lines["force z"].split()
    assert (float(number), unit) == (pytest.approx(5.74, rel=5e-3), "N")
    assert out.splitlines()[-1].startswith("force, force z: 31 to 67 % less than finite elements, 5 to 15 kPa.")

    assert run(["solve", str(CONFIGS / "shell_cylinder.toml"), "--pressure-kPa", "500"]) == NO_ANSWER
    out, err = capsys.readouterr()
    assert err == ""
    assert "BEYOND_LIMIT" in out
    assert "nan" not in out
    (limit,) = re.findall(r"limit pressure +│ ([\d.]+) kPa", out)
    below, above = (
        run(["solve", str(CONFIGS / "shell_cylinder.toml"), "--pressure-kPa", str(float(limit) + step)])
        for step in (-0.01, 0.01)
    )
    assert (below, above) == (0, NO_ANSWER)


@pytest.mark.slow
def test_what_is_chosen_for_a_tolerance_leaves_the_other_drive_alone(capsys):
    """It was solved with as few points, and had no answer."""
    found = []
    for options in ([], ["--tolerance", "1%"]):
        assert run(["solve", str(ROOT / "configs" / "finger_tip_contact.toml"), "--json", *options]) == 0
        found.append(json.loads(capsys.readouterr().out)["other_drive"])
    assert found[0] == found[1]
    assert found[0]["observables"]["tip_force"] > 0.5


def test_picture(tmp_path, capsys):
    picture = tmp_path / "cylinder.png"
    config = str(CONFIGS / "shell_cylinder.toml")
    assert run(["solve", config, "--plot", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [picture]
    assert f"The picture is in {picture}." in capsys.readouterr().out
    picture.unlink()
    capsys.readouterr()
    assert run(["solve", config, "--pressure-kPa", "500", "--plot", str(picture)]) == NO_ANSWER
    assert capsys.readouterr().err == "No picture: there is no state to draw.\n"
    assert not list(tmp_path.iterdir())


def test_help_teaches_and_answers_at_once():
    times = []
    for _ in range(3):
        start = time.perf_counter()
        command = [sys.executable, "-m", "softgrip_jax", "--help"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        times.append(time.perf_counter() - start)
        assert done.returncode == 0
        assert "solve" in done.stdout
    # 0.3 s alone on one core; a machine that is busy may take longer, but importing JAX alone takes 0.7 s of one.
    code = "import sys, softgrip_jax.cli as cli; cli.run(['--help']); sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, cwd=ROOT).returncode == 0
    assert min(times) < 2


def test_no_arguments_is_help_and_version_is_told(capsys):
    assert run([]) == 0
    assert "Usage" in capsys.readouterr().out
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip() == "0.1.0"


@pytest.mark.parametrize("arguments", [["--profile", "solve", SHELL], ["solve", SHELL, "--profile"]])
def test_a_profile_says_where_the_time_went(arguments, capsys):
    find = importlib._bootstrap._find_and_load
    jax.clear_caches()
    assert run(arguments) == 0
    rows = [line.split() for line in capsys.readouterr().err.splitlines()]
    seconds = {row[3] if "%" in row[2] else row[2]: float(row[0]) for row in rows}
    assert list(seconds) == ["importing", "tracing", "compiling,", "running,", "in"]
    assert all(value >= 0 for value in seconds.values())
    assert seconds["tracing"] > 0
    assert seconds["tracing"] + seconds["compiling,"] < seconds["in"]
    assert importlib._bootstrap._find_and_load is find


def test_console_script():
    script = Path(sys.executable).with_name("softgrip")
    done = subprocess.run([script, "solve", "--help"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0
    assert "--pressure-kPa" in done.stdout


def test_a_linear_finger_by_hand_and_its_picture(tmp_path, capsys):
    """Type A at 20 kPa: the tip force is 3 M_T / (2 L), the angle M_T L / EI, EI = mu B H^3 / 3."""
    picture = tmp_path / "linear.png"
    code, data = solved(capsys, CONFIGS / "finger_linear.toml", "--plot", str(picture))
    seen = data["observables"]
    assert (code, data["status"]) == (0, "OK")
    assert seen["tip_force"] == pytest.approx(1.5 * seen["end_moment"] / 0.077)
    assert seen["tip_angle"] == pytest.approx(seen["end_moment"] * 0.077 * 3 / (136e3 * 0.02 * 0.005**3))
    assert picture.stat().st_size > 10_000


def test_what_nothing_is_drawn_of_is_one_sentence(tmp_path, capsys):
    plain = (CONFIGS / "finger_chamber.toml").read_text().replace('"pneunet.Chamber"', '"pneunet.SmallStrainChamber"')
    config = tmp_path / "plain.toml"
    config.write_text("\n".join(line for line in plain.splitlines() if not line.startswith("inclination")))
    for arguments in (["solve", "--plot", "chamber.png"], ["path", "--to-kPa", "31", "--animate", "chamber.gif"]):
        command, option, name = arguments[0], arguments[-2], arguments[-1]
        assert run([command, str(config), *arguments[1:-1], str(tmp_path / name)]) == 2
        told = capsys.readouterr()
        assert told.err.strip() == f"{option}: there is no picture of a SmallStrainChamber yet."
        assert told.out == ""  # it printed its answer, and then refused
    assert list(tmp_path.iterdir()) == [config]


def test_what_a_new_config_says_next_can_be_typed(tmp_path, capsys):
    file = tmp_path / "my finger.toml"
    assert run(["new", "shell.Free", str(file)]) == 0
    printed = capsys.readouterr().out
    assert str(file) in printed
    assert run(shlex.split(printed.partition("Next: softgrip ")[2])) == 0


def test_a_file_that_cannot_be_written_after_all_is_named(tmp_path):
    def full(path):
        path.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with pytest.raises(ConfigError, match=r"curve.csv cannot be written: no space left on device\.") as caught:
        write_whole(tmp_path / "curve.csv", full)
    assert str(caught.value).startswith(str(tmp_path / "curve.csv"))
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="fcntl is of Unix")
def test_a_file_is_brought_to_the_disk_by_one_who_may_write_it(tmp_path, monkeypatch):
    """Windows refuses it to others."""
    import fcntl

    modes = []
    monkeypatch.setattr(os, "fsync", lambda number: modes.append(fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE))
    write_whole(tmp_path / "curve.csv", b"pressure_kPa")
    assert modes == [os.O_RDWR]
