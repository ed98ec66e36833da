"""Inverse problems along a path: the pressure at which an observable has its wanted value."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..equations import residual_and_observables
from ..load_path import Goal, LoadPath, PathEnd, begun, onwards, start_of, to_moderate
from ..numerics.choice import larger, select
from ..numerics.implicit import implicit
from ..reasons import Reason
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import Found, frozen
from .climb import climb_to

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

MUCH_CLOSER = 1e-4
"""Of `BEGINNING`: a second try to find a value begins so close to where the pressure begins to act."""


class Surplus(NamedTuple):
    """A `Goal`: an observable less its target, over the target (in SI where that is zero)."""

    name: str

    def __call__(self, target: Scalar, _: Any, observed: dict[str, Array]) -> Scalar:
        return surplus_over(self.name, target, observed)


def surplus_over(name: str, target: Scalar, observed: dict[str, Array]) -> Scalar:
    """An observable less its target, over the target (in SI where that is zero)."""
    size = jnp.abs(lax.stop_gradient(target))
    return (observed[name] - target) / jnp.where(size > 0, jnp.maximum(size, 1e-12), 1.0)


def solve_for(method: Any, scene: Any, name: str, target: Scalar) -> Solution:
    """The solution at the pressure that gives an observable its wanted value."""
    point, found = _sought(method, scene, name, target, scene.verified)
    solution = scene.report_of(point[:-1], point[-1], found)
    no_answer = jnp.where(found.reason == Reason.VALUE_PASSED, found.pressure, jnp.nan)
    return solution.at_pressure(jnp.where(solution.status == Status.OK, solution.pressure, no_answer))


def onset(method: Any, scene: Any, name: str) -> Scalar:
    """The pressure (Pa) where an observable rises through zero, with its derivatives; inf where it never does. Where it
    is positive already, the pressure begins to act."""
    begins = scene.pressure_span().begin
    point, found = _sought(method, scene, name, jnp.zeros_like(begins), scene.solved)
    never = jnp.where(found.status == Status.BEYOND_LIMIT, jnp.inf, jnp.nan)
    touched = jnp.where(found.status == Status.OK, point[-1], never)
    return jnp.where(found.reason == Reason.VALUE_PASSED, begins, touched)


def _sought(
    method: Any, scene: Any, name: str, target: Scalar, verified: Callable[[Found], Found]
) -> tuple[Vector, Found]:
    """The unknowns and, last, the pressure (Pa) where an observable has its wanted value, with derivatives."""
    fixed, value = frozen((scene, target))
    span = fixed.pressure_span()
    legs = _legs_together if scene.grows_together() else _legs
    (loaded, reached), pressures = legs(method, fixed, Surplus(name), value, span)
    points = jnp.stack([loaded.u, reached.u])[:, :-1]
    seen = lax.map(lambda at: fixed.evaluated(*at), (points, pressures))
    over = jax.vmap(partial(Surplus(name), value, None))(seen[1])
    pressure = pressures[1]
    no_pressure = (over[0] >= 0) & (not scene.grows_together())
    if scene.grows_together():
        no_pressure = (reached.status == Status.OK) & (pressure <= 0)
    ended = ~no_pressure & (reached.status == Status.OK) & (pressure > span.end)
    status = jnp.where(no_pressure, Status.NO_CONTACT, jnp.where(ended, Status.BEYOND_LIMIT, reached.status))
    # The path is followed a little beyond the end of a law: it ends there all the same.
    ends = ended | ((status == Status.BEYOND_LIMIT) & (reached.detail > span.end))
    unknown = ends & (scene.end_reason() == Reason.CELL_LAW_ENDS)
    beyond = jnp.where(unknown, int(Reason.VALUE_BEYOND_CELL_LAW), int(Reason.VALUE_NOT_REACHED))
    reason = jnp.where(status == Status.BEYOND_LIMIT, beyond, reached.reason)
    reason = jnp.where(no_pressure, int(Reason.VALUE_PASSED), reason)
    detail = jnp.where(ends, span.end, jnp.where(no_pressure, span.begin, reached.detail))
    held = loaded.status == Status.OK
    status, reason = jnp.where(held, status, loaded.status), jnp.where(held, reason, loaded.reason)
    meant = jnp.isfinite(value)
    found = Found(
        points[1],
        jnp.where(status == Status.NO_CONTACT, span.begin, pressure),
        jnp.where(meant, status, Status.IMPOSSIBLE),
        loaded.iterations + reached.iterations,
        jnp.where((status == Status.OK) & meant, over[1], 0.0),
        evaluated=jax.tree.map(lambda v: v[1], seen),
        reason=jnp.where(meant, reason, int(Reason.PRESSURE_RULE)),
        detail=jnp.where(meant, jnp.where(held, detail, loaded.detail), jnp.nan),
    )
    found, step = verified(found), span.step
    ok = found.status == Status.OK
    solved = stop_gradient_where_failed(ok, (scene, target))

    def equations(point, args):
        scene, target, step = args
        residual, observed = scene.evaluated(point[:-1], point[-1] * step)
        return jnp.append(residual, Surplus(name)(target, point, observed))

    point = implicit(equations, jnp.append(found.unknowns, pressure / step), (*solved, step))
    point = stop_gradient_where_failed(ok, point)
    return point.at[-1].multiply(step), found


def _legs(
    method: Any, scene: Any, surplus: Goal, value: Scalar, span: LoadPath
) -> tuple[tuple[PathEnd, PathEnd], Float[Array, " 2"]]:
    """First to where the pressure begins to act, then to the target, and the pressures there.

    What was not found because it lies far behind where the second leg began is sought once more from close to where
    the pressure begins to act: there the state may change with a root of the place.
    """

    def goal(context, u, observed):
        is_loading, value, loading = context
        return jnp.where(is_loading, u[-1] - loading, surplus(value, u, observed))

    def leg(carry, number):
        """One program for all."""
        loaded, before = carry
        is_loading, again = number == 0, number == 2
        by = jnp.where(again, MUCH_CLOSER, 1.0)
        u = jnp.where(is_loading, loaded, begun(scene, loaded, span, by=by))
        is_there = again & (before.status != Status.NOT_CONVERGED)
        climb = climb_to(span.last(), scene, span)
        if climb is not None:
            climb = climb._replace(here=climb.here & (number == 1))
        context = (is_loading, value, span.loading)
        found = method.search(scene, u, goal, context, span, is_there=is_there, climb=climb)
        found = select(is_there, before, found)
        u = found.u.at[-1].set(jnp.where(is_loading, span.loading, found.u[-1]))
        found = found._replace(u=u)
        return (jnp.where(is_loading, u, loaded), found), (found, span.pressure_at(u))

    start = start_of(scene, span)
    none = PathEnd(start, jnp.asarray(Status.OK), jnp.asarray(0), jnp.asarray(0), jnp.full_like(value, jnp.nan))
    _, (legs, pressures) = lax.scan(leg, (start, none), jnp.arange(3))
    loaded, reached = (jax.tree.map(lambda v, k=k: v[k], legs) for k in (0, 2))
    return (loaded, reached), pressures[jnp.array([0, 2])]


def _legs_together(method: Any, scene: Any, surplus: Goal, value: Scalar, span: LoadPath):
    """As `_legs`: first to a moderate pressure and all of the loads at once, then with the loads to the target,
    at a higher or a lower pressure. What is not found down to no pressure ends there."""
    ray, moderate = to_moderate(span)

    def goal(context, u, observed):
        is_loading, value, loading, down, last = context
        over = surplus(value, u, observed)
        over = jnp.where(down, larger(-over, u[-1] - last), over)
        return jnp.where(is_loading, u[-1] - loading, over)

    def leg(u, is_loading):
        """One program for both."""
        observed = residual_and_observables(scene, u[:-1], jnp.ones_like(moderate), moderate)[1]
        down = ~is_loading & (surplus(value, u, observed) >= 0)
        way = select(is_loading, ray, onwards(ray, moderate, down))
        context = (is_loading, value, ray.loading, down, moderate / span.step)
        found = method.search(scene, u.at[-1].set(0.0), goal, context, way)
        # Where no pressure is left, rounding must not leave a little of it.
        pressure = jnp.where(down & (found.u[-1] >= context[-1]), 0.0, way.pressure_at(found.u))
        return found.u, (found, jnp.where(is_loading, moderate, pressure))

    _, (both, pressures) = lax.scan(leg, start_of(scene, span), jnp.array([True, False]))
    loaded, reached = (jax.tree.map(lambda v, k=k: v[k], both) for k in (0, 1))
    return (loaded, reached), pressures
