"""The base of scenes of one's own with one unknown: the pressure is an explicit function of an angle."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .equations import Approach as Approach
from .equations import CurveEquations
from .errors import InputError
from .own import is_known, is_own, outcome, require_numbers, said_of
from .scene import Scene
from .solvers.explicit_curve import ExplicitCurve, interval_of
from .units import DISPLAY

PLACES = np.linspace(0.05, 0.95, 7)
"""Of the interval, where the load of a scene of one's own is looked at."""


class CurveScene(CurveEquations, Scene):
    """A scene whose pressure is an explicit function of one angle, see `CurveEquations`.

    Raises:
        InputError: where a method of a class of one's own gives what it must not, or the load is nowhere positive
            (outside of jit).
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("ExplicitCurve", "Newton")

    def solver(self):
        return ExplicitCurve()

    def __check_init__(self) -> None:
        if is_own(self):
            _require_curve(self)


def _require_curve(scene: CurveScene) -> None:
    """An InputError where a scene of the user's own is no curve, or does not observe what it announces."""
    name, angle = type(scene).__name__, jnp.ones(())
    for observable, kind in scene.OBSERVABLES.items():
        if kind not in DISPLAY:
            raise InputError(
                f"{name}.OBSERVABLES has {observable!r} of the kind {kind!r}; it must be one of {', '.join(DISPLAY)}."
            )
    if not is_known(scene):
        return
    single = require_numbers(f"{name}.interval", scene, scene.interval, names=("start", "end"))
    single &= require_numbers(f"{name}.load", scene, scene.load, angle)
    single &= require_numbers(f"{name}.pressure_scale", scene, scene.pressure_scale)
    if not single:
        return  # several scenes in one, made for vmap
    _require_observed(scene, outcome(f"{name}.observe", scene.observe, angle, angle))
    with jax.ensure_compile_time_eval():  # under jit, too
        loads = np.asarray(_loads(scene))
    # What is NaN everywhere is told by the status.
    if np.any(loads < 0) and not np.any(loads > 0):
        raise InputError(
            f"{name}.load is {np.nanmin(loads):.6g} Pa, and nowhere in its interval positive; it must be the pressure "
            "that holds the scene, which rises with the angle."
        )


def _require_observed(scene: CurveScene, found: Any) -> None:
    """An InputError where `observe` does not give what OBSERVABLES announces."""
    name, announced = type(scene).__name__, scene.OBSERVABLES
    if not isinstance(found, dict):
        raise InputError(f"{name}.observe gives {said_of(found)}; it must give a dict of {', '.join(announced)}.")
    missing = announced.keys() - found.keys()
    if missing:
        raise InputError(f"{name}.observe does not give {', '.join(sorted(missing))}, which OBSERVABLES announces.")
    for key, kind in announced.items():
        value, shape = found[key], (2,) if kind == "position" else ()
        if getattr(value, "shape", None) != shape:
            needs = "a point (x, y)" if shape else "one number"
            raise InputError(
                f"{name}.observe gives {key} as {said_of(value)}; it must be {needs}, of the shape {shape}."
            )


@jax.jit
def _loads(scene: CurveScene) -> Float[Array, " k"]:
    """The load at PLACES."""
    start, end = interval_of(scene)
    return jax.vmap(scene.load)(start + (end - start) * PLACES)
