"""Input decks of the same finite elements for Abaqus, CalculiX and FEBio.

Units are mm, N and MPa. Elements are the boxes of the first mesh with each cell divided in two, as bricks of 20 nodes;
the same edges are held, the same planes are symmetric, the same face is pressed, following it. What the membrane may
touch is a rigid body of bricks under its outer face as a height over the membrane, without friction.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..folders import write_whole
from ..materials import MooneyRivlin, NeoHookean, Ogden, Yeoh
from ..materials.base import Material
from ..shell.obstacles import Obstacle
from ..units import MPa, mm
from .shell import Plate, heights, is_shell
from .solid import Solid

FORMATS = ("abaqus", "calculix", "febio")
PARTS = 2
"""Into how many each cell of the first mesh is divided."""
BULK = 500.0
"""Bulk modulus over the shear modulus: more makes bricks of displacements alone too stiff."""
STEPS = 40
"""Increments of the pressure to begin with."""
REACH = 1.15
"""How far the object reaches over the membrane's edges."""
OBJECT_CELLS = 24

_CORNERS = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
_MIDDLES = [(0, -1, -1), (1, 0, -1), (0, 1, -1), (-1, 0, -1), (0, -1, 1), (1, 0, 1), (0, 1, 1), (-1, 0, 1)]
_UPRIGHTS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
ORDER = np.array(_CORNERS + _MIDDLES + _UPRIGHTS)
"""Nodes of a brick by their local coordinates, as all three programs count them."""
BOTTOM, TOP = "S1", "S2"
"""Faces of a brick whose normals are -z and z."""
BOTTOM_NODES = [0, 3, 2, 1, 11, 10, 9, 8]
TOP_NODES = [4, 5, 6, 7, 12, 13, 14, 15]
"""... seen from outside."""


class Bricks(NamedTuple):
    """A plate of bricks, mm.

    Args:
        nodes: shape (n, 3).
        cells: numbers of nodes, from 0, shape (elements, 20).
        inner, outer: elements whose faces -z and z are pressed, and may touch.
        held: (what, axes, nodes): fixed displacements.
    """

    nodes: np.ndarray
    cells: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    held: list[tuple[str, tuple[int, ...], np.ndarray]]


class Rigid(NamedTuple):
    """A rigid object as bricks of 8 nodes, mm; the face -z of each may be touched."""

    nodes: np.ndarray
    cells: np.ndarray


def write_deck(scene: Any, pressure: float, format: str, path: Path) -> None:
    """Write the input deck of a scene's finite elements.

    Args:
        scene: of a shell.
        pressure: gauge pressure, Pa.
        format: "abaqus", "calculix" or "febio".
        path: of the file.

    Raises:
        InputError: for another format, a scene without a deck, and a material that the program has no law for.
    """
    if format not in FORMATS:
        raise InputError(f"the deck is for {format!r}; it must be one of {', '.join(FORMATS)}.")
    if not is_shell(scene):
        raise InputError(f"{type(scene).__name__} has no input deck; scenes of a shell have.")
    plate = Plate(scene, PARTS)
    bricks = bricks_of(plate)
    rigid = rigid_of(plate.obstacle, plate) if plate.obstacle is not None else None
    if rigid is None and plate.obstacle is not None:
        raise InputError("the object is nowhere over the membrane: there is no deck of it.")
    write = _febio if format == "febio" else _abaqus
    text = write(bricks, rigid, plate.material, pressure / MPa, format, type(scene).__name__)
    write_whole(path, text.encode())


