"""What the thesis prints, each number with its source, and the scenes that the numbers belong to.

Source: "Analytical Modeling of Pneumatic Soft Grippers Based on Finite-Strain Membrane and Beam Theories" (see
CITATION.cff). Only what its text and tables give is here: its figures are pictures. Finger scenes have the printed
section law (`section="thesis"`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .. import pneunet as fingers
from ..materials.laws import NeoHookean
from ..objects.grasped import Cylinder
from ..pneunet.finger import TABLE_5_1, PneuNet
from ..pneunet.grasp import Grasp as FingerGrasp
from ..pneunet.grasp import Gripper
from ..shell.arc.cylinder import CylinderContact
from ..shell.arc.flat import FlatContact
from ..shell.arc.free import Free
from ..shell.arc.grasp import Grasp
from ..shell.arc.inclined import InclinedContact
from ..shell.flat_shell import FlatShell
from ..units import DISPLAY, gram, kPa, mm


class Printed(NamedTuple):
    """A number as it is printed."""

    text: str
    """Its digits."""
    kind: str
    """Kind of quantity, a key of units.DISPLAY: the number is in that unit."""

    @property
    def value(self) -> float:
        """In SI."""
        return float(self.text) * self.unit

    @property
    def unit(self) -> float:
        return DISPLAY[self.kind][1]

    @property
    def digit(self) -> float:
        """One unit of the last printed digit, in SI. The thesis cuts some numbers where others would be rounded."""
        return 10.0 ** -len(self.text.partition(".")[2]) * self.unit

    def __str__(self) -> str:
        return f"{self.text} {DISPLAY[self.kind][0]}".strip()


# --- the flat shell (chapters 3, 5.1, 6.2) ----------------------------------------------------------------------------

SHELL_MU = Printed("175", "pressure")
"""Section 6.2: tuned to the measured free inflation."""
FIGURE_PRESSURE = 15 * kPa
"""Of figures 5.1 to 5.3."""
FIGURE_5_1 = Printed("13.38", "length")
FIGURE_5_2 = Printed("18.33", "force")
FIGURE_5_3 = Printed("5.74", "force")

ROD = 20 * mm
"""Radius of the shell's cylinder."""
GAP = 5 * mm
"""Distance of plane and cylinder in the figures of chapter 5."""
GAPS = (3 * mm, 5 * mm, 8 * mm, 10 * mm)
"""Offsets d - r of figure 6.7."""


class GraspRow(NamedTuple):
    """A row of table 6.1: a cylinder 40 mm across at a gap (m), of a mass (kg)."""

    gap: float
    mass: float
    height: Printed
    pressure: Printed


TABLE_6_1 = tuple(
    GraspRow(gap * mm, mass * gram, Printed(height, "length"), Printed(pressure, "pressure"))
    for gap, mass, height, pressure in (
        (5, 137, "28.1", "5.5"),
        (5, 263, "30.3", "7.2"),
        (5, 563, "33.7", "10.9"),
        (10, 137, "26.4", "13.0"),
        (10, 263, "27.9", "14.5"),
        (10, 563, "32.1", "17.5"),
    )
)
"""Figure 5.4 prints its first row again."""


class TiltRow(NamedTuple):
    """A row of table 6.2: the mass (kg) is `eccentricity` (m) from the middle of the contact; 5 mm gap."""

    mass: float
    eccentricity: float
    traction: Printed
    pressure: Printed


TABLE_6_2 = tuple(
    TiltRow(mass * gram, eccentricity * mm, Printed(traction, "force"), Printed(pressure, "pressure"))
    for mass, eccentricity, traction, pressure in (
        (263, 0, "0.68", "5.34"),
        (263, 5, "2.18", "8.58"),
        (263, 10, "3.38", "10.55"),
        (263, 15, "4.46", "12.08"),
        (563, 0, "1.83", "7.9"),
        (563, 5, "4.12", "11.62"),
        (563, 10, "6.95", "15.09"),
        (563, 15, "10.32", "18.38"),
    )
)


def shell(mu: Any = SHELL_MU.value) -> FlatShell:
    """The shell of section 5.1: 32 x 86 x 1.1 mm."""
    return FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=NeoHookean(mu=mu))


def free_shell(mu: Any = SHELL_MU.value) -> Free:
    """Figure 5.1."""
    return Free(shell(mu))


def flat_contact(mu: Any = SHELL_MU.value, gap: Any = GAP) -> FlatContact:
    """Figures 5.2 and 6.6."""
    return FlatContact(shell(mu), distance=gap)


def cylinder_contact(mu: Any = SHELL_MU.value, gap: Any = GAP) -> CylinderContact:
    """Figures 5.3, 6.7, 6.8 and 6.9."""
    return CylinderContact(shell(mu), radius=ROD, gap=gap)


def shell_grasp(gap: Any = GAP, mass: Any = 0.0, friction: Any = 1.0) -> Grasp:
    """Table 6.1; its friction coefficient is another one for each object and not printed."""
    return Grasp(shell(), radius=ROD, gap=gap, mass=mass, friction=friction)


def square_membrane(angle: Any = 0.0) -> InclinedContact:
    """Appendix B: side 15 mm, 1.1 mm thick, mu 111 kPa, a plane at 5 mm, inclined by 0 or 10 degrees."""
    square = FlatShell(a=7.5 * mm, b=7.5 * mm, t_m=1.1 * mm, material=NeoHookean(mu=111 * kPa))
    return InclinedContact(square, distance=5 * mm, angle=angle)


