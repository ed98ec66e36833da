"""Parts by the expansion of everything that is asked about their design, of the second order and more.

    v(t, s) = v + sum_j v_j s_j + 1/2 sum_jk v_jk s_j s_k + sum_jk c_jk s_j^2 s_k

v_j are exact; v_jk are differences of exact first derivatives at s_j = +-STEP, two parts for each number that scatters.
The same parts give all terms of the third order but the products of three different numbers, which are left out. The
derivatives by the design are dv/dt = v_t + sum_j v_tj s_j + 1/2 sum_j v_tjj s_j^2. The expansion of thousands of parts
then costs next to nothing.
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
    cubic: Float[np.ndarray, "q m m"]
    """Of s_j^2 s_k."""

    def parts(self, s: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k q"]:
        """The values of parts."""
        return self.of_powers(powers(s))

    def of_powers(self, powers: Float[np.ndarray, "k r"]) -> Float[np.ndarray, "k q"]:
        """The values of parts whose `powers` are known."""
        count = len(self.values)
        by_all = [self.values[:, None], self.by_s, 0.5 * self.by_ss.reshape(count, -1), self.cubic.reshape(count, -1)]
        return powers @ np.concatenate(by_all, axis=1).T

    def pulled(self, s: Float[np.ndarray, "k m"], by_values: Float[np.ndarray, "r k q"]) -> Float[np.ndarray, "r n"]:
        """The derivatives by t of what has the derivatives `by_values` by the values of parts; no table of their slopes
        is made."""
        count = len(s)
        moments = np.concatenate([np.ones((count, 1)), s, 0.5 * s**2], axis=1).T @ by_values  # (r, 1 + 2 m, q)
        by_all = np.concatenate([self.by_t[..., None], self.by_ts, self.by_tss], axis=2)  # (q, n, 1 + 2 m)
        return np.einsum("rjq,qnj->rn", moments, by_all, optimize=True)

    def slopes(self, s: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k q n"]:
        """Their derivatives by t."""
        return self.by_t + np.einsum("qnm,km->kqn", self.by_ts, s) + 0.5 * np.einsum("qnm,km->kqn", self.by_tss, s**2)


def powers(s: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k r"]:
    """What the values of parts are linear in: 1, s_j, s_j s_k, s_j^2 s_k."""
    count = len(s)
    products = (s[:, :, None] * s[:, None]).reshape(count, -1)
    cubes = (s[:, :, None] ** 2 * s[:, None]).reshape(count, -1)
    return np.concatenate([np.ones((count, 1)), s, products, cubes], axis=1)


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
    cubic = np.moveaxis(0.5 * (by_s[up] + by_s[down]) - by_s[:1], 0, 1) / STEP**2
    own = 0.5 * (values[up] - values[down]).T / STEP - by_s[0]
    for k in range(own.shape[1]):
        cubic[:, k, k] = own[:, k] / STEP**2
    by_ss = 0.5 * (by_ss + np.swapaxes(by_ss, 1, 2))
    return Expansion(values[0], by_s[0], by_ss, by_t[0], by_ts, by_tss, cubic)
