"""Many starts at once: first-order steps on all of them, then a second-order finish on the best distinct ones.

1. Starts: a scrambled Sobol set over the unit cube, and the design that the search starts from.
2. Every member minimises its augmented Lagrangian (Powell, Hestenes, Rockafellar) with an optax optimiser in the free
   variables of `space.py`. A member without equilibrium descends its shortfall until it has one. A member that has
   come to rest stops, and the members that are left are packed together, so it costs nothing any more. Of many, one
   that stays beside a better one is left to it (`Company`).
3. The best members of each region are finished by sequential quadratic programming or least squares (`finish.py`),
   which land on the active constraints and bounds to the last digits.

The physics is compiled once, for a chunk of members, with all derivatives; starts, steps, finish and report share it.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree
from scipy.stats import qmc

from softgrip_jax.errors import InputError
from softgrip_jax.folders import DeferInterrupt
from softgrip_jax.quantities import State
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Solution, Status, in_units

from ..problem import Problem, Scales, Scaling, Score, at_limit
from ..space import to_free, to_unit
from .finish import NO_EQUILIBRIUM_RANK, ROUNDING, finish

OPTIMISERS = ("adam", "adabelief", "amsgrad", "lion", "nadam", "rmsprop", "sgd", "yogi")
"""optax optimisers that need nothing but a gradient and a learning rate."""

FEASIBLE = 1e-6
"""A design is feasible when no scaled constraint is broken by more than this: a millionth of its bound."""

ACTIVE = 1e-4
"""A constraint or a bound is called active within this (scaled): ten times the spread of finished designs."""

PERIOD = 10
"""Steps between two updates of the multipliers: the optimiser settles a little in between."""

PENALTY, PENALTY_GROWTH, PENALTY_MAX = 10.0, 2.0, 1e4
"""Of the augmented Lagrangian: with pure numbers of order one, 10 bends the objective's slope back within a tenth of a
bound. It grows while the violation does not halve between two updates."""

LOOSELY_FEASIBLE, CHARGE = 1e-2, 100.0
"""The descent keeps the best design that breaks nothing by more than this (scaled), its violation charged by so much:
multipliers approach a constraint from its broken side, and the finish removes what is left."""

ROOM = 3e-5
"""The descent keeps this much room to every constraint (scaled), so that its ends are feasible by themselves. Where a
constraint holds the optimum, this is what the best of the descent is worse by, and little else."""

STALLED = 5e-4
"""A member rests when it moves less than this part of every range per step, nearly feasible, for PERIOD steps. With
2e-3 the best of `finger_tip_force` rested a few ten-thousandths of its objective short of the optimum."""

FINAL_RATE = 0.02
"""The learning rate falls along a cosine to this part of its start."""

STEEPEST = 1.0
"""Slopes are cut to this length: a design far outside of a constraint would else fill the memory of the optimiser with
a slope hundreds of times that of the objective, and hardly move for long after it is back."""

FINISHED = 16
"""Members that are finished where nothing else is said: half a second's work for a shell."""

REGION, DISTINCT = 0.05, 0.01
"""Two members are of one region, two finished designs are the same, when no variable differs by more of its range."""

UNFELT = 1e-9
"""A variable that changes a quantity by less than this part of its size, over its whole range, does not change it."""

LOOKS = 2
"""A member within REGION of a better one at so many looks in a row, PERIOD steps apart, is left to it."""

CPU_CHUNK = 16
"""Members per call on a CPU at most, where a member alone costs as much as a member in a batch: as many as are finished
together, so that no call is filled up with copies. Elsewhere a chunk holds all the starts."""

NEARBY_CHUNK = 64
"""Designs that are solved together from what is known nearby."""

ROUNDS = 6
"""Each with a new Jacobian: from a design far away Newton's method takes four or five."""

REMEMBERED = 2048
"""Designs that a search knows as places to begin from: 13 kB each for the beam of a finger."""


class Evaluated(NamedTuple):
    """What is known of designs, each array with one row per design."""

    values: Float[np.ndarray, "k q"]
    value_slopes: Float[np.ndarray, "k q n"]
    shortfall: Float[np.ndarray, " k"]
    shortfall_slopes: Float[np.ndarray, "k n"]
    statuses: Int[np.ndarray, "k s"]
    reasons: Any = None
    details: Any = None
    limit_margins: Any = None
    """Limit pressure over pressure, (k, s), NaN where that is not known: of `solve`, and of what is not near."""


