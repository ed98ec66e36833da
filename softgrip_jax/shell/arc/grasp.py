"""Grasping a cylinder with a parallel gripper of flat shells: lifting, and tilting under an eccentric mass."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...errors import InputError, require_whole
from ...fields import choice, is_concrete, nonnegative, positive
from ...numerics.choice import largest, smaller
from ...objects.friction import friction, friction_coefficient, friction_force, required_normal_force
from ...scene import Scene
from ...units import GRAVITY
from ..energy.contacts import EnergyCylinder, cylinder_observables
from ..energy.resting import resting_on
from ..energy.scene import EnergyScene
from ..flat_shell import FlatShell, Scalar, ShellScene
from ..obstacles import Cylinder
from .cylinder import CylinderContact, OnCylinder

MEAN_STEPS = 10
"""Steps of the arithmetic-geometric mean: each halves the logarithm of the axis ratio until it is small, and squares it
from there on. Ten are exact to rounding for ratios up to 1e16."""


HOLDING = {"required_force": "force", "tilt_resistance": "moment", "security": "number", "least_security": "number"}
"""What is observed of any grasp."""


def tilt_moment(c_a: Scalar, c_b: Scalar, shear: Scalar, lever: str = "exact") -> Scalar:
    """The moment about its centre of a uniform shear traction on an elliptical contact.

    With lever "exact" the lever arm is the distance of each point, T_R = shear * integral of r dA = shear (4/3) c_a c_b
    int_0^{pi/2} sqrt(c_a^2 cos^2 + c_b^2 sin^2) dphi, which is 2 pi c^3 shear / 3 for a circle. With "rim" it is taken
    at the rim at the same y, as the thesis does, which is too large (pi c^3 shear for a circle).

    Args:
        c_a, c_b: half axes of the ellipse, m, zero or more.
        shear: traction, Pa; friction times the contact pressure.
        lever: "exact", or "rim" for the thesis's formula.

    Returns:
        T_R, N m.

    Source: thesis (3.36) to (3.40) for "rim", own for "exact".

    Examples:
        >>> circle = sg.shell.tilt_moment(jnp.asarray(10 * mm), jnp.asarray(10 * mm), jnp.asarray(1 * kPa))
        >>> print(f"{circle:.6e} N m, {2 / 3 * np.pi * (10 * mm) ** 3 * kPa:.6e} N m")
        2.094395e-03 N m, 2.094395e-03 N m
    """
    exists = (c_a > 0) & (c_b > 0)
    a, b = jnp.where(exists, c_a, 1.0), jnp.where(exists, c_b, 1.0)
    integral = _rim_lengths(a, b)[0] / 3 if lever == "exact" else _rim_lengths(a, b)[1]
    return 4 * shear * c_a * c_b * jnp.where(exists, integral, 0.0)


def _rim_lengths(a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
    """int_0^{pi/2} r dphi and int_0^{pi/2} r cos^2(phi) dphi, r = sqrt(a^2 cos^2 + b^2 sin^2); a, b > 0.

    They are a E and a ((1 + k^2) E - (1 - k^2) K) / (3 k^2), elliptic integrals with k^2 = 1 - (b/a)^2, by the
    arithmetic-geometric mean (Abramowitz and Stegun 17.6): K = pi / (2 mean), 1 - E/K = k^2/2 + sum 2^(n-1) c_n^2, with
    a = 1 and c_1 = (1 - b)/2. The differences c_n follow from each other without cancellation, c_{n+1} = c_n^2 / (4
    a_{n+1}), and k^2 is divided out by hand, so that a circle (k = 0) is a point like any other.
    """
    ratio = b / a
    k2 = (1 - ratio) * (1 + ratio)
    high, low = 0.5 * (1 + ratio), jnp.sqrt(ratio)
    part = 0.25 / high  # c_n / k^2

    def step(state, power):
        high, low, part, difference, total = state
        total = total + power * difference * part  # the sum, over k^2
        high, low = 0.5 * (high + low), jnp.sqrt(high * low)
        return (high, low, difference * part / (4 * high), difference * difference / (4 * high), total), None

    # A loop: written out, ten steps take minutes to compile where derivatives of derivatives are taken.
    state = (high, low, part, k2 * part, jnp.zeros_like(ratio))
    (high, _, _, _, total), _ = lax.scan(step, state, 2.0 ** jnp.arange(MEAN_STEPS, dtype=ratio.dtype))
    scale = a * (0.5 * jnp.pi) / high
    whole = scale * (1 - k2 * (0.5 + total))
    return whole, scale * (1.5 - 0.5 * k2 - (1 + k2) * total) / 3


class Grasp(ShellScene):
    """A parallel gripper of flat shells holds a cylinder at the least height h, where e_2 = 0.

    Friction must carry the weight, mu_f F_ext = m g / fingers (6.2), and resist tilting by an eccentric mass, T_R
    (3.36) against m g x_e (3.41).

    Args:
        shell: the actuator, longer than wide (b > a).
        radius: r of the cylinder, m.
        gap: d - r, its distance from the membrane, m.
        model: "arc", or "energy" for the energy membrane with the cylinder in its middle, see `EnergyGrasp`.
        mass: of the cylinder, kg; 0 where only the state at a pressure or a force is asked for.
        friction: mu_f, dimensionless, a number or a function of the normal force (N).
        eccentricity: x_e, m: distance of the centre of mass from the middle of the contact, across the width.
        lever: "exact", or "rim" for the thesis's formula (3.40).
        fingers: shells that share the weight (2 in a parallel gripper).

    Observables:
        - force: p A_c along the normal, N, zero before contact.
        - force_z: its projection on the axis of inflation (3.29), N.
        - contact_angle: theta_c, rad.
        - flat_length: e, the mean straight length on one side, m.
        - contact_area: A_c of the ellipse (3.28), m^2.
        - contact_half_width, contact_half_length: c_a and c_b, m.
        - stretch: lambda_1, dimensionless.
        - clamp_angle: theta_m, rad.
        - height: h of the cylinder's axis above the end of the membrane, m.
        - required_force: F_ext, the least normal force that lifts, N; inf where no force does.
        - tilt_resistance: T_R, N m.
        - security: the smaller of mu_f(F) F / (m g / fingers) and T_R / (m g x_e), dimensionless; 1 is just held. Each
          has all of the friction to itself.
        - least_security: 1 / (1 / the first + 1 / the second), dimensionless: what one friction leaves for lifting and
          tilting at once is at least this and at most `security`, which it equals without eccentricity.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 3.4.4, algorithm 4, 6.2; the limit surface of friction is convex: Goyal, Ruina and Papadopoulos 1991,
        Wear 143.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> grasp = sg.shell.Grasp(shell, radius=20 * mm, gap=5 * mm, mass=563 * gram, friction=0.96)
        >>> held = sg.solve(grasp, 10.9 * kPa)  # thesis table 6.1: just held, h = 33.7 mm
        >>> print(f"security {held.security:.2f}, h = {held.height / mm:.1f} mm")
        security 1.00, h = 33.7 mm
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")
    mass: Scalar = nonnegative("mass", default=0.0)
    friction: Scalar = friction(default=1.0)
    eccentricity: Scalar = nonnegative("length", default=0.0)
    lever: str = choice("exact", "rim", default="exact")
    fingers: int = eqx.field(static=True, default=2)

    OBSERVABLES: ClassVar = CylinderContact.OBSERVABLES | {"height": "length"} | HOLDING
    SAME_AT_ALL_PRESSURES: ClassVar = ("required_force",)

    def __check_init__(self) -> None:
        require_whole("Grasp.fingers", self.fingers, 1)
        if self.model == "energy" and self.lever != "exact":
            raise InputError(f"Grasp.lever is {self.lever!r}; with model 'energy' there is only 'exact'.")

    def energy_scene(self) -> Scene:
        rod = Cylinder(self.radius, self.gap)
        return EnergyGrasp(
            self.shell,
            rod,
            symmetry="both",
            bending=self.bending,
            mass=self.mass,
            friction=self.friction,
            eccentricity=self.eccentricity,
            fingers=self.fingers,
        )

    def arcs(self) -> OnCylinder:
        return OnCylinder(self.shell, self.radius, self.gap, self.shell.b - self.shell.a)

    def approach(self):
        return self.arcs().approach(self)

    def end_reason(self):
        return self.arcs().end_reason(self)

    def is_possible(self):
        return super().is_possible() & (self.arcs().reach > 0)

    def target(self):
        return _target(self.mass)

    def may_turn(self, name):
        return name in HOLDING and callable(self.friction)  # a coefficient that falls with the force may hold less

    def margins_of_state(self, angle, pressure):
        """membranes_apart: of two opposite shells, what the highest point of a membrane keeps from the middle."""
        crest = self.shell.a * jnp.tan(0.5 * self.arcs().state(angle).theta_m)
        return _apart(self, self.gap + self.radius - crest)

    def observe(self, angle, pressure):
        observed = self.arcs().observables(angle, pressure)
        c_a, c_b = observed["contact_half_width"], observed["contact_half_length"]
        shear = friction_coefficient(self.friction, observed["force"]) * pressure
        resistance = tilt_moment(c_a, c_b, shear, self.lever)
        height = {"height": self.shell.b - observed["flat_length"]}
        return observed | height | holding(self, observed["force"], resistance)

    def profile(self, angle, pressure, n):
        flat = self.arcs().state(angle).flat
        return self.arcs().profile(angle, (2 * flat, jnp.zeros_like(flat)), n)


