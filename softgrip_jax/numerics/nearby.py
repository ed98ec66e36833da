"""A root and what is observed there, from a root nearby: for searches, which ask thousands of times.

When a parameter moves a little the root moves along. From where the slope at the root before leads (Euler's predictor),
and with the inverse of the Jacobian there, a few evaluations lead to the new one (the chord method: Newton's with a
Jacobian that is kept); one Jacobian there, by the unknowns and by the parameters, then gives the last correction, every
derivative, and what the next root begins with. Optimistix has the chord method too, within one solve: it does not hand
its Jacobian on.

Where a limit point is behind, there is no root. `fold_nearby` follows the limit point itself, which says by how much.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .choice import largest
from .continuation.limit_load import null_direction
from .continuation.newton import value_and_jacobian
from .small_linear import solve_and_renew, solve_and_sign

Equations = Callable[[Array, Array], tuple[tuple[Array, Array], Any]]
"""(u, t) -> (residual, of the size of u, and what is observed), what else is to be known there, without derivatives;
traced values come through u and t alone."""

CHORDS = 12
"""Moves with a kept Jacobian at most: where more are needed a new one is worth its price."""
CONTRACTION = 0.5
"""Moves must shrink at least this much, or the Jacobian is too old."""
NEAR = 1e-7
"""A move below this, relative, is the last: with the Jacobian of the place itself it is squared."""

KEPT = 2
"""Moves up to which the inverse serves the next root, too."""

LAST = 1e-9
"""A move below this is the last where no Jacobian at the root follows: the error left is smaller than the move."""


class Known(NamedTuple):
    """A root as a place to begin from."""

    u: Float[Array, " n"]
    inverse: Float[Array, "n n"]
    """Of the Jacobian by u, there or at a root that this one was found from; zeros where it is not known."""
    side: Float[Array, ""]
    """The sign of the Jacobian's determinant, which is the same along a branch; 0 where it is not known. Of what is not
    good it is that of the root that was asked for: another trial from there is no way to another branch."""
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
    told: Any
    """What else the equations say: before the last move, which is below NEAR where it is a root."""


def known_root(u: Float[Array, " n"], t: Float[Array, " m"]) -> Known:
    """A root at parameters t of which nothing else is known yet."""
    n, zero = len(u), jnp.zeros((), u.dtype)
    return Known(u, jnp.zeros((n, n), u.dtype), zero, t, jnp.zeros((n, len(t)), u.dtype))


def root_nearby(equations: Equations, t: Float[Array, " m"], known: Known) -> Nearby:
    """The root of equations(u, t)[0] near a known one. What is not good may be tried again from where it ended."""
    u, last, count = _by_chords(equations, t, known, NEAR)
    # Apart: along u nothing moves of what depends on t alone, which is most of what there is to differentiate.
    (residual, observed), (by_u, seen_by_u), told = value_and_jacobian(lambda u: equations(u, t), u, has_aux=True)
    _, (by_t, seen_by_t), _ = value_and_jacobian(lambda t: equations(u, t), t, has_aux=True)
    is_old = (known.side == 0) | (last > NEAR) | (count > KEPT)
    right = -jnp.concatenate([residual[:, None], by_t], axis=1)
    moves, side, inverse = solve_and_renew(by_u, right, known.inverse, is_old)
    move, moved = moves[:, 0], moves[:, 1:]
    is_root = largest(jnp.abs(move) / (1 + jnp.abs(u))) <= NEAR
    asked = jnp.where((known.side == 0) & is_root, side, known.side)
    root = Known(u + move, inverse, asked, t, moved)
    good = is_root & (side == asked)
    return Nearby(observed + seen_by_u @ move, seen_by_t + seen_by_u @ moved, root, good, count, told)


def root_by_chords(
    equations: Equations, t: Float[Array, " m"], known: Known
) -> tuple[Float[Array, " q"], Float[Array, " n"], Bool[Array, ""], Any]:
    """(what is observed, the root, whether it is one, what else the equations say there) with the Jacobian of the known
    root alone, without derivatives.

    The last move is below LAST. Where moves shrink by CONTRACTION each, the eigenvalues of the kept inverse times the
    Jacobian at the root are within CONTRACTION of 1 (in all directions that the moves have), so that the determinant
    has the sign that it has at the known root.
    """
    u, size, _ = _by_chords(equations, t, known, LAST)
    # A state whose Jacobian is not known (zeros) does not move, and is no root.
    good = (size <= LAST) & (known.side != 0)
    (_, observed), told = equations(u, t)
    return observed, u, good, told


def _by_chords(
    equations: Equations, t: Float[Array, " m"], known: Known, enough: float
) -> tuple[Float[Array, " n"], Float[Array, ""], Int[Array, ""]]:
    """(unknowns, size of the last move, moves) while the moves shrink and are above `enough`."""

    def chord(state):
        u, last, _, count = state
        (residual, _), _ = equations(u, t)
        move = known.inverse @ residual
        size = largest(jnp.abs(move) / (1 + jnp.abs(u)))
        shrinks = size <= CONTRACTION * last
        return jnp.where(shrinks, u - move, u), size, shrinks & (size > enough), count + 1

    predicted = known.u + known.moved @ (t - known.t)
    start = (predicted, jnp.full((), jnp.inf, t.dtype), jnp.asarray(True), jnp.asarray(0))
    u, size, _, count = lax.while_loop(lambda state: state[2] & (state[3] < CHORDS), chord, start)
    return u, size, count


FOLD_STEPS = 16
"""Steps towards a limit point at most: from a design nearby five or six are enough."""
LONGEST = 0.05
"""Of the first step along the path towards it, over the size of the unknowns."""
OFF, FARTHEST = 0.02, 0.3
"""A path that is farther away than this is sought first, in steps not longer than that; relative, too."""
ASIDE = 1e-3
"""The first step from a limit point of which nothing else is known, relative."""
FLAT = 1e-3
"""A tangent whose load component is below this is level."""
LEVEL = 1e-4
"""A step along the path below this, relative, is the last: the load there is right to the square of it."""


class KnownFold(NamedTuple):
    """A limit point as a place to begin from."""

    u: Float[Array, " n"]
    """The load last."""
    tangent: Float[Array, " n"]
    """Of the path, which is level there."""
    bend: Float[Array, ""]
    """How the tangent's load component falls along the path; zero where it is not known."""
    t: Float[Array, " m"]
    """The parameters of this limit point."""
    moved: Float[Array, "n m"]
    """How the path moves with them, across itself; the slope of the limit point's load last."""


