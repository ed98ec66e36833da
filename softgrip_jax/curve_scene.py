"""Scenes with one unknown: the pressure is an explicit function of an angle, so every question is a scalar root."""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .numerics.curves import Scan, first_crossing, first_maximum, first_maximum_before, scan_curve, slope_of
from .numerics.implicit import implicit
from .numerics.xla import materialised
from .reasons import Reason
from .results import Status, stop_gradient_where_failed
from .scene import FALLEN, WITHOUT_LIMIT, Found, Scene, frozen

Scalar = Float[Array, ""]


BRANCH_CELLS = 512
"""The end of a drawn branch is one of as many places, and with them right to a line's width."""
DROP, FIRST = 1e-6, np.geomspace(1e-6, 1e-1, 16)
"""A load falls at first where, at these parts of the interval, it is lower by this part before it is as much higher: a
dip or a hump that is less lets the state snap by nothing that anybody could see."""
BEFORE_END = 1e-6
"""The end of the interval itself may be singular (a flat membrane turned inside out): a branch stops so much before."""


class Approach(NamedTuple):
    """The free state that grows from zero load until a scene's own state begins."""

    scene: CurveScene
    touch: Scalar
    """Its angle where it touches, with derivatives."""
    begins: Scalar
    """The pressure at which the scene's own state begins, with derivatives."""
    touches_early: bool = False
    """Whether the free state touches before the scene's own state begins (an inclined plane): it then is inflated
    freely up to there, and must have no limit point on that way either."""


class Climb(NamedTuple):
    """A scene's load curve as it was sampled, values only."""

    scan: Scan
    end: Scalar
    """The angle where the interval ends."""
    possible: Bool[Array, ""]
    touches: Bool[Array, ""]
    """Whether the free state comes to where the scene's own state begins without passing a limit point of its own."""
    free_peak: Scalar
    """The free state's angle at its first maximum, where it has one before it touches."""
    free_limit: Scalar
    """The largest pressure of the free state where it does not touch: inf where the material locks before."""
    drops: Bool[Array, ""]
    """Whether the load falls from the very beginning: the state then snaps where it begins, and no branch leads on."""


class End(NamedTuple):
    """Codes of what `find_limit` found, in `Found.end`."""

    MODEL: int = 0
    PEAK: int = 1
    FREE_PEAK: int = 2
    BEGINNING: int = 3


END = End()


