"""The No-U-Turn sampler (Hoffman and Gelman 2014) of numpyro, all chains side by side, a few draws at a time.

In blocks, so that progress is told and Ctrl-C ends it between two of them.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from softgrip_jax.errors import InputError
from softgrip_jax.progress import Tell, silent

BLOCK = 50
"""Draws between two signs of life."""

ACCEPTED = 0.9
"""Wanted mean probability of a step: above the usual 0.8, since a posterior by few points is seldom normal."""

DISPERSED = 2.0
"""Chains begin so many lengths around the fit."""

DEPTH = 8
"""A trajectory has 2^8 - 1 steps at most."""


@dataclasses.dataclass(frozen=True)
class Sampled:
    """Draws of all chains, without those of the warm-up."""

    v: np.ndarray
    """Shape (chains, draws, unknowns)."""
    energy: np.ndarray
    diverging: np.ndarray
    steps: np.ndarray
    """Evaluations of the density in each draw."""
    accepted: np.ndarray


def extra() -> Any:
    """ArviZ, without its words about its own future; an InputError where the extra is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import arviz
            import numpyro  # noqa: F401
    except ImportError as error:
        raise InputError(f'Posteriors need numpyro and arviz ({error}): pip install "softgrip_jax[bayes]".') from None
    return arviz


def kernel(potential: Callable[[Any], Any]) -> Any:
    """NUTS with a dense mass matrix and this potential."""
    from numpyro.infer import NUTS

    return NUTS(potential_fn=potential, dense_mass=True, target_accept_prob=ACCEPTED, max_tree_depth=DEPTH)


KEPT = ("z", "energy", "diverging", "num_steps", "accept_prob")


def advanced(nuts: Any, state: Any, count: int) -> tuple[Any, Any]:
    """The state after so many draws, and the draws."""

    def once(state, _):
        state = nuts.sample(state, (), {})
        return state, tuple(getattr(state, name) for name in KEPT)

    return jax.lax.scan(once, state, length=count)


def sample(
    potential: Callable[[Any], Any],
    centre: np.ndarray,
    scale: np.ndarray,
    chains: int,
    draws: int,
    warmup: int,
    seed: int = 0,
    tell: Tell = silent,
) -> Sampled:
    """Draws of a density, in blocks; the draws are rounded up to whole blocks and the rest is left out."""
    extra()
    key = jax.random.key(seed)
    first, second = jax.random.split(key)
    start = DISPERSED * jax.random.normal(first, (chains, len(centre)))
    middle, length = jnp.asarray(centre), jnp.asarray(scale)
    nuts = kernel(jax.jit(lambda e: potential(middle + length * e)))  # traced once, for the start and for the draws
    tell("posterior: compiling")
    state = nuts.init(jax.random.split(second, chains), warmup, start, (), {})
    run = jax.jit(lambda state: advanced(nuts, state, BLOCK))
    blocks, found = -(-(warmup + draws) // BLOCK), []
    for k in range(blocks):
        tell("posterior", k * BLOCK, blocks * BLOCK)
        state, drawn = run(state)
        found.append(jax.tree.map(np.asarray, drawn))
    columns = [np.swapaxes(np.concatenate(part), 0, 1)[:, warmup : warmup + draws] for part in zip(*found, strict=True)]
    return Sampled(np.asarray(centre) + np.asarray(scale) * columns[0], *columns[1:])
