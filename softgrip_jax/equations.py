"""What a scene states for a solver that knows its kind of equations: no more than physics, and no way to a state.

`CurveEquations` is for one unknown, whose pressure is explicit (solved by `solvers.ExplicitCurve`); `PathEquations` is
for several unknowns with loads beside the pressure (solved by `solvers.ArcLength`). A scene derives from one of them
and from `Scene`.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .load_path import LoadPath
from .reasons import Reason
from .scene import Found

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]


class Approach(NamedTuple):
    """The free state that grows from zero load until a scene's own state begins."""

    scene: CurveEquations
    touch: Scalar
    """Its angle where it touches, with derivatives."""
    begins: Scalar
    """The pressure at which the scene's own state begins, with derivatives."""
    touches_early: bool = False
    """Whether the free state touches before the scene's own state begins (an inclined plane): it then is inflated
    freely up to there, and must have no limit point on that way either."""


class CurveEquations(eqx.Module):
    """The pressure p(theta) as an explicit function of one angle theta (rad): every state is a scalar root of it.

    An author gives `interval`, `load`, `pressure_scale` and, as for every scene, `observe`. The pressure rises with the
    angle up to the first limit point, or to the end of the interval: that is where equilibrium under pressure control
    ends.
    """

    CONTACT: ClassVar[bool] = True
    """Whether the angle starts where something is first touched (a lower pressure is then NO_CONTACT)."""

    @abc.abstractmethod
    def interval(self) -> tuple[Scalar, Scalar]:
        """The angles where the state begins and where its model ends, with their derivatives."""

    @abc.abstractmethod
    def load(self, angle: Scalar) -> Scalar:
        """The pressure that holds the scene at this angle, Pa."""

    @abc.abstractmethod
    def pressure_scale(self) -> Scalar:
        """A pressure typical of the design, Pa: makes the residual a pure number."""

    def unbounded(self) -> Bool[Array, ""]:
        """True where the load grows without bound towards the end of the interval: there is then no limit."""
        return jnp.asarray(False)

    def amplified(self, angle: Scalar) -> Scalar:
        """How many parts of rounding the load has for one in what it is made of, where that is many."""
        return jnp.zeros_like(angle)

    def may_dip(self) -> bool:
        """Whether the load may fall and rise again. A neo-Hookean membrane's has one maximum at most."""
        return True

    def may_turn(self, name: str) -> bool:
        """Whether this observable may rise and fall, or fall and rise, along the curve."""
        return True

    def residual(self, unknowns, pressure):
        return (self.load(unknowns) - pressure) / (self.pressure_scale() + jnp.abs(pressure))

    def approach(self) -> Approach | None:
        """The free state that leads from zero load to this one; None where this one begins at zero load."""
        return None

    def end_reason(self) -> Int[Array, ""] | int:
        """The `Reason` that belongs to the end of the interval."""
        return Reason.ARC_CLOSED

    def largest_angle(self) -> Scalar:
        """The angle at which the scene is as large as anybody would draw it; the end of the interval may come first."""
        return jnp.full_like(self.interval()[1], jnp.inf)


class PathEquations(eqx.Module):
    """Equations `residual_and_observables(unknowns, load_factor, pressure)[0] = 0` for several unknowns.

    load_factor, from 0 to 1, scales the external loads: states are those that are connected to zero load, on a way of
    loads and pressures, see `LoadPath`.
    """

    def end_reason(self) -> Reason:
        """What ends the model at `LoadPath.end`."""
        return Reason.NO_EQUILIBRIUM

    @abc.abstractmethod
    def unloaded_state(self) -> Vector:
        """The unknowns without any load: an exact solution at load_factor 0 and no pressure."""

    def begun_state(self, unknowns: Vector, load: Any) -> Vector:
        """From where the first point at which the pressure acts is sought; load: as `LoadPath.load_at` gives it."""
        return unknowns

    @abc.abstractmethod
    def residual_and_observables(
        self, unknowns: Vector, load_factor: Scalar, pressure: Any
    ) -> tuple[Vector, dict[str, Array]]:
        """The scaled equations (entries and unknowns of order one) with the external loads times `load_factor`, and
        what is observed. Both come from one integration; what is not used is not computed. In place of the pressure
        there may be what the scene's `load_of` and its `LoadPath.load_at` give."""

    def observe(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[1]

    def evaluated(self, unknowns, pressure):
        return residual_and_observables(self, unknowns, jnp.ones_like(pressure), self.load_of(pressure))

    def load_of(self, pressure: Scalar) -> Any:
        """What `residual_and_observables` is given of a pressure, as `LoadPath.load_at` gives it on the way."""
        return pressure

    @abc.abstractmethod
    def pressure_span(self) -> LoadPath:
        """The range of pressures in which the actuator acts."""

    def unknown_shape(self):
        return jax.eval_shape(self.unloaded_state).shape

    def passed(self, observed: dict[str, Array]) -> Scalar | None:
        """How far a state is beyond what the model covers, rising through zero where that ends (`Reason.CURLED_UP`):
        the equations go on behind it. None where there is no such end."""
        return None

    def is_loop(self, observed: dict[str, Array]) -> Array:
        """True where a state is none of the branch connected to zero load, whatever the sign of its Jacobian says."""
        return jnp.asarray(False)

    def is_resolved(self, unknowns: Vector) -> Bool[Array, ""]:
        """False where the points that stand for a shape are too few to tell it: behind its limit a branch ends."""
        return jnp.asarray(True)

    def spent(self, unknowns: Vector, pressure: Scalar) -> dict[Reason, Scalar]:
        """What a state uses of the most that its parts can hold, less 1: the equations have no value above zero."""
        return {}

    def is_unloaded(self) -> Array:
        """True where `unloaded_state` already solves the scene at no pressure: there are no external loads."""
        return jnp.asarray(False)

    def residual(self, unknowns, pressure):
        return self.evaluated(unknowns, pressure)[0]

    def grows_together(self) -> bool:
        """Whether loads and pressure grow together on the way to a state; otherwise all loads come first."""
        return False

    def explicit(self, pressure: Scalar) -> Found | None:
        """The state at a pressure where it needs no path, in closed form or as scalar roots; None where it does."""
        return None

    def explicit_limit(self) -> Found | None:
        """The end of the branch, as a solver's `find_limit` has it, where it needs no path; None where it does."""
        return None

    def is_lightly_loaded(self) -> Bool[Array, ""] | None:
        """Whether Newton's method is tried from rest, before the path is followed; None where it never is."""
        return None

    def is_the_only_state(self, unknowns: Vector, pressure: Scalar) -> Bool[Array, ""]:
        """Under light loads: where True these unknowns, if they solve the equations at the pressure, are the state that
        is connected to zero load, whatever the way to it."""
        return jnp.asarray(False)

    def has_close_limits(self) -> bool:
        """Whether limit points may follow so close on each other that states beyond them look like states before."""
        return False

    def touches_where_positive(self) -> str | None:
        """The observable that rises through zero where contact begins; None where that is where the pressure acts."""
        return None

    def solved(self, found: Found) -> Found:
        """What `Scene.verified` says of the equations alone, whatever the contact says."""
        return self.verified(found)  # pyright: ignore[reportAttributeAccessIssue]


@jax.jit
def residual_and_observables(
    scene: PathEquations, unknowns: Vector, load_factor: Scalar, pressure: Any
) -> tuple[Vector, dict[str, Array]]:
    """`scene.residual_and_observables`, traced once for all that asks for it."""
    return scene.residual_and_observables(unknowns, load_factor, pressure)
