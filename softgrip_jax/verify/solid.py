"""Finite elements of a nearly incompressible solid: 27-node hexahedra with a linear pressure in each (Q2/P1).

The energy is that of Stretches with the pressure q as a second unknown,

    Pi(u, q) = integral of W(F) + q (J - 1) - q^2 / (2 K) dV,

q linear in each element and apart from its neighbours', so that it is eliminated there (a stable pair, Boffi, Brezzi,
Fortin, Mixed Finite Element Methods and Applications, 8.6). Shape functions and quadrature are scikit-fem's.

Libraries that were looked at: FElupe has this element, and is GPL; scikit-fem leaves hyperelasticity to its user.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ..materials.base import Material
from .stretches import Stretches

BULK = 2000.0
"""Bulk modulus over the shear modulus: four times less changes moments of a finger's cell by 0.15 %."""
ELEMENTS = 128
"""At once: the memory for what is not kept stays below 50 MB."""
NODES = 27

_EPS = np.zeros((3, 3, 3))
_EPS[0, 1, 2] = _EPS[1, 2, 0] = _EPS[2, 0, 1] = 1.0
_EPS[0, 2, 1] = _EPS[2, 1, 0] = _EPS[1, 0, 2] = -1.0
_DCOF = np.einsum("ace,JLM->eMaJcL", _EPS, _EPS).reshape(9, 81)
"""d cof(F)_aJ / dF_cL, linear in F_eM."""


class Faces(NamedTuple):
    """Quadrature points on faces of elements.

    Args:
        elements: the element behind each face, shape (faces,).
        values: of the shape functions, shape (faces, points, nodes).
        gradients: of them, 1/m, shape (faces, points, nodes, 3).
        normals: out of the solid at rest, shape (faces, points, 3).
        areas: of the points at rest, m^2, shape (faces, points).
    """

    elements: Int[np.ndarray, " faces"]
    values: Float[np.ndarray, "faces points nodes"]
    gradients: Float[np.ndarray, "faces points nodes 3"]
    normals: Float[np.ndarray, "faces points 3"]
    areas: Float[np.ndarray, "faces points"]


