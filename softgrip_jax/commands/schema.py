"""`softgrip schema`: the JSON schema of configs, with the sections that other packages read."""

from __future__ import annotations

import json

from .. import plugins
from ..config.schema import schema
from .sensitivity import SensitivityTable
from .sweep import SweepTable


def schema_text() -> str:
    """The schema as JSON."""
    others = {name: point.load() for name, point in plugins.found(plugins.SECTIONS).items()}
    return json.dumps(schema({"sweep": SweepTable, "sensitivity": SensitivityTable} | others), indent=2)
