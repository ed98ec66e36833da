"""Calibration against SciPy, lmfit, closed forms and known truth; nothing here is compared with a stored output."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from scipy import optimize, stats

import softgrip_jax as sg
from optim.calibration.cross_validation import by_specimen, held_out
from optim.calibration.data import Curve
from optim.calibration.drives import misses
from optim.calibration.fit import calibrate, finished, implausible
from optim.calibration.identifiability import _finger_scenes, _shell_scenes, candidates, unknown_directions
from optim.calibration.intervals import bootstrap_fits, intervals
from optim.calibration.model import CAUCHY, HUBER, SOFT_L1, Fitting
from optim.calibration.report import Findings, examine, is_determined, misfit, over_specimens, spread_of_specimens
from optim.calibration.run import _lines
from optim.calibration.systematic import offset
from optim.space import Variable, to_free
from optim.tension.test import Tension
from softgrip_jax.errors import InputError
from softgrip_jax.results import Status
from softgrip_jax.units import kPa, mm

A, B, T = 16 * mm, 43 * mm, 1.1 * mm
MU = Variable("shell.material.mu", 20 * kPa, 2000 * kPa, "log")
THICKNESS = Variable("shell.t_m", 0.3 * mm, 5 * mm, "log")


def shell(mu=175 * kPa, t_m=T):
    return sg.FlatShell(a=A, b=B, t_m=t_m, material=sg.NeoHookean(mu=mu))


def inflation(mu, pressure):
    """Free inflation by SciPy from the thesis's equations."""
    design = {"a": A, "b": B, "t_m": T, "material": {"kind": reference.NEO, "mu": mu}}
    angles = [optimize.brentq(lambda th, p=p: reference.free(th, design)[0] - p, 1e-6, 1.5) for p in pressure]
    return A * np.tan(0.5 * np.array(angles))


PRESSURES = np.linspace(1, 14, 20) * kPa


def free_curve(y, noise=None, x=PRESSURES, **more):
    return Curve("free", "free", "inflation", "length", np.asarray(x), np.asarray(y), noise=noise, **more)


@pytest.fixture(scope="module")
def noisy():
    return inflation(175 * kPa, PRESSURES) + 0.1 * mm * np.random.default_rng(3).normal(size=20)


@pytest.fixture(scope="module")
def fitting(noisy):
    return Fitting({"free": sg.shell.Free(shell(120 * kPa))}, [MU], [free_curve(noisy)])


@pytest.fixture(scope="module")
def fit(fitting):
    return calibrate(fitting)


def test_the_fit_is_lmfits(fit, noisy):
    """lmfit with finite differences on SciPy's solution of the same equations: value to 1e-6, error to 1e-3."""
    lmfit = pytest.importorskip("lmfit")
    start = lmfit.Parameters()
    start.add("mu", value=200.0, min=130, max=2000)
    found = lmfit.minimize(
        lambda p: (inflation(p["mu"].value * kPa, PRESSURES) - noisy) / mm, start, xtol=1e-12, ftol=1e-12
    )
    assert fit.x[0] == pytest.approx(found.params["mu"].value * kPa, rel=1e-6)
    assert fit.deviation[0] * fit.x[0] == pytest.approx(found.params["mu"].stderr * kPa, rel=1e-3)
    assert float(fit.member.sigma[0]) == pytest.approx(np.sqrt(found.redchi) * mm, rel=1e-3)


@pytest.mark.slow
def test_intervals_cover_the_truth():
    """500 experiments on a plane at an unknown distance, in one vmap: 95 % of the intervals hold the truth."""
    truth = np.array([175 * kPa, 5 * mm])
    pressure = np.linspace(4, 18, 20) * kPa
    scene = sg.shell.FlatContact(shell(), distance=truth[1])
    force = np.asarray(sg.path(scene, pressure).force)
    curve = Curve("contact", "contact", "force", "force", pressure, force)
    problem = Fitting({"contact": scene}, [MU, Variable("distance", 2 * mm, 10 * mm)], [curve])
    start = to_free(problem.space.to_unit([140 * kPa, 4 * mm]))
    member = problem.member(start)

    def experiment(y):
        end = problem.fit_member(member._replace(y=y))
        scales = problem.scales(end.x)
        first = problem.statistics(end.predicted, member._replace(y=y), scales)
        final = problem.statistics(end.predicted, member._replace(y=y, sigma=first.sigma), scales)
        return end.x, end.converged, jnp.sqrt(jnp.diagonal(final.covariance))

    y = force + 0.2 * np.random.default_rng(11).normal(size=(500, 20))
    x, converged, deviation = map(np.asarray, jax.jit(jax.vmap(experiment))(jnp.asarray(y)))
    assert converged.all()
    change = np.stack([np.log(truth[0] / x[:, 0]), (truth[1] - x[:, 1]) / (8 * mm)], axis=1)
    inside = np.abs(change) <= stats.t.ppf(0.975, 18) * deviation
    # 99.9 % of binomial counts of 500 at 0.95 lie between these.
    low, high = stats.binom.ppf([0.0005, 0.9995], 500, 0.95)
    assert np.all((inside.sum(axis=0) >= low) & (inside.sum(axis=0) <= high)), inside.mean(axis=0)


def test_a_start_from_which_most_points_have_no_equilibrium_comes_back(fitting, fit):
    """At mu = 25 kPa the membrane ends at 3 kPa: three quarters of the points have no answer on the way."""
    assert float(sg.limit_pressure(sg.shell.Free(shell(25 * kPa)))) < 3 * kPa
    end = fitting.fit_member_jit(fitting.member(to_free(fitting.space.to_unit([25 * kPa]))))
    assert bool(end.converged)
    assert float(end.x[0]) == pytest.approx(fit.x[0], rel=1e-7)


