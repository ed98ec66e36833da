"""Scenes with several unknowns: every question follows the branch from zero load by arc length.

The path has one parameter: first the external loads grow from nothing to their full size, then the pressure grows from
the value at which it begins to act. What is found is therefore on the branch connected to zero load, never a loop.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .checked import choice
from .numerics.paths import BIFURCATION, FIRST_STEP, FOLD, LARGEST_STEP, REACHED, fold_load, follow, trace
from .numerics.roots import implicit, select
from .reasons import Reason
from .results import Status, gate
from .scene import FALLEN, Found, Scene, frozen
from .spans import BEGINNING, Ray, Span, onwards, proportional

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
Goal = Callable[[Any, Vector, dict[str, Array]], Scalar]
"""(what it needs, point u, what is observed there) -> a number that rises through zero where a search ends."""


class Search(NamedTuple):
    """Where a search along the path ended, and why."""

    u: Vector
    status: Int[Array, ""]
    iterations: Int[Array, ""]
    reason: Int[Array, ""]
    detail: Scalar


class PathScene(Scene):
    """A scene that solves `measured(unknowns, share, pressure)[0] = 0`; share in [0, 1] scales its external loads."""

    loading: str = choice("first", "proportional", default="first", kw_only=True)
    """How the way to a state goes: "first", all external loads before any pressure; "proportional", loads and pressure
    together. Where both arrive they arrive at the same state, unless the loads alone would snap or buckle."""

    def end_reason(self) -> Reason:
        """What ends the model at `Span.end`."""
        return Reason.NO_EQUILIBRIUM

    @abc.abstractmethod
    def rest(self) -> Vector:
        """The unknowns without any load: an exact solution at share 0 and no pressure."""

    @abc.abstractmethod
    def measured(self, unknowns: Vector, share: Scalar, pressure: Any) -> tuple[Vector, dict[str, Array]]:
        """The scaled equations (entries and unknowns of order one) with the external loads times `share`, and what is
        observed. Both come from one integration; what is not used is not computed. In place of the pressure there may
        be what the scene's `driven` and its `Span.drive_at` give."""

    def observe(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[1]

    def evaluated(self, unknowns, pressure):
        return _measured(self, unknowns, jnp.ones_like(pressure), self.driven(pressure))

    def found_directly(self, pressure: Scalar) -> tuple[Vector, Bool[Array, ""] | bool]:
        """(unknowns at a pressure, True) where they can be found without the way there, as the state that is connected
        to zero load; (anything, False) where the path is to be followed."""
        return self.rest(), False

    def driven(self, pressure: Scalar) -> Any:
        """What `measured` is given of a pressure, as `Span.drive_at` gives it on the way."""
        return pressure

    @abc.abstractmethod
    def pressure_span(self) -> Span:
        """The range of pressures in which the actuator acts."""

    def is_unloaded(self) -> Array:
        """True where `rest` already solves the scene at no pressure: there are no external loads."""
        return jnp.asarray(False)

    def residual(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[0]

    def _start(self, span: Span) -> Vector:
        return jnp.append(self.rest(), jnp.zeros_like(span.loading))

    def _begun(self, u: Vector, span: Span, most: Scalar | float = jnp.inf) -> Vector:
        """A little further where the pressure begins to act, at most to a place: the path's direction shows there."""
        return u.at[-1].set(jnp.where(u[-1] >= span.loading, jnp.minimum(span.loading + BEGINNING, most), u[-1]))

    def _search(
        self, start: Vector, goal: Goal, context: Any, span: Span, is_there: Bool[Array, ""] | bool = False
    ) -> Search:
        """Where goal(context, ...) rises through zero along the path from `start`; `start` itself where `is_there`."""

        def equations(u, args):
            scene, context, span = args
            residual, observed = _measured(scene, u[:-1], span.share_at(u), span.drive_at(u))
            return residual, goal(context, u, observed)

        # Where the pressure alone acts the path is nearly straight.
        first = jnp.where(start[-1] >= span.loading, LARGEST_STEP, FIRST_STEP)
        end = follow(equations, start, (self, context, span), first, is_there)
        folded = end.reason == FOLD
        # A fold before the pressure acts: the other loads alone have no equilibrium. Where the finger buckles under
        # them the state beyond is not stable.
        is_loading = end.u[-1] <= span.loading
        not_held = is_loading & (folded | (end.reason == BIFURCATION))
        together = self.loading == "proportional"
        folded &= ~is_loading
        status = jnp.where(end.reason == REACHED, Status.OK, Status.NOT_CONVERGED)
        without = Status.BEYOND_LIMIT if together else Status.IMPOSSIBLE
        status = jnp.where(folded, Status.BEYOND_LIMIT, jnp.where(not_held, without, status))
        why = Reason.LOADS_AND_PRESSURE_NOT_HELD if together else Reason.LOAD_NOT_HELD
        reason = jnp.where(folded, int(Reason.LIMIT_POINT), jnp.where(not_held, int(why), 0))
        detail = jnp.where(not_held, span.share_at(end.u), jnp.nan)
        detail = jnp.where(folded, span.pressure_at(end.u, folded), detail)
        possible = self.can_exist()
        status, reason = jnp.where(possible, status, Status.IMPOSSIBLE), jnp.where(possible, reason, 0)
        return Search(end.u, status, end.iterations, reason, jnp.where(possible, detail, jnp.nan))

    def find(self, pressure):
        span = self.pressure_span()
        if self.loading == "proportional":
            ray = proportional(span, jnp.minimum(pressure, span.end))
            found, beyond = self._search(self._start(span), _to_place, ray.loading, ray), pressure > span.end
        else:
            wanted = span.place_of(pressure)
            reachable = jnp.minimum(wanted, span.last())
            start = self._begun(self._start(span), span, reachable)
            unknowns, is_found = self.found_directly(span.pressure_at(start.at[-1].set(reachable)))
            start = jnp.where(is_found, jnp.append(unknowns, reachable), start)
            found, beyond = self._search(start, _to_place, reachable, span, is_found), wanted > reachable
        ended = (found.status == Status.OK) & beyond
        status = jnp.where(ended, Status.BEYOND_LIMIT, found.status)
        reason = jnp.where(ended, int(self.end_reason()), found.reason)
        detail = jnp.where(ended, span.end, found.detail)
        u, steps = found.u, found.iterations
        return asked_for(pressure, Found(u[:-1], pressure, status, steps, reason=reason, detail=detail))

    def onset(self):
        return self.pressure_span().begin

    def find_limit(self):
        """As `Found`; `iterations` says which end it is: 1 a fold, 0 the end of the actuator's model."""
        span = self.pressure_span()
        start, way, last, before = self._begun(self._start(span), span), span, span.last(), None
        if self.loading == "proportional":
            ray, moderate = _to_moderate(span)
            before = self._search(self._start(span), _to_place, ray.loading, ray)
            start, way, last = before.u.at[-1].set(0.0), onwards(ray, moderate), (span.end - moderate) / span.step
        u, status, _, _, fold = self._search(start, _to_place, last, way)
        if before is not None:
            status = jnp.where(before.status == Status.OK, status, Status.IMPOSSIBLE)
        at_fold = status == Status.BEYOND_LIMIT
        pressure = jnp.where(at_fold, fold, span.end)
        return Found(u[:-1], pressure, jnp.where(at_fold, Status.OK, status), at_fold.astype(int))

    def limit_pressure_from(self, found):
        scale = frozen(self).pressure_span().step
        ok = found.status == Status.OK
        scene = gate(ok, self)

        def equations(u, args):
            scene, scale = args
            return scene.residual(u[:-1], u[-1] * scale)

        fold = fold_load(equations, jnp.append(found.unknowns, found.pressure / scale), (scene, scale)) * scale
        end = scene.pressure_span().end
        return jnp.where(ok, jnp.where(found.iterations == 1, fold, end), jnp.nan)

    def solve_for(self, name, target):
        point, found = self._sought(name, target, self.settled)
        solution = self._report(point[:-1], point[-1], found)
        no_answer = jnp.where(found.reason == Reason.VALUE_PASSED, found.pressure, jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, solution.pressure, no_answer))

    def _sought(self, name: str, target: Scalar, settled: Callable[[Found], Found]) -> tuple[Vector, Found]:
        """The unknowns and, last, the pressure (Pa) where an observable has its wanted value, with derivatives."""
        fixed, value = frozen((self, target))
        span = fixed.pressure_span()
        legs = fixed._legs_together if self.loading == "proportional" else fixed._legs
        (loaded, reached), pressures = legs(_Surplus(name), value, span)
        points = jnp.stack([loaded.u, reached.u])[:, :-1]
        seen = lax.map(lambda at: fixed.evaluated(*at), (points, pressures))
        over = jax.vmap(partial(_Surplus(name), value, None))(seen[1])
        pressure = pressures[1]
        no_pressure = (over[0] >= 0) & (self.loading == "first")
        if self.loading == "proportional":
            no_pressure = (reached.status == Status.OK) & (pressure <= 0)
        ended = ~no_pressure & (reached.status == Status.OK) & (pressure > span.end)
        status = jnp.where(no_pressure, Status.NO_CONTACT, jnp.where(ended, Status.BEYOND_LIMIT, reached.status))
        reason = jnp.where(status == Status.BEYOND_LIMIT, int(Reason.VALUE_NOT_REACHED), reached.reason)
        reason = jnp.where(no_pressure, int(Reason.VALUE_PASSED), reason)
        detail = jnp.where(ended, span.end, jnp.where(no_pressure, span.begin, reached.detail))
        held = loaded.status == Status.OK
        status, reason = jnp.where(held, status, loaded.status), jnp.where(held, reason, loaded.reason)
        meant = jnp.isfinite(value)
        found = Found(
            points[1],
            jnp.where(status == Status.NO_CONTACT, span.begin, pressure),
            jnp.where(meant, status, Status.IMPOSSIBLE),
            loaded.iterations + reached.iterations,
            jnp.where((status == Status.OK) & meant, over[1], 0.0),
            seen=jax.tree.map(lambda v: v[1], seen),
            reason=jnp.where(meant, reason, int(Reason.PRESSURE_RULE)),
            detail=jnp.where(meant, jnp.where(held, detail, loaded.detail), jnp.nan),
        )
        found, step = settled(found), span.step
        scene, target = gate(found.status == Status.OK, (self, target))

        def equations(point, args):
            scene, target, step = args
            residual, observed = scene.evaluated(point[:-1], point[-1] * step)
            return jnp.append(residual, _Surplus(name)(target, point, observed))

        point = implicit(equations, jnp.append(found.unknowns, pressure / step), (scene, target, step))
        return point.at[-1].multiply(step), found

    def _legs(self, surplus: Goal, value: Scalar, span: Span) -> tuple[tuple[Search, Search], Float[Array, " 2"]]:
        """First to where the pressure begins to act, then to the target, and the pressures there."""

        def goal(context, u, observed):
            is_loading, value, loading = context
            return jnp.where(is_loading, u[-1] - loading, surplus(value, u, observed))

        def leg(u, is_loading):
            """One program for both."""
            u = jnp.where(is_loading, u, self._begun(u, span))
            found = self._search(u, goal, (is_loading, value, span.loading), span)
            u = found.u.at[-1].set(jnp.where(is_loading, span.loading, found.u[-1]))
            return u, (found._replace(u=u), span.pressure_at(u))

        _, (both, pressures) = lax.scan(leg, self._start(span), jnp.array([True, False]))
        loaded, reached = (jax.tree.map(lambda v, k=k: v[k], both) for k in (0, 1))
        return (loaded, reached), pressures

    def _legs_together(self, surplus: Goal, value: Scalar, span: Span):
        """As `_legs`: first to a moderate pressure and all of the loads at once, then with the loads to the target,
        at a higher or a lower pressure. What is not found down to no pressure ends there."""
        ray, moderate = _to_moderate(span)

        def goal(context, u, observed):
            is_loading, value, loading, down, last = context
            over = surplus(value, u, observed)
            over = jnp.where(down, jnp.maximum(-over, u[-1] - last), over)
            return jnp.where(is_loading, u[-1] - loading, over)

        def leg(u, is_loading):
            """One program for both."""
            observed = _measured(self, u[:-1], jnp.ones_like(moderate), moderate)[1]
            down = ~is_loading & (surplus(value, u, observed) >= 0)
            way = select(is_loading, ray, onwards(ray, moderate, down))
            context = (is_loading, value, ray.loading, down, moderate / span.step)
            found = self._search(u.at[-1].set(0.0), goal, context, way)
            # Where no pressure is left, rounding must not leave a little of it.
            pressure = jnp.where(down & (found.u[-1] >= context[-1]), 0.0, way.pressure_at(found.u))
            return found.u, (found, jnp.where(is_loading, moderate, pressure))

        _, (both, pressures) = lax.scan(leg, self._start(span), jnp.array([True, False]))
        loaded, reached = (jax.tree.map(lambda v, k=k: v[k], both) for k in (0, 1))
        return (loaded, reached), pressures

    def branch(self, n):
        """n points at equal arc lengths from (next to) the first effect of pressure, through the limit point; where
        loads and pressure grow together, from the moderate pressure where they have arrived.

        The path is followed twice: to see where it turns and where it is to end, and once more with the limit point on
        one of the points.
        """
        span = self.pressure_span()
        ray, moderate = _to_moderate(span)
        together = self.loading == "proportional"
        way = ray if together else span
        loaded, status, *_ = self._search(self._start(span), _to_place, way.loading, way)
        span = onwards(ray, moderate) if together else span
        begun = self._begun(loaded.at[-1].set(span.loading), span)
        # A coarse curve is a part of one that is fine enough to see where it turns.
        finer = -(-BRANCH_POINTS // (n - 1))

        def along(u):
            return _measured(self, u[:-1], jnp.ones_like(u[-1]), span.drive_at(u))[0]

        def follow_it(step, _):
            points, trusted = trace(along, begun, step, finer * (n - 1) + 1)
            pressures = jax.vmap(span.pressure_at)(points)
            fold, end = branch_marks(points[:, -1], pressures, trusted & (points[:, -1] <= span.last()))
            cells = jnp.ceil((n - 1) * fold / end)
            whole = jnp.where(fold < end, fold / jnp.maximum(cells, 1), end / (n - 1))
            return step * whole / finer, (points, trusted)

        first = jnp.asarray(BRANCH_LENGTH / (finer * (n - 1)))
        _, (points, trusted) = lax.scan(follow_it, first, length=2)

        def report(u, trusted):
            good = trusted & (status == Status.OK) & (u[-1] >= span.loading)
            state = jnp.where(good, Status.OK, Status.NOT_CONVERGED)
            state = jnp.where(good & (u[-1] > span.last()), Status.BEYOND_LIMIT, state)
            pressure = span.pressure_at(u)
            return self._report(u[:-1], pressure, self.settled(Found(u[:-1], pressure, state, jnp.asarray(0))))

        return jax.vmap(report)(points[-1, ::finer], trusted[-1, ::finer])


def branch_marks(
    place: Float[Array, " k"], pressure: Float[Array, " k"], good: Bool[Array, " k"]
) -> tuple[Scalar, Scalar]:
    """Where a branch turns and where it is to end, in steps of its points; it does not turn where both are the same.

    It turns at the top of the parabola through the three points around the first that is higher than the next. It ends
    with the last `good` point; behind the turn, too, where the pressure is FALLEN times that of the turn, or where it
    rises again, for what is stable then is for a beam not to be seen from the curve.
    """
    index = jnp.arange(place.shape[0])
    gone = jnp.cumsum(~good) > 0
    rise = jnp.diff(place, append=place[-1:])
    turns = (rise < 0) & ~gone & ~jnp.roll(gone, -1)
    turned = jnp.any(turns) & (jnp.argmax(turns) > 0)
    top = jnp.where(turned, jnp.argmax(turns), index[-1])
    behind = index > top
    over = gone | (behind & ((pressure < FALLEN * pressure[top]) | (jnp.roll(rise, 1) > 0)))
    last = jnp.where(jnp.any(over), jnp.maximum(jnp.argmax(over) - 1, 1), index[-1])
    middle = jnp.clip(top, 1, index[-1] - 1)
    low, high, after = place[middle - 1], place[middle], place[middle + 1]
    bend = low - 2 * high + after
    fold = middle + 0.5 * (low - after) / jnp.where(bend == 0, 1.0, bend)
    end = last.astype(fold.dtype)
    return jnp.where(turned & (fold < end), fold, end), end


class _Surplus(NamedTuple):
    """A `Goal`: an observable less its target, over the target (in SI where that is zero)."""

    name: str

    def __call__(self, target: Scalar, _: Any, observed: dict[str, Array]) -> Scalar:
        size = jnp.abs(lax.stop_gradient(target))
        return (observed[self.name] - target) / jnp.where(size > 0, jnp.maximum(size, 1e-12), 1.0)


def _to_moderate(span: Span) -> tuple[Ray, Scalar]:
    """To all loads at a moderate pressure (Pa), one that bends by about a radian: there questions that name no pressure
    begin where loads and pressure grow together."""
    moderate = jnp.minimum(span.begin + span.step, 0.5 * (span.begin + span.end))
    return proportional(span, moderate), moderate


def asked_for(pressure: Scalar, found: Found) -> Found:
    """What was found, IMPOSSIBLE where nothing can be meant by the pressure."""
    meant = (pressure >= 0) & (pressure < jnp.inf)
    return found._replace(
        status=jnp.where(meant, found.status, Status.IMPOSSIBLE),
        reason=jnp.where(meant, found.reason, int(Reason.PRESSURE_RULE)),
        detail=jnp.where(meant, found.detail, jnp.nan),
    )


@jax.jit
def _measured(scene: PathScene, unknowns: Vector, share: Scalar, pressure: Any) -> tuple[Vector, dict[str, Array]]:
    """`scene.measured`, traced once for all that asks for it."""
    return scene.measured(unknowns, share, pressure)


def _to_place(place: Scalar, u: Vector, _: dict[str, Array]) -> Scalar:
    """The goal of a search for a place on the path."""
    return u[-1] - place


BRANCH_LENGTH = 50.0
"""Arc length of a drawn branch in scaled units at most: through the fold and down to where the finger curls up."""
BRANCH_POINTS = 100
"""At least as many are needed to see where a branch turns and ends."""
