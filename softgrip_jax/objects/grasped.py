"""What is grasped: cylinders, prisms and cones that stand on their base."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Any, ClassVar

import jax.numpy as jnp
import numpy as np

from ..fields import Checked, nonnegative, positive
from .friction import Scalar, friction


class Object(Checked):
    """Something that fingertips hold between them, standing on its base.

    A subclass gives the radius over the height in `radius_at`, and has the fields mass (kg) and friction
    (dimensionless).

    Examples:
        >>> isinstance(sg.objects.Cone(radius=20 * mm, height=40 * mm, mass=20 * gram, friction=0.9), sg.objects.Object)
        True
    """

    if TYPE_CHECKING:
        mass: Scalar
        friction: Any

    FACES: ClassVar[int] = 0
    """Equal flat faces around the axis; 0 for what is round."""

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
    """A circular cylinder, upright.

    Args:
        radius: of the cylinder, m.
        mass: of the object, kg, zero or more.
        friction: mu_f, dimensionless, a number, a `Friction` or a function of the normal force (N).

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 5.2.3.

    Examples:
        >>> rod = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
        >>> print(f"{rod.radius_at(10 * mm) / mm:.1f} mm")
        18.0 mm
    """

    radius: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def radius_at(self, height):
        return self.radius + 0 * height


class HexagonalCylinder(Object):
    """A hexagonal cylinder, upright, held on two, three or six of its faces.

    Args:
        side: of the hexagon, m; the tips touch at the apothem, side sqrt(3)/2.
        mass: of the object, kg, zero or more.
        friction: mu_f, dimensionless, a number, a `Friction` or a function of the normal force (N).

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 5.2.3.

    Examples:
        >>> prism = sg.objects.HexagonalCylinder(side=15 * mm, mass=26 * gram, friction=0.96)
        >>> print(f"{prism.radius_at(10 * mm) / mm:.2f} mm")
        12.99 mm
    """

    FACES: ClassVar = 6

    side: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def radius_at(self, height):
        """The apothem, side sqrt(3)/2."""
        return self.side * (np.sqrt(3) / 2) + 0 * height


class Taper(Object):
    """A solid that narrows linearly from its base to a point.

    radius_at(z) = base_radius (1 - z / height). Inclined faces need a normal force that is larger by 1 / sin^2(beta),
    beta the angle of the face at the base.

    Source: thesis 5.2.3.

    Examples:
        >>> issubclass(sg.objects.Cone, sg.objects.Taper)
        True
    """

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
    """A right circular cone, standing on its base.

    Args:
        radius: of the base, m.
        height: of the cone, m.
        mass: of the object, kg, zero or more.
        friction: mu_f, dimensionless, a number, a `Friction` or a function of the normal force (N).

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 5.2.3.

    Examples:
        >>> cone = sg.objects.Cone(radius=20 * mm, height=40 * mm, mass=20 * gram, friction=0.9)
        >>> print(f"{cone.radius_at(10 * mm) / mm:.1f} mm, {cone.slope_factor():.2f}")  # 1 + (20/40)^2
        15.0 mm, 1.25
    """

    radius: Scalar = positive("length")
    height: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def base_radius(self):
        return self.radius


class ThreeFaceCone(Taper):
    """A pyramid on an equilateral triangle, held on its three faces.

    Args:
        side: of the base, m; the tips touch at the inradius, side / (2 sqrt(3)) at the base.
        height: of the pyramid, m.
        mass: of the object, kg, zero or more.
        friction: mu_f, dimensionless, a number, a `Friction` or a function of the normal force (N).

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 5.2.3.

    Examples:
        >>> pyramid = sg.objects.ThreeFaceCone(side=60 * mm, height=60 * mm, mass=19 * gram, friction=0.9)
        >>> print(f"{pyramid.base_radius() / mm:.2f} mm")
        17.32 mm
    """

    FACES: ClassVar = 3

    side: Scalar = positive("length")
    height: Scalar = positive("length")
    mass: Scalar = nonnegative("mass")
    friction: Scalar = friction()

    def base_radius(self):
        """The inradius of the base, side / (2 sqrt(3))."""
        return self.side / (2 * np.sqrt(3))
