"""Inverse problems of the energy membrane: where its path meets something that is wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.choice import select, smallest
from ..numerics.implicit import implicit
from ..reasons import Reason
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import Found, frozen
from .path_values import surplus_over

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

LARGEST_LOAD = 4.0
"""Cube root of the largest p a / (mu t_m) that is looked at: 64 is three times more than any measured shell had."""
FIRST_LOAD, GROWTH = 0.3, 1.2
"""The first cube root that is tried, and its growth until the wanted state is passed."""
SEEK_STEPS, MEETS = 120, 2e-13
"""The most trials, and the relative error that ends them."""
TOP_KNOWN = 1e-3
"""Where an observable turns below its wanted value is known this well, relative to the load, before it is passed."""
END_KNOWN = 1e-5
"""Where equilibrium ends is known this well, relative to the load, before the search gives up."""


def onset(method: Any, scene: Any) -> Scalar:
    """The pressure (Pa) at which the free membrane meets the object at a contact point; inf where it never does."""
    free = scene.without_body()
    fixed = frozen(scene)

    def nearest(scene, free_unknowns):
        return -smallest(scene.functional.gaps(free_unknowns, scene))

    sought = seek(method, frozen(free), lambda unknowns, pressure: nearest(fixed, unknowns))
    found, within = sought.found, sought.found.status == Status.OK
    # The last state that was looked at is one, too, where the membrane holds all pressures and stays away.
    never = sought.ended & (within | (found.status == Status.BEYOND_LIMIT))
    ok = within & ~sought.ended
    scene, free = stop_gradient_where_failed(ok, (scene, free))

    def equation(scaled, args):
        scene, free, unknowns = args
        return nearest(scene, free.with_implicit_derivative(unknowns, scaled * scene.unit()))

    scaled = implicit(equation, found.pressure / fixed.unit(), (scene, free, found.unknowns))
    return jnp.where(ok, scaled * scene.unit(), jnp.where(never, jnp.inf, jnp.nan))


class Sought(NamedTuple):
    """What a search along the branch came to."""

    found: Found
    left: Scalar
    """Of the surplus, there."""
    ended: Bool[Array, ""]
    """Whether the branch ended before it, or LARGEST_LOAD; the point is then the last one that was tried."""
    end: Scalar
    """The last pressure (Pa) below that end, within END_KNOWN; NaN where nothing says that it ends."""


class _End(NamedTuple):
    """An end of the interval that is looked at."""

    load: Scalar
    value: Scalar
    """Of the surplus, there; NaN where there is no equilibrium, or where nothing is known."""
    rise: Scalar
    """Its slope by the load."""
    known: tuple[Vector, Scalar, Vector]
    """An equilibrium there, its load, and its change per load."""


class _Search(NamedTuple):
    low: _End
    """The last equilibrium that counts as below; the value is sought between it and what follows,"""
    top: _End
    """where the surplus is negative and falls, but has risen before: it may be positive in between;"""
    high: _End
    """or the value is passed, or there is no equilibrium. Loads that are not known are inf."""
    load: Scalar
    """What is tried next."""
    side: Array
    last: tuple[Found, Scalar]
    count: Array


def seek(method: Any, scene: Any, surplus: Callable[[Vector, Scalar], Scalar]) -> Sought:
    """Where surplus(unknowns, pressure), negative at low pressure, first rises through zero: by false position.

    Where it falls at a trial and has risen before, the top in between is looked at before anything higher is."""
    unit = scene.unit()
    zero = jnp.zeros_like(unit)
    flat = scene.unloaded_state(), zero, scene.first_guess(zero + 1)
    none = _End(zero + jnp.inf, zero + jnp.nan, zero, flat)

    def step(state: _Search) -> _Search:
        load, low, high = state.load, state.low, state.high
        found, *after = method.find_from(scene, *low.known, load**3 * unit)
        solved = (found.status == Status.OK) | (found.status == Status.NO_CONTACT)
        moves = after[2], 3 * load**2 * unit
        value, rise = jax.jvp(surplus, (found.unknowns, found.pressure), moves)
        here = _End(load, jnp.where(solved, value, jnp.nan), rise, tuple(after))
        below = here.value < 0
        turned = below & (rise < 0) & ((low.rise > 0) | (here.value > low.value))
        inside = jnp.isfinite(state.top.load)
        new_side = jnp.where(below, -1, 1)
        stays = (new_side == state.side) & ~inside & ~turned
        # The end that stays counts half (Illinois); an end without equilibrium has no value.
        halved_high = high._replace(value=jnp.where(stays, 0.5 * high.value, high.value))
        halved_low = low._replace(value=jnp.where(stays, 0.5 * low.value, low.value))
        low = select(turned, low, select(below, here, halved_low))
        high = select(below, halved_high, here)
        top = select(turned, here, select(below, state.top, none))
        # Nothing is met at the top: its far side is the next low end.
        passed = jnp.isfinite(top.load) & (top.load - low.load < TOP_KNOWN * top.load)
        low, top = select(passed, top, low), select(passed, none, top)
        part = low.value / (low.value - high.value)
        between = low.load + (high.load - low.load) * jnp.where(jnp.isfinite(part), part, 0.5)
        further = jnp.where(low.load < LARGEST_LOAD, jnp.minimum(GROWTH * low.load, LARGEST_LOAD), jnp.inf)
        ahead = jnp.where(jnp.isfinite(high.load), between, further)
        ahead = jnp.where(jnp.isfinite(top.load), 0.5 * (low.load + top.load), ahead)
        side = jnp.where(inside | turned, 0, new_side)
        return _Search(low, top, high, ahead, side, (found, here.value), state.count + 1)

    def busy(state: _Search):
        low, high, value = state.low.load, state.high.load, state.last[1]
        open_ = ~(jnp.isfinite(high) & (high - low <= 1e-15 * high)) & (state.load <= LARGEST_LOAD)
        near_end = jnp.isnan(value) & jnp.isfinite(high) & (high - low < END_KNOWN * high)
        return ~(jnp.abs(value) <= MEETS) & open_ & ~near_end & (state.count < SEEK_STEPS)

    def begun(last):
        low = none._replace(load=zero)
        return _Search(low, none, none, zero + FIRST_LOAD, jnp.asarray(0), last, jnp.asarray(0))

    nothing = Found(flat[0], zero, jnp.asarray(int(Status.NOT_CONVERGED)), jnp.asarray(0)), none.value
    shapes = jax.eval_shape(lambda last: step(begun(last)).last, nothing)
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    end = lax.while_loop(busy, step, begun((nothing[0], none.value)))
    (found, value), high = end.last, end.high
    last = jnp.where(jnp.isfinite(high.load) & jnp.isnan(value), end.low.load**3 * unit, jnp.nan)
    return Sought(found, value, jnp.isnan(value) | (end.load > LARGEST_LOAD), last)


def solve_for(method: Any, scene: Any, name: str, target: Scalar) -> Solution:
    """The solution at the pressure that gives an observable its wanted value.

    What may go either way from its value at rest is sought on that way, up or down."""
    fixed, value = frozen((scene, target))

    def surplus(scene, target, unknowns, pressure):
        falls = False if (rest := scene.EITHER_WAY.get(name)) is None else target < rest
        sense = jnp.where(falls, -1.0, 1.0)
        return sense * surplus_over(name, target, scene.observe(unknowns, pressure))

    sought = seek(method, fixed, lambda unknowns, pressure: surplus(fixed, value, unknowns, pressure))
    found = sought.found
    flat, none = fixed.unloaded_state(), jnp.zeros_like(value)
    at_rest = surplus(fixed, value, flat, none)
    touches_later = found.status == Status.NO_CONTACT
    possible = fixed.can_exist()
    resting, passed = ~touches_later & (at_rest == 0), possible & (at_rest > 0)
    # Where the last state that was looked at is one, equilibrium goes on and the search does not.
    unsought = sought.ended & jnp.isfinite(sought.left)
    status = jnp.where(sought.ended, jnp.where(unsought, Status.NOT_CONVERGED, Status.BEYOND_LIMIT), found.status)
    status = jnp.where(resting, Status.OK if fixed.body is None else Status.NO_CONTACT, status)
    known = jnp.isfinite(value)
    status = jnp.where(passed, Status.IMPOSSIBLE if fixed.body is None else Status.NO_CONTACT, status)
    status = jnp.where(possible & known, status, Status.IMPOSSIBLE)
    beyond = status == Status.BEYOND_LIMIT
    reason = jnp.where(beyond, int(Reason.VALUE_NOT_REACHED), int(Reason.NONE))
    reason = jnp.where(passed, int(Reason.VALUE_PASSED), reason)
    unsought &= status == Status.NOT_CONVERGED
    reason = jnp.where(unsought, int(Reason.VALUE_NOT_SOUGHT), reason)
    detail = jnp.where(beyond, sought.end, jnp.where(passed, none, jnp.nan))
    detail = jnp.where(unsought, LARGEST_LOAD**3 * fixed.unit(), detail)
    found = found._replace(
        unknowns=jnp.where(resting, flat, found.unknowns),
        pressure=jnp.where(resting, 0.0, found.pressure),
        status=status,
        mismatch=jnp.where((status == Status.OK) & ~resting, sought.left, 0.0),
        reason=jnp.where(known, reason, int(Reason.PRESSURE_RULE)),
        detail=jnp.where(known, detail, jnp.nan),
    )
    found = fixed.verified(found)
    ok = found.status == Status.OK
    scene, target = stop_gradient_where_failed(ok, (scene, target))

    def equation(scaled, args):
        scene, target, unknowns = args
        pressure = scaled * scene.unit()
        return surplus(scene, target, scene.with_implicit_derivative(unknowns, pressure), pressure)

    scaled = implicit(equation, found.pressure / fixed.unit(), (scene, target, found.unknowns))
    pressure = jnp.where(ok, scaled * scene.unit(), jnp.nan)
    safe = jnp.where(ok, pressure, fixed.unit())
    return scene.report_of(scene.with_implicit_derivative(found.unknowns, safe), pressure, found)
