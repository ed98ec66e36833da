"""Every scene x material x question: derivatives by every number, forward mode against sixth-order differences.

The error is given over the largest elasticity of the same question, so 1e-7 means seven digits of what matters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from helpers import MATERIALS, differences, shell, stencil
from jax.flatten_util import ravel_pytree

import softgrip_jax as sg
from softgrip_jax.units import gram, kPa, mm

STEP = 2e-3
"""Of the differences, relative: their truncation is of order 1e-16 of the seventh derivative, their rounding 1e-12."""
WORST = 1e-7
MIDDLE = 0.6
"""Of the way from contact to the limit: where states are looked at."""
HIGH = 3.0
"""The pressure in units of the first contact's where there is no limit."""

ROD = {"radius": 20 * mm, "gap": 5 * mm}

SHELLS: dict[str, Callable[[str], sg.Scene]] = {
    "Free": lambda m: sg.shell.Free(shell(m)),
    "FlatContact": lambda m: sg.shell.FlatContact(shell(m), distance=5 * mm),
    "InclinedContact": lambda m: sg.shell.InclinedContact(shell(m, a=7.5 * mm, b=8 * mm), distance=5 * mm, angle=0.17),
    "CylinderContact": lambda m: sg.shell.CylinderContact(shell(m), **ROD),
    "AxialOffset": lambda m: sg.shell.AxialOffset(shell(m), height=40 * mm, **ROD),
    "Grasp": lambda m: sg.shell.Grasp(shell(m), mass=263 * gram, friction=1.3, eccentricity=5 * mm, **ROD),
    "FlatContact far": lambda m: sg.shell.FlatContact(shell(m), distance=30 * mm),
}


def finger(material: str) -> sg.PneuNet:
    sizes = {"a": 5, "b": 8, "h_x": 0.9, "t_m": 1.1, "h_L": 4.2, "H": 5, "B": 20, "L": 77}
    return sg.PneuNet(**{k: v * mm for k, v in sizes.items()}, material=MATERIALS[material]())


FINGERS: dict[str, Callable[[str], sg.Scene]] = {
    "pneunet.Chamber": lambda m: sg.pneunet.Chamber(finger(m), 0.05),
    "pneunet.Linear": lambda m: sg.pneunet.Linear(finger(m)),
    "pneunet.Free arcs": lambda m: sg.pneunet.Free(finger(m), weight=None),
    "pneunet.Free": lambda m: sg.pneunet.Free(finger(m), points=8, inclination="none"),
    "pneunet.TipContact": lambda m: sg.pneunet.TipContact(finger(m), points=8, tip_offset=-3 * mm, weight=(0.0, -1.0)),
    "pneunet.Grasp": lambda m: sg.pneunet.Grasp(
        sg.pneunet.Gripper(finger(m)), sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96), points=8
    ),
}

TARGETS = {"Free": "inflation", "pneunet.Free arcs": "tip_angle", "pneunet.Free": "tip_angle"}
"""What `pressure_for` is asked for, where it is no force."""


def catalogue() -> Iterator[tuple[str, str, sg.Scene]]:
    for name, make in (SHELLS | FINGERS).items():
        for material in MATERIALS:
            yield name, material, make(material)


def worst_errors(name: str, scene: sg.Scene) -> dict[str, float]:
    """Question -> worst error of a derivative, over the largest of the same question."""
    contact, limit = float(sg.contact_pressure(scene)), float(sg.limit_pressure(scene))
    if np.isfinite(limit) and limit > contact:
        pressure = contact + MIDDLE * (limit - contact)
    else:
        pressure = HIGH * contact if np.isfinite(contact) and contact > 0 else 12 * kPa
    solved = sg.solve(scene, pressure)
    is_ok = int(solved.status) == sg.Status.OK
    observed = {k: np.asarray(v) for k, v in solved.observables.items()}
    names = [k for k, v in observed.items() if is_ok and np.all(np.isfinite(v)) and np.all(v != 0)]
    target = next((k for k in (TARGETS.get(name), "tip_force", "force", "end_moment") if k in names), None)
    leaves, rebuild = ravel_pytree(scene)

    def answers(change: jax.Array) -> dict[str, jax.Array]:
        changed = rebuild(leaves * (1 + change[:-1]))
        out: dict[str, Any] = {}
        if is_ok:
            found = sg.solve(changed, pressure * (1 + change[-1]))
            out["solve"] = jnp.concatenate([jnp.ravel(found.observables[k] / observed[k]) for k in names])
        if target:
            back = sg.pressure_for(changed, **{target: observed[target] * (1 + change[-1])})
            out["pressure_for"] = back.pressure[None] / pressure
        if np.isfinite(limit):
            out["limit_pressure"] = sg.limit_pressure(changed)[None] / limit
        if np.isfinite(contact) and contact > 0:
            out["contact_pressure"] = sg.contact_pressure(changed)[None] / contact
        return out

    n = leaves.size + 1
    slopes = jax.jit(jax.jacfwd(answers))(jnp.zeros(n))
    values = jax.jit(lambda points: jax.lax.map(answers, points))(stencil(n, STEP))
    errors = {}
    for question, slope in slopes.items():
        by_differences = differences(values[question], n, STEP)
        errors[question] = float(np.max(np.abs(slope - by_differences)) / np.max(np.abs(by_differences)))
    return errors
