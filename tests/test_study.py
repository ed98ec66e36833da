"""Parameter studies: the designs are those that were asked for, the numbers those of the library, and a study that was
killed equals one that was not."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from conftest import ROOT
from helpers import shell
from scipy.stats import qmc

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax import plots
from softgrip_jax.cli import run
from softgrip_jax.commands import sweep
from softgrip_jax.errors import ConfigError
from softgrip_jax.results import Status
from softgrip_jax.study import Grid, LatinHypercube, Range, Sobol, Table
from softgrip_jax.study import study as chunks
from softgrip_jax.study.store import CHUNKS, run_in
from softgrip_jax.units import kPa, mm

A, T = Range(10 * mm, 22 * mm), Range(0.5 * mm, 2 * mm, "log")
PRESSURE = 12 * kPa


def contact(**dimensions):
    return sg.shell.CylinderContact(shell(**dimensions), radius=20 * mm, gap=5 * mm)


# --- sets of designs --------------------------------------------------------------------------------------------------


def test_a_grid_is_every_combination():
    grid = Grid([np.array([1.0, 2.0, 4.0]), np.array([7.0, 8.0])])
    assert (grid.shape, grid.count) == ((3, 2), 6)
    np.testing.assert_array_equal(grid.rows(0, 6), [[1, 7], [1, 8], [2, 7], [2, 8], [4, 7], [4, 8]])
    np.testing.assert_array_equal(grid.rows(3, 5), [[2, 8], [4, 7]])
    np.testing.assert_allclose(T.points(3), [0.5 * mm, 1 * mm, 2 * mm], rtol=1e-14)


@pytest.mark.parametrize("kind", [Sobol, LatinHypercube])
def test_any_rows_of_a_set_are_the_same_whoever_asks(kind):
    whole = kind([A, T], 64, seed=3).rows(0, 64)
    parts = [kind([A, T], 64, seed=3).rows(k, k + 16) for k in (48, 0, 16, 32)]
    np.testing.assert_array_equal(whole, np.concatenate([parts[1], parts[2], parts[3], parts[0]]))
    assert np.all((whole >= [A.low, T.low]) & (whole <= [A.high, T.high]))
    assert not np.array_equal(whole, kind([A, T], 64, seed=4).rows(0, 64))


def test_sets_fill_their_ranges_evenly():
    slices = np.sort(np.floor(LatinHypercube([A, T], 50, 1).unit(0, 50) * 50), axis=0)
    np.testing.assert_array_equal(slices, np.arange(50)[:, None] * np.ones(2))
    even = Sobol([A, T], 256, 1).unit(0, 256)
    assert qmc.discrepancy(even) < 0.1 * qmc.discrepancy(np.random.default_rng(0).random((256, 2)))


# --- what comes out ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def data():
    quantities = [sg.Quantity("force", PRESSURE), sg.Quantity("limit_pressure"), sg.Quantity("force", 1.5 * kPa)]
    axes = [A.points(4), np.array([0.5, 1.1, 2.0]) * mm]
    return sg.Study(contact(), ["shell.a", "shell.t_m"], quantities, Grid(axes), gradients=True).run()


def test_numbers_and_labels_are_those_of_the_library(data):
    assert data["force_at_12_kPa"].dims == ("shell.a", "shell.t_m")
    assert data["force_at_12_kPa"].attrs["units"] == "N"
    assert data["shell.a"].attrs["units"] == "m"
    assert data["status_12_kPa"].attrs["flag_meanings"].split() == [s.name for s in Status]
    for i, a in enumerate(A.points(4)):
        for j, t_m in enumerate(np.array([0.5, 1.1, 2.0]) * mm):
            scene = contact(a=a, t_m=t_m)
            for pressure in (PRESSURE, 1.5 * kPa):
                solution = sg.solve(scene, pressure)
                here = data.isel({"shell.a": i, "shell.t_m": j})
                assert int(here[f"status_{pressure / kPa:g}_kPa"]) == int(solution.status)
                np.testing.assert_allclose(here[f"force_at_{pressure / kPa:g}_kPa"], solution.force, rtol=1e-9)
            np.testing.assert_allclose(here["limit_pressure"], sg.limit_pressure(scene), rtol=1e-9)
    assert {Status.OK, Status.NO_CONTACT} <= set(np.unique(data["status_1.5_kPa"]))
    assert {Status.OK, Status.BEYOND_LIMIT} <= set(np.unique(data["status_12_kPa"]))
    assert np.all(data["force_at_1.5_kPa"].values[data["status_1.5_kPa"] == Status.NO_CONTACT] == 0)


def test_slopes_are_those_of_the_library(data):
    def force(a, t_m):
        scene = contact(a=a, t_m=t_m)
        return sg.solve(scene, PRESSURE).force

    expected = jax.grad(force, (0, 1))(jnp.asarray(A.points(4)[2]), jnp.asarray(1.1 * mm))
    found = data["slope_of_force_at_12_kPa"].isel({"shell.a": 2, "shell.t_m": 1})
    assert found.dims == ("by",)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    beyond = data["status_12_kPa"].values == Status.BEYOND_LIMIT
    assert np.all(np.isnan(data["slope_of_force_at_12_kPa"].values[beyond]))


def test_a_design_is_the_same_bits_wherever_it_stands(monkeypatch):
    """Chunks are filled up, so the place of a design in its chunk and the size of the study change nothing."""
    monkeypatch.setattr(chunks, "CHUNK", 256)
    rows = Sobol([A, T], 600, 2).rows(0, 600)
    study = sg.Study(contact(), ["shell.a", "shell.t_m"], [sg.Quantity("force", PRESSURE)], Table(rows))
    assert (study.chunk, study.chunks) == (256, 3)
    turned = sg.Study(contact(), ["shell.a", "shell.t_m"], [sg.Quantity("force", PRESSURE)], Table(rows[::-1]))
    turned.compiled = study.compiled
    one, two = study.run()["force_at_12_kPa"].values, turned.run()["force_at_12_kPa"].values
    np.testing.assert_array_equal(one, two[::-1])


# --- a study in a folder ----------------------------------------------------------------------------------------------

CONFIG = """
[scene]
type = "shell.FlatContact"
distance_mm = 5
[scene.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
material = { type = "NeoHookean", mu_kPa = 175 }
[sweep]
method = "sobol"
samples = SAMPLES
seed = 7
gradients = true
[[sweep.variables]]
name = "shell.a_mm"
low = 10
high = 22
[[sweep.variables]]
name = "distance_mm"
low = 2
high = 9
[[sweep.observables]]
name = "force_N"
at = { pressure_kPa = [10, 20] }
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(CONFIG.replace("SAMPLES", str(20 * chunks.CHUNK + 5)))
    return path


def test_a_killed_study_goes_on_and_equals_one_that_was_not(config, tmp_path, monkeypatch, capsys):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen(
        [sys.executable, "-m", "softgrip_jax", "sweep", str(config), "--out", str(killed)],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
        stdout=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 120
    while len(list((killed / CHUNKS).glob("[0-9]*"))) < 3:
        assert process.poll() is None, "the study ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    done = len(list((killed / CHUNKS).glob("[0-9]*.npz")))
    assert 3 <= done < 21
    with pytest.raises(ConfigError, match="run it again with the same --out"):
        sg.load_study(killed)

    computed = []
    evaluate = sg.Study.evaluate
    monkeypatch.setattr(sg.Study, "evaluate", lambda self, rows: computed.append(len(rows)) or evaluate(self, rows))
    assert run(["sweep", str(config), "--out", str(killed)]) == 0
    assert f"going on with {done * chunks.CHUNK} of" in capsys.readouterr().out
    assert len(computed) == 21 - done
    assert run(["sweep", str(config), "--out", str(whole)]) == 0
    assert len(computed) == 21 - done + 21

    with sg.load_study(killed) as one, sg.load_study(whole) as two:
        assert one.sizes["design"] == 20 * chunks.CHUNK + 5
        xr.testing.assert_identical(one.load(), two.load())
        for name in one.variables:
            assert one[name].values.tobytes() == two[name].values.tobytes()
    assert (killed / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()
    assert {p.name for p in killed.iterdir()} == {"config.toml", "manifest.json", "study.nc", "study.csv", "study.png"}
    assert json.loads((killed / "manifest.json").read_text())["finished"]

    # Again: nothing is left to do. Another study: refused.
    assert run(["sweep", str(config), "--out", str(killed)]) == 0
    assert len(computed) == 21 - done + 21
    capsys.readouterr()
    config.write_text(config.read_text().replace("distance_mm = 5", "distance_mm = 6"))
    assert run(["sweep", str(config), "--out", str(killed)]) == 2
    assert "holds another study (different: config)" in capsys.readouterr().err


def test_chunks_that_cannot_be_read_are_computed_again(tmp_path, monkeypatch):
    """One cut short, one with a bit that flipped, one of another size, one that is no file of arrays at all."""
    monkeypatch.setattr(chunks, "CHUNK", chunks.BATCH)
    quantities = [sg.Quantity("force", at=PRESSURE)]
    study = sg.Study(contact(), ["shell.t_m"], quantities, Sobol([T], 6 * chunks.BATCH))
    computed, said, evaluate = [], [], study.evaluate
    monkeypatch.setattr(study, "evaluate", lambda rows: computed.append(rows) or evaluate(rows))

    def stop(done, skipped):
        if done == 5 * chunks.BATCH:
            raise KeyboardInterrupt

    broken, whole = tmp_path / "broken", tmp_path / "whole"
    with pytest.raises(KeyboardInterrupt):
        run_in(broken, study, "x", stop)
    files = sorted((broken / CHUNKS).glob("*.npz"))
    assert len(files) == len(computed) == 5
    content = [file.read_bytes() for file in files]
    files[0].write_bytes(content[0][:-100])
    middle = len(content[1]) // 2
    files[1].write_bytes(content[1][:middle] + bytes([content[1][middle] ^ 1]) + content[1][middle + 1 :])
    np.savez(files[2], values=np.zeros((3, 1)), statuses=np.zeros((3, 1), int))
    files[3].write_bytes(b"")
    run_in(broken, study, "x", remark=said.append)
    assert len(computed) == 5 + 5
    [sentence] = said
    assert sentence == (f"{files[0]} and 3 more cannot be read, of 5 that were there; the designs are computed again.")
    run_in(whole, study, "x", remark=said.append)
    assert len(said) == 1
    assert (broken / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()


def test_a_study_that_cannot_end_is_refused_at_once(config, tmp_path, capsys, monkeypatch):
    out = small(config, tmp_path)
    text = config.read_text().replace('method = "sobol"\nsamples = 6\nseed = 7\ngradients = true', 'method = "grid"')
    text = text.replace("low = 10\n", "points = 1_000_000\nlow = 10\n")
    config.write_text(text.replace("low = 2\n", "points = 1_000_000\nlow = 2\n"))
    monkeypatch.setattr(sg.Study, "evaluate", None)  # what is not reached
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "1,000,000,000,000 designs" in said
    assert "116 days" in said
    # Two varied numbers, two forces and two statuses to a design.
    assert "about 264 TB of disk" in said
    assert not out.exists()


def test_a_grid_has_more_designs_than_a_machine_counts():
    assert Grid([np.arange(1e6)] * 4).count == 10**24


def test_a_study_without_any_answer_says_why_and_exits_with_1(config, tmp_path, capsys):
    """Thin free membranes far beyond their limit; a design that has an answer makes it a study like any other."""
    out = small(config, tmp_path)
    text = config.read_text().replace("shell.FlatContact", "shell.Free").replace("distance_mm = 5\n", "")
    text = text.replace('name = "distance_mm"\nlow = 2\nhigh = 9', 'name = "shell.t_m_mm"\nlow = 0.1\nhigh = 0.2')
    text = text.replace('"force_N"', '"inflation_mm"').replace("gradients = true\n", "")
    config.write_text(text)
    assert run(["sweep", str(config), "--out", str(out)]) == 1
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert [line.partition(";")[0] for line in lines] == [
        f"{at} kPa: none of 6 designs has an answer (6 BEYOND_LIMIT)" for at in (10, 20)
    ]
    thinnest = sg.load_study(out).isel(design=0)
    first = sg.solve(sg.shell.Free(shell(a=float(thinnest["shell.a"]), t_m=float(thinnest["shell.t_m"]))), 10 * kPa)
    assert f"the most frequent reason: {first.reason_text()}".rstrip(".") in lines[0].rstrip(".")
    assert "study.nc" in said.out
    assert "nan" not in said.out


def small(config, tmp_path, **changes):
    text = config.read_text().replace(str(20 * chunks.CHUNK + 5), "6")
    for old, new in changes.items():
        text = text.replace(old, new)
    config.write_text(text)
    return tmp_path / "out"


def test_a_table_of_designs_has_units_in_its_columns(config, tmp_path, capsys):
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text("note,shell.a_mm,distance_mm\nfirst,12,3\nsecond,18,4\n\n")
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    config.write_text(text.replace("low = 10\nhigh = 22\n", "").replace("low = 2\nhigh = 9\n", ""))
    assert run(["sweep", str(config), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["folder"] == str(out)
    assert (out / "study.png").read_bytes().startswith(b"\x89PNG")
    with (out / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    force = told["quantities"]["force_at_20_kPa"]
    assert (force["unit"], force["answered"]) == ("N", 2)
    assert force["least"] == pytest.approx(min(float(row["force_at_20_kPa_N"]) for row in rows), rel=1e-9)
    assert [float(row["distance_mm"]) for row in rows] == [3, 4]
    expected = sg.solve(sg.shell.FlatContact(shell(a=18 * mm), distance=4 * mm), 20 * kPa)
    assert rows[1]["status_20_kPa"] == "OK"
    assert float(rows[1]["force_at_20_kPa_N"]) == pytest.approx(float(expected.force), rel=1e-9)
    assert "d_force_at_20_kPa_N_by_distance_mm" in rows[0]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('method = "sobol"', 'method = "grid"', "the method 'grid' has no samples"),
        ('method = "sobol"', 'method = "sobel"', "method is 'sobel'"),
        ("samples = 6", "", "the method 'sobol' needs samples"),
        ('method = "sobol"\nsamples = 6', 'method = "csv"', "the method 'csv' needs a file"),
        ('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "no.csv"', "give its name alone"),
        ("low = 10\n", "low = 10\npoints = 3\n", "shell.a_mm has low, high, points; give low, high"),
        ("low = 10", "low = 40", "shell.a_mm goes from 40 to 22; low must be below high"),
        ("low = 10", "low = -1", "must be a positive finite number in mm"),
        ('"shell.a_mm"', '"shell.a"', "did you mean a_mm"),
        ('"distance_mm"', '"shell.a_mm"', "is given twice"),
        ('"force_N"', '"force"', "there is no quantity 'force'"),
        ("at = { pressure_kPa = [10, 20] }", "", "force_N is asked at None"),
        ("[sweep]", "[sweeep]", "did you mean sweep"),
    ],
)
def test_mistakes_are_one_sentence(config, tmp_path, capsys, old, new, sentence):
    out = small(config, tmp_path)
    assert old in config.read_text()
    config.write_text(config.read_text().replace(old, new))
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("shell.a_mm\n", "has no rows of designs"),
        ("shell.a\n12\n", "line 1: there is no number 'shell.a'; did you mean a_mm?"),
        ("shell.a_mm\n12\nx\n", "line 3: shell.a_mm is 'x'; it must be a number"),
        ("shell.a_mm\n-12\n", "must be a positive finite number in mm"),
    ],
)
def test_mistakes_in_a_table_are_one_sentence(config, tmp_path, capsys, table, sentence):
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text(table)
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    start, end = text.index("[[sweep.variables]]"), text.index("[[sweep.observables]]")
    config.write_text(text[:start] + text[end:])
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    assert sentence in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_of_something_else_is_left_alone(config, tmp_path, capsys):
    out = small(config, tmp_path)
    out.mkdir()
    (out / "thesis.docx").write_text("years of work")
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    assert "exists already and holds no study" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["thesis.docx"]


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_maps_hatch_and_name_what_has_no_answer(data):
    figure = plots.study(data[["force_at_12_kPa", "status_12_kPa"]])
    (ax,) = [ax for ax in figure.axes if ax.get_title(loc="left")]
    assert ax.get_title(loc="left") == "force at 12 kPa"
    assert ax.get_xlabel() == "shell.a (mm)"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["no contact", "beyond limit"]


def test_curves_end_where_there_is_no_answer(data):
    figure = plots.study(data.isel({"shell.t_m": [0]}))
    forces, _ = figure.axes
    assert forces.get_ylabel() == "force (N)"
    assert {"12 kPa", "1.5 kPa", "beyond limit"} <= {text.get_text() for text in forces.get_legend().get_texts()}
    (line,) = [line for line in forces.lines if line.get_label() == "12 kPa"]
    status = data["status_12_kPa"].isel({"shell.t_m": 0}).values
    np.testing.assert_array_equal(np.isfinite(line.get_ydata()), status == Status.OK)


def test_the_config_of_the_project_runs(tmp_path):
    study, _ = sweep.read(configs.load(ROOT / "configs" / "shell_sweep.toml"))
    assert study.designs.shape == (49, 46)
