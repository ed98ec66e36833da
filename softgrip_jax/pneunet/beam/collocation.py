"""The cover of the finger: a plane-strain hyperelastic beam with an active moment per part, by collocation.

Along the reference length X (thesis 2.3, 4.4; signs as in `finger_scene`):

    M(theta', lambda), N(theta', lambda): the section law;   M = M_ext + M_active,   N = P cos(theta) + Q sin(theta)
    M_ext' = lambda (P sin(theta) - Q cos(theta)),   x' = lambda cos(theta),   y' = lambda sin(theta)
    P = P_tip + g_x (L - X),   Q = Q_tip + g_y (L - X),   M_ext = 0 at the tip

The unknowns are the curvatures theta' at Gauss points of every part: integrals of them give the angles, angles and the
axial force the stretches, those the moment that the loads exert; the section law's moment must be the same at every
point (`Line.gaps`). Nothing grows along the beam, whatever pulls at it.

Everything here is a pure number: s = X/L, lengths by L, forces by mu B H, moments by mu B H^2, slenderness = H/L.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.choice import largest, smallest
from ...numerics.ivp import adaptive
from ...numerics.quadrature import Points, between, integrals, remaining
from ...numerics.small_linear import solve
from ...numerics.xla import cos_and_sin, differentiated_once
from ..section.base import SectionLaw

Scalar = Float[Array, ""]
AtPoints = Float[Array, "parts points"]
PerPart = Float[Array, " parts"]


BETWEEN = 2
"""It tells all of the 408 wrong states among 32,768 random held fingers by the cell law; 1 leaves a few of them."""


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
    """Of all parts, or one for each: see `SectionLaw.axis`."""
    loads: Loads


class Part(NamedTuple):
    """A piece of the beam between two places, with whatever its active moment depends on."""

    low: Scalar
    high: Scalar
    chamber: Any


class Line(NamedTuple):
    """The beam at its Gauss points and at the ends of its parts."""

    curvature: AtPoints
    """L theta'."""
    theta: AtPoints
    stretch: AtPoints
    moment: AtPoints
    """On the section, from its curvature."""
    external: AtPoints
    """M_ext: from the loads."""
    at_clamp: Scalar
    """M_ext there."""
    slopes: tuple[AtPoints, AtPoints]
    """dx/ds, dy/ds."""
    angles: PerPart
    """theta at the ends of the parts."""
    ends: tuple[PerPart, PerPart]
    """x and y there."""

    def gaps(self, active: PerPart) -> AtPoints:
        """What the sections carry minus what acts on them."""
        return self.moment - self.external - active[:, None]


def forces(cover: Cover, s: Array) -> tuple[Array, Array]:
    """(P, Q) at s."""
    loads, rest = cover.loads, 1 - s
    return loads.p_tip + loads.g_x * rest, loads.q_tip + loads.g_y * rest


def of_one_part(cover: Cover) -> Cover:
    """The same of a beam of one part, without an axis for it: numbers are multiplied by values at points in fewer
    operations, and so compile faster."""
    law = cover.law
    return cover._replace(law=jax.tree.map(lambda leaf: leaf[0], law) if law.axis() == 0 else law)


def _at_a_point(cover: Cover, s: Scalar, curvature: Scalar, theta: Scalar) -> tuple[Scalar, ...]:
    """(M on the section, stretch, dx/ds, dy/ds, dM_ext/ds)."""
    p, q = forces(cover, s)
    cosine, sine = cos_and_sin(theta)
    moment, stretch = cover.law.bent_once(cover.slenderness * curvature, p * cosine + q * sine)
    dx, dy = stretch * cosine, stretch * sine
    return moment, stretch, dx, dy, (p * dy - q * dx) / cover.slenderness


class Along(NamedTuple):
    """What one part is from its curvatures and the angle at its beginning: at its points, and over all of it."""

    theta: Float[Array, " points"]
    moment: Float[Array, " points"]
    stretch: Float[Array, " points"]
    slopes: tuple[Float[Array, " points"], Float[Array, " points"]]
    ahead: Float[Array, " points"]
    """How M_ext changes from each point to the part's end."""
    change: Scalar
    """... and from its beginning."""
    way: tuple[Scalar, Scalar]
    """x and y from its beginning to its end."""


