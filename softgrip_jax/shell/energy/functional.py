"""The membrane as a minimum of energy under contact: values, gradients and Hessians by a few matrix products.

With u, v, w in polynomials (coefficients y), equilibrium at the pressure p is a minimum of

    Pi / (mu t_m a^2) = integral W(C) / mu  -  p a / (mu t_m) * volume,       lengths in a, per flat area,

plus the energy of contact. With the gap g between the outer face and the object at the contact points and the stiffness
rho = RHO p a / (mu t_m) of a thin layer on the object, the contact's pressure lambda per flat area and its energy are

    lambda = rho max(0, -g),        sum of weight * lambda^2 / (2 rho).

The layer gives way by a / RHO where the contact presses as much as the air. It lets polynomials, which are never quite
flat, lie on an object over an area and not at single points. C = F^T F is that of the middle surface (plane stress,
incompressible), the volume under it is the integral of w (F11 F22 - F12 F21).

W is a function of tr C and det C, both polynomials in F, so the second derivatives at a point are written out (D), and
the Hessian is the sum of B^T D B over the points, with the constant tables B.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .basis import Grid, Values, at_points, contact_tables, quadrature
from .sheet import bent, local, tension_field

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
Entries = dict[tuple[int, int, int, int], Array]
"""(i, r, j, s) -> at each point, the second derivative by derivative r of component i and s of j, i <= j."""

LEAST_PRESSURE = 1e-3
"""This is added to p a / (mu t_m) in rho, which must not vanish with the pressure."""
RHO = 1000.0
"""rho over p a / (mu t_m). Half of it changes forces by 0.4 %."""


class Expanded(NamedTuple):
    """Of the energy without contact."""

    value: Scalar
    gradient: Vector
    hessian: Float[Array, "n n"]
    lift: Vector
    """d volume / dy: minus the change of the gradient with p a / (mu t_m)."""


class Layer(NamedTuple):
    """Of the energy of contact."""

    value: Scalar
    gradient: Vector
    hessian: Float[Array, "n n"]
    by_load: Vector
    """d gradient / d (p a / (mu t_m))."""
    touching: Bool[Array, ""]


class Functional:
    """The energy on a grid. Unknowns: the coefficients y of u, v, w, one after the other."""

    def __init__(self, grid: Grid):
        self.grid = grid
        self.inside, self.touching = quadrature(grid), contact_tables(grid)
        self.sizes = [values.shape[-1] for values in self.inside.values]
        self.size = sum(self.sizes)
        self.equations = jax.custom_jvp(self._equations)
        self.equations.defjvp(self._equations_jvp)

    # --- tables -------------------------------------------------------------------------------------------------------

    def parts(self, y: Vector) -> list[Array]:
        """Coefficients of u, v, w."""
        u, v = self.sizes[0], self.sizes[0] + self.sizes[1]
        return [y[:u], y[u:v], y[v : self.size]]

    def deformed(self, y: Vector, values: Values | None = None) -> Float[Array, "q 3 r"]:
        """The derivatives e of (u, v, w) at the quadrature points, or at those that tables `values` were made for."""
        values = self.inside.values if values is None else values
        pairs = zip(values, self.parts(y), strict=True)
        return jnp.stack([jnp.stack([b[r] @ c for r in range(b.shape[0])], axis=1) for b, c in pairs], axis=1)

    def height_of_first(self) -> float:
        """w / a in the middle for a coefficient of 1 of the first polynomial of w."""
        return float(at_points(self.grid, [(0.0, 0.0)])[2][0, 0, 0])

    def _weighted(self, slopes: Float[Array, "q 3 r"], values: Values) -> Float[Array, " size"]:
        """Sum over points of slopes by e times the tables: slopes by y."""
        return jnp.concatenate([sum(slopes[:, c, r] @ b[r] for r in range(b.shape[0])) for c, b in enumerate(values)])  # type: ignore[arg-type]

    def _assembled(self, entries: Entries, values: Values) -> Float[Array, "size size"]:
        """Sum of B^T D B: for each pair of components one product of matrices over points and derivatives."""
        blocks: dict[tuple[int, int], Array] = {}
        for i in range(3):
            for j in range(i, 3):
                rows = sorted({key[1] for key in entries if (key[0], key[2]) == (i, j)})
                columns = sorted({key[3] for key in entries if (key[0], key[2]) == (i, j)})
                halves = [
                    sum(entries[i, r, j, s][:, None] * values[j][s] for s in columns if (i, r, j, s) in entries)
                    for r in rows
                ]
                blocks[i, j] = np.concatenate([values[i][r] for r in rows]).T @ jnp.concatenate(halves)  # type: ignore
                blocks[j, i] = blocks[i, j].T
        return jnp.concatenate([jnp.concatenate([blocks[i, j] for j in range(3)], axis=1) for i in range(3)])

    # --- the energy without contact -----------------------------------------------------------------------------------

    def area_weights(self, scene: Any) -> Float[Array, " q"]:
        """Weights of the quadrature points for integrals over the flat membrane, in a^2."""
        return self.inside.weights * (scene.shell.b / scene.shell.a)

    def value(self, y: Vector, scene: Any, load: Scalar) -> Scalar:
        """Energy without contact, in mu t_m a^2; load: p a / (mu t_m)."""
        at = jax.vmap(_density, in_axes=(0, 0, None, None))(self.deformed(y), self.inside.points, scene, load)
        return jnp.dot(self.area_weights(scene), at)

    def _gradient(self, y: Vector, scene: Any, load: Scalar) -> Vector:
        slopes = jax.vmap(jax.grad(_density), in_axes=(0, 0, None, None))(
            self.deformed(y), self.inside.points, scene, load
        )
        return self._weighted(slopes * self.area_weights(scene)[:, None, None], self.inside.values)

    def expand(self, y: Vector, scene: Any, load: Scalar) -> Expanded:
        """Energy, gradient and Hessian in one pass: what Newton's method asks for."""
        if self.grid.bending:
            return self._expand_bent(y, scene, load)
        sheet = _Sheet(self.deformed(y), scene, load, self.area_weights(scene))
        gradient = self._weighted(sheet.slopes(), self.inside.values)
        hessian = self._assembled(sheet.curvatures(), self.inside.values)
        return Expanded(sheet.value(), gradient, hessian, self._weighted(sheet.lifts(), self.inside.values))

    def _expand_bent(self, y: Vector, scene: Any, load: Scalar) -> Expanded:
        e, points, weights = self.deformed(y), self.inside.points, self.area_weights(scene)
        value, slopes, curvatures = jax.vmap(_expansion(_density), in_axes=(0, 0, None, None))(e, points, scene, load)
        orders = range(e.shape[-1])
        entries = {
            (i, r, j, s): weights * curvatures[:, i, r, j, s] for i in range(3) for j in range(i, 3) for r in orders
            for s in orders
        }  # fmt: skip
        gradient = self._weighted(slopes * weights[:, None, None], self.inside.values)
        lift = self._gradient(y, scene, load - 1) - gradient
        return Expanded(weights @ value, gradient, self._assembled(entries, self.inside.values), lift)

    # --- contact ------------------------------------------------------------------------------------------------------

    def contact_weights(self, scene: Any) -> Float[Array, " k"]:
        """Flat area of the contact points, in a^2."""
        return self.touching.weights * (scene.shell.b / scene.shell.a)

    def gaps(self, y: Vector, scene: Any) -> Float[Array, " k"]:
        """Signed distance of the outer face from the object at the contact points, in a."""
        e = self.deformed(y, self.touching.values)
        return jax.vmap(gap, in_axes=(0, 0, None))(e, self.touching.points, scene)

    def contact_pressures(self, y: Vector, scene: Any, load: Scalar) -> Float[Array, " k"]:
        """At the contact points per flat area, in mu t_m / a; none in free space."""
        return jnp.zeros(0) if scene.body is None else pressed(self.gaps(y, scene), load)

    def layer(self, y: Vector, scene: Any, load: Scalar) -> Layer:
        """The energy of contact, expanded."""
        values, stiffness = self.touching.values, rho(load)
        e = self.deformed(y, values)
        gaps, by_e, curved = jax.vmap(_expansion(gap), in_axes=(0, 0, None))(e, self.touching.points, scene)
        pressures, weights = pressed(gaps, load), self.contact_weights(scene)
        pushes = weights * pressures
        stiff = jnp.where(pressures > 0, stiffness * weights, 0.0)
        entries = {
            (i, r, j, s): stiff * by_e[:, i, r] * by_e[:, j, s] - pushes * curved[:, i, r, j, s]
            for i in range(3) for j in range(i, 3) for r in range(3) for s in range(3)
        }  # fmt: skip
        gradient = -self._weighted(by_e * pushes[:, None, None], values)
        value = pushes @ pressures / (2 * stiffness)
        hessian = self._assembled(entries, values)
        # lambda is in proportion to rho, and rho - RHO LEAST_PRESSURE to the load.
        return Layer(value, gradient, hessian, gradient * (RHO / stiffness), jnp.any(pressures > 0))

    # --- equilibrium --------------------------------------------------------------------------------------------------

    def _equations(self, y: Vector, scene: Any, load: Scalar) -> Vector:
        """dPi/dy, contact included."""
        pull = self._gradient(y, scene, load)
        if scene.body is None:
            return pull
        values = self.touching.values
        e = self.deformed(y, values)
        gaps, by_e = jax.vmap(jax.value_and_grad(gap), in_axes=(0, 0, None))(e, self.touching.points, scene)
        pushes = self.contact_weights(scene) * pressed(gaps, load)
        return pull - self._weighted(by_e * pushes[:, None, None], values)

    def _equations_jvp(self, primals: Any, tangents: Any) -> tuple[Vector, Vector]:
        (y, scene, load), (along, *rest) = primals, tangents
        found, other = jax.jvp(lambda *args: self._equations(y, *args), (scene, load), tuple(rest))
        return found, self.jacobian(y, scene, load) @ along + other

    def jacobian(self, y: Vector, scene: Any, load: Scalar) -> Float[Array, "n n"]:
        """Derivatives of the equations by the coefficients."""
        hessian = self.expand(y, scene, load).hessian
        return hessian if scene.body is None else hessian + self.layer(y, scene, load).hessian


