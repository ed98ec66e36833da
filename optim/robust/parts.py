"""Parts of designs, solved: each from the state of a part or a design nearby.

A part is one design with its deviations. Its problem is that of the design over `ScatteredSpace`, so that what searches
use (values with derivatives, states from states nearby) holds for parts as it is; the design itself is the part without
deviations, and the nominal search runs on the same compiled programs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from softgrip_jax.quantities import State
from softgrip_jax.results import Solution, in_units
from softgrip_jax.units import DISPLAY

from ..design.descent import Evaluated, Evaluator, chunk_for, evaluated
from ..problem import Limits, Problem
from .scatter import ScatteredSpace, Scatters

BLOCK = 512
"""Parts that are looked up together among the states that are known: what a table of their distances takes, 8 MB."""
COUNTED_AT_ONCE = 256
"""Parts that are counted by one call: without derivatives they take less memory."""
AT_ONCE = 16
"""Parts that are solved with derivatives by one call on a CPU: about as many as an expansion asks for."""


def problem_of_parts(problem: Problem, scatters: Scatters) -> Problem:
    """The same goals, limits and rules, asked of parts."""
    space = ScatteredSpace(problem.space, scatters)
    found = Problem(
        space,
        problem.goals,
        problem.limits,
        ignore_rules=problem.ignored_rules,
        different_laws=True,
        reported=problem.quantities,
    )
    assert found.quantities == problem.quantities
    found.about = problem.about and f"{problem.about}\nparts {space.scatter_held()}"
    return found


class Parts:
    """Solves parts: rows of unit values of designs with rows of deviations.

    Args:
        problem: of the parts, see `problem_of_parts`.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self.designed = problem.space.size - problem.space.scatters.size  # type: ignore[attr-defined]
        self.evaluate = Evaluator(problem, chunk_for(AT_ONCE, AT_ONCE))

    @property
    def solves(self) -> int:
        return self.evaluate.solves

    def __call__(self, t: np.ndarray, s: np.ndarray) -> Evaluated:
        """Parts with derivatives by t and s; those without equilibrium have a shortfall with its derivatives."""
        return self._in_blocks(self.evaluate, np.concatenate([t, s], axis=1))

    def counted(self, t: np.ndarray, s: np.ndarray, tell: Callable[[int], None] = lambda done: None) -> Evaluated:
        """Parts of one design t; those without equilibrium have just a positive shortfall. What is not found from a
        state nearby is followed from zero load."""
        rows = np.concatenate([np.broadcast_to(t, (len(s), len(t))), s], axis=1)
        if not self.evaluate.is_near:
            return self._in_blocks(self._directly, rows, tell)
        self._answer(rows[:1] * np.append(np.ones(len(t)), np.zeros(s.shape[1])))  # the design itself, to begin from
        return self._in_blocks(self._by_chords, rows, tell)

    def whole_way(self, t: np.ndarray, s: np.ndarray) -> Evaluated:
        """Parts of one design t, each along the whole way from zero load, as `sg.solve` does it."""
        return self.evaluate.solve(np.concatenate([np.broadcast_to(t, (len(s), len(t))), s], axis=1))

    def _directly(self, rows: np.ndarray) -> Evaluated:
        """Along the whole way, without derivatives."""
        self.evaluate.solves += len(rows)
        return evaluated(self.evaluate.in_chunks(self.problem.solved, BLOCK, rows), 0)

    def _by_chords(self, rows: np.ndarray) -> Evaluated:
        """With the Jacobians of parts nearby; what is not found so is answered like any other. Where chambers snap what
        is found nearby may be a state behind a snap: parts are followed from zero load."""
        evaluate = self.evaluate
        if not evaluate.can_begin or self.problem.doubted:
            found = evaluate.solve(rows)
            return found._replace(
                value_slopes=found.value_slopes[..., :0], shortfall_slopes=found.shortfall_slopes[:, :0]
            )
        evaluate.solves += len(rows)
        known, _ = evaluate.starts(rows)
        found = evaluated(evaluate.in_chunks(self.problem.solved_by_chords, COUNTED_AT_ONCE, rows, known), 0)
        left = np.flatnonzero(found.shortfall > 0)
        return _put(found, left, self._answer(rows[left])) if len(left) else found

    def _answer(self, rows: np.ndarray) -> Evaluated:
        evaluate = self.evaluate
        evaluate.solves += len(rows)
        if not evaluate.can_begin:
            evaluate.begin(rows[:1])
        if not evaluate.can_begin:
            return evaluate.solve(rows)
        found, left = evaluate.nearby(rows)
        if len(left):
            found = _put(found, left, evaluate.solve(rows[left]))
        return found

    def _in_blocks(
        self,
        solve: Callable[[np.ndarray], Evaluated],
        rows: np.ndarray,
        tell: Callable[[int], None] = lambda done: None,
    ) -> Evaluated:
        found = []
        for start in range(0, len(rows), BLOCK):
            found.append(solve(rows[start : start + BLOCK]))
            tell(start + len(found[-1].values))
        return jax.tree.map(lambda *x: np.concatenate([np.asarray(v) for v in x]), *found)


