"""Strain energies of incompressible hyperelastic materials.

A material is its strain energy density W(lambda_1, lambda_2, lambda_3) per undeformed volume, J/m^3, with
lambda_1 lambda_2 lambda_3 = 1. Every stress and tension elsewhere is a derivative of it; nothing is written twice.
"""

from __future__ import annotations

import abc

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .checked import Checked, finite, is_concrete, nonzero, positive
from .errors import InputError
from .names import listing
from .units import kPa

Scalar = Float[Array, ""]

EQUAL = 1e-4
"""Half the relative distance at which squared stretches are kept: second derivatives keep 1e-8 of accuracy there."""


class Material(Checked):
    """A strain energy. A new one needs `energy` and `shear_modulus`."""

    @abc.abstractmethod
    def energy(self, l1: Scalar, l2: Scalar, l3: Scalar) -> Scalar:
        """W at the principal stretches, J/m^3; zero in the undeformed state."""

    @abc.abstractmethod
    def shear_modulus(self) -> Scalar:
        """mu of the undeformed material, Pa: the scale of every stress."""

    def stretchable(self, l1: Scalar, l2: Scalar) -> Scalar:
        """A pure number that is positive where the energy exists (1 for materials without a largest stretch)."""
        return jnp.ones_like(l1)

    def sheet_energy(self, trace: Scalar, determinant: Scalar) -> Scalar:
        """W, J/m^3, of a sheet from tr C and det C, C = F^T F in its plane: lambda^2 are the eigenvalues of C.

        Unlike the stretches these two are smooth in F where the stretches are equal. This works for any energy and
        keeps squared stretches apart by EQUAL of their mean, which changes W by EQUAL^2 of itself at most.
        """
        mean = 0.5 * trace
        apart = jnp.sqrt(jnp.maximum(mean**2 - determinant, 0.0) + (EQUAL * mean) ** 2)
        larger = jnp.sqrt(mean + apart)
        return self.energy(larger, jnp.sqrt(determinant) / larger, 1 / jnp.sqrt(determinant))

    def is_stable_at_rest(self) -> Bool[Array, ""]:
        """True where the undeformed material resists every small shear."""
        return self.shear_modulus() > 0


def nominal_stresses(material: Material, l1: Scalar, l2: Scalar) -> tuple[Scalar, Scalar]:
    """Engineering stresses (dw/dlambda_1, dw/dlambda_2), Pa, of a sheet with a free surface.

    w(lambda_1, lambda_2) = W(lambda_1, lambda_2, 1/(lambda_1 lambda_2)): incompressibility and plane stress are in w,
    so its derivatives are the forces per undeformed area along 1 and 2.
    """
    return jax.grad(lambda a, b: material.energy(a, b, 1 / (a * b)), argnums=(0, 1))(l1, l2)


def _invariants(l1, l2, l3):
    """I_1 - 3 and I_2 - 3 of (2.3)."""
    a, b, c = l1 * l1, l2 * l2, l3 * l3
    return a + b + c - 3, 1 / a + 1 / b + 1 / c - 3


def _require_stiff(material: Material) -> None:
    """A ValueError for constants that keep their own rules but together give no shear modulus."""
    Checked.__check_init__(material)
    if is_concrete(*jax.tree.leaves(material)) and not jnp.all(material.is_stable_at_rest()):
        modulus = float(jnp.min(material.shear_modulus()))
        raise InputError(
            f"{type(material).__name__} has a shear modulus of {modulus:.6g} Pa; its constants must make it positive."
        )


class InvariantMaterial(Material):
    """A strain energy of the invariants I_1, I_2 of the thesis's (2.3)."""

    @abc.abstractmethod
    def of_invariants(self, i1: Scalar, i2: Scalar) -> Scalar:
        """W, J/m^3, from I_1 - 3 and I_2 - 3."""

    def energy(self, l1, l2, l3):
        return self.of_invariants(*_invariants(l1, l2, l3))

    def sheet_energy(self, trace, determinant):
        # The third principal value of C is 1 / det C (incompressibility).
        return self.of_invariants(trace + 1 / determinant - 3, determinant + trace / determinant - 3)


