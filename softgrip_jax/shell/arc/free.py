"""Free inflation of the shell: the finite-strain arc model, and the plate law of small deflections."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from ...membrane import angle_over_sine, arc_chain, length_stretch, plate_coefficient
from ...scene import Scene
from ..energy.scene import EnergyFree
from ..flat_shell import FlatShell, Scalar, ShellScene

FREE_END = jnp.pi * (1 - 1e-9)
"""A free arc closes to a full circle (infinite radius and stretch) at pi: the interval ends just before."""


LARGEST_INFLATION = 10.0
"""A branch is drawn up to this inflation, in half widths. A membrane that does not stiffen would go on for ever at
almost no pressure, and one that stiffens late would go on at almost the same pressure."""


class FreeArcs(NamedTuple):
    """The free membrane: arcs across its width, and along its length with spherical ends."""

    shell: FlatShell

    def angles(self) -> tuple[Scalar, Scalar]:
        """theta_m from flat to almost a full circle."""
        zero = jnp.zeros_like(self.shell.a)
        return zero, zero + FREE_END

    def stretches(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """lambda_1 (3.5) and lambda_2 (3.1)."""
        l1 = angle_over_sine(angle)
        return l1, length_stretch(l1, self.shell.a, self.shell.b)

    def curvatures(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """kappa_1 (3.4) and kappa_2 (3.3), 1/m."""
        a, b = self.shell.a, self.shell.b
        return jnp.sin(angle) / a, angle / (a * angle_over_sine(angle) + b - a)

    def profile(self, angle: Scalar, n: int) -> dict[str, Array]:
        """x, z across the width at the middle, y, z_length along the length (the ends are spherical), m."""
        a, b = self.shell.a, self.shell.b
        arc = a * angle_over_sine(angle)
        curvature = -jnp.sin(angle) / a
        return two_sections(
            (-a, jnp.stack([2 * arc]), jnp.stack([curvature])),
            (-b, jnp.stack([arc, 2 * (b - a), arc]), jnp.stack([curvature, jnp.zeros_like(a), curvature])),
            angle,
            n,
        )


class Free(ShellScene):
    """The membrane inflates into free space.

    The unknown is the clamp angle theta_m: kappa_1 = sin(theta_m) / a (3.4), kappa_2 = theta_m / (R theta_m + b - a)
    (3.3), lambda_1 = theta_m / sin(theta_m) (3.5), lambda_2 from (3.1), p = T_1 kappa_1 + T_2 kappa_2 (3.7), and the
    inflation is delta = a tan(theta_m / 2) (3.6).

    Args:
        shell: the actuator.
        model: "arc" for these equations, "energy" for the energy membrane, which is nearer to finite elements.

    Observables:
        - inflation: height delta of the middle, m.
        - stretch, length_stretch: lambda_1 and lambda_2, dimensionless.
        - clamp_angle: theta_m, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 3.2. It ends at a limit point for materials that do not stiffen. Against finite elements the
    inflation is 13 to 15 % low; see docs/limits.md.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{sg.solve(sg.shell.Free(shell), 15 * kPa).inflation / mm:.4f} mm")
        13.4067 mm
    """

    OBSERVABLES: ClassVar = {
        "inflation": "length",
        "stretch": "number",
        "length_stretch": "number",
        "clamp_angle": "angle",
    }
    CONTACT: ClassVar = False
    ENDLESS: ClassVar = True

    def energy_scene(self) -> Scene:
        return EnergyFree(self.shell, bending=self.bending)

    def arcs(self):
        return FreeArcs(self.shell)

    def largest_angle(self):
        return angle_of_largest_inflation(self.shell)

    def observe(self, angle, pressure):
        return inflated(self, angle)

    def profile(self, angle, pressure, n):
        return self.arcs().profile(angle, n)


class FreeSquare(ShellScene):
    """The square membrane of thesis 4.2 in free space: stretched equally both ways, p = 2 T / R, (4.7), (4.15), (4.16).

    What `InclinedContact` is before it touches.
    """

    OBSERVABLES: ClassVar = Free.OBSERVABLES
    CONTACT: ClassVar = False
    ENDLESS: ClassVar = True

    def arcs(self):
        return FreeArcs(self.shell)

    def largest_angle(self):
        return angle_of_largest_inflation(self.shell)

    def stretches(self, angle):
        stretch = angle_over_sine(angle)
        return stretch, stretch

    def curvatures(self, angle):
        curvature = jnp.sin(angle) / self.shell.a
        return curvature, curvature

    def observe(self, angle, pressure):
        return inflated(self, angle)

    def profile(self, angle, pressure, n):
        return self.arcs().profile(angle, n)


def angle_of_largest_inflation(shell: FlatShell) -> Scalar:
    """Where a drawn branch ends."""
    return 2 * jnp.arctan(LARGEST_INFLATION + jnp.zeros_like(shell.a))


def inflated(scene: ShellScene, angle: Scalar) -> dict[str, Scalar]:
    """What is observed of a membrane in free space."""
    l1, l2 = scene.stretches(angle)
    return {
        "inflation": scene.shell.a * jnp.tan(0.5 * angle),
        "stretch": l1,
        "length_stretch": l2,
        "clamp_angle": angle,
    }


def two_sections(width, length, heading, n):
    """Profiles across the width and along the length, each (start, arc lengths, curvatures), clamped at z = 0."""
    x, z = arc_chain(width[1], width[2], heading, n)
    y, z_length = arc_chain(length[1], length[2], heading, n)
    return {"x": x + width[0], "z": z, "y": y + length[0], "z_length": z_length}


class Plate(ShellScene):
    """The membrane in free space by the law of small deflections.

    p = C E t_m delta^3 / a^4 (2.1) with E = 3 mu (incompressible, Poisson's ratio 1/2) and C(a/b) from
    `plate_coefficient`. It is the simplest model of `Free`, holds for delta much smaller than a, and has no limit
    point.

    Args:
        shell: the actuator.
        model: "arc"; there is no other one here.

    Observables:
        - inflation: height delta of the middle, m.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 2.1.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> low, high = (sg.solve(sg.shell.Plate(shell), p * kPa).inflation for p in (1, 8))
        >>> print(f"{high / low:.3f}")  # eight times the pressure, twice the inflation
        2.000
    """

    OBSERVABLES: ClassVar = {"inflation": "length"}
    CONTACT: ClassVar = False
    ENDLESS: ClassVar = True

    def arcs(self):
        return FreeArcs(self.shell)

    def largest_angle(self):
        return angle_of_largest_inflation(self.shell)

    def load(self, angle):
        shell = self.shell
        stiffness = 3 * shell.material.shear_modulus() * plate_coefficient(shell.a / shell.b)
        return stiffness * shell.t_m * jnp.tan(0.5 * angle) ** 3 / shell.a

    def interval(self):
        return self.geometry()

    def unbounded(self):
        return jnp.asarray(True)

    def observe(self, angle, pressure):
        return {"inflation": self.shell.a * jnp.tan(0.5 * angle)}

    def profile(self, angle, pressure, n):
        return self.arcs().profile(angle, n)
