"""The cover of a finger as a solid in plane strain: clamped at one end, its tip held at y = 0 and free along x.

The chambers act as a moment on the end section, as in the thesis's beam. The section stays plane and turns by theta
about its middle, (x_t, 0); x_t and the places tau of its nodes along it are unknowns,

    x = (x_t, 0) + tau t,   t = (sin theta, cos theta),   M = dPi/dtheta,   tip force = the sum of reactions along y.

Forces and moments are those of the whole width.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..pneunet.finger import PneuNet
from .boxes import divided, line, mesh
from .equilibrium import Model, NoStateError, State
from .run import Target
from .solid import Solid

ALONG = 16
"""Cells of the first mesh; one across the thickness."""
MOST = 0.15
"""Of L, for a node in one iteration."""
TURN = 0.3
"""rad, in one secant step."""
OUT_OF_BALANCE = 1e-4
"""Of the moment."""
SECANTS = 30


class CoverSolid:
    """A finger's cover under an end moment, on a mesh.

    Args:
        finger: whose cover it is.
        moment: on the end section, N m, positive as the chambers bend it.
        parts: into how many each cell of the first mesh is divided along each axis.
    """

    def __init__(self, finger: PneuNet, moment: float, parts: int = 1):
        f: Any = finger
        L, H, B = (float(getattr(f, name)) for name in ("L", "H", "B"))
        self.finger, self.moment, self.share = finger, moment, B / H
        x, y, z = line(0.0, L, ALONG, 2.0, 2.0), np.array([-0.5 * H, 0.5 * H]), np.array([0.0, H])
        self.grid = mesh(*(divided(places, parts) for places in (x, y, z)))
        solid = Solid(self.grid, f.material)
        X, tiny = solid.X, 1e-9 * L
        fixed = np.zeros(X.shape, dtype=bool)
        fixed[:, 2] = True
        fixed[X[:, 0] < tiny] = True
        self.face = np.flatnonzero(X[:, 0] > L - tiny)
        on_face = np.zeros(X.shape, dtype=bool)
        on_face[self.face] = True
        self.free = np.flatnonzero(~(fixed | on_face).ravel())
        self.slides = self.face[np.abs(X[self.face, 1]) > tiny]
        self.angle = 0.0
        T, g = self._constraints_of(solid, 0.0)
        self.model = Model(solid, None, T, g, bent=lambda angle: self._constraints_of(solid, angle))
        self.most = MOST * L

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        """n and t of the end section."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([c, -s]), np.array([s, c])

    def _constraints_of(self, solid: Solid, angle: float) -> tuple[Any, np.ndarray]:
        """T and g: free displacements, then the section's nodes along t, then its middle along x."""
        self.angle = angle
        _, t = self._axes()
        count, face, slides = len(self.free), self.face, self.slides
        own, last = count + np.arange(len(slides)), np.full(len(face), count + len(slides))
        rows = np.concatenate([self.free, 3 * slides, 3 * slides + 1, 3 * face])
        columns = np.concatenate([np.arange(count), own, own, last])
        one = np.ones(len(slides))
        values = np.concatenate([np.ones(count), t[0] * one, t[1] * one, np.ones(len(face))])
        T = sp.csr_matrix((values, (rows, columns)), shape=(solid.size, count + len(slides) + 1))
        g = np.zeros_like(solid.X)
        X = solid.X[face]
        g[face, :2] = X[:, 1:2] * t - X[:, 1:2] * np.array([0.0, 1.0])
        return T, g.ravel()

    def follow(self, targets: list[Target]) -> Iterator[State]:
        """The state of the one target: from rest, until the end moment is reached."""
        try:
            yield self.settle(targets[0], self.model.rest())
        except NoStateError:
            return

    def settle(self, target: Target, state: State) -> State:
        """By secants of the angle; the pressure in the chambers acts through the moment alone."""
        f: Any = self.finger
        rigidity = float(f.material.shear_modulus()) * float(f.B) * float(f.H) ** 3 / 3
        slope = 4 * rigidity / float(f.L)
        moment = self.observe(state)["moment"] if state.bend else 0.0
        for _ in range(SECANTS):
            if state.bend and abs(moment - self.moment) < OUT_OF_BALANCE * abs(self.moment):
                return State(target.pressure, state.y, state.q, None, state.bend)
            ahead = float(np.clip((self.moment - moment) / slope, -TURN, TURN))
            *_, found = [None, *self.model.follow(state, [(state.pressure, state.bend + ahead)], self.most)]
            if found is None:
                raise NoStateError("the cover does not bend so far")
            now = self.observe(found)["moment"]
            if (now - moment) / ahead <= 0:
                raise NoStateError("the moment has its largest value")
            slope, state, moment = (now - moment) / ahead, found, now
        raise NoStateError("the cover does not bend so far")

    def observe(self, state: State) -> dict[str, float]:
        """Tip force, tip angle, place of the tip, and the moment on the end section, in SI."""
        self.model.at(state.bend)
        n, t = self._axes()
        u = self.model.displacement(state.y)
        reactions = self.model.balance(state, matrix=False).reactions.reshape(-1, 3)[self.face, :2]
        places = (self.model.solid.X + u)[self.face, :2]
        x_t = float(self.finger.L + state.y[-1])
        tau = (places - np.array([x_t, 0.0])) @ t
        return {
            "tip_force": self.share * float(reactions[:, 1].sum()),
            "tip_angle": state.bend,
            "moment": self.share * float(np.sum(reactions @ n * tau)),
        }
