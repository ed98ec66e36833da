"""`softgrip solve --posterior`: which draws enter the intervals."""

import json

import numpy as np
import pytest

import softgrip_jax as sg
from softgrip_jax.cli import MISTAKE, NO_ANSWER, run
from softgrip_jax.laws import laws_of
from softgrip_jax.units import kPa, mm

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


def test_numbers_of_another_law_are_told(tmp_path, capsys):
    words = asked(tmp_path, [170.0, 175.0])
    # A file of before says no laws.
    assert run([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["remarks"] == []
    assert run(words) == 0
    assert "those of a calibration make up for part of that." in capsys.readouterr().out
    laws = {"laws": json.dumps({"model": ["energy"], "bending": [True]})}
    draws = {"shell.material.mu_kPa": (("chain", "draw"), np.array([[170.0, 175.0]]), laws)}
    xr.Dataset(draws).to_netcdf(tmp_path / "p.nc", group="posterior", engine="h5netcdf", mode="w")
    sentence = 'The numbers were found with model = "energy"; this scene has model = "arc": they belong to that model.'
    assert run([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["remarks"] == [sentence]
    assert run(words) == 0
    told = capsys.readouterr().out
    assert sentence in told
    assert "with numbers as they are." in told
    assert "make up for part" not in told


def test_laws_are_those_that_have_a_part():
    finger = sg.PneuNet.table_5_1("A")
    assert laws_of(sg.pneunet.Free(finger, drive="cell")) == {"drive": "cell", "loading": "first"}
    assert laws_of(sg.pneunet.Free(finger))["inclination"] == "segment"
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    assert laws_of(sg.shell.Free(shell)) == {"model": "arc"}
    by_energy = sg.shell.Free(shell, model="energy")
    assert laws_of(by_energy) == laws_of(by_energy.prepared()) == {"model": "energy", "bending": True}


def test_draws_are_those_of_a_posterior(tmp_path, capsys):
    words = asked(tmp_path, [170.0, 175.0])
    assert run([*words[:2], "--draws", "20"]) == MISTAKE
    assert "--draws are those of a posterior; give --posterior too." in capsys.readouterr().err


def test_no_draw_that_touches_is_no_answer(tmp_path, capsys):
    assert run(asked(tmp_path, [2000.0, 2100.0])) == NO_ANSWER
    assert "2 of 2 draws have no equilibrium or touch nothing" in capsys.readouterr().out
