"""Rigid objects by their signed distance, in the frame of the shell.

x runs across the width, y along the length, z out of the outer face of the flat membrane, whose middle is the origin.
An object is `distance(place)`: positive outside, zero on the surface, its gradient a unit vector there.
"""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..fields import Checked, finite, positive
from ..names import listing
from ..numerics.choice import larger, smaller

Scalar = Float[Array, ""]
Place = Float[Array, "3"]


class Obstacle(Checked):
    """A rigid object. A new one needs `distance`, which may be any function that JAX can differentiate twice."""

    @abc.abstractmethod
    def distance(self, place: Place) -> Scalar:
        """Signed distance of a point from the surface, m; negative inside."""


def length(vector: Float[Array, " n"]) -> Scalar:
    """The norm, with derivative zero at zero."""
    square = vector @ vector
    apart = square > 0
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1.0)), 0.0)


def direction(tilt_x: Scalar, tilt_y: Scalar) -> Place:
    """z, turned by tilt_x about x and then by tilt_y about y, rad."""
    return jnp.stack([jnp.sin(tilt_y) * jnp.cos(tilt_x), -jnp.sin(tilt_x), jnp.cos(tilt_y) * jnp.cos(tilt_x)])


class Plane(Obstacle):
    """A half space in any attitude.

    height: where the plane crosses the z axis, m. tilt_x, tilt_y: rad; its normal, which points away from the membrane,
    is z turned by tilt_x about x and then by tilt_y about y.
    """

    height: Scalar = positive("length")
    tilt_x: Scalar = finite("angle", default=0.0)
    tilt_y: Scalar = finite("angle", default=0.0)

    def distance(self, place):
        return direction(self.tilt_x, self.tilt_y) @ (jnp.zeros_like(place).at[2].set(self.height) - place)


class Cylinder(Obstacle):
    """An endless circular cylinder in any position and posture.

    radius, gap: m; the point of its surface next to the membrane is at z = gap above (offset_x, offset_y).
    heading: rad, of its axis from x (across the membrane, the thesis's posture) towards y (pi/2: along it).
    incline: rad, by which the axis then rises towards its heading, about the axis's point above (offset_x, offset_y).
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")
    offset_x: Scalar = finite("length", default=0.0)
    offset_y: Scalar = finite("length", default=0.0)
    heading: Scalar = finite("angle", default=0.0)
    incline: Scalar = finite("angle", default=0.0)

    def distance(self, place):
        across = jnp.cos(self.incline)
        axis = jnp.stack([across * jnp.cos(self.heading), across * jnp.sin(self.heading), jnp.sin(self.incline)])
        arm = place - jnp.stack([self.offset_x, self.offset_y, self.gap + self.radius])
        return length(arm - (arm @ axis) * axis) - self.radius


class Sphere(Obstacle):
    """A ball. radius, gap, offset_x, offset_y: m; its nearest point is at z = gap above (offset_x, offset_y)."""

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")
    offset_x: Scalar = finite("length", default=0.0)
    offset_y: Scalar = finite("length", default=0.0)

    def distance(self, place):
        return length(place - jnp.stack([self.offset_x, self.offset_y, self.gap + self.radius])) - self.radius


class Box(Obstacle):
    """A box with rounded edges, flat above the membrane.

    half_x, half_y, half_z: half sides over the rounding, m. rounding: radius of the edges, m, at most the least half
    side. gap: z of its lower face, m. offset_x, offset_y: of its middle, m. heading: rad, turn about z.
    """

    half_x: Scalar = positive("length")
    half_y: Scalar = positive("length")
    half_z: Scalar = positive("length")
    rounding: Scalar = positive("length")
    gap: Scalar = positive("length")
    offset_x: Scalar = finite("length", default=0.0)
    offset_y: Scalar = finite("length", default=0.0)
    heading: Scalar = finite("angle", default=0.0)

    def distance(self, place):
        arm = place - jnp.stack([self.offset_x, self.offset_y, self.gap + self.half_z])
        c, s = jnp.cos(self.heading), jnp.sin(self.heading)
        turned = jnp.stack([c * arm[0] + s * arm[1], c * arm[1] - s * arm[0], arm[2]])
        beyond = jnp.abs(turned) - jnp.stack([self.half_x, self.half_y, self.half_z]) + self.rounding
        least = smaller(larger(larger(beyond[0], beyond[1]), beyond[2]), 0.0)
        return length(larger(beyond, 0.0)) + least - self.rounding


class Shape(Obstacle):
    """Any object, from a function of the user.

    function: (place, parameters) -> signed distance, m. parameters: any pytree of arrays, derivatives included.
    """

    function: Any = eqx.field(static=True)
    parameters: Any = None

    def distance(self, place):
        return self.function(place, self.parameters)


__dir__ = listing(globals())
