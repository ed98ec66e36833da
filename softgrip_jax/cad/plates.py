"""Printed pieces laid out on the beds of a printer, and written as 3MF files, one a plate.

Pieces stand as they are drawn, lids turned over so that their cores stand on their plate, and turned about the vertical
by a right angle where only that fits. They are laid in rows,
the deepest first, each row as deep as its deepest piece (the shelf algorithm of two-dimensional packing).

Libraries that were looked at: rectpack fills a bed more densely and keeps neither the order nor the way that pieces
stand; there are a dozen pieces, and most runs need one bed.
"""

from __future__ import annotations

import locale
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from .parts import Export, Piece
from .rules import ManufactureTable
from .solids import Number, extent, kernel, moved, scaled, turned

BETWEEN = 5.0
"""Millimetres between two pieces, and to the edge where there is room for it."""


class Placed(NamedTuple):
    """A piece on a plate, mm."""

    piece: Piece
    scale: Number
    turned: bool
    """By a right angle about the vertical."""
    x: Number
    y: Number
    """Of its corner with the smallest coordinates."""
    size: tuple[Number, Number]
    """As it lies there."""


def printed(export: Export, scale: Number) -> list[tuple[Piece, Number]]:
    """(piece, how much larger it is made) of everything that is printed."""
    parts = [(one, 1.0) for one in export.pieces if one.made == "printed"]
    return parts + [(one, scale) for mould in export.moulds for one in mould.pieces]


def laid_out(pieces: Sequence[tuple[Piece, Number]], table: ManufactureTable) -> list[list[Placed]]:
    """The plates; every piece must fit a bed (`limits.check_bed`)."""
    width, depth = table.bed_mm[:2]
    waiting = []
    for piece, scale in pieces:
        x, y = (scale * length for length in extent(piece.solid)[:2])
        # The longer side along the bed's width keeps rows shallow.
        aside = (y > x and y <= width and x <= depth) or not (x <= width and y <= depth)
        waiting.append((piece, scale, aside, (y, x) if aside else (x, y)))
    plates: list[list[Placed]] = []
    x = y = row = 0.0
    for piece, scale, aside, size in sorted(waiting, key=lambda one: -one[3][1]):
        if plates and x + size[0] > width:  # the next row
            x, y, row = 0.0, y + row + BETWEEN, 0.0
        if not plates or y + size[1] > depth:
            plates.append([])
            x, y, row = 0.0, 0.0, 0.0
        plates[-1].append(Placed(piece, scale, aside, x, y, size))
        x, row = x + size[0] + BETWEEN, max(row, size[1])
    return plates


def solid_of(placed: Placed) -> Any:
    """The solid where it stands on its plate."""
    piece = placed.piece
    solid = scaled(turned(piece.solid) if piece.hangs else piece.solid, placed.scale)
    if placed.turned:
        solid = kernel().Rot(0, 0, 90) * solid
    low = solid.bounding_box().min
    return moved(solid, (placed.x - low.X, placed.y - low.Y, -low.Z))


@contextmanager
def locale_kept() -> Iterator[None]:
    """lib3mf sets the locale of the whole process to "C", in which Python reads the output of others as ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        yield
    finally:
        locale.setlocale(locale.LC_ALL, before)


def write_plate(plate: Sequence[Placed], path: Path) -> None:
    """A 3MF file of one plate, mm, each piece under its name."""
    mesher = kernel().Mesher()
    for placed in plate:
        solid = solid_of(placed)
        solid.label = placed.piece.name
        mesher.add_shape(solid, linear_deflection=0.01, angular_deflection=0.1)
    with locale_kept():
        mesher.write(str(path))
