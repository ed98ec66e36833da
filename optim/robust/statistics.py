"""What is wanted of all parts of a design, as pure numbers that a gradient method can use.

From the values of N parts come the objective of the robust search and its constraints (broken where positive):

    expected     the mean over the parts that have a value
    quantile     Harrell and Davis (1982): all order statistics, weighted by a Beta density about the quantile, so that
                 the derivative is not that of a single part
    yield        Y_w = mean of 1 / (1 + exp(g / w)), g the worst scaled violation of a part, w the width of the smoothed
                 edge, a part of the standard deviation of g; the constraint is logit(aim) - logit(Y_w) <= 0

Y_w is the yield that is counted where w goes to zero; at w its error is about (pi w)^2 / 6 times the slope of the
density of g at the edge. The aim is what Y_w is where g is normal and the yield is the wanted one, so that a wide edge
asks for no more than a narrow one. The logit of a yield is nearly linear in the room that a design has, and its
derivative stays finite and away from zero where every part fails or none does.

A part without equilibrium fails: its g is its shortfall, which says how far it is from one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import betainc, expit, ndtri

from ..problem import Problem, Scales, finite
from .parts import Requirements

Kind = Literal["nominal", "expected", "quantile", "worst"]

LEAST_SHORTFALL = 1e-3
"""A part without equilibrium is broken by at least this much, however near it is to one."""

NOTHING_ASKED = -1e9
"""How far a part is from breaking something where it has nothing to keep."""

LEAST_SPREAD = 1e-6
"""Of the worst scaled violation over the parts."""


class Worth(NamedTuple):
    """What one part is worth: pure numbers."""

    objective: Float[Array, ""]
    violations: Float[Array, " k"]
    """Of the problem's limits, then of its rules."""
    broken: Float[Array, ""]
    """The worst requirement: positive where the part fails."""


class Wanted(NamedTuple):
    """What is asked of all parts."""

    goal: Kind
    share: float
    """Of the goal's quantile, and of the constraints' where no yield is wanted."""
    promised: float | None
    """The yield that is wanted."""


def worth(
    problem: Problem, requirements: Requirements, scales: Scales
) -> Callable[[Float[Array, " q"], Float[Array, ""]], Worth]:
    """worth(values, shortfall) of one part of a problem."""
    sides, rules = requirements.sides, len(problem.sides)

    def of_part(values: Array, shortfall: Array) -> Worth:
        judged = problem.score(values, scales)
        known = ~jnp.isnan(values)
        safe = jnp.where(known, values, 0.0)
        own = [jnp.where(known[k], sign * (finite(safe[k], scale) - bound) / scale, 0.0)
               for k, sign, bound, scale in sides]  # fmt: skip
        every = jnp.concatenate([jnp.stack(own) if own else jnp.zeros(0), judged.violations[rules:]])
        worst = jnp.max(every, initial=NOTHING_ASKED)
        broken = jnp.where(shortfall > 0, shortfall + LEAST_SHORTFALL, worst)
        return Worth(judged.objective, judged.violations, broken)

    return of_part


def smoothed_logit(broken: Float[Array, " n"], width: Float[Array, ""]) -> Float[Array, ""]:
    """logit Y_w, finite however many parts fail."""
    count = jnp.log(broken.shape[0])
    kept = jax.scipy.special.logsumexp(jax.nn.log_sigmoid(-broken / width)) - count
    failed = jax.scipy.special.logsumexp(jax.nn.log_sigmoid(broken / width)) - count
    return kept - failed


def spread(broken: Float[Array, " n"]) -> Float[Array, ""]:
    """Standard deviation, with a derivative where there is none."""
    return jnp.sqrt(jnp.var(broken) + LEAST_SPREAD**2)


def quantile_weights(count: int, share: float) -> Float[np.ndarray, " n"]:
    """Of the order statistics of so many values (Harrell and Davis)."""
    a, b = (count + 1) * share, (count + 1) * (1 - share)
    return np.diff(betainc(a, b, np.arange(count + 1) / count))


def logit(share: float) -> float:
    """log(p / (1 - p))."""
    return float(np.log(share / (1 - share)))


def aimed_logit(share: float, width: float) -> float:
    """logit Y_w of a normal violation of which this share is kept; width: w over its standard deviation."""
    z = np.linspace(-8, 8, 16_001)
    kept = expit((ndtri(share) - z) / max(width, 1e-3))
    return logit(float(np.trapezoid(kept * np.exp(-(z**2) / 2), z) / np.sqrt(2 * np.pi)))


def asked_of_parts(
    problem: Problem, requirements: Requirements, scales: Scales, wanted: Wanted
) -> Callable[..., tuple[Any, Any]]:
    """asked(values, shortfalls, width, aim): what is wanted of N parts and its derivatives by values and shortfalls.

    values: (N, q), shortfalls: (N,); width: of the edge, in standard deviations of the worst violation; aim: see
    `aimed_logit`; row 0 is the design itself, which counts for nominal values alone. The result is one vector: the
    objective, then the constraints.
    """
    of_part = worth(problem, requirements, scales)
    limits = len(problem.sides)

    def asked(values: Array, shortfalls: Array, width: Array, aim: Array) -> Array:
        found = jax.vmap(of_part)(values, shortfalls)
        known = shortfalls[1:] <= 0
        sharp = jnp.maximum(jnp.sum(known), 1)

        def mean(x: Array) -> Array:
            return jnp.sum(jnp.where(known, x, 0.0)) / sharp

        weights = quantile_weights(len(shortfalls) - 1, wanted.share) if wanted.goal == "quantile" else np.zeros(0)

        def quantile(x: Array) -> Array:
            # A part without a value is no better than the worst that has one.
            most = jax.lax.stop_gradient(jnp.max(jnp.where(known, x, -1e9)))
            return jnp.sort(jnp.where(known, x, most)) @ weights

        statistic = {"expected": mean, "quantile": quantile}.get(wanted.goal)
        parts = found.objective[1:]
        goal = found.objective[0] if statistic is None else statistic(parts)
        if wanted.promised is not None:
            rows = [(aim - smoothed_logit(found.broken[1:], width * spread(found.broken[1:])))[None]]
            if requirements.limits is not None:
                rows.append(found.violations[0, :limits])
        else:
            assert statistic is not None
            rows = (
                [jnp.stack([statistic(column) for column in found.violations[1:].T])] if found.violations.size else []
            )
            rows.append(jnp.sum(jnp.where(known, 0.0, shortfalls[1:] + LEAST_SHORTFALL))[None] / len(known))
        return jnp.concatenate([goal[None], *rows])

    def both(*args: Array) -> tuple[Array, Any]:
        return asked(*args), jax.jacrev(asked, argnums=(0, 1))(*args)

    return jax.jit(both)


def with_row_by_row(
    problem: Problem, requirements: Requirements, scales: Scales
) -> Callable[[Any, Any], tuple[Worth, Any]]:
    """(worth of every part, its derivatives by the values)."""
    of_part = worth(problem, requirements, scales)

    def each(values: Array, shortfall: Array) -> tuple[Worth, Any]:
        return of_part(values, shortfall), jax.jacfwd(of_part)(values, shortfall)

    return jax.jit(jax.vmap(each))
