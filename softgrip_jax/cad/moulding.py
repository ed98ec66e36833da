"""Moulds around parts that are made of blocks: a tray below, a lid above, holes, and pins that align both."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .parts import Mould, corners, piece, rods
from .rules import ManufactureTable
from .solids import Block, Number, Rod, Shape


def outline(shapes: Sequence[Block]) -> tuple[tuple[Number, Number], tuple[Number, Number]]:
    """The range of blocks along x and along y."""
    x = min(one.low[0] for one in shapes), max(one.high[0] for one in shapes)
    y = min(one.low[1] for one in shapes), max(one.high[1] for one in shapes)
    return x, y


def mould_of(
    name: str,
    casts: str,
    part: Sequence[Block],
    height: tuple[Number, Number],
    pours: list[tuple[Number, Number]],
    vents: list[tuple[Number, Number]],
    table: ManufactureTable,
    teeth: Sequence[Block] = (),
    vent_mm: Number | None = None,
    is_turned: bool = False,
) -> Mould:
    """A mould of two pieces that part at the top of the range `height`; teeth hang from the lid into the part.

    The tray is a block without the part's outline (and is open without the lid); the lid has holes where silicone and
    air leave, and holes for the pins of the tray.
    """
    wall, lid, gap = table.mould_wall_mm, table.mould_floor_mm, table.clearance_mm
    low, top = height
    x, y = outline(part)
    x, y = (x[0] - wall, x[1] + wall), (y[0] - wall, y[1] + wall)
    pin = table.pin_mm / 2
    places = corners((x[0] + wall / 2, x[1] - wall / 2), (y[0] + wall / 2, y[1] - wall / 2))
    end = pin - lid * math.tan(math.radians(table.draft_deg))
    pins: list[Shape] = [Rod((px, py, top), pin, lid, top=end) for px, py in places]
    pin_holes = rods(places, table.pin_mm + 2 * gap, top, top + lid)
    tray = piece(f"{name} tray", "mould", [Block((x[0], y[0], low - lid), (x[1], y[1], top)), *pins], [*part])
    holes = [*rods(pours, table.pour_mm, top, top + lid), *rods(vents, vent_mm or table.vent_mm, top, top + lid)]
    cover = piece(
        f"{name} lid",
        "mould",
        [Block((x[0], y[0], top), (x[1], y[1], top + lid)), *teeth],
        [*holes, *pin_holes],
    )
    return Mould(
        name,
        casts,
        [tray, cover],
        Block((x[0], y[0], low - lid), (x[1], y[1], top + lid)),
        [*holes, *pin_holes],
        {tray.name: -1.0, cover.name: 1.0},
        is_turned,
    )


def open_mould(name: str, casts: str, part: Block, table: ManufactureTable) -> Mould:
    """A tray for a slab, open on top, where a straight edge levels the silicone."""
    wall, floor = table.mould_wall_mm, table.mould_floor_mm
    (x0, y0, z0), (x1, y1, z1) = part.low, part.high
    space = Block((x0 - wall, y0 - wall, z0 - floor), (x1 + wall, y1 + wall, z1))
    tray = piece(f"{name} tray", "mould", [space], [part])
    return Mould(name, casts, [tray], space, [], {tray.name: -1.0})
