"""The tolerance budget of a robust design: which tolerance costs most, and how tight each should be.

The price of a tolerance is what the goal gains, at the wanted yield, where this one alone is halved and the design is
improved anew. At equal cost, sum_j 1 / f_j = m with f_j the factor of tolerance j (making a number twice as precise
costs twice as much, each tolerance as it stands costs the same), the yield of the design is largest for the factors
told here; where the goal itself is one of all parts, the goal is best for them at the same yield.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from .count import of_values
from .evaluate import Wants
from .improve import WIDTHS, Improved, improved
from .statistics import smoothed_logit, spread

HALVED = 0.5
NARROWEST, WIDEST = 0.25, 4.0
"""Factors of a tolerance that an allocation may ask for."""


@dataclasses.dataclass(frozen=True)
class Budget:
    """Of one design, by its expansion.

    Args:
        share: of the parts that keep every requirement, by the expansion.
        halved: that share where one tolerance alone is halved, and the others stay.
        gained: what the scaled objective falls by at the wanted yield where one tolerance alone is halved; NaN where no
            design was found.
        factors: of every tolerance at equal cost.
        allocated: the share of good parts with them.
        allocated_gain: what the scaled objective falls by with them at the wanted yield.
    """

    share: float
    halved: Float[np.ndarray, " m"]
    gained: Float[np.ndarray, " m"]
    factors: Float[np.ndarray, " m"]
    allocated: float
    allocated_gain: float


def budget(wants: Wants, best: Improved) -> Budget | None:
    """The budget of a design; None where it has no expansion."""
    expansion = wants.expansions(best.t[None])[0]
    if expansion is None or wants.wanted.promised is None:
        return None
    s, m = wants.expanded_parts, wants.scatters.size
    width = best.width or WIDTHS[-1]

    def broken(factors: np.ndarray) -> np.ndarray:
        values = expansion.parts(s * factors)
        return wants.broken(values, np.zeros(len(values)))[0]

    def share(factors: np.ndarray) -> float:
        return float(np.mean(broken(factors) <= 0))

    def one(k: int) -> np.ndarray:
        return np.where(np.arange(m) == k, HALVED, 1.0)

    def gain(factors: np.ndarray) -> float:
        found = improved(wants, best.t[None], best.method, factors, WIDTHS[1:])
        return float(best.values[0] - found[0].values[0]) if found and found[0].kept else float("nan")

    def goal(factors: np.ndarray) -> float:
        values = expansion.parts(np.concatenate([np.zeros((1, m)), s * factors]))
        return of_values(wants, values, np.zeros(len(values))).goal

    def room(factors: np.ndarray) -> float:
        return float(smoothed(jnp.asarray(broken(factors)), width))

    if wants.wanted.goal == "nominal":
        factors = allocation(lambda f: -room(f), m)
    else:
        least = room(np.ones(m))
        factors = allocation(goal, m, lambda f: room(f) - least)
    return Budget(
        share(np.ones(m)),
        np.array([share(one(k)) for k in range(m)]),
        np.array([gain(one(k)) for k in range(m)]),
        factors,
        share(factors),
        gain(factors),
    )


@jax.jit
def smoothed(broken: Float[Array, " n"], width: Float[Array, ""]) -> Float[Array, ""]:
    """logit Y_w at a width in standard deviations."""
    return smoothed_logit(broken, width * spread(broken))


def allocation(
    cost: Callable[[np.ndarray], float], size: int, kept: Callable[[np.ndarray], float] | None = None
) -> Float[np.ndarray, " m"]:
    """The factors of tolerances, sum 1 / factor = size, that cost least, where `kept` stays at zero or above.

    In e = 1 / factor, the precision that is paid for, the cost is linear.
    """
    found = minimize(
        lambda e: cost(1 / e),
        np.ones(size),
        bounds=[(1 / WIDEST, 1 / NARROWEST)] * size,
        constraints=[
            {"type": "eq", "fun": lambda e: np.sum(e) - size, "jac": lambda e: np.ones((1, size))},
            *([{"type": "ineq", "fun": lambda e: kept(1 / e)}] if kept else []),
        ],
        method="SLSQP",
        options={"eps": 1e-3, "ftol": 1e-6, "maxiter": 40},
    )
    return 1 / found.x
