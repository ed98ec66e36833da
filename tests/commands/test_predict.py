"""`softgrip solve --posterior`: which draws enter the intervals."""

import json

import numpy as np
import pytest

from softgrip_jax.cli import MISTAKE, NO_ANSWER, run

xr = pytest.importorskip("xarray", reason="posteriors need the extra bayes")
pytest.importorskip("h5netcdf", reason="posteriors need the extra bayes")

CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[solve]
pressure_kPa = 8
"""


def asked(folder, mu):
    (folder / "pad.toml").write_text(CONFIG)
    draws = {"shell.material.mu_kPa": (("chain", "draw"), np.array([mu]))}
    xr.Dataset(draws).to_netcdf(folder / "p.nc", group="posterior", engine="h5netcdf")
    return ["solve", str(folder / "pad.toml"), "--posterior", str(folder / "p.nc")]


def test_draws_that_touch_nothing_are_counted_and_not_averaged(tmp_path, capsys):
    words = asked(tmp_path, [170.0, 175.0, 180.0, 2000.0, 2100.0])
    assert run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["statuses"] == {"OK": 3, "NO_CONTACT": 2}
    assert told["solved"] == 3
    assert told["observables"]["force"]["low"] > 0
    ((reason, count),) = told["reasons"].items()
    assert reason.startswith("the pressure is too low: nothing is touched below")
    assert count == 2
    assert run(words) == 0
    assert "2 of 5 draws have no equilibrium or touch nothing" in capsys.readouterr().out


def test_draws_are_those_of_a_posterior(tmp_path, capsys):
    words = asked(tmp_path, [170.0, 175.0])
    assert run([*words[:2], "--draws", "20"]) == MISTAKE
    assert "--draws are those of a posterior; give --posterior too." in capsys.readouterr().err


def test_no_draw_that_touches_is_no_answer(tmp_path, capsys):
    assert run(asked(tmp_path, [2000.0, 2100.0])) == NO_ANSWER
    assert "2 of 2 draws have no equilibrium or touch nothing" in capsys.readouterr().out
