"""The energy membrane in free space and against any rigid object."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...errors import JoinedRuleError
from ...fields import choice, is_concrete, part
from ...numerics.choice import smallest
from ..obstacles import Obstacle, Shape, length
from .basis import Grid
from .maps import shape_observables
from .scene import EnergyScene, Vector
from .sheet import local


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

    symmetry: str = choice("none", "across", "along", "both", default="both")
    bending: bool = eqx.field(static=True, default=False)
    across: int = eqx.field(static=True, default=4)
    lengthwise: int = eqx.field(static=True, default=6)

    @property
    def body(self):
        return None

    @property
    def grid(self):
        return Grid(self.across, self.lengthwise, self.symmetry, self.bending)

    def without_body(self):
        return self

    def measured(self, y, contact_pressures, pressure):
        return shape_observables(self, y)


class Resting(NamedTuple):
    """The membrane at the contact points."""

    places: Float[Array, "k 3"]
    """Of its outer face, m."""
    pushes: Float[Array, " k"]
    """Normal forces, N."""
    shares: Float[Array, " k"]
    """Of their sum; zero where nothing presses."""


class ObstacleContact(EnergyScene):
    """The energy membrane pressed against any rigid object, without friction.

    The state minimises the integral of t_m W(C) dA minus p times the enclosed volume over a global polynomial basis of
    the displacements; the object is its signed distance, kept zero or more at the contact points.

    Args:
        shell: the actuator.
        obstacle: the object, by its signed distance in the frame of `sg.shell.obstacles`.
        symmetry: mirror symmetry of the object, "across" (x -> -x), "along" (y -> -y), "both" or "none"; each halves
            the unknowns. "auto" looks for it where the object's numbers are known, and takes "none" where they are
            traced, so that derivatives by what breaks a symmetry are right. A symmetry that is named is checked.
        bending: whether the wall has its bending stiffness and clamped slopes, for t_m / a above about 0.1.
        across, lengthwise: polynomials of the height, of each parity; there are as many contact points.

    Observables:
        - force: sum of the contact pressures over the contact, N.
        - force_x, force_y, force_z: their resultant on the object, N.
        - moment_x, moment_y, moment_z: its moment about the middle of the flat membrane's outer face, N m.
        - friction_moment: contact pressure times distance from the middle of the contact, integrated, N m; times the
            coefficient of friction it resists turning about z, which the thesis (3.40) takes from a uniform pressure.
        - contact_area: force over pressure, what an even pressure would need, m^2.
        - inflation: height of the middle, m.
        - stretch, length_stretch, largest_stretch: in the middle across and along, and anywhere, dimensionless.
        - clamp_angle: slope at the middle of the long edge, rad.
        - wrinkled_share: part of the area in compression, dimensionless.

    Raises:
        InputError: where a field breaks its rule, or the object breaks the named symmetry (IMPOSSIBLE under jit).

    Source: own; docs/theory/energy.md. Free inflation and forces on a plane are within 5 % of finite elements.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> ball = sg.shell.obstacles.Sphere(radius=20 * mm, gap=5 * mm)
        >>> sg.shell.ObstacleContact(shell, ball).prepared().symmetry
        'both'
    """

    obstacle: Obstacle = part(Obstacle)
    symmetry: str = choice("auto", "none", "across", "along", "both", default="auto")
    bending: bool = eqx.field(static=True, default=False)
    across: int = eqx.field(static=True, default=4)
    lengthwise: int = eqx.field(static=True, default=6)

    OBSERVABLES: ClassVar = {
        "force": "force",
        "force_x": "force",
        "force_y": "force",
        "force_z": "force",
        "moment_x": "moment",
        "moment_y": "moment",
        "moment_z": "moment",
        "friction_moment": "moment",
        "contact_area": "area",
    } | EnergyFree.OBSERVABLES

    def __check_init__(self) -> None:
        if self.symmetry not in MIRRORS or not self._is_known():
            return
        with jax.ensure_compile_time_eval():  # under jit, too
            broken = self.broken_symmetry()
        if float(broken) > SYMMETRIC:
            name = type(self).__name__
            raise JoinedRuleError(
                f"{name}.symmetry is {self.symmetry!r}, but the object is not the same on both sides: its distance "
                "differs by {difference}; use 'auto' or 'none'.",
                difference=(float(f"{float(broken * self.shell.a):.3g}"), "length"),
            )

    def _is_known(self) -> bool:
        """Whether everything about one object is known (of a user's own, parameters may be arrays)."""
        leaves = jax.tree.leaves(self.shell if isinstance(self.obstacle, Shape) else (self.shell, self.obstacle))
        return is_concrete(*jax.tree.leaves((self.shell, self.obstacle))) and all(jnp.ndim(x) == 0 for x in leaves)

    def broken_symmetry(self, symmetry: str | None = None):
        """By how much, in a, mirroring changes the distance of the object from places over the membrane."""
        side = self.functional.touching.points
        flat = np.concatenate([side, np.ones_like(side[:, :1])], axis=1)
        sizes = jnp.stack([self.shell.a, self.shell.b, self.shell.a])[None]
        change = jnp.zeros_like(self.shell.a)
        for mirror in MIRRORS[symmetry or self.symmetry]:
            for height in HEIGHTS:
                places = flat * np.array([[1, 1, height]]) * sizes
                distance = jax.vmap(self.obstacle.distance)
                apart = distance(places * mirror[None]) - distance(places)
                change = jnp.maximum(change, jnp.max(jnp.abs(apart)) / self.shell.a)
        return change

    def prepared(self):
        if self.symmetry != "auto":
            return self
        if self._is_known():
            for symmetry in ("both", "across", "along"):
                with jax.ensure_compile_time_eval():
                    broken = self.broken_symmetry(symmetry)
                if float(broken) <= SYMMETRIC:
                    return dataclasses.replace(self, symmetry=symmetry)
        return dataclasses.replace(self, symmetry="none")

    def is_possible(self):
        symmetric = self.symmetry not in MIRRORS or self.broken_symmetry() <= SYMMETRIC
        return super().is_possible() & symmetric

    def margins_at_rest(self):
        """membrane_clear_at_rest: the least distance of the object from the outer face of the flat membrane and its
        clamped edges, at FACE x FACE points."""
        x, y = (part.reshape(-1) for part in np.meshgrid(*[np.linspace(-1, 1, FACE)] * 2))
        places = jnp.stack([self.shell.a * x, self.shell.b * y, jnp.zeros_like(self.shell.a * x)], axis=-1)
        return {"membrane_clear_at_rest": smallest(jax.vmap(self.body.distance)(places))}

    @property
    def grid(self):
        return Grid(self.across, self.lengthwise, self.symmetry.replace("auto", "none"), self.bending)

    @property
    def body(self):
        return self.obstacle

    def without_body(self):
        return EnergyFree(self.shell, self.grid.symmetry, self.bending, self.across, self.lengthwise)

    def resting(self, y: Vector, contact_pressures: Float[Array, " k"]) -> Resting:
        """Where the membrane rests on the object, and how much."""
        shell, table = self.shell, self.functional.touching
        aspect, thickness = shell.a / shell.b, shell.t_m / shell.a

        def face(e, point):
            return shell.a * local(e, point, aspect).face(thickness)

        places = jax.vmap(face)(self.functional.deformed(y, table.values), table.points)
        pushes = contact_pressures * self.functional.contact_weights(self) * self.unit() * shell.a**2
        total = jnp.sum(pushes)
        return Resting(places, pushes, pushes / jnp.where(total > 0, total, 1.0))

    def measured(self, y, contact_pressures, pressure):
        resting = self.resting(y, contact_pressures)
        places, pushes = resting.places, resting.pushes
        forces = pushes[:, None] * -jax.vmap(jax.grad(self.body.distance))(places)
        # The grid of a symmetric scene covers one side: what the other side takes away again is left out.
        across, along = self.symmetry in ("across", "both"), self.symmetry in ("along", "both")
        force = jnp.sum(forces, axis=0) * np.array([not across, not along, True])
        moment = jnp.sum(jnp.cross(places, forces), axis=0) * np.array([not along, not across, not (across or along)])
        total = jnp.sum(pushes)
        resultants = {f"force_{axis}": force[k] for k, axis in enumerate("xyz")}
        resultants |= {f"moment_{axis}": moment[k] for k, axis in enumerate("xyz")}
        # What turns about the z axis through the middle of the contact: zero by symmetry, or where the forces balance.
        middle = (resting.shares @ places)[:2] * np.array([not across, not along])
        arms = jax.vmap(length)(places[:, :2] - middle[None])
        resultants["friction_moment"] = pushes @ arms
        return {"force": total, **resultants, "contact_area": total / pressure} | shape_observables(self, y)


FACE = 17
"""Points along each side of the membrane at which its distance at rest from the object is asked; what is convex and
comes nearest at an edge or a corner, as tilted planes and rods do, is met exactly at one of them, or nearly so."""
SYMMETRIC = 1e-9
"""Mirrored distances that differ by less than this, in a, are the same."""
HEIGHTS = (0.0, 0.5, 1.0)
"""Heights over every contact point, in a, at which an object is compared with its mirror image."""
_ACROSS, _ALONG = np.array([-1, 1, 1]), np.array([1, -1, 1])
MIRRORS = {"across": (_ACROSS,), "along": (_ALONG,), "both": (_ACROSS, _ALONG)}
"""Symmetry -> what a place is multiplied by."""
