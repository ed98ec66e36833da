"""The deformed gripper in space as one mesh of triangles, and the files that other programs read.

The mesh is in m. A finger is its cover and its chambers with inflated walls, drawn as wide as they are (2b); the model
inflates the walls between chambers, and roofs, floors and sides stay flat in it. Of an arc membrane the model knows two
sections; between them the mesh takes their product, z(x) z(y) / z(0), and that is drawn, not computed. The energy
membrane is the computed surface.
"""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..folders import write_whole
from ..objects.grasped import HexagonalCylinder, ThreeFaceCone
from ..pneunet.finger_scene import FingerScene
from ..pneunet.grasp import Grasp as FingerGrasp
from ..pneunet.linear import Linear
from ..results import Solution, Status
from ..shell.arc.cylinder import AxialOffset, CylinderContact
from ..shell.arc.flat import FlatContact
from ..shell.arc.grasp import Grasp as ShellGrasp
from ..shell.arc.inclined import InclinedContact
from ..shell.energy.scene import EnergyScene
from ..shell.flat_shell import ShellScene
from ..shell.obstacles import Box, Cylinder, Plane, Sphere, direction
from ..units import mm
from .finger import POINTS, band, chambers_of, line_of, object_outline, plate_radius, touching_point
from .sections import RIM, axis_height

ROUND = 48
"""What is round has so many faces."""
WALL_POINTS = 24
"""Points on a wall from the cover to the roof."""
COVER_STEP = 5
"""Of the points along the finger every so many are corners of the cover."""
SURFACE = 61
"""Points along each side of a membrane."""
PLATE = 6.0
"""mm: thickness of the plate that carries the fingers."""

