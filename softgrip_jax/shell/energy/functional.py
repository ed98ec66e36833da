"""The membrane as a minimum of energy: values, gradients and Hessians by a few matrix products.

With u, v, w in polynomials (coefficients y), equilibrium at the pressure p is a minimum of

    Pi / (mu t_m a^2) = integral W(C) / mu  -  p a / (mu t_m) * volume,       lengths in a, per flat area,

plus the energies of bending, of the clamped edges and of contact. Each is a density at points (a `Term`). C = F^T F is
that of the middle surface (plane stress, incompressible), the volume under it is the integral of w (F11 F22 - F12 F21).

W is a function of tr C and det C, both polynomials in F, so the sheet's second derivatives at a point are written out
(D); those of bending and contact are chained from what JAX finds by fewer numbers. The Hessian is the sum of B^T D B
over the points, with the polynomials B, one axis after the other (`grid_sums`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics.choice import largest
from .basis import (
    Grid,
    Tables,
    Values,
    at_points,
    bending_tables,
    clamp_tables,
    contact_tables,
    lattice,
    quadrature,
)
from .grid_sums import Pairs, Patch, assembled, at_grid, weighted
from .sheet import bending, bending_measures, chained_bending, chained_face, clamping, local, stretching

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

LEAST_PRESSURE = 1e-3
"""This is added to p a / (mu t_m) in rho, which must not vanish with the pressure."""
RHO = 1000.0
"""rho over p a / (mu t_m). Twice of it changes forces by less than 0.5 %."""
BETWEEN = 3
"""Points from one contact point to the next at which it is looked for what lies between them."""
COLUMN_STEPS, LEAST_STEP = 24, 0.1
"""Steps along a column under the membrane, and the shortest of them in t_m."""
SUNK = 1.0
"""A face that is deeper in the object than this (in t_m), and not out of it twice as far back along its own normal, did
not come in where it is next to the surface: it has passed a part of the object."""


class Term(NamedTuple):
    """An energy as a sum over points."""

    density: Callable[..., Scalar]
    """(e, point, scene, load) -> energy at a point, in mu t_m, with the derivatives e that the tables hold."""
    tables: Tables
    weights: Float[Array, " q"]
    """Of the points: flat area in a^2, or length in a."""


class Expanded(NamedTuple):
    """Of an energy in mu t_m a^2."""

    value: Scalar
    gradient: Vector
    hessian: Float[Array, "n n"]
    by_load: Vector
    """d gradient / d (p a / (mu t_m))."""


class Functional:
    """The energy on a grid. Unknowns: the coefficients y of u, v, w, one after the other."""

    def __init__(self, grid: Grid):
        self.grid = grid
        self.inside, self.bent, self.clamps = quadrature(grid), bending_tables(grid), clamp_tables(grid)
        self.touching = contact_tables(grid)
        self.sizes = [len(x) * len(y) for x, y in self.inside.patches[0].sides]
        self.size = sum(self.sizes)
        self.equations = jax.custom_jvp(self._equations)
        self.equations.defjvp(self._equations_jvp)
        self.expand = jax.jit(self._expand)
        """(y, scene, load) -> `Expanded`, in one pass: what Newton's method asks for. A program that asks for it in
        several places traces it once."""

    # --- tables -------------------------------------------------------------------------------------------------------

    def parts(self, y: Vector) -> list[Array]:
        """Coefficients of u, v, w."""
        u, v = self.sizes[0], self.sizes[0] + self.sizes[1]
        return [y[:u], y[u:v], y[v : self.size]]

    def deformed(self, y: Vector, tables: Tables | None = None) -> Float[Array, "q 3 r"]:
        """The derivatives e of (u, v, w) at the points of tables, by themselves the quadrature points."""
        patches = (self.inside if tables is None else tables).patches
        return jnp.concatenate([at_grid(self.parts(y), patch) for patch in patches])

    def deformed_at(self, y: Vector, values: Values) -> Float[Array, "q 3 r"]:
        """The same at any points, from the polynomials there (`basis.at_points`)."""
        pairs = zip(values, self.parts(y), strict=True)
        return jnp.stack([jnp.stack([b[r] @ c for r in range(b.shape[0])], axis=1) for b, c in pairs], axis=1)

    def height_of_first(self) -> float:
        """w / a in the middle for a coefficient of 1 of the first polynomial of w."""
        return float(at_points(self.grid, [(0.0, 0.0)])[2][0, 0, 0])

    # --- the energy ---------------------------------------------------------------------------------------------------

    def terms(self, scene: Any) -> list[Term]:
        """What the energy is the sum of: the sheet and the air, bending and its clamps, contact."""
        long = scene.shell.b / scene.shell.a
        found = [Term(_sheet, self.inside, self.inside.weights * long)]
        if scene.bending:
            found.append(Term(_bending, self.bent, self.bent.weights * long))
            lengths = jnp.where(_on_short_edge(self.clamps.points.T), 1.0, long)
            found.append(Term(_clamping, self.clamps, self.clamps.weights * lengths))
        if scene.body is not None:
            found.append(Term(_contact, self.touching, self.contact_weights(scene)))
        return found

    def value(self, y: Vector, scene: Any, load: Scalar) -> Scalar:
        """Energy in mu t_m a^2; load: p a / (mu t_m)."""
        found = jnp.zeros_like(load)
        for density, tables, weights in self.terms(scene):
            e = self.deformed(y, tables)
            found += weights @ jax.vmap(density, in_axes=(0, 0, None, None))(e, tables.points, scene, load)
        return found

    def _expand(self, y: Vector, scene: Any, load: Scalar) -> Expanded:
        own = {_sheet: self._expanded_sheet, _bending: self._expanded_bending, _contact: self._expanded_contact}
        parts = [own.get(term.density, self._expanded)(term, y, scene, load) for term in self.terms(scene)]
        return jax.tree.map(lambda *values: functools.reduce(jnp.add, values), *parts)

    def _expanded_sheet(self, term: Term, y: Vector, scene: Any, load: Scalar) -> Expanded:
        sheet, tables = _Sheet(self.deformed(y), scene, load, term.weights), term.tables
        gradient, hessian = _weighted(sheet.slopes(), tables), _assembled(*sheet.curvatures(), tables)
        return Expanded(sheet.value(), gradient, hessian, -_weighted(sheet.lifts(), tables))

    def _expanded_bending(self, term: Term, y: Vector, scene: Any, load: Scalar) -> Expanded:
        shell, weights = scene.shell, term.weights
        thickness, aspect, mu = shell.t_m / shell.a, shell.a / shell.b, shell.material.shear_modulus()
        e = self.deformed(y, term.tables)

        def energy(measures):
            return bending(measures, thickness, shell.material.sheet_energy) / mu

        measures = jax.vmap(bending_measures, in_axes=(0, None))(e, aspect)
        value, by, curved = jax.vmap(_expansion(energy))(measures)
        chained = jax.vmap(chained_bending, in_axes=(0, None, 0, 0), out_axes=(0, -1))
        slopes, curvatures = chained(e, aspect, weights[:, None] * by, weights[:, None, None] * curved)
        gradient, hessian = _weighted(slopes, term.tables), _assembled(*_of_all_pairs(curvatures), term.tables)
        return Expanded(weights @ value, gradient, hessian, jnp.zeros_like(y))

    def _expanded_contact(self, term: Term, y: Vector, scene: Any, load: Scalar) -> Expanded:
        shell, weights, stiffness = scene.shell, term.weights, rho(load)
        thickness, aspect = shell.t_m / shell.a, shell.a / shell.b
        at = jax.vmap(local, in_axes=(0, 0, None))(
            self.deformed(y, term.tables), jnp.asarray(term.tables.points), aspect
        )

        def energy(face):
            return _pressed(stiffness, scene.body.distance(shell.a * face) / shell.a)

        faces = jax.vmap(lambda at: at.face(thickness))(at)
        value, by, curved = jax.vmap(_expansion(energy))(faces)
        chained = jax.vmap(chained_face, in_axes=(0, None, None, 0, 0), out_axes=(0, -1))
        by, curved = weights[:, None] * by, weights[:, None, None] * curved
        slopes, curvatures = chained(at, aspect, thickness, by, curved)
        gradient, hessian = _weighted(slopes, term.tables), _assembled(*_of_all_pairs(curvatures), term.tables)
        return Expanded(weights @ value, gradient, hessian, RHO / stiffness * gradient)

    def _expanded(self, term: Term, y: Vector, scene: Any, load: Scalar) -> Expanded:
        density, tables, weights = term
        e = self.deformed(y, tables)

        def at_point(e, point):
            def energy(both):
                return density(jnp.reshape(both[:-1], e.shape), point, scene, both[-1])

            return _expansion(energy)(jnp.append(e, load))

        value, by, curved = jax.vmap(at_point)(e, jnp.asarray(tables.points))
        by, by_load = (jnp.reshape(weights[:, None] * part[:, : e[0].size], e.shape) for part in (by, curved[:, :, -1]))
        curved = (weights[:, None, None] * curved)[:, : e[0].size, : e[0].size]
        curved = jnp.moveaxis(jnp.reshape(curved, (-1, *2 * e.shape[1:])), 0, -1)
        hessian = _assembled(*_of_all_pairs(curved), tables)
        return Expanded(weights @ value, _weighted(by, tables), hessian, _weighted(by_load, tables))

    # --- contact ------------------------------------------------------------------------------------------------------

    def contact_weights(self, scene: Any) -> Float[Array, " k"]:
        """Flat area of the contact points, in a^2."""
        return self.touching.weights * (scene.shell.b / scene.shell.a)

    def gaps(self, y: Vector, scene: Any) -> Float[Array, " k"]:
        """Signed distance of the outer face from the object at the contact points, in a."""
        e = self.deformed(y, self.touching)
        return jax.vmap(_gap, in_axes=(0, 0, None))(e, self.touching.points, scene)

    def contact_pressures(self, y: Vector, scene: Any, load: Scalar) -> Float[Array, " k"]:
        """At the contact points per flat area, in mu t_m / a; none in free space."""
        return jnp.zeros(0) if scene.body is None else rho(load) * jnp.maximum(0.0, -self.gaps(y, scene))

    def touches(self, y: Vector, scene: Any) -> Bool[Array, ""]:
        """Whether the contact presses anywhere."""
        return jnp.asarray(False) if scene.body is None else jnp.any(self.gaps(y, scene) < 0)

    def passed(self, y: Vector, scene: Any) -> Scalar:
        """How deep the object is in a column under a face that has it wholly behind itself, or how deep a face is that
        has SUNK into the object, in a; 0 where neither is so.

        The columns stand on the plane of the clamp, on a lattice finer than the contact points, and go up to the outer
        face. They are walked along by the distance itself, so that no thick part of the object is missed.
        """
        shell, tables = scene.shell, lattice(self.grid, BETWEEN)
        thickness = shell.t_m / shell.a

        def distance(place):
            return scene.body.distance(shell.a * place) / shell.a

        def at(e, point):
            sheet = local(e, point, shell.a / shell.b)
            face = sheet.face(thickness)

            def walk(_, state):
                height, least = state
                found = distance(face.at[2].set(height))
                step = jnp.maximum(jnp.abs(found), LEAST_STEP * thickness)
                return jnp.minimum(height + step, face[2]), jnp.minimum(least, found)

            ground = jnp.minimum(jnp.zeros_like(face[2]), face[2])
            _, least = jax.lax.fori_loop(0, COLUMN_STEPS, walk, (ground, jnp.full_like(ground, jnp.inf)))
            depth = -distance(face)
            back = face - 2 * depth * sheet.normal / jnp.sqrt(sheet.determinant)
            sunk = (depth > SUNK * thickness) & (distance(back) < 0)
            return jnp.where(depth <= 0, -least, jnp.where(sunk, depth, 0.0))

        return jnp.maximum(0.0, largest(jax.vmap(at)(self.deformed(y, tables), tables.points)))

    # --- equilibrium --------------------------------------------------------------------------------------------------

    def _equations(self, y: Vector, scene: Any, load: Scalar) -> Vector:
        """dPi/dy."""
        found = jnp.zeros_like(y)
        for density, tables, weights in self.terms(scene):
            e = self.deformed(y, tables)
            slopes = jax.vmap(jax.grad(density), in_axes=(0, 0, None, None))(e, tables.points, scene, load)
            found += _weighted(slopes * weights[:, None, None], tables)
        return found

    def _equations_jvp(self, primals: Any, tangents: Any) -> tuple[Vector, Vector]:
        (y, scene, load), (along, *rest) = primals, tangents
        found, other = jax.jvp(lambda *args: self._equations(y, *args), (scene, load), tuple(rest))
        return found, self.jacobian(y, scene, load) @ along + other

    def jacobian(self, y: Vector, scene: Any, load: Scalar) -> Float[Array, "n n"]:
        """Derivatives of the equations by the coefficients."""
        return self.expand(y, scene, load).hessian


def _weighted(slopes: Float[Array, "q 3 r"], tables: Tables) -> Vector:
    """Sum over the points of slopes by e: slopes by y."""
    return functools.reduce(jnp.add, [weighted(slopes[those], patch) for those, patch in _patches(tables)])


def _assembled(found: Pairs, curved: Float[Array, "p q"], tables: Tables) -> Float[Array, "size size"]:
    """Sum over the points of curvatures by e: the Hessian by y."""
    return functools.reduce(jnp.add, [assembled(found, curved[:, those], patch) for those, patch in _patches(tables)])


def _patches(tables: Tables) -> list[tuple[slice, Patch]]:
    """Each grid of the tables, and which of the points are its."""
    ends = np.cumsum([0, *(patch.size for patch in tables.patches)])
    return [(slice(*pair), patch) for pair, patch in zip(itertools.pairwise(ends), tables.patches, strict=True)]


def _of_all_pairs(curved: Float[Array, "3 r 3 r q"]) -> tuple[Pairs, Float[Array, "p q"]]:
    """The second derivatives by all pairs of e, as rows."""
    return list(np.ndindex(curved.shape[:4])), jnp.reshape(curved, (-1, curved.shape[4]))


def _expansion(function: Callable[[Vector], Scalar]) -> Callable[[Vector], tuple[Scalar, Vector, Float[Array, "n n"]]]:
    """Value, gradient and Hessian at one point: tangents of a gradient that keeps its value."""

    def expanded(x):
        def with_slope(x):
            value, slope = jax.value_and_grad(function)(x)
            return slope, (value, slope)

        curvature, (value, slope) = jax.jacfwd(with_slope, has_aux=True)(x)
        return value, slope, curvature

    return expanded


# --- densities --------------------------------------------------------------------------------------------------------


def _sheet(e: Float[Array, "3 3"], point: Float[Array, 2], scene: Any, load: Scalar) -> Scalar:
    """Of the stretched sheet and the air beneath it, per flat area."""
    shell, at = scene.shell, local(e, point, scene.shell.a / scene.shell.b)
    elastic = stretching(shell.material, scene.bending, at.trace, at.determinant)
    return elastic / shell.material.shear_modulus() - load * at.place[2] * at.normal[2]


def _bending(e: Float[Array, "3 5"], point: Float[Array, 2], scene: Any, load: Scalar) -> Scalar:
    """See `sheet.bending`; e: without the displacements themselves."""
    shell = scene.shell
    found = bending(bending_measures(e, shell.a / shell.b), shell.t_m / shell.a, shell.material.sheet_energy)
    return found / shell.material.shear_modulus()


def _clamping(e: Float[Array, "3 1"], point: Float[Array, 2], scene: Any, load: Scalar) -> Scalar:
    """See `sheet.clamping`; e: the derivatives across the edge."""
    aspect, short = scene.shell.a / scene.shell.b, _on_short_edge(point)
    scale = jnp.where(short, aspect, 1.0)
    slope = jnp.arctan2(scale * e[2, 0], 1 + scale * jnp.where(short, e[1, 0], e[0, 0]))
    waves = jnp.where(short, scene.grid.along * aspect, scene.grid.across)
    return clamping(slope, load, scene.shell.t_m / scene.shell.a, waves)


def _on_short_edge(point: Any) -> Any:
    """Of points on the edges."""
    return abs(point[1]) == 1


def _contact(e: Float[Array, "3 3"], point: Float[Array, 2], scene: Any, load: Scalar) -> Scalar:
    """Of a thin layer on the object, per flat area.

    With the gap g between the outer face and the object, the layer's stiffness rho = RHO p a / (mu t_m) and the
    contact's pressure lambda = rho max(0, -g), it is lambda^2 / (2 rho). The layer gives way by a / RHO where the
    contact presses as much as the air. It lets polynomials, which are never quite flat, lie on an object over an area
    and not at single points.
    """
    return _pressed(rho(load), _gap(e, point, scene))


def _pressed(stiffness: Scalar, gap: Scalar) -> Scalar:
    """Energy of the layer, per flat area."""
    return 0.5 * stiffness * jnp.maximum(0.0, -gap) ** 2


def rho(load: Scalar) -> Scalar:
    """Stiffness of the layer, in mu t_m / a^2."""
    return RHO * (load + LEAST_PRESSURE)


def _gap(e: Float[Array, "3 r"], point: Float[Array, 2], scene: Any) -> Scalar:
    """Signed distance of the outer face from the object at one point, in a."""
    shell = scene.shell
    place = local(e, point, shell.a / shell.b).face(shell.t_m / shell.a)
    return scene.body.distance(place * shell.a) / shell.a


class _Sheet:
    """The energy of `_sheet`, its slopes and its curvatures, all points at a time.

    With the tangents X, Y (columns of F): tr C = X.X + Y.Y, det C = (X.X)(Y.Y) - (X.Y)^2, and the volume's density
    w (X_1 Y_2 - X_2 Y_1).
    """

    def __init__(self, e: Float[Array, "q 3 r"], scene: Any, load: Scalar, weights: Float[Array, " q"]):
        shell = scene.shell
        aspect, mu = shell.a / shell.b, shell.material.shear_modulus()
        self.scales = (jnp.ones_like(aspect), aspect)
        self.load, self.weights, self.height = load, weights, e[:, 2, 0]
        x = [e[:, 0, 1] + 1, e[:, 1, 1], e[:, 2, 1]]
        y = [aspect * e[:, 0, 2], aspect * e[:, 1, 2] + 1, aspect * e[:, 2, 2]]
        self.tangents = x, y
        self.xx, self.yy, self.xy = _dot(x, x), _dot(y, y), _dot(x, y)

        def energy(invariants):
            return stretching(shell.material, scene.bending, *invariants) / mu

        invariants = jnp.stack([self.xx + self.yy, self.xx * self.yy - self.xy**2], axis=-1)
        self.energy, by, curved = jax.vmap(_expansion(energy))(invariants)
        self.by_t, self.by_d = by.T
        self.tt, self.td, self.dd = curved[:, 0, 0], curved[:, 0, 1], curved[:, 1, 1]
        self.of_trace = [[2 * value for value in tangent] for tangent in (x, y)]
        self.of_determinant = [
            [2 * (self.yy * p - self.xy * q) for p, q in zip(x, y, strict=True)],
            [2 * (self.xx * q - self.xy * p) for p, q in zip(x, y, strict=True)],
        ]
        zero = jnp.zeros_like(x[0])
        self.of_volume = [[y[1], -y[0], zero], [-x[1], x[0], zero]]
        self.flat = x[0] * y[1] - x[1] * y[0]

    def value(self) -> Scalar:
        return self.weights @ (self.energy - self.load * self.height * self.flat)

    def lifts(self) -> Float[Array, "q 3 r"]:
        """d(volume) by e, weighted."""
        by_tangent = [[self.scales[r] * self.height * self.of_volume[r][c] for r in (0, 1)] for c in range(3)]
        zero = jnp.zeros_like(self.flat)
        rows = [jnp.stack([self.flat if c == 2 else zero, *by_tangent[c]], axis=1) for c in range(3)]
        return self.weights[:, None, None] * jnp.stack(rows, axis=1)

    def slopes(self) -> Float[Array, "q 3 r"]:
        """By e, weighted."""
        zero = jnp.zeros_like(self.flat)

        def elastic(c: int, r: int) -> Array:
            return self.scales[r] * (self.by_t * self.of_trace[r][c] + self.by_d * self.of_determinant[r][c])

        rows = [jnp.stack([zero, elastic(c, 0), elastic(c, 1)], axis=1) for c in range(3)]
        return self.weights[:, None, None] * jnp.stack(rows, axis=1) - self.load * self.lifts()

    def curvatures(self) -> tuple[Pairs, Float[Array, "p q"]]:
        """By pairs of e, weighted."""
        entries: dict[tuple[int, int, int, int], Array] = {}
        pushes = -self.load * self.weights
        for i in range(3):
            for j in range(i, 3):
                for r in (0, 1):
                    for s in (0, 1):
                        found = self.weights * self._elastic(i, r, j, s)
                        sign = {(0, 1): 1, (1, 0): -1}.get((i, j), 0) * (s - r)
                        found = found + sign * pushes * self.height if sign else found
                        entries[i, r + 1, j, s + 1] = self.scales[r] * self.scales[s] * found
                    if i < 2 and j == 2:
                        entries[i, r + 1, j, 0] = self.scales[r] * pushes * self.of_volume[r][i]
        return list(entries), jnp.stack(list(entries.values()))

    def _elastic(self, i: int, r: int, j: int, s: int) -> Array:
        """By component i of the tangent r and component j of the tangent s."""
        t, d = self.of_trace, self.of_determinant
        found = self.by_d * self._of_determinant_twice(i, r, j, s) + self.tt * t[r][i] * t[s][j]
        found = found + self.td * (t[r][i] * d[s][j] + d[r][i] * t[s][j]) + self.dd * d[r][i] * d[s][j]
        return found + 2 * self.by_t if (i, r) == (j, s) else found

    def _of_determinant_twice(self, i: int, r: int, j: int, s: int) -> Array:
        x, y = self.tangents
        if r == s:
            other = self.tangents[1 - r]
            return 2 * ((_dot(other, other) if i == j else 0) - other[i] * other[j])
        first, second = (i, j) if r == 0 else (j, i)
        crossed = 2 * x[first] * y[second] - y[first] * x[second]
        return 2 * (crossed - self.xy if i == j else crossed)


def _dot(a: Sequence[Array], b: Sequence[Array]) -> Array:
    return sum(p * q for p, q in zip(a, b, strict=True))  # type: ignore[return-value]


@functools.cache
def functional(grid: Grid) -> Functional:
    """One per grid: its tables are computed once."""
    return Functional(grid)
