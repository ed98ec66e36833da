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


ORDER = [
    "Install",
    "Ten lines",
    "The command line",
    "What it can do",
    "How right it is",
    "How fast it is",
    "How it works",
    "Development",
    "Licence and citation",
]


def test_the_readme_has_the_order_in_which_people_read():
    head, *sections = re.split(r"^## (.*)$", README, flags=re.MULTILINE)
    assert sections[::2] == ORDER
    assert len(re.findall(r"\.(?:\s|$)", head.partition("![")[0])) == 2  # what it is, in two sentences
    assert head.count("![") == 1


def test_the_page_of_limits_has_the_same_errors():
    (table,) = re.findall(r"^\| quantity \| model \| difference \|\n(?:\|.*\n)+", README, re.MULTILINE)
    assert table in (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")


SPEEDS = {"shell free": "some millions", "shell cylinder": "half a million", "finger, tip held": "a hundred thousand"}


def test_the_speeds_are_those_that_were_measured():
    measured = (ROOT / "docs" / "speed-and-error.md").read_text(encoding="utf-8")
    orders = {"some millions": (2e6, 1e7), "half a million": (4.5e5, 6.5e5), "a hundred thousand": (0.9e5, 2e5)}
    for scene, words in SPEEDS.items():
        (rate,) = re.findall(rf"^\| {scene}: states per second.*?\| [\d,]+ \| ([\d,]+) \|", measured, re.MULTILINE)
        low, high = orders[words]
        assert low < float(rate.replace(",", "")) < high
        assert words in " ".join(README.split())
    times = re.findall(r"value and full gradient over value \| at most 3 \| ([\d.]+) \|", measured)
    assert times
    assert all(f"{float(time):.1f}" in ("1.2", "1.3") for time in times)
    (faster,) = re.findall(r"faster than the thesis's algorithms with SciPy \| .*? \| ([\d,]+) times", measured)
    assert float(faster.replace(",", "")) == pytest.approx(1000, rel=0.1)


def test_links_of_the_readme_exist():
    for path in re.findall(r"\]\((?!http)([^)#]+)", README):
        assert (ROOT / path).is_file(), path


def test_files_of_the_readme_exist():
    for path in re.findall(r"configs/\w+\.toml|CITATION\.cff", README):
        assert (ROOT / path).is_file(), path
