"""The cover of the finger: a plane-strain hyperelastic beam with an active moment per part, by shooting.

Along the reference length X (thesis 2.3, 4.4; signs as in `finger_scene`):

    theta' and lambda from the section law at (M, N),   M = M_ext + M_active,   N = P cos(theta) + Q sin(theta)
    M_ext' = lambda (P sin(theta) - Q cos(theta)),   x' = lambda cos(theta),   y' = lambda sin(theta)
    P = P_tip + g_x (L - X),   Q = Q_tip + g_y (L - X)

Everything here is a pure number: s = X/L, lengths by L, forces by mu B H, moments by mu B H^2, slenderness = H/L.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..numerics.shooting import adaptive, fixed_steps
from .section import SectionLaw

Scalar = Float[Array, ""]


class State(NamedTuple):
    """The beam at one place: angle, external moment, position."""

    theta: Scalar
    moment: Scalar
    x: Scalar
    y: Scalar


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
    """(m, n) -> (H theta', lambda)."""
    loads: Loads


def section_state(cover: Cover, s: Scalar, state: State, active: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """(H theta', lambda, P, Q) at s."""
    loads, rest = cover.loads, 1 - s
    p, q = loads.p_tip + loads.g_x * rest, loads.q_tip + loads.g_y * rest
    z, stretch = cover.law(state.moment + active, p * jnp.cos(state.theta) + q * jnp.sin(state.theta))
    return z, stretch, p, q


def slopes(s: Scalar, state: State, args: tuple[Cover, Scalar]) -> State:
    """d(state)/ds."""
    cover, active = args
    sine, cosine = jnp.sin(state.theta), jnp.cos(state.theta)
    z, stretch, p, q = section_state(cover, s, state, active)
    return State(
        z / cover.slenderness,
        stretch * (p * sine - q * cosine) / cover.slenderness,
        stretch * cosine,
        stretch * sine,
    )


class Part(NamedTuple):
    """A piece of the beam between two places, with whatever its active moment depends on."""

    low: Scalar
    high: Scalar
    chamber: Any


class Shot(NamedTuple):
    """A beam integrated part by part."""

    ends: State
    """States at the end of every part, shape (parts,)."""
    states: State
    """States after every step, shape (parts, steps)."""
    active: Float[Array, " parts"]
    """The active moment of every part."""


ActiveMoment = Callable[[Cover, State, Part], Scalar]
"""The signed active moment of a part that begins in a state; it may depend on how far the part will turn."""


def run_part(cover: Cover, state: State, part: Part, active: Scalar, steps: int) -> tuple[State, State]:
    """(state at the end of a part, states after every step) under a constant active moment."""
    return fixed_steps(slopes, state, (cover, active), part.low, part.high, steps)


def shoot(cover: Cover, start: State, parts: Part, active: ActiveMoment, steps: int, restarts: State | None) -> Shot:
    """Integrate all parts (leaves of `parts` have a leading axis) from the state at s = 0.

    restarts: states at the beginning of every part but the first, for multiple shooting: the parts then do not depend
    on each other and run side by side, and that ends meet restarts is the caller's equation.
    """

    def integrate(state: State, part: Part):
        moment = active(cover, state, part)
        end, states = run_part(cover, state, part, moment, steps)
        return end, Shot(end, states, moment)

    if restarts is None:
        return lax.scan(integrate, start, parts)[1]
    starts = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, restarts)
    return jax.vmap(integrate)(starts, parts)[1]


def reference_shot(cover: Cover, start: State, part: Part, active: Scalar, tolerance: float) -> State:
    """The end of one part by adaptive steps: what the fixed steps are measured against."""
    return adaptive(slopes, start, (cover, active), part.low, part.high, tolerance)
