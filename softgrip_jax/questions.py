"""The questions that can be asked of a scene: solve, path, branch, pressure_for, limit_pressure, contact_pressure.

Each checks what it is given outside of jit, and hands it to one compiled program."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .errors import InputError
from .fields import batched_field, require, to_float_array
from .results import Solution, stop_gradient_where_failed
from .scene import Scalar, Scene, Solver, equilibrium, frozen


def _checked(scene: Any) -> Scene:
    """The scene, ready to be solved, or one sentence about what is wrong."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "softgrip_jax needs float64, which is switched off: remove JAX_ENABLE_X64=0 or the call of "
            "jax.config.update('jax_enable_x64', False) after the import."
        )
    if not isinstance(scene, Scene):
        raise InputError(f"scene is {scene!r}; it must be a Scene, for instance sg.shell.Free(...).")
    batched = batched_field(scene)
    if batched is not None:
        raise InputError(_several_scenes(scene, *batched))
    return scene.prepared()


def _several_scenes(scene: Scene, where: str, shape: tuple[int, ...]) -> str:
    """What to type where a scene holds arrays in place of numbers."""
    said = f"{where} has the shape {shape}, and one scene has one number there; "
    if all(jnp.shape(leaf)[:1] == shape[:1] for leaf in jax.tree.leaves(scene)):
        return said + "solve the batch with jax.vmap(sg.solve, in_axes=(0, None))(scene, pressure)."
    name = where.rpartition(".")[2]
    return said + f"make it inside of vmap: jax.vmap(lambda {name}: sg.solve(make_scene({name}), pressure))(values)."


def _one_pressure(pressure: Any) -> Scalar:
    """The pressure of one state, Pa."""
    checked = require("pressure", pressure, "nonnegative", "pressure")
    if checked.ndim:
        raise InputError(
            f"pressure has the shape {checked.shape}, and solve takes one number; type sg.path(scene, pressures) for a "
            "curve, or jax.vmap(sg.solve, in_axes=(None, 0))(scene, pressures)."
        )
    return checked


@jax.jit
def _solve_by(scene: Scene, pressure: Scalar, solver: Solver, guess: Array | None) -> Solution:
    fixed, at, near = frozen((scene, pressure, guess))
    return scene._solution(solver.find(fixed, at, near)._replace(pressure=pressure))


@jax.jit
def _contact_pressure(scene: Scene) -> Scalar:
    possible = scene.can_exist()
    return jnp.where(possible, stop_gradient_where_failed(possible, scene).onset(), jnp.nan)


@jax.jit
def _limit_pressure(scene: Scene) -> Scalar:
    return scene.limit_pressure_from(frozen(frozen(scene).find_limit()))


@jax.jit
def _path(scene: Scene, pressures: Float[Array, " n"]) -> Solution:
    return scene.along(pressures)


@partial(jax.jit, static_argnames="n")
def _branch(scene: Scene, n: int) -> Solution:
    return scene.branch(n)


def solve(scene: Scene, pressure: Any, *, solver: Any = None, guess: Any = None) -> Solution:
    """The equilibrium of a scene at a pressure.

    Args:
        scene: what to solve; any float leaf of it may be traced or batched by vmap.
        pressure: gauge pressure in the actuator, Pa, zero or more.
        solver: one of `sg.solvers`; by default the one that is sure to find the branch connected to zero load.
        guess: for solvers that begin from one: the Solution of a scene nearby, or its unknowns.

    Returns: a Solution. A scene without equilibrium is not an error: see `Solution.status`.
    Raises: ValueError for a pressure that cannot be meant (outside jit), and for a solver that the scene cannot use;
        RuntimeError where float64 is off.
    """
    if solver is None and guess is None:
        return equilibrium(*to_solve(scene, pressure))
    scene, pressure = to_solve(scene, pressure)
    return _solve_by(scene, pressure, *_chosen(scene, solver, guess))


