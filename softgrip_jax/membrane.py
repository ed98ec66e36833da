"""A thin membrane that forms circular arcs: tensions from the energy, equilibrium, arcs, and the inclined wall.

Notation: a, b half width and half length, t_m thickness, theta the arc (clamp) angle, lambda stretches, p pressure.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .materials.base import Material, nominal_stresses
from .numerics.implicit import implicit
from .numerics.xla import cos_and_sin

Scalar = Float[Array, ""]

SERIES_ANGLE = 1e-2
"""Below this angle the series of x/sin(x) through x^6 is exact to the last bit (next term 4e-19)."""


@jax.jit
def angle_over_sine(x: Scalar) -> Scalar:
    """x / sin x, regular at zero in value and every derivative."""
    small = jnp.abs(x) < SERIES_ANGLE
    safe = jnp.where(small, 1.0, x)
    x2 = x * x
    series = 1 + x2 * (1 / 6 + x2 * (7 / 360 + x2 * (31 / 15120)))
    return jnp.where(small, series, safe / jnp.sin(safe))


def tensions(material: Material, t_m: Scalar, l1: Scalar, l2: Scalar) -> tuple[Scalar, Scalar]:
    """Line tensions T_1, T_2 (N/m, force per deformed length): T_1 = t_m (dw/dlambda_1) / lambda_2, and likewise T_2.

    Equal to thesis (2.2), with w(lambda_1, lambda_2) the energy of an incompressible sheet.
    """
    s1, s2 = nominal_stresses(material, l1, l2)
    return t_m * s1 / l2, t_m * s2 / l1


def equilibrium_pressure(material: Material, t_m: Scalar, l1: Scalar, l2: Scalar, k1: Scalar, k2: Scalar) -> Scalar:
    """p = kappa_1 T_1 + kappa_2 T_2, thesis (2.4)."""
    t1, t2 = tensions(material, t_m, l1, l2)
    return k1 * t1 + k2 * t2


def length_stretch(l1: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """lambda_2 when width and length grow by the same amount, thesis (3.1)."""
    return 1 + a / b * (l1 - 1)


def flat_contact_stretch(theta: Scalar, distance_over_a: Scalar) -> Scalar:
    """lambda_1 of an arc-flat-arc profile that touches a plane at distance d, thesis (3.11)."""
    half = 0.5 * theta
    return 1 + distance_over_a * (half / jnp.sin(half) ** 2 - 1 / jnp.tan(half))


INVERSE_STEPS = 7
"""Newton steps for the two inverses below. Both functions are convex, so that Newton's method approaches from one side;
over the whole range the sixth step is already down to rounding."""


SERIES_COTANGENT = 0.4
"""Below this angle 1 - x cot x by its series through x^18: the next term is 5e-17 of it."""


@jax.jit
def one_less_cotangent(x: Scalar) -> Scalar:
    """1 - x cot x, without loss of digits at small x, where it is x^2 / 3 (-pi < x < pi)."""
    small = jnp.abs(x) < SERIES_COTANGENT
    safe = jnp.where(small, 1.0, x)
    x2 = x * x
    series = jnp.zeros_like(x)
    for coefficient in COTANGENT_SERIES[::-1]:
        series = x2 * (coefficient + series)
    return jnp.where(small, series, 1 - safe / jnp.tan(safe))


COTANGENT_SERIES = (
    *(1 / 3, 1 / 45, 2 / 945, 1 / 4725, 2 / 93555, 1382 / 638512875, 4 / 18243225),
    *(3617 / 162820783125, 87734 / 38979295480125),
)
"""Of 1 - x cot x in powers of x^2: 2^(2n) |B_2n| / (2n)! (Euler)."""


@jax.jit
def contact_half_width(gap: Scalar, sunk: Scalar) -> Scalar:
    """c_a / a of an arc-flat-arc profile at the distance `gap` that is stretched as a free arc of height gap + sunk.

    Both are given over a. With F(h) = h / sin^2 h - cot h and half arc angles h (touching), h_e (the free arc) and
    h + w, (3.11) is gap F(h + w) = tan(h_e) F(h_e), and c_a / a = 1 - tan h / tan(h + w) = sin w / (cos h sin(h + w)).
    Everything is written in the differences w and sunk and in q(x) = 1 - x cot x, so that a narrow contact loses no
    digits: F(h + w) - F(h) = sin w (q(h) + q(h + w) - q(w)) / (sin h sin(h + w)).
    """

    def rise(start, by):
        """F(start + by) - F(start)."""
        q = one_less_cotangent(start) + one_less_cotangent(start + by) - one_less_cotangent(by)
        return jnp.sin(by) * q / (jnp.sin(start) * jnp.sin(start + by))

    def wanted(gap, sunk):
        """F(h + w) - F(h) = F(h_e) - F(h) + F(h_e) sunk / gap."""
        high = gap + sunk
        half, by = jnp.arctan(gap), jnp.arctan2(sunk, 1 + gap * high)
        free = high - one_less_cotangent(half + by) * (high + 1 / high)
        return rise(half, by) + free * sunk / gap

    def excess(w, args):
        return rise(jnp.arctan(args[0]), w) - wanted(*args)

    fixed = lax.stop_gradient((gap, sunk))
    half, goal = jnp.arctan(fixed[0]), wanted(*fixed)
    most = 0.5 * jnp.pi - half
    # F is convex with slopes from 2/3 to 2 in [0, pi/2]: Newton's method comes down to the root from above.
    slope = 2 * one_less_cotangent(half) / jnp.sin(half) ** 2

    def step(_, w):
        value, slope = jax.jvp(lambda w: excess(w, fixed), (w,), (jnp.ones_like(w),))
        return jnp.clip(w - value / slope, 0.0, most)

    w = lax.fori_loop(0, INVERSE_STEPS, step, jnp.minimum(goal / slope, most))
    w = implicit(excess, w, (gap, sunk))
    half = jnp.arctan(gap)
    return jnp.sin(w) * jnp.sqrt(1 + gap * gap) / jnp.sin(half + w)


def angle_of_stretch(stretch: Scalar) -> Scalar:
    """theta of a free arc with a given stretch theta / sin(theta) > 1: the inverse of (3.5); differentiable."""
    fixed = lax.stop_gradient(stretch)
    # theta / sin theta >= 1 + theta^2 / 6, and one Newton step from pi: both are at or above the root.
    angle = jnp.minimum(jnp.sqrt(6 * (fixed - 1)), jnp.pi * fixed / (1 + fixed))

    def step(_, angle):
        return angle - (fixed * jnp.sin(angle) - angle) / (fixed * jnp.cos(angle) - 1)

    angle = lax.fori_loop(0, INVERSE_STEPS, step, angle)
    return implicit(lambda angle, stretch: stretch * jnp.sin(angle) - angle, angle, stretch)


def plate_coefficient(a_over_b: Scalar) -> Scalar:
    """C of the small-deflection law p = C E t_m delta^3 / a^4, thesis (2.1), for a clamped rectangular membrane.

    nu = 1/2. An infinite strip has C = (4/3) / (1 - nu^2) = 16/9 exactly. The polynomial was fitted to a Ritz
    solution of the Foeppl membrane (252 unknowns; 3.4856 for the square) and is within 0.1 % of it for every a/b <= 1.
    """
    q = a_over_b
    return 16 / 9 + q**3 * (1.28850335 + q * (-4.01138846 + q * (7.6042909 - 3.1746312 * q)))


class InclinedWall(NamedTuple):
    """A square-like membrane in contact with an inclined plane, at exterior clamp angle theta_m2 (thesis 4.3.3)."""

    pressure: Scalar
    stretch: Scalar
    radius: Scalar
    theta_m1: Scalar
    c_1: Scalar
    c_2: Scalar
    c_z: Scalar
    rho: Scalar
    """rho*: undeformed place of first contact, measured from the middle of the wall."""

    @property
    def contact_width(self) -> Scalar:
        """c_y = c_1 + c_2, thesis (4.33): along the incline."""
        return self.c_1 + self.c_2

    @property
    def contact_area(self) -> Scalar:
        """A_c = pi/4 c_y c_z, thesis (4.35)."""
        return jnp.pi / 4 * self.contact_width * self.c_z


def first_contact_angle(d_over_a: Scalar, incline: Scalar) -> Scalar:
    """theta_i: clamp angle of the free arc that just touches a plane at distance d, inclined by theta_s.

    (4.18), d/a = csc(theta_i) - cos(theta_s) cot(theta_i) - sin(theta_s), is a quadratic in tan(theta_i / 2).
    """
    s, c = jnp.sin(incline), jnp.cos(incline)
    return 2 * jnp.arctan((d_over_a + s + jnp.sqrt(d_over_a * (d_over_a + 2 * s))) / (1 + c))


SMALL_STRAIN = 3e-3
"""Below it, T / (lambda - 1) is the mean of dT/dlambda by three Gauss points (error 2 strain^6); above, the quotient
loses eps / strain, 1e-13 at most."""


GAUSS_PLACES, GAUSS_WEIGHTS = (0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5), (5 / 18, 8 / 18, 5 / 18)
"""Gauss points and weights on the interval from 0 to 1."""


def tension_over_strain(material: Material, t_m: Scalar, strain: Scalar) -> Scalar:
    """T / (lambda - 1) of a membrane stretched by lambda = 1 + strain both ways, N/m; regular at zero strain.

    The closed form of a material that states it (neo-Hookean) saves two thirds of what a finger takes to compile.
    """
    closed_form = material.closed_forms().tension_over_strain
    if closed_form is not None:
        return closed_form(t_m, strain)

    def tension(stretch):
        return tensions(material, t_m, stretch, stretch)[0]

    small = jnp.abs(strain) < SMALL_STRAIN
    tiny, safe = jnp.where(small, strain, 0.0), jnp.where(small, 1.0, strain)
    slopes = jax.vmap(lambda x: jax.jvp(tension, (1 + x,), (jnp.ones_like(x),))[1])(jnp.array(GAUSS_PLACES) * tiny)
    mean = jnp.dot(jnp.array(GAUSS_WEIGHTS), slopes)
    return jnp.where(small, mean, tension(1 + safe) / safe)


class Seat(NamedTuple):
    """What of an inclined wall does not depend on its angle: where it meets the plane, (4.18), (4.19), (4.27)."""

    cosine: Scalar
    """cos(theta_s)."""
    lean: Scalar
    """cos(theta_s) - 1."""
    depth: Scalar
    """d + 2 a sin(theta_s), m."""
    rho: Scalar
    """rho*, m."""
    outer: Scalar
    """a + rho*, m: the part of the wall outside of the place of first contact."""


@jax.jit
def wall_seat(a: Scalar, d: Scalar, incline: Scalar) -> Seat:
    """As for `inclined_wall`."""
    cosine, sine = cos_and_sin(incline)
    apart = d > 0
    theta_i = first_contact_angle(jnp.where(apart, d / a, 1.0), incline)
    rho = a * jnp.where(apart, incline / theta_i, jnp.sign(incline))  # (4.19)
    lean = -2 * jnp.sin(0.5 * incline) ** 2
    return Seat(cosine, lean, d + 2 * a * sine, rho, a + rho)


class _Inflated(NamedTuple):
    """A seated wall at one angle."""

    sine: Scalar
    """sin(theta_m2 / 2)."""
    cosine: Scalar
    cot: Scalar
    strain: Scalar
    pressure: Scalar


def _inflated(theta_m2: Scalar, seat: Seat, t_m: Scalar, material: Material) -> _Inflated:
    """p = 2 T / R, (4.7), (4.27), (4.28), (4.30), with T and R each in proportion to the depth where it is small."""
    cosine, sine = cos_and_sin(0.5 * theta_m2)
    sine2, cot = sine * sine, cosine / sine
    bulge = (theta_m2 / sine2 - 2 * cot) / (2 * seat.outer)
    strain = seat.lean + seat.depth * bulge  # (4.28)
    deep = seat.depth > 0
    strain_over_depth = bulge + jnp.where(deep, seat.lean / jnp.where(deep, seat.depth, 1.0), 0.0)
    pressure = 4 * sine2 * strain_over_depth * tension_over_strain(material, t_m, strain)
    return _Inflated(sine, cosine, cot, strain, pressure)


@jax.jit
def seated_pressure(theta_m2: Scalar, seat: Seat, t_m: Scalar, material: Material) -> Scalar:
    """The pressure (Pa) of `inclined_wall`, for searches for its angle: what the angle leaves alone is in the seat."""
    return _inflated(theta_m2, seat, t_m, material).pressure


@jax.jit
def inclined_wall(
    theta_m2: Scalar, a: Scalar, b: Scalar, t_m: Scalar, material: Material, d: Scalar, incline: Scalar
) -> InclinedWall:
    """The wall at theta_m2, every quantity explicit: (4.19), (4.26)-(4.34), with (4.30) for any strain energy.

    d: distance of the plane along the interior edge, m, >= 0; incline: theta_s, rad, >= 0 (0 is the parallel plane,
    where theta_m1 = theta_m2 and c_1 = c_2). The wall is stretched equally both ways (square assumption); b enters
    by the stretch mapping (4.34) alone. On a parallel plane d = 0 is a regular limit; on an inclined one the model
    touches at the very edge there (rho* = a, no force) and depends on sqrt(d).
    """
    seat = wall_seat(a, d, incline)
    sine, cosine, cot, strain, pressure = _inflated(theta_m2, seat, t_m, material)
    depth, apart, deep = seat.depth, d > 0, seat.depth > 0
    radius = depth / (2 * sine * sine)  # (4.27)
    c_2 = seat.outer * seat.cosine - depth * cot  # (4.26)
    part = jnp.sqrt(jnp.where(apart, d / jnp.where(deep, depth, 1.0), 1.0))
    part = jnp.where(apart | ~deep, part, 0.0)
    # The arcsine has no slope at 1, where parallel walls close.
    cosine_1 = jnp.sqrt(cosine * cosine + sine * sine * (1 - part) * (1 + part))
    theta_m1 = 2 * jnp.arctan2(sine * part, cosine_1)  # (4.31)
    c_1 = 2 * a * (1 + strain) - radius * (theta_m1 + theta_m2) - c_2  # (4.32)
    c_z = (c_1 + c_2) * b * (a - seat.rho) / a**2  # (4.34)
    return InclinedWall(pressure, 1 + strain, radius, theta_m1, c_1, c_2, c_z, seat.rho)


def arc_chain(
    lengths: Float[Array, " k"], curvatures: Float[Array, " k"], heading: Scalar, n: int
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """n points, evenly spaced by arc length, on a smooth chain of circular arcs that starts at the origin.

    lengths: m, of each arc; curvatures: 1/m, positive to the left, 0 for straight; heading: rad, at the start.
    """
    turns = lengths * curvatures
    headings = heading + jnp.concatenate([jnp.zeros(1, turns.dtype), jnp.cumsum(turns)[:-1]])

    def advance(s, curvature, heading):
        chord = s * jnp.sinc(0.5 * curvature * s / jnp.pi)
        middle = heading + 0.5 * curvature * s
        return chord * jnp.cos(middle), chord * jnp.sin(middle)

    dx, dy = advance(lengths, curvatures, headings)
    x0, y0, s0 = (jnp.concatenate([jnp.zeros(1, v.dtype), jnp.cumsum(v)]) for v in (dx, dy, lengths))
    s = jnp.linspace(0.0, 1.0, n, dtype=lengths.dtype) * s0[-1]
    k = jnp.clip(jnp.searchsorted(s0[1:], s, side="left"), 0, lengths.shape[0] - 1)
    dx, dy = advance(s - s0[k], curvatures[k], headings[k])
    return x0[k] + dx, y0[k] + dy