KINDS = ("cover", "chamber", "membrane", "object", "body")
"""What a part can be of; the others of its name are its number."""


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles in space by parts.

    Args:
        points: corners, m, shape (n, 3).
        triangles: three numbers of points each, shape (m, 3).
        part: of each triangle the number of its part, shape (m,).
        names: of the parts: "cover 0", "chamber 0.3" (finger 0, chamber 3), "membrane", "object", "body".
        values: name -> a number per point in SI, shape (n,), for instance the contact pressure (Pa); NaN where there is
            none.

    Examples:
        >>> sol = sg.solve(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=8), 31 * kPa)
        >>> mesh = sol.mesh()
        >>> len(mesh.names), mesh.points.shape[1]  # the cover and 12 chambers
        (13, 3)
        >>> mesh.write("finger.vtk").name
        'finger.vtk'
    """

    points: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    part: Int[np.ndarray, " m"]
    names: tuple[str, ...]
    values: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

    def of_kind(self, kind: str) -> Int[np.ndarray, "k 3"]:
        """The triangles of all parts of a kind, one of KINDS.

        Args:
            kind: "cover", "chamber", "membrane", "object" or "body".
        """
        wanted = [k for k, name in enumerate(self.names) if name.split()[0] == kind]
        return self.triangles[np.isin(self.part, wanted)]

    def volume(self, name: str) -> float:
        """The volume that the surface of a part encloses, m^3: the sum of x . (y cross z) / 6 over its triangles.

        Args:
            name: one of `names`; a membrane is no closed surface.
        """
        if name not in self.names:
            raise InputError(f"There is no part {name!r}; the parts are {', '.join(self.names)}.")
        x, y, z = np.moveaxis(self.points[self.triangles[self.part == self.names.index(name)]], 1, 0)
        return float(np.sum(x * np.cross(y, z)) / 6)

    def write(self, path: str | Path) -> Path:
        """Write a file for ParaView, PyVista, meshio or a slicer.

        Args:
            path: it ends in .vtk (legacy PolyData with parts and values, m), .stl (binary, mm, as printers take it) or
                .obj (m).

        Returns:
            The file.

        Raises:
            InputError: for another ending, and where the file cannot be written; nothing is half written then.
        """
        path = Path(path)
        writers = {".vtk": _vtk, ".stl": _stl, ".obj": _obj}
        if path.suffix.lower() not in writers:
            raise InputError(f"path is {str(path)!r}; it must be a file that ends in .vtk, .stl or .obj.")
        write_whole(path, writers[path.suffix.lower()](self))
        return path

    def to_pyvista(self) -> Any:
        """The mesh as a `pyvista.PolyData`; needs PyVista, which this package does not install."""
        try:
            import pyvista  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise InputError("PyVista is missing: pip install pyvista; mesh.write('x.vtk') needs nothing.") from None
        found = pyvista.PolyData.from_regular_faces(self.points, self.triangles)
        found.cell_data["part"] = self.part
        for name, values in self.values.items():
            found.point_data[name] = values
        return found

    def to_meshio(self) -> Any:
        """The mesh as a `meshio.Mesh`; needs meshio, which this package does not install."""
        try:
            import meshio  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise InputError("meshio is missing: pip install meshio; mesh.write('x.vtk') needs nothing.") from None
        return meshio.Mesh(self.points, [("triangle", self.triangles)], self.values, {"part": [self.part]})


def _vtk(mesh: Mesh) -> bytes:
    """Legacy VTK, binary, which is big-endian."""
    count, faces = len(mesh.points), len(mesh.triangles)
    head = f"# vtk DataFile Version 3.0\nsoftgrip_jax, m; parts: {', '.join(mesh.names)}"[:240]
    out = [f"{head}\nBINARY\nDATASET POLYDATA\nPOINTS {count} double\n".encode(), mesh.points.astype(">f8").tobytes()]
    out += [f"\nPOLYGONS {faces} {4 * faces}\n".encode()]
    out += [np.column_stack([np.full(faces, 3), mesh.triangles]).astype(">i4").tobytes()]
    out += [f"\nCELL_DATA {faces}\nSCALARS part int 1\nLOOKUP_TABLE default\n".encode()]
    out += [mesh.part.astype(">i4").tobytes()]
    if mesh.values:
        out.append(f"\nPOINT_DATA {count}\n".encode())
    for name, values in mesh.values.items():
        out.append(f"SCALARS {name} double 1\nLOOKUP_TABLE default\n".encode())
        out += [values.astype(">f8").tobytes(), b"\n"]
    return b"".join(out)


def _stl(mesh: Mesh) -> bytes:
    corners = mesh.points[mesh.triangles] / mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(size > 0, size, 1.0)
    rows = np.zeros(len(corners), dtype=[("numbers", "<f4", (4, 3)), ("none", "<u2")])
    rows["numbers"] = np.concatenate([normal[:, None], corners], axis=1)
    return b"softgrip_jax, mm".ljust(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def _obj(mesh: Mesh) -> bytes:
    lines = ["# softgrip_jax, m", *(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.points)]
    for k, name in enumerate(mesh.names):
        lines.append(f"g {name.replace(' ', '_')}")
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.triangles[mesh.part == k] + 1]
    return ("\n".join(lines) + "\n").encode()


class _Build:
    """Parts that are added one after the other, in mm."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []
        self.triangles: list[np.ndarray] = []
        self.part: list[np.ndarray] = []
        self.names: list[str] = []
        self.values: dict[str, list[np.ndarray]] = {}
        self.count = 0

    def add(self, name: str, points: np.ndarray, quads: np.ndarray, values: dict[str, np.ndarray] | None = None):
        """Four-cornered faces, each cut into two triangles; those without area are left out."""
        three = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        a, b, c = np.moveaxis(points[three], 1, 0)
        if name != "membrane" and np.sum(a * np.cross(b, c)) < 0:
            three = three[:, ::-1]  # seen from outside, corners go round against the clock
        three = three[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0]
        self.points.append(points)
        self.triangles.append(three + self.count)
        self.part.append(np.full(len(three), len(self.names)))
        self.names.append(name)
        for key in set(self.values) | set(values or {}):
            column = self.values.setdefault(key, [np.full(len(p), np.nan) for p in self.points[:-1]])
            column.append((values or {}).get(key, np.full(len(points), np.nan)))
        self.count += len(points)

    def mesh(self) -> Mesh:
        values = {name: np.concatenate(column) for name, column in self.values.items()}
        points, triangles = np.concatenate(self.points) * mm, np.concatenate(self.triangles)
        return Mesh(points, triangles, np.concatenate(self.part), tuple(self.names), values)


