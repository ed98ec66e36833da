"""Parameter studies: the designs are those that were asked for, the numbers those of the library, and a study that was
killed equals one that was not."""

import csv
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
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
from softgrip_jax.commands.sweep import beyond_ranges
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.explorer.study import open_study
from softgrip_jax.results import Status
from softgrip_jax.study import Grid, LatinHypercube, Range, Sobol, Table, store
from softgrip_jax.study import study as chunks
from softgrip_jax.study.blocks import Blocks
from softgrip_jax.study.dataset import write_csv
from softgrip_jax.study.store import BEGUN, STORE, run_in
from softgrip_jax.study.summary import best, condition, quantiles, reason_counts
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


@pytest.mark.parametrize("count", [1, 2, 3, 10, 97, 4096, 65537])
def test_every_slice_of_a_latin_hypercube_is_hit_once(count):
    points = LatinHypercube([A, T, A], count, seed=5).unit(0, count)
    slices = np.sort(np.floor(points * count), axis=0)
    np.testing.assert_array_equal(slices, np.arange(count)[:, None] * np.ones(3))


def test_a_latin_hypercube_has_no_pattern():
    """Two variables, a variable and the next design's, and a variable and the number: chi-squared of 256 cells, whose
    225 degrees of freedom have a standard deviation of 21."""
    count, cells = 1 << 16, 16
    points = LatinHypercube([A, T], count, seed=1).unit(0, count)
    number = np.arange(count) / count
    for one, two in [(points[:, 0], points[:, 1]), (points[:-1, 0], points[1:, 0]), (number, points[:, 1])]:
        found = np.histogram2d(one, two, bins=cells, range=[(0, 1), (0, 1)])[0]
        expected = len(one) / cells**2
        assert np.sum((found - expected) ** 2) / expected < 225 + 5 * 21


def test_a_latin_hypercube_of_any_size_keeps_nothing():
    huge = LatinHypercube([A, T], 10**12, seed=1)
    points = huge.unit(10**12 - 1000, 10**12)
    assert np.all((points >= 0) & (points < 1))
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.05)
    np.testing.assert_allclose(points.std(axis=0), 12**-0.5, atol=0.03)
    assert sum(np.size(value) for value in vars(huge).values()) < 10


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
    """Blocks are filled up, so the place of a design in its block and the size of the study change nothing."""
    monkeypatch.setattr(chunks, "BLOCK", 256)
    monkeypatch.setattr(chunks, "BATCH", {"cpu": 128})
    rows = Sobol([A, T], 600, 2).rows(0, 600)
    study = sg.Study(contact(), ["shell.a", "shell.t_m"], [sg.Quantity("force", PRESSURE)], Table(rows))
    assert (study.blocks.size, len(study.blocks)) == (256, 3)
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


BLOCK, DESIGNS = 256, 20 * 256 + 5


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(CONFIG.replace("SAMPLES", str(DESIGNS)))
    return path


SMALL_BLOCKS = f"""
from softgrip_jax.study import study
study.BLOCK = {BLOCK}
study.BATCH = {{"cpu": {BLOCK}}}
from softgrip_jax.cli import main
main()
"""


def blocks_there(store):
    """Of the variable that is written last."""
    return len(list((store / "reason_20_kPa" / "c").glob("[0-9]*")))


def same(one, two):
    """Two studies are equal to the bit, but for the time that they took."""
    with sg.load_study(one) as one, sg.load_study(two) as two:
        for data in (one, two):
            assert data.attrs[BEGUN].pop("seconds") >= 0
        xr.testing.assert_identical(one.load(), two.load())
        for name in one.variables:
            assert one[name].values.tobytes() == two[name].values.tobytes()


