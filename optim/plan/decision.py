"""What is decided with the numbers of a plan, and how often the decision is right before and after it.

Whether a quantity keeps its bounds, or whether enough of the parts that are cast keep theirs: with the worst scaled
violation g of a part, a yield is at least Y where the quantile Q of g that Y of the parts lie below is at most zero. Q
takes the place of the quantity: unlike the yield itself it is nowhere flat, and nearly linear in the numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats

from softgrip_jax.errors import InputError
from softgrip_jax.progress import Tell
from softgrip_jax.quantities import LIMIT_MARGIN, NO_LIMIT_MARGIN, QuantitySet
from softgrip_jax.results import Status

from ..problem import Goal, Problem, Scaling
from ..robust.parts import Parts, Requirements, problem_of_parts
from ..robust.settings import require_felt
from ..robust.statistics import quantile_weights, with_row_by_row
from .settings import Decision, Settings

LEAST_SHARE = 0.9
"""What fewer of the draws have a state for is not planned: it might burst, or not touch."""
GRID = np.linspace(-6, 6, 2001)


class Decided(NamedTuple):
    """What a decision is about, at every draw of the numbers."""

    values: Float[np.ndarray, " m"]
    """SI, or Q of a yield; NaN where it has no value, inf where it has no end, as the largest pressure of a scene that
    has none."""
    slopes: Float[np.ndarray, "m n"]
    """By the logarithms of the numbers; zero where it has no value or no end."""
    yields: Float[np.ndarray, " m"] | None = None
    """Counted, where a yield is decided on."""


class Verdict(NamedTuple):
    """What a decision gains."""

    mean: float
    """Over the draws, without those that have no end, SI."""
    before: float
    """Standard deviation, SI."""
    after: float
    right_before: float
    """Probability that the decision is right."""
    right_after: float
    yields: Float[np.ndarray, " m"] | None
    """Of every draw, where a yield is decided on."""


def decided(settings: Settings, decision: Decision, draws: np.ndarray, tell: Tell) -> Decided:
    """What the decision is about, at draws of the numbers.

    Raises:
        InputError: where more than a tenth of the draws have no value, or all of them no end.
    """
    tell("compiling what is decided")
    found = (
        _of_parts(settings, decision, draws, tell) if decision.uncertain else _of_quantity(settings, decision, draws)
    )
    good = ~np.isnan(found.values)
    if good.mean() < LEAST_SHARE:
        raise InputError(
            f"{decision.key} has no value for {np.sum(~good)} of {len(good)} draws of what is known; it must have one "
            f"for {LEAST_SHARE:.0%}."
        )
    if not np.any(np.isfinite(found.values)):
        raise InputError(f"{decision.key} has no end, whatever is drawn of what is known; there is nothing to decide.")
    return found


def _of_quantity(settings: Settings, decision: Decision, draws: np.ndarray) -> Decided:
    space = settings.fitting.given
    assert decision.quantity is not None
    asked = QuantitySet(settings.scenes, [decision.quantity])

    def value(x: Any) -> tuple[Any, tuple[Any, Any]]:
        scenes = space.scenes_at(x)
        found = asked.measure({name: scenes[name] for name in settings.scenes})
        return found.values[0], (found.values[0], found.statuses[0])

    slopes, (values, status) = jax.jit(jax.vmap(jax.jacfwd(value, has_aux=True)))(jnp.asarray(draws))
    values = np.where(np.asarray(status) == Status.OK, np.asarray(values), np.nan)
    if asked.quantities[0].observable == LIMIT_MARGIN:
        values = np.where(values == NO_LIMIT_MARGIN, np.inf, values)
    return Decided(values, np.where(np.isfinite(values)[:, None], np.asarray(slopes) * draws, 0.0))


def _of_parts(settings: Settings, decision: Decision, draws: np.ndarray, tell: Tell) -> Decided:
    """The parts that scatter about every draw."""
    uncertain, limits = decision.uncertain, decision.limits
    assert uncertain is not None
    assert uncertain.wanted.promised is not None
    space = settings.space
    # A problem has a goal; that of this one is never looked at.
    problem = problem_of_parts(Problem(space, [Goal("minimise", limits[0].quantity)], limits), uncertain.scatters)
    require_felt(problem, uncertain, settings.where)
    parts = Parts(problem)
    s = uncertain.scatters.quasi_random(uncertain.samples, uncertain.seed)
    scaling, weights = Scaling(problem), quantile_weights(len(s), uncertain.wanted.promised)
    values, slopes, yields = [], [], []
    for k, t in enumerate(space.to_unit(draws)):
        found = parts(np.broadcast_to(t, (len(s), len(t))), s)
        if k == 0:
            scaling.learn(found.values)
            of_each = with_row_by_row(problem, Requirements(problem), scaling.scales)
        worth, by = jax.tree.map(np.asarray, of_each(found.values, found.shortfall))
        has_state = found.shortfall <= 0
        by_t = np.einsum("pq,pqn->pn", by.broken, found.value_slopes[..., : len(t)])
        order = np.argsort(np.where(has_state, worth.broken, np.inf))
        # A part without equilibrium fails; where the quantile reaches one, Q says nothing.
        is_known = weights @ ~has_state[order] < 1e-6
        values.append(weights @ np.where(has_state, worth.broken, 0.0)[order] if is_known else np.nan)
        slopes.append(weights @ np.where(has_state[:, None], by_t, 0.0)[order] if is_known else np.zeros(len(t)))
        yields.append(np.mean(has_state & (worth.broken <= 0)))
        tell("counting parts", k + 1, len(draws))
    by_logarithm = np.stack(slopes) / np.log(space.high / space.low)
    return Decided(np.array(values), by_logarithm, np.array(yields))


def verdict(found: Decided, decision: Decision, prior: np.ndarray, after: np.ndarray) -> Verdict:
    """How often the decision is right now, and after the plan.

    After the data the quantity is normal about m with the variance v = mean g^T C g; before them m is normal about the
    mean with the variance v_0 - v. Whoever decides for what is more probable is right with max(p, 1 - p). A share of
    draws without an end is as probable before as after: it keeps every lower bound and breaks every upper one.

    Args:
        found: what it is about.
        decision: its bounds.
        prior: covariance of the logarithms, shape (n, n).
        after: the plan, at every draw, shape (m, n, n).
    """
    has_end = ~np.isinf(found.values)
    g, mean = found.slopes[has_end], float(np.nanmean(found.values[has_end]))
    first = float(np.mean(np.einsum("mj,jk,mk->m", g, prior, g)))
    last = float(np.mean(np.einsum("mj,mjk,mk->m", g, after[has_end], g)))
    endless = float(np.sum(~has_end) / np.sum(~np.isnan(found.values)))

    def right(left: float) -> float:
        means = mean + np.sqrt(max(first - left, 0.0)) * GRID
        normal = stats.norm(means, np.sqrt(left))
        keeps = (1 - endless) * (normal.cdf(decision.high) - normal.cdf(decision.low))
        keeps += endless * (decision.high == np.inf)
        weight = stats.norm.pdf(GRID)
        return float(np.sum(weight * np.maximum(keeps, 1 - keeps)) / np.sum(weight))

    return Verdict(mean, np.sqrt(first), np.sqrt(last), right(first), right(last), found.yields)
