"""Strain energies of incompressible hyperelastic materials.

A material is its strain energy density W(lambda_1, lambda_2, lambda_3) per undeformed volume, J/m^3, with
lambda_1 lambda_2 lambda_3 = 1. Every stress and tension elsewhere is a derivative of it; nothing is written twice.

What makes the models faster than the energy alone would (closed forms, the shear modulus, the stretch at which it
locks) is stated by the class that defines the energy. A subclass with another energy inherits none of it.
"""

from __future__ import annotations

import abc
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..errors import InputError, JoinedRuleError
from ..fields import Checked, check_fields
from ..own import is_known, is_own, require_numbers

Scalar = Float[Array, ""]

EQUAL = 1e-4
"""Half the relative distance at which squared stretches are kept: second derivatives keep 1e-8 of accuracy there."""


class ClosedForms(NamedTuple):
    """What is known of an energy beyond its values.

    The models use it where it is stated; by default nothing is. A wrong statement gives wrong results without a word,
    so a statement belongs to the class that defines the energy.

    Examples:
        >>> sg.NeoHookean(mu=175 * kPa).closed_forms().has_one_maximum
        True
    """

    tension_over_strain: Callable[[Scalar, Scalar], Scalar] | None = None
    """(t_m, strain) -> T / (lambda - 1), N/m, of a sheet that is stretched by lambda = 1 + strain both ways."""
    neo_hookean_in_plane_strain: bool = False
    """W(s, 1/s, 1) = mu/2 (s^2 + 1/s^2 - 2): covers follow the section law that is solved in closed form."""
    has_one_maximum: bool = False
    """The pressure of a membrane on an arc has at most one maximum along its angle, and never falls and rises again."""
    has_rising_wall: bool = False
    """The pressure of a chamber's wall rises all along its angle, up to a half circle."""
    is_endless: bool = False
    """The energy exists at every stretch: nothing locks."""


class Material(Checked):
    """The strain energy W(lambda_1, lambda_2, lambda_3) of an incompressible hyperelastic material.

    A new material derives from it and needs `energy` and nothing else; stresses and tensions are its derivatives. What
    else a class can state saves time. All of it is about one energy: where a subclass gives another energy, it falls
    back to what holds for any, unless the subclass states it anew.

    Raises:
        InputError: where a statement of a class of one's own contradicts its energy, or that is stressed at rest,
            changes as stretches are swapped, cannot be differentiated, or has a shear modulus that is not positive.

    Source: thesis 2.2; lambda_1 lambda_2 lambda_3 = 1.

    Examples:
        >>> class Stiffening(sg.materials.Material):
        ...     def energy(self, l1, l2, l3):
        ...         first = l1**2 + l2**2 + l3**2 - 3
        ...         return 68 * kPa * first + 2 * kPa * first**2
        >>> print(f"{Stiffening().shear_modulus() / kPa:.1f} kPa")
        136.0 kPa
    """

    @abc.abstractmethod
    def energy(self, l1: Scalar, l2: Scalar, l3: Scalar) -> Scalar:
        """W at the principal stretches, J/m^3; zero in the undeformed state."""

    def shear_modulus(self) -> Scalar:
        """mu of the undeformed material, Pa: the scale of every stress. By default from the energy."""
        return modulus_of_energy(self)

    def closed_forms(self) -> ClosedForms:
        """What is known of this energy beyond its values; nothing by default."""
        return ClosedForms()

    def stretchable(self, l1: Scalar, l2: Scalar) -> Scalar:
        """A number that is positive where the energy exists. By default -1 where W is not finite.

        The default falls towards the place where W ends, for a search of that place keeps the smallest value it saw.
        """
        if self.closed_forms().is_endless:
            return jnp.ones_like(l1)
        energy = self.energy(l1, l2, 1 / (l1 * l2))
        return jnp.where(jnp.isfinite(energy), 1 / (1 + jnp.abs(energy)), -1.0)

    def sheet_energy(self, trace: Scalar, determinant: Scalar) -> Scalar:
        """W, J/m^3, of a sheet from tr C and det C, C = F^T F in its plane: lambda^2 are the eigenvalues of C.

        Unlike the stretches these two are smooth in F where the stretches are equal. This works for any energy and
        keeps squared stretches apart by EQUAL of their mean, which adds some mu EQUAL^2 to W.
        """
        mean = 0.5 * trace
        apart = jnp.sqrt(jnp.maximum(mean**2 - determinant, 0.0) + (EQUAL * mean) ** 2)
        larger = jnp.sqrt(mean + apart)
        return self.energy(larger, jnp.sqrt(determinant) / larger, 1 / jnp.sqrt(determinant))

    def is_stable_at_rest(self) -> Bool[Array, ""]:
        """True where the undeformed material resists every small shear."""
        return self.shear_modulus() > 0

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for statement, energies in STATEMENTS.items():
            stated_by = _provider(cls, statement)
            # The method resolution order begins with the class that was derived last.
            later = cls.__mro__[: cls.__mro__.index(stated_by)]
            if stated_by is not Material and any(name in vars(base) for base in later for name in energies):
                setattr(cls, statement, vars(Material)[statement])

    def __check_init__(self) -> None:
        # The laws of this package keep to their energies by its tests.
        if is_own(self):
            _require_true_statements(self)


