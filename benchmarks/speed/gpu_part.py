"""What a GPU does: shells, held fingers and energy membranes in batches, as a user's default call solves them, and one
search. Programs of a part are compiled side by side; while one is timed no other is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from . import cases, same_part
from . import measure as clocks
from .measure import Compiled, alone, compiled, median_seconds, row

PARTS = ("gpu_same", "gpu_search", "gpu_fingers", "gpu_energy", "gpu_shells")
"""Longest first."""
SEARCH_FIELDS = ("search", "designs", "run", "seconds", "descent_seconds", "finish_seconds", "solves", "best")
FIELDS = dict.fromkeys(PARTS, clocks.FIELDS) | {"gpu_search": SEARCH_FIELDS, "gpu_same": same_part.FIELDS}

LARGEST = 2**20
SHELL_BATCHES = (1, 4096, LARGEST)
FINGER_BATCHES = (1, 4096, 2**18, LARGEST)
ENERGY_BATCHES = (1, 256, 4096)
SEARCH = "finger_tip_force"
AT_ONCE = 6
"""Programs of a part that are compiled at the same time."""
CELL_PRESSURE = 15e3
"""Pa: at 27 kPa, where the other laws are compared, a finger by the cell law has snapped."""


class Job(NamedTuple):
    """A row to be measured."""

    scene: str
    setting: str
    precision: str
    size: int
    value: Callable[..., Any]
    both: Callable[..., Any] | None
    """With the gradient; not measured where there is none."""
    arguments: Any
    judge: Callable[[Any, Any], tuple[float, float]] | None
    """(values, gradients) -> errors of both."""


def measure(part: str, quick: bool) -> Iterator[dict[str, Any]]:
    """The rows of a part."""
    if part in ("gpu_search", "gpu_same"):
        yield from (_search if part == "gpu_search" else same_part.measure)(quick)
        return
    jobs = {"gpu_shells": _shells, "gpu_fingers": _fingers, "gpu_energy": _energy}[part](quick)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        made = list(pool.map(_programs, jobs))
    with alone():
        yield from filter(None, (_timed(job, *programs) for job, programs in zip(jobs, made, strict=True)))


def _programs(job: Job) -> tuple[Compiled, Compiled | None]:
    with jax.enable_x64(job.precision == "float64"):
        value = compiled(job.value, *job.arguments, called=False)
        return value, None if job.both is None else compiled(job.both, *job.arguments, called=False)


def _timed(job: Job, value: Compiled, both: Compiled | None) -> dict[str, Any] | None:
    """A row; none where the batch does not fit into the memory."""
    found: dict[str, Any] = {}
    try:
        values = value.call(*job.arguments)
        found["seconds"] = median_seconds(lambda: value.call(*job.arguments)) / job.size
        gradients = None
        if both is not None:
            values, gradients = both.call(*job.arguments)
            found["gradient_seconds"] = median_seconds(lambda: both.call(*job.arguments)) / job.size
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        print(f"{job.scene}, {job.setting}: a batch of {job.size:,} does not fit into the memory", flush=True)
        return None
    if job.judge is not None:
        found["error"], found["gradient_error"] = job.judge(values, gradients)
    return row(
        job.scene, "softgrip_jax", job.setting, precision=job.precision, batch=job.size,
        compile_seconds=value.seconds, memory_MB=(both or value).memory / 1e6, **found,
    )  # fmt: skip


def _of_case(
    scene: str, setting: str, case: cases.Case, batch: cases.Batch, true: Any, precision: str = "float64"
) -> Job:
    def judge(values, gradients):
        few = jax.tree.map(lambda leaf: leaf[: cases.JUDGED], (batch, values, gradients))
        slopes = None if gradients is None else cases.elasticities(*few, case.pressure is not None)
        return cases.errors(few[1], slopes, true)

    value, both = jax.vmap(cases.value_of(case)), jax.vmap(cases.value_and_gradient(case))
    return Job(scene, setting, precision, batch.pressure.shape[0], value, both, tuple(batch), judge)


def _shells(quick: bool) -> list[Job]:
    from .shell_part import reference

    jobs = []
    for name, case in cases.shells().items():
        if quick and name != "shell flat":
            continue
        sizes = (16,) if quick else SHELL_BATCHES
        batch = cases.batch_of(case, max(sizes))
        true = reference(name, batch, 4 if quick else cases.JUDGED)
        jobs += [_of_case(name, "", case, batch.lanes(size), true) for size in sizes]
        single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), batch)
        jobs.append(_of_case(name, "", case, single, true, "float32"))
    return jobs


def _fingers(quick: bool) -> list[Job]:
    """Held fingers by the laws that a user has: the default, the exact one at 8 points, the cell's."""
    from .finger_part import FINE_POINTS, with_choices

    usual: Any = replace(cases.tip_contact().scene, section="thesis")
    usual = replace(usual, points=type(usual).__dataclass_fields__["points"].default)
    laws = {
        f"thesis, {usual.points} points": (usual, cases.tip_contact().pressure),
        "exact, 8 points": (replace(usual, section="exact", points=8), cases.tip_contact().pressure),
        f"cell, {usual.points} points": (replace(usual, drive="cell"), CELL_PRESSURE),
    }
    jobs = []
    for place, (setting, (scene, pressure)) in enumerate(laws.items()):
        if quick and place != 1:
            continue
        case = cases.Case(scene, pressure, "tip_force")
        fine = case._replace(scene=replace(scene, points=16 if quick else FINE_POINTS))
        sizes = (16,) if quick else FINGER_BATCHES if place == 0 else FINGER_BATCHES[-2:]
        batch = cases.batch_of(case, max(sizes))
        few = batch.lanes(cases.JUDGED)
        few = cases.Batch(with_choices(few.scene, fine.scene), few.pressure)
        values, gradients = jax.jit(jax.vmap(cases.value_and_gradient(fine)))(*few)
        true = np.asarray(values), cases.elasticities(few, values, gradients, True)
        jobs += [_of_case("finger tip contact", setting, case, batch.lanes(size), true) for size in sizes]
    return jobs


