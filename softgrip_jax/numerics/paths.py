"""Equilibrium paths residual(y, load) = 0 by arc length: goals, limit points, and the curve through them.

A path is followed from a known point in the direction of growing load, so what is found is on the branch connected to
that point and on no other. Points are vectors u = (y, load), scaled by the caller so that each entry is of order one.
No derivatives pass through (see roots.implicit).

One loop does everything (steps, the search for a limit point, the last step to the goal), one Newton iteration of
whatever is under way at a time: the residual and its Jacobian are compiled once, which is what users wait for, and
lanes of a batch do not wait for each other's iterations (see `queue`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .batching import lane_pool
from .roots import implicit, select, solve_and_sign, solve_small
from .xla import materialised

Vector = Float[Array, " n"]
Scalar = Float[Array, ""]
Equations = Callable[[Vector, Any], tuple[Vector, Scalar]]
"""(u of size n + 1, args) -> n equations, and the goal: a number that rises through zero where a search ends."""

FIRST_STEP = 0.3
LARGEST_STEP = 4.0
SMALLEST_STEP = 1e-7
LONGER, SHORTER = 2.0, 0.3
"""Arc lengths in scaled units: less than a typical load to start with, for what bends a beam may begin with the square
of a load (the contact of chambers); below 1e-7 a path counts as ended. A step that fails is tried again, SHORTER."""
SHORT = 0.2
"""A step shorter than this that fails may have failed because the point before was known roughly only."""
MAX_STEPS = 400
NEWTON_STEPS = 8
"""A good predictor needs 2 to 4 corrections; a step that needs more is shortened instead."""
CONTRACTION = 0.7
"""Corrections must shrink at least this much (Deuflhard 2004, 2.1, has 1/2; next to a limit point they just halve): a
Newton iteration that wanders may settle on another branch. The start of the search is then taken closer."""
TURN = 0.9
"""Cosine of the largest turn of the tangent in one step (26 degrees): keeps a step from jumping between branches."""
POLISHED_TURN = 0.5
"""And where a point that was known roughly is found better."""
DETOUR = 0.25
"""A correction is at most this part of its step: an arc that turns by 26 degrees leaves its tangent by 0.22."""
GOAL_STEPS = 20
"""Next to a limit point the last Newton iteration halves its error at first, before it squares it."""
SETTLED = 1e-8
"""Moves below this need not contract: they are near rounding."""
LEAST_BEND = 1e-2
"""Of the equations, as far as two moves can tell: a move of 1e-7 is the last one."""
ROUNDED = 1e-13
"""Moves below this are rounding alone: from a point of the path itself they are of one size from the first one on."""


class Accuracy(NamedTuple):
    """How well the points of a path are solved for."""

    move: Scalar | float
    """Newton's method ends where its next move would be below this."""
    left: Scalar | float
    """Or where a first correction leaves about this: itself times the turn of the tangent (its sine)."""


class Steps(NamedTuple):
    """How long the steps along a path may be, and how many."""

    first: float = FIRST_STEP
    largest: float = LARGEST_STEP
    turn: float = TURN
    most: int = MAX_STEPS


FINE = Accuracy(1e-16, -1.0)
ROUGH = Accuracy(1e-3, 0.05)
"""Of the steps on the way: to keep to a branch, not to know it. A search that ends on the way begins once more with
every point known well: a rough point may have been off the path."""
STEEP = 0.1
"""Load component of the tangent below which a point is known well, so that it is known on which side of a limit point
it lies."""
SLACK = 0.05
"""What a correction may be in any case: no more than the point before may be off."""
LEVEL = 1e-6
"""Load component of a tangent that may be of either sign at a limit point that is known to rounding."""
FLAT = 1e-8
"""Load component of the tangent that counts as a limit point, whose load is then right to the square of it."""

STEPPING, TO_FOLD, TO_GOAL, REACHED, FOLD, BIFURCATION, ENDED = range(7)


class Point(NamedTuple):
    """A point of a path with its unit tangent, and how far it is from the goal."""

    u: Vector
    tangent: Vector
    goal: Scalar
    side: Scalar
    """Sign of det [Jacobian; tangent]: it is one and the same along a path, through limit points too, and another on
    the far side of a bifurcation or on the next branch. 0 where it is not known yet."""


