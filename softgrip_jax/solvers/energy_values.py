"""Inverse problems of the energy membrane: where its path meets something that is wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.choice import smallest
from ..numerics.implicit import implicit
from ..reasons import Reason
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import Found, frozen
from .path_values import surplus_over

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

LARGEST_LOAD = 4.0
"""Cube root of the largest p a / (mu t_m) that is looked at: 64 is three times more than any measured shell had."""
FIRST_LOAD, GROWTH = 0.3, 1.5
"""The first cube root that is tried, and its growth until the wanted state is passed."""
SEEK_STEPS, MEETS = 60, 2e-13
"""The most trials, and the relative error that ends them."""
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


def seek(method: Any, scene: Any, surplus: Callable[[Vector, Scalar], Scalar]) -> Sought:
    """Where surplus(unknowns, pressure), negative at low pressure, first rises through zero: by false position."""
    unit = scene.unit()
    zero = jnp.zeros_like(unit)
    unknown = zero + jnp.nan

    def step(state):
        start, start_load, slope, low, low_value, high, high_value, load, side, _, count = state
        found, *after = method.find_from(scene, start, start_load, slope, load**3 * unit)
        solved = (found.status == Status.OK) | (found.status == Status.NO_CONTACT)
        value = jnp.where(solved, surplus(found.unknowns, found.pressure), jnp.nan)
        below = value < 0
        new_side = jnp.where(below, -1, 1)
        stays = new_side == side
        # The end that stays counts half (Illinois); an end without equilibrium has no value.
        high_value = jnp.where(below & stays, 0.5 * high_value, jnp.where(below, high_value, value))
        low_value = jnp.where(~below & stays, 0.5 * low_value, jnp.where(below, value, low_value))
        low, high = jnp.where(below, load, low), jnp.where(below, high, load)
        part = low_value / (low_value - high_value)
        inside = low + (high - low) * jnp.where(jnp.isfinite(part), part, 0.5)
        further = jnp.where(load < LARGEST_LOAD, jnp.minimum(GROWTH * load, LARGEST_LOAD), jnp.inf)
        next_load = jnp.where(jnp.isfinite(high), inside, further)
        kept = jax.tree.map(lambda a, b: jnp.where(below, a, b), tuple(after), (start, start_load, slope))
        return *kept, low, low_value, high, high_value, next_load, new_side, (found, value), count + 1

    def busy(state):
        low, high, load, (_, value), count = state[3], state[5], state[7], state[9], state[10]
        open_ = ~(jnp.isfinite(high) & (high - low <= 1e-15 * high)) & (load <= LARGEST_LOAD)
        near_end = jnp.isnan(value) & jnp.isfinite(high) & (high - low < END_KNOWN * high)
        return ~(jnp.abs(value) <= MEETS) & open_ & ~near_end & (count < SEEK_STEPS)

    def begun(last):
        return (
            scene.unloaded_state(), zero, scene.first_guess(zero + 1), zero, unknown, zero + jnp.inf, unknown,
            zero + FIRST_LOAD, jnp.asarray(0), last, jnp.asarray(0),
        )  # fmt: skip

    nothing = Found(scene.unloaded_state(), zero, jnp.asarray(int(Status.NOT_CONVERGED)), jnp.asarray(0)), unknown
    shapes = jax.eval_shape(lambda last: step(begun(last))[9], nothing)
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    last = lax.while_loop(busy, step, begun((nothing[0], unknown)))
    (low, high, load), (found, value) = (last[3], last[5], last[7]), last[9]
    end = jnp.where(jnp.isfinite(high) & jnp.isnan(value), low**3 * unit, jnp.nan)
    return Sought(found, value, jnp.isnan(value) | (load > LARGEST_LOAD), end)


def solve_for(method: Any, scene: Any, name: str, target: Scalar) -> Solution:
    """The solution at the pressure that gives an observable its wanted value.

    What may have either sign is sought on its way from zero, up or down."""
    fixed, value = frozen((scene, target))

    def surplus(scene, target, unknowns, pressure):
        sense = jnp.where((target < 0) & (name in scene.EITHER_SIGN), -1.0, 1.0)
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
