"""The beam of `beam` as an initial-value problem from the clamp on, cut into segments (multiple shooting).

With the section's own rates, dz and dlambda under dM and dN (`SectionLaw.rates`), the equations are explicit:

    theta' = z / H,   x' = lambda cos(theta),   y' = lambda sin(theta),   M' = M_ext' (active moments are constant),
    N' = theta' (Q cos(theta) - P sin(theta)) - g_x cos(theta) - g_y sin(theta)

The unknowns are the curvature L theta' at the clamp and, at every joint between segments, angle and curvature there;
the stretch at the beginning of a segment follows from its curvature and axial force.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.choice import largest
from ...numerics.ivp import Replay, Tolerance, end_of, replay, steps_of
from ...numerics.quadrature import Points
from .collocation import Cover, Part, forces
from .method import Shooting

Scalar = Float[Array, ""]
PerPart = Float[Array, " parts"]
PerSegment = Float[Array, " segments"]


class Shot(NamedTuple):
    """The beam at one place."""

    theta: Scalar
    curvature: Scalar
    """L theta'."""
    stretch: Scalar
    moment: Scalar
    """On the section, over EI/L."""
    x: Scalar
    y: Scalar


class Segments(NamedTuple):
    """The pieces of a beam, `each` of them in every part, with the unknowns at their beginnings."""

    low: PerSegment
    width: PerSegment
    theta: PerSegment
    curvature: PerSegment
    last: Scalar | None
    """The angle at the tip, where it is an unknown, too: chambers that incline need the turn of their part."""
    each: int

    def turned(self) -> PerPart:
        """The turn of every part from the unknowns."""
        assert self.last is not None
        return -jnp.diff(jnp.append(self.theta, self.last)[:: self.each])


class Arrived(NamedTuple):
    """The beam as it was shot; also what is needed of `beam.Line` at the ends of parts."""

    angles: PerPart
    """theta at the ends of the parts."""
    ends: tuple[PerPart, PerPart]
    """x and y there."""
    at_clamp: Scalar
    """M_ext there."""
    missed: Float[Array, " unknowns"]
    """Jumps of M_ext, over EI/L, and of theta from segment to segment; M_ext at the tip."""


