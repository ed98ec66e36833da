"""Scenes of the energy membrane: minima of `energy.Functional`, followed from the flat state by growing pressure."""

from __future__ import annotations

import abc
from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap, sequential_vmap
from jaxtyping import Array, Float

from ...fields import part
from ...numerics.implicit import implicit
from ...numerics.minimise import Expansion, Minimum, minimise
from ...results import Status, stop_gradient_where_failed
from ...scene import Found, Scene, frozen
from ..flat_shell import FlatShell, Scalar
from ..obstacles import Obstacle
from . import batches, limits, maps, seek
from .basis import Grid, Vector
from .functional import Functional, functional, rho

LARGEST_STEP = 1.3
"""The largest step of the load, the cube root of p a / (mu t_m). The membrane rises by two thirds of the half width."""


class EnergyScene(Scene):
    """A state of the energy membrane. `body` is what it touches (None in free space).

    The unknowns are the coefficients of the displacement, then the contact pressures in mu t_m / a. Loads are cube
    roots of p a / (mu t_m), in proportion to which the membrane rises.
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("MinimumEnergy",)

    shell: FlatShell = part(FlatShell)

    @property
    @abc.abstractmethod
    def body(self) -> Obstacle | None:
        """What the membrane touches."""

    @property
    def functional(self) -> Functional:
        """The energy on this scene's grid."""
        return functional(self.grid)

    @property
    @abc.abstractmethod
    def grid(self) -> Grid:
        """Polynomials and symmetry."""

    @abc.abstractmethod
    def without_body(self) -> EnergyScene:
        """The same membrane, on the same grid, in free space."""

    def unit(self) -> Scalar:
        """mu t_m / a, Pa: the unit of pressure."""
        return self.shell.pressure_scale()

    def split(self, unknowns: Vector) -> tuple[Float[Array, " m"], Float[Array, " k"]]:
        """Coefficients and contact pressures."""
        return unknowns[: self.functional.size], unknowns[self.functional.size :]

    def unloaded_state(self) -> Vector:
        """The unknowns of the flat membrane."""
        count = self.functional.size + self.functional.contacts(self)
        return jnp.zeros_like(self.shell.a, shape=(count,))

    # --- finding ------------------------------------------------------------------------------------------------------

    def follow(
        self, start: Vector, start_load: Scalar, guess: Vector, load: Scalar, largest: Scalar | float = LARGEST_STEP
    ) -> Minimum:
        """The minimum at `load`, from a known one, by load steps of at most `largest`."""
        return _follow(self, start, start_load, guess, load, jnp.asarray(largest))

    def first_guess(self, load: Scalar) -> Vector:
        """A cap: what the small-deflection law (2.1) of a square gives, with the first polynomial of w alone."""
        height = self.functional.height_of_first()
        return self.unloaded_state().at[sum(self.functional.sizes[:2])].set(load / (3 * 2.5) ** (1 / 3) / height)

    def _load(self, pressure: Scalar) -> tuple[Array, Scalar]:
        """Whether the scene can be at this pressure, and the load."""
        possible = self.can_exist() & (pressure >= 0) & (pressure < jnp.inf)
        return possible, jnp.cbrt(jnp.where(possible, pressure, 0.0) / self.unit())

    def _labelled(self, met: Minimum, pressure: Scalar) -> Found:
        status = jnp.where(met.reached, Status.OK, jnp.where(met.lost, Status.BEYOND_LIMIT, Status.NOT_CONVERGED))
        apart = Status.OK if self.body is None else Status.NO_CONTACT
        status = jnp.where((status == Status.OK) & ~jnp.any(met.multipliers > 0), apart, status)
        flat = pressure <= 0
        status = jnp.where(self._load(pressure)[0], jnp.where(flat, apart, status), Status.IMPOSSIBLE)
        unknowns = jnp.where(flat, 0.0, jnp.concatenate([met.y, met.multipliers]))
        return Found(unknowns, pressure, status, met.evaluations)

    def find(self, pressure):
        return self._labelled(_find(self, self._load(pressure)[1]), pressure)

    def find_by(self, pressure: Scalar, largest: float) -> Found:
        """`find` by load steps of at most `largest`."""
        load = self._load(pressure)[1]
        met = self.follow(self.unloaded_state(), jnp.zeros_like(load), self.first_guess(load), load, largest)
        return self._labelled(met, pressure)

    def find_from(
        self, start: Vector, start_load: Scalar, slope: Vector, pressure: Scalar
    ) -> tuple[Found, Vector, Scalar, Vector]:
        """As `find`, from a known equilibrium and its change per load.

        Also the last equilibrium that was met, its load, and its change per load.
        """
        load = self._load(pressure)[1]
        met = self.follow(start, start_load, start + (load - start_load) * slope, load)
        kept = jnp.concatenate([met.y, met.multipliers])
        return self._labelled(met, pressure), kept, met.load, jnp.concatenate(met.slope)

    def is_possible(self):
        return (self.shell.b >= self.shell.a) & self.shell.material.is_stable_at_rest()

    def along(self, pressures):
        """Each from the one before, with a guess along its tangent."""

        def next_one(state, pressure):
            found, *state = fixed.find_from(*state, pressure)
            return tuple(state), found

        fixed = frozen(self)
        one = jnp.ones_like(pressures[0])
        start = fixed.unloaded_state(), jnp.zeros_like(one), fixed.first_guess(one)
        _, found = lax.scan(next_one, start, lax.stop_gradient(pressures))
        return jax.vmap(lambda found, pressure: self._solution(found._replace(pressure=pressure)))(found, pressures)

    # --- equations ----------------------------------------------------------------------------------------------------

    def residual(self, unknowns, pressure):
        return self.functional.equations(unknowns, self, pressure / self.unit())

    def with_implicit_derivative(self, unknowns, pressure):
        # The flat membrane has no stiffness, and is given no derivatives: they would be infinite.
        flat = pressure <= 0
        scene, pressure = stop_gradient_where_failed(~flat, (self, pressure))
        bulged = frozen(self).first_guess(jnp.ones_like(pressure))
        found = implicit(
            lambda unknowns, args: args[0].residual(unknowns, args[1]),
            jnp.where(flat, bulged, unknowns),
            (scene, pressure),
        )
        return jnp.where(flat, 0.0, found)

    def observe(self, unknowns, pressure):
        return self.measured(*self.split(unknowns), pressure)

    @abc.abstractmethod
    def measured(self, y: Vector, contact_pressures: Float[Array, " k"], pressure: Scalar) -> dict[str, Array]:
        """What is observed; `contact_pressures`: contact pressures."""

    # --- questions ----------------------------------------------------------------------------------------------------

    def onset(self):
        return jnp.zeros_like(self.shell.a) if self.body is None else seek.onset(self)

    def solve_for(self, name, target):
        return seek.solve_for(self, name, target)

    def find_limit(self):
        return limits.find_limit(self)

    def limit_pressure_from(self, found):
        return limits.limit_pressure_from(self, found)

    def branch(self, n):
        return limits.branch(self, n)

    def profile(self, unknowns, pressure, n):
        return maps.profile(self, unknowns, n)

    def surface(self, unknowns: Vector, pressure: Scalar, n: int) -> dict[str, Array]:
        """Maps on n x n points: see `maps.surface`."""
        return maps.surface(self, unknowns, n)


