"""Numbers as built, from the drawing, readings and masses; then moduli from curves, given what is known of the numbers.

The numbers x are normal before, about the drawing x_0 with the workshop's tolerance. Readings and masses m = rho V(x)
are normal about what x says. The most probable x is found by Gauss and Newton's method, and

    C = (C_0^-1 + J^T S^-1 J)^-1

is its covariance, with the derivatives J of all that was measured and the variances S of their errors. Curves are then
fitted with x held: they tell of the moduli theta alone, for a model that is a little wrong would move dimensions that
were measured. The fit moves with x by G = -(R_t^T R_t)^-1 R_t^T R_x, with the derivatives R of the curves over their
noise, so that the covariances are C of x, (R_t^T R_t)^-1 + G C G^T of theta, and G C of both. A noise that is estimated
from few points is not well known itself: it widens the first part (`covariance_of`), and intervals are those of
Student's t, by what of a variance rests on it.

Source: A. Gelman et al., Bayesian Data Analysis, 3rd ed., section 14 (normal linear models); M. Plummer 2015, Cuts in
Bayesian graphical models, Stat. Comput. 25, 37-43; thesis 6.2 for the curves.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from softgrip_jax import cad
from softgrip_jax.errors import InputError
from softgrip_jax.results import NORMAL_95
from softgrip_jax.units import gram

from ..calibration.fit import Fit, finished, reached, require_data
from ..calibration.model import Fitting, covariance_of
from ..calibration.report import misfit, on_bounds
from ..space import to_free
from .settings import Settings

STEP = 1e-3
"""Of a number, relative, for the derivative of a mass by it: volumes are polynomials of low degree."""
ROUNDS = 4
"""Of Gauss and Newton's method: masses are nearly linear within a tolerance."""
CONFLICT = 3.5
"""Standard deviations by which a mass and the readings may differ: one pair in two thousand does by chance."""
ANOTHER = 10.0
"""Standard deviations from the drawing from which readings are of something else: no workshop is so far off."""


@dataclasses.dataclass(frozen=True)
class AsBuilt:
    """What is known of the parts.

    Args:
        drawn, built: the numbers, SI, shape (n,).
        covariance: of the numbers as built, SI.
        fit: of the curves with the numbers held; None without curves.
        fit_covariance: of the numbers and then the parameters of the fit, jointly, SI; None without curves.
        remarks: sentences about the fit.
    """

    drawn: np.ndarray
    built: np.ndarray
    covariance: np.ndarray
    fit: Fit | None = None
    fit_covariance: np.ndarray | None = None
    remarks: tuple[str, ...] = ()

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations of the numbers."""
        return np.sqrt(np.diag(self.covariance if self.fit_covariance is None else self.joint)[: len(self.built)])

    @property
    def joint(self) -> np.ndarray:
        """The covariance of all that is known."""
        return self.covariance if self.fit_covariance is None else self.fit_covariance

    def half_widths(self, along: np.ndarray) -> np.ndarray:
        """Half of the 95 % intervals of combinations of the numbers and then the parameters of the fit, one per row,
        SI."""
        variance = np.einsum("ij,jk,ik->i", along, self.joint, along)
        quantile = NORMAL_95 if self.fit is None else self.fit.quantiles(along * self.fit.scales, variance)
        return quantile * np.sqrt(variance)


def masses_of(settings: Settings, x: np.ndarray) -> dict[str, float]:
    """The mass of every cast part, kg, by its formula. A finger has the chambers of its mould, whatever its length."""
    scenes = settings.space.scenes_at(jnp.asarray(x))
    name = next(name for name, scene in settings.config.scenes.items() if scene is settings.scene)
    export = cad.export_of(scenes[name], settings.manufacture, with_moulds=False, drawn=settings.scene)
    density = settings.manufacture.density_g_per_cm3
    return {
        piece.name: float(piece.volume) / 1000 * density * gram
        for piece in export.pieces
        if piece.made in ("cast", "bonded")
    }


def updated(settings: Settings, masses: Callable[[Settings, np.ndarray], dict[str, float]] = masses_of) -> AsBuilt:
    """The numbers as built, by the drawing, readings and masses.

    Raises:
        InputError: for a part that is not cast, and where a mass and the readings do not go together.
    """
    table = settings.table
    drawn = np.asarray(settings.space.reference, float)
    rows = []
    for k, (one, number) in enumerate(zip(table.numbers, settings.numbers, strict=True)):
        if one.values:
            assert one.uncertainty is not None
            unit = np.zeros(len(drawn))
            unit[k] = 1.0
            deviation = one.uncertainty * number.unit / np.sqrt(len(one.values))
            _require_readings(one, number, float(drawn[k]))
            rows.append((unit, float(np.mean(one.values)) * number.unit, deviation))
    prior = np.diag((np.array([one.tolerance for one in table.numbers]) * drawn) ** -2.0)
    read, C = _best(drawn, prior, rows)
    if not table.masses:
        return AsBuilt(drawn, read, C)
    x = read
    weighed: list[tuple[np.ndarray, float, float]] = []
    for step in range(ROUNDS):
        expected, J = _masses(settings, x, masses)
        weighed = []
        for one in table.masses:
            if one.part not in expected:
                raise InputError(f"A mass is given of {one.part!r}; the cast parts are {', '.join(expected)}.")
            found, slope = expected[one.part], J[one.part]
            error = np.hypot(one.uncertainty_g * gram, table.density_spread * found)
            if step == 0:
                _agree(one.part, one.value_g * gram, found, error, slope, C)
            weighed.append((slope, one.value_g * gram - found + slope @ x, error))
        x, C_new = _best(drawn, prior, [*rows, *weighed])
    return AsBuilt(drawn, x, C_new)


def _require_readings(one: Any, number: Any, drawn: float) -> None:
    """InputError where the readings of a number differ by more than they can, or are of something else."""
    values = np.array(one.values)
    off = float(np.max(np.abs(values - np.median(values))))
    if off > CONFLICT * np.sqrt(2) * one.uncertainty:
        raise InputError(
            f"The readings of {number.key}, {', '.join(f'{v:g}' for v in values)}, differ by {off:g}, and their "
            f"uncertainty is {one.uncertainty:g}; one of them is wrong, or the uncertainty."
        )
    mean, was = float(np.mean(values)), drawn / number.unit
    spread = np.hypot(one.uncertainty / np.sqrt(len(values)), one.tolerance * was)
    if abs(mean - was) > ANOTHER * spread:
        raise InputError(
            f"The readings of {number.key} say {mean:g} where {was:g} is drawn, {abs(mean - was) / spread:.0f} times "
            "what uncertainty and tolerance allow; is it another number, or another unit?"
        )


def _best(
    drawn: np.ndarray, prior: np.ndarray, rows: list[tuple[np.ndarray, float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """(the most probable numbers, their covariance) from rows (derivative, value, standard deviation)."""
    A, b = prior.copy(), prior @ drawn
    for slope, value, deviation in rows:
        A += np.outer(slope, slope) / deviation**2
        b += slope * value / deviation**2
    C = np.linalg.inv(A)
    return C @ b, C


def _masses(settings: Settings, x: np.ndarray, masses: Any) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Masses and their derivatives, by central differences."""
    middle = masses(settings, x)
    slopes = {name: np.zeros(len(x)) for name in middle}
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = STEP * x[k]
        up, down = masses(settings, x + step), masses(settings, x - step)
        for name in middle:
            slopes[name][k] = (up[name] - down[name]) / (2 * step[k])
    return middle, slopes


