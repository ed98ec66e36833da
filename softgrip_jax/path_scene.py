"""Scenes with several unknowns: every question follows the branch from zero load by arc length.

The path has one parameter: first the external loads grow from nothing to their full size, then the pressure grows from
the value at which it begins to act. What is found is therefore on the branch connected to zero load, never a loop.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from .numerics.paths import FIRST_STEP, FOLD, LARGEST_STEP, REACHED, fold_load, follow, trace
from .numerics.roots import implicit
from .results import Status, gate
from .scene import FALLEN, Found, Scene, frozen

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
Goal = Callable[[Any, Vector, dict[str, Array]], Scalar]
"""(what it needs, point u, what is observed there) -> a number that rises through zero where a search ends."""


LATER = 2.0
"""Where the moment of type A and C begins to grow with x rather than with its square: 2.3 and 1.9."""
BEGINNING = 1e-3
"""Of the way under pressure, where it begins to be followed."""


class Span(eqx.Module):
    """Pressures, Pa, and their places on the path, which begins with the external loads."""

    loading: Scalar
    """Where the loads have arrived and the pressure begins to act: 1, more for loads that are large, 0 without any."""
    begin: Scalar
    step: Scalar
    """A typical change of pressure: the unit along the path."""
    end: Scalar
    """Where the actuator's own model ends."""
    early: Scalar
    """How fast the way goes at first: the place is x (x + early) / (x + LATER) at begin + step x. What chambers do
    grows with the square of x before it grows with x, and so does the place where this is small; at LATER it is x."""

    def place_of(self, pressure: Scalar) -> Scalar:
        """The last entry of u at a pressure."""
        x = jnp.maximum(pressure - self.begin, 0) / self.step
        return self.loading + x * (x + self.early) / (x + LATER)

    def last(self) -> Scalar:
        """The place of `end`."""
        return self.place_of(self.end)

    def pressure_at(self, u: Vector) -> Scalar:
        """The pressure at a point of the path."""
        place = jnp.maximum(u[-1] - self.loading, 0)
        half = 0.5 * (place - self.early)
        return self.begin + self.step * (half + jnp.sqrt(half * half + LATER * place))

    def drive_at(self, u: Vector) -> Any:
        """What `measured` needs to know of the pressure there."""
        return self.pressure_at(u)

    def share_at(self, u: Vector) -> Scalar:
        """The share of the loads there: they arrive with zero slope, no kink for the tangent."""
        arrived = jnp.where(self.loading > 0, u[-1] / jnp.where(self.loading > 0, self.loading, 1), 1)
        return 1 - (1 - jnp.minimum(arrived, 1)) ** 2


class PathScene(Scene):
    """A scene that solves `measured(unknowns, share, pressure)[0] = 0`; share in [0, 1] scales its external loads."""

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

    def _search(self, start: Vector, goal: Goal, context: Any, span: Span) -> tuple[Vector, Array, Array]:
        """(point u, status, iterations) where goal(context, ...) rises through zero along the path from `start`."""

        def equations(u, args):
            scene, context, span = args
            residual, observed = _measured(scene, u[:-1], span.share_at(u), span.drive_at(u))
            return residual, goal(context, u, observed)

        # Where the pressure alone acts the path is nearly straight.
        first = jnp.where(start[-1] >= span.loading, LARGEST_STEP, FIRST_STEP)
        end = follow(equations, start, (self, context, span), first)
        status = jnp.where(end.reason == REACHED, Status.OK, Status.NOT_CONVERGED)
        status = jnp.where(end.reason == FOLD, Status.BEYOND_LIMIT, status)
        # A fold before the pressure acts: the other loads alone have no equilibrium.
        is_loading = end.u[-1] <= span.loading
        status = jnp.where((status == Status.BEYOND_LIMIT) & is_loading, Status.IMPOSSIBLE, status)
        possible = self.can_exist()
        return end.u, jnp.where(possible, status, Status.IMPOSSIBLE), end.iterations

    def find(self, pressure):
        span = self.pressure_span()
        wanted = span.place_of(pressure)
        reachable = jnp.minimum(wanted, span.last())
        u, status, steps = self._search(self._begun(self._start(span), span, reachable), _to_place, reachable, span)
        status = jnp.where((status == Status.OK) & (wanted > reachable), Status.BEYOND_LIMIT, status)
        possible = (pressure >= 0) & (pressure < jnp.inf)
        return Found(u[:-1], pressure, jnp.where(possible, status, Status.IMPOSSIBLE), steps)

    def onset(self):
        return self.pressure_span().begin

    def find_limit(self):
        """As `Found`; `iterations` says which end it is: 1 a fold, 0 the end of the actuator's model."""
        span = self.pressure_span()
        u, status, _ = self._search(self._begun(self._start(span), span), _to_place, span.last(), span)
        at_fold = status == Status.BEYOND_LIMIT
        pressure = jnp.where(at_fold, span.pressure_at(u), span.end)
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
        fixed, value = frozen((self, target))
        span = fixed.pressure_span()

        def surplus(target, _, observed):
            return (observed[name] - target) / jnp.maximum(jnp.abs(lax.stop_gradient(target)), 1e-12)

        def walk(u, is_loading):
            """First to where the pressure begins to act, then to the target: one program for both."""

            def goal(context, u, observed):
                is_loading, value, loading = context
                return jnp.where(is_loading, u[-1] - loading, surplus(value, u, observed))

            u = jnp.where(is_loading, u, fixed._begun(u, span))
            u, *found = fixed._search(u, goal, (is_loading, value, span.loading), span)
            return u.at[-1].set(jnp.where(is_loading, span.loading, u[-1])), (u, *found)

        u, (points, statuses, counts) = lax.scan(walk, fixed._start(span), jnp.array([True, False]))
        seen = lax.map(lambda u: fixed.evaluated(u[:-1], span.pressure_at(u)), points.at[1].set(u))
        over = jax.vmap(partial(surplus, value, u))(seen[1])
        reached = jnp.where(over[0] >= 0, Status.NO_CONTACT, statuses[1])
        status = jnp.where(statuses[0] == Status.OK, reached, statuses[0])
        pressure = span.pressure_at(u)
        status = jnp.where((status == Status.OK) & (pressure > span.end), Status.BEYOND_LIMIT, status)
        status = jnp.where(jnp.isfinite(value), status, Status.IMPOSSIBLE)
        mismatch = jnp.where(status == Status.OK, over[1], 0.0)
        there = jax.tree.map(lambda v: v[1], seen)
        found = fixed.settled(Found(u[:-1], pressure, status, jnp.sum(counts), mismatch, seen=there))
        step, status = span.step, found.status

        scene, target = gate(status == Status.OK, (self, target))

        def equations(point, args):
            scene, target, step = args
            p = point[-1] * step
            residual, observed = scene.evaluated(point[:-1], p)
            return jnp.append(residual, surplus(target, point, observed))

        point = implicit(equations, jnp.append(found.unknowns, pressure / step), (scene, target, step))
        solution = self._report(point[:-1], point[-1] * step, found)
        no_answer = jnp.where(status == Status.NO_CONTACT, span.begin, jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, solution.pressure, no_answer))

    def branch(self, n):
        """n points at equal arc lengths from (next to) the first effect of pressure, through the limit point.

        The path is followed twice: to see where it turns and where it is to end, and once more with the limit point on
        one of the points.
        """
        span = self.pressure_span()
        loaded, status, _ = self._search(self._start(span), _to_place, span.loading, span)
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
