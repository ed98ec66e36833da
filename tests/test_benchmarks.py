"""The benchmark runs, and the pages say what its tables say."""

import csv
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

from benchmarks.speed import measure
from benchmarks.speed.__main__ import run_part

FOLDER = ROOT / "docs" / "benchmarks"


def quick(tmp_path, *parts):
    """The rows of parts of the benchmark, at a small sample."""
    order = [sys.executable, "-m", "benchmarks.speed", "--quick", "--out", str(tmp_path), "--only", *parts]
    done = subprocess.run(order, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})
    assert done.returncode == 0, done.stderr[-2000:]
    tables = {part: (tmp_path / f"{part}.csv").read_text(encoding="utf-8").splitlines() for part in parts}
    return {part: list(csv.DictReader(lines)) for part, lines in tables.items()}


def test_a_small_sample_runs_and_is_right(tmp_path):
    """A shell against 80-bit arithmetic, fsolve and optimistix beside it."""
    rows = quick(tmp_path, "shells")["shells"]
    assert {row["method"].split(",")[0] for row in rows} == {"softgrip_jax", "fsolve", "optimistix Newton"}
    ours = next(row for row in rows if row["method"] == "softgrip_jax")
    assert float(ours["error"]) < 1e-14
    assert float(ours["gradient_error"]) < 1e-12
    assert 0 < float(ours["seconds"]) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    "part", ["fingers", "methods", "peers", "scenes", "models", "energy", "hard", "start", "fidelity"]
)
def test_every_part_runs(tmp_path, part):
    assert quick(tmp_path, part)[part]


@pytest.mark.slow
def test_the_explorer_is_timed_in_a_browser(tmp_path):
    pytest.importorskip("playwright")
    if not (shutil.which("chromium") or shutil.which("chromium-browser")):
        pytest.skip("there is no Chromium: apt-get install chromium")
    [row] = quick(tmp_path, "explorer")["explorer"]
    assert 0 < float(row["median_ms"]) <= float(row["slowest_ms"]) < 2000
    assert row["last_drawn"] == "yes"


@pytest.mark.slow
def test_a_rod_at_rest_is_a_finger(tmp_path):
    pytest.importorskip("elastica")
    errors = [float(row["error"]) for row in quick(tmp_path, "elastica")["elastica"]]
    assert max(errors) < 0.15  # ten elements


@pytest.mark.parametrize("name", ["speed-and-error.md", "hard-cases.md"])
def test_pages_say_what_the_tables_say(tmp_path, name):
    """Written again from the CSV files, a page does not change."""
    from benchmarks.speed.page import write_page

    folder = shutil.copytree(FOLDER, tmp_path / "benchmarks")
    page = tmp_path / name
    page.write_text((ROOT / "docs" / name).read_text(encoding="utf-8"), encoding="utf-8")
    write_page(page, folder)
    assert page.read_text(encoding="utf-8") == (ROOT / "docs" / name).read_text(encoding="utf-8")


def test_the_shells_of_the_benchmark_are_the_thesis_s():
    """Its reference in 80-bit arithmetic gives the published states (thesis 5.1: 13.38 mm, 18.33 N, 5.74 N)."""
    from benchmarks.speed import long_double

    shell = [16e-3, 43e-3, 1.1e-3, 175e3]
    for name, rest, printed in (
        ("shell free", [], 13.38e-3),
        ("shell flat", [5e-3], 18.33),
        ("shell cylinder", [20e-3, 5e-3], 5.74),
    ):
        value, slopes = long_double.value_and_elasticities(name, [*shell, *rest, 15e3])
        assert value == pytest.approx(printed, rel=3e-3)
        # Twice the stiffness at twice the pressure is the same shape: mu and t_m act as one number.
        assert slopes[2] == pytest.approx(slopes[3], rel=1e-9)
        assert np.all(np.isfinite(slopes))


def test_a_part_that_is_stopped_keeps_its_rows_and_says_so(tmp_path, monkeypatch):
    def stopped(quick):
        yield measure.row("shell free", "softgrip_jax", "")
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.speed.shell_part.measure", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_part("shells", tmp_path, False, None)
    assert json.loads((tmp_path / "shells.json").read_text())["sample"] == "stopped"
    assert len((tmp_path / "shells.csv").read_text().splitlines()) == 2
