"""Tension tests: stresses by hand, the choice of a material, where one softens, and silicones where data are there."""

import json
import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize, stats

import softgrip_jax as sg
from optim.calibration.data import Column, Curve, read_columns
from optim.calibration.fit import _other_minima, calibrate
from optim.calibration.model import Fitted, Fitting
from optim.calibration.report import examine
from optim.tension.compare import STRIP, compare, neo_hookean_windows
from optim.tension.run import beyond_the_data, read, verdicts
from optim.tension.test import CANDIDATES, Tension, candidate, softening
from softgrip_jax.cli import MISTAKE, STOPPED, run
from softgrip_jax.errors import InputError
from softgrip_jax.units import kPa

STRAIN = np.linspace(0.02, 1.5, 40)
STRETCH = 1 + STRAIN
RISE = STRETCH - STRETCH**-2
I1 = STRETCH**2 + 2 / STRETCH - 3


def curve(stress, strain=STRAIN):
    return Curve("test", "test", "stress", "pressure", np.asarray(strain), np.asarray(stress))


@pytest.mark.parametrize(
    ("material", "stress"),
    [
        (sg.NeoHookean(mu=1e5), 1e5 * RISE),
        (sg.MooneyRivlin(c1=4e4, c2=1e4), 2 * (4e4 + 1e4 / STRETCH) * RISE),
        (sg.Yeoh(c1=5e4, c2=3e3, c3=-200.0), 2 * (5e4 + 2 * 3e3 * I1 - 3 * 200.0 * I1**2) * RISE),
        (sg.Gent(mu=1e5, j_m=20.0), 1e5 / (1 - I1 / 20.0) * RISE),
        (
            sg.Ogden(mu=[6e4, 1e3], alpha=[1.7, 5.0]),
            sum(m * (STRETCH ** (a - 1) - STRETCH ** (-a / 2 - 1)) for m, a in [(6e4, 1.7), (1e3, 5.0)]),
        ),
    ],
)
def test_stress_is_the_closed_form(material, stress):
    """Engineering stress of an incompressible strip (Treloar 1975; Ogden 1984)."""
    ours = np.array([float(Tension(material).stress(jnp.asarray(e))) for e in STRAIN])
    np.testing.assert_allclose(ours, stress, rtol=1e-11)


def test_a_yeoh_material_that_softens_is_flagged():
    """With C3 < 0 the strip's stress has a maximum, which SciPy finds too."""
    c1, c2, c3 = 5e4, 8e3, -800.0
    soft = {found.mode: found.strain for found in softening(sg.Yeoh(c1=c1, c2=c2, c3=c3), 1.0)}

    def slope(stretch):
        def stress(s):
            i1 = s**2 + 2 / s - 3
            return 2 * (c1 + 2 * c2 * i1 + 3 * c3 * i1**2) * (s - s**-2)

        return (stress(stretch + 1e-6) - stress(stretch - 1e-6)) / 2e-6

    expected = optimize.brentq(slope, 1.5, 3) - 1
    assert soft["uniaxial tension"] == pytest.approx(expected, abs=2 * 2.0 / 400)
    assert softening(sg.NeoHookean(mu=1e5), 1.0) == []
    assert softening(sg.Gent(mu=1e5, j_m=20.0), 5.0) == []


@pytest.fixture(scope="module")
def compared():
    """A Gent material with 1 % noise, the neo-Hookean one, a Yeoh one and itself tried."""
    stress = 1e5 / (1 - I1 / 9.0) * RISE
    noisy = stress * (1 + 0.01 * np.random.default_rng(4).normal(size=40))
    return compare(curve(noisy), ["NeoHookean", "Yeoh", "Gent"], 1.5, [0.25, 0.5, 1.0, 1.5])


def test_the_material_that_made_the_data_is_chosen(compared):
    assert compared.judged[0].name == "Gent"
    assert compared.judged[-1].name == "NeoHookean"
    constants = dict(zip(compared.judged[0].fit.fitting.space.names, compared.judged[0].fit.x, strict=True))
    assert constants["material.mu"] == pytest.approx(1e5, rel=0.02)
    assert constants["material.j_m"] == pytest.approx(9.0, rel=0.02)


