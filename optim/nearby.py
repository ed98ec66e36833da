"""The state of a scene from a state nearby (`softgrip_jax.numerics.nearby`): what a search asks for thousands of times.

The answer is a good one or none: where it is none the whole way from zero load is to be followed. Its certificate is
the one of `Newton`, the sign of det(dr/dy), which must be that of the state it came from; see there what that cannot
tell. What a search reports in the end is therefore solved along the whole way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softgrip_jax.equations import CurveEquations, PathEquations
from softgrip_jax.numerics.nearby import Known, KnownFold, fold_nearby, known_fold, known_root
from softgrip_jax.quantities import REQUIRED, State
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Solution, Status
from softgrip_jax.scene import Found, Scene, frozen
from softgrip_jax.solvers.path_values import surplus_over
from softgrip_jax.units import kPa

PRESSURE = 10 * kPa
"""What makes a pressure that is sought a number of order one."""


def can_begin_nearby(scene: Scene) -> bool:
    """Whether a scene has equations of several unknowns, of which a state nearby is worth something."""
    return isinstance(scene, PathEquations)


def begins_by_formula(scene: Scene) -> bool:
    """Whether the pressure at which contact begins is the load where an interval begins; elsewhere a path is followed
    to it, by a program that takes a minute to compile."""
    return isinstance(scene.prepared(), CurveEquations)


def snaps(scene: Any) -> bool:
    """Whether limit points follow so close on each other that the sign of det(dr/dy) says nothing: two of them between
    a state and the one nearby leave it as it was."""
    return isinstance(scene, PathEquations) and scene.has_close_limits()


def is_sought(at: State | Array) -> bool:
    """Whether the pressure of a state is unknown: it is asked for by what it does."""
    return isinstance(at, tuple | str)


def known_state(at: State, solution: Solution, t: Float[Array, " m"]) -> Known:
    """A solved state of a design t as a place to begin from: its unknowns and, where it was sought, the pressure."""
    u = solution.unknowns
    return known_root(jnp.append(u, solution.pressure / PRESSURE) if is_sought(at) else u, t)


@partial(jax.jit, static_argnums=0)
def known_states(at: State, solutions: Solution, t: Float[Array, "k m"]) -> Known:
    """`known_state` of a batch."""
    return jax.vmap(partial(known_state, at))(solutions, t)


def state_at(scene: Any, at: State | Array, u: Float[Array, " n"]) -> tuple[Array, Solution]:
    """What is left of the equations at u, and the state there as if nothing were, with the rules of states alone.

    at: a pressure (Pa), "required", or (observable, value), as in `quantities`.
    """
    scene = scene.prepared()
    unknowns, pressure = (u[:-1], u[-1] * PRESSURE) if is_sought(at) else (u, jnp.asarray(at, u.dtype))
    residual, observed = scene.evaluated(unknowns, pressure)
    if is_sought(at):
        name, target = cast(Any, scene.target() if at == REQUIRED else at)
        residual = jnp.append(residual, surplus_over(name, jnp.asarray(target, u.dtype), observed))
    margins = scene.margins_of_state(unknowns, pressure)
    none, number = jnp.zeros((), u.dtype), jnp.asarray(0)
    solution = Solution(
        scene, pressure, jnp.asarray(int(Status.OK)), none, number, unknowns, observed, number, none * jnp.nan, margins
    )
    return residual, solution


def limit_of(scene: Any, t: Float[Array, " m"]) -> tuple[KnownFold, Bool[Array, ""]]:
    """(where the branch of a design t ends, whether that is a limit point), along the whole way from zero load."""
    scene = frozen(scene.prepared())
    found = scene.solver().find_limit(scene)
    is_fold = (found.status == Status.OK) & (found.reason == Reason.LIMIT_POINT)
    return known_fold(jnp.append(found.unknowns, found.pressure / PRESSURE), t), is_fold


def limit_nearby(
    scene_at: Callable[[Array], Any], t: Float[Array, " m"], known: KnownFold
) -> tuple[KnownFold, Bool[Array, ""]]:
    """The limit point of scene_at(t) from one nearby, and whether it is one."""

    def residual(u, t):
        return scene_at(t).prepared().residual(u[:-1], u[-1] * PRESSURE)

    found, good = fold_nearby(residual, t, known)
    return found, good & (found.u[-1] > 0)


def is_covered(scene: Any, at: State | Array, solution: Solution) -> Bool[Array, ""]:
    """Whether a state that solves the equations is one of those that `solve` calls OK: between the ends of the model,
    resolved by its points, held as it may be held."""
    scene, solution = frozen((scene.prepared(), solution))
    span = scene.pressure_span()
    good = scene.can_exist() & (solution.pressure < span.end)
    if is_sought(at):
        good &= solution.pressure > span.begin
    passed = scene.passed(solution.observables)
    if passed is not None:
        good &= passed < 0
    good &= ~scene.is_loop(solution.observables)
    nothing_left = (jnp.zeros_like(solution.unknowns), solution.observables)
    found = Found(solution.unknowns, solution.pressure, solution.status, solution.iterations, evaluated=nothing_left)
    return good & (scene.verified(found).status == Status.OK)
