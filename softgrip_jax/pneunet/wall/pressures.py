"""What pressure does to a chamber, and the pressure that does it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ...errors import InputError
from ...fields import is_concrete, to_float_array
from ...membrane import Seat, seated_pressure, tension_over_strain
from ...numerics.choice import larger
from ...numerics.implicit import implicit
from ...numerics.scalar_roots import bracketed_root, newton_bracketed
from ...numerics.xla import differentiated_once
from ...questions import contact_pressure as scene_contact_pressure
from ...questions import limit_pressure, solve
from ...results import Solution, Status, stop_gradient_where_failed
from ..finger import SEGMENT_FIELDS, PneuNet
from .arc import LEAST_ANGLE, Chamber, Scalar, within
from .small_strain import SmallStrainChamber

NO_PRESSURE = 1e-15
"""A wall under less than this part of the largest pressure counts as flat."""
CUBIC_STEPS = 3
"""From twice the root at most they leave 1e-2 of it."""
LEAST_DEPTH = 1e-12
"""m: a depth below it counts as none, so that nothing is divided by zero."""
SLOWER = 0.08
"""With this the cubic law is good to 1 % of the angle up to one radian."""


def chamber(
    finger: PneuNet,
    pressure: Any,
    inclination: Any = 0.0,
    model: str = "finite",
    ignored_rules: tuple[str, ...] = (),
) -> Solution:
    """The contact of two chambers of a finger at a pressure.

    Args:
        finger: the actuator.
        pressure: gauge pressure, Pa, a scalar.
        inclination: theta_s, rad; of a nonuniform finger one for all, or shape (n,).
        model: "finite", see `Chamber`; "small", see `SmallStrainChamber` (without inclination).
        ignored_rules: names of rules that may be broken, as in every scene.

    Returns:
        The `Solution`; of a nonuniform finger a batch with one member per segment.

    Raises:
        InputError: for another model, and for an inclination with model "small".

    Source: thesis 4.2 and 4.3.

    Examples:
        >>> wall = sg.pneunet.chamber(sg.PneuNet.table_5_1("A"), 31 * kPa, inclination=0.15)
        >>> print(f"{wall.end_moment / N_mm:.5f} N mm")
        0.99699 N mm
    """
    if model not in ("finite", "small"):
        raise InputError(f"model is {model!r}; it must be 'finite' or 'small'.")
    if model == "small" and not (is_concrete(to_float_array(inclination)) and jnp.all(inclination == 0)):
        raise InputError("The inclination is not 0; walls of small strain cannot incline.")

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
    """The pressure at which two chambers begin to press on each other.

    It is where c_1 + c_2 = 0. At theta_s = 0 that is where the freely inflated wall reaches the plane, (4.15), (4.16).
    Inclined, the two differ: the free arc (4.18) touches a little earlier (type A: by 7 % at 0.02 rad, 16 % at 0.15),
    because (4.28) measures the stretch of the exterior part alone.

    Args:
        finger: a uniform finger.
        inclination: theta_s, rad.

    Returns:
        The pressure, Pa, differentiable.

    Raises:
        InputError: where the finger cannot be meant (outside of jit).

    Source: thesis 4.3.

    Examples:
        >>> finger = sg.PneuNet.table_5_1("A")
        >>> at_contact = sg.pneunet.chamber(finger, sg.pneunet.contact_pressure(finger) * 1.001)
        >>> bool(0 < at_contact.force < 1e-3)
        True
    """
    return scene_contact_pressure(Chamber(finger, inclination))


def wall_limit(finger: PneuNet, inclination: Any = 0.0) -> Scalar:
    """The pressure at which the model of a neo-Hookean wall ends, theta_m2 = pi.

    Args:
        finger: a uniform finger.
        inclination: theta_s, rad.

    Returns:
        The pressure, Pa, differentiable; see also `sg.limit_pressure`.

    Raises:
        InputError: where the finger cannot be meant (outside of jit).

    Source: thesis 4.3.

    Examples:
        >>> finger = sg.PneuNet.table_5_1("A")
        >>> limit = sg.limit_pressure(sg.pneunet.Chamber(finger, inclination=0.0))
        >>> bool(jnp.isclose(sg.pneunet.wall_limit(finger), limit))
        True
    """
    scene = within(finger, inclination)
    return limit_pressure(scene)


@differentiated_once
def end_moment(finger: PneuNet, pressure: Scalar, inclination: Scalar) -> Scalar:
    """M_T of `Chamber`, N m, for inner loops. Zero, with zero derivatives, below contact; NaN where there is none."""
    return _of_touching(lambda observed: observed["end_moment"], finger, pressure, inclination)


@differentiated_once
def gap_moment(finger: PneuNet, pressure: Scalar, inclination: Scalar) -> Scalar:
    """As `end_moment`, but on the gap, F_p e_y: without the root, whose derivative is infinite at h_x = 0."""
    return _of_touching(lambda observed: observed["force"] * observed["lever_arm"], finger, pressure, inclination)


def _of_touching(
    moment_of: Callable[[dict[str, Array]], Scalar], finger: PneuNet, pressure: Scalar, inclination: Scalar
) -> Scalar:
    """A moment (N m) of what `Chamber` observes; zero below contact, NaN where there is none.

    A wall whose pressure rises all along theta_m2 (neo-Hookean) is one scalar root; other materials are searched as the
    scene is, for the first rising branch.
    """
    scene = within(finger, inclination)
    fixed, target = lax.stop_gradient((scene, pressure))
    if finger.material.closed_forms().has_rising_wall:
        low, high = fixed.search_interval()
        seat, t_m, material = fixed.seat(), fixed.finger.t_m, fixed.finger.material

        def load(angle):
            return seated_pressure(angle, seat, t_m, material)

        flat, most = jax.vmap(load)(jnp.stack([low, high]))
        # Rounding may leave a wall that is all but flat a pressure below zero.
        flat = jnp.maximum(flat, NO_PRESSURE * most)
        wanted = jnp.maximum(target, flat)
        guess = _little_inflated(seat, wanted / tension_over_strain(material, t_m, jnp.zeros_like(t_m)))
        guess = guess + SLOWER * guess * guess  # the pressure of a round wall rises a little more slowly
        angle = newton_bracketed(lambda x: jnp.log(load(x) / wanted), low, high, guess).x
        inside = (target <= most) & fixed.is_possible()
        touching = inside & (fixed.wall(angle).contact_width > 0)
    else:
        found = fixed.solver().find(fixed, target, None)
        angle, touching = found.unknowns, found.status == Status.OK
        inside = touching | (found.status == Status.NO_CONTACT)
    scene, pressure = stop_gradient_where_failed(touching, (scene, pressure))
    angle = implicit(lambda x, args: args[0].residual(x, args[1]), angle, (scene, pressure))
    moment = moment_of(scene.observe(angle, pressure))
    return jnp.where(touching, moment, jnp.where(inside, 0.0, jnp.nan))


def _little_inflated(seat: Seat, pressure: Scalar) -> Scalar:
    """theta_m2 of a wall that is inflated a little, by the pressure over its stiffness T / (lambda - 1), 1/m.

    With (4.28) to first order in theta, strain = theta depth / (3 outer) + lean, p = theta^2 strain / depth is a cubic.
    It is convex from its root on, and Newton's method comes down to it from above.
    """
    slack, cube = -3 * seat.outer * seat.lean / jnp.maximum(seat.depth, LEAST_DEPTH), 3 * seat.outer * pressure
    angle = slack + jnp.cbrt(cube)
    for _ in range(CUBIC_STEPS):
        angle -= (angle * angle * (angle - slack) - cube) / (angle * (3 * angle - 2 * slack))
    return angle


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
