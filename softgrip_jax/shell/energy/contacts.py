"""The energy membrane on the thesis's objects: what their arc scenes are solved as with `model="energy"`.

Half axes of a contact are those of the ellipse on which an even pressure has the same second moments: sums over the
contact points, smooth where single points take turns in pressing.
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..flat_shell import Scalar
from ..obstacles import Cylinder, Plane
from .basis import Vector, at_points
from .maps import contact_average
from .resting import CONTACT, contact_observables, half_axis, resting_on
from .scene import EnergyFree, EnergyScene
from .sheet import local

LINE_POINTS = 40
"""Gauss points along an axis: the edge of the contact is found to a hundredth of a half side."""


class EnergyFlat(EnergyScene):
    """A plane parallel to the membrane: what `FlatContact(shell, distance, model="energy")` is solved as.

    contact_half_width, contact_half_length: how far the pressed part reaches from the middle along x and y, m.
    """

    OBSERVABLES: ClassVar = (
        {"force": "force", "contact_area": "area", "contact_half_width": "length"}
        | {"contact_half_length": "length"}
        | EnergyFree.OBSERVABLES
    )

    def measured(self, y, contact_pressures, pressure):
        return contact_observables(self, y, contact_pressures, pressure)

    def observe(self, unknowns, pressure):
        observed = super().observe(unknowns, pressure)
        width, length = self._half_axes(unknowns, self.contact_pressures(unknowns, pressure), pressure)
        return {
            name: (observed | {"contact_half_width": width, "contact_half_length": length})[name]
            for name in self.OBSERVABLES
        }

    def _half_axes(self, y, contact_pressures, pressure):
        """Along each axis: integral of contact pressure over pressure, which is one where the membrane lies flat."""
        nodes, weights = np.polynomial.legendre.leggauss(LINE_POINTS)
        shell, halves = self.shell, []
        aspect = shell.a / shell.b
        for axis in (0, 1):
            points = np.zeros((LINE_POINTS, 2))
            points[:, axis] = (nodes + 1) / 2
            values = at_points(self.grid, points)
            at = jax.vmap(local, in_axes=(0, 0, None))(self.functional.deformed(y, values), points, aspect)
            pressing = contact_average(self.grid, points) @ contact_pressures
            true = pressing / jnp.sqrt(jax.vmap(lambda at: at.determinant)(at)) / (pressure / self.unit())
            stretch = jnp.linalg.norm(at.along_y if axis else at.along_x, axis=1)
            side = shell.b if axis else shell.a
            halves.append(side * jnp.dot(weights / 2, true * stretch))
        return halves


class EnergyInclined(EnergyScene):
    """A plane inclined across the width: what `InclinedContact(..., model="energy")` is solved as.

    contact_width, contact_length: both half axes of the contact, along the incline and along the membrane, m.
    """

    OBSERVABLES: ClassVar = CONTACT | EnergyFree.OBSERVABLES | {"contact_width": "length", "contact_length": "length"}

    def measured(self, y, contact_pressures, pressure):
        assert isinstance(self.obstacle, Plane)
        resting = resting_on(self, y, contact_pressures)
        width = half_axis(resting, resting.places[:, 0] / jnp.cos(self.obstacle.tilt_y), False)
        sides = {"contact_width": 2 * width, "contact_length": 2 * half_axis(resting, resting.places[:, 1], True)}
        return contact_observables(self, y, contact_pressures, pressure) | sides


class EnergyCylinder(EnergyScene):
    """A cylinder whose axis lies across the length: what `CylinderContact(..., model="energy")` is solved as.

    contact_half_length is measured along the cylinder, contact_angle is that over its radius, and contact_area that of
    the ellipse. The contact presses more than the air does (by the tension around the cylinder over its radius): the
    force is larger than pressure times area.
    """

    OBSERVABLES: ClassVar = (
        CONTACT
        | EnergyFree.OBSERVABLES
        | {
            "contact_angle": "angle",
            "contact_half_width": "length",
            "contact_half_length": "length",
        }
    )

    def measured(self, y, contact_pressures, pressure):
        return cylinder_observables(self, y, contact_pressures, pressure)


def cylinder_observables(
    scene: EnergyScene, y: Vector, contact_pressures: Float[Array, " k"], pressure: Scalar
) -> dict[str, Array]:
    """What is observed of a contact with a cylinder."""
    rod = scene.obstacle
    assert isinstance(rod, Cylinder)
    resting = resting_on(scene, y, contact_pressures)
    x, y_, z = resting.places.T
    turned = jnp.arctan2(y_ - rod.offset_y, rod.gap + rod.radius - z)
    angle = half_axis(resting, turned, scene.symmetry == "both")
    width, length = half_axis(resting, x, True), rod.radius * angle
    sides = {"contact_angle": angle, "contact_half_width": width, "contact_half_length": length}
    return (
        contact_observables(scene, y, contact_pressures, pressure) | sides | {"contact_area": jnp.pi * width * length}
    )
