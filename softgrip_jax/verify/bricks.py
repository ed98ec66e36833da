"""What an input deck for Abaqus, CalculiX or FEBio says of the same finite elements.

Units are mm, N and MPa. Elements are the boxes of the first mesh with each cell divided in two, as bricks of 20 nodes;
the same nodes are held, the same planes are symmetric, the same faces are pressed, following them. What may be touched,
without friction, is a body of bricks of 8 nodes: the side of an object as a height over a membrane, which is fixed; or
the plane in the middle of the gap of a finger's cell. With the normal n that this plane has at the end, the part s of
the load, and the way e that the plane has moved along n,

    n u = e + s (x_B - n X)  of the cover's cut,   u = s d + e n  of the plane,

d being the plane's turn: the cut stays plane, and the axial force of cut and plane together vanishes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import pneunet
from ..errors import InputError
from ..materials.base import Material
from ..shell.obstacles import Obstacle
from ..units import MPa, mm
from .cell import CellSolid
from .finger import is_finger, uniform
from .shell import Plate, heights, is_shell
from .solid import Faces, Solid

PARTS = 2
"""Into how many each cell of the first mesh is divided."""
REACH = 1.15
"""How far the object reaches over the membrane's edges, and the plane over the cell's."""
OBJECT_CELLS = 24

_CORNERS = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
_MIDDLES = [(0, -1, -1), (1, 0, -1), (0, 1, -1), (-1, 0, -1), (0, -1, 1), (1, 0, 1), (0, 1, 1), (-1, 0, 1)]
_UPRIGHTS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
ORDER = np.array(_CORNERS + _MIDDLES + _UPRIGHTS)
"""Nodes of a brick by their local coordinates, as all three programs count them."""
SIDES = [(2, -1), (2, 1), (1, -1), (0, 1), (1, 1), (0, -1)]
"""(axis, direction) of the faces S1 to S6 of a brick."""
AROUND = [
    [0, 3, 2, 1, 11, 10, 9, 8],
    [4, 5, 6, 7, 12, 13, 14, 15],
    [0, 1, 5, 4, 8, 17, 12, 16],
    [1, 2, 6, 5, 9, 18, 13, 17],
    [2, 3, 7, 6, 10, 19, 14, 18],
    [3, 0, 4, 7, 11, 16, 15, 19],
]
"""Their nodes, seen from outside: corners, then the middles between them."""

Sided = dict[int, np.ndarray]
"""Numbers of elements by the face, from 0 for S1."""


class Bricks(NamedTuple):
    """A solid of bricks, mm.

    Args:
        nodes: shape (n, 3).
        cells: numbers of nodes, from 0, shape (elements, 20).
        pressed, touching: faces that the air presses, and those that may touch.
        held: (what, axes, nodes): fixed displacements, or just a name for nodes where there are no axes.
    """

    nodes: np.ndarray
    cells: np.ndarray
    pressed: Sided
    touching: Sided
    held: list[tuple[str, tuple[int, ...], np.ndarray]]


class Body(NamedTuple):
    """What may be touched, as bricks of 8 nodes, mm; the face S1 of each may be touched.

    Args:
        nodes: shape (n, 3).
        cells: numbers of nodes, from 0, shape (elements, 8).
        held: axes along which none of its nodes moves.
    """

    nodes: np.ndarray
    cells: np.ndarray
    held: tuple[int, ...] = (0, 1, 2)


class Tie(NamedTuple):
    """A linear equation: displacement of a node = sum of coefficients times displacements + s moved.

    Args:
        node: (number, axis), those of the body counted after those of the solid.
        others: (number, axis, coefficient).
        moved: mm, at the full load.
    """

    node: tuple[int, int]
    others: list[tuple[int, int, float]]
    moved: float


class Deck(NamedTuple):
    """All that is written.

    Args:
        heading: what it is, in a line.
        bricks, body, ties: as above.
        material: of the bricks.
        pressure: MPa.
        thick: the wall that may touch, mm.
    """

    heading: str
    bricks: Bricks
    body: Body | None
    ties: list[Tie]
    material: Material
    pressure: float
    thick: float


def deck_of(scene: Any, pressure: float) -> Deck:
    """What stands in the deck of a scene at a pressure (Pa)."""
    heading = f"{type(scene).__name__}, pressure {pressure / MPa:.6g} MPa; mm, N, MPa"
    if is_finger(scene):
        return cell_deck(scene, pressure, heading)
    if not is_shell(scene):
        raise InputError(f"{type(scene).__name__} has no input deck; scenes of a shell and of a finger have.")
    plate = Plate(scene, PARTS)
    body = body_of(plate.obstacle, plate) if plate.obstacle is not None else None
    if body is None and plate.obstacle is not None:
        raise InputError("the object is nowhere over the membrane: there is no deck of it.")
    return Deck(heading, bricks_of_plate(plate), body, [], plate.material, pressure / MPa, plate.sizes[2] / mm)


def bricks_of(solid: Solid, pressed: Faces, touching: Faces | None) -> Bricks:
    """A solid's elements without the nodes in the middle of faces and cells; nothing is held yet."""
    middles, halves = solid.boxes
    local = np.rint((solid.X[solid.cells] - middles[:, None]) / halves[:, None]).astype(int)
    code = local @ np.array([9, 3, 1])
    wanted = ORDER @ np.array([9, 3, 1])
    cells = np.stack([solid.cells[np.arange(len(code)), np.argmax(code == one, axis=1)] for one in wanted], axis=1)
    used, cells = np.unique(cells, return_inverse=True)
    return Bricks(
        solid.X[used] / mm, cells.reshape(-1, 20), sided(pressed), sided(touching) if touching is not None else {}, []
    )


