"""Minima of an energy, followed as the load grows.

An equilibrium is a minimum of energy(y, load). Each is found by Newton's method with a line search, from where the
tangent of the last one leads. The energy may have kinks in its second derivatives, as that of a stiff contact has.

One loop does everything, one expansion of the energy in its body: Newton's steps and the steps of the load. Nothing
waits for another stage, and the energy is compiled once. No derivatives pass through (see implicit.implicit).

Libraries that were looked at: optimistix and JAXopt (no longer maintained) minimise, SciPy's trust-exact too, which is
not compiled or batched with the energy. None of them stays with one minimum while a load grows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float, Int

from .batching import in_blocks, in_turn
from .choice import largest, select

Vector = Float[Array, " n"]
Scalar = Float[Array, ""]


class Expansion(NamedTuple):
    """Of the energy at (y, load)."""

    value: Scalar
    gradient: Vector
    hessian: Float[Array, "n n"]
    by_load: Vector
    """d gradient / d load."""
    touching: Bool[Array, ""]
    """Whether a contact presses: it bends y into shapes that the first guess knows nothing of."""


DECREASE = 1e-4
"""A step is taken where the energy falls by at least this part of what its slope promises (Armijo)."""
ROUNDING = 1e-13
"""Relative rounding of an energy that is a sum over many points."""
SHORTER = 0.3
SHORTEST = 1e-4
"""Steps are cut by SHORTER until they are accepted; below SHORTEST of a Newton step there is no minimum ahead."""
NEARER = 0.4
"""Of the way to a load without a minimum: the next load step. Failures cost more than steps."""
CONVERGED = 1e-7
"""After a move this small the next one, which is taken without a look, reaches the last bit: moves e, then C e^2."""
TRUSTED = 0.2
"""Of the load: where a larger step fails the guess may be to blame, and the load is tried again."""
LEAP, LEAP_IN_CONTACT = 1.5, 2.5
"""A minimum that is larger by this (in any component, y being of order one) than the last one, or than the first guess,
may be on another branch, behind the largest load: the load step is cut. So it is where the way there leads twice as
far. Contact bends y into shapes that the first guess knows nothing of, and keeps it from leaping far."""
TRUSTED_LEAP = 0.02
"""As TRUSTED, where a step has led so far: nothing says that there is no minimum nearby."""
DOUBTED = 1 / 64
"""Nearer to the least load at which none was found than this part of the distance from which it was tried, it is tried
again: what was too far for Newton's method was taken for a largest load."""
FINEST = 3e-7
"""Load steps below this part of the load count as none: the load has passed its largest value."""
PATIENCE = 40
"""Steps at one load. 3 to 10 are needed; where the load has just passed its largest value Newton's method halves its
distance to a point that is no minimum, and would go on so."""
MAX_EVALUATIONS = 600
BLOCK = 1024
"""Members of a batch that are at work at once, where they are not solved one after the other: the Hessian of each takes
half a megabyte to make."""


class Minimum(NamedTuple):
    """Where a minimisation ended."""

    y: Vector
    load: Scalar
    """Of the last equilibrium that was met."""
    slope: Vector
    """Change of y per load."""
    touching: Bool[Array, ""]
    """As in Expansion, there."""
    reached: Bool[Array, ""]
    """Whether that is the load that was asked for."""
    lost: Bool[Array, ""]
    """Whether no minimum was left at a higher load (and it was not merely given up)."""
    evaluations: Int[Array, ""]


class _State(NamedTuple):
    kept: Vector
    """The last equilibrium."""
    kept_load: Scalar
    slope: Vector
    touching: Bool[Array, ""]
    base: Vector
    """The last accepted point."""
    move: Vector
    """The step from there."""
    part: Scalar
    """Of the step that is tried."""
    energy: Scalar
    """At base; inf where it is not known (a new load)."""
    promise: Scalar
    """Slope of the energy along the step."""
    load: Scalar
    ceiling: Scalar
    """The least load at which none was found; inf before."""
    room: Scalar
    """How far that was from the last equilibrium when it was tried."""
    trials: Int[Array, ""]
    """At this load."""
    active: Bool[Array, ""]
    reached: Bool[Array, ""]
    lost: Bool[Array, ""]
    count: Int[Array, ""]


