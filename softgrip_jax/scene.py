"""The contracts of scenes and solvers. A scene states physics, a solver finds its states, and `questions` asks.

A scene says what its equations, unknowns, loads, observables and rules are, for one point, one scene and one pressure;
batching is `jax.vmap` outside. How its states are found is for `solvers`. The data flow of every question is the same:

    find (values only: brackets, bisection, continuation)  ->  implicit (attach derivatives)  ->  observe  ->  mask
"""

from __future__ import annotations

import abc
from collections.abc import Iterable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .errors import InputError
from .fields import Checked, admissible, rule_names
from .numerics.choice import largest
from .numerics.implicit import implicit, with_derivatives_of
from .numerics.xla import traced_once
from .reasons import BROKEN, Reason
from .results import Solution, Status, mask, stop_gradient_where_failed

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
    """Scaled norm of all that was to be solved; known once `verified`."""
    evaluated: tuple[Array, dict[str, Array]] | None = None
    """What `evaluated` says there, where it was asked already; known once `verified`."""
    reason: Int[Array, ""] | int = 0
    """A `Reason`, where more is known than the status says."""
    detail: Scalar | float = jnp.nan
    """The number that belongs to the reason."""
    end: Int[Array, ""] | int = 0
    """Of `find_limit`: what the branch ends with, a code of its kind of scene."""


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

    Its tolerances are its fields. `find` gives the unknowns and the status that they deserve; `solve` then judges the
    residual and the rules of the scene, r(u; scene, p) = 0 being solved to rounding or NOT_CONVERGED. A solver of your
    own needs no more than `find`, and says by `suits` itself which scenes it is for.

    Examples:
        >>> [solver.takes_guess() for solver in (sg.solvers.Newton(), sg.solvers.ArcLength())]
        [True, False]
        >>> sg.solvers.ArcLength().suits(sg.pneunet.TipContact(sg.PneuNet.table_5_1("A")))
        True
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


class BranchSolver(Solver):
    """A solver that knows the whole branch connected to zero load, so that it answers every question of a scene."""

    def in_turn(self) -> bool:
        """Whether a batch is solved one member after the other here, so that one more costs as much as each."""
        return False

    @abc.abstractmethod
    def onset(self, scene: Any) -> Scalar:
        """The pressure (Pa) at which something is first touched, or pressure begins to act; with its derivatives."""

    @abc.abstractmethod
    def find_limit(self, scene: Any) -> Found:
        """The end of the branch that `find` follows; pressure inf where it does not end."""

    @abc.abstractmethod
    def limit_pressure_from(self, scene: Any, found: Found) -> Scalar:
        """The limit pressure with its derivatives, from where `find_limit` found it."""

    @abc.abstractmethod
    def solve_for(self, scene: Any, name: str, target: Scalar) -> Solution:
        """The solution at the pressure that gives an observable its wanted value."""

    @abc.abstractmethod
    def branch(self, scene: Any, n: int, limit: Found | None = None) -> Solution:
        """n points of the equilibrium curve, through its limit point.

        limit: what `find_limit` found, where it was asked already.
        """

    def along(self, scene: Any, pressures: Float[Array, " n"]) -> Solution:
        """The solutions at several pressures."""
        return jax.vmap(equilibrium, in_axes=(None, 0))(scene, pressures)


