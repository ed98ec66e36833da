"""Scenes with one unknown: the pressure is an explicit function of an angle, so every question is a scalar root."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..numerics.curves import (
    Scan,
    first_crossing,
    first_maximum,
    first_maximum_before,
    samples_with_turns,
    scan_curve,
    slope_of,
)
from ..numerics.implicit import implicit
from ..numerics.xla import materialised
from ..reasons import Reason
from ..results import Status, is_zero_apart, stop_gradient_where_failed
from ..scene import FALLEN, WITHOUT_LIMIT, BranchSolver, Found, frozen

Scalar = Float[Array, ""]
AnyCurveScene = Any
"""A `Scene` with `CurveEquations`."""


BRANCH_CELLS = 512
"""The end of a drawn branch is one of as many places, and with them right to a line's width."""
DROP, FIRST = 1e-6, np.geomspace(1e-6, 1e-1, 16)
"""A load falls at first where, at these parts of the interval, it is lower by this part before it is as much higher: a
dip or a hump that is less lets the state snap by nothing that anybody could see."""
BEFORE_END = 1e-6
"""The end of the interval itself may be singular (a flat membrane turned inside out): a branch stops so much before."""


class SampledCurve(NamedTuple):
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


class ExplicitCurve(BranchSolver):
    """A bracketed root on the first rising part of the load curve, for scenes with one unknown.

    It is what shells and chambers use by themselves. The load is explicit in the unknown angle, so the whole curve
    p(theta) is looked at first. The root cannot fail to converge and has no tolerance: the bracket is closed to
    rounding. The first maximum of the load is the limit, and a larger pressure is BEYOND_LIMIT.

    Libraries that were looked at: see `numerics.scalar_roots` for the root; none has the first maximum of a curve, with
    its derivatives, or the first root before it.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> found = sg.solve(sg.shell.Free(shell), 15 * kPa, solver=sg.solvers.ExplicitCurve())
        >>> print(f"{found.inflation / mm:.2f} mm")
        13.41 mm
    """

    def find(self, scene: Any, pressure, guess):
        curve = sampled(scene)
        scan, possible = curve.scan, curve.possible
        start, low = scan.x[0], scan.y[0]
        stop = stop_of(scene, curve, ~(scan.y[scan.sure] > pressure))
        crossing = first_crossing(scene.load, pressure, scan.x, scan.y, stop)
        status = jnp.where(crossing.exists, Status.OK, Status.BEYOND_LIMIT)
        status = jnp.where(pressure <= low, Status.NO_CONTACT if scene.CONTACT else Status.OK, status)
        angle = jnp.where(pressure <= low, start, crossing.x)
        # A free state that does not touch is all there is.
        free = jnp.where(pressure <= curve.free_limit, Status.NO_CONTACT, Status.BEYOND_LIMIT)
        status = jnp.where(curve.touches, status, free)
        known = (pressure >= 0) & (pressure < jnp.inf)
        reason = jnp.where(possible & (status == Status.BEYOND_LIMIT), _why(scene, curve), Reason.NONE)
        reason = jnp.where(known, reason, Reason.PRESSURE_RULE)
        begins = jnp.where(curve.touches, low, curve.free_limit)
        ends = jnp.where(curve.touches, scene.load(stop), curve.free_limit)
        detail = jnp.where(status == Status.BEYOND_LIMIT, ends, begins)
        detail = jnp.where(jnp.isfinite(detail) & known & (status != Status.OK) & possible, detail, jnp.nan)
        status = jnp.where(possible & known, status, Status.IMPOSSIBLE)
        # Near the angle where a material locks or an arc closes the load is so steep that no angle in floating point
        # meets a pressure more closely.
        rounding = crossing.swing / (scene.pressure_scale() + jnp.abs(pressure)) + scene.amplified(angle)
        return Found(angle, pressure, status, crossing.iterations, rounding=rounding, reason=reason, detail=detail)

    def onset(self, scene):
        approach = scene.approach()
        if approach is None:
            return scene.load(interval_of(scene)[0])
        touches, peak, limit = frozen(approached(frozen(scene), approach.touch))
        own = stop_gradient_where_failed(touches, scene).approach()
        free = stop_gradient_where_failed(~touches & jnp.isfinite(limit), approach.scene)
        limit = jnp.where(jnp.isfinite(limit), free.load(_at_peak(free, peak)), jnp.inf)
        return jnp.where(touches, own.begins, limit)

    def find_limit(self, scene):
        curve = sampled(scene)
        scan, stop, possible = curve.scan, stop_of(scene, curve), curve.possible
        endless = scene.unbounded() & ~scan.falls & ~curve.drops
        pressure = jnp.where(endless, jnp.inf, scene.load(stop))
        pressure = jnp.where(curve.touches, pressure, curve.free_limit)
        status = jnp.where(possible, Status.OK, Status.IMPOSSIBLE)
        own = jnp.where(curve.drops, END.BEGINNING, jnp.where(scan.falls, END.PEAK, END.MODEL))
        code = jnp.where(curve.touches, own, END.FREE_PEAK)
        return Found(jnp.where(curve.touches, stop, curve.free_peak), pressure, status, jnp.asarray(0), end=code)

    def limit_pressure_from(self, scene, found):
        ok = (found.status == Status.OK) & jnp.isfinite(found.pressure)
        code = found.end
        own = stop_gradient_where_failed(ok & (code != END.FREE_PEAK), scene)
        start, end = interval_of(own)
        border = jnp.where(ok, jnp.where(code == END.BEGINNING, start, end), 1.0)
        pressure = own.load(jnp.where(code == END.PEAK, _at_peak(own, found.unknowns), border))
        approach = scene.approach()
        if approach is not None:
            free = stop_gradient_where_failed(ok & (code == END.FREE_PEAK), approach.scene)
            pressure = jnp.where(code == END.FREE_PEAK, free.load(_at_peak(free, found.unknowns)), pressure)
        return jnp.where(ok, pressure, jnp.where(found.status == Status.OK, jnp.inf, jnp.nan))

    def solve_for(self, scene, name, target):
        fixed, value = frozen((scene, target))

        def wanted(scene, angle):
            return scene.observe(angle, scene.load(angle))[name]

        curve = sampled(fixed)
        scan, stop, possible = curve.scan, stop_of(fixed, curve), curve.possible
        start = scan.x[0]

        def observed(angle):
            return wanted(fixed, angle)

        if scene.may_turn(name):
            places, seen = samples_with_turns(observed, scan.x)
        else:
            places, seen = scan.x, jax.vmap(observed)(scan.x)
        crossing = first_crossing(observed, value, places, seen, stop)
        at_start = value == seen[0]
        angle = jnp.where(at_start, start, crossing.x)
        # A value on the far side of the one at the start, seen from where the curve goes, belongs to no state of it.
        before = ((value - seen[0]) * (wanted(fixed, stop) - seen[0]) <= 0) & ~curve.drops
        status = jnp.where(before, Status.NO_CONTACT if scene.CONTACT else Status.IMPOSSIBLE, Status.BEYOND_LIMIT)
        reached = crossing.exists & ~at_start if scene.CONTACT else crossing.exists | at_start
        status = jnp.where(reached, Status.OK, status)
        status = jnp.where(curve.touches, status, jnp.where(before, Status.NO_CONTACT, Status.BEYOND_LIMIT))
        known = jnp.isfinite(value)
        ends = jnp.where(curve.touches, fixed.load(stop), curve.free_limit)
        unknown = _why(fixed, curve) == Reason.CELL_LAW_ENDS
        beyond = jnp.where(unknown, Reason.VALUE_BEYOND_CELL_LAW, Reason.VALUE_NOT_REACHED)
        reason = jnp.where(possible & (status == Status.BEYOND_LIMIT), beyond, Reason.NONE)
        passed = possible & known & before & ~reached
        if scene.CONTACT:  # below it forces are zero, and the free membrane has a stretch of its own
            passed &= curve.touches & ~at_start & is_zero_apart(name, scene.OBSERVABLES[name])
        reason = jnp.where(passed, Reason.VALUE_PASSED, reason)
        reason = jnp.where(known, reason, Reason.PRESSURE_RULE)
        is_beyond = possible & known & (status == Status.BEYOND_LIMIT) & jnp.isfinite(ends)
        detail = jnp.where(is_beyond, ends, jnp.where(passed, scan.y[0], jnp.nan))
        status = jnp.where(possible & known, status, Status.IMPOSSIBLE)

        # Rounding of the observable is relative to its change over a cell, where the value itself may be zero, and what
        # rounding of the angle leaves of it.
        scale = jnp.abs(value) + crossing.scale + crossing.swing
        mismatch = (wanted(fixed, angle) - value) / jnp.where(scale > 0, scale, 1.0)
        found = Found(angle, fixed.load(angle), status, crossing.iterations, mismatch, reason=reason, detail=detail)
        found = fixed.verified(found)
        solved, target = stop_gradient_where_failed(found.status == Status.OK, (scene, target))
        angle = implicit(lambda x, args: wanted(args[0], x) - args[1], angle, (solved, target))
        pressure = solved.load(angle)
        solution = scene.report_of(angle, pressure, found)
        begins = jnp.where(curve.touches, scan.y[0], curve.free_limit)
        no_answer = jnp.where(status == Status.NO_CONTACT, begins, jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, pressure, no_answer))

    def branch(self, scene, n, limit=None):
        fixed = frozen(scene)
        curve = sampled(fixed)
        stop = stop_of(fixed, curve)
        start = interval_of(scene)[0]
        angles = start + (_branch_end(fixed, curve, stop) - start) * jnp.linspace(0.0, 1.0, n)
        # The limit is one of the points, where the branch goes through it.
        nearest = jnp.argmin(jnp.abs(angles - stop))
        angles = jnp.where(curve.scan.falls & (jnp.arange(n) == nearest), stop, angles)

        def at(angle):
            pressure = scene.load(angle)
            status = jnp.where(jnp.isfinite(pressure), Status.OK, Status.BEYOND_LIMIT)
            # What is touched only behind the free membrane's own limit is no part of this branch.
            status = jnp.where(curve.touches, status, Status.BEYOND_LIMIT)
            status = jnp.where(curve.possible, status, Status.IMPOSSIBLE)
            return scene.report_of(angle, pressure, scene.verified(Found(angle, pressure, status, jnp.asarray(0))))

        return jax.vmap(at)(angles)


