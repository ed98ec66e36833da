"""The polynomials of the energy membrane, at quadrature points and at contact points: constants.

u, v and w are sums of products of polynomials in (xi, eta) = (X / a, Y / b) that vanish on the clamped edges. The
membrane moves far out of its plane and little within it, so u and v have fewer of them (IN_PLANE).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from .grid_sums import Patch

Vector = Float[Array, " n"]

SPARE_POINTS = 3
"""Gauss points on a half side beyond one per polynomial: twice as many change forces by less than 1e-3."""
IN_PLANE = (3 / 4, 2 / 3)
"""Polynomials of u and v per polynomial of w, across and along: as many as w has change forces by less than 1 %."""

CONTACT_POINTS = 3
"""Contact points on each half side per polynomial of w: forces differ by less than 0.5 % from those of four."""


class Grid(NamedTuple):
    """What is chosen before anything is computed: the polynomials and the symmetry."""

    across: int
    """Polynomials of w of each parity across the width."""
    along: int
    """The same along the length."""
    symmetry: str
    """Mirror symmetry: 'across' (x -> -x), 'along' (y -> -y), 'both' or 'none'."""


Rule = tuple[np.ndarray, np.ndarray]
"""Points and weights."""
Values = tuple[Float[np.ndarray, "r q nu"], Float[np.ndarray, "r q nv"], Float[np.ndarray, "r q nw"]]
"""Of u, v, w: each derivative (ORDERS) of each polynomial at each point."""

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Derivatives by (xi, eta) that tables hold; the last three are for bending and for maps of the contact."""


class Tables(NamedTuple):
    """Polynomials at grids of points, one grid after the other."""

    points: Float[np.ndarray, "q 2"]
    """(xi, eta)."""
    weights: Float[np.ndarray, " q"]
    """Their sum is 4, the area of the square from -1 to 1."""
    patches: tuple[Patch, ...]


def polynomials(degrees: list[int], x: np.ndarray) -> Float[np.ndarray, "k 3 n"]:
    """Values and two derivatives of the polynomials of these degrees that vanish at -1 and 1.

    P_k - P_{k-2}, over the norm of their slopes, which are orthogonal.
    """
    rows = []
    for k in degrees:
        series = np.eye(k + 1)[k] - np.eye(k + 1)[k - 2]
        slope = legendre.legder(series)
        square = legendre.legint(legendre.legmul(slope, slope))
        size = np.sqrt(legendre.legval(1, square) - legendre.legval(-1, square))
        rows.append([legendre.legval(x, legendre.legder(series, m)) / size for m in range(3)])
    return np.array(rows)


def _is_even(grid: Grid, axis: int) -> bool:
    return grid.symmetry in ("both", ("across", "along")[axis])


def _degrees(n: int, even: bool, symmetric: bool) -> list[int]:
    """Of n polynomials of one parity, or of n of both."""
    return [2 * k + (2 if even else 3) for k in range(n)] if symmetric else [k + 2 for k in range(2 * n)]


def lattice(grid: Grid, apart: int) -> Tables:
    """A lattice over what is looked at, `apart` times as fine as the contact points; its weights are even."""
    halves = []
    for count in (grid.across, grid.along):
        number = apart * CONTACT_POINTS * count
        halves.append(((np.arange(number) + 0.5) / number, np.full(number, 2 / number)))
    return _product(grid, halves)


def _kinds(grid: Grid) -> tuple[tuple[tuple[int, int], tuple[bool, bool]], ...]:
    """Of u, v, w: how many polynomials of each parity along both axes, and which parity symmetry leaves."""
    few, many = counts(grid), (grid.across, grid.along)
    return (few, (False, True)), (few, (True, False)), (many, (True, True))


def counts(grid: Grid) -> tuple[int, int]:
    """Polynomials of u and v of each parity, across and along."""
    return math.ceil(IN_PLANE[0] * grid.across), math.ceil(IN_PLANE[1] * grid.along)


def at_points(grid: Grid, points: Any, orders: Sequence[tuple[int, int]] = ORDERS[:3]) -> Values:
    """Each derivative of each polynomial of u, v, w at any points (xi, eta)."""
    xi, eta = np.asarray(points, dtype=float).T
    found = [
        np.stack([(x[:, None, i] * y[None, :, j]).reshape(-1, len(xi)).T for i, j in orders])
        for x, y in _sides(grid, xi, eta)
    ]
    return found[0], found[1], found[2]


def _sides(grid: Grid, xi: np.ndarray, eta: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Of u, v, w: the polynomials along both axes, there. u is odd across, v odd along, w even in both."""
    return tuple(
        (
            polynomials(_degrees(number[0], even[0], _is_even(grid, 0)), xi),
            polynomials(_degrees(number[1], even[1], _is_even(grid, 1)), eta),
        )
        for number, even in _kinds(grid)
    )


def _product(grid: Grid, rules: Sequence[Rule], orders: Sequence[tuple[int, int]] = ORDERS[:3]) -> Tables:
    """Points and weights (of half a side, their sum is 2) on the side that is looked at, or mirrored to both."""
    sides = []
    for axis, (x, weights) in enumerate(rules):
        both = np.concatenate([-x[::-1], x]), np.concatenate([weights[::-1], weights]) / 2
        sides.append((x, weights) if _is_even(grid, axis) else both)
    (x, wx), (y, wy) = sides
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return Tables(points, np.outer(wx, wy).ravel(), (Patch(_sides(grid, x, y), tuple(orders)),))


def _gauss(n: int) -> Rule:
    """n Gauss points of a whole side with an even number of them: one half."""
    x, weights = legendre.leggauss(2 * n)
    return x[x > 0], 2 * weights[x > 0]


def _sheet_points(grid: Grid) -> tuple[Rule, Rule]:
    return _gauss(grid.across + SPARE_POINTS), _gauss(grid.along + SPARE_POINTS)


@functools.cache
def quadrature(grid: Grid) -> Tables:
    """Gauss points for the sheet."""
    return _product(grid, _sheet_points(grid))


@functools.cache
def bending_tables(grid: Grid) -> Tables:
    """The same for bending: first and second derivatives. With fewer points polynomials fold between them freely."""
    return _product(grid, _sheet_points(grid), ORDERS[1:])


@functools.cache
def clamp_tables(grid: Grid) -> Tables:
    """Gauss points on the long edges x = +-a, then on the short ones: the derivative across the edge.

    The weights of each pair of edges sum to 4, two sides of length 2.
    """
    edge = np.ones(1), 2 * np.ones(1)
    across, along = _sheet_points(grid)
    long, short = _product(grid, (edge, along), ORDERS[1:2]), _product(grid, (across, edge), ORDERS[2:3])
    points, weights = (np.concatenate(pair) for pair in zip(long[:2], short[:2], strict=True))
    return Tables(points, weights, long.patches + short.patches)


def contact_axes(grid: Grid) -> tuple[Rule, Rule]:
    """Points and weights on half a side, across and along, where contact is asked for."""

    def half(n: int) -> Rule:
        x, weights = legendre.leggauss(CONTACT_POINTS * n)
        return (x + 1) / 2, weights

    return half(grid.across), half(grid.along)


@functools.cache
def contact_tables(grid: Grid) -> Tables:
    """The points of `contact_axes` on what is looked at."""
    return _product(grid, contact_axes(grid))
