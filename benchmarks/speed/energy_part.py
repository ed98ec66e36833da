"""The shell on a plane by arcs, by energy and by finite elements: what a solve costs, and how far the model is off.

Shell 32 x 86 x 1.1 mm, neo-Hookean, mu 175 kPa, a frictionless plane 5 mm above it: cold from the flat membrane, warm
from the solution at 12 kPa to 12.5 kPa, and in batches of pressures and of unlike designs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.shell.obstacles import Plane
from softgrip_jax.units import kPa, mm

from .measure import compiled, median_seconds
from .model_part import ON_PLANE

FE_SECONDS, FE_STATES = 193.0, 4
"""CPU time of the curve of ON_PLANE on its finest mesh (FElupe 11.3, computed for this project), and its states."""
BASES = ((2, 3), (3, 4), (4, 6), (6, 6))
"""Polynomials of the height, across and along: 48 unknowns at (4, 6)."""
BATCH = 256
COLD, WARM = 12 * kPa, 12.5 * kPa
ERRORS = tuple(f"error_{pressure}_kPa" for pressure in ON_PLANE)
FIELDS = ("model", "unknowns", "cold_s", "warm_s", "pressures_s", "designs_s", "compile_s", *ERRORS)
"""Seconds per solve; errors of the force against finite elements, in percent."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """One row per model."""
    size = 16 if quick else BATCH
    yield _row("arcs", 1, lambda shell, gap: sg.shell.FlatContact(shell, distance=gap), size)
    for across, along in BASES[:1] if quick else BASES:

        def make(shell, gap, across=across, along=along):
            return sg.shell.ObstacleContact(shell, Plane(gap), symmetry="both", across=across, lengthwise=along)

        count = make(_shell(), 5 * mm).functional.size
        yield _row(f"energy, {across} x {along} polynomials", count, make, size)
    yield {"model": "finite elements", "cold_s": FE_SECONDS / FE_STATES} | dict.fromkeys(ERRORS, 0.0)


def _shell(a: Any = 16 * mm, b: Any = 43 * mm, t_m: Any = 1.1 * mm, mu: Any = 175 * kPa) -> sg.FlatShell:
    return sg.FlatShell(a=a, b=b, t_m=t_m, material=sg.NeoHookean(mu=mu))


def unlike(u: Any, make: Callable[[sg.FlatShell, Any], Any]) -> Any:
    """A design from five numbers between 0 and 1: half sides, thickness, stiffness and the gap."""
    shell = _shell((13 + 5 * u[0]) * mm, (38 + 8 * u[1]) * mm, (0.9 + 0.5 * u[2]) * mm, (150 + 50 * u[3]) * kPa)
    return make(shell, (4 + 2 * u[4]) * mm)


def _row(model: str, unknowns: int, make: Callable[[sg.FlatShell, Any], Any], size: int) -> dict[str, Any]:
    scene, cold = make(_shell(), 5 * mm), jnp.asarray(COLD)
    one = compiled(sg.solve, scene, cold)
    errors = [100 * (float(one.call(scene, jnp.asarray(p * kPa)).force) / force - 1) for p, force in ON_PLANE.items()]
    pressures = jnp.linspace(6, 20, size) * kPa
    many = compiled(jax.vmap(sg.solve, in_axes=(None, 0)), scene, pressures)
    designs = jnp.asarray(np.random.default_rng(0).uniform(size=(size, 5)))
    several = compiled(jax.vmap(lambda u: sg.solve(unlike(u, make), COLD)), designs)
    row = {
        "model": model,
        "unknowns": float(unknowns),
        "cold_s": median_seconds(lambda: one.call(scene, cold)),
        "pressures_s": median_seconds(lambda: many.call(scene, pressures)) / size,
        "designs_s": median_seconds(lambda: several.call(designs)) / size,
        "compile_s": one.seconds,
    }
    warm = {} if model == "arcs" else {"warm_s": _warm(scene)}
    return row | warm | dict(zip(ERRORS, errors, strict=True))


def _warm(scene: Any) -> float:
    """From a solution and its tangent."""

    def begin(scene, pressure):
        guess = scene.first_guess(jnp.ones_like(pressure))
        return scene.solver().find_from(scene, scene.unloaded_state(), jnp.zeros_like(pressure), guess, pressure)[1:]

    def go(scene, start, load, slope, pressure):
        return scene.solver().find_from(scene, start, load, slope, pressure)[0]

    known = jax.jit(begin)(scene, jnp.asarray(COLD))
    program = compiled(go, scene, *known, jnp.asarray(WARM))
    return median_seconds(lambda: program.call(scene, *known, jnp.asarray(WARM)))
