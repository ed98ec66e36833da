"""From a fit to its posterior: draws, diagnostics, intervals, leave-one-out scores, predictions."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from softgrip_jax.progress import Tell, silent

from ..calibration.fit import Fit
from .density import LEAST_SIZE, Density, Unknowns, require_normal, require_touched
from .diagnose import Diagnosis, diagnose
from .evidence import ROUGH, Scores, scores
from .priors import Prior, Sampling, require_proper
from .sample import Sampled, extra, sample

EVALUATED = 1000
"""Draws by which points are scored and predicted: their noise is then well below that of the data."""

DRAWN = 100
"""Draws of a band in a picture."""

GRID = 30
"""Points along a band."""

TOLD_LITTLE = 0.8
"""A posterior this wide, as a part of its prior, says what the prior said."""

CORRELATED = 0.95


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Draws of the parameters of a fit, and what they say."""

    fit: Fit
    density: Density
    settings: Sampling
    sampled: Sampled
    unknowns: Unknowns
    """Arrays with the chains and draws first, SI."""
    next_part: np.ndarray
    """The parameters of a further specimen, shape (chains, draws, n); those of all where there is just one."""
    diagnosis: Diagnosis
    scores: Scores
    log_likelihood: np.ndarray
    """Of the draws that were evaluated, one row each: log p(y_i | y_-i, theta)."""

    @cached_property
    def x(self) -> np.ndarray:
        """All draws of a further specimen, one row each, SI."""
        return self.next_part.reshape(-1, self.next_part.shape[-1])

    def quantiles(self, q: Any) -> np.ndarray:
        """Of the parameters of a further specimen, SI."""
        return np.quantile(self.x, q, axis=0)

    @property
    def contraction(self) -> np.ndarray:
        """Width of the 95 % interval over that of the prior, by parameter; of the population where there is one."""
        space = self.fit.fitting.space
        low, high = np.quantile(np.asarray(self.unknowns.x), [0.025, 0.975], axis=(0, 1))
        prior = self.prior_quantiles([0.025, 0.975])
        log = space.is_log
        width = np.where(log, np.log(high / np.where(log, low, 1.0)), high - low)
        before = np.where(log, np.log(prior[1] / np.where(log, prior[0], 1.0)), prior[1] - prior[0])
        return width / before

    def prior_quantiles(self, q: Any) -> np.ndarray:
        """Of the priors, SI, one column per parameter."""
        space = self.fit.fitting.space
        found = [p.quantiles(space.low[j], space.high[j], q) for j, p in enumerate(self.density.priors)]
        return np.stack(found, axis=-1)

    @cached_property
    def correlation(self) -> np.ndarray:
        """Of the parameters of the population, log parameters by their logarithms."""
        x = np.asarray(self.unknowns.x).reshape(-1, self.fit.fitting.space.size)
        log = self.fit.fitting.space.is_log
        return np.atleast_2d(np.corrcoef(np.where(log, np.log(np.where(log, x, 1.0)), x), rowvar=False))

    def remarks(self) -> list[str]:
        """The verdict first, then what people should know of it."""
        said = [self.diagnosis.sentence(), *self.diagnosis.remarks]
        space = self.fit.fitting.space
        for j, name in enumerate(space.names):
            if self.contraction[j] > TOLD_LITTLE:
                said.append(f"The data say little of {name}: its posterior is nearly its prior.")
        said += [
            f"{space.names[i]} and {space.names[j]} are known together rather than apart (correlation "
            f"{self.correlation[i, j]:+.3f}): use their draws jointly."
            for i in range(space.size)
            for j in range(i)
            if abs(self.correlation[i, j]) > CORRELATED
        ]
        far = int(np.sum(self.scores.shape > ROUGH))
        if far:
            said.append(
                f"The leave-one-out scores of {far} of {len(self.scores.shape)} points are rough: each of them moves "
                f"the posterior (Pareto k above {ROUGH:g})."
            )
        if self.density.specimens:
            said.append(
                "There are several specimens: the interval of a parameter is that of the next part, which scatters as "
                "they do."
            )
        return said

    def band(self, k: int, count: int = DRAWN, n: int = GRID) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(x, the model of a further specimen, the same with model error and noise) of a curve, one row per draw, SI;
        NaN where a draw has no equilibrium."""
        sigma, delta = (
            np.asarray(v).reshape(-1, v.shape[-1])[:, k] for v in (self.unknowns.sigma, self.unknowns.delta)
        )
        picks = np.linspace(0, len(self.x) - 1, count).astype(int)
        rng = np.random.default_rng(self.settings.seed)
        if not self.fit.fitting.curves[k].fit:  # nothing is known of its errors but their prior
            delta = self.settings.discrepancy * np.abs(rng.normal(size=delta.shape))
            sigma = np.full_like(sigma, self.fit.fitting.curves[k].noise or 0.0)
        rows = []
        for pick in picks:
            x, y, _ = dataclasses.replace(self.fit, x=self.x[pick]).band(k, n)
            rows.append(y)
        values = np.array(rows)
        with np.errstate(invalid="ignore"):
            size = np.maximum(np.abs(values), LEAST_SIZE * self.fit.fitting.curves[k].size)
        error = np.sqrt(sigma[picks, None] ** 2 + (delta[picks, None] * size) ** 2)
        return x, values, values + error * rng.normal(size=(len(picks), 1))


def posterior(fit: Fit, priors: Sequence[Prior], settings: Sampling | None = None, tell: Tell = silent) -> Posterior:
    """The posterior of the parameters of a fit.

    Data, noise and the model's error are normal: y ~ N(f(x), sigma^2 I + delta^2 S K S), see `optim.posterior.density`.

    Args:
        fit: the least-squares fit, which says where to begin and which points have an equilibrium.
        priors: one for each parameter.
        settings: how it is sampled.
        tell: told of every stage.

    Returns:
        The draws, with their diagnostics.

    Raises:
        InputError: for an improper prior, for data that do not depend on a parameter, for a robust loss, and where
            the extra is missing.
    """
    settings = settings or Sampling()
    extra()
    space = fit.fitting.space
    for j, prior in enumerate(priors):
        require_proper(space.names[j], prior, float(space.low[j]), float(space.high[j]))
    require_touched(fit)
    require_normal(fit)
    density = Density(fit, list(priors), settings.discrepancy, settings.between)
    sampled = sample(
        density.potential, *density.start(), settings.chains, settings.draws, settings.warmup, settings.seed, tell
    )
    return finished(fit, density, settings, sampled, tell)


def finished(fit: Fit, density: Density, settings: Sampling, sampled: Sampled, tell: Tell = silent) -> Posterior:
    """What draws say."""
    flat = sampled.v.reshape(-1, density.size)
    unknowns = jax.tree.map(np.asarray, jax.jit(jax.vmap(density.unknowns))(jnp.asarray(flat)))
    shape = sampled.v.shape[:2]
    whole = Unknowns(*(v.reshape(*shape, *v.shape[1:]) for v in unknowns))
    diagnosis = diagnose(density.table(whole), sampled, density.names)
    tell("posterior: scores of the points")
    picks = np.linspace(0, len(flat) - 1, min(EVALUATED, len(flat))).astype(int)
    run = jax.jit(lambda parts: jax.lax.map(lambda one: density.modelled(one, slopes=False), parts))
    modelled = jax.tree.map(np.asarray, run(jnp.asarray(unknowns.parts[picks])))
    found, given = scores(density, modelled.values, modelled.ok, unknowns.sigma[picks], unknowns.delta[picks])
    return Posterior(
        fit, density, settings, sampled, whole, _next(density, whole, settings.seed), diagnosis, found, given
    )


def _next(density: Density, unknowns: Unknowns, seed: int) -> np.ndarray:
    """The parameters of a further specimen: drawn from the population, given each draw of it."""
    x = np.array(unknowns.x)
    if density.specimens:
        z = np.random.default_rng(seed).normal(size=np.shape(unknowns.tau))
        x[..., density.varying] *= np.exp(np.asarray(unknowns.tau) * z)
    return x
