"""Equilibria on a curve: where the load is an explicit function of one parameter x.

Many states of a gripper reduce to this: pick x (an angle), and the load that holds it there follows without a solve.
Then "solve for a load" is one scalar root on the rising part of load(x), and a limit point is its first maximum.

Libraries that were looked at: see `scalar_roots` for the root. `scipy.optimize.minimize_scalar` and golden sections in
JAX find some maximum in an interval; the first one of a curve with several, and whether there is one, they do not tell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .scalar_roots import bracketed_root, newton_bracketed

Scalar = Float[Array, ""]
Samples = Float[Array, " n"]
Function = Callable[[Scalar], Scalar]

CELLS = 48
"""A curve is looked at in this many cells."""

SINGLE_CELLS = 12
"""... or in these, where it has one maximum at most: they only bring Newton's method near."""

DIP_POINTS, DIP_ROUNDS = 13, 3
"""A maximum and a minimum of the load can be closer than a cell (Mooney, Yeoh, Gent: one design in a hundred). Where
the curve rises least, the slope is sampled in three cells, then around its least value, to 1/140 of a cell."""


RISES_AT_FIRST = 1e-3
"""A curve with one maximum still rises at this part of its length: loads begin with the third power of the angle."""


class Scan(NamedTuple):
    """Samples of a curve, and how far it rises."""

    x: Samples
    y: Samples
    last: Int[Array, ""]
    """Index of the last sample that is above all samples before it."""
    falls: Bool[Array, ""]
    """Whether the curve stops rising before its end."""
    low: Scalar
    high: Scalar
    """Where it falls: the bracket of its first maximum."""
    clearly_after: Scalar
    """Beyond this x in the bracket, a value under y[last] is past the maximum, even where the curve rises again."""
    sure: Int[Array, ""]
    """Index of the last sample that is known to lie before the first maximum."""
    single: bool
    """Whether the curve has one maximum at most."""


class Crossing(NamedTuple):
    """The first place where a curve takes a value."""

    x: Scalar
    exists: Bool[Array, ""]
    iterations: Int[Array, ""]
    scale: Scalar
    """The change of the curve over the cell of the crossing: what its rounding errors are measured by."""
    swing: Scalar
    """|slope| times the larger of |x| and one: rounding leaves eps times this of the curve. x may count from anywhere;
    the angles that a curve is made of are of the order of one."""


def slope_of(function: Function) -> Function:
    """d function / d x."""
    return lambda x: jax.jvp(function, (x,), (jnp.ones_like(x),))[1]


def scan_curve(function: Function, start: Scalar, end: Scalar, look: str = "cells") -> Scan:
    """Samples of `function` at the borders of equal cells.

    look: "cells", CELLS of them; "dips", for falls narrower than a cell, too; "single", where the curve has one maximum
    at most, SINGLE_CELLS.
    """
    cells = SINGLE_CELLS if look == "single" else CELLS
    x = start + (end - start) * jnp.linspace(0.0, 1.0, cells + 1, dtype=start.dtype)
    y = jax.vmap(function)(x)
    stops = ~(y[1:] > y[:-1])  # NaN stops it too
    falls = jnp.any(stops)
    last = jnp.where(falls, jnp.argmax(stops), cells)
    if look == "single":  # the maximum may lie between the last two samples
        falls |= slope_of(function)(x[-1]) <= 0
    after = jnp.minimum(last + 1, cells)
    # The first point that a root search tries is x[last] itself, where rounding alone decides which value is higher.
    clearly_after = x[last] + 1e-3 * (x[after] - x[last])
    scan = Scan(x, y, last, falls, x[jnp.maximum(last - 1, 0)], x[after], clearly_after, last, look == "single")
    return _with_dip(function, scan) if look == "dips" else scan


def _with_dip(function: Function, scan: Scan) -> Scan:
    """The scan, ended earlier where the curve falls between two samples that rise."""
    x, last = scan.x, scan.last
    rise = jnp.where(jnp.arange(CELLS) < last, scan.y[1:] - scan.y[:-1], jnp.inf)
    # The first cell is no candidate: a curve may begin with slope zero.
    around = jnp.pad(rise, 1, constant_values=(-jnp.inf, jnp.inf))
    least = jnp.argmin(jnp.where((rise <= around[:-2]) & (rise <= around[2:]), rise, jnp.inf))
    low = x[jnp.maximum(least - 1, 0)]
    slope = jax.vmap(slope_of(function))

    def closer(_, state):
        low, high, _, _ = state
        points = low + (high - low) * jnp.linspace(0.0, 1.0, DIP_POINTS, dtype=low.dtype)
        slopes = slope(points)
        slopes = jnp.where(jnp.isnan(slopes), jnp.inf, slopes)
        k = jnp.argmin(slopes)
        return points[jnp.maximum(k - 1, 0)], points[jnp.minimum(k + 1, DIP_POINTS - 1)], points[k], slopes[k]

    first = (low, x[jnp.minimum(least + 2, last)], low, jnp.full_like(low, jnp.inf))
    _, _, place, value = lax.fori_loop(0, DIP_ROUNDS, closer, first)
    dip = (value <= 0) & (place > x[0])
    return scan._replace(
        falls=scan.falls | dip,
        low=jnp.where(dip, low, scan.low),
        high=jnp.where(dip, place, scan.high),
        clearly_after=jnp.where(dip, place, scan.clearly_after),
        sure=jnp.where(dip, jnp.maximum(least - 1, 0), last),
    )


