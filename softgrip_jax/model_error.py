"""How far models are from finite elements, where that is known: a sentence for each number of a scene.

The numbers are those of docs/benchmarks/models.csv: finite elements of the shell of the thesis and of a finger's cover,
neo-Hookean. Of a shell that is not like it the difference between arcs and the energy membrane is told, as it was found
over random shells (docs/benchmarks/arcs.csv): a small and thick one on a plane was 150 % off its finite elements.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import numpy as np

from . import pneunet, shell
from .fields import is_concrete
from .materials import NeoHookean
from .shell.energy.scene import EnergyScene
from .shell.flat_shell import ShellScene
from .units import kPa

FREE = {
    "arc": "13 to 15 % less than finite elements",
    "energy": "0.3 to 1.2 % less than finite elements",
}
PLANE = {
    "arc": "11 to 21 % less than finite elements",
    "energy": "within 1.2 % of finite elements",
}
CYLINDER = {
    "arc": "31 to 67 % less than finite elements",
    "energy": "within 1 % of finite elements",
}
LEANING = {
    "arc": "89 to 100 % less than finite elements",
    "energy": "8 to 11 % less than finite elements",
}
LIMIT = {"arc": "3.2 % more than finite elements", "energy": "0.3 % less than finite elements"}
DRIVE = "a quarter of what finite elements of chambers, rims and cover together give; drive = 'cell' is near them"
TIP = "a fifth of what finite elements of chambers, rims and cover together give; drive = 'cell' is nearer"
SPREAD = "half, or less, of what finite elements of chambers, rims and cover together give; drive = 'cell' is near them"
"""Of the thesis's chambers without the root of `moment_spread`."""
SMALL_STRAIN = "far less than what finite elements of chambers, rims and cover give; drive = 'cell' is near them"
CELL = "within 5 % of finite elements of the same cells, 10 to 31 kPa, inside the range that the law was fitted to"


TRUSTED_STRETCH = 1.5
"""From about there on silicones stiffen, which a neo-Hookean law does not (docs/limits.md)."""
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


class Elements(NamedTuple):
    """Finite elements of a scene of one shell, 175 kPa, and what they say of both models."""

    proportions: tuple[float, ...]
    """See `_proportions`."""
    errors: dict[str, dict[str, str]]
    """Of an observable: by the model."""
    pressures: tuple[float, float]
    """kPa, the least and the largest."""


THIN = (43 / 16, 1.1 / 16)
"""The thesis's shell: a 16 mm, b 43 mm, t_m 1.1 mm."""
ELEMENTS: dict[type, Elements] = {
    shell.Free: Elements(THIN, {"inflation": FREE}, (5.0, 17.5)),
    shell.FlatContact: Elements((*THIN, 5 / 16), {"force": PLANE}, (5.0, 20.0)),
    shell.CylinderContact: Elements((*THIN, 5 / 16, 20 / 16), {"force": CYLINDER, "force_z": CYLINDER}, (5.0, 15.0)),
    shell.InclinedContact: Elements((1.0, 1.1 / 16, 5 / 16, np.deg2rad(10)), {"force": LEANING}, (10.0, 15.0)),
}

OF_MANY = " (nine in ten random shells); model = 'energy' is near finite elements"
ON_ROD = f"7 to 97 % less than by the energy membrane, next to first contact most{OF_MANY}"
ARCS: dict[type, dict[str, str]] = {
    shell.Free: {"inflation": f"8 to 20 % less than by the energy membrane{OF_MANY}"},
    shell.FlatContact: {"force": f"31 % less to 4 % more than by the energy membrane{OF_MANY}"},
    shell.InclinedContact: {"force": f"48 to 80 % less than by the energy membrane{OF_MANY}"},
    shell.CylinderContact: {"force": ON_ROD, "force_z": ON_ROD},
    shell.AxialOffset: {"force": ON_ROD, "force_z": ON_ROD},
    shell.Grasp: {
        "force": ON_ROD,
        "force_z": ON_ROD,
        "pressure": f"where it is the required one, 8 to 72 % more than by the energy membrane{OF_MANY}",
    },
}
"""Of shells by arcs that are not like those of the finite elements."""
PLACES = {"distance": (0.05, 0.6), "gap": (0.05, 0.6), "radius": (0.8, 2.0), "angle": (np.deg2rad(1), np.deg2rad(20))}
"""Where an object is: what the random shells had, lengths over a."""
SIDES, SQUARE, THICKNESSES = (1.3, 4.0), (0.99, 1.01), (0.03, 0.12)
"""Their b/a, on a plane that leans the second, and t_m/a."""


