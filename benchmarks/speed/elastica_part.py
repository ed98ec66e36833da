"""PyElastica, relaxed to rest: a free finger under its weight, and one with a force on its tip."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from softgrip_jax import pneunet, solve
from softgrip_jax.units import kPa

from . import elastica_peer
from .measure import clock, row

RUNS = ((10, 2.0), (20, 2.0), (40, 2.0), (80, 2.0))
"""Elements, and simulated seconds: two are enough to come to rest, as longer runs show."""


PRESSURE, TIP_LOAD = 20 * kPa, 0.03
"""Where there is one equilibrium only, which a swinging rod then finds; N."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """Distance between tips over the length, against our linear section."""
    finger = pneunet.PneuNet.table_5_1("A")
    built = {name: float(getattr(finger, name)) for name in ("H", "B", "L")} | {"mu": float(finger.material.mu)}
    tasks = {"finger free": ((0.0, -2.0), None), "finger with a force on its tip": (None, (0.0, TIP_LOAD))}
    solved = {
        name: solve(
            pneunet.Free(finger, section="inextensible", inclination="none", weight=weight, tip_load=load), PRESSURE
        )
        for name, (weight, load) in tasks.items()
    }
    began = clock()
    elastica_peer.relaxed(built, 0.0, 0.0, 0.0, 4, 0.01)
    compiling = clock() - began
    for name, (weight, load) in tasks.items():
        moment, true = float(solved[name].end_moment), np.asarray(solved[name].tip)
        for elements, seconds in RUNS[:1] if quick else RUNS:
            began = clock()
            tip = elastica_peer.relaxed(
                built, moment, weight[1] if weight else 0.0, load[1] if load else 0.0, elements, seconds
            )
            spent = clock() - began
            error = float(np.linalg.norm(np.asarray(tip) - true)) / built["L"]
            yield row(
                name, "PyElastica, relaxed", f"{elements} elements, {seconds:g} s", error=error, seconds=spent,
                compile_seconds=compiling,
            )  # fmt: skip
