"""The deformed sheet at one point: strains, faces, wrinkles and bending. Lengths in a.

The membrane 2a x 2b lies in z = 0; its point (xi a, eta b) moves by a (u, v, w)(xi, eta). `e` holds the derivatives of
(u, v, w) in the order of `basis.ORDERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]

RESOLVED = 5.0
"""Stiffness of the slope at a clamped edge per polynomial, in D / a: fitted to finite elements of a wall with t_m / a =
0.22 on a plane and of one with 0.07 in free space."""


class Local(NamedTuple):
    """The deformation at one point."""

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
    """The deformation from the derivatives e of (u, v, w) at the point (xi, eta); aspect: a / b."""
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


def stretching(material: Any, bends: bool, trace: Scalar, determinant: Scalar) -> Scalar:
    """W of the middle surface, J/m^3. What resists bending resists compression, too: with `bending` this is the mean
    energy of the fibres, which is never negative. What does not bend wrinkles at no cost."""
    return material.sheet_energy(*((trace, determinant) if bends else tension_field(trace, determinant)))


def bending_measures(e: Float[Array, "3 5"], aspect: Scalar) -> Float[Array, 6]:
    """What bending depends on: c_11, c_12, c_22 of C, and m . d2x/dX2 (11, 12, 22) with m = dx/dX x dx/dY.

    e: the first and second derivatives of (u, v, w).
    """
    x, y, xx, xy, yy = tangents(e, aspect).T
    normal = jnp.cross(x, y)
    return jnp.stack([x @ x, x @ y, y @ y, normal @ xx, normal @ xy, normal @ yy])


def tangents(e: Float[Array, "3 5"], aspect: Scalar) -> Float[Array, "3 5"]:
    """dx/dX, dx/dY and the second derivatives (XX, XY, YY) of the place, as columns."""
    return jnp.asarray(FLAT) + e * _tangent_scales(aspect)[None]


def _tangent_scales(aspect: Scalar) -> Float[Array, 5]:
    return jnp.stack([jnp.ones_like(aspect), aspect, jnp.ones_like(aspect), aspect, aspect**2])


def chained_bending(
    e: Float[Array, "3 5"], aspect: Scalar, by: Float[Array, 6], curved: Float[Array, "6 6"]
) -> tuple[Float[Array, "3 5"], Float[Array, "3 5 3 5"]]:
    """First and second derivatives, by e, of a function of the measures whose derivatives by them are `by`, `curved`.

    With the slopes J of the measures these are J^T by and J^T curved J + sum over k of by_k d2(measure_k). The measures
    are products of two or three vectors each, so their second derivatives are those vectors.
    """
    x, y, *second = tangents(e, aspect).T
    scales = _tangent_scales(aspect)
    none, normal = jnp.zeros_like(x), jnp.cross(x, y)
    rows = [[2 * x, none, none, none, none], [y, x, none, none, none], [none, 2 * y, none, none, none]]
    for k, v in enumerate(second):
        along = [normal if k == m else none for m in range(3)]
        rows.append([jnp.cross(y, v), jnp.cross(v, x), *along])
    slopes = jnp.stack([jnp.stack(row, axis=-1) for row in rows]) * scales[None, None]
    c11, c12, c22 = (part * np.eye(3) for part in by[:3])
    turned = _crossed(sum(part * v for part, v in zip(by[3:], second, strict=True)))
    from_x, from_y = [-part * _crossed(y) for part in by[3:]], [part * _crossed(x) for part in by[3:]]
    zero = jnp.zeros_like(c11)
    blocks = [[2 * c11, c12 + turned, *from_x], [c12 - turned, 2 * c22, *from_y]]
    blocks += [[-from_x[k], -from_y[k], zero, zero, zero] for k in range(3)]
    own = jnp.stack([jnp.stack(row) for row in blocks]) * jnp.outer(scales, scales)[..., None, None]
    second_order = jnp.einsum("kim,kl,ljn->imjn", slopes, curved, slopes) + jnp.transpose(own, (2, 0, 3, 1))
    return jnp.einsum("k,kim->im", by, slopes), second_order


def chained_face(
    at: Local, aspect: Scalar, thickness: Scalar, by: Float[Array, 3], curved: Float[Array, "3 3"]
) -> tuple[Float[Array, "3 3"], Float[Array, "3 3 3 3"]]:
    """First and second derivatives, by e (the displacement and its slopes), of a function of the outer face's place
    whose derivatives by that place are `by` and `curved`.

    The face is at x + (t_m / 2) m / (m . m) with m = X x Y. With G = (I - 2 n n^T) / (m . m), n = m / |m|, its
    derivative by m is G t_m / 2; those of m by X and Y are the matrices of v -> v x Y and of v -> X x v.
    """
    half, square, m = 0.5 * thickness, at.determinant, at.normal
    turned = half / square * (jnp.eye(3) - 2 / square * jnp.outer(m, m))
    by_m, along = turned @ by, by @ m
    mixed = jnp.outer(by, m)
    of_place = 8 / square * along * jnp.outer(m, m) - 2 * (mixed + mixed.T + along * jnp.eye(3))
    twice = turned @ curved @ turned + half / square**2 * of_place
    by_x, by_y = _crossed(at.along_y), -aspect * _crossed(at.along_x)
    slopes = jnp.stack([by, by_m @ by_x, by_m @ by_y], axis=1)
    place_m = curved @ turned
    x, y, xy = place_m @ by_x, place_m @ by_y, by_x.T @ twice @ by_y + aspect * _crossed(by_m)
    blocks = [[curved, x, y], [x.T, by_x.T @ twice @ by_x, xy], [y.T, xy.T, by_y.T @ twice @ by_y]]
    return slopes, jnp.transpose(jnp.stack([jnp.stack(row) for row in blocks]), (2, 0, 3, 1))


def _crossed(v: Float[Array, 3]) -> Float[Array, "3 3"]:
    """The matrix of i, j: sum over k of the permutation symbol (ijk) times v_k."""
    return jnp.asarray(PERMUTATION) @ v


FLAT = np.concatenate([np.eye(3, 2), np.zeros((3, 3))], axis=1)
"""Tangents and second derivatives of the flat sheet."""

PERMUTATION = np.cross(np.eye(3)[:, None], np.eye(3)[None])
"""(ijk): the k-th component of e_i x e_j."""


def bending(measures: Float[Array, 6], thickness: Scalar, sheet_energy: Callable[..., Scalar]) -> Scalar:
    """Energy of bending per flat area, over the thickness t_m: that of the fibres less that of the middle surface.

    C(z) = C - 2 zeta K + zeta^2 K C^-1 K at the two Gauss points through the thickness, z = +-t_m / (2 sqrt 3), with K
    the curvature n . d2x/dX2 and zeta = z / (lambda_1 lambda_2), because the sheet thins as it stretches
    (Kirchhoff-Love). Its determinant is det(C - zeta K)^2 / det C. The fibres' mean energy is right to the order of
    bending, for any W.

    measures: see `bending_measures`. thickness: t_m / a. sheet_energy: W of (tr C, det C).
    """
    c11, c12, c22, *along = measures
    trace, determinant = c11 + c22, c11 * c22 - c12**2
    # k: zeta K at z = t_m / (2 sqrt 3); the unit normal is m over the root of the determinant.
    k11, k12, k22 = (thickness / np.sqrt(12) / determinant * part for part in along)
    square = (k11**2 + k12**2) * c22 - 2 * k12 * (k11 + k22) * c12 + (k12**2 + k22**2) * c11
    mean, turned = trace + square / determinant, 2 * (k11 + k22)
    even, odd = determinant + k11 * k22 - k12**2, k11 * c22 + k22 * c11 - 2 * k12 * c12
    outer = sheet_energy(mean - turned, (even - odd) ** 2 / determinant)
    inner = sheet_energy(mean + turned, (even + odd) ** 2 / determinant)
    return (outer + inner) / 2 - sheet_energy(trace, determinant)


def clamping(slope: Scalar, load: Scalar, thickness: Scalar, waves: Scalar | float) -> Scalar:
    """Energy of a clamped edge per length of it, in mu t_m a: the polynomials meet it at a slope, the wall does not.

    Within a layer of the width sqrt(D / N) the wall bends from no slope into that of the membrane, alpha. The layer's
    bending and the tension's loss make

        4 k (1 - cos(alpha / 2)),        k^2 = N lambda D = (mu t_m^2)^2 (1 - q) (1 + 3 q) / 12,        q = lambda^-4,

    with the tension N (per flat length) and the stiffness D of a neo-Hookean strip that is stretched. From q = 1/10 to
    3/4 it varies by a fifth only, so the N of a long membrane in free space does, N / (mu t_m) = (2 P^2 / 3)^(1/3) with
    P = p a / (mu t_m), and q = 1 / (1 + N / (mu t_m)). Where the layer is as wide as polynomials can follow, at small
    pressures and in thick walls, they bend themselves, and k keeps their slope small: RESOLVED times their number
    times D / a is added to it, as a root of the sum of squares.

    slope: alpha, rad. load: P. thickness: t_m / a. waves: polynomials of w per half width a, of one parity.
    """
    tension = jnp.cbrt(2 / 3 * load**2)
    q = 1 / (1 + tension)
    k = thickness * jnp.sqrt((1 - q) * (1 + 3 * q) / 12 + (RESOLVED * waves * thickness / 3) ** 2)
    return 4 * k * (1 - jnp.cos(slope / 2))
