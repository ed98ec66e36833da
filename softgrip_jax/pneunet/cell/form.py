"""The form of the cell law: a few functions of curvature and pressure, whose numbers go with the geometry.

Neighbouring walls touch at a pressure p_c, the larger the more the curvature has opened the gap between them, and then
press on each other with a growing share of the pressure on the wall:

    E = exp(-(p_c o^m / p)^n),   o = 1 + kappa / kappa_r

o is the opening of the gap over the gap itself, rounded off where it closes; kappa_r the curvature at which the rims
of rigid neighbours meet. With the wall's force W = 4 a b p and its moment W (a + H / 2),

    M = EI kappa (c + c' kappa + c'' kappa^2) - W (a + H / 2) (A E s(E, p, o) + d + d' (o - 1)) - rims
    F = W A_F E s_F(E, p, o) + rims_F

s are polynomials near one, d what the pressure does without contact, rims ramps of -o. Stretch, lever and compliance
are sums of the same functions. Every number (p_c, m, n, A, c, ...) is a polynomial of first or second degree in the
logarithms of the lengths over B, p_c and A the exponential of one: see `NUMBERS`. They are fitted,
benchmarks/cell/fit.py.

Lengths are over B, curvatures times B, pressures over mu, moments over mu B^3, forces over mu B^2.

Sums are written out in numbers, not as products of arrays: XLA makes one loop of them, which takes a third of the time
of small products, and compiles in two thirds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]

SIZES = ("a", "b", "t_m", "h_x", "h_L", "H")
LOW = np.array([4.2, 6.7, 0.85, 0.55, 3.8, 3.8]) / 20
HIGH = np.array([7.2, 9.2, 1.55, 0.95, 4.9, 6.2]) / 20
"""Lengths over B between which the law was fitted."""
MIDDLE, HALF_WIDTH = 0.5 * np.log(LOW * HIGH), 0.5 * np.log(HIGH / LOW)
MOST_PRESSURE = 0.24
"""Over mu, where the states end."""
TOP = 0.1
"""Thickness of the top wall over B."""
LEAST_PRESSURE = 1e-5
"""Over mu, added to the pressure where it divides: without pressure nothing presses."""
CLOSED = 0.3
"""Width over which the opening is rounded off at zero."""
RIM_KNOTS, RIM_WIDTHS = np.array([0.1, -0.4, -1.0]), np.array([0.12, 0.2, 0.25])
"""Openings at which pressed rims begin to be felt, and over which they do."""
ROUNDED = 0.02
"""Forces below so much of the walls' share of the pressure are rounded off towards zero."""
NO_FORCE = 1e-6
"""Over mu B^2: forces below it are rounded off, too, 0.05 mN for Dragon Skin 20. Rims of a cell without pressure begin
to press as it bends, by as little as that, and Newton's method would stop at their kink."""
PRESSURE_UNIT, OPENING_UNIT = 0.2, 5.0
"""Of pressures over mu and of (o - 1) in the polynomials, so that they are near one."""
RIMS = tuple(f"{name} {i}" for name in ("rim", "rim p") for i in range(len(RIM_KNOTS)))
SHAPE = ("p", "p^2", "o", "o^2", "E", "E^2", "p o", "E o", "E o^2", "E p")
LINEAR, QUADRATIC = 1 + len(SIZES), 1 + len(SIZES) + len(SIZES) * (len(SIZES) + 1) // 2
NUMBERS = {
    "touch": {"p_c": QUADRATIC, "m": LINEAR, "n": LINEAR},
    "moment": {"A": QUADRATIC}
    | dict.fromkeys(SHAPE, LINEAR)
    | {"c": QUADRATIC, "c'": LINEAR, "c''": LINEAR, "d": LINEAR, "d'": LINEAR}
    | dict.fromkeys(RIMS, LINEAR),
    "force": {"A": QUADRATIC} | dict.fromkeys(SHAPE + RIMS, LINEAR),
    "stretch": dict.fromkeys(
        ("F", "F E", "F p", "F^2", "p", "p^2", "p o", "M", "k", "k^2", "k^3", "E k", "E k^2", *RIMS[:3]), LINEAR
    ),
    "lever": {"1": QUADRATIC, "E": QUADRATIC} | dict.fromkeys(("E^2", "p", "o", "o^2", "E o", *RIMS[:3]), LINEAR),
    "compliance": dict.fromkeys(("1", "E", "E^2", "p", "E p", "E o", "k", "k^2", *RIMS[:3]), LINEAR),
}
"""How many of `geometry_functions` the polynomial of each number takes."""
COUNTS = [count for group in NUMBERS.values() for count in group.values()]


