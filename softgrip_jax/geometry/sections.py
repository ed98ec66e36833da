"""A solved scene as flat sections: outlines by what they are of, forces, and nothing of how they are drawn.

In goes a `Solution`, out comes one `Section` per view; renderers (pages in a browser, reports) give each role its look.
Lengths are in mm.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..pneunet.finger_scene import FingerScene
from ..pneunet.grasp import Grasp as FingerGrasp
from ..pneunet.linear import Linear
from ..pneunet.wall.arc import Chamber
from ..results import Solution, Status
from ..shell.arc.cylinder import AxialOffset, CylinderContact
from ..shell.arc.flat import FlatContact
from ..shell.arc.grasp import Grasp as ShellGrasp
from ..shell.arc.inclined import InclinedContact
from ..shell.energy.scene import EnergyScene
from ..shell.flat_shell import ShellScene
from ..units import mm
from .finger import (
    Line,
    band,
    boxes,
    chamber_places,
    chambers_of,
    clamp_angle,
    contacts,
    line_of,
    object_outline,
    plate_radius,
    straight,
    touching_point,
)
from .walls import TOUCHES, pressed_outline, thick, wall_behind

ROLES = ("object", "ghost", "air", "body", "wall", "tight", "membrane", "cover", "face", "edge", "contact", "axis")
"""From the back to the front. Areas: object, ghost (without pressure), air, body (what is rigid), wall, tight (walls
that do not fit), membrane, cover; lines: face (the outer face of a membrane), edge, contact, axis."""
LINES = ("face", "edge", "contact", "axis")
"""Roles that are lines; the ghost is the outline of an area, or a line."""

RIM = 4.0
"""mm of the rigid shell that is shown around and under a membrane."""
POINTS = 301
"""Points on a membrane."""
ARROW, WITHIN = 14.0, 0.75
"""mm: length of the arrow of a force, whatever its size; at most this part of the object's radius."""
ENERGY_TOUCHES = 0.04
"""As TOUCHES: arcs lie exactly on an object, the energy membrane nearly so: its polynomials leave up to 0.035 t_m free
between the points where they press (shell of the thesis on a plane, 6 to 20 kPa)."""
GRID = (161, 81)
"""Points along and up, between which the outline of an object is interpolated that is known by its distance."""


@dataclasses.dataclass(frozen=True)
class Outline:
    """An area by its outline, or a line.

    Args:
        role: what it is, one of ROLES.
        points: of it, mm, shape (n, 2).
        across: how far it extends to both sides of the view, in the units of the axes, mm; 0 where that is not known.

    Examples:
        >>> sg.geometry.Outline("edge", np.zeros((2, 2))).points.shape
        (2, 2)
    """

    role: str
    points: np.ndarray
    across: float = 0.0


@dataclasses.dataclass(frozen=True)
class Force:
    """An arrow, with what is written beside it.

    Args:
        start, end: the points that it goes from and to, mm, shape (2,).
        text: beside it.

    Examples:
        >>> sg.geometry.Force(np.zeros(2), np.ones(2), "1 N").text
        '1 N'
    """

    start: np.ndarray
    end: np.ndarray
    text: str


