"""The catalogue of hard cases: a scene, a pressure, what must come back, and an independent value where there is one.

`tests/questions/test_hard_cases.py` holds every one of them; `python -m benchmarks.speed --only hard` runs them again
beside the thesis's solvers and writes the table of docs/hard-cases.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import reference as shells
import reference_beam as beams
from fingers import TYPE_A, contact, free, pneunet
from helpers import ROD, shell
from scipy.optimize import brentq, minimize_scalar

import softgrip_jax as sg
from softgrip_jax.units import GRAVITY, gram, kPa, mm

OK, NO_CONTACT, BEYOND, IMPOSSIBLE = (sg.Status[n] for n in ("OK", "NO_CONTACT", "BEYOND_LIMIT", "IMPOSSIBLE"))


@dataclass(frozen=True)
class Hard:
    """One case."""

    name: str
    what: str
    """What is hard about it."""
    make: Callable[[], sg.Scene]
    pressure: Callable[[], float]
    """Pa."""
    status: tuple[sg.Status, ...]
    """What may come back."""
    observable: str = ""
    truth: Callable[[], float] | None = None
    """The observable, SI, by another code."""
    tolerance: float = 1e-9
    """Relative error that is allowed: what the conditioning of the case leaves."""
    design: dict[str, Any] = field(default_factory=dict)
    """Numbers of the case for solvers that are not ours (mm, N, MPa)."""

    def __str__(self) -> str:
        return self.name


def at(value: float) -> Callable[[], float]:
    """A pressure in kPa that is known."""
    return lambda: value * kPa


# --- shells -----------------------------------------------------------------------------------------------------------

THIN = {"a": 16e-3, "b": 43e-3, "t_m": 1.1e-3, "material": {"kind": "neo", "mu": 175e3}}


@cache
def free_top() -> tuple[float, float]:
    """(angle, Pa) of the largest pressure of the thesis's free shell, by SciPy."""
    found = minimize_scalar(lambda th: -shells.free(th, THIN)[0], bounds=(1.0, 2.8), options={"xatol": 1e-12})
    return float(found.x), float(-found.fun)


def inflation_at(share: float) -> float:
    """m, at a share of the largest pressure."""
    top, p = free_top()
    angle = brentq(lambda th: shells.free(th, THIN)[0] - share * p, 1e-9, top, xtol=1e-16, rtol=1e-15)
    return 16e-3 * np.tan(angle / 2)


def begin_flat() -> float:
    """Pa: first contact with a plane at 5 mm."""
    return float(shells.free(2 * np.arctan(5 / 16), THIN)[0])


def flat_force_at(p: float) -> float:
    """N, on a plane at 5 mm."""
    design = THIN | {"distance": 5e-3}
    start = 2 * np.arctan(5 / 16)
    angle = brentq(lambda th: shells.flat(th, design)[0] - p, start, 3.1, xtol=1e-16, rtol=1e-15)
    return float(shells.flat_force(angle, design))


def small_inflation(p: float) -> float:
    """m, by the cubic that the arcs become for small angles: p a / (mu t) = c theta^3, from the reference itself."""
    angle = brentq(lambda th: shells.free(th, THIN)[0] - p, 1e-7, 0.5, xtol=1e-18, rtol=1e-15)
    return 16e-3 * np.tan(angle / 2)


SHELLS = [
    Hard(
        "free shell just below its largest pressure", "the angle moves with the square root of what is missing",
        lambda: sg.shell.Free(shell()), lambda: (1 - 1e-6) * free_top()[1], (OK,), "inflation",
        lambda: inflation_at(1 - 1e-6), 1e-9, {"share": 1 - 1e-6},
    ),
    Hard(
        "free shell past its largest pressure", "there is no equilibrium",
        lambda: sg.shell.Free(shell()), lambda: (1 + 1e-6) * free_top()[1], (BEYOND,), design={"share": 1 + 1e-6},
    ),
    Hard(
        "free shell at a millionth of a pascal", "the slope of the pressure is zero where it begins",
        lambda: sg.shell.Free(shell()), lambda: 1e-6, (OK,), "inflation", lambda: small_inflation(1e-6), 1e-9,
        {"share": 1e-6 / 20175.6},
    ),
    Hard(
        "plane, a part in 1e6 above first contact", "the force is nearly nothing: c goes to zero",
        lambda: sg.shell.FlatContact(shell(), distance=5 * mm), lambda: begin_flat() * (1 + 1e-6), (OK,), "force",
        lambda: flat_force_at(begin_flat() * (1 + 1e-6)), 1e-6, {"factor": 1 + 1e-6},
    ),
    Hard(
        "plane, below first contact", "the equations of contact still have a root, with a negative width",
        lambda: sg.shell.FlatContact(shell(), distance=5 * mm), lambda: 0.9 * begin_flat(), (NO_CONTACT,),
        "force", lambda: 0.0, design={"factor": 0.9},
    ),
    Hard(
        "cylinder, poor first guess", "five equations with roots that mean nothing: theta_c < 0, or e < 0",
        lambda: sg.shell.CylinderContact(shell(), **ROD), at(15), (OK,), "force_z", lambda: 5.75451045, 1e-7,
        {"starts": True},
    ),
    Hard(
        "wide shell on a large cylinder, past its end", "the membrane is used up, e = 0, before any maximum",
        lambda: sg.shell.CylinderContact(shell(b=20 * mm), radius=40 * mm, gap=2 * mm), at(40), (BEYOND,),
        design={"short": True},
    ),
    Hard(
        "a cylinder that all but touches, gap 1 nm",
        "angles of 1e-7; the contact is as wide as the shell at once, and the model ends",
        lambda: sg.shell.CylinderContact(shell(), radius=20 * mm, gap=1e-6 * mm),
        at(2),
        (BEYOND,),
    ),
    Hard(
        "a locking membrane (Gent)", "tension without bound at a finite stretch",
        lambda: sg.shell.Free(shell("gent")), at(300), (OK,),
    ),
    Hard(
        "a membrane as thin as a soap film", "t_m / a = 1e-6, and pressures of 1e-2 Pa",
        lambda: sg.shell.Free(shell(t_m=16e-9)), lambda: 0.5 * free_top()[1] * 16e-9 / 1.1e-3, (OK,), "inflation",
        lambda: inflation_at(0.5),
    ),
]  # fmt: skip

