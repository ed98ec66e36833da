"""From the designs of a nominal search to robust ones.

The best nominal designs, and a few points of the box, are improved in step by sequential quadratic programming, with
what is wanted of all parts as objective and constraints. The smoothed edge of a yield is narrowed from WIDTHS[0] to
WIDTHS[-1], of the spread of the worst requirement, each stage beginning where the last one ended.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from ..design.finish import Lost, boxed, in_step, on_bounds, remembered
from .evaluate import Answer, Error, Wants

WIDTHS = (0.5, 0.2, 0.05)
"""Of the smoothed edge, in standard deviations of the worst requirement over the parts: at the last one a yield of 95 %
of a normal requirement is off by 0.07 %."""
ITERATIONS, ENOUGH = 15, 1e-4
"""Of SLSQP in each stage, and the change of the objective and the break of a constraint that are none (scaled)."""
SAME, GOING_ON = 0.02, 2
"""Designs within this part of every range are one; so many go on after the first stage."""
KEPT, KEPT_LOGIT = 2e-3, 1e-2
"""A constraint that is broken by less is kept; the logit of a yield of 95 % by 1e-2 is 0.05 % of the parts."""
STALLED, STILL = 8, 1e-5
"""A line search whose last so many designs lie within this part of every range has failed."""
RESTORING = 5
"""Steps back to what keeps the constraints, at most, where a line search has failed: in a corner of the constraints the
merit function of SLSQP is flat along the way back."""
CANDIDATES = 4
"""Designs that are improved: with a dozen parts each they fill one call."""
SHARE_ERROR, OBJECTIVE_ERROR = 5e-3, 2e-3
"""An expansion is good enough where the yield is off by half a percent at most, and the scaled objective and
the constraints by 0.2 %."""

DERIVATIVES, BY_SAMPLES, ASCENT = "derivatives", "samples", "inner ascent"


class Stalled(Exception):
    """A line search that finds nothing better."""


@dataclasses.dataclass(frozen=True)
class Improved:
    """A design that was improved.

    Args:
        t: unit values.
        values: the objective, then the constraints, at the last width.
        kept: whether all constraints hold.
        width: of the smoothed edge, in standard deviations of the worst violation.
        method: how its parts were known.
        error: of the expansion about it; None where it has none.
    """

    t: np.ndarray
    values: np.ndarray
    kept: bool
    width: float
    method: str
    error: Error | None = None

    @property
    def rank(self) -> tuple[bool, float]:
        """The best first."""
        return (not self.kept, float(self.values[0]) if self.kept else float(np.max(self.values[1:])))


def is_good(error: Error | None, has_yield: bool, needs_values: bool) -> bool:
    """Whether an expansion is good enough for what is wanted."""
    if error is None or error.lost:
        return False
    if has_yield and error.share > SHARE_ERROR:
        return False
    if needs_values and error.objective > OBJECTIVE_ERROR:
        return False
    return has_yield or error.violation < OBJECTIVE_ERROR


def candidates(designs: list[np.ndarray], reference: np.ndarray, seed: int) -> np.ndarray:
    """Where robust designs are looked for: distinct nominal ones, the start, points of the box."""
    known = [*designs[: CANDIDATES - 2], reference]
    points = qmc.Sobol(len(reference), scramble=True, rng=seed).random_base2(3)
    return np.clip(np.stack([*known, *points][:CANDIDATES]), 0.02, 0.98)


def improved(
    wants: Wants, starts: np.ndarray, method: str, factors: Any = 1.0, widths: tuple[float, ...] = WIDTHS
) -> list[Improved]:
    """The robust optimum near each row of unit values, the best first. factors: of every deviation."""
    if method == ASCENT:
        ends = _in_step(wants.at_worst, starts)
        return _ranked(wants.at_worst(ends), ends, 0.0, method, False)
    look = wants.by_expansion(factors) if method == DERIVATIVES else wants.by_samples(factors)
    has_yield, ends, found = wants.wanted.promised is not None, starts, []
    for width in widths if has_yield else widths[-1:]:
        answer = wants.answer(look, width)
        ends = _in_step(answer, ends)
        found = _ranked(answer(ends), ends, width, method, has_yield)
        if not found:
            break
        ends = _distinct([one.t for one in found])
    if not found or found[0].kept:
        return found
    ends = _restored(answer, ends)
    return sorted([*found, *_ranked(answer(ends), ends, width, method, has_yield)], key=lambda one: one.rank)


def _restored(answer: Callable[[np.ndarray], Answer], ends: np.ndarray) -> np.ndarray:
    """Designs that keep the constraints, by Newton's shortest steps from some that break them a little."""
    for _ in range(RESTORING):
        found = answer(ends)
        broken = found.values[:, 1:] > -ENOUGH
        broken &= np.any(found.values[:, 1:] > ENOUGH, axis=1)[:, None]
        if not np.any(broken):
            break
        ends = ends.copy()
        for k, rows in enumerate(broken):
            if np.any(rows):
                slopes, values = found.value_slopes[k, 1:][rows], found.values[k, 1:][rows] + ENOUGH
                ends[k] = np.clip(ends[k] - np.linalg.lstsq(slopes, values, rcond=1e-6)[0], 0.0, 1.0)
    return ends


def _distinct(rows: list[np.ndarray]) -> np.ndarray:
    """The first ones that are not the same."""
    kept: list[np.ndarray] = []
    for row in rows:
        if all(np.max(np.abs(row - other)) > SAME for other in kept):
            kept.append(row)
    return np.stack(kept[:GOING_ON])


def _ranked(answer: Answer, ends: np.ndarray, width: float, method: str, has_yield: bool) -> list[Improved]:
    rows = zip(ends, answer.values, answer.shortfall, strict=True)
    free = np.full(answer.values.shape[1] - 1, KEPT)
    if has_yield:  # its logit is the first constraint, where any design says something
        free[:1] = KEPT_LOGIT
    found = [Improved(t, v, bool(np.all(v[1:] <= free)), width, method) for t, v, lost in rows if not lost]
    return sorted(found, key=lambda one: one.rank)


def _in_step(evaluate: Callable[[np.ndarray], Answer], starts: np.ndarray) -> np.ndarray:
    """The end of sequential quadratic programming from each row."""

    def one(k: int, look: Any) -> np.ndarray:
        @remembered
        def told(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes, shortfall = look(t)
            if shortfall > 0:
                raise Lost
            return values, slopes

        def run(t: np.ndarray, bounds: Any) -> np.ndarray:
            seen: list[np.ndarray] = []

            def objective(t: np.ndarray) -> float:
                seen.append(t.copy())
                if len(seen) >= STALLED and np.max(np.ptp(seen[-STALLED:], axis=0)) < STILL:
                    raise Stalled
                return told(t)[0][0]

            try:
                return programmed(objective, t, bounds)
            except Stalled:
                return seen[-1]

        def programmed(objective: Callable[[np.ndarray], float], t: np.ndarray, bounds: Any) -> np.ndarray:
            return minimize(
                objective,
                t,
                jac=lambda t: told(t)[1][0],
                bounds=bounds,
                constraints=[
                    {"type": "ineq", "fun": lambda t: -told(t)[0][1:], "jac": lambda t: -told(t)[1][1:]},
                ],
                method="SLSQP",
                options={"maxiter": ITERATIONS, "ftol": ENOUGH},
            ).x

        return boxed(run, starts[k])

    return on_bounds(np.stack(in_step(evaluate, len(starts), one)))
