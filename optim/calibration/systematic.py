"""Errors of a fit that are no noise: those of a wrong model go together, those of a sensor that was not at zero are one
number in all values of a curve."""

from __future__ import annotations

import numpy as np
from scipy import stats

from .cross_validation import UNLIKELY
from .data import rounded
from .fit import Fit

SYSTEMATIC, SYSTEMATIC_POINTS = 0.6, 8
"""Errors of neighbouring points this much correlated (in curves of so many points) are the model's, not noise: of
independent ones, eight exceed it in one case of thirty."""

TOGETHER = 0.3
"""An offset explains errors that are no more correlated than this from point to point without it: a wrong model leaves
errors that go together."""


def autocorrelation(fit: Fit, k: int, errors: np.ndarray | None = None) -> float:
    """Of the errors of neighbouring points of a curve, along pressure or strain, averaged over its specimens.

    Args:
        fit: a finished fit.
        k: which of its curves.
        errors: of all points of all curves, in SI, where not those of the fit.
    """
    errors, x, top, bottom = fit.errors if errors is None else errors, fit.fitting.x, 0.0, 0.0
    for own in _specimens(fit, k):
        along = errors[own][np.argsort(x[own], kind="stable")]
        top += float(along[1:] @ along[:-1])
        bottom += float(along @ along)
    return top / bottom if bottom > 0 else 0.0


def _specimens(fit: Fit, k: int) -> list[np.ndarray]:
    """The points of every specimen of a curve that were fitted, among those of all curves."""
    curve, of = fit.fitting.curves[k], np.flatnonzero(fit.fitting.of_curve == k)
    specimen = np.zeros(len(of), dtype=int) if curve.specimen is None else curve.specimen
    return [of[(specimen == one) & fit.used[of]] for one in np.unique(specimen)]


def offset(fit: Fit, k: int) -> str | None:
    """A sentence where an offset explains the errors of a curve of one specimen.

    With r the weighted residuals of a fit, J their derivatives by the scaled parameters, and 1_k what an offset of the
    curve adds to them, the least squares of r + J dx + 1_k b are compared with those of r (F test). What a bound holds
    stays there.
    """
    fitting, curve, used = fit.fitting, fit.fitting.curves[k], fit.used
    own = used & (fitting.of_curve == k)
    if fitting.loss != "linear" or curve.specimen is not None or own.sum() < SYSTEMATIC_POINTS:
        return None
    scale = np.sqrt(np.asarray(fit.member.weight)) / np.asarray(fit.member.sigma)[fitting.of_curve]
    slopes = np.asarray(fit.predicted.slopes) * fit.scales * np.asarray(fit.member.free) * ~fit.on_bound
    rows, r = (np.column_stack([slopes, own]) * scale[:, None])[used], (fit.errors * scale)[used]
    change, _, rank, _ = np.linalg.lstsq(rows, -r, rcond=None)
    left, freedom = r + rows @ change, len(r) - rank
    if freedom < 1:
        return None
    square = max(float(left @ left), np.finfo(float).tiny)
    by_chance = stats.f.sf((float(r @ r) - square) / (square / freedom), 1, freedom)
    errors = np.zeros(len(scale))
    errors[used] = left / scale[used]
    if by_chance > UNLIKELY or autocorrelation(fit, k, errors) > TOGETHER:
        return None
    space = fitting.space
    numbers = zip(space.names, space.kinds, fit.shifted(change[:-1]), strict=True)
    values = ", ".join(f"{name} {rounded(x, kind)}" for name, kind, x in numbers)
    return (
        f"{curve.name}: an offset of {rounded(change[-1], curve.kind)} in all values would explain the errors. Was the "
        f"sensor at zero without load? With the offset taken off, the fit is about {values}."
    )