def _places() -> dict[str, slice]:
    out, begin = {}, 0
    for head, group in NUMBERS.items():
        out[head] = slice(begin, begin + len(group))
        begin += len(group)
    return out


PLACES = _places()
"""Of the numbers of each group among all of them."""


def geometry_functions(x: Array) -> Array:
    """1, z_i, z_i z_j of z, the lengths' logarithms from -1 to 1."""
    z = (jnp.log(x) - MIDDLE) / HALF_WIDTH
    first, second = np.triu_indices(len(SIZES))
    return jnp.concatenate([jnp.ones(1), z, z[first] * z[second]])


def rims_meet(x: Array) -> Scalar:
    """B times the curvature (positive) at which the rims of rigid neighbours would meet."""
    a, _, _, gap, length, H = jnp.unstack(x)
    return gap / ((0.5 * length + gap) * (0.5 * H + 2 * a + TOP))


def ramp(x: Scalar, width: float) -> Scalar:
    """The larger of x and 0, rounded off over the width."""
    return 0.5 * (x + jnp.sqrt(x * x + width * width))


def pressing(x: Any, width: float) -> Scalar:
    """What pressed rims add at the depth x: a ramp that starts as a square, so that it leaves no tail before it."""
    r = ramp(jnp.asarray(x), width)
    return r * r / (r + width)


class Loaded(NamedTuple):
    """A cell at a pressure."""

    numbers: Array
    """All of NUMBERS at the geometry."""
    x: Array
    pressure: Scalar
    rims_meet: Scalar


def loaded(C: Any, x: Array, p: Scalar) -> Loaded:
    """From the coefficients of all polynomials, (numbers, geometry functions)."""
    return Loaded(jnp.asarray(C) @ geometry_functions(x), x, p, rims_meet(x))


class Functions(NamedTuple):
    """What all heads are made of, at one curvature."""

    E: Scalar
    p: Scalar
    o: Scalar
    k: Scalar
    rims: tuple[Scalar, ...]


def pressed_share(c: Loaded, log_opening: Any) -> Scalar:
    """E where the gap is open by so much."""
    log_touch, m, n = jnp.unstack(c.numbers[PLACES["touch"]])
    return jnp.exp(-jnp.exp(n * (log_touch + m * log_opening - jnp.log(c.pressure + LEAST_PRESSURE))))


def functions(c: Loaded, k: Scalar) -> Functions:
    """E, p, o - 1 (both in their units), k and the ramps of the rims, zero without curvature."""
    opening = k / c.rims_meet
    E = pressed_share(c, jnp.log(ramp(1 + opening, CLOSED)))
    rims = tuple(
        pressing(knot - 1 - opening, width) - pressing(knot - 1, width)
        for knot, width in zip(RIM_KNOTS, RIM_WIDTHS, strict=True)
    )
    return Functions(E, c.pressure / PRESSURE_UNIT, opening / OPENING_UNIT, k, rims)


def straight_shape(numbers: Sequence[Scalar], E: Scalar, p: Scalar) -> Scalar:
    """s of the pressed walls of a straight cell, see SHAPE."""
    p_1, p_2, _, _, E_1, E_2, _, _, _, Ep = numbers
    E = E - 0.5
    return 1 + p * (p_1 + p_2 * p) + E * (E_1 + E_2 * E + Ep * p)


def shape(numbers: Sequence[Scalar], f: Functions) -> Scalar:
    """s of the pressed walls, see SHAPE."""
    _, _, o_1, o_2, _, _, po, Eo, Eo_2, _ = numbers
    E, o = f.E - 0.5, f.o
    return straight_shape(numbers, f.E, f.p) + o * (o_1 + o_2 * o + po * f.p + E * (Eo + Eo_2 * o))


def wall_force(c: Loaded) -> Scalar:
    """W: the pressure on one wall."""
    return 4 * c.x[0] * c.x[1] * c.pressure


def of_rims(numbers: Sequence[Scalar], f: Functions) -> Scalar:
    """One number for each ramp of the rims."""
    return sum((n * rim for n, rim in zip(numbers, f.rims, strict=True)), jnp.zeros_like(f.k))


def pressed_rims(numbers: Sequence[Scalar], f: Functions, c: Loaded) -> Scalar:
    """Force of pressed rims; it goes with the wall's area."""
    without, by_pressure = numbers[: len(f.rims)], numbers[len(f.rims) :]
    pressed = [n + q * f.p for n, q in zip(without, by_pressure, strict=True)]
    return 0.4 * c.x[0] * c.x[1] * of_rims(pressed, f)


