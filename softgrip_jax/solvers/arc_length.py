"""Natural continuation along the equilibrium path, by its arc length."""

from __future__ import annotations

from typing import Any

import equinox as eqx

from ..errors import InputError
from ..numerics.continuation import FIRST_STEP, LARGEST_STEP, MAX_STEPS, TURN, Steps
from ..scene import Solver


class ArcLength(Solver):
    """Arc-length continuation from zero load to the pressure, for scenes with several unknowns.

    It is what fingers use by themselves. The predictor goes along the tangent of the path, Newton's method corrects
    across it (see `numerics.continuation`). A limit point on the way is BEYOND_LIMIT, a bifurcation under the loads is
    IMPOSSIBLE. The answer is solved to rounding whatever the steps; their length only decides how sure it is that no
    step goes from one branch to another.

    Args:
        first_step: arc length that is tried first while external loads grow, dimensionless (scaled unknowns and loads).
        largest_step: of any step, dimensionless; also the first one where the pressure acts alone, where the path is
            nearly straight.
        turn: cosine of the largest turn of the tangent in one step, dimensionless, between 0 and 1.
        max_steps: NOT_CONVERGED where more are needed.

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

    def __check_init__(self) -> None:
        for name in ("first_step", "largest_step"):
            if not getattr(self, name) > 0:
                raise InputError(f"ArcLength.{name} is {getattr(self, name)!r}; it must be a positive number.")
        if not 0 < self.turn < 1:
            raise InputError(f"ArcLength.turn is {self.turn!r}; it must be a cosine between 0 and 1.")
        if not (type(self.max_steps) is int and self.max_steps > 0):
            raise InputError(f"ArcLength.max_steps is {self.max_steps!r}; it must be a whole number, 1 or more.")

    def find(self, scene: Any, pressure, guess):
        return scene.find_along(pressure, Steps(self.first_step, self.largest_step, self.turn, self.max_steps))
