"""The finger with its tip held by each law of what drives it: what a state costs, and how far the model is off.

Type A of the thesis, tip held at the clamp's height, no weight. The tip force of finite elements is that of a beam that
has the law of the elements at every section (docs/theory/cell.md), the moment that of the straight cell.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.units import N_mm, kPa

from . import cases
from .measure import compiled, median_seconds

TIP_FORCE = {5: 0.028, 10: 0.081, 15: 0.148, 20: 0.231, 25: 0.340, 31: 0.573}
"""kPa: N."""
STRAIGHT = {5: 1.447641, 15: 7.385981, 31: 21.5627}
"""kPa: N mm, of the cell without curvature (benchmarks/cell/finite_elements.csv)."""
FE_SECONDS = 360.0
"""A state of the whole finger as one solid (benchmarks/whole_finger.py), on two cores."""
DRIVES = {
    "arcs, the thesis's": {"drive": "thesis"},
    "arcs without the root of (4.39)": {"drive": "thesis", "moment_spread": "none"},
    "cell law": {"drive": "cell"},
}
BATCH, COLD = 256, 15 * kPa
ERRORS = (*(f"force_{p}_kPa" for p in TIP_FORCE), *(f"moment_{p}_kPa" for p in STRAIGHT))
FIELDS = ("model", "cold_s", "designs_s", "gradient", "compile_s", *ERRORS)
"""Seconds per solve, times of a value for value and gradient; errors against finite elements, in percent."""
VARIED = ("a", "h_x", "t_m", "H", "L")


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """One row per model."""
    for model, choices in DRIVES.items():
        yield _row(model, choices, 16 if quick else BATCH)
    yield {"model": "finite elements", "cold_s": FE_SECONDS} | dict.fromkeys(ERRORS, 0.0)


def held(choices: dict[str, Any], factors: Any = None) -> sg.pneunet.TipContact:
    """Type A, or one with lengths times factors."""
    finger = sg.PneuNet.table_5_1("A")
    if factors is not None:
        moved = {name: getattr(finger, name) * factors[k] for k, name in enumerate(VARIED)}
        finger = dataclasses.replace(finger, **moved)
    return sg.pneunet.TipContact(finger, **choices, **cases.ALL_RULES)


def _row(model: str, choices: dict[str, Any], size: int) -> dict[str, Any]:
    scene, cold = held(choices), jnp.asarray(COLD)
    one = compiled(sg.solve, scene, cold)
    states = {p: one.call(scene, jnp.asarray(p * kPa)) for p in {*TIP_FORCE, *STRAIGHT}}
    forces = [100 * (float(states[p].tip_force) / force - 1) for p, force in TIP_FORCE.items()]
    # Of arcs the moment is the same everywhere; of cells it is that of a straight segment.
    moments = [100 * (float(states[p].end_moment) / N_mm / moment - 1) for p, moment in STRAIGHT.items()]
    designs = jnp.asarray(np.random.default_rng(0).uniform(0.95, 1.05, (size, len(VARIED))))

    def force(factors):
        return sg.solve(held(choices, factors), COLD).tip_force

    several = compiled(jax.vmap(force), designs)
    sloped = compiled(jax.vmap(jax.value_and_grad(force)), designs)
    seconds = median_seconds(lambda: several.call(designs))
    numbers = {
        "cold_s": median_seconds(lambda: one.call(scene, cold)),
        "designs_s": seconds / size,
        "gradient": median_seconds(lambda: sloped.call(designs)) / seconds,
        "compile_s": one.seconds,
    }
    return {"model": model} | numbers | dict(zip(ERRORS, [*forces, *moments], strict=True))