def moment(c: Loaded, f: Functions) -> Scalar:
    """M, over mu B^3."""
    a, H = c.x[0], c.x[5]
    size, *others = jnp.unstack(c.numbers[PLACES["moment"]])
    s, (c_0, c_1, c_2, d_0, d_1), rims = others[:10], others[10:15], others[15:]
    cover = H**3 / 3 * f.k * (c_0 + 0.3 * f.k * (c_1 + c_2 * f.k))
    walls = wall_force(c) * (a + 0.5 * H) * (jnp.exp(size) * f.E * shape(s, f) + d_0 + d_1 * f.o)
    return cover - walls - (2 * a + 0.5 * H) * pressed_rims(rims, f, c)


def straight_moment(c: Loaded) -> Scalar:
    """`moment` without curvature."""
    size, *others = jnp.unstack(c.numbers[PLACES["moment"]])
    E, p = pressed_share(c, np.log(0.5 * (1 + np.sqrt(1 + CLOSED**2)))), c.pressure / PRESSURE_UNIT
    walls = jnp.exp(size) * E * straight_shape(others[:10], E, p) + others[13]
    return -wall_force(c) * (c.x[0] + 0.5 * c.x[5]) * walls


def force(c: Loaded, f: Functions) -> Scalar:
    """F, over mu B^2: it only pushes; what would pull is rounded off to none, or NO_FORCE / 2 below it."""
    size, *others = jnp.unstack(c.numbers[PLACES["force"]])
    whole = wall_force(c) * jnp.exp(size) * f.E
    value, width = whole * shape(others[:10], f) + pressed_rims(others[10:], f, c), ROUNDED * whole
    return 0.5 * (value - NO_FORCE + jnp.sqrt(value * value + width * width + NO_FORCE**2))


def strain(numbers: Array, f: Functions, H: Scalar, F: Scalar, M: Scalar) -> Scalar:
    """Without axial force, F and M being the cell's: the walls' force pulls the cover."""
    F_1, FE, Fp, F_2, p_1, p_2, po, M_1, k_1, k_2, k_3, Ek, Ek_2, *rims = jnp.unstack(numbers)
    E, p, o, k = f.E, f.p, f.o, f.k
    F, M = F / (4 * H), M / H**2
    pulled = F * (F_1 + FE * E + Fp * p + F_2 * F) + M_1 * M
    bent = k * (k_1 + Ek * E * H + k * (k_2 + Ek_2 * E * H + k_3 * k))
    return pulled + p * (p_1 + p_2 * p + po * o) + bent + of_rims(rims, f)


def more_lever(numbers: Array, f: Functions) -> Scalar:
    """The lever over a + H / 2, less one."""
    one, E_1, E_2, p_1, o_1, o_2, Eo, *rims = jnp.unstack(numbers)
    E, p, o = f.E, f.p, f.o
    return one + E * (E_1 + E_2 * E + Eo * o) + p_1 * p + o * (o_1 + o_2 * o) + of_rims(rims, f)


def log_compliance(numbers: Array, f: Functions) -> Scalar:
    """The logarithm of the axial compliance over B / (4 H)."""
    one, E_1, E_2, p_1, Ep, Eo, k_1, k_2, *rims = jnp.unstack(numbers)
    E, p, o, k = f.E, f.p, f.o, f.k
    return one + E * (E_1 + E_2 * E + Ep * p + Eo * o) + p_1 * p + k * (k_1 + k_2 * k) + of_rims(rims, f)


def lever(c: Loaded, f: Functions) -> Scalar:
    """Of F about the cover's mid-height, over B."""
    return (1 + more_lever(c.numbers[PLACES["lever"]], f)) * (c.x[0] + 0.5 * c.x[5])


def at_curvature(c: Loaded, k: Scalar) -> dict[str, Array]:
    """Moment, strain and axial compliance at a curvature (times B), and the slopes of the last two by it."""

    def of(k):
        f, H = functions(c, k), c.x[5]
        M = moment(c, f)
        stretched = strain(c.numbers[PLACES["stretch"]], f, H, force(c, f), M)
        axial = 0.25 / H * jnp.exp(log_compliance(c.numbers[PLACES["compliance"]], f))
        return (stretched, axial), M

    (stretched, axial), (strain_slope, axial_slope), M = jax.jvp(of, (k,), (jnp.ones_like(k),), has_aux=True)
    return {
        "moment": M,
        "strain": stretched,
        "compliance": axial,
        "strain_slope": strain_slope,
        "compliance_slope": axial_slope,
    }