class Scene(Checked):
    """An actuator and what surrounds it: its equations, unknowns, loads, observables and rules.

    A state solves r(u; scene, p) = 0, `residual`, with unknowns u (scaled, dimensionless) at a pressure p (Pa). Float
    leaves may vary and be differentiated by; choices are static. Most scenes derive from a class that asks for less:
    `curve_scene.CurveScene` where the pressure is an explicit function of one angle.

    Args:
        ignored_rules: names of rules that may be broken, for instance "walls_fit": their margins are still reported.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> scene = sg.shell.Free(shell)
        >>> isinstance(scene, sg.Scene), scene.OBSERVABLES["inflation"], scene.solver()
        (True, 'length', ExplicitCurve())
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ()
    """Names of the solvers (`sg.solvers`) that may be asked for, the kind of `solver` first."""

    OBSERVABLES: ClassVar[dict[str, str]] = {}
    """Observable -> kind of quantity (a key of units.DISPLAY)."""

    SAME_AT_ALL_PRESSURES: ClassVar[tuple[str, ...]] = ()
    """Observables that no pressure changes, so that none can be sought for them."""

    ignored_rules: tuple[str, ...] = rule_names(default=(), kw_only=True)

    @abc.abstractmethod
    def solver(self) -> BranchSolver:
        """What finds the states of this scene where the caller names no solver."""

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

    def unknown_shape(self) -> tuple[int, ...]:
        """The shape of the unknowns: () where there is one."""
        return ()

    def target(self) -> tuple[str, Scalar]:
        """What `pressure_for` seeks when the caller names nothing: only scenes with a task of their own know it."""
        raise InputError(f"pressure_for({type(self).__name__}) needs a target, for instance force=2.0 (in N).")

    def has_target(self) -> bool:
        """Whether scenes of this kind know a task of their own."""
        return type(self).target is not Scene.target

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
            if name not in self.ignored_rules and Reason[name.upper()].forbids:
                possible &= margin >= -BROKEN
        return possible

    def verified(self, found: Found) -> Found:
        """`found` with its residual, relabelled NOT_CONVERGED where that is not small."""
        found = frozen(found)
        evaluated = found.evaluated or frozen(self).searched().evaluated(found.unknowns, found.pressure)
        own = largest(jnp.abs(jnp.atleast_1d(evaluated[0])))
        # Rounding leaves a residual in proportion to the unknowns.
        own = (
            own
            / jnp.maximum(1.0, largest(jnp.abs(found.unknowns)))
            / (1 + found.rounding * (ROUNDING_EPS / RESIDUAL_EPS))
        )
        residual = jnp.maximum(own, jnp.abs(found.mismatch))
        small = residual <= RESIDUAL_EPS * jnp.finfo(residual.dtype).eps
        failed = (found.status == Status.OK) & ~small
        status = jnp.where(failed, Status.NOT_CONVERGED, found.status)
        return found._replace(status=status, residual=residual, evaluated=evaluated)

    def solution_of(self, found: Found) -> Solution:
        """Attach derivatives to a found equilibrium at a given pressure, observe, and mask."""
        pressure = found.pressure
        found = self.verified(found)
        ok = found.status == Status.OK
        scene, pressure = stop_gradient_where_failed(ok, (self, pressure))
        # Where a state failed its Jacobian may be singular: the tangent of its unknowns would be 0 / 0.
        unknowns = stop_gradient_where_failed(ok, scene.with_implicit_derivative(found.unknowns, pressure))
        return self.report_of(unknowns, pressure, found)

    def with_implicit_derivative(self, unknowns: Array, pressure: Scalar) -> Array:
        """Unknowns that solve `residual`, with their derivatives by everything in the scene and by the pressure."""
        return implicit(lambda y, args: args[0].residual(y, args[1]), unknowns, (self, pressure))

    def report_of(self, unknowns: Array, pressure: Scalar, found: Found) -> Solution:
        """The Solution of a verified point; `unknowns` and `pressure` carry the derivatives."""
        assert found.evaluated is not None
        ok = found.status == Status.OK
        scene = stop_gradient_where_failed(ok, self)
        # What is observed of the scene alone, as a required force, is one number for a batch of pressures; its
        # derivative passes `scene` and is a batch. JAX wants both alike.
        values = jax.tree.map(lambda value: jnp.where(ok, value, value), found.evaluated[1])
        observed = with_derivatives_of(lambda args: args[0].observe(*args[1:]), values, (scene, unknowns, pressure))
        margins, status, reason, detail = self._after_rules(scene, unknowns, pressure, found)
        observables = mask(status, observed)
        return Solution(
            scene, pressure, status, found.residual, found.iterations, unknowns, observables, reason, detail, margins
        )

    def _after_rules(self, solved_scene: Scene, unknowns: Array, pressure: Scalar, found: Found):
        """(margins, status, reason, detail): a state that breaks a rule is IMPOSSIBLE, whatever the equations say."""
        solved = found.status == Status.OK
        of_state = solved_scene.margins_of_state(unknowns, pressure)
        margins = self.margins_at_rest() | {k: jnp.where(solved, v, jnp.nan) for k, v in of_state.items()}
        reason, detail = jnp.asarray(found.reason), jnp.asarray(found.detail, pressure.dtype)
        for status, general in GENERAL.items():
            reason = jnp.where((reason == 0) & (found.status == status), int(general), reason)
        # A field that breaks its own rule is named before what follows from it.
        unfit = (found.status == Status.IMPOSSIBLE) & (reason == Reason.PARTS_DO_NOT_FIT)
        reason = jnp.where(unfit & ~admissible(self), int(Reason.FIELD_RULE), reason)
        is_open = solved | (unfit & (reason != Reason.FIELD_RULE))
        asked = [(name, lax.stop_gradient(v)) for name, v in margins.items() if name not in self.ignored_rules]
        status, reason, detail = with_rules(asked, is_open, found.status, reason, detail)
        return margins, status, jnp.where(status == Status.OK, 0, reason), detail


def with_rules(margins: Iterable[tuple[str, Array]], is_open: Array, status: Array, reason: Any, detail: Any):
    """(status, reason, detail) of a state: IMPOSSIBLE where it is open to rules and breaks one that forbids, for the
    worst of them. margins: (name of a rule, m)."""
    worst = jnp.full_like(detail, -BROKEN)
    for name, margin in margins:
        rule = Reason[name.upper()]
        if rule.forbids:
            broken = is_open & (margin < worst)
            status = jnp.where(broken, int(Status.IMPOSSIBLE), status)
            reason = jnp.where(broken, int(rule), reason)
            detail, worst = jnp.where(broken, margin, detail), jnp.where(broken, margin, worst)
    return status, reason, detail


def type_name(cls: type) -> str:
    """How `type` names a class: the package's scenes by room and class ('shell.Grasp'), all else by class alone."""
    package, _, rooms = cls.__module__.partition(".")
    if not issubclass(cls, Scene) or package != __name__.partition(".")[0]:
        return cls.__name__
    return f"{rooms.split('.')[0]}.{cls.__name__}"


def frozen(tree: Any) -> Any:
    """The same values without derivatives."""
    return jax.tree.map(lax.stop_gradient, tree)


@traced_once
def equilibrium(scene: Scene, pressure: Scalar) -> Solution:
    """The state at a pressure by the scene's own solver."""
    fixed = frozen(scene)
    return scene.solution_of(scene.solver().find(fixed, lax.stop_gradient(pressure), None)._replace(pressure=pressure))
