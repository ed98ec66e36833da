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
from jaxtyping import Array, Float, Int

from .roots import bracketed_root

Scalar = Float[Array, ""]
Load = Callable[[Scalar], Scalar]
Margins = Callable[[Scalar], Float[Array, " m"]]

SCAN_POINTS = 48
"""Samples along the curve that look for the first event. Over random designs the load has one maximum; events closer
than 1/48 of the range to each other would be seen as one, at the earlier one's cell."""


class Stop(NamedTuple):
    """Where the rising part of a curve ends, and by which event."""

    x: Scalar
    event: Int[Array, ""]
    """0: the load has its maximum; k: the k-th margin is used up; -1: the end of the range."""


def slope_of(load: Load) -> Load:
    """d load / d x."""
    return lambda x: jax.jvp(load, (x,), (jnp.ones_like(x),))[1]


def events(load: Load, margins: Margins) -> Callable[[Scalar], Float[Array, " k"]]:
    """The quantities that stay positive up to the stop: the slope of the load, then each margin."""
    return lambda x: jnp.concatenate([slope_of(load)(x)[None], margins(x)])


def first_stop(load: Load, margins: Margins, start: Scalar, end: Scalar) -> Stop:
    """The first x after `start` where the load stops rising or a margin reaches zero; else `end`.

    Sampled at SCAN_POINTS, then refined by a bracketed Newton to the last bit. No derivatives pass through.
    """
    quantities = events(load, margins)
    step = (end - start) / SCAN_POINTS
    # The samples sit at the middles of the cells: both ends of a range may be singular.
    x = start + step * (jnp.arange(SCAN_POINTS) + 0.5)
    sampled = jax.vmap(quantities)(x)
    failed = ~jnp.all(sampled > 0, axis=1)
    first = jnp.argmax(failed)
    found = failed[first]
    high = x[first]
    low = jnp.where(first == 0, start, x[jnp.maximum(first - 1, 0)])

    def refine(k):
        broken = sampled[first, k] <= 0
        root = bracketed_root(lambda z: quantities(z)[k], low, high).x
        return jnp.where(broken, root, jnp.inf)

    stops = jax.vmap(refine)(jnp.arange(sampled.shape[1]))
    event = jnp.argmin(stops)
    # A sample that is NaN breaks no sign: it stops the curve at the last good sample.
    stop = jnp.where(jnp.isfinite(stops[event]), stops[event], low)
    return Stop(jnp.where(found, stop, end), jnp.where(found, event, -1))


def crossing(function: Load, target: Scalar, start: Scalar, stop: Scalar) -> tuple[Scalar, Int[Array, ""]]:
    """x in [start, stop] where a rising `function` equals `target`, and the iterations it took."""
    root = bracketed_root(lambda x: function(x) - target, start, stop)
    return lax.stop_gradient(root.x), root.iterations
