"""The energy membrane on the thesis's objects: what their arc scenes are solved as with `model="energy"`.

Half axes of a contact are those of the ellipse on which an even pressure has the same second moments; on a parallel
plane half sides are those of the rectangle, which is nearer to where the membrane leaves the plane. They are sums over
the contact points, smooth where single points take turns in pressing.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..flat_shell import Scalar
from ..obstacles import Cylinder, Plane
from .basis import Vector
from .resting import CONTACT, HALF_SIDE, contact_observables, half_axis, resting_on
from .scene import EnergyFree, EnergyScene


class EnergyFlat(EnergyScene):
    """A plane parallel to the membrane: what `FlatContact(shell, distance, model="energy")` is solved as.

    contact_half_width, contact_half_length: half sides of the contact along x and y, m.
    """

    OBSERVABLES: ClassVar = (
        {"force": "force", "contact_area": "area", "contact_half_width": "length"}
        | {"contact_half_length": "length"}
        | EnergyFree.OBSERVABLES
    )

    def measured(self, y, contact_pressures, pressure):
        resting = resting_on(self, y, contact_pressures)
        width, length = (HALF_SIDE * half_axis(resting, resting.places[:, k], True) for k in (0, 1))
        sides = {"contact_half_width": width, "contact_half_length": length}
        return contact_observables(self, y, contact_pressures, pressure) | sides


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
