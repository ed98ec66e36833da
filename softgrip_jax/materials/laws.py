"""The laws: neo-Hookean, Mooney-Rivlin, Yeoh, Gent, Ogden, each an energy and what is known of it."""

from __future__ import annotations

import abc

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import finite, is_concrete, nonzero, positive
from .base import ClosedForms, Material, Scalar, invariants, require_stiff


class InvariantMaterial(Material):
    """A strain energy of the invariants I_1 and I_2.

    A subclass gives W in `of_invariants`, from I_1 - 3 and I_2 - 3.

    Source: thesis (2.3).

    Examples:
        >>> print(f"{sg.NeoHookean(mu=100 * kPa).of_invariants(jnp.asarray(1.0), jnp.asarray(0.0)) / kPa:.1f} kJ/m^3")
        50.0 kJ/m^3
    """

    @abc.abstractmethod
    def of_invariants(self, i1: Scalar, i2: Scalar) -> Scalar:
        """W, J/m^3, from I_1 - 3 and I_2 - 3."""

    def energy(self, l1, l2, l3):
        return self.of_invariants(*invariants(l1, l2, l3))

    def sheet_energy(self, trace, determinant):
        # The third principal value of C is 1 / det C (incompressibility).
        return self.of_invariants(trace + 1 / determinant - 3, determinant + trace / determinant - 3)


class NeoHookean(InvariantMaterial):
    """The neo-Hookean material, W = mu/2 (I_1 - 3).

    Args:
        mu: shear modulus, Pa.

    Raises:
        InputError: where mu is not positive (outside of jit).

    Source: thesis (2.5); Treloar 1943. Trusted for stretches up to about 1.5 of silicone.

    Examples:
        >>> one = jnp.asarray(1.0)
        >>> print(f"{sg.NeoHookean(mu=100 * kPa).energy(2 * one, 0.5 * one, one) / kPa:.1f} kJ/m^3")
        112.5 kJ/m^3
    """

    mu: Scalar = positive("pressure")

    def of_invariants(self, i1, i2):
        return 0.5 * self.mu * i1

    def shear_modulus(self):
        return self.mu

    def closed_forms(self):
        return ClosedForms(
            tension_over_strain=self._tension_over_strain,
            neo_hookean_in_plane_strain=True,
            has_one_maximum=True,
            has_rising_wall=True,
            is_endless=True,
        )

    def _tension_over_strain(self, t_m: Scalar, strain: Scalar) -> Scalar:
        """T = mu t_m (1 - x^6) with x = 1/lambda, and so T / (lambda - 1) = mu t_m (x + x^2 + ... + x^6)."""
        x = 1 / (1 + strain)
        return self.mu * t_m * x * (1 + x * (1 + x * (1 + x * (1 + x * (1 + x)))))


class MooneyRivlin(InvariantMaterial):
    """The Mooney-Rivlin material, W = C_1 (I_1 - 3) + C_2 (I_2 - 3).

    Args:
        c1: C_1, Pa, positive.
        c2: C_2, Pa, of either sign, with mu = 2 (C_1 + C_2) positive.

    Raises:
        InputError: where a constant breaks its rule, or the shear modulus is not positive (outside of jit).

    Source: Mooney 1940.

    Examples:
        >>> print(f"{sg.MooneyRivlin(c1=60 * kPa, c2=8 * kPa).shear_modulus() / kPa:.1f} kPa")
        136.0 kPa
    """

    c1: Scalar = positive("pressure")
    c2: Scalar = finite("pressure")

    def __check_init__(self) -> None:
        require_stiff(self)

    def of_invariants(self, i1, i2):
        return self.c1 * i1 + self.c2 * i2

    def shear_modulus(self):
        return 2 * (self.c1 + self.c2)

    def closed_forms(self):
        # In plane strain I_1 = I_2.
        return ClosedForms(neo_hookean_in_plane_strain=True, is_endless=True)


class Yeoh(InvariantMaterial):
    """The Yeoh material, W = C_1 (I_1 - 3) + C_2 (I_1 - 3)^2 + C_3 (I_1 - 3)^3.

    Args:
        c1: C_1, Pa, positive; mu = 2 C_1.
        c2: C_2, Pa, of either sign.
        c3: C_3, Pa, of either sign.

    Raises:
        InputError: where a constant breaks its rule (outside of jit).

    Source: Yeoh 1993.

    Examples:
        >>> print(f"{sg.Yeoh(c1=68 * kPa, c2=2 * kPa).shear_modulus() / kPa:.1f} kPa")
        136.0 kPa
    """

    c1: Scalar = positive("pressure")
    c2: Scalar = finite("pressure", default=0.0)
    c3: Scalar = finite("pressure", default=0.0)

    def of_invariants(self, i1, i2):
        return i1 * (self.c1 + i1 * (self.c2 + i1 * self.c3))

    def shear_modulus(self):
        return 2 * self.c1

    def closed_forms(self):
        return ClosedForms(is_endless=True)


class Gent(InvariantMaterial):
    """The Gent material, W = -mu J_m / 2 ln(1 - (I_1 - 3) / J_m), which locks.

    Args:
        mu: shear modulus, Pa.
        j_m: J_m, the largest I_1 - 3, dimensionless.

    Raises:
        InputError: where a constant is not positive (outside of jit).

    Source: Gent 1996.

    Examples:
        >>> one = jnp.asarray(1.0)
        >>> bool(sg.Gent(mu=136 * kPa, j_m=10.0).stretchable(4 * one, one) > 0)  # I_1 - 3 is 14 there
        False
    """

    mu: Scalar = positive("pressure")
    j_m: Scalar = positive("number")

    def of_invariants(self, i1, i2):
        return -0.5 * self.mu * self.j_m * jnp.log1p(-i1 / self.j_m)

    def shear_modulus(self):
        return self.mu

    def stretchable(self, l1, l2):
        return 1 - invariants(l1, l2, 1 / (l1 * l2))[0] / self.j_m


class Ogden(Material):
    """The Ogden material, W = sum_i mu_i / alpha_i (lambda_1^alpha_i + lambda_2^alpha_i + lambda_3^alpha_i - 3).

    Args:
        mu: mu_i, Pa, shape (n,), of either sign.
        alpha: alpha_i, dimensionless, shape (n,), not zero; the shear modulus sum_i mu_i alpha_i / 2 is positive.

    Raises:
        InputError: where shapes differ, or the shear modulus is not positive (outside of jit).

    Source: Ogden 1972.

    Examples:
        >>> print(f"{sg.Ogden(mu=[100 * kPa, 9 * kPa], alpha=[2.0, 8.0]).shear_modulus() / kPa:.1f} kPa")
        136.0 kPa
    """

    mu: Float[Array, " n"] = finite("pressure")
    alpha: Float[Array, " n"] = nonzero("number")

    def __check_init__(self) -> None:
        if is_concrete(self.mu, self.alpha) and (self.mu.ndim != 1 or self.mu.shape != self.alpha.shape):
            raise InputError(
                f"Ogden.mu and Ogden.alpha have shapes {jnp.shape(self.mu)} and {jnp.shape(self.alpha)}; "
                "they must be two lists of the same length."
            )
        require_stiff(self)

    def energy(self, l1, l2, l3):
        powers = sum(jnp.exp(self.alpha * jnp.log(stretch)) for stretch in (l1, l2, l3))
        return jnp.sum(self.mu / self.alpha * (powers - 3))

    def shear_modulus(self):
        return 0.5 * jnp.sum(self.mu * self.alpha)

    def closed_forms(self):
        return ClosedForms(is_endless=True)