class Solid:
    """The elements of a mesh, with what they know of their shape.

    Args:
        mesh: hexahedra of scikit-fem, lengths in m.
        material: of the solid.
    """

    def __init__(self, mesh: Any, material: Material):
        from skfem import CellBasis, ElementHex2

        basis: Any = CellBasis(mesh, ElementHex2(), intorder=5)
        self.mesh, self.material = mesh, material
        self.X = np.ascontiguousarray(basis.doflocs.T)
        self.cells = np.ascontiguousarray(basis.element_dofs.T)
        self.weights = np.asarray(basis.dx)
        count, points = self.weights.shape
        self.points = points
        G = np.stack([np.broadcast_to(b[0].grad, (3, count, points)) for b in basis.basis])  # node, J, element, point
        self.G = np.ascontiguousarray(G.transpose(2, 0, 3, 1).reshape(count, NODES, points * 3))
        self.modulus = float(material.shear_modulus())
        self.bulk = BULK * self.modulus
        self.law = Stretches(material)
        # Legendre's linear functions of each box, orthogonal under the quadrature.
        places = np.asarray(basis.global_coordinates())  # 3, element, point
        corners = mesh.p[:, mesh.t]
        middle, half = corners.mean(axis=1), 0.5 * (corners.max(axis=1) - corners.min(axis=1))
        self.boxes = middle.T, half.T
        local = (places - middle[:, :, None]) / half[:, :, None]
        self.psi = np.concatenate([np.ones((1, count, points)), local]).transpose(1, 2, 0)
        self.mass = np.einsum("eq,eqk->ek", self.weights, self.psi**2)
        self._pattern()

    @property
    def size(self) -> int:
        """How many numbers the displacement has."""
        return 3 * len(self.X)

    def _pattern(self) -> None:
        """Where each entry of the elements' matrices goes in a sparse matrix."""
        self.dofs = (3 * self.cells[:, :, None] + np.arange(3)).reshape(len(self.cells), -1).astype(np.int32)
        rows, columns = np.repeat(self.dofs, 81, axis=1).ravel(), np.tile(self.dofs, (1, 81)).ravel()
        ones = sp.coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(self.size, self.size))
        pattern = ones.tocsr()
        pattern.sort_indices()
        key = pattern.copy()
        key.data = np.arange(pattern.nnz, dtype=np.int64)
        self.indptr, self.indices = pattern.indptr, pattern.indices
        # Position of (row, column): rows are sorted, so a search in row * size + column finds it.
        row_of = np.repeat(np.arange(self.size, dtype=np.int64), np.diff(pattern.indptr))
        keys = row_of * self.size + pattern.indices
        self.place = np.searchsorted(keys, rows.astype(np.int64) * self.size + columns).astype(np.int32)

    def matrix(self, blocks: Float[np.ndarray, "elements 81 81"]) -> sp.csr_matrix:
        """The sum of the elements' matrices."""
        data = np.bincount(self.place, weights=blocks.ravel(), minlength=len(self.indices))
        return sp.csr_matrix((data, self.indices, self.indptr), shape=(self.size, self.size))

    def gradients_of(self, u: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "elements points 3 3"]:
        """F at all quadrature points."""
        local = np.swapaxes(u[self.cells], 1, 2)  # element, a, node
        H = (local @ self.G).reshape(len(self.cells), 3, self.points, 3)
        return np.eye(3) + H.transpose(0, 2, 1, 3)

    def assemble(
        self, u: Float[np.ndarray, "nodes 3"], q: Float[np.ndarray, "elements 4"], tangent: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, Any]:
        """Residuals and matrices of all elements, with the pressures eliminated.

        Returns:
            The forces of elements on their nodes before (N, shape (elements, 81)) and after the elimination, their
            matrices (N/m, shape (elements, 81, 81)), and what `pressures` needs.
        """
        count, points = self.weights.shape
        plain = np.zeros((count, 81))
        force = np.zeros((count, 81))
        blocks = np.zeros((count, 81, 81)) if tangent else None
        B_all, r_all = np.zeros((count, 81, 4)), np.zeros((count, 4))
        for begin in range(0, count, ELEMENTS):
            part = slice(begin, begin + ELEMENTS)
            F = self._F(u, part)
            n = len(F)
            w, psi, G = self.weights[part], self.psi[part], self.G[part]
            pressure = np.einsum("eqk,ek->eq", psi, q[part])
            flat = F.reshape(-1, 3, 3)
            law = self.law(flat, pressure.ravel(), tangent)
            J = np.linalg.det(flat).reshape(n, points)
            cof = (J[..., None, None] * np.swapaxes(np.linalg.inv(F), 2, 3)).transpose(0, 1, 3, 2)  # J, a
            P = law.stress.reshape(n, points, 3, 3).transpose(0, 1, 3, 2) * w[..., None, None]
            plain[part] = (G @ P.reshape(n, points * 3, 3)).reshape(n, 81)
            weighted = (w[..., None] * psi)[:, :, None, None, :] * cof[..., None]  # point, J, a, k
            B = (G @ weighted.reshape(n, points * 3, 12)).reshape(n, 81, 4)
            r = np.einsum("eqk,eq->ek", psi, w * (J - 1)) - self.mass[part] * q[part] / self.bulk
            stiff = self.bulk / self.mass[part]
            force[part] = plain[part] + (B @ (stiff * r)[..., None])[..., 0]
            B_all[part], r_all[part] = B, r
            if blocks is None or law.tangent is None:
                continue
            A = law.tangent.reshape(n, points, 3, 3, 3, 3) * w[..., None, None, None, None]  # J a, L c
            rows = np.ascontiguousarray(A.transpose(0, 1, 2, 3, 5, 4)).reshape(n, points, 27, 3)  # J a c, L
            Y = rows @ G.reshape(n, NODES, points, 3).transpose(0, 2, 3, 1)  # J a c, node
            K = (G @ Y.reshape(n, points * 3, 9 * NODES)).reshape(n, NODES, 3, 3, NODES)  # node, a, c, node
            K = K.transpose(0, 1, 2, 4, 3).reshape(n, 81, 81)
            blocks[part] = K + (B * stiff[:, None, :]) @ np.swapaxes(B, 1, 2)
        return plain, force, blocks, (B_all, r_all)

    def _F(self, u: np.ndarray, part: slice) -> np.ndarray:
        local = np.swapaxes(u[self.cells[part]], 1, 2)
        H = (local @ self.G[part]).reshape(len(local), 3, self.points, 3)
        return np.eye(3) + H.transpose(0, 2, 1, 3)

    def pressures(self, kept: Any, step: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "elements 4"]:
        """The change of the pressures (Pa) that goes with a step of the displacement."""
        B, r = kept
        local = step.reshape(-1)[self.dofs]
        return self.bulk / self.mass * (r + np.einsum("enk,en->ek", B, local))

    def gather(self, forces: Float[np.ndarray, "elements 81"]) -> Float[np.ndarray, " numbers"]:
        """Forces of elements as one vector."""
        return np.bincount(self.dofs.ravel(), weights=forces.ravel(), minlength=self.size)

    def faces(self, chosen: Int[np.ndarray, " faces"], order: int = 5) -> Faces:
        """Quadrature points on facets of the mesh, given by their numbers."""
        from skfem import ElementHex2, FacetBasis

        basis: Any = FacetBasis(self.mesh, ElementHex2(), facets=chosen, intorder=order)
        shape = basis.dx.shape
        values = np.stack([np.broadcast_to(np.asarray(b[0]), shape) for b in basis.basis], axis=-1)
        grads = np.stack([np.broadcast_to(b[0].grad, (3, *shape)) for b in basis.basis], axis=-1).transpose(1, 2, 3, 0)
        normals = np.asarray(basis.normals).transpose(1, 2, 0)
        return Faces(np.asarray(basis.tind), values, grads, normals, np.asarray(basis.dx))

    def at(self, faces: Faces, u: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "faces points 3"]:
        """Where the points of faces are, m."""
        return np.einsum("fpn,fna->fpa", faces.values, (self.X + u)[self.cells[faces.elements]])

    def push(
        self, faces: Faces, u: Float[np.ndarray, "nodes 3"], tangent: bool = True
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """What a unit pressure on faces does, following them: residuals (m^2, shape (faces, 81)) and their derivatives.

        The force is -p cof(F) N dA; its derivative is made symmetric, which it is as a whole where edges of the faces
        are held or lie in planes of symmetry.
        """
        F = np.eye(3) + np.einsum("fna,fpnJ->fpaJ", u[self.cells[faces.elements]], faces.gradients)
        J = np.linalg.det(F)
        cof = J[..., None, None] * np.swapaxes(np.linalg.inv(F), 2, 3)
        pull = np.einsum("fpaJ,fpJ->fpa", cof, faces.normals) * faces.areas[..., None]
        force = np.einsum("fpn,fpa->fna", faces.values, pull).reshape(-1, 81)
        if not tangent:
            return force, None
        D = (F.reshape(-1, 9) @ _DCOF).reshape(*F.shape[:2], 3, 3, 3, 3)
        D = np.einsum("fpaJcL,fpJ->fpacL", D, faces.normals * faces.areas[..., None])
        Z = np.einsum("fpacL,fpmL->fpacm", D, faces.gradients)
        K = np.einsum("fpn,fpacm->fnamc", faces.values, Z).reshape(-1, 81, 81)
        return force, 0.5 * (K + np.swapaxes(K, 1, 2))
