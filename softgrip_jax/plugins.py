"""What other packages add to the command `softgrip`: commands, sections of configs and tabs of the
explorer, found by entry points.

A package names them in its pyproject.toml, as `optim` does; nothing here knows of it:

    [project.entry-points."softgrip_jax.commands"]
    design = "optim.cli:design"                        # a function as typer takes it

    [project.entry-points."softgrip_jax.sections"]
    design = "optim.design.settings:DesignTable"       # the pydantic model of [design]
"""

from __future__ import annotations

import functools
from importlib.metadata import entry_points
from typing import Any

COMMANDS = "softgrip_jax.commands"
"""The group of commands."""
SECTIONS = "softgrip_jax.sections"
"""The group of sections of configs."""


@functools.cache
def found(group: str) -> dict[str, Any]:
    """The entry points of a group by name; each is imported by its `load()`, and not before. Their type is that of
    importlib.metadata, or of importlib_metadata where that is installed: it takes the place of the other."""
    return {point.name: point for point in entry_points(group=group)}
