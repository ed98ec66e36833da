"""The thesis's algorithms 1 to 7 as a user would write them with SciPy: fsolve, solve_bvp, lambda and theta in turn.

One design at a time, dimensions in mm, N, MPa; a finger is a dict with a, b, h_x, t_m, h_L, H, B, L, mu. The section
law is the thesis's, as printed, and walls are parallel.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_bvp
from scipy.optimize import brentq, fsolve

NODES = 120
"""Section 5.2."""


MAX_NODES = 20_000
"""Of SciPy's solve_bvp, which has 1,000 by itself: fewer than small tolerances need."""


class Tolerances(NamedTuple):
    """Of a run: the change of theta that ends the alternation, of the boundary-value problem, and of fsolve."""

    theta: float = 1e-3
    bvp: float = 1e-3
    roots: float = 1.49e-8
    nodes: int = NODES


def membrane_pressure(mu, t, l1, l2, k1, k2):
    """(2.4) with (2.6)."""
    l3 = 1 / (l1 * l2)
    return mu * t * l3 * (k1 * (l1**2 - l3**2) + k2 * (l2**2 - l3**2))


def algorithm_1(a, b, t, mu, p, xtol=1.49e-8):
    """Free inflation: (3.7) for theta_m, then (3.6)."""

    def balance(angle):
        l1, radius = angle / np.sin(angle), a / np.sin(angle)
        l2 = 1 + a / b * (l1 - 1)
        return membrane_pressure(mu, t, l1, l2, 1 / radius, angle / (radius * angle + b - a)) - p

    angle = _fsolve(balance, 1.0, xtol)[0]
    return a * np.tan(angle / 2)


def algorithm_2(a, b, t, mu, d, p, xtol=1.49e-8):
    """Contact with a plane: (3.7) for theta_m, then (3.12), (3.13)."""

    def stretch(angle):
        return 1 + d / a * (angle / 2 / np.sin(angle / 2) ** 2 - 1 / np.tan(angle / 2))

    def balance(angle):
        l1, radius = stretch(angle), d / (1 - np.cos(angle))
        l2 = 1 + a / b * (l1 - 1)
        return membrane_pressure(mu, t, l1, l2, 1 / radius, angle / (radius * angle + b - a)) - p

    angle = _fsolve(balance, 1.5, xtol)[0]
    l1 = stretch(angle)
    c_a = a - d / np.tan(angle / 2)
    c_b = (1 + a / b * (l1 - 1)) * b - l1 * a + c_a
    return p * (4 * c_a * (c_b - c_a) + np.pi * c_a**2)


def algorithm_3(a, b, t, mu, r, gap, p, xtol=1.49e-8, start=(0.6, 2.0, 18.0, 1.2, 6.0)):
    """Contact with a cylinder: (2.4), (3.15), (3.16), (3.18), (3.27) as five equations; then (3.29).

    Returns (force along z, (theta_c, theta_ma, R, theta_m, e), whether fsolve says that it converged).
    """

    def equations(y):
        th_c, th_a, radius, th_m, e = y
        l1 = th_m / np.sin(th_m)
        l2 = (r * th_c + radius * th_c + e + radius * th_m) / b
        k2 = (th_m + th_c) / (radius * (th_m + th_c) + e)
        th_e = 2 * np.arctan(radius * (np.cos(th_c) - np.cos(th_m)) / a)
        edge = 1 + gap / a * (th_a / 2 / np.sin(th_a / 2) ** 2 - 1 / np.tan(th_a / 2))
        return [
            (membrane_pressure(mu, t, l1, l2, 1 / radius, k2) - p) / p,
            ((r + radius) * np.sin(th_c) + e + a - b) / b,
            (gap + r + radius * np.cos(th_m) - (r + radius) * np.cos(th_c)) / a,
            (radius * np.sin(th_m) - a) / a,
            edge - th_e / np.sin(th_e),
        ]

    y, good = _fsolve(equations, np.array(start), xtol)
    c_a = a - gap / np.tan(y[1] / 2)
    return p * np.pi * c_a * r * np.sin(y[0]), y, good


def algorithm_4(a, b, t, mu, r, gap, wanted, first, step, xtol=1.49e-8):
    """The pressure of a grasp: p rises by `step` from `first` until the normal force reaches `wanted`."""
    p, start = first, (0.3, 1.0, 20.0, 1.0, 10.0)
    while True:
        force_z, y, good = algorithm_3(a, b, t, mu, r, gap, p, xtol, start)
        if not good:
            return np.nan
        if force_z * y[0] / np.sin(y[0]) >= wanted:
            return p
        p, start = p + step, tuple(y)


