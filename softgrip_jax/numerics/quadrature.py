"""Functions along a line by their values at Gauss points: integrals, and values in between.

A function that is as smooth as a bent beam's curvature is known to the last bits from a dozen values: errors fall
geometrically with their number, and what is integrated to the end gains the square of that (de Boor and Swartz 1973).
All values are unknowns at once, so nothing grows along the line as it does in shooting.

Libraries that were looked at: diffrax solves initial-value problems alone (`ivp.py` uses it), and so boundary
values by shooting only. SciPy's solve_bvp refines its mesh in NumPy, of fourth order: it cannot be compiled or
differentiated, and is what the tests compare with.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre


class Points(NamedTuple):
    """Gauss points of the interval from 0 to 1."""

    places: np.ndarray
    weights: np.ndarray
    up_to: np.ndarray
    """up_to @ values: integrals from 0 to each point."""
    beyond: np.ndarray
    """beyond @ values: integrals from each point to 1."""
    spectrum: np.ndarray
    """spectrum @ values: coefficients of Legendre polynomials."""


@cache
def gauss_points(count: int) -> Points:
    """`count` Gauss points and what belongs to them."""
    x, weights = legendre.leggauss(count)
    spectrum = np.linalg.inv(legendre.legvander(x, count - 1))
    integrals = legendre.legval(x, legendre.legint(np.eye(count), lbnd=-1), tensor=True).T
    up_to = 0.5 * integrals @ spectrum
    return Points(0.5 * (x + 1), 0.5 * weights, up_to, 0.5 * weights - up_to, spectrum)


def integrals(
    values: Float[Array, "parts points"], widths: Float[Array, " parts"], points: Points
) -> tuple[Float[Array, "parts points"], Float[Array, " parts"]]:
    """Integrals from the beginning of a line of several parts to every point and to the end of every part."""
    whole = widths * (values @ points.weights)
    ends = whole if len(whole) == 1 else jnp.cumsum(whole)
    return (ends - whole)[:, None] + widths[:, None] * (values @ points.up_to.T), ends


def remaining(
    values: Float[Array, "parts points"], widths: Float[Array, " parts"], points: Points
) -> Float[Array, "parts points"]:
    """Integrals from every point to the end of a line of several parts."""
    within = widths[:, None] * (values @ points.beyond.T)
    if len(values) == 1:
        return within
    whole = widths * (values @ points.weights)
    return within + (jnp.sum(whole) - jnp.cumsum(whole))[:, None]


def between(
    values: Float[Array, "parts points"], place: Float[Array, ""], part: Array | int, points: Points
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(value at a place from 0 to 1 in a part; integral from the part's beginning to there, over its width)."""
    coefficients = jnp.asarray(points.spectrum) @ values[part]
    x = 2 * place - 1
    polynomials = [jnp.ones_like(x), x]
    for k in range(1, len(points.places)):
        polynomials.append(((2 * k + 1) * x * polynomials[k] - k * polynomials[k - 1]) / (k + 1))
    rising = [0.5 * (x + 1)]
    rising += [0.5 * (polynomials[k + 1] - polynomials[k - 1]) / (2 * k + 1) for k in range(1, len(points.places))]
    return jnp.dot(coefficients, jnp.stack(polynomials[: len(rising)])), jnp.dot(coefficients, jnp.stack(rising))
