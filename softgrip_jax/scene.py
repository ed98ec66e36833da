"""The contract of a scene, and the four questions that can be asked of one: solve, path, pressure_for, limit_pressure.

An author writes physics for one point, one scene and one pressure; batching is `jax.vmap` outside. The data flow of
every question is the same:

    find (values only: brackets, bisection, continuation)  ->  implicit (attach derivatives)  ->  observe  ->  mask
"""

from __future__ import annotations

import abc
from functools import partial
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .errors import InputError
from .fields import Checked, admissible, batched_field, require, rule_names, to_float_array
from .numerics.roots import implicit, with_derivatives_of
from .reasons import BROKEN, Reason
from .results import Solution, Status, gate, mask

Scalar = Float[Array, ""]

RESIDUAL_EPS = 4096
"""A root counts as found when its scaled residual is under RESIDUAL_EPS machine epsilons: 9e-13 in float64."""
ROUNDING_EPS = 64
"""... and so many more for each part of rounding that the equations make of one (seen next to a lock: 5)."""


FALLEN = 0.5
"""A branch is followed behind its limit until the pressure has fallen to this part of the limit: far enough to see the
limit as one, and not to where a membrane at almost no pressure is kilometres wide."""
WITHOUT_LIMIT = 20.0
"""Where the pressure grows without bound a branch is followed to this many times mu t_m / a: the largest limit of a
design of the thesis is 17 (the wall of a chamber of type A, 516 kPa)."""


class Found(NamedTuple):
    """A point of equilibrium as the numerics return it: values only, no derivatives."""

    unknowns: Any
    pressure: Scalar
    status: Int[Array, ""]
    iterations: Int[Array, ""]
    mismatch: Scalar | float = 0.0
    """Scaled error of whatever was asked for beyond the scene's own equations (the target of `pressure_for`)."""
    rounding: Scalar | float = 0.0
    """What one part of rounding in the unknowns leaves of the scaled equations, where that is more than one part."""
    residual: Scalar | float = 0.0
    """Scaled norm of all that was to be solved; known once `settled`."""
    seen: tuple[Array, dict[str, Array]] | None = None
    """What `evaluated` says there, where it was asked already; known once `settled`."""
    reason: Int[Array, ""] | int = 0
    """A `Reason`, where more is known than the status says."""
    detail: Scalar | float = jnp.nan
    """The number that belongs to the reason."""


GENERAL = {
    Status.OK: Reason.NONE,
    Status.NO_CONTACT: Reason.NOTHING_TOUCHED,
    Status.BEYOND_LIMIT: Reason.NO_EQUILIBRIUM,
    Status.IMPOSSIBLE: Reason.PARTS_DO_NOT_FIT,
    Status.NOT_CONVERGED: Reason.RESIDUAL_TOO_LARGE,
}
"""The reason of a status about which nothing more is known."""


class Solver(eqx.Module):
    """How the equilibrium at a pressure is found: values only, derivatives are attached to what is found.

    `find` gives the unknowns and the status that they deserve; `solve` then judges the residual, and the rules.
    """

    @abc.abstractmethod
    def find(self, scene: Any, pressure: Scalar, guess: Array | None) -> Found:
        """The equilibrium of a scene at a pressure, from a guess of its unknowns where one is given."""

    def suits(self, scene: Scene) -> bool:
        """Whether this solver can be used for a scene."""
        return type(self).__name__ in scene.SOLVERS

    def takes_guess(self) -> bool:
        """Whether the search begins from a guess."""
        return False


