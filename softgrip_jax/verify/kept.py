"""Verifications that are kept: a folder of files, and which of them speak about a design at hand.

A verification is near to a design where the two are of one kind, of the same class of material, and of the same model
(its settings), and every number (lengths, angles, moduli) is within NEAR of the other's; and it speaks about the
pressures from the least that it verified to the largest, by NEAR more. Between its pressures errors are interpolated.
"""

from __future__ import annotations

import json
import math
import uuid
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import pneunet
from ..errors import InputError
from ..folders import why_unwritable, write_whole
from ..pneunet.finger_scene import FingerScene
from ..scene import Scene
from ..shell.energy.scene import EnergyScene

FOLDER = Path("verified")
"""Where verifications are kept, below the folder in which one works."""
NEAR = 0.1
"""Largest relative difference of a number, dimensionless."""
ROUNDING = 1e-9
"""Relative differences that a number has by its way through a file or a unit."""
VERSION = 2


class Nearby(NamedTuple):
    """What finite elements said of a model near to the design at hand.

    Args:
        error: model over finite elements, less one, dimensionless.
        mesh_error: of the finite elements, over their value; NaN where one mesh was solved.
        distance: largest relative difference of a number of the two designs, dimensionless.
        file: of the verification.
    """

    error: float
    mesh_error: float
    distance: float
    file: Path

    def rank(self) -> tuple[float, float]:
        """The nearest design first, and of several verifications of it the one with the least mesh error."""
        return self.distance, self.mesh_error if math.isfinite(self.mesh_error) else math.inf

    def as_data(self) -> dict[str, Any]:
        """As plain data; a mesh error that is not known is None."""
        mesh = self.mesh_error if math.isfinite(self.mesh_error) else None
        return {"error": self.error, "mesh_error": mesh, "distance": self.distance, "file": str(self.file)}

    def __str__(self) -> str:
        mesh = f" (mesh error {100 * self.mesh_error:.1g} %)" if math.isfinite(self.mesh_error) else ""
        source = "a verification of this design"
        if self.distance > ROUNDING:
            source = f"a verified design whose numbers are within {100 * self.distance:.2g} % of this one's"
        return f"{100 * self.error:+.2g} % against finite elements{mesh}, from {source}: {self.file}"


class Subject(NamedTuple):
    """What finite elements compute of a scene, and what the errors of our models of it depend on.

    Args:
        kind: of it.
        part: what has the material.
        numbers: that it depends on, as a tree.
        settings: of the model, what is no number.
    """

    kind: str
    part: Any
    numbers: Any
    settings: dict[str, Any]

    def as_data(self) -> dict[str, Any]:
        """As plain data: every number by its path, in SI."""
        leaves = jax.tree_util.tree_flatten_with_path(self.numbers)[0]
        material = type(self.part.material).__name__ if hasattr(self.part, "material") else ""
        numbers = {jax.tree_util.keystr(path): np.asarray(leaf).tolist() for path, leaf in leaves}
        return {"kind": self.kind, "material": material, "settings": self.settings, "numbers": numbers}


def subject(scene: Any) -> Subject:
    """What is verified of a scene."""
    if isinstance(scene, FingerScene | pneunet.Cell):
        # The walls of a straight cell, of which a finger is told the errors, do not incline.
        section = getattr(scene, "section", "exact")
        name = section if isinstance(section, str) else type(section).__name__
        settings = {"section": name, "moment_spread": getattr(scene, "moment_spread", "root")}
        return Subject("finger", scene.finger, scene.finger, settings)
    if isinstance(scene, pneunet.Chamber):
        return Subject("Chamber", scene.finger, (scene.finger, scene.inclination), {})
    if isinstance(scene, EnergyScene):
        energy: Any = scene
    else:
        try:
            energy = scene.energy_scene()
        except (AttributeError, NotImplementedError):
            return Subject(type(scene).__name__, scene, scene, {})
    body, basis = energy.body, {name: getattr(energy, name) for name in ("across", "lengthwise", "bending")}
    kind = f"shell on {type(body).__name__}" if body is not None else "free shell"
    return Subject(kind, energy.shell, (energy.shell, body), basis)