@dataclasses.dataclass(frozen=True)
class Section:
    """One view of a solved scene.

    Args:
        horizontal, vertical: labels of the axes, with their units.
        outlines: areas and lines; their roles are those of ROLES.
        forces: arrows.
        directions: in which the horizontal and the vertical of the view point in the space of the mesh: unit vectors,
            dimensionless.
        origin: where the view's own is in that space, mm, shape (3,).
        fingers: so many stand around the vertical axis in space, each as the right half of the view shows one; 0 where
            the view is one plane in space.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> views = sg.geometry.sections(sg.solve(sg.shell.Free(shell), 15 * kPa))
        >>> [view.horizontal for view in views]
        ['along the length, y (mm)', 'across the width, x (mm)']
    """

    horizontal: str
    vertical: str
    outlines: tuple[Outline, ...]
    forces: tuple[Force, ...] = ()
    directions: tuple[tuple[float, float, float], tuple[float, float, float]] = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fingers: int = 0

    def of_role(self, role: str) -> list[np.ndarray]:
        """The points of all outlines of a role."""
        return [one.points for one in self.outlines if one.role == role]

    def limits(self) -> tuple[float, float, float, float]:
        """The least and the largest x, then y, of all that is in the view, mm."""
        points = [one.points for one in self.outlines] + [np.stack([f.start, f.end]) for f in self.forces]
        every = np.concatenate(points)
        (left, low), (right, high) = every.min(axis=0), every.max(axis=0)
        return float(left), float(right), float(low), float(high)

    def in_space(self, points: np.ndarray) -> list[np.ndarray]:
        """Points of one outline in the space of the mesh, mm, shape (n, 3): once, or once for each finger that stands
        around the axis, and then never for what is left of it.

        Args:
            points: (horizontal, vertical, distance to the side of the view), mm, shape (n, 3); NaN parts lines.
        """
        directions = np.array(self.directions)
        frames = [directions]
        if self.fingers:
            turns = 2 * np.pi * np.arange(self.fingers) / self.fingers if np.nanmean(points[:, 0]) > 0 else []
            frames = [np.array([[np.cos(turn), np.sin(turn), 0.0], directions[1]]) for turn in turns]
        return [self.origin + points @ np.array([*frame, np.cross(*frame)]) for frame in frames]


def sections(solution: Solution) -> tuple[Section, ...]:
    """The flat views of one solved scene.

    Args:
        solution: of one scene, not a batch.

    Returns:
        One `Section` per view.

    Raises:
        InputError: for a batch, a state that is not OK, or a scene without a picture.

    Examples:
        >>> finger = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"))
        >>> [view] = sg.geometry.sections(sg.solve(finger, 31 * kPa))
        >>> len(view.of_role("air"))  # chambers
        12
    """
    if np.ndim(solution.status):
        raise InputError("This solution is a batch; draw one scene of it.")
    if int(solution.status) != Status.OK:
        raise InputError(f"There is no state to draw: {Status(int(solution.status)).message}.")
    for kind, draw in _VIEWS.items():
        if isinstance(solution.scene, kind):
            return draw(solution)
    raise InputError(f"There is no picture of a {type(solution.scene).__name__} yet.")


def rectangle(x: float, y: float, width: float, height: float) -> np.ndarray:
    """Corners of a rectangle from its lower left one."""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def circle(x: float, y: float, radius: float, count: int = 120) -> np.ndarray:
    """Points on a circle."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)


def runs(points: np.ndarray, where: np.ndarray) -> list[np.ndarray]:
    """The parts of a line in which a condition holds, each of two points or more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(int)))
    return [points[i:j] for i, j in zip(edges[::2], edges[1::2], strict=True) if j - i > 1]


def _newton(force: Any) -> str:
    return f"{abs(float(force)):.3g} N"


# --- fingers ----------------------------------------------------------------------------------------------------------


def _finger_parts(solution: Solution, line: Line, where: Callable[[np.ndarray], np.ndarray]) -> list[Outline]:
    """A finger without pressure and under it, each point placed by `where`."""
    finger, chambers = solution.scene.finger, chambers_of(solution, line)
    rest, thickness = straight(finger, clamp_angle(solution.scene)), float(finger.H) / mm
    places, half = [chamber.place for chamber in chambers], 0.5 * float(finger.B) / mm
    each = zip(boxes(rest, finger, places), places, strict=True)
    parts = [Outline("ghost", where(box), place.fields["b"] / mm) for box, place in each]
    ends = {name: values[[0, -1]] for name, values in rest.items()}
    parts.append(Outline("ghost", where(band(ends, thickness)), half))
    touching = [np.zeros(0, bool), *contacts(chambers)]
    for chamber, touches in zip(chambers, touching[: len(chambers)], strict=True):
        role = "wall" if chamber.place.fits else "tight"
        parts.append(Outline("air", where(chamber.outline())))
        parts += [Outline(role, where(body)) for body in chamber.walls]
        width = chamber.place.fields["b"] / mm
        parts += [Outline("contact", where(run), width) for run in runs(chamber.near_clamp, touches)]
    parts.append(Outline("cover", where(band(line, thickness)), half))
    return parts


def _as_is(points: np.ndarray) -> np.ndarray:
    return points


