"""What the README shows runs as it stands there."""

import re

import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_of_the_readme(capsys):
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in block.splitlines() if line]) == 10
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    # Thesis table 6.1: 10.9 kPa hold the 563 g cylinder at a gap of 5 mm.
    (pressure,) = re.findall(r"pressure +([\d.]+) kPa", printed)
    assert float(pressure) == pytest.approx(10.9, abs=0.05)
    (slope,) = re.findall(r"([\d.]+) kPa more for each mm", printed)
    sg, grasp = names["sg"], names["grasp"]
    thicker, thinner = (
        sg.shell.Grasp(sg.FlatShell(0.016, 0.043, t_m, sg.NeoHookean(175e3)), 0.02, 0.005, 0.563, 0.96)
        for t_m in (1.1001e-3, 1.0999e-3)
    )
    difference = (sg.pressure_for(thicker).pressure - sg.pressure_for(thinner).pressure) / 0.2e-6 * 1e-6
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)
    assert float(sg.limit_pressure(grasp)) > float(sg.pressure_for(grasp).pressure)


def test_files_of_the_readme_exist():
    for path in re.findall(r"configs/\w+\.toml|CITATION\.cff", README):
        assert (ROOT / path).is_file(), path
