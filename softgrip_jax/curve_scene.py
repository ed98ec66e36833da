"""The base of scenes of one's own with one unknown: the pressure is an explicit function of an angle."""

from __future__ import annotations

from typing import ClassVar

from .equations import Approach as Approach
from .equations import CurveEquations
from .scene import Scene
from .solvers.explicit_curve import ExplicitCurve


class CurveScene(CurveEquations, Scene):
    """A scene whose pressure is an explicit function of one angle, see `CurveEquations`."""

    SOLVERS: ClassVar[tuple[str, ...]] = ("ExplicitCurve", "Newton")

    def solver(self):
        return ExplicitCurve()