def first_maximum(function: Function, scan: Scan, wanted: Bool[Array, ""]) -> Scalar:
    """x of the first maximum of a scanned `function` that falls, to the last bit, where it is `wanted`.

    A batch member that does not want it takes no step. No derivatives pass through.
    """
    low, high = scan.low, jnp.where(wanted, scan.high, scan.low)
    if scan.single:
        # The parabola through three samples knows the place.
        middle, cell = jnp.clip(scan.last, 1, scan.x.shape[0] - 2), scan.x[1] - scan.x[0]
        before, top, after = scan.y[middle - 1], scan.y[middle], scan.y[middle + 1]
        bend = after - 2 * top + before
        guess = scan.x[middle] - cell * 0.5 * (after - before) / jnp.where(bend == 0, 1.0, bend)
        return newton_bracketed(lambda x: -slope_of(function)(x), low, high, guess).x
    y_top = scan.y[scan.last]

    def beyond(x):
        value, slope = jax.jvp(function, (x,), (jnp.ones_like(x),))
        past = (x > scan.clearly_after) & ~(value > y_top)
        return jnp.where(past, jnp.abs(slope), -slope)

    return bracketed_root(beyond, low, high).x


def first_maximum_before(
    function: Function, start: Scalar, end: Scalar, may_dip: bool
) -> tuple[Scalar, Bool[Array, ""]]:
    """(x, whether there is one): the first maximum of `function`, which rises at first, between `start` and `end`.

    may_dip: False where there is one maximum at most: the slope at the end then tells, and a curve that still rises
    there costs one slope. No derivatives pass through.
    """
    start, end = lax.stop_gradient((start, end))
    if may_dip:
        scan = scan_curve(function, start, end, "dips")
        falls = scan.falls & (scan.last > 0)
        return jnp.where(falls, first_maximum(function, scan, falls), end), falls
    falls = slope_of(function)(end) <= 0
    low, high = end - (end - start) * jnp.where(falls, 1 - RISES_AT_FIRST, 0.0), end
    peak = newton_bracketed(lambda x: -slope_of(function)(x), low, high, 0.5 * (low + high)).x
    return jnp.where(falls, peak, end), falls


def samples_with_turns(function: Function, x: Samples) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """(x, y): samples at x and one between each two, where the cubic by their values and slopes turns; in the middle
    where it does not. A value that a curve takes only around a turn within a cell is thus seen. `x` rises.
    """
    y, slope = jax.vmap(lambda at: jax.jvp(function, (at,), (jnp.ones_like(at),)))(x)
    width, first, last = x[1:] - x[:-1], slope[:-1], slope[1:]
    mean = (y[1:] - y[:-1]) / jnp.where(width > 0, width, 1.0)
    # The cubic's slope over its cell is first + b t + a t^2, with one root in it where the slopes at its ends differ in
    # sign: of the two, without cancellation, the one that is inside.
    a, b = 3 * (first + last - 2 * mean), 2 * (3 * mean - 2 * first - last)
    turns = first * last < 0
    root = jnp.sqrt(jnp.where(turns, b * b - 4 * a * first, 0.0))
    half = -0.5 * (b + jnp.where(b < 0, -root, root))
    one, other = first / jnp.where(half == 0, 1.0, half), half / jnp.where(a == 0, 1.0, a)
    place = jnp.where((one > 0) & (one < 1), one, other)
    between = x[:-1] + width * jnp.where(turns & (place > 0) & (place < 1), place, 0.5)

    def together(at, within):
        return jnp.append(jnp.stack([at[:-1], within], axis=1).reshape(-1), at[-1])

    return together(x, between), together(y, jax.vmap(function)(between))


def first_crossing(function: Function, target: Scalar, x: Samples, y: Samples, stop: Scalar) -> Crossing:
    """The first x up to `stop` at which `function`, sampled as y(x), takes the value `target`, rising or falling.

    No derivatives pass through.
    """
    inside = x <= stop
    last = jnp.sum(inside) - 1
    above = y > target
    crossed = inside & (above != above[0])
    sampled = jnp.any(crossed)
    y_stop = function(stop)
    exists = sampled | ((y_stop > target) != above[0]) | (y_stop == target)
    k = jnp.argmax(crossed)
    low = jnp.where(sampled, k - 1, last)
    high, y_high = jnp.where(sampled, x[k], stop), jnp.where(sampled, y[k], y_stop)
    sign = jnp.where(above[0], -1.0, 1.0)
    rise = y_high - y[low]
    guess = x[low] + (high - x[low]) * (target - y[low]) / jnp.where(rise == 0, 1.0, rise)
    high = jnp.where(exists, high, x[low])  # nothing is looked for where there is nothing
    root = newton_bracketed(lambda z: sign * (function(z) - target), x[low], high, guess)
    swing = jnp.abs(slope_of(function)(root.x)) * jnp.maximum(jnp.abs(root.x), 1.0)
    swing = jnp.where(jnp.isfinite(swing), swing, 0.0)
    return Crossing(root.x, exists, root.iterations, jnp.abs(rise), lax.stop_gradient(swing))
