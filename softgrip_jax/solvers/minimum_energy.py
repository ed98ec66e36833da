"""Minima of an energy, followed as the load grows."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..numerics.batching import one_at_a_time
from ..numerics.choice import select
from ..numerics.minimise import Minimum
from ..results import Status
from ..scene import BranchSolver, Found, frozen
from . import energy_limits, energy_values
from .energy_follow import in_front, minimum_at
from .settings import require_number

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

LARGEST_STEP = 1.3
"""The largest step of the load, the cube root of p a / (mu t_m). The membrane rises by two thirds of the half width."""


class MinimumEnergy(BranchSolver):
    """The minimum of the energy, followed from the flat membrane to the pressure; for the energy membrane.

    It is what `model="energy"` uses by itself: Newton's method with a line search, contact by a stiff layer
    (see `numerics.minimise`). The answer is a minimum, so it is stable, and is solved to rounding. Where no minimum is
    left ahead the state is BEYOND_LIMIT.

    Args:
        largest_step: of the load (p a / (mu t_m))^(1/3), dimensionless; the membrane rises in proportion to it.

    Raises:
        InputError: where largest_step is not positive.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> plane = sg.shell.ObstacleContact(shell, sg.shell.obstacles.Plane(5 * mm), across=2, lengthwise=2)
        >>> found = sg.solve(plane, 12 * kPa, solver=sg.solvers.MinimumEnergy(largest_step=0.5))
        >>> print(f"{found.force:.2f} N")
        14.08 N
    """

    largest_step: float = eqx.field(static=True, default=LARGEST_STEP)

    def __check_init__(self) -> None:
        require_number("MinimumEnergy.largest_step", self.largest_step)

    def in_turn(self):
        return one_at_a_time()

    def find(self, scene: Any, pressure, guess):
        return _labelled(scene, minimum_at(scene, _load(scene, pressure)[1], self.largest_step), pressure)

    def find_from(
        self, scene: Any, start: Vector, start_load: Scalar, slope: Vector, pressure: Scalar
    ) -> tuple[Found, Vector, Scalar, Vector]:
        """As `find`, from a known equilibrium and its change per load.

        Also the last equilibrium that was met in front of the object, its load, and its change per load.
        """
        load = _load(scene, pressure)[1]
        met = in_front(scene, start, start_load, start + (load - start_load) * slope, load, self.largest_step)
        known = select(scene.has_passed(met.y), (start, start_load, slope), (met.y, met.load, met.slope))
        return _labelled(scene, met, pressure), *known

    def along(self, scene, pressures):
        """Each from the one before, with a guess along its tangent."""

        def next_one(state, pressure):
            found, *after = self.find_from(fixed, state[0], state[1], state[2], pressure)
            return tuple(after), found

        fixed = frozen(scene)
        one = jnp.ones_like(pressures[0])
        start = fixed.unloaded_state(), jnp.zeros_like(one), fixed.first_guess(one)
        _, found = lax.scan(next_one, start, lax.stop_gradient(pressures))
        return jax.vmap(lambda found, pressure: scene.solution_of(found._replace(pressure=pressure)))(found, pressures)

    def onset(self, scene):
        return jnp.zeros_like(scene.shell.a) if scene.body is None else energy_values.onset(self, scene)

    def solve_for(self, scene, name, target):
        return energy_values.solve_for(self, scene, name, target)

    def find_limit(self, scene):
        return energy_limits.find_limit(scene, self.largest_step)

    def limit_pressure_from(self, scene, found):
        return energy_limits.limit_pressure_from(scene, found)

    def branch(self, scene, n, limit=None):
        return energy_limits.branch(self, scene, n, limit)


def _load(scene: Any, pressure: Scalar) -> tuple[Array, Scalar]:
    """Whether the scene can be at this pressure, and the load."""
    possible = scene.can_exist() & (pressure >= 0) & (pressure < jnp.inf)
    return possible, jnp.cbrt(jnp.where(possible, pressure, 0.0) / scene.unit())


def _labelled(scene: Any, met: Minimum, pressure: Scalar) -> Found:
    """What the minimum that was met says of the state."""
    status = jnp.where(met.reached, Status.OK, jnp.where(met.lost, Status.BEYOND_LIMIT, Status.NOT_CONVERGED))
    apart = Status.OK if scene.body is None else Status.NO_CONTACT
    status = jnp.where((status == Status.OK) & ~met.touching, apart, status)
    flat = pressure <= 0
    status = jnp.where(_load(scene, pressure)[0], jnp.where(flat, apart, status), Status.IMPOSSIBLE)
    unknowns = jnp.where(flat, 0.0, met.y)
    return Found(unknowns, pressure, status, met.evaluations)
