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

with tau the scatter between parts. Noises that are stated are taken as known. The others, delta and tau have half
normal priors; all three are sampled as logarithms.
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

from ..calibration.data import Curve
from ..calibration.fit import Fit
from ..calibration.model import LEAST_NOISE, _answers
from .priors import BETWEEN, DISCREPANCY, Prior

NOISE = 0.05
"""Scale of the half-normal prior of a noise that is not stated, as a part of the size of its curve."""

LENGTH = 0.5
"""The error of a model keeps its sign over about this part of the measured range."""

LEAST_SIZE = 0.1
"""The size of a model's error does not fall below that at this part of the curve: it may begin at the wrong
pressure."""

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
class Asked:
    """Where one model is asked: by each specimen that has points of it, at its own pressures."""

    model: str
    parts: np.ndarray
    xs: np.ndarray
    """One row per specimen; short rows repeat their last entry."""


@dataclasses.dataclass(frozen=True)
class Errors:
    """One curve's errors: the points that count, and the eigendecomposition of S K S of those."""

    points: np.ndarray
    sizes: np.ndarray
    lam: np.ndarray
    q: np.ndarray


class Density:
    """The posterior density of a fit's parameters.

    A point is v, one real number for each unknown: the parameters (logit of their place between the bounds), the
    specimens, then the logarithms of tau, sigma and delta as parts of their priors' scales.

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
        labels = specimens_of(fitting.curves)
        counted = [str(name) for name in dict.fromkeys(labels) if self.used[labels == name].any()]
        self.varying = np.array([any(p in PARTS for p in _path(name)) for name in space.names]) & (space.low > 0)
        self.specimens: tuple[str, ...] = tuple(counted) if len(counted) > 1 and between > 0 else ()
        if not self.specimens or not self.varying.any():
            self.specimens, self.varying = (), np.zeros(self.n, dtype=bool)
        self.part_of = np.zeros(len(self.y), dtype=int)
        for k, name in enumerate(self.specimens):
            self.part_of[labels == name] = k
        self.asked, self._places = _asked(fit, self.part_of, self.used)
        sizes = np.abs(np.asarray(fit.predicted.response.values))
        self.errors = [_errors(fit, k, sizes) for k in range(len(fitting.curves))]
        self.sampled_noise = np.array([c.fit and c.noise is None for c in fitting.curves])
        self.sampled_delta = np.array([c.fit and discrepancy > 0 for c in fitting.curves])
        self.noise_scales = np.where(self.sampled_noise, NOISE * fitting.sizes, np.asarray(fit.member.sigma))
        self.floor = LEAST_NOISE * fitting.sizes
        count, v = len(self.specimens), int(self.varying.sum())
        self.centred = self._centred()
        cuts = np.cumsum([0, self.n, count * v, v, self.sampled_noise.sum(), self.sampled_delta.sum()])
        self._cuts = [slice(int(a), int(b)) for a, b in itertools.pairwise(cuts)]
        self.size = int(cuts[-1])

    def _centred(self) -> np.ndarray:
        """Whether the specimens are sampled themselves (their data say more of them than the population does), or
        their z: the other way, either is slow."""
        return self._relative < self.between

    @property
    def _relative(self) -> np.ndarray:
        """Standard deviations of the numbers that vary, by the fit, as parts of them."""
        fit, own = self.fit, self.varying
        return np.minimum(fit.deviation, 1e3)[own] * np.asarray(fit.scales)[own] / np.abs(fit.x[own])

    def unknowns(self, v: Float[Array, " V"]) -> Unknowns:
        """A point in SI."""
        t, parts, tau, noise, delta = (v[cut] for cut in self._cuts)
        x = self.fitting.space.from_unit(jax.nn.sigmoid(t))
        scatter = self.between * jnp.exp(tau)
        rows = jnp.broadcast_to(x, (max(len(self.specimens), 1), self.n))
        if self.specimens:
            z = jnp.reshape(parts, (len(self.specimens), -1))
            own = jnp.where(self.centred, jnp.asarray(self._own) + z * self.between, 0.0)
            change = jnp.where(self.centred, own - jnp.log(x[self.varying])[None, :], scatter[None, :] * z)
            rows = rows.at[:, np.flatnonzero(self.varying)].set(x[self.varying][None, :] * jnp.exp(change))
        noises = self.noise_scales[self.sampled_noise] * jnp.exp(noise)
        sigma = jnp.asarray(self.noise_scales).at[np.flatnonzero(self.sampled_noise)].set(noises)
        errors = (
            jnp.zeros(len(self.errors)).at[np.flatnonzero(self.sampled_delta)].set(self.discrepancy * jnp.exp(delta))
        )
        return Unknowns(x, rows, scatter, sigma, errors)

    @property
    def _own(self) -> np.ndarray:
        """Where the logarithms of centred specimens are counted from."""
        return np.log(np.abs(self.fit.x[self.varying]))[None, :]

    def log_prior(self, v: Float[Array, " V"]) -> Float[Array, ""]:
        """Logarithm of the prior density by v."""
        space = self.fitting.space
        t, parts, tau, noise, delta = (v[cut] for cut in self._cuts)
        x = space.from_unit(jax.nn.sigmoid(t))
        total = jnp.sum(jax.nn.log_sigmoid(t) + jax.nn.log_sigmoid(-t))
        total += jnp.sum(jnp.where(space.is_log, jnp.log(jnp.abs(x)), 0.0))
        total += sum(prior.log_density(x[j]) for j, prior in enumerate(self.priors))
        for scaled in (tau, noise, delta):
            total += jnp.sum(scaled - 0.5 * jnp.exp(2 * scaled))
        if self.specimens:
            z = jnp.reshape(parts, (len(self.specimens), -1))
            scatter = self.between * jnp.exp(tau)[None, :]
            own = jnp.asarray(self._own) + z * self.between - jnp.log(x[self.varying])[None, :]
            centred = -0.5 * (own / scatter) ** 2 - tau[None, :]
            total += jnp.sum(jnp.where(self.centred, centred, -0.5 * z**2))
        return total

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
        found = self.unknowns(v)
        modelled = self.modelled(found.parts)
        data = jnp.asarray(self.y) if y is None else y
        return -(self.log_prior(v) + self.log_likelihood(modelled, found.sigma, found.delta, data))

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
        """(the fit as a point, a length of each coordinate that the density is smooth over)."""
        fit, space = self.fit, self.fitting.space
        t = space.inside(space.to_unit(fit.x))
        v = np.zeros(self.size)
        v[self._cuts[0]] = np.log(t / (1 - t))
        scale = np.ones(self.size)
        slope = np.where(space.is_log, 1 / np.log(space.high / np.where(space.is_log, space.low, 1.0)), 1.0)
        scale[self._cuts[0]] = np.clip(fit.deviation * slope / (t * (1 - t)), 1e-4, 1.0)
        if self.specimens:
            v[self._cuts[2]] = np.log(0.3)
            own = np.clip(self._relative / self.between, 1e-4, 1.0)
            scale[self._cuts[1]] = np.tile(np.where(self.centred, own, 1.0), len(self.specimens))
        sampled = self.sampled_noise
        sigma = np.maximum(np.asarray(fit.member.sigma), 1e-3 * self.noise_scales)
        v[self._cuts[3]] = np.log(sigma / self.noise_scales)[sampled]
        v[self._cuts[4]] = np.log(0.3)
        return v, scale


def specimens_of(curves: tuple[Curve, ...]) -> np.ndarray:
    """The name of the specimen of every point; '' where a curve names none."""
    return np.concatenate(
        [
            np.full(len(c.x), "") if c.specimen is None else np.array([c.specimens[int(i)] for i in c.specimen])
            for c in curves
        ]
    )


def require_touched(fit: Fit) -> None:
    """An InputError where no fitted point depends on a parameter."""
    slopes = np.asarray(fit.predicted.slopes)[fit.used]
    for name, column in zip(fit.fitting.space.names, slopes.T, strict=True):
        if not np.any(column != 0):
            raise InputError(
                f"The data do not touch {name}: its posterior would be its prior; leave it out, or fit a curve that "
                "depends on it."
            )


def _path(name: str) -> list[str]:
    return name.split("=")[0].strip().split(".")


def _key(curve: Curve) -> str:
    return curve.quantity if curve.component is None else f"{curve.quantity}.{curve.component}"


def _asked(fit: Fit, part_of: np.ndarray, used: np.ndarray) -> tuple[list[Asked], list[Any]]:
    """Where the models are asked, and (row, place) there of every point of every curve; (None, None) of a curve that
    is predicted only."""
    fitting = fit.fitting
    asked: dict[str, Asked] = {}
    models = np.array([c.model for c in fitting.curves])[fitting.of_curve]
    fitted = np.array([c.fit for c in fitting.curves])[fitting.of_curve]
    for model in dict.fromkeys(models[fitted]):
        own = (models == model) & fitted
        parts = np.unique(part_of[own])
        rows = [np.unique(fitting.x[own & (part_of == p)]) for p in parts]
        size = max(map(len, rows))
        padded = np.array([np.append(row, np.full(size - len(row), row[-1])) for row in rows])
        asked[str(model)] = Asked(str(model), parts, padded)
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


def _one(density: Density, asked: Asked, x: Array, at: Array) -> tuple[dict[str, Array], Array, Array]:
    model = density.fitting.space.scenes_at(x)[asked.model]
    observables, ok, missing, _ = _answers(model, at)
    named = _named(observables, density.fitting.curves, asked.model)
    return {name: jnp.where(ok, v, 0.0) for name, v in named.items()}, missing, ok


def _plain(density: Density, asked: Asked, rows: Array) -> Any:
    return jax.vmap(lambda x, at: _one(density, asked, x, at))(rows, jnp.asarray(asked.xs))


def _with_slopes(density: Density, asked: Asked, rows: Array) -> Any:
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
