"""How well a model predicts each point of the data from the others: leave-one-out scores, and models compared by them.

With the draws theta_s of the posterior by all data, the score of a point is (Vehtari, Gelman and Gabry 2017)

    elpd_i = log sum_s w_is p(y_i | theta_s),    w_is ~ 1 / p(y_i | y_-i, theta_s)

with the largest weights smoothed by a Pareto distribution. Its shape k says how far the point moves the posterior; the
score is not to be trusted above 0.7. Given theta the points of a curve are correlated through the model's error, so

    p(y_i | y_-i, theta) = N(y_i - [C^-1 r]_i / [C^-1]_ii,  1 / [C^-1]_ii)           (Burkner, Gabry and Vehtari 2021)
    p(y_i | theta) = N(f_i, sigma^2 + delta^2 size_i^2)

The first takes the weights off, the second scores: what the model alone would say of the point, with its error and
noise, and not what its neighbours say of its error.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.special import logsumexp

from .density import Density
from .sample import extra

ROUGH = 0.7
"""Pareto shapes above this (Vehtari et al. 2024)."""


@dataclasses.dataclass(frozen=True)
class Scores:
    """Leave-one-out scores of the fitted points."""

    points: np.ndarray
    """Their places among all points."""
    elpd: np.ndarray
    """Natural logarithms, of densities in SI."""
    shape: np.ndarray
    """Pareto's k."""

    @property
    def total(self) -> float:
        """Sum of the scores."""
        return float(self.elpd.sum())


def scores(
    density: Density, values: np.ndarray, ok: np.ndarray, sigma: np.ndarray, delta: np.ndarray
) -> tuple[Scores, np.ndarray]:
    """(scores, log p(y_i | y_-i, theta_s) of every draw) of models' values with one row per draw."""
    conditional, alone, points = [], [], []
    for k, one in enumerate(density.errors):
        if not len(one.points):
            continue
        miss = density.fitting.sizes[k] * np.ones_like(values[:, one.points])
        r = np.where(ok[:, one.points], density.y[one.points] - values[:, one.points], miss)
        noise = sigma[:, k] ** 2 + density.floor[k] ** 2
        inverse = 1 / (noise[:, None] + delta[:, k, None] ** 2 * one.lam[None, :])
        weighted = ((r @ one.q) * inverse) @ one.q.T
        diagonal = inverse @ (one.q**2).T
        conditional.append(_log_normal(weighted / diagonal, 1 / diagonal))
        alone.append(_log_normal(r, noise[:, None] + (delta[:, k, None] * one.sizes[None, :]) ** 2))
        points.append(one.points)
    given, score = np.concatenate(conditional, axis=1), np.concatenate(alone, axis=1)
    log_weights, shape = extra().psislw(-given.T)
    elpd = logsumexp(np.asarray(log_weights) + score.T, axis=1)
    return Scores(np.concatenate(points), elpd, np.asarray(shape)), given


def _log_normal(r: np.ndarray, variance: np.ndarray) -> np.ndarray:
    return -0.5 * (r**2 / variance + np.log(2 * np.pi * variance))


def difference(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """(sum of other - one, its standard error) of scores of the same points."""
    apart = other - one
    return float(apart.sum()), float(np.sqrt(len(apart)) * apart.std(ddof=1)) if len(apart) > 1 else np.inf
