"""The chamber's wall as a plate of small strain."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from ...curve_scene import CurveScene
from ...fields import part, to_float_array
from ...membrane import plate_coefficient
from ...results import stop_gradient_where_failed
from ..finger import PneuNet
from ..rules import margins_of_parts
from .arc import Scalar, gap_share, one_chamber
from .base import WallModel


class SmallStrainChamber(CurveScene):
    """Two chamber walls in contact, as plates of small strain.

    The unknown is the angle atan(delta / a). p = C E t_m delta^3 / a^4 (2.1), that is (4.3) with the exponent 1/3; F_p
    = 3 pi a^2 delta p / (4 (delta + h_x)) (4.5); e_y = H/2 + a; C from `membrane.plate_coefficient`, E = 3 mu. As for
    finite strain M_T is the moment of the gap spread over the segment, F_p e_y sqrt(2 h_x / (2 h_x + h_L)); (4.6) as
    printed is force * lever_arm. Contact begins at delta = h_x, where F_p steps up from zero: the thesis assumes that
    all chambers touch.

    Args:
        finger: a uniform finger (or one segment of a nonuniform one).

    Observables:
        - force: F_p of one wall on the next, N, zero before contact.
        - end_moment: M_T, N m, positive in the bending direction.
        - lever_arm: e_y, m.
        - inflation: delta, m.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 4.2, (4.1) to (4.6). It knows no inclination and no limit.

    Examples:
        >>> wall = sg.solve(sg.pneunet.SmallStrainChamber(sg.PneuNet.table_5_1("A")), 15 * kPa)
        >>> print(f"{wall.lever_arm / mm:.2f} mm")  # H/2 + a
        7.50 mm
    """

    finger: PneuNet = part(PneuNet)

    OBSERVABLES: ClassVar[dict[str, str]] = {
        "force": "force",
        "end_moment": "moment",
        "lever_arm": "length",
        "inflation": "length",
    }

    def prepared(self):
        return one_chamber(self)

    def margins_at_rest(self):
        return margins_of_parts(self.finger)

    def interval(self):
        start = jnp.arctan(self.finger.h_x / self.finger.a)
        return start, jnp.zeros_like(start) + PLATE_END

    def unbounded(self):
        return jnp.asarray(True)

    def _stiffness(self):
        f = self.finger
        return plate_coefficient(f.a / f.b) * 3 * f.material.shear_modulus() * f.t_m / f.a

    def load(self, angle):
        return self._stiffness() * jnp.tan(angle) ** 3

    def pressure_scale(self):
        return self.finger.material.shear_modulus() * self.finger.t_m / self.finger.a

    def observe(self, angle, pressure):
        f = self.finger
        inflation = f.a * jnp.tan(angle)
        force = 0.75 * jnp.pi * f.a**2 * inflation * pressure / (inflation + f.h_x)
        lever_arm = 0.5 * f.H + f.a
        return {
            "force": force,
            "end_moment": force * lever_arm * gap_share(f),
            "lever_arm": lever_arm,
            "inflation": inflation,
        }


PLATE_END = 0.5 * jnp.pi * (1 - 1e-9)
"""delta grows without bound as its angle goes to pi/2."""


def small_strain_gap_moment(finger: PneuNet, pressure: Scalar) -> Scalar:
    """F_p e_y of `SmallStrainChamber`, N m, explicit; zero, with zero derivatives, below contact."""
    scene = SmallStrainChamber(finger)
    touching = pressure > scene.load(scene.interval()[0])
    scene, pressure = stop_gradient_where_failed(touching, (scene, pressure))
    inflation = jnp.cbrt(jnp.where(touching, pressure, 1.0) / scene._stiffness())
    observed = scene.observe(jnp.arctan(inflation), pressure)
    return jnp.where(touching, observed["force"] * observed["lever_arm"], 0.0)


def small_strain_end_moment(finger: PneuNet, pressure: Scalar) -> Scalar:
    """M_T of `SmallStrainChamber`, N m, explicit; zero, with zero derivatives, below contact."""
    return small_strain_gap_moment(finger, pressure) * gap_share(finger)


CONTACT_GROWS = 0.02
"""Of the pressure of contact: the way on which the moment of `SmallStrainWalls` comes up."""
MOST_INFLATION = 10.0
"""delta over a where the drive ends: far beyond what a plate of small strain can mean, and beyond all limit points."""


class SmallStrainWalls(WallModel):
    """What drives a finger with drive = "small_strain": the walls of `SmallStrainChamber`.

    M_T(p) is that of `SmallStrainChamber`, explicit, whatever the inclination. There it steps up from zero at contact,
    p_c = C E t_m h_x^3 / a^4; no finger could be followed through a step, so here it comes up on the way from p_c
    to 1.02 p_c, as the smooth step s^3 (10 - 15 s + 6 s^2). The pressure ends at delta = 10 a.

    Source: thesis 4.2, (4.1) to (4.6); the way on which the moment comes up is own.

    Examples:
        >>> finger = sg.PneuNet.table_5_1("A")
        >>> exerted = sg.pneunet.SmallStrainWalls().end_moment(finger, 15 * kPa, 0.0)
        >>> print(f"{exerted / N_mm:.4f} N mm")
        2.5690 N mm
    """

    def end_moment(self, finger, pressure, inclination):
        return small_strain_end_moment(finger, to_float_array(pressure)) * self._come_up(finger, pressure)

    def gap_moment(self, finger: PneuNet, pressure: Scalar) -> Scalar:
        """F_p e_y, N m: `end_moment` without the root, whose derivative is infinite at h_x = 0."""
        return small_strain_gap_moment(finger, pressure) * self._come_up(finger, pressure)

    def _come_up(self, finger: PneuNet, pressure: Any) -> Scalar:
        """The part of the moment that is there so near to contact."""
        begin = self.contact_pressure(finger)
        gap = begin > 0
        s = jnp.clip((to_float_array(pressure) / jnp.where(gap, begin, 1.0) - 1) / CONTACT_GROWS, 0.0, 1.0)
        return jnp.where(gap, s**3 * (10 - 15 * s + 6 * s * s), 1.0)

    def largest_pressure(self, finger):
        return SmallStrainChamber(finger).load(jnp.arctan(MOST_INFLATION))

    def contact_pressure(self, finger):
        scene = SmallStrainChamber(finger)
        return scene.load(scene.interval()[0])


@jax.jit
def small_strain_inflation(finger: PneuNet, pressure: Scalar) -> Scalar:
    """delta of `SmallStrainChamber`, m, below contact, too."""
    return finger.a * jnp.cbrt(pressure / SmallStrainChamber(finger)._stiffness())
