"""The section law as the thesis prints it."""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax

from ...numerics.implicit import implicit
from .base import SectionLaw
from .exact import axial_stretch


class Thesis(SectionLaw):
    """The law of the thesis as printed, (2.12), (2.13) with kappa = theta'/lambda (2.9); He et al. 2018.

    n = lambda - lambda^-3 - (kappa H)^2 lambda^-7,   m = kappa H / (3 lambda^6),   kappa H = z / lambda

    With m given: f(lambda) = lambda - lambda^-3 - 9 m^2 lambda^5 = n. f is concave: its rising part is the branch from
    zero load; where n is above its maximum (for n = 0: |m| > 1/6) there is no state, and NaN is returned. The law is
    not the derivative of an energy.
    """

    NAME = "thesis"
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