def test_mu_of_a_window_is_the_least_squares_value(compared):
    y = compared.curve.y
    for window in compared.windows:
        inside = window.strain + 1e-9 >= STRAIN
        assert window.mu == pytest.approx(RISE[inside] @ y[inside] / (RISE[inside] @ RISE[inside]), rel=1e-6)
    assert any("depends on the window" in sentence for sentence in verdicts(compared))


@pytest.fixture(scope="module")
def specimens():
    """Strips of 150, 170 and 190 kPa with 1 kPa of noise."""
    rng, strain = np.random.default_rng(1), np.linspace(0.05, 1.0, 20)
    stretch = 1 + strain
    stress = [mu * 1e3 * (stretch - stretch**-2) + 1e3 * rng.normal(size=20) for mu in (150, 170, 190)]
    known = {"specimen": np.repeat(np.arange(3), 20), "specimens": ("s1", "s2", "s3")}
    made = Curve("test", "test", "stress", "pressure", np.tile(strain, 3), np.concatenate(stress), **known)
    return compare(made, ["NeoHookean", "Yeoh"], 1.0, [1.0])


def test_an_interval_is_that_of_the_mean_over_specimens(specimens):
    """Student's t over the logarithms of the three moduli, by hand: the noise of the points alone gives a tenth."""
    stretch = 1 + np.linspace(0.05, 1.0, 20)
    rise = stretch - stretch**-2
    mu = np.log(specimens.curve.y.reshape(3, 20) @ rise / (rise @ rise))
    half = stats.t.ppf(0.975, 2) * mu.std(ddof=1) / np.sqrt(3)
    low, high = np.exp(mu.mean() - half), np.exp(mu.mean() + half)
    (window,) = specimens.windows
    assert (window.low, window.high) == (pytest.approx(low, rel=1e-5), pytest.approx(high, rel=1e-5))
    neo = next(one for one in specimens.judged if one.name == "NeoHookean")
    assert neo.ends(0) == (pytest.approx(low, rel=1e-5), pytest.approx(high, rel=1e-5))
    assert neo.fit.high[0] - neo.fit.low[0] < 0.2 * (high - low)
    assert any("by specimen: s1" in sentence and "one to quote" in sentence for sentence in verdicts(specimens))


def test_a_test_of_few_per_cent_is_asked_for_its_unit(compared):
    short = compare(curve(compared.curve.y[:20] / 10, STRAIN[:20] / 100), ["NeoHookean"], 0.0075, [0.0075])
    assert any(
        f"ends at {STRAIN[19]:.4g} % strain" in sentence and "unit of the strain" in sentence
        for sentence in verdicts(short)
    )
    assert not any("unit of the strain" in sentence for sentence in verdicts(compared))


def test_a_test_of_thousands_of_per_cent_is_asked_for_its_unit():
    """Per cent read as numbers: a modulus of 2 kPa was written, and nothing was asked."""
    long = compare(curve(1e5 * RISE, 100 * STRAIN), ["NeoHookean"], 150.0, [150.0])
    asked = [sentence for sentence in verdicts(long) if "unit of the strain" in sentence]
    assert asked == [
        "The test goes to 15000 % strain, and no silicone or rubber beyond 1500 %: is the unit of the strain right?"
    ]


@pytest.mark.parametrize(
    ("strain", "stress", "said"),
    [
        ("stretch", "stress", ["'stretch' is taken as engineering strain, and its name says stretch; is it that?"]),
        (
            "strain",
            "true_stress",
            ["'true_stress' is taken as engineering stress, and its name says true; is it that?"],
        ),
        ("strain", "stress", []),
    ],
)
def test_columns_of_another_measure_are_asked_about(tmp_path, strain, stress, said):
    """True stresses up to 200 % strain gave two and a half times the modulus, without a word."""
    path = written(tmp_path)
    path.write_text(CONFIG.replace('"strain"', f'"{strain}"').replace('"stress"', f'"{stress}"'))
    data = tmp_path / "test.csv"
    data.write_text(data.read_text().replace("strain,stress", f"{strain},{stress}"))
    assert [note.removeprefix("tension: the column ") for note in read(path)[1].notes] == said