def _finger(solution: Solution) -> tuple[Section, ...]:
    scene: Any = solution.scene
    finger, line, angle = scene.finger, line_of(solution), clamp_angle(solution.scene)
    parts = _finger_parts(solution, line, _as_is)
    highest = max((place.height for place in chamber_places(finger)), default=0.0)
    along, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    foot, top = -0.5 * float(finger.H) / mm - 4, highest + 6.5
    clamp = np.array([foot * normal, top * normal, top * normal - 4 * along, foot * normal - 4 * along])
    parts.append(Outline("body", clamp))
    forces = []
    if isinstance(scene, FingerScene) and scene.tip() is not None:
        tip = np.array([line["x"][-1], line["y"][-1]])
        force = float(solution.tip_force)
        forces.append(Force(tip, tip + np.array([0.0, -ARROW if force >= 0 else ARROW]), _newton(force)))
    return (Section("along the finger, x (mm)", "y (mm)", tuple(parts), tuple(forces)),)


def _grasp(solution: Solution) -> tuple[Section, ...]:
    """Two fingers of the gripper, turned into one plane where none is opposite, and the object between them."""
    scene: Any = solution.scene
    line = line_of(solution)
    base, tip = float(scene.gripper.midline_radius()) / mm, touching_point(scene, line)
    edge = np.array(object_outline(scene, tip))
    both = np.concatenate([edge, edge[::-1] * [-1, 1]])
    parts = [Outline("object", both), Outline("axis", np.array([[0.0, 6.0], [0.0, both[:, 1].min() - 4]]))]
    forces = []
    for side in (1, -1):

        def where(points: np.ndarray, side=side) -> np.ndarray:
            return np.stack([side * (base + points[:, 1]), -points[:, 0]], axis=-1)

        parts += _finger_parts(solution, line, where)
        at = where(tip[None])[0]
        length = min(ARROW, WITHIN * (base + tip[1]))
        forces.append(Force(at, at - [side * length, 0.0], _newton(solution.tip_force)))
    reach = plate_radius(scene)
    parts.append(Outline("body", rectangle(-reach, 0.0, 2 * reach, 6.0)))
    labels = ("distance from the axis (mm)", "height (mm)")
    return (Section(*labels, tuple(parts), tuple(forces), fingers=scene.gripper.n),)


def _chamber(solution: Solution) -> tuple[Section, ...]:
    """Two neighbouring walls across their gap, in the frame of the plane between them."""
    scene: Any = solution.scene
    near, lean = (float(v) for v in scene.nearer_edge())
    now = pressed_outline(float(scene.finger.a), near, lean, float(solution.clamp_angle)) / mm
    depth, parts = float(scene.finger.h_L) / mm, []
    along = (now[-1] - now[0]) / np.linalg.norm(now[-1] - now[0])
    back = depth * np.array([along[1], -along[0]])
    wall = wall_behind(now, float(scene.finger.t_m) / mm / float(solution.stretch) ** 2)
    span = now[-1, 1]
    for side in (-1, 1):

        def where(points: np.ndarray, side=side) -> np.ndarray:
            height = span - points[:, 1] if float(scene.inclination) < 0 else points[:, 1]
            return np.stack([side * points[:, 0], height], axis=-1)

        parts += [
            Outline("air", where(np.concatenate([now, [now[-1] + back, now[0] + back]]))),
            Outline("wall", where(wall)),
            Outline("ghost", where(now[[0, -1]])),
        ]
        parts += [Outline("contact", where(run)) for run in runs(now, now[:, 0] < TOUCHES)]
    reach = 0.55 * float(np.max(np.abs(now[:, 0] + depth)))
    forces = [Force(np.array([s * reach, span / 2]), np.array([0, span / 2]), _newton(solution.force)) for s in (-1, 1)]
    labels = ("along the finger, from the plane of contact (mm)", "height of the wall (mm)")
    return (Section(*labels, tuple(parts), tuple(forces)),)


# --- shells -----------------------------------------------------------------------------------------------------------

LENGTH, WIDTH, HEIGHT = "along the length, y (mm)", "across the width, x (mm)", "z (mm)"
DIRECTIONS = {LENGTH: ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), WIDTH: ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))}
"""Of the views of a membrane in space."""


