"""Scenes of one unknown: a bracketed root on the rising part of the load curve."""

from __future__ import annotations

from typing import Any

from ..scene import Solver


class ExplicitCurve(Solver):
    """Look at the whole curve of the load over its angle, then find the root on its first rising part; for scenes of
    one unknown, the shells and chambers, and what they use by themselves.

    It cannot fail to converge and has no tolerance: the bracket is closed to rounding. The first maximum of the load is
    the limit, beyond which there is BEYOND_LIMIT; see `curve_scene`.
    """

    def find(self, scene: Any, pressure, guess):
        return scene.find(pressure)
