"""Our models beside finite elements: one row for each quantity at each state."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import pneunet, shell
from ..errors import CellRangeWarning
from ..questions import solve
from ..results import Status
from ..shell.flat_shell import ShellScene
from .run import Found, Target


class Row(NamedTuple):
    """One quantity at one state.

    Args:
        quantity: its name, as an observable's.
        kind: of its unit, a key of units.DISPLAY.
        pressure: Pa.
        curvature: of a finger's cell, 1/m; None elsewhere.
        models: name of a model -> its value in SI, NaN where it has none.
        elements: finite elements on the finest mesh, in SI.
        mesh_error: of them, in SI; None with one mesh.
        seconds: that the finite elements took for this state, on all meshes.
    """

    quantity: str
    kind: str
    pressure: float
    curvature: float | None
    models: dict[str, float]
    elements: float
    mesh_error: float | None
    seconds: float

    def difference(self, model: str) -> float:
        """Model over finite elements, less one, dimensionless; NaN where there is nothing to compare."""
        value = self.models.get(model, math.nan)
        return value / self.elements - 1 if self.elements else math.nan

    def as_data(self) -> dict[str, Any]:
        """As plain data, with None for what is not a finite number."""

        def plain(value: float | None) -> float | None:
            return value if value is not None and math.isfinite(value) else None

        return self._asdict() | {
            "models": {name: plain(value) for name, value in self.models.items()},
            "differences": {name: plain(self.difference(name)) for name in self.models},
        }


QUANTITIES = {
    "inflation": "length",
    "stretch": "number",
    "length_stretch": "number",
    "force": "force",
    "force_x": "force",
    "force_y": "force",
    "force_z": "force",
}
"""Of shells; what is not asked of a scene is left out."""
NOTHING = 1e-9
"""A component of a force below this part of the force is nothing."""


def shell_models(scene: Any) -> dict[str, Any]:
    """Our models of a shell's scene, by name."""
    if isinstance(scene, pneunet.Chamber):
        return {"thesis": scene}
    if not isinstance(scene, ShellScene):
        return {"energy": scene}
    return {model: dataclasses.replace(scene, model=model) for model in ("arc", "energy")}


def means_the_same(scene: Any, name: str) -> bool:
    """Whether a model's observable is what finite elements measure: an arc's stretch is that of its free part, and in
    contact not that of the middle; a chamber's wall reports its force alone."""
    if isinstance(scene, pneunet.Chamber):
        return name == "force"
    return not (isinstance(scene, ShellScene) and scene.model == "arc" and "stretch" in name) or isinstance(
        scene, shell.Free
    )


def model_values(models: dict[str, Any], targets: Sequence[Target]) -> dict[str, list[dict[str, float]]]:
    """What each model says at each pressure, in SI; empty where it has no state."""
    found: dict[str, list[dict[str, float]]] = {}
    for name, scene in models.items():
        found[name] = []
        for target in targets:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", CellRangeWarning)
                solution = solve(scene, target.pressure)
            status = int(solution.status)
            values = {key: float(v) for key, v in solution.observables.items() if np.ndim(v) == 0}
            # Without contact there is no force, and nothing else is reported.
            known = [
                k for k in values if status == Status.OK or (status == Status.NO_CONTACT and k.startswith("force"))
            ]
            found[name].append({k: values[k] for k in known if means_the_same(scene, k)})
    return found


def rows_of(found: Sequence[Found], kinds: dict[str, str], models: dict[str, list[dict[str, float]]]) -> list[Row]:
    """The table of what is there: the last states that were asked for come first."""
    rows = []
    for place in reversed(range(len(found))):
        one = found[place]
        if not one.values:
            continue
        values = one.values[-1]
        for name, kind in kinds.items():
            if name not in values or not any(name in given[place] for given in models.values()):
                continue
            if name.startswith("force_") and abs(values[name]) <= NOTHING * abs(values.get("force", 0.0)):
                continue
            said = {model: given[place].get(name, math.nan) for model, given in models.items()}
            curvature = one.target.curvature
            rows.append(
                Row(
                    name,
                    kind,
                    one.target.pressure,
                    curvature,
                    said,
                    values[name],
                    one.mesh_error(name),
                    sum(one.seconds),
                )
            )
    return [_with_the_worst(row, rows) for row in rows]


def _with_the_worst(row: Row, rows: Sequence[Row]) -> Row:
    """Two meshes may agree by accident at one state: an error is no smaller, relative to the quantity, than the largest
    at any state over its largest value."""
    known = [one for one in rows if one.quantity == row.quantity and one.mesh_error is not None]
    largest = max((abs(one.elements) for one in known), default=0.0)
    if row.mesh_error is None or largest == 0:
        return row
    share = max(one.mesh_error or 0.0 for one in known) / largest
    return row._replace(mesh_error=max(row.mesh_error, share * abs(row.elements)))