class Newton(NamedTuple):
    """A Newton iteration under way: where it is, and the sizes of its last two moves."""

    u: Vector
    before_last: Scalar
    last: Scalar
    count: Int[Array, ""]


def _newton_from(guess: Vector) -> Newton:
    far = jnp.full((), jnp.inf, guess.dtype)
    return Newton(guess, far, far, jnp.asarray(0))


def value_and_jacobian(function: Callable[[Vector], Any], u: Vector) -> tuple[Any, Any]:
    """function(u), vectors or scalars, and their Jacobians, with the function's own work done once."""
    return jax.vmap(lambda v: jax.jvp(function, (u,), (v,)), out_axes=(None, -1))(jnp.eye(u.shape[0], dtype=u.dtype))


class Local(NamedTuple):
    """What one factorisation of the equations at a point tells of the path there."""

    goal: Scalar
    """Where the Newton step leads, as far as its slope tells."""

    tangent: Vector
    """A null vector of the equations' Jacobian."""
    sign: Scalar
    """Of det [Jacobian; tangent]."""
    rise: Vector
    """The gradient of the goal."""


def _newton_step(
    equations: Callable[[Vector], tuple[Vector, Scalar]],
    tangent: Vector,
    guess: Vector,
    to_goal: Bool[Array, ""] | bool,
    newton: Newton,
) -> tuple[Newton, Local]:
    """One Newton step towards the path in the plane through `guess` across the tangent or, with `to_goal`, towards the
    path where goal = 0; and what is known of the path before it."""
    u = newton.u
    (value, goal), (jacobian, rise) = value_and_jacobian(equations, u)
    last = jnp.where(to_goal, goal, jnp.dot(tangent, u - guess))
    row = jnp.where(to_goal, rise, tangent)
    right = jnp.stack([jnp.append(value, last), jnp.zeros_like(u).at[-1].set(1.0)], axis=1)
    found, sign = solve_and_sign(jnp.concatenate([jacobian, row[None]]), right)
    move, null = found.T
    size = jnp.max(jnp.abs(move) / (1 + jnp.abs(u)))
    size = jnp.where(jnp.isfinite(size), size, jnp.inf)
    local = Local(goal - jnp.dot(rise, move), null / jnp.linalg.norm(null), sign, rise)
    return Newton(u - move, newton.last, size, newton.count + 1), local


def _next_move(newton: Newton) -> Scalar:
    """Quadratic convergence: moves e, C e^2, then C (C e^2)^2; never thought to be slower than halving, nor C to be
    less than LEAST_BEND: the first move may lie along the path, where nothing bends."""
    ratio = jnp.where(jnp.isfinite(newton.before_last), newton.last / newton.before_last, 1.0)
    return newton.last * jnp.maximum(jnp.minimum(ratio, 1.0) ** 2, LEAST_BEND * newton.last)


def _goes_on(newton: Newton, limit: Int[Array, ""] | int, accuracy: Accuracy) -> Bool[Array, ""]:
    """Whether a Newton iteration has more to do; it is given up where its moves do not contract."""
    contracts = newton.last <= jnp.maximum(CONTRACTION * newton.before_last, SETTLED)
    # Written so that a NaN, from two moves of zero or from none at all, ends the loop.
    more = ~(_next_move(newton) <= accuracy.move) & (newton.last > accuracy.move)
    return more & (newton.count < limit) & contracts & jnp.all(jnp.isfinite(newton.u))


def _converged(newton: Newton, accuracy: Accuracy) -> Bool[Array, ""]:
    verified = (newton.last <= accuracy.move) | (_next_move(newton) <= accuracy.move) | (newton.last <= ROUNDED)
    return verified & jnp.isfinite(newton.last)


