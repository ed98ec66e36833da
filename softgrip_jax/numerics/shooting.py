"""Initial-value problems by diffrax's adaptive steps: what the beam's collocation is checked by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float

Field = Callable[[Float[Array, ""], Any, Any], Any]
"""field(s, y, args) -> dy/ds, with y and the result the same pytree."""


def adaptive(field: Field, y: Any, args: Any, start: Any, stop: Any, tolerance: float, saveat: Any = None) -> Any:
    """y at `stop` (or at a diffrax.SaveAt) by Dopri8 with adaptive steps. Forward derivatives only."""
    import diffrax

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Dopri8(),
        start,
        stop,
        None,
        y,
        args,
        saveat=diffrax.SaveAt(t1=True) if saveat is None else saveat,
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        adjoint=diffrax.ForwardMode(),
        max_steps=100_000,
    )
    return jax.tree.map(lambda v: v[0], solution.ys) if saveat is None else solution.ys
