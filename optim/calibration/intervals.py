"""95 % intervals of fitted parameters, three ways, by name.

    gauss_newton    x +- t sd from the covariance (`model.covariance_of`): instant; exact for one curve, a model that is
                    linear over the interval and noise that is normal.
    bootstrap       fits to points drawn with replacement within every curve, percentiles of them (Efron 1979): no
                    normal noise, and no noise that is the same everywhere, is assumed, nor one that is stated. Drawn
                    points scatter less than measured ones, and tell the noise only as well as Student's t has it
                    (Hesterberg 2015): the fits are stretched about the best one by both, see `_stretch`.
    profile         where the best fit with one parameter held costs t^2/2 more (Bates and Watts 1988), t times what the
                    noises' own errors add (`Fit.widening`): follows a model that is not linear, and says where an
                    interval has no end. The cost of a robust loss is
                    no likelihood, and is divided by what it scatters by (Schrader and Hettmansperger 1980).

Each parameter is log or linear as it is varied, so that an interval of a log parameter is never negative.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import stats
from scipy.interpolate import PchipInterpolator

from softgrip_jax.errors import InputError
from softgrip_jax.progress import Tell, silent
from softgrip_jax.spread import Spread

from ..space import to_free
from .fit import CONFIDENCE, ON_BOUND, Fit, run_members
from .model import DETERMINED

METHODS = ("gauss_newton", "bootstrap", "profile")

REPEATS = 1000
"""With so many bootstrap fits the ends of a 95 % interval stand on 25 fits each."""

MIN_CONVERGED = 0.9
"""Where fewer than this part of the bootstrap fits converge, the percentiles mean little, and the report says so."""


@dataclasses.dataclass(frozen=True)
class Intervals:
    """Ends of the intervals, SI; NaN where there is none."""

    method: str
    low: np.ndarray
    high: np.ndarray
    notes: tuple[str, ...] = ()


def intervals(
    fit: Fit,
    method: str,
    repeats: int = REPEATS,
    seed: int = 0,
    report: Tell = silent,
    spread: Spread | None = None,
) -> Intervals:
    """The 95 % intervals of fitted parameters.

    Args:
        fit: the fit.
        method: "gauss_newton" (from the covariance), "profile" (of the likelihood) or "bootstrap".
        repeats: fits of the bootstrap.
        seed: of the bootstrap.
        report: told of every stage.
        spread: who does the fits of the bootstrap in place of this process.

    Returns:
        Their ends, in SI.

    Raises:
        InputError: for another method.

    Source: Seber and Wild 2003; Efron and Tibshirani 1993; Hesterberg 2015, What Teachers Should Know About the
        Bootstrap, The American Statistician 69, 4.2 (how much too narrow plain percentiles are).

    Examples:
        >>> strain = np.linspace(0.1, 1.0, 10)
        >>> stress = 100 * kPa * (1 + strain - (1 + strain) ** -2) * (1 + 1e-3 * np.cos(9 * strain))
        >>> curve = optim.Curve("test", "strip", "stress", "pressure", strain, stress)
        >>> strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
        >>> moduli = [optim.Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
        >>> fit = optim.calibrate(optim.Fitting({"strip": strip}, moduli, [curve]), starts=1)
        >>> ends = optim.intervals(fit, "gauss_newton")
        >>> bool(ends.low[0] < 100 * kPa < ends.high[0])
        True
    """
    if method == "gauss_newton":
        return Intervals(method, fit.low, fit.high)
    if method == "bootstrap":
        return bootstrap(fit, repeats, seed, report, spread)
    if method == "profile":
        return profile(fit, report)
    raise InputError(f"The intervals are {method!r}; they must be one of {', '.join(map(repr, METHODS))}.")


def bootstrap(fit: Fit, repeats: int, seed: int, report: Tell = silent, spread: Spread | None = None) -> Intervals:
    """Percentiles of fits to resampled points, stretched about the fit; noises stay as in the fit."""
    nothing = np.full(fit.fitting.space.size, np.nan)
    stretch = _stretch(fit)
    if not np.all(np.isfinite(stretch)):
        return Intervals("bootstrap", nothing, nothing, (TOO_FEW,))
    draws = bootstrap_fits(fit, repeats, seed, report, spread)
    kept = draws[np.all(np.isfinite(draws), axis=1)]
    notes = []
    if len(kept) < MIN_CONVERGED * repeats:
        notes.append(f"Only {len(kept)} of {repeats} bootstrap fits converged: its intervals mean little.")
    if len(kept) < 2:
        return Intervals("bootstrap", nothing, nothing, tuple(notes))
    tail, space = 0.5 * (1 - CONFIDENCE), fit.fitting.space
    changes = np.quantile(fit.change_to(kept), [tail, 1 - tail], axis=0)
    t = space.to_unit(fit.shifted(changes))
    held = (t < ON_BOUND) | (t > 1 - ON_BOUND)
    for side, ends in zip(("below", "above"), held, strict=True):
        for j in np.flatnonzero(ends):
            notes.append(
                f"{space.names[j]}: the bootstrap sets no end to its interval {side}: its fits are on a bound."
            )
    low, high = np.where(held, np.nan, fit.shifted(stretch * changes))
    return Intervals("bootstrap", low, high, tuple(notes))


TOO_FEW = "The bootstrap has no intervals: no curve that tells a parameter has two points to draw from."


def _stretch(fit: Fit) -> np.ndarray:
    """How much further measured points scatter every parameter than drawn ones; inf where drawn ones do not at all.

    With J_k the derivatives of the weighted residuals of curve k, J those of all curves, h the leverages of the points,
    C = (J^T J)^-1 and A_k = J_k^T J_k, a linear model with normal noise has covariance C, and its fits to drawn points
    have on the average

        C (sum_i (1 - h_i) J_i J_i^T - sum_k (A_k - A_k C A_k) / n_k) C

    The ratio of the deviations is times Student's t over the normal quantile, with every noise taken as estimated, and
    times what the noises' own errors add, as drawn points are fitted with the noises of the fit.
    """
    rows, of_curve = fit.rows, fit.fitting.of_curve
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    told = s > DETERMINED * s.max()
    u, back = u * told, vt.T * np.where(told, 1 / np.where(told, s, 1.0), 0.0)
    drawn = (u * (1 - np.sum(u**2, axis=1))[:, None]).T @ u
    for k in range(len(fit.fitting.curves)):
        own = (of_curve == k) & fit.used
        B = u[own].T @ u[own]
        drawn -= (B - B @ B) / max(int(own.sum()), 1)
    variance, of_drawn = np.sum(back**2, axis=1), np.einsum("ij,jk,ik->i", back, drawn, back)
    t = fit.quantiles(np.eye(len(variance)), stated=False)
    scatters = of_drawn > ROUNDING * variance
    ratio = np.divide(variance, of_drawn, out=np.full(len(variance), np.inf), where=scatters)
    return fit.widening * np.sqrt(ratio) * t / stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)


ROUNDING = 1e-9
"""Fits to drawn points that scatter by less than this part of the variance do not scatter."""


def bootstrap_fits(
    fit: Fit, repeats: int, seed: int, report: Tell = silent, spread: Spread | None = None
) -> np.ndarray:
    """Parameters (SI) of every bootstrap fit, one row each; NaN where one did not converge."""
    fitting, rng = fit.fitting, np.random.default_rng(seed)
    weight = np.asarray(fit.member.weight)
    start = jnp.asarray(_start(fit, fit.x))
    members = []
    for _ in range(repeats):
        drawn = np.zeros_like(weight)
        for k in range(len(fitting.curves)):
            own = np.flatnonzero((fitting.of_curve == k) & (weight > 0))
            if own.size:
                drawn += np.bincount(rng.choice(own, own.size), minlength=len(weight))
        members.append(fit.member._replace(start=start, weight=jnp.asarray(drawn)))
    ends = run_members(fitting, members, "bootstrap", report, spread)
    return np.where(ends.converged[:, None], ends.x, np.nan)


STEPS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Standard deviations at which the profile is first looked at."""

REFINED = 5
"""Points of the second look, around the crossing: the interval is then good to a thousandth of its width."""


def profile(fit: Fit, report: Tell = silent) -> Intervals:
    """Profile likelihood: the root of the added cost, z of `_roots`, crosses the quantile."""
    n = fit.fitting.space.size
    low, high = np.full(n, np.nan), np.full(n, np.nan)
    notes = []
    for j in range(n):
        name = fit.fitting.space.names[j]
        report("profile", j, n)
        for sign, ends in ((-1, low), (1, high)):
            found = _crossing(fit, j, sign)
            ends[j] = found
            if np.isnan(found):
                side = "below" if sign < 0 else "above"
                notes.append(f"{name}: the data set no end to its interval {side} within its bounds.")
    return Intervals("profile", low, high, tuple(notes))


def _crossing(fit: Fit, j: int, sign: int) -> float:
    """The value of parameter j (SI) where its profile crosses, on one side; NaN where it does not within the bounds."""
    space = fit.fitting.space
    quantile = fit.quantile[j] * fit.widening[j]
    edge = space.high[j] if sign > 0 else space.low[j]
    log = bool(space.is_log[j])
    room = abs(np.log(edge / fit.x[j]) if log else (edge - fit.x[j]) / fit.scales[j])
    sd, room = min(fit.deviation[j], room), room * (1 - 1e-6)
    steps = np.unique(np.minimum(np.array([0.0, *STEPS]) * sd, room))
    z = _roots(fit, j, sign * steps)
    if not np.any(z > quantile) and 0 < steps[-1] < room:
        # Nothing yet, so on to the bound, twice as far each time.
        doublings = np.arange(1, 1 + np.ceil(np.log2(room / steps[-1])))
        more = np.minimum(steps[-1] * 2.0**doublings, room)
        steps, z = np.append(steps, more), np.append(z, _roots(fit, j, sign * more))
    known = np.isfinite(z)
    steps, z = steps[known], z[known]
    for _ in range(2):
        over = np.flatnonzero(z > quantile)
        if not over.size:
            break
        k = int(over[0])
        more = np.linspace(steps[k - 1], steps[k], REFINED + 2)[1:-1]
        steps, z = np.append(steps, more), np.append(z, _roots(fit, j, sign * more))
        order = np.argsort(steps)
        steps, z = steps[order], np.maximum.accumulate(z[order])
    over = np.flatnonzero(z > quantile)
    if not over.size:
        return np.nan
    rising = np.concatenate([[True], np.diff(z) > 0])
    return float(fit.shifted(sign * float(PchipInterpolator(z[rising], steps[rising])(quantile)))[j])


def _roots(fit: Fit, j: int, changes: np.ndarray) -> np.ndarray:
    """sqrt(2 (cost - best) / c) with parameter j held at changes of its scaled value, and c of a robust loss
    (`Fit.robust_factors`)."""
    free = np.arange(fit.fitting.space.size) != j
    members = []
    for change in changes:
        x = fit.shifted(np.where(free, 0.0, change))
        start = np.where(free, _start(fit, fit.x), np.asarray(to_free(fit.fitting.space.to_unit(x))))
        members.append(fit.member._replace(start=jnp.asarray(start), free=jnp.asarray(free)))
    added = np.asarray(run_members(fit.fitting, members).cost) - fit.cost
    return np.sqrt(2 * np.maximum(added, 0) / float(fit.robust_factors.cost))


def _start(fit: Fit, x: Any) -> np.ndarray:
    return np.asarray(to_free(fit.fitting.space.inside(fit.fitting.space.to_unit(x))))
