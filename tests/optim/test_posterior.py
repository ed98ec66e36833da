"""Posteriors of calibrated parameters: against closed forms, by simulation, through the commands, and bad input."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ROOT
from rich.console import Console
from scipy import stats

import optim
import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.cli import MISTAKE, run
from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.units import kPa, mm

pytest.importorskip("numpyro", reason="posteriors need the extra bayes")
pytest.importorskip("h5netcdf")

from optim.calibration import settings
from optim.design import settings as design_settings
from optim.posterior.compare import Run, compared, run_evidence
from optim.posterior.density import Density
from optim.posterior.diagnose import diagnose
from optim.posterior.evidence import scores
from optim.posterior.posterior import posterior
from optim.posterior.priors import Prior, Sampling, require_proper, weak
from optim.posterior.sample import Sampled, advanced, kernel, sample
from optim.posterior.write import laws_behind

STRAIN = np.linspace(0.1, 1.0, 12)
SHAPE = 1 + STRAIN - (1 + STRAIN) ** -2
"""Engineering stress of a neo-Hookean strip over mu (Treloar 1944)."""


def strip_fit(y, noise=None, scale="linear"):
    curve = optim.Curve("test", "strip", "stress", "pressure", STRAIN, y, noise=noise)
    strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
    variables = [optim.Variable("material.mu", 20 * kPa, 2000 * kPa, scale)]
    return optim.calibrate(optim.Fitting({"strip": strip}, variables, [curve]), starts=1)


@pytest.fixture(scope="module")
def conjugate():
    """A linear model with known normal noise and a normal prior: its posterior is a normal distribution."""
    rng = np.random.default_rng(1)
    noise, prior = 8 * kPa, Prior("normal", 160 * kPa, 5 * kPa)
    y = 175 * kPa * SHAPE + noise * rng.normal(size=len(SHAPE))
    found = posterior(strip_fit(y, noise), [prior], Sampling(discrepancy=0.0))
    return found, y, noise, prior


def exact(y, shape, noise, prior):
    """(mean, standard deviation) of mu, where y = mu shape + noise."""
    precision = shape @ shape / noise**2 + 1 / prior.spread**2
    return (shape @ y / noise**2 + prior.centre / prior.spread**2) / precision, precision**-0.5


def test_draws_are_those_of_the_exact_posterior(conjugate):
    found, y, noise, prior = conjugate
    mean, deviation = exact(y, SHAPE, noise, prior)
    assert found.diagnosis.usable
    # The Monte Carlo error of a mean by 1,500 effective draws is a fortieth of the deviation.
    assert abs(found.x.mean() - mean) < 0.1 * deviation
    assert found.x.std() == pytest.approx(deviation, rel=0.07)
    np.testing.assert_allclose(
        found.quantiles([0.025, 0.975])[:, 0], stats.norm(mean, deviation).ppf([0.025, 0.975]), atol=0.2 * deviation
    )


def test_leave_one_out_scores_are_the_exact_ones(conjugate):
    """p(y_i | y_-i) of the linear model is normal, with the posterior by the other points."""
    found, y, noise, prior = conjugate
    expected = []
    for i in range(len(y)):
        rest = np.arange(len(y)) != i
        mean, deviation = exact(y[rest], SHAPE[rest], noise, prior)
        expected.append(stats.norm(mean * SHAPE[i], np.hypot(noise, deviation * SHAPE[i])).logpdf(y[i]))
    np.testing.assert_allclose(found.scores.elpd, expected, atol=0.05)
    assert np.all(found.scores.shape < 0.7)


@pytest.fixture(scope="module")
def erring():
    """A density with noise and model error to be found."""
    rng = np.random.default_rng(2)
    y = 175 * kPa * SHAPE * (1 + 0.03 * np.sin(4 * STRAIN)) + 1 * kPa * rng.normal(size=len(SHAPE))
    fit = strip_fit(y, scale="log")
    return Density(fit, [Prior("lognormal", 150 * kPa, 0.3)])


def covariance(density, sigma, delta):
    """sigma^2 I + delta^2 S K S, written out."""
    x = density.fitting.x
    size = np.maximum(np.abs(density.fit.x[0] * SHAPE), 0.1 * density.fitting.sizes[0])
    smooth = np.exp(-0.5 * ((x[:, None] - x[None, :]) / (0.5 * np.ptp(x))) ** 2)
    return sigma**2 * np.eye(len(x)) + delta**2 * np.outer(size, size) * smooth


def test_the_density_is_that_of_scipy(erring):
    """Likelihood with the whole covariance, priors with their change of variables, up to one constant."""
    space = erring.fitting.space

    def expected(v):
        found = erring.unknowns(jnp.asarray(v))
        x, step = float(found.x[0]), 1e-5 * np.eye(3)[0]
        by_v = np.diff([float(erring.unknowns(jnp.asarray(w)).x[0]) for w in (v - step, v + step)])[0] / 2e-5
        assert space.low[0] < x < space.high[0]
        sigma, delta = 0.05 * erring.fitting.sizes[0] * np.exp(v[1]), 0.1 * np.exp(v[2])
        likelihood = stats.multivariate_normal(x * SHAPE, covariance(erring, sigma, delta)).logpdf(erring.y)
        prior = stats.lognorm(0.3, scale=150 * kPa).logpdf(x) + np.log(by_v)
        prior += sum(stats.halfnorm.logpdf(np.exp(u)) + u for u in v[1:])
        return likelihood + prior

    points = np.array([[-0.1, -1.0, -1.0], [0.0, -2.0, 0.5], [-0.4, 0.3, -3.0]])
    assert np.ptp([float(erring.unknowns(jnp.asarray(v)).x[0]) for v in points]) > 2 * kPa
    ours = np.array([-float(erring.potential(jnp.asarray(v))) for v in points])
    theirs = np.array([expected(v) for v in points])
    np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], rtol=1e-7, atol=1e-6)
    slope = jax.grad(erring.potential)(jnp.asarray(points[0]))
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        change = (
            erring.potential(jnp.asarray(points[0] + step)) - erring.potential(jnp.asarray(points[0] - step))
        ) / 2e-6
        np.testing.assert_allclose(slope[k], change, rtol=1e-4)


def test_scores_condition_on_the_other_points(erring):
    """One draw: its weights are one, so that the score is the model's own density, and what is taken off is that of a
    conditional normal distribution."""
    sigma, delta, mu = 2 * kPa, 0.04, 170 * kPa
    rows = 30
    values = np.tile(mu * SHAPE, (rows, 1))
    found, given = scores(erring, values, values > 0, np.full((rows, 1), sigma), np.full((rows, 1), delta))
    whole = covariance(erring, sigma, delta)
    for i in (0, 5, 11):
        rest = np.arange(len(SHAPE)) != i
        solved = np.linalg.solve(whole[np.ix_(rest, rest)], whole[rest, i])
        mean = values[0, i] + solved @ (erring.y - values[0])[rest]
        deviation = np.sqrt(whole[i, i] - solved @ whole[rest, i])
        np.testing.assert_allclose(given[0, i], stats.norm(mean, deviation).logpdf(erring.y[i]), rtol=1e-6)
        alone = stats.norm(values[0, i], np.sqrt(whole[i, i])).logpdf(erring.y[i])
        np.testing.assert_allclose(found.elpd[i], alone, rtol=1e-6)


SETS, RANKED = 48, 31
"""Synthetic sets, and draws among which the truth is ranked."""


@pytest.mark.slow
def test_ranks_of_the_truth_are_uniform(erring):
    """Simulation-based calibration (Talts et al. 2018): parameters from the prior, data from them, and the posterior by
    the data; then the truth is as likely to have any rank among the draws. All sets go through one program."""
    rng = np.random.default_rng(11)
    mu = 150 * kPa * np.exp(0.3 * rng.normal(size=SETS))
    sigma = 0.05 * erring.fitting.sizes[0] * np.abs(rng.normal(size=SETS))
    delta = 0.1 * np.abs(rng.normal(size=SETS))
    roots = np.array([np.linalg.cholesky(covariance(erring, s, d)) for s, d in zip(sigma, delta, strict=True)])
    y = mu[:, None] * SHAPE + np.einsum("nij,nj->ni", roots, rng.normal(size=(SETS, len(SHAPE))))
    centre, _ = erring.start()
    warmup, every = 200, 10

    def ranks(y, truth, key):
        nuts = kernel(lambda v: erring.potential(v, y))
        start = jnp.asarray(centre) + 0.1 * jax.random.normal(key, (erring.size,))
        state = nuts.init(key, warmup, start, (), {})
        state, _ = advanced(nuts, state, warmup)
        _, (v, *_) = advanced(nuts, state, every * RANKED)
        found = jax.vmap(lambda v: erring.unknowns(v, y))(v[::every])
        drawn = jnp.stack([found.x[:, 0], found.sigma[:, 0], found.delta[:, 0]], axis=-1)
        return jnp.sum(drawn < truth[None, :], axis=0)

    truths = np.stack([mu, sigma, delta], axis=1)
    keys = jax.random.split(jax.random.key(4), SETS)
    found = np.asarray(jax.jit(jax.vmap(ranks))(jnp.asarray(y), jnp.asarray(truths), keys))
    for column in found.T:
        counts = np.bincount(column // 4, minlength=8)
        assert counts.sum() == SETS
        assert stats.chisquare(counts).pvalue > 1e-3
    assert np.all(stats.kstest((found + 0.5) / (RANKED + 1), "uniform").pvalue > 1e-3)


def test_chains_that_do_not_agree_are_not_to_be_used():
    rng = np.random.default_rng(0)
    good = rng.normal(size=(4, 500, 2))

    def said(v, diverging=0):
        flags = np.arange(2000).reshape(4, 500) < diverging
        ones = np.ones((4, 500))
        return diagnose(v, Sampled(v, ones, flags, ones, ones), ["mu", "the noise"])

    assert said(good).usable
    apart = said(good + np.arange(4)[:, None, None] * [0.0, 1.0])
    assert not apart.usable
    assert apart.sentence().startswith("DO NOT USE this posterior: the chains do not agree on the noise (R-hat is 1.")
    slow = said(np.cumsum(good, axis=1))
    assert "effective draws, and 400 are needed" in slow.sentence()
    assert "100 of 2000 draws diverged: a part" in said(good, 100).sentence()
    few = said(good, 3)
    assert few.usable
    assert few.remarks[0].startswith("3 of 2000 draws diverged: the ends")
    stuck = good.copy()
    stuck[:, :, 0] = 1.0
    assert not said(stuck).usable


def test_blocks_are_one_run():
    """The draws of a normal density, in blocks that do not divide the warm-up."""
    found = sample(
        lambda v: 0.5 * jnp.sum(((v - 3.0) / jnp.array([1.0, 10.0])) ** 2), np.zeros(2), np.ones(2), 2, 420, 130
    )
    assert found.v.shape == (2, 420, 2)
    np.testing.assert_allclose(found.v.std(axis=(0, 1)), [1.0, 10.0], rtol=0.25)


# --- the commands -----------------------------------------------------------------------------------------------------

CONFIG = """
[scene]
type = "shell.Free"
shell = {{ a_mm = 16, b_mm = 43, t_m_mm = 1.1, material = {{ type = "NeoHookean", mu_kPa = 150 }} }}

