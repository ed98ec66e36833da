"""Newton's method by optimistix, from a guess, with a certificate."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..equations import CurveEquations, residual_and_observables
from ..errors import InputError, require_whole
from ..numerics.curves import slope_of
from ..numerics.small_linear import solve_and_sign
from ..reasons import Reason
from ..results import Status
from ..scene import Found, Solver
from .explicit_curve import DROP, approached
from .settings import require_number

Scalar = Float[Array, ""]

MIDDLE = 0.45
"""Of the interval of a scene of one unknown: the guess where none is given."""


class Newton(Solver):
    """Newton's method from a guess (`optimistix.root_find`), whose answer is certified before it counts.

    It suits a parameter that changes a little from one solution to the next; for scenes with equations, that is shells,
    chambers and fingers. Without a guess it begins at the unloaded finger, from where its first step leads to the
    linear finger; for scenes with one unknown it begins in the middle of their interval.

    Newton's method finds a root on whatever branch. A root is OK where it also has the certificate of the branch
    connected to zero load. For one unknown the load must rise with it (and the approach be free of limit points), which
    is a proof for materials whose load has one maximum. For several unknowns the sign of det(dr/du) must be what it is
    without load, where the branch begins, since it changes at a limit point and at a simple bifurcation. Another branch
    on which the load rises, or a state behind two such points, has the same sign: the certificate does not tell these
    apart, and only ArcLength and ExplicitCurve do. Without the certificate a state is NOT_CONVERGED, with the reason
    ANOTHER_BRANCH where the equations are solved and RESIDUAL_TOO_LARGE where they are not: Newton's method cannot know
    that there is no equilibrium.

    Args:
        rtol, atol: relative and absolute tolerance of the last step, dimensionless, between 0 and 1. The residual must
            be rounding all the same, so larger tolerances do not give rough answers but NOT_CONVERGED.
        max_steps: at most.
        linear_solver: of lineax, for the steps; by default optimistix's choice.

    Raises:
        InputError: where a number is out of its range, or linear_solver is not one of lineax.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> near = sg.solve(sg.shell.Free(shell), 14 * kPa)
        >>> found = sg.solve(sg.shell.Free(shell), 15 * kPa, solver=sg.solvers.Newton(), guess=near)
        >>> print(f"{found.inflation / mm:.2f} mm")
        13.41 mm
    """

    rtol: float = eqx.field(static=True, default=1e-9)
    atol: float = eqx.field(static=True, default=1e-9)
    max_steps: int = eqx.field(static=True, default=40)
    linear_solver: Any = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        for name in ("rtol", "atol"):
            require_number(f"Newton.{name}", getattr(self, name), 1.0, "a number between 0 and 1")
        require_whole("Newton.max_steps", self.max_steps, 1)
        if self.linear_solver is not None:
            import lineax

            if not isinstance(self.linear_solver, lineax.AbstractLinearSolver):
                raise InputError(
                    f"Newton.linear_solver is {self.linear_solver!r}; it must be a solver of lineax, for instance "
                    "lineax.LU()."
                )

    def takes_guess(self):
        return True

    def find(self, scene: Any, pressure, guess):
        if isinstance(scene, CurveEquations):
            return self._on_curve(scene, pressure, guess)
        return self._on_path(scene.searched(), pressure, guess)

    def _root(self, scene: Any, pressure: Scalar, start: Array) -> tuple[Array, Array, Bool[Array, ""]]:
        """(unknowns, steps, whether the method converged)."""
        import optimistix as optx

        own = {} if self.linear_solver is None else {"linear_solver": self.linear_solver}
        found = optx.root_find(
            lambda y, args: args[0].residual(y, args[1]),
            optx.Newton(rtol=self.rtol, atol=self.atol, **own),
            start,
            (scene, pressure),
            max_steps=self.max_steps,
            throw=False,
        )
        return found.value, found.stats["num_steps"], found.result == optx.RESULTS.successful

    def _on_curve(self, scene: Any, pressure: Scalar, guess: Array | None) -> Found:
        start, end = scene.interval()
        touches, _, free_limit = approached(scene, start)
        low = scene.load(start)
        angle, steps, converged = self._root(
            scene, pressure, start + MIDDLE * (end - start) if guess is None else guess
        )
        begins = pressure <= low
        angle = jnp.where(begins, start, angle)
        inside = (angle >= start) & (angle <= end)
        slope = slope_of(scene.load)(angle)
        # A load that falls from its very beginning leads to no branch.
        drops = -slope_of(scene.load)(start) * (end - start) > DROP * jnp.abs(low)
        follows = ~drops if scene.may_dip() and scene.approach() is not None else jnp.asarray(True)
        status, reason = _labelled(converged, inside & (slope > 0) & follows)
        status = jnp.where(begins, Status.NO_CONTACT if scene.CONTACT else Status.OK, status)
        free = jnp.where(pressure <= free_limit, Status.NO_CONTACT, Status.BEYOND_LIMIT)
        status = jnp.where(touches, status, free)
        reason = jnp.where(begins | ~touches, 0, reason)
        reason = jnp.where(status == Status.BEYOND_LIMIT, int(Reason.LIMIT_BEFORE_CONTACT), reason)
        detail = jnp.where(touches, low, free_limit)
        is_known = (status == Status.NO_CONTACT) | (status == Status.BEYOND_LIMIT)
        detail = jnp.where(is_known & jnp.isfinite(detail), detail, jnp.nan)
        rounding = jnp.abs(slope) * jnp.maximum(jnp.abs(angle), 1.0) / (scene.pressure_scale() + jnp.abs(pressure))
        rounding = jnp.where(jnp.isfinite(rounding), rounding, 0.0) + scene.amplified(angle)
        possible = scene.can_exist() & ((start < end) | ~touches)
        found = Found(angle, pressure, status, steps, rounding=rounding, reason=reason, detail=detail)
        return _possible(found, possible)

    def _on_path(self, scene: Any, pressure: Scalar, guess: Array | None) -> Found:
        span, rest = scene.pressure_span(), scene.unloaded_state()
        unknowns, steps, converged = self._root(scene, pressure, rest if guess is None else guess)
        begin = jnp.append(rest, jnp.zeros_like(pressure))
        unloaded = jax.jacfwd(
            lambda y: residual_and_observables(scene, y, jnp.zeros_like(pressure), span.load_at(begin))[0]
        )(rest)
        loaded = jax.jacfwd(lambda y: scene.residual(y, pressure))(unknowns)
        observed = scene.evaluated(unknowns, pressure)[1]
        status, reason = _labelled(converged, (_sign(unloaded) == _sign(loaded)) & ~scene.is_loop(observed))
        passed = scene.passed(observed)
        if passed is not None:
            curled = (status == Status.OK) & (passed > 0)
            status = jnp.where(curled, Status.BEYOND_LIMIT, status)
            reason = jnp.where(curled, int(Reason.CURLED_UP), reason)
        ended = pressure > span.end
        status = jnp.where(ended, Status.BEYOND_LIMIT, status)
        reason = jnp.where(ended, int(scene.end_reason()), reason)
        detail = jnp.where(ended, span.end, jnp.nan)
        found = Found(unknowns, pressure, status, steps, reason=reason, detail=detail)
        return _possible(found, scene.can_exist())


def _labelled(converged: Bool[Array, ""], certified: Bool[Array, ""]) -> tuple[Array, Array]:
    """(status, reason) of a root with or without its certificate."""
    good = converged & certified
    status = jnp.where(good, Status.OK, Status.NOT_CONVERGED)
    reason = jnp.where(good, 0, jnp.where(converged, int(Reason.ANOTHER_BRANCH), int(Reason.RESIDUAL_TOO_LARGE)))
    return status, reason


def _possible(found: Found, possible: Bool[Array, ""]) -> Found:
    """What was found, IMPOSSIBLE where the scene or the pressure has no meaning."""
    meant = (found.pressure >= 0) & (found.pressure < jnp.inf)
    reason = jnp.where(meant, jnp.where(possible, found.reason, 0), int(Reason.PRESSURE_RULE))
    return found._replace(
        status=jnp.where(meant & possible, found.status, Status.IMPOSSIBLE),
        reason=reason,
        detail=jnp.where(meant & possible, found.detail, jnp.nan),
    )


def _sign(matrix: Array) -> Scalar:
    """Of the determinant."""
    return solve_and_sign(matrix, jnp.zeros((len(matrix), 1), matrix.dtype))[1]
