"""Limit points of the energy membrane, and its equilibria behind them."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..numerics.batching import in_turn
from ..numerics.continuation import fold_load
from ..numerics.control import hold, top
from ..numerics.small_linear import solve
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import Found, frozen
from .energy_follow import follow
from .energy_values import FIRST_LOAD, LARGEST_LOAD

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

BRANCH = 2.0
"""A drawn branch ends so many times as far from the flat membrane as the limit point."""
REACH = 0.1
"""Largest step towards a limit point, in unknowns of order one."""
LEAST_ABOVE = 1e-5
"""A limit point next to the last equilibrium below it has at least its load, within this part of it."""


def _linear(scene: Any):
    def linear(unknowns: Vector, load: Scalar) -> tuple[Vector, Array, Vector]:
        """Equations, their Jacobian and their change with the load p a / (mu t_m)."""
        work = scene.functional
        value, by_load = jax.jvp(lambda load: work.equations(unknowns, scene, load), (load,), (jnp.ones_like(load),))
        return value, work.jacobian(unknowns, scene, load), by_load

    return linear


def find_limit(scene: Any, largest: float) -> Found:
    """The limit point; `end` is 1 there, 0 where the branch ends without one. largest: load step."""
    return _limit(scene, jnp.asarray(largest))


@in_turn
def _limit(scene: Any, largest: Scalar) -> Found:
    zero = jnp.zeros_like(scene.shell.a)
    far = zero + LARGEST_LOAD
    climb = follow(scene, scene.unloaded_state(), zero, scene.first_guess(far), far, largest)
    kept, scaled = climb.y, climb.load**3
    # Next to the limit this is the direction in which stiffness is lost.
    _, jacobian, by_load = _linear(scene)(kept, scaled)
    yielding = solve(jacobian, -by_load)
    peak = top(_linear(scene), kept, scaled, yielding / jnp.linalg.norm(yielding), REACH + zero)
    above = peak.load >= scaled * (1 - LEAST_ABOVE)
    at_fold = climb.lost & peak.good & above
    possible = scene.can_exist()
    pressure = jnp.where(at_fold, peak.load, scaled) * scene.unit()
    pressure = jnp.where(climb.reached, jnp.inf, pressure)
    status = jnp.where(possible, Status.OK, Status.IMPOSSIBLE)
    return Found(jnp.where(at_fold, peak.y, kept), pressure, status, jnp.asarray(0), end=at_fold.astype(int))


def limit_pressure_from(scene: Any, found: Found) -> Scalar:
    """The limit pressure with its derivatives."""
    at_fold = (found.status == Status.OK) & (found.end == 1)
    masked = stop_gradient_where_failed(at_fold, scene)
    scaled = jnp.where(at_fold, found.pressure / frozen(scene).unit(), 1.0)

    def equations(point, scene):
        return scene.functional.equations(point[:-1], scene, point[-1])

    fold = fold_load(equations, jnp.append(found.unknowns, scaled), masked) * masked.unit()
    return jnp.where(found.status == Status.OK, jnp.where(at_fold, fold, found.pressure), jnp.nan)


def branch(method: Any, scene: Any, n: int, limit: Found | None) -> Solution:
    """n points at equal arc lengths of the unknowns, through the limit point to BRANCH times its distance, or up to the
    end of the branch where that is no limit point.

    Behind the limit these are equilibria at a given displacement.
    """
    fixed = frozen(scene)
    known: Found = method.find_limit(fixed) if limit is None else limit
    zero = jnp.zeros_like(known.pressure)
    low = zero + FIRST_LOAD
    begun = follow(fixed, fixed.unloaded_state(), zero, fixed.first_guess(low), low, method.largest_step)
    first = begun.y
    reach = jnp.where(known.end == 1, BRANCH, 1.0) * jnp.linalg.norm(known.unknowns)
    length = (reach - jnp.linalg.norm(first)) / (n - 1)

    def next_point(state, first):
        unknowns, load, along, rise, alive = state
        size = jnp.linalg.norm(along)
        direction = along / size
        step = jnp.where(first, 0.0, length)
        guess = unknowns + step * direction
        held = hold(_linear(fixed), guess, load + step * rise / size, direction, direction @ guess)
        alive = alive & held.good
        kept = jax.tree.map(lambda a, b: jnp.where(alive, a, b), held[:4], state[:4])
        return (*kept, alive), (kept[0], kept[1], alive)

    start = first, begun.load**3, first, zero, begun.reached & (known.status == Status.OK)
    _, (points, loads, alive) = lax.scan(next_point, start, jnp.arange(n) == 0)

    def report(unknowns, load, alive):
        status = jnp.where(alive, Status.OK, Status.NOT_CONVERGED)
        if fixed.body is not None:
            touched = jnp.any(fixed.contact_pressures(unknowns, load * fixed.unit()) > 0)
            status = jnp.where(alive & ~touched, Status.NO_CONTACT, status)
        found = fixed.verified(Found(unknowns, load * fixed.unit(), status, jnp.asarray(0)))
        return fixed.report_of(unknowns, load * fixed.unit(), found)

    return jax.vmap(report)(points, loads, alive)