def sided(faces: Faces) -> Sided:
    """Elements by the side on which their faces lie."""
    normals = faces.normals[:, 0]
    sides = np.array([int(np.argmax([direction * n[axis] for axis, direction in SIDES])) for n in normals])
    return {int(side): np.sort(faces.elements[sides == side]) for side in np.unique(sides)}


def bricks_of_plate(plate: Plate) -> Bricks:
    """The plate's elements, clamped along their edges."""
    model = plate.model
    bricks = bricks_of(model.solid, _faces(model.pressed), model.contact.faces if model.contact else None)
    X = bricks.nodes * mm
    a, b, _ = plate.sizes
    edge = (np.abs(X[:, 0]) > a * (1 - 1e-9)) | (np.abs(X[:, 1]) > b * (1 - 1e-9))
    bricks.held.append(("CLAMPED", (0, 1, 2), np.flatnonzero(edge)))
    for axis, half in enumerate(plate.mirrors):
        if half:
            on = np.abs(X[:, axis]) < 1e-9 * a
            bricks.held.append((f"MIRROR_{'XY'[axis]}", (axis,), np.flatnonzero(on & ~edge)))
    return bricks


def _faces(faces: Faces | None) -> Faces:
    assert faces is not None
    return faces


def body_of(obstacle: Obstacle, plate: Plate) -> Body | None:
    """The side of an object that looks at the membrane, as a height over a grid; None where there is none."""
    a, b, t = plate.sizes
    lines = [
        np.linspace(0.0 if half else -REACH * size, REACH * size, OBJECT_CELLS + 1)
        for size, half in zip((a, b), plate.mirrors, strict=True)
    ]
    x, y = (part.ravel() for part in np.meshgrid(*lines, indexing="ij"))
    high = heights(obstacle, x, y, 2 * a, 0.5 * t)
    met = np.isfinite(high)
    shape = tuple(len(line) for line in lines)
    number = np.arange(len(x)).reshape(shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    quads = quads[met[quads].all(axis=1)]
    if not len(quads):
        return None
    used, quads = np.unique(quads, return_inverse=True)
    face = np.stack([x[used], y[used], high[used]], axis=1) / mm
    behind = face + np.array([0.0, 0.0, t / mm])
    quads = quads.reshape(-1, 4)
    return Body(np.concatenate([face, behind]), np.concatenate([quads, quads + len(used)], axis=1))


def cell_deck(scene: Any, pressure: float, heading: str) -> Deck:
    """Half a segment of a finger at one curvature, with the plane in its gap."""
    curvature = float(scene.curvature) if isinstance(scene, pneunet.Cell) else 0.0
    half = CellSolid(uniform(scene), PARTS)
    model = half.model
    assert model.contact is not None
    bricks = bricks_of(model.solid, _faces(model.pressed), model.contact.faces)
    X, x_B = bricks.nodes, half.x_B / mm
    width, top = float(np.max(X[:, 2])), float(np.max(X[:, 1]))
    middle, across = np.abs(X[:, 0]) < 1e-9 * width, np.abs(X[:, 2]) < 1e-9 * width
    cut = np.flatnonzero(np.abs(X[:, 0] - x_B) < 1e-9 * width)
    pin = np.array([int(np.argmin(np.sum(X**2, axis=1)))])
    bricks.held.extend(
        [
            ("MIRROR_X", (0,), np.flatnonzero(middle)),
            ("MIRROR_Z", (2,), np.flatnonzero(across)),
            ("MID_HEIGHT", (1,), pin),
            ("CUT", (), cut),
        ]
    )
    thick = float(scene.finger.t_m) / mm
    corners = np.array([(c, a, b) for a, b, c in _CORNERS])  # so turned, S1 looks along -x
    low, high = np.array([x_B, 0.0, 0.0]), np.array([x_B + thick, REACH * top, REACH * width])
    body = Body(low + 0.5 * (corners + 1) * (high - low), np.arange(8)[None], held=(2,))
    phi = curvature * half.x_B
    turned = heading + f"; half a segment at the curvature {curvature:.6g} 1/m"
    ties = _ties(X, cut, body.nodes, x_B, phi)
    return Deck(turned, bricks, body, ties, scene.finger.material, pressure / MPa, thick)


def _ties(X: np.ndarray, cut: np.ndarray, plane: np.ndarray, x_B: float, phi: float) -> list[Tie]:
    """The equations of cut and plane, with the way e by the displacement of the plane's first node along x."""
    c, s = np.cos(phi), np.sin(phi)
    n, t = np.array([c, -s]), np.array([s, c])
    first = len(X)
    d = plane[:, :1] * n + plane[:, 1:2] * t - plane[:, :2]
    ties = []
    for node in cut:
        moved = (x_B - X[node, :2] @ n) / n[0] - d[0, 0] / n[0] ** 2
        ties.append(Tie((int(node), 0), [(first, 0, 1 / n[0] ** 2), (int(node), 1, -n[1] / n[0])], float(moved)))
    for i in range(len(plane)):
        if i:
            ties.append(Tie((first + i, 0), [(first, 0, 1.0)], float(d[i, 0] - d[0, 0])))
        ties.append(Tie((first + i, 1), [(first, 0, n[1] / n[0])], float(d[i, 1] - d[0, 0] * n[1] / n[0])))
    return ties
