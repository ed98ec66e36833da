"""What an exported design consists of: parts, moulds, and where their thicknesses are measured."""

from __future__ import annotations

import dataclasses
from typing import Any

from .solids import Block, Number, Point, Rod, Shape, made_of


@dataclasses.dataclass(frozen=True)
class Piece:
    """A solid with the volume that its formula gives, mm^3."""

    name: str
    solid: Any
    volume: Number
    made: str
    """"cast", "printed", "bonded" (of cast ones) or "mould"."""

    @property
    def hangs(self) -> bool:
        """Whether it is a lid: it is drawn as it closes its mould, with its cores below the plate."""
        return self.name.endswith(" lid")


@dataclasses.dataclass(frozen=True)
class Probe:
    """Where the thickness of a part is measured back, and what it shall be, mm."""

    piece: str
    name: str
    point: Point
    direction: Point
    expected: Number


@dataclasses.dataclass(frozen=True)
class Mould:
    """The printed pieces around one cast part, as they stand while it cures."""

    name: str
    casts: str
    pieces: list[Piece]
    space: Block
    """What the pieces, the part, and the holes fill together."""
    holes: list[Shape]
    """For pouring, air and pins."""
    pulls: dict[str, Number]
    """Piece -> +1 or -1: it is pulled off along z or against it."""
    is_turned: bool = False
    """Whether the part stands in it upside down, turned about x."""


@dataclasses.dataclass(frozen=True)
class Export:
    """All of a design."""

    kind: str
    pieces: list[Piece]
    moulds: list[Mould]
    probes: list[Probe]
    facts: dict[str, str]
    """For the sheet."""
    fingers: int = 1
    """How often everything is cast and printed, but the base of a gripper."""


def piece(name: str, made: str, plus: list[Shape], minus: list[Shape]) -> Piece:
    """A piece of shapes that do not overlap each other, without shapes that lie within them and do not either."""
    volume = sum(shape.volume for shape in plus) - sum(shape.volume for shape in minus)
    return Piece(name, made_of(plus, minus), volume, made)


def ring(inner: tuple[Number, Number], outer: tuple[Number, Number], low: Number, high: Number) -> list[Shape]:
    """A rectangular ring about the origin as four blocks; half widths along x and y."""
    (a, b), (c, d) = inner, outer
    return [
        Block((-c, -d, low), (c, -b, high)),
        Block((-c, b, low), (c, d, high)),
        Block((-c, -b, low), (-a, b, high)),
        Block((a, -b, low), (c, b, high)),
    ]


def corners(x: tuple[Number, Number], y: tuple[Number, Number]) -> list[tuple[Number, Number]]:
    """The four corners of a rectangle."""
    return [(px, py) for px in x for py in y]


def rods(places: list[tuple[Number, Number]], diameter: Number, low: Number, high: Number) -> list[Shape]:
    """Upright cylinders."""
    return [Rod((x, y, low), diameter / 2, high - low) for x, y in places]
