"""Trade-offs: the designs that cannot be better in one goal without being worse in another.

1. A Sobol set of designs, solved once, is where everything starts from.
2. Each goal alone is brought to its optimum (of three, also every two together): the ends of the front. They span the
   range of every goal, in which all are measured from now on: 0 is its best, 1 its worst at the other ends. A goal that
   shall reach a target is brought to it within about a millionth.
3. From points p spread evenly over the flat between the ends, the front is approached along the diagonal (Pascoletti
   and Serafini 1984; Das and Dennis 1998):  least s  with  f_i(x) <= p_i + s  for every goal i, and the constraints.
   All of these are solved at once by SLSQP with exact slopes, from the best design that is known for each. What one
   found may be a better start for another: those are solved again.
4. Of two goals this is done for a few points first; what lies beyond the ends is looked at again, and more points
   are then placed so that the designs are evenly spaced along the front, and begin from designs in between.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from itertools import product
from typing import Any

import jax
import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import qmc

from softgrip_jax.errors import ConfigError, InputError
from softgrip_jax.folders import DeferInterrupt
from softgrip_jax.quantities import State
from softgrip_jax.results import Solution

from ..problem import Problem, Scaling
from .descent import (
    CPU_CHUNK,
    FEASIBLE,
    Design,
    Evaluator,
    Felt,
    begun_apart,
    chunk_for,
    designs_at,
    outside_of_bounds,
    score_with_slopes,
    search,
)
from .finish import ROUNDING, Look, Lost, boxed, in_step, on_bounds, remembered

ANCHOR_STARTS = 2
"""Designs from which each end of the front is sought."""

OTHERS = 1e-3
"""Part of the other goals in the search for an end: of several best designs, the one that is better in the rest."""

OTHERS_AT_TARGET = 1e-6
"""The same where a target shall be reached: the square of a distance is flat there, and with OTHERS a design would stay
beside the target by a thousandth of the range."""

RESTARTS = 4
"""Of the search for an end: where the slope of a goal jumps SLSQP may stop early, and begins afresh from there."""

ROUNDS = 2
"""Of solving again what another design gives a better start."""

ENDS, ENOUGH = 40, 20
"""Steps of SLSQP towards an end and a point of the front: fast from nearby, but at a kink of a goal it would creep."""

ENDS_TO, TARGETS_TO = 1e-9, 1e-15
"""What SLSQP may leave of the (scaled) goal at an end, and of the square of a distance from a target."""

LEAST_RANGE = 1e-9
"""Of a goal between the ends: where one design is the best in every goal, its range is what SLSQP left."""

SCOUTS = 9
"""Points of a front of two goals that say how it runs."""

BETTER = 1e-3
"""A start is better when it is nearer by this part of the range."""

RANGES_AWAY = 10.0
"""In ranges: from a point this far along one goal, the diagonal asks nothing of it."""

NO_FRONT = "No design that keeps every constraint was found; there is no front."


class NoFrontError(ConfigError):
    """There is nothing to trade off: a search of all goals together tells what is in the way. Nothing of a config is
    wrong, so its sentence needs no place (`errors.located`)."""


DISTINCT = 1e-3
"""Two designs whose goals all differ by less of their ranges are one point of the front."""


@dataclasses.dataclass(frozen=True)
class Front:
    """A trade-off between the goals of a problem.

    Args:
        problem: what was asked.
        designs: feasible, none better in every goal than another, in the order of the first goal.
        terms: scaled terms, to be minimised, dimensionless, shape (designs, goals).
        solves: designs evaluated.
        seconds: by stage, s.
        stopped: by Ctrl-C: the designs are the best of those that were solved until then.
        notes: sentences for the report: as those of a search, and where one design is the best in every goal.
        solutions: of every design, the states that were solved along the whole way from zero load.

    Examples:
        >>> [field.name for field in __import__("dataclasses").fields(optim.Front)][:3]
        ['problem', 'designs', 'terms']
    """

    problem: Problem
    designs: list[Design]
    terms: np.ndarray
    solves: int
    seconds: dict[str, float]
    stopped: bool = False
    notes: tuple[str, ...] = ()
    solutions: dict[tuple[str, State], list[Solution]] = dataclasses.field(default_factory=dict)


def pareto(
    problem: Problem,
    *,
    points: int = 21,
    starts: int = 64,
    seed: int = 0,
    report: Callable[[str, int], None] = lambda stage, solves: None,
) -> Front:
    """The front of two or three goals under the limits of a problem.

    Ctrl-C ends it and keeps what is undominated of all designs until then, if any of them keeps every constraint.

    Args:
        problem: its goals are kept apart; their weights play no part.
        points: about how many designs on the front (of three goals, the next full net of them).
        starts: number of designs looked at before.
        seed: of these.
        report: called with the name of every stage and the solves so far.

    Raises:
        InputError: for another number of goals, and for fewer than two points.
        NoFrontError: where no design that keeps every constraint was found.

    Source: docs/theory/search.md.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> space = optim.Space({"free": sg.shell.Free(shell)}, [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        >>> high = optim.Goal("maximise", optim.Quantity("inflation", at=12 * kPa))
        >>> safe = optim.Goal("maximise", optim.Quantity("limit_pressure"))
        >>> front = optim.pareto(optim.Problem(space, [high, safe]), points=3, starts=4)
        >>> bool(np.all(np.diff([design.x[0] for design in front.designs]) > 0))  # thicker walls: safer, and lower
        True
    """
    goals = len(problem.goals)
    if goals not in (2, 3):
        raise InputError(f"A trade-off is between two or three goals; there are {goals}.")
    if points < 2:
        raise InputError(f"points is {points}; it must be 2 or more.")
    began = time.perf_counter()
    known = _Known(problem, starts, seed)
    compiled = time.perf_counter()
    stopped = False
    try:
        rows = _front(known, points, report)
    except KeyboardInterrupt:
        known.keep_visited()
        rows, stopped = known.undominated(np.arange(len(known.t))), True
        if not len(rows):
            raise
    t, terms = known.t[rows], known.terms[rows]
    with DeferInterrupt() as waiting:  # the front is found, and its designs are there once they are solved
        designs = designs_at(problem, known.score, known.evaluate, t)
        # Along the whole way one may prove to have no equilibrium though designs nearby led to it.
        kept = [k for k, design in enumerate(designs) if design.feasible]
        if not kept:
            raise NoFrontError(NO_FRONT)
        designs, terms = [designs[k] for k in kept], terms[kept]
        solutions = known.evaluate.solutions(t[kept])
    seconds = {"compile": compiled - began, "front": time.perf_counter() - compiled}
    stopped |= waiting.asked
    notes = [
        *problem.always_kept(),
        *outside_of_bounds(problem, problem.space.to_unit(problem.space.reference)),
        *begun_apart(problem),
        *known.felt.sentences(),
    ]
    if len(designs) == 1 and not stopped:
        notes.append("One design is the best in every goal: there is nothing to trade off.")
    return Front(problem, designs, terms, known.evaluate.solves, seconds, stopped, tuple(notes), solutions)


def _front(known: _Known, points: int, report: Callable[[str, int], None]) -> np.ndarray:
    """Rows of the designs on the front."""
    goals = known.terms.shape[1]
    report("ends of the front", known.evaluate.solves)
    known.find_ends()
    if known.ends_meet:
        return known.ends[:1]
    report("front between them", known.evaluate.solves)
    if goals == 3:
        flat = known.over_ends(points)
        return known.undominated(np.concatenate([known.ends, known.approach(flat)]))
    scouts = known.undominated(known.approach(_simplex(2, min(SCOUTS, points))))
    known.add(_beyond(known.t[scouts]))
    known.find_ends()
    if known.ends_meet:
        return known.ends[:1]
    scouts = known.undominated(np.concatenate([known.ends, scouts]))
    report("designs evenly along it", known.evaluate.solves)
    flat, between = _evenly(known.scaled()[scouts], known.t[scouts], points)
    known.add(between)
    return known.undominated(np.concatenate([scouts[[0, -1]], known.approach(flat)]))


class _Known:
    """Every design that was solved, and the ways to better ones."""

    def __init__(self, problem: Problem, starts: int, seed: int):
        space = problem.space
        self.problem, self.evaluate = problem, Evaluator(problem, chunk_for(starts, CPU_CHUNK))
        self.scaling, self.felt = Scaling(problem), Felt(problem)
        self.scaling.learn(self.evaluate(space.to_unit(space.reference)).values)
        judging = jax.jit(lambda values, scales: score_with_slopes(problem, scales, values))
        terms_of = jax.jit(
            lambda values, scales: (problem.terms(values, scales), jax.jacfwd(problem.terms)(values, scales))
        )
        self.score = lambda values: judging(values, self.scaling.scales)
        self.terms_of = lambda values: terms_of(values, self.scaling.scales)
        power = int(np.ceil(np.log2(max(starts, 2))))
        t = qmc.Sobol(space.size, rng=seed).random_base2(power)
        t = np.concatenate([np.clip(space.to_unit(space.reference), 0, 1)[None], t])[:starts]
        self.t, self.terms, self.broken = np.zeros((0, space.size)), np.zeros((0, len(problem.goals))), np.zeros(0)
        self.add(t)
        if not np.any(np.isfinite(self.broken)):
            # Nothing has an equilibrium: the search knows how to climb back.
            found = search(problem, starts=starts, steps=50, seed=seed)
            self.evaluate.solves += found.solves
            self.add(np.stack([design.t for design in found.designs]))
        if not np.any(np.isfinite(self.broken)):
            raise NoFrontError("No design with an equilibrium was found; there is no front to begin with.")
        self.best, self.worst = np.zeros(len(problem.goals)), np.ones(len(problem.goals))
        self.ends = np.zeros(0, dtype=int)
        self.visited: list[tuple[np.ndarray, np.ndarray, float]] = []
        """(t, terms, largest violation) on the ways that are being gone."""

    def add(self, t: np.ndarray) -> None:
        """Solve designs and keep them; `broken`: the largest violation, inf without equilibrium."""
        found = self.evaluate(t)
        self.scaling.learn(found.values)
        self.felt.look(found)
        terms, broken = [], []
        for values, shortfall in zip(found.values, found.shortfall, strict=True):
            judged, _ = self.score(values)
            terms.append(np.asarray(self.terms_of(values)[0]))
            broken.append(np.inf if shortfall > 0 else float(np.max(np.asarray(judged.violations), initial=0.0)))
        self.t = np.concatenate([self.t, t])
        self.terms = np.concatenate([self.terms, np.stack(terms)])
        self.broken = np.concatenate([self.broken, broken])
        self.visited = []

    def keep_visited(self) -> None:
        """What was seen on the way, of ways that will not be gone to their ends."""
        if self.visited:
            t, terms, broken = (np.array(column) for column in zip(*self.visited, strict=True))
            self.t, self.terms = np.concatenate([self.t, t]), np.concatenate([self.terms, terms])
            self.broken = np.concatenate([self.broken, broken])

    def scaled(self) -> np.ndarray:
        """Terms in the ranges between the ends."""
        return (self.terms - self.best) / np.maximum(self.worst - self.best, LEAST_RANGE)

    @property
    def ends_meet(self) -> bool:
        """Whether one design is the best in every goal."""
        return bool(np.all(self.worst - self.best <= LEAST_RANGE))

    def find_ends(self) -> None:
        """Bring each goal to its best; `best` and `worst` are then the ranges that the ends span."""
        solved = np.isfinite(self.broken)
        spread = np.maximum(np.ptp(self.terms[solved], axis=0), LEAST_RANGE)
        self.best, self.worst = np.zeros(len(spread)), spread
        goals = len(spread)
        weights = np.eye(goals) + OTHERS * (1 - np.eye(goals))
        reached = np.full(goals, np.inf)
        for _ in range(RESTARTS):
            merits = self.scaled() @ weights.T + 10 * np.minimum(self.broken, 1e6)[:, None]
            merits = np.where(np.isfinite(self.broken)[:, None], merits, np.inf)
            better = np.flatnonzero(np.min(merits, axis=0) < reached - BETTER)
            if not len(better):
                break
            reached = np.min(merits, axis=0)
            starts = [(i, self.t[k]) for i in better for k in np.argsort(merits[:, i], kind="stable")[:ANCHOR_STARTS]]
            found = in_step(
                self.evaluate, len(starts), lambda k, look, s=starts: self._sum(look, s[k][1], weights[s[k][0]])
            )
            self.add(on_bounds(np.stack(found)))
        feasible = self.broken <= FEASIBLE
        if not np.any(feasible):
            raise NoFrontError(NO_FRONT)
        self.ends = self._bests(weights)
        targets = [i for i, goal in enumerate(self.problem.goals) if goal.kind == "reach"]
        if targets:
            weights[targets] = np.where(np.eye(goals)[targets] == 1, 1.0, OTHERS_AT_TARGET)
            begin = self.t[self.ends[targets]]
            found = in_step(
                self.evaluate, len(targets), lambda k, look: self._sum(look, begin[k], weights[targets[k]], TARGETS_TO)
            )
            self.add(on_bounds(np.stack(found)))
            self.ends = self._bests(weights)
        if goals == 3:
            # The best of one goal leaves the others open. A corner is where all others are as good as they can be.
            self.best = np.min(self.terms[self.broken <= FEASIBLE], axis=0)
            self.worst = self.best + spread
            self.ends = np.concatenate([self.ends, self.approach(RANGES_AWAY * np.eye(goals))])
        ends = self.terms[self.ends]
        self.best, self.worst = np.min(ends, axis=0), np.max(ends, axis=0)

    def _bests(self, weights: np.ndarray) -> np.ndarray:
        """The row of the feasible design with the least sum of the goals, for every row of weights."""
        return np.argmin(np.where(self.broken[:, None] <= FEASIBLE, self.scaled() @ weights.T, np.inf), axis=0)

    def approach(self, flat: np.ndarray) -> np.ndarray:
        """The front from each point of the flat, again where another result gives a better start; rows of the best."""
        reached = np.full(len(flat), np.inf)
        for _ in range(ROUNDS):
            nearest, distance = self.nearest(flat)
            behind = np.flatnonzero(distance < reached - BETTER)
            if not len(behind):
                break
            todo = [(flat[k], self.t[nearest[k]]) for k in behind]
            found = in_step(
                self.evaluate, len(todo), lambda k, look, todo=todo: self._diagonal(look, todo[k][1], todo[k][0])
            )
            before = len(self.t)
            self.add(on_bounds(np.stack(found)))
            reached[behind] = self.distances(flat[behind])[np.arange(len(behind)), before + np.arange(len(behind))]
        return self.nearest(flat)[0]

    def over_ends(self, points: int) -> np.ndarray:
        """About so many points spread evenly over the flat, where the diagonal through them passes between the ends of
        three goals."""
        ends = self.scaled()[self.ends]
        flat = ends + (1 - np.sum(ends, axis=1, keepdims=True)) / 3
        try:
            hull = ConvexHull(flat[:, :2]).equations
        except QhullError:  # ends along one line, or all at one place
            return _simplex(3, points)
        for parts in range(1, points + 1):
            i, j = np.mgrid[-parts : 2 * parts + 1, -parts : 2 * parts + 1].reshape(2, -1) / parts
            net = np.stack([i, j, 1 - i - j], axis=1)
            net = net[np.all(net[:, :2] @ hull[:, :2].T + hull[:, 2] < ROUNDING, axis=1)]
            if len(net) >= points:
                return net
        return _simplex(3, points)

    def distances(self, flat: np.ndarray) -> np.ndarray:
        """(point, design): s of every design from every point of the flat; inf where it breaks a constraint: such a
        design may be any number of ranges nearer where the ends are close to each other."""
        s = np.max(self.scaled()[None] - flat[:, None], axis=2)
        return np.where(self.broken <= FEASIBLE, s, np.inf)

    def nearest(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(row, s) of the best design for every point of the flat."""
        distances = self.distances(flat)
        rows = np.argmin(distances, axis=1)
        return rows, distances[np.arange(len(flat)), rows]

    def undominated(self, rows: np.ndarray) -> np.ndarray:
        """Those of `rows` that are feasible and that nothing known is better than, by their goals, none twice; the
        best of each goal rather than what is next to it."""
        feasible = np.flatnonzero(self.broken <= FEASIBLE)
        scaled, kept = self.scaled(), []
        rows = rows[self.broken[rows] <= FEASIBLE]
        rows = rows[np.lexsort(self.terms[rows].T[::-1])]
        bests = rows[np.argmin(self.terms[rows], axis=0)] if len(rows) else rows
        for k in rows[np.argsort(~np.isin(rows, bests), kind="stable")]:
            others = scaled[feasible]
            better = np.all(others <= scaled[k] + BETTER**2, axis=1) & np.any(others < scaled[k] - BETTER, axis=1)
            same = any(np.max(np.abs(scaled[k] - scaled[j])) < DISTINCT for j in kept)
            if not np.any(better) and not same:
                kept.append(k)
        order = np.array(kept, dtype=int)
        return order[np.lexsort(self.terms[order].T[::-1])]

    # --- one program ----------------------------------------------------------------------------------------------

    def _seen(self, look: Look) -> Callable[[np.ndarray], Any]:
        """t -> (scaled terms, slopes, violations, slopes)."""
        ranges = np.maximum(self.worst - self.best, LEAST_RANGE)

        @remembered
        def seen(t):
            values, by_t, shortfall = look(t)
            judged, slopes = self.score(values)
            violations, pushes = np.asarray(judged.violations), np.asarray(slopes.violations)
            if shortfall > 0:
                raise Lost
            terms, by_value = (np.asarray(v) for v in self.terms_of(values))
            self.visited.append((t, terms, float(np.max(violations, initial=0.0))))
            return (terms - self.best) / ranges, by_value @ by_t / ranges[:, None], violations, pushes @ by_t

        return seen

    def _sum(self, look: Look, t: np.ndarray, weight: np.ndarray, to: float = ENDS_TO) -> np.ndarray:
        """The least weighted sum of the goals. to: what may be left of it."""
        seen = self._seen(look)
        constraint = {"type": "ineq", "fun": lambda t: -seen(t)[2], "jac": lambda t: -seen(t)[3]}

        def run(t, bounds):
            return minimize(
                lambda t: float(weight @ seen(t)[0]),
                t,
                jac=lambda t: weight @ seen(t)[1],
                bounds=bounds,
                constraints=[constraint] if self.problem.constrained else [],
                method="SLSQP",
                options={"maxiter": ENDS, "ftol": to},
            ).x

        return boxed(run, t)

    def _diagonal(self, look: Look, t: np.ndarray, point: np.ndarray) -> np.ndarray:
        """The least s with every goal at most p_i + s."""
        seen = self._seen(look)

        def room(ts):
            terms, _, violations, _ = seen(ts[:-1])
            return np.concatenate([point + ts[-1] - terms, -violations])

        def slopes(ts):
            _, by_terms, _, by_violations = seen(ts[:-1])
            return np.block(
                [[-by_terms, np.ones((len(point), 1))], [-by_violations, np.zeros((len(by_violations), 1))]]
            )

        last = np.append(np.zeros(len(t)), 1.0)

        def run(t, bounds):
            return minimize(
                lambda ts: ts[-1],
                np.append(t, np.max(seen(t)[0] - point)),
                jac=lambda ts: last,
                bounds=[*bounds, (None, None)],
                constraints=[{"type": "ineq", "fun": room, "jac": slopes}],
                method="SLSQP",
                options={"maxiter": ENOUGH, "ftol": 1e-7},
            ).x[:-1]

        return boxed(run, t)


def _simplex(goals: int, points: int) -> np.ndarray:
    """Points with coordinates that add up to 1, evenly spread (Das and Dennis), of about the wanted number."""
    parts = points - 1
    if goals == 3:
        parts = int(np.ceil((np.sqrt(8 * points + 1) - 3) / 2))
    return np.array([p for p in product(range(parts + 1), repeat=goals) if sum(p) == parts]) / parts


def _beyond(t: np.ndarray) -> np.ndarray:
    """Designs beyond both ends of a front, along the line to the last ones: an end at a kink may have been missed."""
    if len(t) < 2:
        return t
    steps = np.array([0.1, 0.25, 0.5, 1.0])[:, None]
    return np.clip(np.concatenate([t[0] + steps * (t[0] - t[1]), t[-1] + steps * (t[-1] - t[-2])]), 0.0, 1.0)


def _evenly(front: np.ndarray, t: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Where on the flat to begin so that designs are evenly spaced between the ends of a front of two goals, and
    designs to begin with."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(front, axis=0).T))])
    wanted = np.linspace(0, along[-1], points)[1:-1]
    places = np.stack([np.interp(wanted, along, front[:, i]) for i in range(2)], axis=1)
    # Back along the diagonal to the flat.
    flat = places + 0.5 * (1 - np.sum(places, axis=1, keepdims=True))
    return flat, np.stack([np.interp(wanted, along, column) for column in t.T], axis=1)