def _proportions(scene: Any) -> np.ndarray:
    """b/a, t_m/a, and where the object is: its lengths over a, and its angle."""
    made = scene.shell
    places = [
        getattr(scene, name) / (1.0 if name == "angle" else made.a)
        for name in ("distance", "gap", "radius", "angle")
        if hasattr(scene, name)
    ]
    return np.array([made.b / made.a, made.t_m / made.a, *places], dtype=float)


def _is_like(scene: Any, known: Elements) -> bool:
    """Whether a shell and its object are shaped like those of finite elements."""
    return bool(np.all(np.abs(_proportions(scene) / known.proportions - 1) <= LIKE))


def _is_among_many(scene: Any) -> bool:
    """Whether a shell and its object are within what the random shells were."""
    sides = SQUARE if isinstance(scene, shell.InclinedContact) else SIDES
    ranges = np.array([sides, THICKNESSES, *(ends for name, ends in PLACES.items() if hasattr(scene, name))])
    own = _proportions(scene)
    return bool(np.all((ranges[:, 0] <= own) & (own <= ranges[:, 1])))


def _at(made: Any, low: float, high: float) -> str:
    """The pressures (kPa) of the finite elements, of 175 kPa, at this shell: the shape follows p a / (mu t_m)."""
    scale = float((made.material.mu * made.t_m / made.a) / (175 * kPa * 1.1 / 16))
    return f", {low * scale:.3g} to {high * scale:.3g} kPa"


def _of_shell(scene: Any, observable: str) -> str:
    by_energy = isinstance(scene, EnergyScene) or scene.model == "energy"
    if not isinstance(scene.shell.material, NeoHookean) or not is_concrete(*jax.tree.leaves(scene)):
        return ""
    if by_energy and not _is_usual(scene):
        return ""
    model = "energy" if by_energy else "arc"
    is_free = scene.body is None if isinstance(scene, EnergyScene) else isinstance(scene, shell.Free)
    known = ELEMENTS[shell.Free] if is_free else ELEMENTS.get(type(scene))
    if known is not None and _is_like(scene, known):
        if observable == "limit_pressure":
            return LIMIT[model] if is_free else ""
        errors = known.errors.get(observable)
        return errors[model] + _at(scene.shell, *known.pressures) if errors else ""
    words = "" if by_energy else ARCS.get(type(scene), {}).get(observable, "")
    return words if words and _is_among_many(scene) else ""


def of_shell(scene: Any, names: Iterable[str]) -> list[str]:
    """A sentence for each thing that `model_error` says of these numbers of a shell; of a finger both drives say it."""
    said: dict[str, list[str]] = {}
    for name in names if isinstance(scene, ShellScene | EnergyScene) else ():
        said.setdefault(model_error(scene, name), []).append(name.replace("_", " "))
    return [f"{', '.join(those)}: {words}." for words, those in said.items() if words]


def of_material(solution: Any) -> dict[str, str]:
    """What is said of a shell that is stretched further than its neo-Hookean law is trusted, by the observable."""
    scene = solution.scene
    if not isinstance(scene, ShellScene | EnergyScene) or not isinstance(scene.shell.material, NeoHookean):
        return {}
    stretch = float(solution.observables.get("stretch", np.nan))
    if not stretch > TRUSTED_STRETCH:  # NaN where there is no state
        return {}
    words = (
        f"{stretch:.3g} is more than the {TRUSTED_STRETCH:g} or so up to which a neo-Hookean law is trusted with "
        "silicone, which stiffens; a law that does (Yeoh, Gent, Ogden), fitted as far, goes further"
    )
    return {"stretch": words}


def model_error(scene: Any, observable: str) -> str:
    """What is known of the error of an observable of a scene against finite elements; '' where nothing is."""
    if isinstance(scene, ShellScene | EnergyScene):
        return _of_shell(scene, observable)
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
