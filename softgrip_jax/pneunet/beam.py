"""The cover of the finger: a plane-strain hyperelastic beam with an active moment per part, by shooting.

Along the reference length X (thesis 2.3, 4.4; signs as in `finger_scene`):

    theta' and lambda from the section law at (M, N),   M = M_ext + M_active,   N = P cos(theta) + Q sin(theta)
    M_ext' = lambda (P sin(theta) - Q cos(theta)),   x' = lambda cos(theta),   y' = lambda sin(theta)
    P = P_tip + g_x (L - X),   Q = Q_tip + g_y (L - X)

Everything here is a pure number: s = X/L, lengths by L, forces by mu B H, moments by mu B H^2, slenderness = H/L.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..numerics.shooting import Steps, adaptive, fixed_steps
from .section import SectionLaw

Scalar = Float[Array, ""]


class State(NamedTuple):
    """The beam at one place: angle, external moment, position, and the section's own state.

    The section's state is carried along, by the law's rates, instead of being solved for at every place; so are the
    cosine and the sine of the angle, whose rates are multiplications.
    """

    theta: Scalar
    cosine: Scalar
    sine: Scalar
    moment: Scalar
    x: Scalar
    y: Scalar
    z: Scalar
    """H theta'."""
    stretch: Scalar


class Loads(NamedTuple):
    """Tip forces and weight along x and y, over mu B H (weight: times L)."""

    p_tip: Scalar
    q_tip: Scalar
    g_x: Scalar
    g_y: Scalar


class Cover(NamedTuple):
    """What the beam equations need to know."""

    slenderness: Scalar
    """H / L."""
    law: SectionLaw
    loads: Loads


def beginning(theta: Scalar, moment: Scalar) -> State:
    """The state in the origin with this angle and external moment; the section's own is found by `entered`."""
    zero = jnp.zeros_like(theta)
    return State(theta, jnp.cos(theta), jnp.sin(theta), moment, zero, zero, zero, zero)


def forces(cover: Cover, s: Scalar) -> tuple[Scalar, Scalar]:
    """(P, Q) at s."""
    loads, rest = cover.loads, 1 - s
    return loads.p_tip + loads.g_x * rest, loads.q_tip + loads.g_y * rest


def section_loads(cover: Cover, s: Scalar, state: State, active: Scalar) -> tuple[Scalar, Scalar]:
    """(m, n) on the section at s."""
    p, q = forces(cover, s)
    return state.moment + active, p * state.cosine + q * state.sine


def entered(cover: Cover, s: Scalar, state: State, active: Scalar) -> State:
    """The state at s with the section's state under M and N: where a part begins, its active moment jumps."""
    z, stretch = cover.law(*section_loads(cover, s, state, active))
    return state._replace(z=z, stretch=stretch)


def settled(s: Scalar, state: State, args: tuple[Cover, Scalar]) -> State:
    """The state at s with the section's state corrected by one Newton step: what was carried along has strayed a
    little from the law, and the more the nearer the inner fibre is to its end."""
    cover, active = args
    m, n = section_loads(cover, s, state, active)
    held_m, held_n = cover.law.loads(state.z, state.stretch)
    dz, dstretch = cover.law.rates(m, state.z, state.stretch, m - held_m, n - held_n)
    return state._replace(z=state.z + dz, stretch=state.stretch + dstretch)


def slopes(s: Scalar, state: State, args: tuple[Cover, Scalar]) -> State:
    """d(state)/ds."""
    cover, active = args
    p, q = forces(cover, s)
    turn = state.z / cover.slenderness
    across = p * state.sine - q * state.cosine
    dm = state.stretch * across / cover.slenderness
    dn = -across * turn - cover.loads.g_x * state.cosine - cover.loads.g_y * state.sine
    dz, dstretch = cover.law.rates(state.moment + active, state.z, state.stretch, dm, dn)
    dx, dy = state.stretch * state.cosine, state.stretch * state.sine
    return State(turn, -state.sine * turn, state.cosine * turn, dm, dx, dy, dz, dstretch)


class Part(NamedTuple):
    """A piece of the beam between two places, with whatever its active moment depends on."""

    low: Scalar
    high: Scalar
    chamber: Any


class Shot(NamedTuple):
    """A beam integrated part by part."""

    starts: State
    """States where every part begins, shape (parts,)."""
    ends: State
    """States at the end of every part, shape (parts,)."""
    states: State | None
    """States after every step, shape (parts, steps); None where the number of steps is not known beforehand."""
    active: Float[Array, " parts"]
    """The active moment of every part."""


def run_part(cover: Cover, state: State, part: Part, active: Scalar, steps: Steps) -> tuple[State, State, State | None]:
    """(state at the beginning, at the end, and after every step of a part) under a constant active moment."""
    start = entered(cover, part.low, state, active)
    return start, *fixed_steps(slopes, start, (cover, active), part.low, part.high, steps, settled)


def shoot(
    cover: Cover, start: State, parts: Part, active: Float[Array, " parts"], steps: Steps, restarts: State | None
) -> Shot:
    """Integrate all parts (leaves of `parts` have a leading axis) with their active moments from the state at s = 0.

    restarts: states at the beginning of every part but the first, for multiple shooting: the parts then do not depend
    on each other and run side by side, and that ends meet restarts is the caller's equation.
    """

    def integrate(state: State, part: tuple[Part, Scalar]):
        begin, end, states = run_part(cover, state, *part, steps)
        return end, Shot(begin, end, states, part[1])

    if restarts is None:
        return lax.scan(integrate, start, (parts, active))[1]
    starts = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, restarts)
    return jax.vmap(integrate)(starts, (parts, active))[1]


def reference_shot(cover: Cover, start: State, part: Part, active: Scalar, tolerance: float) -> State:
    """The end of one part by adaptive steps: what the fixed steps are measured against."""
    begin = entered(cover, part.low, start, active)
    return adaptive(slopes, begin, (cover, active), part.low, part.high, tolerance)