def bricks_of(plate: Plate) -> Bricks:
    """The plate's elements without the nodes in the middle of faces and cells."""
    solid: Solid = plate.model.solid
    middles, halves = solid.boxes
    local = np.rint((solid.X[solid.cells] - middles[:, None]) / halves[:, None]).astype(int)
    code = local @ np.array([9, 3, 1])
    wanted = ORDER @ np.array([9, 3, 1])
    cells = np.stack([solid.cells[np.arange(len(code)), np.argmax(code == one, axis=1)] for one in wanted], axis=1)
    used, cells = np.unique(cells, return_inverse=True)
    cells = cells.reshape(-1, 20)
    X = solid.X[used]
    a, b, t = plate.sizes
    edge = (np.abs(X[:, 0]) > a * (1 - 1e-9)) | (np.abs(X[:, 1]) > b * (1 - 1e-9))
    held: list[tuple[str, tuple[int, ...], np.ndarray]] = [("CLAMPED", (0, 1, 2), np.flatnonzero(edge))]
    for axis, half in enumerate(plate.mirrors):
        if half:
            on = np.abs(X[:, axis]) < 1e-9 * a
            held.append((f"MIRROR_{'XY'[axis]}", (axis,), np.flatnonzero(on & ~edge)))
    low = np.flatnonzero(middles[:, 2] - halves[:, 2] < -t * (1 - 1e-9))
    high = np.flatnonzero(middles[:, 2] + halves[:, 2] > -1e-9 * t)
    return Bricks(X / mm, cells, low, high, held)


def rigid_of(obstacle: Obstacle, plate: Plate) -> Rigid | None:
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
    return Rigid(np.concatenate([face, behind]), np.concatenate([quads, quads + len(used)], axis=1))


def _hyperelastic(material: Material) -> list[str]:
    """The lines of *HYPERELASTIC, MPa."""
    bulk = BULK * float(material.shear_modulus()) / MPa
    D = 2 / bulk
    numbers: list[float]
    if isinstance(material, NeoHookean):
        name, numbers = "NEO HOOKE", [float(material.mu) / MPa / 2, D]
    elif isinstance(material, MooneyRivlin):
        name, numbers = "MOONEY-RIVLIN", [float(material.c1) / MPa, float(material.c2) / MPa, D]
    elif isinstance(material, Yeoh):
        name, numbers = "YEOH", [*(float(c) / MPa for c in (material.c1, material.c2, material.c3)), D, 0.0, 0.0]
    elif isinstance(material, Ogden) and len(np.asarray(material.mu)) <= 3:
        # W = sum 2 mu_i / alpha_i^2 (...) there, sum mu_i / alpha_i (...) here.
        pairs = zip(np.asarray(material.mu) / MPa, np.asarray(material.alpha), strict=True)
        terms = [value for mu, alpha in pairs for value in (float(mu * alpha / 2), float(alpha))]
        count = len(terms) // 2
        name, numbers = f"OGDEN, N={count}", [*terms, D, *([0.0] * (count - 1))]
    else:
        raise InputError(f"the material {type(material).__name__} has no law in the program that the deck is for.")
    values = [f"{value:.10g}" for value in numbers]
    return [f"*HYPERELASTIC, {name}", *(", ".join(values[i : i + 8]) for i in range(0, len(values), 8))]


def _lines(head: str, numbers: np.ndarray, each: int = 12) -> list[str]:
    """A set of numbers, so many in a line."""
    parts = [numbers[i : i + each] for i in range(0, len(numbers), each)]
    return [head, *(", ".join(str(int(n)) for n in part) for part in parts)]


