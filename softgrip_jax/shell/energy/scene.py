"""Scenes of the energy membrane: minima of `energy.Functional`."""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...errors import JoinedRuleError
from ...fields import choice, count, part
from ...numerics.choice import smallest
from ...numerics.implicit import implicit
from ...numerics.minimise import Expansion
from ...reasons import Reason
from ...results import Status, stop_gradient_where_failed
from ...scene import Scene, frozen
from ...solvers.minimum_energy import MinimumEnergy
from ..flat_shell import FlatShell, Scalar
from ..obstacles import Obstacle
from . import maps
from .basis import Grid, Vector
from .functional import Functional, functional
from .own_obstacle import require_distance
from .symmetry import MIRRORS, SYMMETRIC, broken_symmetry, known_break, symmetry_of

FACE = 17
"""Points along each side of the membrane at which its distance at rest from the object is asked; what is convex and
comes nearest at an edge or a corner, as tilted planes do, is met exactly at one of them."""


PASSED = 0.01
"""An object that is wholly behind the outer face somewhere, and there deeper than this (in t_m), has been passed. What
presses is inside the face, by up to 0.6 t_m at the edges of a box, and not behind it: of 135 random states on planes,
balls and cylinders none has a column that is in the object at all."""
ZOOMS = 6
"""Times that the place at rest nearest to the object is looked for, each time within a quarter of the range."""