@jax.jit
def _stretches(scene: Any, unknowns: Any) -> Any:
    return scene.stretches(unknowns)


def thickness_of(solution: Solution) -> float:
    """Of a stretched membrane, mm: its material keeps its volume, t_m / (lambda_1 lambda_2)."""
    scene: Any = solution.scene
    across, lengthwise = _stretches(scene, solution.unknowns)
    return float(scene.shell.t_m) / mm / float(across * lengthwise)


def _shell(solution: Solution) -> tuple[Section, ...]:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    views = [] if isinstance(solution.scene, InclinedContact) else [(LENGTH, "length", shape["y"], shape["z_length"])]
    views.append((WIDTH, "width", shape["x"], shape["z"]))
    return tuple(_shell_view(solution, *view) for view in views)


def _shell_view(solution: Solution, label: str, view: str, s: np.ndarray, z: np.ndarray) -> Section:
    scene: Any = solution.scene
    half, beside = (float(v) / mm for v in _half_sizes(scene.shell, view == "length"))
    thickness = thickness_of(solution)
    # Across the width the membrane is shown where it touches a cylinder, which need not be in its middle.
    on_cylinder = view == "width" and isinstance(scene, CylinderContact | AxialOffset | ShellGrasp)
    face = np.stack([s, z], axis=-1)
    held, away = _touched(solution, view, half, face)
    parts = [Outline("object", held)] if held is not None else []
    parts += [
        Outline("body", rectangle(-half - RIM, -RIM, 2 * (half + RIM), RIM)),
        Outline("ghost", np.array([[-half, 0.0], [half, 0.0]]), 0.0 if on_cylinder else beside),
        Outline("membrane", thick(face, thickness)),
        Outline("face", face),
    ]
    on = runs(face, away < TOUCHES * thickness)
    parts += [Outline("contact", run) for run in on]
    forces = []
    if on and "force" in solution.observables:
        where = np.concatenate(on)
        middle = np.array([where[:, 0].mean(), where[:, 1].max()])
        forces.append(Force(middle, middle + ARROW * _normal(scene, view), _newton(solution.force)))
    middle = float(scene.shell.b) / mm - axis_height(solution) if on_cylinder else 0.0
    return Section(label, HEIGHT, tuple(parts), tuple(forces), DIRECTIONS[label], (0.0, middle, 0.0))


def _half_sizes(shell: Any, is_length: bool) -> tuple[Any, Any]:
    """Half the sizes of a membrane along a view and across it, m."""
    return (shell.b, shell.a) if is_length else (shell.a, shell.b)


def _normal(scene: Any, view: str) -> np.ndarray:
    """The direction in which a membrane pushes what it touches."""
    if isinstance(scene, InclinedContact) and view == "width":
        return np.array([np.sin(float(scene.angle)), np.cos(float(scene.angle))])
    return np.array([0.0, 1.0])


