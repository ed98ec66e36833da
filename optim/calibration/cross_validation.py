"""Curves and specimens apart: what a fit without one curve says of it, and how far specimens differ."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from scipy import stats

from .fit import CONFIDENCE, Fit, off_bounds, run_members


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
    """Each specimen fitted alone: how far they differ."""

    names: tuple[str, ...]
    x: np.ndarray
    """Parameters, one row per specimen, SI."""
    low: np.ndarray
    """95 % interval of the mean of all such specimens (Student's t over the specimens), SI."""
    high: np.ndarray


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
    with np.errstate(over="ignore"):
        return Specimens(tuple(names), ends.x, np.where(log, np.exp(low), low), np.where(log, np.exp(high), high))
