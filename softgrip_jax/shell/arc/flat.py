"""The shell pressed against a plane: parallel (thesis 3.3) and inclined (thesis 4.3.3 and appendix B)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ...equations import Approach
from ...fields import positive
from ...membrane import flat_contact_stretch, length_stretch
from ...scene import Scene
from ..energy.contacts import EnergyFlat
from ..flat_shell import Scalar, ShellScene
from ..obstacles import Plane
from .free import Free, two_sections


class FlatContact(ShellScene):
    """The membrane in full contact with a rigid frictionless plane that is parallel to it.

    The unknown is the clamp angle theta_m: R = d / (1 - cos theta_m) (3.8), lambda_1 (3.11), kappa_2 (3.3), p (3.7).
    Contact begins at theta_m = 2 atan(d / a), where (3.11) meets (3.5).

    Args:
        shell: the actuator.
        distance: d, from the flat membrane to the plane, m.
        model: "arc" for these equations, "energy" for the energy membrane, which is nearer to finite elements.

    Observables:
        - force: p A_c (3.13), N, zero before contact.
        - contact_area: A_c of the oval (3.12), m^2.
        - contact_half_width, contact_half_length: c_a (3.9) and c_b (3.10), m.
        - stretch: lambda_1, dimensionless.
        - clamp_angle: theta_m, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 3.3. Against finite elements the force is 11 to 21 % low; see docs/limits.md.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa).force:.4f} N")
        18.3565 N
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
        return EnergyFlat(self.shell, Plane(self.distance), symmetry="both", bending=self.bending)

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