def _agree(part: str, mass: float, expected: float, error: float, slope: np.ndarray, C: np.ndarray) -> None:
    """InputError where a mass is further from what the readings and the drawing say than all their errors allow."""
    spread = float(np.sqrt(slope @ C @ slope))
    if abs(mass - expected) > CONFLICT * np.hypot(error, spread):
        raise InputError(
            f"The mass of the {part}, {mass / gram:.4g} g, does not go with its dimensions, which say "
            f"{expected / gram:.4g} +- {NORMAL_95 * spread / gram:.2g} g; weigh and measure again, or correct "
            "density_g_per_cm3 or the tolerances."
        )


def calibrated(settings: Settings, known: AsBuilt) -> AsBuilt:
    """The same with the parameters of the curves, fitted with the numbers as built.

    Raises:
        InputError: where the curves cannot give a fit.
    """
    assert settings.calibration is not None
    own = settings.calibration.fitting
    models, variables = own.given.scenes, own.space.variables
    count = len(known.built)
    fitting = Fitting(models, [*settings.space.variables, *variables], own.curves, own.loss)
    require_data(own)
    start = np.concatenate([known.built, np.asarray(own.space.reference, float)])
    free = np.arange(len(start)) >= count
    t = fitting.space.inside(fitting.space.to_unit(start))
    member = fitting.member(to_free(t), free=free)
    member = member._replace(start=fitting.fit_member_jit(member).u)
    member, dropped = reached(fitting, member, own.space.size)
    fit = finished(fitting, member, dropped)
    sigma = np.asarray(fit.member.sigma)[fitting.of_curve]
    rows = np.asarray(fit.predicted.slopes) * (np.sqrt(np.asarray(fit.member.weight)) / sigma)[:, None]
    by_x, by_theta = rows[:, :count], rows[:, count:]
    information = by_theta.T @ by_theta
    sizes = np.abs(np.asarray(fit.x)[count:])
    if np.linalg.matrix_rank(information * np.outer(sizes, sizes)) < len(information):
        names = " and ".join(own.space.names)
        raise InputError(f"The curves do not determine {names}: hold one, or measure something else.")
    inverse, C = np.linalg.inv(information), known.covariance
    scaled = covariance_of(jnp.asarray(by_theta * sizes), fitting.of_curve, jnp.asarray(fit.unsure))
    own = float(fit.robust_factors.covariance) * np.asarray(scaled) * np.outer(sizes, sizes)
    G = -inverse @ by_theta.T @ by_x
    joint = np.block([[C, C @ G.T], [G @ C, own + G @ C @ G.T]])
    remarks = (*fit.notes, *on_bounds(fit), *misfit(fit))
    return dataclasses.replace(known, fit=fit, fit_covariance=joint, remarks=remarks)