def test_an_outlier_does_not_have_the_points_beyond_it_left_out():
    """The model met 50 mm next to its limit point, at half of mu, and lost the three good points above."""
    x = np.array([3.0, 5, 7, 9, 10, 13, 15]) * kPa
    y = np.array([5.5, 7.9, 9.5, 50.0, 11.5, 13.8, 15.7]) * mm
    scenes, good = {"free": sg.shell.Free(shell(200 * kPa))}, np.arange(7) != 3
    found = calibrate(Fitting(scenes, [MU], [free_curve(y, x=x)]))
    without = calibrate(Fitting(scenes, [MU], [free_curve(y[good], x=x[good])]))
    np.testing.assert_allclose(
        [found.x[0], found.low[0], found.high[0]], [without.x[0], without.low[0], without.high[0]], rtol=1e-4
    )
    assert int(found.member.weight.sum()) == 6
    assert found.notes == (
        "free: left out 50 mm at 9 kPa: with that the model ends below 3 of the other points; is it an outlier?",
    )


def test_a_profile_has_its_ends_where_few_points_make_it_wide():
    """With one point more than parameters the quantile is 12.7 standard deviations, where nobody had looked."""
    x = np.array([3.0, 8, 14]) * kPa
    y = inflation(175 * kPa, x) + 0.01 * mm * np.array([1, -1, 1])
    half_width = Variable("shell.a", 10 * mm, 22 * mm)
    found = calibrate(Fitting({"free": sg.shell.Free(shell(170 * kPa))}, [MU, half_width], [free_curve(y, x=x)]))
    assert np.all(found.quantile > 12)
    ends = intervals(found, "profile")
    assert ends.notes == ()
    np.testing.assert_allclose(ends.low, found.low, rtol=0.02)
    np.testing.assert_allclose(ends.high, found.high, rtol=0.02)
    # Where it crosses: the cost of the best fit with that number held, by SciPy.
    for k, (end, low, high) in enumerate(((ends.high[0], 15 * mm, 17.5 * mm), (ends.high[1], 155 * kPa, 250 * kPa))):

        def cost(other, k=k, end=end):
            mu, a = (end, other) if k == 0 else (other, end)
            design = {"a": a, "b": B, "t_m": T, "material": {"kind": reference.NEO, "mu": mu}}
            tried = np.linspace(0.1, 1.5, 200)
            top = tried[np.argmax([reference.free(th, design)[0] for th in tried])]
            angles = [optimize.brentq(lambda th, p=p: reference.free(th, design)[0] - p, 1e-6, top) for p in x]
            return np.sum((a * np.tan(0.5 * np.array(angles)) - y) ** 2)

        held = optimize.minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-9}).fun
        best = np.sum((np.asarray(found.predicted.response.values) - y) ** 2)
        # sigma^2 is estimated by the best fit with one degree of freedom, best / 1.
        assert np.sqrt((held - best) / best) == pytest.approx(found.quantile[k], rel=0.02)


@pytest.mark.parametrize("method", ["gauss_newton", "profile", "bootstrap"])
def test_a_noise_is_known_as_well_as_its_own_curve_tells_it(method):
    """Two curves without a parameter in common are two fits: what 30 points tell of the noise of one says nothing of
    the noise of the other, which has 4. The interval of that held the truth in 86 % of all cases."""

    def curve(name, count, seed):
        strain = np.linspace(0.2, 1.0, count)
        noise = 2 * kPa * np.random.default_rng(seed).normal(size=count)
        return Curve(name, name, "stress", "pressure", strain, 100 * kPa * (1 + strain - (1 + strain) ** -2) + noise)

    names, curves = ("few", "many"), [curve("few", 4, 1), curve("many", 30, 2)]
    strips = {name: Tension(sg.NeoHookean(mu=150 * kPa)) for name in names}
    moduli = [Variable(f"{name}.material.mu", 10 * kPa, 1000 * kPa, "log") for name in names]
    both = calibrate(Fitting(strips, moduli, curves), starts=1)
    np.testing.assert_allclose(both.quantile, stats.t.ppf(0.975, [3, 29]), rtol=1e-6)
    ends = intervals(both, method, repeats=400)
    for k, name in enumerate(names):
        own = Variable("material.mu", 10 * kPa, 1000 * kPa, "log")
        alone = intervals(calibrate(Fitting({name: strips[name]}, [own], [curves[k]]), starts=1), method, repeats=400)
        rough = 0.1 if method == "bootstrap" else 1e-4  # draws differ, and how far 4 points scatter is all points' mean
        width = alone.high[0] - alone.low[0]
        np.testing.assert_allclose([ends.low[k], ends.high[k]], [alone.low[0], alone.high[0]], atol=rough * width)
    stated = [curves[0], dataclasses.replace(curves[1], noise=2 * kPa)]
    known = calibrate(Fitting(strips, moduli, stated), starts=1)
    np.testing.assert_allclose(known.quantile, [stats.t.ppf(0.975, 3), stats.norm.ppf(0.975)], rtol=1e-6)


@pytest.mark.parametrize("method", ["gauss_newton", "profile", "bootstrap"])
def test_curves_that_share_a_parameter_are_weighted_by_noises_that_err(method):
    """The mean of two sets with weights w of their estimated variances varies by 1 + sum 4 w (1 - w) / f times what
    true weights give (Meier 1953, Biometrics 9); intervals of two curves of four points held the truth in 87 % of all
    cases, those of five of three in 73 %, and now in 91 and 83 %."""
    strain, rng = np.linspace(0.2, 1.0, 4), np.random.default_rng(3)
    clean = 100 * kPa * (1 + strain - (1 + strain) ** -2)
    curves = [
        Curve(f"c{k}", "test", "stress", "pressure", strain, clean + noise * kPa * rng.normal(size=4))
        for k, noise in enumerate((1.0, 2.0))
    ]
    models, moduli = {"test": Tension(sg.NeoHookean(mu=150 * kPa))}, [Variable("material.mu", 1e4, 1e6, "log")]
    found = calibrate(Fitting(models, moduli, curves), starts=1)
    sigma = np.asarray(found.member.sigma)
    told = np.sum((found.x[0] * clean / (100 * kPa)) ** 2) / sigma**2  # stress is linear in mu
    w = told / told.sum()
    assert 0.1 < w[0] < 0.9
    wider = 1 + np.sum(4 * w * (1 - w) / (4 - w))
    deviation = np.sqrt(wider / told.sum())
    assert found.deviation[0] == pytest.approx(deviation, rel=1e-6)
    freedom = 1 / np.sum(w**2 / (4 - w))
    ends = intervals(found, method, repeats=400)
    if method == "profile":  # straight in mu, and the change of log mu is asked for
        change = np.array([ends.low[0], ends.high[0]]) / found.x[0] - 1
    else:
        change = np.log([ends.low[0], ends.high[0]] / found.x[0])
    half = stats.t.ppf(0.975, freedom) * deviation
    if method == "bootstrap":  # of so few points it leans to one side
        assert np.ptp(change) == pytest.approx(2 * half, rel=0.1)
    else:
        np.testing.assert_allclose(change, [-half, half], rtol=1e-3)
    stated = [dataclasses.replace(c, noise=float(s)) for c, s in zip(curves, sigma, strict=True)]
    known = calibrate(Fitting(models, moduli, stated), starts=1)
    assert known.deviation[0] == pytest.approx(1 / np.sqrt(told.sum()), rel=1e-4)