def interval_of(scene: AnyCurveScene) -> tuple[Scalar, Scalar]:
    """The interval of a scene, which a user may give as plain numbers."""
    start, end = scene.interval()
    return jnp.asarray(start, float), jnp.asarray(end, float)


def sampled(scene: AnyCurveScene) -> SampledCurve:
    """Look at the load curve once; every question starts from this."""
    start, end = interval_of(scene)
    scan = scan_curve(scene.load, start, end, "dips" if scene.may_dip() else "single")
    touches, peak, limit = approached(scene, start)
    possible = scene.can_exist() & ((start < end) | ~touches)
    drops = jnp.asarray(False)
    if scene.may_dip() and scene.approach() is not None:
        change = jax.vmap(scene.load)(start + (end - start) * FIRST) / scan.y[0] - 1
        rose = jnp.cumsum(change > DROP) > 0
        drops = touches & jnp.any((change < -DROP) & ~rose)
    return SampledCurve(scan, end, possible, touches, peak, limit, drops)


def approached(scene: AnyCurveScene, start: Scalar) -> tuple[Bool[Array, ""], Scalar, Scalar]:
    """(touches, free_peak, free_limit) of `SampledCurve`."""
    approach = scene.approach()
    if approach is None:
        return jnp.asarray(True), start, jnp.full_like(start, jnp.inf)
    free = approach.scene
    begin, end = interval_of(free)
    far = end if approach.touches_early else jnp.minimum(approach.touch, end)
    peak, falls = first_maximum_before(free.load, begin, far, scene.may_dip())
    limit = jnp.where(falls, free.load(peak), jnp.inf)
    if approach.touches_early:
        touches = (approach.touch <= jnp.where(falls, peak, end)) & (approach.begins <= limit)
    else:
        touches = ~falls & (approach.touch <= end)
    return materialised(touches.astype(peak.dtype)) > 0, peak, limit