def _abaqus(bricks: Bricks, rigid: Rigid | None, material: Material, pressure: float, format: str, name: str) -> str:
    """Keywords that Abaqus and CalculiX share; Abaqus takes hybrid bricks."""
    kind = "C3D20RH" if format == "abaqus" else "C3D20R"
    lines = ["*HEADING", f"{name}, pressure {pressure:.6g} MPa; mm, N, MPa", "*NODE, NSET=PLATE"]
    lines += [f"{i + 1}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(bricks.nodes)]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=PLATE")
    for i, cell in enumerate(bricks.cells):
        numbers = [str(n + 1) for n in cell]
        lines += [f"{i + 1}, {', '.join(numbers[:10])},", ", ".join(numbers[10:])]
    lines += _lines("*ELSET, ELSET=INNER", bricks.inner + 1)
    lines += _lines("*ELSET, ELSET=OUTER", bricks.outer + 1)
    for what, _, nodes in bricks.held:
        lines += _lines(f"*NSET, NSET={what}", nodes + 1)
    lines += ["*MATERIAL, NAME=SILICONE", *_hyperelastic(material), "*SOLID SECTION, ELSET=PLATE, MATERIAL=SILICONE"]
    if rigid is not None:
        first, begin = len(bricks.nodes) + 1, len(bricks.cells) + 1
        lines += ["*NODE, NSET=OBJECT"]
        lines += [f"{first + i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(rigid.nodes)]
        lines.append("*ELEMENT, TYPE=C3D8, ELSET=OBJECT")
        lines += [f"{begin + i}, {', '.join(str(first + n) for n in cell)}" for i, cell in enumerate(rigid.cells)]
        lines += ["*MATERIAL, NAME=HARD", "*ELASTIC", "1000., 0.3", "*SOLID SECTION, ELSET=OBJECT, MATERIAL=HARD"]
        stiffness = 100 * float(material.shear_modulus()) / MPa / float(np.ptp(bricks.nodes[:, 2]))
        lines += ["*SURFACE, NAME=MEMBRANE", f"OUTER, {TOP}", "*SURFACE, NAME=OBJECT", f"OBJECT, {BOTTOM}"]
        lines += ["*SURFACE INTERACTION, NAME=SMOOTH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
        lines += [f"{stiffness:.6g}" + (", 1.e-6" if format == "calculix" else "")]
        lines += ["*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE", "MEMBRANE, OBJECT"]
    lines.append("*BOUNDARY")
    for what, axes, _ in bricks.held:
        lines += [f"{what}, {axis + 1}, {axis + 1}" for axis in axes]
    if rigid is not None:
        lines.append("OBJECT, 1, 3")
    lines += [f"*STEP, NLGEOM{'=YES' if format == 'abaqus' else ''}, INC=1000", "*STATIC", f"{1 / STEPS:.6g}, 1., 1e-6"]
    lines += ["*DLOAD", f"INNER, P{BOTTOM[1]}, {pressure:.9g}"]
    if format == "abaqus":
        lines += ["*OUTPUT, FIELD", "*NODE OUTPUT", "U, RF"]
    else:
        lines += ["*NODE FILE", "U", "*NODE PRINT, NSET=PLATE", "U"]
        if rigid is not None:
            lines += ["*NODE PRINT, NSET=OBJECT, TOTALS=ONLY", "RF"]
    return "\n".join([*lines, "*END STEP", ""])


def _febio(bricks: Bricks, rigid: Rigid | None, material: Material, pressure: float, format: str, name: str) -> str:
    """FEBio's XML, version 4.0."""
    bulk = BULK * float(material.shear_modulus()) / MPa
    if isinstance(material, NeoHookean):
        c1, c2 = float(material.mu) / MPa / 2, 0.0
    elif isinstance(material, MooneyRivlin):
        c1, c2 = float(material.c1) / MPa, float(material.c2) / MPa
    else:
        raise InputError(f"the material {type(material).__name__} has no law in the program that the deck is for.")
    out = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<febio_spec version="4.0">',
        f"<!-- {name}, pressure {pressure:.6g} MPa; mm, N, MPa -->",
        '<Module type="solid"/>',
        "<Control><analysis>STATIC</analysis>",
        f"<time_steps>{STEPS}</time_steps><step_size>{1 / STEPS:.6g}</step_size>",
        '<solver type="solid"><symmetric_stiffness>non-symmetric</symmetric_stiffness></solver>',
        '<time_stepper type="default"><dtmin>1e-5</dtmin><dtmax>0.1</dtmax>',
        "<max_retries>20</max_retries></time_stepper>",
        "</Control>",
        "<Material>",
        '<material id="1" name="silicone" type="Mooney-Rivlin">',
        f"<c1>{c1:.10g}</c1><c2>{c2:.10g}</c2><k>{bulk:.10g}</k></material>",
    ]
    if rigid is not None:
        out.append('<material id="2" name="object" type="rigid body"><density>1</density></material>')
    out += ["</Material>", "<Mesh>", '<Nodes name="plate">']
    out += [f'<node id="{i + 1}">{x:.9g},{y:.9g},{z:.9g}</node>' for i, (x, y, z) in enumerate(bricks.nodes)]
    out += ["</Nodes>", '<Elements type="hex20" name="plate">']
    out += [f'<elem id="{i + 1}">{",".join(str(n + 1) for n in cell)}</elem>' for i, cell in enumerate(bricks.cells)]
    out.append("</Elements>")
    first, begin = len(bricks.nodes) + 1, len(bricks.cells) + 1
    if rigid is not None:
        out.append('<Nodes name="object">')
        out += [f'<node id="{first + i}">{x:.9g},{y:.9g},{z:.9g}</node>' for i, (x, y, z) in enumerate(rigid.nodes)]
        out += ["</Nodes>", '<Elements type="hex8" name="object">']
        for i, cell in enumerate(rigid.cells):
            out.append(f'<elem id="{begin + i}">{",".join(str(first + n) for n in cell)}</elem>')
        out.append("</Elements>")
    for what, _, nodes in bricks.held:
        out.append(f'<NodeSet name="{what}">{",".join(str(n + 1) for n in nodes)}</NodeSet>')
    faces = [("inner", bricks.inner, BOTTOM_NODES), ("outer", bricks.outer, TOP_NODES)]
    for what, elements, nodes in faces:
        out.append(f'<Surface name="{what}">')
        for i, cell in enumerate(bricks.cells[elements]):
            out.append(f'<quad8 id="{i + 1}">{",".join(str(n + 1) for n in cell[nodes])}</quad8>')
        out.append("</Surface>")
    if rigid is not None:
        out.append('<Surface name="object">')
        for i, cell in enumerate(rigid.cells):
            out.append(f'<quad4 id="{i + 1}">{",".join(str(first + n) for n in cell[[0, 3, 2, 1]])}</quad4>')
        out += [
            "</Surface>",
            '<SurfacePair name="touch"><primary>outer</primary><secondary>object</secondary></SurfacePair>',
        ]
    out += ["</Mesh>", "<MeshDomains>", '<SolidDomain name="plate" mat="silicone"/>']
    if rigid is not None:
        out.append('<SolidDomain name="object" mat="object"/>')
    out += ["</MeshDomains>", "<Boundary>"]
    for what, axes, _ in bricks.held:
        dofs = "".join(f"<{d}_dof>{int(i in axes)}</{d}_dof>" for i, d in enumerate("xyz"))
        out.append(f'<bc name="{what}" type="zero displacement" node_set="{what}">{dofs}</bc>')
    out.append("</Boundary>")
    if rigid is not None:
        fixed = "".join(f"<{d}_dof>1</{d}_dof>" for d in ("Rx", "Ry", "Rz", "Ru", "Rv", "Rw"))
        out.append(f'<Rigid><rigid_bc name="hold" type="rigid_fixed"><rb>object</rb>{fixed}</rigid_bc></Rigid>')
    out += [
        "<Loads>",
        f'<surface_load name="air" type="pressure" surface="inner"><pressure lc="1">{pressure:.9g}</pressure>'
        "<linear>0</linear></surface_load>",
        "</Loads>",
    ]
    if rigid is not None:
        out += [
            '<Contact><contact name="touch" type="sliding-elastic" surface_pair="touch">',
            "<laugon>AUGLAG</laugon><auto_penalty>1</auto_penalty><penalty>1</penalty><fric_coeff>0</fric_coeff>",
            "</contact></Contact>",
        ]
    out += [
        '<LoadData><load_controller id="1" type="loadcurve"><interpolate>LINEAR</interpolate>',
        "<points><pt>0,0</pt><pt>1,1</pt></points></load_controller></LoadData>",
        '<Output><plotfile type="febio"><var type="displacement"/><var type="reaction forces"/></plotfile></Output>',
        "</febio_spec>",
        "",
    ]
    return "\n".join(out)
