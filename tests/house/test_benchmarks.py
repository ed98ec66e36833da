"""The benchmark runs, and the pages say what its tables say."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT

import softgrip_jax as sg
from benchmarks.speed import measure
from benchmarks.speed.__main__ import run_part
from softgrip_jax import model_error

FOLDER = ROOT / "docs" / "benchmarks"


def quick(tmp_path, *parts):
    """The rows of parts of the benchmark, at a small sample."""
    order = [sys.executable, "-m", "benchmarks.speed", "--quick", "--out", str(tmp_path), "--only", *parts]
    done = subprocess.run(order, cwd=ROOT, capture_output=True, text=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})
    assert done.returncode == 0, done.stderr[-2000:]
    tables = {part: (tmp_path / f"{part}.csv").read_text(encoding="utf-8").splitlines() for part in parts}
    return {part: list(csv.DictReader(lines)) for part, lines in tables.items()}


@pytest.mark.slow
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
    "part",
    [
        *("fingers", "methods", "peers", "scenes", "models", "arcs", "energy", "hard", "start", "fidelity"),
        *("gpu_same", "gpu_shells", "gpu_fingers", "gpu_energy", "gpu_search"),
    ],
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


def test_pages_say_what_the_tables_say(tmp_path, monkeypatch):
    """Written again from the CSV files, a page does not change."""
    from benchmarks.speed import page

    folder = shutil.copytree(FOLDER, tmp_path / "benchmarks")
    for name in ("speed-and-error.md", "hard-cases.md"):
        copy = Path(shutil.copy(ROOT / "docs" / name, tmp_path))
        page.write_page(copy, folder)
        assert copy.read_text(encoding="utf-8") == (ROOT / "docs" / name).read_text(encoding="utf-8")
        monkeypatch.setattr(page.pictures, "draw", lambda *_: None)  # the pictures are the same for both


def rows_of(name):
    with (FOLDER / f"{name}.csv").open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


@pytest.mark.parametrize(("model", "column"), [("arc", "thesis_model"), ("energy", "better_model")])
def test_reports_say_what_the_table_of_models_says(model, column):
    """The sentences beside the numbers of shells hold the smallest and the largest error of the table, in percent."""
    rows = rows_of("models")
    for sentence, quantity in (
        (model_error.FREE[model], "shell, free: inflation"),
        (model_error.PLANE[model], "shell on a plane: force"),
        (model_error.CYLINDER[model], "shell on a cylinder: force"),
        (model_error.LEANING[model], "shell on a leaning plane: force"),
        (model_error.LIMIT[model], "shell, free: largest pressure"),
    ):
        errors = [
            100 * (float(row[column]) / float(row["finite_elements"]) - 1)
            for row in rows
            if row["quantity"] == quantity
        ]
        assert errors
        said = [float(number) for number in re.findall(r"[\d.]+", sentence.partition("%")[0])]
        digits = len(re.findall(r"\.(\d+)", sentence.partition("%")[0])[:1])
        assert said[-1] == round(max(map(abs, errors)), digits)
        if "within" not in sentence:
            assert said[0] == round(min(map(abs, errors)), digits)
            assert {error > 0 for error in errors} == {"more" in sentence}


def test_reports_say_what_the_table_of_random_shells_says():
    """The sentences beside the numbers of shells by arcs hold what 5 of 100 are below and above, in percent."""
    scenes = sg.shell.Free, sg.shell.FlatContact, sg.shell.InclinedContact, sg.shell.CylinderContact, sg.shell.Grasp
    rows = rows_of("arcs")
    assert len(rows) == len(scenes)
    for row, scene in zip(rows, scenes, strict=True):
        sentence = model_error.ARCS[scene][row["quantity"].rpartition(": ")[2]]
        said = [int(number) for number in re.findall(r"(\d+)(?= to | %)", sentence)]
        low, high = (round(100 * float(row[end])) for end in ("low", "high"))
        assert sorted(said) == sorted([abs(low), abs(high)])
        assert ("less" in sentence, "more" in sentence) == (low < 0, high > 0)


def errors_of_models():
    """What the tables of the benchmark say, in percent, by the first words of a row and its model."""
    models = {(row["quantity"], row["at"]): row for row in rows_of("models")}
    drives = {row["model"]: row for row in rows_of("drives")}
    for model, column in (("arcs", "thesis_model"), ("energy membrane", "better_model")):
        for words, quantity, places in (
            ("shell 32 x 86 x 1.1 mm, free: inflation", "shell, free: inflation", ("5", "15")),
            ("the same: largest pressure", "shell, free: largest pressure", ("",)),
            ("the same, on a plane 5 mm away: force", "shell on a plane: force", ("5", "10", "15", "20")),
            ("the same, on a cylinder", "shell on a cylinder: force", ("5", "10", "15")),
            ("shell 32 x 32 x 1.1 mm", "shell on a leaning plane: force", ("10", "15")),
            ("chamber wall on its neighbour: force", "chamber wall on its neighbour: force", ("28", "31")),
        ):
            if (words[:7], model) != ("chamber", "energy membrane"):  # another row, from 10 kPa on
                found = [models[quantity, at] for at in places]
                yield words, model, [100 * (float(row[column]) / float(row["finite_elements"]) - 1) for row in found]
    for drive, model in (("thesis", "arcs, the thesis's"), ("cell", "cell law")):
        for words, key in (("moment of the straight segment", "moment"), ("tip force", "force")):
            errors = [float(drives[model][f"{key}_{p}_kPa"]) for p in (5, 15, 31)]
            yield f"finger type A: {words}", f'`drive="{drive}"`', errors


@pytest.mark.parametrize("page", ["README.md", "docs/limits.md"])
def test_errors_of_the_models_are_those_of_the_tables(page):
    """Every row whose numbers a table has says them, rounded to the digits that it shows."""
    said, quantity = {}, ""
    for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
        if line.startswith("|") and line.count("|") == 4:
            first, model, difference = (cell.strip() for cell in line.strip("|").split("|"))
            quantity = first or quantity
            said[quantity, model] = re.findall(r"[-+]?\d+(?:\.\d+)?", difference)
    for words, model, errors in errors_of_models():
        [numbers] = [value for (quantity, of), value in said.items() if quantity.startswith(words) and of == model]
        digits = [len(number.partition(".")[2]) for number in numbers]
        assert [float(n) for n in numbers] == [round(e, d) for e, d in zip(errors, digits, strict=True)], words


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


def test_what_is_timed_is_what_solve_does():
    from benchmarks.speed import cases

    case = cases.shells()["shell flat"]
    value, slopes = jax.jit(cases.value_and_gradient(case))(case.scene, jnp.asarray(case.pressure))
    assert float(value) == pytest.approx(float(sg.solve(case.scene, case.pressure).force), rel=1e-14)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def test_a_process_is_not_charged_for_the_one_that_starts_it():
    from benchmarks.speed import start_part

    held = b"x" * 200_000_000  # written: zeros would take no memory
    _, _, memory = start_part.run([sys.executable, "-c", "pass"], dict(os.environ))
    assert len(held) / 1e6 > memory > 1


def test_a_part_that_is_stopped_keeps_its_rows_and_says_so(tmp_path, monkeypatch):
    def stopped(quick):
        yield measure.row("shell free", "softgrip_jax", "")
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.speed.shell_part.measure", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_part("shells", tmp_path, False, None)
    assert json.loads((tmp_path / "shells.json").read_text())["sample"] == "stopped"
    assert len((tmp_path / "shells.csv").read_text().splitlines()) == 2
