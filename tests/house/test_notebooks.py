"""The notebooks: stored as their text sources make them, small, without physics of their own, and they run."""

import ast
import json
import math
import os
import subprocess
import sys

import pytest
from conftest import ROOT

SOURCES = sorted((ROOT / "notebooks").glob("*.py"))
LARGEST = 250_000
"""Bytes of a stored notebook."""


def cells_of(source):
    jupytext = pytest.importorskip("jupytext")
    return [cell for cell in jupytext.read(source).cells if cell.cell_type == "code"]


def stored(source):
    nbformat = pytest.importorskip("nbformat")
    return nbformat.read(source.with_suffix(".ipynb"), as_version=4)


def test_there_is_one_for_each_step():
    assert {source.stem for source in SOURCES} == {
        "one_chamber",
        "one_finger",
        "contact_and_limit_points",
        "design_search",
        "parameter_study",
        "calibration",
        "your_own_scene",
        "from_design_to_cast",
    }


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_what_is_stored_belongs_to_the_source(source):
    """A source that was changed is executed again (`make notebooks`) before it is committed."""
    notebook = stored(source)
    jupytext = pytest.importorskip("jupytext")
    assert [cell.source for cell in notebook.cells] == [cell.source for cell in jupytext.read(source).cells]
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [output for cell in code for output in cell.outputs]
    assert outputs
    assert not [o for o in outputs if o.output_type == "error"]
    assert source.with_suffix(".ipynb").stat().st_size < LARGEST
    text = source.with_suffix(".ipynb").read_text(encoding="utf-8")
    assert str(ROOT) not in text


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_physics_is_defined_in_the_last_one_alone(source):
    text = "\n".join(line for cell in cells_of(source) for line in cell.source.splitlines() if not line.startswith("%"))
    classes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)]
    if source.stem != "your_own_scene":
        assert classes == []
        return
    (scene,) = classes
    imports = {node.lineno for node in ast.parse(text).body if isinstance(node, ast.Import | ast.ImportFrom)}
    body = [line for line in text.splitlines()[scene.lineno - 1 : scene.end_lineno] if line.strip()]
    assert len(body) + len(imports) < 50
    assert len(body) < 40


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_the_notebook_runs(source, monkeypatch):
    pytest.importorskip("nbclient")
    monkeypatch.syspath_prepend(ROOT / "docs")
    import run_notebooks

    notebook = run_notebooks.execute(source)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert any(cell.outputs for cell in code)
    # A mistake that does not raise is told on stderr.
    said = [o.text for cell in code for o in cell.outputs if o.output_type == "stream" and o.name == "stderr"]
    assert not [text for text in said if "Traceback" in text]
    sys.modules.pop("run_notebooks")


PAD = """
[scene]
type = "RoundPad"
radius_mm = 16
distance_mm = 5
t_m_mm = 1.1
material = { preset = "dragon_skin_20_shell" }

[solve]
force_N = 5

[design]
starts = 4
steps = 3
finishes = 1

[[design.goals]]
minimise = "pressure_kPa"
at = { force_N = 5 }

[[design.variables]]
name = "t_m_mm"
low = 0.8
high = 2
"""


@pytest.mark.slow
def test_a_scene_in_a_file_of_its_own_has_the_command_line(tmp_path):
    source = ROOT / "notebooks" / "your_own_scene.py"
    imports, scene = [cell.source for cell in cells_of(source)][:2]
    lines = [line for line in imports.splitlines() if not line.startswith("%")]
    main = 'if __name__ == "__main__":\n    from softgrip_jax.cli import main\n\n    main()\n'
    (tmp_path / "pad.py").write_text("\n".join([*lines, "\n", scene, "\n", main]))
    (tmp_path / "pad.toml").write_text(PAD)

    def run(*arguments):
        command = [sys.executable, "pad.py", *arguments]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    solved = run("solve", "pad.toml", "--json")
    assert solved.returncode == 0, solved.stderr
    found = json.loads(solved.stdout)
    assert found["scene"] == "RoundPad"
    # The force on a circle of the contact's radius, by hand.
    seen = found["observables"]
    assert seen["force"] == pytest.approx(5, rel=1e-9)
    assert math.pi * seen["contact_radius"] ** 2 * found["pressure"] == pytest.approx(5, rel=1e-9)
    designed = run("design", "pad.toml", "--out", "run")
    assert designed.returncode == 0, designed.stderr
    assert (tmp_path / "run").is_dir()
