"""The state of a search along a path, and how it goes on after each Newton iteration that has ended."""

from __future__ import annotations

from functools import cache, reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..xla import materialised
from .newton import NewtonIteration, Scalar, Vector, newton_from
from .points import Point

FIRST_STEP = 0.3
LARGEST_STEP = 4.0
SMALLEST_STEP = 1e-7
LONGER, SHORTER = 2.0, 0.3
"""Arc lengths in scaled units: less than a typical load to start with, for what bends a beam may begin with the square
of a load (the contact of chambers); below 1e-7 a path counts as ended. A step that fails is tried again, SHORTER."""
SHORT = 0.2
"""A step shorter than this that fails may have failed because the point before was known roughly only."""
LEVEL = 1e-6
"""Load component of a tangent that may be of either sign at a limit point that is known to rounding."""
FLAT = 1e-8
"""Load component of the tangent that counts as a limit point, whose load is then right to the square of it."""

STEPPING, TO_FOLD, TO_GOAL, TRYING, FOUND, MISSED, REACHED, FOLD, BIFURCATION, ENDED = range(10)


class Search(NamedTuple):
    """State of `follow`: where the path is, the step under way, and the bracket of a limit point."""

    before: Point
    """In the end, what was found."""
    far: Vector
    """The far end of the interval that holds what is looked for."""
    far_goal: Scalar
    length: Scalar
    """Arc length of the next step, or the next trial inside the bracket."""
    low: Scalar
    high: Scalar
    rise_low: Scalar
    rise_high: Scalar
    """Load components of the tangent at both ends of the bracket; an end that stays twice counts half (Illinois)."""
    stride: Scalar
    """Arc length of the step from `before` that led to the bracket."""
    rose: Int[Array, ""]
    """Whether the last trial in the bracket was still rising (1) or not (-1); 0 before the first."""
    at_fold: Bool[Array, ""]
    """Whether `far` is a limit point."""
    bend: Vector
    """Change of the tangent with arc length behind `before`: what the next step expects."""
    roughly: Bool[Array, ""]
    """Whether `before` is known roughly only."""
    polishing: Bool[Array, ""]
    """Whether the step under way has length zero: it finds `before` itself better."""
    mode: Int[Array, ""]
    count: Int[Array, ""]
    guess: Vector
    """Where the Newton iteration under way began."""
    newton: NewtonIteration
    iterations: Int[Array, ""]
    """Newton iterations so far."""
    careful: Bool[Array, ""]
    """Whether this is the second try, with every point known well."""


def beginning(u: Vector, length: Scalar | float, careful: Bool[Array, ""] | bool = False) -> Search:
    """The first "step" has length zero: it finds the tangent at u."""
    zero, count = jnp.zeros((), u.dtype), jnp.asarray(0)
    start = Point(u, jnp.zeros_like(u).at[-1].set(1.0), zero, zero)
    no, mode = jnp.asarray(False), jnp.asarray(STEPPING)
    length = zero + length
    return Search(
        *(start, u, zero, length, zero, zero, zero, zero, zero, count, no, 0 * u, no, no, mode, count),
        guess=u,
        newton=newton_from(u),
        iterations=count,
        careful=jnp.asarray(careful),
    )


Case = tuple[Bool[Array, ""] | bool, Search]
"""A condition, and how the search goes on where it is the first that holds: see `first_of`."""


def first_of(*cases: Case) -> tuple[Scalar, Search]:
    """(the number of the first case whose condition holds, its state); the last is for all the rest.

    Numbered before anything is chosen: XLA would work out the conditions anew for every array of the state.
    """
    conditions, states = zip(*cases, strict=True)
    number = jnp.asarray(len(cases) - 1.0)
    for k in reversed(range(len(cases) - 1)):
        number = jnp.where(conditions[k], float(k), number)
    number = materialised(number)
    is_case = [number == k for k in range(len(cases))]

    @cache
    def is_one_of(*some: int) -> Array:
        return reduce(jnp.logical_or, (is_case[k] for k in some))

    def chosen(*values):
        result = values[-1]
        for value in {id(v): v for v in values if v is not result}.values():
            result = jnp.where(is_one_of(*(k for k, v in enumerate(values) if v is value)), value, result)
        return result

    return number, jax.tree.map(chosen, *states)


def guess_of(search: Search) -> Vector:
    """Of the next trial: a quadratic as the path bent before, or through `before`, its tangent, `far`."""
    before, length, high = search.before, search.length, search.high
    through_far = (search.far - before.u - high * before.tangent) / jnp.where(high > 0, high, 1) ** 2
    bend = jnp.where((search.mode == STEPPING) | directly(search), 0.5 * search.bend, through_far)
    return materialised(before.u + jnp.where(search.polishing, 0.0, length) * (before.tangent + length * bend))


def _to_goal(search: Search) -> Search:
    """Aim at the goal between `before` and `far`: a straight line, or a parabola with its top at a limit point."""
    near, there = search.before.goal, search.far_goal
    rest = there / jnp.where(there > near, there - near, 1.0)
    share = 1 - jnp.where(search.at_fold, jnp.sqrt(jnp.maximum(rest, 0.0)), rest)
    return search._replace(length=search.high * jnp.clip(share, 0.0, 1.0), mode=jnp.asarray(TO_GOAL))