def _along_a_part(
    points: Points, cover: Cover, low: Scalar, width: Scalar, curvature: Float[Array, " points"], start: Scalar
) -> Along:
    """One part of several; `start` is theta at its beginning."""
    theta = start + width * (curvature @ points.up_to.T)
    s = low + width * points.places
    moment, stretch, dx, dy, change = jax.vmap(_at_a_point, (None, 0, 0, 0))(cover, s, curvature, theta)
    whole, x, y = (width * (values @ points.weights) for values in (change, dx, dy))
    return Along(theta, moment, stretch, (dx, dy), width * (change @ points.beyond.T), whole, (x, y))


def bend(cover: Cover, clamp: Scalar, parts: Part, curvature: AtPoints, points: Points) -> Line:
    """The beam with these curvatures, from the angle at its clamp; the tip is free of moments."""
    return (_bend_one if len(curvature) == 1 else _bend_several)(cover, clamp, parts, curvature, points)


def _bend_one(cover: Cover, clamp: Scalar, parts: Part, curvature: AtPoints, points: Points) -> Line:
    """Every point by itself: each depends on all the others."""
    widths = parts.high - parts.low
    turned, turns = integrals(curvature, widths, points)
    theta = clamp + turned
    s = parts.low[0] + widths[0] * points.places
    every = jax.vmap(_at_a_point, (None, 0, 0, 0))(of_one_part(cover), s, curvature[0], theta[0])
    moment, stretch, dx, dy, change = (values[None] for values in every)
    x, y = integrals(dx, widths, points)[1], integrals(dy, widths, points)[1]
    external, at_clamp = -remaining(change, widths, points), -integrals(change, widths, points)[1][-1]
    return Line(curvature, theta, stretch, moment, external, at_clamp, (dx, dy), clamp + turns, (x, y))


def _bend_several(cover: Cover, clamp: Scalar, parts: Part, curvature: AtPoints, points: Points) -> Line:
    """Every part at once: it depends on what is in it and on few numbers of the others, so that its derivatives are
    taken by those, and not by everything along the beam (two thirds of the time of a Jacobian)."""
    widths = parts.high - parts.low
    turns = widths * (curvature @ points.weights)
    angles = clamp + jnp.cumsum(turns)
    along = (Cover(None, cover.law.axis(), None), 0, 0, 0, 0)
    every = jax.vmap(differentiated_once(partial(_along_a_part, points)), along)
    found = every(cover, parts.low, widths, curvature, angles - turns)
    changes = jnp.cumsum(found.change)
    external = -found.ahead - (changes[-1] - changes)[:, None]
    ends = (jnp.cumsum(found.way[0]), jnp.cumsum(found.way[1]))
    return Line(curvature, found.theta, found.stretch, found.moment, external, -changes[-1], found.slopes, angles, ends)


def pushed_over_stiffness(cover: Cover, clamp: Scalar, curvature: Float[Array, " points"], points: Points) -> Scalar:
    """The largest push along a beam of one part over the least stiffness of its sections, over 1 / L^2; infinite where
    a section gives way.

    Stiffnesses are the moment's differences over those of the curvature, between neighbouring points and with BETWEEN
    more: where a piece of the beam has snapped, the curvatures that it went through lie between two points.
    """
    p, q = forces(cover, jnp.asarray(points.places))
    cosine, sine = cos_and_sin(clamp + curvature @ points.up_to.T)
    z, n = cover.slenderness * curvature, p * cosine + q * sine
    count = len(points.places)
    fine = np.linspace(0, count - 1, (BETWEEN + 1) * (count - 1) + 1)
    linear = np.maximum(0, 1 - abs(fine[:, None] - np.arange(count)))
    z, n = linear @ z, linear @ n
    least = smallest(of_one_part(cover).law.stiffnesses(z, n))
    push = jnp.maximum(largest(-n), 0.0) / cover.slenderness**2
    return jnp.where(least > 0, push / jnp.where(least > 0, least, 1.0), jnp.inf)


