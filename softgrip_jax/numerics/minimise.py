"""Minima of an energy under g(y) >= 0, followed as the load grows.

An equilibrium is a minimum of energy(y, load) with multipliers l >= 0, zero where g > 0. Far from it the augmented
Lagrangian

    energy + sum of weight ((max(0, l - rho g))^2 - l^2) / (2 rho)

is minimised by Newton's method with a line search, l held; near it y and l move together by Newton's method for both
(a primal-dual active set, l - rho g > 0). What is found does not depend on rho, and constraints are met exactly.

One loop does everything, one expansion of the energy in its body: both kinds of steps and the steps of the load.
Nothing waits for another stage, and the energy is compiled once. No derivatives pass through (see implicit.implicit).

Libraries that were looked at: optimistix minimises without constraints. JAXopt has bounds, quadratic programs and
projections, but no inequalities of any shape, and is no longer maintained. SciPy's SLSQP and trust-constr are not
compiled or batched with the energy. None of them stays with one minimum while a load grows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float, Int

from .choice import select

Vector = Float[Array, " n"]
Multipliers = Float[Array, " k"]
Scalar = Float[Array, ""]


class Expansion(NamedTuple):
    """Of the augmented Lagrangian at (y, multipliers, load)."""

    value: Scalar
    gradient: Vector
    hessian: Float[Array, "n n"]
    by_load: Vector
    """d gradient / d load."""
    gaps: Float[Array, " k"]
    slopes: Float[Array, "k n"]
    """d gaps / dy."""
    pressed: Float[Array, " k"]
    """max(0, multipliers - rho gaps)."""
    weights: Float[Array, " k"]


DECREASE = 1e-4
"""A step is taken where the energy falls by at least this part of what its slope promises (Armijo)."""
ROUNDING = 1e-13
"""Relative rounding of an energy that is a sum over many points."""
SHORTER = 0.3
SHORTEST = 1e-4
"""Steps are cut by SHORTER until they are accepted; below SHORTEST of a Newton step there is no minimum ahead."""
NEARER = 0.4
"""Of the way to a load without a minimum: the next load step. Failures cost more than steps."""
NEAR = 0.3
"""Newton's method for y and multipliers takes over where its step is this small, y being of order one ..."""
TRIES = 12
"""... for this many steps. Where contact points still come and go then, the multipliers are held again, and improved
only where the minimum is known as well as HELD."""
HELD = 1e-3
SETTLED = 1e-7
"""After a move this small the next one, which is taken without a look, reaches the last bit: moves e, then C e^2."""
TRUSTED = 0.2
"""Of the load: where a larger step fails the guess may be to blame, and the load is tried again."""
LEAP, LEAP_IN_CONTACT = 1.5, 2.5
"""A minimum that is larger by this (in any component, y being of order one) than the last one, or than the first guess,
may be on another branch, behind the largest load: the load step is cut. So it is where the way there leads twice as
far. Contact bends y into shapes that the first guess knows nothing of, and keeps it from leaping far."""
TRUSTED_LEAP = 0.02
"""As TRUSTED, where a step has led so far: nothing says that there is no minimum nearby."""
FINEST = 3e-7
"""Load steps below this part of the load count as none: the load has passed its largest value."""
PATIENCE = 40
"""Steps at one load. 3 to 10 are needed; where the load has just passed its largest value Newton's method halves its
distance to a point that is no minimum, and would go on so."""
MAX_EVALUATIONS = 600


class Minimum(NamedTuple):
    """Where a minimisation ended."""

    y: Vector
    multipliers: Multipliers
    load: Scalar
    """Of the last equilibrium that was met."""
    slope: tuple[Vector, Multipliers]
    """Its change (of y and multipliers) per load."""
    reached: Bool[Array, ""]
    """Whether that is the load that was asked for."""
    lost: Bool[Array, ""]
    """Whether no minimum was left at a higher load (and it was not merely given up)."""
    evaluations: Int[Array, ""]


