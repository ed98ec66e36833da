"""Scenes with several unknowns: every question follows the branch from zero load by arc length.

The path has one parameter: first the external loads grow from nothing to their full size, then the pressure grows from
the value at which it begins to act. What is found is therefore on the branch connected to zero load, never a loop.
"""

from __future__ import annotations

import abc

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .checked import admissible
from .numerics.paths import FOLD, REACHED, fold_border, fold_value, follow, trace
from .numerics.roots import implicit
from .results import Solution, Status, gate
from .scene import Found, Scene, frozen

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]


class PathScene(Scene):
    """A scene that solves `ramped(unknowns, share, pressure) = 0`; share in [0, 1] scales its external loads."""

    @abc.abstractmethod
    def rest(self) -> Vector:
        """The unknowns without any load: an exact solution at share 0 and no pressure."""

    @abc.abstractmethod
    def ramped(self, unknowns: Vector, share: Scalar, pressure: Scalar) -> Vector:
        """The scaled equations with the external loads times `share`; entries and unknowns of order one."""

    @abc.abstractmethod
    def pressure_span(self) -> tuple[Scalar, Scalar, Scalar]:
        """Pressures (Pa): where pressure begins to act, a typical step, and where the actuator's model ends."""

    def is_unloaded(self) -> Array:
        """True where `rest` already solves the scene at no pressure: there are no external loads."""
        return jnp.asarray(False)

    def residual(self, unknowns, pressure):
        return self.ramped(unknowns, jnp.ones_like(pressure), pressure)

    def pressure_at(self, u: Vector) -> Scalar:
        """The pressure at a point of the path."""
        begin, step, _ = self.pressure_span()
        return begin + step * jnp.maximum(u[-1] - 1, 0)

    def _along(self, u: Vector) -> Vector:
        # The loads arrive with zero slope at u[-1] = 1, where the pressure takes over: no kink for the tangent.
        share = 1 - (1 - jnp.minimum(u[-1], 1)) ** 2
        return self.ramped(u[:-1], share, self.pressure_at(u))

    def _start(self) -> Vector:
        return jnp.append(self.rest(), jnp.where(self.is_unloaded(), 1.0, 0.0))

    def _search(self, start, goal):
        """(point u, status, steps) where `goal` rises through zero."""
        end = follow(self._along, start, goal)
        status = jnp.where(end.reason == REACHED, Status.OK, Status.NOT_CONVERGED)
        status = jnp.where(end.reason == FOLD, Status.BEYOND_LIMIT, status)
        # A fold before the pressure acts: the other loads alone have no equilibrium.
        status = jnp.where((status == Status.BEYOND_LIMIT) & (end.point.u[-1] <= 1), Status.IMPOSSIBLE, status)
        possible = admissible(self) & self.is_possible()
        return end.point.u, jnp.where(possible, status, Status.IMPOSSIBLE), end.steps

    def find(self, pressure):
        begin, step, end = self.pressure_span()
        wanted = 1 + jnp.maximum(pressure - begin, 0) / step
        reachable = 1 + jnp.maximum(jnp.minimum(pressure, end) - begin, 0) / step
        u, status, steps = self._search(self._start(), lambda u: u[-1] - reachable)
        status = jnp.where((status == Status.OK) & (wanted > reachable), Status.BEYOND_LIMIT, status)
        possible = (pressure >= 0) & (pressure < jnp.inf)
        return Found(u[:-1], pressure, jnp.where(possible, status, Status.IMPOSSIBLE), steps)

    def find_limit(self):
        """As `Found`; `iterations` says which end it is: 1 a fold, 0 the end of the actuator's model."""
        begin, step, end = self.pressure_span()
        u, status, _ = self._search(self._start(), lambda u: u[-1] - (1 + (end - begin) / step))
        at_fold = status == Status.BEYOND_LIMIT
        pressure = jnp.where(at_fold, self.pressure_at(u), end)
        return Found(u[:-1], pressure, jnp.where(at_fold, Status.OK, status), at_fold.astype(int))

    def limit_pressure_from(self, found):
        scale = frozen(self).pressure_span()[1]
        ok = found.status == Status.OK
        scene = gate(ok, self)

        def equations(scene, scale):
            return lambda u: scene.residual(u[:-1], u[-1] * scale)

        point = jnp.append(found.unknowns, found.pressure / scale)
        border = fold_border(equations(frozen(self), scale), point)

        def at_fold(u, args):
            scene, scale, border = args
            there = equations(scene, scale)
            return jnp.append(there(u), fold_value(there, u, border))

        fold = implicit(at_fold, point, (scene, scale, border))[-1] * scale
        end = scene.pressure_span()[2]
        return jnp.where(ok, jnp.where(found.iterations == 1, fold, end), jnp.nan)

    def solve_for(self, name, target):
        fixed, value = frozen((self, target))
        begin, step, _ = fixed.pressure_span()

        def surplus(scene, target, unknowns, pressure):
            return (scene.observe(unknowns, pressure)[name] - target) / jnp.maximum(
                jnp.abs(lax.stop_gradient(target)), 1e-12
            )

        loaded, status, steps = fixed._search(fixed._start(), lambda u: u[-1] - 1)
        ready = surplus(fixed, value, loaded[:-1], begin)
        u, reached, more = fixed._search(
            loaded.at[-1].set(1.0), lambda u: surplus(fixed, value, u[:-1], fixed.pressure_at(u))
        )
        status = jnp.where(status == Status.OK, jnp.where(ready >= 0, Status.NO_CONTACT, reached), status)
        pressure = fixed.pressure_at(u)
        status = jnp.where((status == Status.OK) & (pressure > fixed.pressure_span()[2]), Status.BEYOND_LIMIT, status)
        status = jnp.where(jnp.isfinite(value), status, Status.IMPOSSIBLE)
        found = Found(u[:-1], pressure, status, steps + more)

        scene, target = gate(status == Status.OK, (self, target))

        def equations(point, args):
            scene, target, step = args
            y, p = point[:-1], point[-1] * step
            return jnp.append(scene.residual(y, p), surplus(scene, target, y, p))

        point = implicit(equations, jnp.append(found.unknowns, pressure / step), (scene, target, step))
        solution = scene._report(point[:-1], point[-1] * step, found)
        no_answer = jnp.where(status == Status.NO_CONTACT, begin, jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, solution.pressure, no_answer))

    def branch(self, n):
        """n points at equal arc lengths from the first effect of pressure, through the limit point."""
        begin, step, _ = self.pressure_span()
        loaded, status, _ = self._search(self._start(), lambda u: u[-1] - 1)
        points, trusted = trace(self._along, loaded.at[-1].set(1.0), BRANCH_LENGTH / n, n)

        def report(u, trusted):
            state = jnp.where(trusted & (status == Status.OK) & (u[-1] >= 1), Status.OK, Status.NOT_CONVERGED)
            return self._report(u[:-1], self.pressure_at(u), Found(u[:-1], self.pressure_at(u), state, jnp.asarray(0)))

        return jax.vmap(report)(points, trusted)


BRANCH_LENGTH = 12.0
"""Arc length of a drawn branch in scaled units: through the fold and down to where the finger curls up."""

