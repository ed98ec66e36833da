"""Half a segment of a uniformly bent finger as a solid: chamber, wall, side wall, top wall and cover.

x runs along the finger from the middle of a chamber (symmetry) to the middle of a gap, y up from the cover's
mid-height, z across from the middle (symmetry) to the side. The plane in the middle of the gap turns by phi = kappa x_B
about the cover's mid-height at x = 0 and moves along its normal n: the cut of the cover stays in it, and the wall may
press on it without friction, as its neighbour does by symmetry. With the distance c of the plane,

    x = c n + tau t  on the cut,   gap = c - n x  of the wall,   N = dPi/dc = 0,   M_ext = dPi/dphi.

Forces and moments are those of the whole width.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..pneunet.cell.form import TOP
from ..pneunet.finger import PneuNet
from .boxes import divided, facets_on, line, mesh
from .equilibrium import Contact, Model, NoStateError, State, Touch
from .run import Target
from .solid import Solid

CELLS = {"cover": 1, "cavity": 4, "top": 1, "inside": 3, "side": 1}
"""Of the first mesh, along y and z; along x there is one in the chamber, one in the wall, one in the gap."""
SHORTER = 3.0
"""The cells at the wall's edges over those in its middle."""
PENALTY = 100.0
"""Stiffness of the contact over mu / t_m."""
MOST = 0.3
"""Of a, for a node in one iteration."""
NO_MOMENT = 3e-4
"""Of the blocked moment: what is left where a cell bends freely."""
SECANTS = 12


