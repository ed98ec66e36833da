"""The chambers of a finger: two inflated walls that press on each other across the gap (thesis 4.2, 4.3).

The walls are mirror images, so each one presses on a rigid frictionless plane at the distance h_x, inclined by
theta_s once the finger bends. `chamber` answers with a full Solution; `end_moment` is the same moment for the inner
loops of the beam.
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...curve_scene import CurveScene
from ...errors import InputError
from ...fields import finite, part
from ...membrane import InclinedWall, Seat, inclined_wall, wall_seat
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import bracketed_root
from ...reasons import RULE_NAMES
from ...scene import frozen
from ...shell.flat_shell import has_largest_stretch, locking_angle
from ..finger import PneuNet
from ..rules import margins_of_parts

Scalar = Float[Array, ""]
START = 1e-3
"""The search for the wall's angle starts at this part of the angle of first contact: the wall is flat there."""
LEAST_ANGLE = 1e-6
"""The search does not start at zero, for chambers without a gap: at this angle the pressure is 1e-18 mu t_m / a."""


class Chamber(CurveScene):
    """Two finite-strain chamber walls in inclined contact.

    The unknown is the exterior clamp angle theta_m2. p = 2 T(lambda) / R from (4.30) for any strain energy; F_p = p A_c
    (4.35), (4.36); e_y = (H/2 + a - rho*) cos theta_s (4.38); M_T = F_p e_y sqrt(2 h_x / (2 h_x + h_L)) (4.37), (4.39).
    Contact begins where c_1 + c_2 = 0; the model ends at theta_m2 = pi.

    The thesis has walls that open towards the outside, theta_s >= 0. Where they close (a finger bent backwards, theta_s
    < 0) the same wall is seen from its other edge: at the distance h_x + 2 a sin(theta_s), inclined by -theta_s,
    touching first at -rho*. That is continuous, with a kink at theta_s = 0, where derivatives are those of the opening
    side. IMPOSSIBLE where the outer edges would overlap.

    Args:
        finger: a uniform finger (or one segment of a nonuniform one).
        inclination: theta_s, half the angle between the two walls, rad.

    Observables:
        - force: F_p of one wall on the next, N, zero before contact.
        - end_moment: M_T, N m, positive in the bending direction.
        - lever_arm: e_y, m.
        - contact_width, contact_length: axes c_y and c_z of the elliptical contact, m.
        - stretch: lambda, dimensionless.
        - clamp_angle: theta_m2, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 4.3, (4.7) to (4.39); theta_s < 0 is own. Against finite elements the force is 40 % low.

    Examples:
        >>> wall = sg.solve(sg.pneunet.Chamber(sg.PneuNet.table_5_1("A"), inclination=0.0), 31 * kPa)
        >>> print(f"{wall.force:.5f} N, {wall.end_moment / N_mm:.5f} N mm")
        1.44419 N, 5.93261 N mm
    """

    finger: PneuNet = part(PneuNet)
    inclination: Scalar = finite("angle")

    OBSERVABLES: ClassVar[dict[str, str]] = {
        "force": "force",
        "end_moment": "moment",
        "lever_arm": "length",
        "contact_width": "length",
        "contact_length": "length",
        "stretch": "number",
        "clamp_angle": "angle",
    }

    def nearer_edge(self) -> tuple[Scalar, Scalar]:
        """Distance of the contact plane from the wall's nearer edge, m, and its inclination away from there."""
        f, th_s = self.finger, self.inclination
        return jnp.where(th_s < 0, f.h_x + 2 * f.a * jnp.sin(th_s), f.h_x), jnp.where(th_s < 0, -th_s, th_s)

    def wall(self, angle: Scalar) -> InclinedWall:
        """The wall at theta_m2."""
        f = self.finger
        distance, incline = self.nearer_edge()
        return inclined_wall(angle, f.a, f.b, f.t_m, f.material, distance, incline)

    def seat(self) -> Seat:
        """What of the wall does not depend on theta_m2."""
        return wall_seat(self.finger.a, *self.nearer_edge())

    def prepared(self):
        return one_chamber(self)

    def is_possible(self):
        return self.nearer_edge()[0] >= 0

    def margins_at_rest(self):
        return margins_of_parts(self.finger) | {"chambers_apart": 2 * self.nearer_edge()[0]}

    def search_interval(self) -> tuple[Scalar, Scalar]:
        """theta_m2 from a flat wall to the end of the model."""
        f = self.finger
        start = START * jnp.arctan(jnp.maximum(self.nearer_edge()[0], 0.0) / f.a) + LEAST_ANGLE
        end = jnp.pi + jnp.zeros_like(start)
        if has_largest_stretch(f.material):
            end = locking_angle(self._stretchable, start, end)
        return start, end

    def _stretchable(self, angle):
        stretch = self.wall(angle).stretch
        return self.finger.material.stretchable(stretch, stretch)

    def interval(self):
        low, end = self.search_interval()
        fixed = frozen(self)

        def width(angle, scene):
            return scene.wall(angle).contact_width / scene.finger.a

        return implicit(width, bracketed_root(lambda angle: width(angle, fixed), low, end).x, self), end

    def unbounded(self):
        if not has_largest_stretch(self.finger.material):
            return jnp.asarray(False)
        return self._stretchable(jnp.pi + jnp.zeros_like(self.finger.h_x)) <= 0

    def load(self, angle):
        return self.wall(angle).pressure

    def pressure_scale(self):
        return self.finger.material.shear_modulus() * self.finger.t_m / self.finger.a

    def observe(self, angle, pressure):
        f, wall = self.finger, self.wall(angle)
        force = pressure * wall.contact_area
        rho = jnp.where(self.inclination < 0, -wall.rho, wall.rho)
        lever_arm = (0.5 * f.H + f.a - rho) * jnp.cos(self.inclination)
        return {
            "force": force,
            "end_moment": force * lever_arm * gap_share(f),
            "lever_arm": lever_arm,
            "contact_width": wall.contact_width,
            "contact_length": wall.c_z,
            "stretch": wall.stretch,
            "clamp_angle": angle,
        }


def within(finger: PneuNet, inclination: Any) -> Chamber:
    """The chamber as a part of another scene, which judges the rules of its parts itself."""
    return Chamber(finger, inclination, ignored_rules=RULE_NAMES)  # pyright: ignore[reportCallIssue]


def one_chamber(scene: Any) -> Any:
    """The scene itself, unless its finger has chambers of several kinds (when asked: a batch of scenes may be made)."""
    if scene.finger.segments is not None:
        raise InputError(
            f"{type(scene).__name__} is one chamber and its finger has lists; give one number each, or ask "
            "pneunet.chamber(finger, pressure) for all."
        )
    return scene


def gap_share(finger: PneuNet) -> Scalar:
    """sqrt(2 h_x / (2 h_x + h_L)) of (4.39): the moment on the gap as one on the whole segment, of equal energy.

    Zero for h_x = 0, where its derivative by h_x, infinite in truth, is given as zero.
    """
    gap = finger.h_x > 0
    return jnp.where(gap, jnp.sqrt(jnp.where(gap, 2 * finger.h_x, 1.0) / finger.pitch), 0.0)
