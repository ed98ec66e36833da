"""Decks as text: keywords of Abaqus and CalculiX, XML of FEBio."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..materials import MooneyRivlin, NeoHookean, Ogden, Yeoh
from ..materials.base import Material
from ..units import MPa
from .bricks import AROUND, Deck

BULK = 500.0
"""Bulk modulus over the shear modulus: more makes bricks of displacements alone too stiff."""
STEPS = 40
"""Increments of the load to begin with."""
PROGRAMS = {"abaqus": "Abaqus", "calculix": "CalculiX"}
LITTLE = 1e-12
"""A coefficient, and a way in mm, that is nothing."""


def _no_law(material: Material, program: str, laws: str) -> InputError:
    """For a material that is not among the laws a deck is written for."""
    terms = f" of {len(np.asarray(material.mu))} terms" if isinstance(material, Ogden) else ""
    return InputError(f"a deck for {program} is written for {laws}; the material is {type(material).__name__}{terms}.")


def _hyperelastic(material: Material, program: str) -> list[str]:
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
        raise _no_law(material, program, "NeoHookean, MooneyRivlin, Yeoh and Ogden of at most 3 terms")
    values = [f"{value:.10g}" for value in numbers]
    return [f"*HYPERELASTIC, {name}", *(", ".join(values[i : i + 8]) for i in range(0, len(values), 8))]


def _lines(head: str, numbers: np.ndarray, each: int = 12) -> list[str]:
    """A set of numbers, so many in a line."""
    parts = [numbers[i : i + each] for i in range(0, len(numbers), each)]
    return [head, *(", ".join(str(int(n)) for n in part) for part in parts)]


def _places(nodes: np.ndarray, begin: int) -> list[str]:
    return [f"{begin + i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(nodes)]


def _equations(deck: Deck, begin: int) -> tuple[list[str], list[str]]:
    """The ties as *EQUATION, and what moves: each way by a node of its own, numbered from `begin`."""
    moved = [tie for tie in deck.ties if abs(tie.moved) > LITTLE]
    lines, moves = [], []
    if moved:
        lines += ["*NODE, NSET=WAYS", *(f"{begin + i}, 0, 0, 0" for i in range(len(moved)))]
    for tie in deck.ties:
        terms = [(*tie.node, -1.0), *((node, axis, by) for node, axis, by in tie.others if abs(by) > LITTLE)]
        entries = [f"{node + 1}, {axis + 1}, {by:.12g}" for node, axis, by in terms]
        if abs(tie.moved) > LITTLE:
            way = begin + len(moves)
            entries.append(f"{way}, 1, 1.")
            moves.append(f"{way}, 1, 1, {tie.moved:.12g}")
        lines += ["*EQUATION", str(len(entries)), ", ".join(entries)]
    return lines, moves


def abaqus(deck: Deck, format: str) -> str:
    """Keywords that Abaqus and CalculiX share; Abaqus takes hybrid bricks."""
    bricks, body = deck.bricks, deck.body
    kind = "C3D20RH" if format == "abaqus" else "C3D20R"
    lines = ["*HEADING", deck.heading, "*NODE, NSET=SOLID", *_places(bricks.nodes, 1)]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=SOLID")
    for i, cell in enumerate(bricks.cells):
        numbers = [str(n + 1) for n in cell]
        lines += [f"{i + 1}, {', '.join(numbers[:10])},", ", ".join(numbers[10:])]
    for what, faces in (("PRESSED", bricks.pressed), ("OUTER", bricks.touching if body is not None else {})):
        for side, elements in faces.items():
            lines += _lines(f"*ELSET, ELSET={what}{side + 1}", elements + 1)
    for what, _, nodes in bricks.held:
        lines += _lines(f"*NSET, NSET={what}", nodes + 1)
    lines += ["*MATERIAL, NAME=SILICONE", *_hyperelastic(deck.material, PROGRAMS[format])]
    lines += ["*SOLID SECTION, ELSET=SOLID, MATERIAL=SILICONE"]
    moves: list[str] = []
    if body is not None:
        first, begin = len(bricks.nodes) + 1, len(bricks.cells) + 1
        lines += ["*NODE, NSET=OBJECT", *_places(body.nodes, first), "*ELEMENT, TYPE=C3D8, ELSET=OBJECT"]
        lines += [f"{begin + i}, {', '.join(str(first + n) for n in cell)}" for i, cell in enumerate(body.cells)]
        lines += ["*MATERIAL, NAME=HARD", "*ELASTIC", "1000., 0.3", "*SOLID SECTION, ELSET=OBJECT, MATERIAL=HARD"]
        equations, moves = _equations(deck, first + len(body.nodes))
        lines += equations
        stiffness = 100 * float(deck.material.shear_modulus()) / MPa / deck.thick
        lines += ["*SURFACE, NAME=TOUCHING", *(f"OUTER{side + 1}, S{side + 1}" for side in bricks.touching)]
        lines += ["*SURFACE, NAME=TOUCHED", "OBJECT, S1"]
        lines += ["*SURFACE INTERACTION, NAME=SMOOTH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
        lines += [f"{stiffness:.6g}" + (", 1.e-6" if format == "calculix" else "")]
        lines += ["*CONTACT PAIR, INTERACTION=SMOOTH, TYPE=SURFACE TO SURFACE", "TOUCHING, TOUCHED"]
    lines.append("*BOUNDARY")
    for what, axes, _ in bricks.held:
        lines += [f"{what}, {axis + 1}, {axis + 1}" for axis in axes]
    if body is not None:
        lines += [f"OBJECT, {axis + 1}, {axis + 1}" for axis in body.held]
    if moves:
        lines.append("WAYS, 2, 3")
    lines += [
        f"*STEP, NLGEOM{'=YES' if format == 'abaqus' else ''}, INC=1000",
        "*STATIC",
        f"{1 / STEPS:.6g}, 1., 1e-6, {2 / STEPS:.6g}",
    ]
    if moves:
        lines += ["*BOUNDARY", *moves]
    lines += ["*DLOAD", *(f"PRESSED{side + 1}, P{side + 1}, {deck.pressure:.9g}" for side in bricks.pressed)]
    if format == "abaqus":
        lines += ["*OUTPUT, FIELD", "*NODE OUTPUT", "U, RF"]
    else:
        lines += ["*NODE FILE", "U", "*NODE PRINT, NSET=SOLID", "U"]
        for what, axes, _ in bricks.held:
            lines += [f"*NODE PRINT, NSET={what}, TOTALS=YES", "RF"] if not axes else []
        if body is not None:
            lines += ["*NODE PRINT, NSET=OBJECT, TOTALS=YES", "U, RF"]
    return "\n".join([*lines, "*END STEP", ""])


def _silicone(material: Material) -> str:
    """FEBio's material, MPa."""
    bulk = BULK * float(material.shear_modulus()) / MPa
    if isinstance(material, NeoHookean):
        c1, c2 = float(material.mu) / MPa / 2, 0.0
    elif isinstance(material, MooneyRivlin):
        c1, c2 = float(material.c1) / MPa, float(material.c2) / MPa
    else:
        raise _no_law(material, "FEBio", "NeoHookean and MooneyRivlin")
    return (
        '<material id="1" name="silicone" type="Mooney-Rivlin">'
        f"<c1>{c1:.10g}</c1><c2>{c2:.10g}</c2><k>{bulk:.10g}</k></material>"
    )