def _energy(quick: bool) -> list[Job]:
    """A batch of unlike shells on a plane at 12 kPa, from the flat membrane."""
    import softgrip_jax as sg
    from softgrip_jax.shell.obstacles import Plane

    from .energy_part import COLD, unlike

    basis = {"across": 2, "lengthwise": 2} if quick else {}

    def force(u):
        def make(shell, gap):
            return sg.shell.ObstacleContact(shell, Plane(gap), symmetry="both", **basis)

        return sg.solve(unlike(u, make), COLD).force

    def job(size):
        designs = jnp.asarray(np.random.default_rng(0).uniform(size=(size, 5)))
        both = jax.vmap(jax.value_and_grad(force)) if size == 256 or quick else None
        return Job("shell on a plane by energy", "", "float64", size, jax.vmap(force), both, (designs,), None)

    return [job(size) for size in ((4,) if quick else ENERGY_BATCHES)]


def _search(quick: bool) -> Iterator[dict[str, Any]]:
    """A shipped search, all of it but reading the config: the first run compiles, the second does not."""
    from optim.design import settings
    from optim.design.descent import search
    from softgrip_jax import config as configs

    root = Path(__file__).resolve().parent.parent.parent
    wanted = settings.read(configs.load(root / "configs" / f"{SEARCH}.toml"))
    arguments = dict(wanted.arguments) | ({"starts": 8, "steps": 3} if quick else {})

    def one(run: str) -> dict[str, Any]:
        began = time.perf_counter()
        found = search(wanted.problem, **arguments)
        return {
            "search": SEARCH, "designs": arguments["starts"], "run": run, "seconds": time.perf_counter() - began,
            "descent_seconds": found.seconds["descend"], "finish_seconds": found.seconds["finish"],
            "solves": found.solves, "best": found.best.objective,
        }  # fmt: skip

    yield one("first")
    with alone():
        yield one("second")
        if not quick:
            yield one("third")