def _arrived(
    newton: Newton,
    local: Local,
    before: Point,
    guess: Vector,
    within: Bool[Array, ""] | bool,
    first: Bool[Array, ""] | bool = False,
    polishing: Bool[Array, ""] | bool = False,
    turn: float = TURN,
) -> tuple[Point, Scalar, Bool[Array, ""], Scalar, Bool[Array, ""]]:
    """Where a Newton iteration is, how the goal rises along the path there, whether that can be trusted to be the
    path's next point once it has converged, about how far from there it was left by its first correction, and whether
    all that is wrong with it is that it lies beyond a bifurcation.

    It can if the tangent has not turned too far since `before`, no branch point was passed, and the correction was
    small (`within` a known piece of the path it may be large). At the first point the tangent was only guessed: it may
    turn as it likes, but must point to growing load; and more than usual where a rough point is found better.
    """
    along = jnp.where(jnp.dot(local.tangent, before.tangent) < 0, -1.0, 1.0)
    tangent, side = along * local.tangent, along * local.sign
    rise = jnp.dot(local.rise, tangent)
    same_side = (before.side == 0) | (side == before.side)
    straight = jnp.dot(tangent, before.tangent)
    correction = jnp.linalg.norm(newton.u - guess)
    near = correction <= DETOUR * jnp.linalg.norm(guess - before.u) + jnp.where(polishing, 3 * SLACK, SLACK)
    ahead = jnp.all(jnp.isfinite(tangent)) & (tangent[-1] > 0)
    least = jnp.where(polishing, min(POLISHED_TURN, turn), turn)
    trusted = jnp.where(first, ahead, (straight > least) & (near | within))
    # Only the first correction tells: a Newton iteration that wanders may come back to its guess from far away.
    left = jnp.where(newton.count > 1, jnp.inf, correction * jnp.sqrt(jnp.maximum(1 - straight**2, 0.0)))
    return Point(newton.u, tangent, local.goal, side), rise, trusted & same_side, left, trusted & ~same_side


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
    newton: Newton
    iterations: Int[Array, ""]
    """Newton iterations so far."""
    careful: Bool[Array, ""]
    """Whether this is the second try, with every point known well."""


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
) -> End:
    """Follow the path from u towards growing load until the goal rises through zero, the load turns, or the path ends.

    equations: must take every traced value through u and args. first: the arc length to try first. steps: of all the
    others. is_there: True where u is the goal itself, and nothing is to be done.
    """
    by = steps or Steps()
    traced = jax.jit(equations)  # once for all that follows

    def iterate(search: Search, context) -> Search:
        args, *start = context
        stepping, to_goal = search.mode == STEPPING, search.mode == TO_GOAL
        newton, local = _newton_step(
            lambda u: traced(u, args), search.before.tangent, search.guess, to_goal, search.newton
        )
        first = (search.count == 0) & ~to_goal
        within = to_goal & ~_directly(search)
        new, rise, trusted, left, crossed = _arrived(
            newton, local, search.before, search.guess, within, first, search.polishing, by.turn
        )
        roughly = stepping & ~search.polishing & ~search.careful & (jnp.abs(new.tangent[-1]) > STEEP)
        accuracy = Accuracy(*(jnp.where(roughly, a, b) for a, b in zip(ROUGH, FINE, strict=True)))
        newton = newton._replace(last=jnp.where(left <= accuracy.left, 0.0, newton.last))
        converged = _converged(newton, accuracy)
        good = trusted & converged
        limit = jnp.where(within, GOAL_STEPS, NEWTON_STEPS)
        going = _goes_on(newton, limit, accuracy)
        case, chosen = _first_of(
            (going, search),
            *_after_step(search, new, rise, good, roughly, crossed & converged, by.largest),
            *_after_goal_trial(search, new, good),
            *_after_fold_trial(search, new, good),
        )
        again = (chosen.mode >= BIFURCATION) & ~search.careful
        chosen = select(again, _begin(*start, careful=True), chosen)
        going = case == 0
        # The second try, too, begins where the path does, and not a step ahead on whatever branch is there.
        guess = jnp.where(going | again, chosen.guess, _guess(chosen))
        return chosen._replace(
            count=jnp.where(again, 0, search.count + ~going),
            guess=guess,
            newton=select(going, newton, _newton_from(guess)),
            iterations=search.iterations + 1,
        )

    def busy(search: Search) -> Bool[Array, ""]:
        return (search.mode < REACHED) & (search.count < by.most)

    begin = _begin(u, first)
    begin = begin._replace(mode=jnp.where(is_there, REACHED, begin.mode))
    end = lane_pool(busy, iterate, begin, (args, u, jnp.asarray(first, u.dtype)))
    return End(end.before.u, jnp.where(end.mode < REACHED, ENDED, end.mode), end.iterations)


