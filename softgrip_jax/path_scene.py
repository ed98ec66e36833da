"""Scenes with several unknowns: every question follows the branch from zero load by arc length.

The path has one parameter: first the external loads grow from nothing to their full size, then the pressure grows from
the value at which it begins to act. What is found is therefore on the branch connected to zero load, never a loop.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .fields import choice
from .load_path import BEGINNING, LoadPath, Ray, onwards, proportional
from .numerics.choice import larger
from .numerics.paths import BIFURCATION, ENDED, FOLD, REACHED, End, Steps, fold_load, follow, trace
from .numerics.roots import implicit, select, solve_small
from .reasons import Reason
from .results import Status, stop_gradient_where_failed
from .scene import FALLEN, Found, Scene, frozen

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
    """A scene that solves `residual_and_observables(unknowns, share, pressure)[0] = 0`.

    share in [0, 1] scales its external loads.
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("ArcLength", "Newton")

    loading: str = choice("first", "proportional", default="first", kw_only=True)
    """How the way to a state goes: "first", all external loads before any pressure; "proportional", loads and pressure
    together. Where both arrive they arrive at the same state, unless the loads alone would snap or buckle."""

    def end_reason(self) -> Reason:
        """What ends the model at `LoadPath.end`."""
        return Reason.NO_EQUILIBRIUM

    @abc.abstractmethod
    def unloaded_state(self) -> Vector:
        """The unknowns without any load: an exact solution at share 0 and no pressure."""

    @abc.abstractmethod
    def residual_and_observables(
        self, unknowns: Vector, share: Scalar, pressure: Any
    ) -> tuple[Vector, dict[str, Array]]:
        """The scaled equations (entries and unknowns of order one) with the external loads times `share`, and what is
        observed. Both come from one integration; what is not used is not computed. In place of the pressure there may
        be what the scene's `driven` and its `LoadPath.drive_at` give."""

    def observe(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[1]

    def evaluated(self, unknowns, pressure):
        return _residual_and_observables(self, unknowns, jnp.ones_like(pressure), self.driven(pressure))

    def found_directly(self, pressure: Scalar) -> tuple[Vector, Bool[Array, ""] | bool]:
        """(unknowns at a pressure, True) where they can be found without the way there, as the state that is connected
        to zero load; (anything, False) where the path is to be followed."""
        return self.unloaded_state(), False

    def driven(self, pressure: Scalar) -> Any:
        """What `residual_and_observables` is given of a pressure, as `LoadPath.drive_at` gives it on the way."""
        return pressure

    @abc.abstractmethod
    def pressure_span(self) -> LoadPath:
        """The range of pressures in which the actuator acts."""

    def unknown_shape(self):
        return jax.eval_shape(self.unloaded_state).shape

    def passed(self, observed: dict[str, Array]) -> Scalar | None:
        """How far a state is beyond what the model covers, rising through zero where that ends (`Reason.CURLED_UP`):
        the equations go on behind it. None where there is no such end."""
        return None

    def spent(self, unknowns: Vector, pressure: Scalar) -> dict[Reason, Scalar]:
        """What a state uses of the most that its parts can hold, less 1: the equations have no value above zero."""
        return {}

    def is_unloaded(self) -> Array:
        """True where `rest` already solves the scene at no pressure: there are no external loads."""
        return jnp.asarray(False)

    def residual(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[0]

    def _start(self, span: LoadPath) -> Vector:
        return jnp.append(self.unloaded_state(), jnp.zeros_like(span.loading))

    def _begun(self, u: Vector, span: LoadPath, most: Scalar | float = jnp.inf, by: Scalar | float = 1.0) -> Vector:
        """A little further where the pressure begins to act, at most to a place: the path's direction shows there.
        by: part of the usual way."""
        further = jnp.minimum(span.loading + BEGINNING * by, most)
        return u.at[-1].set(jnp.where(u[-1] >= span.loading, further, u[-1]))

    def _search(
        self,
        start: Vector,
        goal: Goal,
        context: Any,
        span: LoadPath,
        steps: Steps | None = None,
        is_there: Bool[Array, ""] | bool = False,
    ) -> Search:
        """Where goal(context, ...) rises through zero along the path from `start`; `start` itself where `is_there`."""

        def equations(u, args):
            scene, context, span = args
            residual, observed = _residual_and_observables(scene, u[:-1], span.share_at(u), span.drive_at(u))
            passed, wanted = scene.passed(observed), goal(context, u, observed)
            return residual, wanted if passed is None else larger(wanted, passed)

        # Where the pressure alone acts the path is nearly straight.
        by = steps or Steps()
        first = jnp.where(start[-1] >= span.loading, by.largest, by.first)
        end = follow(equations, start, (self.searched(), context, span), first, by, is_there)
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
        beyond = self._beyond_the_model(end, goal, context, span)
        status = jnp.where(beyond > 0, Status.BEYOND_LIMIT, status)
        why = Reason.LOADS_AND_PRESSURE_NOT_HELD if together else Reason.LOAD_NOT_HELD
        reason = jnp.where(folded, int(Reason.LIMIT_POINT), jnp.where(not_held, int(why), beyond))
        detail = jnp.where(not_held, span.share_at(end.u), jnp.nan)
        at_end = folded | (beyond > 0)
        detail = jnp.where(at_end, span.pressure_at(end.u, at_end), detail)
        possible = self.can_exist()
        status, reason = jnp.where(possible, status, Status.IMPOSSIBLE), jnp.where(possible, reason, 0)
        return Search(end.u, status, end.iterations, reason, jnp.where(possible, detail, jnp.nan))

    def _beyond_the_model(self, end: End, goal: Goal, context: Any, span: LoadPath) -> Int[Array, ""]:
        """The `Reason` for which the model ends where a search did, before its goal; 0 where it does not."""
        reason = jnp.zeros_like(end.reason)
        behind = end.u[-1] > span.loading
        if type(self).passed is not PathScene.passed:
            observed = _residual_and_observables(
                self.searched(), end.u[:-1], span.share_at(end.u), span.drive_at(end.u)
            )[1]
            passed = self.passed(observed)
            if passed is not None:
                curled = behind & (end.reason == REACHED) & (passed > goal(context, end.u, observed))
                reason = jnp.where(curled, int(Reason.CURLED_UP), reason)
        for why, share in self.spent(end.u[:-1], span.pressure_at(end.u, end.reason == ENDED)).items():
            reason = jnp.where(behind & (end.reason == ENDED) & (share > -AT_THE_EDGE), int(why), reason)
        return reason

    def find(self, pressure):
        return self.find_along(pressure)

    def find_along(self, pressure: Scalar, steps: Steps | None = None) -> Found:
        """`find` by steps of a certain length."""
        span = self.pressure_span()
        if self.loading == "proportional":
            ray = proportional(span, jnp.minimum(pressure, span.end))
            found, beyond = self._search(self._start(span), _to_place, ray.loading, ray, steps), pressure > span.end
        else:
            wanted = span.place_of(pressure)
            reachable = jnp.minimum(wanted, span.last())
            start = self._begun(self._start(span), span, reachable)
            unknowns, is_found = self.found_directly(span.pressure_at(start.at[-1].set(reachable)))
            start = jnp.where(is_found, jnp.append(unknowns, reachable), start)
            found, beyond = self._search(start, _to_place, reachable, span, steps, is_found), wanted > reachable
        ended = (found.status == Status.OK) & beyond
        status = jnp.where(ended, Status.BEYOND_LIMIT, found.status)
        reason = jnp.where(ended, int(self.end_reason()), found.reason)
        detail = jnp.where(ended, span.end, found.detail)
        unknowns, taken = found.u[:-1], found.iterations
        return asked_for(pressure, Found(unknowns, pressure, status, taken, reason=reason, detail=detail))

    def onset(self):
        return self.pressure_span().begin

    def find_limit(self):
        """As `Found`; its reason says which end it is, and is none for the end of the actuator's own model."""
        span = self.pressure_span()
        start, way, last, before = self._begun(self._start(span), span), span, span.last(), None
        if self.loading == "proportional":
            ray, moderate = _to_moderate(span)
            before = self._search(self._start(span), _to_place, ray.loading, ray)
            start, way, last = before.u.at[-1].set(0.0), onwards(ray, moderate), (span.end - moderate) / span.step
        u, status, steps, reason, detail = self._search(start, _to_place, last, way)
        if before is not None:
            status = jnp.where(before.status == Status.OK, status, Status.IMPOSSIBLE)
        early = status == Status.BEYOND_LIMIT
        pressure = jnp.where(early, detail, span.end)
        status, reason = jnp.where(early, Status.OK, status), jnp.where(early, reason, 0)
        return Found(u[:-1], pressure, status, steps, reason=reason)

    def limit_pressure_from(self, found):
        scale = frozen(self).pressure_span().step
        ok = found.status == Status.OK
        scene = stop_gradient_where_failed(ok, self)

        def equations(u, args):
            scene, scale = args
            return scene.residual(u[:-1], u[-1] * scale)

        u = jnp.append(found.unknowns, found.pressure / scale)
        limit = jnp.where(
            found.reason == Reason.LIMIT_POINT,
            fold_load(equations, u, (scene, scale)) * scale,
            scene.pressure_span().end,
        )
        return jnp.where(ok, scene._where_the_model_ends(limit, u, scale, found.reason), jnp.nan)

    def _where_the_model_ends(self, limit: Scalar, u: Vector, scale: Scalar, reason: Int[Array, ""]) -> Scalar:
        """The pressure (Pa) at which a state reaches an end of the model, with its derivatives, from close to there;
        `limit` where the branch ends for another reason. scale: what u[-1] = 1 is in Pa."""
        ends = self._ends(u[:-1], u[-1] * scale)
        for why in ends:
            here = reason == why

            def equations(u, args, why=why):
                scene, scale, start, here = args
                pressure = u[-1] * scale
                own = scene.residual(u[:-1], pressure)
                # Elsewhere the equations may have no solution, or none with derivatives.
                return jnp.where(here, jnp.append(own, scene._ends(u[:-1], pressure)[why]), u - start)

            args = (stop_gradient_where_failed(here, self), scale, u, here)
            moving = implicit(equations, u, args)
            fixed, start = frozen((args, u))
            jacobian = jax.jacfwd(equations)(start, fixed)
            closer = (start - solve_small(jacobian, equations(start, fixed)))[-1]
            limit = jnp.where(here, (moving[-1] + lax.stop_gradient(closer - moving[-1])) * scale, limit)
        return limit

    def _ends(self, unknowns: Vector, pressure: Scalar) -> dict[Reason, Scalar]:
        """Numbers that rise through zero where the model ends."""
        ends = self.spent(unknowns, pressure)
        if type(self).passed is not PathScene.passed:
            passed = self.passed(self.evaluated(unknowns, pressure)[1])
            ends |= {} if passed is None else {Reason.CURLED_UP: passed}
        return ends

    def solve_for(self, name, target):
        point, found = self._sought(name, target, self.verified)
        solution = self._report(point[:-1], point[-1], found)
        no_answer = jnp.where(found.reason == Reason.VALUE_PASSED, found.pressure, jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, solution.pressure, no_answer))

    def _sought(self, name: str, target: Scalar, verified: Callable[[Found], Found]) -> tuple[Vector, Found]:
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
            evaluated=jax.tree.map(lambda v: v[1], seen),
            reason=jnp.where(meant, reason, int(Reason.PRESSURE_RULE)),
            detail=jnp.where(meant, jnp.where(held, detail, loaded.detail), jnp.nan),
        )
        found, step = verified(found), span.step
        scene, target = stop_gradient_where_failed(found.status == Status.OK, (self, target))

        def equations(point, args):
            scene, target, step = args
            residual, observed = scene.evaluated(point[:-1], point[-1] * step)
            return jnp.append(residual, _Surplus(name)(target, point, observed))

        point = implicit(equations, jnp.append(found.unknowns, pressure / step), (scene, target, step))
        return point.at[-1].multiply(step), found

    def _legs(self, surplus: Goal, value: Scalar, span: LoadPath) -> tuple[tuple[Search, Search], Float[Array, " 2"]]:
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
            u = jnp.where(is_loading, loaded, self._begun(loaded, span, by=by))
            is_there = again & (before.status != Status.NOT_CONVERGED)
            found = self._search(u, goal, (is_loading, value, span.loading), span, is_there=is_there)
            found = select(is_there, before, found)
            u = found.u.at[-1].set(jnp.where(is_loading, span.loading, found.u[-1]))
            found = found._replace(u=u)
            return (jnp.where(is_loading, u, loaded), found), (found, span.pressure_at(u))

        start = self._start(span)
        none = Search(start, jnp.asarray(Status.OK), jnp.asarray(0), jnp.asarray(0), jnp.full_like(value, jnp.nan))
        _, (legs, pressures) = lax.scan(leg, (start, none), jnp.arange(3))
        loaded, reached = (jax.tree.map(lambda v, k=k: v[k], legs) for k in (0, 2))
        return (loaded, reached), pressures[jnp.array([0, 2])]

    def _legs_together(self, surplus: Goal, value: Scalar, span: LoadPath):
        """As `_legs`: first to a moderate pressure and all of the loads at once, then with the loads to the target,
        at a higher or a lower pressure. What is not found down to no pressure ends there."""
        ray, moderate = _to_moderate(span)

        def goal(context, u, observed):
            is_loading, value, loading, down, last = context
            over = surplus(value, u, observed)
            over = jnp.where(down, larger(-over, u[-1] - last), over)
            return jnp.where(is_loading, u[-1] - loading, over)

        def leg(u, is_loading):
            """One program for both."""
            observed = _residual_and_observables(self, u[:-1], jnp.ones_like(moderate), moderate)[1]
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
            return _residual_and_observables(self.searched(), u[:-1], jnp.ones_like(u[-1]), span.drive_at(u))[0]

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
            return self._report(u[:-1], pressure, self.verified(Found(u[:-1], pressure, state, jnp.asarray(0))))

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
        return surplus_over(self.name, target, observed)


