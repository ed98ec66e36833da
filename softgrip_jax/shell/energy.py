"""The membrane as a minimum of energy: displacements in polynomials, one density, one sum over points.

The membrane 2a x 2b lies in z = 0; its point (xi a, eta b) moves by a (u, v, w)(xi, eta). Equilibrium is a minimum of

    Pi / (mu t_m a^2) = integral W(C) / mu  -  p a / (mu t_m) * volume  +  contact,       lengths in a, per flat area,

with C = F^T F of the middle surface (plane stress, incompressible), the volume w (F11 F22 - F12 F21) under it, and
contact by an augmented Lagrangian: (max(0, lambda - rho g)^2 - lambda^2) / (2 rho) with the gap g of the outer face.
u, v and w are sums of products of polynomials that vanish on the clamped edges; integrals are Gauss sums. Everything
that depends on the displacement is written in `density` for ONE point; the rest is linear algebra with constant tables.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

SPARE_POINTS = 4
"""Gauss points on a half side beyond two per polynomial: with fewer the force on a plane moves by more than 1 %."""


class Grid(NamedTuple):
    """What is chosen before anything is computed: the polynomials and the symmetry."""

    across: int
    """Polynomials of each parity across the width."""
    along: int
    """The same along the length."""
    symmetry: str
    """Mirror symmetry: 'across' (x -> -x), 'along' (y -> -y), 'both' or 'none'."""
    bending: bool
    """Whether w has no slope on the edges and second derivatives are needed."""


class Tables(NamedTuple):
    """Polynomials at the quadrature points: constants."""

    points: Float[np.ndarray, "q 2"]
    """(xi, eta)."""
    weights: Float[np.ndarray, " q"]
    """Their sum is 4, the area of the square from -1 to 1."""
    values: Float[np.ndarray, "3 q r m"]
    """Of u, v, w at each point: value, d/dxi, d/deta (and d2/dxi2, d2/dxi deta, d2/deta2) of each polynomial."""


ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Derivatives by (xi, eta), in the order of the tables."""


def polynomials(degrees: list[int], x: np.ndarray, clamped: bool) -> Float[np.ndarray, "k 3 n"]:
    """Values and two derivatives of the polynomials of these degrees that vanish at -1 and 1.

    P_k - P_{k-2} (their slopes are orthogonal), or clamped, without slope at the ends: (1 - x^2)^2 P_{k-2}.
    """
    rows = []
    for k in degrees:
        series = legendre.legmul([2 / 3, 0, -2 / 3], [2 / 3, 0, -2 / 3]) if clamped else np.eye(k + 1)[k]
        series = legendre.legmul(series, np.eye(k - 1)[k - 2]) if clamped else series - np.eye(k + 1)[k - 2]
        slope = legendre.legder(series)
        square = legendre.legint(legendre.legmul(slope, slope))
        size = np.sqrt(legendre.legval(1, square) - legendre.legval(-1, square))
        rows.append([legendre.legval(x, legendre.legder(series, m)) / size for m in range(3)])
    return np.array(rows)


def _axis(n: int, symmetric: bool) -> tuple[list[int], list[int], np.ndarray, np.ndarray]:
    """Degrees of what is even and of what is odd along an axis, Gauss points and weights (their sum is 2)."""
    x, weights = legendre.leggauss(2 * n + SPARE_POINTS)
    x = (x + 1) / 2
    if symmetric:
        return [2 * k + 2 for k in range(n)], [2 * k + 3 for k in range(n)], x, weights
    # The same points on both sides: a symmetric scene gives the same result with and without its symmetry.
    every = [k + 2 for k in range(2 * n)]
    return every, every, np.concatenate([-x[::-1], x]), np.concatenate([weights[::-1], weights]) / 2


def _degrees(grid: Grid) -> tuple[list[tuple[list[int], list[int]]], list[tuple[np.ndarray, np.ndarray]]]:
    """Degrees of (u, v, w) across and along, and the Gauss rules: u is odd across, v odd along, w even."""
    even_x, odd_x, x, wx = _axis(grid.across, grid.symmetry in ("across", "both"))
    even_y, odd_y, y, wy = _axis(grid.along, grid.symmetry in ("along", "both"))
    return [(odd_x, even_y), (even_x, odd_y), (even_x, even_y)], [(x, wx), (y, wy)]


