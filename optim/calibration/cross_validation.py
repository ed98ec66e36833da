"""Curves and specimens apart: what a fit without one curve says of it, and how far specimens differ."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import stats

from .fit import CONFIDENCE, Fit, off_bounds, run_members
from .model import LEAST_NOISE, NORMAL_MAD, Fitted, inverse_square, leverage

UNLIKELY = 0.01
"""What noise alone does in no more than this part of all cases is not explained by it: a sum of squares of errors, or
specimens as far apart."""


def held_out(fit: Fit) -> dict[str, tuple[np.ndarray, float]]:
    """For each fitted curve, where there are several: (parameters without it in SI, RMSE of its prediction in SI).

    A parameter that no other curve depends on stays where it is in the whole fit.
    """
    fitting = fit.fitting
    fitted = [k for k, c in enumerate(fitting.curves) if c.fit]
    if len(fitted) < 2:
        return {}
    found = {}
    for k in fitted:
        kept = np.asarray(fit.member.weight) * (fitting.of_curve != k)
        member = fit.member._replace(start=jnp.asarray(off_bounds(fitting, fit.member.start)), weight=jnp.asarray(kept))
        end = fitting.fit_member_jit(member)
        response = fitting.predict_at(end.x).response
        errors = np.where(response.ok, np.asarray(response.values) - fitting.y, np.nan)[fitting.of_curve == k]
        errors = errors[np.isfinite(errors)]
        rmse = float(np.sqrt(np.mean(errors**2))) if errors.size else np.nan
        found[fitting.curves[k].name] = (np.asarray(end.x), rmse)
    return found


@dataclasses.dataclass(frozen=True)
class Specimens:
    """Each specimen fitted alone: how far they differ, and whether the noise alone explains that."""

    names: tuple[str, ...]
    x: np.ndarray
    """Parameters, one row per specimen, SI."""
    low: np.ndarray
    """95 % interval of the mean of all such specimens (Student's t over the specimens), SI."""
    high: np.ndarray
    chance: np.ndarray
    """Of each parameter: how likely noise alone sets its values at least as far apart."""
    chance_together: float
    """The same of all parameters at once: several may differ together of which none differs alone."""

    @property
    def differ(self) -> np.ndarray:
        """Parameters whose values differ by more than the noise explains."""
        return self.chance < UNLIKELY

    @property
    def differ_together(self) -> bool:
        """Whether all parameters together differ by more than the noise explains, though none does alone."""
        return len(self.chance) > 1 and not self.differ.any() and self.chance_together < UNLIKELY


def by_specimen(fit: Fit) -> Specimens | None:
    """A fit per specimen, where there are several and each has more points than there are parameters."""
    fitting = fit.fitting
    labels = np.concatenate([curve.labels for curve in fitting.curves])
    fitted = np.asarray(fit.member.weight)
    names = [name for name in dict.fromkeys(labels) if name and fitted[labels == name].any()]
    weights = [fitted * (labels == name) for name in names]
    if len(names) < 2 or min(w.sum() for w in weights) <= fitting.space.size:
        return None
    start = jnp.asarray(off_bounds(fitting, fit.member.start))
    ends = run_members(fitting, [fit.member._replace(start=start, weight=jnp.asarray(w)) for w in weights])
    log = fitting.space.is_log
    z = np.where(log, np.log(np.where(log, ends.x, 1.0)), ends.x)
    half = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, len(names) - 1) * z.std(axis=0, ddof=1) / np.sqrt(len(names))
    low, high = z.mean(axis=0) - half, z.mean(axis=0) + half
    chances = _chances(fit, weights, ends)
    with np.errstate(over="ignore"):
        low, high = np.where(log, np.exp(low), low), np.where(log, np.exp(high), high)
    return Specimens(tuple(names), ends.x, low, high, *chances)


def _chances(fit: Fit, weights: list[np.ndarray], ends: Fitted) -> tuple[np.ndarray, float]:
    """How likely noise alone sets the specimens' values as far apart: of each parameter, and of all together.

    With the values z_s of S specimens, their covariances V_s by the noise, and the mean weighted by these,

        Q = sum_s (z_s - mean)^T V_s^-1 (z_s - mean)

    of one parameter, with its own variance in V_s, is chi-squared with S - 1 degrees of freedom where the noise is
    stated; where it is estimated with nu degrees of freedom, Q / (S - 1) has the F distribution (Cochran 1954). All n
    parameters together have n (S - 1) degrees. The noise is that within the specimens, each about its own fit: that of
    the fit to all of them contains what they differ by.
    """
    fitting, count = fit.fitting, len(weights)
    log, scales = fitting.space.is_log, np.asarray(fitting.scales(fit.x))
    z = np.where(log, np.log(np.where(log, ends.x, 1.0)), ends.x / scales)
    ok = np.asarray(ends.predicted.response.ok)
    kept = np.array(weights) * ok
    slopes = np.where(kept[..., None] > 0, ends.predicted.slopes, 0.0) * np.where(log, ends.x, scales)[:, None, :]
    errors = np.where(kept > 0, np.asarray(ends.predicted.response.values) - fitting.y, 0.0)
    sigma, freedom = _noise_within(fit, kept, slopes, errors)
    at = sigma[fitting.of_curve]
    J = slopes * (np.sqrt(kept) / at)[..., None]
    fitted = [jnp.sum(leverage(jnp.asarray(one))) for one in J]
    factors = [fitting.robust_factors(*map(jnp.asarray, (errors[s] / at, kept[s], fitted[s]))) for s in range(count)]
    J = J / np.sqrt([one.covariance for one in factors])[:, None, None]
    variance = np.array([np.diag(inverse_square(jnp.asarray(one))) for one in J])

    def chance(Q: Any, parameters: int) -> Any:
        between = parameters * (count - 1)
        return stats.f.sf(Q / between, between, freedom) if np.isfinite(freedom) else stats.chi2.sf(Q, between)

    mean = np.sum(z / variance, axis=0) / np.sum(1 / variance, axis=0)
    alone = chance(np.sum((z - mean) ** 2 / variance, axis=0), 1)
    W = np.swapaxes(J, 1, 2) @ J
    middle = np.linalg.pinv(W.sum(axis=0), hermitian=True) @ np.einsum("sij,sj->i", W, z)
    together = np.sum(np.einsum("skj,sj->sk", J, z - middle) ** 2)
    return alone, float(chance(together, fitting.space.size))


def _noise_within(fit: Fit, kept: np.ndarray, slopes: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, float]:
    """(noise of every curve, SI, from the errors of each specimen about its own fit; degrees of freedom that it is
    estimated with, inf where it is stated)."""
    fitting = fit.fitting
    known, robust = np.asarray(fit.member.sigma), fitting.loss != "linear"
    weighted = slopes * (np.sqrt(kept) / known[fitting.of_curve])[..., None]
    left = kept - np.array([np.asarray(leverage(jnp.asarray(one))) for one in weighted])
    sigma, total = known.copy(), 0.0
    for k in range(len(fitting.curves)):
        own = kept * (fitting.of_curve == k) > 0
        freedom = float(left[own].sum())
        if fitting.known[k] or not freedom > 0:
            continue
        mean = np.sum(kept[own] * errors[own] ** 2) / freedom
        if robust:
            mean = (NORMAL_MAD * np.median(np.abs(errors[own]))) ** 2 * kept[own].sum() / freedom
        sigma[k] = max(np.sqrt(mean), LEAST_NOISE * fitting.sizes[k])
        total += freedom
    return sigma, max(total, 1.0) if total else np.inf
