"""The shell on an inclined plane (thesis appendix B)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax import lax

from ...equations import Approach
from ...fields import positive, right_angle
from ...membrane import arc_chain, first_contact_angle, inclined_wall
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import bracketed_root
from ...scene import Scene, frozen
from ..energy.contacts import EnergyInclined
from ..flat_shell import Scalar, ShellScene
from ..obstacles import Plane
from .free import FreeSquare


class InclinedContact(ShellScene):
    """The square membrane in contact with an inclined plane.

    The unknown is the exterior clamp angle theta_m2, and p follows from (4.30). Contact begins where c_1 + c_2 = 0.

    Args:
        shell: the actuator; the equations are those of a square, a = b.
        distance: d, from the nearer edge of the membrane to the plane, m.
        angle: theta_s of the plane, rad, from zero to less than a right angle.
        model: "arc" for these equations, "energy" for the energy membrane, which is nearer to finite elements.

    Observables:
        - force: p A_c (B.3), N, zero before contact.
        - contact_area: A_c of the ellipse (B.1), (B.2), m^2.
        - contact_width, contact_length: its axes c_1 + c_2 and c_z, m.
        - stretch: lambda, dimensionless.
        - clamp_angle: theta_m2, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 4.3.3 and appendix B.

    Examples:
        >>> square = sg.FlatShell(a=7.5 * mm, b=7.5 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=111 * kPa))
        >>> print(f"{sg.solve(sg.shell.InclinedContact(square, distance=5 * mm, angle=0.0), 41 * kPa).force:.4f} N")
        0.7554 N
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
        return EnergyInclined(self.shell, Plane(height, tilt_y=self.angle), symmetry="along", bending=self.bending)

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