def _begin(u: Vector, length: Scalar | float, careful: bool = False) -> Search:
    """The first "step" has length zero: it finds the tangent at u."""
    zero, count = jnp.zeros((), u.dtype), jnp.asarray(0)
    start = Point(u, jnp.zeros_like(u).at[-1].set(1.0), zero, zero)
    no, mode = jnp.asarray(False), jnp.asarray(STEPPING)
    length = zero + length
    return Search(
        *(start, u, zero, length, zero, zero, zero, zero, zero, count, no, 0 * u, no, no, mode, count),
        guess=u,
        newton=_newton_from(u),
        iterations=count,
        careful=jnp.asarray(careful),
    )


Case = tuple[Bool[Array, ""] | bool, Search]
"""A condition, and how the search goes on where it is the first that holds: see `_first_of`."""


def _first_of(*cases: Case) -> tuple[Scalar, Search]:
    """(the number of the first case whose condition holds, its state); the last is for all the rest.

    Numbered before anything is chosen: XLA would work out the conditions anew for every array of the state.
    """
    conditions, states = zip(*cases, strict=True)
    number = jnp.asarray(len(cases) - 1.0)
    for k in reversed(range(len(cases) - 1)):
        number = jnp.where(conditions[k], float(k), number)
    number = materialised(number)

    def chosen(*values):
        result = values[-1]
        for value in {id(v): v for v in values if v is not result}.values():
            here = [number == k for k, v in enumerate(values) if v is value]
            result = jnp.where(jnp.any(jnp.stack(here), axis=0), value, result)
        return result

    return number, jax.tree.map(chosen, *states)


def _guess(search: Search) -> Vector:
    """Of the next trial: a quadratic as the path bent before, or through `before`, its tangent, `far`."""
    before, length, high = search.before, search.length, search.high
    through_far = (search.far - before.u - high * before.tangent) / jnp.where(high > 0, high, 1) ** 2
    bend = jnp.where((search.mode == STEPPING) | _directly(search), 0.5 * search.bend, through_far)
    return materialised(before.u + jnp.where(search.polishing, 0.0, length) * (before.tangent + length * bend))


def _to_goal(search: Search) -> Search:
    """Aim at the goal between `before` and `far`: a straight line, or a parabola with its top at a limit point."""
    near, there = search.before.goal, search.far_goal
    rest = there / jnp.where(there > near, there - near, 1.0)
    share = 1 - jnp.where(search.at_fold, jnp.sqrt(jnp.maximum(rest, 0.0)), rest)
    return search._replace(length=search.high * jnp.clip(share, 0.0, 1.0), mode=jnp.asarray(TO_GOAL))


