"""Whether a GPU says what the CPU says: the shipped scenes, solved on both with the same version of JAX.

`python -m benchmarks.speed.same_part FILE` writes what the device that JAX finds says.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax import config as configs

from . import cases

ROOT = Path(__file__).resolve().parent.parent.parent
QUESTIONS = (
    *("shell_free", "shell_flat", "shell_inclined", "shell_axial_offset", "shell_cylinder", "shell_grasp"),
    *("shell_plane_energy", "shell_obstacle", "finger_chamber", "finger_free", "finger_linear", "finger_nonuniform"),
    *("finger_tip_contact", "finger_grasp", "finger_shape", "finger_free cell", "finger_free small_strain"),
    *("finger_tip_contact cell", "finger_tip_contact small_strain", "finger_grasp cell"),
)
"""Configs, some of them with another drive."""
FIELDS = ("question", "designs", "ok", "statuses_differ", "value", "limit", "derivative")
AT_ONCE = 6
"""Questions that are compiled at the same time."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """A row per question: how many of its designs are OK, and the largest differences between the devices."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cpu.npz"
        order = [sys.executable, "-m", f"{__package__}.same_part", str(file)] + ["quick"] * quick
        with subprocess.Popen(order, cwd=ROOT, env=os.environ | {"JAX_PLATFORMS": "cpu"}) as other:
            here = answers(quick)
            if other.wait():
                raise RuntimeError("the CPU's answers could not be had")
        there = dict(np.load(file))
    for question in dict.fromkeys(key.split("/")[0] for key in here):
        yield {"question": question} | _differences(_of(question, here), _of(question, there))


def _of(question: str, answers: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {what: value for key, value in answers.items() for of, what in [key.split("/")] if of == question}


def answers(quick: bool) -> dict[str, np.ndarray]:
    """question/what -> one value per design."""
    questions, designs = (("shell_flat",), 4) if quick else (QUESTIONS, cases.JUDGED)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        found = list(pool.map(lambda question: _answer(question, designs), questions))
    return {f"{question}/{what}": v for question, of in zip(questions, found, strict=True) for what, v in of.items()}


def _answer(question: str, designs: int) -> dict[str, np.ndarray]:
    """Statuses, observables, limit pressures where a pressure is given, and the derivatives of the first observable
    (of the pressure that is sought) by all numbers."""
    name, _, drive = question.partition(" ")
    config = configs.load(ROOT / "configs" / f"{name}.toml")
    scene = config.scene.prepared()
    scene = replace(scene, drive=drive) if drive else scene
    asked = configs.question(config)
    target = {key: value for key, value in asked.items() if key != "pressure"}
    batch = cases.batch_of(cases.Case(scene, asked.get("pressure"), ""), designs)
    main = next(iter(scene.OBSERVABLES))

    def solve(scene, pressure):
        solution = sg.solve(scene, pressure) if "pressure" in asked else sg.pressure_for(scene, **target)
        return jnp.sum(solution.observables[main] if "pressure" in asked else solution.pressure), solution

    def one(scene, pressure):
        (_, solution), slopes = jax.value_and_grad(solve, argnums=(0, 1), has_aux=True)(scene, pressure)
        ends = sg.limit_pressure(scene) if "pressure" in asked else solution.pressure
        by = [jnp.sum(a * b) for a, b in zip(*map(jax.tree.leaves, ((scene, pressure), slopes)), strict=True)]
        return {"status": solution.status, "limit": ends, "derivative": jnp.stack(by)} | {
            f"value {key}": value for key, value in solution.observables.items()
        }

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(*batch))


def _differences(here: dict[str, np.ndarray], there: dict[str, np.ndarray]) -> dict[str, Any]:
    """The largest differences, over the size of what they are differences of."""
    ok = np.isin(here["status"], [sg.Status.OK, sg.Status.NO_CONTACT])
    told = {
        "designs": len(ok),
        "ok": int(np.sum(ok)),
        "statuses_differ": int(np.sum(here["status"] != there["status"])),
    }

    def largest(a: np.ndarray, b: np.ndarray) -> float:
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return float("inf")
        differ = ~np.isnan(a) & (a != b)
        size = np.max(np.abs(a), where=np.isfinite(a), initial=0.0)
        return float(np.max(np.abs(a[differ] - b[differ]) / size, initial=0.0))

    values = [largest(here[key], there[key]) for key in here if key.startswith("value ")]
    slopes = largest(here["derivative"], there["derivative"])
    return told | {"value": max(values), "limit": largest(here["limit"], there["limit"]), "derivative": slopes}


if __name__ == "__main__":
    np.savez(sys.argv[1], **answers("quick" in sys.argv[2:]))  # pyright: ignore[reportArgumentType]
