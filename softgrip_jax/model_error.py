"""How far models are from finite elements, where that is known: a sentence for each number of a scene.

The numbers are those of docs/benchmarks/models.csv: finite elements of the shell of the thesis and of a finger's cover,
neo-Hookean. Of a shell that is not like it nothing is said: a small and thick one on a plane was 150 % off.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from . import pneunet, shell
from .fields import is_concrete
from .materials import NeoHookean
from .shell.energy.scene import EnergyScene
from .units import kPa, mm

FREE = {
    "arc": "13 to 15 % less than finite elements",
    "energy": "0.3 to 1.2 % less than finite elements",
}
PLANE = {
    "arc": "11 to 21 % less than finite elements",
    "energy": "within 1.2 % of finite elements",
}
LIMIT = {"arc": "3.2 % more than finite elements", "energy": "0.3 % less than finite elements"}
DRIVE = "a quarter of what finite elements of chambers, rims and cover together give; drive = 'cell' is near them"
TIP = "a fifth of what finite elements of chambers, rims and cover together give; drive = 'cell' is nearer"
SPREAD = "half, or less, of what finite elements of chambers, rims and cover together give; drive = 'cell' is near them"
"""Of the thesis's chambers without the root of `moment_spread`."""
SMALL_STRAIN = "far less than what finite elements of chambers, rims and cover give; drive = 'cell' is near them"
CELL = "within 5 % of finite elements of the same cells, 10 to 31 kPa, inside the range that the law was fitted to"


LIKE = 0.1
"""Another shell is like that of the finite elements where none of its proportions differs by more than this: what makes
a verification near to a design, too (`verify.kept.NEAR`)."""


POLYNOMIALS = (4, 6)
"""Of the energy membrane, across and along: those by which its errors were found."""


def _is_usual(scene: Any) -> bool:
    """Whether an energy membrane bends and has no fewer polynomials than POLYNOMIALS: without bending the force on the
    plane is 4.3 % too large, by one polynomial each way the inflation 10 %."""
    across, along = POLYNOMIALS
    return scene.bending and getattr(scene, "across", across) >= across and getattr(scene, "lengthwise", along) >= along


def _proportions(a: Any, b: Any, t_m: Any, distance: Any) -> Any:
    """b/a, t_m/a and the distance of a plane over a."""
    return np.array([b / a, t_m / a, distance / a], dtype=float)


def _is_like_elements(scene: Any) -> bool:
    """Whether a shell is shaped like that of the finite elements: a 16 mm, b 43 mm, t_m 1.1 mm, a plane at 5 mm."""
    made, distance = scene.shell, 5 * mm
    if not isinstance(made.material, NeoHookean) or not is_concrete(*jax.tree.leaves(scene)):
        return False
    known = _proportions(16 * mm, 43 * mm, 1.1 * mm, distance)
    own = _proportions(made.a, made.b, made.t_m, getattr(scene, "distance", distance))
    return bool(np.all(np.abs(own / known - 1) <= LIKE))


def _at(made: Any, low: float, high: float) -> str:
    """The pressures (kPa) of the finite elements, of 175 kPa, at this shell: the shape follows p a / (mu t_m)."""
    scale = float((made.material.mu * made.t_m / made.a) / (175 * kPa * 1.1 / 16))
    return f", {low * scale:.3g} to {high * scale:.3g} kPa"


def model_error(scene: Any, observable: str) -> str:
    """What is known of the error of an observable of a scene against finite elements; '' where nothing is."""
    by_energy = isinstance(scene, EnergyScene) or getattr(scene, "model", "arc") == "energy"
    if by_energy or isinstance(scene, shell.Free | shell.FlatContact):
        if not _is_like_elements(scene):
            return ""
        if by_energy and not _is_usual(scene):
            return ""
        model = "energy" if by_energy else "arc"
        touched = scene.body is not None if isinstance(scene, EnergyScene) else not isinstance(scene, shell.Free)
        if observable == "limit_pressure":
            return "" if touched else LIMIT[model]
        if observable == "inflation" and not touched:
            return FREE[model] + _at(scene.shell, 5.0, 17.5)
        if observable == "force" and isinstance(scene, shell.FlatContact):
            return PLANE[model] + _at(scene.shell, 5.0, 20.0)
        return ""
    if isinstance(scene, pneunet.Free | pneunet.TipContact | pneunet.Grasp):
        pushed = observable in ("end_moment", "tip_force")
        if scene.drive in ("cell", "small_strain"):
            return {"cell": CELL, "small_strain": SMALL_STRAIN}[scene.drive] if pushed else ""
        if scene.drive != "thesis":  # chambers of the user's own
            return ""
        if scene.moment_spread == "none":
            return SPREAD if pushed else ""
        return {"end_moment": DRIVE, "tip_force": TIP}.get(observable, "")
    return ""