class CurveScene(Scene):
    """A scene whose pressure is an explicit function of one angle: every question is one scalar root.

    An author gives `interval`, `load` and `observe`. The pressure rises with the angle up to the first limit point,
    or to the end of the interval: that is where equilibrium under pressure control ends.
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("ExplicitCurve", "Newton")
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

    def amplified(self, angle: Scalar) -> Scalar:
        """How many parts of rounding the load has for one in what it is made of, where that is many."""
        return jnp.zeros_like(angle)

    def may_dip(self) -> bool:
        """Whether the load may fall and rise again. A neo-Hookean membrane's has one maximum at most."""
        return True

    def residual(self, unknowns, pressure):
        return (self.load(unknowns) - pressure) / (self.pressure_scale() + jnp.abs(pressure))

    def approach(self) -> Approach | None:
        """The free state that leads from zero load to this one; None where this one begins at zero load."""
        return None

    def end_reason(self) -> Int[Array, ""] | int:
        """The `Reason` that belongs to the end of the interval."""
        return Reason.ARC_CLOSED

    def climb(self) -> Climb:
        """Look at the load curve once; every question starts from this."""
        start, end = self.interval()
        scan = scan_curve(self.load, start, end, "dips" if self.may_dip() else "single")
        touches, peak, limit = self._approached(start)
        possible = self.can_exist() & ((start < end) | ~touches)
        drops = jnp.asarray(False)
        if self.may_dip() and self.approach() is not None:
            change = jax.vmap(self.load)(start + (end - start) * FIRST) / scan.y[0] - 1
            rose = jnp.cumsum(change > DROP) > 0
            drops = touches & jnp.any((change < -DROP) & ~rose)
        return Climb(scan, end, possible, touches, peak, limit, drops)

    def _approached(self, start: Scalar) -> tuple[Bool[Array, ""], Scalar, Scalar]:
        """(touches, free_peak, free_limit) of `Climb`."""
        approach = self.approach()
        if approach is None:
            return jnp.asarray(True), start, jnp.full_like(start, jnp.inf)
        free = approach.scene
        begin, end = free.interval()
        far = end if approach.touches_early else jnp.minimum(approach.touch, end)
        peak, falls = first_maximum_before(free.load, begin, far, self.may_dip())
        limit = jnp.where(falls, free.load(peak), jnp.inf)
        if approach.touches_early:
            touches = (approach.touch <= jnp.where(falls, peak, end)) & (approach.begins <= limit)
        else:
            touches = ~falls & (approach.touch <= end)
        return materialised(touches.astype(peak.dtype)) > 0, peak, limit

    def stop(self, climb: Climb, wanted: Bool[Array, ""] | bool = True) -> Scalar:
        """The angle where the rising part of the load ends: its first maximum, or the end of the interval.

        Where it is not `wanted` a place before the maximum does, which costs nothing.
        """
        scan = climb.scan
        wanted = wanted & scan.falls
        peak = first_maximum(self.load, scan, wanted)
        stop = jnp.where(wanted, peak, jnp.where(scan.falls, scan.x[scan.sure], climb.end))
        return jnp.where(climb.drops, scan.x[0], stop)

    def find(self, pressure):
        climb = self.climb()
        scan, possible = climb.scan, climb.possible
        start, low = scan.x[0], scan.y[0]
        stop = self.stop(climb, ~(scan.y[scan.sure] > pressure))
        crossing = first_crossing(self.load, pressure, scan.x, scan.y, stop)
        status = jnp.where(crossing.exists, Status.OK, Status.BEYOND_LIMIT)
        status = jnp.where(pressure <= low, Status.NO_CONTACT if self.CONTACT else Status.OK, status)
        angle = jnp.where(pressure <= low, start, crossing.x)
        # A free state that does not touch is all there is.
        free = jnp.where(pressure <= climb.free_limit, Status.NO_CONTACT, Status.BEYOND_LIMIT)
        status = jnp.where(climb.touches, status, free)
        known = (pressure >= 0) & (pressure < jnp.inf)
        reason = jnp.where(possible & (status == Status.BEYOND_LIMIT), self._why(climb), Reason.NONE)
        reason = jnp.where(known, reason, Reason.PRESSURE_RULE)
        begins = jnp.where(climb.touches, low, climb.free_limit)
        ends = jnp.where(climb.touches, self.load(stop), climb.free_limit)
        detail = jnp.where(status == Status.BEYOND_LIMIT, ends, begins)
        detail = jnp.where(jnp.isfinite(detail) & known & (status != Status.OK) & possible, detail, jnp.nan)
        status = jnp.where(possible & known, status, Status.IMPOSSIBLE)
        # Near the angle where a material locks or an arc closes the load is so steep that no angle in floating point
        # meets a pressure more closely.
        rounding = crossing.swing / (self.pressure_scale() + jnp.abs(pressure)) + self.amplified(angle)
        return Found(angle, pressure, status, crossing.iterations, rounding=rounding, reason=reason, detail=detail)

    def _why(self, climb: Climb) -> Int[Array, ""]:
        """The reason where the branch ends."""
        own = jnp.where(climb.scan.falls | climb.drops, Reason.LIMIT_POINT, self.end_reason())
        return jnp.where(climb.touches, own, Reason.LIMIT_BEFORE_CONTACT)

    def onset(self):
        approach = self.approach()
        if approach is None:
            return self.load(self.interval()[0])
        touches, peak, limit = frozen(frozen(self)._approached(approach.touch))
        own = stop_gradient_where_failed(touches, self).approach()
        free = stop_gradient_where_failed(~touches & jnp.isfinite(limit), approach.scene)
        limit = jnp.where(jnp.isfinite(limit), free.load(_at_peak(free, peak)), jnp.inf)
        return jnp.where(touches, own.begins, limit)

    def find_limit(self):
        climb = self.climb()
        scan, stop, possible = climb.scan, self.stop(climb), climb.possible
        endless = self.unbounded() & ~scan.falls & ~climb.drops
        pressure = jnp.where(endless, jnp.inf, self.load(stop))
        pressure = jnp.where(climb.touches, pressure, climb.free_limit)
        status = jnp.where(possible, Status.OK, Status.IMPOSSIBLE)
        own = jnp.where(climb.drops, END.BEGINNING, jnp.where(scan.falls, END.PEAK, END.MODEL))
        code = jnp.where(climb.touches, own, END.FREE_PEAK)
        return Found(jnp.where(climb.touches, stop, climb.free_peak), pressure, status, jnp.asarray(0), end=code)

    def limit_pressure_from(self, found):
        ok = (found.status == Status.OK) & jnp.isfinite(found.pressure)
        code = found.end
        scene = stop_gradient_where_failed(ok & (code != END.FREE_PEAK), self)
        start, end = scene.interval()
        border = jnp.where(ok, jnp.where(code == END.BEGINNING, start, end), 1.0)
        pressure = scene.load(jnp.where(code == END.PEAK, _at_peak(scene, found.unknowns), border))
        approach = self.approach()
        if approach is not None:
            free = stop_gradient_where_failed(ok & (code == END.FREE_PEAK), approach.scene)
            pressure = jnp.where(code == END.FREE_PEAK, free.load(_at_peak(free, found.unknowns)), pressure)
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
        before = ((value - seen[0]) * (wanted(fixed, stop) - seen[0]) <= 0) & ~climb.drops
        status = jnp.where(before, Status.NO_CONTACT if self.CONTACT else Status.IMPOSSIBLE, Status.BEYOND_LIMIT)
        reached = crossing.exists & ~at_start if self.CONTACT else crossing.exists | at_start
        status = jnp.where(reached, Status.OK, status)
        status = jnp.where(climb.touches, status, jnp.where(before, Status.NO_CONTACT, Status.BEYOND_LIMIT))
        known = jnp.isfinite(value)
        ends = jnp.where(climb.touches, fixed.load(stop), climb.free_limit)
        reason = jnp.where(possible & (status == Status.BEYOND_LIMIT), Reason.VALUE_NOT_REACHED, Reason.NONE)
        reason = jnp.where(known, reason, Reason.PRESSURE_RULE)
        is_beyond = possible & known & (status == Status.BEYOND_LIMIT) & jnp.isfinite(ends)
        detail = jnp.where(is_beyond, ends, jnp.nan)
        status = jnp.where(possible & known, status, Status.IMPOSSIBLE)

        # Rounding of the observable is relative to its change over a cell, where the value itself may be zero, and what
        # rounding of the angle leaves of it.
        scale = jnp.abs(value) + crossing.scale + crossing.swing
        mismatch = (wanted(fixed, angle) - value) / jnp.where(scale > 0, scale, 1.0)
        found = Found(angle, fixed.load(angle), status, crossing.iterations, mismatch, reason=reason, detail=detail)
        found = fixed.verified(found)
        scene, target = stop_gradient_where_failed(found.status == Status.OK, (self, target))
        angle = implicit(lambda x, args: wanted(args[0], x) - args[1], angle, (scene, target))
        pressure = scene.load(angle)
        solution = self._report(angle, pressure, found)
        begins = jnp.where(climb.touches, scan.y[0], climb.free_limit)
        no_answer = jnp.where(status == Status.NO_CONTACT, begins, jnp.nan)
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
            # What is touched only behind the free membrane's own limit is no part of this branch.
            status = jnp.where(climb.touches, status, Status.BEYOND_LIMIT)
            status = jnp.where(climb.possible, status, Status.IMPOSSIBLE)
            return self._report(angle, pressure, self.verified(Found(angle, pressure, status, jnp.asarray(0))))

        return jax.vmap(at)(angles)


def _at_peak(scene: CurveScene, angle: Scalar) -> Scalar:
    """The angle of a maximum of the load, with its derivatives."""
    return implicit(lambda angle, scene: slope_of(scene.load)(angle), angle, scene)
