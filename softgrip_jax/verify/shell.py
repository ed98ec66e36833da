"""The shell's membrane as a solid: a plate 2a x 2b x t_m, clamped along its edges, in free space or against an object.

z = 0 is the outer face of the flat membrane, the air presses on the face z = -t_m, and nodes on the four edges are
held. Where the object is the same on both sides of x = 0 or y = 0, half of the plate is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from .. import pneunet, shell
from ..errors import InputError
from ..shell.energy.scene import EnergyScene
from ..shell.flat_shell import ShellScene
from ..shell.obstacles import Obstacle, Plane
from ..units import mm
from .boxes import divided, facets_on, line, mesh
from .equilibrium import Contact, Model, State, Touch
from .run import Target
from .solid import Solid
from .transfer import gradient_at, place_of

ACROSS, ALONG = 8, 12
"""Cells of a quarter on the first mesh."""
SHORTER = 6.0
"""The cells at the clamp over those in the middle: the plate bends most there."""
PENALTY = 100.0
"""Stiffness of the contact over mu / t_m; multipliers take up what it gives way."""
HALVINGS = 60
"""Of a height: to the last digit."""
MOST = 0.3
"""Of a, for a node in one iteration."""


def is_shell(scene: Any) -> bool:
    """Whether a scene is a membrane."""
    return isinstance(scene, ShellScene | EnergyScene | pneunet.Chamber) and not isinstance(scene, shell.Plate)


class Plate:
    """The solid of a shell's scene on a mesh.

    Args:
        scene: of a shell, or a finger's chamber.
        parts: into how many each cell of the first mesh is divided along each axis.

    Raises:
        InputError: for a chamber whose walls overlap at rest.
    """

    def __init__(self, scene: Any, parts: int = 1):
        self.scene = scene
        if isinstance(scene, pneunet.Chamber):
            finger: Any = scene.finger
            self.material, sizes = finger.material, (finger.b, finger.a, finger.t_m)
            distance, incline = (float(one) for one in scene.nearer_edge())
            if distance < 0:
                raise InputError(f"the walls overlap by {-2 * distance / mm:.4g} mm before there is any pressure.")
            # The chamber's height, along which its wall inclines, is the y axis here.
            height = (distance + float(finger.a) * np.sin(incline)) / np.cos(incline)
            self.obstacle: Obstacle | None = Plane(height, tilt_x=incline) if height > 0 else None
            symmetry = "both" if incline == 0 else "across"
        else:
            membrane = scene.shell
            self.material, sizes = membrane.material, (membrane.a, membrane.b, membrane.t_m)
            energy: Any = scene if isinstance(scene, EnergyScene) else _energy_scene(scene)
            energy = energy.prepared()
            self.obstacle, symmetry = energy.body, energy.symmetry
        a, b, t = (float(size) for size in sizes)
        self.sizes = a, b, t
        self.mirrors = symmetry in ("both", "across"), symmetry in ("both", "along")
        x, y = line(0.0, a, ACROSS, high=SHORTER), line(0.0, b, ALONG, high=SHORTER)
        x, y = (
            points if half else np.concatenate([-points[:0:-1], points])
            for points, half in zip((x, y), self.mirrors, strict=True)
        )
        lines = [divided(points, parts) for points in (x, y, np.array([-t, 0.0]))]
        self.grid = mesh(*lines)
        solid = Solid(self.grid, self.material)
        self.copies = 2 ** sum(self.mirrors)
        X = solid.X
        fixed = np.zeros(X.shape, dtype=bool)
        fixed[(np.abs(X[:, 0]) > a * (1 - 1e-9)) | (np.abs(X[:, 1]) > b * (1 - 1e-9))] = True
        for axis, half in enumerate(self.mirrors):
            if half:
                fixed[np.abs(X[:, axis]) < 1e-9 * a, axis] = True
        free = np.flatnonzero(~fixed.ravel())
        T = sp.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(solid.size, len(free)))
        contact = None
        if self.obstacle is not None:
            outer = solid.faces(facets_on(self.grid, 2, 0.0, t))
            contact = Contact(outer, touch_of(self.obstacle), PENALTY * solid.modulus / t)
        self.model = Model(solid, solid.faces(facets_on(self.grid, 2, -t, t)), T, contact=contact)
        self.most = MOST * a

    def settle(self, target: Target, state: State) -> State:
        """The state itself: nothing but the pressure is asked for."""
        return state

    def follow(self, targets: list[Target]) -> Iterator[State]:
        """States from rest through all targets, at rising pressures."""
        return self.model.follow(self.model.rest(), [(target.pressure, 0.0) for target in targets], self.most)

    def observe(self, state: State) -> dict[str, Any]:
        """What is compared, in SI, by the names of our models' observables."""
        solid, u = self.model.solid, self.model.displacement(state.y)
        t = self.sizes[2]
        middle = np.array([0.0, 0.0, -0.5 * t])
        F = gradient_at(solid, u, middle)
        found: dict[str, Any] = {
            "inflation": float(place_of(solid, u, middle)[2] + 0.5 * t),
            "stretch": float(np.linalg.norm(F[:, 0])),
            "length_stretch": float(np.linalg.norm(F[:, 1])),
        }
        if self.model.contact is not None:
            touch, pressures = self.model.touching(state)
            forces = pressures * self.model.contact.faces.areas
            push = -np.einsum("fp,fpa->a", forces, touch.slope.reshape(*forces.shape, 3)) * self.copies
            for axis, half in enumerate(self.mirrors):
                if half:
                    push[axis] = 0.0
            found["force"] = float(forces.sum() * self.copies)
            found |= {f"force_{name}": float(value) for name, value in zip("xyz", push, strict=True)}
            found["penetration"] = float(max(0.0, -np.min(np.where(pressures.ravel() > 0, touch.gap, 0.0))))
        return found

    def objects(self, n: int = 161) -> list[list[np.ndarray]]:
        """Outlines of what the membrane may touch, across the width and along the length, m: (s, z) up to a height."""
        a, b, t = self.sizes
        views = []
        for axis, size in ((0, a), (1, b)):
            s = np.linspace(-size - 0.5 * a, size + 0.5 * a, n)
            zero = np.zeros_like(s)
            places = (s, zero) if axis == 0 else (zero, s)
            z = np.full_like(s, np.nan) if self.obstacle is None else heights(self.obstacle, *places, 3 * a, 0.5 * t)
            known = np.flatnonzero(np.isfinite(z))
            line = np.stack([s[known], z[known]], axis=1)
            top = np.array([[line[-1, 0], 4 * a], [line[0, 0], 4 * a]]) if len(known) else None
            views.append([np.concatenate([line, top])] if top is not None else [])
        return views

    def profile(self, state: State, n: int = 121) -> dict[str, np.ndarray]:
        """The middle surface across the width (x, z) and along the length (y, z_length) through the middle, and both
        faces, m."""
        solid, u = self.model.solid, self.model.displacement(state.y)
        a, b, t = self.sizes
        found = {}
        for axis, names, size in ((0, ("x", "z"), a), (1, ("y", "z_length"), b)):
            start = 0.0 if self.mirrors[axis] else -size
            for face, height in (("_inner", -t), ("_outer", 0.0)):
                places = np.zeros((n, 3))
                places[:, axis] = np.linspace(start, size, n)
                places[:, 2] = height
                gone = np.stack([place_of(solid, u, place) for place in places])
                s, z = gone[:, axis], gone[:, 2]
                if self.mirrors[axis]:
                    s, z = np.concatenate([-s[:0:-1], s]), np.concatenate([z[:0:-1], z])
                found[names[0] + face], found[names[1] + face] = s, z
        return found