def at_points(grid: Grid, points: Any) -> Float[np.ndarray, "3 q r m"]:
    """The tables' `values` at any points (xi, eta)."""
    xi, eta = np.asarray(points, dtype=float).T
    orders = ORDERS if grid.bending else ORDERS[:3]
    rows = []
    for k, (x_degrees, y_degrees) in enumerate(_degrees(grid)[0]):
        x = polynomials(x_degrees, xi, grid.bending and k == 2)
        y = polynomials(y_degrees, eta, grid.bending and k == 2)
        products = [x[:, None, i] * y[None, :, j] for i, j in orders]
        rows.append(np.stack(products).reshape(len(orders), -1, len(xi)).transpose(2, 0, 1))
    return np.stack(rows)


@functools.cache
def tables(grid: Grid) -> Tables:
    """The tables at the Gauss points."""
    (x, wx), (y, wy) = _degrees(grid)[1]
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return Tables(points, np.outer(wx, wy).ravel(), at_points(grid, points))


class Local(NamedTuple):
    """The deformation at one point; lengths in a."""

    place: Float[Array, 3]
    """Of the middle surface."""
    along_x: Float[Array, 3]
    along_y: Float[Array, 3]
    """Tangents dx/dX, dx/dY: the columns of F."""
    normal: Float[Array, 3]
    """Their cross product, lambda_1 lambda_2 times the unit normal."""

    @property
    def trace(self) -> Scalar:
        """Of C."""
        return self.along_x @ self.along_x + self.along_y @ self.along_y

    @property
    def determinant(self) -> Scalar:
        """Of C: the square of the ratio of areas."""
        return self.normal @ self.normal

    def face(self, thickness: Scalar) -> Float[Array, 3]:
        """Place of the outer face, seen from where it is at rest (z = 0): thickness t_m / a thins by 1/(l1 l2)."""
        rest = jnp.array([0.0, 0.0, 1.0], self.place.dtype)
        return self.place + 0.5 * thickness * (self.normal / self.determinant - rest)


def local(e: Float[Array, "3 r"], point: Float[Array, 2], aspect: Scalar) -> Local:
    """The deformation from the table's derivatives e of (u, v, w) at the point (xi, eta); aspect: a / b."""
    x = e[:, 1] + jnp.array([1.0, 0.0, 0.0], e.dtype)
    y = aspect * e[:, 2] + jnp.array([0.0, 1.0, 0.0], e.dtype)
    flat = jnp.stack([point[0], point[1] / aspect, jnp.zeros_like(aspect)])
    return Local(flat + e[:, 0], x, y, jnp.cross(x, y))


def tension_field(trace: Scalar, determinant: Scalar) -> tuple[Scalar, Scalar]:
    """(tr C, det C) of the sheet once its wrinkles are drawn out: what its energy is computed from.

    A thin sheet bears no compression. Where it is narrower than its natural width under uniaxial tension,
    lambda_2 < lambda_1^(-1/2) (the same for every isotropic incompressible material), it wrinkles at no cost and its
    energy is that of uniaxial tension; where also lambda_1 < 1 it is slack and has none (Pipkin 1986). The energy so
    relaxed has continuous tensions, never negative.
    """
    mean = 0.5 * trace
    apart = mean**2 - determinant
    equal = apart < (1e-8 * mean) ** 2
    square = mean + jnp.where(equal, 0.0, jnp.sqrt(jnp.where(equal, 1.0, apart)))
    stretch = jnp.sqrt(square)
    wrinkled, slack = determinant < stretch, square < 1
    drawn = jnp.where(slack, 2.0, square + 1 / stretch), jnp.where(slack, 1.0, stretch)
    return jnp.where(wrinkled, drawn[0], trace), jnp.where(wrinkled, drawn[1], determinant)


