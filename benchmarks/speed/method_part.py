"""Every method of the beam with every solver, on one problem each: the tip-held finger, a shell, an energy membrane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.pneunet import Collocation, Shooting
from softgrip_jax.shell.obstacles import Plane
from softgrip_jax.solvers import ArcLength, ExplicitCurve, MinimumEnergy, Newton

from . import cases, long_double
from .energy_part import BASES as ENERGY_BASES
from .energy_part import COLD, unlike
from .finger_part import FINE_POINTS, reference
from .measure import compiled, median_seconds, row

BEAMS = {
    "collocation": [(f"{points} points", Collocation(points=points)) for points in (4, 6, 8, 12, 16)],
    "shooting": [(f"rtol {rtol:g}", Shooting(rtol=rtol)) for rtol in (1e-4, 1e-6, 1e-8)],
}
SOLVERS = {"ArcLength": ArcLength(), "Newton": Newton()}
LANES = 256
ENERGY_LANES = 16
BEST_BASIS = (8, 8)
"""Errors of energy membranes are measured against this one."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows."""
    fine = cases.tip_contact("exact", FINE_POINTS)
    batch = cases.batch_of(fine, 16 if quick else LANES)
    true = reference(fine, batch.lanes(cases.JUDGED))[0]
    for beam, settings in BEAMS.items():
        for setting, method in settings[:1] if quick else settings:
            lanes = cases.Batch(batch.scene.with_method(method), batch.pressure)
            for name, solver in SOLVERS.items():
                yield one("finger tip contact", "tip_force", f"{beam}, {name}", setting, solver, lanes, true)
    name = "shell cylinder"
    case = cases.shells()[name]
    batch = cases.batch_of(case, 16 if quick else LANES)
    designs = [[float(v) for v in jax.tree.leaves(batch.one(k))] for k in range(cases.JUDGED)]
    true = np.array([float(long_double.value_and_elasticities(name, x)[0]) for x in designs])
    for found_by, solver in {"ExplicitCurve": ExplicitCurve(), "Newton": Newton()}.items():
        yield one(name, case.observable, found_by, "", solver, batch, true)
    if quick:
        return
    designs = jnp.asarray(np.random.default_rng(0).uniform(size=(ENERGY_LANES, 5)))
    pressure = jnp.full(ENERGY_LANES, COLD)
    membranes = {basis: jax.jit(jax.vmap(lambda u, basis=basis: unlike(u, on_plane(*basis))))(designs)
                 for basis in (*ENERGY_BASES, BEST_BASIS)}  # fmt: skip
    best = compiled(jax.vmap(lambda s, p: value(s, p, "force", None)), membranes[BEST_BASIS], pressure)
    true = np.asarray(best.call(membranes[BEST_BASIS], pressure))
    for basis in ENERGY_BASES:
        setting, lanes = f"{basis[0]} x {basis[1]} polynomials", cases.Batch(membranes[basis], pressure)
        yield one("energy membrane on a plane", "force", "MinimumEnergy", setting, MinimumEnergy(), lanes, true)


def on_plane(across: int, along: int) -> Any:
    """What makes a membrane above a plane of a shell and a gap."""
    return lambda shell, gap: sg.shell.ObstacleContact(
        shell, Plane(gap), symmetry="both", across=across, lengthwise=along
    )


def value(scene: Any, pressure: Any, observable: str, solver: Any) -> jax.Array:
    """The observable of the state that a solver finds; NaN where it finds none."""
    return sg.solve(scene, pressure, solver=solver).observables[observable]


def one(
    name: str, observable: str, method: str, setting: str, solver: Any, batch: cases.Batch, true: np.ndarray
) -> dict[str, Any]:
    """A row: values alone. Its error is NaN where one of the judged designs has no state by this way."""
    size = batch.pressure.shape[0]
    program = compiled(jax.vmap(lambda scene, pressure: value(scene, pressure, observable, solver)), *batch)
    found = np.asarray(program.call(*batch))[: cases.JUDGED]
    return row(
        name, method, setting, batch=size, error=float(np.max(np.abs(found / true[: cases.JUDGED] - 1))),
        seconds=median_seconds(lambda: program.call(*batch)) / size, compile_seconds=program.seconds,
        first_seconds=program.first, memory_MB=program.memory / 1e6,
    )  # fmt: skip