def at_place(line: Line, parts: Part, clamp: Scalar, s: Scalar, points: Points) -> tuple[Scalar, ...]:
    """(x, y, theta, stretch) at any place, as exact as at the points."""
    part = jnp.clip(jnp.searchsorted(parts.high, s), 0, len(parts.high) - 1)
    width = parts.high[part] - parts.low[part]
    local = (s - parts.low[part]) / width

    def whole(values: Array, start: Scalar, ends: Array) -> Scalar:
        before = jnp.where(part > 0, ends[part - 1], start)
        return before + width * between(values, local, part, points)[1]

    zero = jnp.zeros_like(s)
    x, y = (whole(slope, zero, end) for slope, end in zip(line.slopes, line.ends, strict=True))
    return x, y, whole(line.curvature, clamp, line.angles), between(line.stretch, local, part, points)[0]


class State(NamedTuple):
    """The beam at one place, as an initial-value problem: angle, external moment, position."""

    theta: Scalar
    moment: Scalar
    x: Scalar
    y: Scalar


def slopes(s: Scalar, state: State, args: tuple[Cover, Scalar]) -> State:
    """d(state)/ds, with the section's state solved for at every place."""
    cover, active = args
    p, q = forces(cover, s)
    cosine, sine = cos_and_sin(state.theta)
    z, stretch = cover.law(state.moment + active, p * cosine + q * sine)
    dx, dy = stretch * cosine, stretch * sine
    return State(z / cover.slenderness, (p * dy - q * dx) / cover.slenderness, dx, dy)


def states_of(cover: Cover, line: Line, clamp: Scalar, parts: Part, points: Points) -> tuple[Array, Array]:
    """(places s, states as rows) at the beginning of every part, at its points, and at the tip."""
    widths = parts.high - parts.low
    s = parts.low[:, None] + widths[:, None] * points.places[None]
    p, q = forces(cover, s)
    dx, dy = line.slopes
    values = (line.curvature, (p * dy - q * dx) / cover.slenderness, dx, dy)
    first = (clamp, line.at_clamp, 0.0, 0.0)

    def along(value: Array, start: Scalar | float) -> Array:
        inside, ends = integrals(value, widths, points)
        begins = jnp.concatenate([jnp.zeros(1), ends[:-1]])
        return start + jnp.append(jnp.concatenate([begins[:, None], inside], axis=1), ends[-1])

    places = jnp.append(jnp.concatenate([parts.low[:, None], s], axis=1), parts.high[-1])
    return places, jnp.stack([along(*pair) for pair in zip(values, first, strict=True)], axis=1)


def corrected(
    cover_of: Callable[[Scalar], Cover],
    held: Scalar | None,
    tip: Scalar | None,
    found: tuple[Array, Array],
    active: PerPart,
    tolerance: float,
) -> tuple[Array, Scalar]:
    """How far one Newton step of multiple shooting moves the state at the tip, and the unknown force at a held tip.

    Diffrax's adaptive steps lead from every place to the next; unknown are the states at all places (but theta, x and y
    at the clamp), and the force. The moment at the tip is to be zero, and y of a held tip to be `tip`.
    """
    places, states = found
    size, count = states.size, len(places)
    each = (count - 1) // len(active)
    moments = jnp.repeat(active, each)
    own = cover_of(jnp.zeros_like(states[0, 0]) if held is None else held).law
    axis = own.axis()
    laws = own if axis is None else jax.tree.map(lambda leaf: jnp.repeat(leaf, each, axis=0), own)
    force = jnp.zeros_like(states[0, 0]) if held is None else held

    def arrived(low, high, moment, law, state, force):
        cover = cover_of(force)._replace(law=law)
        end = adaptive(slopes, State(*state), (cover, moment), low, high, tolerance)
        return jnp.stack(end)

    def every(u):
        y, force = u[:-1].reshape(count, 4), u[-1]
        there = jax.vmap(arrived, (0, 0, 0, axis, 0, None))(places[:-1], places[1:], moments, laws, y[:-1], force)
        clamped = (y[0] - states[0])[jnp.array([0, 2, 3])]
        last = force if tip is None else y[-1, 3] - tip
        return jnp.concatenate([clamped, (there - y[1:]).reshape(-1), jnp.stack([y[-1, 1], last])])

    u = jnp.append(states.reshape(-1), force)
    move = solve(jax.jacfwd(every)(u), every(u))
    return move[size - 4 : size], move[-1]
