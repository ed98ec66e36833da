"""Equilibria on a curve: where the load is an explicit function of one parameter x.

Many states of a gripper reduce to this: pick x (an angle), and the load that holds it there follows without a solve.
Then "solve for a load" is one scalar root on the rising part of load(x), and a limit point is its first maximum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .roots import bracketed_root

Scalar = Float[Array, ""]
Samples = Float[Array, " n"]
Function = Callable[[Scalar], Scalar]

CELLS = 48
"""A curve is looked at in this many cells. A maximum and a minimum of the load inside one cell would be overlooked:
over random designs of every material here, two events are never that close."""


class Scan(NamedTuple):
    """Samples of a curve, and how far it rises."""

    x: Samples
    y: Samples
    last: Int[Array, ""]
    """Index of the last sample that is above all samples before it."""
    falls: Bool[Array, ""]
    """Whether the curve stops rising before its end."""


class Crossing(NamedTuple):
    """The first place where a curve takes a value."""

    x: Scalar
    exists: Bool[Array, ""]
    iterations: Int[Array, ""]
    scale: Scalar
    """The change of the curve over the cell of the crossing: what its rounding errors are measured by."""


def slope_of(function: Function) -> Function:
    """d function / d x."""
    return lambda x: jax.jvp(function, (x,), (jnp.ones_like(x),))[1]


def scan_curve(function: Function, start: Scalar, end: Scalar) -> Scan:
    """Samples of `function` at the borders of CELLS equal cells."""
    x = start + (end - start) * jnp.linspace(0.0, 1.0, CELLS + 1, dtype=start.dtype)
    y = jax.vmap(function)(x)
    stops = ~(y[1:] > y[:-1])  # NaN stops it too
    falls = jnp.any(stops)
    return Scan(x, y, jnp.where(falls, jnp.argmax(stops), CELLS), falls)


def first_maximum(function: Function, scan: Scan) -> Scalar:
    """x of the first maximum of a scanned `function`; the end of the scan where it rises throughout.

    The root of the slope in the two cells around the highest sample, to the last bit. No derivatives pass through.
    """
    top = scan.last
    after = jnp.minimum(top + 1, CELLS)
    y_top = scan.y[top]
    # The first point that is tried is x[top] itself, where rounding alone decides which value is higher.
    clearly_after = scan.x[top] + 1e-3 * (scan.x[after] - scan.x[top])

    def beyond(x):
        value, slope = jax.jvp(function, (x,), (jnp.ones_like(x),))
        # Lower than the highest sample before it: past the maximum, even where the curve rises again.
        past = (slope <= 0) | ((x > clearly_after) & ~(value > y_top))
        return jnp.where(past, jnp.abs(slope), -slope)

    return bracketed_root(beyond, scan.x[jnp.maximum(top - 1, 0)], scan.x[after]).x


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
    root = bracketed_root(lambda z: sign * (function(z) - target), x[low], high)
    return Crossing(lax.stop_gradient(root.x), exists, root.iterations, jnp.abs(y_high - y[low]))