STATEMENTS = {
    "sheet_energy": ("energy",),
    "shear_modulus": ("energy", "of_invariants"),
    "stretchable": ("energy", "of_invariants"),
    "is_stable_at_rest": ("energy", "of_invariants", "shear_modulus"),
    "closed_forms": ("energy", "of_invariants", "sheet_energy", "shear_modulus"),
}
"""What a class states about its energy, and what gives the energy: a class that overrides one of the latter without
the statement takes the statement back."""


def _provider(cls: type, name: str) -> type:
    """The class whose method an instance of `cls` has."""
    return next(base for base in cls.__mro__ if name in vars(base))


def modulus_of_energy(material: Material) -> Scalar:
    """The shear modulus of the undeformed material, from its energy alone.

    The second derivative of W(e^x, e^-x, 1) at x = 0 is 4 mu.

    Args:
        material: any material.

    Returns:
        mu, Pa.

    Source: own.

    Examples:
        >>> print(f"{sg.materials.modulus_of_energy(sg.MooneyRivlin(c1=60 * kPa, c2=8 * kPa)) / kPa:.3f} kPa")
        136.000 kPa
    """

    def pure_shear(x):
        return material.energy(jnp.exp(x), jnp.exp(-x), jnp.ones_like(x))

    zero, one = jnp.zeros(()), jnp.ones(())
    return 0.25 * jax.jvp(lambda x: jax.jvp(pure_shear, (x,), (one,))[1], (zero,), (one,))[1]


STATED_TOLERANCE = 1e-6
"""A modulus that was copied from a table with seven digits agrees with the energy; one of another energy does not."""
SHEET_STRETCHES = (1.2, 1.05)
"""Where the two energies of a class are compared: no rubber locks so early."""


@jax.jit
def _stated_and_found(material: Material) -> tuple[tuple[Array, Array], ...]:
    """The shear modulus and the energy of a sheet, each as the class states it and from its `energy`; the stresses at
    rest, which are none; and the least and the largest energy of the same three stretches in any order."""
    l1, l2 = (jnp.asarray(stretch) for stretch in SHEET_STRETCHES)
    modulus = material.shear_modulus(), modulus_of_energy(material)
    sheet = material.sheet_energy(l1**2 + l2**2, (l1 * l2) ** 2)
    # In one call, so that it is compiled once: the stretches in every order, and twice the rest with a small change.
    orders = np.array(list(itertools.permutations((*SHEET_STRETCHES, 1 / np.prod(SHEET_STRETCHES)))))
    places = np.concatenate([orders, np.ones((2, 3))])
    changes = np.concatenate([0 * orders, [[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]]])
    energies, slopes = jax.jvp(jax.vmap(material.energy), tuple(places.T), tuple(changes.T))
    swapped, (first, second) = energies[:-2], slopes[-2:]
    return modulus, (sheet, swapped[0]), (first, second), (jnp.min(swapped, axis=0), jnp.max(swapped, axis=0))


