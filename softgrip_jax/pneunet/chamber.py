"""The chambers of a finger: two inflated walls that press on each other across the gap (thesis 4.2, 4.3).

The walls are mirror images, so each one presses on a rigid frictionless plane at the distance h_x, inclined by
theta_s once the finger bends. `chamber` answers with a full Solution; `end_moment` is the same moment for the inner
loops of the beam.
"""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..curve_scene import CurveScene
from ..errors import InputError
from ..fields import finite, is_concrete, part, to_float_array
from ..membrane import InclinedWall, inclined_wall, plate_coefficient
from ..numerics.choice import larger
from ..numerics.once import differentiated_once
from ..numerics.roots import bracketed_root, implicit, newton_bracketed
from ..reasons import RULE_NAMES
from ..results import Solution, Status, gate
from ..scene import contact_pressure as scene_contact_pressure
from ..scene import frozen, limit_pressure, solve
from ..shell.flat_shell import has_largest_stretch, locking_angle
from .finger import SEGMENT_FIELDS, PneuNet
from .rules import margins_of_parts

Scalar = Float[Array, ""]

SLOWER = 0.08
"""With this the cubic law is good to 1 % of the angle up to one radian."""
START = 1e-3
"""The search for the wall's angle starts at this part of the angle of first contact: the wall is flat there."""
LEAST_ANGLE = 1e-6
"""... but not at zero, for chambers without a gap: at this angle the pressure is 1e-18 mu t_m / a."""


