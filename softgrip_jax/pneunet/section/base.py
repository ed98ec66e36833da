"""Section laws of the cover: bending moment and axial force against curvature and stretch.

All in pure numbers: z = H theta' (theta' per reference length), lambda the stretch of the middle line,
m = M / (mu B H^2), n = N / (mu B H), w = section energy / (mu B H), mu the shear modulus at rest. A law is called as
law(m, n) -> (z, lambda); `law.loads(z, lambda)` is the way back. Laws are odd in m, even in z, and take ONE section.

Where a law has no state for a load, both values are NaN: never a state of another branch.
"""

from __future__ import annotations

import abc
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ...numerics.implicit import implicit
from ...numerics.scalar_roots import newton_bracketed
from ...numerics.xla import differentiated_once

Scalar = Float[Array, ""]


class SectionLaw(eqx.Module):
    """The law of one cross-section: m, n <-> z, lambda.

    m = M / (mu B H^2), n = N / (mu B H), z = H theta', lambda the stretch of the middle line, all dimensionless. How to
    write one of your own: docs/extending/section-law.md. A scene refuses one whose methods are not one law.

    Source: thesis 4.3 for what a section law is.

    Examples:
        >>> class Stiff(sg.pneunet.SectionLaw):
        ...     stretches_at_all = False
        ...     def __call__(self, m, n):
        ...         return 3 * m, 1 + 0 * n
        ...     def loads(self, z, stretch):
        ...         return z / 3, 0 * stretch
        ...     def stretches(self, z, n):
        ...         return 1 + 0 * n, 1 + 0 * n, 1 + 0 * n
        >>> print(Stiff()(0.1, 0.0))
        (0.30000000000000004, 1.0)
    """

    NAME: ClassVar[str] = ""
    """The name by which configs choose it; none for a law that only Python makes."""
    stretches_at_all: ClassVar[bool] = True
    """Whether an axial force stretches it."""
    largest_moment: ClassVar[float] = np.inf
    """The supremum of |m| without an axial force, where it is known; inf where it is not, or there is none."""

    @abc.abstractmethod
    def __call__(self, m: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """(z, lambda) under the moment m and the axial force n."""

    @abc.abstractmethod
    def loads(self, z: Scalar, stretch: Scalar) -> tuple[Scalar, Scalar]:
        """(m, n) that hold the curvature z and the stretch."""

    @abc.abstractmethod
    def stretches(self, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Of the stretch at a curvature under an axial force: a bound from below, one from above, a good guess."""

    def used_up(self, m: Scalar, z: Scalar, stretch: Scalar) -> Scalar:
        """A number that rises through zero where the section carries no more, of its moment and its state."""
        return jnp.abs(m) / self.largest_moment - 1

    def locks(self) -> bool:
        """Whether it ends at a finite curvature, as a number that `used_up` tells."""
        return False

    def axis(self) -> int | None:
        """0 where every part of a beam has a law of its own, stacked in one; None where all have the same."""
        return None

    def bent(self, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """(m, lambda) at the curvature z under the axial force n: one state for any pair, unlike under (m, n)."""
        law, *given = lax.stop_gradient((self, z, n))
        bounds = (jnp.asarray(stretch, float) for stretch in law.stretches(*given))
        found = newton_bracketed(lambda x: law.loads(given[0], x)[1] - given[1], *bounds).x
        stretch = implicit(lambda x, args: args[0].loads(args[1], x)[1] - args[2], found, (self, z, n))
        return self.loads(z, stretch)[0], stretch

    def stiffnesses(self, z: Array, n: Array) -> Array:
        """What m rises by over z from each place of a line to the next, under the n between them."""
        between, step = 0.5 * (n[1:] + n[:-1]), z[1:] - z[:-1]
        rise = jax.vmap(self.bent)(z[1:], between)[0] - jax.vmap(self.bent)(z[:-1], between)[0]
        return jnp.where(step == 0, jnp.inf, rise / jnp.where(step == 0, 1.0, step))

    def bent_once(self, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """`bent`, with its derivatives taken once for all directions of a Jacobian."""
        return _bent_once(self, z, n)

    def rates(self, m: Scalar, z: Scalar, stretch: Scalar, dm: Scalar, dn: Scalar) -> tuple[Scalar, Scalar]:
        """(dz, dlambda) of the state (z, lambda) under small changes dm and dn of its loads; m is its moment.

        Along a beam this is a state's own differential equation: nothing is solved for at any place.
        """
        one, none = jnp.ones_like(z), jnp.zeros_like(z)
        m_z, n_z = jax.jvp(self.loads, (z, stretch), (one, none))[1]
        m_l, n_l = jax.jvp(self.loads, (z, stretch), (none, one))[1]
        scale = 1 / (m_z * n_l - m_l * n_z)
        return (n_l * dm - m_l * dn) * scale, (m_z * dn - n_z * dm) * scale


@partial(differentiated_once, apart=True)
def _bent_once(law: SectionLaw, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
    return law.bent(z, n)
