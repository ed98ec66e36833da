"""The logarithm of the posterior of parameters, noise and model error, and what the models say at parameters.

The data y of one curve are

    y_i = f_i(x_s) (model, parameters of specimen s) + d_i (model error) + e_i (noise)
    e_i ~ N(0, sigma^2)                                     independent
    d ~ N(0, delta^2 S K S),   K_ij = exp(-(p_i - p_j)^2 / (2 l^2)),   S = diag(size_i)

with size_i the size of the model at the least-squares fit (at least a tenth of that of the curve), so that delta is a
part of the value: 0.05 is a model that is 5 % off. The error is smooth over the pressure (or strain), l is half of
the range that was measured, and it is the same for all specimens, since their model is. It is integrated out:

    y ~ N(f(x), sigma^2 I + delta^2 S K S) = N(f, Q diag(sigma^2 + delta^2 lambda) Q^T)

with one eigendecomposition of S K S for all sigma and delta (Kennedy and O'Hagan 2001).

Several specimens are parts of one population, each with its own actuator (Gelman et al. 2013, chapter 5):

    log x_s = log x + tau z_s,   z_s ~ N(0, 1)

with tau the scatter between parts. Noises that are stated are taken as known. The others, delta and tau have
half-normal priors.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softgrip_jax.errors import InputError

from ..calibration.cross_validation import by_specimen
from ..calibration.data import Curve
from ..calibration.fit import Fit
from ..calibration.model import LEAST_NOISE, answers_of
from .priors import BETWEEN, DISCREPANCY, Prior

NOISE = 0.05
"""Scale of the half-normal prior of a noise that is not stated, as a part of the size of its curve."""

LENGTH = 0.5
"""The error of a model keeps its sign over about this part of the measured range."""

LEAST_SIZE = 0.1
"""The size of a model's error does not fall below that at this part of the curve: it may begin at the wrong
pressure."""

EDGE = 0.05
"""The map of a parameter between its bounds bends within this part of its range from them."""

LEAST_PRECISION = 1.0
"""Of the coordinate of a parameter, as a part of its range, where its prior alone has less."""

ROUNDS, FARTHEST, SETTLED = 10, 0.3, 1e-3
"""Steps to where the models are made linear, the longest of them, and one that is short enough; of logarithms."""

PARTS = ("shell", "finger", "gripper", "material")
"""Numbers below a part of these names are those of a specimen; the others are those of the test."""


class Unknowns(NamedTuple):
    """What is sampled, in SI."""

    x: Float[Array, " n"]
    """Of the population."""
    parts: Float[Array, "S n"]
    """Of the specimens; one row, x itself, where there is just one."""
    tau: Float[Array, " v"]
    sigma: Float[Array, " K"]
    delta: Float[Array, " K"]


class Modelled(NamedTuple):
    """The models at all points of all curves."""

    values: Float[Array, " N"]
    missing: Float[Array, " N"]
    ok: Bool[Array, " N"]


@dataclasses.dataclass(frozen=True)
class SpecimenPressures:
    """Where one model is asked: by each specimen that has points of it, at its own pressures."""

    model: str
    parts: np.ndarray
    xs: np.ndarray
    """One row per specimen; short rows repeat their last entry."""


@dataclasses.dataclass(frozen=True)
class Bounded:
    """A smooth map of the real line between bounds, close to the identity but near them.

        u = low + d log((1 + e^((t - low)/d)) / (1 + e^((t - high)/d))),   d = (high - low) / 20

    What is straight between the bounds stays so: in logarithms, of which this is used, the valley of two parameters
    whose product alone is known.
    """

    low: np.ndarray
    high: np.ndarray

    @property
    def _scaled(self) -> np.ndarray:
        return EDGE * (self.high - self.low)

    def __call__(self, t: Array) -> Array:
        """u of t."""
        d = self._scaled
        return jnp.asarray(self.low) + d * (jax.nn.softplus((t - self.low) / d) - jax.nn.softplus((t - self.high) / d))

    def log_slope(self, t: Array) -> Array:
        """log du/dt."""
        d = self._scaled
        return (
            jax.nn.log_sigmoid((t - self.low) / d)
            + jax.nn.log_sigmoid((self.high - t) / d)
            + np.log1p(-np.exp(-1 / EDGE))
        )

    def inverse(self, u: np.ndarray) -> np.ndarray:
        """t of u, between the bounds."""
        d = self._scaled
        return self.low + d * (np.log(np.expm1((u - self.low) / d)) - np.log1p(-np.exp((u - self.high) / d)))


@dataclasses.dataclass(frozen=True)
class Linear:
    """The models, and the prior of the parameters, linear around the fit."""

    centre: np.ndarray
    """Coordinates of the parameters, then logarithms of the specimens over `between`."""
    values: np.ndarray
    jacobian: np.ndarray
    slope: np.ndarray
    precision: np.ndarray
    """Derivatives of the logarithm of the prior by the coordinates: first, and minus the second."""
    log: np.ndarray
    """Derivatives of the logarithms of the parameters that vary, by their coordinates."""
    mean: np.ndarray
    """These logarithms."""
    whole: bool
    """Whether every point that is used has an equilibrium there."""


@dataclasses.dataclass(frozen=True)
class Errors:
    """One curve's errors: the points that count, and the eigendecomposition of S K S of those."""

    points: np.ndarray
    sizes: np.ndarray
    lam: np.ndarray
    q: np.ndarray


