"""Scenes with one unknown: the pressure is an explicit function of an angle, so every question is a scalar root."""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from .numerics.curves import Scan, first_crossing, first_maximum, scan_curve, slope_of
from .numerics.roots import implicit
from .results import Status, gate
from .scene import FALLEN, WITHOUT_LIMIT, Found, Scene, frozen

Scalar = Float[Array, ""]


BRANCH_CELLS = 512
"""The end of a drawn branch is one of as many places, and with them right to a line's width."""
BEFORE_END = 1e-6
"""The end of the interval itself may be singular (a flat membrane turned inside out): a branch stops so much before."""


class Climb(NamedTuple):
    """A scene's load curve as it was sampled, values only."""

    scan: Scan
    end: Scalar
    """The angle where the interval ends."""
    possible: Bool[Array, ""]


class CurveScene(Scene):
    """A scene whose pressure is an explicit function of one angle: every question is one scalar root.

    An author gives `interval`, `load` and `observe`. The pressure rises with the angle up to the first limit point,
    or to the end of the interval: that is where equilibrium under pressure control ends.
    """

    CONTACT: ClassVar[bool] = True
    """Whether the angle starts where something is first touched (a lower pressure is then NO_CONTACT)."""

    @abc.abstractmethod
    def interval(self) -> tuple[Scalar, Scalar]:
        """The angles where the state begins and where its model ends, with their derivatives."""

    @abc.abstractmethod
    def load(self, angle: Scalar) -> Scalar:
        """The pressure that holds the scene at this angle, Pa."""

    @abc.abstractmethod
    def pressure_scale(self) -> Scalar:
        """A pressure typical of the design, Pa: makes the residual a pure number."""

    def unbounded(self) -> Bool[Array, ""]:
        """True where the load grows without bound towards the end of the interval: there is then no limit."""
        return jnp.asarray(False)

    def may_dip(self) -> bool:
        """Whether the load may fall and rise again. A neo-Hookean membrane's has one maximum at most."""
        return True

    def residual(self, unknowns, pressure):
        return (self.load(unknowns) - pressure) / (self.pressure_scale() + jnp.abs(pressure))

    def climb(self) -> Climb:
        """Look at the load curve once; every question starts from this."""
        start, end = self.interval()
        scan = scan_curve(self.load, start, end, "dips" if self.may_dip() else "single")
        return Climb(scan, end, self.can_exist() & (start < end))

    def stop(self, climb: Climb, wanted: Bool[Array, ""] | bool = True) -> Scalar:
        """The angle where the rising part of the load ends: its first maximum, or the end of the interval.

        Where it is not `wanted` a place before the maximum does, which costs nothing.
        """
        scan = climb.scan
        wanted = wanted & scan.falls
        peak = first_maximum(self.load, scan, wanted)
        return jnp.where(wanted, peak, jnp.where(scan.falls, scan.x[scan.sure], climb.end))

    def find(self, pressure):
        climb = self.climb()
        scan, possible = climb.scan, climb.possible
        start, low = scan.x[0], scan.y[0]
        stop = self.stop(climb, ~(scan.y[scan.sure] > pressure))
        crossing = first_crossing(self.load, pressure, scan.x, scan.y, stop)
        status = jnp.where(crossing.exists, Status.OK, Status.BEYOND_LIMIT)
        status = jnp.where(pressure <= low, Status.NO_CONTACT if self.CONTACT else Status.OK, status)
        angle = jnp.where(pressure <= low, start, crossing.x)
        possible &= (pressure >= 0) & (pressure < jnp.inf)
        return Found(angle, pressure, jnp.where(possible, status, Status.IMPOSSIBLE), crossing.iterations)

    def onset(self):
        return self.load(self.interval()[0])

    def find_limit(self):
        climb = self.climb()
        scan, stop, possible = climb.scan, self.stop(climb), climb.possible
        endless = self.unbounded() & ~scan.falls
        pressure = jnp.where(endless, jnp.inf, self.load(stop))
        status = jnp.where(possible, Status.OK, Status.IMPOSSIBLE)
        return Found(stop, pressure, status, scan.falls.astype(int))

    def limit_pressure_from(self, found):
        at_peak = found.iterations == 1
        ok = (found.status == Status.OK) & jnp.isfinite(found.pressure)
        scene = gate(ok, self)
        peak = implicit(lambda angle, scene: slope_of(scene.load)(angle), found.unknowns, scene)
        pressure = scene.load(jnp.where(at_peak, peak, scene.interval()[1]))
        return jnp.where(ok, pressure, jnp.where(found.status == Status.OK, jnp.inf, jnp.nan))

    def solve_for(self, name, target):
        fixed, value = frozen((self, target))

        def wanted(scene, angle):
            return scene.observe(angle, scene.load(angle))[name]

        climb = fixed.climb()
        scan, stop, possible = climb.scan, fixed.stop(climb), climb.possible
        start = scan.x[0]
        seen = jax.vmap(lambda angle: wanted(fixed, angle))(scan.x)
        crossing = first_crossing(lambda angle: wanted(fixed, angle), value, scan.x, seen, stop)
        at_start = value == seen[0]
        angle = jnp.where(at_start, start, crossing.x)
        # A value on the far side of the one at the start, seen from where the curve goes, belongs to no state of it.
        before = (value - seen[0]) * (wanted(fixed, stop) - seen[0]) <= 0
        status = jnp.where(before, Status.NO_CONTACT if self.CONTACT else Status.IMPOSSIBLE, Status.BEYOND_LIMIT)
        reached = crossing.exists & ~at_start if self.CONTACT else crossing.exists | at_start
        status = jnp.where(reached, Status.OK, status)
        status = jnp.where(possible & jnp.isfinite(value), status, Status.IMPOSSIBLE)

        # Rounding of the observable is relative to its change over a cell, where the value itself may be zero.
        scale = lax.stop_gradient(jnp.abs(value) + crossing.scale)
        mismatch = (wanted(fixed, angle) - value) / jnp.where(scale > 0, scale, 1.0)
        found = fixed.settled(Found(angle, fixed.load(angle), status, crossing.iterations, mismatch))
        scene, target = gate(found.status == Status.OK, (self, target))
        angle = implicit(lambda x, args: wanted(args[0], x) - args[1], angle, (scene, target))
        pressure = scene.load(angle)
        solution = self._report(angle, pressure, found)
        no_answer = jnp.where(status == Status.NO_CONTACT, scan.y[0], jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, pressure, no_answer))

    def largest_angle(self) -> Scalar:
        """The angle at which the scene is as large as anybody would draw it; the end of the interval may come first."""
        return jnp.full_like(self.interval()[1], jnp.inf)

    def branch_end(self, climb: Climb, stop: Scalar) -> Scalar:
        """The angle where a drawn branch ends, see `sg.branch`; values only. stop: where the pressure is the limit."""
        scan, first = climb.scan, climb.scan.x[0]
        latest = jnp.minimum(first + (1 - BEFORE_END) * (climb.end - first), self.largest_angle())

        def before(wanted, begin):
            """The last of the angles from `begin` to `latest` in front of the first whose load is `wanted`."""
            angles = begin + jnp.maximum(latest - begin, 0) * jnp.linspace(0.0, 1.0, BRANCH_CELLS + 1)
            is_wanted = wanted(jax.vmap(self.load)(angles))
            place = jnp.where(jnp.any(is_wanted), jnp.argmax(is_wanted) - 1, BRANCH_CELLS)
            return angles[jnp.maximum(place, 0)]

        limit = self.load(stop)

        def is_over(loads):
            fell = jnp.cumsum(loads < limit) > 0
            return ~jnp.isfinite(loads) | (loads < FALLEN * limit) | (fell & (loads > limit))

        most = WITHOUT_LIMIT * self.pressure_scale()
        endless = before(lambda loads: ~(loads <= most), first)
        end = jnp.where(self.unbounded(), jnp.minimum(endless, latest), latest)
        return jnp.where(scan.falls, before(is_over, stop), end)

    def branch(self, n):
        fixed = frozen(self)
        climb = fixed.climb()
        stop = fixed.stop(climb)
        start = self.interval()[0]
        angles = start + (fixed.branch_end(climb, stop) - start) * jnp.linspace(0.0, 1.0, n)
        # The limit is one of the points, where the branch goes through it.
        nearest = jnp.argmin(jnp.abs(angles - stop))
        angles = jnp.where(climb.scan.falls & (jnp.arange(n) == nearest), stop, angles)

        def at(angle):
            pressure = self.load(angle)
            status = jnp.where(jnp.isfinite(pressure), Status.OK, Status.BEYOND_LIMIT)
            status = jnp.where(climb.possible, status, Status.IMPOSSIBLE)
            return self._report(angle, pressure, self.settled(Found(angle, pressure, status, jnp.asarray(0))))

        return jax.vmap(at)(angles)
