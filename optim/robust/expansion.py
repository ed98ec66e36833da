"""Parts by the second-order expansion of everything that is asked about their design.

    v(t, s) = v + sum_j v_j s_j + 1/2 sum_jk v_jk s_j s_k

v_j are exact; v_jk are differences of exact first derivatives at s_j = +-STEP, two parts for each number that scatters.
So are the derivatives by the design, dv/dt = v_t + sum_j v_tj s_j + 1/2 sum_j v_tjj s_j^2 (the mixed third ones are
left out). The expansion of thousands of parts then costs next to nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEP = 1.0
"""Of a difference, in deviations: the second derivatives are those over the scatter itself, not those at a point."""


class Expansion(NamedTuple):
    """Of the values of one design by the deviations of its parts."""

    values: Float[np.ndarray, " q"]
    by_s: Float[np.ndarray, "q m"]
    by_ss: Float[np.ndarray, "q m m"]
    by_t: Float[np.ndarray, "q n"]
    by_ts: Float[np.ndarray, "q n m"]
    by_tss: Float[np.ndarray, "q n m"]
    """By t and twice by the same s."""

    def parts(self, s: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k q"]:
        """The values of parts."""
        bent = np.einsum("kj,qjl->kql", s, self.by_ss)
        return self.values + s @ self.by_s.T + 0.5 * np.einsum("kql,kl->kq", bent, s)

    def slopes(self, s: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k q n"]:
        """Their derivatives by t."""
        return self.by_t + np.einsum("qnm,km->kqn", self.by_ts, s) + 0.5 * np.einsum("qnm,km->kqn", self.by_tss, s**2)


def star(size: int) -> Float[np.ndarray, "k m"]:
    """The deviations of the parts that an expansion needs: none, then up and down for each number."""
    return np.concatenate(
        [np.zeros((1, size)), STEP * np.repeat(np.eye(size), 2, axis=0) * np.tile([[1], [-1]], (size, 1))]
    )


def expanded(values: Float[np.ndarray, "k q"], slopes: Float[np.ndarray, "k q p"], designed: int) -> Expansion:
    """The expansion from the parts of a `star`; slopes: by t (the first `designed`), then by s."""
    by_t, by_s = slopes[..., :designed], slopes[..., designed:]
    up, down = slice(1, None, 2), slice(2, None, 2)
    by_ss = np.moveaxis(by_s[up] - by_s[down], 0, -1) / (2 * STEP)
    by_ts = np.moveaxis(by_t[up] - by_t[down], 0, -1) / (2 * STEP)
    by_tss = np.moveaxis(by_t[up] + by_t[down] - 2 * by_t[:1], 0, -1) / STEP**2
    return Expansion(values[0], by_s[0], 0.5 * (by_ss + np.swapaxes(by_ss, 1, 2)), by_t[0], by_ts, by_tss)
