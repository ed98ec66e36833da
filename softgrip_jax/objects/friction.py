"""Friction: a coefficient, a table or a law, and the normal force that a load needs."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import Checked, is_concrete, nonnegative, positive, to_float_array
from ..numerics.choice import larger
from ..numerics.curves import CELLS, first_crossing, samples_with_turns
from ..numerics.implicit import implicit
from ..own import is_known, is_own, require_numbers

Scalar = Float[Array, ""]


FORCES = (0.01, 0.1, 0.5, 1.0)
"""Normal forces, N, at which a law of the user's own is asked: from a touch to what a strong fingertip presses."""


class Friction(Checked):
    """A coefficient of friction that depends on the normal force.

    A subclass gives mu_f (dimensionless) from the normal force (N) in `__call__`.

    Source: Coulomb's law with a coefficient that varies.

    Examples:
        >>> table = sg.objects.FrictionTable(force=[1.0, 3.0], coefficient=[1.5, 1.0])
        >>> isinstance(table, sg.objects.Friction)
        True
    """

    @abc.abstractmethod
    def __call__(self, force: Scalar) -> Scalar:
        """mu_f, a pure number."""

    def corners(self) -> Float[Array, " k"]:
        """Normal forces (N) at which mu_f has a corner, where it has any."""
        return jnp.zeros(0)

    def __check_init__(self) -> None:
        if (is_own(self) or isinstance(self, FrictionLaw)) and is_known(self):
            _require_coefficients(self)


def _require_coefficients(friction: Friction) -> None:
    """An InputError where a law of the user's own gives what is no coefficient of friction."""
    where, law = f"{type(friction).__name__}.__call__", friction
    if isinstance(friction, FrictionLaw) and not is_own(friction):
        where, law = "The friction law", friction.law
    if not require_numbers(where, friction, law, jnp.ones(())):
        return  # several laws in one, made for vmap
    with jax.ensure_compile_time_eval():  # under jit, too
        found = np.asarray(jax.vmap(law)(jnp.asarray(FORCES)))
    # Written so that NaN counts as no coefficient.
    wrong = ~((found >= 0) & (found < np.inf))
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise InputError(
            f"{where} is {found[k]:.6g} under {FORCES[k]:g} N; a coefficient of friction must be a finite number, zero "
            f"or more, from {FORCES[0]:g} to {FORCES[-1]:g} N."
        )


