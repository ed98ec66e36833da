"""By which laws a scene treats its actuator: numbers that were found by one belong to that one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

NO_LAWS = ("symmetry", "hold", "searching")
"""Choices that say how a scene is computed, or what holds the finger, and not how the actuator behaves."""

IDLE = {
    ("drive", "cell"): ("section", "inclination", "combination", "moment_spread"),
    ("drive", "small_strain"): ("inclination",),
    ("model", "arc"): ("bending",),
}
"""Choices that have no part beside others."""


def laws_of(scene: Any) -> dict[str, Any]:
    """The choices of a scene and its parts that say how the actuator behaves, by name: drive, model, inclination."""
    found: dict[str, Any] = {}
    for node in parts_of(scene):
        if hasattr(node, "MODEL"):
            found.setdefault("model", node.MODEL)
        for field in dataclasses.fields(node):
            value = getattr(node, field.name)
            if ("allowed" in field.metadata or isinstance(value, bool)) and field.name not in NO_LAWS:
                # What is neither a name nor a switch is a law that somebody wrote.
                found.setdefault(field.name, value if isinstance(value, str | bool) else type(value).__name__)
    idle = {name for (law, value), names in IDLE.items() if found.get(law) == value for name in names}
    return {name: value for name, value in found.items() if name not in idle}


def parts_of(module: Any) -> Iterator[Any]:
    """A module and all parts of it."""
    if dataclasses.is_dataclass(module) and not isinstance(module, type):
        yield module
        for field in dataclasses.fields(module):
            yield from parts_of(getattr(module, field.name))