class Density:
    """The posterior density of a fit's parameters.

    A point is v, one real number for each unknown: parameters and specimens, counted from what linear models say of
    them given tau, sigma and delta; then the logarithms of those as parts of their priors' scales.

    Args:
        fit: the least-squares fit: it says which points have an equilibrium, and where the sampling begins.
        priors: one per parameter.
        discrepancy: scale of the prior of delta; 0 takes the models as right.
        between: scale of the prior of tau; 0 takes all specimens as alike.
    """

    def __init__(
        self, fit: Fit, priors: list[Prior], discrepancy: float = DISCREPANCY, between: float = BETWEEN
    ) -> None:
        self.fit, self.fitting, self.priors = fit, fit.fitting, tuple(priors)
        self.discrepancy, self.between = discrepancy, between
        fitting, space = fit.fitting, fit.fitting.space
        self.n, self.y = space.size, np.asarray(fitting.y)
        self.used = np.asarray(fit.used)
        labels = np.concatenate([curve.labels for curve in fitting.curves])
        counted = [str(name) for name in dict.fromkeys(labels) if self.used[labels == name].any()]
        self.varying = np.array([any(p in PARTS for p in _path(name)) for name in space.names]) & (space.low > 0)
        self.specimens: tuple[str, ...] = tuple(counted) if len(counted) > 1 and between > 0 else ()
        if not self.specimens or not self.varying.any():
            self.specimens, self.varying = (), np.zeros(self.n, dtype=bool)
        self.part_of = np.zeros(len(self.y), dtype=int)
        for k, name in enumerate(self.specimens):
            self.part_of[labels == name] = k
        self.asked, self._places = _asked(fit, self.part_of)
        sizes = np.abs(np.asarray(fit.predicted.response.values))
        self.errors = [_errors(fit, k, sizes) for k in range(len(fitting.curves))]
        self.sampled_noise = np.array([c.fit and c.noise is None for c in fitting.curves])
        self.sampled_delta = np.array([c.fit and discrepancy > 0 for c in fitting.curves])
        self.noise_scales = np.where(self.sampled_noise, NOISE * fitting.sizes, np.asarray(fit.member.sigma))
        self.floor = LEAST_NOISE * fitting.sizes
        count, v = len(self.specimens), int(self.varying.sum())
        cuts = np.cumsum([0, self.n + count * v, v, self.sampled_noise.sum(), self.sampled_delta.sum()])
        self._cuts = [slice(int(a), int(b)) for a, b in itertools.pairwise(cuts)]
        self.size = int(cuts[-1])
        self.logs = space.low > 0
        ends = np.where(self.logs, np.log(np.where(self.logs, [space.low, space.high], 1.0)), [space.low, space.high])
        self.bounded = Bounded(*ends)
        self._linear = self._linearised()

    def _x(self, t: Float[Array, " n"]) -> Float[Array, " n"]:
        """Parameters in SI from their coordinates."""
        u = self.bounded(t)
        return jnp.where(self.logs, jnp.exp(jnp.where(self.logs, u, 0.0)), u)

    def _linearised(self) -> Linear:
        """The models, linear around what they and the priors find likely where sigma and delta are as in the middle of
        their priors: beginning at the fit, of each specimen at its own fit, by steps of Gauss and Newton."""
        fit, space, own = self.fit, self.fitting.space, np.flatnonzero(self.varying)
        alone = by_specimen(fit) if self.specimens else None
        inner = np.asarray(space.from_unit(jnp.asarray(space.inside(space.to_unit(fit.x)))))
        middle = self.bounded.inverse(np.where(self.logs, np.log(np.where(self.logs, inner, 1.0)), inner))
        rows = []
        for name in self.specimens:
            known = alone is not None and name in alone.names
            x = alone.x[alone.names.index(name)] if known else fit.x  # type: ignore[union-attr]
            rows.append(np.log(np.abs(x[own])) / self.between)
        centre = np.concatenate([middle, *rows])
        found = self._around(centre)
        h = self._middle()
        for _ in range(ROUNDS):
            self._linear = found
            moved = np.asarray(self._affine(h, jnp.asarray(self.y))[0]) - found.centre
            following = self._around(
                found.centre + moved * min(1.0, FARTHEST / max(float(np.max(np.abs(moved))), 1e-12))
            )
            if not following.whole:
                break
            found = following
            if np.max(np.abs(moved)) < SETTLED:
                break
        return found

    def _middle(self) -> tuple[Array, Array, Array]:
        """tau, sigma and delta in the middle of their priors; noises as the fit has them."""
        delta = np.where(self.sampled_delta, 0.5 * self.discrepancy, 0.0)
        sigma = np.asarray(self.fit.member.sigma)
        sigma = np.where(self.sampled_noise, np.minimum(sigma, 0.5 * self.noise_scales), sigma)
        tau = np.full(int(self.varying.sum()), 0.5 * self.between)
        return jnp.asarray(tau), jnp.asarray(sigma), jnp.asarray(delta)

    def _around(self, centre: np.ndarray) -> Linear:
        """The models, linear around a place; a point that has no equilibrium there says nothing."""
        fitting, own = self.fitting, np.flatnonzero(self.varying)
        middle, count = jnp.asarray(centre[: self.n]), len(own)
        by_t, x = np.asarray(jax.jacfwd(self._x)(middle)), np.asarray(self._x(middle))
        values, slopes, whole = np.zeros(len(self.y)), np.zeros((len(self.y), self.n)), True
        for s in range(max(len(self.specimens), 1)):
            part = x.copy()
            if self.specimens:
                part[own] = np.exp(self.between * centre[self.n + s * count : self.n + (s + 1) * count])
            predicted, at = fitting.predict_at(part), self.part_of == s
            ok = np.asarray(predicted.response.ok)
            whole = whole and bool(np.all(ok[at & self.used]))
            values[at] = np.where(ok, np.asarray(predicted.response.values), self.y)[at]
            slopes[at] = np.where(ok[:, None], np.asarray(predicted.slopes), 0.0)[at]
        jacobian = np.zeros((len(self.y), len(centre)))
        jacobian[:, : self.n] = (slopes * ~self.varying) @ by_t
        for i, part in enumerate(self.part_of if self.specimens else ()):
            place = slice(self.n + part * count, self.n + (part + 1) * count)
            jacobian[i, place] = slopes[i, own] * np.exp(self.between * centre[place]) * self.between
        slope = np.asarray(jax.grad(self._log_prior_of_t)(middle))
        bend = np.asarray(jax.hessian(self._log_prior_of_t)(middle))
        precision = np.maximum(-np.diag(bend), LEAST_PRECISION / (self.bounded.high - self.bounded.low) ** 2)
        log, mean = np.diag(by_t)[own] / x[own], np.log(np.abs(x[own]))
        return Linear(centre, values, jacobian, slope, precision, log, mean, whole)

    def _affine(self, h: tuple[Array, Array, Array], y: Float[Array, " N"]) -> tuple[Array, Array]:
        """(mean, root of the inverse covariance) of parameters and specimens, given tau, sigma, delta and y, by models
        that are linear: what is sampled is counted from there in units of that. It is exact for any model, and for
        nearly linear ones there is no funnel, in which a sampler that has found one size of steps is stuck."""
        linear, (tau, sigma, delta) = self._linear, h
        size = len(linear.centre)
        inverse = jnp.zeros((size, size)).at[np.arange(self.n), np.arange(self.n)].add(jnp.asarray(linear.precision))
        pull = jnp.zeros(size).at[: self.n].add(jnp.asarray(linear.slope))
        for k, one in enumerate(self.errors):
            if len(one.points):
                rotated = jnp.asarray(one.q.T @ linear.jacobian[one.points])
                weighted = rotated.T / self.variance(k, sigma, delta)[None, :]
                inverse += weighted @ rotated
                pull += weighted @ (jnp.asarray(one.q).T @ (y - jnp.asarray(linear.values))[one.points])
        count = int(self.varying.sum())
        own = np.flatnonzero(self.varying)
        for s in range(len(self.specimens)):
            place = self.n + s * count + np.arange(count)
            to = np.zeros((count, size))
            to[np.arange(count), place], to[np.arange(count), own] = self.between, -linear.log
            off = self.between * linear.centre[place] - linear.mean
            scaled = jnp.asarray(to) / (tau**2)[:, None]
            inverse += scaled.T @ jnp.asarray(to)
            pull -= scaled.T @ jnp.asarray(off)
        root = jnp.linalg.cholesky(inverse)
        return jnp.asarray(linear.centre) + jax.scipy.linalg.cho_solve((root, True), pull), root

    def _split(self, v: Float[Array, " V"], y: Array | None) -> tuple[Array, Array, tuple[Array, Array, Array]]:
        """(coordinates of the parameters, those of the specimens, (tau, sigma, delta)) of a point."""
        e, tau, noise, delta = (v[cut] for cut in self._cuts)
        noises = self.noise_scales[self.sampled_noise] * jnp.exp(noise)
        sigma = jnp.asarray(self.noise_scales).at[np.flatnonzero(self.sampled_noise)].set(noises)
        sizes = self.discrepancy * jnp.exp(delta)
        errors = jnp.zeros(len(self.errors)).at[np.flatnonzero(self.sampled_delta)].set(sizes)
        h = (self.between * jnp.exp(tau), sigma, errors)
        mean, root = self._affine(h, jnp.asarray(self.y) if y is None else y)
        place = mean + jax.scipy.linalg.solve_triangular(root, e, lower=True, trans=1)
        return place[: self.n], jnp.reshape(place[self.n :], (len(self.specimens), int(self.varying.sum()))), h

    def unknowns(self, v: Float[Array, " V"], y: Array | None = None) -> Unknowns:
        """A point in SI; y: other data than those of the fit."""
        t, own, (tau, sigma, delta) = self._split(v, y)
        x = self._x(t)
        rows = jnp.broadcast_to(x, (max(len(self.specimens), 1), self.n))
        if self.specimens:
            rows = rows.at[:, np.flatnonzero(self.varying)].set(jnp.exp(self.between * own))
        return Unknowns(x, rows, tau, sigma, delta)

    def _log_prior_of_t(self, t: Float[Array, " n"]) -> Float[Array, ""]:
        """Of the parameters, by their coordinates."""
        x = self._x(t)
        total = jnp.sum(self.bounded.log_slope(t) + jnp.where(self.logs, jnp.log(jnp.abs(x)), 0.0))
        return total + sum(prior.log_density(x[j]) for j, prior in enumerate(self.priors))

    def log_prior(self, v: Float[Array, " V"], y: Array | None = None) -> Float[Array, ""]:
        """Logarithm of the prior density by v."""
        t, own, h = self._split(v, y)
        _, tau, noise, delta = (v[cut] for cut in self._cuts)
        total = self._log_prior_of_t(t)
        for scaled in (tau, noise, delta):
            total += jnp.sum(scaled - 0.5 * jnp.exp(2 * scaled))
        if self.specimens:
            x = self._x(t)[self.varying]
            apart = (self.between * own - jnp.log(x)[None, :]) / h[0][None, :]
            total -= jnp.sum(0.5 * apart**2 + tau[None, :])
        return total - jnp.sum(jnp.log(jnp.diag(self._affine(h, jnp.asarray(self.y) if y is None else y)[1])))

    def modelled(self, parts: Float[Array, "S n"], slopes: bool = True) -> Modelled:
        """The models with the parameters of all specimens (SI), with exact first derivatives by them."""
        answered: dict[str, Any] = {}
        for one in self.asked:
            rows = parts[one.parts]
            at = jax.lax.stop_gradient(rows)
            values, missing, ok = _with_slopes(self, one, at) if slopes else _plain(self, one, at)
            if slopes:
                (values, by_x), (missing, back) = values, missing
                change = (rows - at)[:, None, :]
                values = {name: v + jnp.sum(by_x[name] * change, -1) for name, v in values.items()}
                missing = missing + jnp.sum(back * change, -1)
            answered[one.model] = values, missing, ok
        found = []
        for curve, (row, place) in zip(self.fitting.curves, self._places, strict=True):
            if row is None:
                nothing = jnp.zeros(len(curve.x))
                found.append(Modelled(nothing, nothing, nothing > 1))
                continue
            values, missing, ok = answered[curve.model]
            key = _key(curve)
            found.append(Modelled(values[key][row, place], missing[row, place], ok[row, place]))
        return jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *found)

    def log_likelihood(
        self, modelled: Modelled, sigma: Float[Array, " K"], delta: Float[Array, " K"], y: Float[Array, " N"]
    ) -> Float[Array, ""]:
        """Logarithm of the density of the data, up to a constant.

        A point without equilibrium at these parameters misses by more than its curve is large: so a part of the
        parameters is left that has next to no probability, and the slope leads back from there.
        """
        sizes = jnp.asarray(self.fitting.sizes)[self.fitting.of_curve]
        r = jnp.where(modelled.ok, modelled.values - y, sizes * (1 + modelled.missing))
        total = jnp.zeros(())
        for k, one in enumerate(self.errors):
            if len(one.points):
                variance = self.variance(k, sigma, delta)
                rotated = jnp.asarray(one.q).T @ r[one.points]
                total -= 0.5 * jnp.sum(rotated**2 / variance + jnp.log(variance))
        return total

    def variance(self, k: int, sigma: Float[Array, " K"], delta: Float[Array, " K"]) -> Float[Array, " m"]:
        """Eigenvalues of the covariance of a curve."""
        return sigma[k] ** 2 + self.floor[k] ** 2 + delta[k] ** 2 * jnp.asarray(self.errors[k].lam)

    def potential(self, v: Float[Array, " V"], y: Float[Array, " N"] | None = None) -> Float[Array, ""]:
        """Minus the logarithm of the posterior density, up to a constant."""
        found = self.unknowns(v, y)
        modelled = self.modelled(found.parts)
        data = jnp.asarray(self.y) if y is None else y
        return -(self.log_prior(v, y) + self.log_likelihood(modelled, found.sigma, found.delta, data))

    def table(self, found: Unknowns) -> np.ndarray:
        """The unknowns as one vector, in SI, in the order of `names`."""
        parts = np.asarray(found.parts)[..., self.varying] if self.specimens else np.zeros((*found.tau.shape[:-1], 0))
        columns = [found.x, parts.reshape(*parts.shape[: np.ndim(found.x) - 1], -1), found.tau]
        columns += [np.asarray(found.sigma)[..., self.sampled_noise], np.asarray(found.delta)[..., self.sampled_delta]]
        return np.concatenate([np.asarray(c) for c in columns], axis=-1)

    @property
    def names(self) -> list[str]:
        """Of the unknowns, for people."""
        space, curves = self.fitting.space, self.fitting.curves
        varying = [name for name, own in zip(space.names, self.varying, strict=True) if own]
        found = [*space.names, *(f"{name} of {s or 'the others'}" for s in self.specimens for name in varying)]
        found += [f"the scatter of {name}" for name in varying]
        for what, own in (("noise", self.sampled_noise), ("model error", self.sampled_delta)):
            found += [f"the {what} of {c.name}" for c, sampled in zip(curves, own, strict=True) if sampled]
        return found

    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """(a point near the fit, a length of each coordinate that the density is smooth over)."""
        v, scale = np.zeros(self.size), np.ones(self.size)
        scale[self._cuts[0]] = 0.5
        v[self._cuts[1]], scale[self._cuts[1]] = np.log(0.5), 0.3
        sigma = np.maximum(np.asarray(self.fit.member.sigma), 1e-3 * self.noise_scales)
        v[self._cuts[2]] = np.log(sigma / self.noise_scales)[self.sampled_noise]
        scale[self._cuts[2]] = 0.3
        v[self._cuts[3]], scale[self._cuts[3]] = np.log(0.3), 0.5
        return v, scale