def known_fold(u: Float[Array, " n"], t: Float[Array, " m"]) -> KnownFold:
    """A limit point at parameters t of which nothing else is known yet."""
    zero = jnp.zeros((), u.dtype)
    return KnownFold(u, jnp.zeros_like(u), zero, t, jnp.zeros((len(u), len(t)), u.dtype))


class _Way(NamedTuple):
    """The search for a limit point under way."""

    u: Float[Array, " n"]
    tangent: Float[Array, " n"]
    bend: Float[Array, ""]
    rise: Float[Array, ""]
    """The tangent's load component at the point before, from which this is `along` away."""
    along: Float[Array, ""]
    size: Float[Array, ""]
    """Of the last step over what ends the search."""
    count: Int[Array, ""]


def fold_nearby(
    residual: Callable[[Array, Array], Array], t: Float[Array, " m"], known: KnownFold
) -> tuple[KnownFold, Bool[Array, ""]]:
    """(the limit point of residual(u, t) = 0 near a known one, whether it is one); u[-1] is the load.

    Each step has one Jacobian, from which come Newton's move across the path, the path's tangent, and by the secant of
    its load component how far along the path that component is zero. Second derivatives, which Newton's method for the
    limit point needs, take minutes to compile for a finger. The load's slope with t is exact at the limit point.
    """
    n = len(known.u)

    def of_u(u):
        return residual(u, t)

    def look(u, row):
        """(Newton's move, the tangent, the inverse of [r_u; row])."""
        value, jacobian = value_and_jacobian(of_u, u)
        inverse, _ = solve_and_sign(jnp.concatenate([jacobian, row[None]]), jnp.eye(n, dtype=u.dtype))
        return inverse[:, :-1] @ value, inverse[:, -1] / jnp.linalg.norm(inverse[:, -1]), inverse

    def step(way):
        move, tangent, _ = look(way.u, way.tangent)
        scale, rise = 1 + jnp.linalg.norm(way.u), tangent[-1]
        secant = (rise - way.rise) / jnp.where(way.along == 0, 1.0, way.along)
        bend = jnp.where((way.along != 0) & (secant < 0), secant, way.bend)
        # Of a new one the bend is asked for by a step to the side.
        ahead = jnp.where(bend == 0, ASIDE * scale, -rise / jnp.where(bend == 0, 1.0, bend))
        longest = jnp.where(way.along == 0, LONGEST * scale, 2 * jnp.abs(way.along))
        off = jnp.linalg.norm(move)
        # First back to the path, then along it.
        along = jnp.where(off > OFF * scale, 0.0, jnp.clip(ahead, -longest, longest))
        size = jnp.maximum(off / NEAR, jnp.abs(along) / LEVEL) / scale
        u = way.u - move * jnp.minimum(1.0, FARTHEST * scale / off) + along * tangent
        return _Way(u, tangent, bend, rise, along, size, way.count + 1)

    def goes_on(way):
        return (way.size > 1) & (way.count < FOLD_STEPS)

    zero = jnp.zeros((), t.dtype)
    predicted = known.u + known.moved @ (t - known.t)
    is_new = jnp.all(known.tangent == 0)
    row = jnp.where(is_new, null_direction(value_and_jacobian(of_u, known.u)[1]), known.tangent)
    # A place of which nothing else is known is the limit point itself, of its own parameters.
    size = jnp.where(is_new & jnp.all(t == known.t), 0.0, jnp.inf)
    start = _Way(predicted, row, known.bend, zero, zero, size, jnp.asarray(0))
    way = lax.while_loop(goes_on, step, start)
    move, tangent, inverse = look(way.u, way.tangent)
    moved = -inverse[:, :-1] @ jax.jacfwd(lambda t: residual(way.u, t))(t)
    size = jnp.linalg.norm(move) / (1 + jnp.linalg.norm(way.u))
    good = (way.size <= 1) & (size <= NEAR) & (jnp.abs(tangent[-1]) <= FLAT) & jnp.all(jnp.isfinite(moved))
    return KnownFold(way.u - move, tangent, way.bend, t, moved), good
