"""What pressure does to a chamber, and the pressure that does it."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ...errors import InputError
from ...fields import is_concrete, to_float_array
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
"""Of the largest pressure: a wall under less is flat."""
SLOWER = 0.08
"""With this the cubic law is good to 1 % of the angle up to one radian."""


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
        # Rounding may leave a wall that is all but flat a pressure below zero.
        flat = jnp.maximum(flat, NO_PRESSURE * most)
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
    scene, pressure = stop_gradient_where_failed(touching, (scene, pressure))
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
