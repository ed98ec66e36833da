"""Peers at the finger: the thesis's algorithms with SciPy, SciPy's shooting, diffrax in optimistix under vmap."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from softgrip_jax.units import gram, kPa, mm

from . import cases, diffrax_peer, scipy_peer, thesis_peer
from .finger_part import CHUNK, ENOUGH, FINE_POINTS, reference, with_choices
from .measure import compiled, median_seconds, row
from .shell_part import ours
from .thesis_peer import Tolerances

THESIS = {
    "tolerances of the thesis, 120 nodes": Tolerances(),
    "1e-5, 120 nodes": Tolerances(1e-5, 1e-5, 1e-10),
    "1e-7, 480 nodes": Tolerances(1e-7, 1e-7, 1e-11, 480),
}
SCIPY_RTOL = (1e-4, 1e-6, 1e-8, 1e-10)
DIFFRAX_RTOL = (1e-4, 1e-6, 1e-8, 1e-10)
REFERENCE_RTOL = 1e-13
LANES = 256


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of the peers, and ours at the same designs beside them."""
    for law in ("thesis", "exact"):
        fine = cases.tip_contact(law, FINE_POINTS)
        batch = cases.batch_of(fine, LANES)
        true = reference(fine, batch.lanes(cases.JUDGED))
        case = cases.tip_contact(law, ENOUGH)
        lanes = cases.Batch(with_choices(batch.scene, case.scene), batch.pressure)
        if not quick:
            yield ours("finger tip contact", case, lanes, true, chunk=CHUNK) | {"setting": f"{law}, {ENOUGH} points"}
        fingers = [as_dict(batch.one(k)) for k in range(2 if quick else 8)]
        yield from (by_alternation if law == "thesis" else by_shooting)(fingers, true, quick)
        if law == "exact":
            for rtol in DIFFRAX_RTOL[1:2] if quick else DIFFRAX_RTOL:
                yield by_diffrax(law, batch, true, rtol)
        if not quick:
            few = batch.lanes(cases.JUDGED)
            yield by_diffrax(law, few, true, REFERENCE_RTOL) | {"method": "diffrax, reference"}
    if not quick:
        yield from grasps()


def by_alternation(fingers: Any, true: Any, quick: bool) -> Iterator[dict[str, Any]]:
    """Algorithm 6, with the thesis's tolerances and finer ones."""
    for words, tolerances in list(THESIS.items())[: 1 if quick else None]:
        method = "thesis, fsolve and solve_bvp in turn"
        yield one_by_one(method, words, true, fingers, _alternate(tolerances))


def _alternate(tolerances: Tolerances) -> Any:
    return lambda f, p: thesis_peer.finger(f, p, 0.0, tolerances=tolerances).tip_force


def by_shooting(fingers: Any, true: Any, quick: bool) -> Iterator[dict[str, Any]]:
    """solve_ivp inside root."""
    for rtol in SCIPY_RTOL[1:2] if quick else SCIPY_RTOL:
        shoot = partial(scipy_peer.tip_force, rtol=rtol)
        yield one_by_one("SciPy, solve_ivp in root", f"exact, rtol {rtol:g}", true, fingers, shoot)


def as_dict(lane: cases.Batch) -> tuple[dict[str, float], float]:
    """A finger and its pressure in mm, N, MPa."""
    finger = lane.scene.finger
    lengths = {name: float(getattr(finger, name)) / mm for name in ("a", "b", "h_x", "t_m", "h_L", "H", "B", "L")}
    return lengths | {"mu": float(finger.material.mu) / 1e6}, float(lane.pressure) / 1e6


def one_by_one(method: str, setting: str, true: Any, fingers: Any, solve: Any) -> dict[str, Any]:
    """A peer that solves one design at a time."""

    def run():
        return [solve(f, p) for f, p in fingers]

    found = np.array(run(), float)
    if not np.all(np.isfinite(found)):  # a time of what has no answer says nothing
        answered = f"{setting}: {np.sum(np.isfinite(found))} of {len(found)} have an answer"
        return row("finger tip contact", method, answered, error=np.nan, seconds=np.nan)
    error, _ = cases.errors(found, None, true)
    return row(
        "finger tip contact", method, setting, error=error, seconds=median_seconds(run, repeats=5) / len(fingers)
    )


def by_diffrax(law: str, batch: cases.Batch, true: Any, rtol: float) -> dict[str, Any]:
    """A batch under vmap, and its gradient in forward mode (the only one that the adaptive steps have here)."""
    finger, size = batch.scene.finger, batch.pressure.shape[0]
    value = compiled(jax.vmap(lambda f, p: diffrax_peer.tip_force(f, p, law, rtol)), finger, batch.pressure)
    values = value.call(finger, batch.pressure)
    both = compiled(jax.vmap(lambda f, p: diffrax_peer.value_and_slopes(f, p, law, rtol)), finger, batch.pressure)
    _, slopes = both.call(finger, batch.pressure)
    numbers = jax.tree.leaves((finger, batch.pressure))
    columns = [np.asarray(n) * np.asarray(s) / np.asarray(values) for n, s in zip(numbers, slopes, strict=True)]
    # The scene has two numbers more, the place where the tip is held and the pull at it: both are zero.
    elasticities = np.stack(columns[:-1] + [0 * columns[0]] * (true[1].shape[1] - len(columns)) + columns[-1:], axis=1)
    error, gradient_error = cases.errors(np.asarray(values), elasticities, true)
    return row(
        "finger tip contact", "diffrax in optimistix Newton", f"{law}, rtol {rtol:g}", batch=size, error=error,
        gradient_error=gradient_error, seconds=median_seconds(lambda: value.call(finger, batch.pressure)) / size,
        gradient_seconds=median_seconds(lambda: both.call(finger, batch.pressure)) / size,
        compile_seconds=value.seconds, first_seconds=value.first, memory_MB=both.memory / 1e6,
    )  # fmt: skip


def grasps() -> Iterator[dict[str, Any]]:
    """Algorithm 7 for the thesis's cylinder of 26 g, with its step and with brentq instead."""
    fine = cases.grasp("thesis", FINE_POINTS)
    solved = jax.jit(cases.value_of(fine))(fine.scene, jnp.zeros(()))
    true, finger = float(solved) / 1e6, as_dict(cases.batch_of(cases.tip_contact(), 1).one(0))[0]
    pull = 26 * gram * 9.80665 / 3
    task = (-1.61, pull, (2e-3, 0.0), pull / 0.96)
    for words, solve in (
        ("steps of 1 kPa", lambda: thesis_peer.algorithm_7(finger, *task, 0.02, 1 * kPa / 1e6, Tolerances())),
        ("brentq", lambda: thesis_peer.bracketed_7(finger, *task, 0.02, 0.035, Tolerances(1e-7, 1e-7, 1e-11, 480))),
    ):
        error = abs(solve() / true - 1)
        seconds = median_seconds(solve, repeats=3)
        yield row("finger grasp", "thesis, algorithm 7", words, error=error, seconds=seconds)
