"""The chambers of a finger: two inflated walls that press on each other across the gap (thesis 4.2, 4.3).

The walls are mirror images, so each one presses on a rigid frictionless plane at the distance h_x, inclined by
theta_s once the finger bends. `chamber` answers with a full Solution; `end_moment` is the same moment for the inner
loops of the beam.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..checked import finite, part
from ..curve_scene import CurveScene
from ..membrane import InclinedWall, inclined_wall
from ..numerics.roots import bracketed_root, implicit
from ..results import Solution, gate
from ..scene import solve
from .finger import PneuNet

Scalar = Float[Array, ""]

START = 1e-3
"""The search for the wall's angle starts at this part of the angle of first contact: the wall is flat there."""


class Chamber(CurveScene):
    """Finite-strain walls in inclined contact (4.7)-(4.39). The curve's angle is theta_m2.

    p from (4.30) for any strain energy; F_p = p A_c (4.35), (4.36); e_y = (H/2 + a - rho*) cos theta_s (4.38);
    M_T = F_p e_y sqrt(2 h_x / (2 h_x + h_L)) (4.37), (4.39). Contact begins where c_1 + c_2 = 0; the model ends at
    theta_m2 = pi.

    Args:
        finger: a uniform finger (or one segment of a nonuniform one).
        inclination: theta_s, half the angle between the two walls, rad.
    """

    finger: PneuNet = part(PneuNet)
    inclination: Scalar = finite("angle")

    OBSERVABLES = {
        "force": "force",
        "end_moment": "moment",
        "lever_arm": "length",
        "contact_width": "length",
        "contact_length": "length",
        "stretch": "number",
        "clamp_angle": "angle",
    }

    def wall(self, angle: Scalar) -> InclinedWall:
        """The wall at theta_m2."""
        f = self.finger
        return inclined_wall(angle, f.a, f.b, f.t_m, f.material, f.h_x, self.inclination)

    def interval(self):
        end = jnp.pi + jnp.zeros_like(self.finger.h_x + self.inclination)
        return first_touch(lambda angle: self.wall(angle).contact_width, self._flat(), end), end

    def _flat(self):
        return START * jnp.arctan(self.finger.h_x / self.finger.a)

    def load(self, angle):
        return self.wall(angle).pressure

    def pressure_scale(self):
        return self.finger.material.shear_modulus() * self.finger.t_m / self.finger.a

    def observe(self, angle, pressure):
        f, wall = self.finger, self.wall(angle)
        force = pressure * wall.contact_area
        lever_arm = (0.5 * f.H + f.a - wall.rho) * jnp.cos(self.inclination)
        return {
            "force": force,
            "end_moment": force * lever_arm * jnp.sqrt(2 * f.h_x / f.pitch),
            "lever_arm": lever_arm,
            "contact_width": wall.contact_width,
            "contact_length": wall.c_z,
            "stretch": wall.stretch,
            "clamp_angle": angle,
        }


def first_touch(width, low: Scalar, high: Scalar) -> Scalar:
    """theta_m2 where the contact width is zero and rising; no derivatives (nothing depends on it but a bracket)."""
    return lax.stop_gradient(bracketed_root(lambda angle: lax.stop_gradient(width(angle)), low, high).x)


def chamber(finger: PneuNet, pressure: Any, inclination: Any = 0.0) -> Solution:
    """The contact of two chambers at a pressure (Pa) and an inclination theta_s (rad): see `Chamber`."""
    return solve(Chamber(finger, inclination), pressure)


def contact_pressure(finger: PneuNet, inclination: Any = 0.0) -> Scalar:
    """The pressure (Pa) at which two chambers begin to press on each other: c_1 + c_2 = 0. Differentiable.

    At theta_s = 0 this is where the freely inflated wall reaches the plane, (4.15), (4.16). Inclined, the two differ:
    the free arc (4.18) touches a little earlier (type A: by 7 % at 0.02 rad, 16 % at 0.15), because (4.28) measures
    the stretch of the exterior part alone.
    """
    scene = Chamber(finger, inclination)
    angle = implicit(lambda x, scene: scene.wall(x).contact_width / scene.finger.a, scene.interval()[0], scene)
    return scene.load(angle)


def wall_limit(finger: PneuNet, inclination: Any = 0.0) -> Scalar:
    """The pressure (Pa) at which theta_m2 reaches pi, where the model of the wall ends."""
    scene = Chamber(finger, inclination)
    return scene.load(scene.interval()[1])


def end_moment(finger: PneuNet, pressure: Scalar, inclination: Scalar) -> Scalar:
    """M_T of `Chamber`, N m, by one scalar root: for inner loops. Zero, with zero derivatives, below contact.

    NaN beyond `wall_limit`.
    """
    scene = Chamber(finger, inclination)
    frozen, target = lax.stop_gradient((scene, pressure))
    scale = frozen.pressure_scale()
    end = jnp.pi + jnp.zeros_like(target + frozen.inclination)

    def residual(angle, args):
        scene, pressure, scale = args
        return (scene.load(angle) - pressure) / scale

    angle = bracketed_root(lambda x: residual(x, (frozen, target, scale)), frozen._flat() + 0 * end, end).x
    inside = target <= frozen.load(end)
    touching = inside & (frozen.wall(angle).contact_width > 0)
    scene, pressure = gate(touching, (scene, pressure))
    angle = implicit(residual, angle, (scene, pressure, scale))
    moment = scene.observe(angle, pressure)["end_moment"]
    return jnp.where(touching, moment, jnp.where(inside, 0.0, jnp.nan))