def test_points_beyond_the_limit_are_left_out_and_said():
    """Softer data than the model: inflations of mu = 175 kPa measured up to pressures where that has no equilibrium."""
    mu = 175 * kPa
    limit = float(sg.limit_pressure(sg.shell.Free(shell(mu))))
    x = np.append(PRESSURES, [1.05 * limit, 1.1 * limit])
    y = np.append(inflation(mu, PRESSURES), [25 * mm, 30 * mm])
    found = calibrate(Fitting({"free": sg.shell.Free(shell(mu))}, [MU], [free_curve(y, x=x)]), starts=1)
    assert found.x[0] == pytest.approx(mu, rel=1e-6)
    assert [bool(used) for used in found.used] == [True] * 20 + [False] * 2
    assert "2 of 22 points" in found.notes[0]
    assert "limit point" in found.notes[0]


@pytest.mark.parametrize(("part", "held"), [(0.9995, True), (0.99, False)])
def test_a_point_where_the_model_ends_holds_the_fit_and_that_is_said(part, held):
    """A fit of the thesis's finger to data of the cell law sat there, with a hundredth of its modulus as interval; a
    better one was on the other side."""
    mu, scene = 175 * kPa, sg.shell.Free(shell(175 * kPa))
    x = np.array([5 * kPa, 10 * kPa, 15 * kPa, part * float(sg.limit_pressure(scene))])
    y = np.asarray(sg.path(scene, x).inflation)
    found = calibrate(Fitting({"free": scene}, [MU], [free_curve(y, x=x)]), starts=1)
    assert found.x[0] == pytest.approx(mu, rel=1e-5)
    remarks = examine(found, ["gauss_newton"], 0, 0).remarks
    said = [remark.startswith("free: the model of the fit ends just above 20.1") for remark in remarks]
    assert sum(said) == held
    assert any(remark.startswith("The data determine") for remark in remarks) != held


@pytest.mark.parametrize(
    ("ours", "scipys", "scale"),
    [("huber", "huber", HUBER), ("soft_l1", "soft_l1", SOFT_L1), ("cauchy", "cauchy", CAUCHY)],
)
def test_robust_losses_are_scipys(ours, scipys, scale):
    """Mooney-Rivlin in tension, stress = 2 (C1 + C2 / lambda) (lambda - lambda^-2), with two outliers."""
    strain = np.linspace(0.05, 1.5, 25)
    stretch = 1 + strain

    def stress(c1, c2):
        return 2 * (c1 + c2 / stretch) * (stretch - stretch**-2)

    y = stress(40e3, 15e3) + 1e3 * np.random.default_rng(5).normal(size=25)
    y[[7, 20]] += 60e3
    curve = Curve("test", "test", "stress", "pressure", strain, y, noise=1e3)
    variables = [Variable("material.c1", 1e3, 1e6, "log"), Variable("material.c2", -1e5, 1e5)]
    problem = Fitting({"test": Tension(sg.MooneyRivlin(c1=30e3, c2=0.0))}, variables, [curve], loss=ours)
    found = calibrate(problem)
    theirs = optimize.least_squares(
        lambda c: (stress(*(c * 1e4)) - y) / 1e3,
        [3.0, 0.0],
        loss=scipys,
        f_scale=scale,
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
    )
    np.testing.assert_allclose(found.x, theirs.x * 1e4, rtol=2e-5)
    assert found.cost == pytest.approx(theirs.cost, rel=1e-8)
    if ours == "huber":
        plain = calibrate(Fitting(problem.space.scenes, variables, [curve]))
        truth = np.array([40e3, 15e3])
        assert np.all(np.abs(found.x - truth) < np.abs(plain.x - truth))


def test_intervals_of_a_robust_loss_cover_the_truth():
    """600 tension tests of 20 points: 95 % of the intervals of three constants hold the truth."""
    strain = np.linspace(0.05, 2, 20)
    truth = np.array([60e3, 4e3, 100.0])
    stress = np.asarray(jax.vmap(Tension(sg.Yeoh(*truth)).stress)(strain))
    y = stress + 2e3 * np.random.default_rng(3).normal(size=(600, 20))
    variables = [Variable(f"material.c{k}", -most, most) for k, most in ((1, 3e5), (2, 1e5), (3, 2e4))]
    curve = Curve("test", "test", "stress", "pressure", strain, stress)
    problem = Fitting({"test": Tension(sg.Yeoh(c1=50e3))}, variables, [curve], loss="huber")
    start = problem.member(to_free(problem.space.to_unit(truth)))

    def experiment(y):
        def again(member, _):
            end = problem.fit_member(member)
            found = problem.statistics(end.predicted, member, problem.scales(end.x))
            return member._replace(start=end.u, sigma=found.sigma), (end.x, found.covariance)

        _, (x, covariance) = jax.lax.scan(again, start._replace(y=y), length=10)
        return x[-1], jnp.sqrt(jnp.diagonal(covariance[-1]))

    x, deviation = map(np.asarray, jax.jit(jax.vmap(experiment))(jnp.asarray(y)))
    inside = np.abs(x - truth) <= stats.t.ppf(0.975, 17) * deviation * np.asarray(problem.scales(truth))
    assert 0.93 < inside.mean() < 0.97, inside.mean(axis=0)


