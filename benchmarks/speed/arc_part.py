"""How far arcs are from the energy membrane, over random neo-Hookean shells: what nine in ten of them keep.

Finite elements of single shells (`model_part`) are within 2 % of the energy membrane on planes and cylinders, and
within 11 % on a plane that leans; hundreds of shells by elements would take weeks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.model_error import PLACES, SIDES, THICKNESSES
from softgrip_jax.units import gram, kPa, mm

FIELDS = ("quantity", "shells", "low", "median", "high")
"""Arcs over energy, less one: in the middle of the shells, and what 5 of 100 are below and above."""
SHELLS = 150
MU = 175 * kPa
LARGEST = 4.0
"""Pressures (mu t_m / a) of membranes that have no limit there end at this."""


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """A row for each quantity."""
    count = 6 if quick else SHELLS
    for quantity, make in SCENES.items():
        if not quick or quantity == "shell, free: inflation":
            shares = _shares(quantity.rpartition(": ")[2], make, _designs(count))
            low, median, high = np.quantile(shares, [0.05, 0.5, 0.95]) - 1
            yield dict(zip(FIELDS, (quantity, len(shares), low, median, high), strict=True))


def _designs(count: int) -> dict[str, Any]:
    """Half sides, thickness, gap, radius, angle, mass, and where between first contact and limit the pressure is."""
    random = np.random.default_rng(7)
    a = random.uniform(8, 24, count) * mm
    return {
        "a": a,
        "b": a * random.uniform(*SIDES, count),
        "t_m": a * random.uniform(*THICKNESSES, count),
        "gap": a * random.uniform(*PLACES["gap"], count),
        "radius": a * random.uniform(*PLACES["radius"], count),
        "mass": random.uniform(50, 700, count) * gram,
        "angle": random.uniform(*PLACES["angle"], count),
        "part": random.uniform(0.15, 0.8, count),
    }


def _shell(x: Any, b: str = "b") -> sg.FlatShell:
    return sg.FlatShell(a=x["a"], b=x[b], t_m=x["t_m"], material=sg.NeoHookean(mu=MU))


SCENES: dict[str, Callable[[Any, str], Any]] = {
    "shell, free: inflation": lambda x, model: sg.shell.Free(_shell(x), model=model),
    "shell on a plane: force": lambda x, model: sg.shell.FlatContact(_shell(x), distance=x["gap"], model=model),
    "shell on a leaning plane: force": lambda x, model: sg.shell.InclinedContact(
        _shell(x, "a"), distance=x["gap"], angle=x["angle"], model=model
    ),
    "shell on a cylinder: force": lambda x, model: sg.shell.CylinderContact(
        _shell(x), radius=x["radius"], gap=x["gap"], model=model
    ),
    "shell's grasp: pressure": lambda x, model: sg.shell.Grasp(
        _shell(x), radius=x["radius"], gap=x["gap"], mass=x["mass"], friction=0.9, model=model
    ),
}
"""By the quantity: (a design, the model) -> scene. The last one is asked for the pressure that it requires."""


def _shares(observable: str, make: Callable[[Any, str], Any], designs: dict[str, Any]) -> np.ndarray:
    """Arcs over energy where both have an answer."""

    def every(function: Callable[..., Any], *given: Any) -> Any:
        return jax.jit(jax.vmap(function))(designs, *given)

    if observable == "pressure":
        pair = [every(lambda x, model=model: sg.pressure_for(make(x, model))) for model in ("arc", "energy")]
    else:
        scale = jnp.asarray(MU * designs["t_m"] / designs["a"])
        limit = jnp.minimum(every(lambda x: sg.limit_pressure(make(x, "arc"))), LARGEST * scale)
        touches = "force" in observable
        onset = every(lambda x: sg.contact_pressure(make(x, "arc"))) if touches else jnp.zeros_like(limit)
        pressures = onset + designs["part"] * (limit - onset)
        pair = [every(lambda x, p, model=model: sg.solve(make(x, model), p), pressures) for model in ("arc", "energy")]
    good = np.all([np.asarray(one.status) == sg.Status.OK for one in pair], axis=0)
    arcs, energy = (np.asarray(getattr(one, observable))[good] for one in pair)
    return arcs / energy
