"""Limit points of the energy membrane, and its equilibria behind them."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..numerics.batching import in_turn
from ..numerics.continuation import fold_load
from ..numerics.continuation.search import LONGER, SHORTER
from ..numerics.control import hold, top
from ..numerics.small_linear import solve
from ..results import Solution, Status, stop_gradient_where_failed
from ..scene import Found, frozen
from .energy_follow import BESIDE, follow, in_front
from .energy_values import FIRST_LOAD, LARGEST_LOAD

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]

BRANCH = 2.0
"""A drawn branch ends so many times as far from the flat membrane as the limit point."""
BRANCH_STEPS = 30
"""At least as many lead along a drawn branch."""
TURN = 0.7
"""Cosine of the largest turn of a drawn branch in one step: where the membrane first touches it turns by 33 degrees."""
SMALLEST = 1e-4
"""A drawn branch ends where steps of this part of its usual ones fail."""
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
    climb = in_front(scene, scene.unloaded_state(), zero, scene.first_guess(far), far, largest, to_end=True)
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

    Whatever n is, the curve is followed in BRANCH_STEPS steps at least, and those that fail are cut. The point nearest
    to what `find_limit` found is moved there. Behind the limit these are equilibria at a given displacement.
    """
    fixed = frozen(scene)
    known: Found = method.find_limit(fixed) if limit is None else limit
    zero = jnp.zeros_like(known.pressure)
    low = zero + FIRST_LOAD
    begun = follow(fixed, fixed.unloaded_state(), zero, fixed.first_guess(low), low, method.largest_step)
    first = begun.y
    reach = jnp.where(known.end == 1, BRANCH, 1.0) * jnp.linalg.norm(known.unknowns)
    finer = -(-BRANCH_STEPS // (n - 1))
    length = (reach - jnp.linalg.norm(first)) / (finer * (n - 1))

    def attempt(state):
        (unknowns, load, along, rise), step, rest = state
        size, step = jnp.linalg.norm(along), jnp.minimum(step, rest)
        direction = along / size
        guess = unknowns + step * direction
        held = hold(_linear(fixed), guess, load + step * rise / size, direction, direction @ guess)
        # direction . along is 1 there: what `along` is longer by tells how far the curve has turned.
        straight = jnp.linalg.norm(held.along) * TURN < 1
        good = held.good & straight & jnp.all(jnp.abs(held.y - guess) < BESIDE)
        kept = jax.tree.map(lambda a, b: jnp.where(good, a, b), held[:4], state[0])
        return kept, jnp.where(good, LONGER, SHORTER) * step, jnp.where(good, rest - step, rest)

    def next_point(state, _):
        def busy(state):
            return alive & (state[2] > 0) & (state[1] > SMALLEST * length)

        point, step, alive = state
        # The last piece of a step says nothing of how long the next one may be.
        point, last, rest = lax.while_loop(busy, attempt, (point, step, length))
        alive = alive & (rest <= 0)
        return (point, jnp.maximum(last, jnp.minimum(step, length)), alive), (*point[:2], alive)

    start = (first, begun.load**3, begun.slope, 3 * begun.load**2)
    alive = begun.reached & (known.status == Status.OK)
    _, followed = lax.scan(next_point, (start, length, alive), None, length=finer * (n - 1))
    points, loads, alive = (
        jnp.concatenate([jnp.asarray(a)[None], b[finer - 1 :: finer]])
        for a, b in zip((*start[:2], alive), followed, strict=True)
    )
    distance = jnp.linalg.norm(points - known.unknowns[None], axis=1)
    nearest = jnp.argmin(jnp.where(alive, distance, jnp.inf))
    there = (jnp.arange(n) == nearest) & (distance <= finer * length) & jnp.isfinite(known.pressure)
    points = jnp.where(there[:, None], known.unknowns[None], points)
    loads = jnp.where(there, known.pressure / fixed.unit(), loads)

    def report(unknowns, load, alive):
        status = jnp.where(alive, Status.OK, Status.NOT_CONVERGED)
        if fixed.body is not None:
            touched = jnp.any(fixed.contact_pressures(unknowns, load * fixed.unit()) > 0)
            status = jnp.where(alive & ~touched, Status.NO_CONTACT, status)
        found = fixed.verified(Found(unknowns, load * fixed.unit(), status, jnp.asarray(0)))
        return fixed.report_of(unknowns, load * fixed.unit(), found)

    return jax.vmap(report)(points, loads, alive)
