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
    """A rigid object by its signed distance.

    A new object derives from it and needs `distance`, which may be any function that JAX can differentiate twice. Its
    gradient is a unit vector on the surface.

    Examples:
        >>> class Step(sg.shell.obstacles.Obstacle):
        ...     def distance(self, place):
        ...         return 5 * mm - place[2]
        >>> print(f"{Step().distance(jnp.zeros(3)) / mm:.1f} mm")
        5.0 mm
    """

    @abc.abstractmethod
    def distance(self, place: Place) -> Scalar:
        """Signed distance of a point from the surface, m; negative inside."""


def length(vector: Float[Array, " n"]) -> Scalar:
    """The norm of a vector, with derivative zero at zero.

    Args:
        vector: any vector, shape (n,), in any unit.

    Examples:
        >>> print(f"{sg.shell.obstacles.length(jnp.array([3.0, 4.0])):.1f}")
        5.0
    """
    square = vector @ vector
    apart = square > 0
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1.0)), 0.0)


def direction(tilt_x: Scalar, tilt_y: Scalar) -> Place:
    """The unit vector z, turned by tilt_x about x and then by tilt_y about y.

    Args:
        tilt_x, tilt_y: angles, rad.

    Examples:
        >>> tilted = sg.shell.obstacles.direction(jnp.asarray(0.0), jnp.asarray(np.pi / 2))  # about y: from z to x
        >>> print(f"{tilted[0]:.1f}")
        1.0
    """
    return jnp.stack([jnp.sin(tilt_y) * jnp.cos(tilt_x), -jnp.sin(tilt_x), jnp.cos(tilt_y) * jnp.cos(tilt_x)])


class Plane(Obstacle):
    """A half space in any attitude.

    Args:
        height: where the plane crosses the z axis, m.
        tilt_x, tilt_y: turns of its normal from z, by tilt_x about x and then by tilt_y about y, rad; the normal points
            away from the membrane.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Examples:
        >>> print(f"{sg.shell.obstacles.Plane(height=5 * mm).distance(jnp.zeros(3)) / mm:.1f} mm")
        5.0 mm
    """

    height: Scalar = positive("length")
    tilt_x: Scalar = finite("angle", default=0.0)
    tilt_y: Scalar = finite("angle", default=0.0)

    def distance(self, place):
        return direction(self.tilt_x, self.tilt_y) @ (jnp.zeros_like(place).at[2].set(self.height) - place)


class Cylinder(Obstacle):
    """An endless circular cylinder in any position and posture.

    Args:
        radius: of the cylinder, m.
        gap: z of the point of its surface next to the membrane, above (offset_x, offset_y), m.
        offset_x, offset_y: where that point is, m.
        heading: turn of its axis from x (across the membrane, the thesis's posture) towards y (along it), rad.
        incline: angle by which the axis then rises towards its heading, about its point above the place of contact,
            rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Examples:
        >>> rod = sg.shell.obstacles.Cylinder(radius=20 * mm, gap=5 * mm)
        >>> print(f"{rod.distance(jnp.array([30 * mm, 0.0, 0.0])) / mm:.1f} mm")  # the rod runs along x
        5.0 mm
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
    """A ball above the membrane.

    Args:
        radius: of the ball, m.
        gap: z of its nearest point, above (offset_x, offset_y), m.
        offset_x, offset_y: where that point is, m.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Examples:
        >>> ball = sg.shell.obstacles.Sphere(radius=20 * mm, gap=5 * mm)
        >>> print(f"{ball.distance(jnp.zeros(3)) / mm:.1f} mm")
        5.0 mm
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")
    offset_x: Scalar = finite("length", default=0.0)
    offset_y: Scalar = finite("length", default=0.0)

    def distance(self, place):
        return length(place - jnp.stack([self.offset_x, self.offset_y, self.gap + self.radius])) - self.radius


class Box(Obstacle):
    """A box with rounded edges, whose lower face is parallel to the membrane.

    Args:
        half_x, half_y, half_z: half sides over the rounding, m.
        rounding: radius of the edges, m, at most the least half side.
        gap: z of its lower face, m.
        offset_x, offset_y: of its middle, m.
        heading: turn about z, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Examples:
        >>> box = sg.shell.obstacles.Box(8 * mm, 8 * mm, 8 * mm, rounding=1 * mm, gap=5 * mm)
        >>> print(f"{box.distance(jnp.zeros(3)) / mm:.1f} mm")
        5.0 mm
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

    Args:
        function: (place (m, shape (3,)), parameters) -> signed distance, m.
        parameters: any pytree of arrays; derivatives by them are taken, too.

    Examples:
        >>> wall = sg.shell.obstacles.Shape(lambda place, height: height - place[2], jnp.asarray(5 * mm))
        >>> print(f"{wall.distance(jnp.zeros(3)) / mm:.1f} mm")
        5.0 mm
    """

    function: Any = eqx.field(static=True)
    parameters: Any = None

    def distance(self, place):
        return self.function(place, self.parameters)


__dir__ = listing(globals())
