"""Rules of what can be made; a rule that is broken is one sentence with the number that must change."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..errors import InputError
from .parts import Piece
from .rules import ManufactureTable
from .solids import Number, extent


def at_least(what: str, value: Number, least: Number, why: str) -> None:
    """An InputError where a length in mm is too small."""
    if not value >= least - 1e-9:
        raise InputError(f"{what} is {value:.4g} mm; it must be at least {least:.4g} mm: {why}.")


def at_most(what: str, value: Number, most: Number, why: str) -> None:
    """An InputError where a length in mm is too large."""
    if not value <= most + 1e-9:
        raise InputError(f"{what} is {value:.4g} mm; it must be at most {most:.4g} mm: {why}.")


def check_common(table: ManufactureTable) -> None:
    """Rules that every design keeps."""
    wall = table.least_wall_mm
    least = table.screw_mm + 2 * wall
    at_least(
        "frame_mm", table.frame_mm, least, "a screw hole of screw_mm with least_wall_mm on both sides stands in it"
    )
    least = table.pin_mm + 2 * table.clearance_mm + 2 * wall
    at_least("mould_wall_mm", table.mould_wall_mm, least, "a pin with clearance and least_wall_mm stands in it")
    for name in ("floor_mm", "mould_floor_mm", "ring_mm"):
        at_least(name, getattr(table, name), wall, "that is the least wall of the printer (least_wall_mm)")
    tip = table.pin_mm / 2 - table.mould_floor_mm * math.tan(math.radians(table.draft_deg))
    at_least("the radius of a pin at its end", tip, 0.5, "lower draft_deg or mould_floor_mm, or raise pin_mm")


def check_core(name: str, thickness: Number, height: Number, table: ManufactureTable, change: str) -> None:
    """Rules of a printed tooth: thick enough to print, and not too slender to hold."""
    if thickness < table.least_core_mm - 1e-9:
        raise InputError(
            f"{name} is {max(thickness, 0.0):.4g} mm thick, too thin to hold; it must be at least "
            f"{table.least_core_mm:.4g} mm (least_core_mm): {change}."
        )
    if height > table.most_slender * thickness + 1e-9:
        raise InputError(
            f"{name} is {height:.4g} mm high and {thickness:.4g} mm thick, too slender to hold: "
            f"{height / thickness:.3g} to 1, at most {table.most_slender:.3g} to 1 (most_slender): {change}."
        )


def check_bed(printed: Sequence[tuple[Piece, Number]], table: ManufactureTable) -> None:
    """An InputError where a printed piece is larger than the bed, turned about the vertical or not."""
    width, depth, height = table.bed_mm
    for one, factor in printed:
        x, y, z = (factor * length for length in extent(one.solid))
        if z > height or not ((x <= width and y <= depth) or (y <= width and x <= depth)):
            raise InputError(
                f"The part {one.name} is {x:.4g} x {y:.4g} x {z:.4g} mm, larger than the printer's bed of "
                f"{width:.4g} x {depth:.4g} x {height:.4g} mm; make the design smaller or give another bed_mm."
            )
