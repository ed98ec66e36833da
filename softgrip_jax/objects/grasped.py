"""What is grasped: cylinders, prisms and cones that stand on their base."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from ..fields import Checked, nonnegative, positive
from .friction import Scalar, friction


class Object(Checked):
    """Something that fingertips hold between them, standing on its base: a radius over height, mass and friction."""

    if TYPE_CHECKING:
        mass: Scalar
        friction: Any

    @abc.abstractmethod
    def radius_at(self, height: Scalar) -> Scalar:
        """Distance (m) of the surface that a tip touches from the axis, at a height (m) above the base."""

    def slope_factor(self) -> Scalar:
        """How much more normal force inclined faces need: 1 for upright ones, 1/sin^2 of the base angle for cones."""
        return jnp.ones_like(self.mass)

    @property
    def tapers(self) -> bool:
        """Whether the radius depends on the height."""
        return False


class Cylinder(Object):
    """A circular cylinder. radius: m; mass: kg; friction: mu_f."""

    radius: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def radius_at(self, height):
        return self.radius + 0 * height


class HexagonalCylinder(Object):
    """A hexagonal cylinder held on three faces. side: of the hexagon, m; mass: kg; friction: mu_f."""

    side: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def radius_at(self, height):
        """The apothem, side sqrt(3)/2."""
        return self.side * (np.sqrt(3) / 2) + 0 * height


class Taper(Object):
    """A solid that narrows linearly to a point: `base_radius` at the base, nothing at `height`."""

    if TYPE_CHECKING:
        height: Scalar

    @abc.abstractmethod
    def base_radius(self) -> Scalar:
        """Distance of the touched face from the axis at the base, m."""

    def radius_at(self, height):
        return self.base_radius() * (1 - height / self.height)

    def slope_factor(self):
        """1 / sin^2(beta), beta the base angle of the face (thesis 5.2.3)."""
        return 1 + (self.base_radius() / self.height) ** 2

    @property
    def tapers(self):
        return True


class Cone(Taper):
    """A right circular cone. radius: of the base, m; height: m; mass: kg; friction: mu_f."""

    radius: Scalar = positive("length")
    height: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def base_radius(self):
        return self.radius


class ThreeFaceCone(Taper):
    """A pyramid on an equilateral triangle, held on its faces. side: of the base, m; height: m; mass: kg; friction."""

    side: Scalar = positive("length")
    height: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def base_radius(self):
        """The inradius of the base, side / (2 sqrt(3))."""
        return self.side / (2 * np.sqrt(3))
