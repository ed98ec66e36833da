"""Silicones with their measured constants and where these are from."""

from __future__ import annotations

from ..units import kPa
from .laws import NeoHookean


def dragon_skin_20() -> NeoHookean:
    """Dragon Skin 20 silicone, neo-Hookean: mu = 136 kPa from a linear fit of tension tests (thesis table 5.1)."""
    return NeoHookean(mu=136 * kPa)


def dragon_skin_30() -> NeoHookean:
    """Dragon Skin 30 silicone, neo-Hookean: mu = 198 kPa from a linear fit of tension tests (thesis table 5.1)."""
    return NeoHookean(mu=198 * kPa)


def dragon_skin_20_shell() -> NeoHookean:
    """Dragon Skin 20 in the flat shell: mu = 175 kPa, tuned to its measured free inflation (thesis section 6.2)."""
    return NeoHookean(mu=175 * kPa)


PRESETS = {
    "dragon_skin_20": dragon_skin_20,
    "dragon_skin_30": dragon_skin_30,
    "dragon_skin_20_shell": dragon_skin_20_shell,
}
