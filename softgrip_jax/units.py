"""Units as plain floats: multiply to enter SI, divide to leave it.

>>> from softgrip_jax.units import mm, kPa
>>> 16 * mm, 175 * kPa
(0.016, 175000.0)

Everything inside the package is SI (metre, newton, pascal, radian, kilogram).
"""

import math

from .names import listing

mm = 1e-3
cm = 1e-2
m = 1.0
Pa = 1.0
kPa = 1e3
MPa = 1e6
N = 1.0
mN = 1e-3
N_mm = 1e-3
gram = 1e-3
kg = 1.0
degree = math.pi / 180
rad = 1.0

GRAVITY = 9.81
"""Standard acceleration used throughout the thesis, m/s^2."""

DISPLAY = {
    "length": ("mm", mm),
    "position": ("mm", mm),
    "area": ("mm^2", mm * mm),
    "force": ("N", N),
    "force_per_length": ("N/m", 1.0),
    "pressure": ("kPa", kPa),
    "moment": ("N mm", N_mm),
    "angle": ("deg", degree),
    "curvature": ("1/m", 1.0),
    "mass": ("g", gram),
    "number": ("", 1.0),
}
"""What people read: kind of quantity -> (label, value of that unit in SI).
Config keys, tables and axis labels take their unit from here. A position is a point (x, y), not one number."""

SI = {
    "length": "m",
    "position": "m",
    "area": "m^2",
    "force": "N",
    "force_per_length": "N/m",
    "pressure": "Pa",
    "moment": "N m",
    "angle": "rad",
    "curvature": "1/m",
    "mass": "kg",
    "number": "",
}
"""Kind of quantity -> its SI unit: what constructors take, results hold and `--json` prints."""


def unit_key(name: str, kind: str) -> str:
    """The name of a quantity with its unit, as keys of configs and columns of tables have it.

    Args:
        name: of the quantity.
        kind: a key of `units.DISPLAY`.

    Examples:
        >>> sg.units.unit_key("weight", "force_per_length")
        'weight_N_per_m'
    """
    label = DISPLAY[kind][0].replace("^", "").replace("/", "_per_").replace(" ", "_")
    return f"{name}_{label}" if label else name


def number_of(text: str) -> float | None:
    """A number as people write it; None for what is none, and for 1_0, which Python would read as 10.

    Args:
        text: the number, and nothing else.

    Examples:
        >>> sg.units.number_of("1e3"), sg.units.number_of("1_0")
        (1000.0, None)
    """
    try:
        return float(text if "_" not in text else "")
    except ValueError:
        return None


_NUMBERS = (name for name, value in globals().copy().items() if type(value) is float)
__dir__ = listing(globals(), "DISPLAY", "SI", *_NUMBERS)