def test_what_a_bound_holds_is_no_offset():
    """All errors are those of a modulus that may not reach its 100 kPa: no sensor was off its zero."""
    strain = np.linspace(0.1, 1.0, 9)
    y = 100e3 * (1 + strain - (1 + strain) ** -2) + 1e3 * np.random.default_rng(0).normal(size=9)
    curve = Curve("test", "test", "stress", "pressure", strain, y)
    held = [Variable("material.mu", 10e3, 90e3, "log")]
    found = calibrate(Fitting({"test": Tension(sg.NeoHookean(mu=50e3))}, held, [curve]), starts=1)
    assert found.on_bound.all()
    assert offset(found, 0) is None


def test_curves_that_share_parameters_are_not_said_to_be_missed():
    """Three curves of five points determine three constants together: each has four degrees of freedom, not two, and
    errors whose squares add up to 11 times that of the noise are nothing unlikely."""
    strain = np.linspace(0.2, 2, 5)
    rise, i1 = 1 + strain - (1 + strain) ** -2, (1 + strain) ** 2 + 2 / (1 + strain) - 3
    columns = 2 * rise[:, None] * np.stack([np.ones_like(i1), 2 * i1, 3 * i1**2], axis=1)
    unmet = np.linalg.svd(columns)[0][:, 3]
    assert stats.chi2.sf(11, 2) < 0.01 < stats.chi2.sf(11, 4)
    variables = [Variable(f"material.c{k}", -most, most) for k, most in ((1, 3e5), (2, 1e5), (3, 2e4))]
    models, y, noise = {"test": Tension(sg.Yeoh(c1=50e3))}, columns @ [60e3, 4e3, 100.0], 2e3

    def said(square):
        errors = [np.sqrt(square) * noise * unmet, 0.0, 1e-6 * noise]
        curves = [
            Curve(name, "test", "stress", "pressure", strain, y + e, noise=noise)
            for name, e in zip("abc", errors, strict=True)
        ]
        return misfit(calibrate(Fitting(models, variables, curves), starts=1))

    assert said(11) == []
    assert "times the stated noise" in said(20)[0]


@pytest.mark.parametrize("method", ["gauss_newton", "profile"])
def test_a_robust_interval_knows_the_scatter_from_its_few_errors(method):
    """Errors far below Huber's bound count in full, and those of five points tell how far they scatter: the interval is
    that of least squares with an unknown noise, whatever noise is stated."""
    strain = np.linspace(0.1, 1.0, 5)
    rise = 1 + strain - (1 + strain) ** -2
    y = 100e3 * rise + 1e3 * np.array([1.0, -0.6, 0.2, 0.9, -0.7])
    curve = Curve("test", "test", "stress", "pressure", strain, y, noise=10e3)
    variables = [Variable("material.mu", 10e3, 1e6)]
    found = calibrate(Fitting({"test": Tension(sg.NeoHookean(mu=80e3))}, variables, [curve], loss="huber"), starts=1)
    mu = rise @ y / (rise @ rise)
    half = stats.t.ppf(0.975, 4) * np.sqrt(np.sum((y - mu * rise) ** 2) / 4 / (rise @ rise))
    ends = intervals(found, method)
    np.testing.assert_allclose([ends.low[0], ends.high[0]], [mu - half, mu + half], rtol=1e-5)


def test_a_linear_model_has_the_textbook_covariance_profile_and_bootstrap():
    """Yeoh in tension is linear in its constants: covariance s^2 (A^T A)^-1, and the profile is the same interval."""
    strain = np.linspace(0.05, 2, 40)
    stretch = 1 + strain
    rise, i1 = stretch - stretch**-2, stretch**2 + 2 / stretch - 3
    columns = 2 * rise[:, None] * np.stack([np.ones_like(i1), 2 * i1, 3 * i1**2], axis=1)
    y = columns @ [60e3, 4e3, 100.0] + 2e3 * np.random.default_rng(8).normal(size=40)
    curve = Curve("test", "test", "stress", "pressure", strain, y)
    variables = [
        Variable("material.c1", 1e3, 2e5),
        Variable("material.c2", -5e4, 5e4),
        Variable("material.c3", -1e4, 1e4),
    ]
    found = calibrate(Fitting({"test": Tension(sg.Yeoh(c1=50e3))}, variables, [curve]))
    expected, square, _, _ = np.linalg.lstsq(columns, y)
    sd = np.sqrt(np.diag(square[0] / 37 * np.linalg.inv(columns.T @ columns)))
    np.testing.assert_allclose(found.x, expected, rtol=1e-6)
    np.testing.assert_allclose(found.high - found.x, stats.t.ppf(0.975, 37) * sd, rtol=1e-5)
    profile = intervals(found, "profile")
    np.testing.assert_allclose(profile.low, found.low, rtol=1e-3, atol=1e-3 * np.abs(found.high - found.low).min())
    np.testing.assert_allclose(profile.high, found.high, rtol=1e-3, atol=1e-3 * np.abs(found.high - found.low).min())
    # Draws with replacement estimate the covariance that allows for unequal noise (White 1980), by its own closed form.
    bread = np.linalg.inv(columns.T @ columns)
    errors = y - columns @ expected
    white = np.sqrt(np.diag(bread @ (columns.T * errors**2) @ columns @ bread))
    draws = bootstrap_fits(found, 400, seed=1)
    np.testing.assert_allclose(np.nanstd(draws, axis=0), white, rtol=0.25)


def test_a_bootstrap_of_few_points_is_as_wide_as_student_has_it():
    """Of eight points with normal noise the exact interval is the linear one; plain percentiles had 0.74 of it."""
    strain = np.linspace(0.1, 1.0, 8)
    rise = 1 + strain - (1 + strain) ** -2
    widths = []
    for seed in range(8):
        stress = 170e3 * rise + 3e3 * np.random.default_rng(seed).normal(size=8)
        strip = {"test": Tension(sg.NeoHookean(mu=150 * kPa))}
        curve = Curve("test", "test", "stress", "pressure", strain, stress)
        found = calibrate(Fitting(strip, [Variable("material.mu", 10e3, 1e6, "log")], [curve]), starts=1)
        ends = intervals(found, "bootstrap", 300, seed)
        widths.append(float((ends.high[0] - ends.low[0]) / (found.high[0] - found.low[0])))
    assert 0.88 < np.mean(widths) < 1.12


