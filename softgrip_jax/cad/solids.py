"""Solids from boxes, cylinders and cones, in mm: the one file that knows build123d.

build123d takes seconds to import: that happens in `kernel`, when the first solid is made.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError

Number = int | float
Point = tuple[Number, Number, Number]


@functools.cache
def kernel() -> Any:
    """build123d; an InputError that says how to get it where it is missing."""
    try:
        import build123d
        import trimesh as trimesh
    except ImportError as error:
        raise InputError(f'Solids need build123d and trimesh ({error}): pip install "softgrip_jax[cad]".') from None
    return build123d


@dataclasses.dataclass(frozen=True)
class Block:
    """A box from its lowest to its highest corner."""

    low: Point
    high: Point

    @property
    def size(self) -> Point:
        """Its three lengths."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z

    @property
    def volume(self) -> float:
        """In mm^3."""
        return math.prod(self.size)

    def solid(self) -> Any:
        """As a solid."""
        cad = kernel()
        return (cad.Pos(*self.low) * cad.Box(*self.size, align=(cad.Align.MIN,) * 3)).solid()


@dataclasses.dataclass(frozen=True)
class Rod:
    """A cylinder, or a cone cut off, from a point along z or x; `top` is its radius at the end where it is another."""

    start: Point
    radius: Number
    length: Number
    axis: str = "z"
    top: Number | None = None

    @property
    def volume(self) -> float:
        """In mm^3."""
        low, high = self.radius, self.radius if self.top is None else self.top
        return math.pi * self.length * (low * low + low * high + high * high) / 3

    def solid(self) -> Any:
        """As a solid."""
        cad = kernel()
        align = (cad.Align.CENTER, cad.Align.CENTER, cad.Align.MIN)
        turn = cad.Rot(0, 90, 0) if self.axis == "x" else cad.Rot(0, 0, 0)
        if self.top is None or self.top == self.radius:
            shape = cad.Cylinder(self.radius, self.length, align=align)
        else:
            shape = cad.Cone(self.radius, self.top, self.length, align=align)
        return (cad.Pos(*self.start) * turn * shape).solid()


Shape = Block | Rod


def made_of(plus: Sequence[Shape], minus: Sequence[Shape] = ()) -> Any:
    """The one solid of some shapes without others."""
    first, *rest = (shape.solid() for shape in plus)
    whole = first.fuse(*rest) if rest else first
    if minus:
        whole = whole.cut(*(shape.solid() for shape in minus))
    return one_solid(whole)


def joined(solids: Sequence[Any]) -> Any:
    """Solids that touch as one."""
    return one_solid(solids[0].fuse(*solids[1:]))


def one_solid(shape: Any) -> Any:
    """The only solid of a shape, its faces in one plane made one."""
    found = solids_of(shape)
    if len(found) != 1:
        raise RuntimeError(f"a part fell into {len(found)} solids")
    return found[0].clean()


def solids_of(shape: Any) -> list[Any]:
    """The solids of a shape, of several shapes, or of nothing."""
    if shape is None:
        return []
    return [s for part in shape for s in part.solids()] if isinstance(shape, list) else list(shape.solids())


def volume(shape: Any) -> float:
    """Of all its solids, mm^3."""
    return float(sum(solid.volume for solid in solids_of(shape)))


def without(solid: Any, others: Iterable[Any]) -> Any:
    """What is left of a solid, maybe nothing, maybe several."""
    others = list(others)
    return solid.cut(*others) if others else solid


def overlap(one: Any, other: Any) -> float:
    """Volume that two solids share, mm^3."""
    return volume(one.intersect(other))


def difference(one: Any, other: Any) -> float:
    """Volume that belongs to one of two shapes and not to the other, mm^3."""
    total = 0.0
    for first, second in ((one, other), (other, one)):
        rest = solids_of(second)
        for solid in solids_of(first):
            total += volume(without(solid, rest))
    return total


def moved(solid: Any, by: Point) -> Any:
    """The solid somewhere else."""
    return kernel().Pos(*by) * solid


def turned(solid: Any) -> Any:
    """The solid turned upside down about the x axis."""
    return kernel().Rot(180, 0, 0) * solid


def scaled(solid: Any, factor: Number) -> Any:
    """The solid made larger about the origin."""
    return solid if factor == 1 else kernel().scale(solid, by=factor).solid()


def extent(solid: Any) -> Point:
    """The lengths of its bounding box, mm."""
    size = solid.bounding_box().size
    return size.X, size.Y, size.Z


def levels(solid: Any) -> list[Number]:
    """The heights z of its vertices, mm."""
    return sorted({round(vertex.Z, 7) for vertex in solid.vertices()})


def thickness_at(solid: Any, point: Point, direction: Point) -> float:
    """Thickness of the material around a point within it along a direction, mm; nan outside of it."""
    cad = kernel()
    hits = solid.find_intersection_points(cad.Axis(point, direction))
    along = [sum((getattr(hit, c) - p) * d for c, p, d in zip("XYZ", point, direction, strict=True)) for hit, _ in hits]
    ahead, behind = [s for s in along if s > 0], [s for s in along if s <= 0]
    if not ahead or not behind or not solid.is_inside(point):
        return math.nan
    return min(ahead) - max(behind)


def triangles(solid: Any) -> tuple[list[Point], list[tuple[int, int, int]]]:
    """(vertices, triples of them) of its surface, mm."""
    vertices, faces = solid.tessellate(0.05, 0.2)
    return [(v.X, v.Y, v.Z) for v in vertices], faces


def edges(solid: Any) -> list[list[Point]]:
    """Its edges as lines of points, mm."""
    lines = []
    for edge in solid.edges():
        count = 2 if edge.geom_type == kernel().GeomType.LINE else 17
        lines.append([(p.X, p.Y, p.Z) for p in (edge @ (k / (count - 1)) for k in range(count))])
    return lines


def write_step(solid: Any, path: Path) -> None:
    """A STEP file, mm."""
    kernel().export_step(solid, str(path))


def read_step(path: Path) -> list[Any]:
    """The solids of a STEP file."""
    return solids_of(kernel().import_step(str(path)))


def write_stl(solid: Any, path: Path) -> None:
    """An STL file, mm; curved faces within 0.01 mm."""
    kernel().export_stl(solid, str(path), tolerance=0.01, angular_tolerance=0.1)
