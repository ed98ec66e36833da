"""The catalogue of scenes that every general check runs over, and the tools that the checks share.

A new scene is one line in CASES: it then meets every check of derivatives, batching and limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

import softgrip_jax as sg
from softgrip_jax.objects.friction import FrictionTable
from softgrip_jax.units import gram, kPa, mm

# One of each energy, all of the order of the thesis's silicone; the Yeoh stiffens, the Gent locks.
MATERIALS: dict[str, Callable[[], sg.materials.Material]] = {
    "neo": lambda: sg.NeoHookean(mu=175 * kPa),
    "mooney": lambda: sg.MooneyRivlin(c1=80 * kPa, c2=7 * kPa),
    "yeoh": lambda: sg.Yeoh(c1=85 * kPa, c2=-1.5 * kPa, c3=0.4 * kPa),
    "gent": lambda: sg.Gent(mu=170 * kPa, j_m=40.0),
    "ogden": lambda: sg.Ogden(mu=np.array([120 * kPa, 4 * kPa, -6 * kPa]), alpha=np.array([1.6, 5.0, -2.1])),
}


def shell(material: str = "neo", a=16 * mm, b=43 * mm, t_m=1.1 * mm) -> sg.FlatShell:
    """The thesis's shell (section 5.1), of any material of the catalogue."""
    return sg.FlatShell(a=a, b=b, t_m=t_m, material=MATERIALS[material]())


def cheap(scene: sg.Scene) -> sg.Scene:
    """A scene of the energy membrane on the smallest basis that bulges."""
    return replace(scene.prepared(), across=2, lengthwise=2)


@dataclass(frozen=True)
class Case:
    """A scene with a pressure at which it is OK, and the observable that `pressure_for` is asked for."""

    name: str
    make: Callable[[], sg.Scene]
    pressure: float
    target: str
    has_limit: bool = True
    slow: bool = False
    """Whether all its derivatives take more than a minute to compile."""

    def __str__(self) -> str:
        return self.name


FRICTION = FrictionTable(force=np.array([0.5, 2.0, 6.0, 30.0]), coefficient=np.array([1.6, 1.2, 0.9, 0.7]))
ROD = {"radius": 20 * mm, "gap": 5 * mm}

CASES = [
    Case("free", lambda: sg.shell.Free(shell()), 12 * kPa, "inflation"),
    Case("free-gent", lambda: sg.shell.Free(shell("gent")), 12 * kPa, "stretch", has_limit=False),
    # In contact it has kinks where contact points come and go: see test_energy.py and test_energy_contacts.py.
    Case("free-energy", lambda: cheap(sg.shell.Free(shell(), model="energy")), 12 * kPa, "inflation", slow=True),
    Case("plate", lambda: sg.shell.Plate(shell("mooney")), 2 * kPa, "inflation", has_limit=False),
    Case("flat-yeoh", lambda: sg.shell.FlatContact(shell("yeoh"), distance=5 * mm), 15 * kPa, "force"),
    # Nearly square: differences step both sides, and a longer than b is impossible.
    Case(
        "inclined-gent",
        lambda: sg.shell.InclinedContact(shell("gent", a=7.5 * mm, b=8 * mm), distance=5 * mm, angle=0.17),
        50 * kPa,
        "force",
        slow=True,
    ),
    Case(
        "inclined-parallel",
        lambda: sg.shell.InclinedContact(shell("neo", a=7.5 * mm, b=8 * mm), distance=5 * mm, angle=0.0),
        55 * kPa,
        "force",
    ),
    Case("cylinder-mooney", lambda: sg.shell.CylinderContact(shell("mooney"), **ROD), 15 * kPa, "force_z", slow=True),
    Case("cylinder", lambda: sg.shell.CylinderContact(shell(), **ROD), 15 * kPa, "flat_length"),
    Case("offset-ogden", lambda: sg.shell.AxialOffset(shell("ogden"), height=40 * mm, **ROD), 8 * kPa, "force"),
    Case(
        "grasp-table",
        lambda: sg.shell.Grasp(shell(), mass=563 * gram, friction=FRICTION, **ROD),
        12 * kPa,
        "security",
    ),
    Case(
        "grasp-eccentric",
        lambda: sg.shell.Grasp(shell(), mass=263 * gram, friction=1.3, eccentricity=5 * mm, **ROD),
        12 * kPa,
        "security",
        slow=True,
    ),
    Case(
        "grasp-rim",
        lambda: sg.shell.Grasp(shell("gent"), mass=263 * gram, friction=1.3, eccentricity=5 * mm, lever="rim", **ROD),
        12 * kPa,
        "tilt_resistance",
        slow=True,
    ),
]


@cache
def reference(case: Case) -> tuple[sg.Scene, dict[str, np.ndarray]]:
    """The scene of a case and its observables, solved once."""
    scene = case.make()
    solution = sg.solve(scene, case.pressure)
    assert sg.Status(int(solution.status)) is sg.Status.OK, case.name
    return scene, {name: np.asarray(value) for name, value in solution.observables.items()}


def relative(case: Case, inverse: bool) -> tuple[int, Callable[[jax.Array], jax.Array]]:
    """(n, f): f takes n relative changes of every float leaf and, last, of the pressure or the target.

    f returns every observable at the pressure, or (inverse) the pressure for the target and the limit pressure where
    there is one, each divided by its value at no change, so that all derivatives are of order one.
    """
    scene, observed = reference(case)
    leaves, rebuild = ravel_pytree(scene)
    value = observed[case.target]
    limit = np.asarray(sg.limit_pressure(scene))
    names = [name for name, seen in observed.items() if np.all(np.isfinite(seen)) and np.all(seen != 0)]

    def f(change):
        changed = rebuild(leaves * (1 + change[:-1]))
        if not inverse:
            solution = sg.solve(changed, case.pressure * (1 + change[-1]))
            return jnp.concatenate([jnp.ravel(solution.observables[name] / observed[name]) for name in names])
        solution = sg.pressure_for(changed, **{case.target: value * (1 + change[-1])})
        out = [solution.pressure[None] / case.pressure]
        if case.has_limit:
            out.append(sg.limit_pressure(changed)[None] / limit)
        return jnp.concatenate(out)

    return leaves.size + 1, f


# Central differences of sixth order: sum of WEIGHTS * f(x + k h) / h.
STENCIL = np.array([-3, -2, -1, 1, 2, 3])
WEIGHTS = np.array([-1, 9, -45, 45, -9, 1]) / 60


def stencil(n: int, h: float) -> jax.Array:
    """The points that `differences` needs around zero: STENCIL along each of n coordinates."""
    return jnp.asarray((np.eye(n)[:, None, :] * STENCIL[:, None] * h).reshape(-1, n))


def differences(values: jax.Array, n: int, h: float) -> np.ndarray:
    """Derivatives at zero of a function given at the points of `stencil`; the index of the coordinate comes last."""
    values = np.asarray(values)
    return np.moveaxis(
        np.tensordot(WEIGHTS / h, values.reshape(n, STENCIL.size, *values.shape[1:]), axes=(0, 1)), 0, -1
    )