class Scene(Checked):
    """An actuator and what surrounds it. Subclasses say how to find an equilibrium and which equations it solves."""

    SOLVERS: ClassVar[tuple[str, ...]] = ()
    """Names of the solvers (`sg.solvers`) that may be used in place of `find`; the first does what `find` does."""

    OBSERVABLES: ClassVar[dict[str, str]] = {}
    """Observable -> kind of quantity (a key of units.DISPLAY)."""

    ignored_rules: tuple[str, ...] = rule_names(default=(), kw_only=True)
    """Rules that may be broken, by name: their margins are still reported."""

    @abc.abstractmethod
    def find(self, pressure: Scalar) -> Found:
        """The equilibrium at a pressure, on the branch that is connected to zero load."""

    @abc.abstractmethod
    def residual(self, unknowns: Array, pressure: Scalar) -> Array:
        """The scaled equations, zero in equilibrium; shaped as the unknowns."""

    @abc.abstractmethod
    def observe(self, unknowns: Array, pressure: Scalar) -> dict[str, Array]:
        """Everything reported, in SI, from the unknowns."""

    def evaluated(self, unknowns: Array, pressure: Scalar) -> tuple[Array, dict[str, Array]]:
        """(`residual`, `observe`), for scenes that have both from one computation."""
        return self.residual(unknowns, pressure), self.observe(unknowns, pressure)

    def searched(self) -> Any:
        """The scene as searches use it, which ask for values and forward derivatives of first order alone."""
        return self

    @abc.abstractmethod
    def onset(self) -> Scalar:
        """The pressure (Pa) at which something is first touched, or pressure begins to act; with its derivatives."""

    @abc.abstractmethod
    def find_limit(self) -> Found:
        """The end of the branch that `find` follows; pressure inf where it does not end."""

    @abc.abstractmethod
    def limit_pressure_from(self, found: Found) -> Scalar:
        """The limit pressure with its derivatives, from where `find_limit` found it."""

    @abc.abstractmethod
    def solve_for(self, name: str, target: Scalar) -> Solution:
        """The solution at the pressure that gives an observable its wanted value."""

    @abc.abstractmethod
    def branch(self, n: int) -> Solution:
        """n points of the equilibrium curve, through its limit point."""

    def unknown_shape(self) -> tuple[int, ...]:
        """The shape of the unknowns: () where there is one."""
        return ()

    def along(self, pressures: Float[Array, " n"]) -> Solution:
        """The solutions at several pressures."""
        return jax.vmap(_solve, in_axes=(None, 0))(self, pressures)

    def target(self) -> tuple[str, Scalar]:
        """What `pressure_for` seeks when the caller names nothing: only scenes with a task of their own know it."""
        raise InputError(f"pressure_for({type(self).__name__}) needs a target, for instance force=2.0 (in N).")

    def prepared(self) -> Scene:
        """The scene with choices made that need known numbers; called outside of jit, before anything else."""
        return self

    def profile(self, unknowns: Array, pressure: Scalar, n: int) -> dict[str, Array]:
        """The deformed shape at n points."""
        raise NotImplementedError(f"{type(self).__name__} has no shape.")

    def is_possible(self) -> Bool[Array, ""]:
        """False where the equations have no meaning (beyond each field's own rule)."""
        return jnp.asarray(True)

    def margins_at_rest(self) -> dict[str, Scalar]:
        """Margins (m) of the rules that the undeformed parts keep: name of a `Reason` in small letters -> margin."""
        return {}

    def margins_of_state(self, unknowns: Array, pressure: Scalar) -> dict[str, Scalar]:
        """Margins (m) of the rules that a deformed state keeps."""
        return {}

    def can_exist(self) -> Bool[Array, ""]:
        """True where every field keeps its rule, the equations have a meaning and the parts at rest keep theirs."""
        possible = admissible(self) & self.is_possible()
        for name, margin in self.margins_at_rest().items():
            if name not in self.ignored_rules:
                possible &= margin >= -BROKEN
        return possible

    def settled(self, found: Found) -> Found:
        """`found` with its residual, relabelled NOT_CONVERGED where that is not small: before it gates anything."""
        found = frozen(found)
        seen = found.seen or frozen(self).searched().evaluated(found.unknowns, found.pressure)
        own = jnp.max(jnp.abs(jnp.atleast_1d(seen[0])))
        # Rounding leaves a residual in proportion to the unknowns.
        own = (
            own
            / jnp.maximum(1.0, jnp.max(jnp.abs(found.unknowns)))
            / (1 + found.rounding * (ROUNDING_EPS / RESIDUAL_EPS))
        )
        residual = jnp.maximum(own, jnp.abs(found.mismatch))
        small = residual <= RESIDUAL_EPS * jnp.finfo(residual.dtype).eps
        failed = (found.status == Status.OK) & ~small
        status = jnp.where(failed, Status.NOT_CONVERGED, found.status)
        return found._replace(status=status, residual=residual, seen=seen)

    def _solution(self, found: Found) -> Solution:
        """Attach derivatives to a found equilibrium at a given pressure, observe, and mask."""
        pressure = found.pressure
        found = self.settled(found)
        scene, pressure = gate(found.status == Status.OK, (self, pressure))
        return self._report(scene.rooted(found.unknowns, pressure), pressure, found)

    def rooted(self, unknowns: Array, pressure: Scalar) -> Array:
        """Unknowns that solve `residual`, with their derivatives by everything in the scene and by the pressure."""
        return implicit(lambda y, args: args[0].residual(y, args[1]), unknowns, (self, pressure))

    def _report(self, unknowns: Array, pressure: Scalar, found: Found) -> Solution:
        """The Solution of a settled point; `unknowns` and `pressure` carry the derivatives."""
        assert found.seen is not None
        scene = gate(found.status == Status.OK, self)
        observed = with_derivatives_of(
            lambda args: args[0].observe(*args[1:]), found.seen[1], (scene, unknowns, pressure)
        )
        margins, status, reason, detail = self._judged_by_rules(scene, unknowns, pressure, found)
        observables = mask(status, observed)
        return Solution(
            scene, pressure, status, found.residual, found.iterations, unknowns, observables, reason, detail, margins
        )

    def _judged_by_rules(self, gated: Scene, unknowns: Array, pressure: Scalar, found: Found):
        """(margins, status, reason, detail): a state that breaks a rule is IMPOSSIBLE, whatever the equations say."""
        solved = found.status == Status.OK
        of_state = gated.margins_of_state(unknowns, pressure)
        margins = self.margins_at_rest() | {k: jnp.where(solved, v, jnp.nan) for k, v in of_state.items()}
        reason, detail = jnp.asarray(found.reason), jnp.asarray(found.detail, pressure.dtype)
        for status, general in GENERAL.items():
            reason = jnp.where((reason == 0) & (found.status == status), int(general), reason)
        # A field that breaks its own rule is named before what follows from it.
        unfit = (found.status == Status.IMPOSSIBLE) & (reason == Reason.PARTS_DO_NOT_FIT)
        reason = jnp.where(unfit & ~admissible(self), int(Reason.FIELD_RULE), reason)
        status, worst = found.status, jnp.asarray(-BROKEN, pressure.dtype)
        open_to_rules = solved | (unfit & (reason != Reason.FIELD_RULE))
        for name, margin in margins.items():
            if name in self.ignored_rules:
                continue
            value = lax.stop_gradient(margin)
            broken = open_to_rules & (value < worst)
            status = jnp.where(broken, Status.IMPOSSIBLE, status)
            reason = jnp.where(broken, int(Reason[name.upper()]), reason)
            detail, worst = jnp.where(broken, value, detail), jnp.where(broken, value, worst)
        return margins, status, jnp.where(status == Status.OK, 0, reason), detail


def frozen(tree: Any) -> Any:
    """The same values without derivatives."""
    return jax.tree.map(lax.stop_gradient, tree)


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
def _solve(scene: Scene, pressure: Scalar) -> Solution:
    return scene._solution(frozen(scene).find(lax.stop_gradient(pressure))._replace(pressure=pressure))


@jax.jit
def _solve_by(scene: Scene, pressure: Scalar, solver: Solver, guess: Array | None) -> Solution:
    fixed, at, near = frozen((scene, pressure, guess))
    return scene._solution(solver.find(fixed, at, near)._replace(pressure=pressure))


@jax.jit
def _contact_pressure(scene: Scene) -> Scalar:
    possible = scene.can_exist()
    return jnp.where(possible, gate(possible, scene).onset(), jnp.nan)


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
        return _solve(*to_solve(scene, pressure))
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
