"""A section that bends and does not stretch."""

from __future__ import annotations

import jax.numpy as jnp

from .base import Scalar, SectionLaw


class Inextensible(SectionLaw):
    """lambda = 1, M = mu B H^3 theta'/3 (Euler-Bernoulli, plane strain): m = z/3. It knows no axial force."""

    NAME = "inextensible"
    stretches_at_all = False

    def __call__(self, m, n):
        return 3 * m + 0 * n, jnp.ones_like(m + n)

    def loads(self, z, stretch):
        """(z/3, NaN): an inextensible line carries any axial force."""
        return z / 3, jnp.full_like(z, jnp.nan)

    def stretches(self, z, n):
        one = jnp.ones_like(z)
        return one, one, one

    def bent(self, z, n):
        return z / 3, 1 + 0 * z

    def rates(self, m, z, stretch, dm, dn):
        return 3 * dm, 0 * dn

    def energy(self, z: Scalar, stretch: Scalar) -> Scalar:
        """w = z^2 / 6."""
        return z * z / 6