def _mesh(nodes: np.ndarray, cells: np.ndarray, name: str, kind: str, node: int, element: int) -> list[str]:
    """A part's nodes and elements, numbered from `node` and `element`."""
    return [
        f'<Nodes name="{name}">',
        *(f'<node id="{node + i}">{x:.9g},{y:.9g},{z:.9g}</node>' for i, (x, y, z) in enumerate(nodes)),
        "</Nodes>",
        f'<Elements type="{kind}" name="{name}">',
        *(f'<elem id="{element + i}">{",".join(str(node + n) for n in cell)}</elem>' for i, cell in enumerate(cells)),
        "</Elements>",
    ]


def _surface(name: str, quads: list[np.ndarray], kind: str, node: int) -> list[str]:
    faces = [f'<{kind} id="{i + 1}">{",".join(str(node + n) for n in quad)}</{kind}>' for i, quad in enumerate(quads)]
    return [f'<Surface name="{name}">', *faces, "</Surface>"]


def _constraint(node: int, axis: int, others: list[tuple[int, int, float]], moved: float) -> str:
    children = "".join(
        f"<child_dof><node>{other + 1}</node><dof>{'xyz'[along]}</dof><value>{by:.12g}</value></child_dof>"
        for other, along, by in others
        if abs(by) > LITTLE
    )
    offset = f'<offset lc="1">{moved:.12g}</offset>' if abs(moved) > LITTLE else ""
    return f'<bc type="linear constraint"><node>{node + 1}</node><dof>{"xyz"[axis]}</dof>{offset}{children}</bc>'


