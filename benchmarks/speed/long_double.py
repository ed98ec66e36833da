"""The shells once more, in 80-bit floating point and from the thesis's equations: what errors are measured against.

The pressure is explicit in the angle; the angle at a pressure follows by bisection and Newton's method, derivatives by
central differences of sixth order (step 1e-4: an error of 1e-15 from either side).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LONG = np.longdouble
STEP = LONG("1e-4")
WEIGHTS = {1: LONG(3) / 4, 2: -LONG(3) / 20, 3: LONG(1) / 60}
"""Of f(x + k h) - f(x - k h), over h."""


def _pressure(mu, t, l1, l2, k1, k2):
    """(2.4) with (2.6): neo-Hookean line tensions."""
    l3 = 1 / (l1 * l2)
    return mu * t * l3 * (k1 * (l1**2 - l3**2) + k2 * (l2**2 - l3**2))


def free(angle, x):
    """(p, inflation) by (3.1)-(3.7); x: a, b, t_m, mu."""
    a, b, t, mu = x
    l1 = angle / np.sin(angle)
    radius = a / np.sin(angle)
    l2 = 1 + a / b * (l1 - 1)
    return _pressure(mu, t, l1, l2, 1 / radius, angle / (radius * angle + b - a)), a * np.tan(angle / 2)


def flat(angle, x):
    """(p, force) by (3.7)-(3.13); x: a, b, t_m, mu, distance."""
    a, b, t, mu, d = x
    radius = d / (1 - np.cos(angle))
    l1 = 1 + d / a * (angle / 2 / np.sin(angle / 2) ** 2 - 1 / np.tan(angle / 2))
    l2 = 1 + a / b * (l1 - 1)
    c_a = a - d / np.tan(angle / 2)
    c_b = l2 * b - l1 * a + c_a
    p = _pressure(mu, t, l1, l2, 1 / radius, angle / (radius * angle + b - a))
    return p, p * (2 * c_a * (2 * c_b - 2 * c_a) + LONG(np.pi) * c_a**2)


def cylinder(angle, x):
    """(p, force_z) by (3.14)-(3.30) in the clamp angle; x: a, b, t_m, mu, radius, gap."""
    a, b, t, mu, r, gap = x
    radius = a / np.sin(angle)
    th_c = np.arccos((gap + r + radius * np.cos(angle)) / (r + radius))
    e = b - (r + radius) * np.sin(th_c) - a
    l1 = angle / np.sin(angle)
    l2 = (r * th_c + radius * th_c + e + radius * angle) / b
    p = _pressure(mu, t, l1, l2, 1 / radius, (angle + th_c) / (radius * th_c + e + radius * angle))
    th_e = 2 * np.arctan(radius * (np.cos(th_c) - np.cos(angle)) / a)
    edge = th_e / np.sin(th_e)

    def excess(th):
        return 1 + gap / a * (th / 2 / np.sin(th / 2) ** 2 - 1 / np.tan(th / 2)) - edge

    c_a = a - gap / np.tan(_root(excess, th_e, LONG(np.pi) - LONG("1e-9")) / 2)
    return p, p * LONG(np.pi) * c_a * r * np.sin(th_c)


def _root(function: Callable, low, high):
    """Bisection to a part in 1e12 of the bracket, then secant steps (Steffensen) to the last bits."""
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    x = (low + high) / 2
    for _ in range(3):
        h = LONG("1e-7")
        x = x - function(x) * 2 * h / (function(x + h) - function(x - h))
    return x


KINDS: dict[str, tuple[Callable, Callable]] = {
    "shell free": (free, lambda x: (LONG("1e-3"), LONG("1.8"))),
    "shell flat": (flat, lambda x: (2 * np.arctan(x[4] / x[0]), LONG("3.1"))),
    "shell cylinder": (cylinder, lambda x: (2 * np.arctan(x[5] / x[0]) + LONG("1e-9"), LONG("1.3"))),
}
"""(p, observable) of an angle, and angles that enclose the rising branch."""


def solved(name: str, x: np.ndarray, pressure) -> np.longdouble:
    """The observable of a design at a pressure, Pa."""
    state, bracket = KINDS[name]
    angle = _root(lambda th: state(th, x)[0] - pressure, *bracket(x))
    return state(angle, x)[1]


def value_and_elasticities(name: str, numbers: list[float]) -> tuple[float, np.ndarray]:
    """The observable of (dimensions..., pressure), and its derivatives by their logarithms over it."""
    x = np.array(numbers, dtype=LONG)

    def at(change):
        moved = x * (1 + change)
        return solved(name, moved[:-1], moved[-1])

    value = at(0 * x)
    slopes = []
    for k in range(len(x)):
        unit = np.zeros(len(x), LONG)
        unit[k] = STEP
        slopes.append(sum(w * (at(n * unit) - at(-n * unit)) for n, w in WEIGHTS.items()) / STEP / value)
    return float(value), np.array(slopes, float)