class Chamber(CurveScene):
    """Finite-strain walls in inclined contact (4.7)-(4.39). The curve's angle is theta_m2.

    p from (4.30) for any strain energy; F_p = p A_c (4.35), (4.36); e_y = (H/2 + a - rho*) cos theta_s (4.38);
    M_T = F_p e_y sqrt(2 h_x / (2 h_x + h_L)) (4.37), (4.39). Contact begins where c_1 + c_2 = 0; the model ends at
    theta_m2 = pi.

    The thesis has walls that open towards the outside, theta_s >= 0. Where they close (a finger bent backwards,
    theta_s < 0) the same wall is seen from its other edge: at the distance h_x + 2 a sin(theta_s), inclined by
    -theta_s, touching first at -rho*. That is continuous, with a kink at theta_s = 0, where derivatives are those of
    the opening side. IMPOSSIBLE where the outer edges would overlap.

    Args:
        finger: a uniform finger (or one segment of a nonuniform one).
        inclination: theta_s, half the angle between the two walls, rad.
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

    def prepared(self):
        return _one_chamber(self)

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


def _one_chamber(scene: Any) -> Any:
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


class SmallStrainChamber(CurveScene):
    """Infinitesimal-strain chambers, (4.1)-(4.6): the cheap rung. The curve's angle is atan(delta / a).

    p = C E t_m delta^3 / a^4 (2.1), that is (4.3) with the exponent 1/3; F_p = 3 pi a^2 delta p / (4 (delta + h_x))
    (4.5); e_y = H/2 + a. C from `membrane.plate_coefficient`, E = 3 mu. It knows no inclination and no limit. As for
    finite strain, M_T is the moment of the gap spread over the segment, F_p e_y sqrt(2 h_x / (2 h_x + h_L)); (4.6) as
    printed is force * lever_arm. Contact begins at delta = h_x, where F_p steps up from zero: the thesis assumes that
    all chambers touch.
    """

    finger: PneuNet = part(PneuNet)

    OBSERVABLES: ClassVar[dict[str, str]] = {
        "force": "force",
        "end_moment": "moment",
        "lever_arm": "length",
        "inflation": "length",
    }

    def prepared(self):
        return _one_chamber(self)

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


def chamber(
    finger: PneuNet,
    pressure: Any,
    inclination: Any = 0.0,
    model: str = "finite",
    ignored_rules: tuple[str, ...] = (),
) -> Solution:
    """The contact of two chambers at a pressure (Pa) and an inclination theta_s (rad).

    model: "finite", see `Chamber`; "small", see `SmallStrainChamber` (without inclination). For a nonuniform finger
    the Solution is a batch, one lane per segment (inclination: one for all, or one per segment). ignored_rules: as in
    every scene.
    """
    if model not in ("finite", "small"):
        raise InputError(f"model is {model!r}; it must be 'finite' or 'small'.")
    if model == "small" and not (is_concrete(to_float_array(inclination)) and jnp.all(inclination == 0)):
        raise InputError("The small-strain chamber knows no inclination: it must be 0.")

    def one(finger, inclination):
        if model == "small":
            scene = SmallStrainChamber(finger, ignored_rules=ignored_rules)  # pyright: ignore[reportCallIssue]
            return solve(scene, pressure)
        scene = Chamber(finger, inclination, ignored_rules=ignored_rules)  # pyright: ignore[reportCallIssue]
        return solve(scene, pressure)

    if finger.segments is None:
        return one(finger, inclination)
    count = finger.segments
    fields = {name: jnp.broadcast_to(getattr(finger, name), (count,)) for name in SEGMENT_FIELDS}
    inclination = jnp.broadcast_to(to_float_array(inclination), (count,))
    return jax.vmap(lambda fields, th_s: one(dataclasses.replace(finger, **fields), th_s))(fields, inclination)


def contact_pressure(finger: PneuNet, inclination: Any = 0.0) -> Scalar:
    """The pressure (Pa) at which two chambers begin to press on each other: c_1 + c_2 = 0. Differentiable.

    At theta_s = 0 this is where the freely inflated wall reaches the plane, (4.15), (4.16). Inclined, the two differ:
    the free arc (4.18) touches a little earlier (type A: by 7 % at 0.02 rad, 16 % at 0.15), because (4.28) measures
    the stretch of the exterior part alone.
    """
    return scene_contact_pressure(Chamber(finger, inclination))


def wall_limit(finger: PneuNet, inclination: Any = 0.0) -> Scalar:
    """The pressure (Pa) at which the model of a neo-Hookean wall ends, theta_m2 = pi; see also `limit_pressure`."""
    scene = within(finger, inclination)
    return limit_pressure(scene)


@differentiated_once
def end_moment(finger: PneuNet, pressure: Scalar, inclination: Scalar) -> Scalar:
    """M_T of `Chamber`, N m, for inner loops. Zero, with zero derivatives, below contact; NaN where there is none.

    A wall whose pressure rises all along theta_m2 (neo-Hookean) is one scalar root; other materials are searched as the
    scene is, for the first rising branch.
    """
    scene = within(finger, inclination)
    fixed, target = lax.stop_gradient((scene, pressure))
    if finger.material.closed_forms().has_rising_wall:
        low, high = fixed.search_interval()
        # The pressure of a flat wall rises with the third power of its angle, of a round one a little more slowly.
        flat, most = jax.vmap(fixed.load)(jnp.stack([low, high]))
        wanted = jnp.maximum(target, flat)
        guess = low * jnp.cbrt(wanted / flat)
        guess = guess + SLOWER * guess * guess
        angle = newton_bracketed(lambda x: jnp.log(fixed.load(x) / wanted), low, high, guess).x
        inside = (target <= most) & fixed.is_possible()
        touching = inside & (fixed.wall(angle).contact_width > 0)
    else:
        found = fixed.find(target)
        angle, touching = found.unknowns, found.status == Status.OK
        inside = touching | (found.status == Status.NO_CONTACT)
    scene, pressure = gate(touching, (scene, pressure))
    angle = implicit(lambda x, args: args[0].residual(x, args[1]), angle, (scene, pressure))
    moment = scene.observe(angle, pressure)["end_moment"]
    return jnp.where(touching, moment, jnp.where(inside, 0.0, jnp.nan))


def touching_angle(finger: PneuNet) -> Scalar:
    """theta_m2 where parallel walls touch: the free arc that reaches the plane, (4.15)."""
    return larger(2 * jnp.arctan(finger.h_x / finger.a), LEAST_ANGLE)


def pressure_of_moment(finger: PneuNet, moment: Scalar, wanted: Bool[Array, ""] | bool = True) -> Scalar:
    """The pressure (Pa) at which parallel neo-Hookean walls exert M_T (N m): the inverse of `end_moment`.

    Pressure and area of contact grow together with theta_m2, so there is one. More than the walls can exert gives a
    pressure beyond `wall_limit`. No derivatives pass through. Where it is not wanted nothing is searched for.
    """
    scene, moment = lax.stop_gradient((within(finger, jnp.zeros_like(finger.L)), moment))
    low = touching_angle(finger)
    high = jnp.pi + jnp.zeros_like(low)

    def exerted(angle):
        return scene.observe(angle, scene.load(angle))["end_moment"]

    angle = bracketed_root(lambda angle: exerted(angle) - moment, low, jnp.where(wanted, high, low)).x
    most = exerted(high)
    return scene.load(jnp.where(moment > 0, angle, low)) * jnp.where(moment > most, moment / most, 1.0)


def small_strain_end_moment(finger: PneuNet, pressure: Scalar) -> Scalar:
    """M_T of `SmallStrainChamber`, N m, explicit; zero, with zero derivatives, below contact."""
    scene = SmallStrainChamber(finger)
    touching = pressure > scene.load(scene.interval()[0])
    scene, pressure = gate(touching, (scene, pressure))
    inflation = jnp.cbrt(jnp.where(touching, pressure, 1.0) / scene._stiffness())
    return jnp.where(touching, scene.observe(jnp.arctan(inflation), pressure)["end_moment"], 0.0)
