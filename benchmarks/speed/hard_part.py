"""The catalogue of tests/hard_cases.py once more, beside the thesis's solvers: what fsolve and solve_bvp make of it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import softgrip_jax as sg
from softgrip_jax.results import in_units

from . import thesis_peer

FIELDS = ("case", "hard", "thesis_solver", "ours", "error", "iterations", "residual")
START = 0.5
"""First guess of fsolve, rad, where the thesis says 'on the basis of practically feasible solution range'."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """A row per case."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tests"))
    from hard_cases import CASES

    for case in CASES[:5:4] if quick else CASES:
        pressure = case.pressure()
        found = sg.solve(case.make(), pressure)
        status = sg.Status(int(found.status))
        error = ""
        if status is sg.Status.OK and case.truth is not None:
            error = abs(float(found.observables[case.observable]) / case.truth() - 1)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            theirs = solver_of_the_thesis(case, pressure)
        said = status.name
        if status is sg.Status.OK and case.observable:
            kind = found.scene.OBSERVABLES[case.observable]
            said += f", {case.observable.replace('_', ' ')} {in_units(found.observables[case.observable], kind)}"
        numbers = (case.name, case.what, theirs, said, error, int(found.iterations), float(found.residual))
        yield dict(zip(FIELDS, numbers, strict=True))


def solver_of_the_thesis(case: Any, pressure: float) -> str:
    """What a user of fsolve or solve_bvp would see, in words."""
    design = case.design
    if "finger" in design:
        return _finger(design)
    if "starts" in design:
        return _cylinder_from_random_guesses()
    if "short" in design:
        _, y, good = thesis_peer.algorithm_3(16, 20, 1.1, 0.175, 40, 2, pressure / 1e6)
        return f"fsolve {_says(good)}: theta_c {y[0]:.3g}, e {y[4]:.3g} mm"
    if "share" in design:
        return _scalar(lambda th: _free(th) - pressure / 1e6, lambda th: f"inflation {16 * np.tan(th / 2):.6g} mm")
    if "factor" in design:
        return _scalar(lambda th: _flat(th)[0] - pressure / 1e6, lambda th: "c_a {:.3g} mm, force {:.3g} N".format(
            *_flat(th)[1:]))  # fmt: skip
    return "not tried"


def _free(th):
    l1 = th / np.sin(th)
    return thesis_peer.membrane_pressure(
        0.175, 1.1, l1, 1 + 16 / 43 * (l1 - 1), np.sin(th) / 16, th / (16 / np.sin(th) * th + 27)
    )


def _flat(th):
    """(MPa, c_a in mm, force in N) at the thesis's distance."""
    l1, radius = 1 + 5 / 16 * (th / 2 / np.sin(th / 2) ** 2 - 1 / np.tan(th / 2)), 5 / (1 - np.cos(th))
    l2 = 1 + 16 / 43 * (l1 - 1)
    p = thesis_peer.membrane_pressure(0.175, 1.1, l1, l2, 1 / radius, th / (radius * th + 27))
    c_a = 16 - 5 / np.tan(th / 2)
    c_b = l2 * 43 - l1 * 16 + c_a
    return p, c_a, p * (4 * c_a * (c_b - c_a) + np.pi * c_a**2)


def _scalar(balance, report) -> str:
    root, good = thesis_peer._fsolve(lambda th: balance(th), START, 1.49e-8)
    return f"fsolve from {START} rad {_says(good)}: {report(float(root))}"


def _says(good: bool) -> str:
    return "says that it converged" if good else "gives up"


def _cylinder_from_random_guesses() -> str:
    """100 first guesses around feasible ones: how many roots are false."""
    rng = np.random.default_rng(0)
    right = false = 0
    for _ in range(100):
        start = np.array([0.6, 1.5, 17.0, 1.2, 6.0]) * np.exp(rng.uniform(-0.7, 0.7, 5))
        force, _, good = thesis_peer.algorithm_3(16, 43, 1.1, 0.175, 20, 5, 0.015, start=tuple(start))
        right += bool(good and abs(force - 5.75451) < 1e-4)
        false += bool(good and abs(force - 5.75451) >= 1e-4)
    none = 100 - right - false
    return f"fsolve from 100 guesses within a factor of two: {right} right, {false} false roots, {none} none"


def _finger(design: dict[str, Any]) -> str:
    f, p = design["finger"], design["p"]
    free = "weight" in design
    try:
        found = thesis_peer.finger(
            f, p, None if free else design.get("offset", 0.0), design.get("pull", 0.0), design.get("weight", (0.0, 0.0))
        )
    except (ValueError, ZeroDivisionError, FloatingPointError, np.linalg.LinAlgError) as error:
        return f"ends with {type(error).__name__}"
    if not found.converged:
        return f"solve_bvp gives up in round {found.rounds}"
    told = f"tip turned by {found.tip_angle:.4g} rad" + ("" if free else f", force {found.tip_force:.4g} N")
    return f"solve_bvp and fsolve: {told} (section law of the thesis; {found.rounds} rounds)"