def test_a_strain_that_falls_again_is_said(tmp_path):
    """A loop of loading and unloading gave the modulus of their middle without a word."""
    rows = [*zip(100 * STRAIN, 100 * RISE, strict=True), *zip(100 * STRAIN[::-1], 70 * RISE[::-1], strict=True)]
    text = "\n".join(["strain,stress", *(f"{e:.6g},{s:.6g}" for e, s in rows)])
    (tmp_path / "loop.csv").write_text(text)
    (tmp_path / "t.toml").write_text(
        '[tension]\nfile = "loop.csv"\nmaterials = ["NeoHookean"]\n'
        'strain = { column = "strain", unit = "%" }\nstress = { column = "stress", unit = "kPa" }\n'
    )
    assert any("the strain rises and falls again" in note for note in read(tmp_path / "t.toml")[1].notes)


def test_akaike_is_its_formula(compared):
    for one in compared.judged:
        square = np.sum((one.rmse**2) * 40)
        k = one.fit.fitting.space.size + 1
        expected = 40 * np.log(square / 40) + 2 * k + 2 * k * (k + 1) / (40 - k - 1)
        assert one.akaike == pytest.approx(expected, rel=1e-9)


# --- soft, noisy specimens --------------------------------------------------------------------------------------------


def soft(kind):
    """A test of a silicone of some kPa that was pulled with a load cell for a kilonewton.

    "slack": the first stresses are slightly below zero, the noise is that of the load cell, and the specimen is a
    little slack; "toe": it hangs loose up to half of the window.
    """
    rng, strain = np.random.default_rng(0), np.linspace(0.02, 1.5, 24)
    if kind == "toe":
        return curve(np.maximum(strain - 0.7, 0) ** 2 * 2e4 - 200 + 100 * rng.normal(size=24), strain)
    stretch = 1 + np.maximum(strain - 0.05, 0)
    i1 = stretch**2 + 2 / stretch - 3
    stress = (
        2 * (4e3 + 32 * i1 + 0.4 * i1**2) * (stretch - stretch**-2) * (1 - 0.25 * np.exp(-(((strain - 1) / 0.8) ** 2)))
    )
    stress += -600 * np.exp(-strain / 0.1) + 400 * rng.normal(size=24)
    return curve(np.round(stress, -1), strain)


def closed_form(name, x, strain):
    """Engineering stress of a strip (Treloar 1975; Ogden 1984) with constants in the order of the fit."""
    s = 1 + strain
    rise, i1 = s - s**-2, s**2 + 2 / s - 3
    if name.startswith("Ogden"):
        mu, alpha = np.split(np.asarray(x), 2)
        return sum(m * (s ** (a - 1) - s ** (-a / 2 - 1)) for m, a in zip(mu, alpha, strict=True))
    return rise * {
        "NeoHookean": lambda mu: mu,
        "MooneyRivlin": lambda c1, c2: 2 * (c1 + c2 / s),
        "Yeoh": lambda c1, c2, c3: 2 * (c1 + 2 * c2 * i1 + 3 * c3 * i1**2),
        "Gent": lambda mu, j_m: mu / (1 - i1 / j_m),
    }[name](*x)


FEW = 4
"""Starts: enough to come upon the floor of a valley, and a quarter of what a run takes."""


@pytest.mark.parametrize("kind", ["slack", "toe"])
@pytest.mark.parametrize("name", CANDIDATES)
def test_every_material_is_fitted_to_a_soft_and_noisy_test(name, kind):
    """To within a hundredth of what SciPy finds from the same place and from where our fit ended."""
    data = soft(kind)
    assert data.y.min() < 0
    tried = candidate(name, data.x, data.y)
    fit = calibrate(Fitting({STRIP: Tension(tried.start)}, tried.variables, [data]), FEW, canonical=tried.canonical)
    assert np.all(np.isfinite(fit.x))
    np.testing.assert_allclose(closed_form(name, fit.x, data.x) - data.y, fit.errors, atol=1e-6 * data.size)
    space = fit.fitting.space
    unit = np.where(space.is_log, 1.0, space.high - space.low)

    def constants(z):
        return np.where(space.is_log, np.exp(z), z * unit)

    def misfit(z):
        return (closed_form(name, constants(z), data.x) - data.y) / data.size

    ends = []
    for x in (space.reference, fit.x):
        start, low, high = (
            np.where(space.is_log, np.log(np.maximum(v, 1e-300)), v / unit) for v in (x, space.low, space.high)
        )
        inside = np.clip(start, low + 1e-9, high - 1e-9)
        ends.append(2 * optimize.least_squares(misfit, inside, bounds=(low, high)).cost)
    best = data.size * np.sqrt(min(ends) / len(data.x))
    assert fit.rmse(0) <= 1.01 * best


