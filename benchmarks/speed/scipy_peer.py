"""Shooting with SciPy: solve_ivp inside scipy.optimize.root, one finger at a time; the exact law in closed form."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from .thesis_peer import end_moment


def exact_rates(m: float, z: float, lam: float, dm: float, dn: float) -> tuple[float, float]:
    """(dz, dlambda) of the exact law: the inverse of the Hessian of its energy (docs/theory/section.md)."""
    l2 = lam * lam
    l4 = l2 * l2
    w = z * z / l4
    if w < 0.04:
        k = sum((j + 1) / (2 * j + 3) * w**j for j in range(10))
    else:
        k = m * l2 * z / w
    inverse = 1 / (l4 - z * z)
    m_z = ((l4 * inverse) ** 2 - 2 * k) / (l4 * l2)
    n_z = -2 * lam * z * inverse**2
    n_l = 1 + (3 * l4 + z * z) * inverse**2
    scale = 1 / (m_z * n_l - n_z * n_z)
    return (n_l * dm - n_z * dn) * scale, (m_z * dn - n_z * dm) * scale


def exact_state(m: float, n: float) -> tuple[float, float]:
    """(z, lambda) under m and n, by root on the closed form."""

    def loads(y):
        z, lam = y
        u = z / lam**2
        k = sum((j + 1) / (2 * j + 3) * u ** (2 * j) for j in range(12))
        if abs(u) > 0.3:
            k = (1 / (1 - u * u) - np.arctanh(u) / u) / (2 * u * u)
        return [u * k / lam**4 - m, lam - lam / (lam**4 - z * z) - n]

    return tuple(root(loads, [3 * m, 1 + 0.25 * n], tol=1e-15).x)


def tip_force(f: dict[str, float], p: float, rtol: float) -> float:
    """The tip force of a finger held at y = 0 without other loads; N."""
    force = f["mu"] * f["B"] * f["H"]
    slender, moment = f["H"] / f["L"], end_moment(f, p, 1e-14) / (force * f["H"])
    unit = slender / 3

    def slopes(s, y, q):
        theta, m_ext, _, z, lam = y
        sine, cosine = np.sin(theta), np.cos(theta)
        dm = -lam * q * cosine / slender
        dz, dlam = exact_rates(m_ext - moment, z, lam, dm, q * cosine * z / slender)
        return [z / slender, dm, lam * sine, dz, dlam]

    def miss(y):
        m_ext, q = y * [unit, unit * slender]
        z, lam = exact_state(m_ext - moment, 0.0)
        start = [0.0, m_ext, 0.0, z, lam]
        end = solve_ivp(slopes, (0, 1), start, args=(q,), method="DOP853", rtol=rtol, atol=rtol).y[:, -1]
        return [end[1] / unit, end[2]]

    pushed = 3 * moment / slender
    found = root(miss, [1.5 * pushed, 1.5 * pushed], tol=rtol)
    return found.x[1] * unit * slender * force if found.success else np.nan
