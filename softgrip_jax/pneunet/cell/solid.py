"""Half a segment of a bent pneu-net finger as a three-dimensional solid: the reference of the cell law.

The solid goes from the middle of a chamber (x = 0, symmetry) to the middle of a gap, and from the middle of the finger
(z = 0, symmetry) to its side. It has a cover, one wall, a side wall and a top wall, in boxes. In each box the
displacement is a product of polynomials (the p-version of finite elements). The plane in the middle of the gap turns by
phi = kappa x_B about the cover's mid-height: the cut of the cover stays in it, and the wall may press on it without
friction.

    Pi(q; p, phi) = integral of W dV - p V + penalty of the contact,   M = dPi/dphi,   N = dPi/dc

with q the displacements and c the distance of the plane. The volume is kept by a bulk modulus, with fewer quadrature
points than the rest, so that thin walls do not lock.

This module makes the data that the law is fitted to: a state takes one to two seconds on one core.

Libraries that were looked at: scikit-fem (`verify` uses it) has elements of low order and no derivatives by dimensions;
FElupe and JAX-FEM are GPL.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


class Degrees(NamedTuple):
    """Polynomial degrees: along x (chamber, wall, gap), along y (cover, foot of the wall, wall, head of the wall, top),
    along z (wall, edge of the wall, side wall). Foot, head and edge are layers as wide as the wall is thick. More
    numbers along y or z divide the wall between them into equal parts."""

    x: tuple[int, int, int] = (1, 3, 2)
    y: tuple[int, ...] = (2, 3, 5, 3, 2)
    z: tuple[int, ...] = (5, 3, 2)


DEGREES = Degrees()
BULK = 500.0
"""Bulk modulus over mu: four times as much changes the moment by 0.15 %."""
PENALTY = 100.0
"""Contact stiffness over mu / t_m: the wall enters the plane by some thousandths of its thickness."""


class Box(NamedTuple):
    """One element: which segment along each axis, its nodes, and what is known of its shape functions."""

    segment: tuple[int, int, int]
    nodes: np.ndarray
    gradients: np.ndarray
    """Derivatives by the local coordinates in [-1, 1] at the quadrature points, (points, nodes, 3)."""
    weights: np.ndarray
    volume_gradients: np.ndarray
    """... at the points where the volume is kept."""
    volume_weights: np.ndarray


class Face(NamedTuple):
    """One face of a box: quadrature points with values and two tangential derivatives of the shape functions."""

    axis: int
    sign: float
    """-1 where the volume is behind the face as its tangents make the normal."""
    segments: tuple[int, int, int]
    nodes: np.ndarray
    values: np.ndarray
    first: np.ndarray
    second: np.ndarray
    weights: np.ndarray


def lobatto(degree: int) -> np.ndarray:
    """Gauss-Lobatto points in [-1, 1]."""
    inner = np.polynomial.legendre.Legendre.basis(degree).deriv().roots()
    return np.concatenate([[-1.0], np.sort(np.real(inner)), [1.0]])


def lagrange(nodes: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives of the Lagrange polynomials of `nodes` at x, each (len(x), len(nodes))."""
    vander = np.polynomial.legendre.legvander(nodes, len(nodes) - 1)
    inverse = np.linalg.inv(vander)
    derivatives = np.stack([np.polynomial.legendre.Legendre.basis(k).deriv()(x) for k in range(len(nodes))], axis=-1)
    return np.polynomial.legendre.legvander(x, len(nodes) - 1) @ inverse, derivatives @ inverse


