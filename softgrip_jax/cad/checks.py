"""What holds of every exported design, each by a measurement of the solids or of the written files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from . import solids
from .parts import Export, Mould, Piece
from .solids import Number

VOLUME = 1e-6
"""Largest relative error of a volume."""
LENGTH = 1e-3
"""Largest error of a thickness, mm: 1e-6 m."""


@dataclasses.dataclass(frozen=True)
class Check:
    """One thing that was measured, and whether it is within what is allowed."""

    what: str
    piece: str
    expected: Number
    found: Number
    allowed: Number
    unit: str = ""

    @property
    def good(self) -> bool:
        """Whether it holds; nan does not."""
        return abs(self.found - self.expected) <= self.allowed

    def as_data(self) -> dict[str, Any]:
        """For JSON."""
        return dataclasses.asdict(self) | {"good": self.good}


def check_piece(piece: Piece) -> Iterator[Check]:
    """Closed, manifold, valid, without a hidden void, and as large as its formula says."""
    solid = piece.solid
    yield Check("valid and manifold", piece.name, 1, float(bool(solid.is_valid and solid.is_manifold)), 0)
    yield Check("surfaces: one, so that no air is shut in", piece.name, 1, float(len(solid.shells())), 0)
    yield Check("volume", piece.name, piece.volume, solid.volume, VOLUME * piece.volume, "mm^3")


def check_thicknesses(export: Export, read: dict[str, Any]) -> Iterator[Check]:
    """Every thickness, measured in solids by name, for instance those of written files."""
    for probe in export.probes:
        if probe.piece in read:
            found = solids.thickness_at(read[probe.piece], probe.point, probe.direction)
            yield Check(probe.name, probe.piece, probe.expected, found, LENGTH, "mm")


def check_mould(mould: Mould, part: Any) -> Iterator[Check]:
    """The closed mould leaves the part and nothing else, and comes off it."""
    part = solids.turned(part) if mould.is_turned else part
    pieces = {piece.name: piece.solid for piece in mould.pieces}
    rest = solids.without(mould.space.solid(), [*pieces.values(), *(hole.solid() for hole in mould.holes)])
    allowed, wrong = VOLUME * solids.volume(part), solids.difference(rest, part)
    yield Check("what the closed mould leaves, beside the part", mould.name, 0, wrong, allowed, "mm^3")
    names = list(pieces)
    for name, sign in mould.pulls.items():
        fixed = [part] + [pieces[other] for other in names if other != name]
        worst = max(undercut(pieces[name], other, sign) for other in fixed)
        yield Check("undercut in the pull direction", name, 0, worst, allowed, "mm^3")


def undercut(moving: Any, fixed: Any, sign: Number) -> float:
    """The largest volume that a solid pulled off along z shares with one that stays, at the shifts half-way between
    those at which faces meet.

    Between two shifts at which faces meet, the shared volume of blocks is linear in the shift; so it vanishes where it
    vanishes half-way.
    """
    low, high = solids.levels(fixed), solids.levels(moving)
    shifts = sorted({round(sign * (a - b), 6) for a in low for b in high} | {0.0})
    shifts = [0.0, *(s for s in shifts if s > 0)]
    middles = [0.0, *((one + other) / 2 for one, other in pairwise(shifts))]
    return max(solids.overlap(solids.moved(moving, (0.0, 0.0, sign * shift)), fixed) for shift in middles)


def check_mesh(path: Path, piece: str, expected: Number) -> Iterator[Check]:
    """An STL file opens without a repair, is closed, and is nearly as large as the solid (curves are polygons)."""
    import trimesh

    mesh: Any = trimesh.load(path, process=True)
    yield Check("STL is watertight", piece, 1, float(mesh.is_watertight and mesh.is_winding_consistent), 0)
    yield Check("volume of the STL", piece, expected, float(mesh.volume), 2e-3 * expected, "mm^3")


def check_solids(export: Export, tell: Callable[[str], Any] = lambda words: None) -> list[Check]:
    """All checks that need no file."""
    found: list[Check] = []
    pieces = {piece.name: piece for piece in export.pieces}
    for piece in [*export.pieces, *(one for mould in export.moulds for one in mould.pieces)]:
        tell(f"checking {piece.name}")
        found += check_piece(piece)
    for mould in export.moulds:
        tell(f"opening the mould of the {mould.casts}")
        found += check_mould(mould, pieces[mould.casts].solid)
    return found
