"""Scenes of the energy membrane: minima of `energy.Functional`, followed from the flat state by growing pressure."""

from __future__ import annotations

import abc
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Float

from ..checked import admissible, part
from ..numerics.control import hold, top
from ..numerics.minimise import Minimum, minimise
from ..numerics.paths import fold_load
from ..numerics.roots import implicit
from ..results import Solution, Status, gate, mask
from ..scene import Found, Scene, frozen
from .energy import Functional, Grid, Load, at_points, contact_pressure, functional, gap, local
from .flat_shell import FlatShell, Scalar
from .obstacles import Obstacle

Vector = Float[Array, " n"]

ROUNDS = 2
"""Solves of the augmented Lagrangian: one without multipliers leaves a penetration of 1 / PENALTY of a half width, one
with them takes most of it away. More rounds do not come nearer to the truth: contact at hundreds of points asks more of
the polynomials than they can give, so the multipliers end as spikes. Stopped after two they are smooth."""
PENALTY = 300.0
"""rho a / p: in the first round contact presses with the inner pressure where it is entered by a / 300."""
LARGEST_LOAD = 4.0
"""Cube root of the largest p a / (mu t_m) that is looked at, 64: three times beyond any measured shell."""
FIRST_LOAD, GROWTH = 0.3, 1.5
"""Of the search for a wanted state: the first cube root, and its growth until the state is passed."""
SEEK_STEPS, MEETS = 60, 2e-13
"""Of that search: its most trials, and the relative error that ends it."""
CLOSE = 1e-5
"""Where equilibrium ends is known this well, relative to the load, before the limit point is aimed at."""
LEAST_PRESSURE = 1e-3
"""Added to p a / (mu t_m) in the penalty, which must not vanish with the pressure."""
TINY = 1e-30
"""Under a root whose derivative nobody asks for."""
LARGEST_STEP = 0.6
"""Of the cube root of p a / (mu t_m), in proportion to which the membrane rises: about a third of the half width."""