class EnergyGrasp(EnergyScene):
    """What `Grasp(..., model="energy")` is solved as: the cylinder in the middle of the membrane.

    By energy the force depends on the height of the cylinder (a little; see `AxialOffset`), and no straight lengths are
    there to be used up: `height` and `flat_length` are the arcs' alone. tilt_resistance is friction times the contact
    pressure times the distance from the middle of the contact, integrated over the computed contact.
    """

    mass: Scalar = nonnegative("mass", default=0.0)
    friction: Scalar = friction(default=1.0)
    eccentricity: Scalar = nonnegative("length", default=0.0)
    fingers: int = eqx.field(static=True, default=2)

    OBSERVABLES: ClassVar = EnergyCylinder.OBSERVABLES | HOLDING
    SAME_AT_ALL_PRESSURES: ClassVar = ("required_force",)

    def target(self):
        return _target(self.mass)

    def margins_of_state(self, unknowns, pressure):
        """membrane_above_clamp, and membranes_apart as of the arcs, of the outer face at the contact points."""
        crest = largest(resting_on(self, unknowns, self.contact_pressures(unknowns, pressure)).places[:, 2])
        rod = self.obstacle
        assert isinstance(rod, Cylinder)
        return super().margins_of_state(unknowns, pressure) | _apart(self, rod.gap + rod.radius - crest)

    def measured(self, y, contact_pressures, pressure):
        observed = cylinder_observables(self, y, contact_pressures, pressure)
        force = observed["force"]
        resistance = friction_coefficient(self.friction, force) * observed["friction_moment"]
        return observed | holding(self, force, resistance)