def _touched(solution: Solution, view: str, half: float, face: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """The outline of what a membrane touches, and the distance of every point of its face from that, mm."""
    scene: Any = solution.scene
    s, z = face.T
    slab = 2 * RIM
    if isinstance(scene, FlatContact):
        height = float(scene.distance) / mm
        return rectangle(-half - RIM, height, 2 * (half + RIM), slab), height - z
    if isinstance(scene, InclinedContact):
        normal = _normal(scene, view)
        along = np.array([normal[1], -normal[0]])
        high = float(np.max(face @ normal))
        corners = [high * normal - 1.3 * half * along, high * normal + 1.3 * half * along]
        return np.array([*corners, corners[1] + slab * normal, corners[0] + slab * normal]), high - face @ normal
    if isinstance(scene, CylinderContact | AxialOffset | ShellGrasp):
        radius, gap = float(scene.radius) / mm, float(scene.gap) / mm
        if view == "width":
            return rectangle(-half - RIM, gap, 2 * (half + RIM), 2 * radius), gap - z
        middle = half - axis_height(solution)
        return circle(middle, gap + radius, radius), np.hypot(s - middle, z - gap - radius) - radius
    return None, np.full(len(face), np.inf)


def axis_height(solution: Solution) -> float:
    """Distance (mm) of a cylinder's axis from the near end of the membrane: b where the state is symmetric."""
    scene: Any = solution.scene
    return float(solution.observables.get("height", getattr(scene, "height", scene.shell.b))) / mm


@jax.jit
def _distances(body: Any, places: Any) -> Any:
    return jax.vmap(body.distance)(places)


def _energy(solution: Solution) -> tuple[Section, ...]:
    shape = {name: np.asarray(v) / mm for name, v in solution.shape(POINTS).items()}
    highest = max(float(np.max(shape[name])) for name in ("z_face", "z_length_face"))
    top = max(1.15 * highest, highest + 2 * RIM)
    views = []
    for label, axis, names in ((LENGTH, 1, ("y", "z_length")), (WIDTH, 0, ("x", "z"))):
        middle, face = (np.stack([shape[name + kind] for name in names], axis=-1) for kind in ("", "_face"))
        views.append(_energy_view(solution, label, axis, middle, face, top))
    return tuple(views)


def _energy_view(
    solution: Solution, label: str, axis: int, middle: np.ndarray, face: np.ndarray, top: float
) -> Section:
    scene: Any = solution.scene
    half, beside = (float(v) / mm for v in _half_sizes(scene.shell, axis == 1))
    thickness = float(scene.shell.t_m) / mm
    # Heights are those of the outer face, from where it is at rest: the middle surface is half the thickness below.
    middle = middle - [0.0, 0.5 * thickness]
    reach = max(half + RIM, float(np.max(np.abs(face[:, 0]))) + RIM)
    parts, forces = [], []
    if scene.body is not None:
        parts += [Outline("object", points) for points in body_section(scene.body, axis, reach, top)]
    parts += [
        Outline("body", rectangle(-half - RIM, -RIM, 2 * (half + RIM), RIM)),
        Outline("ghost", np.array([[-half, 0.0], [half, 0.0]]), beside),
        Outline("membrane", np.concatenate([face, (2 * middle - face)[::-1]])),
        Outline("face", face),
    ]
    if scene.body is not None:
        places = np.zeros((len(face), 3))
        places[:, axis], places[:, 2] = face.T
        on = runs(face, np.asarray(_distances(scene.body, jnp.asarray(places * mm))) / mm < ENERGY_TOUCHES * thickness)
        parts += [Outline("contact", run) for run in on]
        if on and "force" in solution.observables:
            where = np.concatenate(on)
            at = np.array([where[:, 0].mean(), where[:, 1].max()])
            forces.append(Force(at, at + np.array([0.0, ARROW]), _newton(solution.force)))
    return Section(label, HEIGHT, tuple(parts), tuple(forces), DIRECTIONS[label])


def body_section(body: Any, axis: int, reach: float, top: float) -> list[np.ndarray]:
    """Outlines of an object, known by its distance, in the plane x = 0 (axis 1) or y = 0 (axis 0), from -reach to reach
    and from 0 to top, mm."""
    from contourpy import contour_generator  # comes with matplotlib

    across, up = np.linspace(-reach, reach, GRID[0]), np.linspace(0, top, GRID[1])
    places = np.zeros((GRID[1], GRID[0], 3))
    places[..., axis], places[..., 2] = across, up[:, None]
    flat = jnp.asarray(places.reshape(-1, 3) * mm)
    distance = np.asarray(_distances(body, flat)).reshape(GRID[::-1])
    generator: Any = contour_generator(across, up, distance, fill_type="OuterCode")
    return [np.asarray(points) for points in generator.filled(-1e9, 0.0)[0]]


_VIEWS: dict[type, Callable[[Any], tuple[Section, ...]]] = {
    FingerGrasp: _grasp,
    FingerScene: _finger,
    Linear: _finger,
    Chamber: _chamber,
    EnergyScene: _energy,
    ShellScene: _shell,
}


def has_sections(scene: Any) -> bool:
    """Whether `sections` knows this kind of scene.

    Args:
        scene: any scene, as it is solved.

    Examples:
        >>> sg.geometry.has_sections(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A")))
        True
    """
    views = tuple(_VIEWS)
    return isinstance(scene, views) or isinstance(scene.prepared(), views)
