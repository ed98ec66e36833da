"""What is known of parameters before the data: a distribution of each, within the bounds of the calibration.

    lognormal    log x normal around log median, its standard deviation `spread` (0.1: about 10 %)
    normal       x normal around `mean`, its standard deviation `deviation`
    uniform      x anywhere between the bounds, all alike

All three are cut off at the bounds `low` and `high` of the parameter, so that every prior is proper.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy import stats

from softgrip_jax.errors import InputError

from ..space import Space

DISTRIBUTIONS = ("lognormal", "normal", "uniform")

WEAK_SPREAD = float(np.log(2.0))
"""Of a log parameter without a prior of its own: two thirds of it lie within half and twice the value as given."""

WEAK_PART = 0.25
"""Of a linear parameter without a prior of its own: its standard deviation as a part of the range of its bounds."""


DISCREPANCY = 0.1
"""Scale of the half-normal prior of delta: arcs of shells are 11 to 21 % off finite elements (docs/limits.md), energy
membranes less than 5 %."""

BETWEEN = 0.1
"""Scale of the half-normal prior of tau: moduli of silicone vary by about 10 % from batch to batch."""


@dataclasses.dataclass(frozen=True)
class Sampling:
    """How a posterior is sampled.

    Args:
        chains, draws, warmup: numbers of chains, and of draws of each after and before the steps are tuned.
        discrepancy: scale of the half-normal prior of the model's error, as a part of the value, dimensionless; 0 takes
            the models as right.
        between: scale of the half-normal prior of the scatter between specimens, relative, dimensionless; 0 takes them
            as alike.
        seed: of the draws.
    """

    chains: int = 4
    draws: int = 1000
    warmup: int = 500
    discrepancy: float = DISCREPANCY
    between: float = BETWEEN
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is known of one parameter.

    Args:
        distribution: "lognormal", "normal" or "uniform".
        centre: the median of a lognormal, the mean of a normal, SI; a uniform one has none.
        spread: standard deviation: of the logarithm, dimensionless, or of the number itself, SI.
    """

    distribution: str
    centre: float = 0.0
    spread: float = 0.0

    def log_density(self, x: Float[Array, ""]) -> Any:
        """Logarithm of the density by x, up to a constant."""
        if self.distribution == "lognormal":
            return -0.5 * ((jnp.log(x) - np.log(self.centre)) / self.spread) ** 2 - jnp.log(x)
        if self.distribution == "normal":
            return -0.5 * ((x - self.centre) / self.spread) ** 2
        return jnp.zeros_like(x)

    def quantiles(self, low: float, high: float, q: Any) -> np.ndarray:
        """Quantiles of the prior between its bounds, SI."""
        if self.distribution == "uniform":
            return low + np.asarray(q) * (high - low)
        log = self.distribution == "lognormal"
        to, back = (np.log, np.exp) if log else (np.asarray, np.asarray)
        normal = stats.norm(to(self.centre), self.spread)
        first, last = normal.cdf(to(low)), normal.cdf(to(high))
        return np.clip(back(normal.ppf(first + np.asarray(q) * (last - first))), low, high)


def weak(space: Space, j: int) -> Prior:
    """The prior of a parameter for which none is given: wide, around its value as given or the bound next to it."""
    centre = float(np.clip(space.reference[j], space.low[j], space.high[j]))
    if space.is_log[j]:
        return Prior("lognormal", centre, WEAK_SPREAD)
    return Prior("normal", centre, WEAK_PART * float(space.high[j] - space.low[j]))


def require_proper(name: str, prior: Prior, low: float, high: float, unit: float = 1.0) -> None:
    """An InputError where a prior has no density, or none between the bounds of its parameter; unit: of its name, in
    SI."""
    if prior.distribution not in DISTRIBUTIONS:
        raise InputError(
            f"The prior of {name} is {prior.distribution!r}; it must be one of {', '.join(DISTRIBUTIONS)}."
        )
    if prior.distribution == "uniform":
        return
    if not (np.isfinite(prior.spread) and prior.spread > 0):
        what, size = ("spread", 1.0) if prior.distribution == "lognormal" else ("deviation", unit)
        raise InputError(
            f"The prior of {name} is improper: its {what} is {prior.spread / size:g}; it must be a positive number."
        )
    if prior.distribution == "lognormal" and not (prior.centre > 0 and low > 0):
        raise InputError(f"The prior of {name} is lognormal; its median and its lower bound must be above zero.")
    if not low <= prior.centre <= high:
        raise InputError(
            f"The prior of {name} is centred at {prior.centre / unit:g}, outside of its bounds, {low / unit:g} to "
            f"{high / unit:g}; move its centre or widen them."
        )
