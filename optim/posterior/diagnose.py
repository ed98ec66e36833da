"""Whether draws can be trusted, in words: convergence of the chains, effective number of draws, divergences.

R-hat       between-chain over within-chain scatter of ranks, 1 where all chains agree (Vehtari et al. 2021)
ESS         how many independent draws the middle (bulk) and the ends (tail) of a posterior are worth
divergence  a trajectory that left the surface of constant energy: a place that the chains could not go through
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from .sample import DEPTH, Sampled, extra

LARGEST_R_HAT = 1.01
LEAST_ESS = 100
"""Of each chain. Both are the limits of Vehtari et al. 2021."""
MOST_DIVERGENCES = 0.01
"""As a part of the draws."""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What the diagnostics say."""

    r_hat: np.ndarray
    bulk: np.ndarray
    tail: np.ndarray
    divergences: int
    faults: tuple[str, ...]
    """In words, why the draws must not be used; none where they may be."""
    remarks: tuple[str, ...]

    @property
    def usable(self) -> bool:
        """Whether the draws may be used."""
        return not self.faults

    def sentence(self) -> str:
        """The verdict for people."""
        if self.usable:
            return (
                f"The chains agree (R-hat at most {np.nanmax(self.r_hat):.3f}, effective draws at least "
                f"{min(np.nanmin(self.bulk), np.nanmin(self.tail)):.0f})."
            )
        return f"DO NOT USE this posterior: {'; '.join(self.faults)}. Take more draws, or say more by priors."


def diagnose(v: np.ndarray, sampled: Sampled, names: Sequence[str]) -> Diagnosis:
    """The diagnostics of every unknown; v: its draws, shape (chains, draws, unknowns)."""
    az = extra()
    chains, draws, _ = v.shape
    columns = [v[:, :, k] for k in range(v.shape[2])]
    moved = [np.ptp(column) > 0 for column in columns]
    r_hat = np.array([float(az.rhat(c)) if ok else np.inf for c, ok in zip(columns, moved, strict=True)])
    bulk, tail = (
        np.array([float(az.ess(c, method=m)) if ok else 0.0 for c, ok in zip(columns, moved, strict=True)])
        for m in ("bulk", "tail")
    )
    divergences, total = int(sampled.diverging.sum()), chains * draws
    faults, remarks = [], []
    worst = int(np.argmax(np.where(np.isfinite(r_hat), r_hat, 1e300)))
    if not r_hat[worst] <= LARGEST_R_HAT:
        faults.append(
            f"the chains do not agree on {names[worst]} (R-hat is {r_hat[worst]:.3f}, and at most {LARGEST_R_HAT} is "
            "allowed)"
        )
    for words, found in (("middle", bulk), ("ends", tail)):
        least = int(np.argmin(np.where(np.isfinite(found), found, -1.0)))
        if not found[least] >= LEAST_ESS * chains:
            faults.append(
                f"the {words} of {names[least]} stand on {found[least]:.0f} effective draws, and {LEAST_ESS * chains} "
                "are needed"
            )
    if divergences > MOST_DIVERGENCES * total:
        faults.append(f"{divergences} of {total} draws diverged: a part of the posterior was not reached")
    elif divergences:
        remarks.append(
            f"{divergences} of {total} draws diverged: the ends of the intervals may be a little too narrow."
        )
    deep = float(np.mean(sampled.steps >= 2**DEPTH - 1))
    if deep > MOST_DIVERGENCES:
        remarks.append(f"{deep:.0%} of the trajectories were cut off at {2**DEPTH - 1} steps: the sampling was slow.")
    return Diagnosis(r_hat, bulk, tail, divergences, tuple(faults), tuple(remarks))