class EnergyScene(Scene):
    """A state of the energy membrane. `body` is what it touches (None in free space).

    The unknowns are the coefficients of every round of the augmented Lagrangian, one after the other: each round is an
    equilibrium with multipliers from the round before, so all of them are roots, and the last one is what is reported.
    """

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

    @property
    def rounds(self) -> int:
        """Solves of the augmented Lagrangian."""
        return 1 if self.body is None else ROUNDS

    def unit(self) -> Scalar:
        """mu t_m / a, Pa: the unit of pressure."""
        return self.shell.pressure_scale()

    def scaled_load(self, pressure: Scalar, multipliers: Any) -> Load:
        """What acts at a pressure (Pa)."""
        scaled = pressure / self.unit()
        return Load(scaled, multipliers, PENALTY * (scaled + LEAST_PRESSURE))

    def no_multipliers(self) -> Float[Array, " q"]:
        """Those of the first round."""
        return jnp.zeros_like(self.shell.a, shape=self.functional.tables.weights.shape)

    def pressed(self, y: Vector, pressure: Scalar, multipliers: Array) -> Array:
        """The contact pressures of an equilibrium: the next round's multipliers."""
        if self.body is None:
            return multipliers
        stiffness = self.scaled_load(pressure, multipliers).stiffness
        return contact_pressure(self.functional.gaps(y, self), multipliers, stiffness)

    def pressed_at(self, points: Any, rows: Float[Array, "k n"], pressure: Scalar) -> Float[Array, " p"]:
        """The scaled contact pressure of the last round, per flat area, at any points (xi, eta)."""
        points = np.asarray(points, dtype=float)
        values = at_points(self.grid, points)
        pressed = jnp.zeros_like(pressure, shape=(len(points),))
        for y in rows:
            gaps = jax.vmap(gap, in_axes=(0, 0, None))(self.functional.deformed(y, values), points, self)
            pressed = contact_pressure(gaps, pressed, self.scaled_load(pressure, pressed).stiffness)
        return pressed

    # --- finding ------------------------------------------------------------------------------------------------------

    def _minimise(self, start: Vector, start_load: Scalar, guess: Vector, load: Scalar, rounds: int) -> Minimum:
        """The loads are cube roots of p a / (mu t_m), in proportion to which the membrane rises."""
        return _minimum(rounds)(self, start, start_load, guess, load)

    def first_guess(self, load: Scalar) -> Vector:
        """A cap: what the small-deflection law (2.1) of a square gives, with the first polynomial of w alone."""
        rest = jnp.zeros_like(load, shape=(self.functional.size,))
        height = self.functional.height_of_first()
        return rest.at[2 * self.functional.size // 3].set(load / (3 * 2.5) ** (1 / 3) / height)

    def find_from(
        self, start: Vector, start_load: Scalar, guess: Vector, pressure: Scalar
    ) -> tuple[Found, Vector, Scalar]:
        """As `find`, from a known equilibrium of the first round and a guess of the one that is looked for.

        Also the last equilibrium of the first round that was met, and its load.
        """
        possible = admissible(self) & self.is_possible() & (pressure >= 0) & (pressure < jnp.inf)
        load = jnp.cbrt(jnp.where(possible, pressure, 0.0) / self.unit())
        found = self._minimise(start, start_load, guess, load, self.rounds)
        status = jnp.where(found.reached, Status.OK, jnp.where(found.lost, Status.BEYOND_LIMIT, Status.NOT_CONVERGED))
        y = found.rounds
        if self.body is not None:
            touched = jnp.any(self._multipliers(y, pressure)[-1] > 0)
            status = jnp.where((status == Status.OK) & ~touched, Status.NO_CONTACT, status)
        flat = pressure <= 0
        status = jnp.where(flat, Status.OK if self.body is None else Status.NO_CONTACT, status)
        y = jnp.where(flat, 0.0, y)
        status = jnp.where(possible, status, Status.IMPOSSIBLE)
        return Found(y.ravel(), pressure, status, found.evaluations), found.kept, found.load

    def find(self, pressure):
        load = jnp.cbrt(pressure / self.unit())
        rest = jnp.zeros_like(pressure, shape=(self.functional.size,))
        return self.find_from(rest, jnp.zeros_like(pressure), self.first_guess(load), pressure)[0]

    def is_possible(self):
        return (self.shell.b >= self.shell.a) & self.shell.material.is_stable_at_rest()

    # --- equations ----------------------------------------------------------------------------------------------------

    def _rows(self, unknowns: Vector) -> Float[Array, "k m"]:
        return unknowns.reshape(self.rounds, -1)

    def _multipliers(self, rows: Float[Array, "k n"], pressure: Scalar) -> list[Array]:
        """Those of each round, and the contact pressures of the last one."""
        chain = [self.no_multipliers()]
        for y in rows:
            chain.append(self.pressed(y, pressure, chain[-1]))
        return chain

    def residual(self, unknowns, pressure):
        rows = self._rows(unknowns)
        chain = self._multipliers(rows, pressure)
        return jnp.concatenate(
            [
                self.functional.gradient(y, self, self.scaled_load(pressure, multipliers))
                for y, multipliers in zip(rows, chain[:-1], strict=True)
            ]
        )

    def rooted(self, unknowns, pressure):
        """The unknowns with their derivatives, round by round."""

        def equations(y, args):
            scene, pressure, multipliers = args
            return scene.functional.gradient(y, scene, scene.scaled_load(pressure, multipliers))

        # The flat membrane has no stiffness, and is given no derivatives: they would be infinite.
        flat = pressure <= 0
        scene, pressure = gate(~flat, (self, pressure))
        bulged = jnp.tile(frozen(self).first_guess(jnp.ones_like(pressure)), self.rounds)
        multipliers, rows = self.no_multipliers(), []
        for y in self._rows(jnp.where(flat, bulged, unknowns)):
            rows.append(implicit(equations, y, (scene, pressure, multipliers)))
            multipliers = scene.pressed(rows[-1], pressure, multipliers)
        return jnp.where(flat, 0.0, jnp.concatenate(rows))

    def observe(self, unknowns, pressure):
        rows = self._rows(unknowns)
        return self.measured(rows[-1], pressure, self._multipliers(rows, pressure)[-1])

    @abc.abstractmethod
    def measured(self, y: Vector, pressure: Scalar, pressed: Array) -> dict[str, Array]:
        """What is observed of the last round; `pressed`: its contact pressures."""

    def shape_observables(self, y: Vector) -> dict[str, Array]:
        """Height, stretches and slope of the membrane."""
        shell = self.shell
        aspect = shell.a / shell.b
        middle, rim = at_points(self.grid, [(0.0, 0.0)]), at_points(self.grid, [(1.0, 0.0)])
        top = local(self.functional.deformed(y, middle)[0], jnp.zeros(2), aspect)
        edge = self.functional.deformed(y, rim)[0]
        at = jax.vmap(local, in_axes=(0, 0, None))(self.functional.deformed(y), self.functional.tables.points, aspect)
        trace, determinant = jax.vmap(lambda at: (at.trace, at.determinant))(at)
        mean = 0.5 * trace
        larger = jnp.sqrt(mean + jnp.sqrt(jnp.maximum(mean**2 - determinant, TINY)))
        share = jnp.dot(self.functional.tables.weights, (determinant < larger).astype(y.dtype)) / 4
        return {
            "inflation": shell.a * top.place[2],
            "stretch": jnp.linalg.norm(top.along_x),
            "length_stretch": jnp.linalg.norm(top.along_y),
            "largest_stretch": jnp.max(larger),
            "clamp_angle": jnp.arctan2(-edge[2, 1], 1 + edge[0, 1]),
            "wrinkled_share": share,
        }

    def profile(self, unknowns, pressure, n):
        """x, z across the width at the middle, y, z_length along the length, m: the middle surface."""
        line = np.linspace(-1, 1, n)
        shell, y, zero = self.shell, self._rows(unknowns)[-1], np.zeros(n)
        across, along = np.stack([line, zero], axis=1), np.stack([zero, line], axis=1)
        places = [self.places(y, points) * shell.a for points in (across, along)]
        return {"x": places[0][:, 0], "z": places[0][:, 2], "y": places[1][:, 1], "z_length": places[1][:, 2]}

    def places(self, y: Vector, points: Any) -> Float[Array, "m 3"]:
        """The middle surface at the points (xi, eta), in a."""
        e = self.functional.deformed(y, at_points(self.grid, points))
        return jax.vmap(local, in_axes=(0, 0, None))(e, jnp.asarray(points), self.shell.a / self.shell.b).place

    def surface(self, unknowns: Vector, pressure: Scalar, n: int) -> dict[str, Array]:
        """Maps on n x n points of the membrane, m and Pa: X, Y of the flat membrane, place, principal stretches, and
        the pressure of the contact per deformed area."""
        line = np.linspace(-1, 1, n)
        points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        shell, rows = self.shell, self._rows(unknowns)
        e = self.functional.deformed(rows[-1], at_points(self.grid, points))
        at = jax.vmap(local, in_axes=(0, 0, None))(e, jnp.asarray(points), shell.a / shell.b)
        trace, determinant = jax.vmap(lambda at: (at.trace, at.determinant))(at)
        larger = jnp.sqrt(0.5 * trace + jnp.sqrt(jnp.maximum((0.5 * trace) ** 2 - determinant, TINY)))
        maps = {
            "X": shell.a * points[:, 0],
            "Y": shell.b * points[:, 1],
            "larger_stretch": larger,
            "smaller_stretch": jnp.sqrt(determinant) / larger,
        }
        if self.body is not None:
            maps["contact_pressure"] = self.unit() * self.pressed_at(points, rows, pressure) / jnp.sqrt(determinant)
        maps = {name: jnp.reshape(value, (n, n)) for name, value in maps.items()}
        return maps | {"place": jnp.reshape(shell.a * at.place, (n, n, 3))}

    # --- questions ----------------------------------------------------------------------------------------------------

    def along(self, pressures):
        """Each from the one before, with a guess from the last two."""

        def next_one(state, pressure):
            start, start_load, slope = state
            load = jnp.cbrt(pressure / self.unit())
            found, kept, kept_load = fixed.find_from(start, start_load, start + (load - start_load) * slope, pressure)
            moved = kept_load != start_load
            slope = jnp.where(moved, (kept - start) / jnp.where(moved, kept_load - start_load, 1.0), slope)
            return (kept, kept_load, slope), found

        fixed = frozen(self)
        one = jnp.ones_like(pressures[0])
        rest = jnp.zeros_like(one, shape=(self.functional.size,))
        start = rest, jnp.zeros_like(one), fixed.first_guess(one)
        _, found = lax.scan(next_one, start, lax.stop_gradient(pressures))
        return jax.vmap(lambda found, pressure: self._solution(found._replace(pressure=pressure)))(found, pressures)

    def onset(self):
        if self.body is None:
            return jnp.zeros_like(self.shell.a)
        free = self.without_body()
        fixed = frozen(self)

        def nearest(scene, free_rows, pressure):
            return -jnp.min(scene.functional.gaps(free_rows[-1], scene))

        found, _, _ = frozen(free).seek(lambda rows, pressure: nearest(fixed, rows, pressure))
        ok = found.status == Status.OK
        scene, free = gate(ok, (self, free))

        def equation(pressure, args):
            scene, free, unknowns = args
            return nearest(scene, free._rows(free.rooted(unknowns, pressure * scene.unit())), pressure)

        scaled = implicit(equation, found.pressure / fixed.unit(), (scene, free, found.unknowns))
        return jnp.where(ok, scaled * scene.unit(), jnp.nan)

    @abc.abstractmethod
    def without_body(self) -> EnergyScene:
        """The same membrane, on the same grid, in free space."""

    def seek(self, surplus) -> tuple[Found, Scalar, Array]:
        """Where surplus(rows, pressure), negative at low pressure, first rises through zero: false position (Illinois).

        Returns the point, what is left of the surplus there, and whether the branch ended before it (the point is
        then the last one).
        """
        unit = self.unit()
        zero = jnp.zeros_like(unit)
        rest = jnp.zeros_like(unit, shape=(self.functional.size,))
        unknown = zero + jnp.nan

        def step(state):
            start, start_load, slope, low, low_value, high, high_value, load, side, _, count = state
            found, kept, kept_load = self.find_from(
                start, start_load, start + (load - start_load) * slope, load**3 * unit
            )
            solved = (found.status == Status.OK) | (found.status == Status.NO_CONTACT)
            value = jnp.where(solved, surplus(self._rows(found.unknowns), found.pressure), jnp.nan)
            below = value < 0
            moved = kept_load != start_load
            slope = jnp.where(moved, (kept - start) / jnp.where(moved, kept_load - start_load, 1.0), slope)
            new_side = jnp.where(below, -1, 1)
            stays = new_side == side
            # The end that stays counts half (Illinois); an end without equilibrium has no value.
            high_value = jnp.where(below & stays, 0.5 * high_value, jnp.where(below, high_value, value))
            low_value = jnp.where(~below & stays, 0.5 * low_value, jnp.where(below, value, low_value))
            low, high = jnp.where(below, load, low), jnp.where(below, high, load)
            share = low_value / (low_value - high_value)
            inside = low + (high - low) * jnp.where(jnp.isfinite(share), share, 0.5)
            next_load = jnp.where(jnp.isfinite(high), inside, GROWTH * load)
            return (
                jnp.where(below, kept, start), jnp.where(below, kept_load, start_load), slope, low, low_value, high,
                high_value, next_load, new_side, (found, value), count + 1,
            )  # fmt: skip

        def busy(state):
            low, high, load, (_, value), count = state[3], state[5], state[7], state[9], state[10]
            open_ = ~(jnp.isfinite(high) & (high - low <= 1e-15 * high)) & (load < LARGEST_LOAD)
            near_end = jnp.isnan(value) & jnp.isfinite(high) & (high - low < CLOSE * high)
            return ~(jnp.abs(value) <= MEETS) & open_ & ~near_end & (count < SEEK_STEPS)

        nothing = Found(jnp.tile(rest, self.rounds), zero, jnp.asarray(int(Status.NOT_CONVERGED)), jnp.asarray(0))
        start = (
            rest, zero, self.first_guess(zero + 1), zero, unknown, zero + jnp.inf, unknown, zero + FIRST_LOAD,
            jnp.asarray(0), (nothing._replace(residual=zero), unknown), jnp.asarray(0),
        )  # fmt: skip
        nothing = jax.eval_shape(step, start)[9]
        start = (*start[:9], jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), nothing), start[10])
        start = (*start[:9], (start[9][0], unknown), start[10])
        last = lax.while_loop(busy, step, start)
        found, value = last[9]
        ended = jnp.isnan(value) | (last[7] >= LARGEST_LOAD)
        return found, value, ended

    def solve_for(self, name, target):
        fixed, value = frozen((self, target))

        def surplus(scene, target, rows, pressure):
            size = jnp.maximum(jnp.abs(lax.stop_gradient(target)), 1e-12)
            observed = scene.measured(rows[-1], pressure, scene._multipliers(rows, pressure)[-1])[name]
            return (observed - target) / size

        found, left, ended = fixed.seek(lambda rows, pressure: surplus(fixed, value, rows, pressure))
        status = jnp.where(ended, Status.BEYOND_LIMIT, found.status)
        possible = admissible(fixed) & fixed.is_possible() & jnp.isfinite(value)
        status = jnp.where(possible, status, Status.IMPOSSIBLE)
        found = fixed.settled(found._replace(status=status, mismatch=jnp.where(status == Status.OK, left, 0.0)))
        ok = found.status == Status.OK
        scene, target = gate(ok, (self, target))

        def equation(scaled, args):
            scene, target, unknowns = args
            pressure = scaled * scene.unit()
            return surplus(scene, target, scene._rows(scene.rooted(unknowns, pressure)), pressure)

        scaled = implicit(equation, found.pressure / fixed.unit(), (scene, target, found.unknowns))
        pressure = jnp.where(ok, scaled * scene.unit(), jnp.nan)
        safe = jnp.where(ok, pressure, fixed.unit())
        return scene._report(scene.rooted(found.unknowns, safe), pressure, found)

    # --- limit points -------------------------------------------------------------------------------------------------

    def _linear(self, y: Vector, scaled: Scalar):
        """Gradient, Hessian and d gradient / d load of the first round; the load is p a / (mu t_m)."""

        def gradient(scaled):
            load = self.scaled_load(scaled * self.unit(), self.no_multipliers())
            return self.functional.gradient(y, self, load)

        load = self.scaled_load(scaled * self.unit(), self.no_multipliers())
        value, by_load = jax.jvp(gradient, (scaled,), (jnp.ones_like(scaled),))
        return value, self.functional.hessian(y, self, load), by_load

    def find_limit(self):
        """The limit point of the first round; `iterations` is 1 there, 0 where the branch ends without one.

        Contact pressures follow the pressure, so all rounds have their limit points within PENALTY's error.
        """
        return _limit(self)

    def _limit(self) -> Found:
        zero = jnp.zeros_like(self.shell.a)
        rest = jnp.zeros_like(zero, shape=(self.functional.size,))
        far = zero + LARGEST_LOAD
        climb = self._minimise(rest, zero, self.first_guess(far), far, rounds=1)
        scaled = climb.load**3
        # Next to the limit this is the direction in which stiffness is lost.
        _, hessian, by_load = self._linear(climb.kept, scaled)
        yielding = jnp.linalg.solve(hessian, -by_load)
        peak = top(self._linear, climb.kept, scaled, yielding / jnp.linalg.norm(yielding), REACH + zero)
        above = peak.load >= scaled * (1 - CLOSE)
        at_fold = climb.lost & peak.good & above
        possible = admissible(self) & self.is_possible()
        y = jnp.where(at_fold, peak.y, climb.kept)
        pressure = jnp.where(at_fold, peak.load, scaled) * self.unit()
        pressure = jnp.where(climb.reached, jnp.inf, pressure)
        status = jnp.where(possible, Status.OK, Status.IMPOSSIBLE)
        return Found(y, pressure, status, at_fold.astype(int))

    def limit_pressure_from(self, found):
        at_fold = (found.status == Status.OK) & (found.iterations == 1)
        scene = gate(at_fold, self)
        scaled = jnp.where(at_fold, found.pressure / frozen(self).unit(), 1.0)

        def equations(u, scene):
            return scene.functional.gradient(
                u[:-1], scene, scene.scaled_load(u[-1] * scene.unit(), scene.no_multipliers())
            )

        fold = fold_load(equations, jnp.append(found.unknowns, scaled), scene) * scene.unit()
        pressure = jnp.where(at_fold, fold, found.pressure)
        return jnp.where(found.status == Status.OK, pressure, jnp.nan)

    def branch(self, n):
        """n points at equal arc lengths of the coefficients, through the limit point to BRANCH times its distance.

        Behind the limit these are equilibria at a given displacement. With an object they are those of the first
        round, whose contact pressures are within PENALTY's error.
        """
        fixed = frozen(self)
        limit = fixed.find_limit()
        zero = jnp.zeros_like(limit.pressure)
        rest = jnp.zeros_like(zero, shape=(self.functional.size,))
        low = zero + FIRST_LOAD
        begun = fixed._minimise(rest, zero, fixed.first_guess(low), low, rounds=1)
        length = (BRANCH * jnp.linalg.norm(limit.unknowns) - jnp.linalg.norm(begun.kept)) / (n - 1)

        def next_point(state, first):
            y, load, along, rise, alive = state
            size = jnp.linalg.norm(along)
            direction = along / size
            step = jnp.where(first, 0.0, length)
            guess = y + step * direction
            held = hold(fixed._linear, guess, load + step * rise / size, direction, direction @ guess)
            alive = alive & held.good
            kept = jax.tree.map(lambda a, b: jnp.where(alive, a, b), held[:4], state[:4])
            return (*kept, alive), (kept[0], kept[1], alive)

        start = begun.kept, begun.load**3, begun.kept, zero, begun.reached & (limit.status == Status.OK)
        _, (points, loads, alive) = lax.scan(next_point, start, jnp.arange(n) == 0)

        def report(y, load, alive):
            pressure = load * fixed.unit()
            chain = fixed._multipliers(y[None], pressure)
            status = jnp.where(alive, Status.OK, Status.NOT_CONVERGED)
            equations = fixed.functional.gradient(y, fixed, fixed.scaled_load(pressure, chain[0]))
            residual = jnp.max(jnp.abs(equations))
            observed = mask(status, fixed.measured(y, pressure, chain[1]))
            unknowns = jnp.tile(y, fixed.rounds)
            return Solution(fixed, pressure, status, residual, jnp.asarray(0), unknowns, observed)

        return jax.vmap(report, out_axes=Solution(None, 0, 0, 0, 0, 0, 0))(points, loads, alive)


BRANCH = 2.0
"""Where a drawn branch ends: twice as far from the flat membrane as the limit point."""
REACH = 0.1
"""Largest step towards a limit point, in coefficients of order one."""


# In a batch one lane is found after the other: on a CPU a lane alone makes better use of matrix products, and does not
# wait for others.
_limit = sequential_vmap(EnergyScene._limit)


@functools.cache
def _minimum(rounds: int) -> Callable[..., Minimum]:
    """`minimise` for a scene, with a number of rounds."""

    @sequential_vmap
    def minimum(scene, start, start_load, guess, load):
        def expansion(y, load, multipliers):
            return scene.functional.expansion(y, scene, scene.scaled_load(load**3 * scene.unit(), multipliers))

        def update(y, load, multipliers):
            return scene.pressed(y, load**3 * scene.unit(), multipliers)

        first = scene.no_multipliers()
        return minimise(expansion, update, first, rounds, start, start_load, guess, load, LARGEST_STEP)

    return minimum