def stop_of(scene: AnyCurveScene, curve: SampledCurve, wanted: Bool[Array, ""] | bool = True) -> Scalar:
    """The angle where the rising part of the load ends: its first maximum, or the end of the interval.

    Where it is not `wanted` a place before the maximum does, which costs nothing.
    """
    scan = curve.scan
    wanted = wanted & scan.falls
    peak = first_maximum(scene.load, scan, wanted)
    stop = jnp.where(wanted, peak, jnp.where(scan.falls, scan.x[scan.sure], curve.end))
    return jnp.where(curve.drops, scan.x[0], stop)


def _why(scene: AnyCurveScene, curve: SampledCurve) -> Int[Array, ""]:
    """The reason where the branch ends."""
    own = jnp.where(curve.scan.falls | curve.drops, Reason.LIMIT_POINT, scene.end_reason())
    return jnp.where(curve.touches, own, Reason.LIMIT_BEFORE_CONTACT)


def _branch_end(scene: AnyCurveScene, curve: SampledCurve, stop: Scalar) -> Scalar:
    """The angle where a drawn branch ends, see `sg.branch`; values only. stop: where the pressure is the limit."""
    scan, first = curve.scan, curve.scan.x[0]
    latest = jnp.minimum(first + (1 - BEFORE_END) * (curve.end - first), scene.largest_angle())

    def before(wanted, begin):
        """The last of the angles from `begin` to `latest` in front of the first whose load is `wanted`."""
        angles = begin + jnp.maximum(latest - begin, 0) * jnp.linspace(0.0, 1.0, BRANCH_CELLS + 1)
        is_wanted = wanted(jax.vmap(scene.load)(angles))
        place = jnp.where(jnp.any(is_wanted), jnp.argmax(is_wanted) - 1, BRANCH_CELLS)
        return angles[jnp.maximum(place, 0)]

    limit = scene.load(stop)

    def is_over(loads):
        fell = jnp.cumsum(loads < limit) > 0
        return ~jnp.isfinite(loads) | (loads < FALLEN * limit) | (fell & (loads > limit))

    most = WITHOUT_LIMIT * scene.pressure_scale()
    endless = before(lambda loads: ~(loads <= most), first)
    end = jnp.where(scene.unbounded(), jnp.minimum(endless, latest), latest)
    return jnp.where(scan.falls, before(is_over, stop), end)


def _at_peak(scene: AnyCurveScene, angle: Scalar) -> Scalar:
    """The angle of a maximum of the load, with its derivatives."""
    return implicit(lambda angle, scene: slope_of(scene.load)(angle), angle, scene)
