"""What `softgrip design` does with [design.uncertain] after the nominal search: improve, count, compare."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from softgrip_jax.errors import InputError
from softgrip_jax.progress import Tell, silent
from softgrip_jax.results import Status

from ..design.descent import Design, SearchResult, designs_at, score_with_slopes, search
from ..problem import Limits, Problem, Scaling
from .budget import Budget, budget
from .count import FRESH, Count, counted, promised
from .evaluate import SAMPLES, Error, Wants
from .improve import ASCENT, BY_SAMPLES, DERIVATIVES, KEPT, KEPT_LOGIT, WIDTHS, Improved, candidates, improved, is_good
from .parts import DesignsOfParts, Parts, Requirements, problem_of_parts
from .scatter import Scatters
from .settings import Uncertain
from .statistics import Kind, Wanted

AGREED = 0.01
"""A promised yield within this of the counted one holds."""
FRONT_COUNTED = 4096
"""Fresh parts of a design of a front: 0.35 % of a yield of 95 %."""
BETTER = 2
"""Designs that go on where the expansion is not good enough: parts that are solved cost a hundred times more."""


@dataclasses.dataclass(frozen=True)
class FrontPoint:
    """The best design for one yield.

    Args:
        wanted: the yield.
        promised, counted: what it has, by the search and by fresh parts.
        best: the design.
        objective: nominal, scaled.
        values: nominal, of the problem's quantities, SI.
    """

    wanted: float
    promised: float
    counted: float
    best: Improved
    objective: float
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Robust:
    """Everything that is known of the robust design beside the nominal best one.

    Args:
        uncertain: what was asked.
        wants: how it was evaluated.
        best: the robust design.
        share: the promised yield; None where none is wanted.
        goal: the promised objective in the way that is wanted, scaled.
        of_nominal, of_best: fresh parts, counted.
        switched: why the parts were solved where they were.
        front: best designs for other yields.
        budget: of tolerances.
        seconds: by stage, s.
        solves: parts and designs solved, by stage.
    """

    uncertain: Uncertain
    wants: Wants
    best: Improved
    share: float | None
    goal: float
    of_nominal: Count
    of_best: Count
    switched: str
    front: tuple[FrontPoint, ...]
    budget: Budget | None
    seconds: dict[str, float]
    solves: dict[str, int]

    @property
    def holds(self) -> bool:
        """Whether fresh parts do what was promised, within AGREED."""
        return _holds(self.uncertain.wanted, self.share, self.goal, self.of_best)


def _holds(wanted: Wanted, share: float | None, goal: float, count: Count) -> bool:
    """Whether parts that were counted do what was promised: a yield, or else an objective and its constraints."""
    if share is not None:
        return abs(share - count.share) <= AGREED
    allowed = 0.0 if wanted.goal == "worst" else AGREED
    kept = count.violation <= max(allowed, KEPT) and count.lost <= allowed
    return kept and count.goal <= goal + AGREED * max(abs(goal), 1e-12)


class Scattered:
    """The search of a problem whose parts scatter, on one set of compiled programs.

    Args:
        problem: of the designs.
        uncertain: what scatters and what is wanted.
    """

    def __init__(self, problem: Problem, uncertain: Uncertain):
        of_parts = problem_of_parts(problem, uncertain.scatters)
        self.problem, self.uncertain, self.parts = problem, uncertain, Parts(of_parts)
        self.requirements = Requirements(of_parts, uncertain.limits)
        self.designs = DesignsOfParts(self.parts)

    def evaluator(self, problem: Problem, chunk: int) -> Any:
        """What solves the designs of the nominal search."""
        return self.designs

    def robust(self, nominal: SearchResult, tell: Tell, fresh: int = FRESH) -> tuple[SearchResult, Robust]:
        """The robust design from the result of the nominal search; with it as the best of the designs."""
        problem, uncertain = self.problem, self.uncertain
        scaling = Scaling(problem)
        for design in (nominal.reference, *nominal.designs):
            scaling.learn(design.values[None])
        wants = Wants(
            self.parts,
            uncertain.scatters,
            self.requirements,
            uncertain.wanted,
            scaling.scales,
            uncertain.samples,
            uncertain.seed,
            uncertain.box,
        )
        seconds, solves = {}, {"nominal": nominal.solves}
        began, before = time.perf_counter(), self.parts.solves

        def lap(stage: str) -> None:
            nonlocal began, before
            seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - began
            solves[stage] = solves.get(stage, 0) + self.parts.solves - before
            began, before = time.perf_counter(), self.parts.solves

        tell("improving the design for all parts")
        at_nominal = nominal.best.t
        best, switched = _improve(wants, uncertain, nominal, problem)
        share, goal = promised(wants, best)
        lap("robust")
        of_best = counted(wants, best.t, fresh, lambda done: tell("counting parts of the robust design", done, fresh))
        if best.method == DERIVATIVES and not _holds(uncertain.wanted, share, goal, of_best):
            switched = (
                f"by derivatives {share:.1%} were promised and {of_best.share:.1%} counted, so that parts were solved"
                if share is not None
                else f"by derivatives an objective of {goal:.4g} was promised and {of_best.goal:.4g} counted, so that "
                "parts were solved"
            )
            lap("counting")
            best = dataclasses.replace(
                improved(wants, best.t[None], BY_SAMPLES, widths=WIDTHS[1:])[0], error=best.error
            )
            share, goal = promised(wants, best)
            lap("robust, by samples")
            of_best = counted(
                wants, best.t, fresh, lambda done: tell("counting parts of the robust design", done, fresh)
            )
        of_nominal = counted(
            wants, at_nominal, fresh, lambda done: tell("counting parts of the nominal best", done, fresh)
        )
        lap("counting")
        front, compared, stopped = (), None, False
        try:
            front = _front(wants, best, uncertain, tell)
            lap("front")
            if uncertain.budget:
                tell("comparing tolerances")
                compared = budget(wants, best)
                lap("tolerances")
        except KeyboardInterrupt:  # the robust design is found, and its parts are counted
            stopped = True
        result = dataclasses.replace(self._with_best(nominal, best, scaling), stopped=stopped)
        found = Robust(
            uncertain, wants, best, share, goal, of_nominal, of_best, switched, front, compared, seconds, solves
        )
        return result, found

    def _with_best(self, nominal: SearchResult, best: Improved, scaling: Scaling) -> SearchResult:
        """The nominal result with the robust design before the nominal best one."""
        problem = self.problem
        judging = jax.jit(lambda values: score_with_slopes(problem, scaling.scales, values))
        own = designs_at(problem, judging, self.designs, best.t[None])[0]
        held = held_by(self.uncertain.wanted, best)
        own = dataclasses.replace(own, feasible=is_feasible(own, best.kept), active=(*held, *own.active))
        start = problem.space.to_unit(problem.space.reference)
        return dataclasses.replace(
            nominal,
            designs=[own, nominal.best],
            reached=(0, *nominal.reached[:1]),
            descended=float("nan"),
            solutions=self.designs.solutions(np.stack([start, best.t])),
        )


def held_by(wanted: Wanted, best: Improved) -> tuple[str, ...]:
    """What is wanted of the parts of a robust design, in words, where it keeps the design where it is."""
    missed = "" if best.kept else ", which no design was found to keep"
    if wanted.promised and (missed or best.values[1] > -KEPT_LOGIT):  # its logit is the first constraint
        return (f"a yield of {wanted.promised:.4g}{missed}",)
    return () if wanted.goal == "nominal" else (f"the {wanted.goal} case of its parts{missed}",)


def is_feasible(own: Design, kept: bool) -> bool:
    """Whether a robust design keeps what is wanted of its parts, and can exist itself: what holds for most of its parts
    need not hold for the design in their middle."""
    return kept and own.answered and Status.IMPOSSIBLE not in own.statuses


def robust_search(
    problem: Problem,
    scatters: Scatters,
    *,
    promised: float | None = None,
    goal: Kind = "nominal",
    quantile: float = 0.9,
    requirements: Sequence[Limits] | None = None,
    box: float = 2.0,
    method: str = "auto",
    samples: int = SAMPLES,
    fresh: int = FRESH,
    seed: int = 0,
    **arguments: Any,
) -> tuple[SearchResult, Robust]:
    """The best design where numbers scatter from part to part, beside the nominal best one.

    Args:
        problem: variables, goals and limits.
        scatters: what scatters.
        promised: the yield that is wanted, dimensionless; None where the constraints hold as the goal does.
        goal: what is optimised: "nominal", "expected", "quantile" or "worst".
        quantile: of the goal, dimensionless.
        requirements: what a part must keep beside the rules; by default the limits of the problem. Their quantities
            must be among those of the problem (its argument `reported`).
        box: of a worst case, in standard deviations, dimensionless.
        method: "auto", "derivatives" or "samples".
        samples: parts that are solved for a design where its expansion is not good enough.
        fresh: parts that are counted in the end.
        seed: of all parts.
        arguments: of the nominal search, see `search`.

    Returns:
        The result of the search, the robust design before the nominal best one, and what is known of their parts.

    Raises:
        InputError: where nothing is wanted of the parts, or no design has parts to count.

    Source: docs/guides/robust.md.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> space = optim.Space({"free": sg.shell.Free(shell)}, [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        >>> height = optim.Quantity("inflation", at=15 * kPa)
        >>> problem = optim.Problem(space, [optim.Goal("maximise", height)], [optim.Limits(height, high=13 * mm)])
        >>> scatters = optim.Scatters([optim.Scatter("shell.t_m", 0.05)])
        >>> options = {"starts": 2, "steps": 5, "finishes": 1, "fresh": 1000}
        >>> _, robust = optim.robust_search(problem, scatters, promised=0.9, **options)
        >>> print(f"{robust.share:.2f} of the parts instead of {robust.of_nominal.share:.1f}")
        0.90 of the parts instead of 0.5
    """
    if promised is None and goal == "nominal":
        raise InputError("Nothing is wanted of the parts; give promised, or another goal than 'nominal'.")
    for name, share in (("promised", promised), ("quantile", quantile)):
        if share is not None and not 0 < share < 1:
            raise InputError(f"{name} is {share:g}; it must be between 0 and 1, both excluded.")
    wanted = Wanted(goal, quantile, promised)
    limits = None if requirements is None else tuple(requirements)
    uncertain = Uncertain(scatters, scatters.names, wanted, limits, box, method, samples, seed, (), False)
    scattered = Scattered(problem, uncertain)
    nominal = search(problem, evaluator=scattered.evaluator, seed=seed, **arguments)
    return scattered.robust(nominal, silent, fresh)


def _improve(wants: Wants, uncertain: Uncertain, nominal: SearchResult, problem: Problem) -> tuple[Improved, str]:
    """(the robust design, why parts were solved if they were)."""
    starts = candidates([d.t for d in nominal.designs if d.answered], problem.home(), uncertain.seed)
    if wants.wanted.goal == "worst":
        found = improved(wants, starts, ASCENT)
        return _first(found), ""
    has_yield, needs_values = wants.wanted.promised is not None, wants.wanted.goal != "nominal"
    switched = "it was asked for" if uncertain.method == "samples" else ""
    # The expansion, even where it is not good enough, says cheaply which designs are worth their samples.
    found = improved(wants, starts, DERIVATIVES)
    if found:
        best = dataclasses.replace(found[0], error=wants.error(found[0].t))
        good = uncertain.method == "derivatives" or is_good(best.error, has_yield, needs_values)
        if good and not switched:
            return best, ""
        switched = switched or f"the expansion about the robust design is not good enough: {words(best.error)}"
        found = improved(wants, best.t[None], BY_SAMPLES, widths=WIDTHS[1:])
    else:
        switched = switched or "no design was found whose parts have an expansion"
        found = improved(wants, starts[:BETTER], BY_SAMPLES)
    best = _first(found)
    return dataclasses.replace(best, error=wants.error(best.t)), switched


def _first(found: list[Improved]) -> Improved:
    if not found:
        raise InputError("No design was found that has an equilibrium and parts to count.")
    return found[0]


def words(error: Error | None) -> str:
    """How far an expansion is off."""
    if error is None:
        return "a part within one deviation has no equilibrium"
    if error.lost:
        return f"{error.lost} of the parts that were solved have no equilibrium"
    return (
        f"its yield is off by {error.share:.2%}, the objective by {error.objective:.1e} and the worst requirement by "
        f"{error.violation:.1e} (scaled)"
    )


def _front(wants: Wants, best: Improved, uncertain: Uncertain, tell: Tell) -> tuple[FrontPoint, ...]:
    """The best designs for other yields, each from the one before."""
    points, wanted = [], wants.wanted
    try:
        for k, share in enumerate(uncertain.front):
            tell("front", k, len(uncertain.front))
            wants.wanted = wanted._replace(promised=share)
            start = points[-1].best.t if points else best.t
            found = improved(wants, np.stack([start, best.t]), best.method, widths=WIDTHS[1:])
            own, fresh = _promise_and_count(wants, found)
            if found and found[0].method == DERIVATIVES and abs(own - fresh) > AGREED:
                found = improved(wants, found[0].t[None], BY_SAMPLES, widths=WIDTHS[1:])
                own, fresh = _promise_and_count(wants, found)
            if not found or not found[0].kept or abs(own - fresh) > AGREED:
                continue  # no design of a front whose yield is not what it says
            nominal = wants.parts.counted(found[0].t, np.zeros((1, wants.scatters.size)))
            objective = float(wants.broken(nominal.values, nominal.shortfall)[1][0])
            points.append(FrontPoint(share, own, fresh, found[0], objective, nominal.values[0]))
    finally:
        wants.wanted = wanted
    return tuple(points)


def _promise_and_count(wants: Wants, found: list[Improved]) -> tuple[float, float]:
    """The yield that the first of some designs is promised to have, and that of fresh parts."""
    if not found:
        return 0.0, 0.0
    own, _ = promised(wants, found[0])
    return float(own or 0.0), counted(wants, found[0].t, FRONT_COUNTED).share
