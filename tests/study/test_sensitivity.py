"""Elasticities obey Euler's theorem on homogeneous functions; tolerances give the deviations of the closed form."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from conftest import ROOT
from helpers import shell
from rich.console import Console

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax import plots
from softgrip_jax.cli import run
from softgrip_jax.commands import sensitivity as section
from softgrip_jax.errors import InputError
from softgrip_jax.study import sensitivity
from softgrip_jax.units import kPa, mm

LENGTHS = ["shell.a", "shell.b", "shell.t_m", "radius", "gap"]
MU, T = 175 * kPa, 1.1 * mm


@pytest.fixture(scope="module")
def found():
    scene = sg.shell.CylinderContact(shell(), radius=20 * mm, gap=5 * mm)
    quantities = [sg.Quantity(name, 15 * kPa) for name in ("force", "contact_angle", "flat_length", "limit_margin")]
    return sensitivity({"scene": scene}, [*LENGTHS, "shell.material.mu"], quantities)


def test_elasticities_by_all_lengths_add_up_to_the_dimension(found):
    """y(s x) = s^k y(x) for lengths x at a given pressure: k = 2 for a force, 1 for a length, 0 for a pure number."""
    sums = found["elasticity"].sel(by=LENGTHS).sum("by").values
    np.testing.assert_allclose(sums, [2, 0, 1, 0], atol=1e-9)


def test_the_limit_is_proportional_to_the_stiffness(found):
    assert found["elasticity"].sel(quantity="limit_margin at 15 kPa", by="shell.material.mu") == pytest.approx(1)


def test_stiffness_and_thickness_act_as_a_product(found):
    """The tension of a thin membrane is mu t_m times a function of the stretches."""
    by = found["elasticity"]
    np.testing.assert_allclose(by.sel(by="shell.t_m"), by.sel(by="shell.material.mu"), rtol=1e-9)


def test_deviations_of_a_product_are_those_of_the_closed_form():
    """The limit pressure of a free membrane is mu t_m times a constant."""
    tolerances = [20 * kPa, 0.1 * mm]
    scene = sg.shell.Free(shell())
    data = sensitivity(
        {"scene": scene},
        ["shell.material.mu", "shell.t_m"],
        [sg.Quantity("limit_pressure")],
        tolerances,
        20_000,
        seed=2,
    )
    limit = float(sg.limit_pressure(scene))
    relative = np.array(tolerances) / [MU, T] / np.sqrt(3)
    first_order = limit * np.hypot(*relative)
    exact = limit * np.sqrt((1 + relative[0] ** 2) * (1 + relative[1] ** 2) - 1)
    assert float(data["deviation_by_gradient"][0]) == pytest.approx(first_order, rel=1e-9)
    error = float(data["deviation_error"][0])
    assert abs(float(data["deviation_by_sampling"][0]) - exact) < 4 * error
    assert error < 0.01 * exact
    assert abs(float(data["mean_by_sampling"][0]) - limit) < 4 * exact / np.sqrt(20_000)
    np.testing.assert_allclose(data["share"].values[0], relative**2 / np.sum(relative**2), rtol=1e-9)
    assert float(data["answered"][0]) == 1


def test_samples_without_an_answer_are_counted():
    scene = sg.shell.Free(shell())
    pressure = float(sg.limit_pressure(scene))
    data = sensitivity(
        {"scene": scene}, ["shell.t_m"], [sg.Quantity("inflation", 0.98 * pressure)], [0.1 * mm], 4000, seed=1
    )
    # The limit is proportional to t_m: what is thinner than 0.98 t_m has no equilibrium.
    expected = (0.1 + 0.02 * 1.1) / 0.2
    assert float(data["answered"][0]) == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 4000))


def test_a_tolerance_leads_to_nothing_that_cannot_be():
    """Samples of a wall between -0.9 and 3.1 mm were counted, and those below zero called unanswered."""
    scenes, inflation = {"free": sg.shell.Free(shell())}, [sg.Quantity("inflation", at=5 * kPa)]
    said = r"shell.t_m is 1.1 mm, and its tolerance of 2 mm leads to -0.9 mm, which it cannot be; lower it\."
    with pytest.raises(InputError, match=said):
        sensitivity(scenes, ["shell.t_m"], inflation, [2 * mm], samples=100)


def test_a_config_without_the_section_shows_all_of_the_scene(tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["sensitivity", str(ROOT / "configs" / "shell_free.toml"), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    for words in ("shell.material.mu", "inflation", "15 kPa", "13.407 mm"):
        assert words in printed
    names = {path.name for path in out.iterdir()}
    assert names == {
        "config.toml",
        "sensitivity.nc",
        "elasticities.csv",
        "elasticities.png",
        "report.html",
        "summary.txt",
    }
    with xr.open_dataset(out / "sensitivity.nc", engine="h5netcdf") as data:
        row = data["elasticity"].sel(quantity="inflation at 15 kPa")
        assert float(row.sum()) == pytest.approx(1 + float(row.sel(by="shell.material.mu")), abs=1e-9)


def test_tolerances_of_a_config_are_in_its_units(tmp_path, capsys):
    text = (ROOT / "configs" / "shell_free.toml").read_text()
    config = tmp_path / "tolerances.toml"
    config.write_text(
        text + '[sensitivity]\nsamples = 200\n[[sensitivity.variables]]\nname = "shell.t_m_mm"\ntolerance = 0.1\n'
        '[[sensitivity.observables]]\nname = "limit_pressure_kPa"\n'
    )
    assert run(["sensitivity", str(config), "--out", str(tmp_path / "out"), "--json"]) == 0
    out, err = capsys.readouterr()
    # The limit pressure is in proportion to the thickness.
    assert json.loads(out)["quantities"]["limit_pressure"]["elasticity"]["shell.t_m"] == pytest.approx(1, rel=1e-9)
    # 20.1756 kPa is the thesis's limit pressure; 0.1 / sqrt(3) of 1.1 mm is 5.25 %.
    printed = [float(number) for number in re.findall(r"([\d.]+) kPa", err)]
    assert printed[:2] == [20.176, 20.176]
    assert printed[2] == pytest.approx(20.1756 * 0.1 / 1.1 / np.sqrt(3), rel=1e-4)
    assert (tmp_path / "out" / "tolerances.csv").is_file()


@pytest.mark.parametrize(
    ("question", "first", "is_there"),
    [
        ("force_N = 10", "pressure", True),
        ("pressure_kPa = 15", "force", False),
        ("contact_area_mm2 = 900", "pressure", True),
    ],
)
def test_what_was_asked_for_comes_first(question, first, is_there, tmp_path):
    """What `softgrip solve` finds for the same config: the pressure, or where that is given what it does."""
    text = (ROOT / "configs" / "shell_flat.toml").read_text()
    config = tmp_path / "config.toml"
    config.write_text(text.replace("pressure_kPa = 15", question))
    names = [quantity.observable for quantity in section.read(configs.load(config)).quantities]
    assert names[0] == first
    assert names.count("pressure") == is_there
    assert question.rpartition("_")[0] not in names
    grasp = section.read(configs.load(ROOT / "configs" / "shell_grasp.toml")).quantities
    assert grasp[0] == sg.Quantity("pressure", "required")


def test_the_shipped_tolerances(tmp_path, capsys):
    """Without a terminal every stage has a line; Euler's theorem holds for what is written."""
    out = tmp_path / "out"
    assert run(["sensitivity", str(ROOT / "configs" / "shell_tolerances.toml"), "--out", str(out)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "compiling, then differentiating"
    assert told[1] == "samples of the tolerances: 0 of 2000"
    assert {path.name for path in out.iterdir()} >= {"tolerances.csv", "elasticities.png", "sensitivity.nc"}
    with xr.open_dataset(out / "sensitivity.nc", engine="h5netcdf") as data:
        assert [str(name).split(" at")[0] for name in data["quantity"].values] == [
            "force",
            "contact_area",
            "limit_margin",
        ]
        by = data["elasticity"]
        sums = by.sel(by=["shell.t_m", "shell.a", "distance", "shell.b"]).sum("by").values
        np.testing.assert_allclose(sums, [2, 2, 0], atol=1e-8)
        np.testing.assert_allclose(by.sel(by="shell.t_m"), by.sel(by="shell.material.mu"), rtol=1e-8)
        sampled, gradient = float(data["deviation_by_sampling"][0]), float(data["deviation_by_gradient"][0])
        assert abs(sampled - gradient) < 5 * float(data["deviation_error"][0]) + 0.05 * gradient


def test_what_does_not_matter_has_no_bar(found):
    """The rounding of a derivative is no elasticity, and gives no axis its scale."""
    noisy = found.copy(deep=True)
    noisy["elasticity"].loc[{"quantity": "force at 15 kPa", "by": "shell.b"}] = -3e-16
    noisy["elasticity"].loc[{"quantity": "flat_length at 15 kPa"}] = [4e-16, -1e-15, 0.0, 2e-15, 1e-16, -2e-16]
    axes = plots.elasticities(noisy).axes
    widths = {ax.get_title(loc="left"): sorted(bar.get_width() for bar in ax.patches) for ax in axes}
    assert widths["force at 15 kPa"].count(0) == 1
    assert widths["flat_length at 15 kPa"] == [0] * 6
    (nothing,) = [ax for ax in axes if ax.get_title(loc="left") == "flat_length at 15 kPa"]
    assert nothing.get_xlim() == (-1, 1)
    assert [text.get_text() for text in nothing.texts] == ["0"] * 6


def test_what_is_not_known_has_no_bar_and_is_not_called_nothing(found):
    partly = found.copy(deep=True)
    partly["elasticity"].loc[{"quantity": "force at 15 kPa", "by": ["shell.b", "gap"]}] = np.nan
    partly["elasticity"].loc[{"quantity": "flat_length at 15 kPa"}] = np.nan
    first, _, nothing, _ = plots.elasticities(partly).axes
    assert [text.get_text() for text in first.texts].count("-") == 2
    assert sorted(bar.get_width() for bar in first.patches).count(0) == 2
    assert [text.get_text() for text in nothing.texts] == ["-"] * 6
    assert len(nothing.get_yticks()) == 6


def test_no_limit_is_an_answer_and_has_no_mean(capsys):
    scene = sg.shell.Free(sg.FlatShell(a=16 * mm, b=43 * mm, t_m=T, material=sg.MooneyRivlin(c1=80 * kPa, c2=10 * kPa)))
    asked = [sg.Quantity("limit_pressure"), sg.Quantity("limit_margin", 12 * kPa)]
    data = sensitivity({"scene": scene}, ["shell.material.c2"], asked, [10 * kPa], 200)
    assert np.all(np.isinf(data["value"]))
    assert np.all(data["answered"] == 1)
    assert np.all(np.isfinite(data["mean_by_sampling"]))
    assert np.all((data["mean_by_sampling"] > 0) & (data["mean_by_sampling"] < 1e5))
    section.report(data, Console(width=200))
    said = capsys.readouterr().out
    (values,) = [line for line in said.splitlines() if line.startswith("│ value")]
    assert values.count("none") == 2
    assert "inf" not in said
    assert "1e+06" not in said


def test_a_design_without_the_state_is_no_answer_and_says_why(tmp_path, capsys):
    """Samples that have the state were counted as the design's."""
    config = tmp_path / "beyond.toml"
    asked = "".join(
        f'[[sensitivity.observables]]\nname = "{name}"\nat = {{ pressure_kPa = 20.5 }}\n'
        for name in ("inflation_mm", "limit_margin")
    )
    config.write_text(
        (ROOT / "configs" / "shell_free.toml").read_text()
        + '[sensitivity]\nsamples = 200\n[[sensitivity.variables]]\nname = "shell.t_m_mm"\ntolerance = 0.1\n'
        + asked
    )
    assert run(["sensitivity", str(config), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().out
    assert "20.5 kPa: BEYOND_LIMIT, no equilibrium: the pressure has its largest value, 20.18 kPa, at a limit" in said
    inflation, *_ = [line for line in said.splitlines() if line.startswith("│ inflation")]
    assert inflation.count("BEYOND_LIMIT") == 1
    margin, *_ = [line for line in said.splitlines() if line.startswith("│ limit margin")]
    assert "0.984" in margin
    assert "±" not in inflation + margin


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ('[[sensitivity.variables]]\nname = "shell.t_m"', "did you mean shell.t_m_mm"),
        ('[[sensitivity.variables]]\nname = "shell.t_m_mm"\ntolerance = -1', "greater than 0"),
        ('[[sensitivity.observables]]\nname = "force_N"\nat = { pressure_kPa = 3 }', "there is no quantity 'force_N'"),
        ("[sensitivity]\nsample = 5", "did you mean samples"),
    ],
)
def test_mistakes_are_one_sentence(table, sentence, tmp_path, capsys):
    config = tmp_path / "config.toml"
    config.write_text((ROOT / "configs" / "shell_free.toml").read_text() + table)
    assert run(["sensitivity", str(config), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"config.toml"}


TWO = """
[scenes.free]
type = "shell.Free"
[scenes.plane]
type = "shell.FlatContact"
distance_mm = 5
[scenes.free.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
[scenes.free.shell.material]
type = "NeoHookean"
mu_kPa = 175
[scenes.plane.shell]
a_mm = 16
b_mm = 43
t_m_mm = 1.1
[scenes.plane.shell.material]
type = "NeoHookean"
mu_kPa = 175
[solve]
pressure_kPa = 15
"""


def test_one_of_several_scenes_is_named(tmp_path, capsys):
    """At a given shape the pressure is in proportion to thickness and modulus, so that both have one elasticity."""
    config = tmp_path / "two.toml"
    config.write_text(TWO)
    command = ["sensitivity", str(config), "--json", "--out"]
    assert run([*command, str(tmp_path / "none")]) == 2
    said = capsys.readouterr().err
    assert "has several scenes; say which with --scene, one of free, plane" in said
    assert run([*command, str(tmp_path / "no"), "--scene", "ball"]) == 2
    assert "--scene is 'ball'" in capsys.readouterr().err
    assert run([*command, str(tmp_path / "out"), "--scene", "plane"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["remarks"] == ["These are numbers of the scene plane."]
    by = told["quantities"]["force at 15 kPa"]["elasticity"]
    assert "distance" in by
    assert by["shell.t_m"] == pytest.approx(by["shell.material.mu"], rel=1e-9)


def test_without_a_named_scene_a_section_may_ask_of_several(tmp_path, capsys):
    config = tmp_path / "two.toml"
    asked = '[[sensitivity.observables]]\nname = ["free.limit_pressure_kPa", "plane.limit_pressure_kPa"]\n'
    config.write_text(TWO + asked)
    assert run(["sensitivity", str(config), "--json", "--out", str(tmp_path / "out")]) == 0
    assert len(json.loads(capsys.readouterr().out)["quantities"]) == 2


def test_bars_are_the_elasticities(found):
    figure = plots.elasticities(found)
    first = figure.axes[0]
    assert first.get_title(loc="left") == "force at 15 kPa"
    widths = sorted(bar.get_width() for bar in first.patches)
    np.testing.assert_allclose(widths, np.sort(found["elasticity"].sel(quantity="force at 15 kPa").values))


def drawn(count=4000):
    """mu and t_m that are known as a product: draws of a posterior of free inflation."""
    draw = np.random.default_rng(0)
    product, ratio = draw.normal(0, 0.01, count), draw.normal(0, 0.1, count)
    return np.stack([MU * np.exp(0.5 * (product + ratio)), T * np.exp(0.5 * (product - ratio))], axis=1)


def test_draws_that_go_together_leave_their_product_known():
    """The limit pressure of a free membrane is mu t_m times a constant, so that the draws say all of it."""
    scene, draws = sg.shell.Free(shell()), drawn()
    names = ["shell.material.mu", "shell.t_m"]
    data = sensitivity({"scene": scene}, names, [sg.Quantity("limit_pressure")], (), 20_000, draws=draws)
    limit = float(sg.limit_pressure(scene))
    exact = np.std(limit * np.prod(draws / [MU, T], axis=1))
    assert float(data["deviation_by_sampling"][0]) == pytest.approx(exact, rel=0.03)
    assert float(data["deviation_by_gradient"][0]) == pytest.approx(exact, rel=0.1)
    assert float(data["share"].sum()) == pytest.approx(1)
    apart = np.std(draws / [MU, T], axis=0)
    assert exact / limit < 0.2 * np.hypot(*apart)


def test_a_posterior_and_a_tolerance_go_into_one_analysis(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    draws = drawn(500).reshape(5, 100, 2)
    keys = {"shell.material.mu_kPa": draws[..., 0] / kPa, "shell.t_m_mm": draws[..., 1] / mm}
    laws = {"laws": json.dumps({"model": ["energy"]})}
    data = xr.Dataset({key: (("chain", "draw"), values, laws) for key, values in keys.items()})
    data.to_netcdf(tmp_path / "p.nc", group="posterior", engine="h5netcdf")
    text = (
        (ROOT / "configs" / "shell_free.toml").read_text(encoding="utf-8")
        + """
[sensitivity]
posterior = "p.nc"
samples = 1000
[[sensitivity.variables]]
name = "shell.material.mu_kPa"
[[sensitivity.variables]]
name = "shell.t_m_mm"
[[sensitivity.variables]]
name = "shell.a_mm"
tolerance = 0.1
[[sensitivity.observables]]
name = "limit_pressure_kPa"
"""
    )
    config = tmp_path / "c.toml"
    config.write_text(text)
    assert run(["sensitivity", str(config), "--json", "--out", str(tmp_path / "out")]) == 0
    [remark] = json.loads(capsys.readouterr().out)["remarks"]
    assert remark == (
        'The numbers were found with model = "energy"; this scene has model = "arc": they belong to that model.'
    )
    assert remark in (tmp_path / "out" / "summary.txt").read_text()
    with xr.open_dataset(tmp_path / "out" / "sensitivity.nc", engine="h5netcdf") as found:
        # The limit falls with a: three numbers take part, and none of them alone has it all.
        assert float(found["share"].sum()) == pytest.approx(1)
        assert float(found["deviation_by_sampling"][0]) == pytest.approx(
            float(found["deviation_by_gradient"][0]), rel=0.15
        )
    for old, new, words in (
        ('name = "shell.t_m_mm"', 'name = "shell.t_m_mm"\ntolerance = 0.1', "has a tolerance beside the posterior"),
        ('"p.nc"', '"none.nc"', "there is no posterior"),
    ):
        config.write_text(text.replace(old, new))
        assert run(["sensitivity", str(config)]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
