"""Scenes of one unknown: a bracketed root on the rising part of the load curve."""

from __future__ import annotations

from typing import Any

from ..scene import Solver


class ExplicitCurve(Solver):
    """A bracketed root on the first rising part of the load curve, for scenes with one unknown.

    It is what shells and chambers use by themselves. The load is explicit in the unknown angle, so the whole curve
    p(theta) is looked at first. The root cannot fail to converge and has no tolerance: the bracket is closed to
    rounding. The first maximum of the load is the limit, and a larger pressure is BEYOND_LIMIT; see `curve_scene`.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> found = sg.solve(sg.shell.Free(shell), 15 * kPa, solver=sg.solvers.ExplicitCurve())
        >>> print(f"{found.inflation / mm:.2f} mm")
        13.41 mm
    """

    def find(self, scene: Any, pressure, guess):
        return scene.find(pressure)
