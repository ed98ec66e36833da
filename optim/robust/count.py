"""Fresh parts of a design, counted: what a robust design was promised to do, checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from .evaluate import Wants
from .improve import ASCENT, DERIVATIVES, Improved

FRESH = 20_000
"""Parts that are drawn anew: a yield of 95 % is then known to 0.15 %."""
PROMISED = 1 << 15
"""Parts whose expansion is evaluated for a promise."""
FRESH_SEED = 1_000_003
"""Added to the seed: the parts that are counted are none of those that were searched with."""


@dataclasses.dataclass(frozen=True)
class Count:
    """What the parts of one design do.

    Args:
        parts: how many.
        share: of parts that have an equilibrium and keep every requirement.
        lost: share of parts without equilibrium.
        failures: of every requirement, the share of parts that break it.
        goal: the objective in the way that is wanted of it (nominal, mean, quantile, worst), scaled.
        violation: where no yield is wanted, the worst constraint in that way, scaled.
        values: of the goals' quantities, SI, one row per part; NaN where there is no equilibrium.
        broken: the worst scaled violation of every part.
    """

    parts: int
    share: float
    lost: float
    failures: Float[np.ndarray, " k"]
    goal: float
    violation: float
    values: Float[np.ndarray, "p g"]
    broken: Float[np.ndarray, " p"]


def counted(wants: Wants, t: np.ndarray, count: int = FRESH, tell: Callable[[int], None] = lambda done: None) -> Count:
    """Fresh parts of a design, solved and counted; for a worst case such as fill the box, its corners among them."""
    rng = np.random.default_rng(wants.seed + FRESH_SEED)
    if wants.wanted.goal == "worst":
        low, high = wants.scatters.box(wants.box)
        u = rng.random((count, wants.scatters.size))
        s = low + (high - low) * np.where(np.arange(count)[:, None] % 2, u, np.round(u))
    else:
        s = wants.scatters.fresh(count, wants.seed + FRESH_SEED)
    found = wants.parts.counted(t, np.concatenate([np.zeros((1, s.shape[1])), s]), tell)
    return of_values(wants, found.values, found.shortfall)


def of_values(wants: Wants, values: np.ndarray, shortfall: np.ndarray) -> Count:
    """The parts whose values are known; row 0 is the design itself."""
    problem = wants.problem
    worth, _ = wants.row_by_row(values, shortfall)
    broken, objective = np.asarray(worth.broken)[1:], np.asarray(worth.objective)
    violations, good = np.asarray(worth.violations)[1:], (shortfall <= 0)[1:]
    own = []
    for k, sign, bound, _ in wants.requirements.sides:
        own.append(sign * (values[1:, k] - bound) > 0)
    own += list(violations[:, len(problem.sides) :].T > 0)
    failures = np.array([np.mean(column & good) for column in own])
    statistic = _statistic(wants)
    goal = objective[0]
    if statistic is not None:
        goal = statistic(objective[1:], good) if np.any(good) else np.nan
    violation = 0.0
    if wants.wanted.promised is None and statistic is not None:
        violation = max((statistic(column, good) for column in violations.T if np.any(good)), default=-np.inf)
        violation = max(violation, float(np.mean(~good)))
    places = [problem.asked.index(g.quantity) for g in problem.goals]
    return Count(
        len(broken),
        float(np.mean(broken <= 0)),
        float(np.mean(~good)),
        failures,
        float(goal),
        float(violation),
        values[1:, places],
        broken,
    )


def promised(wants: Wants, best: Improved) -> tuple[float | None, float]:
    """(yield, objective in the way that is wanted of it) that a design is promised to have, as it was searched for."""
    if best.method == ASCENT:
        return None, float(best.values[0])
    if best.method == DERIVATIVES:
        expansion = wants.expansions(best.t[None])[0]
        assert expansion is not None
        s = np.concatenate([np.zeros((1, wants.scatters.size)), wants.scatters.quasi_random(PROMISED, wants.seed)])
        values = expansion.parts(s)
        found = of_values(wants, values, np.zeros(len(values)))
    else:
        seen = wants.by_samples()(best.t[None])[0]
        assert seen is not None
        found = of_values(wants, seen.values, seen.shortfall)
    return (None if wants.wanted.promised is None else found.share), found.goal


def _statistic(wants: Wants) -> Any:
    """statistic(x, good) of a number of every part, where good says which parts have an equilibrium. At a quantile a
    part without one is no better than the worst that has one, as in the search."""
    share = wants.wanted.share
    return {
        "expected": lambda x, good: np.mean(x[good]),
        "quantile": lambda x, good: np.quantile(np.where(good, x, np.max(x[good])), share),
        "worst": lambda x, good: np.max(x[good]),
    }.get(wants.wanted.goal)
