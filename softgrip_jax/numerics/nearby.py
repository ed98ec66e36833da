"""A root and what is observed there, from a root nearby: for searches, which ask thousands of times.

When a parameter moves a little the root moves along. From where the slope at the root before leads (Euler's predictor),
and with the inverse of the Jacobian there, a few evaluations lead to the new one (the chord method: Newton's with a
Jacobian that is kept); one Jacobian there, by the unknowns and by the parameters, then gives the last correction, every
derivative, and what the next root begins with. Optimistix has the chord method too, within one solve: it does not hand
its Jacobian on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .continuation.newton import value_and_jacobian
from .small_linear import solve_and_sign

Equations = Callable[[Array, Array], tuple[Array, Array]]
"""(u, t) -> residual, of the size of u, and what is observed; traced values come through u and t alone."""

CHORDS = 12
"""Moves with a kept Jacobian at most: where more are needed a new one is worth its price."""
CONTRACTION = 0.5
"""Moves must shrink at least this much, or the Jacobian is too old."""
NEAR = 1e-7
"""A move below this, relative, is the last: with the Jacobian of the place itself it is squared."""

LAST = 1e-9
"""A move below this is the last where no Jacobian at the root follows: the error left is smaller than the move."""


class Known(NamedTuple):
    """A root as a place to begin from."""

    u: Float[Array, " n"]
    inverse: Float[Array, "n n"]
    """Of the Jacobian by u; zeros where it is not known."""
    side: Float[Array, ""]
    """The sign of the Jacobian's determinant, which is the same along a branch; 0 where it is not known."""
    t: Float[Array, " m"]
    """The parameters of this root."""
    moved: Float[Array, "n m"]
    """How the root moves with them; zeros where it is not known."""


class Nearby(NamedTuple):
    """What was found."""

    observed: Float[Array, " q"]
    slopes: Float[Array, "q m"]
    """Of what is observed, by t: the root moves along."""
    known: Known
    good: Bool[Array, ""]
    """Whether it is a root, to rounding, and on the same side as the one it came from."""
    count: Int[Array, ""]
    """Evaluations without derivatives."""


def known_root(u: Float[Array, " n"], t: Float[Array, " m"]) -> Known:
    """A root at parameters t of which nothing else is known yet."""
    n, zero = len(u), jnp.zeros((), u.dtype)
    return Known(u, jnp.zeros((n, n), u.dtype), zero, t, jnp.zeros((n, len(t)), u.dtype))


def root_nearby(equations: Equations, t: Float[Array, " m"], known: Known) -> Nearby:
    """The root of equations(u, t)[0] near a known one. What is not good may be tried again from where it ended."""
    u, _, count = _by_chords(equations, t, known, NEAR)
    # Apart: along u nothing moves of what depends on t alone, which is most of what there is to differentiate.
    (residual, observed), (by_u, seen_by_u) = value_and_jacobian(lambda u: equations(u, t), u)
    _, (by_t, seen_by_t) = value_and_jacobian(lambda t: equations(u, t), t)
    inverse, side = solve_and_sign(by_u, jnp.eye(len(u), dtype=t.dtype))
    move, moved = -inverse @ residual, -inverse @ by_t
    size = jnp.max(jnp.abs(move) / (1 + jnp.abs(u)))
    good = (size <= NEAR) & ((known.side == 0) | (side == known.side))
    root = Known(u + move, inverse, side, t, moved)
    return Nearby(observed + seen_by_u @ move, seen_by_t + seen_by_u @ moved, root, good, count)


def root_by_chords(
    equations: Equations, t: Float[Array, " m"], known: Known
) -> tuple[Float[Array, " q"], Float[Array, " n"], Bool[Array, ""]]:
    """(what is observed, the root, whether it is one) with the Jacobian of the known root alone, without derivatives.

    The last move is below LAST. Where moves shrink by CONTRACTION each, the eigenvalues of the kept inverse times the
    Jacobian at the root are within CONTRACTION of 1 (in all directions that the moves have), so that the determinant
    has the sign that it has at the known root.
    """
    u, size, _ = _by_chords(equations, t, known, LAST)
    # A state whose Jacobian is not known (zeros) does not move, and is no root.
    good = (size <= LAST) & (known.side != 0)
    return equations(u, t)[1], u, good


def _by_chords(
    equations: Equations, t: Float[Array, " m"], known: Known, enough: float
) -> tuple[Float[Array, " n"], Float[Array, ""], Int[Array, ""]]:
    """(unknowns, size of the last move, moves) while the moves shrink and are above `enough`."""

    def chord(state):
        u, last, _, count = state
        move = known.inverse @ equations(u, t)[0]
        size = jnp.max(jnp.abs(move) / (1 + jnp.abs(u)))
        shrinks = size <= CONTRACTION * last
        return jnp.where(shrinks, u - move, u), size, shrinks & (size > enough), count + 1

    predicted = known.u + known.moved @ (t - known.t)
    start = (predicted, jnp.full((), jnp.inf, t.dtype), jnp.asarray(True), jnp.asarray(0))
    u, size, _, count = lax.while_loop(lambda state: state[2] & (state[3] < CHORDS), chord, start)
    return u, size, count
