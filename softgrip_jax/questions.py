"""The questions that can be asked of a scene: solve, path, branch, pressure_for, limit_pressure, contact_pressure.

Each checks what it is given outside of jit, and hands it to one compiled program."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .errors import InputError, require_whole
from .fields import batched_field, require, to_float_array
from .numerics.xla import traced_once
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


@traced_once
def _solve_by(scene: Scene, pressure: Scalar, solver: Solver, guess: Array | None) -> Solution:
    fixed, at, near = frozen((scene, pressure, guess))
    return scene.solution_of(solver.find(fixed, at, near)._replace(pressure=pressure))


@traced_once
def _contact_pressure(scene: Scene) -> Scalar:
    possible = scene.can_exist()
    return jnp.where(possible, scene.solver().onset(stop_gradient_where_failed(possible, scene)), jnp.nan)


@traced_once
def pressure_at_limit(scene: Scene) -> Scalar:
    """The program of `limit_pressure`, for what `to_limit` gives."""
    solver = scene.solver()
    return solver.limit_pressure_from(scene, frozen(solver.find_limit(frozen(scene))))


@traced_once
def _path(scene: Scene, pressures: Float[Array, " n"]) -> Solution:
    return scene.solver().along(scene, pressures)


@jax.custom_jvp
def _without_derivatives(number: Array) -> Array:
    """A number of a scene whose branch is asked for: where the points of a branch lie moves with the scene, and with
    that their derivatives are not those of any state."""
    return number


@_without_derivatives.defjvp
def _refuse_derivatives(primals, tangents):
    raise InputError(
        "branch has no derivatives, for its points move along the curve with the scene; take those of solve or path at "
        "pressures, of pressure_for at values, or of limit_pressure."
    )


@partial(traced_once, static_argnames="n")
def _branch(scene: Scene, n: int) -> Solution:
    return scene.solver().branch(scene, n)


def solve(scene: Scene, pressure: Any, *, solver: Any = None, guess: Any = None) -> Solution:
    """The equilibrium of a scene at a pressure.

    The unknowns u solve r(u; scene, p) = 0 on the branch that is connected to zero load. Their derivatives follow from
    the implicit function theorem, du = -(dr/du)^-1 dr, forward and in reverse and of any order. Inside of `lax.map` or
    `lax.scan` second derivatives by reverse mode need `jax.checkpoint` around what is repeated (docs/hard-cases.md).

    Args:
        scene: what to solve; any float leaf of it may be traced, or batched by vmap.
        pressure: gauge pressure in the actuator, Pa, a scalar, zero or more.
        solver: one of `sg.solvers`; by default the one that is sure to find that branch.
        guess: for solvers that begin from one: the Solution of a scene nearby, or its unknowns (scaled, dimensionless,
            of the shape of `Solution.unknowns`).

    Returns:
        The `Solution`, in SI. A scene without equilibrium is not an error: see `Solution.status`.

    Raises:
        InputError: where scene, pressure, solver or guess cannot be meant (outside of jit).
        RuntimeError: where float64 is switched off.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> free = sg.solve(sg.shell.Free(shell), 15 * kPa)
        >>> print(f"{free.inflation / mm:.2f} mm")
        13.41 mm
        >>> slope = jax.grad(lambda p: sg.solve(sg.shell.Free(shell), p).inflation)(15 * kPa)
        >>> print(f"{slope / mm * kPa:.3f} mm per kPa")
        0.860 mm per kPa
    """
    if solver is None and guess is None:
        return equilibrium(*to_solve(scene, pressure))
    prepared, pressure = to_solve(scene, pressure)
    name = type(scene).__name__
    if type(prepared) is not type(scene) and (model := getattr(scene, "model", None)) is not None:
        name += f" with model={model!r}"
    return _solve_by(prepared, pressure, *_chosen(prepared, name, solver, guess))


def _chosen(scene: Scene, name: str, solver: Any, guess: Any) -> tuple[Solver, Array | None]:
    """A solver and the unknowns that it begins from, or one sentence about what is wrong with a scene of this name."""
    if solver is None:
        raise InputError("guess is for a solver that begins from one; give solver=sg.solvers.Newton(), too.")
    if not isinstance(solver, Solver):
        raise InputError(f"solver is {solver!r}; it must be one of sg.solvers, for instance sg.solvers.Newton().")
    if not solver.suits(scene):
        can = " or ".join(scene.SOLVERS) or "its own method alone: leave solver out"
        raise InputError(f"{name} cannot be solved by {type(solver).__name__}; it can by {can}.")
    if guess is None:
        return solver, None
    if not solver.takes_guess():
        raise InputError(f"{type(solver).__name__} begins at zero load and takes no guess; sg.solvers.Newton() does.")
    given = guess.unknowns if isinstance(guess, Solution) else to_float_array(guess)
    wanted = scene.unknown_shape()
    if not isinstance(given, jax.Array) or given.shape != wanted:
        shape = f"has unknowns of the shape {given.shape}" if isinstance(given, jax.Array) else f"is {guess!r}"
        raise InputError(
            f"guess {shape}, and the unknowns of this {name} have the shape {wanted}; it must be a "
            "Solution of a scene of the same kind, or its unknowns."
        )
    return solver, given


def to_solve(scene: Scene, pressure: Any) -> tuple[Scene, Scalar]:
    """What `solve` hands to its program."""
    return _checked(scene), _one_pressure(pressure)


def path(scene: Scene, pressures: Any) -> Solution:
    """The solutions at given pressures, on the branch connected to zero load.

    Args:
        scene: what to solve.
        pressures: gauge pressures, Pa, shape (n,), each zero or more, in any order.

    Returns:
        A `Solution` whose leaves have a first axis of n.

    Raises:
        InputError: where the scene or a pressure cannot be meant (outside of jit).

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> states = sg.path(sg.shell.Free(shell), [5 * kPa, 15 * kPa, 25 * kPa])
        >>> [sg.Status(int(status)).name for status in states.status]
        ['OK', 'OK', 'BEYOND_LIMIT']
    """
    scene = _checked(scene)
    checked = jnp.atleast_1d(require("pressures", pressures, "nonnegative", "pressure"))
    if checked.ndim > 1:
        raise InputError(f"pressures has the shape {checked.shape}; it must be one list of pressures.")
    return _path(scene, checked)


def branch(scene: Scene, n: int = 200) -> Solution:
    """The equilibrium curve through its limit point, at n points from where pressure begins to act.

    Unlike in `path` the pressure is a result: it rises to `limit_pressure` and falls behind it. States behind the limit
    are equilibria at a given volume and unstable at a given pressure. The limit is one of the points, or the last is
    just before it where the model ends there.

    The branch ends where, behind the limit, the pressure has fallen to half of it or is as large again (the state to
    which the scene snaps); of a finger or a grasp also where the pressure rises again behind the limit, or where the
    points along the beam become too few for its shape (more `points` lead further); where the model ends; where a
    membrane has inflated to ten times its half width, or an energy membrane is twice as far from flat as at its limit.
    A branch without a limit ends at 20 mu t_m / a. It is not differentiable: its points move along the curve with the
    scene.

    Args:
        scene: what to solve.
        n: number of points, 2 or more, dimensionless.

    Returns:
        A `Solution` whose leaves have a first axis of n.

    Raises:
        InputError: where the scene (outside of jit) or n cannot be meant, and where it is differentiated.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> curve = sg.branch(sg.shell.Free(shell))
        >>> bool(jnp.isclose(jnp.max(curve.pressure), sg.limit_pressure(sg.shell.Free(shell))))
        True
    """
    scene = _checked(scene)
    require_whole("n", n, 2)
    return _branch(jax.tree.map(_without_derivatives, scene), n)


def contact_pressure(scene: Scene) -> Scalar:
    """The pressure at which contact begins.

    Below it the force is exactly zero. Of a finger it is where the walls of its chambers touch, of a grasp where the
    tips begin to press.

    Args:
        scene: what to ask.

    Returns:
        The pressure, Pa, differentiable: 0 in free space, NaN for an impossible scene. Where nothing is ever touched it
            is inf; of a membrane of arcs it is the limit pressure of the free membrane, up to which none is.

    Raises:
        InputError: where the scene cannot be meant (outside of jit).

    Source: thesis appendix A.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{sg.contact_pressure(sg.shell.FlatContact(shell, distance=5 * mm)) / kPa:.4f} kPa")
        2.3159 kPa
    """
    return _contact_pressure(_checked(scene))


def limit_pressure(scene: Scene) -> Scalar:
    """The largest pressure with an equilibrium on the branch connected to zero load.

    It is a maximum of the load (a limit point, dp/du = 0), or where the model ends (the membrane is used up, an arc
    closes).

    Args:
        scene: what to ask.

    Returns:
        The pressure, Pa, differentiable: inf where there is no limit, NaN for an impossible scene. The branch of an
        energy membrane on an object may end where no maximum is met: derivatives are zero there.

    Raises:
        InputError: where the scene cannot be meant (outside of jit).

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{sg.limit_pressure(sg.shell.Free(shell)) / kPa:.4f} kPa")
        20.1756 kPa
    """
    return pressure_at_limit(to_limit(scene))


def to_limit(scene: Scene) -> Scene:
    """What `limit_pressure` hands to its program."""
    return _checked(scene)


def pressure_for(scene: Scene, **target: Any) -> Solution:
    """The solution whose pressure gives one observable its wanted value.

    The pressure is one more unknown and observable(u, p) = value is one more equation, solved together, without
    stepping.

    Args:
        scene: what to solve.
        target: one observable by its name and its value in SI, a scalar, for instance `force=2.0` (N); none for a grasp
            with a mass, which knows its own task.

    Returns:
        The `Solution`, whose `pressure` (Pa) is the answer; it has derivatives, too.

    Raises:
        InputError: for several targets, for an observable that the scene does not have or that no pressure changes, and
            for a value that cannot be meant (outside of jit).

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> inflated = sg.pressure_for(sg.shell.Free(shell), inflation=13.4067 * mm)
        >>> print(f"{inflated.pressure / kPa:.3f} kPa")
        15.000 kPa
    """
    return equilibrium_reaching(*to_reach(scene, **target))


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
    if name in scene.SAME_AT_ALL_PRESSURES:
        raise InputError(f"{name} is the same at every pressure; no pressure can give it another value.")
    wanted = require(name, value, "finite", scene.OBSERVABLES[name])
    if wanted.ndim:
        raise InputError(
            f"{name} has the shape {wanted.shape}, and pressure_for takes one number; type "
            f"jax.vmap(lambda {name}: sg.pressure_for(scene, {name}={name}))(values)."
        )
    return scene, name, wanted


@partial(traced_once, static_argnames="name")
def equilibrium_reaching(scene: Scene, name: str, value: Scalar) -> Solution:
    """The program of `pressure_for`, for what `to_reach` gives."""
    return scene.solver().solve_for(scene, name, value)
