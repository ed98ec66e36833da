"""Random cells over the range that the cell law was fitted to, and two decades of pressure: every one has a state."""

from __future__ import annotations

import dataclasses
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.pneunet.cell import form, law
from softgrip_jax.units import mm

LEAST_CAVITY = 0.8 * mm
BACK, FORTH = -1.5, 5.0
"""Curvatures, over the one at which the rims of rigid neighbours meet: rims well pressed, and beyond free fingers."""
SMALL_STEP, AGREEMENT = 1e-4, 1e-4
"""Of the curvature, relative to the same; and of the slope by it, relative to the steepest of a cell."""
WORST: dict[str, tuple] = {}


def random_cells(draw, count: int):
    """(fields, curvatures, pressures), SI."""
    fields = {name: draw.uniform(*bounds, count) * mm for name, bounds in law.CHECKED.items()}
    fields["t_m"] = np.minimum(fields["t_m"], 0.5 * (fields["h_L"] - LEAST_CAVITY))
    fields = {name: jnp.asarray(value) for name, value in fields.items()}
    pressures = jnp.asarray(136e3 * 0.98 * law.LARGEST_PRESSURE * 10 ** draw.uniform(-2, 0, count))
    A = sg.PneuNet.table_5_1("A")
    unit = jax.vmap(lambda fields: form.rims_meet(law.sizes(dataclasses.replace(A, **fields))))(fields) / (20 * mm)
    return fields, unit * draw.uniform(BACK, FORTH, count), unit, pressures


def compiled():
    """The states of cells and the slope of their moment by the curvature, of a batch."""
    A = sg.PneuNet.table_5_1("A")

    def one(fields, curvature, pressure):
        def moment(curvature):
            found = sg.solve(sg.pneunet.Cell(dataclasses.replace(A, **fields), curvature=curvature), pressure)
            return found.moment, found

        slope, found = jax.grad(moment, has_aux=True)(curvature)
        return found.status, found.moment, found.contact_force, found.stretch, slope

    return jax.jit(jax.vmap(one))


def violations(draw, count: int, states) -> Counter:
    """What came back, and how many cells break which invariant."""
    fields, curvatures, unit, pressures = random_cells(draw, count)
    status, moment, force, stretch, slope = map(np.asarray, states(fields, curvatures, pressures))
    step = SMALL_STEP * unit
    ends = [np.asarray(states(fields, curvatures + sign * step, pressures)[1]) for sign in (1, -1)]
    differences = (ends[0] - ends[1]) / (2 * np.asarray(step))
    broken = {
        "not solved": status != sg.Status.OK,
        "not finite": ~(np.isfinite(moment) & np.isfinite(force) & np.isfinite(stretch)),
        "a wall that pulls": force < 0,
        "a strain that cannot be": np.abs(stretch - 1) > 0.5,
        "a slope that differences do not have": np.abs(slope - differences) > AGREEMENT * np.abs(differences).max(),
    }
    falling = int(np.sum(slope <= 0))
    for what, mask in broken.items():
        if mask.any() and what not in WORST:
            i = int(np.argmax(mask))
            lengths = [f"{n} {float(v[i]) * 1e3:.4g} mm" for n, v in fields.items()]
            where = [f"curvature {float(curvatures[i]):.4g} 1/m", f"pressure {float(pressures[i]):.6g} Pa"]
            WORST[what] = (*lengths, *where)
    said = {"designs": count, "with a moment that falls with the curvature (see docs/theory/cell.md)": falling}
    return Counter(said | {f"! {what}": int(mask.sum()) for what, mask in broken.items()})
