"""Scenes with several unknowns: every question follows the branch from zero load by arc length.

The path has one parameter: first the external loads grow from nothing to their full size, then the pressure grows from
the value at which it begins to act. What is found is therefore on the branch connected to zero load, never a loop.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..equations import PathEquations, residual_and_observables
from ..errors import require_whole
from ..load_path import Goal, LoadPath, PathEnd, begun, onwards, proportional, start_of, to_coordinate, to_moderate
from ..numerics.choice import larger
from ..numerics.continuation import (
    BIFURCATION,
    DETOUR,
    ENDED,
    FIRST_STEP,
    FOLD,
    LARGEST_STEP,
    MAX_STEPS,
    REACHED,
    TURN,
    Climb,
    End,
    Steps,
    follow,
)
from ..reasons import Reason
from ..results import Status
from ..scene import BranchSolver, Found
from . import path_limits, path_values
from .climb import climb_to
from .settings import require_number

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
AT_THE_EDGE = 1e-5
"""A path that ends is at the edge of the model where no more than this part is left of what a part can hold: its last
steps are SMALLEST_STEP, 1e-7, long."""


class ArcLength(BranchSolver):
    """Arc-length continuation from zero load to the pressure, for scenes with several unknowns.

    It is what fingers use by themselves. The predictor goes along the tangent of the path, Newton's method corrects
    across it (see `numerics.continuation`, also for the libraries that were looked at). A limit point on the way is
    BEYOND_LIMIT, a bifurcation under the loads is IMPOSSIBLE. The answer is solved to rounding whatever the steps;
    their length only decides how sure it is that no step goes from one branch to another.

    Args:
        first_step: arc length that is tried first while external loads grow, dimensionless (scaled unknowns and loads).
        largest_step: of any step, dimensionless; also the first one where the pressure acts alone, where the path is
            nearly straight.
        turn: cosine of the largest turn of the tangent in one step, dimensionless, between 0 and 1.
        max_steps: NOT_CONVERGED where more are needed.
        detour: the largest correction of a step over its length, dimensionless, between 0 and 1. Small ones see limit
            points that follow close on each other, as where one chamber after the other snaps.

    Raises:
        InputError: where a number is out of its range.

    Source: Riks 1979, Crisfield 1981 for the method.

    Examples:
        >>> held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=8)
        >>> short = sg.solvers.ArcLength(largest_step=0.5)
        >>> print(f"{sg.solve(held, 31 * kPa, solver=short).tip_force:.5f} N")
        0.12662 N
    """

    first_step: float = eqx.field(static=True, default=FIRST_STEP)
    largest_step: float = eqx.field(static=True, default=LARGEST_STEP)
    turn: float = eqx.field(static=True, default=TURN)
    max_steps: int = eqx.field(static=True, default=MAX_STEPS)
    detour: float = eqx.field(static=True, default=DETOUR)

    def __check_init__(self) -> None:
        for name in ("first_step", "largest_step"):
            require_number(f"ArcLength.{name}", getattr(self, name))
        require_number("ArcLength.turn", self.turn, 1.0, "a cosine between 0 and 1")
        require_number("ArcLength.detour", self.detour, 1.0, "a number between 0 and 1")
        require_whole("ArcLength.max_steps", self.max_steps, 1)

    def find(self, scene: Any, pressure, guess):
        known = scene.explicit(pressure)
        if known is not None:
            return known
        span = scene.pressure_span()
        if scene.grows_together():
            ray = proportional(span, jnp.minimum(pressure, span.end))
            found, beyond = (
                self.search(scene, start_of(scene, span), to_coordinate, ray.loading, ray),
                pressure > span.end,
            )
        else:
            wanted = span.coordinate_of(pressure)
            reachable = jnp.minimum(wanted, span.last())
            start = begun(scene, start_of(scene, span), span, reachable)
            found = self.search(scene, start, to_coordinate, reachable, span, climb=climb_to(reachable, scene, span))
            beyond = wanted > reachable
        ended = (found.status == Status.OK) & beyond
        status = jnp.where(ended, Status.BEYOND_LIMIT, found.status)
        reason = jnp.where(ended, int(scene.end_reason()), found.reason)
        detail = jnp.where(ended, span.end, found.detail)
        unknowns, taken = found.u[:-1], found.iterations
        return asked_for(pressure, Found(unknowns, pressure, status, taken, reason=reason, detail=detail))

    def onset(self, scene):
        name = scene.touches_where_positive()
        if name is None:
            return scene.pressure_span().begin
        return path_values.onset(self, scene, name)

    def find_limit(self, scene):
        """As `Found`; its reason says which end it is, and is none for the end of the actuator's own model."""
        known = scene.explicit_limit()
        if known is not None:
            return known
        span = scene.pressure_span()
        start, way, last, before = begun(scene, start_of(scene, span), span), span, span.last(), None
        if scene.grows_together():
            ray, moderate = to_moderate(span)
            before = self.search(scene, start_of(scene, span), to_coordinate, ray.loading, ray)
            start, way, last = before.u.at[-1].set(0.0), onwards(ray, moderate), (span.end - moderate) / span.step
        climb = climb_to(last, scene, way) if before is None else None
        u, status, steps, reason, detail = self.search(scene, start, to_coordinate, last, way, climb=climb)
        if before is not None:
            status = jnp.where(before.status == Status.OK, status, Status.IMPOSSIBLE)
        early = status == Status.BEYOND_LIMIT
        pressure = jnp.where(early, detail, span.end)
        status, reason = jnp.where(early, Status.OK, status), jnp.where(early, reason, 0)
        return Found(u[:-1], pressure, status, steps, reason=reason)

    def limit_pressure_from(self, scene, found):
        return path_limits.limit_pressure_from(scene, found)

    def solve_for(self, scene, name, target):
        return path_values.solve_for(self, scene, name, target)

    def branch(self, scene, n, limit=None):
        return path_limits.branch(self, scene, n)

    def search(
        self,
        scene: Any,
        start: Vector,
        goal: Goal,
        context: Any,
        span: LoadPath,
        is_there: Bool[Array, ""] | bool = False,
        climb: Climb | None = None,
    ) -> PathEnd:
        """Where goal(context, ...) rises through zero along the path from `start`; `start` itself where `is_there`."""

        def equations(u, args):
            scene, context, span = args
            residual, observed = residual_and_observables(scene, u[:-1], span.load_factor_at(u), span.load_at(u))
            passed, wanted = scene.passed(observed), goal(context, u, observed)
            return residual, wanted if passed is None else larger(wanted, passed)

        # Where the pressure alone acts the path is nearly straight.
        by = Steps(self.first_step, self.largest_step, self.turn, self.max_steps, self.detour)
        first = jnp.where(start[-1] >= span.loading, by.largest, by.first)
        end = follow(equations, start, (scene.searched(), context, span), first, by, is_there, climb)
        folded = end.reason == FOLD
        # A fold before the pressure acts: the other loads alone have no equilibrium. Where the finger buckles under
        # them the state beyond is not stable.
        is_loading = end.u[-1] <= span.loading
        not_held = is_loading & (folded | (end.reason == BIFURCATION))
        together = scene.grows_together()
        folded &= ~is_loading
        status = jnp.where(end.reason == REACHED, Status.OK, Status.NOT_CONVERGED)
        without = Status.BEYOND_LIMIT if together else Status.IMPOSSIBLE
        status = jnp.where(folded, Status.BEYOND_LIMIT, jnp.where(not_held, without, status))
        beyond = _beyond_the_model(scene, end, goal, context, span)
        status = jnp.where(beyond > 0, Status.BEYOND_LIMIT, status)
        why = Reason.LOADS_AND_PRESSURE_NOT_HELD if together else Reason.LOAD_NOT_HELD
        reason = jnp.where(folded, int(Reason.LIMIT_POINT), jnp.where(not_held, int(why), beyond))
        detail = jnp.where(not_held, span.load_factor_at(end.u), jnp.nan)
        # On a way on which the loads still grow the pressure there is that of a part of them.
        at_end = folded | ((beyond > 0) & ~is_loading)
        detail = jnp.where(at_end, span.pressure_at(end.u, at_end), detail)
        possible = scene.can_exist()
        status, reason = jnp.where(possible, status, Status.IMPOSSIBLE), jnp.where(possible, reason, 0)
        return PathEnd(end.u, status, end.iterations, reason, jnp.where(possible, detail, jnp.nan))