def end_moment(f: dict[str, float], p: float, xtol=1.49e-8) -> float:
    """M_T of parallel walls, (4.28) to (4.39): fsolve for the wall's angle."""
    a, b, d = f["a"], f["b"], f["h_x"]

    def stretch(th):
        return 1 + d / (2 * a) * (th / np.sin(th / 2) ** 2 - 2 / np.tan(th / 2))

    def balance(th):
        return 4 * f["mu"] * f["t_m"] / d * np.sin(th / 2) ** 2 * (1 - stretch(th) ** -6) - p

    th = _fsolve(balance, 0.9, xtol)[0]
    radius = d / (2 * np.sin(th / 2) ** 2)
    width = 2 * a * stretch(th) - 2 * radius * th
    force = p * np.pi / 4 * width**2 * b / a
    return force * (f["H"] / 2 + a) * np.sqrt(2 * d / (2 * d + f["h_L"]))


class Bent(NamedTuple):
    """A finger as the alternation leaves it."""

    tip_angle: float
    tip_force: float
    converged: bool
    rounds: int


def finger(
    f: dict[str, float],
    p: float,
    held: float | None = None,
    pull: float = 0.0,
    weight: tuple[float, float] = (0.0, 0.0),
    tolerances: Tolerances = Tolerances(),  # noqa: B008
    rounds: int = 60,
) -> Bent:
    """Algorithms 5 (free: held is None) and 6 (tip held at y = held): DE for theta, AE for lambda, in turn.

    DE: (4.49), (4.59), (4.63) with lambda known at the nodes; AE: (4.60) at every node. The mesh is the thesis's.
    """
    force, moment = f["mu"] * f["B"] * f["H"], end_moment(f, p, tolerances.roots)
    X = np.linspace(0, f["L"], tolerances.nodes)
    y, unknown = np.zeros((3, X.size)), np.array([0.0])
    y[1] = -moment
    stretch, last = np.ones(X.size), None
    for count in range(rounds):

        def lambda_at(x, nodes=stretch):
            return np.interp(x, X, nodes)

        def loads(x, q):
            return pull + weight[0] * (f["L"] - x), q + weight[1] * (f["L"] - x)

        def slopes(x, y, q, lambda_at=lambda_at):
            lam, (px, qy) = lambda_at(x), loads(x, q[0] if len(q) else 0.0)
            sine, cosine = np.sin(y[0]), np.cos(y[0])
            return np.array([3 * y[1] * lam**7 / (force * f["H"] ** 2), lam * (px * sine - qy * cosine), lam * sine])

        def ends(ya, yb, q):
            held_at = [] if held is None else [yb[2] - held]
            return np.array([ya[0], ya[2], yb[1] + moment, *held_at])

        if held is None:
            found = solve_bvp(
                lambda x, y: slopes(x, y, []),
                lambda a, b: ends(a, b, []),
                X,
                y,
                tol=tolerances.bvp,
                max_nodes=MAX_NODES,
            )
        else:
            found = solve_bvp(slopes, ends, X, y, p=unknown, tol=tolerances.bvp, max_nodes=MAX_NODES)
            unknown = found.p
        y = found.sol(X)
        px, qy = loads(X, unknown[0])
        m = 3 * y[1] / (force * f["H"])  # kappa H = m lambda^6 (2.13)
        tension = (px * np.cos(y[0]) + qy * np.sin(y[0])) / force

        def axial(lam, m=m, tension=tension):
            return lam - lam**-3 - (m * lam**6) ** 2 / lam**7 - tension

        # Every node has its own equation: a banded fsolve knows.
        stretch, _, code, _ = fsolve(axial, stretch, xtol=tolerances.roots, full_output=True, band=(0, 0))
        if not found.success or code != 1:
            return Bent(np.nan, np.nan, False, count + 1)
        if last is not None and np.max(np.abs(y[0] - last)) <= tolerances.theta:
            _ = cumulative_trapezoid(stretch * np.cos(y[0]), X, initial=0)  # (4.61)
            return Bent(-y[0][-1], unknown[0], True, count + 1)
        last = y[0]
    return Bent(np.nan, np.nan, False, rounds)


def algorithm_7(f, offset, pull, weight, wanted, first, step, tolerances: Tolerances) -> float:
    """The pressure of a grasp: p rises by `step` until the tip force reaches `wanted`."""
    p = first
    while p < 0.06:
        if finger(f, p, offset, pull, weight, tolerances).tip_force >= wanted:
            return p
        p += step
    return np.nan


def bracketed_7(f, offset, pull, weight, wanted, low, high, tolerances: Tolerances) -> float:
    """The same pressure by brentq: what the loop of algorithm 7 would have to be for a small error."""
    return brentq(
        lambda p: finger(f, p, offset, pull, weight, tolerances).tip_force - wanted, low, high, xtol=1e-9, rtol=1e-9
    )


def _fsolve(function, start: Any, xtol: float) -> tuple[Any, bool]:
    root, _, code, _ = fsolve(function, start, xtol=xtol, full_output=True)
    return (root if np.ndim(start) else root[0]), code == 1
