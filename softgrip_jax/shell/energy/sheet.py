"""The deformed sheet at one point: strains, faces, wrinkles and bending. Lengths in a.

The membrane 2a x 2b lies in z = 0; its point (xi a, eta b) moves by a (u, v, w)(xi, eta). `e` holds the derivatives of
(u, v, w) in the order of `basis.ORDERS`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


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
