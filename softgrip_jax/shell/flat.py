"""The shell pressed against a plane: parallel (thesis 3.3) and inclined (thesis 4.3.3 and appendix B)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax import lax

from ..curve_scene import Approach
from ..fields import positive, right_angle
from ..membrane import arc_chain, first_contact_angle, flat_contact_stretch, inclined_wall, length_stretch
from ..numerics.roots import bracketed_root, implicit
from ..scene import Scene, frozen
from .energy_contacts import EnergyFlat, EnergyInclined
from .flat_shell import Scalar, ShellScene
from .free import Free, FreeSquare, two_sections
from .obstacles import Plane


class FlatContact(ShellScene):
    """Full contact with a rigid frictionless plane, parallel to the membrane at `distance` d, m. The angle is theta_m.

    R = d / (1 - cos theta) (3.8), lambda_1 (3.11), kappa_2 (3.3), p (3.7); contact half width c_a (3.9), half length
    c_b (3.10), oval area (3.12), force p A_c (3.13). Contact begins at theta = 2 atan(d/a), where (3.11) meets (3.5).
    """

    distance: Scalar = positive("length")

    OBSERVABLES: ClassVar = {
        "force": "force",
        "contact_area": "area",
        "contact_half_width": "length",
        "contact_half_length": "length",
        "stretch": "number",
        "clamp_angle": "angle",
    }

    def energy_scene(self) -> Scene:
        return EnergyFlat(self.shell, Plane(self.distance), symmetry="both")

    def geometry(self):
        return 2 * jnp.arctan(self.distance / self.shell.a), jnp.pi + jnp.zeros_like(self.distance)

    def approach(self):
        begins = self.load(self.geometry()[0])
        return Approach(Free(self.shell), self.geometry()[0], begins)

    def _radius(self, angle):
        return self.distance / (2 * jnp.sin(0.5 * angle) ** 2)

    def stretches(self, angle):
        l1 = flat_contact_stretch(angle, self.distance / self.shell.a)
        return l1, length_stretch(l1, self.shell.a, self.shell.b)

    def curvatures(self, angle):
        radius = self._radius(angle)
        return 1 / radius, angle / (radius * angle + self.shell.b - self.shell.a)

    def observe(self, angle, pressure):
        a, b = self.shell.a, self.shell.b
        l1, l2 = self.stretches(angle)
        c_a = a - self.distance / jnp.tan(0.5 * angle)
        c_b = l2 * b - l1 * a + c_a
        area = 4 * c_a * (c_b - c_a) + jnp.pi * c_a**2
        return {
            "force": pressure * area,
            "contact_area": area,
            "contact_half_width": c_a,
            "contact_half_length": c_b,
            "stretch": l1,
            "clamp_angle": angle,
        }

    def profile(self, angle, pressure, n):
        """x, z across the width; y, z_length along the length, m: arc, flat on the plane, arc."""
        a, b = self.shell.a, self.shell.b
        radius = self._radius(angle)
        lean = radius * jnp.sin(angle)
        arc, curvature = radius * angle, jnp.stack([-1 / radius, jnp.zeros_like(radius), -1 / radius])
        return two_sections(
            (-a, jnp.stack([arc, 2 * (a - lean), arc]), curvature),
            (-b, jnp.stack([arc, 2 * (b - lean), arc]), curvature),
            angle,
            n,
        )


class InclinedContact(ShellScene):
    """Contact with a plane inclined by `angle` theta_s (rad, 0 to pi/2), at `distance` d (m) from the membrane's edge.

    Thesis 4.3.3 and appendix B, for a square membrane (a = b); the curve's angle is theta_m2, p from (4.30), the
    elliptical contact area from (B.1), (B.2), force p A_c (B.3). Contact begins where c_1 + c_2 = 0.
    """

    distance: Scalar = positive("length")
    angle: Scalar = right_angle()

    OBSERVABLES: ClassVar = {
        "force": "force",
        "contact_area": "area",
        "contact_width": "length",
        "contact_length": "length",
        "stretch": "number",
        "clamp_angle": "angle",
    }

    def _wall(self, theta):
        shell = self.shell
        return inclined_wall(theta, shell.a, shell.b, shell.t_m, shell.material, self.distance, self.angle)

    def energy_scene(self) -> Scene:
        height = (self.distance + self.shell.a * jnp.sin(self.angle)) / jnp.cos(self.angle)
        return EnergyInclined(self.shell, Plane(height, tilt_y=self.angle), symmetry="along")

    def geometry(self):
        def width(theta, scene):
            return scene._wall(theta).contact_width / scene.shell.a

        # At 1e-3 of the angle of a parallel plane the arc is nearly flat and far from touching: the width is negative.
        low = lax.stop_gradient(1e-3 * jnp.arctan(self.distance / self.shell.a))
        fixed = frozen(self)
        begin = bracketed_root(lambda theta: width(theta, fixed), low, jnp.pi + jnp.zeros_like(low)).x
        return implicit(width, begin, self), jnp.pi + jnp.zeros_like(self.distance)

    def approach(self):
        # Too far away it never presses: the model then has it inflate freely for good.
        presses = self._wall(jnp.pi + jnp.zeros_like(self.distance)).contact_width > 0
        touch = jnp.where(presses, first_contact_angle(self.distance / self.shell.a, self.angle), jnp.inf)
        return Approach(FreeSquare(self.shell), touch, self.load(self.geometry()[0]), touches_early=True)

    def stretches(self, angle):
        stretch = self._wall(angle).stretch
        return stretch, stretch

    def load(self, angle):
        return self._wall(angle).pressure

    def observe(self, angle, pressure):
        wall = self._wall(angle)
        return {
            "force": pressure * wall.contact_area,
            "contact_area": wall.contact_area,
            "contact_width": wall.contact_width,
            "contact_length": wall.c_z,
            "stretch": wall.stretch,
            "clamp_angle": angle,
        }

    def profile(self, angle, pressure, n):
        """x, z across the width, m: exterior arc, flat on the plane, interior arc; x = -a is the exterior clamp."""
        wall = self._wall(angle)
        # The thesis takes c_1 from the stretch (4.32), so its widths do not close the figure: the picture closes it.
        flat = 2 * self.shell.a * jnp.cos(self.angle) - wall.radius * (jnp.sin(angle) + jnp.sin(wall.theta_m1))
        arcs = jnp.stack([wall.radius * angle, flat, wall.radius * wall.theta_m1])
        bent = -1 / wall.radius
        x, z = arc_chain(arcs, jnp.stack([bent, jnp.zeros_like(bent), bent]), angle - self.angle, n)
        return {"x": x - self.shell.a, "z": z}
