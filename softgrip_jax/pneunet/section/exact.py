"""The exact section law of the neo-Hookean material, in closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from ...numerics.scalar_roots import bracketed_root
from .base import Scalar, SectionLaw

# --- exact, neo-Hookean -------------------------------------------------------------------------------------------

SERIES_BELOW = 0.16
"""Below this w = u^2 the series of `bending_factor` is used; above, its closed form loses less than 1e-14."""
SERIES_TERMS = 20
"""So many terms leave 0.16^20 = 1e-16."""


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
"""So many Newton steps are enough from a start that is good to 1e-2 for |n| < 0.3."""
FALLING_STEPS = 100
"""Far above the root each step takes off a fifth."""
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

    # An empty bracket costs no iteration: none at all, also under vmap, where every member of the batch is done.
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
"""So many steps lead from the bounds below to the last bit for any n: the worst start is 1.3 times the root."""


def axial_stretch(n: Scalar) -> Scalar:
    """lambda under the axial force n alone: the positive root of lambda^3 (lambda - n) = 1."""
    size = jnp.maximum(jnp.abs(n), 1e-9)
    # Upper bounds of the root for either sign; the quartic is convex above it, so Newton falls onto it.
    pulled, pressed = jnp.minimum(1 + size, size + 1 / size**3), jnp.minimum(1.0, 1 / jnp.cbrt(size))
    stretch = jnp.where(n > 0, pulled, pressed)
    for _ in range(QUARTIC_STEPS):
        stretch -= (stretch**3 * (stretch - n) - 1) / (stretch**2 * (4 * stretch - 3 * n))
    return stretch
