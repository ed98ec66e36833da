"""Materials side by side: each fitted to one tension test, and what tells them apart."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np

from softgrip_jax.errors import InputError
from softgrip_jax.materials.base import Material
from softgrip_jax.progress import Tell, silent
from softgrip_jax.results import in_units

from ..calibration.cross_validation import Specimens, by_specimen
from ..calibration.data import Curve
from ..calibration.fit import Fit, calibrate, finished, with_noise
from ..calibration.model import Fitting
from ..space import to_free
from .test import Softening, Tension, candidate, softening

COMPARED = (25.0, 50.0, 100.0, 200.0, 400.0)
"""Windows of strain, in percent, in which mu is compared where a config names none."""

DEPENDS = 1.2
"""A mu that differs by more than this factor between windows depends on the window."""

STARTS = 16
"""Starts of a fit. There are more than for a scene, since several exponents of an Ogden material fit nearly as well."""


@dataclasses.dataclass(frozen=True)
class FittedMaterial:
    """One material on the test."""

    name: str
    fit: Fit
    material: Material
    akaike: float
    softens: list[Softening]
    specimens: Specimens | None = None
    """Its constants by each specimen alone, where there are several."""

    def ends(self, j: int) -> tuple[float, float]:
        """The 95 % interval of a constant, SI: see `ends_of`."""
        return ends_of(self.fit, self.specimens, j)

    @property
    def rmse(self) -> float:
        """Pa."""
        return self.fit.rmse(0)


def ends_of(fit: Fit, specimens: Specimens | None, j: int) -> tuple[float, float]:
    """The wider of two 95 % intervals, SI: by the noise of the points, and of the mean over specimens."""
    low, high = float(fit.low[j]), float(fit.high[j])
    if specimens is not None and specimens.high[j] - specimens.low[j] > high - low:
        return float(specimens.low[j]), float(specimens.high[j])
    return low, high


@dataclasses.dataclass(frozen=True)
class Window:
    """The neo-Hookean mu of one window, Pa, with its 95 % interval: see `ends_of`."""

    strain: float
    mu: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Comparison:
    """All materials on one test."""

    curve: Curve
    window: float
    """Largest strain that was fitted."""
    judged: list[FittedMaterial]
    """Best first."""
    windows: list[Window]
    remarks: tuple[str, ...] = ()
    """What was left out, in sentences."""

    @property
    def chosen(self) -> FittedMaterial:
        """The best that is stable; the best, where none is."""
        return next((one for one in self.judged if not one.softens), self.judged[0])


def compare(
    curve: Curve, materials: list[str], window: float, windows: list[float], seed: int = 0, tell: Tell = silent
) -> Comparison:
    """Fit every material to a curve up to a strain, and the neo-Hookean mu in several windows."""
    inside = curve.x <= window * (1 + 1e-9)
    _require_points(curve, inside, window)
    judged, remarks = [], []
    for name in materials:
        tell(f"fitting {name}")
        tried = candidate(name, curve.x[inside], curve.y[inside])
        fitting = Fitting({STRIP: Tension(tried.start)}, tried.variables, [_part(curve, inside)])
        fit = calibrate(fitting, STARTS if len(tried.variables) > 1 else 1, seed, canonical=tried.canonical)
        material = fit.modules()[STRIP].material
        if not bool(material.is_stable_at_rest()):
            remarks.append(f"{name} is left out: {_softer_than_nothing(material)}.")
            continue
        judged.append(FittedMaterial(name, fit, material, akaike(fit), softening(material, window), by_specimen(fit)))
    if not judged:
        raise InputError(f"No material describes this test. {' '.join(remarks)}")
    judged.sort(key=lambda one: one.akaike)
    found = neo_hookean_windows(curve, windows)
    known = {one.strain for one in found}
    weak = [f"{100 * w:.0f} %" for w in windows if w not in known and points_inside(curve, w) >= LEAST_POINTS]
    if weak:
        remarks.append(
            f"There is no neo-Hookean mu up to {' and '.join(weak)} strain: on the whole the stresses there are not "
            "above zero."
        )
    return Comparison(curve, window, judged, found, tuple(remarks))


def _softer_than_nothing(material: Material) -> str:
    modulus = in_units(float(f"{float(material.shear_modulus()):.3g}"), "pressure")
    return f"its best fit has a shear modulus of {modulus} at rest, and no material has a negative one"


STRIP = "test"


def akaike(fit: Fit) -> float:
    """Corrected Akaike criterion."""
    n, k = int(fit.used.sum()), fit.fitting.space.size + 1
    square = float(np.sum(fit.errors[fit.used] ** 2))
    correction = 2 * k * (k + 1) / (n - k - 1) if n > k + 1 else np.inf
    # Numbers that were computed and not measured may be met exactly.
    return n * float(np.log(max(square / n, np.finfo(float).tiny))) + 2 * k + correction


def neo_hookean_windows(curve: Curve, windows: list[float]) -> list[Window]:
    """mu and its 95 % interval in each window that has three points or more, and on the whole a positive stress."""
    tried = candidate("NeoHookean", curve.x, curve.y)
    fitting = Fitting({STRIP: Tension(tried.start)}, tried.variables, [curve])
    start = to_free(fitting.space.inside(fitting.space.to_unit(fitting.space.reference)))
    found = []
    for window in windows:
        inside = curve.x <= window * (1 + 1e-9)
        if points_inside(curve, window) >= LEAST_POINTS:
            member = fitting.member(start, weight=jnp.asarray(inside.astype(float)))
            fit = finished(fitting, with_noise(fitting, member))
            if fit.on_bound.any():
                continue  # the least-squares mu is zero or negative: a slack specimen, or a load cell below its zero
            found.append(Window(window, float(fit.x[0]), *ends_of(fit, by_specimen(fit), 0)))
    return found


LEAST_POINTS = 3


def points_inside(curve: Curve, window: float) -> int:
    return int(np.sum(curve.x <= window * (1 + 1e-9)))


def _part(curve: Curve, inside: np.ndarray) -> Curve:
    specimen = None if curve.specimen is None else curve.specimen[inside]
    return dataclasses.replace(curve, x=curve.x[inside], y=curve.y[inside], specimen=specimen)


def _require_points(curve: Curve, inside: np.ndarray, window: float) -> None:
    if inside.sum() < LEAST_POINTS + 3:
        raise InputError(
            f"{inside.sum()} of {len(curve.x)} points are in the window of {100 * window:g} % strain; materials are "
            f"compared on {LEAST_POINTS + 3} or more."
        )
    if np.max(curve.x[inside]) <= 0 or np.max(curve.y[inside]) <= 0:
        raise InputError("The test has no positive strains and stresses; both are positive in tension.")


SOFT, STIFF = 1e3, 20e6
"""Shear moduli of the softest gels and the hardest rubbers, Pa."""
