"""Meshes of boxes: graded lines of cells, every second mesh with each cell divided in two along each axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from ..errors import InputError

MISSING = 'finite elements need scikit-fem: pip install "softgrip_jax[verify]".'


def line(start: float, end: float, cells: int, low: float = 1.0, high: float = 1.0) -> Float[np.ndarray, " points"]:
    """Cells between two places, shorter towards an end.

    Args:
        start, end: places, m.
        cells: how many.
        low, high: by how much shorter than the longest the first and the last cell are, dimensionless.

    Examples:
        >>> from softgrip_jax.verify.boxes import line
        >>> print(line(0.0, 1.0, 2, high=3.0).round(3))
        [0.   0.75 1.  ]
    """
    place = np.linspace(0, 1, cells) if cells > 1 else np.zeros(1)
    size = low ** -np.clip(1 - 2 * place, 0, 1) * high ** -np.clip(2 * place - 1, 0, 1)
    if cells == 2 and low == 1:
        size = np.array([high, 1.0])
    return start + (end - start) * np.concatenate([[0], np.cumsum(size)]) / size.sum()


def divided(places: Float[np.ndarray, " points"], parts: int = 2) -> Float[np.ndarray, " more"]:
    """Every cell in equal parts."""
    starts, sizes = places[:-1], np.diff(places)
    return np.append((starts[:, None] + sizes[:, None] * np.arange(parts) / parts).ravel(), places[-1])


def mesh(x: np.ndarray, y: np.ndarray, z: np.ndarray, keep: Any = None) -> Any:
    """Hexahedra of scikit-fem between lines of places (m); keep(middles, shape (3, n)) says which of them."""
    try:
        from skfem import MeshHex
    except ImportError:
        raise InputError(MISSING) from None

    whole = MeshHex.init_tensor(x, y, z)
    if keep is None:
        return whole
    middles = whole.p[:, whole.t].mean(axis=1)
    return whole.restrict(np.flatnonzero(keep(middles)))


def facets_on(grid: Any, axis: int, place: float, size: float, where: Any = None) -> np.ndarray:
    """Numbers of the boundary's facets that lie in a plane; where(middles) keeps some of them."""
    boundary = grid.boundary_facets()
    corners = grid.p[:, grid.facets[:, boundary]]
    flat = np.all(np.abs(corners[axis] - place) < 1e-9 * size, axis=0)
    if where is not None:
        flat &= where(corners.mean(axis=1))
    return boundary[flat]