class Mesh:
    """The boxes for given degrees; lengths come in later, so that one mesh serves all geometries."""

    def __init__(self, degrees: Degrees = DEGREES, contact_points: tuple[int, int] = (1, 1)):
        self.degrees = degrees
        starts = [np.concatenate([[0], np.cumsum(d)]) for d in degrees]
        counts = [s[-1] + 1 for s in starts]
        grid = np.arange(np.prod(counts)).reshape(counts)
        top, side = len(degrees.y) - 1, len(degrees.z) - 1
        walls, inner = range(1, top), range(side)
        boxes = [(i, 0, k) for i in range(3) for k in range(side + 1)]
        boxes += [(1, j, k) for j in walls for k in inner] + [(i, j, side) for i in range(2) for j in walls]
        boxes += [(i, top, k) for i in range(2) for k in range(side + 1)]

        def nodes_of(box):
            cut = tuple(slice(s[i], s[i + 1] + 1) for s, i in zip(starts, box, strict=True))
            return grid[cut].reshape(-1)

        used = np.unique(np.concatenate([nodes_of(box) for box in boxes]))
        number = np.full(grid.size, -1)
        number[used] = np.arange(len(used))
        self.count = len(used)
        # Place of every node: its segment along each axis and the local coordinate there.
        place = np.stack(np.meshgrid(*[np.arange(c) for c in counts], indexing="ij"), -1).reshape(-1, 3)[used]
        self.segment = np.stack(
            [
                np.minimum(np.searchsorted(s, place[:, j], side="right") - 1, len(degrees[j]) - 1)
                for j, s in enumerate(starts)
            ],
            -1,
        )
        self.local = np.stack(
            [
                np.array(
                    [
                        lobatto(degrees[j][e])[p - starts[j][e]]
                        for e, p in zip(self.segment[:, j], place[:, j], strict=True)
                    ]
                )
                for j in range(3)
            ],
            -1,
        )
        self.boxes = [self._box(box, number[nodes_of(box)]) for box in boxes]

        def on(axis, index):
            return place[:, axis] == index

        self.middle_x, self.middle_z = np.where(on(0, 0))[0], np.where(on(2, 0))[0]
        self.cut = np.where(on(0, counts[0] - 1))[0]
        half = degrees.y[0] // 2
        end = counts[0] - 1
        self.origin, self.middle_of_cut = (int(np.where(on(0, x) & on(1, half) & on(2, 0))[0][0]) for x in (0, end))

        def faces(axis, side, which, more):
            return [self._face(box, axis, side, number[nodes_of(box)], more) for box in which]

        none = (0, 0)
        self.cavity = faces(0, -1, [(1, j, k) for j in walls for k in inner], none)
        self.cavity += faces(1, 1, [(0, 0, k) for k in inner], none) + faces(1, -1, [(0, top, k) for k in inner], none)
        self.cavity += faces(2, -1, [(0, j, side) for j in walls], none)
        # The cavity's outward normal is against the axis on its floor alone.
        self.cavity = [face._replace(sign=-1.0) if face.segments[1] == 0 else face for face in self.cavity]
        self.outer = faces(0, 1, [(1, j, k) for j in walls for k in inner], contact_points)
        self.outer += faces(0, 1, [(1, j, side) for j in walls] + [(1, top, k) for k in range(side + 1)], none)

    def _box(self, box, nodes):
        degrees = [self.degrees[j][i] for j, i in enumerate(box)]
        gradients, weights = [], []
        for more in (1, 0):
            rules = [np.polynomial.legendre.leggauss(d + more) for d in degrees]
            shapes = [lagrange(lobatto(d), rule[0]) for d, rule in zip(degrees, rules, strict=True)]
            parts = []
            for j in range(3):
                f = [shape[1] if i == j else shape[0] for i, shape in enumerate(shapes)]
                parts.append(np.einsum("ai,bj,ck->abcijk", *f).reshape(np.prod([len(v) for v in f]), -1))
            gradients.append(np.stack(parts, -1))
            weights.append(np.einsum("i,j,k->ijk", *[rule[1] for rule in rules]).reshape(-1) / 8)
        return Box(box, nodes, gradients[0], weights[0], gradients[1], weights[1])

    def _face(self, box, axis, side, nodes, more):
        degrees = [self.degrees[j][i] for j, i in enumerate(box)]
        shape = [d + 1 for d in degrees]
        nodes = np.take(nodes.reshape(shape), 0 if side < 0 else -1, axis=axis).reshape(-1)
        # The order (first, second) makes first x second point along +axis.
        one, two = [(1, 2), (2, 0), (0, 1)][axis]
        kept = [j for j in range(3) if j != axis]
        rules = {
            j: np.polynomial.legendre.leggauss(degrees[j] * (1 + m) + 1 + m) for j, m in zip(kept, more, strict=True)
        }
        shapes = {j: lagrange(lobatto(degrees[j]), rules[j][0]) for j in kept}

        def product(which):
            factors = [shapes[j][1] if j == which else shapes[j][0] for j in kept]
            return np.einsum("ai,bj->abij", *factors).reshape(-1, len(nodes))

        weights = np.einsum("i,j->ij", *[rules[j][1] for j in kept]).reshape(-1) / 4
        return Face(axis, 1.0, box, nodes, product(None), product(one), product(two), weights)