def _beyond_the_model(scene: Any, end: End, goal: Goal, context: Any, span: LoadPath) -> Int[Array, ""]:
    """The `Reason` for which the model ends where a search did, before its goal; 0 where it does not."""
    reason = jnp.zeros_like(end.reason)
    behind = (end.u[-1] > span.loading) | scene.grows_together()  # there the pressure acts from the first on
    if type(scene).passed is not PathEquations.passed:
        observed = residual_and_observables(
            scene.searched(), end.u[:-1], span.load_factor_at(end.u), span.load_at(end.u)
        )[1]
        passed = scene.passed(observed)
        if passed is not None:
            curled = behind & (end.reason == REACHED) & (passed > goal(context, end.u, observed))
            reason = jnp.where(curled, int(Reason.CURLED_UP), reason)
    for why, used in scene.spent(end.u[:-1], span.pressure_at(end.u, end.reason == ENDED)).items():
        reason = jnp.where(behind & (end.reason == ENDED) & (used > -AT_THE_EDGE), int(why), reason)
    return reason


def asked_for(pressure: Scalar, found: Found) -> Found:
    """What was found, IMPOSSIBLE where nothing can be meant by the pressure."""
    meant = (pressure >= 0) & (pressure < jnp.inf)
    return found._replace(
        status=jnp.where(meant, found.status, Status.IMPOSSIBLE),
        reason=jnp.where(meant, found.reason, int(Reason.PRESSURE_RULE)),
        detail=jnp.where(meant, found.detail, jnp.nan),
    )
