"""One segment of the finger as a scene: bent to a curvature, under an axial force and a pressure."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...curve_scene import CurveScene
from ...fields import finite, part
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import newton_bracketed
from ...reasons import Reason
from ...results import Status
from ..finger import PneuNet
from ..rules import margins_of_parts
from ..wall.arc import one_chamber
from .law import LARGEST_PRESSURE, cell_of, known_curvatures, range_margin, warn_outside

Scalar = Float[Array, ""]

LEAST_STRETCH, MOST_STRETCH = 0.7, 2.0
"""Of the cover's mid-height. The cells of the data are stretched by 0.999 to 1.19. Where rims are pressed on each other
twice as far as they meet the law has 0.8 to 1.8."""
PLACES = 33
"""Pressures at which the stretch is looked at."""


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

    Source: own; docs/theory/cell.md. Five geometries in the range of `law.CHECKED` that no fit has seen are within 6 %
    of finite elements' blocked moment from 5 to 31 kPa; it is worse where rims are about to meet. BEYOND_LIMIT above p
    = 0.24 mu, from where the cover's mid-height is stretched by less than 0.7 or more than 2, and at all pressures
    where the cell is bent as none that the law was fitted to: kappa above 2.6 / B, or backwards beyond 2.5 times the
    curvature at which the rims of rigid neighbours meet (130 and -52 1/m for type A).

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
        warn_outside(self.finger, stacklevel=3)
        return one_chamber(self)

    def margins_at_rest(self):
        return margins_of_parts(self.finger) | {"cell_law_range": range_margin(self.finger)}

    def interval(self):
        """To the end of the law, or to where the stretch leaves what is known; empty for a curvature that is not."""
        zero = jnp.zeros_like(self.finger.L)
        return zero, jnp.where(self._begins(), self._stretched(), zero)

    def _begins(self) -> Bool[Array, ""]:
        """Whether it is known without pressure, and so up to some pressure."""
        low, high = known_curvatures(self.finger)
        known = (self.curvature >= low) & (self.curvature <= high)
        return known & (self._room(jnp.zeros_like(self.finger.L)) > 0)

    def _room(self, share: Scalar) -> Scalar:
        """Positive where the stretch is known, at a pressure over mu."""
        stretch = self.bent(share)[1]
        return (stretch - LEAST_STRETCH) * (MOST_STRETCH - stretch)

    def _stretched(self) -> Scalar:
        """The first pressure, over mu, at which the stretch leaves what is known; LARGEST_PRESSURE at most."""
        places = LARGEST_PRESSURE * jnp.linspace(0.0, 1.0, PLACES)
        within = jax.vmap(self._room)(places) > 0
        leaves, first = ~jnp.all(within), jnp.argmin(within)
        high, low = places[first], places[jnp.maximum(first - 1, 0)]
        found = newton_bracketed(lambda p: -self._room(p), low, high, high).x

        def equation(p, args):
            scene, leaves, found = args
            return jnp.where(leaves, scene._room(p), p - found)  # a root that is none may have no derivatives

        return jnp.where(leaves, implicit(equation, found, (self, leaves, found)), LARGEST_PRESSURE)

    def load(self, angle):
        """The unknown is p / mu itself."""
        return angle * self.pressure_scale()

    def may_dip(self):
        return False

    def end_reason(self):
        return Reason.CELL_LAW_ENDS

    def pressure_scale(self):
        return self.finger.material.shear_modulus()

    def verified(self, found):
        """Where no pressure has a state, it is the law that ends."""
        found = super().verified(found)
        unknown = self.can_exist() & ~self._begins()
        return found._replace(
            status=jnp.where(unknown, Status.BEYOND_LIMIT, found.status),
            reason=jnp.where(unknown, int(Reason.CELL_LAW_ENDS), found.reason),
        )

    def bent(self, share: Scalar) -> tuple[Scalar, Scalar]:
        """(moment over mu B^3, stretch) at a pressure over mu."""
        f = self.finger
        cell = cell_of(f, share * self.pressure_scale())
        return cell.bent(self.curvature * f.B, self.axial_force / (self.pressure_scale() * f.B**2))

    def observe(self, angle, pressure):
        f = self.finger
        unit = self.pressure_scale() * f.B**2
        moment, stretch = self.bent(angle)
        force, lever = cell_of(f, angle * self.pressure_scale()).touched(self.curvature * f.B)
        return {
            "moment": moment * unit * f.B,
            "contact_force": force * unit,
            "lever_arm": lever * f.B,
            "stretch": stretch,
        }