@pytest.mark.parametrize(("counts", "noises"), [((4,), (0.5e3,)), ((4, 30), (0.5e3, None)), ((4, 30), (None, None))])
def test_a_bootstrap_knows_the_noise_from_the_points_that_it_draws(counts, noises):
    """A few precise points tell mu: drawn points scatter less than they do, whatever noise is stated and however many
    points another curve has. Student's t with the freedom of the few is exact; intervals were half as wide."""
    widths = []
    for seed in range(6):
        rng, curves = np.random.default_rng(seed), []
        for k, (count, noise) in enumerate(zip(counts, noises, strict=True)):
            strain = np.linspace(0.3, 1.0, count)
            rise = 1 + strain - (1 + strain) ** -2
            stress = 100e3 * rise + (0.5e3, 60e3)[k] * rng.normal(size=count)
            if k == 0:
                mu = rise @ stress / (rise @ rise)
                sd = np.sqrt(np.sum((stress - mu * rise) ** 2) / (count - 1) / (rise @ rise))
            curves.append(Curve(f"c{k}", "test", "stress", "pressure", strain, stress, noise=noise))
        strip = {"test": Tension(sg.NeoHookean(mu=150 * kPa))}
        found = calibrate(Fitting(strip, [Variable("material.mu", 10e3, 1e6)], curves), starts=1)
        ends = intervals(found, "bootstrap", 200, seed)
        widths.append(float(ends.high[0] - ends.low[0]) / (2 * stats.t.ppf(0.975, counts[0] - 1) * sd))
    assert 0.75 < np.mean(widths) < 1.25, widths


def test_a_bootstrap_of_single_points_has_no_interval():
    """Each drawn set is the measured one: the interval was of no width at all."""
    curves = [
        Curve(f"c{k}", "test", "stress", "pressure", np.array([0.6]), np.array([120e3 + 5e3 * k]), noise=3e3)
        for k in range(2)
    ]
    strip = {"test": Tension(sg.NeoHookean(mu=150 * kPa))}
    found = calibrate(Fitting(strip, [Variable("material.mu", 10e3, 1e6, "log")], curves), starts=1)
    ends = intervals(found, "bootstrap", 100)
    assert np.isnan([ends.low, ends.high]).all()
    assert "two points to draw from" in ends.notes[0]


@pytest.mark.slow
def test_a_product_is_named_and_a_tension_test_parts_it(noisy):
    """The free membrane knows only mu t_m: p = mu t_m / a f(angle). Tension knows mu alone."""
    scene = sg.shell.Free(shell(150 * kPa))
    found = calibrate(Fitting({"free": scene}, [MU, THICKNESS], [free_curve(noisy)]), starts=2)
    (direction,) = unknown_directions(found)
    assert direction.combination == "the product shell.material.mu * shell.t_m"
    np.testing.assert_allclose(direction.change[0] * direction.change[1], -1, atol=1e-6)
    assert any("tension test" in words for words in direction.remedies)
    # Contact is by the same product: it is not named.
    assert not any("plane" in words for words in direction.remedies)
    strain = np.linspace(0.1, 1, 10)
    stress = 175 * kPa * (1 + strain - (1 + strain) ** -2)
    test = Curve("test", "test", "stress", "pressure", strain, stress * (1 + 0.01 * (-1.0) ** np.arange(10)))
    tied = dataclasses.replace(MU, name="shell.material.mu = test.material.mu")
    models = {"free": scene, "test": Tension(sg.NeoHookean(mu=150 * kPa))}
    both = calibrate(Fitting(models, [tied, THICKNESS], [free_curve(noisy), test]), starts=2)
    assert unknown_directions(both) == []
    np.testing.assert_allclose(both.x, [175 * kPa, T], rtol=0.02)
    without = held_out(both)
    assert set(without) == {"free", "test"}
    # Without the tension test mu t_m is still known, so the free curve is no worse; without the free curve t_m is lost.
    assert np.prod(without["test"][0]) == pytest.approx(175 * kPa * T, rel=0.02)


def test_further_measurements_are_of_one_scene(noisy):
    """Two membranes, each with a thickness of its own: what would be measured of one knows nothing of the other's."""
    models = {name: sg.shell.Free(shell(150 * kPa)) for name in ("one", "two")}
    tied = dataclasses.replace(MU, name="one.shell.material.mu = two.shell.material.mu")
    own = [dataclasses.replace(THICKNESS, name=f"{name}.shell.t_m") for name in models]
    curves = [dataclasses.replace(free_curve(noisy), name=name, model=name) for name in models]
    found = calibrate(Fitting(models, [tied, *own], curves), starts=1)
    plane = next(rows for words, rows in candidates(found) if "plane" in words)
    assert plane.shape[1] == 3
    assert np.all(plane[:, :2] != 0)
    np.testing.assert_array_equal(plane[:, 2], 0)


def test_further_measurements_are_by_the_laws_that_were_fitted():
    finger = sg.PneuNet.table_5_1("A")
    own = {"drive": "small_strain", "section": "thesis", "moment_spread": "none"}
    made = [scene for _, scene in _finger_scenes(sg.pneunet.TipContact(finger, **own))]
    assert [type(scene) for scene in made] == [sg.pneunet.Free, sg.pneunet.TipContact]
    assert all(getattr(scene, name) == value for scene in made for name, value in own.items())
    assert {scene.drive for _, scene in _finger_scenes(sg.pneunet.Cell(finger, curvature=0.0))} == {"cell"}
    by_energy = sg.shell.Free(shell(), model="energy", bending=False)
    on_ball = sg.shell.ObstacleContact(shell(), sg.shell.obstacles.Sphere(20 * mm, 5 * mm), bending=False)
    for scene in (by_energy, on_ball):
        assert {(made.model, made.bending) for _, made in _shell_scenes(scene)} == {("energy", False)}
    assert {made.model for _, made in _shell_scenes(sg.shell.Free(shell()))} == {"arc"}