def surplus_over(name: str, target: Scalar, observed: dict[str, Array]) -> Scalar:
    """An observable less its target, over the target (in SI where that is zero)."""
    size = jnp.abs(lax.stop_gradient(target))
    return (observed[name] - target) / jnp.where(size > 0, jnp.maximum(size, 1e-12), 1.0)


def _to_moderate(span: LoadPath) -> tuple[Ray, Scalar]:
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
def _residual_and_observables(
    scene: PathScene, unknowns: Vector, share: Scalar, pressure: Any
) -> tuple[Vector, dict[str, Array]]:
    """`scene.residual_and_observables`, traced once for all that asks for it."""
    return scene.residual_and_observables(unknowns, share, pressure)


def residual_at(scene: PathScene, unknowns: Vector, share: Scalar, drive: Any) -> Vector:
    """The equations alone at a share of the loads and what drives the chambers there."""
    return _residual_and_observables(scene, unknowns, share, drive)[0]


def _to_place(place: Scalar, u: Vector, _: dict[str, Array]) -> Scalar:
    """The goal of a search for a place on the path."""
    return u[-1] - place


MUCH_CLOSER = 1e-4
"""Of `BEGINNING`: a second try to find a value begins so close to where the pressure begins to act."""
AT_THE_EDGE = 1e-5
"""A path that ends is at the edge of the model where no more than this part is left of what a part can hold: its last
steps are SMALLEST_STEP, 1e-7, long."""
BRANCH_LENGTH = 50.0
"""Arc length of a drawn branch in scaled units at most: through the fold and down to where the finger curls up."""
BRANCH_POINTS = 100
"""At least as many are needed to see where a branch turns and ends."""
