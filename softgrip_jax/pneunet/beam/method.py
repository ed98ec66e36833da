"""How the equations of a bent cover are solved, as a choice: by collocation or by shooting.

Both solve the same differential equations (see `beam`), and every scene of the finger takes either as `beam`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import equinox as eqx

from ...errors import InputError, require_whole

if TYPE_CHECKING:
    import diffrax

POINTS = 16
"""Gauss points along a finger."""
RTOL = 1e-8
"""Of adaptive steps, where no tolerance is given."""


class BeamMethod(eqx.Module):
    """A method for the beam's equations. Its numbers are static: they are no part of a design."""


def _positive(where: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1:
        raise InputError(f"{where} is {value!r}; it must be a number between 0 and 1.")


class Collocation(BeamMethod):
    """The beam's curvatures at Gauss points are the unknowns, and the section law holds at each of them.

    It is the default. Nothing grows along the beam, whatever pulls at it, and errors fall geometrically with the number
    of points: 16 leave 1e-11 of the tip force of the thesis's finger, 8 leave 2e-7.

    Args:
        points: Gauss points along the beam, dimensionless, at least 3 in each of several parts.

    Raises:
        InputError: where points is not a whole number, 1 or more.

    Source: de Boor and Swartz 1973.

    Examples:
        >>> sg.pneunet.Collocation(points=8)
        Collocation(points=8)
    """

    points: int = eqx.field(static=True, default=POINTS)

    def __check_init__(self) -> None:
        require_whole("Collocation.points", self.points, 1)


def _dopri8() -> Any:
    import diffrax

    return diffrax.Dopri8()


class Shooting(BeamMethod):
    """The beam is integrated from the clamp to the tip, where it must arrive without a moment and at the right place.

    The unknowns are the tip force and the clamp's curvature, which stands for its moment. What diffrax integrates is
    (theta, L theta', lambda, x, y): with the section's own rates (`SectionLaw.rates`) nothing is solved for on the way.
    Derivatives are of any order, forward and in reverse: the accepted steps are gone through once more as plain
    arithmetic (`numerics.ivp.replay`), and the implicit rule is applied to that.

    A finger under a tension P multiplies what rounding leaves at the clamp by e^sqrt(P L^2 / EI) on the way to the tip;
    several segments each have that of their own length only. More are taken where loads that are known numbers ask for
    it, as collocation takes more points. Parts whose chambers incline on their own are segments in any case.

    Args:
        solver: an explicit Runge-Kutta method of diffrax, such as diffrax.Dopri8() or diffrax.Tsit5().
        rtol: relative tolerance of the adaptive steps, dimensionless, between 0 and 1; 1e-8 unless it is given.
        atol: absolute one, of angles (rad) and of curvatures and positions over L (dimensionless); rtol unless it is
            given.
        segments: pieces of the beam that are integrated on their own (multiple shooting); angles and curvatures at the
            joints are unknowns, too.
        steps: so many equal steps in each segment in place of adaptive ones, without rtol and atol. NOT_CONVERGED where
            the method's own error estimate is above a thousandth.
        max_steps: adaptive steps in each segment, at most, those that are taken again included. A state that needs more
            is NOT_CONVERGED; the derivatives' time grows with this number.
        points: Gauss points where the shape is looked at, for the rules of the scene and for pictures.

    Raises:
        InputError: where a number is out of its range, steps are given beside a tolerance, or solver is not an explicit
            Runge-Kutta method of diffrax.

    Source: Keller 1968 for multiple shooting; Kidger 2021 for diffrax.

    Examples:
        >>> shot = sg.pneunet.Shooting(steps=8)  # equal steps: compiled faster than adaptive ones
        >>> free = sg.pneunet.Free(sg.PneuNet.table_5_1("A"), None, (0.0, 0.02), inclination="none", beam=shot)
        >>> print(f"{sg.solve(free, 20 * kPa).tip_angle:.6f} rad")  # by collocation, too
        1.815763 rad
    """

    solver: diffrax.AbstractERK = eqx.field(static=True, default_factory=_dopri8)
    rtol: float | None = eqx.field(static=True, default=None)
    atol: float | None = eqx.field(static=True, default=None)
    segments: int = eqx.field(static=True, default=1)
    steps: int | None = eqx.field(static=True, default=None)
    max_steps: int = eqx.field(static=True, default=32)
    points: int = eqx.field(static=True, default=POINTS)
    searching: bool = eqx.field(static=True, default=False, repr=False, kw_only=True)
    """Whether forward derivatives will do: adaptive steps alone then, not gone through again."""

    def __check_init__(self) -> None:
        import diffrax

        if not isinstance(self.solver, diffrax.AbstractERK) or not hasattr(self.solver.tableau, "b_sol"):
            name = getattr(self.solver, "__name__", None) or type(self.solver).__name__
            raise InputError(
                f"Shooting.solver is {name}; it must be an explicit Runge-Kutta method of diffrax, for instance "
                "diffrax.Dopri8() or diffrax.Tsit5()."
            )
        for name in ("rtol", "atol"):
            tolerance = getattr(self, name)
            if tolerance is None:
                continue
            _positive(f"Shooting.{name}", tolerance)
            if self.steps is not None:
                raise InputError(
                    f"Shooting.steps is {self.steps!r} and its {name} is {tolerance!r}; equal steps have no tolerance, "
                    "so give one of them."
                )
        require_whole("Shooting.segments", self.segments, 1)
        require_whole("Shooting.max_steps", self.max_steps, 2)
        require_whole("Shooting.points", self.points, 1)
        if self.steps is not None:
            require_whole("Shooting.steps", self.steps, 1)

    def tolerances(self) -> tuple[float, float]:
        """(relative, absolute) of adaptive steps."""
        rtol = RTOL if self.rtol is None else self.rtol
        return rtol, rtol if self.atol is None else self.atol


METHODS = ("collocation", "shooting")
"""By name, for configs."""
FROM_CONFIG = {"rtol": float, "atol": float, "segments": int, "steps": int, "max_steps": int, "points": int}
"""Numbers of Shooting that a table may give."""


def to_method(value: Any) -> Any:
    """A method; or its name, or a table {type = "shooting", rtol = 1e-6} of a config, as a method.

    None stands for Collocation with the scene's own points, and so does its name.
    """
    if isinstance(value, str):
        value = {"type": value}
    if not isinstance(value, dict):
        return value
    given = dict(value)
    name = given.pop("type", None)
    if name not in METHODS:
        raise InputError(f"beam is {name!r}; it must be one of {', '.join(map(repr, METHODS))}.")
    allowed = FROM_CONFIG if name == "shooting" else {"points": int}
    for key, number in given.items():
        if key not in allowed:
            raise InputError(f"beam has no key {key!r}; {name!r} takes {', '.join(allowed)}.")
        if isinstance(number, int) and not isinstance(number, bool):
            given[key] = allowed[key](number)
    if name == "shooting":
        return Shooting(**given)
    return Collocation(**given) if given else None


def beam_method() -> Any:
    """The field of a scene that holds its method: None for Collocation with the scene's own number of points."""
    return eqx.field(default=None, static=False, converter=to_method, kw_only=True, metadata={"methods": METHODS})
