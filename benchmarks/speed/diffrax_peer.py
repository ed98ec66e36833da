"""Shooting with diffrax's adaptive steps in optimistix's Newton method, under vmap: what a JAX user would write."""

from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
import optimistix as optx

from softgrip_jax.pneunet.chamber import end_moment
from softgrip_jax.pneunet.section import section_law


def residual(unknowns, arguments, section: str, rtol: float):
    """(M(L) over EI/L, y(L)/L) from (M(0), tip force) in units of EI/L and EI/L^2, for a tip held at y = 0."""
    finger, pressure = arguments
    law = section_law(section, finger.material)
    slender = finger.H / finger.L
    unit = slender / 3
    push = end_moment(finger, pressure, jnp.zeros_like(pressure)) / finger.moment_scale()
    q = unknowns[1] * unit * slender

    def slopes(s, y, _):
        theta, m_ext, _, z, stretch = y
        sine, cosine = jnp.sin(theta), jnp.cos(theta)
        turn, dm = z / slender, -stretch * q * cosine / slender
        # The section's state is carried along by the law's rates: no root within the integration.
        dz, dstretch = law.rates(m_ext - push, z, stretch, dm, q * cosine * turn)
        return jnp.stack([turn, dm, stretch * sine, dz, dstretch])

    m_ext = unknowns[0] * unit
    z, stretch = law(m_ext - push, jnp.zeros_like(push))
    zero = jnp.zeros_like(z)
    end = diffrax.diffeqsolve(
        diffrax.ODETerm(slopes),
        diffrax.Dopri8(),
        0.0,
        1.0,
        None,
        jnp.stack([zero, m_ext, zero, z, stretch]),
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol),
        adjoint=diffrax.ForwardMode(),
        saveat=diffrax.SaveAt(t1=True),
        max_steps=256,
    ).ys[0]
    return jnp.stack([end[1] / unit, end[2]])


def unit_force(finger):
    """EI / L^2, N."""
    return finger.moment_scale() * finger.H / (3 * finger.L**2)


def tip_force(finger, pressure, section: str = "exact", rtol: float = 1e-8):
    """The tip force, N; Newton's method from the linear finger."""
    push = 3 * end_moment(finger, pressure, jnp.zeros_like(pressure)) / finger.moment_scale() * finger.L / finger.H
    start = jnp.stack([1.5 * push, 1.5 * push])
    found = optx.root_find(
        lambda y, args: residual(y, args, section, rtol),
        optx.Newton(rtol=rtol, atol=rtol),
        start,
        (finger, pressure),
        adjoint=optx.ImplicitAdjoint(),
        max_steps=32,
        throw=False,
    )
    return found.value[1] * unit_force(finger)


def value_and_slopes(finger, pressure, section: str, rtol: float):
    """The tip force and its derivatives in forward mode, by every number of the finger and the pressure."""
    leaves, kind = jax.tree.flatten((finger, pressure))

    def force(leaves):
        return tip_force(*jax.tree.unflatten(kind, leaves), section, rtol)

    return force(leaves), jax.jacfwd(force)(leaves)