def require_touched(fit: Fit) -> None:
    """An InputError where no fitted point depends on a parameter."""
    slopes = np.asarray(fit.predicted.slopes)[fit.used]
    for name, column in zip(fit.fitting.space.names, slopes.T, strict=True):
        if not np.any(column != 0):
            raise InputError(
                f"The data do not touch {name}: its posterior would be its prior; leave it out, or fit a curve that "
                "depends on it."
            )


def require_normal(fit: Fit) -> None:
    """An InputError where the fit was not one by least squares."""
    if fit.fitting.loss != "linear":
        raise InputError(
            f"A posterior takes the noise as normal, and the loss is {fit.fitting.loss!r}; it must be 'linear'."
        )


def _path(name: str) -> list[str]:
    return name.split("=")[0].strip().split(".")


def _key(curve: Curve) -> str:
    return curve.quantity if curve.component is None else f"{curve.quantity}.{curve.component}"


def _asked(fit: Fit, part_of: np.ndarray) -> tuple[list[SpecimenPressures], list[Any]]:
    """Where the models are asked, and (row, place) there of every point of every curve; (None, None) of a curve that
    is predicted only."""
    fitting = fit.fitting
    asked: dict[str, SpecimenPressures] = {}
    models = np.array([c.model for c in fitting.curves])[fitting.of_curve]
    fitted = np.array([c.fit for c in fitting.curves])[fitting.of_curve]
    for model in dict.fromkeys(models[fitted]):
        own = (models == model) & fitted
        parts = np.unique(part_of[own])
        rows = [np.unique(fitting.x[own & (part_of == p)]) for p in parts]
        size = max(map(len, rows))
        padded = np.array([np.append(row, np.full(size - len(row), row[-1])) for row in rows])
        asked[str(model)] = SpecimenPressures(str(model), parts, padded)
    places: list[Any] = []
    for k, curve in enumerate(fitting.curves):
        if not curve.fit:
            places.append((None, None))
            continue
        one, parts = asked[curve.model], part_of[fitting.of_curve == k]
        row = np.searchsorted(one.parts, parts)
        place = np.array([int(np.argmax(one.xs[r] == x)) for r, x in zip(row, curve.x, strict=True)])
        places.append((row, place))
    return list(asked.values()), places


