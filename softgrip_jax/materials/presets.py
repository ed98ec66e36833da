"""Silicones with their measured constants and where these are from."""

from __future__ import annotations

from ..units import kPa
from .laws import NeoHookean


def dragon_skin_20() -> NeoHookean:
    """Dragon Skin 20 silicone, neo-Hookean, mu = 136 kPa, from a linear fit of tension tests.

    Source: thesis table 5.1.

    Examples:
        >>> print(f"{sg.materials.dragon_skin_20().mu / kPa:.0f} kPa")
        136 kPa
    """
    return NeoHookean(mu=136 * kPa)


def dragon_skin_30() -> NeoHookean:
    """Dragon Skin 30 silicone, neo-Hookean, mu = 198 kPa, from a linear fit of tension tests.

    Source: thesis table 5.1.

    Examples:
        >>> print(f"{sg.materials.dragon_skin_30().mu / kPa:.0f} kPa")
        198 kPa
    """
    return NeoHookean(mu=198 * kPa)


def dragon_skin_20_shell() -> NeoHookean:
    """Dragon Skin 20 in the flat shell, neo-Hookean, mu = 175 kPa, tuned to its measured free inflation.

    Source: thesis 6.2.

    Examples:
        >>> print(f"{sg.materials.dragon_skin_20_shell().mu / kPa:.0f} kPa")
        175 kPa
    """
    return NeoHookean(mu=175 * kPa)


PRESETS = {
    "dragon_skin_20": dragon_skin_20,
    "dragon_skin_30": dragon_skin_30,
    "dragon_skin_20_shell": dragon_skin_20_shell,
}
