"""One finger, one law: scenes of one search that share a finger (or a shell) must treat it alike.

A search over several scenes asks several questions about one actuator. Where the scenes describe it by different laws
(chamber walls that incline in one and stay parallel in the other, for instance) the answer is of no finger at all.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import softgrip_jax as sg
from softgrip_jax.errors import InputError
from softgrip_jax.laws import laws_of, parts_of

from .space import Space

ACTUATORS = {sg.PneuNet: "finger", sg.FlatShell: "shell"}
"""What is shared, and what people call it."""


def differing_laws(space: Space) -> list[str]:
    """A sentence for every pair of scenes that share an actuator and treat it by different laws."""
    scenes, said = space.scenes, []
    shared = _moved_together(space) if len(scenes) > 1 else []
    for one, other, what in shared:
        mine, theirs = laws(scenes[one]), laws(scenes[other])
        differing = [
            f"{law} is {mine[law]!r} in {one} and {theirs[law]!r} in {other}"
            for law in mine
            if law in theirs and mine[law] != theirs[law]
        ]
        if differing:
            said.append(
                f"The scenes {one} and {other} share a {what}, but treat it by different laws: {', '.join(differing)}."
            )
    return said


def require_one_law(space: Space) -> None:
    """An InputError where scenes treat what they share by different laws."""
    sentences = differing_laws(space)
    if sentences:
        raise InputError(f"{sentences[0][:-1]}; give them the same, or set different_laws = true.")


def laws(scene: Any) -> dict[str, Any]:
    """The laws of a scene by name, and the material models of its actuators."""
    made = [type(node.material).__name__ for node in parts_of(scene) if isinstance(node, tuple(ACTUATORS))]
    return laws_of(scene) | ({"material": made[-1]} if made else {})


def _moved_together(space: Space) -> list[tuple[str, str, str]]:
    """(scene, other scene, what they share) of all pairs in which one variable moves the actuators of both."""
    moved: dict[str, dict[type, set[int]]] = {name: {} for name in space.scenes}
    for k in range(space.size):
        # Where the scenes hold NaN in place of the variable, the variable is.
        marked = space.scenes_at(jnp.asarray(np.where(np.arange(space.size) == k, np.nan, space.reference)))
        for name, scene in marked.items():
            for node in parts_of(scene):
                if isinstance(node, tuple(ACTUATORS)) and any(np.isnan(v).any() for v in jax.tree.leaves(node)):
                    moved[name].setdefault(type(node), set()).add(k)
    names = list(moved)
    return [
        (one, other, ACTUATORS[next(base for base in ACTUATORS if issubclass(cls, base))])
        for i, one in enumerate(names)
        for other in names[i + 1 :]
        for cls in moved[one]
        if moved[one][cls] & moved[other].get(cls, set())
    ]
