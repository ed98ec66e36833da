"""Friction: a coefficient, a table or a law, and the normal force that a load needs."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import Checked, is_concrete, nonnegative, positive, to_float_array
from ..numerics.curves import first_crossing, scan_curve
from ..numerics.implicit import implicit

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
            raise InputError(
                f"FrictionTable.force and .coefficient have shapes {jnp.shape(force)} and {jnp.shape(coefficient)}; "
                "they must be two lists of the same length."
            )
        if not np.all(np.diff(np.asarray(force)) > 0):
            raise InputError(f"FrictionTable.force is {np.asarray(force).tolist()}; it must increase from row to row.")

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


FRICTION_RANGE = np.log(1e4)
"""A required force is sought where the coefficient of friction is between 1e-4 and 1e4: every pair of materials."""


def required_normal_force(friction: Any, load: Scalar) -> Scalar:
    """The least normal force F (N) with mu_f(F) F = load (N, tangential); inf where no force does."""
    if not callable(friction):
        return load / friction

    def short(log_force, args):
        friction, load = args
        return jnp.log(friction_force(friction, jnp.exp(log_force))) - jnp.log(jnp.where(load > 0, load, 1.0))

    args = (friction, load)
    fixed = lax.stop_gradient(args)
    middle = jnp.log(jnp.where(fixed[1] > 0, fixed[1], 1.0))
    scan = scan_curve(lambda x: short(x, fixed), middle - FRICTION_RANGE, middle + FRICTION_RANGE)
    carried = first_crossing(lambda x: short(x, fixed), jnp.zeros_like(load), scan.x, scan.y, scan.x[-1])
    force = jnp.where(carried.exists, jnp.exp(implicit(short, carried.x, args)), jnp.inf)
    return jnp.where(load > 0, force, 0.0)
