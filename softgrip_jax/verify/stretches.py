"""Stress and tangent of any strain energy of principal stretches, with the energy's derivatives by JAX."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..materials.base import Material

EQUAL = 1e-6
"""Relative distance of two stretches below which the difference quotient of the tangent is taken as its limit; the
quotient has lost half of its digits there, and the limit is off by less than that."""
CHUNK = 3456
"""Points at once: one program serves every mesh, and the memory does not grow with it."""


class Response(NamedTuple):
    """What a material answers at points.

    Args:
        stress: first Piola-Kirchhoff stress P, Pa, shape (points, 3, 3).
        tangent: dP_aJ / dF_cL, Pa, shape (points, J a, L c), or None where it was not asked for.
    """

    stress: Float[np.ndarray, "points 3 3"]
    tangent: Float[np.ndarray, "points 9 9"] | None


class Stretches:
    """W(F) of a nearly incompressible solid, kept at its volume by a pressure q that is given.

    W(F) = W(lambda_i / J^(1/3)) + q (J - 1). With F = sum lambda_i n_i (x) N_i the stress is sum W_i n_i (x) N_i, and
    the tangent has W_ij and, of two different stretches, (W_i -+ W_j) / (lambda_i -+ lambda_j) (Ogden, Non-Linear
    Elastic Deformations, 6.1.4).

    Args:
        material: whose energy is taken.

    Examples:
        >>> from softgrip_jax.verify.stretches import Stretches
        >>> rubber = Stretches(sg.NeoHookean(mu=100 * kPa))
        >>> F = np.diag([1.25, 0.8, 1.0])[None]
        >>> print(f"{rubber(F, np.zeros(1)).stress[0, 2, 2] / kPa:.3f} kPa")  # mu (1 - I_1 / 3)
        -6.750 kPa
    """

    def __init__(self, material: Material):
        def energy(stretches: Any) -> Any:
            kept = stretches / (stretches[0] * stretches[1] * stretches[2]) ** (1 / 3)
            return material.energy(kept[0], kept[1], kept[2])

        self._derivatives = jax.jit(jax.vmap(lambda s: (jax.grad(energy)(s), jax.hessian(energy)(s))))

    def derivatives(self, stretches: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, np.ndarray]:
        """W_i, shape (points, 3), and W_ij, shape (points, 3, 3), in Pa, of the energy at constant volume."""
        count = len(stretches)
        padded = np.ones((-(-count // CHUNK) * CHUNK, 3))
        padded[:count] = stretches
        parts = [self._derivatives(part) for part in np.split(padded, len(padded) // CHUNK)]
        first, second = (np.concatenate([np.asarray(part[i]) for part in parts])[:count] for i in (0, 1))
        return first, second

    def __call__(
        self, F: Float[np.ndarray, "points 3 3"], q: Float[np.ndarray, " points"], tangent: bool = True
    ) -> Response:
        """Stress and tangent at deformation gradients F under pressures q (Pa, positive in tension)."""
        squares, N = np.linalg.eigh(np.swapaxes(F, 1, 2) @ F)
        s = np.sqrt(squares)
        n = (F @ N) / s[:, None, :]
        first, second = self.derivatives(s)
        J = np.prod(s, axis=1)
        first = first + (q * J)[:, None] / s
        both = (q * J)[:, None, None] / (s[:, :, None] * s[:, None, :])
        second = second + both * (1 - np.eye(3))
        stress = (n * first[:, None, :]) @ np.swapaxes(N, 1, 2)
        if not tangent:
            return Response(stress, None)
        frame = np.zeros((len(F), 9, 9))  # rows (i, j), columns (i', j') of n_i (x) N_j
        for i in range(3):
            for j in range(3):
                frame[:, 4 * i, 4 * j] = second[:, i, j]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            apart = s[:, j] - s[:, i]
            near = np.abs(apart) < EQUAL * s[:, j]
            limit = 0.5 * (second[:, i, i] + second[:, j, j]) - second[:, i, j]
            minus = np.where(near, limit, (first[:, j] - first[:, i]) / np.where(near, 1.0, apart))
            plus = (first[:, i] + first[:, j]) / (s[:, i] + s[:, j])
            ij, ji = 3 * i + j, 3 * j + i
            frame[:, ij, ij] = frame[:, ji, ji] = 0.5 * (minus + plus)
            frame[:, ij, ji] = frame[:, ji, ij] = 0.5 * (minus - plus)
        # Rows (i, j), columns (J, a).
        turn = (np.swapaxes(n, 1, 2)[:, :, None, None, :] * np.swapaxes(N, 1, 2)[:, None, :, :, None]).reshape(-1, 9, 9)
        return Response(stress, np.swapaxes(turn, 1, 2) @ frame @ turn)
