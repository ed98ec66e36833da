"""Shooting with diffrax's adaptive steps in optimistix's Newton method, under vmap: what a JAX user would write."""

from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
import optimistix as optx

from softgrip_jax.pneunet.section.choice import section_law
from softgrip_jax.pneunet.section.exact import ExactNeoHookean
from softgrip_jax.pneunet.wall.pressures import end_moment


def rates(law, m, z, stretch, dm, dn):
    """(dz, dlambda) that follow changes of the loads at a state of the section under the moment m."""
    if isinstance(law, ExactNeoHookean):
        m_z, n_z, n_l = law.stiffness(m, z, stretch)
        m_l = n_z
    else:
        (m_z, m_l), (n_z, n_l) = jax.jacfwd(law.loads, argnums=(0, 1))(z, stretch)
    scale = 1 / (m_z * n_l - m_l * n_z)
    return (n_l * dm - m_l * dn) * scale, (m_z * dn - n_z * dm) * scale


def residual(unknowns, arguments, section: str, rtol: float, equal: tuple[str, int] | None = None):
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
        dz, dstretch = rates(law, m_ext - push, z, stretch, dm, q * cosine * turn)
        return jnp.stack([turn, dm, stretch * sine, dz, dstretch])

    m_ext = unknowns[0] * unit
    z, stretch = law(m_ext - push, jnp.zeros_like(push))
    zero = jnp.zeros_like(z)
    end = diffrax.diffeqsolve(
        diffrax.ODETerm(slopes),
        getattr(diffrax, equal[0] if equal else "Dopri8")(),
        0.0,
        1.0,
        1 / equal[1] if equal else None,
        jnp.stack([zero, m_ext, zero, z, stretch]),
        stepsize_controller=diffrax.ConstantStepSize() if equal else diffrax.PIDController(rtol=rtol, atol=rtol),
        adjoint=diffrax.ForwardMode(),
        saveat=diffrax.SaveAt(t1=True),
        max_steps=256,
    ).ys[0]
    return jnp.stack([end[1] / unit, end[2]])


def unit_force(finger):
    """EI / L^2, N."""
    return finger.moment_scale() * finger.H / (3 * finger.L**2)


def tip_force(finger, pressure, section: str = "exact", rtol: float = 1e-8, equal: tuple[str, int] | None = None):
    """The tip force, N; Newton's method from the linear finger. equal: (method, number) of equal steps instead."""
    push = 3 * end_moment(finger, pressure, jnp.zeros_like(pressure)) / finger.moment_scale() * finger.L / finger.H
    start = jnp.stack([1.5 * push, 1.5 * push])
    found = optx.root_find(
        lambda y, args: residual(y, args, section, rtol, equal),
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
        found = tip_force(*jax.tree.unflatten(kind, leaves), section, rtol)
        return found, found

    slopes, found = jax.jacfwd(force, has_aux=True)(leaves)
    return found, slopes