def bent(e: Float[Array, "3 6"], at: Local, aspect: Scalar, thickness: Scalar) -> list[tuple[Scalar, Scalar]]:
    """(tr C, det C) of the fibres at the two Gauss points through the thickness, z = +-t_m / (2 sqrt 3).

    C(z) = C - 2 zeta K + zeta^2 K C^-1 K, with K the curvature n . d2x/dX2 and zeta = z / (lambda_1 lambda_2), because
    the sheet thins as it stretches (Kirchhoff-Love). Their mean energy is right to the order of bending, for any W.
    """
    zeta = thickness / np.sqrt(12) / at.determinant  # the unit normal is at.normal / sqrt(det C)
    k11 = zeta * (at.normal @ e[:, 3])
    k12 = zeta * aspect * (at.normal @ e[:, 4])
    k22 = zeta * aspect**2 * (at.normal @ e[:, 5])
    c = jnp.stack([jnp.stack([at.along_x @ at.along_x, at.along_x @ at.along_y]), jnp.zeros(2, e.dtype)])
    c = c.at[1].set(jnp.stack([c[0, 1], at.along_y @ at.along_y]))
    k = jnp.stack([jnp.stack([k11, k12]), jnp.stack([k12, k22])])
    adjugate = jnp.stack([jnp.stack([c[1, 1], -c[0, 1]]), jnp.stack([-c[0, 1], c[0, 0]])])
    third = k @ adjugate @ k / at.determinant
    fibres = [c - 2 * side * k + third for side in (1, -1)]
    return [(f[0, 0] + f[1, 1], f[0, 0] * f[1, 1] - f[0, 1] ** 2) for f in fibres]


class Load(NamedTuple):
    """What acts on the membrane, scaled: everything that an equilibrium depends on beside the scene."""

    pressure: Scalar
    """p a / (mu t_m)."""
    multipliers: Float[Array, " q"]
    """Contact pressure of the augmented Lagrangian at each point, per flat area, in the same unit."""
    stiffness: Scalar
    """rho of the augmented Lagrangian, in that unit per a."""


def density(e: Float[Array, "3 r"], point: Float[Array, 2], multiplier: Scalar, scene: Any, load: Load) -> Scalar:
    """Potential energy per flat area at one point, in mu t_m."""
    shell = scene.shell
    aspect, thickness, mu = shell.a / shell.b, shell.t_m / shell.a, shell.material.shear_modulus()
    at = local(e, point, aspect)
    if scene.grid.bending:
        elastic = sum(shell.material.sheet_energy(*fibre) for fibre in bent(e, at, aspect, thickness)) / 2
    else:
        elastic = shell.material.sheet_energy(*tension_field(at.trace, at.determinant))
    total = elastic / mu - load.pressure * at.place[2] * at.normal[2]
    if scene.body is None:
        return total
    pressed = contact_pressure(gap(e, point, scene), multiplier, load.stiffness)
    return total + (pressed**2 - multiplier**2) / (2 * load.stiffness)


def gap(e: Float[Array, "3 r"], point: Float[Array, 2], scene: Any) -> Scalar:
    """Signed distance of the outer face from the object at one point, in a."""
    shell = scene.shell
    place = local(e, point, shell.a / shell.b).face(shell.t_m / shell.a)
    return scene.body.distance(place * shell.a) / shell.a


def contact_pressure(gap: Array, multiplier: Array, stiffness: Scalar) -> Array:
    """max(0, lambda - rho g): what presses, and the next multiplier."""
    return jnp.maximum(0, multiplier - stiffness * gap)


