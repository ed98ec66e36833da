"""Parameters from measured curves: the best fit, the noise, what is left out, and what each curve says of the others.

>>> fit = calibrate(Fitting(models, variables, curves))
>>> print(fit.x, fit.low, fit.high)

The steps: several starts, the best of them; noises that are not stated estimated and the fit repeated with them until
they converge (iterated weighted least squares); points at the limit of the model put to the test and left out where
they have no equilibrium; covariance. The fit is compiled once, and every later one (bootstrap, profile, a curve or a
specimen alone) shares the program. On a CPU the fits run one after the other, which was up to twice as fast as under
vmap: a fit is already a batch over its points, and none waits for the slowest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats
from scipy.stats import qmc

from softgrip_jax.errors import InputError
from softgrip_jax.progress import Tell, silent
from softgrip_jax.spread import Spread
from softgrip_jax.units import DISPLAY

from ..problem import NEAR_LIMIT
from ..space import to_free, to_unit
from .model import DETERMINED, FitMember, Fitted, Fitting, Predicted, RobustFactors, inverse_square, leverage

CONFIDENCE = 0.95
"""Confidence of every interval."""

STARTS = 8
"""Fits that are tried: from the values as given, and from a Sobol set between the bounds."""

NOISE_ROUNDS, NOISE_CONVERGED = 30, 1e-4
"""Estimated noises have converged when they change by less than this part of themselves, usually within ten rounds."""

ON_BOUND = 1e-3
"""A parameter this near to a bound (of its range) is held by it."""

A_CALL, AT_ONCE = 10, 400
"""Fits that a worker does in one call, and that are handed out between two reports."""

SAME_COST = 1e-6
"""Two starts have found equally good fits when their costs differ by less, relatively."""

SAME_PARAMETERS = 1e-2
"""Two starts have found the same fit when no parameter differs by more, relative to its size."""


@dataclasses.dataclass(frozen=True)
class Fit:
    """A finished fit.

    Arrays of parameters are in the order of `fitting.space.names`, arrays of points in that of the curves.

    Args:
        fitting: models, parameters and curves.
        member: the data with the weights and noises of the last fit; its `start` is where it ended.
        predicted: what the models say there.
        x: the parameters, in SI, shape (n,).
        scales: a change of a parameter times its scale is in SI; log parameters scale with their value; shape (n,).
        covariance: of the scaled parameters, dimensionless, shape (n, n).
        cost: half the sum of squares of the weighted residuals, dimensionless.
        steps: of the last fit.
        notes: what was left out or looks odd, in sentences.

    Examples:
        >>> strain = np.linspace(0.1, 1.0, 10)
        >>> stress = 100 * kPa * (1 + strain - (1 + strain) ** -2) * (1 + 1e-3 * np.cos(9 * strain))
        >>> curve = optim.Curve("test", "strip", "stress", "pressure", strain, stress)
        >>> strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
        >>> moduli = [optim.Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
        >>> fit = optim.calibrate(optim.Fitting({"strip": strip}, moduli, [curve]), starts=1)
        >>> bool(fit.low[0] < 100 * kPa < fit.high[0])
        True
    """

    fitting: Fitting
    member: FitMember
    predicted: Predicted
    x: np.ndarray
    scales: np.ndarray
    covariance: np.ndarray
    cost: float
    steps: int
    notes: tuple[str, ...]

    @property
    def used(self) -> np.ndarray:
        """Points that were fitted."""
        return np.asarray(self.member.weight) > 0

    @property
    def freedom(self) -> int:
        """Points less parameters."""
        return int(self.used.sum()) - self.fitting.space.size

    @property
    def freedoms(self) -> np.ndarray:
        """Of every curve, points less what it has of the parameters (the sum of its leverages), shape (curves,)."""
        weight = np.asarray(self.member.weight) * np.asarray(self.predicted.response.ok)
        left = weight - np.asarray(leverage(jnp.asarray(self.rows)))
        return np.bincount(self.fitting.of_curve, left, len(self.fitting.curves))

    @property
    def unsure(self) -> np.ndarray:
        """One over the degrees of freedom of the noise of every curve, 0 of one that states it, shape (curves,)."""
        free = self.freedoms
        return np.where(self.fitting.known | ~(free > 0), 0.0, 1 / np.where(free > 0, free, 1.0))

    @property
    def quantile(self) -> np.ndarray:
        """Standard deviations on each side of every parameter's interval, shape (n,)."""
        return self.quantiles(np.eye(self.fitting.space.size))

    @property
    def robust_factors(self) -> RobustFactors:
        """What a robust loss makes of the covariance and of the cost."""
        response, sigma = self.predicted.response, np.asarray(self.member.sigma)[self.fitting.of_curve]
        weight = np.asarray(self.member.weight) * np.asarray(response.ok)
        r = np.where(weight > 0, (np.asarray(response.values) - self.fitting.y) / sigma, 0.0)
        fitted = jnp.sum(leverage(jnp.asarray(self.rows)))
        return self.fitting.robust_factors(jnp.asarray(r), jnp.asarray(weight), fitted)

    @property
    def rows(self) -> np.ndarray:
        """Derivatives of the weighted residuals by the scaled parameters; zero of points and parameters that are held
        out of the fit."""
        weight = np.asarray(self.member.weight) * np.asarray(self.predicted.response.ok)
        slopes = np.asarray(self.predicted.slopes) * self.scales * np.asarray(self.member.free)
        scale = np.sqrt(weight) / np.asarray(self.member.sigma)[self.fitting.of_curve]
        return np.where(weight > 0, slopes.T * scale, 0.0).T

    def quantiles(self, along: np.ndarray, variance: np.ndarray | None = None, stated: bool = True) -> np.ndarray:
        """Standard deviations on each side of the interval of combinations of the scaled parameters, one per row.

        Normal where every noise is stated and the loss is linear, else Student's t. Each noise that is estimated is
        known as well as its own curve tells it: the degrees of freedom are Welch's and Satterthwaite's for the curves'
        parts of the variance. With a robust loss the errors of all points tell the variance of curves with a stated
        noise, too.
        variance: of every combination, where more is behind it than the noise of the curves.
        stated: False takes noises that are stated as estimated, too.
        """
        fitting = self.fitting
        known = fitting.known & stated
        of_curve = np.arange(len(fitting.curves))[:, None] == fitting.of_curve
        free = self.freedoms
        factor = float(self.robust_factors.covariance)
        parts = factor * (along @ np.linalg.pinv(self.rows, rcond=DETERMINED)) ** 2 @ of_curve.T
        unsure = np.where(known, 0.0, parts**2 / np.maximum(free, 1.0)).sum(axis=1)
        if fitting.loss != "linear":
            unsure += parts[:, known].sum(axis=1) ** 2 / max(free.sum(), 1.0)
        whole = parts.sum(axis=1) if variance is None else variance
        freedom = np.divide(whole**2, unsure, out=np.full(len(along), np.inf), where=unsure > 0)
        return stats.t.ppf(0.5 + 0.5 * CONFIDENCE, freedom)

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviations of the scaled parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def widening(self) -> np.ndarray:
        """How many times further every parameter scatters than with weights by the true noises, shape (n,)."""
        sure = inverse_square(jnp.asarray(self.rows)) * self.robust_factors.covariance
        return self.deviation / np.sqrt(np.diag(sure))

    @property
    def correlation(self) -> np.ndarray:
        """Of the parameters."""
        return self.covariance / np.outer(self.deviation, self.deviation)

    def shifted(self, change: Any) -> np.ndarray:
        """The parameters in SI after a change of the scaled ones: log parameters grow by its exponential."""
        with np.errstate(over="ignore"):
            return np.where(self.fitting.space.is_log, self.x * np.exp(change), self.x + self.scales * change)

    def change_to(self, x: np.ndarray) -> np.ndarray:
        """The change of the scaled parameters that leads to others (SI, one row each); undone by `shifted`."""
        log = self.fitting.space.is_log
        return np.where(log, np.log(np.where(log, x / self.x, 1.0)), (x - self.x) / self.scales)

    @property
    def low(self) -> np.ndarray:
        """Lower ends of the Gauss-Newton intervals, SI."""
        return self.shifted(-self.quantile * self.deviation)

    @property
    def high(self) -> np.ndarray:
        """Upper ends of the Gauss-Newton intervals, SI."""
        return self.shifted(self.quantile * self.deviation)

    @property
    def on_bound(self) -> np.ndarray:
        """Parameters that are held by one of their bounds."""
        t = self.fitting.space.to_unit(self.x)
        return (t < ON_BOUND) | (t > 1 - ON_BOUND)

    @property
    def errors(self) -> np.ndarray:
        """Model less measurement at every point, SI; NaN where the model has no answer."""
        response = self.predicted.response
        return np.where(response.ok, np.asarray(response.values) - self.fitting.y, np.nan)

    def rmse(self, k: int) -> float:
        """Root mean square error of a curve in SI, over the points that were used (all, of one that was not fitted)."""
        of = self.fitting.of_curve == k
        of &= self.used | (not self.fitting.curves[k].fit)
        errors = self.errors[of]
        errors = errors[np.isfinite(errors)]
        return float(np.sqrt(np.mean(errors**2))) if errors.size else np.nan

    def chi_square(self, k: int) -> float:
        """Mean square of error over stated noise, of a curve: 1 where the model is right and the noise is too."""
        return (self.rmse(k) / float(self.member.sigma[k])) ** 2

    def modules(self) -> dict[str, Any]:
        """The models, as they were given, with the fitted parameters."""
        return self.fitting.given.scenes_at(jnp.asarray(self.x))

    def band(self, k: int, n: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(x, fit, half width of its 95 % interval) of a curve at n points or more, in SI; NaN beyond the limit.

        The interval is that of the fitted line (from the covariance), not of a further measurement.
        """
        fitting, curve = self.fitting, self.fitting.curves[k]
        of = fitting.of_curve == k
        size = len(fitting.xs[curve.model])
        parts = -(-n // size)
        low = 0.0 if curve.quantity == "stress" else min(float(curve.x.min()), 0.05 * float(curve.x.max()))
        grid = np.linspace(low, float(curve.x.max()), parts * size)
        order = np.full(size, -1)
        order[np.searchsorted(fitting.xs[curve.model], curve.x)] = np.flatnonzero(of)
        seen, rows = order >= 0, order[order >= 0]
        x, y, half = [], [], []
        # The compiled program takes as many points as were measured: a finer grid goes through it in parts.
        for part in grid.reshape(parts, size):
            response, slopes, _ = fitting.predict_at(self.x, **{curve.model: part})
            scaled = np.asarray(slopes)[rows] * self.scales
            spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", scaled, self.covariance, scaled), 0))
            ok = np.asarray(response.ok)[rows]
            x.append(part[seen])
            y.append(np.where(ok, np.asarray(response.values)[rows], np.nan))
            half.append(np.where(ok, self.quantiles(scaled) * spread, np.nan))
        return np.concatenate(x), np.concatenate(y), np.concatenate(half)


def run_members(
    fitting: Fitting,
    members: Sequence[FitMember],
    stage: str = "",
    report: Tell = silent,
    spread: Spread | None = None,
) -> Fitted:
    """Many fits, stacked, by the one compiled program; `report` is told the stage and how many are done. spread: who
    fits in place of this process, with the same program."""
    ends = []
    if spread is not None:
        with spread.on(_fitter, fitting) as calls:
            for start in range(0, len(members), AT_ONCE):
                report(stage, start, len(members))
                part = [jax.tree.map(np.asarray, member) for member in members[start : start + AT_ONCE]]
                ends += [
                    end
                    for found in calls([(part[k : k + A_CALL],) for k in range(0, len(part), A_CALL)])
                    for end in found
                ]
        members = []
    for k, member in enumerate(members):
        report(stage, k, len(members))
        ends.append(jax.block_until_ready(fitting.fit_member_jit(member)))
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(v) for v in leaves]), *ends)


def _fitter(fitting: Fitting) -> Callable[[list[FitMember]], list[Fitted]]:
    """What a worker calls: some of many fits."""
    return lambda members: [jax.tree.map(np.asarray, fitting.fit_member_jit(member)) for member in members]


def calibrate(
    fitting: Fitting,
    starts: int = STARTS,
    seed: int = 0,
    report: Tell = silent,
    canonical: Callable[[np.ndarray], np.ndarray] = lambda x: x,
) -> Fit:
    """The best fit of models to measured curves.

    It minimises the sum of squares of (model - measurement) / noise, with the loss of the fitting, from several starts
    by Levenberg and Marquardt's method.

    Args:
        fitting: models, parameters and curves.
        starts: number of starts, the given parameters first.
        seed: of the others, a Sobol set.
        report: told of every stage.
        canonical: gives parameters (SI) that describe the same model, such as terms of a sum in another order, one
            form.

    Returns:
        The fit, with the covariance of its parameters.

    Raises:
        InputError: where the data cannot give a fit.

    Examples:
        >>> strain = np.linspace(0.1, 1.0, 10)
        >>> stress = 100 * kPa * (1 + strain - (1 + strain) ** -2)  # Treloar's uniaxial tension
        >>> curve = optim.Curve("test", "strip", "stress", "pressure", strain, stress)
        >>> strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
        >>> moduli = [optim.Variable("material.mu", 10 * kPa, 1000 * kPa, "log")]
        >>> fit = optim.calibrate(optim.Fitting({"strip": strip}, moduli, [curve]), starts=1)
        >>> print(f"{fit.x[0] / kPa:.4f} kPa")
        100.0000 kPa
    """
    require_data(fitting)
    space = fitting.space
    home = space.inside(space.to_unit(space.reference))
    cloud = qmc.Sobol(space.size, rng=seed).random_base2(int(np.ceil(np.log2(starts)))) if starts > 1 else []
    units = np.array([home, *cloud])[:starts]
    members = [fitting.member(to_free(space.inside(t))) for t in units]
    tried = run_members(fitting, members, "compiling once, then fits from several starts", report)
    best = int(np.argmin(np.where(np.isfinite(tried.cost), tried.cost, np.inf)))
    member = members[best]._replace(start=jnp.asarray(off_bounds(fitting, tried.u[best])))
    notes = _other_minima(fitting, tried, best, canonical)
    report("noise")
    member, dropped = reached(fitting, member, space.size)
    return finished(fitting, member, (*notes, *dropped))


def reached(fitting: Fitting, member: FitMember, parameters: int) -> tuple[FitMember, list[str]]:
    """The member with its noises, without the points that the model does not reach, and sentences about them.

    Raises:
        InputError: where too few are left for so many parameters.
    """
    asked = int(np.asarray(member.weight).sum())
    given = with_noise(fitting, member)
    member, dropped = _without_lost_points(fitting, given)
    if dropped:
        member, dropped = _without_what_ends_it(fitting, given, member, dropped)
    left = int(member.weight.sum())
    if left <= parameters:
        why = implausible(fitting) or ["where the fit ends the others lie beyond the limit point of the model."]
        raise InputError(f"{left} of {asked} points have an equilibrium within the bounds, too few for a fit: {why[0]}")
    if 2 * left < asked:
        dropped.append(
            f"The model reaches {left} of {asked} points: the fit stands on the smaller part of what was measured, "
            "next to where the model ends, and its intervals say nothing of that."
        )
    return member, dropped


def finished(fitting: Fitting, member: FitMember, notes: Sequence[str] = ()) -> Fit:
    """The last fit from where the member starts, with its statistics."""
    end = fitting.fit_member_jit(member)
    member = member._replace(start=end.u)
    predicted = fitting.predict_at(end.x)
    scales = fitting.scales(end.x)
    found = fitting.statistics(predicted, member, scales)
    if not bool(end.converged):
        notes = (*notes, f"The fit had not converged after {int(end.steps)} steps.")
    return Fit(
        fitting,
        member,
        predicted,
        np.asarray(end.x),
        np.asarray(scales),
        np.asarray(found.covariance),
        float(end.cost),
        int(end.steps),
        tuple(notes),
    )


def require_data(fitting: Fitting) -> None:
    """A ValueError where there are too few points."""
    n = fitting.space.size
    points = int(np.sum(fitting.weight))
    if points == 0:
        raise InputError("No curve is fitted; leave out fit = false for at least one.")
    if points <= n:
        count = f"{points} point" + ("" if points == 1 else "s")
        raise InputError(
            f"There {'is' if points == 1 else 'are'} {count} for {n} parameter{'' if n == 1 else 's'}; "
            "more points than parameters are needed."
        )
    for curve in fitting.curves:
        if curve.fit and curve.noise is None and len(curve.x) < 3:
            raise InputError(
                f"Curve {curve.name!r} has {len(curve.x)} point{'' if len(curve.x) == 1 else 's'}, too few to estimate "
                "its noise; state it (in a config: noise, in the curve's measured)."
            )


def with_noise(fitting: Fitting, member: FitMember) -> FitMember:
    """The member with its noises estimated where they are not stated, and started where its fit ends."""
    for _ in range(NOISE_ROUNDS):
        end = fitting.fit_member_jit(member)
        member = member._replace(start=end.u)
        predicted = fitting.predict_at(end.x)
        sigma = fitting.statistics(predicted, member, fitting.scales(end.x)).sigma
        change = float(jnp.max(jnp.abs(sigma / member.sigma - 1)))
        member = member._replace(sigma=sigma)
        if change < NOISE_CONVERGED:
            break
    return member


def _without_lost_points(fitting: Fitting, member: FitMember) -> tuple[FitMember, list[str]]:
    """The member without the points that have no equilibrium at its best fit, and a sentence per curve about them.

    A point just below the limit may hold the fit there: a little softer, and it would have no equilibrium, which costs
    more than any misfit. Whether it does is asked by a fit without it: where that fit leaves it without equilibrium it
    is a point that the model does not reach, and it is left out; where not, it stays.
    """
    left_out = np.zeros(len(fitting.y), dtype=bool)
    while True:
        response = fitting.predict_at(fitting.space.from_unit(to_unit(member.start))).response
        weight = np.asarray(member.weight)
        near = (weight > 0) & (~np.asarray(response.ok) | (np.asarray(response.share) > NEAR_LIMIT))
        if not near.any() or (weight * ~near).sum() <= fitting.space.size:
            lost = (weight > 0) & ~np.asarray(response.ok)
            left_out |= lost
            member = member._replace(weight=jnp.asarray(weight * ~lost))
            break
        trial = with_noise(fitting, member._replace(weight=jnp.asarray(weight * ~near)))
        there = fitting.predict_at(fitting.space.from_unit(to_unit(trial.start))).response
        lost = near & ~np.asarray(there.ok)
        if not lost.any():
            break
        left_out |= lost
        member = with_noise(fitting, trial._replace(weight=jnp.asarray(weight * ~lost)))
    notes = []
    for k, curve in enumerate(fitting.curves):
        lost = left_out & (fitting.of_curve == k)
        if lost.any():
            unit, value = DISPLAY["pressure"]
            count = f"{lost.sum()} of {len(curve.x)} points"
            notes.append(
                f"{curve.name}: {count}, from {fitting.x[lost].min() / value:.4g} {unit} on, left out: the model ends "
                "below them (limit point)."
                if curve.quantity != "stress"
                else f"{curve.name}: {count} left out: the material does not reach their strain."
            )
    return member, notes


def _without_what_ends_it(
    fitting: Fitting, given: FitMember, member: FitMember, dropped: list[str]
) -> tuple[FitMember, list[str]]:
    """The member where points were lost, or a fit that reaches more of them without those that hold it at its limit.

    A value far too large is met by a model next to its limit point, whatever lies beyond; and next to it the slopes are
    so large that the interval would be nothing.
    """
    response = fitting.predict_at(fitting.space.from_unit(to_unit(member.start))).response
    weight, kept = np.asarray(given.weight), np.asarray(member.weight)
    held = (kept > 0) & (np.asarray(response.share) > NEAR_LIMIT)
    if not held.any() or (weight * ~held).sum() <= fitting.space.size:
        return member, dropped
    freed = with_noise(fitting, given._replace(weight=jnp.asarray(weight * ~held)))
    trial, notes = _without_lost_points(fitting, freed)
    if int(trial.weight.sum()) <= int(member.weight.sum()):
        return member, dropped
    more = int(trial.weight.sum()) - int((kept * ~held).sum())
    for k, curve in enumerate(fitting.curves):
        own = held & (fitting.of_curve == k)
        if own.any():
            unit, value = curve.unit
            beside, size = ("", 1.0) if curve.quantity == "stress" else (" kPa", DISPLAY["pressure"][1])
            there = ", ".join(
                f"{y / value:.4g} {unit} at {x / size:.4g}{beside}"
                for x, y in zip(fitting.x[own], fitting.y[own], strict=True)
            )
            notes.append(
                f"{curve.name}: left out {there}: with that the model ends below {more} of the other points; is it an "
                "outlier?"
            )
    return trial, notes


def off_bounds(fitting: Fitting, u: Any) -> np.ndarray:
    """A start for further fits: free values off the bounds, where the sine map passes no gradient."""
    return np.asarray(to_free(fitting.space.inside(np.asarray(to_unit(jnp.asarray(u))))))


def _other_minima(
    fitting: Fitting, tried: Fitted, best: int, canonical: Callable[[np.ndarray], np.ndarray]
) -> list[str]:
    """A sentence where other starts ended in a fit nearly as good at other parameters.

    Whether those fits have converged does not matter: on the floor of a valley none may, and all of it is equally good.
    """
    close = tried.cost <= tried.cost[best] * (1 + SAME_COST) + SAME_COST
    x = np.array([canonical(row) for row in tried.x[close]]).reshape(-1, fitting.space.size)
    apart = (x - canonical(tried.x[best])) / fitting.sizes_of(tried.x[best])
    if np.max(np.abs(apart), initial=0.0) > SAME_PARAMETERS:
        return [
            "Fits from different starts are equally good at different parameters: the data do not tell these "
            "parameters apart."
        ]
    return []


def implausible(fitting: Fitting) -> list[str]:
    """Sentences about curves whose pressures or values are far from the model at the values as given: a wrong unit?"""
    said = []
    response = fitting.predict_at(fitting.space.reference).response
    for k, curve in enumerate(fitting.curves):
        of = fitting.of_curve == k
        share = np.asarray(response.share)[of]
        if np.median(share) > WRONG_UNIT:
            said.append(
                f"{curve.name}: the pressures are about {_round(np.median(share))} times the largest that the "
                "model holds at the values as given; is their unit right?"
            )
            continue
        if np.all(share > 0) and np.max(share) < 1 / WRONG_UNIT:
            said.append(
                f"{curve.name}: the largest pressure is {_round(1 / np.max(share))} times below the limit of the "
                "model at the values as given; is its unit right?"
            )
        values, ok = np.asarray(response.values)[of], np.asarray(response.ok)[of]
        there = ok & (values != 0) & (curve.y != 0)
        if there.any() and np.all(curve.y[there] * values[there] < 0):
            said.append(
                f"{curve.name}: {curve.label} has the other sign than the model's at the values as given; is its "
                "direction right?"
            )
            continue
        if there.any():
            ratio = float(np.median(np.abs(curve.y[there] / values[there])))
            if not 1 / WRONG_UNIT < ratio < WRONG_UNIT:
                said.append(
                    f"{curve.name}: {curve.label} is about {_round(max(ratio, 1 / ratio))} times "
                    f"{'above' if ratio > 1 else 'below'} the model at the values as given; is its unit right?"
                )
    return said


WRONG_UNIT = 30.0
"""A factor that no sensible first guess is wrong by, but a unit (1000, or 100 for cm^2) is."""


def _round(factor: float) -> str:
    return f"{float(f'{factor:.1g}'):g}"
