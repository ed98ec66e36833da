"""Tension tests: stresses by hand, the choice of a material, where one softens, and silicones where data are there."""

import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

import softgrip_jax as sg
from optim.curve_files import Column, Curve, read_columns
from optim.tension import Tension, softening
from optim.tension_run import compare, neo_hookean_windows, verdicts
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


def test_akaike_is_its_formula(compared):
    for one in compared.judged:
        square = np.sum((one.rmse**2) * 40)
        k = one.fit.fitting.space.size + 1
        expected = 40 * np.log(square / 40) + 2 * k + 2 * k * (k + 1) / (40 - k - 1)
        assert one.akaike == pytest.approx(expected, rel=1e-9)


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
