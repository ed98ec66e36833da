"""Which measurements to make: linear algebra on the derivatives of all that can be measured.

Near the parameters theta = log x a measurement y_i with the noise s_i has the row r_i = (dy_i / dtheta) / s_i. What is
known after n_i measurements of each, with the precision P_0 before, is normal with the covariance

    C = (P_0 + sum_i n_i r_i r_i^T)^-1

and a list of measurements is better the larger

    "D": mean of 1/2 log(det C_0 / det C)           information gained, nats
    "A": -mean of sum_j C_jj / C_0jj                shares of the variances left
    "decision": -mean of g^T C g                    variance of a quantity q left, g = dq / dtheta

Means are over draws of theta, since rows depend on it. Lists are built one by one, from the best gain for its cost and
from the best gain, and improved by exchanging one measurement for another as long as that helps (Fedorov's exchange),
and, where there is a budget, two for what they pay for. The better of the two is taken.

Source: K. Chaloner, I. Verdinelli, "Bayesian experimental design: a review", Statistical Science 10 (1995) 273-304.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CRITERIA = ("D", "A", "decision")
LEAST_GAIN = 1e-9
"""An exchange is made where the criterion grows by more than this part of itself."""
MOST_SWEEPS = 50
"""Of exchanges over the whole list."""


class Candidates(NamedTuple):
    """What can be measured, and what is known before."""

    rows: np.ndarray
    """r of every draw and candidate, dimensionless, shape (draws, candidates, n); zero where a draw has no state."""
    costs: np.ndarray
    """Shape (candidates,)."""
    most: np.ndarray
    """How often each may be measured, shape (candidates,)."""
    prior: np.ndarray
    """C_0, shape (n, n)."""
    decided: np.ndarray | None = None
    """g of every draw, shape (draws, n); None where nothing is to be decided."""

    def covariance(self, chosen: Sequence[int]) -> np.ndarray:
        """C after measuring these candidates, shape (draws, n, n)."""
        seen = self.rows[:, list(chosen)]
        return np.linalg.inv(np.linalg.inv(self.prior) + np.einsum("mij,mik->mjk", seen, seen))

    def value(self, chosen: Sequence[int], criterion: str) -> float:
        """The criterion; the larger, the better."""
        C = self.covariance(chosen)
        if criterion == "D":
            return float(0.5 * (np.linalg.slogdet(self.prior)[1] - np.mean(np.linalg.slogdet(C)[1])))
        if criterion == "A":
            return -float(np.mean(np.einsum("mjj->mj", C) / np.diag(self.prior)) * len(self.prior))
        assert self.decided is not None
        return -float(np.mean(np.einsum("mj,mjk,mk->m", self.decided, C, self.decided)))

    def gains(self, chosen: Sequence[int], criterion: str) -> np.ndarray:
        """What one more of each candidate adds to the criterion, shape (candidates,)."""
        C = self.covariance(chosen)
        moved = np.einsum("mjk,mik->mij", C, self.rows)
        size = np.einsum("mij,mij->mi", moved, self.rows)
        if criterion == "D":
            return np.mean(0.5 * np.log1p(size), axis=0)
        if criterion == "A":
            return np.mean(np.sum(moved**2 / np.diag(self.prior), axis=2) / (1 + size), axis=0)
        assert self.decided is not None
        return np.mean(np.einsum("mij,mj->mi", moved, self.decided) ** 2 / (1 + size), axis=0)

    def is_allowed(self, chosen: Sequence[int], points: int, budget: float) -> bool:
        """Whether a list keeps the number of points, the budget, and how often each may be measured."""
        counts = np.bincount(list(chosen), minlength=len(self.costs))
        spent = float(np.sum(self.costs[list(chosen)]))
        return len(chosen) <= points and spent <= budget * (1 + 1e-12) and bool(np.all(counts <= self.most))


def choose(given: Candidates, criterion: str, points: int, budget: float = np.inf) -> list[int]:
    """The list of candidates to measure, the most telling first.

    Args:
        given: what can be measured.
        criterion: one of CRITERIA.
        points: how many measurements at most.
        budget: what they may cost together, in the unit of the costs.

    Returns:
        Indices of candidates; one that is measured twice stands there twice.
    """
    # By the gain for the cost alone, cheap measurements may leave no budget for a dear one that tells more.
    prices = (given.costs, np.ones(len(given.costs)))
    found = [_exchanged(given, criterion, points, budget, _filled(given, criterion, points, budget, p)) for p in prices]
    return _in_order(given, criterion, max(found, key=lambda chosen: given.value(chosen, criterion)))


def _exchanged(given: Candidates, criterion: str, points: int, budget: float, chosen: list[int]) -> list[int]:
    """The list, one measurement after the other exchanged for a better one, and filled up where that leaves room."""
    best = given.value(chosen, criterion)
    for _ in range(MOST_SWEEPS):
        before = best
        for place in range(len(chosen)):
            rest = chosen[:place] + chosen[place + 1 :]
            for other in np.argsort(-given.gains(rest, criterion)):
                swapped = [*rest, int(other)]
                if int(other) == chosen[place] or not given.is_allowed(swapped, points, budget):
                    continue
                value = given.value(swapped, criterion)
                if value > best + LEAST_GAIN * abs(best):
                    chosen, best = swapped, value
                break  # the gains are exact: the others are worse
        if best <= before and np.isfinite(budget):
            chosen, best = _without_two(given, criterion, points, budget, chosen, best)
        if best <= before:
            break
        chosen = _filled(given, criterion, points, budget, given.costs, chosen)
        best = given.value(chosen, criterion)
    return chosen


def _without_two(
    given: Candidates, criterion: str, points: int, budget: float, chosen: list[int], best: float
) -> tuple[list[int], float]:
    """The first better list without two of its measurements, and its criterion: the budget that they leave may pay for
    one that is dear, or for others whose worth is in being made together."""
    for places in itertools.combinations(range(len(chosen)), min(2, len(chosen))):
        rest = [k for place, k in enumerate(chosen) if place not in places]
        for prices in (given.costs, np.ones(len(given.costs))):
            other = _filled(given, criterion, points, budget, prices, rest)
            value = given.value(other, criterion)
            if value > best + LEAST_GAIN * abs(best):
                return other, value
    return chosen, best


def _filled(
    given: Candidates, criterion: str, points: int, budget: float, prices: np.ndarray, chosen: Sequence[int] = ()
) -> list[int]:
    """The list, and what else is allowed: one after the other, the one that gains most for its price first."""
    chosen = list(chosen)
    while True:
        gains = given.gains(chosen, criterion) / prices
        able = np.array([given.is_allowed([*chosen, k], points, budget) for k in range(len(gains))])
        if not able.any() or not np.max(np.where(able, gains, 0.0)) > 0:
            return chosen
        chosen.append(int(np.argmax(np.where(able, gains, -1.0))))


def _in_order(given: Candidates, criterion: str, chosen: list[int]) -> list[int]:
    """The same list, the most telling for its cost first."""
    left, ordered = list(chosen), []
    while left:
        gains = given.gains(ordered, criterion) / given.costs
        best = max(left, key=lambda k: gains[k])
        ordered.append(best)
        left.remove(best)
    return ordered


def evenly(group: np.ndarray, points: int) -> list[int]:
    """So many candidates of a group, evenly spaced over it; several times round where it has fewer."""
    rounds, rest = divmod(points, len(group))
    spaced = group[np.unique(np.round(np.linspace(0, len(group) - 1, rest)).astype(int))] if rest else group[:0]
    return [int(k) for k in [*np.tile(group, rounds), *spaced]]