def test_specimens_are_fitted_alone():
    """Three membranes of their own mu: each is found again."""
    mus = np.array([160, 175, 190]) * kPa
    y = np.concatenate([inflation(mu, PRESSURES) for mu in mus])
    curve = free_curve(y, x=np.tile(PRESSURES, 3), specimen=np.repeat([0, 1, 2], 20), specimens=("a", "b", "c"))
    found = calibrate(Fitting({"free": sg.shell.Free(shell())}, [MU], [curve]), starts=1)
    apart = by_specimen(found)
    np.testing.assert_allclose(apart.x[:, 0], mus, rtol=1e-6)
    half = stats.t.ppf(0.975, 2) * np.std(np.log(mus), ddof=1) / np.sqrt(3)
    middle = np.exp(np.mean(np.log(mus)))
    np.testing.assert_allclose(
        [apart.low[0], apart.high[0]], [middle * np.exp(-half), middle * np.exp(half)], rtol=1e-6
    )


STRAIN = np.linspace(0.05, 1, 12)


def strips(mus, noise, rng, variables=None, c2=0.0, stated=None):
    """A fit to strips of their own mu (Mooney-Rivlin with c2) and normal noise, and what is found of them apart."""
    stretch = 1 + STRAIN
    y = [(stretch - stretch**-2) * (mu + 2 * c2 / stretch) + noise * rng.normal(size=12) for mu in mus]
    known = {"specimen": np.repeat(np.arange(len(mus)), 12), "specimens": tuple("abcdef"[: len(mus)])}
    curve = Curve(
        "test", "strip", "stress", "pressure", np.tile(STRAIN, len(mus)), np.concatenate(y), noise=stated, **known
    )
    material = sg.NeoHookean(mu=150 * kPa) if variables is None else sg.MooneyRivlin(c1=60 * kPa, c2=20 * kPa)
    variables = variables or [Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
    found = calibrate(Fitting({"strip": Tension(material)}, variables, [curve]), starts=1)
    return found, by_specimen(found)


def test_specimens_differ_by_the_f_test_of_their_slopes():
    """Stress is linear in mu, the noise the same: the analysis of variance of the slopes, by hand."""
    rng, noise = np.random.default_rng(5), 4e3
    mus = [170 * kPa, 172 * kPa, 176 * kPa]
    one, apart = strips(mus, noise, rng, [Variable("material.c1", 0.0, 1000 * kPa)])
    rise = (1 + STRAIN) - (1 + STRAIN) ** -2
    y = one.fitting.y.reshape(3, 12) - 2 * 20 * kPa * rise / (1 + STRAIN)
    slope = y @ rise / (rise @ rise)
    inside = np.sum((y - slope[:, None] * rise) ** 2) / 33
    F = rise @ rise * np.sum((slope - slope.mean()) ** 2) / 2 / inside
    assert apart.chance[0] == pytest.approx(stats.f.sf(F, 2, 33), rel=1e-4)
    assert apart.chance_together == pytest.approx(apart.chance[0], rel=1e-9)
    known, apart = strips(mus, noise, rng, [Variable("material.c1", 0.0, 1000 * kPa)], stated=noise)
    slope = (known.fitting.y.reshape(3, 12) - 2 * 20 * kPa * rise / (1 + STRAIN)) @ rise / (rise @ rise)
    Q = rise @ rise * np.sum((slope - slope.mean()) ** 2) / noise**2
    assert apart.chance[0] == pytest.approx(stats.chi2.sf(Q, 2), rel=1e-4)


def test_equal_specimens_are_said_to_differ_as_rarely_as_the_level():
    """Twenty pairs of the same strip: one in a hundred is said to differ (four or more of twenty: p = 4e-5)."""
    rng, chances, differing = np.random.default_rng(2), [], 0
    for _ in range(20):
        one, apart = strips([175 * kPa] * 2, 3e3, rng)
        differing += bool(apart.differ[0])
        (sentence,) = spread_of_specimens(one, apart)
        assert ("agree within the noise" in sentence) != ("one to quote" in sentence)
        assert over_specimens(one, apart, 0).ends in sentence
        assert over_specimens(one, apart, 0).is_to_quote == apart.differ[0]
        chances.append(apart.chance[0])
    assert differing < 4
    assert stats.kstest(chances, "uniform").pvalue > 1e-3


def test_specimens_that_differ_are_said_to():
    """Moduli 5 % apart, known to 0.4 % each."""
    rng = np.random.default_rng(0)
    for mus in ([170 * kPa, 178.5 * kPa], [165 * kPa, 174 * kPa, 183 * kPa]):
        one, apart = strips(mus, 3e3, rng)
        assert apart.differ[0]
        (sentence,) = spread_of_specimens(one, apart)
        assert "by more than the noise explains (Cochran's test, p < 1e-06), so that" in sentence
        assert "one to quote" in sentence


def test_constants_that_go_together_differ_together():
    """Of two constants that the curve hardly tells apart neither alone is different, and both together are."""
    wide = [Variable("material.c1", 10 * kPa, 500 * kPa, "log"), Variable("material.c2", 0.0, 200 * kPa)]
    one, apart = strips([140 * kPa, 146 * kPa], 4e3, np.random.default_rng(1), wide, c2=15e3)
    assert not apart.differ.any()
    *each, both = spread_of_specimens(one, apart)
    assert len(each) == 2
    assert all("agree within the noise" in sentence and sentence.endswith(", taken alone.") for sentence in each)
    head = _lines(Findings(one, (), {}, apart, (), ()))
    assert all("differ in all parameters together: the interval is too narrow" in line for line in head)
    assert "all parameters together" in both
    assert "too narrow" in both


def test_no_interval_of_a_mean_has_values_that_cannot_be():
    """Two constants that differ: Student's t of one degree of freedom reaches far below zero."""
    mus = np.array([100 * kPa, 170 * kPa])
    one, apart = strips(mus, 1e3, np.random.default_rng(0), [Variable("material.c1", 0.0, 250 * kPa)])
    assert apart.low[0] < 0
    found = over_specimens(one, apart, 0)
    assert found.differ
    assert not found.is_to_quote
    (sentence,) = spread_of_specimens(one, apart)
    assert "2 specimens are too few" in sentence
    assert "-" not in sentence.partition("their mean")[2]
    assert "are too few for an interval of their mean" in _lines(Findings(one, (), {}, apart, (), ()))[0]
    wider, apart = strips(mus, 1e3, np.random.default_rng(0), [Variable("material.c1", 0.0, 3000 * kPa)])
    assert apart.low[0] < 0
    (sentence,) = spread_of_specimens(wider, apart)
    assert "one to quote: 0 kPa (its bound) to " in sentence
    assert "quote 95 % 0 to " in _lines(Findings(wider, (), {}, apart, (), ()))[0]


def test_repeats_at_one_pressure_are_followed():
    """Their range is that of the noise, and the RMS error was a third of it: the model was said not to follow them."""
    strain, stress = np.full(6, 0.5), 100 * kPa * (1 + 0.02 * np.array([-1.0, 1, 0.3, -0.4, 0.8, -0.7]))
    curve = Curve("test", "strip", "stress", "pressure", strain, stress)
    moduli = [Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
    found = calibrate(Fitting({"strip": Tension(sg.NeoHookean(mu=150 * kPa))}, moduli, [curve]), starts=1)
    assert misfit(found) == []


def test_rounding_is_no_error_of_the_model():
    """Numbers that were computed: their errors, of the solver or of a file's digits, say nothing of the model."""
    stretch = 1 + STRAIN
    stress = 175 * kPa * (stretch - stretch**-2)
    said = []
    for ripple in (1e-6, 1e-2):
        curve = Curve("test", "strip", "stress", "pressure", STRAIN, stress * (1 + ripple * np.cos(3 * STRAIN)))
        variables = [Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
        said.append(misfit(calibrate(Fitting({"strip": Tension(sg.NeoHookean(mu=150 * kPa))}, variables, [curve]), 1)))
    assert said[0] == []
    assert "go together" in said[1][0]


def test_a_sensor_that_was_not_at_zero_is_told_from_a_wrong_material():
    """3.6 kPa on every stress are found again, with the modulus that they cost; errors of a wrong law are none."""
    strain, noise = np.linspace(0.05, 1, 16), 0.9 * kPa * np.random.default_rng(6).normal(size=16)

    def fitting(stress, loss="linear", **changes):
        curve = Curve("strip", "strip", "stress", "pressure", strain, stress, **changes)
        models = {"strip": Tension(sg.NeoHookean(mu=140 * kPa))}
        return Fitting(models, [Variable("material.mu", 20 * kPa, 900 * kPa)], [curve], loss)

    right = 150 * kPa * (1 + strain - (1 + strain) ** -2)
    measured = right + noise + 3.6 * kPa
    fit = calibrate(fitting(measured), starts=1)
    (sentence,) = misfit(fit)
    assert not fit.low[0] < 150 * kPa < fit.high[0]  # the interval takes the model as right
    mu, zero = np.linalg.lstsq(np.stack([right / (150 * kPa), np.ones(16)], axis=1), measured, rcond=None)[0]
    assert f"an offset of {zero / kPa:.3g} kPa in all values would explain the errors." in sentence
    assert sentence.endswith(f"the fit is about material.mu {mu / kPa:.3g} kPa.")
    assert misfit(calibrate(fitting(right + noise), starts=1)) == []
    locking = np.asarray(jax.vmap(Tension(sg.Gent(mu=150 * kPa, j_m=30.0)).stress)(jnp.asarray(strain)))
    (sentence,) = misfit(calibrate(fitting(locking + 0.1 * noise), starts=1))
    assert "go together" in sentence
    # Points of small weight are not asked, and specimens have tests of their own.
    specimens = {"specimen": np.repeat([0, 1], 8), "specimens": ("a", "b")}
    for other in (fitting(measured, "huber"), fitting(measured, **specimens)):
        assert offset(dataclasses.replace(fit, fitting=other), 0) is None


@pytest.mark.slow
def test_mu_tuned_in_free_space_predicts_the_force():
    """Finite elements (FElupe 11.3, see configs/data): tuned, the force is nearer than with the elements' own mu."""
    from conftest import ROOT

    from optim.calibration import settings as calibrate_settings
    from softgrip_jax import config as configs

    problem = calibrate_settings.read(configs.load(ROOT / "configs" / "calibrate_shell.toml")).fitting
    found = calibrate(problem)
    force = problem.of_curve == 1
    tuned = found.errors[force] / problem.y[force]
    response = problem.predict_at(np.array([175 * kPa])).response
    own = (np.asarray(response.values) - problem.y)[force] / problem.y[force]
    np.testing.assert_allclose(own, [-0.21, -0.13, -0.11, -0.11], atol=0.01)
    assert np.max(np.abs(tuned)) < 0.5 * np.max(np.abs(own))
    assert 120 * kPa < found.x[0] < 175 * kPa


@pytest.mark.slow
def test_wrong_units_are_asked_about(noisy):
    def said(x, y):
        return implausible(Fitting({"free": sg.shell.Free(shell())}, [MU], [free_curve(y, x=x)]))

    assert said(PRESSURES, noisy) == []
    (words,) = said(PRESSURES, noisy * 1000)
    assert "1000 times above the model" in words
    (words,) = said(PRESSURES * 1000, noisy)
    assert "unit right?" in words


def test_numbers_of_objects_are_those_of_the_model_that_was_given():
    """A symmetry that was looked for before an object's number moved made every other number impossible."""
    plane = sg.shell.FlatContact(sg.FlatShell(16 * mm, 43 * mm, 1.1 * mm, sg.NeoHookean(mu=175 * kPa)), 5 * mm)
    curve = Curve("press", "contact", "force", "force", np.array([12, 14]) * kPa, np.array([14.0, 17.0]))
    by_energy = dataclasses.replace(plane, model="energy")
    assert Fitting({"contact": by_energy}, [Variable("distance", 2 * mm, 9 * mm)], [curve]).space.names == ["distance"]
    ball = sg.shell.obstacles.Sphere(20 * mm, 5 * mm)
    on_ball = sg.shell.ObstacleContact(plane.shell, ball, across=2, lengthwise=2)
    moved = Fitting({"contact": on_ball}, [Variable("obstacle.offset_x", -3 * mm, 3 * mm)], [curve])
    scene = moved.space.scenes_at(jnp.array([1 * mm]))["contact"]
    assert Status(int(sg.solve(scene, 12 * kPa).status)) is Status.OK
    fixed = Fitting({"contact": on_ball}, [Variable("shell.t_m", 1 * mm, 2 * mm)], [curve])
    assert fixed.space.scenes["contact"].symmetry == "both"  # which takes a quarter of the time


def test_an_error_is_no_part_of_nothing():
    """3.31 mm of a curve of zeros was 0.3 %: of a metre."""
    assert free_curve(np.full(20, 10 * mm)).share(0.1 * mm) == " (1.0%)"
    assert free_curve(np.zeros(20)).share(3.31 * mm) == ""


STRAINS = np.linspace(0.1, 1.0, 10)
STRESSES = 100 * kPa * (1 + STRAINS - (1 + STRAINS) ** -2) * (1 + 1e-2 * np.cos(9 * STRAINS))


def strip_fitting(*curves, low=10 * kPa, high=1000 * kPa):
    strip = Tension(sg.NeoHookean(mu=150 * kPa))
    return Fitting({"strip": strip}, [Variable("material.mu", low, high, "log")], curves)


def strip_curve(name="test", x=STRAINS, y=STRESSES, model="strip", quantity="stress", **more):
    return Curve(name, model, quantity, "pressure", x, y, **more)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"y": np.append(STRESSES[:1], np.full(9, np.nan))}, r"y\[1\] of curve 'test' is nan"),
        ({"x": np.append(np.inf, STRAINS[1:])}, r"x\[0\] of curve 'test' is inf"),
        ({"y": STRESSES[1:]}, "x has 10, y has 9"),
        ({"specimen": np.zeros(3, dtype=int), "specimens": ("a",)}, "specimen has 3"),
        ({"x": np.array([]), "y": np.array([])}, "must be a list of numbers"),
        ({"x": STRAINS - 2}, "a strain must be above -1"),
        ({"x": -STRAINS, "quantity": "inflation"}, "a gauge pressure must be zero or more"),
    ],
)
def test_points_that_cannot_be_meant_are_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        strip_curve(**wrong)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"model": "strap"}, "is of the model 'strap'; it must be one of 'strip'"),
        ({"quantity": "force"}, "measures 'force'; of its model it must be one of stress"),
        ({"component": 1}, "component of curve 'test' is 1"),
    ],
)
def test_curves_of_what_no_model_has_are_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        strip_fitting(strip_curve(**wrong))


