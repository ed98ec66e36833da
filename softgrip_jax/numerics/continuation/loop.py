"""The search along a path: to a goal, a limit point, a bifurcation or the path's end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from ..batching import lane_pool
from ..choice import select
from .newton import (
    FINE,
    FREE_STEPS,
    GOAL_STEPS,
    NEWTON_STEPS,
    ROUGH,
    Accuracy,
    Scalar,
    Vector,
    goes_on,
    has_converged,
    newton_from,
    newton_step,
)
from .points import DETOUR, TURN, arrived
from .search import (
    BIFURCATION,
    ENDED,
    FIRST_STEP,
    LARGEST_STEP,
    REACHED,
    STEPPING,
    TO_GOAL,
    TRIED,
    TRYING,
    Search,
    after_fold_trial,
    after_goal_trial,
    after_step,
    beginning,
    directly,
    first_of,
    guess_of,
)

Equations = Callable[[Vector, Any], tuple[Vector, Scalar]]
"""(u of size n + 1, args) -> n equations, and the goal: a number that rises through zero where a search ends."""

MAX_STEPS = 400
STEEP = 0.1
"""Load component of the tangent below which a point is known well, so that it is known on which side of a limit point
it lies."""


class Steps(NamedTuple):
    """How long the steps along a path may be, and how many."""

    first: float = FIRST_STEP
    largest: float = LARGEST_STEP
    turn: float = TURN
    most: int = MAX_STEPS
    detour: float = DETOUR


class Trial(NamedTuple):
    """A point from which Newton's method goes at once to what is looked for, the one solution at that point's load; the
    path is followed where it does not arrive there, or at what is not sure to be it."""

    at: Vector
    here: Bool[Array, ""]
    """Whether to try."""
    is_it: Callable[[Vector, Any], Bool[Array, ""]]
    """(where Newton's method has arrived, args) -> whether it is the one solution."""


class End(NamedTuple):
    """Where a search ended: REACHED (u has goal = 0), FOLD (u is a limit point), BIFURCATION (u is shortly before one:
    the path goes on, but it is not stable there) or ENDED."""

    u: Vector
    reason: Int[Array, ""]
    iterations: Int[Array, ""]
    """Newton iterations."""


def follow(
    equations: Equations,
    u: Vector,
    args: Any = None,
    first: Scalar | float = FIRST_STEP,
    steps: Steps | None = None,
    is_there: Bool[Array, ""] | bool = False,
    trial: Trial | None = None,
) -> End:
    """Follow the path from u towards growing load until the goal rises through zero, the load turns, or the path ends.

    equations: must take every traced value through u and args. first: the arc length to try first. steps: of all the
    others. is_there: True where u is the goal itself, and nothing is to be done. trial: what is tried first.
    """
    by = steps or Steps()
    traced = jax.jit(equations)  # once for all that follows

    def iterate(search: Search, context) -> Search:
        args, *start = context
        stepping, to_goal = search.mode == STEPPING, search.mode == TO_GOAL
        trying = False if trial is None else search.mode == TRYING
        newton, local = newton_step(
            lambda u: traced(u, args), search.before.tangent, search.guess, to_goal, search.newton
        )
        first = search.count == 0
        within = to_goal & ~directly(search)
        new, rise, trusted, left, crossed = arrived(
            newton, local, search.before, search.guess, within, first, search.polishing, by.turn, by.detour
        )
        roughly = stepping & ~search.polishing & ~search.careful & (jnp.abs(new.tangent[-1]) > STEEP)
        accuracy = Accuracy(*(jnp.where(roughly, a, b) for a, b in zip(ROUGH, FINE, strict=True)))
        newton = newton._replace(last=jnp.where(left <= accuracy.left, 0.0, newton.last))
        converged = has_converged(newton, accuracy)
        good = trusted & converged
        limit = jnp.where(within | trying, GOAL_STEPS, NEWTON_STEPS)
        going = goes_on(newton, limit, accuracy, jnp.where(trying, FREE_STEPS, 0))
        case, chosen = first_of(
            (going, search),
            *([] if trial is None else [(trying, search._replace(before=new, mode=jnp.asarray(TRIED)))]),
            *after_step(search, new, rise, good, roughly, crossed & converged, by.largest),
            *after_goal_trial(search, new, good),
            *after_fold_trial(search, new, good),
        )
        again = (chosen.mode >= BIFURCATION) & ~search.careful
        careful = True
        if trial is not None:
            again, careful = again | (trying & ~going & ~converged), ~trying
        chosen = select(again, beginning(*start, careful=careful), chosen)
        going = case == 0
        # The second try, too, begins where the path does, and not a step ahead on whatever branch is there.
        guess = jnp.where(going | again, chosen.guess, guess_of(chosen))
        return chosen._replace(
            count=jnp.where(again, 0, search.count + ~going),
            guess=guess,
            newton=select(going, newton, newton_from(guess)),
            iterations=search.iterations + 1,
        )

    def busy(search: Search) -> Bool[Array, ""]:
        return (search.mode < TRIED) & (search.count < by.most)

    begin = beginning(u, first)
    if trial is not None:
        tried = begin._replace(mode=jnp.asarray(TRYING), guess=trial.at, newton=newton_from(trial.at))
        begin = select(trial.here, tried, begin)
    begin = begin._replace(mode=jnp.where(is_there, REACHED, begin.mode))
    context = (args, u, jnp.asarray(first, u.dtype))

    def search_on(search: Search) -> Search:
        """What a trial has found is looked at once, outside the loop of the iterations."""
        assert trial is not None
        search = lane_pool(busy, iterate, search, context)
        found = search._replace(mode=jnp.asarray(REACHED))
        found = select(
            trial.is_it(search.before.u, args), found, beginning(u, first)._replace(iterations=search.iterations)
        )
        return select(search.mode == TRIED, found, search)

    end = lane_pool(busy, iterate, begin, context) if trial is None else lax.while_loop(busy, search_on, begin)
    return End(end.before.u, jnp.where(end.mode < REACHED, ENDED, end.mode), end.iterations)
