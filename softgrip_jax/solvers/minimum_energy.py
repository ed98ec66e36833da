"""Minima of an energy under inequalities, followed as the load grows."""

from __future__ import annotations

from typing import Any

import equinox as eqx

from ..errors import InputError
from ..scene import Solver

LARGEST_STEP = 1.3
"""As `shell.energy_scene.LARGEST_STEP`."""


class MinimumEnergy(Solver):
    """Follow the minimum of the energy from the flat membrane to the pressure; for the energy membrane, which uses it
    by itself.

    Newton's method with a line search, contact by an augmented Lagrangian, see `numerics.minimise`: what is found is a
    minimum, so it is stable; where none is left ahead the state is BEYOND_LIMIT. It is solved to rounding.

    Args:
        largest_step: of the load, which is the cube root of p a / (mu t_m); the membrane rises in proportion to it.
    """

    largest_step: float = eqx.field(static=True, default=LARGEST_STEP)

    def __check_init__(self) -> None:
        if not self.largest_step > 0:
            raise InputError(f"MinimumEnergy.largest_step is {self.largest_step!r}; it must be a positive number.")

    def find(self, scene: Any, pressure, guess):
        return scene.find_by(pressure, self.largest_step)