class EnergyScene(Scene):
    """A state of the energy membrane. `body` is what it touches (None in free space).

    The unknowns are the coefficients of the displacement. Loads are cube roots of p a / (mu t_m), in proportion to
    which the membrane rises.
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("MinimumEnergy",)
    MODEL: ClassVar[str] = "energy"
    """What scenes that have the choice call it."""
    EITHER_WAY: ClassVar[dict[str, float]] = {
        **dict.fromkeys(("force_x", "force_y", "moment_x", "moment_y", "moment_z"), 0.0),
        **dict.fromkeys(("stretch", "length_stretch"), 1.0),
    }
    """Observables that rise or fall from their value at rest, as the object lies: `pressure_for` seeks either way."""

    shell: FlatShell = part(FlatShell)
    obstacle: Obstacle | None = part(Obstacle)
    symmetry: str = choice("auto", "none", "across", "along", "both", default="auto")
    bending: bool = eqx.field(static=True, default=True)
    across: int = count(default=4)
    lengthwise: int = count(default=6)

    def __check_init__(self) -> None:
        if self.obstacle is not None:
            require_distance(self)
        broken = known_break(self)
        if broken is not None and float(broken) > SYMMETRIC:
            name = type(self).__name__
            raise JoinedRuleError(
                f"{name}.symmetry is {self.symmetry!r}, but the object is not the same on both sides: its distance "
                "differs by {difference}; use 'auto' or 'none'.",
                difference=(float(f"{float(broken * self.shell.a):.3g}"), "length"),
            )

    def prepared(self):
        return dataclasses.replace(self, symmetry=symmetry_of(self)) if self.symmetry == "auto" else self

    @property
    def functional(self) -> Functional:
        """The energy on this scene's grid."""
        return functional(self.grid)

    @property
    def grid(self) -> Grid:
        """Polynomials and symmetry."""
        return Grid(self.across, self.lengthwise, self.symmetry.replace("auto", "none"))

    @property
    def body(self) -> Obstacle | None:
        """What the membrane touches; None in free space."""
        return self.obstacle

    def without_body(self) -> EnergyFree:
        """The same membrane, on the same grid, in free space."""
        return EnergyFree(self.shell, None, self.grid.symmetry, self.bending, self.across, self.lengthwise)

    def solver(self):
        return MinimumEnergy()

    def unit(self) -> Scalar:
        """mu t_m / a, Pa: the unit of pressure."""
        return self.shell.pressure_scale()

    def contact_pressures(self, unknowns: Vector, pressure: Scalar) -> Float[Array, " k"]:
        """At the contact points per flat area, in mu t_m / a."""
        return self.functional.contact_pressures(unknowns, self, pressure / self.unit())

    def unknown_shape(self):
        return (self.functional.size,)

    def unloaded_state(self) -> Vector:
        """The unknowns of the flat membrane."""
        return jnp.zeros_like(self.shell.a, shape=self.unknown_shape())

    def first_guess(self, load: Scalar) -> Vector:
        """A cap: what the small-deflection law (2.1) of a square gives, with the first polynomial of w alone."""
        height = self.functional.height_of_first()
        return self.unloaded_state().at[sum(self.functional.sizes[:2])].set(load / (3 * 2.5) ** (1 / 3) / height)

    def is_possible(self):
        possible = (self.shell.b >= self.shell.a) & self.shell.material.is_stable_at_rest()
        if self.body is None:
            return possible
        return possible & (self.symmetry not in MIRRORS or broken_symmetry(self, self.symmetry) <= SYMMETRIC)

    def margins_at_rest(self):
        """membrane_clear_at_rest: the least distance of the object from the outer face of the flat membrane and its
        clamped edges: at FACE x FACE points, then around the nearest of them, more and more closely."""
        if self.body is None:
            return {}
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, FACE)] * 2), axis=-1).reshape(-1, 2)

        def distances(scene: EnergyScene, points: Float[Array, "n 2"]) -> Float[Array, " n"]:
            body, sides = scene.body, jnp.stack([scene.shell.a, scene.shell.b])
            assert body is not None
            return jax.vmap(lambda point: body.distance(jnp.append(point * sides, 0.0)))(points)

        def closer(k, middle):
            points = jnp.clip(middle[None] + grid * 0.25**k, -1.0, 1.0)
            return points[jnp.argmin(distances(fixed, points))]

        fixed = frozen(self)
        nearest = lax.fori_loop(0, ZOOMS, closer, jnp.zeros_like(fixed.shell.a, shape=(2,)))
        # The place does not move to first order: the distance is least there.
        return {"membrane_clear_at_rest": distances(self, nearest[None])[0]}

    def margins_of_state(self, unknowns, pressure):
        """membrane_above_clamp: half the wall more than the least height of the middle surface over the plane of its
        clamp, at the quadrature points. What bulges further back passes through the frame, and often through itself."""
        heights = self.functional.deformed(unknowns)[:, 2, 0] * self.shell.a
        return {"membrane_above_clamp": smallest(heights) + 0.5 * self.shell.t_m}

    def expansion(self, y: Vector, load: Scalar) -> Expansion:
        """The energy with its derivatives at a load, for `minimise`."""
        x = self.functional.expand(y, self, load**3)
        touching = self.functional.touches(y, self)
        return Expansion(x.value, x.gradient, x.hessian, 3 * load**2 * x.by_load, touching)

    def residual(self, unknowns, pressure):
        return self.functional.equations(unknowns, self, pressure / self.unit())

    def with_implicit_derivative(self, unknowns, pressure):
        # The flat membrane has no stiffness, and is given no derivatives: they would be infinite.
        flat = pressure <= 0
        scene, pressure = stop_gradient_where_failed(~flat, (self, pressure))
        bulged = frozen(self).first_guess(jnp.ones_like(pressure))
        found = implicit(
            lambda unknowns, args: args[0].residual(unknowns, args[1]),
            jnp.where(flat, bulged, unknowns),
            (scene, pressure),
        )
        return jnp.where(flat, 0.0, found)

    def has_passed(self, unknowns: Vector) -> Bool[Array, ""]:
        """Whether the membrane has a part of the object behind itself, or has sunk into it past a part of it."""
        if self.body is None:
            return jnp.asarray(False)
        return self.functional.passed(unknowns, self) * self.shell.a > PASSED * self.shell.t_m

    def verified(self, found):
        """Not converged, too, where the membrane has passed a part of the object: contact points missed it."""
        found = super().verified(found)
        answered = (found.status == Status.OK) | (found.status == Status.NO_CONTACT)
        lost = answered & frozen(self).has_passed(lax.stop_gradient(found.unknowns))
        return found._replace(
            status=jnp.where(lost, Status.NOT_CONVERGED, found.status),
            reason=jnp.where(lost, int(Reason.OBJECT_NOT_RESOLVED), found.reason),
        )

    def observe(self, unknowns, pressure):
        return self.measured(unknowns, self.contact_pressures(unknowns, pressure), pressure)

    @abc.abstractmethod
    def measured(self, y: Vector, contact_pressures: Float[Array, " k"], pressure: Scalar) -> dict[str, Array]:
        """What is observed, from coefficients and contact pressures (mu t_m / a) at a pressure (Pa)."""

    def profile(self, unknowns, pressure, n):
        return maps.profile(self, unknowns, n)

    def surface(self, unknowns: Vector, pressure: Scalar, n: int) -> dict[str, Array]:
        """Maps on n x n points: see `maps.surface`."""
        return maps.surface(self, unknowns, pressure, n)


class EnergyFree(EnergyScene):
    """The energy membrane in free space: what `Free(shell, model="energy")` is solved as."""

    OBSERVABLES: ClassVar = {
        "inflation": "length",
        "stretch": "number",
        "length_stretch": "number",
        "largest_stretch": "number",
        "clamp_angle": "angle",
        "wrinkled_share": "number",
    }

    obstacle: None = eqx.field(static=True, default=None)
    symmetry: str = choice("none", "across", "along", "both", default="both")

    def measured(self, y, contact_pressures, pressure):
        return maps.shape_observables(self, y)