class Memory:
    """The last designs of a kind, REMEMBERED of them, and what is known of them: arrays, one row per design."""

    def __init__(self, variables: int):
        self._at, self._places = np.zeros((REMEMBERED, variables)), cast(Any, None)
        self._written = 0

    @property
    def at(self) -> np.ndarray:
        """Unit values of the designs."""
        return self._at[: self._written]

    @property
    def places(self) -> Any:
        """What is known of them, where there are any."""
        return jax.tree.map(lambda v: v[: self._written], self._places)

    def nearest(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which design is nearest to each row of unit values, and the square of its distance."""
        # Steps that grow without bound lead nowhere: such a design begins anywhere, and finds nothing.
        distance, nearest = KDTree(self.at).query(np.nan_to_num(t))
        return np.asarray(nearest), np.asarray(distance) ** 2

    def remember(self, t: np.ndarray, places: Any, good: np.ndarray) -> None:
        """Keep the good ones, in the places of the oldest."""
        rows = jax.tree.map(lambda v: v[good][-REMEMBERED:], (t, places))
        if self._places is None:
            self._places = jax.tree.map(lambda v: np.empty((REMEMBERED, *v.shape[1:]), v.dtype), rows[1])
        where = (self._written + np.arange(len(rows[0]))) % REMEMBERED

        def write(memory, new):
            memory[where] = new

        jax.tree.map(write, (self._at, self._places), rows)
        self._written += len(where)


@runtime_checkable
class SolvesDesigns(Protocol):
    """What a search asks of whoever solves its designs, which are rows of unit values."""

    home: np.ndarray
    """Unit values towards which a design goes that knows no other way back to an answer."""
    moving: np.ndarray | None
    """During the descent, which of the starts the rows that are asked for belong to."""
    solves: int
    """How many designs were solved."""

    def prepare(self) -> None:
        """Have the programs made that every search needs, where a command keeps them."""
        ...

    def __call__(self, t: Any) -> Evaluated:
        """The designs, with derivatives."""
        ...

    def solve(self, t: Any) -> Evaluated:
        """The designs along the whole way from zero load, as `sg.solve` does it; without derivatives."""
        ...

    def solutions(self, t: np.ndarray) -> dict[tuple[str, State], list[Solution]]:
        """The solved states of the designs, along the whole way from zero load."""
        ...


class Evaluator:
    """The compiled physics of a problem: any number of designs, in chunks of one size. Counts what it solves.

    It remembers where it has been: a design is solved from the nearest one that it knows (`Problem.solve_nearby`), and
    along the whole way from zero load (`Problem.solve`) only where that does not lead to an equilibrium. What lies
    beyond a limit point learns from that how far (`Problem.lost_nearby`), and what has no equilibrium for another
    reason asks for each state that it lacks (`Problem.short`). Each of them is compiled when it is first needed, the
    first two together (`Problem.prepare`).
    """

    def __init__(self, problem: Problem, chunk: int):
        self.problem, self.chunk, self.solves = problem, chunk, 0
        self.nearby_chunk = NEARBY_CHUNK if jax.default_backend() == "cpu" else max(chunk, NEARBY_CHUNK)
        """Designs that are solved together from what is known nearby; all, where a call costs the same for any."""
        self.checked_chunk = CPU_CHUNK if jax.default_backend() == "cpu" else self.nearby_chunk
        """Designs of `Problem.standing` that are solved together: each waits for the longest way of all."""
        self.home = problem.home()
        """Unit values towards which a design goes that knows no other way back to an answer."""
        self.is_near = bool(problem.followed)
        self.states = [Memory(problem.space.size) for _ in problem.followed] if self.is_near else []
        """Of each `Problem.followed` state: designs that have it, and the state."""
        self.limits = [Memory(problem.space.size) for _ in problem.pressed] if self.is_near else []
        """Of each `Problem.pressed` state: designs without it, and the limit point before it."""
        self.moving: np.ndarray | None = None
        """During the descent, which of the starts the rows that are asked for belong to."""

    def __call__(self, t: Any) -> Evaluated:
        """The designs at rows of unit values, with derivatives."""
        t = np.atleast_2d(np.asarray(t, dtype=float))
        self.solves += len(t)
        if not self.is_near:
            return self._with_shortfalls(t)
        if not self.can_begin:
            self.prepare()
            self.begin(t[:1])
        found, left = cast(Any, None), np.arange(len(t))

        def answer(rows: np.ndarray, fresh: Evaluated) -> None:
            nonlocal found
            found = fresh if found is None else jax.tree.map(partial(_replaced, rows), found, fresh)

        if self.can_begin:
            doubtful = self._is_doubtful(t)
            fresh, left = self.nearby(t, doubtful)
            answer(np.arange(len(t)), fresh)
            left = left[self._lost(t, found, left)]
            again = left[doubtful[left]]
            if len(again):
                fresh, still = self.nearby(t[again])
                answer(again, fresh)
                left = np.setdiff1d(left, np.delete(again, still))
        if len(left) and found is not None and any(len(limit.at) for limit in self.limits):
            left = self._limits_first(t, found, left)
        if len(left):
            # What has an equilibrium all the same is known now, and found at once.
            followed, along = left, self.begin(t[left])
            if found is not None or self.can_begin:
                fresh, still = self.nearby(t[left])
                answer(left, fresh)
                left = left[still]
            else:
                answer(left, along._replace(value_slopes=np.zeros_like(along.value_slopes)))
            left = self._limits_first(t, found, left)
            along = jax.tree.map(lambda v: v[np.searchsorted(followed, left)], along)
            left = left[self._short(t, found, left, along)]
        if len(left):
            answer(left, self._with_shortfalls(t[left])._replace(limit_margins=None))
        return cast(Evaluated, found)

    def prepare(self) -> None:
        """Have the programs made that every search needs."""
        if self.is_near:
            self.problem.prepare(self.chunk, self.nearby_chunk, self.checked_chunk)

    @property
    def can_begin(self) -> bool:
        """Whether a design with each of the states is known."""
        return all(len(memory.at) for memory in self.states)

    def starts(self, t: np.ndarray) -> tuple[tuple[Any, ...], np.ndarray]:
        """(the states of the designs nearest to rows of unit values, the square of the distance of the farthest)."""
        nearest = [memory.nearest(t) for memory in self.states]
        known = [
            jax.tree.map(lambda v, k=k: v[k], memory.places)
            for memory, (k, _) in zip(self.states, nearest, strict=True)
        ]
        return tuple(known), np.max([distance for _, distance in nearest], axis=0)

    def _remember(self, t: np.ndarray, known: tuple[Any, ...], has: np.ndarray) -> None:
        """Keep the states that designs t have, (rows, states)."""
        for memory, places, good in zip(self.states, known, has.T, strict=True):
            memory.remember(t, places, good)

    def _is_doubtful(self, t: np.ndarray) -> np.ndarray:
        """Whether the design next to each row is one that lacks a state."""
        doubtful = np.zeros(len(t), bool)
        for state, limit in zip(self.problem.pressed, self.limits, strict=True):
            memory = self.states[self.problem.followed.index(state)]
            if len(limit.at):
                doubtful |= limit.nearest(t)[1] < memory.nearest(t)[1]
        return doubtful

    def _missing(self, values: np.ndarray, states: list[tuple[str, State]]) -> np.ndarray:
        """Which of the states rows of values do not have, shape (rows, states)."""
        missing = np.zeros((len(values), len(states)), bool)
        for k, state in enumerate(states):
            missing[:, k] = np.any(np.isnan(values[:, self.problem.columns_of(state)]), axis=1)
        return missing

    def _limits_first(self, t: np.ndarray, found: Evaluated, left: np.ndarray) -> np.ndarray:
        """The rows whose limit points do not say what they lack: those of a few tell of others, and those that learn
        nothing from them are asked for their own."""
        few = left[: self.chunk]
        left = left[self._look_for_limits(t, found, few, left)]
        return left[self._look_for_limits(t, found, np.setdiff1d(left, few), left)]

    def _look_for_limits(self, t: np.ndarray, found: Evaluated, asked: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Find the limit points that the rows `asked` lie beyond, along the whole way, and do as `_lost` for `rows`."""
        missing, any_found = self._missing(found.values[asked], self.problem.pressed), False
        for place, limit in enumerate(self.limits):
            of = asked[missing[:, place]]
            if len(of):
                at, is_fold, _ = self._ends(t[of], place)
                limit.remember(t[of], at, is_fold)
                any_found |= bool(np.any(is_fold))
        return self._lost(t, found, rows) if any_found else np.arange(len(rows))

    def _ends(self, t: np.ndarray, place: int) -> tuple[Any, np.ndarray, np.ndarray]:
        """`Problem.end` of rows of unit values."""
        return self.in_chunks(partial(self.problem.ends, place=place), self.chunk, t)

    def _limit_margins(self, t: np.ndarray) -> np.ndarray:
        """`Evaluated.limit_margins` of designs, for states beyond whose limit points designs of this search were found:
        the program that tells them is compiled."""
        states = self.problem.asked.states
        margins = np.full((len(t), len(states)), np.nan)
        for place, (state, limit) in enumerate(zip(self.problem.pressed, self.limits, strict=True)):
            if len(limit.at) and state in states:
                _, is_fold, ratio = self._ends(t, place)
                margins[:, states.index(state)] = np.where(is_fold, ratio, np.nan)
        return margins

    def _lost(self, t: np.ndarray, found: Evaluated, rows: np.ndarray) -> np.ndarray:
        """Put into rows of `found` how far they lie beyond limit points near known ones; the places among the rows of
        those for which that is not the whole truth."""
        if not len(rows):
            return np.zeros(0, int)
        missing = self._missing(found.values[rows], self.problem.pressed)
        shortfall, slopes = np.zeros(len(rows)), np.zeros((len(rows), t.shape[1]))
        explained = np.zeros_like(missing)
        for place, limit in enumerate(self.limits):
            (of,) = np.nonzero(missing[:, place])
            if not (len(of) and len(limit.at)):
                continue
            nearest = limit.nearest(t[rows[of]])[0]
            start = jax.tree.map(lambda v, nearest=nearest: v[nearest], limit.places)
            program = partial(self.problem.all_lost_nearby, place=place)
            by, by_t, at, good = self.in_chunks(program, self.nearby_chunk, t[rows[of]], start)
            beyond = good & (by > 0)
            limit.remember(t[rows[of]], at, beyond)
            explained[of, place] = beyond
            shortfall[of] += by
            slopes[of] += by_t
        # Whatever else a design lacks says nothing about how far it is from having it.
        others = [state for state in self.problem.measured.states if state not in self.problem.pressed]
        other = np.any(self._missing(found.values[rows], others), axis=1)
        done = np.any(missing, axis=1) & np.all(explained == missing, axis=1) & ~other
        put = rows[done]
        found.shortfall[put], found.shortfall_slopes[put] = shortfall[done], slopes[done]
        found.value_slopes[put] = np.where(np.isnan(found.values[put])[..., None], 0.0, found.value_slopes[put])
        for place, state in enumerate(self.problem.pressed):
            if state in self.problem.asked.states:
                of = rows[done & missing[:, place]]
                found.statuses[of, self.problem.asked.states.index(state)] = int(Status.BEYOND_LIMIT)
        return np.flatnonzero(~done)

    def _short(self, t: np.ndarray, found: Evaluated, rows: np.ndarray, along: Evaluated) -> np.ndarray:
        """Put into rows of `found` how far they lie beyond what their scenes can do, and what there is `along` the way
        from zero load; the places among the rows of those that have an equilibrium there all the same."""
        lost = along.shortfall > 0
        put, along = rows[lost], jax.tree.map(lambda v: v[lost], along)
        shortfall, slopes = np.zeros(len(put)), np.zeros((len(put), t.shape[1]))
        missing = self._missing(along.values, self.problem.measured.states)
        for place in np.flatnonzero(np.any(missing, axis=0)):
            (of,) = np.nonzero(missing[:, place])
            program = partial(self.problem.all_short, home=self.home, place=int(place))
            by, by_t = self.in_chunks(program, self.chunk, t[put[of]])
            shortfall[of] += by
            slopes[of] += by_t
        found.shortfall[put], found.shortfall_slopes[put] = shortfall, slopes
        found.statuses[put], found.values[put] = along.statuses, along.values
        found.value_slopes[put] = np.nan_to_num(found.value_slopes[put])
        return np.flatnonzero(~lost)

    def solve(self, t: Any) -> Evaluated:
        """The designs along the whole way from zero load, as `sg.solve` does it; without derivatives."""
        t = np.atleast_2d(np.asarray(t, dtype=float))
        self.solves += len(t)
        if not self.is_near:
            return self._with_shortfalls(t)
        return evaluated(self._solve(t), t.shape[1])._replace(limit_margins=self._limit_margins(t))

    def solutions(self, t: np.ndarray) -> dict[tuple[str, State], list[Solution]]:
        """The solved states of the designs at rows of unit values, along the whole way from zero load."""
        found = self._solve(t) if self.is_near else self._measured(t)[0]
        if not found.solutions:  # a problem of formulas
            return {}
        rows = [jax.tree.map(lambda v, k=k: jnp.asarray(v[k]), found.solutions) for k in range(len(t))]
        return {state: [row[j] for row in rows] for j, state in enumerate(self.problem.solved_states)}

    def _with_shortfalls(self, t: np.ndarray) -> Evaluated:
        found, slopes = self._measured(t)
        return Evaluated(
            found.values,
            slopes.values,
            found.shortfall,
            slopes.shortfall,
            found.statuses,
            found.reasons,
            found.details,
            found.limit_margins,
        )

    def _measured(self, t: np.ndarray) -> Any:
        return self.in_chunks(partial(self.problem.measured_with_slopes, home=self.home), self.chunk, t)

    def _solve(self, t: np.ndarray) -> Any:
        return self.in_chunks(self.problem.solved, self.chunk, t)

    def begin(self, t: np.ndarray) -> Evaluated:
        """Get to know designs along the whole way from zero load: what is found there, without derivatives."""
        found = self._solve(t)
        here = partial(Evaluator._run, self, self.problem.known)  # whoever solved it: it is a few zeros
        known = _in_calls(here, self.chunk, t, found.solutions)
        self._remember(t, known, ~self._missing(np.asarray(found.values), self.problem.followed))
        return evaluated(found, t.shape[1])

    def nearby(self, t: np.ndarray, doubtful: np.ndarray | None = None) -> tuple[Evaluated, np.ndarray]:
        """What is found from the designs that are known, and the rows that are not found so; those that are doubtful
        are tried once."""
        known, distance = self.starts(t)
        # Designs that are solved together wait for the one with the longest way.
        left, found = np.argsort(distance, kind="stable"), cast(Any, None)
        known = jax.tree.map(lambda v: v[left], known)
        for _ in range(ROUNDS):
            measured, slopes, known = self.in_chunks(self.problem.solved_nearby, self.nearby_chunk, t[left], known)
            fresh = evaluated(measured, t.shape[1], slopes)
            beyond = self._beyond(t[left], fresh)
            found = fresh if found is None else found
            found = jax.tree.map(partial(_replaced, left), found, fresh)
            good = fresh.shortfall == 0
            self._remember(t[left], known, ~self._missing(fresh.values, self.problem.followed))
            on = ~good & ~beyond & np.all([np.all(np.isfinite(place.u), axis=1) for place in known], axis=0)
            on &= True if doubtful is None else ~doubtful[left]
            known, left = jax.tree.map(lambda v, on=on: v[on], known), left[on]
            if not len(left):
                break
        return found, np.flatnonzero(found.shortfall > 0)

    def _beyond(self, t: np.ndarray, fresh: Evaluated) -> np.ndarray:
        """Which of the rows that have an answer have none along the whole way from zero load: `Problem.doubted` states
        that lie beyond limit points are taken out of `fresh`."""
        beyond = np.zeros(len(t), bool)
        (rows,) = np.nonzero(fresh.shortfall == 0)
        if len(rows) and self.problem.doubted:
            stands = self.in_chunks(self.problem.standing, self.checked_chunk, t[rows])
            for state, there in zip(self.problem.doubted, stands.T, strict=True):
                lost = rows[~there]
                fresh.values[np.ix_(lost, self.problem.columns_of(state))] = np.nan
                fresh.shortfall[lost], beyond[lost] = 1.0, True
        return beyond

    def in_chunks(self, program: Any, size: int, *rows: Any) -> Any:
        """program(*rows), any number of them, by calls of one size."""
        return _in_calls(partial(self._run, program), size, *rows)

    def _run(self, program: Any, batches: list[Any]) -> list[Any]:
        """program(*rows) of every batch; `islands` has it done by others."""
        return [program(*rows) for rows in batches]


def _in_calls(run: Callable[[list[Any]], list[Any]], size: int, *rows: Any) -> Any:
    """What a program says of any number of rows, from batches of one size: what is missing is the last row again.

    run: batches -> what the program says of each.
    """
    count, batches = len(rows[0]), []
    for start in range(0, count, size):
        part = jax.tree.map(lambda v, start=start: np.asarray(v[start : start + size]), rows)
        batches.append(jax.tree.map(lambda v: np.concatenate([v, np.repeat(v[-1:], size - len(v), axis=0)]), part))
    parts = jax.device_get(run(batches))  # at once: one array after the other would wait for a GPU each time
    return jax.tree.map(lambda *x: np.concatenate(x)[:count], *parts)


def evaluated(found: Any, variables: int, slopes: np.ndarray | None = None) -> Evaluated:
    """What was solved, without a way back where there is no equilibrium."""
    count = len(found.values)
    by_t = np.full((*found.values.shape, variables), np.nan) if slopes is None else slopes
    return Evaluated(
        found.values,
        by_t,
        found.shortfall,
        np.zeros((count, variables)),
        found.statuses,
        found.reasons,
        found.details,
    )


def chunk_for(starts: int, finishes: int) -> int:
    """Members per call, see CPU_CHUNK."""
    return min(starts, max(finishes, 1), CPU_CHUNK) if jax.default_backend() == "cpu" else starts


def prepare(
    problem: Problem, starts: int, finishes: int, evaluator: Callable[[Problem, int], SolvesDesigns] = Evaluator
) -> None:
    """Have the programs of a search made, where a command keeps them: they are compiled while it does other things."""
    evaluator(problem, chunk_for(starts, finishes)).prepare()


class SearchMember(NamedTuple):
    """One descent: what it carries from step to step."""

    u: Float[Array, " n"]
    t: Float[Array, " n"]
    """The unit values of u."""
    memory: Any
    """Of the optimiser."""
    multipliers: Float[Array, " m"]
    penalty: Float[Array, ""]
    last_violation: Float[Array, ""]
    stalled: Int[Array, ""]
    """Steps in a row in which it hardly moved."""
    rank: Float[Array, ""]
    """Of the design before the last step."""
    objective: Float[Array, ""]
    """Of that design, where it is nearly feasible; else NaN."""
    best_t: Float[Array, " n"]
    best_rank: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class Design:
    """One design and how good it is."""

    t: np.ndarray
    x: np.ndarray
    """Variables in SI, in the order of `Space.names`."""
    values: np.ndarray
    """Quantities in SI, in the order of `Problem.quantities`."""
    objective: float
    violations: np.ndarray
    """Scaled, one per constraint (`Problem.constraint_labels`); negative is room."""
    margins: np.ndarray
    """Of the rules in m, in the order of `Problem.rules`; negative where one is broken."""
    statuses: tuple[Status, ...]
    """Of the states in the order of `Problem.asked.states`, as the scenes say with their rules on."""
    reasons: tuple[str, ...]
    """Why each state is not OK, in words; 'solved' where it is."""
    feasible: bool
    rank: float
    active: tuple[str, ...]
    """Names of the constraints and bounds that hold it where it is; of states at their limit pressure, too, where that
    is known."""
    limit_margins: dict[str, float] = dataclasses.field(default_factory=dict)
    """By state, its limit pressure over its pressure: of shells, and of fingers where designs of the search lie beyond
    their limit points."""

    @property
    def answered(self) -> bool:
        """Whether every state that is asked of it exists; else its objective and its violations say nothing."""
        return self.rank < 2 * NO_EQUILIBRIUM_RANK

    @property
    def violation(self) -> float:
        """The largest scaled violation, 0 where every constraint is kept."""
        return float(max(0.0, np.max(self.violations, initial=0.0)))


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """Everything that a search found.

    Args:
        problem: what was asked.
        reference: the design that the search started from.
        designs: distinct designs, the best first; infeasible ones only where nothing feasible was found.
        history: per step, shape (steps,), dimensionless: best_objective so far, and how many batch members are
            with_equilibrium, feasible (loosely) so far, moving.
        solves: designs evaluated.
        seconds: by stage, s.
        stopped: by Ctrl-C: the designs are the best until then, and not finished.
        paths: the objective of every start at every step, dimensionless, shape (steps, starts); NaN where it is not
            (nearly) feasible.
        descended: the objective of the best feasible design before the finish, dimensionless.
        reached: how many starts ended within REGION of each of the designs, each start at the nearest one; one that was
            left to another ends with it.
        merged: how many starts came and stayed beside a better one on the way, and were left to it.
        solutions: of the start and of the best design, the states that were solved along the whole way from zero load.
        remarks: sentences for the report: of limits that hold for every state (`Problem.always_kept`), of scales that
            are not those of the starting design (`Scaling`), of a start outside of the bounds, of numbers that are
            one and begin as several, of goals that no variable changes, and of variables that change nothing.

    Examples:
        >>> [field.name for field in __import__("dataclasses").fields(optim.SearchResult)][:3]
        ['problem', 'reference', 'designs']
    """

    problem: Problem
    reference: Design
    designs: list[Design]
    history: dict[str, np.ndarray]
    solves: int
    seconds: dict[str, float]
    stopped: bool = False
    paths: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    descended: float = float("nan")
    reached: tuple[int, ...] = ()
    merged: int = 0
    remarks: tuple[str, ...] = ()
    solutions: dict[tuple[str, State], list[Solution]] = dataclasses.field(default_factory=dict)

    @property
    def best(self) -> Design:
        """The best of the designs."""
        return self.designs[0]


def search(
    problem: Problem,
    *,
    starts: int = 256,
    steps: int = 100,
    optimiser: str | optax.GradientTransformation = "adam",
    learning_rate: float = 0.3,
    finishes: int = FINISHED,
    seed: int = 0,
    report: Callable[[int, float, int, int], None] | None = None,
    remark: Callable[[str], None] = lambda sentence: None,
    evaluator: Callable[[Problem, int], SolvesDesigns] = Evaluator,
) -> SearchResult:
    """The best distinct feasible designs of a problem.

    Many starts descend at once by a first-order method with multipliers for the constraints; the best are finished by a
    second-order method. The same seed on the same machine gives the same answer. A search begins from any design: one
    without an answer is one of the starts, and the others lead it back. Ctrl-C after the first step ends the search and
    keeps the best designs until then.

    Args:
        problem: variables, goals and limits.
        starts: size of the batch.
        steps: of the optimiser at most; members of the batch that no longer improve stop before.
        optimiser: name of an optax optimiser, see OPTIMISERS, or any transformation of gradients that optax knows.
        learning_rate: in free variables, dimensionless, whose range is pi; a transformation of your own has its own.
        finishes: members that are finished, the best of as many regions of the cube; 0 for the descent alone.
        seed: of the Sobol set.
        report: called after every step with (step, best objective so far, feasible members, moving members).
        remark: called with a sentence where the starting design has no answer.
        evaluator: what solves the designs, from the problem and a size of batches; see `optim.design.islands`.

    Raises:
        InputError: for an unknown optimiser, and for a number below 1.

    Source: docs/theory/search.md.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> space = optim.Space({"free": sg.shell.Free(shell)}, [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        >>> goal = optim.Goal("reach", optim.Quantity("inflation", at=15 * kPa), target=13.4067 * mm)
        >>> best = optim.search(optim.Problem(space, [goal]), starts=4, steps=10, finishes=1).best
        >>> print(f"{best.x[0] / mm:.3f} mm")  # the wall that inflates so
        1.100 mm
    """
    if isinstance(optimiser, str) and optimiser not in OPTIMISERS:
        raise InputError(f"The optimiser is {optimiser!r}; it must be one of {', '.join(OPTIMISERS)}.")
    for name, number, least in (("starts", starts, 1), ("steps", steps, 1), ("finishes", finishes, 0)):
        if number < least:
            raise InputError(f"{name} is {number}; it must be {least} or more.")
    space, began = problem.space, time.perf_counter()
    evaluate = evaluator(problem, chunk_for(starts, finishes))
    reference_t = space.to_unit(space.reference)
    at_reference = evaluate(reference_t)
    start_t = _starts(space.inside(reference_t), starts, seed)
    scaling = Scaling(problem)
    scaling.learn(at_reference.values)
    if at_reference.shortfall[0] > 0:
        remark(_without_answer(at_reference.statuses[0]))
        sampled = evaluate(start_t)
        scaling.learn(sampled.values)
        answered = np.flatnonzero(sampled.shortfall == 0)
        if len(answered):
            evaluate.home = start_t[answered[0]]
    judging = problem.kept(
        ("judging",), lambda: jax.jit(lambda values, scales: score_with_slopes(problem, scales, values))
    )

    def score(values: Any) -> tuple[Score, Score]:
        return judging(values, scaling.scales)

    name = (optimiser, learning_rate, steps) if isinstance(optimiser, str) else optimiser
    if isinstance(optimiser, str):
        optimiser = getattr(optax, optimiser)(optax.cosine_decay_schedule(learning_rate, steps, FINAL_RATE))
    rule = optax.chain(optax.clip_by_global_norm(STEEPEST), optimiser)
    begin = problem.kept(("begin", name), lambda: jax.jit(lambda t: (to_free(t), jax.vmap(rule.init)(to_free(t)))))
    members = _begin(start_t, len(problem.constrained), *begin(start_t))
    advance = problem.kept(
        ("advance", name), lambda: jax.jit(jax.vmap(partial(_step, problem, rule), in_axes=(None, 0, 0, None)))
    )
    # Called for nothing, to be compiled.
    score(at_reference.values[0])
    advance(scaling.scales, members, jax.tree.map(lambda v: np.repeat(v, len(members.u), axis=0), at_reference), 0)
    compiled = time.perf_counter()

    company, felt = Company(starts), Felt(problem)
    members, history, paths, stopped = _descend(members, evaluate, advance, scaling, steps, report, company, felt)
    with DeferInterrupt() as waiting:  # what was found is known only once it is solved
        descended = time.perf_counter()
        remarks = (
            *problem.always_kept(),
            *scaling.remarks(),
            *outside_of_bounds(problem, reference_t),
            *begun_apart(problem),
            *felt.sentences(),
        )
        ends, ranks = company.ends(np.asarray(members.best_t), np.asarray(members.best_rank))
        candidates = ends[_distinct(felt.of(ends), ranks, REGION)[: max(finishes, 1)]]
        designs = designs_at(problem, score, evaluate, candidates)
    stopped |= waiting.asked
    alone = min((d.objective for d in designs if d.feasible), default=float("nan"))
    if finishes and not stopped:
        try:
            finished = finish(candidates, evaluate, problem, scaling.scales, score)
            # A finish may fail (a kink, the edge of equilibrium): the member's own best then stands.
            both = zip(designs_at(problem, score, evaluate, finished), designs, strict=True)
            designs = [after if after.rank <= before.rank else before for after, before in both]
        except KeyboardInterrupt:
            stopped = True
    with DeferInterrupt() as waiting:
        rows = felt.of(np.stack([d.t for d in designs]))
        order = _distinct(rows, np.array([d.rank for d in designs]), DISTINCT)
        chosen = [designs[k] for k in order]
        if chosen[0].feasible:
            chosen = [d for d in chosen if d.feasible]
        reference = designs_at(problem, score, evaluate, reference_t[None])[0]
        solutions = evaluate.solutions(np.stack([reference_t, chosen[0].t]))
    return SearchResult(
        problem,
        reference,
        chosen,
        history,
        evaluate.solves,
        {
            "compile": compiled - began,
            "descend": descended - compiled,
            "finish": time.perf_counter() - descended,
        },
        stopped or waiting.asked,
        paths,
        alone,
        _reached(felt.of(ends), felt.of(np.stack([d.t for d in chosen]))),
        company.merged,
        remarks,
        solutions,
    )


def _reached(ends: np.ndarray, designs: np.ndarray) -> tuple[int, ...]:
    """How many ends of descents are within REGION of each design and nearer to it than to any other."""
    away = np.max(np.abs(ends[:, None] - designs), axis=2, initial=0.0)
    nearest = np.where(np.min(away, axis=1) <= REGION, np.argmin(away, axis=1), -1)
    return tuple(int(np.sum(nearest == k)) for k in range(len(designs)))


def _without_answer(statuses: Any) -> str:
    words = ", ".join(dict.fromkeys(Status(int(s)).name for s in statuses if s != Status.OK))
    return f"The starting design has no answer ({words or 'OK'}); the search begins from it all the same."


def outside_of_bounds(problem: Problem, reference_t: np.ndarray) -> list[str]:
    """A sentence where the starting design, by its unit values, is not between the bounds."""
    beyond = (reference_t < -ROUNDING) | (reference_t > 1 + ROUNDING)
    names = [name for name, is_beyond in zip(problem.space.names, beyond, strict=True) if is_beyond]
    if not names:
        return []
    return [f"The start is outside of the bounds of {', '.join(names)}: the search begins from the nearest bound."]


def begun_apart(problem: Problem) -> list[str]:
    """A sentence per number that is one in every design, and that the scenes of the start have at several values."""
    space, said = problem.space, []
    at_start = [row for tied in space.leaves_of(space.scenes) for row in np.stack([*map(np.ravel, tied)], axis=1)]
    for names, kind, values in zip(space.tied, space.kinds, at_start, strict=True):
        begun = dict.fromkeys(in_units(value, kind) for value in values)
        if len(begun) > 1:
            said.append(f"{names} is one number, of which the scenes have {', '.join(begun)}: the start has the first.")
    return said


def _starts(reference: np.ndarray, starts: int, seed: int) -> np.ndarray:
    """The reference and a scrambled Sobol set, unit values, shape (starts, n)."""
    power = int(np.ceil(np.log2(max(starts, 2))))
    points = qmc.Sobol(len(reference), scramble=True, rng=seed).random_base2(power)
    return np.concatenate([reference[None], points])[:starts]


def _begin(t: np.ndarray, constraints: int, u: Any, memory: Any) -> SearchMember:
    """A member at each row of unit values, with its free variables and what the optimiser begins with."""
    count = len(t)
    return SearchMember(
        u,
        t,
        memory,
        np.zeros((count, constraints)),
        np.full(count, PENALTY),
        np.full(count, np.inf),
        np.zeros(count, int),
        np.full(count, np.inf),
        np.full(count, np.nan),
        t,
        np.full(count, np.inf),
    )


class Company:
    """Which members have come to a better one and stayed beside it: the same end, found twice.

    Of each region only the best member is finished, so two members of one region are one too many. They are let go
    while more are moving than are solved in one call, the worst first: fewer would save nothing.
    """

    def __init__(self, members: int):
        self.looks = np.zeros(members, int)
        """At how many looks in a row each had a better one within REGION."""
        self.into = np.arange(members)
        """The member that each was left to: itself while it moves."""

    @property
    def merged(self) -> int:
        """How many were left to others."""
        return int(np.sum(self.into != np.arange(len(self.into))))

    def look(self, moving: np.ndarray, t: np.ndarray, rank: np.ndarray) -> np.ndarray:
        """Which of the moving members are left to others now. t, rank: of every member, the smaller rank the better."""
        order = moving[np.argsort(rank[moving], kind="stable")]
        best = _first_beside(t[order])
        self.looks[order] = np.where(best < np.arange(len(order)), self.looks[order] + 1, 0)
        (stayed,) = np.nonzero(self.looks[order] >= LOOKS)
        left = stayed[::-1][: max(len(order) - NEARBY_CHUNK, 0)]
        self.into[order[left]] = order[best[left]]
        return order[left]

    def ends(self, t: np.ndarray, rank: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(t, rank) of the best of every member; one that was left to another has the better of both."""
        last = self.into
        while np.any(last != self.into[last]):
            last = self.into[last]
        last = np.where(rank[last] <= rank, last, np.arange(len(last)))
        return t[last], rank[last]


def _first_beside(t: np.ndarray) -> np.ndarray:
    """For every row, the first one within REGION of it in every variable: itself at the latest."""
    first = np.arange(len(t))
    for start in range(0, len(t), NEARBY_CHUNK):  # all at once would take memory for every pair
        rows = t[start : start + NEARBY_CHUNK]
        first[start : start + NEARBY_CHUNK] = np.argmax(np.all(np.abs(rows[:, None] - t) <= REGION, axis=2), axis=1)
    return first


class Felt:
    """Which variables change which of the values that a problem measures, as the slopes of all designs tell that were
    seen with an answer."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.sizes, self.slopes = np.zeros(1), np.zeros((1, problem.space.size))
        self.has_seen = False

    def look(self, found: Evaluated) -> None:
        """Take in designs; a slope that is not known may be any."""
        good = found.shortfall == 0
        sizes = np.nan_to_num(np.abs(found.values[good]), posinf=0.0)
        slopes = np.nan_to_num(np.abs(found.value_slopes[good]), nan=np.inf)
        self.sizes = np.maximum(self.sizes, np.max(sizes, axis=0, initial=0.0))
        self.slopes = np.maximum(self.slopes, np.max(slopes, axis=0, initial=0.0))
        self.has_seen |= bool(np.any(good))

    @property
    def changes(self) -> np.ndarray:
        """(values, variables): whether the one changes with the other."""
        return (self.slopes > UNFELT * self.sizes[:, None]) | (not self.has_seen)

    def of(self, t: np.ndarray) -> np.ndarray:
        """The columns of unit values that change anything: what tells designs apart."""
        return t[:, np.any(self.changes, axis=0)]

    def sentences(self) -> list[str]:
        """What no variable changes of the goals, and which variables change nothing."""
        problem, changes = self.problem, self.changes
        goals = dict.fromkeys(problem.label(goal.quantity) for goal in problem.goals)
        moved = zip(problem.quantities, np.any(changes, axis=1), strict=False)  # then come margins of rules
        still = {problem.label(quantity) for quantity, moves in moved if not moves}
        said = [
            f"No variable changes {name}: as a goal it prefers no design to another." for name in goals if name in still
        ]
        idle = [name for name, moves in zip(problem.space.names, np.any(changes, axis=0), strict=True) if not moves]
        if idle:
            said.append(
                f"Nothing that is asked for depends on {', '.join(idle)}: the values in the designs mean nothing, and "
                "designs that differ in nothing else count as one."
            )
        return said


def _descend(
    members: SearchMember, evaluate, advance, scaling: Scaling, steps, report, company: Company, felt: Felt
) -> tuple[SearchMember, dict[str, np.ndarray], np.ndarray, bool]:
    """All members to rest, or to the last step, or (True) to where they were stopped."""
    moving = np.arange(len(members.u))
    found, stopped = None, False
    rows, paths = [], []
    try:
        for step in range(steps):
            # NumPy picks the rows: JAX would compile a gather for every number of them.
            evaluate.moving = moving
            fresh = evaluate(np.asarray(members.t)[moving])
            # Members at rest keep what was found last: `advance` sees every member and is compiled for one shape.
            found = fresh if found is None else jax.tree.map(partial(_replaced, moving), found, fresh)
            scaling.learn(fresh.values)
            felt.look(fresh)
            before, members = np.asarray(members.t), advance(scaling.scales, members, found, step)
            seen = jax.device_get(members._replace(memory=()))
            moving = np.flatnonzero(seen.stalled < PERIOD)
            paths.append(np.where(company.into == np.arange(len(before)), seen.objective, np.nan))
            if step % PERIOD == PERIOD - 1:
                left, rest = company.look(moving, before, seen.rank), np.array(seen.stalled)
                rest[left] = PERIOD
                members, moving = members._replace(stalled=rest), np.setdiff1d(moving, left)
            rank = seen.best_rank
            best = rank.min()
            feasible = int(np.sum(rank < 0.5 * NO_EQUILIBRIUM_RANK))
            equilibrium = int(np.sum(found.shortfall == 0))
            rows.append((best if feasible else np.nan, equilibrium, feasible, len(moving)))
            if report:
                report(step + 1, rows[-1][0], feasible, len(moving))
            if not len(moving):
                break
    except KeyboardInterrupt:
        if not rows:
            raise
        del paths[len(rows) :]  # of a step that was not ended
        stopped = True
    evaluate.moving = None
    names = ("best_objective", "with_equilibrium", "feasible", "moving")
    return members, dict(zip(names, np.array(rows).T, strict=True)), np.array(paths), stopped


def _replaced(rows: np.ndarray, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    old = old.copy()
    old[rows] = new
    return old


def _step(
    problem: Problem, rule: Any, scales: Scales, member: SearchMember, found: Evaluated, step: Any
) -> SearchMember:
    """One step of one member, from what was found at its u."""
    judged, slopes = score_with_slopes(problem, scales, found.values)
    in_equilibrium = found.shortfall == 0
    pull = jnp.maximum(0.0, member.multipliers + member.penalty * (judged.violations + ROOM))
    objective_slope = slopes.objective @ found.value_slopes
    downhill = jnp.where(in_equilibrium, objective_slope, found.shortfall_slopes)
    downhill += pull @ (slopes.violations @ found.value_slopes)
    updates, memory = rule.update(downhill * 0.5 * jnp.cos(member.u), member.memory, member.u)
    u = optax.apply_updates(member.u, updates)

    violation = jnp.max(judged.violations, initial=0.0)
    rank = _rank(judged.objective + CHARGE * violation, violation, found.shortfall, LOOSELY_FEASIBLE)
    better = rank < member.best_rank
    due = in_equilibrium & (step % PERIOD == PERIOD - 1)
    stubborn = due & (violation > jnp.maximum(FEASIBLE, 0.5 * member.last_violation))
    t = to_unit(u)
    moved = jnp.max(jnp.abs(t - member.t))
    resting = in_equilibrium & (moved < STALLED) & (violation < LOOSELY_FEASIBLE)
    done = member.stalled >= PERIOD
    new = SearchMember(
        u,
        t,
        memory,
        jnp.where(due, pull, member.multipliers),
        jnp.where(stubborn, jnp.minimum(PENALTY_GROWTH * member.penalty, PENALTY_MAX), member.penalty),
        jnp.where(due, violation, member.last_violation),
        jnp.where(resting, member.stalled + 1, 0),
        rank,
        jnp.where(rank < 0.5 * NO_EQUILIBRIUM_RANK, judged.objective, jnp.nan),
        jnp.where(better, member.t, member.best_t),
        jnp.where(better, rank, member.best_rank),
    )
    return jax.tree.map(lambda kept, moved: jnp.where(done, kept, moved), member, new)


def score_with_slopes(problem: Problem, scales: Scales, values: Any) -> tuple[Score, Score]:
    """`Problem.score` and its derivatives by the quantities."""
    return problem.score(values, scales), jax.jacfwd(partial(problem.score, scales=scales))(values)


def _rank(objective, violation, shortfall, tolerance=FEASIBLE):
    """Feasible designs by objective, then infeasible ones by violation, then those without equilibrium."""

    def between(first, amount):
        """From `first` to `first` + 1 as an amount grows from zero without end, in ranks that no objective reaches."""
        return NO_EQUILIBRIUM_RANK * (first + 1 - 1 / (1 + amount))

    rank = jnp.where(violation <= tolerance, objective, between(1, violation))
    return jnp.where(shortfall == 0, rank, between(2, shortfall))


def _distinct(t: np.ndarray, rank: np.ndarray, radius: float) -> list[int]:
    """Rows in order of rank, without those that are within `radius` of a better one in every variable."""
    kept: list[int] = []
    for k in np.argsort(rank, kind="stable"):
        if all(np.max(np.abs(t[k] - t[j]), initial=0.0) > radius for j in kept):
            kept.append(int(k))
    return kept


def _reasons(found: Evaluated, k: int) -> tuple[str, ...]:
    """Why the states of design k are as they are, in words."""
    if found.reasons is None:  # a problem of formulas
        return ()
    pairs = zip(found.reasons[k], found.details[k], strict=True)
    return tuple(Reason(int(reason)).text(float(detail)) for reason, detail in pairs)


def _limit_margins(problem: Problem, found: Evaluated, k: int) -> dict[str, float]:
    """By state, the limit pressure over its pressure of design k, where that is known."""
    if found.limit_margins is None:
        return {}
    pairs = zip(problem.asked.state_labels(), found.limit_margins[k], strict=True)
    return {label: float(margin) for label, margin in pairs if np.isfinite(margin)}


def designs_at(problem: Problem, score: Any, evaluate: SolvesDesigns, t: np.ndarray) -> list[Design]:
    """The designs at rows of t, judged."""
    found, space, designs = evaluate.solve(t), problem.space, []
    labels = problem.constraint_labels()
    for k, row in enumerate(t):
        judged, _ = score(found.values[k])
        violations = np.asarray(judged.violations)
        rank = float(_rank(judged.objective, np.max(violations, initial=0.0), found.shortfall[k]))
        held = np.abs(violations) < ACTIVE
        # What is not known of a design counts for nothing, and holds nothing.
        held &= np.isfinite(found.values[k][problem.constrained])
        active = [label for label, is_held in zip(labels, held, strict=True) if is_held]
        active += [f"{name} at its lower bound" for name, v in zip(space.names, row, strict=True) if v < ACTIVE]
        active += [f"{name} at its upper bound" for name, v in zip(space.names, row, strict=True) if v > 1 - ACTIVE]
        margins = _limit_margins(problem, found, k)
        at_ends = [at_limit(label) for label, margin in margins.items() if abs(margin - 1) < ACTIVE]
        active += dict.fromkeys([*problem.at_limits(found.values[k], ACTIVE), *at_ends])
        designs.append(
            Design(
                row,
                np.asarray(space.from_unit(jnp.asarray(row))),
                found.values[k][: len(problem.quantities)],
                float(judged.objective),
                violations,
                problem.margins(found.values[k]),
                tuple(Status(int(s)) for s in found.statuses[k]),
                _reasons(found, k),
                rank < 0.5 * NO_EQUILIBRIUM_RANK,
                rank,
                tuple(active),
                margins,
            )
        )
    return designs
