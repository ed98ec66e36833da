"""The finger with its tip held: section laws, integrators and steps, precisions, batch sizes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax.pneunet.beam as beam

from . import cases
from .measure import ON_GPU, WHOLE
from .shell_part import ours

STEPS = {"exact": (2, 4, 8, 12), "thesis": (2, 4, 12), "inextensible": (2, 4, 12)}
INTEGRATORS = {"Tsit5": (diffrax.Tsit5(), (8, 24)), "Bosh3": (diffrax.Bosh3(), (64,))}
"""Of lower order; with steps that make them comparable."""
FINE_STEPS = 48
"""Of order 8: errors of fingers are measured against these, and these against diffrax at 1e-13 (see `peers`)."""
BATCHES = (1, 16, 256, 4096, 65536, *[WHOLE] * ON_GPU)
CHUNK = WHOLE if ON_GPU else 256
"""Larger batches run in chunks of this size; every chunk waits for its slowest lane."""
USUAL = 512
"""Lanes where the batch size is not what is varied."""


@contextmanager
def integrator(solver: Any) -> Iterator[None]:
    """Programs that are traced inside integrate the beam with another Runge-Kutta method."""
    given = beam.fixed_steps
    beam.fixed_steps = lambda *args, **options: given(*args, **options | {"solver": solver})
    try:
        yield
    finally:
        beam.fixed_steps = given


def reference(case: cases.Case, batch: cases.Batch) -> tuple[np.ndarray, np.ndarray]:
    """Values and elasticities with the finest steps."""
    both = jax.jit(jax.vmap(cases.value_and_gradient(case)))
    values, gradients = both(*batch)
    return np.asarray(values), cases.elasticities(batch, values, gradients, case.pressure is not None)


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of the finger with its tip held."""
    for law, steps in STEPS.items():
        if quick and law != "exact":
            continue
        fine = cases.tip_contact(law, FINE_STEPS)
        batch = cases.batch_of(fine, 16 if quick else max(BATCHES))
        true = reference(fine, batch.lanes(cases.JUDGED))
        for count in steps[1:2] if quick else steps:
            lanes = batch.lanes(16 if quick else USUAL)
            yield one(law, count, lanes, true)
        if law != "exact" or quick:
            continue
        for name, (solver, counts) in INTEGRATORS.items():
            for count in counts:
                with integrator(solver):
                    yield one(law, count, batch.lanes(USUAL), true, method=name)
        for size in BATCHES:
            yield one(law, 4, batch.lanes(size), true)
        with jax.enable_x64(False):
            single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), batch.lanes(USUAL))
            yield one(law, 4, single, true, "float32")


def one(
    law: str, steps: int, batch: cases.Batch, true: Any, precision: str = "float64", method: str = "Dopri8"
) -> dict[str, Any]:
    """A row."""
    case = cases.tip_contact(law, steps)
    batch = cases.Batch(_with_steps(batch.scene, case.scene), batch.pressure)
    found = ours("finger tip contact", case, batch, true, precision, CHUNK)
    return found | {"setting": f"{law}, {method}, {steps} steps"}


def _with_steps(batch: Any, scene: Any) -> Any:
    """The numbers of a batch in a scene with other choices."""
    return jax.tree.unflatten(jax.tree.structure(scene), jax.tree.leaves(batch))
