"""Minima of an energy under inequalities, followed as the load grows."""

from __future__ import annotations

from typing import Any

import equinox as eqx

from ..errors import InputError
from ..scene import Solver

LARGEST_STEP = 1.3
"""As `shell.energy_scene.LARGEST_STEP`."""


class MinimumEnergy(Solver):
    """The minimum of the energy, followed from the flat membrane to the pressure; for the energy membrane.

    It is what `model="energy"` uses by itself: Newton's method with a line search, contact by an augmented Lagrangian
    (see `numerics.minimise`). The answer is a minimum, so it is stable, and is solved to rounding. Where no minimum is
    left ahead the state is BEYOND_LIMIT.

    Args:
        largest_step: of the load (p a / (mu t_m))^(1/3), dimensionless; the membrane rises in proportion to it.

    Raises:
        InputError: where largest_step is not positive.

    Examples:
        >>> sg.solvers.MinimumEnergy(largest_step=0.5)
        MinimumEnergy(largest_step=0.5)
    """

    largest_step: float = eqx.field(static=True, default=LARGEST_STEP)

    def __check_init__(self) -> None:
        if not self.largest_step > 0:
            raise InputError(f"MinimumEnergy.largest_step is {self.largest_step!r}; it must be a positive number.")

    def find(self, scene: Any, pressure, guess):
        return scene.find_by(pressure, self.largest_step)
