"""The finger with its tip held: section laws, integrators, points and steps, precisions, batch sizes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from . import cases, diffrax_peer
from .measure import compiled, median_seconds, row
from .shell_part import ours

POINTS = {"exact": (4, 6, 8, 12, 16), "thesis": (6, 8, 16), "inextensible": (6, 8, 16)}
FINE_POINTS = 32
"""Errors of fingers are measured against these, and these against diffrax at 1e-13 (see `peers`)."""
ENOUGH = 8
"""Points that know the tip force to 1e-6."""
INTEGRATORS = {"Dopri8": (4, 12), "Tsit5": (8, 24), "Bosh3": (64,)}
"""Of diffrax, with equal steps, in optimistix's Newton method; with steps that make them comparable."""
BATCHES = (1, 16, 256, 4096, 65536)
CHUNK = 1024
"""Larger batches run in chunks of this size."""
USUAL = 1024
"""Lanes where the batch size is not what is varied."""


def reference(case: cases.Case, batch: cases.Batch) -> tuple[np.ndarray, np.ndarray]:
    """Values and elasticities with the most points."""
    both = jax.jit(jax.vmap(cases.value_and_gradient(case)))
    values, gradients = both(*batch)
    return np.asarray(values), cases.elasticities(batch, values, gradients, case.pressure is not None)


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of the finger with its tip held."""
    for law, points in POINTS.items():
        if quick and law != "exact":
            continue
        fine = cases.tip_contact(law, FINE_POINTS)
        batch = cases.batch_of(fine, 16 if quick else max(BATCHES))
        true = reference(fine, batch.lanes(cases.JUDGED))
        for count in [ENOUGH] if quick else points:
            yield one(law, count, batch.lanes(16 if quick else USUAL), true)
        if law != "exact" or quick:
            continue
        for name, counts in INTEGRATORS.items():
            for count in counts:
                yield by_steps(law, name, count, batch.lanes(USUAL), true)
        for size in BATCHES:
            yield one(law, ENOUGH, batch.lanes(size), true)
        with jax.enable_x64(False):
            single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), batch.lanes(USUAL))
            yield one(law, ENOUGH, single, true, "float32")


def one(law: str, points: int, batch: cases.Batch, true: Any, precision: str = "float64") -> dict[str, Any]:
    """A row."""
    case = cases.tip_contact(law, points)
    batch = cases.Batch(with_choices(batch.scene, case.scene), batch.pressure)
    found = ours("finger tip contact", case, batch, true, precision, CHUNK)
    return found | {"setting": f"{law}, {points} points"}


def by_steps(law: str, method: str, steps: int, batch: cases.Batch, true: Any) -> dict[str, Any]:
    """Values by shooting with equal steps of one of diffrax's methods."""
    finger, size = batch.scene.finger, batch.pressure.shape[0]
    solve = compiled(
        jax.vmap(lambda f, p: diffrax_peer.tip_force(f, p, law, 1e-10, (method, steps))), finger, batch.pressure
    )
    error, _ = cases.errors(np.asarray(solve.call(finger, batch.pressure)), None, true)
    return row(
        "finger tip contact", "diffrax in optimistix Newton", f"{law}, {method}, {steps} steps", batch=size,
        error=error, seconds=median_seconds(lambda: solve.call(finger, batch.pressure)) / size,
        compile_seconds=solve.seconds, first_seconds=solve.first, memory_MB=solve.memory / 1e6,
    )  # fmt: skip


def with_choices(batch: Any, scene: Any) -> Any:
    """The numbers of a batch in a scene with other choices."""
    return jax.tree.unflatten(jax.tree.structure(scene), jax.tree.leaves(batch))
