"""Every method of the beam with every solver, on the same designs: the finger with its tip held, shells.

Type A of the thesis and designs within 5 % of it, tip held at the clamp's height; the thesis's shell on a plane and on
a cylinder. Errors are against codes that share nothing with the package: SciPy's DOP853 at 1e-12 for fingers
(tests/reference_beam.py), the thesis's equations in 80-bit arithmetic for shells (long_double.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import jax
import numpy as np

import softgrip_jax as sg
from softgrip_jax.pneunet import Collocation, Shooting
from softgrip_jax.solvers import ArcLength, ExplicitCurve, Newton
from softgrip_jax.units import kPa

from . import cases, long_double
from .finger_part import with_choices
from .measure import compiled, median_seconds, row
from .peer_part import as_dict

FIELDS = ("scene", "method", "setting", "batch", "found", "error", "seconds", "iterations", "compile_seconds",
          "memory_MB")  # fmt: skip
"""`found` counts the designs of the batch that are OK; `error` is the largest of those among the first cases.JUDGED;
`iterations` is their mean over the batch."""
BEAMS: dict[str, list[tuple[str, Any]]] = {
    "collocation": [(f"{points} points", Collocation(points=points)) for points in (4, 6, 8, 12, 16, 24)],
    "shooting": [(f"rtol 1e-{digits}", Shooting(rtol=10.0**-digits)) for digits in (3, 5, 7, 9, 11)],
}
FINGER = "finger tip contact"
FINGER_PRESSURE = 31 * kPa
"""Where the thesis presses; the largest pressure of type A is 41.6 kPa."""
SHELLS = ("shell flat", "shell cylinder")
LANES = 256
NEARBY = 0.96
"""Newton's method begins at the solution of the same design at this share of the pressure, which is not timed."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """A row per scene, method, setting and solver."""
    size = 16 if quick else LANES
    base = cases.tip_contact()._replace(pressure=FINGER_PRESSURE)
    scene: Any = base.scene
    batch, judged = cases.batch_of(base, size), 2 if quick else cases.JUDGED
    true = finger_truth(batch, judged)
    for beam, settings in BEAMS.items():
        for setting, method in settings[2:3] if quick else settings:
            lanes = cases.Batch(with_choices(batch.scene, scene.with_method(method)), batch.pressure)
            for solver in (ArcLength(), Newton()):
                yield one(FINGER, f"{beam}, {type(solver).__name__}", setting, base.observable, solver, lanes, true)
    for name in SHELLS[:1] if quick else SHELLS:
        case = cases.shells()[name]
        batch = cases.batch_of(case, size)
        true = shell_truth(name, batch, judged)
        for solver in (ExplicitCurve(), Newton()):
            yield one(name, type(solver).__name__, "", case.observable, solver, batch, true)


def finger_truth(batch: cases.Batch, count: int) -> np.ndarray:
    """Tip forces of the first designs by SciPy, N."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tests"))
    reference_beam = import_module("reference_beam")
    forces = []
    for k in range(count):
        finger, pressure = as_dict(batch.one(k))
        parts = [(finger["L"], reference_beam.end_moment(finger, pressure))]
        forces.append(float(reference_beam.held_tip(finger, "exact", parts)[1]))
    return np.array(forces)


def shell_truth(name: str, batch: cases.Batch, count: int) -> np.ndarray:
    """Forces of the first designs in 80-bit arithmetic, N."""
    designs = [[float(number) for number in jax.tree.leaves(batch.one(k))] for k in range(count)]
    return np.array([long_double.value_and_elasticities(name, design)[0] for design in designs])


def one(
    scene: str, method: str, setting: str, observable: str, solver: Any, batch: cases.Batch, true: np.ndarray
) -> dict[str, Any]:
    """A row: values alone, of a batch under vmap."""
    size = batch.pressure.shape[0]

    def state(design, pressure, *guess):
        found = sg.solve(design, pressure, solver=solver, guess=guess[0] if guess else None)
        return found.observables[observable], found.status, found.iterations

    arguments = batch
    if solver.takes_guess():
        near = jax.jit(jax.vmap(lambda design, pressure: sg.solve(design, pressure).unknowns))
        arguments = (*batch, near(batch.scene, NEARBY * batch.pressure))
    program = compiled(jax.vmap(state), *arguments)
    values, status, iterations = (np.asarray(part) for part in program.call(*arguments))
    known = status == int(sg.Status.OK)
    errors = np.abs(values[: len(true)] / true - 1)[known[: len(true)]]
    error = float(np.max(errors)) if errors.size else np.nan
    return row(
        scene, method, setting, batch=size, found=int(np.sum(known)), error=error,
        seconds=median_seconds(lambda: program.call(*arguments)) / size, iterations=float(np.mean(iterations)),
        compile_seconds=program.seconds, memory_MB=program.memory / 1e6,
    )  # fmt: skip