def pressed(gaps: Float[Array, " k"], load: Scalar) -> Float[Array, " k"]:
    """The pressure of the contact at gaps (in a) per flat area, in mu t_m / a."""
    return jnp.where(gaps < 0, -rho(load) * gaps, 0.0)


def rho(load: Scalar) -> Scalar:
    """Stiffness of the layer, in mu t_m / a^2."""
    return RHO * (load + LEAST_PRESSURE)


def gap(e: Float[Array, "3 r"], point: Float[Array, 2], scene: Any) -> Scalar:
    """Signed distance of the outer face from the object at one point, in a."""
    shell = scene.shell
    place = local(e, point, shell.a / shell.b).face(shell.t_m / shell.a)
    return scene.body.distance(place * shell.a) / shell.a


def _expansion(function):
    """Value, gradient and Hessian by the first argument, at one point: tangents of a gradient that keeps its value."""

    def expanded(e, *rest):
        def with_slope(e):
            value, slope = jax.value_and_grad(function)(e, *rest)
            return slope, (value, slope)

        curvature, (value, slope) = jax.jacfwd(with_slope, has_aux=True)(e)
        return value, slope, curvature

    return expanded


def _density(e: Float[Array, "3 r"], point: Float[Array, 2], scene: Any, load: Scalar) -> Scalar:
    """Energy per flat area at one point, in mu t_m."""
    shell, at = scene.shell, local(e, point, scene.shell.a / scene.shell.b)
    if scene.grid.bending:
        fibres = bent(e, at, shell.a / shell.b, shell.t_m / shell.a)
        elastic = sum(shell.material.sheet_energy(*fibre) for fibre in fibres) / 2
    else:
        elastic = shell.material.sheet_energy(*tension_field(at.trace, at.determinant))
    return elastic / shell.material.shear_modulus() - load * at.place[2] * at.normal[2]


class _Sheet:
    """The energy of `_density` without bending, its slopes and its curvatures, all points at a time.

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

        def energy(trace, determinant):
            return shell.material.sheet_energy(*tension_field(trace, determinant)) / mu

        def expanded(trace, determinant):
            def slopes(trace, determinant):
                value, found = jax.value_and_grad(energy, (0, 1))(trace, determinant)
                return found, (value, found)

            curved, (value, slope) = jax.jacfwd(slopes, (0, 1), has_aux=True)(trace, determinant)
            return value, slope, curved

        determinant = self.xx * self.yy - self.xy**2
        self.energy, (self.by_t, self.by_d), ((self.tt, self.td), (_, self.dd)) = jax.vmap(expanded)(
            self.xx + self.yy, determinant
        )
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

    def curvatures(self) -> Entries:
        """By pairs of e, weighted."""
        entries: Entries = {}
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
        return entries

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