[calibrate]
starts = 1
{more}

[[calibrate.parameters]]
name = "{name}"
low = {low}
high = {high}
scale = "{scale}"

[[calibrate.curves]]
name = "strip"
file = ["s1.csv", "s2.csv", "s3.csv"]
strain = {{ column = "strain", unit = "1" }}
measured = {{ quantity = "stress", column = "stress", unit = "kPa" }}
"""
MU = (160.0, 175.0, 190.0)


def written(folder, more="", name="shell.material.mu_kPa", low=20, high=2000, scale="log"):
    rng = np.random.default_rng(5)
    for k, mu in enumerate(MU, 1):
        rows = [f"{e:.6g},{mu * s + 0.5 * rng.normal():.6g}" for e, s in zip(STRAIN, SHAPE, strict=True)]
        (folder / f"s{k}.csv").write_text("\n".join(["strain,stress", *rows]))
    (folder / "fit.toml").write_text(CONFIG.format(more=more, name=name, low=low, high=high, scale=scale))
    return folder / "fit.toml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("posterior")
    prior = '[calibrate.priors]\n"shell.material.mu_kPa" = { median = 170, spread = 0.2 }'
    config = written(folder, "[calibrate.posterior]\ndraws = 600\nseed = 2\n" + prior)
    assert run(["calibrate", str(config), "--posterior", "--out", str(folder / "out")]) == 0
    return folder


def test_the_run_keeps_everything(finished, capsys):
    out = finished / "out"
    assert {"posterior.nc", "corner.png", "predictive.png"} <= {path.name for path in out.iterdir()}
    told = json.loads((out / "result.json").read_text())["posterior"]
    assert told["usable"]
    mu = told["parameters"]["shell.material.mu"]
    assert mu["low"] < 160e3 < 190e3 < mu["high"]
    for name, expected in zip(("s1", "s2", "s3"), MU, strict=True):
        low, _, high = told["specimens"][name]["shell.material.mu"]
        assert low < expected * kPa < high
        assert high - low < 0.3 * (mu["high"] - mu["low"])
    assert "agree" in told["remarks"][0]
    # Specimens of 160, 175 and 190 kPa: the noise of each says nothing of how far they are apart.
    over = json.loads((out / "result.json").read_text())["interval_over_specimens"]
    assert over["to_quote"] == ["shell.material.mu"]
    half = stats.t.ppf(0.975, 2) * np.std(np.log(MU), ddof=1) / np.sqrt(3)
    ends = over["low"]["shell.material.mu"], over["high"]["shell.material.mu"]
    np.testing.assert_allclose(ends, np.exp(np.mean(np.log(MU)) + np.array([-half, half])) * kPa, rtol=0.01)
    comment = (out / "material.toml").read_text()
    assert "differ by more than the noise explains: quote 95 % " in comment
    assert "(mean of the specimens)" in comment
    page = (out / "report.html").read_text()
    assert "predictive.png" in page or "posterior.parameters" in page


def test_arviz_reads_the_file(finished):
    from optim.posterior.sample import extra

    data = extra().from_netcdf(str(finished / "out" / "posterior.nc"), engine="h5netcdf")
    assert data.posterior["shell.material.mu_kPa"].attrs["laws"] == "{}"  # a tension test knows no model of a shell
    assert dict(data.posterior.sizes)["draw"] == 600
    table = extra().summary(data, var_names=["shell.material.mu_kPa", "scatter of shell.material.mu_kPa"])
    assert 160 < float(table["mean"].iloc[0]) < 190
    assert data.log_likelihood["y"].dims[-1] == "point"


def test_a_search_takes_the_file_for_its_parts(finished):
    text = (ROOT / "configs" / "shell_grasp_robust.toml").read_text()
    read = configs.load(ROOT / "configs" / "shell_grasp_robust.toml")
    table = dict(read.tables["design"]["uncertain"]) | {"posterior": str(finished / "out" / "posterior.nc")}
    table["numbers"] = [n for n in table["numbers"] if "mu_kPa" not in str(n["name"])]
    table.pop("correlations", None)
    tables = dict(read.tables) | {"design": dict(read.tables["design"]) | {"uncertain": table}}
    wanted = design_settings.read(configs.Config(read.path, read.scenes, tables))
    draws = wanted.uncertain.scatters.draws
    assert "material" in text
    assert all(name.endswith("shell.material.mu") for part in draws.names for name in part.split(" = "))
    assert 160 * kPa < draws.mean[0] < 190 * kPa
    assert len(draws.values) == 2400


def test_the_file_says_by_which_laws_its_numbers_were_found():
    """Those of the scenes that a number moves and that a curve was fitted with: a tension test has none."""
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=150 * kPa))
    models = {
        "free": sg.shell.Free(shell, model="energy"),
        "plane": sg.shell.FlatContact(shell, distance=5 * mm),
        "strip": optim.Tension(sg.NeoHookean(mu=150 * kPa)),
    }
    variables = [
        optim.Variable("free.shell.material.mu = plane.shell.material.mu = strip.material.mu", 20 * kPa, 2000 * kPa),
        optim.Variable("plane.distance", 1 * mm, 9 * mm),
    ]
    pressure, kind = np.linspace(2, 12, 6) * kPa, {"inflation": "length", "force": "force"}

    def fitted(*wanted):
        curves = [optim.Curve("test", "strip", "stress", "pressure", STRAIN, 150 * kPa * SHAPE)]
        curves += [optim.Curve(m, m, q, kind[q], pressure, pressure * 1e-6) for m, q in wanted]
        return [laws_behind(optim.Fitting(models, variables, curves), j) for j in range(2)]

    assert fitted() == [{}, {}]
    assert fitted(("free", "inflation")) == [{"model": ["energy"], "bending": [True]}, {}]
    both = fitted(("free", "inflation"), ("plane", "force"))
    assert both == [{"model": ["energy", "arc"], "bending": [True]}, {"model": ["arc"]}]


def test_solve_gives_every_value_an_interval(finished, capsys):
    file = str(finished / "out" / "posterior.nc")
    words = ["solve", str(finished / "fit.toml"), "--posterior", file, "--draws", "200"]
    assert run([*words, "--pressure-kPa", "10", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["solved"] == told["draws"] == 200
    # The inflation falls as mu rises, so that its interval is that of mu, end for end.
    ends, mu = told["observables"]["inflation"], told["parameters"]["shell.material.mu"]
    assert told["units"]["shell.material.mu"] == "Pa"
    assert not any(name.endswith("_kPa") for name in (*told["parameters"], *told["units"]))
    for one, other in (("low", "high"), ("median", "median"), ("high", "low")):
        shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=mu[other]))
        assert ends[one] == pytest.approx(float(sg.solve(sg.shell.Free(shell), 10 * kPa).inflation), rel=5e-3)
    assert run([*words, "--pressure-kPa", "20.2"]) == 0
    printed = capsys.readouterr().out
    assert "of 200 draws have no equilibrium" in printed
    assert "at a limit point" in printed
    # The pressures of the finite elements, of 175 kPa, are 150 / 175 of theirs here.
    assert (
        "than finite elements, 4.29 to 15 kPa, with numbers as they are; those of a calibration make up for" in printed
    )
    assert run([*words, "--pressure-kPa", "60"]) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["solve", "{finger}", "--posterior", "{file}"], "is of another scene: it holds shell.material.mu_kPa"),
        (["solve", "{gent}", "--pressure-kPa", "5", "--posterior", "{file}"], "is a number of NeoHookean, and here"),
        (["solve", "{fit}", "--pressure-kPa", "5", "--posterior", "none.nc"], "there is no posterior 'none.nc'"),
        (["solve", "{fit}", "--posterior", "{file}", "--tolerance", "1%"], "leave out --tolerance"),
        (
            ["solve", "{fit}", "--pressure-kPa", "5", "--posterior", "{bad}"],
            "says of itself: DO NOT USE this posterior",
        ),
    ],
)
def test_a_posterior_of_something_else(finished, tmp_path, capsys, words, said):
    import xarray as xr

    bad = tmp_path / "bad.nc"
    draws = ("chain", "draw"), np.ones((2, 10))
    about = {"usable": 0, "verdict": "DO NOT USE this posterior: the chains do not agree."}
    data = xr.Dataset({"shell.material.mu_kPa": draws}, attrs=about)
    data.to_netcdf(bad, group="posterior", engine="h5netcdf")
    gent = tmp_path / "gent.toml"
    gent.write_text(
        (finished / "fit.toml").read_text().replace('"NeoHookean"', '"Gent", j_m = 50').split("[calibrate")[0]
    )
    finger = ROOT / "configs" / "finger_free.toml"
    files = {"finger": finger, "file": finished / "out" / "posterior.nc", "fit": finished / "fit.toml"}
    assert run([word.format(gent=gent, bad=bad, **files) for word in words]) == MISTAKE
    assert said in capsys.readouterr().err.replace("\n", " ")


MU_KEY = '"shell.material.mu_kPa"'


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (f"{MU_KEY} = {{ median = 170, spread = 0 }}", "is improper: its spread is 0; it must be a positive number"),
        (f"{MU_KEY} = {{ mean = 170, deviation = -3 }}", "is improper: its deviation is -3; it must be a positive"),
        (f'{MU_KEY} = {{ distribution = "flat" }}', "is 'flat', which is no proper prior here; it must be one of"),
        (f"{MU_KEY} = {{ median = 5, spread = 0.1 }}", "is centred at 5, outside of its bounds, "),
        (f"{MU_KEY} = {{ median = 170 }}", "must have median and spread"),
        (f"{MU_KEY} = {{ }}", "it has nothing"),
        ('"shell.t_m_mm" = { mean = 1, deviation = 0.1 }', "is not among the parameters; it must be one of"),
    ],
)
def test_a_prior_that_cannot_be_meant(tmp_path, capsys, more, said):
    config = written(tmp_path, f"[calibrate.priors]\n{more}")
    assert run(["calibrate", str(config), "--posterior", "--out", str(tmp_path / "out")]) == MISTAKE
    assert said in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "out").exists()


def test_data_that_do_not_touch_a_parameter(tmp_path, capsys):
    """A tension test says nothing of the thickness of a wall."""
    config = written(tmp_path, name="shell.t_m_mm", low=0.5, high=2)
    assert run(["calibrate", str(config), "--posterior", "--out", str(tmp_path / "out")]) == MISTAKE
    assert "The data do not touch shell.t_m: its posterior would be its prior" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_weak_priors_stand_around_the_values_as_given(tmp_path):
    read = settings.read(configs.load(written(tmp_path)))
    assert read.priors[0] == weak(read.fitting.space, 0)
    assert read.priors[0].centre == 150 * kPa
    ends = read.priors[0].quantiles(20 * kPa, 2000 * kPa, [0.1587, 0.8413])
    np.testing.assert_allclose(ends, [75 * kPa, 300 * kPa], rtol=0.01)
    # A value outside of the bounds: around the bound next to it.
    outside = settings.read(configs.load(written(tmp_path, high=140)))
    assert outside.priors[0] == Prior("lognormal", 140 * kPa, read.priors[0].spread)
    require_proper("mu", outside.priors[0], 20 * kPa, 140 * kPa)
    with pytest.raises(InputError, match="lower bound must be above zero"):
        require_proper("x", Prior("lognormal", 1.0, 0.1), 0.0, 2.0)


# --- models compared --------------------------------------------------------------------------------------------------


def scored(name, elpd, first=0):
    points = tuple(("curve", float(k), 1.0) for k in range(first, first + len(elpd)))
    return Run(name, points, np.asarray(elpd, float), np.zeros(len(elpd)), {}, True)


def test_evidence_is_a_difference_with_its_error():
    rng = np.random.default_rng(3)
    better, noise = rng.normal(size=40), rng.normal(size=40)
    found = compared([scored("bad", better - 1 + 0.5 * noise), scored("good", better), scored("same", better - 0.01)])
    assert [run.name for run in found.runs] == ["good", "same", "bad"]
    change, error = found.apart[2]
    assert change == pytest.approx(np.sum(-1 + 0.5 * noise))
    assert error == pytest.approx(np.sqrt(40) * np.std(0.5 * noise, ddof=1))
    assert found.sentence().startswith("good predicts the points better than bad (by ")
    assert "do not tell good from same" in found.sentence()
    # A point that one model does not reach is compared by none of them.
    fewer = compared([scored("all", np.zeros(10)), scored("less", np.ones(9), first=1)])
    assert fewer.scores.shape == (2, 9)
    assert dict(zip([run.name for run in fewer.runs], fewer.lost, strict=True)) == {"all": 0, "less": 1}
    with pytest.raises(ConfigError, match="models of the same data"):
        compared([scored("one", np.zeros(10)), scored("other", np.zeros(10), first=20)])
    with pytest.raises(ConfigError, match="name two runs"):
        compared([scored("one", np.zeros(10))])


def test_runs_are_compared_by_their_files(finished, tmp_path, capsys):
    out = finished / "out"
    (tmp_path / "copy.nc").write_bytes((out / "posterior.nc").read_bytes())
    told = run_evidence([out, tmp_path / "copy.nc"], False, Console())
    assert "do not tell" in capsys.readouterr().out
    one, other = told["runs"].values()
    assert (
        one["elpd"]
        == other["elpd"]
        == pytest.approx(json.loads((out / "result.json").read_text())["posterior"]["elpd"])
    )
    assert one["points"] == 36
    assert set(one["model_error"]) == {"strip"}
    with pytest.raises(ConfigError, match="make one with softgrip calibrate CONFIG --posterior"):
        run_evidence([out, tmp_path], False, Console())
    with pytest.raises(ConfigError, match="One run is named twice"):
        run_evidence([out, out], False, Console())


def test_a_robust_loss_has_no_posterior(tmp_path, capsys):
    config = written(tmp_path, 'loss = "huber"\nposterior = true')
    assert run(["calibrate", str(config), "--out", str(tmp_path / "out")]) == MISTAKE
    assert "the loss is 'huber'; it must be 'linear'" in capsys.readouterr().err.replace("\n", " ")
