"""What is grasped: cylinders, prisms and cones that stand on their base."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..fields import Checked, nonnegative, positive
from ..own import is_known, is_own, require_numbers
from .friction import Friction, OnSlope, Scalar, friction


class Object(Checked):
    """Something that fingertips hold between them, standing on its base.

    A subclass gives the radius over the height in `radius_at`, and has the fields mass (kg) and friction
    (dimensionless). Where the radius depends on the height it also says that it `tapers`; `slope` follows from the
    radius where that falls evenly.

    Raises:
        InputError: where a class of one's own lacks a field, or its radius contradicts what it says of its faces
            (outside of jit).

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

    def slope(self) -> tuple[Scalar, Scalar]:
        """(sine, cosine) of the angle between the touched face and the ground: (1, 0) where it is upright. By default
        from how the radius falls at the base."""
        falls = -jax.grad(lambda height: jnp.asarray(self.radius_at(height), float))(jnp.zeros_like(self.mass))
        side = jnp.hypot(1.0, falls)
        return 1 / side, falls / side

    def lift(self) -> Any:
        """What a tip lifts over the force with which it presses inwards: mu_f of upright faces, less of those that lean
        (`friction.OnSlope`); a number, or a `Friction` where mu_f is one."""
        if not self.tapers:
            return self.friction
        on_slope = OnSlope(self.friction, *self.slope())
        return on_slope if isinstance(self.friction, Friction) else on_slope(jnp.zeros_like(self.mass))

    @property
    def tapers(self) -> bool:
        """Whether the radius depends on the height."""
        return False

    def __check_init__(self) -> None:
        if is_own(self):
            _require_faces(self)


HEIGHTS = (0.0, 0.25, 0.5, 1.0)
"""Over the radius at the base: where the radius of an object of one's own is asked for its slope."""
EVEN = 1e-6
"""Metres per metre of height that count as nothing."""


def _require_faces(held: Object) -> None:
    """An InputError where an object of the user's own has no mass or friction, no radius, or leans otherwise than it
    says: its friction would be that of another one."""
    name = type(held).__name__
    for field, words in (("mass", "kg"), ("friction", "a pure number")):
        if not hasattr(held, field):
            raise InputError(f"{name} has no {field} ({words}); an object to be grasped needs it as a field.")
    if not is_known(held) or not require_numbers(f"{name}.radius_at", held, held.radius_at, jnp.zeros(())):
        return
    with jax.ensure_compile_time_eval():  # under jit, too
        base = float(held.radius_at(jnp.zeros(())))
        heights = jnp.asarray(HEIGHTS) * (base if 0 < base < np.inf else 1.0)
        falls = -np.asarray(jax.vmap(jax.grad(lambda height: jnp.asarray(held.radius_at(height), float)))(heights))
        falls = falls[np.isfinite(falls)]
        sine, cosine = (float(value) for value in held.slope()) if held.tapers else (1.0, 0.0)
    if len(falls) == 0:
        return
    least, most, said = falls.min(), falls.max(), cosine / sine if sine else np.inf
    steep = f"{name}.radius_at falls by " + (f"{most:.4g}" if most - least < EVEN else f"{least:.4g} to {most:.4g}")
    if not held.tapers and max(abs(least), abs(most)) > EVEN:
        raise InputError(
            f"{steep} m per metre of height, and {name}.tapers is False; give it the property tapers that is True, so "
            "that friction counts the lean of its faces."
        )
    if held.tapers and most - least > EVEN and type(held).slope is Object.slope:
        raise InputError(f"{steep} m per metre of height; give {name}.slope, the lean of the face that is touched.")
    if held.tapers and not least - EVEN <= said <= most + EVEN:
        raise InputError(
            f"{steep} m per metre of height, and {name}.slope is ({sine:.4g}, {cosine:.4g}), which falls by {said:.4g}."
        )


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

    radius_at(z) = base_radius (1 - z / height). A tip presses its faces down as well, and lifts less: see `lift`.

    Source: thesis 5.2.3; `friction.OnSlope` in place of its 1 / sin^2 of the base angle.

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

    def slope(self):
        side = jnp.hypot(self.height, self.base_radius())
        return self.height / side, self.base_radius() / side

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
        >>> print(f"{cone.radius_at(10 * mm) / mm:.1f} mm, {cone.lift():.2f}")  # (0.9 * 2 - 1) / (2 + 0.9)
        15.0 mm, 0.28
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
