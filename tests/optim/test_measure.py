"""`softgrip measure`: numbers as built by closed forms of normal models, conflicts, the design file that follows."""

import csv
import dataclasses
import json
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT
from scipy import stats

import softgrip_jax as sg
from optim import calibrate
from optim.asbuilt import settings
from optim.asbuilt.run import found_from_elsewhere
from optim.asbuilt.update import _masses, calibrated, masses_of, updated
from softgrip_jax import config as configs
from softgrip_jax.cli import MISTAKE, NO_ANSWER, run
from softgrip_jax.units import gram, kPa, mm

CONFIG = """
[scene]
type = "shell.Free"
shell = { a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = { type = "NeoHookean", mu_kPa = 175 } }
[solve]
pressure_kPa = 8
"""
MEASURED = """
[[numbers]]
name = "shell.t_m_mm"
values = [1.18, 1.22]
uncertainty = 0.03
tolerance = 0.08
[[numbers]]
name = "shell.a_mm"
tolerance = 0.01
"""
CURVE = """
[calibrate]
[[calibrate.parameters]]
name = "shell.material.mu_kPa"
low = 50
high = 500
scale = "log"
[[calibrate.curves]]
name = "first inflation"
file = "first.csv"
pressure = { column = "pressure_kPa", unit = "kPa" }
measured = { quantity = "inflation", column = "inflation_mm", unit = "mm" }
"""
MASS = """
[[masses]]
part = "membrane"
value_g = 6.78
uncertainty_g = 0.05
"""