def _apart(grasp: Grasp | EnergyGrasp, margin: Scalar) -> dict[str, Scalar]:
    """The rule of two shells; one alone has none opposite."""
    return {"membranes_apart": margin} if grasp.fingers > 1 else {}


def holding(grasp: Grasp | EnergyGrasp, force: Scalar, resistance: Scalar) -> dict[str, Scalar]:
    """HOLDING, from the normal force and the moment that resists tilting.

    required_force is F_ext (N): the least normal force whose friction carries one finger's share of the weight, thesis
    (6.2); inf where no force does (friction that does not grow with the force). What force and moment friction can
    resist together is convex, whatever the contact pressure: it contains the line between the largest force and the
    largest moment, of which least_security tells.
    """
    share, turn = grasp.mass * GRAVITY / grasp.fingers, grasp.mass * GRAVITY * grasp.eccentricity
    hold = friction_force(grasp.friction, force)
    lift, tilt = _ratio(hold, share), _ratio(resistance, turn)
    both = share * resistance + turn * hold
    return {
        "required_force": required_normal_force(grasp.friction, share),
        "tilt_resistance": resistance,
        "security": smaller(lift, tilt),
        # Nothing holds where nothing is touched.
        "least_security": jnp.where((share > 0) & (both <= 0), 0.0, _ratio(hold * resistance, both)),
    }


def _target(mass: Scalar) -> tuple[str, Scalar]:
    if is_concrete(mass) and not np.all(np.asarray(mass) > 0):
        raise InputError("pressure_for(Grasp) needs Grasp.mass > 0, or a target such as force=2.0 (in N).")
    return "security", jnp.ones_like(mass)


def _ratio(value: Scalar, need: Scalar) -> Scalar:
    """value / need, and inf where nothing is needed."""
    return jnp.where(need > 0, value / jnp.where(need > 0, need, 1.0), jnp.inf)


def smallest_object(shell: FlatShell) -> Scalar:
    """The least height of an object that the shell can hold: a, the reach of its spherical ends.

    Args:
        shell: the actuator.

    Returns:
        The height, m.

    Source: thesis 3.4.4.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> print(f"{sg.shell.smallest_object(shell) / mm:.0f} mm")
        16 mm
    """
    return shell.a
