"""The pneu-net finger: a row of chambers on a cover."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import Checked, is_concrete, nonnegative, part, positive
from ..materials.base import Material
from ..materials.presets import dragon_skin_20, dragon_skin_30
from ..units import mm

Scalar = Float[Array, ""]
PerSegment = Float[Array, ""] | Float[Array, " n"]

SEGMENT_FIELDS = ("a", "b", "h_x", "t_m", "h_L")
"""Fields that may differ from segment to segment."""
ROUNDING = 1e-6
"""Of a chamber: what is short by less is a whole one."""

_GEOMETRY_1 = {"h_x": 0.9 * mm, "t_m": 1.1 * mm, "h_L": 4.2 * mm}
_GEOMETRY_2 = {"h_x": 0.75 * mm, "t_m": 1.5 * mm, "h_L": 4.5 * mm}
TABLE_5_1 = {
    "A": (_GEOMETRY_1, dragon_skin_20),
    "B": (_GEOMETRY_1, dragon_skin_30),
    "C": (_GEOMETRY_2, dragon_skin_20),
    "D": (_GEOMETRY_2, dragon_skin_30),
}
"""Thesis table 5.1. Its geometry columns are two for four types: A and B share the first, C and D the second."""


class PneuNet(Checked):
    """Air chambers in a row on a cover that bends as a beam.

    `a, b, h_x, t_m, h_L` are numbers for a uniform finger, or arrays of one length n for a finger of n segments, each
    with its own chamber (thesis 4.3.5). A uniform finger needs no whole number of chambers: the thesis's own is 77 / 6
    = 12.8 segments long. The segments of a nonuniform finger share L in proportion to their pitch; one that is as long
    as several pitches has as many equal chambers.

    Args:
        a: half height of the chamber wall, m.
        b: half width of the chamber wall, m.
        h_x: half of the gap between two chambers, m, zero or more.
        t_m: thickness of the wall, m.
        h_L: length of a chamber along the finger, m.
        H: thickness of the cover, m.
        B: width of the cover, m.
        L: length of the cover, m.
        material: strain energy of chambers and cover.

    Raises:
        InputError: where a field breaks its rule, or arrays have different lengths (outside of jit).

    Source: thesis 4.1, figures 4.2 to 4.5.

    Examples:
        >>> finger = sg.PneuNet.table_5_1("A")
        >>> print(f"{finger.pitch / mm:.1f} mm, {finger.L / finger.pitch:.1f} segments")
        6.0 mm, 12.8 segments
    """

    a: PerSegment = positive("length")
    b: PerSegment = positive("length")
    h_x: PerSegment = nonnegative("length")
    t_m: PerSegment = positive("length")
    h_L: PerSegment = positive("length")
    H: Scalar = positive("length")
    B: Scalar = positive("length")
    L: Scalar = positive("length")
    material: Material = part(Material)

    def __check_init__(self) -> None:
        shapes = {name: jnp.shape(getattr(self, name)) for name in SEGMENT_FIELDS if is_concrete(getattr(self, name))}
        lengths = {shape for shape in shapes.values() if shape}
        if len(lengths) > 1 or any(len(shape) > 1 or 0 in shape for shape in lengths):
            raise InputError(
                f"PneuNet has fields of shapes {shapes}; each must be a number, or an array with one value per segment."
            )

    @classmethod
    def table_5_1(cls, kind: str, L: Any = 77 * mm) -> PneuNet:
        """A finger of thesis table 5.1.

        Args:
            kind: "A", "B", "C" or "D".
            L: length of the cover, m.

        Raises:
            InputError: for another kind.
        """
        if kind not in TABLE_5_1:
            raise InputError(f"kind is {kind!r}; it must be one of {', '.join(map(repr, TABLE_5_1))}.")
        geometry, material = TABLE_5_1[kind]
        return cls(a=5 * mm, b=8 * mm, **geometry, H=5 * mm, B=20 * mm, L=L, material=material())

    @property
    def pitch(self) -> PerSegment:
        """Length of a segment, 2 h_x + h_L, m."""
        return 2 * self.h_x + self.h_L

    @property
    def segments(self) -> int | None:
        """Number of segments of a nonuniform finger; None for a uniform one."""
        lengths = [jnp.shape(getattr(self, name)) for name in SEGMENT_FIELDS]
        return next((shape[0] for shape in lengths if shape), None)

    @property
    def segment_lengths(self) -> Float[Array, " n"]:
        """Cover length of each segment, m: L shared in proportion to the pitch. A uniform finger is one segment."""
        pitch = jnp.broadcast_to(self.pitch, (self.segments or 1,))
        return self.L * pitch / jnp.sum(pitch)

    @property
    def whole_chambers(self) -> Float[Array, " n"]:
        """How many whole chambers fit into each segment: one, where L is the sum of pitches. A uniform finger is one
        segment."""
        return jnp.floor(self.segment_lengths / self.pitch + ROUNDING)

    def moment_scale(self) -> Scalar:
        """mu B H^2, N m: the unit of moments in the section laws."""
        return self.material.shear_modulus() * self.B * self.H**2

    def force_scale(self) -> Scalar:
        """mu B H, N: the unit of axial forces in the section laws."""
        return self.material.shear_modulus() * self.B * self.H


PRESETS = {f"table_5_1_{kind}": partial(PneuNet.table_5_1, kind) for kind in TABLE_5_1}
"""Fingers by name, for configs."""