class Sizes(NamedTuple):
    """Lengths of one cell; any unit, the same for all (stresses are in units of mu)."""

    a: Any
    b: Any
    t_m: Any
    h_x: Any
    h_L: Any
    H: Any
    B: Any
    top: Any

    def segments(self, degrees: Degrees):
        """Lengths of the segments along x, y, z, and where each axis begins."""
        high, wide = len(degrees.y) - 4, len(degrees.z) - 2
        x = jnp.stack([0.5 * self.h_L - self.t_m, self.t_m * 1.0, self.h_x * 1.0])
        layer = self.t_m * 1.0
        wall = [(2.0 * self.a - 2 * layer) / high] * high
        y = jnp.stack([self.H * 1.0, layer, *wall, layer, self.top * 1.0])
        z = jnp.stack([*[(self.b - layer) / wide] * wide, layer, 0.5 * self.B - self.b])
        return (x, y, z), (0.0, -0.5 * self.H, 0.0)

    @property
    def x_B(self):
        return 0.5 * self.h_L + self.h_x


def neo_hookean(i1, i2):
    """W over mu."""
    return 0.5 * i1


class Solid:
    """One cell's equations. Unknowns: displacements (3 per node) and c at the end; see `to_places`."""

    def __init__(self, mesh: Mesh, energy=neo_hookean, bulk: float = BULK, penalty: float = PENALTY):
        self.mesh, self.energy, self.bulk, self.penalty = mesh, energy, bulk, penalty
        n = mesh.count
        fixed = np.zeros(3 * n + 1, bool)
        fixed[3 * mesh.middle_x] = True
        fixed[3 * mesh.middle_z + 2] = True
        fixed[3 * mesh.origin + 1] = True
        fixed[3 * mesh.cut] = True  # x is given by c and tau
        self.free = np.where(~fixed)[0]
        self.size = len(self.free)

    def nodes(self, sizes: Sizes):
        lengths, begins = sizes.segments(self.mesh.degrees)
        out = []
        for j in range(3):
            start = jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths[j])])[:-1] + begins[j]
            out.append(
                start[self.mesh.segment[:, j]] + 0.5 * (1 + self.mesh.local[:, j]) * lengths[j][self.mesh.segment[:, j]]
            )
        return jnp.stack(out, -1)

    def start(self, sizes: Sizes):
        """Unknowns of the undeformed cell."""
        X = self.nodes(sizes)
        return jnp.concatenate([jnp.reshape(X, -1), jnp.reshape(sizes.x_B * 1.0, 1)])[self.free]

    def to_places(self, q, sizes, phi):
        """Deformed places of the nodes: linear in q."""
        X = self.nodes(sizes)
        full = jnp.concatenate([jnp.reshape(X, -1), jnp.zeros(1)]).at[3 * self.mesh.middle_x].set(0.0)
        full = full.at[3 * self.mesh.middle_z + 2].set(0.0).at[3 * self.mesh.origin + 1].set(0.0)
        full = full.at[self.free].set(q)
        c, y = full[-1], full[:-1].reshape(-1, 3)
        cut = self.mesh.cut
        tau = y[cut, 1]
        cos, sin = jnp.cos(phi), jnp.sin(phi)
        y = y.at[cut, 0].set(c * cos + tau * sin).at[cut, 1].set(-c * sin + tau * cos)
        return y, c

    # ------------------------------------------------------------------------------------------ parts of the energy
    def density(self, F):
        """Isochoric energy at a point, over mu."""
        C = F.T @ F
        third = _det(F) ** (-2.0 / 3.0)
        b1 = jnp.trace(C) * third
        b2 = 0.5 * (b1 * b1 - jnp.sum(C * C) * third * third)
        return self.energy(b1 - 3, b2 - 3)

    def boxes(self, y, sizes):
        """Gradients of shape functions of every box at both sets of points, its volume, and F at all points of all
        boxes, in one array each: one evaluation of the energy serves all."""
        lengths, _ = sizes.segments(self.mesh.degrees)
        parts = []
        for box in self.mesh.boxes:
            sides = jnp.stack([lengths[j][box.segment[j]] for j in range(3)])
            G, V = jnp.asarray(box.gradients) * (2 / sides), jnp.asarray(box.volume_gradients) * (2 / sides)
            volume = sides[0] * sides[1] * sides[2]
            parts.append((G, V, volume * box.weights, volume * box.volume_weights))
        sets = [
            jnp.concatenate(
                [
                    jnp.einsum("ai,qaI->qiI", y[box.nodes], part[k])
                    for box, part in zip(self.mesh.boxes, parts, strict=True)
                ]
            )
            for k in (0, 1)
        ]
        return parts, *sets

    def strain_energy(self, y, sizes):
        parts, F, FV = self.boxes(y, sizes)
        weights, volumes = (jnp.concatenate([part[k] for part in parts]) for k in (2, 3))
        shear = jnp.sum(weights * jax.vmap(self.density)(F))
        return shear + 0.5 * self.bulk * jnp.sum(volumes * (jax.vmap(_det)(FV) - 1) ** 2)

    def pressures(self, q, sizes, phi, move=None):
        """K (J - 1) at the volume points; with a move of q, to first order from the state before it."""

        def of(q):
            y, _ = self.to_places(q, sizes, phi)
            return self.bulk * (jax.vmap(_det)(self.boxes(y, sizes)[2]) - 1)

        if move is None:
            return of(q)
        value, change = jax.jvp(of, (q,), (move,))
        return value + change

    def cavity(self, y):
        """Volume enclosed with the planes of symmetry."""
        total = 0.0
        for face in self.mesh.cavity:
            r = face.values @ y[face.nodes]
            normal = jnp.cross(face.first @ y[face.nodes], face.second @ y[face.nodes]) * 4
            total += face.sign * jnp.sum(face.weights * jnp.sum(r * normal, -1)) / 3
        return total

    def pressing(self, y, c, sizes, phi):
        """Gap at the contact points, their weights times the stiffness, and their height along the plane."""
        lengths, _ = sizes.segments(self.mesh.degrees)
        gaps, weights, heights = [], [], []
        for face in self.mesh.outer:
            r = face.values @ y[face.nodes]
            area = lengths[1][face.segments[1]] * lengths[2][face.segments[2]]
            gaps.append(c - r[:, 0] * jnp.cos(phi) + r[:, 1] * jnp.sin(phi))
            weights.append(area * face.weights * self.penalty / sizes.t_m)
            heights.append(r[:, 0] * jnp.sin(phi) + r[:, 1] * jnp.cos(phi))
        return jnp.concatenate(gaps), jnp.concatenate(weights), jnp.concatenate(heights)

    def loads_energy(self, y, c, sizes, p, phi):
        gap, weight, _ = self.pressing(y, c, sizes, phi)
        return 0.5 * jnp.sum(weight * jnp.minimum(gap, 0.0) ** 2) - p * self.cavity(y)

    def total(self, q, sizes, p, phi, n=0.0):
        """Pi over mu, of the half width; n: axial force of the half width."""
        y, c = self.to_places(q, sizes, phi)
        return self.strain_energy(y, sizes) + self.loads_energy(y, c, sizes, p, phi) - n * c

    # ------------------------------------------------------------------------------------------------- derivatives
    def hessian(self, q, pressures, sizes, p, phi):
        """d2Pi/dq2, dense, in free unknowns; `pressures` stand for K (J - 1) in it, see `newton`."""
        n = self.mesh.count
        y, c = self.to_places(q, sizes, phi)
        K = jnp.zeros((3 * n + 1, 3 * n + 1))
        parts, F, FV = self.boxes(y, sizes)
        weights, volumes = (jnp.concatenate([part[k] for part in parts]) for k in (2, 3))
        A = jax.vmap(jax.hessian(self.density))(F) * weights[:, None, None, None, None]
        AV = jax.vmap(jax.hessian(_det))(FV) * (volumes * pressures)[:, None, None, None, None]
        cof = jax.vmap(jax.grad(_det))(FV)
        AV = AV + cof[:, :, :, None, None] * cof[:, None, None] * (self.bulk * volumes)[:, None, None, None, None]
        begin, begin_v = 0, 0
        for box, (G, V, w, v) in zip(self.mesh.boxes, parts, strict=True):
            k = _sandwich(G, A[begin : begin + len(w)]) + _sandwich(V, AV[begin_v : begin_v + len(v)])
            begin, begin_v = begin + len(w), begin_v + len(v)
            index = (3 * box.nodes[:, None] + np.arange(3)).reshape(-1)
            K = K.at[index[:, None], index[None, :]].add(k, unique_indices=True)
        # Pressure: V is trilinear in the places; its Hessian by forward over reverse on the few nodes of each face.
        for face in self.mesh.cavity:
            m = len(face.nodes)
            Y = y[face.nodes]
            r, d1, d2 = face.values @ Y, face.first @ Y, face.second @ Y
            w = face.sign * face.weights * 4 / 3
            # r . (d1 x d2): second derivatives couple different directions through the permutation symbol.
            k = jnp.zeros((m, 3, m, 3))
            N, D1, D2 = face.values, face.first, face.second
            pairs = (
                (jnp.einsum("q,qa,qb,qk->abk", w, N, D1, d2), 0),
                (jnp.einsum("q,qa,qb,qk->abk", w, D1, D2, r), 0),
                (jnp.einsum("q,qa,qb,qk->abk", w, D2, N, d1), 0),
            )
            whole = sum(t for t, _ in pairs)
            kk = jnp.einsum("ijk,abk->aibj", _EPS, whole)
            k = kk + jnp.transpose(kk, (2, 3, 0, 1))
            index = (3 * face.nodes[:, None] + np.arange(3)).reshape(-1)
            K = K.at[index[:, None], index[None, :]].add(-p * k.reshape(3 * m, 3 * m))
        normal = jnp.stack([jnp.cos(phi), -jnp.sin(phi), jnp.zeros_like(phi)])
        gap, weight, _ = self.pressing(y, c, sizes, phi)
        active = jnp.where(gap < 0, weight, 0.0)
        begin = 0
        for face in self.mesh.outer:
            w = active[begin : begin + len(face.weights)]
            begin += len(face.weights)
            G = (-face.values[:, :, None] * normal).reshape(len(face.weights), -1)
            G = jnp.concatenate([G, jnp.ones((len(face.weights), 1))], 1)
            index = np.concatenate([(3 * face.nodes[:, None] + np.arange(3)).reshape(-1), [3 * n]])
            K = K.at[index[:, None], index[None, :]].add(G.T @ (w[:, None] * G))
        # The cut: x = c cos + tau sin, y = -c sin + tau cos.
        cut = self.mesh.cut
        cos, sin = jnp.cos(phi), jnp.sin(phi)

        def columns(K):
            kx, ky = K[:, 3 * cut], K[:, 3 * cut + 1]
            K = K.at[:, 3 * cut + 1].set(sin * kx + cos * ky)
            return K.at[:, -1].add(jnp.sum(cos * kx - sin * ky, 1))

        K = columns(columns(K).T)
        return K[self.free][:, self.free]


def _sandwich(G, A):
    """Stiffness of a box, (3 nodes, 3 nodes), from the tangents A at its points."""
    half = jnp.einsum("qaI,qiIjJ->ijaqJ", G, A)
    m = G.shape[1]
    return jnp.einsum("ijaqJ,qbJ->aibj", half, G).reshape(3 * m, 3 * m)


_EPS = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPS[_i, _j, _k], _EPS[_j, _i, _k] = 1.0, -1.0


def _det(F):
    return (
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )
