"""The contract of a scene, and the four questions that can be asked of one: solve, path, pressure_for, limit_pressure.

An author writes physics for one point, one scene and one pressure; batching is `jax.vmap` outside. The data flow of
every question is the same:

    find (values only: brackets, bisection, continuation)  ->  implicit (attach derivatives)  ->  observe  ->  mask
"""

from __future__ import annotations

import abc
from functools import partial
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .checked import Checked, admissible, require
from .numerics.curves import crossing, events, first_stop
from .numerics.roots import implicit
from .results import Solution, Status, gate, mask

Scalar = Float[Array, ""]

RESIDUAL_EPS = 4096
"""A root counts as found when its scaled residual is under RESIDUAL_EPS machine epsilons: 9e-13 in float64."""


class Found(NamedTuple):
    """A point of equilibrium as the numerics return it: values only, no derivatives."""

    unknowns: Any
    pressure: Scalar
    status: Int[Array, ""]
    iterations: Int[Array, ""]


class Scene(Checked):
    """An actuator and what surrounds it. Subclasses say how to find an equilibrium and which equations it solves."""

    OBSERVABLES: ClassVar[dict[str, str]] = {}
    """Observable -> kind of quantity (a key of units.DISPLAY)."""

    @abc.abstractmethod
    def find(self, pressure: Scalar) -> Found:
        """The equilibrium at a pressure, on the branch that is connected to zero load."""

    @abc.abstractmethod
    def residual(self, unknowns: Array, pressure: Scalar) -> Array:
        """The scaled equations, zero in equilibrium; shaped as the unknowns."""

    @abc.abstractmethod
    def observe(self, unknowns: Array, pressure: Scalar) -> dict[str, Array]:
        """Everything reported, in SI, from the unknowns."""

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

    def target(self) -> tuple[str, Scalar]:
        """What `pressure_for` seeks when the caller names nothing: only scenes with a task of their own know it."""
        raise ValueError(f"pressure_for({type(self).__name__}) needs a target, for instance force=2.0 (in N).")

    def profile(self, unknowns: Array, pressure: Scalar, n: int) -> dict[str, Array]:
        """The deformed shape at n points."""
        raise NotImplementedError(f"{type(self).__name__} has no shape.")

    def is_possible(self) -> Bool[Array, ""]:
        """False where the parts do not fit together (beyond each field's own rule)."""
        return jnp.asarray(True)

    def _solution(self, found: Found) -> Solution:
        """Attach derivatives to a found equilibrium at a given pressure, observe, and mask."""
        found, pressure = frozen(found), found.pressure
        ok = found.status == Status.OK
        scene, pressure = gate(ok, (self, pressure))
        unknowns = implicit(lambda y, args: args[0].residual(y, args[1]), found.unknowns, (scene, pressure))
        return scene._report(unknowns, pressure, found)

    def _report(self, unknowns: Array, pressure: Scalar, found: Found) -> Solution:
        residual = jnp.max(jnp.abs(jnp.atleast_1d(lax.stop_gradient(self.residual(unknowns, pressure)))))
        status = found.status
        small = residual <= RESIDUAL_EPS * jnp.finfo(residual.dtype).eps
        status = jnp.where((status == Status.OK) & ~small, Status.NOT_CONVERGED, status)
        observables = mask(status, self.observe(unknowns, pressure))
        return Solution(self, pressure, status, residual, found.iterations, unknowns, observables)


class CurveScene(Scene):
    """A scene whose pressure is an explicit function of one angle: every question is one scalar root.

    An author gives `interval`, `load`, `observe`, and where the model ends (`margins`). The pressure rises with the
    angle up to the first limit point, which is where equilibrium under pressure control ends.
    """

    CONTACT: ClassVar[bool] = True
    """Whether the angle starts where something is first touched (a lower pressure is then NO_CONTACT)."""

    @abc.abstractmethod
    def interval(self) -> tuple[Scalar, Scalar]:
        """The angles where the state begins and where its geometry ends (the load need not exist at the end)."""

    @abc.abstractmethod
    def load(self, angle: Scalar) -> Scalar:
        """The pressure that holds the scene at this angle, Pa."""

    @abc.abstractmethod
    def pressure_scale(self) -> Scalar:
        """A pressure typical of the design, Pa: makes the residual a pure number."""

    def margins(self, angle: Scalar) -> Float[Array, " m"]:
        """Pure numbers that stay positive while the model holds."""
        return jnp.zeros((0,), dtype=angle.dtype)

    def unbounded(self) -> Bool[Array, ""]:
        """True where the load grows without bound towards the end of the interval: there is then no limit."""
        return jnp.asarray(False)

    def residual(self, unknowns, pressure):
        return (self.load(unknowns) - pressure) / (self.pressure_scale() + jnp.abs(pressure))

    def find(self, pressure):
        start, _ = self.interval()
        low, high = self.load(start), self.find_limit()
        angle, iterations = crossing(self.load, pressure, start, high.unknowns)
        status = jnp.where(pressure > high.pressure, Status.BEYOND_LIMIT, Status.OK)
        status = jnp.where(pressure <= low, Status.NO_CONTACT if self.CONTACT else Status.OK, status)
        angle = jnp.where(pressure <= low, start, angle)
        possible = (high.status != Status.IMPOSSIBLE) & (pressure >= 0) & (pressure < jnp.inf)
        return Found(angle, pressure, jnp.where(possible, status, Status.IMPOSSIBLE), iterations)

    def find_limit(self):
        start, end = self.interval()
        stop = first_stop(self.load, self.margins, start, end)
        possible = admissible(self) & self.is_possible() & (start < end)
        endless = self.unbounded() & (stop.event == -1)
        pressure = jnp.where(endless, jnp.inf, self.load(stop.x))
        return Found(stop.x, pressure, jnp.where(possible, Status.OK, Status.IMPOSSIBLE), stop.event)

    def limit_pressure_from(self, found):
        event = found.iterations
        ok = (found.status == Status.OK) & jnp.isfinite(found.pressure)
        scene = gate(ok, self)

        def stops(angle, args):
            scene, event = args
            quantities = events(scene.load, scene.margins)(angle)
            return quantities[jnp.maximum(event, 0)]

        at_event = implicit(stops, found.unknowns, (scene, event))
        at_end = scene.interval()[1]
        pressure = scene.load(jnp.where(event < 0, at_end, at_event))
        return jnp.where(ok, pressure, jnp.where(found.status == Status.OK, jnp.inf, jnp.nan))

    def solve_for(self, name, target):
        fixed = frozen(self)

        def wanted(scene, angle):
            return scene.observe(angle, scene.load(angle))[name]

        start, _ = fixed.interval()
        limit = fixed.find_limit()
        value = lax.stop_gradient(target)
        angle, iterations = crossing(lambda x: wanted(fixed, x), value, start, limit.unknowns)
        low, high = wanted(fixed, start), wanted(fixed, limit.unknowns)
        scale = jnp.maximum(jnp.abs(value), 1e-6 * jnp.abs(high))
        status = jnp.where(value > high, Status.BEYOND_LIMIT, jnp.where(value <= low, Status.NO_CONTACT, Status.OK))
        status = jnp.where((limit.status == Status.IMPOSSIBLE) | ~jnp.isfinite(value), Status.IMPOSSIBLE, status)
        found = Found(angle, fixed.load(angle), status, iterations)
        scene, target = gate(status == Status.OK, (self, target))
        angle = implicit(lambda x, args: (wanted(args[0], x) - args[1]) / args[2], angle, (scene, target, scale))
        pressure = scene.load(angle)
        solution = scene._report(angle, pressure, found)
        no_answer = jnp.where(status == Status.NO_CONTACT, fixed.load(start), jnp.nan)
        return solution.at_pressure(jnp.where(solution.status == Status.OK, pressure, no_answer))

    def branch(self, n):
        start, end = self.interval()

        def at(fraction):
            angle = start + fraction * (end - start)
            pressure = self.load(angle)
            holds = jnp.all(self.margins(angle) >= 0) & jnp.isfinite(pressure)
            status = jnp.where(holds, Status.OK, Status.BEYOND_LIMIT)
            return self._report(angle, pressure, Found(angle, pressure, status, jnp.asarray(0)))

        # The end of the interval itself may be singular (a flat membrane turned inside out): stop just before.
        return jax.vmap(at)(jnp.linspace(0.0, 1.0 - 1e-6, n))