def test_points_count_once():
    """Given twice they made the interval narrower by a third, and nothing was said."""
    again, half = strip_curve("again", STRAINS[::-1], STRESSES[::-1]), np.repeat([0, 1], 10)
    doubled = {"x": np.tile(STRAINS, 2), "y": np.tile(STRESSES, 2), "specimen": half, "specimens": ("a", "b")}
    with pytest.raises(InputError, match="of curve 'again' are those of curve 'test'"):
        strip_fitting(strip_curve(), again)
    with pytest.raises(InputError, match="curve 'test', specimen 'b' are those of curve 'test', specimen 'a'"):
        strip_fitting(strip_curve(**doubled))
    with pytest.raises(InputError, match="Two curves are called 'test'"):
        strip_fitting(strip_curve(), strip_curve(y=2 * STRESSES))
    assert len(strip_fitting(strip_curve(), dataclasses.replace(again, fit=False)).curves) == 2


def test_bootstrap_fits_on_a_bound_set_no_end():
    """They all sit there, and the interval was '150 to 150 kPa'."""
    found = calibrate(strip_fitting(strip_curve(), low=150 * kPa), starts=1)
    ends = intervals(found, "bootstrap", repeats=100)
    assert np.all(np.isnan([ends.low, ends.high]))
    assert any("no end to its interval below" in note for note in ends.notes)
    both = (intervals(found, "gauss_newton"), ends)
    (line,) = _lines(Findings(found, both, {}, None, (), ()))  # what calibrated.toml says
    assert line == "material.mu_kPa = 150, on its bound, 95 % open to open (bootstrap)"


