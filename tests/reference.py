"""An independent NumPy and SciPy transcription of thesis chapters 2 to 4: nothing here is imported from the package.

Where the package uses one angle as the unknown and derives the rest by hand, this file uses another parametrisation
(the clamp angle theta_m) or the thesis's own systems of equations, so that agreement means something.
"""

from __future__ import annotations

import numpy as np

# Strain energies as derivatives U_1, U_2 by the invariants, for the thesis's (2.2). Parameters are plain dictionaries.
NEO = "neo"
MOONEY = "mooney"
YEOH = "yeoh"
GENT = "gent"
OGDEN = "ogden"


def tensions(material: dict, t_m, l1, l2):
    """Line tensions T_1, T_2, N/m: (2.2) for energies of the invariants, Ogden's own closed form otherwise."""
    l3 = 1 / (l1 * l2)
    kind = material["kind"]
    if kind == OGDEN:
        mu, alpha = np.asarray(material["mu"]), np.asarray(material["alpha"])
        terms = list(zip(np.moveaxis(mu, -1, 0), np.moveaxis(alpha, -1, 0), strict=True))
        logs = np.log(l1), np.log(l2)  # NumPy's exponential takes a fifth of the time of its power

        def cauchy(log):
            return sum(m * (np.exp(k * log) - np.exp(-k * (logs[0] + logs[1]))) for m, k in terms)

        return t_m * l3 * cauchy(logs[0]), t_m * l3 * cauchy(logs[1])
    i1 = l1**2 + l2**2 + l3**2
    u_2 = 0.0
    if kind == NEO:
        u_1 = material["mu"] / 2
    elif kind == MOONEY:
        u_1, u_2 = material["c1"], material["c2"]
    elif kind == YEOH:
        u_1 = material["c1"] + 2 * material["c2"] * (i1 - 3) + 3 * material["c3"] * (i1 - 3) ** 2
    else:
        room = 1 - (i1 - 3) / material["j_m"]
        u_1 = np.where(room > 0, material["mu"] / 2 / np.where(room > 0, room, 1.0), np.nan)
    t_1 = 2 * t_m * l3 * (l1**2 - l3**2) * (u_1 + l2**2 * u_2)
    t_2 = 2 * t_m * l3 * (l2**2 - l3**2) * (u_1 + l1**2 * u_2)
    return t_1, t_2


def free(angle, p):
    """(3.1)-(3.7): pressure, and no margins."""
    a, b = p["a"], p["b"]
    radius = a / np.sin(angle)
    l1 = angle / np.sin(angle)
    l2 = 1 + a / b * (l1 - 1)
    t_1, t_2 = tensions(p["material"], p["t_m"], l1, l2)
    return t_1 / radius + angle / (radius * angle + b - a) * t_2, []


def free_square(angle, p):
    """The square membrane in free space, (4.7), (4.15), (4.16): p = 2 T / R, stretched equally both ways."""
    stretch = angle / np.sin(angle)
    tension, _ = tensions(p["material"], p["t_m"], stretch, stretch)
    return 2 * tension * np.sin(angle) / p["a"], []


def flat(angle, p):
    """(3.7)-(3.11)."""
    a, b, d = p["a"], p["b"], p["distance"]
    radius = d / (1 - np.cos(angle))
    l1 = 1 + d / a * (angle / 2 / np.sin(angle / 2) ** 2 - 1 / np.tan(angle / 2))
    l2 = 1 + a / b * (l1 - 1)
    t_1, t_2 = tensions(p["material"], p["t_m"], l1, l2)
    return t_1 / radius + angle / (radius * angle + b - a) * t_2, []


def flat_force(angle, p):
    """(3.9), (3.10), (3.12), (3.13)."""
    a, b, d = p["a"], p["b"], p["distance"]
    l1 = 1 + d / a * (angle / 2 / np.sin(angle / 2) ** 2 - 1 / np.tan(angle / 2))
    l2 = 1 + a / b * (l1 - 1)
    c_a = a - d / np.tan(angle / 2)
    c_b = l2 * b - l1 * a + c_a
    return flat(angle, p)[0] * (2 * c_a * (2 * c_b - 2 * c_a) + np.pi * c_a**2)


def cylinder(angle, p):
    """(3.14)-(3.30) with the clamp angle theta_m as the parameter; margins e (or e_1, e_2) and a - c_a, scaled."""
    a, b, r, gap = p["a"], p["b"], p["radius"], p["gap"]
    radius = a / np.sin(angle)
    cos_c = np.clip((gap + r + radius * np.cos(angle)) / (r + radius), -1, 1)
    th_c = np.arccos(cos_c)
    sin_c = np.sin(th_c)
    e = b - (r + radius) * sin_c - a
    l1 = angle / np.sin(angle)
    l2 = (r * th_c + radius * th_c + e + radius * angle) / b
    k2 = (angle + th_c) / (radius * th_c + e + radius * angle)
    t_1, t_2 = tensions(p["material"], p["t_m"], l1, l2)
    # (3.26), (3.22); c_a = a where (3.27) with (3.20), (3.21) has theta_ma = pi.
    th_e = 2 * np.arctan(radius * (cos_c - np.cos(angle)) / a)
    edge = th_e / np.sin(th_e)
    room = 1 + np.pi / 2 * gap / a - edge
    margins = [e / b, room]
    if "height" in p:
        reach = (r + radius) * sin_c + a
        margins = [(2 * b - p["height"] - reach) / b, (p["height"] - reach) / b, room]
    return t_1 / radius + k2 * t_2, margins


