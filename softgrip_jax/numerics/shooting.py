"""Initial-value problems for shooting: a fixed-step fast path and an adaptive reference, both with diffrax solvers.

The fast path takes its method as data (a diffrax solver's Butcher tableau) and scans over equal steps: forward and
reverse derivatives of any order. `diffeqsolve` inside a Newton iteration gives one mode or the other, not both, and
runs about ten times slower on a few thousand small lanes. The adaptive path is for references: forward mode only.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

Field = Callable[[Float[Array, ""], Any, Any], Any]
"""field(s, y, args) -> dy/ds, with y and the result the same pytree."""

Steps = int | Int[Array, ""]

Solver = Any
"""An explicit Runge-Kutta solver of diffrax (AbstractERK): its tableau is what is used."""


@cache
def dopri8() -> Solver:
    """Order 8 in 12 stages. Diffrax takes a quarter of the time that imports take: it is not asked for before."""
    with jax.ensure_compile_time_eval():  # whatever diffrax makes when it is imported is no part of a program
        import diffrax

        return diffrax.Dopri8()


def runge_kutta_step(
    field: Field, y: Any, args: Any, s: Float[Array, ""], width: Float[Array, ""], solver: Solver
) -> Any:
    """One explicit Runge-Kutta step from s to s + width, by the solver's tableau.

    The stages are a loop, not unrolled: a field compiled 12 times over (and again for each derivative) takes minutes.
    """
    tableau: Any = solver.tableau  # of one method, never a pair of them
    stages = int(np.max(np.flatnonzero(tableau.b_sol))) + 1  # later stages only estimate the error
    weights = np.zeros((stages, stages))
    for i in range(1, stages):
        weights[i, :i] = tableau.a_lower[i - 1]
    nodes = np.concatenate([[0.0], tableau.c])[:stages]

    def combine(weights, slopes):
        return jax.tree.map(lambda v, k: v + width * jnp.sum(weights.reshape(-1, *[1] * v.ndim) * k, axis=0), y, slopes)

    def stage(i, slopes):
        inner = combine(jnp.asarray(weights)[i], slopes)
        slope = field(s + jnp.asarray(nodes)[i] * width, inner, args)
        return jax.tree.map(lambda ks, k: ks.at[i].set(k), slopes, slope)

    slopes = jax.tree.map(lambda v: jnp.zeros((stages, *v.shape), v.dtype), y)
    slopes = lax.fori_loop(0, stages, stage, slopes)
    return combine(jnp.asarray(tableau.b_sol[:stages]), slopes)


def fixed_steps(
    field: Field,
    y: Any,
    args: Any,
    start: Float[Array, ""],
    stop: Float[Array, ""],
    steps: Steps,
    settled: Field | None = None,
    solver: Solver | None = None,
) -> tuple[Any, Any]:
    """(y at `stop`, y after every step) by `steps` equal steps of an explicit Runge-Kutta solver.

    settled(s, y, args): what replaces y after a step, where y has parts that follow from others. solver: `dopri8`
    where none is given. A number of steps that is an array is a loop of unknown length: forward mode
    only, and None for the steps' y.
    """
    width = (stop - start) / steps
    solver = dopri8() if solver is None else solver

    def advance(y, k):
        y = runge_kutta_step(field, y, args, start + k * width, width, solver)
        y = y if settled is None else settled(start + (k + 1) * width, y, args)
        return y, y

    if isinstance(steps, int):
        return lax.scan(advance, y, jnp.arange(steps, dtype=jnp.result_type(width)))
    return lax.fori_loop(0, steps, lambda k, y: advance(y, k)[0], y), None


def adaptive(field: Field, y: Any, args: Any, start: Any, stop: Any, tolerance: float, saveat: Any = None) -> Any:
    """y at `stop` (or at a diffrax.SaveAt) by adaptive steps: the accuracy reference. Forward derivatives only."""
    import diffrax

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        dopri8(),
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
