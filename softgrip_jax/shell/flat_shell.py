"""The flat shell actuator: a clamped rectangular membrane over a rigid shell, and what all its scenes share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..equations import CurveEquations
from ..errors import InputError, JoinedRuleError
from ..fields import Checked, choice, is_concrete, part, positive
from ..materials.base import Material
from ..membrane import equilibrium_pressure
from ..numerics.scalar_roots import bracketed_root
from ..reasons import Reason
from ..scene import Scene
from ..solvers.explicit_curve import ExplicitCurve

Scalar = Float[Array, ""]


class FlatShell(Checked):
    """A rectangular membrane 2a x 2b x t_m that is clamped on the edges of a rigid shell.

    Args:
        a: half width (half of the smaller side), m.
        b: half length, m, at least a.
        t_m: membrane thickness, m.
        material: strain energy of the membrane.

    Raises:
        InputError: where a field breaks its rule, or b is less than a (outside of jit).

    Source: thesis 3.1. Arcs are for thin walls; at t_m / a of 0.1 bending takes a tenth of a force.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{shell.pressure_scale() / kPa:.3f} kPa")
        12.031 kPa
    """

    a: Scalar = positive("length")
    b: Scalar = positive("length")
    t_m: Scalar = positive("length")
    material: Material = part(Material)

    def __check_init__(self) -> None:
        # In NumPy: under jit JAX would trace even known numbers.
        if is_concrete(self.a, self.b) and np.any(np.asarray(self.b) < np.asarray(self.a)):
            raise JoinedRuleError(
                "FlatShell.b is {b}; it must be at least a ({a}): a is half of the smaller side.",
                a=(float(np.max(self.a)), "length"),
                b=(float(np.min(self.b)), "length"),
            )

    def pressure_scale(self) -> Scalar:
        """mu t_m / a, Pa."""
        return self.material.shear_modulus() * self.t_m / self.a


@runtime_checkable
class Arcs(Protocol):
    """The geometry of a membrane of circular arcs, explicit in one angle (rad)."""

    def angles(self) -> tuple[Scalar, Scalar]:
        """Where the state begins and where its geometry ends."""
        ...

    def stretches(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """lambda_1 (width) and lambda_2 (length)."""
        ...

    def curvatures(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """kappa_1 (width) and kappa_2 (length), 1/m."""
        ...


class ShellScene(CurveEquations, Scene):
    """A state of the shell on a curve of angles; subclasses give `geometry`, `stretches` and `curvatures` of the
    membrane, or hold them as `arcs`."""

    SOLVERS: ClassVar[tuple[str, ...]] = ("ExplicitCurve", "Newton")

    shell: FlatShell = part(FlatShell)
    model: str = choice("arc", "energy", default="arc", kw_only=True)
    """The thesis's arcs, or the energy membrane, which is within a few percent of finite elements and costs more."""
    bending: bool = eqx.field(
        static=True, default=True, kw_only=True, metadata={"doc": "whether the energy membrane resists bending"}
    )
    """Whether the energy membrane resists bending and is clamped without a slope; arcs never do."""

    ENDLESS: ClassVar[bool] = False
    """Whether the stretch grows without bound towards the end of the geometry (then a stiff material has no limit)."""

    NO_END: ClassVar[float] = 1e6
    """Such a state has no limit where its pressure at the last angle is more than so many mu t_m / a. Where it is less,
    the model ends at the last angle (Ogden's alpha just above 3: p grows with the stretch to the power alpha - 3)."""

    def __check_init__(self) -> None:
        if self.model == "energy" and type(self).energy_scene is ShellScene.energy_scene:
            raise InputError(f"{type(self).__name__}.model is 'energy'; there is only 'arc' for this scene.")

    def solver(self):
        return ExplicitCurve()

    def energy_scene(self) -> Scene:
        """The same scene with the energy membrane."""
        raise NotImplementedError

    def prepared(self):
        if self.model == "arc":
            return self
        made = self.energy_scene()
        if made.ignored_rules == self.ignored_rules:
            return made
        return dataclasses.replace(made, ignored_rules=self.ignored_rules)

    def arcs(self) -> Arcs:
        """The geometry of the membrane."""
        raise NotImplementedError

    def geometry(self) -> tuple[Scalar, Scalar]:
        """The angles where the state begins and where its geometry ends."""
        return self.arcs().angles()

    def stretches(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """lambda_1 (width) and lambda_2 (length)."""
        return self.arcs().stretches(angle)

    def curvatures(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """kappa_1 (width) and kappa_2 (length), 1/m."""
        return self.arcs().curvatures(angle)

    @jax.jit
    def load(self, angle):
        """The pressure that holds the membrane at this angle, Pa, thesis (2.4)."""
        shell = self.shell
        return equilibrium_pressure(shell.material, shell.t_m, *self.stretches(angle), *self.curvatures(angle))

    def pressure_scale(self):
        return self.shell.pressure_scale()

    def interval(self):
        start, end = self.geometry()
        if not has_largest_stretch(self.shell.material):
            return start, end
        return start, locking_angle(self.stretchable, start, end)

    def stretchable(self, angle: Scalar) -> Scalar:
        """Positive where the material can follow the stretch."""
        return self.shell.material.stretchable(*self.stretches(angle))

    def amplified(self, angle):
        if not has_largest_stretch(self.shell.material):
            return jnp.zeros_like(angle)
        # The tension goes with one over what is left to the lock.
        return 1 / jnp.maximum(self.stretchable(angle), jnp.finfo(angle.dtype).eps)

    def unbounded(self) -> Bool[Array, ""]:
        end = self.interval()[1]
        endless = jnp.asarray(False)
        if self.ENDLESS:
            endless = self.load(end) > self.NO_END * self.pressure_scale()
        return endless | self.locks()

    def locks(self) -> Bool[Array, ""]:
        """Whether the material is stretched to its limit before the geometry ends."""
        if not has_largest_stretch(self.shell.material):
            return jnp.asarray(False)
        return self.stretchable(self.geometry()[1]) <= 0

    def end_reason(self):
        return jnp.where(self.locks(), Reason.MATERIAL_LOCKED, Reason.ARC_CLOSED)

    def may_dip(self):
        return not self.shell.material.closed_forms().has_one_maximum

    def may_turn(self, name):
        return False

    def is_possible(self):
        return (self.shell.b >= self.shell.a) & self.shell.material.is_stable_at_rest()


def has_largest_stretch(material: Material) -> bool:
    """True for energies that may lock at a finite stretch: Gent's, and each one that does not say it is endless."""
    return not material.closed_forms().is_endless


LOCKING_MARGIN = 1e-9
"""The interval of a locking material ends this part of its length before the lock, where the tension is infinite."""


def locking_angle(stretchable: Callable[[Scalar], Scalar], start: Scalar, end: Scalar) -> Scalar:
    """The last angle in [start, end] that the material can reach.

    That is `end`, with its derivatives, where the material does not lock before; otherwise shortly before the lock and
    without derivatives, for the pressure is infinite there. `start` where even that is stretched too far.
    """
    low, high = lax.stop_gradient((start, end))
    lock = bracketed_root(lambda angle: -lax.stop_gradient(stretchable(angle)), low, high).x
    lock = jnp.where(stretchable(low) > 0, low + (1 - LOCKING_MARGIN) * (lock - low), low)
    return jnp.where(stretchable(high) > 0, end, lock)
