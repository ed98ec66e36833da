"""A whole finger by three-dimensional finite elements, beside the beam with the cell law.

    python -m benchmarks.whole_finger [--chambers 12] [--parts 1] [--cells 1]

Chambers, walls, rims and cover of type A are one solid, half of it by symmetry; nothing is assumed of how a segment
bends. Neighbouring walls press on each other at pairs of points that face each other, without friction, along the
normal of the cover's section in the middle of their gap. The clamp is a plane of symmetry: the first wall presses on
it. At the tip a plate, which keeps to the plane that fits the cover's last section best, takes the last wall's push.
The tip's middle is held at y = 0 by a stiff spring, whose force is the tip force, or is free.

It prints each state as it is found, and writes the table of docs/theory/cell.md to benchmarks/cell/whole_finger.csv at
the end. A state of twelve chambers takes six minutes.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import itertools
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

import softgrip_jax as sg
from softgrip_jax.pneunet.cell.form import TOP
from softgrip_jax.units import N, kPa
from softgrip_jax.verify.boxes import divided, facets_on, line, mesh
from softgrip_jax.verify.cell import CELLS, MOST, SHORTER
from softgrip_jax.verify.equilibrium import Balance, Model, State
from softgrip_jax.verify.solid import Solid

PRESSURES = (5, 10, 15, 20, 25, 31)
"""kPa."""
PENALTY = 100.0
"""Stiffness of the contact over mu / t_m."""
SPRING = 1e5
"""Of the tip, N/m: a force of 0.5 N moves it by 5 micrometres."""
TABLE = Path(__file__).parent / "cell" / "whole_finger.csv"


class Gap(NamedTuple):
    """Pairs of points across a gap."""

    apart: Any
    """Sparse, points x nodes: what lies behind the gap less what lies before it; with the places, the way across."""
    areas: np.ndarray
    """Of the points at rest, m^2."""
    cut: np.ndarray
    """Nodes of the cover's section in the middle of the gap."""
    plate: bool = False
    """Whether a plate in the section's plane is what lies behind."""


