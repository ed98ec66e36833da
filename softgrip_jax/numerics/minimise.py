"""Minima of an energy under a growing load, and under constraints by an augmented Lagrangian.

One loop does everything, one evaluation of energy, gradient and Hessian in its body: Newton steps, their line search,
load steps, and the rounds of the augmented Lagrangian. Lanes of a batch are then never kept waiting inside a stage,
and the functional is compiled once. No derivatives pass through (see roots.implicit).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float, Int

from .roots import select

Vector = Float[Array, " n"]
Scalar = Float[Array, ""]
Expansion = Callable[[Vector, Scalar, Any], tuple[Scalar, Vector, Float[Array, "n n"]]]
"""(y, load, multipliers) -> energy, its gradient and its Hessian by y."""

DECREASE = 1e-4
"""A step is taken where the energy falls by at least this part of what its slope promises (Armijo)."""
ROUNDING = 1e-13
"""Relative rounding of an energy that is a sum over hundreds of points."""
SHORTER = 0.3
SHORTEST = 1e-4
"""Steps are cut by SHORTER until they are accepted; below SHORTEST of a Newton step there is no minimum ahead."""
NEARER = 0.4
"""Of the way to a load without a minimum: the next load step. Failures cost more than steps."""
SETTLED = 1e-7
"""After a move this small the next one, which is taken without a look, reaches the last bit: moves e, then C e^2."""
FINEST = 1e-5
"""Load steps below this part of the load count as none: the load has passed its largest value."""
PATIENCE = 15
"""Steps at one load. Newton's method needs 3 to 8; where the load has just passed its largest value it halves its
distance to a point that is no minimum, and would go on so."""
MAX_EVALUATIONS = 400


class Minimum(NamedTuple):
    """Where a minimisation ended."""

    rounds: Float[Array, "k n"]
    """y of every round of the augmented Lagrangian, the first one without multipliers."""
    kept: Vector
    """The last equilibrium of the first round that was met."""
    load: Scalar
    """Its load."""
    reached: Bool[Array, ""]
    """Whether that is the load that was asked for, all rounds done."""
    lost: Bool[Array, ""]
    """Whether no minimum was left at a higher load (and it was not merely given up)."""
    evaluations: Int[Array, ""]


class _State(NamedTuple):
    kept: Vector
    """The last equilibrium of the first round."""
    kept_load: Scalar
    slope: Vector
    """Its change per load, by the last two."""
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
    trials: Int[Array, ""]
    """At this load and round."""
    round: Int[Array, ""]
    rounds: Float[Array, "k n"]
    multipliers: Any
    active: Bool[Array, ""]
    reached: Bool[Array, ""]
    lost: Bool[Array, ""]
    count: Int[Array, ""]


def minimise(
    expansion: Expansion,
    update: Callable[[Vector, Scalar, Any], Any],
    multipliers: Any,
    rounds: int,
    start: Vector,
    start_load: Scalar,
    guess: Vector,
    load: Scalar,
    largest_step: float,
) -> Minimum:
    """Follow the minimum from (start, start_load) to `load`, then improve the multipliers `rounds` - 1 times.

    Every point that is accepted has a positive definite Hessian and less energy than the one before. The basin of a
    minimum that exists is never left so; where none exists the steps shrink on its rim, and the load step is cut.

    expansion: the energy with its derivatives. update: multipliers after a round. multipliers: those of the first
    round. start: a minimum at start_load. guess: a guess of the minimum at `load`. largest_step: of the load.
    """
    span = jnp.abs(load - start_load)
    safe = jnp.where(span > 0, load - start_load, 1.0)
    zero = jnp.zeros_like(load)
    largest = zero + largest_step

    def towards(kept: Vector, kept_load: Scalar, slope: Vector, step: Scalar, state: _State) -> _State:
        """Set out from an equilibrium to the next load."""
        step = jnp.clip(load - kept_load, -jnp.abs(step), jnp.abs(step))
        return state._replace(
            kept=kept,
            kept_load=kept_load,
            slope=slope,
            base=kept,
            move=step * slope,
            part=jnp.ones_like(load),
            energy=jnp.full_like(load, jnp.inf),
            promise=zero,
            load=kept_load + step,
            trials=jnp.zeros_like(state.trials),
        )

    def body(state: _State) -> _State:
        state = state._replace(trials=state.trials + 1)
        trial = state.base + state.part * state.move
        energy, gradient, hessian = expansion(trial, state.load, state.multipliers)
        factor = jnp.linalg.cholesky(hessian)
        newton = -cho_solve((factor, True), gradient)
        definite = jnp.all(jnp.isfinite(newton)) & jnp.isfinite(energy)
        noise = ROUNDING * (1 + jnp.abs(energy))
        falls = energy <= state.energy + DECREASE * state.part * state.promise + noise
        taken = definite & falls
        size = jnp.max(jnp.abs(newton))
        settled = taken & (size < SETTLED)

        onward = state._replace(
            base=trial, move=newton, part=jnp.ones_like(load), energy=energy, promise=gradient @ newton
        )
        shorter = state._replace(part=SHORTER * state.part)
        # No way ahead: back to the last equilibrium, and a smaller load step.
        step = NEARER * (state.load - state.kept_load)
        back = towards(state.kept, state.kept_load, state.slope, step, state)._replace(ceiling=state.load)
        passed = (jnp.abs(step) <= FINEST * jnp.abs(load)) & (state.round == 0)
        back = back._replace(active=(state.round == 0) & ~passed, lost=passed)
        stuck = (~taken & (state.part * SHORTER < SHORTEST)) | (state.trials >= PATIENCE)

        # An equilibrium: the next load, the next round, or the end.
        y = trial + newton
        stored = state._replace(rounds=state.rounds.at[state.round].set(y))
        there = state.load == load
        change = state.load - state.kept_load
        slope = jnp.where(change == 0, state.slope, (y - state.kept) / jnp.where(change == 0, 1.0, change))
        step = jnp.minimum(jnp.minimum(2 * jnp.abs(change), largest), NEARER * jnp.abs(state.ceiling - state.load))
        ahead = towards(y, state.load, slope, step, stored)
        last = there & (state.round == rounds - 1)
        first = there & (state.round == 0)
        again = stored._replace(
            kept=jnp.where(first, y, state.kept),
            kept_load=jnp.where(first, state.load, state.kept_load),
            base=y,
            move=jnp.zeros_like(y),
            part=jnp.ones_like(load),
            energy=jnp.full_like(load, jnp.inf),
            promise=zero,
            trials=jnp.zeros_like(state.trials),
            round=state.round + 1,
            multipliers=update(y, state.load, state.multipliers) if rounds > 1 else state.multipliers,
            active=~last,
            reached=last,
        )
        arrived = select(there, again, ahead)
        new = select(settled, arrived, select(stuck, back, select(taken, onward, shorter)))
        return new._replace(count=state.count + 1)

    def busy(state: _State) -> Bool[Array, ""]:
        return state.active & (state.count < MAX_EVALUATIONS)

    no, count = jnp.asarray(False), jnp.asarray(0)
    state = _State(
        kept=start,
        kept_load=start_load,
        slope=start,
        base=start,
        move=start,
        part=zero,
        energy=zero,
        promise=zero,
        load=zero,
        ceiling=zero + jnp.inf,
        trials=count,
        round=count,
        rounds=jnp.zeros((rounds, *start.shape), start.dtype),
        multipliers=multipliers,
        active=jnp.asarray(True),
        reached=no,
        lost=no,
        count=count,
    )
    slope = (guess - start) / safe
    state = towards(start, start_load, slope, largest, state)
    state = lax.while_loop(busy, body, state)
    return Minimum(state.rounds, state.kept, state.kept_load, state.reached, state.lost, state.count)