def frozen(tree: Any) -> Any:
    """The same values without derivatives."""
    return jax.tree.map(lax.stop_gradient, tree)


def _require_float64() -> None:
    if not jax.config.jax_enable_x64:
        raise RuntimeError(
            "softgrip_jax needs float64, which is switched off: remove JAX_ENABLE_X64=0 or the call of "
            "jax.config.update('jax_enable_x64', False) after the import."
        )


def _require_scene(scene: Any) -> None:
    if not isinstance(scene, Scene):
        raise ValueError(f"scene is {scene!r}; it must be a Scene, for instance sg.shell.Free(...).")


@jax.jit
def _solve(scene: Scene, pressure: Scalar) -> Solution:
    return scene._solution(frozen(scene).find(lax.stop_gradient(pressure))._replace(pressure=pressure))


@jax.jit
def _limit_pressure(scene: Scene) -> Scalar:
    return scene.limit_pressure_from(frozen(frozen(scene).find_limit()))


@jax.jit
def _path(scene: Scene, pressures: Float[Array, " n"]) -> Solution:
    return jax.vmap(_solve, in_axes=(None, 0))(scene, pressures)


@partial(jax.jit, static_argnames="n")
def _branch(scene: Scene, n: int) -> Solution:
    return scene.branch(n)


def solve(scene: Scene, pressure: Any) -> Solution:
    """The equilibrium of a scene at a pressure.

    Args:
        scene: what to solve; any float leaf of it may be traced or batched by vmap.
        pressure: gauge pressure in the actuator, Pa, zero or more.

    Returns: a Solution. A scene without equilibrium is not an error: see `Solution.status`.
    Raises: ValueError for a pressure that cannot be meant (outside jit); RuntimeError where float64 is off.
    """
    _require_float64()
    _require_scene(scene)
    return _solve(scene, require("pressure", pressure, "nonnegative", "pressure"))


def path(scene: Scene, pressures: Any) -> Solution:
    """The curve of solutions at the given pressures (Pa), on the branch connected to zero load; a batched Solution."""
    _require_float64()
    _require_scene(scene)
    return _path(scene, jnp.atleast_1d(require("pressures", pressures, "nonnegative", "pressure")))


def branch(scene: Scene, n: int = 200) -> Solution:
    """The equilibrium curve through its limit point, at n points from where pressure begins to act.

    Unlike `path` the pressure is a result here: it rises to `limit_pressure` and falls behind it. The points behind
    the limit are equilibria under volume control, unstable under pressure control.
    """
    _require_float64()
    _require_scene(scene)
    return _branch(scene, n)


def limit_pressure(scene: Scene) -> Scalar:
    """The largest pressure (Pa) with an equilibrium on the branch connected to zero load.

    A maximum of the load (limit point) or the end of the model (the membrane used up); inf where neither exists,
    NaN for an impossible scene. Differentiable.
    """
    _require_float64()
    _require_scene(scene)
    return _limit_pressure(scene)


def pressure_for(scene: Scene, **target: Any) -> Solution:
    """The inverse problem: the solution (with `.pressure`) that gives one observable its wanted value, no stepping.

    Args:
        scene: what to solve.
        target: one observable and its value in SI, for instance ``force=2.0``; none for a grasp, which knows its own.
    """
    _require_float64()
    _require_scene(scene)
    if len(target) > 1:
        raise ValueError(f"pressure_for got {len(target)} targets ({', '.join(target)}); one pressure can meet one.")
    name, value = next(iter(target.items())) if target else scene.target()
    if scene.OBSERVABLES.get(name) is None:
        allowed = ", ".join(scene.OBSERVABLES)
        raise ValueError(f"{type(scene).__name__} has no observable {name!r}; it has: {allowed}.")
    return _pressure_for(scene, name, require(name, value, "finite", scene.OBSERVABLES[name]))


@partial(jax.jit, static_argnames="name")
def _pressure_for(scene: Scene, name: str, value: Scalar) -> Solution:
    return scene.solve_for(name, value)