class NeoHookean(InvariantMaterial):
    """W = mu/2 (I_1 - 3), thesis (2.5); Treloar 1943. mu: shear modulus, Pa."""

    mu: Scalar = positive("pressure")

    def of_invariants(self, i1, i2):
        return 0.5 * self.mu * i1

    def shear_modulus(self):
        return self.mu


class MooneyRivlin(InvariantMaterial):
    """W = C_1 (I_1 - 3) + C_2 (I_2 - 3); Mooney 1940. C_1 > 0 and C_2 of either sign, Pa; mu = 2 (C_1 + C_2)."""

    c1: Scalar = positive("pressure")
    c2: Scalar = finite("pressure")

    def __check_init__(self) -> None:
        _require_stiff(self)

    def of_invariants(self, i1, i2):
        return self.c1 * i1 + self.c2 * i2

    def shear_modulus(self):
        return 2 * (self.c1 + self.c2)


class Yeoh(InvariantMaterial):
    """W = C_1 (I_1 - 3) + C_2 (I_1 - 3)^2 + C_3 (I_1 - 3)^3; Yeoh 1993. C_1 > 0, Pa; mu = 2 C_1."""

    c1: Scalar = positive("pressure")
    c2: Scalar = finite("pressure", default=0.0)
    c3: Scalar = finite("pressure", default=0.0)

    def of_invariants(self, i1, i2):
        return i1 * (self.c1 + i1 * (self.c2 + i1 * self.c3))

    def shear_modulus(self):
        return 2 * self.c1


class Gent(InvariantMaterial):
    """W = -mu J_m / 2 ln(1 - (I_1 - 3) / J_m); Gent 1996. mu: Pa; J_m: the largest I_1 - 3, a pure number."""

    mu: Scalar = positive("pressure")
    j_m: Scalar = positive("number")

    def of_invariants(self, i1, i2):
        return -0.5 * self.mu * self.j_m * jnp.log1p(-i1 / self.j_m)

    def shear_modulus(self):
        return self.mu

    def stretchable(self, l1, l2):
        return 1 - _invariants(l1, l2, 1 / (l1 * l2))[0] / self.j_m


class Ogden(Material):
    """W = sum_i mu_i / alpha_i (lambda_1^alpha_i + lambda_2^alpha_i + lambda_3^alpha_i - 3); Ogden 1972.

    mu: shape (n,), Pa; alpha: shape (n,), pure numbers, not zero; the shear modulus sum_i mu_i alpha_i / 2 is positive.
    """

    mu: Float[Array, " n"] = finite("pressure")
    alpha: Float[Array, " n"] = nonzero("number")

    def __check_init__(self) -> None:
        if is_concrete(self.mu, self.alpha) and (self.mu.ndim != 1 or self.mu.shape != self.alpha.shape):
            raise InputError(
                f"Ogden.mu and Ogden.alpha have shapes {jnp.shape(self.mu)} and {jnp.shape(self.alpha)}; "
                "they must be two lists of the same length."
            )
        _require_stiff(self)

    def energy(self, l1, l2, l3):
        powers = sum(jnp.exp(self.alpha * jnp.log(stretch)) for stretch in (l1, l2, l3))
        return jnp.sum(self.mu / self.alpha * (powers - 3))

    def shear_modulus(self):
        return 0.5 * jnp.sum(self.mu * self.alpha)


def dragon_skin_20() -> NeoHookean:
    """Dragon Skin 20 silicone, neo-Hookean: mu = 136 kPa from a linear fit of tension tests (thesis table 5.1)."""
    return NeoHookean(mu=136 * kPa)


def dragon_skin_30() -> NeoHookean:
    """Dragon Skin 30 silicone, neo-Hookean: mu = 198 kPa from a linear fit of tension tests (thesis table 5.1)."""
    return NeoHookean(mu=198 * kPa)


def dragon_skin_20_shell() -> NeoHookean:
    """Dragon Skin 20 in the flat shell: mu = 175 kPa, tuned to its measured free inflation (thesis section 6.2)."""
    return NeoHookean(mu=175 * kPa)


PRESETS = {
    "dragon_skin_20": dragon_skin_20,
    "dragon_skin_30": dragon_skin_30,
    "dragon_skin_20_shell": dragon_skin_20_shell,
}

__dir__ = listing(globals())