class WholeFinger(Model):
    """A uniform finger of some chambers, clamped at x = 0.

    Args:
        finger: its length is that of whole segments.
        parts: into how many each cell of the mesh is divided along each axis.
        cells: cells of the mesh along each wall and gap.
        held: whether the tip's middle stays at y = 0.
    """

    def __init__(self, finger: Any, parts: int, cells: int, held: bool):
        a, b, t, h_x, h_L, H, B = (float(getattr(finger, name)) for name in ("a", "b", "t_m", "h_x", "h_L", "H", "B"))
        pitch = h_L + 2 * h_x
        chambers = round(float(finger.L) / pitch)
        self.finger, self.held = finger, held
        x1, x2 = 0.5 * h_L - t, 0.5 * h_L
        y1, y2, y3 = 0.5 * H, 0.5 * H + 2 * a, 0.5 * H + 2 * a + TOP * B
        tiny = 1e-9 * B

        def between(*places: float) -> np.ndarray:
            lines = [line(low, high, cells)[:-1] for low, high in itertools.pairwise(places)]
            return np.append(np.concatenate(lines), places[-1])

        segment = between(-0.5 * pitch, -x2, -x1, x1, x2, 0.5 * pitch)
        x = np.append(np.concatenate([(k + 0.5) * pitch + segment[:-1] for k in range(chambers)]), chambers * pitch)
        y = np.concatenate(
            [
                line(-0.5 * H, y1, CELLS["cover"])[:-1],
                line(y1, y2, CELLS["cavity"], SHORTER, SHORTER)[:-1],
                line(y2, y3, CELLS["top"]),
            ]
        )
        z = np.concatenate([line(0.0, b, CELLS["inside"], high=SHORTER)[:-1], line(b, 0.5 * B, CELLS["side"])])

        def from_middle(m: np.ndarray) -> np.ndarray:
            return np.abs(np.mod(m[0], pitch) - 0.5 * pitch)

        def keep(m: np.ndarray) -> np.ndarray:
            s = from_middle(m)
            return (m[1] < y1) | ((s < x2) & ~((s < x1) & (m[1] < y2) & (m[2] < b)))

        grid = mesh(*(divided(places, parts) for places in (x, y, z)), keep=keep)
        solid = Solid(grid, finger.material)
        X = solid.X

        def inside(m: np.ndarray) -> np.ndarray:
            return (from_middle(m) < x1 + tiny) & (m[1] > y1 - tiny) & (m[1] < y2 + tiny) & (m[2] < b + tiny)

        middles = (np.arange(chambers) + 0.5) * pitch
        planes = [(0, place) for middle in middles for place in (middle - x1, middle + x1)]
        pressed = np.concatenate([facets_on(grid, *plane, B, inside) for plane in [*planes, (1, y1), (1, y2), (2, b)]])

        fixed = np.zeros(X.shape, dtype=bool)
        fixed[np.abs(X[:, 0]) < tiny, 0] = True
        fixed[np.abs(X[:, 2]) < tiny, 2] = True
        fixed[(np.abs(X[:, 0]) < tiny) & (np.abs(X[:, 1]) < tiny), 1] = True
        assert np.any(fixed[:, 1]), "the mesh has nodes at mid-height"
        free = np.flatnonzero(~fixed.ravel())
        T = sp.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(solid.size, len(free)))
        super().__init__(solid, solid.faces(pressed), T)

        def points(place: float) -> tuple[Any, np.ndarray]:
            """Of a wall's outer face: the matrix that gives places from those of nodes, and areas, in one order."""
            faces = solid.faces(facets_on(grid, 0, place, B, lambda m: m[1] > y1))
            at = solid.at(faces, np.zeros_like(X)).reshape(-1, 3)
            order = np.lexsort(np.round(at[:, 1:] / B, 9).T)
            nodes = np.repeat(solid.cells[faces.elements], faces.values.shape[1], axis=0)
            rows = np.repeat(np.arange(len(at)), nodes.shape[1])
            matrix: Any = sp.csr_matrix(
                (faces.values.reshape(len(at), -1).ravel(), (rows, nodes.ravel())), shape=(len(at), len(X))
            )
            return matrix[order], faces.areas.ravel()[order]

        self.gaps: list[Gap] = []
        for k in range(chambers + 1):
            cut = np.flatnonzero(np.abs(X[:, 0] - k * pitch) < tiny)
            before = points(k * pitch - h_x) if k else None
            behind = points(k * pitch + h_x) if k < chambers else None
            areas = (before or behind)[1]  # type: ignore[index]
            apart: Any = sp.csr_matrix((len(areas), len(X)))
            apart = apart + behind[0] if behind else apart
            apart = apart - before[0] if before else apart
            self.gaps.append(Gap(apart.tocsr(), areas, cut, plate=behind is None))
        self.stiffness = PENALTY * solid.modulus / t
        to_x, to_y = (sp.csr_matrix(np.eye(3)[axis : axis + 1]) for axis in (0, 1))
        self._along = []
        for gap in self.gaps:
            apart = gap.apart
            if gap.plate:
                middle = sp.csr_matrix(
                    (np.full(len(gap.cut), 1 / len(gap.cut)), (np.zeros(len(gap.cut), int), gap.cut)), (1, len(X))
                )
                apart = apart + sp.csr_matrix(np.ones((len(gap.areas), 1))) @ middle
            self._along.append((sp.kron(apart, to_x).tocsr(), sp.kron(apart, to_y).tocsr()))
        self.most = MOST * a

    # --- the sections of the cover ------------------------------------------------------------------------------------

    def section(self, cut: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Of the plane that fits a section best: middle, turn (rad, positive anticlockwise), slopes of the turn by the
        places of the nodes, shape (nodes, 2)."""
        height = self.solid.X[cut, 1]
        height = height - height.mean()
        way = height @ places[cut, :2]
        turn = float(np.arctan2(-way[0], way[1]))
        slopes = height[:, None] * np.array([-way[1], way[0]]) / (way @ way)
        return places[cut, :2].mean(axis=0), turn, slopes

    def gap_values(self, index: int, places: np.ndarray) -> tuple[np.ndarray, Any, Any, Any]:
        """Gaps (m), their slopes by all displacements, and what second slopes consist of: the slope of the section's
        turn, and those of the points' ways along the section, which become gaps as it turns."""
        gap = self.gaps[index]
        middle, turn, slopes = self.section(gap.cut, places)
        columns = 3 * gap.cut[:, None] + [0, 1]
        if index == 0:
            turn, slopes = 0.0, 0 * slopes
        n, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        way = (gap.apart @ places)[:, :2] + (middle if gap.plate else 0.0)
        along_x, along_y = self._along[index]
        turning: Any = sp.csr_matrix(
            (slopes.ravel(), (np.zeros(slopes.size, int), columns.ravel())), (1, self.solid.size)
        )
        B = along_x * n[0] + along_y * n[1] + sp.csr_matrix((way @ across)[:, None]) @ turning
        return way @ n, B.tocsr(), turning, (along_x * across[0] + along_y * across[1]).tocsr()

    # --- equilibrium --------------------------------------------------------------------------------------------------

    def rest(self) -> State:
        return State(0.0, np.zeros(self.T.shape[1]), np.zeros((len(self.solid.cells), 4)))

    def tip(self, u: np.ndarray) -> float:
        """How far the tip's middle has moved up, m."""
        return float(u[self.gaps[-1].cut, 1].mean())

    def contact_forces(self, state: State) -> np.ndarray:
        """Of each gap, N, of the whole width."""
        places = self.solid.X + self.displacement(state.y)
        found = []
        for k, gap in enumerate(self.gaps):
            values = self.gap_values(k, places)[0]
            found.append(2 * float(gap.areas @ np.maximum(0.0, -self.stiffness * values)))
        return np.array(found)

    def balance(self, state: State, matrix: bool = True) -> Balance:
        now = super().balance(state, matrix)
        u = self.displacement(state.y)
        places, forces = self.solid.X + u, np.zeros(self.solid.size)
        added: list[Any] = []
        for k, gap in enumerate(self.gaps):
            values, B, turning, across = self.gap_values(k, places)
            pressing = np.flatnonzero(values < 0)
            B, stiff = B[pressing], self.stiffness * gap.areas[pressing]
            forces += B.T @ (stiff * values[pressing])
            if matrix:
                moved: Any = sp.csr_matrix((stiff * values[pressing]) @ across[pressing])
                added += [B.T @ sp.diags(stiff) @ B, moved.T @ turning, turning.T @ moved]
        if self.held:
            row = np.zeros(self.solid.size)
            row[3 * self.gaps[-1].cut + 1] = 1 / len(self.gaps[-1].cut)
            forces += SPRING * self.tip(u) * row
            line_: Any = sp.csr_matrix(row)
            added.append(SPRING * (line_.T @ line_))
        residual = now.residual + self.Tt @ forces
        whole = now.matrix + (self.Tt @ sum(added) @ self.T).tocsr() if matrix else None
        return now._replace(residual=residual, reactions=now.reactions, matrix=whole)

    def tip_force(self, state: State) -> float:
        """On what holds the tip, N, of the whole width."""
        return 2 * SPRING * abs(self.tip(self.displacement(state.y)))

    def tip_angle(self, state: State) -> float:
        """rad, positive as the chambers bend."""
        return -self.section(self.gaps[-1].cut, self.solid.X + self.displacement(state.y))[1]


def beam(finger: Any, held: bool, drive: str) -> Any:
    """The same finger as a beam without weight."""
    scene: Any = sg.pneunet.TipContact if held else sg.pneunet.Free
    return scene(finger, drive=drive, weight=None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--chambers", type=int, default=12)
    parser.add_argument("--parts", type=int, default=1)
    parser.add_argument("--cells", type=int, default=1)
    parser.add_argument("--no-table", action="store_true", help="do not write the table")
    options = parser.parse_args()
    base: Any = sg.PneuNet.table_5_1("A")
    finger = dataclasses.replace(base, L=options.chambers * base.pitch)
    rows = []
    for held in (False, True):
        start = time.perf_counter()
        model = WholeFinger(finger, options.parts, options.cells, held)
        print(f"{model.T.shape[1]} unknowns, tip {'held' if held else 'free'}", flush=True)
        for state in model.follow(model.rest(), [(p * kPa, 0.0) for p in PRESSURES], model.most):
            walls = model.contact_forces(state)
            row: dict[str, Any] = {
                "tip": "held" if held else "free",
                "chambers": options.chambers,
                "parts": options.parts,
                "pressure_kPa": round(state.pressure / kPa, 9),
                "tip_angle_deg": np.degrees(model.tip_angle(state)),
                "tip_force_N": model.tip_force(state) / N if held else None,
            }
            for drive in ("cell", "thesis"):
                found = sg.solve(beam(finger, held, drive), state.pressure)
                row[f"tip_angle_deg_{drive}"] = np.degrees(abs(float(found.tip_angle)))
                row[f"tip_force_N_{drive}"] = float(found.tip_force) if held else None
            rows.append(row)
            print(
                *(f"{k} {v:.4f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()),
                f"contact forces of the first and last walls {walls[1]:.4f} and {walls[-2]:.4f} N",
                f"{time.perf_counter() - start:.0f} s",
                flush=True,
            )
    if not options.no_table:
        with TABLE.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            for row in rows:
                writer.writerow({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})


if __name__ == "__main__":
    main()