def _chosen(scene: Scene, solver: Any, guess: Any) -> tuple[Solver, Array | None]:
    """A solver and the unknowns that it begins from, or one sentence about what is wrong."""
    if solver is None:
        raise InputError("guess is for a solver that begins from one; give solver=sg.solvers.Newton(), too.")
    if not isinstance(solver, Solver):
        raise InputError(f"solver is {solver!r}; it must be one of sg.solvers, for instance sg.solvers.Newton().")
    if not solver.suits(scene):
        can = " or ".join(scene.SOLVERS) or "its own method alone: leave solver out"
        raise InputError(f"{type(scene).__name__} cannot be solved by {type(solver).__name__}; it can by {can}.")
    if guess is None:
        return solver, None
    if not solver.takes_guess():
        raise InputError(f"{type(solver).__name__} begins at zero load and takes no guess; sg.solvers.Newton() does.")
    given = guess.unknowns if isinstance(guess, Solution) else to_float_array(guess)
    wanted = scene.unknown_shape()
    if not isinstance(given, jax.Array) or given.shape != wanted:
        shape = f"has unknowns of the shape {given.shape}" if isinstance(given, jax.Array) else f"is {guess!r}"
        raise InputError(
            f"guess {shape}, and the unknowns of this {type(scene).__name__} have the shape {wanted}; it must be a "
            "Solution of a scene of the same kind, or its unknowns."
        )
    return solver, given


def to_solve(scene: Scene, pressure: Any) -> tuple[Scene, Scalar]:
    """What `solve` hands to its program."""
    return _checked(scene), _one_pressure(pressure)


def path(scene: Scene, pressures: Any) -> Solution:
    """The curve of solutions at the given pressures (Pa), on the branch connected to zero load; a batched Solution."""
    scene = _checked(scene)
    checked = jnp.atleast_1d(require("pressures", pressures, "nonnegative", "pressure"))
    if checked.ndim > 1:
        raise InputError(f"pressures has the shape {checked.shape}; it must be one list of pressures.")
    return _path(scene, checked)


def branch(scene: Scene, n: int = 200) -> Solution:
    """The equilibrium curve through its limit point, at n points from where pressure begins to act.

    Unlike `path` the pressure is a result here: it rises to `limit_pressure` and falls behind it. The points behind
    the limit are equilibria under volume control, unstable under pressure control; the limit is one of the points.

    The branch ends where, behind the limit, the pressure has fallen to half of it or is as large again (the state to
    which the scene snaps); where the model ends; where a membrane has inflated to ten times its half width, or an
    energy membrane is twice as far from flat as at its limit. A branch without a limit ends at 20 mu t_m / a.
    """
    scene = _checked(scene)
    return _branch(scene, n)


def contact_pressure(scene: Scene) -> Scalar:
    """The pressure (Pa) at which contact begins (thesis appendix A; for fingers: between the chambers).

    Below it the force is exactly zero. 0 in free space, NaN for an impossible scene. Differentiable.
    """
    return _contact_pressure(_checked(scene))


def limit_pressure(scene: Scene) -> Scalar:
    """The largest pressure (Pa) with an equilibrium on the branch connected to zero load.

    A maximum of the load (limit point) or the end of the model (the membrane used up); inf where neither exists,
    NaN for an impossible scene. Differentiable.
    """
    scene = _checked(scene)
    return _limit_pressure(scene)


def pressure_for(scene: Scene, **target: Any) -> Solution:
    """The inverse problem: the solution (with `.pressure`) that gives one observable its wanted value, no stepping.

    Args:
        scene: what to solve.
        target: one observable and its value in SI, for instance ``force=2.0``; none for a grasp, which knows its own.
    """
    return _pressure_for(*to_reach(scene, **target))


def to_reach(scene: Scene, **target: Any) -> tuple[Scene, str, Scalar]:
    """What `pressure_for` hands to its program."""
    scene = _checked(scene)
    if len(target) > 1:
        raise InputError(f"pressure_for got {len(target)} targets ({', '.join(target)}); one pressure can meet one.")
    name, value = next(iter(target.items())) if target else scene.target()
    if scene.OBSERVABLES.get(name) is None:
        allowed = ", ".join(scene.OBSERVABLES)
        raise InputError(f"{type(scene).__name__} has no observable {name!r}; it has: {allowed}.")
    if scene.OBSERVABLES[name] == "position":
        raise InputError(f"{name} is a point (x, y); one pressure can meet one number.")
    wanted = require(name, value, "finite", scene.OBSERVABLES[name])
    if wanted.ndim:
        raise InputError(
            f"{name} has the shape {wanted.shape}, and pressure_for takes one number; type "
            f"jax.vmap(lambda {name}: sg.pressure_for(scene, {name}={name}))(values)."
        )
    return scene, name, wanted


@partial(jax.jit, static_argnames="name")
def _pressure_for(scene: Scene, name: str, value: Scalar) -> Solution:
    return scene.solve_for(name, value)
