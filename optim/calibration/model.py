"""Least squares of models on measured curves, for one set of data; pure JAX, so that many can be run at once.

Every point i of curve k gives one residual, a pure number,

    r_i = (f_i(x) - y_i) / sigma_k,       minimise  1/2 sum_i w_i rho(r_i)

with f the model, sigma_k the noise of the curve, w_i >= 0 a weight (0 leaves a point out; a bootstrap draws them) and
rho a loss. The parameters x move between their bounds by the sine map of `space.py`, so none is ever outside them.
Levenberg (1944) and Marquardt (1963) as in Optimistix, with the exact Jacobian, all parameters in one forward pass.

A point without equilibrium (pressure beyond the limit point at these parameters) has no f. Its residual is then

    r_i = (size of the curve / sigma_k) (1 + missing),   missing = 1/NEAR_LIMIT - limit pressure / pressure

which is finite, larger than that of any point with an answer, and leads back by the slope of the limit pressure. It is
for the way only: what is done with points that end there is decided in `fit.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.numerics.xla import traced_once
from softgrip_jax.parameters import ready
from softgrip_jax.results import Status
from softgrip_jax.scene import Scene

from ..problem import NEAR_LIMIT
from ..space import Space, Variable, to_free, to_unit
from ..tension.test import Tension
from .data import Curve

TOLERANCE = 1e-8
"""The fit has converged when a step that lowers the cost changes neither the free parameters (of order one) nor the
residuals (relative to the size of their curve) by more. A smaller step changes the cost by less than its rounding, and
is taken or not by chance."""

SMALLEST_STEP = 1e-10
"""A proposed step of the free parameters below this ends the fit."""

MAX_STEPS = 200
"""Usual fits take 5 to 30 steps."""

HUBER, CAUCHY, SOFT_L1 = 1.345, 2.385, 1.287
"""Residuals beyond these many sigma count less. Each loses 5 % against least squares where the noise is normal (Huber
1981; Holland and Welsch 1977; the one of soft_l1 by the same integral)."""


def _huber(r: Array) -> Array:
    size, far = jnp.abs(r), jnp.abs(r) > HUBER
    return jnp.where(far, jnp.sign(r) * jnp.sqrt(2 * HUBER * jnp.where(far, size, 1.0) - HUBER**2), r)


def _soft_l1(r: Array) -> Array:
    return r * jnp.sqrt(2 / (jnp.sqrt(1 + (r / SOFT_L1) ** 2) + 1))


def _cauchy(r: Array) -> Array:
    square = (r / CAUCHY) ** 2
    safe = jnp.where(square > 0, square, 1.0)
    return r * jnp.sqrt(jnp.where(square > 0, jnp.log1p(safe) / safe, 1.0))


LOSSES: dict[str, Callable[[Array], Array]] = {
    "linear": lambda r: r,
    "huber": _huber,
    "soft_l1": _soft_l1,
    "cauchy": _cauchy,
}
"""Name -> g with rho(r) = g(r)^2: g is smooth through zero and rises, so that Gauss-Newton applies to it."""


class Response(NamedTuple):
    """What the models say at all points of all curves."""

    values: Float[Array, " N"]
    """SI; 0 where there is no answer."""
    ok: Bool[Array, " N"]
    missing: Float[Array, " N"]
    """How far a point without an answer is from one; a pure number."""
    share: Float[Array, " N"]
    """Pressure over limit pressure; 0 where there is no limit."""


class FitMember(NamedTuple):
    """One fit: the data, and where to start."""

    start: Float[Array, " n"]
    """Free values u."""
    free: Bool[Array, " n"]
    """False holds a parameter where it starts."""
    xs: dict[str, Array]
    """Per model: the pressures or strains at which it is asked."""
    y: Float[Array, " N"]
    weight: Float[Array, " N"]
    sigma: Float[Array, " K"]


class Predicted(NamedTuple):
    """The models and their derivatives at some parameters."""

    response: Response
    slopes: Float[Array, "N n"]
    """Of the values, by the parameters in SI."""
    back: Float[Array, "N n"]
    """Of `missing`, likewise."""


class Fitted(NamedTuple):
    """Where one fit ended."""

    u: Float[Array, " n"]
    x: Float[Array, " n"]
    """SI."""
    cost: Float[Array, ""]
    """1/2 sum of w rho(r)."""
    predicted: Predicted
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


class Statistics(NamedTuple):
    """What the residuals tell."""

    sigma: Float[Array, " K"]
    """Noise per curve: as stated, or estimated."""
    covariance: Float[Array, "n n"]
    """Of the scaled parameters."""


class RobustFactors(NamedTuple):
    """What a robust loss multiplies by; 1 of least squares."""

    covariance: Float[Array, ""]
    cost: Float[Array, ""]
    """Twice the cost that is added where a true parameter is held is, on the average, this."""


class _Marquardt(optx.LevenbergMarquardt):
    """Levenberg-Marquardt that also ends where the next step would be too small to matter (xtol of MINPACK).

    Optimistix ends after a step that was accepted. At the minimum itself a step changes the cost by rounding alone, is
    rejected every other time, and the damping grows until the steps vanish.
    """

    def __init__(self) -> None:
        super().__init__(rtol=TOLERANCE, atol=TOLERANCE)

    def terminate(self, fn, y, args, options, state, tags):
        done, result = super().terminate(fn, y, args, options, state, tags)
        step = jnp.max(jnp.abs(state.y_eval - y))
        return done | (~state.first_step & (step < SMALLEST_STEP)), result


class Fitting:
    """Models, their varied parameters, and the curves that they shall follow.

    Curves of one model share its solves.

    Args:
        models: scenes and tension tests by name.
        variables: the parameters and their bounds.
        curves: what was measured.
        loss: "linear", or a robust one, see LOSSES.

    Raises:
        InputError: for an unknown loss, a name that no model has, a quantity that a model does not have, two curves of
            one name, or the same points twice.

    Examples:
        >>> strain = np.linspace(0.1, 1.0, 10)
        >>> curve = optim.Curve("test", "strip", "stress", "pressure", strain, 100 * kPa * strain)
        >>> strip = optim.Tension(sg.NeoHookean(mu=150 * kPa))
        >>> fitting = optim.Fitting({"strip": strip}, [optim.Variable("material.mu", 10 * kPa, 1000 * kPa)], [curve])
        >>> fitting.space.names
        ['material.mu']
    """

    def __init__(
        self,
        models: Mapping[str, Scene | Tension],
        variables: Sequence[Variable],
        curves: Sequence[Curve],
        loss: str = "linear",
    ):
        if loss not in LOSSES:
            raise InputError(f"The loss is {loss!r}; it must be one of {', '.join(map(repr, LOSSES))}.")
        _require_measurable(models, curves)
        _require_once(curves)
        self.space, self.curves, self.loss = Space(ready(models, variables), variables), tuple(curves), loss
        self.given = Space(models, variables)
        """The same leaves of the models as they were given."""
        self.xs: dict[str, np.ndarray] = {}
        self._places: list[np.ndarray] = []
        used = {name: [c for c in curves if c.model == name] for name in models}
        for name, own in used.items():
            if own:
                self.xs[name] = np.unique(np.concatenate([c.x for c in own]))
        for c in self.curves:
            self._places.append(np.searchsorted(self.xs[c.model], c.x))
        self.of_curve = np.repeat(np.arange(len(curves)), [len(c.x) for c in curves])
        """Index of the curve of every point."""
        self.x = np.concatenate([c.x for c in curves])
        self.y = np.concatenate([c.y for c in curves])
        self.sizes = np.array([c.size for c in curves])
        self.known = np.array([c.noise is not None for c in curves])
        """Curves with a stated noise."""
        self.weight = np.concatenate([np.full(len(c.x), float(c.fit)) for c in curves])
        self.fit_member_jit = traced_once(self.fit_member)
        self._predict_jit = traced_once(self.predict_with_slopes)

    def predict(self, x: Float[Array, " n"], xs: dict[str, Array]) -> Response:
        """All models at parameters x (SI)."""
        models = self.space.scenes_at(x)
        parts = []
        answers = {name: answers_of(models[name], at) for name, at in xs.items()}
        for curve, place in zip(self.curves, self._places, strict=True):
            observed, ok, missing, share = answers[curve.model]
            values = observed[curve.quantity]
            values = (values if curve.component is None else values[:, curve.component])[place]
            parts.append(Response(jnp.where(ok[place], values, 0.0), ok[place], missing[place], share[place]))
        return jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *parts)

    def predict_with_slopes(self, x: Float[Array, " n"], xs: dict[str, Array]) -> Predicted:
        """`predict` and its derivatives by x, all parameters in one forward pass."""

        def split(x):
            response = self.predict(x, xs)
            return (response.values, response.missing), response

        (slopes, back), response = jax.jacfwd(split, has_aux=True)(x)
        return Predicted(response, slopes, back)

    def residuals(self, u: Float[Array, " n"], member: FitMember) -> tuple[Float[Array, " N"], Predicted]:
        """(g(r) before the weights, what it comes from). The derivative by u is exact, and there is no second one.

        Values and slopes come from one program, traced once, and the chain rule by u is attached to them: the solver's
        own differentiation would trace and compile the models several times over.
        """
        x = self.space.from_unit(to_unit(u))
        at = jax.lax.stop_gradient(x)
        response, slopes, back = predicted = jax.lax.stop_gradient(self._predict_jit(at, member.xs))
        values, missing = response.values + slopes @ (x - at), response.missing + back @ (x - at)
        sigma = member.sigma[self.of_curve]
        lost = (jnp.asarray(self.sizes)[self.of_curve] / sigma) * (1 + missing)
        return LOSSES[self.loss](jnp.where(response.ok, (values - member.y) / sigma, lost)), predicted

    def fit_member(self, member: FitMember) -> Fitted:
        """One fit."""
        scale = jnp.min(member.sigma / self.sizes)

        def scaled(u, member):
            residuals, predicted = self.residuals(jnp.where(member.free, u, member.start), member)
            weighted = scale * jnp.sqrt(member.weight) * residuals
            # A parameter that is held: its own residual keeps the equations regular and its step zero.
            whole = jnp.concatenate([weighted, jnp.where(member.free, 0.0, u - member.start)])
            return whole, (0.5 * jnp.sum(residuals**2 * member.weight), predicted)

        end = optx.least_squares(
            scaled, _Marquardt(), member.start, args=member, has_aux=True, max_steps=MAX_STEPS, throw=False
        )
        cost, predicted = end.aux
        x = self.space.from_unit(to_unit(end.value))
        converged = end.result == optx.RESULTS.successful
        return Fitted(end.value, x, cost, predicted, end.stats["num_steps"], converged)

    def predict_at(self, x: Any, **xs: Any) -> Predicted:
        """The models at parameters x (SI, within their bounds), at other points where `xs` gives them by model.

        It is a fit with every parameter held, so that nothing more is compiled.
        """
        t = self.space.to_unit(x)
        member = self.member(to_free(np.clip(t, 0, 1)), free=np.zeros(self.space.size, dtype=bool))
        points = {name: jnp.asarray(value) for name, value in xs.items()}
        return self.fit_member_jit(member._replace(xs=member.xs | points)).predicted

    def points(self) -> dict[str, Array]:
        """The pressures and strains at which each model is asked."""
        return {name: jnp.asarray(x) for name, x in self.xs.items()}

    def member(self, start: Any, **changes: Any) -> FitMember:
        """The data as measured, with some entries changed; noises that are not stated start at 1 % of the curve."""
        noises = [c.noise or START_NOISE * c.size for c in self.curves]
        free = jnp.ones(self.space.size, dtype=bool)
        member = FitMember(
            jnp.asarray(start), free, self.points(), jnp.asarray(self.y), jnp.asarray(self.weight), jnp.asarray(noises)
        )
        return member._replace(**{name: jnp.asarray(value) for name, value in changes.items()})

    def scales(self, x: Any) -> Any:
        """What makes a change of each parameter a pure number: its value (log), or its range (linear)."""
        return jnp.where(self.space.is_log, jnp.asarray(x), self.space.high - self.space.low)

    def sizes_of(self, x: Any) -> np.ndarray:
        """What a change of each parameter is small against: its value where that cannot be zero, else its value or at
        least a thousandth of its range."""
        space = self.space
        return np.where(space.low > 0, x, np.maximum(np.abs(x), 1e-3 * (space.high - space.low)))

    def statistics(self, predicted: Predicted, member: FitMember, scales: Any) -> Statistics:
        """Noise per curve and covariance of the parameters from where a fit ended.

        With J the derivatives of r by the scaled parameters, h_i the leverage w_i J_i (J^T W J)^-1 J_i^T:

            sigma_k^2 <- sum_k w (f - y)^2 / sum_k (w - h)      where it is not stated
            covariance = (J^T W J)^-1, wider by what the noises' own errors add (`covariance_of`), times, with a robust
                         loss, `robust_factors`

        With a robust loss an unknown sigma_k is 1.4826 times the median of |f - y| (of points with a weight).
        """
        of_curve, count = self.of_curve, len(self.curves)
        sigma = member.sigma[of_curve]
        weight = member.weight * predicted.response.ok
        jacobian = predicted.slopes * jnp.asarray(scales)[None, :] * (jnp.sqrt(weight) / sigma)[:, None]
        r = jnp.where(weight > 0, (predicted.response.values - member.y) / sigma, 0.0)
        taken = leverage(jacobian * member.free[None, :])  # a parameter that is held fits nothing
        curves = jnp.arange(count)[:, None] == of_curve[None, :]
        freedom, points = curves @ (weight - taken), curves @ weight
        estimated = ~self.known & (freedom > 0)
        unsure = jnp.where(estimated, 1 / jnp.where(freedom > 0, freedom, 1.0), 0.0)
        covariance = covariance_of(jacobian, of_curve, unsure)
        if self.loss == "linear":
            square = curves @ (weight * r**2) / jnp.where(freedom > 0, freedom, 1.0)
        else:
            seen = curves & (weight > 0)[None, :]
            typical = jnp.nanmedian(jnp.where(seen, jnp.abs(r)[None, :], jnp.nan), axis=1)
            square = (NORMAL_MAD * typical) ** 2 * points / jnp.where(freedom > 0, freedom, 1.0)
        least = (LEAST_NOISE * self.sizes) ** 2
        noise = jnp.sqrt(jnp.maximum(square * member.sigma**2, least))
        noise = jnp.where(estimated & (points > 0), noise, member.sigma)
        return Statistics(noise, covariance * self.robust_factors(r, weight, jnp.sum(taken)).covariance)

    def robust_factors(self, r: Array, weight: Array, fitted: Array) -> RobustFactors:
        """What a robust loss makes of the covariance and of the cost; 1 and 1 of least squares.

        With psi = rho'/2, n points and p directions that they are `fitted` along (Huber 1981, 7.6; Schrader and
        Hettmansperger 1980):

            covariance   K^2 (sum psi^2 / (n - p)) / mean(psi')^2,       K = 1 + p/n var(psi') / mean(psi')^2
            cost         covariance * mean(psi')
        """
        if self.loss == "linear":
            return RobustFactors(jnp.asarray(1.0), jnp.asarray(1.0))
        influence = jax.grad(lambda r: 0.5 * LOSSES[self.loss](r) ** 2)
        psi, bend = jax.vmap(influence)(r), jax.vmap(jax.grad(influence))(r)
        points = jnp.sum(weight)
        freedom = jnp.where(points > fitted, points - fitted, 1.0)
        mean = jnp.sum(weight * bend) / points
        varies = jnp.sum(weight * (bend - mean) ** 2) / points
        K = 1 + fitted / points * varies / mean**2
        factor = (K / mean) ** 2 * jnp.sum(weight * psi**2) / freedom
        return RobustFactors(factor, factor * mean)


def _require_measurable(models: Mapping[str, Scene | Tension], curves: Sequence[Curve]) -> None:
    """An InputError for a curve of what its model does not have, and for two of one name."""
    names = [curve.name for curve in curves]
    for curve in curves:
        if names.count(curve.name) > 1:
            raise InputError(f"Two curves are called {curve.name!r}; give each a name of its own.")
        if curve.model not in models:
            known = ", ".join(map(repr, models))
            raise InputError(f"Curve {curve.name!r} is of the model {curve.model!r}; it must be one of {known}.")
        model = models[curve.model]
        kinds = {"stress": "pressure"} if isinstance(model, Tension) else model.prepared().OBSERVABLES
        if curve.quantity not in kinds:
            raise InputError(
                f"Curve {curve.name!r} measures {curve.quantity!r}; of its model it must be one of {', '.join(kinds)}."
            )
        allowed = (0, 1) if kinds[curve.quantity] == "position" else (None,)
        if curve.component not in allowed:
            raise InputError(
                f"The component of curve {curve.name!r} is {curve.component}; of {curve.quantity!r} it must be "
                f"{' or '.join(map(str, allowed))}."
            )


def _require_once(curves: Sequence[Curve]) -> None:
    """An InputError where two curves or specimens that are fitted hold the same points: a measurement counts once, and
    twice it would make every interval too narrow."""
    seen: dict[Any, str] = {}
    for curve in curves:
        for label in dict.fromkeys(curve.labels) if curve.fit else ():
            own = curve.labels == label
            points = np.column_stack([curve.x[own], curve.y[own]])
            # Few points, or a quantity that has not begun, may be the same by chance.
            if len(points) < ALIKE or np.ptp(points[:, 1]) == 0:
                continue
            what = f"curve {curve.name!r}" + (f", specimen {str(label)!r}" if label else "")
            key = (curve.model, curve.quantity, curve.component, points[np.lexsort(points.T)].tobytes())
            if key in seen:
                raise InputError(
                    f"The points of {what} are those of {seen[key]}; a measurement counts once: leave one of them out, "
                    "or say fit = false."
                )
            seen[key] = what


ALIKE = 3
"""So many points are not the same by chance."""

START_NOISE = 1e-2
"""The estimate of a noise begins at this part of the size of its curve."""

LEAST_NOISE = 1e-6
"""No estimated noise is smaller than this part of the size of its curve; numbers that were computed have none."""

NORMAL_MAD = 1.4826
"""Standard deviation over median absolute deviation, normal noise."""


def _directions(jacobian: Array) -> tuple[Array, Array]:
    """(orthonormal columns u, b) with J = u b^+; those of b are huge, not infinite, where nothing determines them, and
    so are all where J is zero."""
    u, s, vt = jnp.linalg.svd(jacobian, full_matrices=False)
    least, largest = jnp.finfo(s.dtype).eps, jnp.max(s)
    return u, vt.T / jnp.maximum(s, least * jnp.where(largest > 0, largest, 1.0))[None, :]


def inverse_square(jacobian: Array) -> Array:
    """(J^T J)^-1; huge, not infinite, in a direction that nothing determines."""
    _, back = _directions(jacobian)
    return back @ back.T


def covariance_of(jacobian: Array, of_curve: np.ndarray, unsure: Array) -> Array:
    """The covariance of a weighted fit; huge, not infinite, in a direction that nothing determines.

    Where curves share a parameter, weights by noises that are estimated miss the best ones, and the fit scatters by
    more than C = (J^T J)^-1 says, which takes the weights for the best. With A_k = J_k^T J_k of curve k and its noise's
    degrees of freedom f_k (Kenward and Roger 1997, whose correction has these terms for noises of separate curves):

        C + C sum_k (4 / f_k) (A_k - A_k C A_k) C

    Args:
        jacobian: J, of the weighted residuals, shape (N, n).
        of_curve: the curve of every point, shape (N,).
        unsure: 1 / f_k where the noise of a curve is estimated, 0 where it is stated, shape (curves,).
    """
    u, back = _directions(jacobian)
    own = jnp.where((jnp.arange(len(unsure))[:, None] == of_curve[None, :])[:, :, None], u[None, :, :], 0.0)
    shares = jnp.einsum("kni,knj->kij", own, own)
    return back @ (jnp.eye(u.shape[1]) + jnp.einsum("k,kij->ij", 4 * unsure, shares - shares @ shares)) @ back.T


DETERMINED = 1e-9
"""Singular values below this part of the largest are rounding of the derivatives: nothing is fitted along them."""


def leverage(jacobian: Array) -> Array:
    """diag J (J^T J)^+ J^T, whose sum is the number of directions that the points determine."""
    u, s, _ = jnp.linalg.svd(jacobian, full_matrices=False)
    return jnp.sum(jnp.where(s > DETERMINED * jnp.max(s), u, 0.0) ** 2, axis=1)


NO_STATE_MISFIT = 2.0
"""`missing` of a point whose scene cannot exist, or was not solved: more than any beyond a limit usually has."""


def answers_of(model: Scene | Tension, at: Array) -> tuple[dict[str, Array], Array, Array, Array]:
    """(observables, ok, missing, share of the limit) of one model at its pressures or strains."""
    if isinstance(model, Tension):
        room = jax.vmap(model.bearable)(at)
        ok = room > 0
        safe = jnp.where(ok, at, 0.0)
        missing = jnp.where(ok, 0.0, 1 - room)
        return {"stress": jax.vmap(model.stress)(safe)}, ok, missing, jnp.zeros_like(at)
    solutions = jax.vmap(lambda pressure: sg.solve(model, pressure))(at)
    limit = sg.limit_pressure(model)
    bounded = jnp.isfinite(limit) & (limit > 0)
    safe = jnp.where(bounded, limit, 1.0)
    ok = (solutions.status == Status.OK) | (solutions.status == Status.NO_CONTACT)
    beyond = bounded & (solutions.status == Status.BEYOND_LIMIT)
    pressure = jnp.where(at > 0, at, 1.0)
    missing = jnp.where(beyond, 1 / NEAR_LIMIT - safe / pressure, jnp.where(ok, 0.0, NO_STATE_MISFIT))
    return solutions.observables, ok, missing, jnp.where(bounded, at / safe, 0.0)
