"""Section laws of the cover: bending moment and axial force against curvature and stretch.

All in pure numbers: z = H theta' (theta' per reference length), lambda the stretch of the middle line,
m = M / (mu B H^2), n = N / (mu B H), w = section energy / (mu B H), mu the shear modulus at rest. A law is called as
law(m, n) -> (z, lambda); `law.loads(z, lambda)` is the way back. Laws are odd in m, even in z, and take ONE section.

Where a law has no state for a load, both values are NaN: never a state of another branch.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..errors import InputError
from ..materials import Material
from ..numerics.roots import bracketed_root, implicit, newton_bracketed, solve_small
from ..results import gate
from .finger import PneuNet

Scalar = Float[Array, ""]


class SectionLaw(eqx.Module):
    """m, n <-> z, lambda of one cross-section."""

    largest_moment: ClassVar[float] = np.inf
    """The supremum of |m| without an axial force, where it is known; inf where it is not, or there is none."""

    @abc.abstractmethod
    def __call__(self, m: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """(z, lambda) under the moment m and the axial force n."""

    @abc.abstractmethod
    def loads(self, z: Scalar, stretch: Scalar) -> tuple[Scalar, Scalar]:
        """(m, n) that hold the curvature z and the stretch."""

    @abc.abstractmethod
    def stretches(self, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Of the stretch at a curvature under an axial force: a bound from below, one from above, a good guess."""

    def axis(self) -> int | None:
        """0 where every part of a beam has a law of its own, stacked in one; None where all have the same."""
        return None

    def bent(self, z: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """(m, lambda) at the curvature z under the axial force n: one state for any pair, unlike under (m, n)."""
        law, *given = lax.stop_gradient((self, z, n))
        found = newton_bracketed(lambda x: law.loads(given[0], x)[1] - given[1], *law.stretches(*given)).x
        stretch = implicit(lambda x, args: args[0].loads(args[1], x)[1] - args[2], found, (self, z, n))
        return self.loads(z, stretch)[0], stretch

    def rates(self, m: Scalar, z: Scalar, stretch: Scalar, dm: Scalar, dn: Scalar) -> tuple[Scalar, Scalar]:
        """(dz, dlambda) of the state (z, lambda) under small changes dm and dn of its loads; m is its moment.

        Along a beam this is a state's own differential equation: nothing is solved for at any place.
        """
        one, none = jnp.ones_like(z), jnp.zeros_like(z)
        m_z, n_z = jax.jvp(self.loads, (z, stretch), (one, none))[1]
        m_l, n_l = jax.jvp(self.loads, (z, stretch), (none, one))[1]
        scale = 1 / (m_z * n_l - m_l * n_z)
        return (n_l * dm - m_l * dn) * scale, (m_z * dn - n_z * dm) * scale


class Inextensible(SectionLaw):
    """lambda = 1, M = mu B H^3 theta'/3 (Euler-Bernoulli, plane strain): m = z/3. It knows no axial force."""

    def __call__(self, m, n):
        return 3 * m + 0 * n, jnp.ones_like(m + n)

    def loads(self, z, stretch):
        """(z/3, NaN): an inextensible line carries any axial force."""
        return z / 3, jnp.full_like(z, jnp.nan)

    def stretches(self, z, n):
        one = jnp.ones_like(z)
        return one, one, one

    def bent(self, z, n):
        return z / 3, 1 + 0 * z

    def rates(self, m, z, stretch, dm, dn):
        return 3 * dm, 0 * dn

    def energy(self, z: Scalar, stretch: Scalar) -> Scalar:
        """w = z^2 / 6."""
        return z * z / 6


# --- exact, neo-Hookean -------------------------------------------------------------------------------------------

SERIES_BELOW = 0.16
"""Below this w = u^2 the series of `bending_factor` is used; above, its closed form loses less than 1e-14."""
SERIES_TERMS = 20
"""0.16^20 = 1e-16."""


def bending_factor(w: Scalar, rest: Scalar) -> Scalar:
    """k(w) = (1/(1-w) - atanh(u)/u) / (2 w), w = u^2: 1/3 + 2w/5 + 3w^2/7 + ...; rest = 1 - w, given apart."""
    small = w < SERIES_BELOW
    series = _series(jnp.where(small, w, 0.0), SERIES_TERMS)
    w_safe, rest_safe = jnp.where(small, 0.5, w), jnp.where(small, 0.5, rest)
    u = jnp.sqrt(w_safe)
    atanh_over_u = 0.5 * jnp.log((1 + u) ** 2 / rest_safe) / u
    return jnp.where(small, series, (1 / rest_safe - atanh_over_u) / (2 * w_safe))


def _series(w: Scalar, terms: int) -> Scalar:
    """k(w) = 1/3 + 2w/5 + 3w^2/7 + ..."""
    total = jnp.zeros_like(w)
    for j in reversed(range(terms)):
        total = total * w + (j + 1) / (2 * j + 3)
    return total


NEAR_STRAIGHT, NEAR_STRAIGHT_TERMS = 0.04, 10
"""Below this w the rates use the series too (good to 1e-14); above, an error of m counts at most 1/u = 5 times in k."""


class ExactNeoHookean(SectionLaw):
    """The exact law of a neo-Hookean cover in plane strain (Rivlin 1949), with u = z / lambda^2:

    w = (lambda^2 + atanh(u)/z - 2) / 2;   n = lambda - lambda / (lambda^4 - z^2);   m = u k(u^2) / lambda^4

    k: `bending_factor`. Mooney-Rivlin covers follow the same law: in plane strain I_1 = I_2. The inner fibre vanishes
    as u -> 1, where m -> 1/2 for every n: there is a state for every |m| < 1/2, and NaN is returned beyond.
    """

    largest_moment = 0.5

    def __call__(self, m, n):
        return _exact_state(m, n)

    def loads(self, z, stretch):
        square = stretch**4 - z * z
        w = z * z / stretch**4
        return z * bending_factor(w, square / stretch**4) / stretch**6, stretch - stretch / square

    def stretches(self, z, n):
        # n rises from minus infinity where the inner fibre vanishes (or at lambda = n); without n, lambda^4 = 1 + z^2.
        low = jnp.maximum(jnp.sqrt(jnp.abs(z)), n)
        square = jnp.sqrt(1 + z * z)
        guess = jnp.sqrt(square) + n * (0.25 + 0.09375 * n / jnp.sqrt(square)) / square
        return low, jnp.sqrt(jnp.abs(z)) + jnp.maximum(n, 0.0) + 1.5, guess

    def bent(self, z, n):
        return _exact_bent(z, n)

    def rates(self, m, z, stretch, dm, dn):
        m_z, n_z, n_l = self.stiffness(m, z, stretch)
        scale = 1 / (m_z * n_l - n_z * n_z)
        return (n_l * dm - n_z * dn) * scale, (m_z * dn - n_z * dm) * scale

    def stiffness(self, m: Scalar, z: Scalar, stretch: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The Hessian of w, (m_z, n_z = m_lambda, n_lambda), with m_z = ((1 - u^2)^-2 - 2 k) / lambda^6.

        The moment is known, so k = m lambda^2 z / w needs no logarithm; towards w = 0 its series takes over, smoothly.
        """
        l2 = stretch * stretch
        l4 = l2 * l2
        z2 = z * z
        w = z2 / l4
        series = _series(w, NEAR_STRAIGHT_TERMS)
        weight = NEAR_STRAIGHT * jnp.maximum(1 - w / NEAR_STRAIGHT, 0.0) ** 3
        k = (m * l2 * z + weight * series) / (w + weight)
        inverse = 1 / jnp.where(z2 < l4, l4 - z2, jnp.nan)
        square = inverse * inverse
        return (l4 * l4 * square - 2 * k) / (l4 * l2), -2 * stretch * z * square, 1 + (3 * l4 + z2) * square

    def energy(self, z: Scalar, stretch: Scalar) -> Scalar:
        """w, zero at rest: (lambda^2 + atanh(u)/(u lambda^2) - 2) / 2."""
        u2 = (z / stretch**2) ** 2
        rest = 1 - u2
        # atanh(u)/u = 1/(1-w) - 2 w k(w): no division by zero.
        return 0.5 * (stretch**2 + (1 / rest - 2 * u2 * bending_factor(u2, rest)) / stretch**2 - 2)


@jax.custom_jvp
def _exact_state(m: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
    """(z, lambda) by one scalar root, see `_exact_stretch`; then z = m lambda^6 / k, regular at m = 0."""
    solvable = jnp.abs(m) < ExactNeoHookean.largest_moment
    m, n = jnp.where(solvable, m, 0.0), jnp.where(solvable, n, 0.0)
    stretch = _exact_stretch(m, n)
    rest = 1 / (stretch**3 * (stretch - n))
    z = m * stretch**6 / bending_factor(1 - rest, rest)
    return jnp.where(solvable, z, jnp.nan), jnp.where(solvable, stretch, jnp.nan)


@_exact_state.defjvp
def _exact_state_jvp(primals, tangents):
    """dz, dlambda by the inverse of the Hessian (differentiable again)."""
    z, stretch = _exact_state(*primals)
    dm, dn = tangents
    m_z, n_z, n_l = ExactNeoHookean().stiffness(primals[0], z, stretch)
    scale = 1 / (m_z * n_l - n_z * n_z)
    return (z, stretch), ((n_l * dm - n_z * dn) * scale, (m_z * dn - n_z * dm) * scale)


@jax.custom_jvp
def _exact_bent(z: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
    """(m, lambda): Newton's method for (lambda - n) (lambda^4 - z^2) = lambda; where a few steps did not do, again from
    above: the polynomial is convex there, and Newton falls onto its largest root."""
    law = ExactNeoHookean()
    low, high, stretch = law.stretches(z, n)

    def closer(state):
        stretch, _, count = state
        cube = stretch * stretch * stretch
        square = stretch * cube - z * z
        move = ((stretch - n) * square - stretch) / (square + 4 * cube * (stretch - n) - 1)
        return stretch - move, move, count + 1

    state = (stretch, jnp.zeros_like(stretch), jnp.asarray(0))
    for _ in range(BENT_STEPS):
        state = closer(state)
    stretch, move, _ = state
    done = (jnp.abs(move) <= CONVERGED * stretch) & (stretch > low)
    again = (jnp.where(done, stretch, high), jnp.where(done, 0.0, high), jnp.asarray(0))
    stretch, *_ = lax.while_loop(lambda s: (jnp.abs(s[1]) > CONVERGED * s[0]) & (s[2] < FALLING_STEPS), closer, again)
    return law.loads(z, stretch)[0], stretch


@_exact_bent.defjvp
def _exact_bent_jvp(primals, tangents):
    """dlambda from dn = n_z dz + n_lambda dlambda, and dm = m_z dz + n_z dlambda (differentiable again)."""
    m, stretch = _exact_bent(*primals)
    dz, dn = tangents
    m_z, n_z, n_l = ExactNeoHookean().stiffness(m, primals[0], stretch)
    dstretch = (dn - n_z * dz) / n_l
    return (m, stretch), (m_z * dz + n_z * dstretch, dstretch)


BENT_STEPS = 4
"""From a start that is good to 1e-2 for |n| < 0.3."""
FALLING_STEPS = 100
"""Far above the root each takes a fifth off."""
NEWTON_STEPS = 3
"""The start is good to 2e-3 for |m| < 0.3, |n| < 0.1, and Newton squares that: 4e-6, 2e-11, last bit."""
CONVERGED = 1e-7
"""A last Newton step below this part of lambda leaves its square, which is rounding."""
LARGEST_STRETCH = 1e4
"""The end of the careful search: there m is within 1e-15 of its supremum."""


def _exact_stretch(m, n):
    """lambda under (m, n): a start, a fixed number of Newton steps, and a bracketed search where they did not suffice.

    The axial force gives 1/(1 - u^2) = s = lambda^3 (lambda - n) without a solve. With it the moment reads R(s) = eta,
    R = u k(u^2) / s (Rivlin's pure bending, from 0 to 1/2), eta = m lambda / (lambda - n). Newton works on
    R^2 / (1 - 4 R^2) = eta^2 / (1 - 4 eta^2), nearly linear in s: squares are regular at m = 0.
    """

    def closer(_, state):
        stretch, _ = state
        r2, r2_slope, eta2, eta2_slope = _squares(stretch, m, n)
        left_r, left_eta = 1 - 4 * r2, 1 - 4 * eta2
        move = -(r2 - eta2) * left_r * left_eta / (r2_slope * left_eta**2 - eta2_slope * left_r**2)
        return stretch + move, move

    start = _start(m, n)
    stretch, move = lax.fori_loop(0, NEWTON_STEPS, closer, (start, jnp.zeros_like(start)))
    # Written so that NaN counts as failure.
    done = (jnp.abs(move) <= CONVERGED * stretch) & (stretch > n)

    def mismatch(stretch):
        r2, _, eta2, _ = _squares(stretch, m, n)
        return jnp.where(stretch**3 * (stretch - n) > 1, r2 - eta2, -1.0)

    # An empty bracket costs no iteration: none at all, also under vmap, where every lane is done.
    low = jnp.maximum(n, 0.0)
    careful = bracketed_root(mismatch, low, jnp.where(done, low, low + LARGEST_STRETCH)).x
    return jnp.where(done, stretch, careful)


def _squares(stretch, m, n):
    """R^2, d(R^2)/dlambda, eta^2, d(eta^2)/dlambda; dR^2/ds = k (s - 2k) / s^3."""
    inverse = 1 / (stretch - n)
    s = stretch**3 * (stretch - n)
    rest = 1 / s
    w = 1 - rest
    k = bending_factor(w, rest)
    eta2 = (m * stretch * inverse) ** 2
    return (
        w * (k * rest) ** 2,
        k * rest**3 * (s - 2 * k) * stretch**2 * (4 * stretch - 3 * n),
        eta2,
        -2 * eta2 * n / stretch * inverse,
    )


START_FIT = (0.99991304, -0.14113449, -0.0674586, -0.49992885)
"""Least squares fit of Rivlin's pure bending for z up to 20, good to 0.11 %: with x = 4 m^2,
z^2 = 9 m^2 (c_0 + c_1 x + c_2 x^2 + c_3 ln(1 - x)) / (1 - x)."""


def _start(m, n):
    """lambda to about 1e-3 at moderate loads: pure bending under eta, and eta from a cruder guess of lambda."""
    m2 = m * m
    guess = jnp.sqrt(jnp.sqrt(1 + 9 * m2 / (1 - 4 * m2))) + 0.25 * n
    x = jnp.minimum(4 * (m * guess / (guess - n)) ** 2, 0.998)
    c0, c1, c2, c3 = START_FIT
    root = jnp.sqrt(jnp.sqrt(1 + 2.25 * x * (c0 + x * (c1 + c2 * x) + c3 * jnp.log1p(-x)) / (1 - x)))
    # The quartic lambda^3 (lambda - n) = root^4 to second order in n, and one Newton step.
    stretch = jnp.maximum(root + n * (0.25 + 0.09375 * n / root), n)
    return stretch - (stretch**3 * (stretch - n) - root**4) / (stretch**2 * (4 * stretch - 3 * n))


QUARTIC_STEPS = 6
"""From the bounds below to the last bit for any n: the worst start is 1.3 times the root."""


def axial_stretch(n: Scalar) -> Scalar:
    """lambda under the axial force n alone: the positive root of lambda^3 (lambda - n) = 1."""
    size = jnp.maximum(jnp.abs(n), 1e-9)
    # Upper bounds of the root for either sign; the quartic is convex above it, so Newton falls onto it.
    pulled, pressed = jnp.minimum(1 + size, size + 1 / size**3), jnp.minimum(1.0, 1 / jnp.cbrt(size))
    stretch = jnp.where(n > 0, pulled, pressed)
    for _ in range(QUARTIC_STEPS):
        stretch -= (stretch**3 * (stretch - n) - 1) / (stretch**2 * (4 * stretch - 3 * n))
    return stretch


class Thesis(SectionLaw):
    """The law of the thesis as printed, (2.12), (2.13) with kappa = theta'/lambda (2.9); He et al. 2018.

    n = lambda - lambda^-3 - (kappa H)^2 lambda^-7,   m = kappa H / (3 lambda^6),   kappa H = z / lambda

    With m given: f(lambda) = lambda - lambda^-3 - 9 m^2 lambda^5 = n. f is concave: its rising part is the branch from
    zero load; where n is above its maximum (for n = 0: |m| > 1/6) there is no state, and NaN is returned. The law is
    not the derivative of an energy.
    """

    largest_moment = 1 / 6

    def __call__(self, m, n):
        m, n = jnp.broadcast_arrays(m, n)
        found = _rising_root(m, n)
        stretch = implicit(lambda x, args: _thesis_tension(x, args[0]) - args[1], found, (m, n))
        return 3 * m * stretch**7, stretch

    def stretches(self, z, n):
        # Without n: lambda^10 - lambda^6 = z^2.
        guess = (1 + 2.5 * z * z) ** 0.1
        return jnp.maximum(n, 0.0), jnp.maximum(n, 0.0) + 1.5 + guess, guess + 0.25 * n

    def loads(self, z, stretch):
        bent = z / stretch
        return bent / (3 * stretch**6), stretch - stretch**-3 - bent**2 / stretch**7


THESIS_STEPS = 60


def _thesis_tension(stretch, m):
    return stretch - stretch**-3 - 9 * m * m * stretch**5


def _rising_root(m, n):
    """Newton from the left on the rising part of a concave function climbs to the root and never passes it."""
    m, n = lax.stop_gradient((m, n))
    m2 = m * m
    # lambda^4 where f has its maximum: 45 m^2 q^2 - q - 3 = 0
    top = jnp.sqrt(jnp.sqrt((1 + jnp.sqrt(1 + 540 * m2)) / (90 * jnp.maximum(m2, 1e-16))))
    exists = n < _thesis_tension(top, m)

    def step(state):
        x, count, _ = state
        slope = 1 + 3 * x**-4 - 45 * m2 * x**4
        new = x + (n - _thesis_tension(x, m)) / slope
        # Rounding ends the climb.
        return jnp.maximum(x, new), count + 1, new > x

    start = (jnp.minimum(axial_stretch(n), top), jnp.asarray(0), exists)
    x, _, _ = lax.while_loop(lambda s: s[2] & (s[1] < THESIS_STEPS), step, start)
    return jnp.where(exists, x, jnp.nan)


# --- exact, any strain energy -------------------------------------------------------------------------------------

THICKNESS_POINTS = 16
"""Gauss points through the thickness: with a neo-Hookean energy the error is about (1/u + sqrt(1/u^2 - 1))^-32 (the
pole of the integrand), which is 1e-12 at u = 0.7; the inner fibre is then compressed to 0.55 of the middle line."""
_X, _WEIGHT = np.polynomial.legendre.leggauss(THICKNESS_POINTS)

QUADRATURE_STEPS = 40


class ExactQuadrature(SectionLaw):
    """The exact law of any strain energy: a fibre at height Z has the stretch sqrt(lambda^2 + 2 theta' Z), exactly.

    w(lambda, z) = integral over -1/2..1/2 of W(s, 1/s, 1)/mu,  s^2 = lambda^2 + 2 z zeta;  n = dw/dlambda, m = dw/dz
    """

    material: Material

    def energy(self, z: Scalar, stretch: Scalar) -> Scalar:
        """w, zero at rest."""

        def fibre(x):
            s = jnp.sqrt(stretch**2 + z * x)
            return self.material.energy(s, 1 / s, jnp.ones_like(s))

        return 0.5 * jnp.dot(jnp.asarray(_WEIGHT), jax.vmap(fibre)(jnp.asarray(_X))) / self.material.shear_modulus()

    def loads(self, z, stretch):
        return jax.grad(self.energy, argnums=(0, 1))(z, stretch)

    def stretches(self, z, n):
        low = jnp.sqrt(jnp.abs(z))
        return low, low + jnp.maximum(n, 0.0) + LARGEST_STRETCH, ExactNeoHookean().stretches(z, n)[2]

    def bent(self, z, n):
        law, *given = lax.stop_gradient((self, z, n))

        def surplus(x):
            """Axial force over what is wanted; too much where a fibre cannot follow."""
            held = law.holds(given[0], x)
            return jnp.where(held, law.loads(given[0], jnp.where(held, x, LARGEST_STRETCH))[1] - given[1], jnp.inf)

        found = newton_bracketed(surplus, *law.stretches(*given)).x
        held = law.holds(given[0], found)
        law, z, n = gate(held, (self, z, n))
        z, found = jnp.where(held, z, 0.0), jnp.where(held, found, 1.0)
        stretch = implicit(lambda x, args: args[0].loads(args[1], x)[1] - args[2], found, (law, z, n))
        return jnp.where(held, law.loads(z, stretch)[0], jnp.nan), jnp.where(held, stretch, jnp.nan)

    def holds(self, z: Scalar, stretch: Scalar) -> Bool[Array, ""]:
        """True where both outer fibres exist and the material can follow them (beyond a lock, stresses lie)."""
        inner, outer = stretch**2 - jnp.abs(z), stretch**2 + jnp.abs(z)
        exists = (stretch > 0) & (inner > 0)
        fibres = jnp.sqrt(jnp.where(exists, jnp.stack([inner, outer]), 1.0))
        return exists & jnp.all(jax.vmap(lambda s: self.material.stretchable(s, 1 / s))(fibres) > 0)

    def __call__(self, m, n):
        m, n = jnp.broadcast_arrays(m, n)
        wanted = jnp.stack([m, n])
        found = _quadrature_state(*lax.stop_gradient((self, wanted)))

        def residual(y, args):
            law, wanted = args
            return jnp.stack(law.loads(y[0], y[1])) - wanted

        state = implicit(residual, found, (self, wanted))
        return state[0], state[1]


def _quadrature_state(law, wanted):
    """Damped Newton from the neo-Hookean state; a step that does not shrink the residual is halved."""

    def residual(y):
        return jnp.stack(law.loads(y[0], y[1])) - wanted

    def step(state):
        y, error, fraction, move, count = state
        trial = y + fraction * move
        r = residual(trial)
        norm = jnp.linalg.norm(r)
        better = (norm < error) & law.holds(trial[0], trial[1])
        fresh = -solve_small(jax.jacfwd(residual)(trial), r)
        return (
            jnp.where(better, trial, y),
            jnp.where(better, norm, error),
            jnp.where(better, 1.0, 0.5 * fraction),
            jnp.where(better, fresh, move),
            count + 1,
        )

    def busy(state):
        _, error, fraction, _, count = state
        return (error > 0) & (fraction > 1e-3) & (count < QUADRATURE_STEPS)

    z, stretch = ExactNeoHookean()(wanted[0], wanted[1])
    start = jnp.where(law.holds(z, stretch), jnp.stack([z, stretch]), jnp.array([0.0, 1.0]))
    y, error, *_ = lax.while_loop(
        busy, step, (start, jnp.inf * jnp.ones_like(z), jnp.ones_like(z), jnp.zeros_like(start), jnp.asarray(0))
    )
    return jnp.where(error <= 1e-12, y, jnp.nan)


# --- by name ------------------------------------------------------------------------------------------------------

LAWS = ("exact", "thesis", "inextensible")


def section_law(name: str, material: Material) -> SectionLaw:
    """The section law of a cover by name: "exact" (closed form where there is one), "thesis", "inextensible"."""
    if name == "thesis":
        return Thesis()
    if name == "inextensible":
        return Inextensible()
    if name != "exact":
        raise InputError(f"section is {name!r}; it must be one of {', '.join(map(repr, LAWS))}.")
    return ExactNeoHookean() if material.closed_forms().neo_hookean_in_plane_strain else ExactQuadrature(material)


def curvature_and_stretch(name: str, finger: PneuNet, moment: Any, tension: Any) -> tuple[Scalar, Scalar]:
    """(theta', 1/m; lambda) of a finger's cover under M (N m, positive turns towards positive theta) and N (N)."""
    law = section_law(name, finger.material)
    z, stretch = law(moment / finger.moment_scale(), tension / finger.force_scale())
    return z / finger.H, stretch


def moment_and_tension(name: str, finger: PneuNet, curvature: Any, stretch: Any) -> tuple[Scalar, Scalar]:
    """(M, N m; N, N) that hold a finger's cover at theta' (1/m) and lambda."""
    m, n = section_law(name, finger.material).loads(curvature * finger.H, stretch)
    return m * finger.moment_scale(), n * finger.force_scale()