def test_starts_none_of_which_has_settled_are_compared():
    """Two terms do not describe a test better than one: all starts end on the floor of a valley, and none settles."""
    tried = candidate("Ogden2", STRAIN, RISE)
    fitting = Fitting({STRIP: Tension(tried.start)}, tried.variables, [curve(RISE * 1e4)])

    def ended(*x, cost=(1.0, 1.0), verified=False):
        x = np.array(x)
        return Fitted(x, x, np.array(cost), None, np.array([200, 200]), np.array([verified, verified]))

    first = [2e3, 1e3, 1.9, 3.0]
    for verified in (False, True):
        (note,) = _other_minima(fitting, ended(first, [1e3, 2e3, 1.9, 3.0], verified=verified), 0, tried.canonical)
        assert "equally good at different parameters" in note
        # The two terms of a sum may stand in either order, and a worse fit says nothing.
        swapped = [first[1], first[0], first[3], first[2]]
        assert _other_minima(fitting, ended(first, swapped, verified=verified), 0, tried.canonical) == []
        assert _other_minima(fitting, ended(first, [1e3] * 4, cost=(1.0, 1.1)), 0, tried.canonical) == []
    assert _other_minima(fitting, ended(first, first, cost=(np.nan, np.nan)), 0, tried.canonical) == []


def test_what_is_no_material_is_left_out():
    """A specimen that hangs loose gives the Mooney-Rivlin material a negative stiffness at rest, and a window no mu."""
    data = soft("toe")
    found = compare(data, ["NeoHookean", "MooneyRivlin"], 1.5, [0.25, 0.5, 1.5])
    assert [one.name for one in found.judged] == ["NeoHookean"]
    told = verdicts(found)
    shape = (1 + data.x) - (1 + data.x) ** -2
    matrix = np.stack([2 * shape, 2 * shape / (1 + data.x)], axis=1)
    modulus = 2 * np.sum(np.linalg.lstsq(matrix, data.y, rcond=None)[0])
    assert modulus < 0
    assert any(
        f"MooneyRivlin is left out: its best fit has a shear modulus of {modulus / kPa:.3g} kPa" in s for s in told
    )
    # Least squares in closed form: mu is negative in the windows without one.
    signs = {w: shape[data.x <= w] @ data.y[data.x <= w] > 0 for w in (0.25, 0.5, 1.5)}
    assert signs == {0.25: False, 0.5: False, 1.5: True}
    assert [window.strain for window in found.windows] == [1.5]
    assert any("no neo-Hookean mu up to 25 % and 50 % strain" in sentence for sentence in told)
    with pytest.raises(InputError, match="No material describes this test"):
        compare(data, ["MooneyRivlin"], 1.5, [1.5])


def test_a_strong_correlation_is_said_in_place_of_a_verdict():
    """C1 and C2 of one tension test: their correlation is that of the linear model's normal equations."""
    stress = 2 * (4e4 + 1e4 / STRETCH) * RISE * (1 + 0.01 * np.random.default_rng(1).normal(size=40))
    tried = candidate("MooneyRivlin", STRAIN, stress)
    fit = calibrate(Fitting({STRIP: Tension(tried.start)}, tried.variables, [curve(stress)]), 1)
    inverse = np.linalg.inv(np.stack([2 * RISE, 2 * RISE / STRETCH]) @ np.stack([2 * RISE, 2 * RISE / STRETCH]).T)
    correlation = inverse[0, 1] / np.sqrt(inverse[0, 0] * inverse[1, 1])
    assert correlation < -0.95
    remarks = examine(fit, ["gauss_newton"], 100, 0).remarks
    assert any(f"strongly correlated ({correlation:+.3f})" in sentence for sentence in remarks)
    assert not any("determine every parameter" in sentence for sentence in remarks)
    few = Fitting(
        {STRIP: Tension(sg.NeoHookean(mu=1e5))}, candidate("NeoHookean", STRAIN, stress).variables, [curve(stress)]
    )
    assert "The data determine the parameter." in examine(calibrate(few, 1), ["gauss_newton"], 100, 0).remarks