def grid_faces(rows: int, columns: int, close_rows: bool = False, close_columns: bool = False) -> np.ndarray:
    """Faces of points that lie in rows, counted row by row; closed: the last is beside the first."""
    i = np.arange(rows if close_rows else rows - 1)[:, None]
    j = np.arange(columns if close_columns else columns - 1)[None]
    ahead, beside = (i + 1) % rows, (j + 1) % columns
    corners = [i * columns + j, ahead * columns + j, ahead * columns + beside, i * columns + beside]
    return np.stack(np.broadcast_arrays(*corners), axis=-1).reshape(-1, 4)


def _ladder(left: np.ndarray, right: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """A solid between two lines of equally many points (n, 2), from -half to half across: (points (4n, 3), faces).

    The third number of a point is across. Seen against it, `right` is to the right of `left`.
    """
    count = len(left)
    flat = np.concatenate([left, right])
    points = np.concatenate([np.column_stack([flat, np.full(2 * count, side * half)]) for side in (-1, 1)])
    k = np.arange(count - 1)
    near, far = 0, 2 * count
    sides = [
        np.stack([near + k, near + count + k, near + count + k + 1, near + k + 1], axis=-1),  # across = -half
        np.stack([far + k, far + k + 1, far + count + k + 1, far + count + k], axis=-1),  # across = half
        np.stack([near + k, near + k + 1, far + k + 1, far + k], axis=-1),  # left
        np.stack([near + count + k, far + count + k, far + count + k + 1, near + count + k + 1], axis=-1),  # right
    ]
    first = [[0, far, far + count, count]]
    last = [[count - 1, 2 * count - 1, far + 2 * count - 1, far + count - 1]]
    return points, np.concatenate([*sides, first, last])


def evenly(line: np.ndarray, count: int) -> np.ndarray:
    """A line by so many points, evenly spaced along it."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(at, along, values) for values in line.T], axis=-1)


def _add_finger(build: _Build, solution: Solution, number: int, place: Any) -> None:
    """The cover and the chambers of a finger; `place` says where points (along, away, across), mm, are in space."""
    scene: Any = solution.scene
    finger, line = scene.finger, line_of(solution)
    outline = band(line, float(finger.H) / mm)
    outer, inner = outline[:POINTS][::COVER_STEP], outline[POINTS:][::-1][::COVER_STEP]
    points, faces = _ladder(outer, inner, 0.5 * float(finger.B) / mm)
    build.add(f"cover {number}", place(points), faces)
    for k, chamber in enumerate(chambers_of(solution, line)):
        walls = evenly(chamber.near_clamp, WALL_POINTS), evenly(chamber.near_tip, WALL_POINTS)
        points, faces = _ladder(*walls, chamber.place.fields["b"] / mm)
        build.add(f"chamber {number}.{k}", place(points), faces)


def _around(
    build: _Build, name: str, outline: list[tuple[float, float]], corners: int = ROUND, swell: bool = False
) -> None:
    """A body of revolution from (radius, height) pairs, top to bottom; with few corners one of flat faces, whose
    middles are at the radius."""
    grow = 1 / np.cos(np.pi / corners) if swell else 1.0
    angle = (np.arange(corners) + 0.5) * 2 * np.pi / corners
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * grow
    points = np.concatenate([np.column_stack([r * ring, np.full(corners, z)]) for r, z in outline])
    build.add(name, points, grid_faces(len(outline), corners, close_columns=True))


def _finger(solution: Solution) -> Mesh:
    build = _Build()
    _add_finger(build, solution, 0, lambda p: np.stack([p[:, 0], p[:, 2], p[:, 1]], axis=-1) * [1, -1, 1])
    return build.mesh()


def _grasp(solution: Solution) -> Mesh:
    scene: Any = solution.scene
    build = _Build()
    base, tip = float(scene.gripper.midline_radius()) / mm, touching_point(scene, line_of(solution))
    for k in range(scene.gripper.n):
        around = 2 * np.pi * k / scene.gripper.n
        outward, sideways = (
            np.array([np.cos(around), np.sin(around), 0]),
            np.array([-np.sin(around), np.cos(around), 0]),
        )

        def place(p: np.ndarray, outward=outward, sideways=sideways) -> np.ndarray:
            return (base + p[:, 1:2]) * outward - p[:, 2:] * sideways - p[:, :1] * np.array([0.0, 0.0, 1.0])

        _add_finger(build, solution, k, place)
    corners = {HexagonalCylinder: 6, ThreeFaceCone: 3}.get(type(scene.object), ROUND)
    _around(build, "object", object_outline(scene, tip), corners, swell=True)
    reach = plate_radius(scene)
    _around(build, "body", [(0.0, PLATE), (reach, PLATE), (reach, 0.0), (0.0, 0.0)])
    return build.mesh()


def _add_box(build: _Build, name: str, low: Any, high: Any) -> None:
    """A box with faces along the axes."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    flat = np.array([[x0, z0], [x0, z1]]), np.array([[x1, z0], [x1, z1]])
    points, faces = _ladder(*flat, 0.5 * (y1 - y0))
    build.add(name, np.column_stack([points[:, 0], 0.5 * (y0 + y1) - points[:, 2], points[:, 1]]), faces)


def _add_slab(build: _Build, middle: np.ndarray, normal: np.ndarray, half_x: float, half_y: float) -> None:
    """The object as a slab behind a plane through `middle`, whose normal points into it."""
    along = np.array([normal[2], 0.0, -normal[0]]) / np.hypot(normal[0], normal[2])
    left, right = (np.array([[side * half_x, 0.0], [side * half_x, 2 * RIM]]) for side in (-1, 1))
    points, faces = _ladder(left, right, half_y)
    build.add("object", middle + points @ np.array([along, normal, np.cross(along, normal)]), faces)


def _add_obstacle(build: _Build, body: Any, half_x: float, half_y: float) -> None:
    """What an energy membrane touches; what is endless as large as the rigid shell, and of a `Shape`, of which only the
    distance is known, nothing."""
    if not isinstance(body, Plane | Cylinder | Sphere | Box):
        return
    size = {field.name: float(getattr(body, field.name)) for field in dataclasses.fields(body)}
    if isinstance(body, Plane):
        normal = np.asarray(direction(body.tilt_x, body.tilt_y))
        _add_slab(build, np.array([0.0, 0.0, size["height"] / mm]), normal, half_x, half_y)
        return
    turn, rise = size.get("heading", 0.0), size.get("incline", 0.0)
    ahead = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    beside = np.array([-np.sin(turn), np.cos(turn), 0.0])
    deep = size["half_z" if isinstance(body, Box) else "radius"]
    middle = np.array([size["offset_x"], size["offset_y"], size["gap"] + deep]) / mm
    half_length = abs(np.cos(turn)) * half_x + abs(np.sin(turn)) * half_y
    points, faces = _solid(body, half_length)
    build.add("object", middle + points @ np.array([ahead, beside, np.cross(ahead, beside)]), faces)


def _solid(body: Cylinder | Sphere | Box, half_length: float) -> tuple[np.ndarray, np.ndarray]:
    """An object about its middle, with a cylinder's axis along x: (points, faces), mm. The edges of a box are sharp."""
    if isinstance(body, Box):
        x, y, z = (float(half) / mm for half in (body.half_x, body.half_y, body.half_z))
        points, faces = _ladder(np.array([[-x, -z], [-x, z]]), np.array([[x, -z], [x, z]]), y)
        return points[:, [0, 2, 1]], faces
    angle, radius = np.arange(ROUND) * 2 * np.pi / ROUND, float(body.radius) / mm
    if isinstance(body, Cylinder):
        ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        points = np.concatenate([np.column_stack([np.full(ROUND, side * half_length), ring]) for side in (-1, 1)])
        return points, grid_faces(2, ROUND, close_columns=True)
    polar = np.linspace(0.0, np.pi, ROUND // 2 + 1)[:, None]
    rings = [np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar) + 0 * angle]
    return radius * np.stack(rings, axis=-1).reshape(-1, 3), grid_faces(len(polar), ROUND, close_columns=True)


def _shell(solution: Solution) -> Mesh:
    scene: Any = solution.scene
    build = _Build()
    a, b = float(scene.shell.a) / mm, float(scene.shell.b) / mm
    if isinstance(scene, EnergyScene):
        maps = _surface(scene, solution.unknowns, solution.pressure)
        place = np.asarray(maps["place"]).reshape(-1, 3) / mm
        values = {name: np.ravel(maps[name]) for name in ("contact_pressure", "larger_stretch") if name in maps}
        build.add("membrane", place, grid_faces(SURFACE, SURFACE), values)
    else:
        shape = {name: np.asarray(v) / mm for name, v in solution.shape(SURFACE).items()}
        x, z = shape["x"], shape["z"]
        # Of an inclined plane the model has no section along the length: it is drawn like the other one, but symmetric.
        y, z_length = (shape["y"], shape["z_length"]) if "y" in shape else (x * b / a, 0.5 * (z + z[::-1]))
        top = z[SURFACE // 2]
        height = np.outer(z, z_length) / (top if top > 0 else 1.0)
        place = np.stack(np.broadcast_arrays(x[:, None], y[None], height), axis=-1)
        build.add("membrane", place.reshape(-1, 3), grid_faces(SURFACE, SURFACE))
    _add_box(build, "body", (-a - RIM, -b - RIM, -RIM), (a + RIM, b + RIM, 0.0))
    if isinstance(scene, EnergyScene):
        _add_obstacle(build, scene.body, a + RIM, b + RIM)
    elif isinstance(scene, InclinedContact):
        # Where it touches the membrane, as from the side.
        normal = np.array([np.sin(float(scene.angle)), 0.0, np.cos(float(scene.angle))])
        high = float(np.max(x * normal[0] + z * normal[2]))
        _add_slab(build, high * normal, normal, 1.3 * a, b + RIM)
    elif isinstance(scene, FlatContact):
        high = float(scene.distance) / mm
        _add_box(build, "object", (-a - RIM, -b - RIM, high), (a + RIM, b + RIM, high + 2 * RIM))
    elif isinstance(scene, CylinderContact | AxialOffset | ShellGrasp):
        radius, gap = float(scene.radius) / mm, float(scene.gap) / mm
        angle = np.arange(ROUND) * 2 * np.pi / ROUND
        ring = np.stack([b - axis_height(solution) + radius * np.cos(angle), gap + radius + radius * np.sin(angle)], -1)
        rows = [np.column_stack([np.full(ROUND, side * (a + RIM)), ring]) for side in (-1, 1)]
        build.add("object", np.concatenate(rows), grid_faces(2, ROUND, close_columns=True))
    return build.mesh()


@jax.jit
def _surface(scene: Any, unknowns: Any, pressure: Any) -> dict[str, Any]:
    return scene.surface(unknowns, pressure, SURFACE)


_MESHES = {FingerGrasp: _grasp, FingerScene: _finger, Linear: _finger, EnergyScene: _shell, ShellScene: _shell}


def mesh(solution: Solution) -> Mesh:
    """The deformed gripper in space: triangles by parts.

    Args:
        solution: of one scene, not a batch.

    Raises:
        InputError: for a batch, a state that is not OK, or a scene without a mesh.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sol = sg.solve(sg.shell.FlatContact(shell, distance=5 * mm), 15 * kPa)
        >>> sg.geometry.mesh(sol).names
        ('membrane', 'body', 'object')
    """
    if np.ndim(solution.status):
        raise InputError("This solution is a batch; mesh one scene of it.")
    if int(solution.status) != Status.OK:
        raise InputError(f"There is no state to mesh: {Status(int(solution.status)).message}.")
    for kind, make in _MESHES.items():
        if isinstance(solution.scene, kind):
            return make(solution)
    raise InputError(f"There is no mesh of a {type(solution.scene).__name__} yet.")
