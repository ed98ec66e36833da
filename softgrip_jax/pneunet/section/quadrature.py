"""The section law of any material, by quadrature over the thickness."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool

from ...materials.base import Material
from ...numerics.choice import smallest
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import newton_bracketed
from ...numerics.small_linear import solve_small
from ...results import stop_gradient_where_failed
from .base import Scalar, SectionLaw
from .exact import LARGEST_STRETCH, ExactNeoHookean

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
        law, z, n = stop_gradient_where_failed(held, (self, z, n))
        z, found = jnp.where(held, z, 0.0), jnp.where(held, found, 1.0)
        stretch = implicit(lambda x, args: args[0].loads(args[1], x)[1] - args[2], found, (law, z, n))
        return jnp.where(held, law.loads(z, stretch)[0], jnp.nan), jnp.where(held, stretch, jnp.nan)

    def holds(self, z: Scalar, stretch: Scalar) -> Bool[Array, ""]:
        """True where both outer fibres exist and the material can follow them (beyond a lock, stresses lie)."""
        exists, left = self._outer_fibres(z, stretch)
        return exists & jnp.all(left > 0)

    def used_up(self, m, z, stretch):
        """Where an outer fibre locks: the points, all inside, carry a finite moment there. Nothing is known of a
        material that does not say how near it is to its lock."""
        if not self.locks():
            return super().used_up(m, z, stretch)
        return -smallest(self._outer_fibres(z, stretch)[1])

    def locks(self):
        return type(self.material).stretchable is not Material.stretchable

    def _outer_fibres(self, z: Scalar, stretch: Scalar) -> tuple[Bool[Array, ""], Array]:
        """Whether both exist, and what is left of each before it locks."""
        inner, outer = stretch**2 - jnp.abs(z), stretch**2 + jnp.abs(z)
        exists = (stretch > 0) & (inner > 0)
        fibres = jnp.sqrt(jnp.where(exists, jnp.stack([inner, outer]), 1.0))
        return exists, jax.vmap(lambda s: self.material.stretchable(s, 1 / s))(fibres)

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