# --- fingers ----------------------------------------------------------------------------------------------------------

SLENDER = TYPE_A | {"L": 300.0}
HEAVY = TYPE_A | {"mu": 0.08}
VERY_HEAVY = TYPE_A | {"mu": 0.012}


def tip_force(f: dict, p: float, offset=0.0, pull=0.0, weight=(0.0, 0.0)) -> Callable[[], float]:
    """N, by SciPy; p in MPa."""
    return lambda: float(beams.held_tip(f, "exact", [(f["L"], beams.end_moment(f, p))], offset, pull, weight)[1])


def tip_angle(f: dict, p: float, weight) -> Callable[[], float]:
    """rad, of a hanging finger, by SciPy; p in MPa."""
    moment = beams.end_moment(f, p) if p else 0.0
    return lambda: -float(beams.cantilever(f, "exact", [(f["L"], moment)], weight)[-1][0])


def held(f=TYPE_A, offset=0.0, pull=0.0, weight=(0.0, 0.0)) -> Callable[[], sg.Scene]:
    """A finger with its tip held."""
    return lambda: contact(f, "exact", offset, pull, weight)


def hanging(f, weight) -> Callable[[], sg.Scene]:
    """A free finger under its weight."""
    return lambda: free(f, "exact", weight, inclination="none")


FINGERS = [
    Hard("finger, tip held, just below its fold", "two equilibria meet", held(), at(41.6), (OK,), "tip_force",
         tip_force(TYPE_A, 0.0416), 1e-6, {"finger": TYPE_A, "p": 0.0416}),
    Hard("finger, tip held, past its fold", "no equilibrium from zero load on; loops solve the same equations", held(),
         at(42), (BEYOND,), design={"finger": TYPE_A, "p": 0.042}),
    Hard("finger, tip held 20 mm along the bending", "the fold comes sooner, branches come close", held(offset=-20.0),
         at(31), (OK, BEYOND), "tip_force", tip_force(TYPE_A, 0.031, -20.0), 1e-7,
         {"finger": TYPE_A, "p": 0.031, "offset": -20.0}),
    Hard("finger, tip held 20 mm against the bending", "the tip is lifted before the pressure acts", held(offset=20.0),
         at(31), (OK,), "tip_force", tip_force(TYPE_A, 0.031, 20.0), 1e-7,
         {"finger": TYPE_A, "p": 0.031, "offset": 20.0}),
    Hard("slender finger under tension, 300 mm and 1 N", "a perturbation grows by e^28 along the beam",
         held(SLENDER, 0.0, 1.0), at(31), (OK,), "end_moment", lambda: beams.end_moment(SLENDER, 0.031) * 1e-3, 1e-9,
         {"finger": SLENDER, "p": 0.031, "pull": 1.0}),
    Hard("soft and heavy: 80 kPa, 6 N/m", "weight alone bends it far", hanging(HEAVY, (0.0, -6e-3)), at(2), (OK,),
         "tip_angle", tip_angle(HEAVY, 0.002, (0.0, -6e-3)), 1e-6,
         {"finger": HEAVY, "p": 0.002, "weight": (0.0, -6e-3)}),
    Hard("chambers without a gap, h_x = 0", "divisions by zero in the text", held(TYPE_A | {"h_x": 0.0}), at(20), (OK,),
         design={"finger": TYPE_A | {"h_x": 0.0}, "p": 0.02}),
    Hard("first contact of chambers, c to 0", "the moment begins with slope zero", held(), at(9.2), (OK, NO_CONTACT),
         design={"finger": TYPE_A, "p": 0.0092}),
    Hard("finger without pressure", "zero divided by zero where shares are taken", held(), at(0), (OK,)),
    Hard("grasp of 500 g, a strong pull at every tip", "strong tension: shooting from the clamp loses its digits",
         lambda: sg.pneunet.Grasp(sg.pneunet.Gripper(pneunet(TYPE_A), base_radius=19.61 * mm, touch="midline"),
                                  sg.objects.Cylinder(radius=18 * mm, mass=500 * gram, friction=0.96)),
         at(31), (OK,), "tip_force",
         tip_force(TYPE_A, 0.031, -1.61, 0.5 * GRAVITY / 3, (2e-3, 0.0)), 1e-7,
         {"finger": TYPE_A, "p": 0.031, "offset": -1.61, "pull": 0.5 * GRAVITY / 3}),
    Hard("finger pressed along its axis, three times Euler's load", "straight it is in equilibrium, but not stable",
         held(pull=-1.0), at(10), (IMPOSSIBLE,),
         design={"finger": TYPE_A, "p": 0.01, "pull": -1.0}),
    Hard("very soft and heavy: 12 kPa, 6 N/m", "weight is 270 times EI/L^3: it hangs from a bend of 5 mm",
         hanging(VERY_HEAVY, (0.0, -6e-3)), at(0), (OK,),
         design={"finger": VERY_HEAVY, "p": 0.0, "weight": (0.0, -6e-3)}),
]  # fmt: skip

CASES = [*SHELLS, *FINGERS]
