"""Grasps of the thesis (3.4.4, 3.4.5) by the energy membrane, beside its arcs: a page of the documentation.

python -m softgrip_jax.thesis.energy_grasp > docs/energy-grasp.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..questions import solve
from ..results import Solution
from ..shell.arc.cylinder import AxialOffset, CylinderContact
from ..shell.arc.grasp import tilt_moment
from ..units import GRAVITY, gram, mm
from . import printed as thesis
from .rows import stacked


class Held(NamedTuple):
    """A row of table 6.1, at the printed pressure and height."""

    row: thesis.GraspRow
    arc: float
    """Normal force, N, in the middle and at the offset: the arcs know no difference."""
    middle: float
    """The same by energy, N."""
    offset: float
    """At the printed height, N."""
    along: float
    """Force that pushes the cylinder along the membrane, towards its end, N."""


class Tilted(NamedTuple):
    """A row of table 6.2, at the printed pressure; moments for a friction of 1."""

    row: thesis.TiltRow
    arc_area: float
    area: float
    """Contact force over pressure, m^2: the area of the ellipse, and what by energy stands in for it."""
    arc: float
    rim: float
    """Uniform traction on the ellipse, N m: with the exact lever arm, and (3.40)."""
    energy: float
    """Contact pressure times distance from the middle, integrated, N m."""


def compute(
    grasps: Sequence[thesis.GraspRow] = thesis.TABLE_6_1, tilts: Sequence[thesis.TiltRow] = thesis.TABLE_6_2
) -> tuple[list[Held], list[Tilted]]:
    """Both tables, for some of their rows."""
    shell = thesis.shell()
    rods = [(row.gap, row.pressure.value) for row in grasps] + [(thesis.GAP, row.pressure.value) for row in tilts]
    pressures = jnp.array([pressure for _, pressure in rods])

    def solved(model: str) -> Solution:
        scenes = [CylinderContact(shell, radius=thesis.ROD, gap=gap, model=model) for gap, _ in rods]
        return jax.jit(jax.vmap(solve))(stacked(scenes), pressures)

    arc, energy = solved("arc"), solved("energy")
    aside = [
        AxialOffset(shell, radius=thesis.ROD, gap=row.gap, height=row.height.value, model="energy") for row in grasps
    ]
    offset = jax.jit(jax.vmap(solve))(stacked(aside), pressures[: len(grasps)])
    held = [
        Held(row, *(float(x) for x in (arc.force[k], energy.force[k], offset.force[k], offset.force_y[k])))
        for k, row in enumerate(grasps)
    ]
    tilted = []
    for k, row in enumerate(tilts, start=len(grasps)):
        c_a, c_b, pressure = arc.contact_half_width[k], arc.contact_half_length[k], pressures[k]
        moments = (tilt_moment(c_a, c_b, pressure, lever) for lever in ("exact", "rim"))
        seen = arc.contact_area[k], energy.force[k] / pressure, *moments, energy.friction_moment[k]
        tilted.append(Tilted(row, *(float(x) for x in seen)))
    return held, tilted


def page(held: Sequence[Held], tilted: Sequence[Tilted]) -> str:
    """The page."""
    lines = [
        "# Grasps by the energy membrane",
        "",
        "The flat shell of the thesis on its cylinder (radius 20 mm), computed with the "
        "[energy membrane](theory/energy.md) at the pressures that tables 6.1 and 6.2 print. Written by "
        "`python -m softgrip_jax.thesis.energy_grasp`; do not edit by hand.",
        "",
        "## Axial offset (3.4.4, table 6.1)",
        "",
        "In the arc model the force does not depend on where along the membrane the cylinder is, as long as straight "
        "parts are left (\\(e_2 \\ge 0\\), which gives the height \\(h\\)). By energy it does, a little: nearer to the "
        "end the membrane is lower, and what touches it there is also pushed towards the end. With 6 x 9 or 8 x 12 "
        "polynomials instead of 4 x 6 the forces change by up to 6 %, and the pushes by up to a factor of two: they "
        "say little more than their size.",
        "",
        "| mass | gap | pressure | height | force, arcs | energy, in the middle | energy, at that height | "
        "pushed along | friction to hold the mass: arcs, energy |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for at in held:
        weight = at.row.mass * GRAVITY / 2
        lines.append(
            f"| {at.row.mass / gram:.0f} g | {at.row.gap / mm:.0f} mm | {at.row.pressure} | {at.row.height} | "
            f"{at.arc:.3g} N | {at.middle:.3g} N ({_percent(at.middle, at.arc)}) | "
            f"{at.offset:.3g} N ({_percent(at.offset, at.arc)}) | {at.along:.2g} N | "
            f"{weight / at.arc:.2f}, {weight / at.offset:.2f} |"
        )
    lines += [
        "",
        "## Eccentric grasp (3.4.5, table 6.2)",
        "",
        "The moment about the normal of the contact that friction bears, for a friction coefficient of 1. Arcs: the "
        "pressure on an ellipse, with the exact lever arm and with (3.40). Energy: contact pressure times distance "
        "from the middle of the contact, integrated over the contact. Two things make the difference. On a cylinder "
        "the contact pressure is more than the air's: the tension along the membrane, which bends around it, presses, "
        "too (T / r is about half of the air's pressure here), and the arcs leave that out. And arcs rise less high: "
        "they touch later.",
        "",
        "| mass | x_e | pressure | force over pressure: arcs, energy | moment: (3.40) | exact | energy | "
        "friction for m g x_e: (3.40), energy |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for at in tilted:
        wanted = at.row.mass * GRAVITY * at.row.eccentricity
        lines.append(
            f"| {at.row.mass / gram:.0f} g | {at.row.eccentricity / mm:.0f} mm | {at.row.pressure} | "
            f"{at.arc_area / mm**2:.0f}, {at.area / mm**2:.0f} mm² | {1e3 * at.rim:.3g} N mm | "
            f"{1e3 * at.arc:.3g} N mm | {1e3 * at.energy:.3g} N mm ({_percent(at.energy, at.arc)}) | "
            + (f"{wanted / at.rim:.2f}, {wanted / at.energy:.2f} |" if wanted else "- |")
        )
    ratios = np.array([at.energy / at.arc for at in tilted])
    forces = np.array([at.middle / at.arc for at in held])
    lines += [
        "",
        f"The energy membrane presses {_range(forces)} as hard as the arcs on the cylinder in the middle, and resists "
        f"turning with {_range(ratios)} the moment of their ellipse.",
        "",
    ]
    return "\n".join(lines)


def _percent(value: float, than: float) -> str:
    return f"{100 * (value / than - 1):+.0f} %"


def _range(values: np.ndarray) -> str:
    return f"{values.min():.2f} to {values.max():.2f} times"


if __name__ == "__main__":
    print(page(*compute()), end="")