def require_place(folder: Path) -> None:
    """An InputError where verifications cannot be kept in a folder, which need not exist yet."""
    absolute = folder.absolute()
    place = next(path for path in (absolute, *absolute.parents) if path.exists())
    reason = why_unwritable(place)
    if reason:
        raise InputError(f"Verifications cannot be kept in {folder}: {place}: {reason}; give --keep another place.")


def keep(scene: Scene, rows: list[dict[str, Any]], folder: Path = FOLDER) -> Path:
    """Keep the rows of a verification; returns the file.

    Raises:
        InputError: where the folder cannot be written to.
    """
    require_place(folder)
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"version": VERSION} | subject(scene).as_data() | {"rows": rows}
    name = f"{record['kind'].replace(' ', '_')}-{uuid.uuid4().hex[:8]}.json"
    path = folder / name
    write_whole(path, json.dumps(record, indent=1, allow_nan=False).encode())
    return path


def distance(a: dict[str, Any], b: dict[str, Any]) -> float:
    """Largest relative difference of two designs' numbers; inf where they have other numbers."""
    if a.keys() != b.keys():
        return math.inf
    largest = 0.0
    for name, value in a.items():
        x, y = np.asarray(value, dtype=float), np.asarray(b[name], dtype=float)
        if x.shape != y.shape:
            return math.inf
        size = np.maximum(np.abs(x), np.abs(y))
        apart = np.where(size > 0, np.abs(x - y) / np.where(size > 0, size, 1.0), 0.0)
        largest = max(largest, float(np.max(apart, initial=0.0)))
    return largest


def nearby(
    scene: Any, pressure: float, quantity: str, model: str, curvature: float | None = None, folder: Path = FOLDER
) -> Nearby | None:
    """What the nearest verified design says of a model's error at a pressure; None where none is near.

    Args:
        scene: the design at hand.
        pressure: Pa.
        quantity: an observable.
        model: "arc" or "energy" of shells, "thesis" or "cell" of fingers.
        curvature: of a finger's cell, 1/m.
        folder: of verifications.

    Raises:
        InputError: for a file in the folder that is no verification.
    """
    if not folder.is_dir():
        return None
    here, best = subject(scene).as_data(), None
    for file in sorted(folder.glob("*.json")):
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
            same = ("kind", "material", "settings")
            known = record["version"] == VERSION and all(record[name] == here[name] for name in same)
            apart = distance(here["numbers"], record["numbers"]) if known else math.inf
            rows = record["rows"]
            said = _at(rows, pressure, quantity, model, curvature) if apart <= NEAR else None
        except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError):
            raise InputError(f"{file} is no verification; move it out of {folder}.") from None
        if said is not None:
            one = Nearby(*said, apart, file)
            best = one if best is None or one.rank() < best.rank() else best
    return best


def _at(
    rows: list[dict[str, Any]], pressure: float, quantity: str, model: str, curvature: float | None
) -> tuple[float, float] | None:
    """The error of a model and that of the mesh, between the pressures of a verification."""
    points = []
    for row in rows:
        bent = row["curvature"] is None or curvature is None or abs(row["curvature"] - curvature) < 1e-9
        error = row["differences"].get(model)
        if row["quantity"] == quantity and bent and error is not None:
            mesh = math.nan if row["mesh_error"] is None else row["mesh_error"] / abs(row["elements"])
            points.append((row["pressure"], error, mesh))
    if not points:
        return None
    p, error, mesh = (np.array(column) for column in zip(*sorted(points), strict=True))
    if not p[0] * (1 - NEAR) <= pressure <= p[-1] * (1 + NEAR):
        return None
    return float(np.interp(pressure, p, error)), float(np.interp(pressure, p, mesh))
