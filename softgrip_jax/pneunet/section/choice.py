"""The section law that a name and a material mean.

A law of the package is one file of this folder: a class with a NAME, which is found here. One of a user's own is handed
over as it is: `section=MyLaw(...)`.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...fields import choice_or
from ...materials.base import Material
from ..finger import PneuNet
from .base import Scalar, SectionLaw
from .exact import ExactNeoHookean
from .quadrature import ExactQuadrature

# --- by name ------------------------------------------------------------------------------------------------------


def _laws() -> dict[str, type[SectionLaw]]:
    """Name -> class of all files beside this one."""
    found = {}
    for file in pkgutil.iter_modules([str(Path(__file__).parent)]):
        module = importlib.import_module(f"{__package__}.{file.name}")
        for law in vars(module).values():
            if isinstance(law, type) and issubclass(law, SectionLaw) and law.NAME:
                found[law.NAME] = law
    return found


LAWS = _laws()
SECTION_LAWS = ("exact", *sorted(LAWS, reverse=True))


def section(**kwargs: Any) -> Any:
    """The field of a scene that holds the section law of its cover: a name, or a `SectionLaw`."""
    return choice_or(SectionLaw, *SECTION_LAWS, **kwargs)


def section_law(name: str | SectionLaw, material: Material) -> SectionLaw:
    """The section law of a cover: "exact" (closed form where there is one), another by its name, or one as given."""
    if isinstance(name, SectionLaw):
        return name
    if name in LAWS:
        return LAWS[name]()
    if name != "exact":
        raise InputError(f"section is {name!r}; it must be one of {', '.join(map(repr, SECTION_LAWS))}.")
    return ExactNeoHookean() if material.closed_forms().neo_hookean_in_plane_strain else ExactQuadrature(material)


def curvature_and_stretch(name: str | SectionLaw, finger: PneuNet, moment: Any, tension: Any) -> tuple[Scalar, Scalar]:
    """(theta', 1/m; lambda) of a finger's cover under M (N m, positive turns towards positive theta) and N (N)."""
    law = section_law(name, finger.material)
    z, stretch = law(moment / finger.moment_scale(), tension / finger.force_scale())
    return z / finger.H, stretch


def moment_and_tension(name: str | SectionLaw, finger: PneuNet, curvature: Any, stretch: Any) -> tuple[Scalar, Scalar]:
    """(M, N m; N, N) that hold a finger's cover at theta' (1/m) and lambda."""
    m, n = section_law(name, finger.material).loads(curvature * finger.H, stretch)
    return m * finger.moment_scale(), n * finger.force_scale()
