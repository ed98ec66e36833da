"""What is wanted of all parts of a design, with its derivatives by the design: by samples, by expansion, or at the
worst.

All three answer to rows of designs at once, so that designs that are improved in step share the calls of the physics.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..problem import Problem, Scales
from .expansion import Expansion, expanded, powers, star
from .parts import Parts, Requirements, as_rows
from .scatter import Scatters
from .statistics import LEAST_SHORTFALL, Wanted, aimed_logit, asked_of_parts, with_row_by_row

SAMPLES = 1024
"""Parts of a design that are solved for its yield: about 0.7 % of a yield of 95 % by independent samples, a few times
less by quasi-random ones."""
EXPANDED = 4096
"""Parts of a design whose expansion is evaluated."""
TESTED = 64
"""Parts of a design that are solved to see how good its expansion is: one call."""
ASCENTS = 6
"""Steps of an inner ascent at most: of a monotone function the first ends in its corner."""


class Answer(NamedTuple):
    """Of K designs; what `finish.in_step` hands on."""

    values: Float[np.ndarray, "k r"]
    """The objective, then the constraints, see `statistics`."""
    value_slopes: Float[np.ndarray, "k r n"]
    shortfall: Float[np.ndarray, " k"]
    """Above zero where a design says nothing."""


class Seen(NamedTuple):
    """The parts of one design, row 0 the design itself."""

    values: Float[np.ndarray, "p q"]
    slopes: Float[np.ndarray, "p q n"] | None
    """None where `expansion` knows them."""
    shortfall: Float[np.ndarray, " p"]
    shortfall_slopes: Float[np.ndarray, "p n"] | None
    expansion: Expansion | None = None
    s: Float[np.ndarray, "p m"] | None = None

    def pulled(self, by_values: np.ndarray, by_shortfall: np.ndarray) -> np.ndarray:
        """The derivatives by t of what has these derivatives by values and shortfalls."""
        if self.expansion is not None:
            assert self.s is not None
            return self.expansion.pulled(self.s, by_values)
        assert self.slopes is not None
        assert self.shortfall_slopes is not None
        flat = by_values.reshape(len(by_values), -1) @ self.slopes.reshape(-1, self.slopes.shape[-1])
        return flat + by_shortfall @ self.shortfall_slopes


class Error(NamedTuple):
    """How far the expansion about a design is off, by parts that were solved."""

    share: float
    """Of the yield: what it changes by where every part is broken by the typical error more or less."""
    objective: float
    """Root of the mean square over parts, of the scaled objective."""
    violation: float
    """The same of the worst requirement."""
    lost: int
    """Parts without equilibrium, which no expansion knows."""


class Wants:
    """Everything that answers need.

    Args:
        parts: who solves.
        scatters: what scatters.
        requirements: what a part must keep.
        wanted: of all parts.
        scales: of the goals and limits.
        samples: parts of a design that are solved where its expansion is not good enough.
        seed: of the quasi-random sets.
        box: of worst cases, normal scores.
    """

    def __init__(
        self,
        parts: Parts,
        scatters: Scatters,
        requirements: Requirements,
        wanted: Wanted,
        scales: Scales,
        samples: int = SAMPLES,
        seed: int = 0,
        box: float = 2.0,
    ):
        self.parts, self.scatters, self.requirements, self.scales = parts, scatters, requirements, scales
        self.problem: Problem = parts.problem
        self.wanted, self.seed, self.box = wanted, seed, box
        self.solved_parts = scatters.quasi_random(samples, seed)
        self.expanded_parts = scatters.quasi_random(EXPANDED, seed)
        self.tested_parts = scatters.quasi_random(TESTED, seed + 1)
        self.row_by_row = with_row_by_row(self.problem, requirements, scales)
        self._asked: dict[float | None, Any] = {}

    @property
    def asked(self) -> Any:
        """`asked_of_parts` for the yield that is wanted now."""
        key = self.wanted.promised
        if key not in self._asked:
            self._asked[key] = asked_of_parts(self.problem, self.requirements, self.scales, self.wanted)
        return self._asked[key]

    # --- the parts of designs -----------------------------------------------------------------------------------------

    def _solved(self, ts: np.ndarray, s: np.ndarray, kept: int) -> list[Seen]:
        """The same parts of every design, with the first `kept` of their derivatives (by t, then by s)."""
        rows = [as_rows(s, t) for t in ts]
        found = self.parts(np.concatenate([t for t, _ in rows]), np.concatenate([s for _, s in rows]))
        each = []
        for k in range(len(ts)):
            own = slice(k * len(s), (k + 1) * len(s))
            slopes = np.nan_to_num(found.value_slopes[own, :, :kept])
            each.append(
                Seen(
                    found.values[own],
                    slopes,
                    found.shortfall[own],
                    np.nan_to_num(found.shortfall_slopes[own, :kept]),
                )
            )
        return each

    def expansions(self, ts: np.ndarray) -> list[Expansion | None]:
        """About every design; None where a part that it needs has no equilibrium."""
        found = []
        for seen in self._solved(ts, star(self.scatters.size), self.problem.space.size):
            assert seen.slopes is not None
            good = np.all(seen.shortfall <= 0)
            found.append(expanded(seen.values, seen.slopes, self.parts.designed) if good else None)
        return found

    def by_samples(self, factors: Any = 1.0) -> Callable[[np.ndarray], list[Seen | None]]:
        """The parts of designs, solved. factors: of every deviation."""
        s = np.concatenate([np.zeros((1, self.scatters.size)), self.solved_parts * factors])

        def seen(ts: np.ndarray) -> list[Seen | None]:
            return list(self._solved(ts, s, self.parts.designed))

        return seen

    def by_expansion(self, factors: Any = 1.0) -> Callable[[np.ndarray], list[Seen | None]]:
        """The parts of designs by their second-order expansion."""
        s = np.concatenate([np.zeros((1, self.scatters.size)), self.expanded_parts * factors])
        known, none = powers(s), np.zeros(len(s))

        def seen(ts: np.ndarray) -> list[Seen | None]:
            return [
                None if one is None else Seen(one.of_powers(known), None, none, None, one, s)
                for one in self.expansions(ts)
            ]

        return seen

    # --- what is wanted of them ---------------------------------------------------------------------------------------

    def answer(self, seen: Callable[[np.ndarray], list[Seen | None]], width: float) -> Callable[[np.ndarray], Answer]:
        """What is wanted of the parts of rows of designs; width: of the smoothed edge, in standard deviations of the
        worst violation."""
        aim = 0.0 if self.wanted.promised is None else aimed_logit(self.wanted.promised, width)

        def answer(ts: np.ndarray) -> Answer:
            rows = []
            for one in seen(ts):
                if one is None or one.shortfall[0] > 0:
                    rows.append(None)
                    continue
                values, (by_values, by_shortfall) = self.asked(one.values, one.shortfall, width, aim)
                rows.append((np.asarray(values), one.pulled(np.asarray(by_values), np.asarray(by_shortfall))))
            return _together(rows, ts.shape[1])

        return answer

    def broken(self, values: np.ndarray, shortfall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(worst violation, objective) of parts."""
        worth, _ = self.row_by_row(values, shortfall)
        return np.asarray(worth.broken), np.asarray(worth.objective)

    def error(self, t: np.ndarray) -> Error | None:
        """Of the expansion about a design; None where there is none."""
        expansion = self.expansions(t[None])[0]
        if expansion is None:
            return None
        found = self.parts.counted(t, self.tested_parts)
        good = found.shortfall <= 0
        (was, f_was), (promised, f_promised) = (
            self.broken(found.values, found.shortfall),
            self.broken(expansion.parts(self.tested_parts), np.zeros(len(good))),
        )
        if not np.any(good):
            return None
        off = float(np.sqrt(np.mean((was - promised)[good] ** 2)))
        every, _ = self.broken(expansion.parts(self.expanded_parts), np.zeros(EXPANDED))
        share = 0.5 * float(np.mean(every <= off) - np.mean(every <= -off))
        objective = float(np.sqrt(np.mean((f_was - f_promised)[good] ** 2)))
        return Error(share, objective, off, int(np.sum(~good)))

    # --- worst cases --------------------------------------------------------------------------------------------------

    def at_worst(self, ts: np.ndarray) -> Answer:
        """The worst objective and the worst of every constraint in the box, each by an ascent of its own, with the
        derivatives by the design there (Danskin). A part without equilibrium is worse than any other."""
        values, slopes, _ = self.worst(ts)
        return _together(
            [(v, d) if np.all(np.isfinite(v)) else None for v, d in zip(values, slopes, strict=True)], ts.shape[1]
        )

    def worst(self, ts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(values, slopes by t, deviations) of the worst of every function; the last one is the shortfall.

        Where the design itself is the best of its parts, as where a goal is reached or an offset is zero, no slope
        there leads to the worst. So the second step also asks for the ends of every number alone, and for the corners
        that are opposite to those that the slopes lead to; the third for the worse ends of all numbers together. Each
        function takes the worst for it of all parts that a step asks for.
        """
        low, high = self.scatters.box(self.box)
        n, m, count = ts.shape[1], self.scatters.size, 2 + len(self.problem.constrained)
        at = np.zeros((len(ts), count, m))
        best = np.full((len(ts), count), -np.inf)
        best_s, best_t, best_by_s = (
            np.zeros((len(ts), count, m)),
            np.zeros((len(ts), count, n)),
            np.zeros((len(ts), count, m)),
        )
        share, further = np.ones((len(ts), count, 1)), np.zeros((len(ts), 0, m))
        alone = np.broadcast_to(np.concatenate([np.diag(low), np.diag(high)]), (len(ts), 2 * m, m))
        for step in range(ASCENTS):
            # At the first step all functions ask for the same part, the design itself.
            s = np.concatenate([at[:, :1] if step == 0 else at, further], axis=1)
            rows_t, rows_s = np.repeat(ts, s.shape[1], axis=0), s.reshape(-1, m)
            found = self.parts(rows_t, rows_s)
            value, slope = self._functions(found)
            value = value.reshape(len(ts), s.shape[1], count)
            slope = slope.reshape(len(ts), s.shape[1], count, n + m)
            designs, own = np.arange(len(ts))[:, None], np.arange(count)
            if step == 1:
                at_low, at_high = value[:, -2 * m : -m], value[:, -m:]
                ends = np.where(at_high > at_low, high[:, None], low[:, None])
                ends = np.where(np.maximum(at_low, at_high) > best[:, None], ends, 0.0).swapaxes(1, 2)
            worst = np.argmax(value, axis=1)
            value, slope, asked = value[designs, worst, own], slope[designs, worst, own], s[designs, worst]
            better = value > best + 1e-12
            best = np.where(better, value, best)
            best_s = np.where(better[..., None], asked, best_s)
            best_t = np.where(better[..., None], slope[..., :n], best_t)
            best_by_s = np.where(better[..., None], slope[..., n:], best_by_s)
            share = np.where(better[..., None], 1.0, 0.5 * share)
            corner = np.where(best_by_s > 0, high, np.where(best_by_s < 0, low, best_s))
            following = best_s + share * (corner - best_s)
            if step == 0:
                opposite = np.where(best_by_s > 0, low, np.where(best_by_s < 0, high, best_s))[:, :-1]
                further = np.concatenate([opposite, alone], axis=1)
            elif step == 1 and not np.allclose(ends, best_s):
                further = ends
            elif np.allclose(following, at) or np.allclose(following, best_s):
                break
            else:
                further = further[:, :0]
            at = following
        return best, best_t, best_s

    def _functions(self, found: Any) -> tuple[np.ndarray, np.ndarray]:
        """Objective, violations and shortfall of parts, and their slopes by t and s."""
        worth, by_values = self.row_by_row(found.values, found.shortfall)
        lost = found.shortfall > 0
        slopes = np.nan_to_num(found.value_slopes)
        value = np.concatenate([np.asarray(worth.objective)[:, None], np.asarray(worth.violations)], axis=1)
        by_value = np.concatenate([np.asarray(by_values.objective)[:, None], np.asarray(by_values.violations)], axis=1)
        slope = np.einsum("kfq,kqp->kfp", by_value, slopes)
        # Where there is no equilibrium the other functions are not known: they are not worse than what is.
        value = np.where(lost[:, None], -np.inf, value)
        short = np.where(lost, found.shortfall + LEAST_SHORTFALL, 0.0)
        value = np.concatenate([value, short[:, None]], axis=1)
        return value, np.concatenate([slope, np.nan_to_num(found.shortfall_slopes)[:, None]], axis=1)


def _together(rows: list[tuple[np.ndarray, np.ndarray] | None], n: int) -> Answer:
    """Answers of designs; those that say nothing have a shortfall."""
    size = next((len(row[0]) for row in rows if row is not None), 1)
    values = np.stack([np.zeros(size) if row is None else row[0] for row in rows])
    slopes = np.stack([np.zeros((size, n)) if row is None else row[1] for row in rows])
    # SciPy's SLSQP takes rows of memory for rows of the matrix.
    return Answer(values, np.ascontiguousarray(slopes), np.array([float(row is None) for row in rows]))