class Functional:
    """The sum of `density` over the points of a grid, with its derivatives by the coefficients y.

    y holds the coefficients of u, v, w one after the other. The second derivatives of the density at a point are a
    small matrix D; the Hessian is the sum of B^T D B over the points, with the constant tables B.
    """

    def __init__(self, grid: Grid):
        self.grid, self.tables = grid, tables(grid)
        self.size = 3 * self.tables.values.shape[-1]
        self.gradient = jax.custom_jvp(self._gradient)
        self.gradient.defjvp(self._gradient_jvp)

    def deformed(self, y: Vector, values: Any = None) -> Float[Array, "q 3 r"]:
        """The derivatives e of (u, v, w) at the points of the grid, or at those that tables `values` were made for."""
        values = self.tables.values if values is None else values
        return jnp.einsum("cqri,ci->qcr", values, y.reshape(3, -1))

    def height_of_first(self) -> float:
        """w / a in the middle for a coefficient of 1 of the first polynomial of w."""
        return float(at_points(self.grid, [(0.0, 0.0)])[2, 0, 0, 0])

    def at_every_point(self, function: Callable, y: Vector, scene: Any, load: Load) -> Any:
        """function(e, point, multiplier, scene, load) at every point."""
        return jax.vmap(function, in_axes=(0, 0, 0, None, None))(
            self.deformed(y), self.tables.points, load.multipliers, scene, load
        )

    def area_weights(self, scene: Any) -> Float[Array, " q"]:
        """Weights of the points for integrals over the flat membrane, in a^2."""
        return self.tables.weights * (scene.shell.b / scene.shell.a)

    def value(self, y: Vector, scene: Any, load: Load) -> Scalar:
        """Potential energy, in mu t_m a^2."""
        return jnp.dot(self.area_weights(scene), self.at_every_point(density, y, scene, load))

    def _gradient(self, y: Vector, scene: Any, load: Load) -> Vector:
        """d value / dy: zero in equilibrium."""
        slopes = self.at_every_point(jax.grad(density), y, scene, load)
        return jnp.einsum("cqri,qcr,q->ci", self.tables.values, slopes, self.area_weights(scene)).ravel()

    def _gradient_jvp(self, primals: Any, tangents: Any) -> tuple[Vector, Vector]:
        (y, scene, load), (along, *rest) = primals, tangents
        gradient, other = jax.jvp(lambda *args: self._gradient(y, *args), (scene, load), tuple(rest))
        return gradient, self.hessian(y, scene, load) @ along + other

    def hessian(self, y: Vector, scene: Any, load: Load) -> Float[Array, "n n"]:
        """d2 value / dy2."""
        curvatures = self.at_every_point(jax.hessian(density), y, scene, load)
        return self._assembled(curvatures, scene)

    def _assembled(self, curvatures: Float[Array, "q 3 r 3 r"], scene: Any) -> Float[Array, "n n"]:
        # Three entries of D at a time are cheaper as sums than as a product of matrices; B^T (D B) is one for each row.
        b, orders = self.tables.values, range(self.tables.values.shape[2])
        weighted = curvatures * self.area_weights(scene)[:, None, None, None, None]
        rows = []
        for c in range(3):
            half = [sum(weighted[:, c, :, d, s, None] * b[d][:, None, s, :] for s in orders) for d in range(3)]
            half = jnp.concatenate(half, axis=-1).reshape(-1, self.size)
            rows.append(b[c].reshape(len(half), -1).T @ half)
        return jnp.concatenate(rows)

    def expansion(self, y: Vector, scene: Any, load: Load) -> tuple[Scalar, Vector, Float[Array, "n n"]]:
        """Value, gradient and Hessian in one pass: what Newton's method asks for."""
        value, slopes, curvatures = self.at_every_point(_expansion, y, scene, load)
        weights = self.area_weights(scene)
        gradient = jnp.einsum("cqri,qcr,q->ci", self.tables.values, slopes, weights).ravel()
        return jnp.dot(weights, value), gradient, self._assembled(curvatures, scene)

    def gaps(self, y: Vector, scene: Any) -> Float[Array, " q"]:
        """`gap` at every point."""
        return jax.vmap(gap, in_axes=(0, 0, None))(self.deformed(y), self.tables.points, scene)


def _expansion(e, point, multiplier, scene, load):
    """Value, gradient and Hessian of the density at one point: tangents of a gradient that also returns its value."""

    def with_slope(e):
        value, slope = jax.value_and_grad(density)(e, point, multiplier, scene, load)
        return slope, (value, slope)

    curvature, (value, slope) = jax.jacfwd(with_slope, has_aux=True)(e)
    return value, slope, curvature


@functools.cache
def functional(grid: Grid) -> Functional:
    """One per grid: its tables are computed once."""
    return Functional(grid)
