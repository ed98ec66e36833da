"""The finger once more, with SciPy and NumPy only: written from the equations, sharing no code with the package.

Lengths in mm, forces in N, moments in N mm, pressures and mu in N/mm^2 (MPa). A finger is a dict with a, b, h_x, t_m,
h_L, H, B, L and mu. Section law `exact`: stretch^2 = lambda^2 + 2 theta' z across the thickness (Rivlin), with the
fibre forces integrated by Gauss's rule; `thesis`: (2.12), (2.13); `inextensible`: M = mu B H^3 theta'/3. The beam is
integrated by DOP853 and closed by `scipy.optimize.root`, along a ramp of all loads from zero.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

ZETA, WEIGHT = np.polynomial.legendre.leggauss(24)
ZETA, WEIGHT = ZETA / 2, WEIGHT / 2
MOMENTS = np.stack([WEIGHT, WEIGHT * ZETA, WEIGHT * ZETA**2], axis=1)
FINE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
COARSE = {"method": "DOP853", "rtol": 1e-6, "atol": 1e-6}
DIFFERENCES = {"eps": 1e-7}  # what COARSE leaves is no slope


PURE_Z = np.linspace(0, 20, 20001)[1:]
PURE_M = (PURE_Z * np.sqrt(1 + PURE_Z**2) - np.arcsinh(PURE_Z)) / (2 * PURE_Z**2)


@np.errstate(over="raise", invalid="raise", divide="raise")  # an ArithmeticError: the ramp then takes a shorter step
def exact_law(m, n):
    """(H theta', lambda) by Newton's method on the integrals over the thickness; m, n numbers or vectors."""
    # A start that holds for large moments too: pure bending (Rivlin).
    z = np.sign(m) * np.interp(np.abs(m), PURE_M, PURE_Z)
    stretch = (1 + z * z) ** 0.25 + 0.25 * n
    for _ in range(40):
        square = (stretch * stretch)[..., None] + z[..., None] * (2 * ZETA)
        s2 = 1 / (square * square)
        # Integrals of (1, zeta) (1 - s^-4) and of (1, zeta, zeta^2) s^-6. NumPy's calls are what takes the time.
        i0, i1, _ = (s2 @ MOMENTS).T
        j0, j1, j2 = ((s2 / square) @ MOMENTS).T
        dm, dn = -i1 - m, stretch * (1 - i0) - n
        m_z, m_l, n_z, n_l = 4 * j2, 4 * stretch * j1, 4 * stretch * j1, 1 - i0 + 4 * stretch**2 * j0
        det = m_z * n_l - m_l * n_z
        dz, dl = (n_l * dm - m_l * dn) / det, (m_z * dn - n_z * dm) / det
        z, stretch = z - dz, stretch - dl
        if (abs(dz) + abs(dl) < 1e-9).all():  # the next one would be its square
            return z, stretch
    raise ArithmeticError("no state of the section")


def thesis_law(m, n):
    """(H theta', lambda): n = lambda - lambda^-3 - 9 m^2 lambda^5 by Newton's method from lambda = 1."""
    stretch = 1.0
    for _ in range(60):
        f = stretch - stretch**-3 - 9 * m * m * stretch**5 - n
        slope = 1 + 3 * stretch**-4 - 45 * m * m * stretch**4
        if slope <= 0 or not 0.2 < stretch < 5:
            break
        stretch -= f / slope
        if abs(f / slope) < 1e-9:
            return 3 * m * stretch**7, stretch
    raise ArithmeticError("no state of the section")


LAWS = {"exact": exact_law, "thesis": thesis_law, "inextensible": lambda m, n: (3 * m, 1.0)}


def end_moment(f, p, th_s=0.0):
    """M_T of two chambers that press on each other, (4.18)-(4.39); th_s >= 0; zero below contact."""
    a, b, mu, t = f["a"], f["b"], f["mu"], f["t_m"]
    s, c = np.sin(th_s), np.cos(th_s)
    rho = 0.0
    if th_s > 0:
        free = brentq(lambda x: (1 - c * np.cos(x)) / np.sin(x) - s - f["h_x"] / a, th_s, 3.14, xtol=1e-15)  # (4.18)
        rho = a * th_s / free
    d = f["h_x"] + 2 * a * s

    def stretch(th):
        return c + d / (2 * (a + rho)) * (th / np.sin(th / 2) ** 2 - 2 / np.tan(th / 2))

    def balance(th):
        return 1 - stretch(th) ** -6 - p * d / (4 * mu * t * np.sin(th / 2) ** 2)

    th = brentq(balance, 1e-2, np.pi, xtol=1e-15)
    radius = d / (2 * np.sin(th / 2) ** 2)
    width = 2 * a * stretch(th) - radius * (np.arccos(1 - f["h_x"] / radius) + th)  # c_1 + c_2
    if width <= 0:
        return 0.0
    force = p * np.pi / 4 * width**2 * b * (a - rho) / a**2
    return force * (f["H"] / 2 + a - rho) * c * np.sqrt(2 * f["h_x"] / (2 * f["h_x"] + f["h_L"]))


def wall_limit(f, th_s=0.0):
    """The pressure at which the model of the walls ends: (4.30) at theta_m2 = pi."""
    s, c, a, rho = np.sin(th_s), np.cos(th_s), f["a"], 0.0
    if th_s > 0:
        rho = a * th_s / brentq(lambda x: (1 - c * np.cos(x)) / np.sin(x) - s - f["h_x"] / a, th_s, 3.14, xtol=1e-15)
    d = f["h_x"] + 2 * a * s
    return 4 * f["mu"] * f["t_m"] / d * (1 - (c + np.pi * d / (2 * (a + rho))) ** -6)


def pressure_of(f, moment):
    """The pressure at which parallel walls give an end moment, at most 0.9 of the wall's limit."""
    highest = 0.9 * wall_limit(f)
    if end_moment(f, highest) < moment:
        return highest
    lowest = 1e-3
    while end_moment(f, lowest) > moment:  # until the walls hardly touch
        lowest /= 2
    return brentq(lambda p: end_moment(f, p) - moment, lowest, highest, xtol=1e-16, rtol=1e-14)


def integrate(f, law, parts, start, loads, how):
    """States [theta, M_ext, x, y] at the end of every part; parts: (length, M_T); loads: (P, Q) at the tip, (g_x, g_y).

    M = M_ext - M_T; M_ext' = lambda (P sin theta - Q cos theta).
    """
    force, section = f["mu"] * f["B"] * f["H"], LAWS[law]
    (p_tip, q_tip), (g_x, g_y) = loads

    def rhs(X, state, active):
        sine, cosine = np.sin(state[0]), np.cos(state[0])
        p, q = p_tip + g_x * (f["L"] - X), q_tip + g_y * (f["L"] - X)
        z, stretch = section((state[1] - active) / (force * f["H"]), (p * cosine + q * sine) / force)
        return [z / f["H"], stretch * (p * sine - q * cosine), stretch * cosine, stretch * sine]

    ends, X, state = [], 0.0, np.array(start, float)
    for length, active in parts:
        state = solve_ivp(rhs, (X, X + length), state, args=(active,), **how).y[:, -1]
        X += length
        ends.append(state)
    return np.array(ends)


def solved(residual, start):
    """The root, with its residual checked."""
    found = root(residual, start, method="hybr", options={"xtol": 1e-13})
    assert np.max(np.abs(found.fun)) < 1e-9, found.message
    return found.x


def ramped(residual, size):
    """The root of residual(y, share) at share 1, followed from y = 0 at share 0; a step that strays is halved."""
    y, slope, share, step = np.zeros(size), np.zeros(size), 0.0, 0.125
    while share < 1:
        step = min(step, 1 - share)
        guess = y + step * slope
        try:
            found = root(residual, guess, args=(share + step,), options=DIFFERENCES)
            near = found.success and np.max(np.abs(found.x - guess)) < 0.4
        except ArithmeticError:
            near = False
        if near:
            y, slope, share = found.x, (found.x - y) / step, share + step
        step *= 1.5 if near else 0.5
        assert step > 1e-4, "the ramp has no way on"
    return y


def held_tip(f, law, parts, offset=0.0, pull=0.0, weight=(0.0, 0.0)):
    """(M_ext(0), Lambda, end state) of a tip held at y = offset, on the branch that is connected to zero load."""
    unit = np.array([f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"] ** k for k in (1, 2)])

    def residual(y, share, how):
        pushed = [(length, share * active) for length, active in parts]
        loads = (share * pull, y[1] * unit[1]), share * np.asarray(weight)
        end = integrate(f, law, pushed, [0.0, y[0] * unit[0], 0.0, 0.0], loads, how)[-1]
        return [end[1] / unit[0], (end[3] - share * offset) / f["L"]]

    y = solved(lambda y: residual(y, 1.0, FINE), ramped(lambda y, share: residual(y, share, COARSE), 2))
    end = integrate(f, law, parts, [0.0, y[0] * unit[0], 0.0, 0.0], ((pull, y[1] * unit[1]), weight), FINE)[-1]
    return y[0] * unit[0], y[1] * unit[1], end


def cantilever(f, law, parts, weight=(0.0, 0.0), tip_load=(0.0, 0.0), clamp=0.0):
    """States at the end of every part of a finger whose tip is free."""
    unit = f["mu"] * f["B"] * f["H"] ** 3 / 3 / f["L"]

    def ends(y, share, how):
        pushed = [(length, share * active) for length, active in parts]
        loads = share * np.asarray(tip_load), share * np.asarray(weight)
        return integrate(f, law, pushed, [clamp, y[0] * unit, 0.0, 0.0], loads, how)

    start = ramped(lambda y, share: ends(y, share, COARSE)[-1, 1] / unit, 1)
    return ends(solved(lambda y: ends(y, 1.0, FINE)[-1, 1] / unit, start), 1.0, FINE)
