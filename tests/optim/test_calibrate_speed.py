"""How fast a fit is, against lmfit with finite differences on the same model, in one run."""

import time

import jax
import numpy as np
import pytest

import softgrip_jax as sg
from optim.calibration.data import Curve
from optim.calibration.fit import calibrate
from optim.calibration.intervals import bootstrap_fits
from optim.calibration.model import Fitting
from optim.space import Variable, to_free
from softgrip_jax.units import kPa, mm


def seconds(work, repeats):
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


@pytest.mark.slow
def test_a_fit_is_fast(capsys):
    """One curve of 20 points, mu and the distance of a plane: under 2 s; 1,000 bootstrap fits: under 20 s."""
    lmfit = pytest.importorskip("lmfit")
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    scene = sg.shell.FlatContact(shell, distance=5 * mm)
    x = np.linspace(4, 18, 20) * kPa
    y = np.asarray(sg.path(scene, x).force) + 0.2 * np.random.default_rng(0).normal(size=20)
    variables = [
        Variable("shell.material.mu", 20 * kPa, 2000 * kPa, "log"),
        Variable("distance", 2 * mm, 10 * mm),
    ]
    problem = Fitting({"contact": scene}, variables, [Curve("contact", "contact", "force", "force", x, y)])
    begin = time.perf_counter()
    fit = calibrate(problem)
    compiling = time.perf_counter() - begin
    whole = seconds(lambda: calibrate(problem), 5)
    member = problem.member(to_free(problem.space.to_unit([140 * kPa, 4 * mm])))
    one = seconds(lambda: jax.block_until_ready(problem.fit_member_jit(member)), 20)
    thousand = seconds(lambda: bootstrap_fits(fit, 1000, 0), 1)

    @jax.jit
    def model(values):
        return problem.predict(values, problem.points()).values

    def residuals(p):
        return (np.asarray(model(np.array([p["mu"].value, p["distance"].value * mm]) * [kPa, 1])) - y) / 0.2

    start = lmfit.Parameters()
    start.add("mu", value=140.0, min=100, max=2000)
    start.add("distance", value=4.0, min=2, max=10)
    theirs = lmfit.minimize(residuals, start)
    lmfits = seconds(lambda: lmfit.minimize(residuals, start), 10)
    with capsys.disabled():
        print(
            f"\nfirst call {compiling:.1f} s; then calibrate {whole * 1e3:.0f} ms (8 starts, noise), one fit "
            f"{one * 1e3:.2f} ms, 1000 bootstrap fits {thousand:.2f} s; lmfit {lmfits * 1e3:.1f} ms "
            f"({lmfits / one:.0f} times one fit)"
        )
    np.testing.assert_allclose(
        fit.x, [theirs.params["mu"].value * kPa, theirs.params["distance"].value * mm], rtol=1e-5
    )
    assert whole < 2
    assert thousand < 20
    assert one < lmfits