class _State(NamedTuple):
    kept: tuple[Vector, Multipliers]
    """The last equilibrium: y and multipliers."""
    kept_load: Scalar
    slope: tuple[Vector, Multipliers]
    base: Vector
    """The last accepted point."""
    move: Vector
    """The step from there."""
    part: Scalar
    """Of the step that is tried."""
    multipliers: Multipliers
    energy: Scalar
    """At base; inf where it is not known (a new load, new multipliers)."""
    promise: Scalar
    """Slope of the energy along the step."""
    together: Int[Array, ""]
    """Newton steps for y and multipliers since the last one with held multipliers."""
    wary: Bool[Array, ""]
    """Whether those steps have failed at this load."""
    fallback: tuple[Vector, Multipliers]
    """Where the last step with held multipliers ended, and improved multipliers."""
    load: Scalar
    ceiling: Scalar
    """The least load at which none was found; inf before."""
    trials: Int[Array, ""]
    """At this load."""
    active: Bool[Array, ""]
    reached: Bool[Array, ""]
    lost: Bool[Array, ""]
    count: Int[Array, ""]


class _Steps(NamedTuple):
    held: Vector
    """Of y, multipliers held."""
    y: Vector
    multipliers: Multipliers
    """The step of y and the new multipliers, together."""
    slope: tuple[Vector, Multipliers]
    """Of the equilibrium, per load."""
    change: Scalar
    """Of the multipliers, the largest."""


def _newton(x: Expansion, multipliers: Multipliers) -> _Steps:
    """All Newton steps from one factorisation of the Hessian and one of what it leaves to the closed gaps."""
    factor = jnp.linalg.cholesky(x.hessian), True
    if not x.gaps.size:
        step = cho_solve(factor, jnp.stack([-x.gradient, -x.by_load], axis=1)).T
        return _Steps(step[0], step[0], multipliers, (step[1], multipliers), jnp.zeros_like(x.value))
    closed = x.pressed > 0
    slopes = jnp.where(closed[:, None], x.slopes, 0.0)
    right = jnp.concatenate([jnp.stack([-x.gradient, -x.by_load]), slopes]).T
    solved = cho_solve(factor, right)
    held, loaded, spread = solved[:, 0], solved[:, 1], solved[:, 2:]
    # Forces on the closed gaps that keep them closed; an open one has a one on the diagonal and no force.
    small = slopes @ spread + jnp.diag(jnp.where(closed, 0.0, 1.0))
    wanted = jnp.stack([jnp.where(closed, -x.gaps, 0.0) - slopes @ held, -(slopes @ loaded)], axis=1)
    forces = cho_solve((jnp.linalg.cholesky(small), True), wanted)
    moved = spread @ forces
    pushed = forces / x.weights[:, None]
    changed = jnp.where(closed, multipliers + pushed[:, 0], 0.0)
    return _Steps(
        held, held + moved[:, 0], changed, (loaded + moved[:, 1], pushed[:, 1]), jnp.max(jnp.abs(changed - multipliers))
    )


