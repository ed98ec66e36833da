"""Initial-value problems by diffrax: a value at the end of an interval, with derivatives of any order.

Adaptive steps choose their lengths by the values that they meet. Two things are kept apart therefore: `steps_of` finds
the places that adaptive steps go through (values only), and `replay` goes through given places with the same method,
as plain arithmetic in a `lax.scan`, which JAX differentiates forward, in reverse and again. Their values agree to
rounding. Diffrax's own adjoints do not all do that: its default one fails inside of Newton's method, ForwardMode has no
reverse mode, and DirectAdjoint with adaptive steps has given wrong second derivatives under vmap.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .choice import largest

if TYPE_CHECKING:
    import diffrax

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


FIRST_STEP = 0.25
"""Of the interval: what adaptive steps try first."""


class Tolerance(NamedTuple):
    """How an interval is gone through: diffrax's method, the tolerances of its adaptive steps and their largest number,
    or a number of equal steps."""

    solver: diffrax.AbstractERK
    rtol: float
    atol: float
    max_steps: int
    equal: int | None = None


def _solved(field: Field, y: Any, args: Any, how: Tolerance, saveat: Any) -> Any:
    import diffrax

    steps = diffrax.PIDController(rtol=how.rtol, atol=how.atol)
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        how.solver,
        0.0,
        1.0,
        FIRST_STEP if how.equal is None else 1 / how.equal,
        y,
        args,
        saveat=saveat,
        stepsize_controller=steps if how.equal is None else diffrax.ConstantStepSize(),
        adjoint=diffrax.ForwardMode(),
        max_steps=how.max_steps if how.equal is None else how.equal + 1,
        throw=False,
    )


def end_of(field: Field, y: Any, args: Any, how: Tolerance) -> Any:
    """y at 1 from y at 0; NaN where the steps do not arrive. Forward derivatives only."""
    import diffrax

    found = _solved(field, y, args, how, diffrax.SaveAt(t1=True))
    arrived = found.result == diffrax.RESULTS.successful
    return jax.tree.map(lambda v: jnp.where(arrived, v[0], jnp.nan), found.ys)


def steps_of(field: Field, y: Any, args: Any, how: Tolerance) -> Float[Array, " n"]:
    """The places from 0 to 1 that the steps go through, filled up with 1; NaN where they do not arrive.

    No derivatives pass through.
    """
    if how.equal is not None:
        return jnp.linspace(0.0, 1.0, how.equal + 1)
    import diffrax

    y, args = lax.stop_gradient((y, args))
    found = _solved(field, y, args, how, diffrax.SaveAt(t0=True, steps=True))
    places = jnp.where(jnp.isfinite(found.ts), found.ts, 1.0)
    return lax.stop_gradient(jnp.where(found.result == diffrax.RESULTS.successful, places, jnp.nan))


class Replay(NamedTuple):
    """An initial-value problem as its steps went through it."""

    end: Any
    ys: Any
    """At the beginning of every step."""
    error: Float[Array, ""]
    """The largest of what the method's embedded error estimates add up to."""


def replay(field: Field, y: Any, args: Any, places: Any, solver: diffrax.AbstractERK) -> Replay:
    """Steps of an explicit Runge-Kutta method of diffrax from each of the given places to the next one.

    y_{n+1} = y_n + h sum b_i k_i,   k_i = f(s_n + c_i h, y_n + h sum_{j<i} a_ij k_j)

    with diffrax's tableau (a, b, c). Steps of length zero change nothing. Derivatives of any order, in both modes.
    """
    flat, unravel = ravel_pytree(y)
    a, b, c, b_error = _tableau(solver)
    picks = np.eye(len(b))

    def weighted(weights, k):
        # A product of matrices is a library call for every design of a batch.
        return jnp.sum(weights[:, None] * k, axis=0)

    def step(y, interval):
        start, stop = interval
        h = stop - start

        def stage(k, row):
            a, c, pick = row
            value = ravel_pytree(field(start + c * h, unravel(y + h * weighted(a, k)), args))[0]
            return k + pick[:, None] * value[None], None

        k, _ = lax.scan(stage, jnp.zeros((len(b), flat.size), flat.dtype), (a, c, picks))
        return y + h * weighted(b, k), (y, jnp.abs(h * weighted(b_error, k)))

    places = jnp.asarray(places)
    end, (ys, errors) = lax.scan(step, flat, (places[:-1], places[1:]))
    return Replay(unravel(end), jax.vmap(unravel)(ys), largest(jnp.sum(errors, axis=0)))


def _tableau(solver: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(a, b, c, b - b of the embedded method) of a diffrax method, a with all its rows."""
    given = solver.tableau
    b = np.asarray(given.b_sol, dtype=float)
    a = np.zeros((len(b), len(b)))
    for i, row in enumerate(given.a_lower):
        a[i + 1, : i + 1] = row
    return a, b, np.append(0.0, given.c), np.asarray(given.b_error, dtype=float)