def minimise(
    expansion: Callable[[Any, Vector, Scalar], Expansion],
    args: Any,
    start: Vector,
    start_load: Scalar,
    guess: Vector,
    load: Scalar,
    largest_step: Scalar | float,
) -> Minimum:
    """Follow the minimum from (start, start_load) to `load`.

    Every point that is accepted has a positive definite Hessian and less energy than the one before: the basin of a
    minimum that exists is never left, and where none exists the steps shrink on its rim and the load step is cut, as it
    is where one is found that is much larger (LEAP).

    expansion: of the energy at (args, y, load), without traced values of its own. start: a minimum at start_load.
    guess: of the one at `load`. largest_step: of the load.
    """
    span = jnp.abs(load - start_load)
    safe = jnp.where(span > 0, load - start_load, 1.0)
    zero, no, none = jnp.zeros_like(load), jnp.asarray(False), jnp.asarray(0)
    yes, unknown = jnp.asarray(True), jnp.full_like(load, jnp.inf)
    numbers = zero, zero, zero, zero, unknown, zero
    state = _State(start, start_load, start, no, start, start, *numbers, none, yes, no, no, none)
    largest = zero + largest_step
    begun = _towards(start, start_load, (guess - start) / safe, largest, state, load)
    end = in_blocks(_busy, _iteration(expansion), begun, (args, load, largest), block=BLOCK)
    return Minimum(end.kept, end.kept_load, end.slope, end.touching, end.reached, end.lost, end.count)


def _busy(state: _State) -> Bool[Array, ""]:
    return state.active & (state.count < MAX_EVALUATIONS)


def _towards(kept: Vector, kept_load: Scalar, slope: Vector, step: Scalar, state: _State, load: Scalar) -> _State:
    """Set out from an equilibrium to the next load."""
    step = jnp.clip(load - kept_load, -jnp.abs(step), jnp.abs(step))
    last = jnp.abs(load - kept_load) <= jnp.abs(step)
    return state._replace(
        kept=kept,
        kept_load=kept_load,
        slope=slope,
        base=kept,
        move=step * slope,
        part=jnp.ones_like(load),
        energy=jnp.full_like(load, jnp.inf),
        load=jnp.where(last, load, kept_load + step),
        trials=jnp.zeros_like(state.trials),
    )


@in_turn
def _downhill(hessian: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """hessian @ x = right; not a number where it is not positive definite."""
    return cho_solve((jnp.linalg.cholesky(hessian), True), right)


def _iteration(expansion: Callable[[Any, Vector, Scalar], Expansion]) -> Callable[[_State, Any], _State]:
    """One expansion of the energy, and what follows from it."""

    def iterate(state: _State, context: Any) -> _State:
        args, load, largest_step = context
        one = jnp.ones_like(load)
        state = state._replace(trials=state.trials + 1, count=state.count + 1)
        trial = state.base + state.part * state.move
        x = expansion(args, trial, state.load)
        step, slope = _downhill(x.hessian, jnp.stack([-x.gradient, -x.by_load], axis=1)).T
        size = largest(jnp.abs(step))
        definite = jnp.all(jnp.isfinite(step)) & jnp.isfinite(x.value)
        falls = x.value <= state.energy + DECREASE * state.part * state.promise + ROUNDING * (1 + jnp.abs(x.value))
        taken = definite & falls
        converged = taken & (size < CONVERGED)
        first = state.kept_load == 0
        known = largest(jnp.abs(state.kept + jnp.where(first, state.load, 0.0) * state.slope))
        leap = jnp.where(x.touching, LEAP_IN_CONTACT, LEAP) * jnp.where(converged, 1.0, 2.0)
        leapt = taken & (largest(jnp.abs(trial)) > known + leap)

        onward = state._replace(base=trial, move=step, part=one, energy=x.value, promise=x.gradient @ step)
        moved = select(taken, onward, state._replace(part=SHORTER * state.part))

        # No way ahead: back to the last equilibrium, and a smaller load step. Without load there may be no stiffness: a
        # part of the first step leads to nowhere, and says nothing of a largest load.
        nowhere = ~definite & first & (state.trials == 1)
        step_back = NEARER * (state.load - state.kept_load)
        small = jnp.abs(state.load - state.kept_load) <= jnp.where(leapt, TRUSTED_LEAP, TRUSTED)
        end = small & ~nowhere
        back = _towards(state.kept, state.kept_load, state.slope, step_back, state, load)._replace(
            ceiling=jnp.where(end, state.load, state.ceiling),
            room=jnp.where(end, jnp.abs(state.load - state.kept_load), state.room),
        )
        passed = jnp.abs(step_back) <= FINEST * jnp.abs(load)
        back = back._replace(active=~passed, lost=passed)
        stuck = nowhere | (~taken & (state.part * SHORTER < SHORTEST)) | (state.trials >= PATIENCE)

        # An equilibrium: the next load, or the end.
        there = state.load == load
        change = state.load - state.kept_load
        left = jnp.abs(state.ceiling - state.load)
        ceiling = jnp.where(left < DOUBTED * state.room, jnp.inf, state.ceiling)
        ahead = jnp.minimum(2 * jnp.abs(change), NEARER * jnp.abs(ceiling - state.load))
        arrived = _towards(trial + step, state.load, slope, jnp.minimum(ahead, largest_step), state, load)
        arrived = arrived._replace(touching=x.touching, active=~there, reached=there, ceiling=ceiling)
        return select(converged & ~leapt, arrived, select(stuck | leapt, back, moved))

    return iterate