def minimise(
    expansion: Callable[[Vector, Multipliers, Scalar], Expansion],
    start: tuple[Vector, Multipliers],
    start_load: Scalar,
    guess: tuple[Vector, Multipliers],
    load: Scalar,
    largest_step: Scalar | float,
) -> Minimum:
    """Follow the minimum from (start, start_load) to `load`.

    With held multipliers every point that is accepted has a positive definite Hessian and less energy than the one
    before: the basin of a minimum that exists is never left, and where none exists the steps shrink on its rim and the
    load step is cut, as it is where one is found that is much larger (LEAP).

    expansion: of the augmented Lagrangian at (y, multipliers, load). start: y and multipliers of a minimum at
    start_load. guess: of those at `load`. largest_step: of the load.
    """
    span = jnp.abs(load - start_load)
    safe = jnp.where(span > 0, load - start_load, 1.0)
    zero, no, none = jnp.zeros_like(load), jnp.asarray(False), jnp.asarray(0)
    unknown, one = jnp.full_like(load, jnp.inf), jnp.ones_like(load)

    def towards(kept, kept_load: Scalar, slope, step: Scalar, state: _State) -> _State:
        """Set out from an equilibrium to the next load."""
        step = jnp.clip(load - kept_load, -jnp.abs(step), jnp.abs(step))
        last = jnp.abs(load - kept_load) <= jnp.abs(step)
        multipliers = jnp.maximum(0.0, kept[1] + step * slope[1])
        return state._replace(
            kept=kept,
            kept_load=kept_load,
            slope=slope,
            base=kept[0],
            move=step * slope[0],
            part=one,
            multipliers=multipliers,
            energy=unknown,
            promise=zero,
            together=none,
            wary=no,
            load=jnp.where(last, load, kept_load + step),
            trials=none,
        )

    def body(state: _State) -> _State:
        state = state._replace(trials=state.trials + 1, count=state.count + 1)
        trial = state.base + state.part * state.move
        x = expansion(trial, state.multipliers, state.load)
        steps = _newton(x, state.multipliers)
        size = jnp.max(jnp.abs(steps.y))
        definite = jnp.all(jnp.isfinite(steps.y)) & jnp.isfinite(x.value)
        falls = x.value <= state.energy + DECREASE * state.part * state.promise + ROUNDING * (1 + jnp.abs(x.value))
        holding = state.together == 0
        taken = definite & jnp.where(holding, falls, (size < NEAR) & (state.together < TRIES))
        settled = taken & (size < SETTLED) & (steps.change < SETTLED)
        first = state.kept_load == 0
        known = jnp.max(jnp.abs(state.kept[0] + jnp.where(first, state.load, 0.0) * state.slope[0]))
        leap = jnp.where(jnp.any(x.pressed > 0), LEAP_IN_CONTACT, LEAP) * jnp.where(settled, 1.0, 2.0)
        leapt = taken & (jnp.max(jnp.abs(trial)) > known + leap)

        # Near: y and multipliers together, from where it is safe to return to.
        both = state._replace(
            base=trial,
            move=steps.y,
            part=one,
            multipliers=steps.multipliers,
            together=state.together + 1,
            fallback=select(holding, (trial, x.pressed), state.fallback),
        )
        again = state._replace(
            base=state.fallback[0],
            move=jnp.zeros_like(trial),
            part=one,
            multipliers=state.fallback[1],
            energy=unknown,
            promise=zero,
            together=none,
            wary=~no,
        )
        improved = again._replace(base=trial, multipliers=x.pressed, wary=state.wary)
        onward = state._replace(base=trial, move=steps.held, part=one, energy=x.value, promise=x.gradient @ steps.held)
        shorter = state._replace(part=SHORTER * state.part)
        settling = jnp.max(jnp.abs(steps.held)) < HELD
        near = (size < NEAR) & (settling | ~state.wary)
        held = select(taken, select(near, both, select(settling, improved, onward)), shorter)
        moved = select(holding, held, select(taken, both, again))

        # No way ahead: back to the last equilibrium, and a smaller load step.
        step = NEARER * (state.load - state.kept_load)
        small = jnp.abs(state.load - state.kept_load) <= jnp.where(leapt, TRUSTED_LEAP, TRUSTED)
        ceiling = jnp.where(small, state.load, state.ceiling)
        back = towards(state.kept, state.kept_load, state.slope, step, state)._replace(ceiling=ceiling)
        passed = jnp.abs(step) <= FINEST * jnp.abs(load)
        back = back._replace(active=~passed, lost=passed)
        stuck = (holding & ~taken & (state.part * SHORTER < SHORTEST)) | (state.trials >= PATIENCE)

        # An equilibrium: the next load, or the end.
        found = trial + steps.y, steps.multipliers
        there = state.load == load
        change = state.load - state.kept_load
        step = jnp.minimum(2 * jnp.abs(change), NEARER * jnp.abs(state.ceiling - state.load))
        arrived = towards(found, state.load, steps.slope, jnp.minimum(step, largest_step), state)
        arrived = arrived._replace(active=~there, reached=there)
        return select(settled & ~leapt, arrived, select(stuck | leapt, back, moved))

    def busy(state: _State) -> Bool[Array, ""]:
        return state.active & (state.count < MAX_EVALUATIONS)

    state = _State(
        start, start_load, start, start[0], start[0], zero, start[1], zero, zero, none, no, start, zero, unknown, none,
        jnp.asarray(True), no, no, none,
    )  # fmt: skip
    slope = (guess[0] - start[0]) / safe, (guess[1] - start[1]) / safe
    state = lax.while_loop(busy, body, towards(start, start_load, slope, zero + largest_step, state))
    return Minimum(*state.kept, state.kept_load, state.slope, state.reached, state.lost, state.count)
