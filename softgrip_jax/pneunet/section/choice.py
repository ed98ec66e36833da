"""The section law that a name and a material mean."""

from __future__ import annotations

from typing import Any

from ...errors import InputError
from ...materials.base import Material
from ..finger import PneuNet
from .base import Scalar, SectionLaw
from .exact import ExactNeoHookean
from .inextensible import Inextensible
from .quadrature import ExactQuadrature
from .thesis import Thesis

# --- by name ------------------------------------------------------------------------------------------------------

SECTION_LAWS = ("exact", "thesis", "inextensible")


def section_law(name: str, material: Material) -> SectionLaw:
    """The section law of a cover by name: "exact" (closed form where there is one), "thesis", "inextensible"."""
    if name == "thesis":
        return Thesis()
    if name == "inextensible":
        return Inextensible()
    if name != "exact":
        raise InputError(f"section is {name!r}; it must be one of {', '.join(map(repr, SECTION_LAWS))}.")
    return ExactNeoHookean() if material.closed_forms().neo_hookean_in_plane_strain else ExactQuadrature(material)


def curvature_and_stretch(name: str, finger: PneuNet, moment: Any, tension: Any) -> tuple[Scalar, Scalar]:
    """(theta', 1/m; lambda) of a finger's cover under M (N m, positive turns towards positive theta) and N (N)."""
    law = section_law(name, finger.material)
    z, stretch = law(moment / finger.moment_scale(), tension / finger.force_scale())
    return z / finger.H, stretch


def moment_and_tension(name: str, finger: PneuNet, curvature: Any, stretch: Any) -> tuple[Scalar, Scalar]:
    """(M, N m; N, N) that hold a finger's cover at theta' (1/m) and lambda."""
    m, n = section_law(name, finger.material).loads(curvature * finger.H, stretch)
    return m * finger.moment_scale(), n * finger.force_scale()