def per_part(method: Shooting, parts: int) -> int:
    """Segments in every part."""
    return -(-method.segments // parts)


def unknown_count(method: Shooting, parts: int, coupled: bool) -> int:
    """How many numbers `segments_of` wants."""
    return 2 * parts * per_part(method, parts) - 1 + coupled


def segments_of(method: Shooting, parts: Part, clamp: Scalar, unknowns: Array, coupled: bool) -> Segments:
    """From [L theta' at the clamp, theta and L theta' at every joint, theta at the tip (coupled)], angles from that of
    the clamp on. All zero is the straight beam."""
    each = per_part(method, len(parts.low))
    width = (parts.high - parts.low) / each
    low = parts.low[:, None] + width[:, None] * np.arange(each)[None]
    count = low.size
    curvature, theta = unknowns[: 2 * count - 1 : 2], unknowns[1 : 2 * count - 1 : 2]
    begins = clamp + jnp.concatenate([jnp.zeros(1), theta])
    last = clamp + unknowns[-1] if coupled else None
    return Segments(low.reshape(-1), jnp.repeat(width, each), begins, curvature, last, each)


def _slopes(place: Scalar, at: Shot, args: tuple[Cover, Scalar, Scalar]) -> Shot:
    """d(state) / d(place), the place from 0 to 1 in a segment."""
    cover, low, width = args
    p, q = forces(cover, low + width * place)
    cosine, sine = jnp.cos(at.theta), jnp.sin(at.theta)
    h, loads = cover.slenderness, cover.loads
    dm = at.stretch * (p * sine - q * cosine) / h
    dn = at.curvature * (q * cosine - p * sine) - loads.g_x * cosine - loads.g_y * sine
    dz, dstretch = cover.law.rates(at.moment * h / 3, at.curvature * h, at.stretch, dm, dn)
    slopes = Shot(at.curvature, dz / h, dstretch, 3 * dm / h, at.stretch * cosine, at.stretch * sine)
    return jax.tree.map(lambda slope: width * slope, slopes)


def _begin(cover: Cover, low: Scalar, theta: Scalar, curvature: Scalar) -> Shot:
    p, q = forces(cover, low)
    moment, stretch = cover.law.bent(curvature * cover.slenderness, p * jnp.cos(theta) + q * jnp.sin(theta))
    zero = jnp.zeros_like(theta)
    return Shot(theta, curvature, stretch, 3 * moment / cover.slenderness, zero, zero)


def _tolerance(method: Shooting) -> Tolerance:
    return Tolerance(method.solver, *method.tolerances(), method.max_steps, method.steps)


def _gone_through(method: Shooting, cover: Cover, low: Scalar, width: Scalar, begin: Shot) -> tuple[Array, Replay]:
    """(places, what was met there) of one segment, with derivatives of any order."""
    args = (cover, low, width)
    places = steps_of(_slopes, begin, args, _tolerance(method))
    return places, replay(_slopes, begin, args, places, method.solver)


def _end(method: Shooting, cover: Cover, low: Scalar, width: Scalar, begin: Shot) -> Shot:
    """The state at the end of one segment."""
    if method.searching:
        return end_of(_slopes, begin, (cover, low, width), _tolerance(method))
    return _gone_through(method, cover, low, width, begin)[1].end


def shoot(method: Shooting, cover: Cover, segments: Segments, active: PerPart) -> Arrived:
    """All segments at once, each from the unknowns at its beginning."""
    begins = jax.vmap(_begin, (None, 0, 0, 0))(cover, segments.low, segments.theta, segments.curvature)
    ends = jax.vmap(lambda *one: _end(method, cover, *one))(segments.low, segments.width, begins)
    each = segments.each
    acts = jnp.repeat(active, each) * 3 / cover.slenderness
    before, after = begins.moment - acts, ends.moment - acts
    following = segments.theta[1:] if segments.last is None else jnp.append(segments.theta[1:], segments.last)
    missed = [after - jnp.append(before[1:], 0.0), ends.theta[: len(following)] - following]
    here = slice(each - 1, None, each)
    way = tuple(jnp.cumsum(along)[here] for along in (ends.x, ends.y))
    return Arrived(ends.theta[here], way, before[0] * cover.slenderness / 3, jnp.concatenate(missed))


def look(method: Shooting, cover: Cover, segments: Segments, points: Points) -> tuple[Array, Scalar]:
    """(L theta' at the Gauss points of every part; the steps' own estimate of the error at the ends of segments).

    One more step leads from the last place that was gone through before each point.
    """
    each, count = segments.each, len(points.places)
    # In every segment all points of its part, those outside of it at its ends.
    local = np.clip(points.places[None] * each - np.arange(each)[:, None], 0.0, 1.0)
    local = np.tile(local, (len(segments.low) // each, 1))

    def inside(low, width, theta, curvature, local):
        begin = _begin(cover, low, theta, curvature)
        places, met = _gone_through(method, cover, low, width, begin)

        def at(place):
            last = jnp.clip(jnp.searchsorted(places, place, side="right") - 1, 0, len(places) - 2)
            before = jax.tree.map(lambda v: v[last], met.ys)
            there = jnp.stack([places[last], place])
            return replay(_slopes, before, (cover, low, width), there, method.solver).end.curvature

        return jax.vmap(at)(local), met.error

    found, errors = jax.vmap(inside)(*segments[:4], jnp.asarray(local))
    which = np.minimum((points.places * each).astype(int), each - 1)
    return found.reshape(-1, each, count)[:, which, np.arange(count)], largest(errors)