class FrictionTable(Friction):
    """Measured coefficients of friction, linear between the rows and constant beyond them.

    Args:
        force: normal force, N, shape (n,), increasing.
        coefficient: mu_f, dimensionless, shape (n,).

    Raises:
        InputError: where shapes differ, a coefficient is not positive, or the force does not increase (outside of jit).

    Source: own.

    Examples:
        >>> table = sg.objects.FrictionTable(force=[1.0, 3.0], coefficient=[1.5, 1.0])
        >>> print(f"{table(jnp.asarray(2.0)):.2f}")
        1.25
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

    def corners(self):
        return self.force


class FrictionLaw(Friction):
    """Any function of the normal force as a coefficient of friction.

    Args:
        law: function from the normal force (N) to mu_f (dimensionless); its constants are not differentiated.

    Raises:
        InputError: where the law gives no finite number, zero or more, at forces up to 1 N.

    Source: own.

    Examples:
        >>> print(f"{sg.objects.FrictionLaw(lambda force: 1.5 / (1 + force))(jnp.asarray(2.0)):.2f}")
        0.50
    """

    law: Callable[[Scalar], Scalar] = eqx.field(static=True)

    def __call__(self, force: Scalar) -> Scalar:
        return jnp.asarray(self.law(force), float)


def to_friction(value: Any) -> Any:
    """A friction as scenes hold it: a number stays a number, a plain function becomes a FrictionLaw.

    Args:
        value: mu_f, dimensionless: a number, a `Friction`, or a function of the normal force (N).

    Examples:
        >>> type(sg.objects.to_friction(lambda force: 1.0)).__name__
        'FrictionLaw'
    """
    if callable(value) and not isinstance(value, eqx.Module):
        return FrictionLaw(value)
    return to_float_array(value)


def friction(**kwargs: Any) -> Any:
    """A field of a module that holds mu_f: a positive number, a Friction, or a function of the normal force in N.

    Args:
        kwargs: of `equinox.field`, for instance `default`.

    Examples:
        >>> sg.objects.friction(default=1.0).default
        1.0
    """
    return eqx.field(converter=to_friction, metadata={"friction": True}, **kwargs)


def friction_coefficient(friction: Any, force: Scalar) -> Scalar:
    """The coefficient of friction at a normal force.

    Args:
        friction: mu_f, dimensionless, a number or a `Friction`.
        force: normal force, N.

    Returns:
        mu_f, dimensionless.

    Examples:
        >>> table = sg.objects.FrictionTable(force=[1.0, 3.0], coefficient=[1.5, 1.0])
        >>> print(f"{sg.objects.friction_coefficient(table, jnp.asarray(2.0)):.2f}")
        1.25
    """
    return friction(force) if isinstance(friction, Friction) else friction


class OnSlope(Friction):
    """What a tip lifts over the force with which it presses inwards, on a face that leans.

    A tip presses with F towards the axis and lifts V. On a face at the angle beta to the ground that is N = F sin(beta)
    - V cos(beta) across it and T = F cos(beta) + V sin(beta) along it, and T = mu_f N at most, so that

        V / F = (mu_f sin(beta) - cos(beta)) / (sin(beta) + mu_f cos(beta)):

    mu_f of an upright face, and nothing at all where mu_f tan(beta) is 1 or less. mu_f is taken at the force F.

    Args:
        friction: mu_f of the surfaces, dimensionless, a number or a `Friction`.
        sine, cosine: of beta, dimensionless.

    Raises:
        InputError: where sine or cosine is negative (outside of jit).

    Source: statics, as of a wedge; the thesis (5.2.3) leaves N's downward part out, and finds V / F = mu_f sin^2(beta).

    Examples:
        >>> steep = sg.objects.OnSlope(jnp.asarray(1.0), jnp.asarray(0.8), jnp.asarray(0.6))
        >>> print(f"{steep(jnp.asarray(2.0)):.4f}")  # (0.8 - 0.6) / (0.8 + 0.6)
        0.1429
    """

    friction: Any = eqx.field()
    sine: Scalar = nonnegative("number")
    cosine: Scalar = nonnegative("number")

    def __call__(self, force: Scalar) -> Scalar:
        mu = friction_coefficient(self.friction, force)
        return larger((mu * self.sine - self.cosine) / (self.sine + mu * self.cosine), 0.0)

    def corners(self):
        return self.friction.corners() if isinstance(self.friction, Friction) else jnp.zeros(0)


def friction_force(friction: Any, force: Scalar) -> Scalar:
    """The largest tangential force that a normal force holds, mu_f(F) F.

    Args:
        friction: mu_f, dimensionless, a number or a `Friction`.
        force: normal force F, N.

    Returns:
        The tangential force, N.

    Source: Coulomb's law.

    Examples:
        >>> print(f"{sg.objects.friction_force(jnp.asarray(0.96), jnp.asarray(2.0)):.2f} N")
        1.92 N
    """
    return friction_coefficient(friction, force) * force


FRICTION_RANGE = np.log(1e4)
"""A required force is sought where the coefficient of friction is between 1e-4 and 1e4: every pair of materials."""


def required_normal_force(friction: Any, load: Scalar) -> Scalar:
    """The least normal force F with mu_f(F) F = load.

    Args:
        friction: mu_f, dimensionless, a number or a `Friction`.
        load: tangential force, N, zero or more.

    Returns:
        F, N, differentiable; inf where no force does it.

    Source: Coulomb's law; thesis (6.2).

    Examples:
        >>> print(f"{sg.objects.required_normal_force(0.96, jnp.asarray(1.92)):.4f} N")
        2.0000 N
    """
    if not callable(friction):
        holds = jnp.asarray(friction) > 0
        return jnp.where(holds, load / jnp.where(holds, friction, 1.0), jnp.where(load > 0, jnp.inf, 0.0))

    def short(log_force, args):
        friction, load = args
        return jnp.log(friction_force(friction, jnp.exp(log_force))) - jnp.log(jnp.where(load > 0, load, 1.0))

    args = (friction, load)
    fixed = lax.stop_gradient(args)
    middle = jnp.log(jnp.where(fixed[1] > 0, fixed[1], 1.0))
    # Where mu_f falls, what is held may have a top, and a load just below it is held around that alone.
    even = FRICTION_RANGE * jnp.linspace(-1.0, 1.0, CELLS + 1)
    corners = jnp.clip(jnp.log(fixed[0].corners()) - middle, even[0], even[-1])
    x, y = samples_with_turns(lambda x: short(x, fixed), middle + jnp.sort(jnp.append(even, corners)))
    carried = first_crossing(lambda x: short(x, fixed), jnp.zeros_like(load), x, y, x[-1])
    force = jnp.where(carried.exists, jnp.exp(implicit(short, carried.x, args)), jnp.inf)
    return jnp.where(load > 0, force, 0.0)