def test_a_killed_study_goes_on_and_equals_one_that_was_not(config, tmp_path, monkeypatch, capsys):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen(
        [sys.executable, "-c", SMALL_BLOCKS, "sweep", str(config), "--out", str(killed)],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
        stdout=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 120
    while blocks_there(killed / STORE) < 3:
        assert process.poll() is None, "the study ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    done = blocks_there(killed / STORE)
    assert 3 <= done < 20
    with pytest.raises(ConfigError, match="run it again with the same --out"):
        sg.load_study(killed)

    monkeypatch.setattr(chunks, "BLOCK", BLOCK)
    monkeypatch.setattr(chunks, "BATCH", {"cpu": BLOCK})
    computed = []
    evaluate = sg.Study.evaluate
    monkeypatch.setattr(sg.Study, "evaluate", lambda self, rows: computed.append(len(rows)) or evaluate(self, rows))
    assert run(["sweep", str(config), "--out", str(killed), "--csv"]) == 0
    assert f"going on with {done * BLOCK} of" in capsys.readouterr().out
    assert len(computed) == 21 - done
    assert run(["sweep", str(config), "--to", str(tmp_path / "any.zarr"), "--out", str(whole), "--csv"]) == 0
    assert len(computed) == 21 - done + 21

    same(killed, tmp_path / "any.zarr")
    assert sg.load_study(killed).sizes["design"] == DESIGNS
    assert (killed / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()
    assert {p.name for p in killed.iterdir()} == {
        "config.toml",
        STORE,
        "study.csv",
        "study.png",
        "report.html",
        "summary.txt",
    }

    # Again: nothing is left to do. Another study: refused.
    assert run(["sweep", str(config), "--out", str(killed)]) == 0
    assert len(computed) == 21 - done + 21
    capsys.readouterr()
    config.write_text(config.read_text().replace("distance_mm = 5", "distance_mm = 6"))
    assert run(["sweep", str(config), "--out", str(killed)]) == 2
    assert "holds another study (different: config)" in capsys.readouterr().err


def test_a_study_that_was_begun_on_another_kind_of_machine_is_told_as_that(tmp_path, monkeypatch):
    walls = Grid([np.array([1.0, 1.1]) * mm])
    study = sg.Study(sg.shell.Free(shell()), ["shell.t_m"], [sg.Quantity("inflation", at=12 * kPa)], walls)
    run_in(tmp_path / "walls", study, "two walls")
    monkeypatch.setattr(store, "device", lambda: "another")
    run_in(tmp_path / "walls", study, "two walls")  # nothing is left to compute
    store.Store(str(tmp_path / "walls" / STORE), study).mark({"finished": False})
    with pytest.raises(ConfigError, match=r"begun on another kind of machine, \w+ \w+, and this one is another"):
        run_in(tmp_path / "walls", study, "two walls")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of six blocks, and where it is."""
    place = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "BLOCK", 128)
        patch.setattr(chunks, "BATCH", {"cpu": 128})
        quantities = [sg.Quantity("force", at=PRESSURE)]
        study = sg.Study(contact(), ["shell.t_m", "shell.a"], quantities, Sobol([T, A], 6 * 128))
    run_in(place, study, "x")
    return place, study


def test_chunks_that_cannot_be_read_are_computed_again(finished, tmp_path, monkeypatch):
    """One cut short, one with a bit that flipped, one that is empty, one that is missing, of a study that had ended."""
    whole, study = finished
    broken = tmp_path / "broken"
    shutil.copytree(whole, broken)
    computed, said, evaluate = [], [], study.evaluate
    monkeypatch.setattr(study, "evaluate", lambda rows: computed.append(rows) or evaluate(rows))
    files = [broken / STORE / "force_at_12_kPa" / "c" / str(k) for k in range(6)]
    content = [file.read_bytes() for file in files]
    files[0].write_bytes(content[0][:-100])
    middle = len(content[1]) // 2
    files[1].write_bytes(content[1][:middle] + bytes([content[1][middle] ^ 1]) + content[1][middle + 1 :])
    files[3].write_bytes(b"")
    files[4].unlink()
    with pytest.raises(ValueError, match="checksum"):
        np.asarray(sg.load_study(broken)["force_at_12_kPa"][128:256])
    run_in(broken, study, "x", remark=said.append)
    assert len(computed) == 4
    [sentence] = said
    assert sentence == (
        f"{files[0]} and 2 more cannot be read, of 5 blocks that were there; the designs are computed again."
    )
    same(whole, broken)
    run_in(broken, study, "x", remark=said.append)
    assert len(computed) == 4
    assert len(said) == 1


def test_a_disk_that_fills_up_is_one_sentence_and_the_study_goes_on_after_it(finished, tmp_path, monkeypatch):
    whole, study = finished
    write, place = store.Store.write, tmp_path / "full"

    def full(self, block, rows, found):
        if block.start == 256:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(self, block, rows, found)

    monkeypatch.setattr(store.Store, "write", full)
    with pytest.raises(ConfigError, match=r"cannot be written: no space left on device; when that is mended, run it"):
        run_in(place, study, "x")
    monkeypatch.setattr(store.Store, "write", write)
    found = []
    run_in(place, study, "x", report=lambda done, skipped: found.append(skipped))
    assert found[-1] in range(256, 6 * 128, 128)
    same(whole, place)


def test_a_store_is_whatever_fsspec_knows(finished, tmp_path):
    whole, study = finished
    run_in(f"file://{tmp_path}/remote.zarr", study, "x")
    same(whole, f"file://{tmp_path}/remote.zarr")
    with pytest.raises(ConfigError, match="there is no study in it"):
        sg.load_study(f"file://{tmp_path}/other.zarr")
    with pytest.raises(ConfigError, match="cannot be opened"):
        sg.load_study("nosuchprotocol://somewhere")
    with pytest.raises(ConfigError, match=r"nowhere cannot be opened: there is no such folder\."):
        sg.load_study(tmp_path / "nowhere")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"other cannot be opened: there is no study in it\."):
        sg.load_study(tmp_path / "other")


def test_a_store_that_is_damaged_is_one_sentence(finished, tmp_path):
    whole, study = finished
    damaged = tmp_path / "damaged"
    shutil.copytree(whole, damaged)
    (damaged / STORE / "force_at_12_kPa" / "zarr.json").write_text("{")
    with pytest.raises(ConfigError, match="not readable; give a new name"):
        run_in(damaged, study, "x")
    (damaged / STORE / "zarr.json").write_text("{")
    with pytest.raises(ConfigError, match=r"its zarr\.json is damaged"):
        run_in(damaged, study, "x")


def test_the_store_says_what_made_it(finished):
    whole, study = finished
    told = sg.load_study(whole).attrs[BEGUN]
    assert told["begun"]["config"] == "x"
    assert told["begun"]["jax"] == jax.__version__
    assert told["begun"]["seed"] == 0
    assert told["devices"] == [store.device()]
    assert sum(told["statuses"]["status_12_kPa"].values()) == study.designs.count


def test_old_studies_still_open(data, tmp_path):
    data.to_netcdf(tmp_path / "study.nc", engine="h5netcdf")
    with sg.load_study(tmp_path) as old:
        xr.testing.assert_identical(old.load(), data)


def test_a_grid_is_stored_by_its_axes(data, tmp_path, monkeypatch):
    """The same as in memory, in blocks that cut an axis."""
    monkeypatch.setattr(chunks, "BLOCK", 6)
    monkeypatch.setattr(chunks, "LEAST_BATCH", 4)
    monkeypatch.setattr(chunks, "BATCH", {"cpu": 4})
    quantities = [sg.Quantity("force", PRESSURE), sg.Quantity("limit_pressure"), sg.Quantity("force", 1.5 * kPa)]
    axes = [A.points(4), np.array([0.5, 1.1, 2.0]) * mm]
    study = sg.Study(contact(), ["shell.a", "shell.t_m"], quantities, Grid(axes), gradients=True)
    assert study.blocks.chunk == (2, 3)
    run_in(tmp_path / "grid", study, "x")
    with sg.load_study(tmp_path / "grid") as stored:
        del stored.attrs[BEGUN]
        assert list(stored.data_vars) == list(data.data_vars)
        assert list(stored.coords) == list(data.coords)
        xr.testing.assert_allclose(stored.load(), data, rtol=1e-12)
        for name in data.variables:
            assert stored[name].attrs.keys() == data[name].attrs.keys()
        write_csv(stored, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    expected = data["slope_of_force_at_12_kPa"].isel({"shell.a": 2, "shell.t_m": 1}).sel(by="shell.t_m")
    assert float(rows[7]["d_force_at_12_kPa_N_by_shell.t_m_mm"]) == pytest.approx(float(expected) * mm, rel=1e-9)


@pytest.mark.parametrize("shape", [(49, 46), (3, 7, 10), (10,), (1000,), (2, 1001), (5, 2, 3, 4)])
@pytest.mark.parametrize("most", [7, 64, 4096])
def test_blocks_are_runs_of_designs_and_boxes_of_the_grid(shape, most):
    blocks, every = Blocks.of(shape, most), np.arange(np.prod(shape)).reshape(shape)
    for some in (blocks, blocks.joined(500)):
        runs = [every[block.box].ravel() for block in some]
        np.testing.assert_array_equal(np.concatenate(runs), every.ravel())
        assert [(run[0], run[-1] + 1) for run in runs] == [(block.start, block.stop) for block in some]
        assert max(map(len, runs)) <= (most if some is blocks else max(most, 500))
        assert all(a % b == 0 or a == n for a, b, n in zip(some.chunk, blocks.chunk, shape, strict=True))


SEVERAL = """
import jax, numpy as np, softgrip_jax as sg
from softgrip_jax.study import Range, Sobol
from softgrip_jax.study import study as blocks
blocks.BATCH = {"cpu": 128}
scene = sg.shell.FlatContact(sg.FlatShell(a=.016, b=.043, t_m=.0011, material=sg.NeoHookean(mu=175e3)), distance=.005)
study = sg.Study(scene, ["distance"], [sg.Quantity("force", 10e3)], Sobol([Range(.002, .009)], 1000))
assert len(jax.devices()) == 4 and study.call == 1024
found = study.compiled(study.designs.rows(0, 1000).repeat(2, 0)[:1024])
assert len(found["values"].sharding.device_set) == 4
several = study.evaluate(study.rows(0))
one_device = jax.local_devices()[:1]
jax.devices = lambda: one_device
del study.compiled
one = study.evaluate(study.rows(0))
for name in one:
    np.testing.assert_array_equal(one[name], several[name])
"""


@pytest.mark.slow  # a process of its own with several devices
def test_several_devices_share_a_block():
    """The same bits as on one, and each device has its part."""
    flags = os.environ | {"XLA_FLAGS": "--xla_force_host_platform_device_count=4", "JAX_PLATFORMS": "cpu"}
    subprocess.run([sys.executable, "-c", SEVERAL], env=flags, check=True, timeout=120)


# --- what a study comes to --------------------------------------------------------------------------------------------


def test_quantiles_are_those_of_numpy_whatever_the_numbers_are():
    rng = np.random.default_rng(1)
    shape = (301, 7)
    values = np.exp(rng.normal(0, 30, shape)) * rng.choice([-1, 1], shape)
    values[rng.random(shape) < 0.2] = np.nan
    values[:5], values[5] = -0.0, 1.0
    values[6] = np.inf
    status = np.where(rng.random(shape) < 0.1, int(Status.NO_CONTACT), int(Status.OK))
    attributes = {"status": "status_x"}
    table = {"one": (("a", "b"), values, attributes), "same": (("a", "b"), np.full(shape, 2.5), attributes)}
    table["none"] = (("a", "b"), np.full(shape, np.nan), attributes)
    table["status_x"] = (("a", "b"), status, {})
    parts = [0.0, 0.013, 0.25, 0.5, 0.77, 1.0]
    found = quantiles(xr.Dataset(table), ["one", "same", "none"], parts)
    known = values[~np.isnan(values) & (status == Status.OK)]
    assert found["one"][0] == known.size
    assert found["one"][1][-1] == np.inf
    np.testing.assert_allclose(found["one"][1][:-1], np.quantile(known, parts[:-1]), rtol=1e-12)
    assert np.all(found["same"][1] == 2.5)
    assert found["none"][0] == 0
    assert np.all(np.isnan(found["none"][1]))


def test_the_best_keep_the_conditions(finished, capsys, tmp_path):
    whole, _ = finished
    with sg.load_study(whole) as data:
        frame = data.load().to_dataframe()
        conditions = [condition(data, "shell.a_mm < 15"), condition(data, "force_at_12_kPa_N <= 4")]
        numbers, allowed = best(data, "force_at_12_kPa", True, 3, conditions)
        reasons = reason_counts(data)["status_12_kPa"]
    kept = frame[(frame["shell.a"] < 15 * mm) & (frame["force_at_12_kPa"] <= 4) & (frame["status_12_kPa"] == Status.OK)]
    assert allowed == len(kept) > 3
    assert list(numbers) == list(kept.sort_values("force_at_12_kPa", ascending=False).index[:3])
    assert sum(sum(counts.values()) for counts in reasons.values()) == len(frame)
    words = ["--best", "force_at_12_kPa_N", "--most", "--where", "shell.a_mm < 15", "--where", "force_at_12_kPa_N<=4"]
    picture = tmp_path / "study.png"
    assert run(["summary", str(whole), *words, "--json", "--count", "3", "--plot", str(picture)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["design"] for row in told["best"]] == list(numbers)
    forces = frame["force_at_12_kPa"][frame["status_12_kPa"] == Status.OK]  # the zeros of NO_CONTACT are no answers
    assert (frame["status_12_kPa"] == Status.NO_CONTACT).any()
    assert told["quantities"]["force_at_12_kPa"]["answered"] == len(forces)
    assert told["quantities"]["force_at_12_kPa"]["median"] == pytest.approx(forces.median(), rel=1e-12)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run(["summary", str(whole), "--best", "force_at_12_kPa_N", "--where", "shell.a_mm < 0"]) == 1
    assert "No design may be chosen" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--best", "force"], "There is no column 'force' in the study; it has shell.t_m_mm, shell.a_mm, force"),
        (
            ["--best", "force_at_12_kPa_N", "--where", "shell.a_mm == 3"],
            "'shell.a_mm == 3' is no condition: it has none of <, <=, > and >=; a condition is NAME <, <=, > or >= "
            'NUMBER, in the unit of the column, for instance --where "shell.t_m_mm < 1.5".',
        ),
        (
            ["--best", "force_at_12_kPa_N", "--where", "14 < shell.a_mm"],
            "is no condition: '14' stands where the name of a column must be; a condition is",
        ),
        (["--best", "force_at_12_kPa_N", "--where", "< 14"], "is no condition: no column is named before <;"),
        (
            ["--best", "force_at_12_kPa_N", "--where", "shell.a_mm < 1,5"],
            "'1,5' is not a finite number (write decimals with a point);",
        ),
        (
            ["--best", "force_at_12_kPa_N", "--where", "shell.a_mm < 15 mm"],
            "'15 mm' is not a finite number (leave out the unit);",
        ),
        (["--best", "force_at_12_kPa_N", "--where", "shell.a_mm >= nan"], "'nan' is not a finite number;"),
        (["--where", "shell.a_mm < 3"], "--where is given without --best"),
        (["--most"], "--most is given without --best"),
        (["--count", "3"], "--count is given without --best"),
    ],
)
def test_mistakes_about_a_summary_are_one_sentence(finished, capsys, words, sentence):
    assert run(["summary", str(finished[0]), *words]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1


TIED = """
[scenes.free]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[scenes.plane]
type = "shell.FlatContact"
distance_mm = 5
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[sweep]
method = "grid"
gradients = true
[[sweep.variables]]
name = "shell.t_m_mm"
values = [1.0, 1.1, 1.2]
[[sweep.variables]]
name = ["free.shell.a_mm", "free.shell.b_mm"]
values = [16, 18]
[[sweep.observables]]
name = ["free.inflation_mm", "plane.force_N"]
at = { pressure_kPa = 8 }
"""


def test_what_is_tied_is_named(tmp_path, capsys, monkeypatch):
    """A number of two scenes, and two numbers of one: neither is the first of them alone, and each name is known."""
    (tmp_path / "tied.toml").write_text(TIED)
    out = tmp_path / "out"
    assert run(["sweep", str(tmp_path / "tied.toml"), "--out", str(out), "--csv"]) == 0
    with (out / "study.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:2] == ["free.shell.t_m_mm = plane.shell.t_m_mm", "free.shell.a_mm = free.shell.b_mm"]
    assert f"d_free.inflation_at_8_kPa_mm_by_{header[0]}" in header
    capsys.readouterr()
    told = []
    for key in ("shell.t_m_mm", "free.shell.t_m_mm", "plane.shell.t_m_mm", header[0].replace(" ", "")):
        words = ["--best", "free.shell.b_mm", "--where", f"{key} > 1.05"]
        assert run(["summary", str(out), *words, "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out)["best"])
    assert [one["design"] for one in told[0]] == [2, 4, 3, 5]
    assert all(one == told[0] for one in told)
    monkeypatch.setenv("COLUMNS", "200")
    assert run(["summary", str(out), "--best", "shell.t_m_mm"]) == 0
    assert "free.shell.a = free.shell.b" in capsys.readouterr().out
    assert open_study(out, tmp_path).label("free.shell.a") == "free.shell.a = free.shell.b (mm)"
    ax = plots.study(sg.study.load_study(out)).axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        "free.shell.t_m = plane.shell.t_m (mm)",
        "free.shell.a = free.shell.b (mm)",
    )
    # The table is one of designs again, by the keys of the config or by its own columns.
    (tmp_path / "designs.csv").write_text("\n".join(",".join(row[:2]) for row in [header, *rows]))
    start, end = TIED.index("[[sweep.variables]]"), TIED.index("[[sweep.observables]]")
    named = '[[sweep.variables]]\nname = "shell.t_m_mm"\n'
    for k, variables in enumerate(("", named)):
        text = TIED[:start] + variables + TIED[end:]
        (tmp_path / "again.toml").write_text(text.replace('"grid"', '"csv"\nfile = "designs.csv"'))
        assert run(["sweep", str(tmp_path / "again.toml"), "--out", str(tmp_path / f"again{k}"), "--csv"]) == 0
        with (tmp_path / f"again{k}" / "study.csv").open(newline="") as file:
            again = next(csv.reader(file))
        assert again[: 2 - k] == header[: 2 - k]


def test_a_store_that_says_no_ties_is_read(tmp_path, capsys):
    (tmp_path / "tied.toml").write_text(TIED)
    out = tmp_path / "out"
    assert run(["sweep", str(tmp_path / "tied.toml"), "--out", str(out)]) == 0
    for name in ("free.shell.t_m", "free.shell.a"):
        path = out / STORE / name / "zarr.json"
        about = json.loads(path.read_text())
        assert about["attributes"].pop("tied").startswith(f"{name} = ")
        path.write_text(json.dumps(about))
    capsys.readouterr()
    assert run(["summary", str(out), "--best", "free.shell.a_mm", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["best"]) == 6


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (
            lambda store: spoil(store / "force_at_12_kPa" / "c" / "1"),
            "force_at_12_kPa cannot be read: Stored and computed",
        ),
        (lambda store: spoil(store / "shell.a" / "c" / "1"), "shell.a cannot be read: Stored and computed checksum"),
        (
            lambda store: (store / "status_12_kPa" / "c" / "1").unlink(),
            "status_12_kPa cannot be read: a chunk is missing",
        ),
        (
            lambda store: (store / "reason_12_kPa" / "c" / "1").unlink(),
            "reason_12_kPa cannot be read: a chunk is missing",
        ),
        (lambda store: shutil.rmtree(store / "force_at_12_kPa"), "it lacks force_at_12_kPa"),
        (lambda store: (store / "force_at_12_kPa" / "zarr.json").write_text("{"), "study.zarr cannot be read"),
    ],
)
def test_a_damaged_study_is_one_sentence(finished, tmp_path, capsys, damage, sentence):
    """With its name, whether numbers or a picture are asked for."""
    place = tmp_path / "damaged"
    shutil.copytree(finished[0], place)
    damage(place / STORE)
    words = ["--best", "shell.a_mm", "--plot", str(tmp_path / "study.png")]
    assert run(["summary", str(place), *words]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert sentence in said
    assert f"{place / STORE}" in said


def spoil(chunk):
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(content)


@pytest.fixture(scope="module")
def endless(tmp_path_factory):
    """Free membranes that differ in their second constant: the first has a limit pressure, the others have none."""
    place = tmp_path_factory.mktemp("endless")
    material = sg.MooneyRivlin(c1=80 * kPa, c2=0.0)
    scene = sg.shell.Free(sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=material))
    asked = [sg.Quantity("limit_pressure"), sg.Quantity("limit_margin", PRESSURE)]
    study = sg.Study(scene, ["shell.material.c2"], asked, Grid([np.array([0.0, 20.0, 30.0]) * kPa]), gradients=True)
    run_in(place, study, "x")
    return place, scene


def test_no_limit_is_an_answer_without_an_end(endless, capsys):
    place, scene = endless
    limit = float(sg.limit_pressure(scene))
    with sg.load_study(place) as data:
        np.testing.assert_allclose(data.limit_pressure, [limit, np.inf, np.inf])
        np.testing.assert_allclose(data.limit_margin_at_12_kPa, [limit / PRESSURE, np.inf, np.inf])
        assert np.isnan(data.slope_of_limit_margin_at_12_kPa[1:]).all()
    assert run(["summary", str(place), "--best", "limit_pressure_kPa", "--most", "--json"]) == 0
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert [row["design"] for row in told["best"]] == [1, 2, 0]
    for name, least in (("limit_pressure", limit), ("limit_margin_at_12_kPa", limit / PRESSURE)):
        found = told["quantities"][name]
        assert (found["answered"], found["median"], found["most"]) == (3, None, None)
        assert found["least"] == pytest.approx(least)
    assert "inf" not in said.err
    assert "1e+06" not in said.err
    assert said.err.count("none") > 10


def test_no_limit_has_its_place_in_pictures(endless):
    with sg.load_study(endless[0]) as data:
        curve = data.load()
    (pressures, margins) = plots.study(curve).axes
    for ax in (pressures, margins):
        assert [text.get_text() for text in ax.get_legend().get_texts()] == ["no limit"]
        assert np.isfinite(ax.get_ylim()).all()
        assert np.isfinite(ax.lines[0].get_ydata()).tolist() == [True, False, False]
    two = xr.concat([curve, curve], xr.DataArray([1.0, 2.0], dims="radius", attrs={"kind": "length"}))
    maps = [ax for ax in plots.study(two).axes if ax.get_title(loc="left")]
    assert [[text.get_text() for text in ax.get_legend().get_texts()] for ax in maps] == [["no limit"]] * 2


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
    assert "12 days" in said
    # Two varied numbers, two forces and two statuses to a design.
    assert "about 48 TB of disk" in said
    assert not out.exists()


def test_a_folder_that_cannot_be_made_is_said_before_a_disk_without_room(config, tmp_path, capsys, monkeypatch):
    """What takes no file has no room either: /proc, an image that is mounted to be read."""
    small(config, tmp_path)
    (tmp_path / "file").touch()
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage._replace(free=0))
    assert run(["sweep", str(config), "--out", str(tmp_path / "file" / "study")]) == 2
    assert "cannot be made" in capsys.readouterr().err


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
    assert STORE in said.out
    assert "nan" not in said.out


def small(config, tmp_path, **changes):
    text = config.read_text().replace(str(DESIGNS), "6")
    for old, new in changes.items():
        text = text.replace(old, new)
    config.write_text(text)
    return tmp_path / "out"


def test_a_table_of_designs_has_units_in_its_columns(config, tmp_path, capsys):
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text("note,shell.a_mm,distance_mm\nfirst,12,3\nsecond,18,4\n\n")
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    config.write_text(text.replace("low = 10\nhigh = 22\n", "").replace("low = 2\nhigh = 9\n", ""))
    assert run(["sweep", str(config), "--out", str(out), "--json", "--csv"]) == 0
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
        ('"shell.a_mm"', '"shell.a"', "did you mean shell.a_mm"),
        ('"distance_mm"', '"shell.a_mm"', "is given twice"),
        ('"force_N"', '"force"', "there is no quantity 'force'"),
        ("at = { pressure_kPa = [10, 20] }", "", "force_N is asked without at; at must be"),
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


def test_a_grid_holds_a_value_once(config, tmp_path, capsys):
    """Its picture had an axis of no width."""
    ends = config.read_text().replace("low = 10\nhigh = 22\n", "values = [12, 10, 12]\n")
    grid = ends.replace("low = 2\nhigh = 9\n", "values = [5]\n").replace(f'"sobol"\nsamples = {DESIGNS}', '"grid"')
    config.write_text(grid)
    assert run(["sweep", str(config), "--out", str(tmp_path / "out")]) == 2
    assert "the values of shell.a_mm hold 12 twice; each may be there once.\n" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("shell.a_mm\n", "has no rows of designs"),
        ("shell.a\n12\n", "line 1: there is no number 'shell.a'; did you mean shell.a_mm?"),
        ("shell.a_mm\n12\nx\n", "line 3: shell.a_mm is 'x'; it must be a number"),
        ("note,shell.a_mm\nx,12\n", "picks those to read)"),
        ("shell.a_mm;distance_mm\n12;1,5\n", "line 2: distance_mm is '1,5'; it must be a number with a decimal point"),
        ("# of a spreadsheet\nshell.a_mm\tdistance_mm\n12\tx\n", "line 3: distance_mm is 'x'; it must be a number"),
        ("# nothing\n\n", "is empty; its first line must name the columns"),
        ("shell.a_mm\n-12\n", "must be a positive finite number in mm"),
        ("shell.a_mm\n1_2\n", "line 2: shell.a_mm is '1_2'; it must be a number"),
        (
            "shell.a_mm,distance_mm\n16,1,5\n",
            "line 2: there are 3 cells below 2 columns; a decimal comma must be a point",
        ),
        (
            'shell.a_mm,distance_mm,\n16,1,"first\n17,1,second\n18,1,"third"\n',
            "line 2: The quotation mark before 'first' is not closed on this line",
        ),
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


@pytest.mark.parametrize(
    "table",
    [
        "shell.a_mm;distance_mm\n12;3\n18;4\n",
        "shell.a_mm\tdistance_mm\n12\t3\n18\t4\n",
        "# two designs, of Monday\nshell.a_mm,distance_mm\n12,3\n# the wide one\n18,4\n",
        "shell.a_mm,distance_mm,\n12,3,\n18,4,\n",
    ],
)
def test_tables_are_written_in_several_ways(config, tmp_path, table):
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text(table)
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    start, end = text.index("[[sweep.variables]]"), text.index("[[sweep.observables]]")
    config.write_text(text[:start] + text[end:])
    assert run(["sweep", str(config), "--out", str(out)]) == 0
    with sg.load_study(out) as data:
        np.testing.assert_allclose(data["shell.a"].values, [12 * mm, 18 * mm])
        np.testing.assert_allclose(data["distance"].values, [3 * mm, 4 * mm])


def test_a_column_that_is_there_twice_is_refused(config, tmp_path, capsys):
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text("shell.a_mm,distance_mm,shell.a_mm\n12,3,20\n")
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    config.write_text(text.replace("low = 10\nhigh = 22\n", "").replace("low = 2\nhigh = 9\n", ""))
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "line 1: 2 columns are called 'shell.a_mm'; one that is read must be there once." in said
    assert not out.exists()


def test_a_spreadsheet_may_mark_its_file(config, tmp_path):
    """Excel's "CSV UTF-8" begins with three bytes that no name has."""
    out = small(config, tmp_path)
    (tmp_path / "designs.csv").write_text("shell.a_mm\n12\n18\n", encoding="utf-8-sig")
    text = config.read_text().replace('method = "sobol"\nsamples = 6', 'method = "csv"\nfile = "designs.csv"')
    start, end = text.index("[[sweep.variables]]"), text.index("[[sweep.observables]]")
    config.write_text(text[:start] + text[end:])
    assert run(["sweep", str(config), "--out", str(out)]) == 0


def test_a_disk_that_is_full_leaves_the_picture_that_was_there(config, tmp_path, capsys, monkeypatch):
    out = small(config, tmp_path)
    assert run(["sweep", str(config), "--out", str(out)]) == 0
    before = (out / "study.png").read_bytes()

    def full(figure, path, **options):
        Path(path).write_bytes(before[:100])
        raise OSError(errno.EFBIG, "File too large")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", full)
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    assert capsys.readouterr().err.rstrip().endswith("study.png cannot be written: file too large.")
    assert (out / "study.png").read_bytes() == before
    assert not list(out.glob(".unfinished*"))


def test_designs_that_no_mould_can_make_are_counted():
    finger = sg.PneuNet.table_5_1("A")
    walls = np.array([1.0, 1.2, 1.7, 1.9]) * mm  # of a chamber of 4.2 mm, whose air needs 1 mm
    study = sg.Study(sg.pneunet.Linear(finger), ["finger.t_m"], [sg.Quantity("end_moment", 5 * kPa)], Grid([walls]))
    (said,) = beyond_ranges(study)
    assert said == (
        "2 of 4 designs that were looked at are beyond mould_range; of the worst, what is left of a chamber's air or "
        "side walls is 0.6 mm less than a mould and liquid silicone can do. The observable margins.mould_range_mm says "
        "which."
    )


CURLED = """
[scene]
type = "pneunet.Free"
weight_N_per_m = [0, 0]
inclination = "none"
[scene.finger]
preset = "table_5_1_A"
[sweep]
method = "grid"
[[sweep.variables]]
name = "finger.H_mm"
low = 3
high = 5
points = 9
[[sweep.observables]]
name = "tip_angle_deg"
at = { pressure_kPa = [5, 20] }
"""


def test_states_beyond_one_turn_are_counted(tmp_path, capsys):
    """As `solve` and `path` say of a state: it is OK and has its answer, and no column more is kept for that."""
    (tmp_path / "curled.toml").write_text(CURLED)
    assert run(["sweep", str(tmp_path / "curled.toml"), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out.splitlines()
    with sg.load_study(tmp_path / "out") as data:
        data.load()
    assert {str(name).partition("_")[0] for name in data.data_vars} == {"tip", "status", "reason"}
    curled = data["tip_angle_at_20_kPa"].values > 2 * np.pi
    assert 0 < curled.sum() < 9
    assert (data["status_20_kPa"] == Status.OK).all()
    np.testing.assert_array_equal(data["reason_20_kPa"] == sg.Reason.ONE_TURN, curled)
    assert (data["reason_5_kPa"] == sg.Reason.NONE).all()
    place = told.index("20 kPa: 9 OK")
    assert told[place - 1] == "5 kPa: 9 OK"
    assert told[place + 1] == f"  {curled.sum()} OK, ONE_TURN: {sg.Reason.ONE_TURN.text()}"
    assert run(["summary", str(tmp_path / "out")]) == 0
    assert f"  OK: {curled.sum()} ONE_TURN" in capsys.readouterr().out.splitlines()


def test_a_margin_of_a_state_that_is_asked_for_stays_where_it_was():
    finger = sg.PneuNet.table_5_1("A")
    scene = sg.pneunet.Free(finger, weight=None, inclination="none", drive="small_strain")
    asked = [
        sg.Quantity("margins.one_turn", 20 * kPa),
        sg.Quantity("limit_pressure"),
        sg.Quantity("tip_angle", 20 * kPa),
    ]
    study = sg.Study(scene, ["finger.H"], asked, Grid([np.array([3.0, 5.0, 9.0]) * mm]), gradients=True)
    data = study.run()
    angles = data["tip_angle_at_20_kPa"].values
    margins = data["margins.one_turn_at_20_kPa"].values
    np.testing.assert_allclose(margins, float(finger.L) * (1 - angles / (2 * np.pi)), atol=1e-12)
    slopes = [data[f"slope_of_{name}_at_20_kPa"].values[:, 0] for name in ("margins.one_turn", "tip_angle")]
    np.testing.assert_allclose(slopes[0], -float(finger.L) / (2 * np.pi) * slopes[1], rtol=1e-9)
    assert data["reason_20_kPa"].values.tolist() == [sg.Reason.ONE_TURN, sg.Reason.NONE, sg.Reason.NONE]
    assert (data["reason_limit"] == sg.Reason.NONE).all()


def test_a_folder_of_something_else_is_left_alone(config, tmp_path, capsys):
    out = small(config, tmp_path)
    out.mkdir()
    (out / "thesis.docx").write_text("years of work")
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    assert "exists already and holds no study" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["thesis.docx"]


def test_a_store_is_a_zarr(config, tmp_path, capsys):
    small(config, tmp_path)
    assert run(["sweep", str(config), "--to", str(tmp_path / "x.foo")]) == 2
    assert "x.foo'; it must be a path that ends in .zarr, or an address (s3://...).\n" in capsys.readouterr().err
    assert not (tmp_path / "x.foo").exists()


def test_the_folder_of_another_run_is_left_alone_where_the_store_is_elsewhere(config, tmp_path, capsys):
    out = small(config, tmp_path)
    to = ["--to", str(out / "mine.zarr"), "--out", str(out)]
    assert run(["sweep", str(config), *to]) == 0  # a store in the folder has its own name
    assert run(["sweep", str(config), *to]) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    config.write_text(config.read_text().replace("distance_mm = 5", "distance_mm = 6"))
    capsys.readouterr()
    assert run(["sweep", str(config), "--to", str(tmp_path / "other.zarr"), "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"--out {out} holds something else than this study; give a new folder.\n"
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before
    assert not (tmp_path / "other.zarr").exists()


def test_a_comment_makes_no_other_study(config, tmp_path, capsys):
    """It goes on. Another number does."""
    out = small(config, tmp_path)
    for to in ([], ["--to", str(out / "mine.zarr")]):
        assert run(["sweep", str(config), *to, "--out", str(out)]) == 0
        config.write_text("# of the second batch\n" + config.read_text())
        assert run(["sweep", str(config), *to, "--out", str(out)]) == 0
    assert (out / "config.toml").read_text().startswith("# of the second batch\n")
    capsys.readouterr()
    config.write_text(config.read_text().replace("distance_mm = 5", "distance_mm = 6"))
    assert run(["sweep", str(config), "--out", str(out)]) == 2
    assert "holds another study (different: config)" in capsys.readouterr().err


def test_labels_have_units_and_never_merge_two_states():
    scene, walls = sg.shell.Free(shell()), Grid([np.array([1.0, 1.1]) * mm])
    asked = [sg.Quantity("pressure", at) for at in (("inflation", 10 * mm), ("clamp_angle", np.pi / 3), 31 * kPa)]
    study = sg.Study(scene, ["shell.t_m"], asked, walls)
    assert study.asked.labels() == [
        "pressure at inflation 10 mm",
        "pressure at clamp_angle 60 deg",
        "pressure at 31 kPa",
    ]
    assert study.asked.state_labels() == ["inflation 10 mm", "clamp_angle 60 deg", "31 kPa"]
    asked = [sg.Quantity("inflation", at) for at in (15.00001 * kPa, 15.00004 * kPa)]
    with pytest.raises(InputError, match="would be called inflation_at_15_kPa"):
        sg.Study(scene, ["shell.t_m"], asked, walls)


# --- pictures ---------------------------------------------------------------------------------------------------------


def grid_of(*axes):
    """A study of the sum of its numbers, of which those above 7 have no answer."""
    dims = ("a", "b")[: len(axes)]
    values = sum(np.meshgrid(*axes, indexing="ij"))
    status = np.where(values > 7, int(Status.BEYOND_LIMIT), int(Status.OK))
    words = {"long_name": "force at 1 kPa", "kind": "number", "status": "status_1_kPa"}
    data = {"force": (dims, values, words), "status_1_kPa": (dims, status, {})}
    return xr.Dataset(data, {d: (d, axis, {"kind": "number"}) for d, axis in zip(dims, axes, strict=True)})


def test_a_grid_is_drawn_in_the_order_of_its_numbers():
    values = np.array([3.0, 9.0, 1.0, 5.0])
    (ax,) = plots.study(grid_of(values)).axes
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), [1, 3, 5, 9])
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [1, 3, 5, np.nan])
    assert ax.get_xlim() == (1, 9)
    ax = plots.study(grid_of(values, values[::-1])).axes[0]
    assert ax.get_xlim() == ax.get_ylim() == (1, 9)
    sums = np.add.outer(*[np.sort(values)] * 2)
    np.testing.assert_array_equal(ax.collections[0].get_array().filled(np.nan), np.where(sums > 7, np.nan, sums))
    (hatched,) = ax.collections[1].get_paths()
    corners = np.array([1.01, 1.99, 2.01, 3.99, 4.01, 6.99, 7.01, 8.99])  # just inside of their cells
    places = [(x, y) for x in corners for y in corners]
    expected = np.repeat(np.repeat(sums > 7, 2, axis=0), 2, axis=1).ravel()
    np.testing.assert_array_equal(hatched.contains_points(places), expected)


def test_neighbours_without_an_answer_are_one_span():
    (ax,) = plots.study(grid_of(np.linspace(0, 10, 2001))).axes
    (span,) = ax.patches
    assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx((7.0025, 10))


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


@pytest.mark.slow
def test_membranes_by_energy_are_not_filled_up_with_copies_and_know_each_other():
    """Three designs are a batch of three, and two pressures of a design one program."""
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    scene = sg.shell.ObstacleContact(shell, sg.shell.obstacles.Plane(5 * mm), symmetry="both", across=2, lengthwise=2)
    sizes = np.array([1.0, 1.1, 1.3]) * mm
    asked = [sg.Quantity("force", PRESSURE), sg.Quantity("force", 1.0 * kPa)]
    study = sg.Study(scene, ["shell.t_m"], asked, Grid([sizes]))
    assert study.batch == study.call == 3
    larger = sg.Study(scene, ["shell.t_m", "shell.a"], asked, Grid([np.full(5, 1 * mm), np.full(46, 16 * mm)]))
    assert larger.blocks.chunk == (2, 46)
    assert larger.batch == larger.call == 92  # 128 would be a third more
    data, solved = study.run(), jax.jit(sg.solve)
    for k, t_m in enumerate(sizes):
        one = eqx.tree_at(lambda s: s.shell.t_m, scene, jnp.asarray(t_m))
        assert float(data.force_at_12_kPa[k]) == pytest.approx(float(solved(one, PRESSURE).force), rel=1e-11)
        assert data.status_1_kPa[k] == solved(one, 1.0 * kPa).status == sg.Status.NO_CONTACT