class CellSolid:
    """A finger's cell on a mesh.

    Args:
        finger: a uniform finger.
        parts: into how many each cell of the first mesh is divided along each axis.

    Raises:
        InputError: where no such solid can be made of the finger.
    """

    def __init__(self, finger: PneuNet, parts: int = 1):
        if finger.segments is not None:
            raise InputError("the finger has segments of its own; finite elements are there for uniform fingers.")
        f: Any = finger
        a, b, t, h_x, h_L, H, B = (float(getattr(f, name)) for name in ("a", "b", "t_m", "h_x", "h_L", "H", "B"))
        for name, rule, true in (
            ("h_x", "more than 0: neighbouring walls need a gap", h_x > 0),
            ("t_m", f"less than half of h_L ({0.5e3 * h_L:.4g} mm): a chamber has two walls", t < 0.5 * h_L),
            ("b", f"less than half of B ({0.5e3 * B:.4g} mm): a chamber has side walls", b < 0.5 * B),
        ):
            if not true:
                raise InputError(f"PneuNet.{name} is {1e3 * float(getattr(f, name)):.4g} mm; it must be {rule}.")
        self.finger = finger
        x1, x2, x_B = 0.5 * h_L - t, 0.5 * h_L, 0.5 * h_L + h_x
        y1, y2, y3 = 0.5 * H, 0.5 * H + 2 * a, 0.5 * H + 2 * a + TOP * B
        self.x_B = x_B
        x = np.array([0.0, x1, x2, x_B])
        y = np.concatenate(
            [
                line(-0.5 * H, y1, CELLS["cover"])[:-1],
                line(y1, y2, CELLS["cavity"], SHORTER, SHORTER)[:-1],
                line(y2, y3, CELLS["top"]),
            ]
        )
        z = np.concatenate([line(0.0, b, CELLS["inside"], high=SHORTER)[:-1], line(b, 0.5 * B, CELLS["side"])])

        def keep(m: np.ndarray) -> np.ndarray:
            return (m[1] < y1) | ((m[0] < x2) & ~((m[0] < x1) & (m[1] < y2) & (m[2] < b)))

        self.grid = mesh(*(divided(places, parts) for places in (x, y, z)), keep=keep)
        solid = Solid(self.grid, f.material)
        X, tiny = solid.X, 1e-9 * B

        def inside(m: np.ndarray) -> np.ndarray:
            return (m[0] < x1 + tiny) & (m[1] > y1 - tiny) & (m[1] < y2 + tiny) & (m[2] < b + tiny)

        pressed = [(0, x1), (1, y1), (1, y2), (2, b)]
        walls = np.concatenate([facets_on(self.grid, axis, place, B, inside) for axis, place in pressed])
        outer = facets_on(self.grid, 0, x2, B, lambda m: m[1] > y1)
        fixed = np.zeros(X.shape, dtype=bool)
        fixed[np.abs(X[:, 0]) < tiny, 0] = True
        fixed[np.abs(X[:, 2]) < tiny, 2] = True
        fixed[int(np.argmin(np.sum(X**2, axis=1))), 1] = True
        self.face = np.flatnonzero(np.abs(X[:, 0] - x_B) < tiny)
        on_face = np.zeros(X.shape, dtype=bool)
        on_face[self.face, :2] = True
        self.free = np.flatnonzero(~(fixed | on_face).ravel())
        self.middle = int(np.argmin(np.abs(X[self.face, 1]) * 1e3 + X[self.face, 2]))
        contact = Contact(solid.faces(outer), self._touch, PENALTY * solid.modulus / t)
        self.phi = 0.0
        T, g = self._constraints_of(solid, 0.0)
        self.model = Model(
            solid, solid.faces(walls), T, g, contact, shift=True, bent=lambda bend: self._constraints_of(solid, bend)
        )
        self.most = MOST * a

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        """n and t of the plane in the gap."""
        c, s = np.cos(self.phi), np.sin(self.phi)
        return np.array([c, -s, 0.0]), np.array([s, c, 0.0])

    def _constraints_of(self, solid: Solid, bend: float) -> tuple[Any, np.ndarray]:
        """T and g: free displacements, then the cut's nodes along t, then the plane along n."""
        self.phi = bend * self.x_B
        n, t = self._axes()
        count, face = len(self.free), self.face
        own, last = count + np.arange(len(face)), np.full(len(face), count + len(face))
        rows = np.concatenate([self.free, 3 * face, 3 * face + 1, 3 * face, 3 * face + 1])
        columns = np.concatenate([np.arange(count), own, own, last, last])
        one = np.ones(len(face))
        values = np.concatenate([np.ones(count), t[0] * one, t[1] * one, n[0] * one, n[1] * one])
        T = sp.csr_matrix((values, (rows, columns)), shape=(solid.size, count + len(face) + 1))
        g = np.zeros_like(solid.X)
        g[face, :2] = (self.x_B * n + solid.X[face, 1:2] * t - solid.X[face])[:, :2]
        return T, g.ravel()

    def _touch(self, places: np.ndarray, shift: float) -> Touch:
        n, _ = self._axes()
        return Touch(self.x_B + shift - places @ n, np.broadcast_to(-n, places.shape), None, 1.0)

    def follow(self, targets: list[Target]) -> Iterator[State]:
        """States from rest through all targets."""
        state = self.model.rest()
        for target in targets:
            bend = state.bend if target.curvature is None else target.curvature
            stops = [(target.pressure, bend)]
            found = list(self.model.follow(state, stops, self.most))
            if not found:
                return
            try:
                state = self.settle(target, found[-1])
            except NoStateError:
                return
            yield state

    def settle(self, target: Target, state: State) -> State:
        """The state of a target from one near it: of a free one by secants, where its moment vanishes."""
        if not target.free:
            return state
        f: Any = self.finger
        unit = target.pressure * 4 * float(f.a) * float(f.b) * (float(f.a) + 0.5 * float(f.H))
        slope = float(f.material.shear_modulus()) * float(f.B) * float(f.H) ** 3 / 3
        moment = self.observe(state)["moment"]
        for _ in range(SECANTS):
            if abs(moment) < NO_MOMENT * unit:
                return state
            ahead = float(np.clip(-moment / slope, -0.3 / self.x_B, 0.3 / self.x_B))
            *_, found = [None, *self.model.follow(state, [(state.pressure, state.bend + ahead)], self.most)]
            if found is None:
                raise NoStateError("it does not bend freely")
            now = self.observe(found)["moment"]
            slope = max((now - moment) / ahead, 0.2 * slope)
            state, moment = found, now
        raise NoStateError("it does not bend freely")

    def observe(self, state: State) -> dict[str, float]:
        """Moment about the cover's mid-height, force of the walls, its lever, stretch and curvature, in SI."""
        model, solid = self.model, self.model.solid
        model.at(state.bend)
        n, t = self._axes()
        reactions = model.balance(state, matrix=False).reactions.reshape(-1, 3)[self.face]
        c = self.x_B + float(state.y[-1])
        places = solid.X[self.face] + model.displacement(state.y)[self.face]
        tau = places @ t
        moment = float(np.sum(reactions @ n * tau) - c * np.sum(reactions @ t))
        assert model.contact is not None
        pressures = model.touching(state)[1]
        forces = pressures * model.contact.faces.areas
        heights = solid.at(model.contact.faces, model.displacement(state.y)) @ t
        force, turning = float(forces.sum()), float(np.sum(forces * heights))
        found = {
            "moment": 2 * (moment - turning),
            "contact_force": 2 * force,
            "stretch": c / self.x_B,
            "free_curvature": state.bend,
        }
        if force > 0:
            found["lever_arm"] = turning / force - float(tau[self.middle])
        return found

    def plane(self, state: State) -> np.ndarray:
        """The plane in the gap: two points (x, y), m."""
        self.model.at(state.bend)
        n, t = self._axes()
        top = float(self.model.solid.X[:, 1].max())
        c = self.x_B + float(state.y[-1])
        return np.stack([c * n - 0.3 * top * t, c * n + 1.05 * top * t])[:, :2]

    def section(self, state: State) -> list[np.ndarray]:
        """Outlines of the solid's boxes in the plane z = 0, m: closed lines (x, y)."""
        from .transfer import shape_functions

        model, solid = self.model, self.model.solid
        model.at(state.bend)
        u = model.displacement(state.y)
        ways = np.linspace(-1, 1, 9)
        square = np.concatenate(
            [
                np.stack([ways, -np.ones(9)], axis=1),
                np.stack([np.ones(9), ways], axis=1),
                np.stack([ways[::-1], np.ones(9)], axis=1),
                np.stack([-np.ones(9), ways[::-1]], axis=1),
            ]
        )
        outlines = []
        for element in np.flatnonzero(solid.boxes[0][:, 2] - solid.boxes[1][:, 2] < 1e-9):
            middle, half = (part[element] for part in solid.boxes)
            places = np.concatenate([middle[:2] + square * half[:2], np.zeros((len(square), 1))], axis=1)
            values, _ = shape_functions(solid, int(element), places)
            outlines.append((values @ (solid.X + u)[solid.cells[element]])[:, :2])
        return outlines
