"""The energy membrane against any rigid object."""

from __future__ import annotations

from typing import ClassVar

from ...fields import part
from ..obstacles import Obstacle
from .resting import CONTACT, contact_observables
from .scene import EnergyFree, EnergyScene


class ObstacleContact(EnergyScene):
    """The energy membrane pressed against any rigid object, without friction.

    The state minimises the integral of t_m W(C) dA minus p times the enclosed volume over a global polynomial basis of
    the displacements; the object is its signed distance, and presses by a thin stiff layer where that is negative.

    Args:
        shell: the actuator.
        obstacle: the object, by its signed distance in the frame of `sg.shell.obstacles`.
        symmetry: mirror symmetry of the object, "across" (x -> -x), "along" (y -> -y), "both" or "none"; each halves
            the unknowns. "auto" looks for it where the object's numbers are known, and takes "none" where they are
            traced, so that derivatives by what breaks a symmetry are right. A symmetry that is named is checked.
        bending: whether the membrane resists bending and is clamped without a slope. Without, a state takes a quarter
            less time, and forces are too large by t_m / a or so.
        across, lengthwise: polynomials of the height, of each parity; there are nine contact points for each.

    Observables:
        - force: sum of the contact pressures over the contact, N.
        - force_x, force_y, force_z: their resultant on the object, N.
        - moment_x, moment_y, moment_z: its moment about the middle of the flat membrane's outer face, N m.
        - friction_moment: contact pressure times distance from the middle of the contact, integrated, N m; times the
            coefficient of friction it resists turning about z, which the thesis (3.40) takes from a uniform pressure.
        - contact_area: force over pressure, what an even pressure would need, m^2.
        - inflation: height of the middle, m.
        - stretch, length_stretch, largest_stretch: in the middle across and along, and anywhere, dimensionless.
        - clamp_angle: slope at the middle of the long edge, rad.
        - wrinkled_share: part of the area in compression, dimensionless.

    Raises:
        InputError: where a field breaks its rule, or the object breaks the named symmetry (IMPOSSIBLE under jit).

    Source: own; docs/theory/energy.md. Free inflation and forces on a plane are within 5 % of finite elements.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> ball = sg.shell.obstacles.Sphere(radius=20 * mm, gap=5 * mm)
        >>> touched = sg.shell.ObstacleContact(shell, ball, across=2, lengthwise=2)  # few polynomials: quick and rough
        >>> print(f"{sg.solve(touched, 12 * kPa).force:.2f} N")
        6.78 N
    """

    obstacle: Obstacle = part(Obstacle)

    OBSERVABLES: ClassVar = CONTACT | EnergyFree.OBSERVABLES

    def measured(self, y, contact_pressures, pressure):
        return contact_observables(self, y, contact_pressures, pressure)