def febio(deck: Deck, format: str) -> str:
    """FEBio's XML, version 4.0."""
    bricks, body = deck.bricks, deck.body
    rigid = body is not None and not deck.ties
    out = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<febio_spec version="4.0">',
        f"<!-- {deck.heading} -->",
        '<Module type="solid"/>',
        "<Control><analysis>STATIC</analysis>",
        f"<time_steps>{STEPS}</time_steps><step_size>{1 / STEPS:.6g}</step_size>",
        '<solver type="solid"><symmetric_stiffness>non-symmetric</symmetric_stiffness></solver>',
        '<time_stepper type="default"><dtmin>1e-5</dtmin><dtmax>0.1</dtmax>',
        "<max_retries>20</max_retries></time_stepper>",
        "</Control>",
        "<Material>",
        _silicone(deck.material),
    ]
    if rigid:
        out.append('<material id="2" name="object" type="rigid body"><density>1</density></material>')
    elif body is not None:
        out.append('<material id="2" name="object" type="neo-Hookean"><E>1000</E><v>0.3</v></material>')
    out += ["</Material>", "<Mesh>", *_mesh(bricks.nodes, bricks.cells, "solid", "hex20", 1, 1)]
    first, begin = len(bricks.nodes) + 1, len(bricks.cells) + 1
    if body is not None:
        out += _mesh(body.nodes, body.cells, "object", "hex8", first, begin)
        if not rigid:
            numbers = ",".join(str(first + i) for i in range(len(body.nodes)))
            out.append(f'<NodeSet name="OBJECT">{numbers}</NodeSet>')
    for what, _, nodes in bricks.held:
        out.append(f'<NodeSet name="{what}">{",".join(str(n + 1) for n in nodes)}</NodeSet>')
    for what, faces in (("pressed", bricks.pressed), ("outer", bricks.touching if body is not None else {})):
        quads = [cell[AROUND[side]] for side, elements in faces.items() for cell in bricks.cells[elements]]
        if quads:
            out += _surface(what, quads, "quad8", 1)
    if body is not None:
        out += _surface("object", [cell[[0, 3, 2, 1]] for cell in body.cells], "quad4", first)
        out.append('<SurfacePair name="touch"><primary>outer</primary><secondary>object</secondary></SurfacePair>')
    out += ["</Mesh>", "<MeshDomains>", '<SolidDomain name="solid" mat="silicone"/>']
    if body is not None:
        out.append('<SolidDomain name="object" mat="object"/>')
    out += ["</MeshDomains>", "<Boundary>"]
    held = [(what, axes) for what, axes, _ in bricks.held if axes]
    if body is not None and not rigid:
        held.append(("OBJECT", body.held))
    for what, axes in held:
        dofs = "".join(f"<{d}_dof>{int(i in axes)}</{d}_dof>" for i, d in enumerate("xyz"))
        out.append(f'<bc name="{what}" type="zero displacement" node_set="{what}">{dofs}</bc>')
    out += [_constraint(*tie.node, tie.others, tie.moved) for tie in deck.ties]
    out.append("</Boundary>")
    if rigid:
        fixed = "".join(f"<{d}_dof>1</{d}_dof>" for d in ("Rx", "Ry", "Rz", "Ru", "Rv", "Rw"))
        out.append(f'<Rigid><rigid_bc name="hold" type="rigid_fixed"><rb>object</rb>{fixed}</rigid_bc></Rigid>')
    out += [
        "<Loads>",
        f'<surface_load name="air" type="pressure" surface="pressed"><pressure lc="1">{deck.pressure:.9g}</pressure>'
        "<linear>0</linear></surface_load>",
        "</Loads>",
    ]
    if body is not None:
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
