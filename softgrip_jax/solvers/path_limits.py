"""The end of a path with its derivatives, and the curve through its limit point."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..equations import PathEquations, residual_and_observables
from ..load_path import begun, onwards, start_of, to_coordinate, to_moderate
from ..numerics.continuation import fold_load, trace
from ..numerics.implicit import implicit
from ..numerics.small_linear import solve_small
from ..reasons import Reason
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import FALLEN, Found, frozen

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

BRANCH_LENGTH = 50.0
"""Arc length of a drawn branch in scaled units at most: through the fold and down to where the finger curls up."""
JUST_BEFORE = 0.003
"""Steps before the end of the model at which a branch ends: the parabola is not the path."""
BRANCH_POINTS = 100
"""At least as many are needed to see where a branch turns and ends."""


def limit_pressure_from(scene: Any, found: Found) -> Scalar:
    """The limit pressure with its derivatives, from where `ArcLength.find_limit` found it."""
    scale = frozen(scene).pressure_span().step
    ok = found.status == Status.OK
    scene = stop_gradient_where_failed(ok, scene)

    def equations(u, args):
        scene, scale = args
        return scene.residual(u[:-1], u[-1] * scale)

    u = jnp.append(found.unknowns, found.pressure / scale)
    limit = jnp.where(
        found.reason == Reason.LIMIT_POINT,
        fold_load(equations, u, (scene, scale)) * scale,
        scene.pressure_span().end,
    )
    return jnp.where(ok, _where_the_model_ends(scene, limit, u, scale, found.reason), jnp.nan)


def _where_the_model_ends(scene: Any, limit: Scalar, u: Vector, scale: Scalar, reason: Int[Array, ""]) -> Scalar:
    """The pressure (Pa) at which a state reaches an end of the model, with its derivatives, from close to there;
    `limit` where the branch ends for another reason. scale: what u[-1] = 1 is in Pa."""
    ends = _ends(scene, u[:-1], u[-1] * scale)
    for why in ends:
        here = reason == why

        def equations(u, args, why=why):
            scene, scale, start, here = args
            pressure = u[-1] * scale
            own = scene.residual(u[:-1], pressure)
            # Elsewhere the equations may have no solution, or none with derivatives.
            return jnp.where(here, jnp.append(own, _ends(scene, u[:-1], pressure)[why]), u - start)

        args = (stop_gradient_where_failed(here, scene), scale, u, here)
        moving = implicit(equations, u, args)
        fixed, start = frozen((args, u))
        jacobian = jax.jacfwd(equations)(start, fixed)
        closer = (start - solve_small(jacobian, equations(start, fixed)))[-1]
        limit = jnp.where(here, (moving[-1] + lax.stop_gradient(closer - moving[-1])) * scale, limit)
    return limit


def _ends(scene: Any, unknowns: Vector, pressure: Scalar) -> dict[Reason, Scalar]:
    """Numbers that rise through zero where the model ends."""
    ends = scene.spent(unknowns, pressure)
    if type(scene).passed is not PathEquations.passed:
        passed = scene.passed(scene.evaluated(unknowns, pressure)[1])
        ends |= {} if passed is None else {Reason.CURLED_UP: passed}
    return ends


def branch(method: Any, scene: Any, n: int) -> Solution:
    """n points at equal arc lengths from (next to) the first effect of pressure, through the limit point; where
    loads and pressure grow together, from the moderate pressure where they have arrived.

    The path is followed twice: to see where it turns and where it is to end, and once more with one of the points next
    to the limit point, which is then moved there.
    """
    span = scene.pressure_span()
    ray, moderate = to_moderate(span)
    together = scene.grows_together()
    way = ray if together else span
    loaded, status, *_ = method.search(scene, start_of(scene, span), to_coordinate, way.loading, way)
    span = onwards(ray, moderate) if together else span
    first_point = begun(scene, loaded.at[-1].set(span.loading), span)
    # A coarse curve is a part of one that is fine enough to see where it turns.
    finer = -(-BRANCH_POINTS // (n - 1))

    def along(u):
        return residual_and_observables(scene.searched(), u[:-1], jnp.ones_like(u[-1]), span.load_at(u))[0]

    def follow_it(state, _):
        step, level = state
        points, trusted = trace(along, first_point, step, finer * (n - 1) + 1, level)
        pressures = jax.vmap(span.pressure_at)(points)
        told = jax.vmap(lambda u: scene.is_resolved(u[:-1]))(points)
        fold, end = branch_marks(points[:, -1], pressures, trusted, span.last(), told)
        cells = jnp.maximum(jnp.ceil((n - 1) * fold / end), 1)
        turns = fold < end
        whole = jnp.where(turns, fold / cells, end / (n - 1))
        return (step * whole / finer, jnp.where(turns, finer * cells.astype(int), 0)), (points, trusted)

    first = jnp.asarray(BRANCH_LENGTH / (finer * (n - 1))), jnp.asarray(0)
    _, (points, trusted) = lax.scan(follow_it, first, length=2)

    def report(u, trusted):
        good = trusted & (status == Status.OK) & (u[-1] >= span.loading)
        state = jnp.where(good, Status.OK, Status.NOT_CONVERGED)
        state = jnp.where(good & (u[-1] > span.last()), Status.BEYOND_LIMIT, state)
        pressure = span.pressure_at(u)
        return scene.report_of(u[:-1], pressure, scene.verified(Found(u[:-1], pressure, state, jnp.asarray(0))))

    return jax.vmap(report)(points[-1, ::finer], trusted[-1, ::finer])


def branch_marks(
    place: Float[Array, " k"],
    pressure: Float[Array, " k"],
    good: Bool[Array, " k"],
    most: Scalar | float = jnp.inf,
    told: Bool[Array, " k"] | bool = True,
) -> tuple[Scalar, Scalar]:
    """Where a branch turns and where it is to end, in steps of its points; it does not turn where both are the same.

    It turns at the top of the parabola through the three points around the first that is higher than the next. It ends
    with the last `good` point, or JUST_BEFORE the place `most` of the parabola through the last point before it and its
    neighbours; behind the turn, too, where the pressure is FALLEN times that of the turn, or where it rises again, for
    what is stable then is for a beam not to be seen from the curve, or before a shape that is not `told`.
    """
    index = jnp.arange(place.shape[0])
    beyond = place > most
    gone = jnp.cumsum(~good | beyond) > 0
    rise = jnp.diff(place, append=place[-1:])
    turns = (rise < 0) & ~gone & ~jnp.roll(gone, -1)
    turned = jnp.any(turns) & (jnp.argmax(turns) > 0)
    top = jnp.where(turned, jnp.argmax(turns), index[-1])
    behind = index > top
    over = gone | (behind & ((pressure < FALLEN * pressure[top]) | (jnp.roll(rise, 1) > 0) | jnp.logical_not(told)))
    last = jnp.where(jnp.any(over), jnp.maximum(jnp.argmax(over) - 1, 1), index[-1])
    middle = jnp.clip(top, 1, index[-1] - 1)
    low, high, after = place[middle - 1], place[middle], place[middle + 1]
    bend = low - 2 * high + after
    fold = middle + 0.5 * (low - after) / jnp.where(bend == 0, 1.0, bend)
    end = last.astype(fold.dtype)
    here = jnp.clip(last, 1, index[-1] - 1)
    low, high, after = place[here - 1], place[here], place[here + 1]
    slope, bend, left = 0.5 * (after - low), low - 2 * high + after, most - high
    passes = good[here + 1] & beyond[here + 1] & (here == last)
    slope, bend, left = (jnp.where(passes, value, 1.0) for value in (slope, bend, left))
    share = 2 * left / (slope + jnp.sqrt(jnp.maximum(slope**2 + 2 * bend * left, 0.0)))
    end += jnp.where(passes, jnp.clip(share - JUST_BEFORE, 0.0, 1.0), 0.0)
    return jnp.where(turned & (fold < end), fold, end), end