CONFIG = """
[tension]
file = "test.csv"
strain = { column = "strain", unit = "1" }
stress = { column = "stress", unit = "Pa" }
materials = ["NeoHookean", "Gent"]
"""


def written(folder, more=""):
    rows = [f"{e:.6g},{1e5 * rise / (1 - i1 / 9):.6g}" for e, rise, i1 in zip(STRAIN, RISE, I1, strict=True)]
    (folder / "test.csv").write_text("\n".join(["strain,stress", *rows]))
    (folder / "fit.toml").write_text(CONFIG + more)
    return folder / "fit.toml"


def test_windows_that_the_data_do_not_reach_are_said(tmp_path):
    """The test has 40 points from 2 to 150 %: two of them up to 6 %."""
    table, data = read(written(tmp_path, "window_percent = 200\ncompare_percent = [6, 50, 300]\n"))
    window, few, beyond = beyond_the_data(table, data)
    assert window.startswith("window_percent is 200, but the test ends at 150 %")
    assert few == "There is no neo-Hookean mu up to 6 % strain: fewer than 3 points are there."
    assert beyond == "There is no neo-Hookean mu up to 300 % strain: the test ends at 150 %."
    for more in ("", "window_percent = 150\ncompare_percent = [50, 150]\n"):
        assert beyond_the_data(*read(written(tmp_path, more))) == []


def test_stopped_in_the_scores_it_keeps_the_fits(tmp_path, monkeypatch, capsys):
    def stop(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr("optim.tension.run.extra", lambda: None)
    monkeypatch.setattr("optim.tension.run._scored", stop)
    config, out = written(tmp_path, "window_percent = 200\nposterior = true\n"), tmp_path / "out"
    assert run(["calibrate", str(config), "--out", str(out)]) == STOPPED
    assert "Stopped after the fit" in capsys.readouterr().out
    result = json.loads((out / "result.json").read_text())
    assert result["chosen"] == "Gent"
    assert "evidence" not in result
    assert any("the test ends at 150 %" in sentence for sentence in result["remarks"])
    assert {"material.toml", "materials.csv", "fit.png", "report.html"} <= {path.name for path in out.iterdir()}


def test_a_seed_that_no_generator_takes_is_one_sentence(tmp_path, capsys):
    config = written(tmp_path, "seed = 99999999999999999999\n")
    assert run(["calibrate", str(config), "--out", str(tmp_path / "out")]) == MISTAKE
    assert "seed is 99999999999999999999; it should be less than" in capsys.readouterr().err.replace("\n", " ")


MEASURED = os.environ.get("SOFTGRIP_MEASURED", "")


@pytest.mark.skipif(not MEASURED, reason="SOFTGRIP_MEASURED names no folder with measured tension tests")
@pytest.mark.parametrize("name", ["dragon_skin_20", "dragon_skin_30", "ecoflex_00-30"])
def test_mu_of_measured_silicones_depends_on_the_window(name):
    """Soft Robotics Materials Database (Marechal et al. 2020): mu from 25 % to all strains changes by more than 1.9."""
    path = Path(MEASURED) / f"{name}.csv"
    if not path.is_file():
        pytest.skip(f"there is no {path.name}")
    columns = [Column("Engineering Strain", "number", "1"), Column("Engineering Stress (MPa)", "pressure", "MPa")]
    data, _ = read_columns(path, columns)
    windows = neo_hookean_windows(curve(data[:, 1], data[:, 0]), [0.25, 1.0, 2.0, float(data[:, 0].max())])
    mu = [window.mu for window in windows]
    assert mu == sorted(mu)
    assert mu[-1] / mu[0] > 1.9
    assert 5 * kPa < mu[0] < 300 * kPa
