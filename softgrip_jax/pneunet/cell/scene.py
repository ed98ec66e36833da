"""One segment of the finger as a scene: bent to a curvature, under an axial force and a pressure."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...curve_scene import CurveScene
from ...fields import finite, part
from ...reasons import Reason
from ..finger import PneuNet
from ..rules import margins_of_parts
from ..wall.arc import one_chamber
from .law import LARGEST_PRESSURE, cell_of

Scalar = Float[Array, ""]


class Cell(CurveScene):
    """One segment of a uniformly bent finger: chamber, walls, rims and cover together.

    With a potential Psi(kappa, lambda; p) per length of the cover, M_ext = dPsi/dkappa and N = dPsi/dlambda. It is what
    three-dimensional finite elements of half a segment compute: the plane in the middle of the gap turns with the
    curvature, the neighbour's wall presses on this one there, and the cover bends and stretches.

    Args:
        finger: a uniform finger (or one segment of a nonuniform one).
        curvature: kappa, 1/m per reference length; negative where the finger is bent backwards.
        axial_force: N on the whole segment, at the cover's mid-height, N.

    Observables:
        - moment: M_ext, N m, positive in the bending direction: the external moment that the segment needs. Without
            curvature it is minus the moment that the chambers give a straight finger; where it is zero the finger bends
            freely.
        - contact_force: of one wall on the next, N.
        - lever_arm: its distance from the cover's mid-height, m, of no meaning where nothing touches.
        - stretch: of the cover's mid-height, dimensionless.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: own; docs/theory/cell.md. Four geometries in the range of `law.CHECKED` that no fit has seen are within 6 %
    of finite elements' blocked moment from 5 to 31 kPa; it is worse where rims are about to meet. BEYOND_LIMIT above p
    = 0.24 mu.

    Examples:
        >>> blocked = sg.solve(sg.pneunet.Cell(sg.PneuNet.table_5_1("A")), 15 * kPa)
        >>> bool(blocked.moment < 0)  # it pushes in the bending direction
        True
    """

    finger: PneuNet = part(PneuNet)
    curvature: Scalar = finite("curvature", default=0.0)
    axial_force: Scalar = finite("force", default=0.0)

    OBSERVABLES: ClassVar[dict[str, str]] = {
        "moment": "moment",
        "contact_force": "force",
        "lever_arm": "length",
        "stretch": "number",
    }
    CONTACT: ClassVar[bool] = False

    def prepared(self):
        return one_chamber(self)

    def margins_at_rest(self):
        return margins_of_parts(self.finger)

    def interval(self):
        zero = jnp.zeros_like(self.finger.L)
        return zero, zero + LARGEST_PRESSURE

    def load(self, angle):
        """The unknown is p / mu itself."""
        return angle * self.pressure_scale()

    def may_dip(self):
        return False

    def end_reason(self):
        return Reason.CELL_LAW_ENDS

    def pressure_scale(self):
        return self.finger.material.shear_modulus()

    def observe(self, angle, pressure):
        f = self.finger
        unit = self.pressure_scale() * f.B**2
        cell, k = cell_of(f, angle * self.pressure_scale()), self.curvature * f.B
        moment, stretch = cell.bent(k, self.axial_force / unit)
        force, lever = cell.touched(k)
        return {
            "moment": moment * unit * f.B,
            "contact_force": force * unit,
            "lever_arm": lever * f.B,
            "stretch": stretch,
        }