def after_step(
    search: Search,
    new: Point,
    rise: Scalar,
    good: Bool[Array, ""],
    roughly: Bool[Array, ""],
    crossed: Bool[Array, ""],
    largest: float,
) -> tuple[Case, ...]:
    stepping, first = search.mode == STEPPING, search.count == 0
    shorter, longer = SHORTER * search.length, jnp.minimum(LONGER * search.length, largest)
    bend = jnp.where(first, 0.0, (new.tangent - search.before.tangent) / search.length)
    length = jnp.where(first, search.length, longer)
    # Where the goal seems to be within the next step, that step is to end there.
    rest = -new.goal / jnp.where(rise > 0, rise, 1.0)
    near = (rise > 0) & (rest < length)
    ahead = search._replace(
        before=new,
        bend=bend,
        roughly=roughly,
        length=jnp.where(near, rest, length),
        stride=length,
        high=jnp.zeros_like(search.high),
        mode=jnp.where(near, TO_GOAL, STEPPING),
    )
    interval = search._replace(
        far=new.u,
        far_goal=new.goal,
        low=jnp.zeros_like(search.low),
        high=search.length,
        stride=search.length,
        rise_low=search.before.tangent[-1],
        rise_high=new.tangent[-1],
    )
    fold = interval._replace(mode=jnp.asarray(TO_FOLD), length=_between(interval))
    # The goal is where the path begins, or a little before: what was found roughly is found well there.
    back = ahead._replace(length=rest, mode=jnp.asarray(TO_GOAL))
    again = search._replace(
        length=shorter,
        roughly=search.roughly & (shorter >= SHORT),
        polishing=search.roughly & (shorter < SHORT),
        mode=jnp.where(first | (shorter < SMALLEST_STEP), jnp.where(crossed, BIFURCATION, ENDED), STEPPING),
    )
    rough = search._replace(polishing=jnp.asarray(False))
    level, past = new.tangent[-1] <= 0, new.goal >= 0
    return (
        (stepping & search.polishing & good & ~level, rough._replace(before=new)),
        (stepping & search.polishing, rough),
        (stepping & ~good, again),
        (stepping & level, fold),
        (stepping & past & first, back),
        (stepping & past, _to_goal(interval)),
        (stepping, ahead),
    )


def directly(search: Search) -> Bool[Array, ""]:
    """Whether the goal is sought from `before` alone, with nothing known beyond it."""
    return (search.mode == TO_GOAL) & (search.high == 0)


def after_goal_trial(search: Search, new: Point, rise: Scalar, good: Bool[Array, ""]) -> tuple[Case, ...]:
    to_goal = search.mode == TO_GOAL
    reached = search._replace(before=new, mode=jnp.asarray(REACHED))
    # A goal that was not where it seemed to be: the step that would have been made without it.
    on = search._replace(length=search.stride, mode=jnp.asarray(STEPPING))
    # At the limit point itself the tangent is level.
    there = to_goal & good & (new.tangent[-1] > jnp.where(search.at_fold, -LEVEL, 0.0))
    # Where the goal falls through zero it rose through it before: the next point is to be this side of that.
    between = jnp.minimum(search.stride, jnp.linalg.norm(new.u - search.before.u))
    falls, nearer = rise < -LEVEL, _step_again(search._replace(stride=between))
    return (there & ~falls, reached), (there, nearer), (directly(search), on), (to_goal, _step_again(search))


def _step_again(search: Search) -> Search:
    """Back to `before` and shorter steps: what looked like the path's next point was on another branch."""
    shorter = SHORTER * search.stride
    return search._replace(
        length=shorter,
        rose=jnp.zeros_like(search.rose),
        at_fold=jnp.zeros_like(search.at_fold),
        roughly=search.roughly & (shorter >= SHORT),
        polishing=search.roughly & (shorter < SHORT),
        mode=jnp.where(shorter < SMALLEST_STEP, ENDED, STEPPING),
    )


def _between(search: Search) -> Scalar:
    """The next trial inside the bracket of a limit point: regula falsi."""
    slope = search.rise_low - search.rise_high
    share = search.rise_low / jnp.where(slope > 0, slope, 1.0)
    return search.low + (search.high - search.low) * jnp.clip(share, 0.0, 1.0)


def after_fold_trial(search: Search, new: Point, good: Bool[Array, ""]) -> tuple[Case, ...]:
    rise = new.tangent[-1]
    rising = rise > 0
    side = jnp.where(rising, 1, -1)
    again = jnp.where(side == search.rose, 0.5, 1.0)
    inner = search._replace(
        far=jnp.where(rising, search.far, new.u),
        far_goal=jnp.where(rising, search.far_goal, new.goal),
        low=jnp.where(rising, search.length, search.low),
        high=jnp.where(rising, search.high, search.length),
        rise_low=jnp.where(rising, rise, again * search.rise_low),
        rise_high=jnp.where(rising, again * search.rise_high, rise),
        rose=side,
    )
    inner = inner._replace(length=_between(inner))
    done = jnp.abs(rise) < FLAT
    # A bracket that closes where the tangent jumps holds no limit point.
    lost = ~good | (~done & (inner.high - inner.low < 1e-12))
    at_fold = search._replace(far=new.u, far_goal=new.goal, high=search.length, at_fold=jnp.asarray(True))
    stopped = at_fold._replace(before=new, mode=jnp.asarray(FOLD))
    over = new.goal >= 0
    return (lost, _step_again(search)), (done & over, _to_goal(at_fold)), (done, stopped), (True, inner)
