"""Shells: our solver in both precisions and every batch size, fsolve on the thesis's equations, optimistix's Newton."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax

from . import cases, long_double, thesis_peer
from .measure import compiled, median_seconds, row

BATCHES = (1, 16, 256, 4096, 65536)
CHUNK = 4096
"""Larger batches run in chunks of this size: they stay in the caches."""
FSOLVE_XTOL = (1e-3, 1e-6, 1.49e-8, 1e-12)
PLAIN_RTOL = (1e-3, 1e-6, 1e-9, 1e-12)


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of the shells."""
    for name, case in cases.shells().items():
        if quick and name != "shell flat":
            continue
        count = 4 if quick else cases.JUDGED
        batch = cases.batch_of(case, max(BATCHES))
        true = reference(name, batch, count)
        for size in (256,) if quick else BATCHES:
            yield ours(name, case, batch.lanes(size), true)
        with jax.enable_x64(False):
            single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), batch)
            for size in () if quick else (1, 4096, 65536):
                yield ours(name, case, single.lanes(size), true, "float32")
        for xtol in FSOLVE_XTOL[2:3] if quick else FSOLVE_XTOL:
            yield by_fsolve(name, batch, true, xtol, count)
        for rtol in PLAIN_RTOL[2:3] if quick else PLAIN_RTOL:
            yield by_newton(name, batch.lanes(16 if quick else 4096), true, rtol)


def reference(name: str, batch: cases.Batch, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Values and elasticities of the first designs in 80-bit arithmetic."""
    known = [
        long_double.value_and_elasticities(name, [float(v) for v in jax.tree.leaves(batch.one(k))])
        for k in range(count)
    ]
    return np.array([value for value, _ in known]), np.array([slopes for _, slopes in known])


def mapped(function: Any, size: int, chunk: int) -> Any:
    """A function of one lane for a batch: vmap, in chunks where the batch is large."""
    if size <= chunk:
        return jax.vmap(function)
    return lambda *lanes: lax.map(lambda lane: function(*lane), lanes, batch_size=chunk)


def ours(
    name: str, case: cases.Case, batch: cases.Batch, true: Any, precision: str = "float64", chunk: int = CHUNK, **extra
) -> dict[str, Any]:
    """One row: value, and value with gradient."""
    size = batch.pressure.shape[0]
    value = compiled(mapped(cases.value_of(case), size, chunk), *batch)
    both = compiled(mapped(cases.value_and_gradient(case), size, chunk), *batch)
    values, gradients = both.call(*batch)
    given = case.pressure is not None
    few = jax.tree.map(lambda leaf: leaf[: cases.JUDGED], (batch, values, gradients))
    error, gradient_error = cases.errors(few[1], cases.elasticities(*few, given), true)
    return row(
        name, "softgrip_jax", extra.pop("setting", ""), precision=precision, batch=size, error=error,
        gradient_error=gradient_error, seconds=median_seconds(lambda: value.call(*batch)) / size,
        gradient_seconds=median_seconds(lambda: both.call(*batch)) / size, compile_seconds=value.seconds,
        first_seconds=value.first, memory_MB=both.memory / 1e6,
    )  # fmt: skip


def by_fsolve(name: str, batch: cases.Batch, true: Any, xtol: float, count: int) -> dict[str, Any]:
    """Algorithms 1 to 3."""
    algorithm = {"shell free": 1, "shell flat": 2, "shell cylinder": 3}[name]
    solve = (thesis_peer.algorithm_1, thesis_peer.algorithm_2, thesis_peer.algorithm_3)[algorithm - 1]
    designs = [[float(v) for v in jax.tree.leaves(batch.one(k))] for k in range(count)]
    scaled = [[v / unit for v, unit in zip(x, units(len(x)), strict=True)] for x in designs]

    def all_of_them():
        return [np.ravel(np.asarray(solve(*x, xtol=xtol), dtype=object))[0] for x in scaled]

    values = np.array(all_of_them(), float) * (1e-3 if algorithm == 1 else 1.0)
    error, _ = cases.errors(values, None, true)
    seconds = median_seconds(all_of_them) / count
    return row(name, f"fsolve, algorithm {algorithm}", f"xtol {xtol:g}", error=error, seconds=seconds)


def units(count: int) -> list[float]:
    """From SI to mm and MPa: a, b, t_m, mu, lengths of what is touched, pressure."""
    return [1e-3, 1e-3, 1e-3, 1e6, *[1e-3] * (count - 5), 1e6]


def by_newton(name: str, batch: cases.Batch, true: Any, rtol: float) -> dict[str, Any]:
    """Optimistix's Newton method on the same scalar equation from the middle of its interval, under vmap."""

    def value(scene, pressure):
        low, high = scene.interval()
        middle = low + 0.45 * (high - low)
        found = optx.root_find(
            lambda angle, args: args[0].residual(angle, args[1]), optx.Newton(rtol=rtol, atol=rtol), middle,
            (scene, pressure), max_steps=64, throw=False,
        )  # fmt: skip
        return scene.observe(found.value, pressure)[cases.shells()[name].observable]

    size = batch.pressure.shape[0]
    program = compiled(jax.vmap(value), *batch)
    both = compiled(jax.vmap(jax.value_and_grad(value, argnums=(0, 1))), *batch)
    values, gradients = both.call(*batch)
    few = jax.tree.map(lambda leaf: leaf[: cases.JUDGED], (batch, values, gradients))
    error, gradient_error = cases.errors(few[1], cases.elasticities(*few, True), true)
    return row(
        name, "optimistix Newton", f"rtol {rtol:g}", batch=size, error=error, gradient_error=gradient_error,
        seconds=median_seconds(lambda: program.call(*batch)) / size,
        gradient_seconds=median_seconds(lambda: both.call(*batch)) / size,
        compile_seconds=program.seconds, first_seconds=program.first, memory_MB=both.memory / 1e6,
    )  # fmt: skip