def _errors(fit: Fit, k: int, sizes: np.ndarray) -> Errors:
    fitting, curve = fit.fitting, fit.fitting.curves[k]
    points = np.flatnonzero((fitting.of_curve == k) & fit.used) if curve.fit else np.zeros(0, dtype=int)
    if not len(points):
        return Errors(points, np.zeros(0), np.zeros(0), np.zeros((0, 0)))
    x, size = fitting.x[points], np.maximum(sizes[points], LEAST_SIZE * curve.size)
    length = LENGTH * max(float(np.ptp(x)), 1e-9 * float(np.max(np.abs(x))) + 1e-300)
    kernel = np.exp(-0.5 * ((x[:, None] - x[None, :]) / length) ** 2)
    lam, q = np.linalg.eigh(size[:, None] * kernel * size[None, :])
    return Errors(points, size, np.maximum(lam, 0), q)


def _named(observables: dict[str, Array], curves: tuple[Curve, ...], model: str) -> dict[str, Array]:
    """The quantities that are measured of a model."""
    found = {}
    for c in curves:
        if c.model == model and c.fit:
            value = observables[c.quantity]
            found[_key(c)] = value if c.component is None else value[:, c.component]
    return found


def _one(density: Density, asked: SpecimenPressures, x: Array, at: Array) -> tuple[dict[str, Array], Array, Array]:
    model = density.fitting.space.scenes_at(x)[asked.model]
    observables, ok, missing, _ = answers_of(model, at)
    named = _named(observables, density.fitting.curves, asked.model)
    return {name: jnp.where(ok, v, 0.0) for name, v in named.items()}, missing, ok


def _plain(density: Density, asked: SpecimenPressures, rows: Array) -> Any:
    return jax.vmap(lambda x, at: _one(density, asked, x, at))(rows, jnp.asarray(asked.xs))


def _with_slopes(density: Density, asked: SpecimenPressures, rows: Array) -> Any:
    """Values and derivatives by one program: all parameters in one forward pass, as in the fit."""

    def one(x, at):
        def split(x):
            values, missing, ok = _one(density, asked, x, at)
            return (values, missing), (values, missing, ok)

        (by_x, back), (values, missing, ok) = jax.jacfwd(split, has_aux=True)(x)
        return values, by_x, missing, back, ok

    found = jax.lax.stop_gradient(jax.vmap(one)(rows, jnp.asarray(asked.xs)))
    values, by_x, missing, back, ok = found
    return (values, by_x), (missing, back), ok
