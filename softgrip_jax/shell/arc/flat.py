"""The shell pressed against a plane: parallel (thesis 3.3) and inclined (thesis 4.3.3 and appendix B)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ...curve_scene import Approach
from ...fields import positive
from ...membrane import flat_contact_stretch, length_stretch
from ...scene import Scene
from ..energy.contacts import EnergyFlat
from ..flat_shell import Scalar, ShellScene
from ..obstacles import Plane
from .free import Free, two_sections


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