@custom_vmap
def _find(scene: EnergyScene, load: Scalar) -> Minimum:
    """The minimum at `load` on the branch that begins at the flat membrane."""
    return scene.follow(scene.unloaded_state(), jnp.zeros_like(load), scene.first_guess(load), load)


@_find.def_vmap
def _find_batch(axis_size, is_batched, *members):
    met = batches.one_after_other(_find, axis_size, tuple(is_batched), members)
    return met, jax.tree.map(lambda _: True, met)


# The members of a batch are solved one after the other: on a CPU one alone makes better use of matrix products, and
# does not wait for others.
@sequential_vmap
def _follow(
    scene: EnergyScene, start: Vector, start_load: Scalar, guess: Vector, load: Scalar, largest: Scalar
) -> Minimum:
    work, unit_weights = scene.functional, scene.functional.contact_weights(scene)

    def expansion(y: Vector, multipliers: Float[Array, " k"], load: Scalar) -> Expansion:
        scaled = load**3
        x = work.expand(y, scene, scaled)
        by_load = -3 * load**2 * x.lift
        if not work.contacts(scene):
            none = multipliers
            return Expansion(x.value, x.gradient, x.hessian, by_load, none, jnp.zeros((0, work.size)), none, none)
        stiffness = rho(scaled)
        terms = work.contact_terms(y, multipliers, scene, stiffness)
        pushes = unit_weights * terms.contact_pressures
        value = x.value + (unit_weights @ (terms.contact_pressures**2 - multipliers**2)) / (2 * stiffness)
        closed = jnp.where(terms.contact_pressures > 0, stiffness * unit_weights, 0.0)
        hessian = x.hessian - terms.curvature + terms.slopes.T @ (closed[:, None] * terms.slopes)
        gradient = x.gradient - pushes @ terms.slopes
        return Expansion(
            value,
            gradient,
            hessian,
            by_load,
            terms.gaps,
            terms.slopes,
            terms.contact_pressures,
            unit_weights,
        )

    return minimise(expansion, scene.split(start), start_load, scene.split(guess), load, largest)
