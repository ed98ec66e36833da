"""The form of the cell law: sums of products of known functions, whose coefficients are fitted.

    f(kappa; p, geometry) = sum_ijk C_ijk G_i(geometry) P_j(p / mu) K_k(kappa)

for the moment (beside that of the cover), the force, the lever, the stretch and the axial compliance, each over a
typical size. G: polynomials of second degree in the logarithms of the six lengths over B; P: functions of the pressure
that rise fast, as the walls touch, or steadily; K: a constant, the curvature, and softplus functions of it (smooth
kinks), which stand close where rims meet. A beam asks for the sums over i and j once at each pressure, and for those
over k at each of its points.

Lengths are over B, curvatures times B, pressures over mu, moments over mu B^3, forces over mu B^2.
"""

from __future__ import annotations

from typing import Any

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
HEADS = ("moment", "force", "lever", "stretch", "compliance")
MOST_PRESSURE = 0.24
"""Over mu, where the states end."""
RISE = 0.1
"""Of MOST_PRESSURE: walls begin to touch at about this pressure."""
SPREAD = 0.25
"""Curvatures enter over four times the one at which the rims of rigid neighbours meet."""
KNOTS = np.array([-0.7, -0.55, -0.45, -0.38, -0.32, -0.27, -0.22, -0.1, 0.1, 0.3, 0.55, 0.8, 1.1, 1.5])
SHARPNESS = np.array([12.0, 15, 20, 25, 30, 30, 30, 12, 8, 8, 7, 6, 5, 4])
TOP = 0.1
"""Thickness of the top wall over B."""
TYPE_A = np.array([5.0, 8.0, 1.1, 0.9, 4.2, 5.0]) / 20
POWERS = np.array([2.5, 1.5, -0.8, -0.6, 0.0, 0.4])
"""Of the six lengths, as the blocked moment of the solid goes with them at type A and 12 to 32 kPa."""
COVER = 0.93
"""Bending stiffness of a cell without pressure over mu B H^3 / 3, types A and E."""
SHARP = 20.0
"""Forces below a twentieth of their scale are rounded off towards zero."""
GEOMETRIES, PRESSURES, CURVATURES = 28, 6, 2 + len(KNOTS)


def geometry_functions(x: Array) -> Array:
    """G: 1, z_i, z_i z_j of z, the lengths' logarithms from -1 to 1."""
    z = (jnp.log(x) - MIDDLE) / HALF_WIDTH
    first, second = np.triu_indices(len(SIZES))
    return jnp.concatenate([jnp.ones(1), z, z[first] * z[second]])


def pressure_functions(p: Scalar) -> Array:
    """P: 1, u, s, u^2, s^2, u^3 with s = p / MOST_PRESSURE and u = s / (s + RISE)."""
    s = p / MOST_PRESSURE
    u = s / (s + RISE)
    return jnp.stack([jnp.ones_like(s), u, s, u * u, s * s, u * u * u])


def curvature_functions(x: Scalar) -> tuple[Array, Array]:
    """K and its slopes at the scaled curvature x."""
    y = (x - KNOTS) * SHARPNESS
    values = jnp.concatenate([jnp.stack([jnp.ones_like(x), x]), jax.nn.softplus(y) / SHARPNESS])
    slopes = jnp.concatenate([jnp.stack([jnp.zeros_like(x), jnp.ones_like(x)]), jax.nn.sigmoid(y)])
    return values, slopes


def rims_meet(x: Array) -> Scalar:
    """B times the curvature (positive) at which the rims of rigid neighbours would meet."""
    a, _, _, gap, length, H = x
    return gap / ((0.5 * length + gap) * (0.5 * H + 2 * a + TOP))


def scales(x: Array) -> Array:
    """Typical size of each of HEADS: the moment of the walls goes with powers of the lengths, see POWERS."""
    a, H = x[0], x[5]
    arm = 0.5 * H + a
    size = jnp.exp(jnp.sum(POWERS * (jnp.log(x) - jnp.log(TYPE_A))))
    force = 0.025 * size * 0.375 / arm
    return jnp.stack([0.00625 * size, force, arm, 0.5 * force / H, 0.25 / H])


def coefficients(C: Any, x: Array, p: Scalar) -> dict[str, Array]:
    """Coefficients of K, (heads, curvatures), from all of them, (heads, curvatures, pressures x geometries)."""
    products = jnp.outer(pressure_functions(p), geometry_functions(x)).reshape(-1)
    return {"c": jnp.asarray(C) @ products, "unit": rims_meet(x), "scale": scales(x), "bending": COVER * x[5] ** 3 / 3}


def at_curvature(c: dict[str, Array], k: Scalar) -> dict[str, Array]:
    """The five values at a curvature (times B), and the slopes of the stretch and the compliance by it."""
    per_curvature = SPREAD / c["unit"]
    values, slopes = curvature_functions(per_curvature * k)
    moment, force, lever, stretch, compliance = c["c"] @ values
    bent = c["c"][3:] @ slopes
    s = c["scale"]
    axial = jnp.exp(compliance) * s[4]
    return {
        "moment": c["bending"] * k + moment * s[0],
        # Forces only push; softplus keeps them smooth.
        "force": jax.nn.softplus(force * SHARP) / SHARP * s[1],
        "lever": (1 + lever) * s[2],
        "stretch": stretch * s[3],
        "compliance": axial,
        "stretch_slope": bent[0] * s[3] * per_curvature,
        "compliance_slope": bent[1] * axial * per_curvature,
    }
