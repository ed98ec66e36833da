"""What is grasped, and the friction that holds it."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .checked import Checked, is_concrete, nonnegative, positive, to_float_array

Scalar = Float[Array, ""]


class Friction(Checked):
    """A coefficient of friction that depends on the normal force: call it with the force in N."""

    @abc.abstractmethod
    def __call__(self, force: Scalar) -> Scalar:
        """mu_f, a pure number."""


class FrictionTable(Friction):
    """Measured coefficients, linear between the rows and constant beyond them.

    force: normal force, N, increasing, shape (n,); coefficient: mu_f, shape (n,).
    """

    force: Float[Array, " n"] = nonnegative("force")
    coefficient: Float[Array, " n"] = positive("number")

    def __check_init__(self) -> None:
        force, coefficient = self.force, self.coefficient
        if not is_concrete(force, coefficient):
            return
        if force.ndim != 1 or force.shape != coefficient.shape:
            raise ValueError(
                f"FrictionTable.force and .coefficient have shapes {jnp.shape(force)} and {jnp.shape(coefficient)}; "
                "they must be two lists of the same length."
            )
        if not np.all(np.diff(np.asarray(force)) > 0):
            raise ValueError(f"FrictionTable.force is {np.asarray(force).tolist()}; it must increase from row to row.")

    def __call__(self, force: Scalar) -> Scalar:
        return jnp.interp(force, self.force, self.coefficient)


class FrictionLaw(Friction):
    """Any function of the normal force (N) as a coefficient of friction; its constants are not differentiated."""

    law: Callable[[Scalar], Scalar] = eqx.field(static=True)

    def __call__(self, force: Scalar) -> Scalar:
        return self.law(force)


def to_friction(value: Any) -> Any:
    """A number stays a number; a plain function becomes a FrictionLaw."""
    if callable(value) and not isinstance(value, eqx.Module):
        return FrictionLaw(value)
    return to_float_array(value)


def friction(**kwargs: Any) -> Any:
    """A field for mu_f: a positive number, a Friction, or a function of the normal force in N."""
    return eqx.field(converter=to_friction, metadata={"friction": True}, **kwargs)


def friction_coefficient(friction: Any, force: Scalar) -> Scalar:
    """mu_f at a normal force."""
    return friction(force) if isinstance(friction, Friction) else friction


def friction_force(friction: Any, force: Scalar) -> Scalar:
    """mu_f(F) F: the largest tangential force that a normal force F holds (Coulomb), N."""
    return friction_coefficient(friction, force) * force
