"""The shell on a plane by arcs, by energy and by finite elements: what a solve costs, and how far it is off.

    python benchmarks/energy_shell.py [--json]

Shell 32 x 86 x 1.1 mm, neo-Hookean, mu 175 kPa, a frictionless plane 5 mm above it. `rows()` gives the same as data.
Times are CPU seconds of this process (all cores that it uses together; bind it to one), compiled, the least of several
runs: cold from the flat membrane, warm from the solution at 12 kPa to 12.5 kPa, in a batch of pressures and of designs.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.shell.obstacles import Plane
from softgrip_jax.units import kPa, mm

FE_FORCE = {5: 3.3115, 10: 11.2138, 15: 20.7274, 20: 31.3090}
"""N at kPa: Q2/Q1 solids, nearly incompressible, clamped (FElupe 11.3, computed for this project; 0.5 %)."""
FE_SECONDS = 193.0
"""CPU time of that curve on its finest mesh."""
BASES = ((3, 4), (4, 6), (6, 6))
"""Polynomials of the height, across and along: 48 unknowns at (4, 6)."""
BATCH, REPEATS = 256, 5
COLD, WARM = 12 * kPa, 12.5 * kPa


def rows() -> list[dict[str, Any]]:
    """One row per model: model, unknowns, seconds (cold, warm, batched over pressures and designs), error_percent."""
    found = [_row("arcs", 1, lambda shell, gap: sg.shell.FlatContact(shell, distance=gap))]
    for across, along in BASES:

        def make(shell, gap, across=across, along=along):
            return sg.shell.ObstacleContact(shell, Plane(gap), symmetry="both", across=across, lengthwise=along)

        scene = make(_shell(), 5 * mm)
        found.append(_row(f"energy, {across} x {along} polynomials", scene.functional.size, make))
    curve = {"cold_s": FE_SECONDS / len(FE_FORCE), "warm_s": None, "pressures_s": None, "designs_s": None}
    none = dict.fromkeys(FE_FORCE, 0.0)
    return [*found, {"model": "finite elements", "unknowns": None, **curve, "error_percent": none}]


def _shell(a: Any = 16 * mm, b: Any = 43 * mm, t_m: Any = 1.1 * mm, mu: Any = 175 * kPa) -> sg.FlatShell:
    return sg.FlatShell(a=a, b=b, t_m=t_m, material=sg.NeoHookean(mu=mu))


def _row(model: str, unknowns: int, make: Callable[[sg.FlatShell, Any], Any]) -> dict[str, Any]:
    scene = make(_shell(), 5 * mm)
    one = jax.jit(sg.solve)
    error = {p: 100 * (float(one(scene, p * kPa).force) / force - 1) for p, force in FE_FORCE.items()}

    def design(u):
        shell = _shell((13 + 5 * u[0]) * mm, (38 + 8 * u[1]) * mm, (0.9 + 0.5 * u[2]) * mm, (150 + 50 * u[3]) * kPa)
        return sg.solve(make(shell, (4 + 2 * u[4]) * mm), COLD)

    pressures, designs = jnp.linspace(6, 20, BATCH) * kPa, np.random.default_rng(0).uniform(size=(BATCH, 5))
    over_pressures = jax.jit(jax.vmap(sg.solve, in_axes=(None, 0)))
    return {
        "model": model,
        "unknowns": unknowns,
        "cold_s": _seconds(one, scene, COLD),
        "warm_s": _warm(scene) if unknowns > 1 else None,
        "pressures_s": _seconds(over_pressures, scene, pressures) / BATCH,
        "designs_s": _seconds(jax.jit(jax.vmap(design)), jnp.asarray(designs)) / BATCH,
        "error_percent": error,
    }


def _warm(scene: Any) -> float:
    """From a solution and its tangent."""

    @jax.jit
    def begin(scene, pressure):
        guess = scene.first_guess(jnp.ones_like(pressure))
        return scene.find_from(scene.rest(), jnp.zeros_like(pressure), guess, pressure)

    @jax.jit
    def go(scene, start, load, slope, pressure):
        return scene.find_from(start, load, slope, pressure)[0]

    _, *known = begin(scene, jnp.asarray(COLD))
    return _seconds(go, scene, *known, jnp.asarray(WARM))


def _seconds(program: Callable[..., Any], *args: Any) -> float:
    jax.block_until_ready(program(*args))
    spent = []
    for _ in range(REPEATS):
        began = time.process_time()
        jax.block_until_ready(program(*args))
        spent.append(time.process_time() - began)
    return min(spent)


def report(found: list[dict[str, Any]]) -> str:
    """The rows as a table in Markdown."""

    def milliseconds(seconds: float | None) -> str:
        return "-" if seconds is None else f"{1e3 * seconds:.3g}"

    lines = [
        "| model | unknowns | cold (ms) | warm (ms) | batch of pressures (ms each) | batch of designs (ms each) | "
        + " | ".join(f"{p} kPa" for p in FE_FORCE)
        + " |",
        "|---" * (6 + len(FE_FORCE)) + "|",
    ]
    for row in found:
        times = [milliseconds(row[name]) for name in ("cold_s", "warm_s", "pressures_s", "designs_s")]
        errors = [f"{row['error_percent'][p]:+.1f} %" for p in FE_FORCE]
        lines.append("| " + " | ".join([row["model"], str(row["unknowns"] or "-"), *times, *errors]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    measured = rows()
    print(json.dumps(measured, indent=2) if "--json" in sys.argv else report(measured))