def inclined(angle, p):
    """(4.18)-(4.32) with (4.30); the margin is c_1 + c_2 after first contact."""
    a, d, s = p["a"], p["distance"], p["angle"]
    depth = d + 2 * a * np.sin(s)
    rho = a * s / touch_angle(d / a, s)
    radius = depth / (1 - np.cos(angle))
    c_2 = (a + rho) * np.cos(s) - depth / np.tan(angle / 2)
    stretch = np.cos(s) + depth / (2 * (a + rho)) * (angle / np.sin(angle / 2) ** 2 - 2 / np.tan(angle / 2))
    c_1 = 2 * a * stretch - radius * (np.arccos(np.clip(1 - d / radius, -1, 1)) + angle) - c_2
    tension, _ = tensions(p["material"], p["t_m"], stretch, stretch)
    return 2 * tension / radius, [c_1 + c_2]


def touch_angle(ratio, s):
    """theta_i of (4.18) by bisection: d/a = csc - cos(theta_s) cot - sin(theta_s) rises with theta_i above theta_s."""
    low, high = np.broadcast_arrays(np.asarray(s, float), np.asarray(ratio, float))[0] + 1e-15, np.pi
    low, high = np.array(low), np.full_like(low, high)
    for _ in range(60):
        middle = (low + high) / 2
        above = (1 - np.cos(s) * np.cos(middle)) / np.sin(middle) - np.sin(s) > ratio
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return (low + high) / 2


def _by_rows(load, angle, p, numbers=50_000):
    """load(angle, p), a few rows at a time: what lies in between stays in the processor's cache."""
    parts = np.array_split(angle, -(-angle.size // numbers))
    pressures, margins = zip(*(load(part, p) for part in parts), strict=True)
    return np.concatenate(pressures), [np.concatenate(margin) for margin in zip(*margins, strict=True)]


def first_rise(load, p, start, end, points=1500, rounds=4):
    """Scan each lane's load curve: angles, pressures and the index where the rising, admissible part ends.

    Every lane's grid is stretched over the part that counts, round by round. Returns (angles, pressures, stop).
    """
    start, end = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
    end = end.copy()
    fractions = np.linspace(0, 1, points)[:, None]
    with np.errstate(all="ignore"):
        for k in range(rounds):
            angle = start + (end - start) * fractions
            pressure, margins = _by_rows(load, angle, p)
            good = np.ones_like(angle, dtype=bool)
            for margin in margins:
                good &= margin >= 0
            good[0] = True
            good[1:] &= (np.diff(pressure, axis=0) > 0) & np.isfinite(pressure[1:])
            good[1] |= np.isnan(pressure[0])
            stop = np.where(good.all(axis=0), points, good.argmin(axis=0))
            last = np.minimum(stop + 1, points - 1)
            if k < rounds - 1:
                end = np.where(stop < points, np.take_along_axis(angle, last[None], 0)[0], end)
    return angle, pressure, stop


def approach(load, p, touch, begins=None, points=400):
    """(whether free inflation leads to a contact, its limit): first_rise of the free load up to where it touches.

    touch: the angle at which the free membrane touches, inf where it never does; begins: where it touches before it
    presses (an inclined plane) the pressure at which it presses: it must hold that, too. The limit is inf where the
    material locks.
    """
    end = np.minimum(np.where(np.isfinite(touch), touch, np.pi), np.pi - 1e-7)
    angle, pressure, stop = first_rise(load, p, 1e-6, end if begins is None else np.pi - 1e-7 + 0 * end, points=points)
    top = np.minimum(stop, points) - 1
    limit = np.take_along_axis(pressure, top[None], 0)[0]
    with np.errstate(all="ignore"):
        locks = np.isnan(np.take_along_axis(pressure, np.minimum(stop, points - 1)[None], 0)[0])
        limit = np.where(locks, np.inf, limit)
        if begins is not None:
            # The maximum is in one of the two cells around the highest sample: on which side the slope tells.
            after = np.take_along_axis(angle, np.minimum(top + 1, points - 1)[None], 0)[0]
            rises = load(touch, p)[0] > load(touch * (1 - 1e-6), p)[0]
            return (touch <= after) & rises & (begins <= limit), limit
        # It rises all the way to where it touches, in the last cell too.
        rises = load(end, p)[0] > load(end * (1 - 1e-6), p)[0]
    return (stop >= points) & rises & np.isfinite(touch), limit