def test_what_the_data_do_not_depend_on_is_not_determined():
    """All strains are zero: the interval was '28 to 1420 kPa', of a made-up deviation of one."""
    found = calibrate(strip_fitting(strip_curve(x=np.zeros(10))), starts=1)
    assert found.deviation[0] > 1e6
    assert not is_determined(found, 0)


def test_points_that_are_left_out_do_not_widen_the_range_of_a_curve():
    """An error of a third of all that was fitted was a thousandth of an outlier that was not."""
    whole = strip_fitting(strip_curve(y=np.append(50 * kPa + STRESSES[:-1] % (30 * kPa), 100 * STRESSES[-1])))
    member = whole.member(to_free(np.array([0.5])), weight=np.append(np.ones(9), 0.0))
    found = finished(whole, member)
    assert misses(found)["test"] == pytest.approx(found.rmse(0) / np.ptp(whole.y[:-1]))


def test_a_profile_without_an_end_within_the_bounds_is_open_there():
    wide = calibrate(strip_fitting(strip_curve()), starts=1)
    ends = intervals(wide, "profile")
    near = calibrate(strip_fitting(strip_curve(), low=0.5 * (ends.low[0] + wide.x[0])), starts=1)
    found = intervals(near, "profile")
    assert np.isnan(found.low[0])
    assert found.high[0] == pytest.approx(ends.high[0], rel=1e-6)
    assert found.notes == ("material.mu: the data set no end to its interval below within its bounds.",)


def test_what_the_other_curves_say_of_one():
    """Stress is linear in mu: without one curve mu is that of the other, and misses it by the difference."""
    shape = 1 + STRAINS - (1 + STRAINS) ** -2
    curves = [strip_curve(name, y=mu * kPa * shape, noise=1 * kPa) for name, mu in (("soft", 100), ("stiff", 120))]
    found = held_out(calibrate(strip_fitting(*curves), starts=1))
    assert set(found) == {"soft", "stiff"}
    for name, mu in (("soft", 120), ("stiff", 100)):
        np.testing.assert_allclose(found[name][0], mu * kPa, rtol=1e-6)
        assert found[name][1] == pytest.approx(20 * kPa * np.sqrt(np.mean(shape**2)), rel=1e-6)
