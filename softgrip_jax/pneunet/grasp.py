"""A gripper of n fingers around an object (thesis 4.4.2, 5.2.3): pressure for a mass, and mass for a pressure."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import Checked, choice, count, finite, is_concrete, part, positive, vector
from ..numerics.choice import larger, smaller, smallest
from ..numerics.continuation import REACHED, follow
from ..numerics.implicit import implicit
from ..objects.friction import friction_force, required_normal_force
from ..objects.grasped import Object, Taper
from ..questions import to_solve
from ..results import Status, stop_gradient_where_failed
from ..scene import Scene, frozen, type_name
from ..units import GRAVITY
from .beam.method import POINTS, BeamMethod, beam_method
from .finger import PneuNet
from .finger_scene import INCLINATIONS, FingerScene, Scalar, to_weight
from .rules import clear_of_clamp, end_inside, line_inside, lowest_of_chambers, side_by_side
from .section.base import SectionLaw
from .section.choice import section
from .tip_contact import HeldTip


class Gripper(Checked):
    """Equal fingers on a circle that point the same way and bend towards its axis.

    Args:
        finger: the actuator.
        n: how many, 2 or more.
        base_radius: distance from the axis, at rest, of the lines of the fingers that touch the object, m.
        touch: which lines touch: "face", the faces of the covers, or "midline", the covers' mid-lines, half a thickness
            H further out. The thesis has its mid-lines touch, and its numbers are those of "midline".

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 4.4.2; "face" is own.

    Examples:
        >>> gripper = sg.pneunet.Gripper(sg.PneuNet.table_5_1("A"), n=3, base_radius=19.61 * mm)
        >>> print(f"{gripper.midline_radius() / mm:.2f} mm")  # H/2 further out
        22.11 mm
    """

    finger: PneuNet = part(PneuNet)
    n: int = eqx.field(static=True, default=3)
    base_radius: Scalar = positive("length", default=0.01961)
    touch: str = choice("face", "midline", default="face")

    def __check_init__(self) -> None:
        if not isinstance(self.n, int) or isinstance(self.n, bool) or self.n < 2:
            raise InputError(f"Gripper.n is {self.n!r}; it must be a whole number, 2 or more.")

    def touching_depth(self) -> Scalar:
        """Distance of the line that touches from the mid-line, m: H/2 for the face of the cover."""
        half = 0.5 * self.finger.H
        return half if self.touch == "face" else 0.0 * half

    def midline_radius(self) -> Scalar:
        """Distance of the mid-lines from the axis at rest, m."""
        return self.base_radius + self.touching_depth()

    def placed(self, x: Float[Array, " m"], y: Float[Array, " m"]) -> Float[Array, "n m 3"]:
        """A mid-line (x, y) for every finger in global coordinates: Z along the fingers, origin in the base."""
        around = 2 * jnp.pi * jnp.arange(self.n) / self.n
        radius = self.midline_radius() + y
        return jnp.stack(
            [
                jnp.cos(around)[:, None] * radius[None],
                jnp.sin(around)[:, None] * radius[None],
                jnp.broadcast_to(x, (self.n, x.shape[0])),
            ],
            axis=-1,
        )


class Grasp(FingerScene):
    """Fingertips pinch an object and lift it.

    Each tip pulls H_ext = m g / n and must press with F_ext: mu_f F_ext = m g / n on upright faces, more on faces that
    lean (`objects.OnSlope`). What touches is the end of the cover's face (gripper.touch = "face"), half a thickness H
    from the end of its mid-line along the normal. With theta (minus tip_angle), x and y of the mid-line's end, and the
    base radius of the faces,

        y = radius(z) - base_radius - H/2 (1 - cos(theta)),   z = stand_distance - (x + H/2 sin(theta))

    and without the terms in H for "midline". The thickness is the one at rest: the cover thins by its stretch, a
    percent or two of H/2. The forces on the tip act on the end of the mid-line, so their small moment about it, at most
    H/2 times the pull m g / n, is left out.

    A tip presses or is free: where only a pull would keep it on the object, the grasp is NO_CONTACT and its force
    exactly zero. `contact_pressure` is where the tips begin to press, with the weight of the object on them; where they
    press already it is where the pressure begins to act, and inf where equilibrium ends before they press.

    Its rules (`ignored_rules`): at rest no finger is inside the object, another finger or the plane that the object
    stands on, nor the object inside the palm. In a bent state the line that touches stays outside the object along the
    whole finger (up to the palm where the object's height is not given), and so does the end of the cover, which turns
    into an upright face beyond 90 degrees; fingers stay apart, and so do their chambers; nothing reaches behind the
    palm, nor chambers below the plane that the object stands on.

    Args:
        gripper: the fingers and where they are clamped.
        object: what is held; its mass and friction are the task.
        tip_offset: y_c of the tip's mid-line, m, where it is known; by default it follows from the object's radius.
        stand_distance: distance from the gripper's base to the plane that the object stands on, m: needed for objects
            that taper, whose radius is taken at the height of the tip.
        weight: (g_x, g_y) of the finger, N/m; shape (2,). The default hangs the thesis's finger.
        section, inclination, points, beam, drive, moment_spread, loading: as in TipContact.

    Observables:
        - tip_force: of each tip on the object, N.
        - required_force: F_ext, N; inf where no force does it.
        - security: what friction lifts over the load, mu_f(F) F of upright faces, dimensionless: 1 is just held.
        - tip: (x, y) of the mid-line's end, m, shape (2,).
        - tip_angle: turn of the tip, rad, positive in the bending direction.
        - end_moment: M_T, N m, positive in the bending direction.

    Raises:
        InputError: where a field breaks its rule, or stand_distance is missing (outside of jit); where the object has
            flat faces and the fingers, equally spaced, do not all meet the middle of one.

    Source: thesis 4.4.2, 5.2.3, algorithm 7; "face" is own.

    Examples:
        >>> gripper = sg.pneunet.Gripper(sg.PneuNet.table_5_1("A"), base_radius=19.61 * mm, touch="midline")
        >>> rod = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
        >>> grasp = sg.pneunet.Grasp(gripper, rod, section="thesis", points=8)
        >>> print(f"{sg.solve(grasp, 26.47 * kPa).security:.3f}")  # just held; the thesis, which steps: 28 kPa
        1.000
    """

    gripper: Gripper = part(Gripper)
    object: Object = part(Object)
    tip_offset: Scalar | None = finite("length", default=None)
    stand_distance: Scalar | None = positive("length", default=None)
    weight: Float[Array, "*batch 2"] | None = vector("force_per_length", to_weight, default=(2.0, 0.0))
    section: str | SectionLaw = section(default="exact")
    inclination: str = choice(*INCLINATIONS, default="none")
    points: int = count(default=POINTS)
    beam: BeamMethod | None = beam_method()

    OBSERVABLES: ClassVar = {
        "tip_force": "force",
        "required_force": "force",
        "security": "number",
        "tip": "position",
        "tip_angle": "angle",
        "end_moment": "moment",
    }
    SAME_AT_ALL_PRESSURES: ClassVar = ("required_force",)

    def __check_init__(self) -> None:
        if self.object.tapers and self.tip_offset is None and self.stand_distance is None:
            raise InputError(
                f"Grasp.stand_distance is missing: the radius of a {type(self.object).__name__} depends on the height "
                "of the tip, so give stand_distance, or tip_offset itself."
            )
        n, faces = self.gripper.n, self.object.FACES
        if faces % n:
            fitting = ", ".join(str(k) for k in range(2, faces + 1) if faces % k == 0)
            raise InputError(
                f"Gripper.n is {n}, and a {type(self.object).__name__} has {faces} faces, so that fingers would meet "
                f"its edges; n that fit: {fitting}."
            )

    @property
    def finger(self) -> PneuNet:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The gripper's finger."""
        return self.gripper.finger

    def tip(self):
        return HeldTip(self.pull(), self.offset_at, True)

    def pull(self) -> Scalar:
        """What each tip carries along +x, N: m g / n."""
        return self.object.mass * GRAVITY / self.gripper.n

    def offset_at(self, x: Scalar, angle: Scalar | float = 0.0) -> Scalar:
        """The y (m) of the mid-line's end at x (m) and with the direction theta = angle (rad) where the tip touches."""
        if self.tip_offset is not None:
            return self.tip_offset
        gripper = self.gripper
        depth = gripper.touching_depth()
        if gripper.touch == "face" and self.stand_distance is not None:
            x = x + depth * jnp.sin(angle)
        height = 0.0 * x if self.stand_distance is None else self.stand_distance - x
        away = self.object.radius_at(height) - gripper.base_radius
        return away - depth * (1 - jnp.cos(angle)) if gripper.touch == "face" else away

    def margins_at_rest(self):
        gripper, finger, held = self.gripper, self.finger, self.object
        stand = self.stand_distance
        # Of what tapers the widest place beside the finger is the lowest one: at its tip, or where the object stands.
        lowest = 0.0 * finger.L if stand is None else larger(stand - finger.L, 0.0)
        clear = gripper.base_radius - held.radius_at(lowest) if self.tip_offset is None else -self.tip_offset
        margins = super().margins_at_rest() | {
            "clear_of_object_at_rest": clear,
            "fingers_apart_at_rest": side_by_side(gripper.base_radius, gripper.n, finger.B),
        }
        if stand is not None:
            margins["clear_of_ground_at_rest"] = stand - finger.L
            if isinstance(held, Taper):
                margins["clear_of_palm"] = stand - held.height
        return margins

    def margins_of_state(self, unknowns, pressure):
        gripper, finger = self.gripper, self.finger
        parts, points = self.chambers()
        line = self.line(self.curvatures(unknowns), unknowns[0], jnp.ones_like(pressure), pressure)[1]
        depth = gripper.touching_depth()
        x, y = (finger.L * at for at in line_inside(line, parts, depth / finger.L, points))
        radius = gripper.midline_radius() + y
        tip_x, tip_y = (finger.L * at for at in end_inside(line, depth / finger.L))
        touched = gripper.midline_radius() + tip_y
        nearest = smaller(smallest(radius), touched)
        margins = super().margins_of_state(unknowns, pressure) | {
            "clear_of_clamp": clear_of_clamp(finger, parts, line, points),
            "fingers_apart": side_by_side(nearest, gripper.n, finger.B),
        }
        # At the tip itself the two just touch, so the points before it are asked; and the edge of the end that is on
        # the side of the chambers, which a tip that turns on pushes into the object.
        edge_x, edge_y = (finger.L * at for at in end_inside(line, -0.5 * finger.H / finger.L))
        places = jnp.append(x, edge_x)
        faces = self.face_at(places) - (0.0 if self.tip_offset is None else self.face_at(tip_x) - touched)
        margins["clear_of_object"] = smallest(jnp.append(radius, gripper.midline_radius() + edge_y) - faces)
        if self.stand_distance is not None:
            lowest = larger(lowest_of_chambers(finger, parts, line, points), tip_x)
            margins["clear_of_ground"] = self.stand_distance - lowest
        return margins

    def face_at(self, x: Array) -> Array:
        """Distance (m) of the object's face from the axis at x (m); below its base it is as at its base. Where nobody
        says how high the object stands, only differences mean something."""
        return self.object.radius_at(-x if self.stand_distance is None else larger(self.stand_distance - x, 0.0))

    def target(self):
        mass = self.object.mass
        if is_concrete(mass) and not np.all(np.asarray(mass) > 0):
            raise InputError("pressure_for(Grasp) needs an object with mass > 0, or a target such as tip_force=0.1.")
        return "security", jnp.ones_like(mass)

    def residual_and_observables(self, unknowns, load_factor, pressure):
        residual, observed = super().residual_and_observables(unknowns, load_factor, pressure)
        load, lift = self.pull(), self.object.lift()
        loaded = load > 0
        carried = friction_force(lift, observed["tip_force"])
        return residual, observed | {
            "required_force": required_normal_force(lift, load),
            "security": jnp.where(loaded, carried / jnp.where(loaded, load, 1.0), jnp.inf),
        }

    def with_mass(self, mass: Scalar) -> Grasp:
        """The same grasp of an object of another mass."""
        return eqx.tree_at(lambda s: s.object.mass, self, mass)


MASS_STEP = 0.05
"""Masses are followed in units of this part of EI / (L^2 g): a gentle first step for every finger."""
TRIES = 8
"""With so many masses a state is looked for: none, then, where the empty gripper is beyond its limit, 1, 2, 4, ..., 64
times EI / (L^2 g) for each finger."""


@jax.jit
def heaviest_held(grasp: Grasp, pressure: Scalar) -> Scalar:
    """The program of `largest_mass`, for a grasp that `solve` takes."""
    fixed, p = frozen((grasp, pressure))
    unit = MASS_STEP * fixed.held_unit() * fixed.gripper.n / GRAVITY

    def slack(scene, mass, unknowns):
        """Required minus exerted force over EI / L^2: rises through zero at the largest mass."""
        with_mass = scene.with_mass(mass)
        exerted = friction_force(scene.object.lift(), unknowns[0] * scene.held_unit())
        return (with_mass.pull() - exerted) / scene.held_unit()

    def is_sought(state):
        tries, _, _, status = state
        return (status == Status.BEYOND_LIMIT) & (tries < TRIES)

    def heavier(state):
        tries = state[0]
        mass = jnp.where(tries > 0, 2.0 ** (tries - 1), 0.0) * unit / MASS_STEP
        found = fixed.solver().find(fixed.with_mass(mass), p, None)
        return tries + 1, mass, found.unknowns, found.status

    # A weight straightens fingers: a gripper that is beyond its limit empty may not be so with an object in it.
    none = (jnp.asarray(0), jnp.zeros_like(unit), fixed.unloaded_state(), jnp.asarray(int(Status.BEYOND_LIMIT)))
    _, begin, unknowns, status = lax.while_loop(is_sought, heavier, none)
    too_heavy = (begin > 0) & (slack(fixed, begin, unknowns) > 0)
    way = jnp.where(too_heavy, -unit, unit)

    def along(u, args):
        scene, pressure, begin, way = args
        mass = begin + u[-1] * way
        return scene.with_mass(mass).residual(u[:-1], pressure), jnp.sign(way) * slack(scene, mass, u[:-1])

    end = follow(along, jnp.append(unknowns, 0.0), (fixed, p, begin, way))
    ok = (status == Status.OK) & (end.reason == REACHED)
    scene, pressure = stop_gradient_where_failed(ok, (grasp, pressure))

    def equations(u, args):
        return jnp.append(*along(u, args))

    mass = begin + implicit(equations, end.u, (scene, pressure, begin, way))[-1] * way
    return jnp.where(ok, larger(mass, 0.0), jnp.nan)


def largest_mass(grasp: Grasp, pressure: Any) -> Scalar:
    """The heaviest object of this shape and friction that the gripper holds at a pressure.

    The mass m and the state are solved for together, from mu_f(F) F = m g / n on each tip. The state is followed along
    the mass, from that of the empty gripper. A weight straightens fingers and raises their limit pressure, so a gripper
    that is beyond its limit while it is empty may have a state with an object in it: it is then followed from a mass
    that has one, up or down to the mass that is just held. No rule of a state is asked: `solve` with that mass says
    which it breaks.

    Args:
        grasp: the gripper and the object; the object's own mass plays no part.
        pressure: gauge pressure, Pa, a scalar.

    Returns:
        The mass, kg, differentiable: 0 where the tips do not press at all, NaN where the grasp has no equilibrium at
            this pressure with any mass that it would hold.

    Raises:
        InputError: where grasp is no `pneunet.Grasp`, and where grasp or pressure cannot be meant (outside of jit).

    Source: own; the inverse of thesis algorithm 7.

    Examples:
        >>> gripper = sg.pneunet.Gripper(sg.PneuNet.table_5_1("A"), base_radius=19.61 * mm, touch="midline")
        >>> rod = sg.objects.Cylinder(radius=18 * mm, mass=26 * gram, friction=0.96)
        >>> grasp = sg.pneunet.Grasp(gripper, rod, section="thesis", points=8)
        >>> print(f"{sg.pneunet.largest_mass(grasp, 26.47 * kPa) / gram:.1f} g")
        26.0 g
    """
    if isinstance(grasp, Scene) and not isinstance(grasp, Grasp):
        raise InputError(f"grasp is a {type_name(type(grasp))}; it must be a pneunet.Grasp.")
    return heaviest_held(*to_solve(grasp, pressure))
