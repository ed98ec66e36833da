"""The measured points of a curve as pictures take them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .data import Curve


def points_of(curve: Curve, used: np.ndarray, x_unit: float, unit: float) -> list[Any]:
    """The measured points of a curve for a diagram, specimen by specimen."""
    from softgrip_jax import plots

    if curve.specimen is None:
        return [plots.Points("measured", curve.x / x_unit, curve.y / unit, used)]
    found = []
    for k, name in enumerate(curve.specimens):
        own = curve.specimen == k
        found.append(plots.Points(name, curve.x[own] / x_unit, curve.y[own] / unit, used[own]))
    return found