# --- the finger (chapters 4, 5.2, 6.3) --------------------------------------------------------------------------------

KINDS = tuple(TABLE_5_1)
"""Types of table 5.1: A, B, C, D."""
YOUNG = {"A": Printed("409", "pressure"), "B": Printed("595", "pressure")}
"""E of Dragon Skin 20 and 30, table 5.1."""
SHEAR = {"A": Printed("136", "pressure"), "B": Printed("198", "pressure")}
HORIZONTAL, HANGING = (0.0, -2.0), (2.0, 0.0)
"""Weight in N/m of a finger in free space (5.2.1) and in a gripper (5.2.3)."""
FINGER_PRESSURE = 31 * kPa
"""Of figures 5.5 and 5.6."""
FIGURE_5_6 = Printed("0.12", "force")
FIGURE_5_7 = Printed("28", "pressure")
TIP_OFFSETS = (0.0, 10 * mm, 20 * mm, -10 * mm, -20 * mm)
"""y_c of figures 6.19 and 6.21."""
LENGTHS = {9: 66 * mm, 11: 78 * mm, 13: 90 * mm}
"""Chambers -> length of the fingers of figures 6.14 to 6.16 and 6.22 (types C and D)."""
FREE_UP_TO = {"B": Printed("61", "pressure"), "D": Printed("71", "pressure")}
"""As far as the thesis's solver went in free space (section 6.3.1)."""
BLOCKED_UP_TO = {kind: Printed(p, "pressure") for kind, p in zip(KINDS, ("41", "71", "51", "61"), strict=True)}
"""As far as it went with the tip held (section 6.3.2)."""
FRICTION = 0.96
"""Between the finger and printed objects (section 6.3.3)."""
CYLINDER_OFFSET = -1.61 * mm
"""y_c at the cylinder of radius 18 mm (figure 5.7): the clamps are on a circle of 18 + 1.61 mm."""
BASE_RADIUS = 18 * mm - CYLINDER_OFFSET
NO_SOLUTION = "—"
NOT_ASKED = (
    "chambers_apart",
    "clear_of_clamp",
    "clear_of_object_at_rest",
    "clear_of_object",
    "fingers_apart_at_rest",
    "fingers_apart",
)
"""Rules that the thesis does not ask for: its held fingers go up to pressures at which they bend back so far that the
boxes of neighbouring chambers meet at their tops, and it does not say where on their faces the cones are touched."""

TABLE_6_3 = {
    name: dict(zip(KINDS, (None if p == NO_SOLUTION else Printed(p, "pressure") for p in row), strict=True))
    for name, row in {
        "hexagonal cylinder": (NO_SOLUTION, "42", "37", "43"),
        "circular cylinder": ("28", "32", "28", "32"),
        "3-face cone": ("28", "33", "29", "33"),
        "circular cone": ("25", "29", "25", "29"),
    }.items()
}
"""Pressures that three fingers need; None where the thesis's solver found nothing."""
MASSES = {"hexagonal cylinder": 35 * gram, "circular cylinder": 26 * gram, "3-face cone": 19 * gram} | {
    "circular cone": 20 * gram
}
CONES = {"3-face cone": (50 * mm / (2 * np.sqrt(3)), 80 * mm), "circular cone": (30 * mm, 80 * mm)}
"""(distance of the touched face from the axis at the base, height), m. Where the tips touch is not printed."""


def finger(kind: str, length: Any = 77 * mm) -> PneuNet:
    """Table 5.1."""
    return PneuNet.table_5_1(kind, L=length)


def free_finger(kind: str = "A", length: Any = 77 * mm, section: str = "thesis") -> fingers.Free:
    """Figures 5.5 and 6.13 to 6.16."""
    return fingers.Free(finger=finger(kind, length), weight=jnp.array(HORIZONTAL), section=section)


def blocked_finger(kind: str = "A", offset: Any = 0.0, length: Any = 77 * mm) -> fingers.TipContact:
    """Figures 5.6, 6.19, 6.21 and 6.22: no weight, since none is given and none meets figure 5.6."""
    return fingers.TipContact(
        finger=finger(kind, length),
        tip_offset=offset,
        weight=jnp.zeros(2),
        section="thesis",
        ignored_rules=NOT_ASKED,
    )


def finger_grasp(kind: str, mass: Any, radius: Any, slope_factor: Any = 1.0) -> FingerGrasp:
    """Three fingers around something that their tips touch at a radius (m), whose face needs `slope_factor` times the
    friction of an upright one: 1 / sin^2(base angle) for cones (section 5.2.3). The mid-lines of the thesis's fingers
    touch."""
    held = Cylinder(radius=radius, mass=mass, friction=FRICTION / slope_factor)
    gripper = Gripper(finger(kind), base_radius=BASE_RADIUS, touch="midline")
    return FingerGrasp(
        gripper=gripper, object=held, weight=jnp.array(HANGING), section="thesis", ignored_rules=NOT_ASKED
    )


def apothem(side: float = 15 * mm) -> float:
    """Of the hexagonal cylinder: where tips touch it, m."""
    return side * np.sqrt(3) / 2