def _after_step(
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


def _directly(search: Search) -> Bool[Array, ""]:
    """Whether the goal is sought from `before` alone, with nothing known beyond it."""
    return (search.mode == TO_GOAL) & (search.high == 0)


def _after_goal_trial(search: Search, new: Point, good: Bool[Array, ""]) -> tuple[Case, ...]:
    to_goal = search.mode == TO_GOAL
    reached = search._replace(before=new, mode=jnp.asarray(REACHED))
    # A goal that was not where it seemed to be: the step that would have been made without it.
    on = search._replace(length=search.stride, mode=jnp.asarray(STEPPING))
    # At the limit point itself the tangent is level.
    rising = new.tangent[-1] > jnp.where(search.at_fold, -LEVEL, 0.0)
    return (to_goal & good & rising, reached), (_directly(search), on), (to_goal, _step_again(search))


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


def _after_fold_trial(search: Search, new: Point, good: Bool[Array, ""]) -> tuple[Case, ...]:
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


class Border(NamedTuple):
    """Frozen vectors that make the equations of a fold regular: see `fold_load`."""

    load: Vector
    null: Vector


def _border(jacobian: Float[Array, "n m"]) -> Border:
    """The border for folds near u: d residual / d load, and the direction of y that the path takes there."""
    matrix = jnp.concatenate([jacobian, _null_direction(jacobian)[None]])
    tangent = solve_small(matrix, jnp.zeros(len(matrix)).at[-1].set(1.0))
    return lax.stop_gradient(Border(jacobian[:, -1], tangent[:-1] / jnp.linalg.norm(tangent)))


def _null_direction(jacobian: Float[Array, "n m"]) -> Float[Array, " m"]:
    """A vector that is not orthogonal to the null space: the cross product of the rows, or its projection."""
    m = jacobian.shape[1]
    scale = jnp.max(jnp.abs(jacobian))
    gram = jacobian.T @ jacobian + 1e-10 * scale**2 * jnp.eye(m, dtype=jacobian.dtype)
    v = jnp.ones(m, jacobian.dtype)
    for _ in range(2):
        v = solve_small(gram, v)
        v = v / jnp.linalg.norm(v)
    return v


def _singular(jacobian: Float[Array, "n m"], border: Border) -> tuple[Vector, Scalar]:
    """(w, g): g is zero where J = d residual / d y is singular, and w is then its left null vector.

    [[J, b], [c, 0]]^T [w; g] = [0; 1] (Keller; Govaerts 2000, bordered systems). Unlike the determinant g is scaled,
    and both are smooth for any number of unknowns; where g is zero does not depend on the border.
    """
    n = jacobian.shape[1]
    matrix = jnp.zeros((n, n), jacobian.dtype)
    matrix = matrix.at[:-1, :-1].set(jacobian[:, :-1].T)
    matrix = matrix.at[:-1, -1].set(border.null).at[-1, :-1].set(border.load)
    solution = solve_small(matrix, jnp.zeros(n, jacobian.dtype).at[-1].set(1.0))
    return solution[:-1], solution[-1]


def fold_load(residual: Callable[[Vector, Any], Vector], u: Vector, args: Any) -> Scalar:
    """The load u[-1] of a limit point u of residual(u, args) = 0, with its derivatives of any order by `args`.

    dp = -(w . dr/dargs dargs) / (w . dr/dp) with the left null vector w of dr/dy: how y moves along with the limit
    point plays no part. Only a second derivative asks for that, and only then are its equations compiled.
    """

    def with_border(u, args):
        return value_and_jacobian(lambda u: residual(u, args), u)

    @jax.custom_jvp
    def load(u, args):
        return u[-1]

    @load.defjvp
    def load_jvp(primals, tangents):
        u, args = primals
        border = _border(with_border(u, lax.stop_gradient(args))[1])

        def at_fold(u, args):
            args, border = args
            value, jacobian = with_border(u, args)
            return jnp.append(value, _singular(jacobian, border)[1])

        moving = implicit(at_fold, u, (args, border))
        jacobian = with_border(moving, args)[1]
        w, _ = _singular(jacobian, border)
        _, along_args = jax.jvp(lambda a: residual(moving, a), (args,), (tangents[1],))
        return load(u, args), -jnp.dot(w, along_args) / jnp.dot(w, jacobian[:, -1])

    return load(lax.stop_gradient(u), args)


def trace(
    residual: Callable[[Vector], Vector], u: Vector, step: Scalar | float, n: int
) -> tuple[Float[Array, "k m"], Bool[Array, " k"]]:
    """n points of the path from u at equal arc lengths, through any limit point; and which are trusted."""
    zero = jnp.zeros((), u.dtype)

    def correct(point: Point, guess: Vector) -> tuple[Point, Bool[Array, ""]]:
        """The point of the path next to `guess`, in the plane across the tangent, and whether it can be trusted."""

        def step(state):
            return _newton_step(lambda u: (residual(u), zero), point.tangent, guess, False, state[0])

        start = (_newton_from(guess), Local(zero, 0 * u, zero, 0 * u))
        newton, local = lax.while_loop(lambda state: _goes_on(state[0], NEWTON_STEPS, FINE), step, start)
        new, _, trusted, *_ = _arrived(newton, local, point, guess, False)
        return new, trusted & _converged(newton, FINE)

    start, _ = correct(Point(u, jnp.zeros_like(u).at[-1].set(1.0), zero, zero), u)

    def next_point(state, _):
        point, length, alive = state

        def attempt(state):
            point, length, rest = state
            new, good = correct(point, point.u + jnp.minimum(length, rest) * point.tangent)
            rest = jnp.where(good, rest - jnp.minimum(length, rest), rest)
            return select(good, new, point), jnp.where(good, LONGER * length, SHORTER * length), rest

        def busy(state):
            return alive & (state[2] > 0) & (state[1] > SMALLEST_STEP)

        point, length, rest = lax.while_loop(busy, attempt, (point, length, zero + step))
        alive = alive & (rest <= 0)
        return (point, length, alive), (point.u, alive)

    _, (points, alive) = lax.scan(next_point, (start, zero + step, jnp.asarray(True)), None, length=n - 1)
    return jnp.concatenate([start.u[None], points]), jnp.concatenate([jnp.ones(1, bool), alive])
