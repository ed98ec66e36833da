"""The search along a path: to a goal, a limit point, a bifurcation or the path's end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from ..batching import in_blocks
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
    FOUND,
    LARGEST_STEP,
    MISSED,
    REACHED,
    STEPPING,
    TO_GOAL,
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
AT_GOAL = 1e-9
"""A goal that is less than this has not been passed."""
NEAR = 0.05
"""Of the loads from rest to the largest: a sure point and one that is not, so near to each other, are not bisected."""
SHARP = 0.2
"""Where a climb ends limit points may be near, and follow close on each other: the path from there is followed so much
more closely."""
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


class Climb(NamedTuple):
    """Loads at which Newton's method is tried before the path is followed: the largest one, and where it does not
    arrive there, or at what is not sure to be on the path, or has passed the goal, smaller ones, by bisection. The path
    is followed from the last point that is sure."""

    rest: Vector
    """Where Newton's method begins; its load is the least one of the bisection."""
    to: Scalar
    """The largest load, the first one to try."""
    here: Bool[Array, ""]
    """Whether to try."""
    is_sure: Callable[[Vector, Any], Bool[Array, ""]]
    """(where Newton's method has arrived, args) -> whether it is on the path, before any limit point."""


class Climbing(NamedTuple):
    """A search, and how far up it is."""

    search: Search
    load: Scalar
    """That Newton's method tries."""
    base: Vector
    """The last sure point, or where Newton's method begins."""
    lost: Scalar
    """The least load at which no point before the goal was sure."""
    start: Vector
    """Where the path is followed from."""
    first: Scalar
    """The arc length to try first there."""
    detour: Scalar
    """`Steps.detour` from there on."""


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
    climb: Climb | None = None,
) -> End:
    """Follow the path from u towards growing load until the goal rises through zero, the load turns, or the path ends.

    equations: must take every traced value through u and args. first: the arc length to try first. steps: of all the
    others. is_there: True where u is the goal itself, and nothing is to be done. climb: what is tried first.
    """
    by = steps or Steps()
    traced = jax.jit(equations)  # once for all that follows

    def iterate(search: Search, context) -> Search:
        args, start, first_length, detour = context
        stepping, to_goal = search.mode == STEPPING, search.mode == TO_GOAL
        trying = False if climb is None else search.mode == TRYING
        newton, local = newton_step(
            lambda u: traced(u, args), search.before.tangent, search.guess, to_goal, search.newton
        )
        first = search.count == 0
        within = to_goal & ~directly(search)
        new, rise, trusted, left, crossed = arrived(
            newton, local, search.before, search.guess, within, first, search.polishing, by.turn, detour
        )
        roughly = stepping & ~search.polishing & ~search.careful & (jnp.abs(new.tangent[-1]) > STEEP)
        accuracy = Accuracy(*(jnp.where(roughly, a, b) for a, b in zip(ROUGH, FINE, strict=True)))
        newton = newton._replace(last=jnp.where(left <= accuracy.left, 0.0, newton.last))
        converged = has_converged(newton, accuracy)
        good = trusted & converged
        limit = jnp.where(within | trying, GOAL_STEPS, NEWTON_STEPS)
        going = goes_on(newton, limit, accuracy, jnp.where(trying, FREE_STEPS, 0))
        found = jnp.where(converged, FOUND, MISSED)
        case, chosen = first_of(
            (going, search),
            *([] if climb is None else [(trying, search._replace(before=new, mode=found))]),
            *after_step(search, new, rise, good, roughly, crossed & converged, by.largest),
            *after_goal_trial(search, new, rise, good),
            *after_fold_trial(search, new, good),
        )
        again = (chosen.mode >= BIFURCATION) & ~search.careful
        chosen = select(again, beginning(start, first_length, careful=True), chosen)
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
        return (search.mode < FOUND) & (search.count < by.most)

    first, detour = jnp.asarray(first, u.dtype), jnp.asarray(by.detour, u.dtype)
    begin = beginning(u, first)
    if climb is not None:
        begin = select(climb.here & ~jnp.asarray(is_there), _trying(climb.rest, climb.to), begin)
    begin = begin._replace(mode=jnp.where(is_there, REACHED, begin.mode))
    if climb is None:
        end = in_blocks(busy, iterate, begin, (args, u, first, detour))
    else:

        def further(now: Climbing) -> Climbing:
            search = in_blocks(busy, iterate, now.search, (args, now.start, now.first, now.detour))
            return _climbed(now._replace(search=search), climb, args, by)

        climbing = Climbing(begin, climb.to, climb.rest, climb.to, u, first, detour)
        end = lax.while_loop(lambda now: busy(now.search), further, climbing).search
    return End(end.before.u, jnp.where(end.mode < REACHED, ENDED, end.mode), end.iterations)


def _trying(base: Vector, load: Scalar) -> Search:
    """Newton's method from a point, at another load."""
    guess = base.at[-1].set(load)
    return beginning(guess, 0.0)._replace(mode=jnp.asarray(TRYING))


def _climbed(now: Climbing, climb: Climb, args: Any, by: Steps) -> Climbing:
    """What Newton's method has found is looked at once, outside the loop of the iterations."""
    search, point = now.search, now.search.before
    tried = (search.mode == FOUND) | (search.mode == MISSED)
    sure = (search.mode == FOUND) & (point.goal < AT_GOAL) & climb.is_sure(point.u, args)
    at_top = now.load >= climb.to
    there = sure & at_top & (point.goal > -AT_GOAL)
    # A goal that is not passed at the largest load may have been passed on the way: all of it is followed.
    missed = sure & at_top & ~there
    sure &= ~missed
    base = jnp.where(sure, point.u, now.base)
    lost = jnp.where(missed, base[-1], jnp.where(tried & ~sure, now.load, now.lost))
    start, first = jnp.where(sure, point.u, now.start), jnp.where(sure, by.largest, now.first)
    detour = jnp.where(sure, SHARP * by.detour, now.detour)
    between = 0.5 * (base[-1] + lost)
    on = select(lost - base[-1] > NEAR * (climb.to - climb.rest[-1]), _trying(base, between), beginning(start, first))
    on = select(there, search._replace(mode=jnp.asarray(REACHED)), on)
    search = select(tried, on._replace(iterations=search.iterations), search)
    return Climbing(search, between, base, lost, start, first, detour)
