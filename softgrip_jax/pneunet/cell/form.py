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
"""

from __future__ import annotations

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
NO_FORCE = 1e-15
"""Over mu B^2: twice the force where there is none, so that its derivatives exist there."""
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
    a, _, _, gap, length, H = x
    return gap / ((0.5 * length + gap) * (0.5 * H + 2 * a + TOP))


def ramp(x: Array, width: Any) -> Array:
    """The larger of x and 0, rounded off over the width."""
    return 0.5 * (x + jnp.sqrt(x * x + width * width))


def pressing(x: Any) -> Array:
    """What pressed rims add at the depth x: a ramp that starts as a square, so that it leaves no tail before it."""
    r = ramp(jnp.asarray(x), RIM_WIDTHS)
    return r * r / (r + RIM_WIDTHS)


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
    rims: Array


def functions(c: Loaded, k: Scalar) -> Functions:
    """E, p, o - 1 (both in their units), k and the ramps of the rims, zero without curvature."""
    log_touch, m, n = c.numbers[PLACES["touch"]]
    opening = k / c.rims_meet
    w = ramp(1 + opening, CLOSED)
    E = jnp.exp(-jnp.exp(n * (log_touch + m * jnp.log(w) - jnp.log(c.pressure + LEAST_PRESSURE))))
    rims = pressing(RIM_KNOTS - 1 - opening) - pressing(RIM_KNOTS - 1)
    return Functions(E, c.pressure / PRESSURE_UNIT, opening / OPENING_UNIT, k, rims)


def shape(numbers: Array, f: Functions) -> Scalar:
    """s of the pressed walls, see SHAPE."""
    E, p, o = f.E - 0.5, f.p, f.o
    return 1 + numbers @ jnp.stack([p, p * p, o, o * o, E, E * E, p * o, E * o, E * o * o, E * p])


def wall_force(c: Loaded) -> Scalar:
    """W: the pressure on one wall."""
    return 4 * c.x[0] * c.x[1] * c.pressure


def pressed_rims(numbers: Array, f: Functions, c: Loaded) -> Scalar:
    """Force of pressed rims; it goes with the wall's area."""
    return 0.4 * c.x[0] * c.x[1] * (numbers @ jnp.concatenate([f.rims, f.p * f.rims]))


def moment(c: Loaded, f: Functions) -> Scalar:
    """M, over mu B^3."""
    a, H = c.x[0], c.x[5]
    numbers = c.numbers[PLACES["moment"]]
    size, others = numbers[0], numbers[1:]
    s, (c_0, c_1, c_2, d_0, d_1), rims = others[:10], others[10:15], others[15:]
    cover = H**3 / 3 * f.k * (c_0 + 0.3 * f.k * (c_1 + c_2 * f.k))
    walls = wall_force(c) * (a + 0.5 * H) * (jnp.exp(size) * f.E * shape(s, f) + d_0 + d_1 * f.o)
    return cover - walls - (2 * a + 0.5 * H) * pressed_rims(rims, f, c)


def force_unrounded(c: Loaded, f: Functions) -> tuple[Scalar, Scalar]:
    """F over mu B^2 before it is kept from pulling, and below what it is rounded off."""
    numbers = c.numbers[PLACES["force"]]
    whole = wall_force(c) * jnp.exp(numbers[0]) * f.E
    return whole * shape(numbers[1:11], f) + pressed_rims(numbers[11:], f, c), ROUNDED * whole


def force(c: Loaded, f: Functions) -> Scalar:
    """F, over mu B^2: it only pushes."""
    value, width = force_unrounded(c, f)
    return 0.5 * (value + jnp.sqrt(value * value + width * width + NO_FORCE**2))


def stretch_terms(f: Functions, H: Scalar, F: Scalar, M: Scalar) -> Array:
    """What the strain without axial force is a sum of, F and M being the cell's: the walls' force pulls the cover."""
    E, p, o, k = f.E, f.p, f.o, f.k
    F, M = F / (4 * H), M / H**2
    bent = (k, k * k, k * k * k, E * k * H, E * k * k * H)
    return jnp.stack([F, F * E, F * p, F * F, p, p * p, p * o, M, *bent, *f.rims])


def lever_terms(f: Functions) -> Array:
    """What the lever over a + H / 2, less one, is a sum of."""
    E, p, o = f.E, f.p, f.o
    return jnp.stack([jnp.ones_like(E), E, E * E, p, o, o * o, E * o, *f.rims])


def compliance_terms(f: Functions) -> Array:
    """What the logarithm of the axial compliance over B / (4 H) is a sum of."""
    E, p, o, k = f.E, f.p, f.o, f.k
    return jnp.stack([jnp.ones_like(E), E, E * E, p, E * p, E * o, k, k * k, *f.rims])


def at_curvature(c: Loaded, k: Scalar) -> dict[str, Array]:
    """The five values at a curvature (times B), and the slopes of the stretch and the compliance by it."""

    def of(k):
        f = functions(c, k)
        M, F = moment(c, f), force(c, f)
        strain = c.numbers[PLACES["stretch"]] @ stretch_terms(f, c.x[5], F, M)
        axial = 0.25 / c.x[5] * jnp.exp(c.numbers[PLACES["compliance"]] @ compliance_terms(f))
        lever = 1 + c.numbers[PLACES["lever"]] @ lever_terms(f)
        return (strain, axial), {"moment": M, "force": F, "lever": lever * (c.x[0] + 0.5 * c.x[5])}

    (strain, axial), (strain_slope, axial_slope), others = jax.jvp(of, (k,), (jnp.ones_like(k),), has_aux=True)
    return others | {
        "stretch": strain,
        "compliance": axial,
        "stretch_slope": strain_slope,
        "compliance_slope": axial_slope,
    }