def _put(old: Evaluated, rows: np.ndarray, new: Evaluated) -> Evaluated:
    """What was found, some rows found again, without derivatives."""

    def put(name: str) -> Any:
        column = np.array(getattr(old, name))
        column[rows] = getattr(new, name)
        return column

    return old._replace(**{name: put(name) for name in ("values", "shortfall", "statuses", "reasons", "details")})


class DesignsOfParts:
    """`descent.SolvesDesigns` by designs that are parts without deviations.

    Args:
        parts: who solves.
    """

    def __init__(self, parts: Parts):
        self.parts, self._evaluate = parts, parts.evaluate
        self.solves = 0
        self.moving: np.ndarray | None = None

    @property
    def home(self) -> np.ndarray:
        return self._evaluate.home[: self.parts.designed]

    @home.setter
    def home(self, t: np.ndarray) -> None:
        self._evaluate.home = self._rows(t)[0]

    def prepare(self) -> None:
        """Have the programs made that every search needs."""
        self._evaluate.prepare()

    def __call__(self, t: Any) -> Evaluated:
        """As `Evaluator`: with derivatives by t."""
        rows, n = self._rows(t), self.parts.designed
        self.solves += len(rows)
        found = self._evaluate(rows)
        return found._replace(
            value_slopes=found.value_slopes[..., :n], shortfall_slopes=found.shortfall_slopes[..., :n]
        )

    def solve(self, t: Any) -> Evaluated:
        """Along the whole way from zero load."""
        rows, n = self._rows(t), self.parts.designed
        self.solves += len(rows)
        found = self._evaluate.solve(rows)
        return found._replace(
            value_slopes=found.value_slopes[..., :n], shortfall_slopes=found.shortfall_slopes[..., :n]
        )

    def solutions(self, t: np.ndarray) -> dict[tuple[str, State], list[Solution]]:
        """The solved states, along the whole way from zero load."""
        return self._evaluate.solutions(self._rows(t))

    def _rows(self, t: Any) -> np.ndarray:
        t = np.atleast_2d(np.asarray(t, dtype=float))
        return np.concatenate([t, np.zeros((len(t), self.parts.problem.space.size - t.shape[1]))], axis=1)


@dataclasses.dataclass(frozen=True)
class Requirements:
    """What a part must keep, as scaled violations: positive where it is broken.

    Args:
        problem: whose quantities are asked for.
        limits: what is required beside the rules; None: what the problem's own limits say.

    Raises:
        InputError: where two limits contradict each other.
    """

    problem: Problem
    limits: tuple[Limits, ...] | None = None

    def __post_init__(self) -> None:
        self.problem.require_room("requirements", self.sides)

    @property
    def sides(self) -> list[tuple[int, int, float, float]]:
        """(index of the quantity, sign, bound, scale) of every one-sided requirement."""
        problem = self.problem
        found = []
        for limit in problem.limits if self.limits is None else self.limits:
            k = problem.asked.index(limit.quantity)
            found += [
                (k, sign, bound, limit.scale or abs(bound) or DISPLAY[problem.kinds[k]][1])
                for sign, bound in limit.sides()
            ]
        return found

    @property
    def labels(self) -> list[str]:
        """'limit_margin at required at least 1.2', then the rules."""
        problem = self.problem
        own = [
            f"{problem.label(problem.quantities[k])} {'at least' if sign < 0 else 'at most'} "
            f"{in_units(bound, problem.kinds[k])}"
            for k, sign, bound, _ in self.sides
        ]
        return own + problem.constraint_labels()[len(problem.sides) :]


def as_rows(s: Float[np.ndarray, " m"] | Float[np.ndarray, "n m"], t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """t beside every row of s."""
    s = np.atleast_2d(s)
    return np.broadcast_to(t, (len(s), len(t))).copy(), s