def heights(obstacle: Obstacle, x: np.ndarray, y: np.ndarray, most: float, step: float) -> Float[np.ndarray, " points"]:
    """Where an object begins above places of the membrane, m; NaN where it does not up to a height.

    Args:
        obstacle: the object.
        x, y: places, m, shape (points,).
        most: height up to which it is looked for, m.
        step: between two looks, m; what is thinner may be missed.
    """
    distance = jax.jit(jax.vmap(obstacle.distance))

    def outside(z: np.ndarray) -> np.ndarray:
        return np.asarray(distance(np.stack([x, y, z], axis=1))) > 0

    low, high = np.zeros_like(x), np.full_like(x, np.nan)
    for z in np.arange(0.0, most, step):
        first = ~outside(np.full_like(x, z)) & np.isnan(high)
        low[first], high[first] = z - step, z
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = outside(middle)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high


def _energy_scene(scene: Any) -> Any:
    """The object that a scene touches, as an energy membrane knows it."""
    if isinstance(scene, shell.AxialOffset | shell.CylinderContact | shell.Free | shell.FlatContact | shell.Grasp):
        return scene.energy_scene()
    if isinstance(scene, shell.InclinedContact):
        return scene.energy_scene()
    raise InputError(f"{type(scene).__name__} has no finite elements: its object is not known to the energy membrane.")


def touch_of(obstacle: Obstacle) -> Any:
    """Gaps, their slopes and curvatures at places, by JAX."""

    def parts(place: Any) -> Any:
        return obstacle.distance(place), jax.grad(obstacle.distance)(place), jax.hessian(obstacle.distance)(place)

    together = jax.jit(jax.vmap(parts))

    def touch(places: np.ndarray, shift: float) -> Touch:
        gap, slope, curvature = (np.asarray(part) for part in together(places))
        return Touch(gap, slope, curvature)

    return touch
