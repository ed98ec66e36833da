"""The energy membrane in free space and against any rigid object."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..checked import choice, part
from .energy import Grid, at_points, local
from .energy_scene import EnergyScene
from .obstacles import Obstacle


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

    def measured(self, y, pressure, pressed):
        return self.shape_observables(y)


class ObstacleContact(EnergyScene):
    """The membrane pressed against any rigid object, without friction.

    obstacle: its signed distance, in the frame of `obstacles`. symmetry: mirror symmetry that the object is known to
    have, "across" (x -> -x), "along" (y -> -y) or "both"; it saves time, and derivatives by what would break the
    symmetry are then lost. bending: with the bending stiffness of the wall and clamped slopes, for thick walls
    (t_m / a above about 0.1). across, along: polynomials of each parity.

    force is the sum of the contact pressures over the contact (N); force_x, force_y, force_z and moment_x, ... are
    their resultant on the object and its moment about the middle of the flat membrane's outer face.
    """

    obstacle: Obstacle = part(Obstacle)
    symmetry: str = choice("none", "across", "along", "both", default="none")
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
        "contact_area": "area",
    } | EnergyFree.OBSERVABLES

    @property
    def grid(self):
        return Grid(self.across, self.lengthwise, self.symmetry, self.bending)

    @property
    def body(self):
        return self.obstacle

    def without_body(self):
        return EnergyFree(self.shell, self.symmetry, self.bending, self.across, self.lengthwise)

    def measured(self, y, pressure, pressed):
        shell, functional = self.shell, self.functional
        aspect, thickness = shell.a / shell.b, shell.t_m / shell.a

        def face(e, point):
            return shell.a * local(e, point, aspect).face(thickness)

        places = jax.vmap(face)(functional.deformed(y), functional.tables.points)
        normals = -jax.vmap(jax.grad(self.body.distance))(places)
        pushes = pressed * functional.area_weights(self) * self.unit() * shell.a**2
        forces = pushes[:, None] * normals
        # The grid of a symmetric scene covers one side: what the other side takes away again is left out.
        across, along = self.symmetry in ("across", "both"), self.symmetry in ("along", "both")
        force = jnp.sum(forces, axis=0) * np.array([not across, not along, True])
        moment = jnp.sum(jnp.cross(places, forces), axis=0) * np.array([not along, not across, not (across or along)])
        total = jnp.sum(pushes)
        resultants = {f"force_{axis}": force[k] for k, axis in enumerate("xyz")}
        resultants |= {f"moment_{axis}": moment[k] for k, axis in enumerate("xyz")}
        return {"force": total, **resultants, "contact_area": total / pressure} | self.shape_observables(y)


class EnergyFlat(ObstacleContact):
    """A plane parallel to the membrane: what `FlatContact(shell, distance, model="energy")` is solved as.

    contact_half_width, contact_half_length: how far the pressed part reaches from the middle along x and y, m.
    """

    OBSERVABLES: ClassVar = (
        {"force": "force", "contact_area": "area", "contact_half_width": "length"}
        | {"contact_half_length": "length"}
        | EnergyFree.OBSERVABLES
    )

    def observe(self, unknowns, pressure):
        observed = super().observe(unknowns, pressure)
        width, length = self._half_axes(self._rows(unknowns), pressure)
        return {
            name: (observed | {"contact_half_width": width, "contact_half_length": length})[name]
            for name in self.OBSERVABLES
        }

    def _half_axes(self, rows, pressure):
        """Along each axis: integral of contact pressure over pressure, which is one where the membrane lies flat."""
        nodes, weights = np.polynomial.legendre.leggauss(LINE_POINTS)
        shell, halves = self.shell, []
        aspect = shell.a / shell.b
        for axis in (0, 1):
            points = np.zeros((LINE_POINTS, 2))
            points[:, axis] = (nodes + 1) / 2
            values = at_points(self.grid, points)
            pressed = self.pressed_at(points, rows, pressure)
            at = jax.vmap(local, in_axes=(0, 0, None))(self.functional.deformed(rows[-1], values), points, aspect)
            true = pressed / jnp.sqrt(jax.vmap(lambda at: at.determinant)(at)) / (pressure / self.unit())
            stretch = jnp.linalg.norm(at.along_y if axis else at.along_x, axis=1)
            side = shell.b if axis else shell.a
            halves.append(side * jnp.dot(weights / 2, true * stretch))
        return halves


LINE_POINTS = 40
"""Gauss points along an axis: the edge of the contact is found to a hundredth of a half side."""