def given(folder, measured=MEASURED, config=CONFIG):
    paths = folder / "design.toml", folder / "measured.toml"
    for path, text in zip(paths, (config, measured), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def read(folder, measured=MEASURED):
    config, path = given(folder, measured)
    return settings.read(configs.load(config), path)


def test_readings_and_tolerance_are_weighed_by_their_variances(tmp_path):
    """The conjugate normal: precision-weighted means."""
    known = updated(read(tmp_path))
    precision = np.array([(0.08 * 1.1) ** -2, 2 * 0.03**-2])
    assert known.built[0] / mm == pytest.approx((precision @ [1.1, 1.2]) / precision.sum(), rel=1e-12)
    assert known.deviations[0] / mm == pytest.approx(precision.sum() ** -0.5, rel=1e-12)
    assert known.built[1] == pytest.approx(16 * mm)
    assert known.deviations[1] == pytest.approx(0.16 * mm)


def test_a_mass_tells_of_all_numbers_that_it_depends_on(tmp_path):
    """A plate m = rho (2 a) (2 b) t: the normal model about it by brute force over a grid."""
    wanted = read(tmp_path, MEASURED + MASS)
    density = 1080 * 2 * 43 * mm

    def plate(settings, x):
        return {"membrane": density * 2 * x[1] * x[0]}

    mass = density * 2 * 16 * mm * 1.17 * mm
    wanted.table.masses[0] = wanted.table.masses[0].model_copy(update={"value_g": mass / gram})
    known = updated(wanted, plate)
    t, a = np.meshgrid(np.linspace(1.0, 1.35, 801) * mm, np.linspace(15.2, 16.8, 801) * mm, indexing="ij")
    error = np.hypot(0.05 * gram, 0.01 * mass)
    exponent = (
        ((t - 1.1 * mm) / (0.08 * 1.1 * mm)) ** 2
        + ((t - 1.2 * mm) / (0.03 * mm / 2**0.5)) ** 2
        + ((a - 16 * mm) / (0.16 * mm)) ** 2
        + ((density * 2 * a * t - mass) / error) ** 2
    )
    weight = np.exp(-0.5 * (exponent - exponent.min()))
    weight /= weight.sum()
    for k, grid in enumerate((t, a)):
        mean = np.sum(weight * grid)
        deviation = np.sqrt(np.sum(weight * (grid - mean) ** 2))
        assert known.built[k] == pytest.approx(mean, abs=0.02 * deviation)
        assert known.deviations[k] == pytest.approx(deviation, rel=0.02)
    correlation = known.covariance[0, 1] / np.prod(known.deviations)
    assert correlation < -0.1, "a wider shell of the same mass is thinner"


FINGER = """
[scene]
type = "pneunet.Free"
finger = { preset = "table_5_1_A", L_mm = 18 }
[manufacture]
foot_mm = 12
"""
LENGTH = """
[[numbers]]
name = "finger.L_mm"
values = [17.9]
uncertainty = 0.05
"""


def test_a_finger_keeps_the_chambers_of_its_mould(tmp_path):
    """Three pitches of 6 mm: the mass has the slope of the cover, and of half the foot, which the first chamber moves
    with. A chamber less in every other difference was 0.7 g in 0.018 mm."""
    pytest.importorskip("build123d", reason="build123d is missing: pip install softgrip_jax[cad]")
    config, path = given(tmp_path, LENGTH, FINGER)
    wanted = settings.read(configs.load(config), path)
    found, slopes = _masses(wanted, np.array([18 * mm]), masses_of)
    per_mm2 = 1080 * mm**2
    assert slopes["base layer"][0] == pytest.approx(20 * 5 * per_mm2, rel=1e-6)
    assert slopes["body"][0] == pytest.approx(0.5 * (20 * 5 - 2 * 2) * per_mm2, rel=1e-6)
    shorter = masses_of(wanted, np.array([17.9 * mm]))
    assert found["body"] - shorter["body"] == pytest.approx(0.1 * mm * slopes["body"][0], rel=1e-6)


def test_segments_as_long_as_their_chambers_can_be_weighed(tmp_path):
    pytest.importorskip("build123d", reason="build123d is missing: pip install softgrip_jax[cad]")
    text = FINGER.replace("L_mm = 18", "L_mm = 17.4, h_x_mm = [0.7, 0.8, 0.9]")
    config, path = given(tmp_path, LENGTH.replace("17.9", "17.3"), text)
    wanted = settings.read(configs.load(config), path)
    drawn, cut = (masses_of(wanted, np.array([length * mm])) for length in (17.4, 17.3))
    assert 0.99 * drawn["finger"] < cut["finger"] < drawn["finger"]


def test_a_mass_that_disagrees_is_told(tmp_path, capsys):
    pytest.importorskip("build123d", reason="build123d is missing: pip install softgrip_jax[cad]")
    config, measured = given(tmp_path, MEASURED + MASS.replace("6.78", "9.1"))
    assert run(["measure", str(config), str(measured), "--out", str(tmp_path / "out")]) == MISTAKE
    told = " ".join(capsys.readouterr().err.split())
    assert "The mass of the membrane, 9.1 g, does not go with its dimensions, which say 6.7" in told
    assert not (tmp_path / "out").exists()


def test_from_measurements_to_a_design_file(tmp_path, capsys):
    """A shell of 1.2 mm and 150 kPa, drawn with 1.1 mm and 175 kPa, is found again from its curve."""
    pytest.importorskip("build123d", reason="build123d is missing: pip install softgrip_jax[cad]")
    pressure = np.linspace(2, 12, 9)
    rng = np.random.default_rng(3)
    height = inflation(pressure * kPa) / mm + rng.normal(0, 0.05, 9)
    rows = "\n".join(f"{p:.6g},{h:.6g}" for p, h in zip(pressure, height, strict=True))
    (tmp_path / "first.csv").write_text(f"pressure_kPa,inflation_mm\n{rows}\n", encoding="utf-8")
    config, measured = given(tmp_path, MEASURED + MASS + CURVE)
    out = tmp_path / "out"
    assert run(["measure", str(config), str(measured), "--out", str(out)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "as drawn and as built" in told
    names = {
        "as_built.toml",
        "config.toml",
        "measured.toml",
        "numbers.csv",
        "result.json",
        "report.html",
        "summary.txt",
    }
    assert {p.name for p in out.iterdir()} == names
    built = configs.load(out / "as_built.toml")
    assert float(built.scene.shell.t_m) == pytest.approx(1.2 * mm, rel=0.01)
    mu = float(built.scene.shell.material.mu)
    result = json.loads((out / "result.json").read_text())
    row = next(row for row in result["numbers"] if row["number"] == "shell.material.mu")
    assert result["units"] == "SI"
    assert row["low_95"] < 150 * kPa < row["high_95"]
    assert row["built"] == pytest.approx(mu)
    # The curve knows the product of mu and t_m: what is not known of the wall is not known of mu.
    wall = next(row for row in result["numbers"] if row["number"] == "shell.t_m")
    assert wall["built"] == pytest.approx(1.2 * mm, rel=0.01)
    with (out / "numbers.csv").open(newline="") as file:
        table = {line["number"]: float(line["built"]) for line in csv.DictReader(file)}
    assert table["shell.material.mu_kPa"] == pytest.approx(mu / kPa)
    relative = [(one["high_95"] - one["low_95"]) / one["built"] for one in (row, wall)]
    assert relative[0] > 0.9 * relative[1]
    assert tomllib.loads((out / "as_built.toml").read_text())["solve"] == {"pressure_kPa": 8}
    seen = {one["name"]: one for one in result["observables"]}
    assert seen["inflation"]["built"] == pytest.approx(float(inflation(np.array([8 * kPa]))[0]), rel=0.01)
    assert run(["solve", str(out / "as_built.toml")]) == 0


def test_the_noise_of_a_curve_is_that_of_its_fit(tmp_path):
    """Wall and modulus bend the curve alike: one of them is fitted, the other is held and takes no freedom from the
    noise; their product is known as well as the curve knows it."""
    pressure = np.linspace(2, 12, 6)
    height = inflation(pressure * kPa) / mm + np.random.default_rng(7).normal(0, 0.1, 6)
    rows = "\n".join(f"{p:.6g},{h:.6g}" for p, h in zip(pressure, height, strict=True))
    (tmp_path / "first.csv").write_text(f"pressure_kPa,inflation_mm\n{rows}\n", encoding="utf-8")
    alone = MEASURED[: MEASURED.rindex("[[numbers]]")]
    wanted = read(tmp_path, alone + CURVE)
    known = calibrated(wanted, updated(wanted))
    sigma = float(known.fit.member.sigma[0])
    assert sigma == pytest.approx(known.fit.rmse(0) * (6 / 5) ** 0.5, rel=1e-6)
    x = np.array([known.built[0], known.fit.x[1]])
    by_product = np.asarray(known.fit.predicted.slopes)[:, 1] * x[1]
    spread = known.joint / np.outer(x, x)
    assert np.sqrt(spread.sum()) == pytest.approx(sigma / np.linalg.norm(by_product), rel=1e-3)
    assert np.sqrt(spread[0, 0]) == pytest.approx(known.deviations[0] / x[0])


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_few_points_tell_little_of_their_noise(loss, tmp_path):
    """Where the wall is known the interval of the modulus is that of a calibration, Student's t and the robust loss
    included; where the wall is not, Welch's and Satterthwaite's degrees of freedom are between the two. (Of 400 curves
    of three points 86 % of the normal intervals held the modulus, of these 94 %.)"""
    pressure, error = np.array([2, 5, 8, 12]), np.array([0.1, -0.12, 0.5, -0.08])
    height = inflation(pressure * kPa) / mm + error
    rows = "\n".join(f"{p},{h:.6g}" for p, h in zip(pressure, height, strict=True))
    (tmp_path / "first.csv").write_text(f"pressure_kPa,inflation_mm\n{rows}\n", encoding="utf-8")
    curve = CURVE.replace("[calibrate]", f"[calibrate]\nloss = '{loss}'")
    wanted = read(tmp_path, "[[numbers]]\nname = 'shell.t_m_mm'\ntolerance = 1e-7\n" + curve)
    alone = calibrate(wanted.calibration.fitting, starts=1)
    known = calibrated(wanted, updated(wanted))
    half = known.half_widths(np.eye(2))[1]
    assert half == pytest.approx(alone.x[0] * alone.quantile[0] * alone.deviation[0], rel=1e-3)
    assert alone.quantile[0] == pytest.approx(stats.t.ppf(0.975, 3))
    unsure = calibrated(wanted, dataclasses.replace(updated(wanted), covariance=np.diag((0.02 * known.drawn) ** 2)))
    by_noise, whole = known.joint[1, 1], unsure.joint[1, 1]
    expected = stats.t.ppf(0.975, 3 * (whole / by_noise) ** 2) * np.sqrt(whole)
    assert unsure.half_widths(np.eye(2))[1] == pytest.approx(expected, rel=1e-6)


def test_a_modulus_that_is_hardly_known_is_above_zero(tmp_path, capsys):
    """The interval of a modulus that is fitted by its logarithm is that of a calibration, not one that is as long below
    the modulus as above: of readings this noisy that one began below zero."""
    pressure, error = np.array([2, 5, 8, 12]), np.array([3, -6, 9, -4])
    height = inflation(pressure * kPa) / mm + error
    rows = "\n".join(f"{p},{h:.6g}" for p, h in zip(pressure, height, strict=True))
    (tmp_path / "first.csv").write_text(f"pressure_kPa,inflation_mm\n{rows}\n", encoding="utf-8")
    config, measured = given(tmp_path, "[[numbers]]\nname = 'shell.t_m_mm'\ntolerance = 1e-7\n" + CURVE)
    out = tmp_path / "out"
    assert run(["measure", str(config), str(measured), "--out", str(out)]) == 0
    wall, modulus = json.loads((out / "result.json").read_text())["numbers"]
    alone = calibrate(settings.read(configs.load(config), measured).calibration.fitting, starts=1)
    assert alone.quantile[0] * alone.deviation[0] > 1
    assert modulus["built"] == pytest.approx(alone.x[0], rel=1e-5)
    assert modulus["low_95"] == pytest.approx(alone.low[0], rel=1e-3)
    assert modulus["high_95"] == pytest.approx(alone.high[0], rel=1e-3)
    assert wall["high_95"] - wall["built"] == pytest.approx(wall["built"] - wall["low_95"], rel=1e-6)
    assert f"kPa ({modulus['low_95'] / kPa:.5g} to" in capsys.readouterr().out


def with_curve(folder, measured=MEASURED, further="", curve=CURVE):
    pressure = np.linspace(2, 12, 6)
    rows = "\n".join(f"{p:.6g},{h / mm:.9g}" for p, h in zip(pressure, inflation(pressure * kPa), strict=True))
    (folder / "first.csv").write_text(f"pressure_kPa,inflation_mm\n{rows}\n{further}", encoding="utf-8")
    wanted = read(folder, measured + curve.replace('column = "inflation_mm"', 'column = "inflation_mm", noise = 0.05'))
    return wanted, updated(wanted)


def test_curves_tell_of_moduli_alone(tmp_path):
    """A drawn wall of 1.1 mm that was never read, and curves of one of 1.2 mm: the wall stays as sure as it was, and
    what is not known of it is in the modulus, by fits with walls that are a little off."""
    drawn = MEASURED.replace("values = [1.18, 1.22]\nuncertainty = 0.03\n", "")
    wanted, before = with_curve(tmp_path, drawn)
    known = calibrated(wanted, before)
    count = len(before.built)
    np.testing.assert_allclose(known.joint[:count, :count], before.covariance, rtol=1e-12)
    steps = 1e-3 * before.built
    by_x = [
        (calibrated(wanted, dataclasses.replace(before, built=before.built + one)).fit.x - known.fit.x)[count] / step
        for one, step in zip(np.diag(steps), steps, strict=True)
    ]
    np.testing.assert_allclose(known.joint[count, :count], before.covariance @ by_x, rtol=2e-2)
    rows = np.asarray(known.fit.predicted.slopes)[:, count] / (0.05 * mm)
    alone = 1 / (rows @ rows)
    assert known.joint[count, count] == pytest.approx(alone + by_x @ before.covariance @ by_x, rel=2e-2)
    assert abs(known.fit.x[count] - 150 * kPa) < 1.96 * known.joint[count, count] ** 0.5


def test_points_beyond_the_limit_are_left_out_and_bounds_are_told(tmp_path):
    whole = calibrated(*with_curve(tmp_path))
    assert whole.remarks == ()
    known = calibrated(*with_curve(tmp_path, further="25,30\n30,30\n"))
    assert known.fit.x[2] == pytest.approx(whole.fit.x[2], rel=1e-6)
    assert "2 of 8 points, from 25 kPa on, left out" in known.remarks[0]
    held = calibrated(*with_curve(tmp_path, curve=CURVE.replace("high = 500", "high = 130")))
    assert any("shell.material.mu is held by a bound" in one for one in held.remarks)
    none = MEASURED + CURVE.replace('"first.csv"', '"none.csv"')
    (tmp_path / "none.csv").write_text("pressure_kPa,inflation_mm\n118,20\n124,20\n130,20\n", encoding="utf-8")
    wanted = read(tmp_path, none)
    with pytest.raises(sg.errors.InputError, match="0 of 3 points have an equilibrium within the bounds"):
        calibrated(wanted, updated(wanted))


def inflation(pressures):
    """Of what was cast: 1.2 mm and 150 kPa."""
    cast = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.2 * mm, material=sg.NeoHookean(mu=150 * kPa))
    return np.asarray(jax.vmap(lambda p: sg.solve(sg.shell.Free(cast), p).inflation)(jnp.asarray(pressures)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("values = [1.18, 1.22]", "values = [-1.2]", "shell.t_m_mm"),
        ("uncertainty = 0.03", "", "has values, but no uncertainty"),
        ("[1.18, 1.22]", "[1180, 1180.02]", "say 1180.01 where 1.1 is drawn"),
        ("[1.18, 1.22]", "[0.00118, 0.00122]", "is it another number, or another unit?"),
        ("[1.18, 1.22]", "[1.2, 12.1, 1.19]", "differ by 10.9, and their uncertainty is 0.03"),
        ('name = "shell.a_mm"', 'name = "shell.t_m_mm"', "is given twice"),
        ('name = "shell.a_mm"', 'name = "shell.q_mm"', "shell.q_mm"),
        ("value_g = 6.78", "value_g = -6.78", "value_g"),
        ('part = "membrane"', 'part = "lid"', "A mass is given of 'lid'; the cast parts are membrane."),
        ("tolerance = 0.08", "tolerance = 3", "tolerance"),
        ('name = "shell.material.mu_kPa"', 'name = "shell.a_mm"', "is measured and calibrated"),
        ('file = "first.csv"', 'file = "none.csv"', "none.csv"),
    ],
)
def test_mistakes_are_one_sentence(old, new, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "lid" in new:
        pytest.importorskip("build123d", reason="build123d is missing: pip install softgrip_jax[cad]")
    (tmp_path / "first.csv").write_text("pressure_kPa,inflation_mm\n2,4\n4,6\n6,7.5\n8,9\n")
    text = MEASURED + MASS + CURVE
    assert old in text
    config, measured = given(tmp_path, text.replace(old, new, 1))
    assert run(["measure", str(config), str(measured)]) == MISTAKE
    assert words in " ".join(capsys.readouterr().err.split())
    assert not Path("runs").exists() or not list(Path("runs").iterdir())


def test_without_a_search_there_is_none_to_repeat(tmp_path, capsys):
    config, measured = given(tmp_path)
    assert run(["measure", str(config), str(measured), "--search"]) == MISTAKE
    assert "has no section [design]" in capsys.readouterr().err


SEARCH = """
[design]
starts = 4
steps = 3
finishes = 0
[[design.variables]]
name = "shell.t_m_mm"
low = 0.8
high = 2
[[design.goals]]
maximise = "inflation_mm"
at = { pressure_kPa = 8 }
[[design.constraints]]
keep = "stretch"
at = { pressure_kPa = 8 }
high = 1.0001
"""
THIN = (
    MEASURED.replace("[1.18, 1.22]", "[0.3, 0.3]")
    .replace("uncertainty = 0.03", "uncertainty = 0.001")
    .replace("tolerance = 0.08", "tolerance = 0.3")
)


def test_a_part_without_an_answer_is_told(tmp_path, capsys):
    """It bursts below the pressure that is asked for; nothing is said of what a search would change."""
    config, measured = given(tmp_path, THIN, CONFIG.replace("t_m_mm = 1.1", "t_m_mm = 0.55") + SEARCH)
    assert run(["measure", str(config), str(measured), "--out", str(tmp_path / "out")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "The design as built has no answer (BEYOND_LIMIT): no equilibrium: the pressure has its largest" in told
    assert "nan" not in told
    text = (tmp_path / "out" / "result.json").read_text()
    result = json.loads(text)
    assert "NaN" not in text
    assert result["status"] == "BEYOND_LIMIT"
    assert result["reason"].startswith("no equilibrium")
    assert result["observables"] == result["elasticities"] == []


def test_a_search_that_keeps_no_constraint_is_told_by_the_exit_code(tmp_path):
    config, measured = given(tmp_path, MEASURED, CONFIG + SEARCH)
    assert run(["measure", str(config), str(measured), "--out", str(tmp_path / "out"), "--search"]) == NO_ANSWER
    result = json.loads((tmp_path / "out" / "search" / "result.json").read_text())
    assert not result["best"]["feasible"]


def test_files_that_the_config_names_are_found_from_the_new_one(tmp_path):
    (tmp_path / "configs").mkdir()
    config = tmp_path / "configs" / "design.toml"
    config.write_text(CONFIG + SEARCH + '[design.uncertain]\nposterior = "../x.nc"\n')
    tables = found_from_elsewhere(configs.load(config))
    assert tables["design"]["uncertain"]["posterior"] == str(tmp_path / "x.nc")
    assert tables["solve"] == {"pressure_kPa": 8}


@pytest.mark.slow  # a grasp and its search
def test_the_shipped_example_finds_what_was_cast(tmp_path):
    config, measured = ROOT / "configs" / "shell_cast.toml", ROOT / "configs" / "data" / "shell_cast_measured.toml"
    assert run(["measure", str(config), str(measured), "--out", str(tmp_path / "out"), "--search"]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    truth = {"shell.t_m_mm": 1.2, "shell.material.mu_kPa": 150}
    for row in result["numbers"]:
        if row["number"] in truth:
            assert row["low_95"] < truth[row["number"]] < row["high_95"]
    assert [one["variable"] for one in result["elasticities"]] == ["grasp.gap"]
    assert (tmp_path / "out" / "search" / "best.toml").is_file()
