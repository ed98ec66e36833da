"""The problems that all methods solve: scenes, batches of designs around them, and what is asked of a solution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax import questions
from softgrip_jax import scene as scene_module
from softgrip_jax.reasons import RULE_NAMES
from softgrip_jax.units import gram, kPa, mm

SPREAD = 0.05
"""Designs of a batch: every number of the scene within 5 % of the thesis's."""
JUDGED = 16
"""Errors are the largest of so many designs."""
SEED = 7
ALL_RULES = {"ignored_rules": RULE_NAMES}
"""Methods are compared on the equations: no finger is left out for what cannot be moulded or overlaps."""


class Case(NamedTuple):
    """A scene at a pressure, and the observable that counts; without a pressure, the one that its task needs."""

    scene: sg.Scene
    pressure: float | None
    observable: str


def shell() -> sg.FlatShell:
    """The thesis's shell, section 5.1."""
    return sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))


def shells() -> dict[str, Case]:
    """Free, on a plane, around a cylinder, at 15 kPa."""
    return {
        "shell free": Case(sg.shell.Free(shell()), 15 * kPa, "inflation"),
        "shell flat": Case(sg.shell.FlatContact(shell(), distance=5 * mm), 15 * kPa, "force"),
        "shell cylinder": Case(sg.shell.CylinderContact(shell(), radius=20 * mm, gap=5 * mm), 15 * kPa, "force_z"),
    }


def tip_contact(section: str = "exact", points: int = 12) -> Case:
    """The thesis's blocked finger of type A; 27 kPa is two thirds of the largest pressure."""
    finger = sg.PneuNet.table_5_1("A")
    scene = sg.pneunet.TipContact(finger, section=section, points=points, **ALL_RULES)
    return Case(scene, 27 * kPa, "tip_force")


def free_finger(section: str = "exact", points: int = 12) -> Case:
    """Type A under its weight; parallel walls, so that the peers solve the same."""
    finger = sg.PneuNet.table_5_1("A")
    free = sg.pneunet.Free(finger, section=section, inclination="none", points=points, **ALL_RULES)
    return Case(free, 27 * kPa, "tip_angle")


def grasp(section: str = "exact", points: int = 12) -> Case:
    """Three fingers of type A hold the thesis's cylinder of 26 g: the pressure that they need. Mid-lines touch, as in
    the thesis and in the peers."""
    gripper = sg.pneunet.Gripper(sg.PneuNet.table_5_1("A"), n=3, base_radius=19.61 * mm, touch="midline")
    held = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
    scene = sg.pneunet.Grasp(gripper, held, section=section, points=points, **ALL_RULES)
    return Case(scene, None, "pressure")


class Batch(NamedTuple):
    """Designs and pressures, one per lane."""

    scene: Any
    pressure: jax.Array

    def lanes(self, n: int) -> Batch:
        """The first n."""
        return jax.tree.map(lambda leaf: leaf[:n], self)

    def one(self, k: int) -> Batch:
        """One of them."""
        return jax.tree.map(lambda leaf: leaf[k], self)


def batch_of(case: Case, n: int) -> Batch:
    """n designs around a case; the first is the case itself, and every batch begins with the same designs."""
    rng = np.random.default_rng(SEED)
    leaves, kind = jax.tree.flatten(case.scene)
    factors = np.exp(rng.uniform(-SPREAD, SPREAD, (n, len(leaves) + 1)))
    factors[0] = 1.0
    many = [
        jnp.asarray(np.broadcast_to(leaf, (n, *np.shape(leaf))) * factors[:, k].reshape(n, *[1] * np.ndim(leaf)))
        for k, leaf in enumerate(leaves)
    ]
    pressure = (case.pressure or 1.0) * factors[:, -1]
    return Batch(jax.tree.unflatten(kind, many), jnp.asarray(pressure))


def value_of(case: Case) -> Callable[[Any, Any], jax.Array]:
    """(scene, pressure) -> the observable, by what `solve` and `pressure_for` do.

    Their inner functions, so that float32 can be measured (the public ones refuse it) and no program is shared.
    """

    def value(scene, pressure):
        if case.pressure is None:
            return questions.equilibrium_reaching.__wrapped__(scene, *scene.target()).pressure
        return scene_module.equilibrium.__wrapped__(scene, pressure).observables[case.observable]

    return value


def value_and_gradient(case: Case) -> Callable[[Any, Any], tuple[jax.Array, Any]]:
    """The observable with its derivatives by every number of the scene, and by the pressure where it is given."""
    return jax.value_and_grad(value_of(case), argnums=(0, 1) if case.pressure is not None else 0)


def elasticities(batch: Batch, values: Any, gradients: Any, given: bool) -> np.ndarray:
    """d log(observable) / d log(number) of every lane: gradients as pure numbers."""
    numbers = jax.tree.leaves(batch if given else batch.scene)
    values = np.asarray(values, float)
    columns = []
    for number, slope in zip(numbers, jax.tree.leaves(gradients), strict=True):
        part = np.asarray(number, float) * np.asarray(slope, float)
        columns.append(part.reshape(len(values), -1).sum(axis=1) / values)
    return np.stack(columns, axis=1)


def errors(values: Any, slopes: Any, true: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Largest relative error of values; largest error of elasticities, over the largest of the design."""
    value, slope = true
    count = min(len(value), len(np.atleast_1d(values)), JUDGED)
    of_value = np.max(np.abs(np.asarray(values)[:count] / value[:count] - 1))
    if slopes is None:
        return float(of_value), float("nan")
    size = np.max(np.abs(slope[:count]), axis=1)
    return float(of_value), float(np.max(np.max(np.abs(slopes[:count] - slope[:count]), axis=1) / size))