def _require_true_statements(material: Material) -> None:
    """A ValueError where a class states a shear modulus (the scale of every load) or an energy of sheets that is not
    the one of its `energy`, or where that is no energy of a rubber that is free of stress at rest."""
    check_fields(material)
    if not is_known(material):
        return
    name, one = type(material).__name__, jnp.ones(())
    if require_numbers(f"{name}.energy", material, material.energy, one, one, one):
        require_numbers(f"{name}.shear_modulus", material, material.shear_modulus)
    with jax.ensure_compile_time_eval():
        pairs = [[np.asarray(value) for value in pair] for pair in _stated_and_found(material)]
    words = ("shear_modulus() is", "Pa"), ("sheet_energy at the stretches 1.2 and 1.05 is", "J/m^3")
    if not np.all(np.isfinite(pairs[0][1])):
        raise InputError(
            f"{name}.energy has no second derivative in the undeformed state (it is "
            f"{np.min(pairs[0][1]):.6g} Pa); write it without roots or logarithms that vanish there."
        )
    *statements, (first, second), (least, most) = pairs
    # Written so that NaN counts as a difference. Several numbers are several materials, made for vmap.
    if not np.all(np.maximum(np.abs(first), np.abs(second)) <= STATED_TOLERANCE * np.abs(pairs[0][1])):
        raise InputError(
            f"{name}.energy is stressed at rest, by {_worst(first):.6g} and {_worst(second):.6g} Pa along the first "
            "two stretches; its derivatives by all three stretches must be the same at (1, 1, 1)."
        )
    if not np.all(most - least <= STATED_TOLERANCE * np.abs(most)):
        raise InputError(
            f"{name}.energy of the stretches 1.2, 1.05 and 0.794 is between {np.min(least):.6g} and {np.max(most):.6g} "
            "J/m^3, as they are ordered; swapping stretches must not change it."
        )
    for (what, unit), (stated, found) in zip(words, statements, strict=True):
        if not np.all(np.abs(stated - found) <= STATED_TOLERANCE * np.abs(found)):
            raise InputError(
                f"{name}.{what} {np.min(stated):.6g} {unit}, but by its energy it is "
                f"{np.min(found):.6g} {unit}; make them agree, or leave the method out."
            )
    if not np.all(pairs[0][1] > 0):
        raise _not_stiff(material, np.min(pairs[0][1]))


def _not_stiff(material: Material, modulus: Any) -> InputError:
    sentence = " has a shear modulus of {modulus}; its constants must make it positive."
    return JoinedRuleError(type(material).__name__ + sentence, modulus=(float(modulus), "pressure"))


def _worst(values: Any) -> float:
    """The value that is furthest from zero."""
    return float(np.atleast_1d(values)[np.argmax(np.abs(np.atleast_1d(values)))])


def nominal_stresses(material: Material, l1: Scalar, l2: Scalar) -> tuple[Scalar, Scalar]:
    """Engineering stresses of a sheet with a free surface.

    With w(lambda_1, lambda_2) = W(lambda_1, lambda_2, 1/(lambda_1 lambda_2)) they are dw/dlambda_1 and dw/dlambda_2:
    incompressibility and plane stress are in w, so its derivatives are the forces per undeformed area along 1 and 2.

    Args:
        material: of the sheet.
        l1, l2: stretches in the plane, dimensionless, positive, as float scalars.

    Returns:
        The two stresses, Pa, positive in tension.

    Source: thesis 2.2.

    Examples:
        >>> rubber = sg.NeoHookean(mu=100 * kPa)
        >>> first, second = sg.materials.nominal_stresses(rubber, jnp.asarray(2.0), jnp.asarray(1.0))
        >>> print(f"{first / kPa:.3f} kPa, {second / kPa:.3f} kPa")  # mu (2 - 1/8), mu (1 - 1/4)
        187.500 kPa, 75.000 kPa
    """
    return jax.grad(lambda a, b: material.energy(a, b, 1 / (a * b)), argnums=(0, 1))(l1, l2)


def invariants(l1, l2, l3):
    """I_1 - 3 and I_2 - 3 of (2.3)."""
    a, b, c = l1 * l1, l2 * l2, l3 * l3
    return a + b + c - 3, 1 / a + 1 / b + 1 / c - 3


def require_stiff(material: Material) -> None:
    """A ValueError for constants that keep their own rules but together give no shear modulus."""
    check_fields(material)
    if not is_known(material):
        return
    with jax.ensure_compile_time_eval():
        stable, modulus = np.asarray(material.is_stable_at_rest()), np.asarray(material.shear_modulus())
    if not np.all(stable):
        raise _not_stiff(material, np.min(modulus))
