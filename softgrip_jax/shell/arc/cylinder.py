"""The shell pressed against a cylinder whose axis lies across its length (thesis 3.4), symmetric and offset."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Int

from ...equations import Approach
from ...fields import positive
from ...membrane import angle_of_stretch, arc_chain, contact_half_width
from ...numerics.choice import smaller
from ...reasons import Reason
from ...scene import Scene
from ..energy.contacts import EnergyCylinder
from ..flat_shell import FlatShell, Scalar, ShellScene
from ..obstacles import Cylinder
from .free import Free

ALMOST_ONE = 1 - 1e-9
"""sin^2 of half a right turn, short of where its arcsine has no derivative: the membrane is used up long before."""


class CylinderState(NamedTuple):
    """The deformed membrane on a cylinder, explicit in the contact angle theta_c."""

    theta_m: Scalar
    theta_c: Scalar
    radius: Scalar
    """R of the free arcs."""
    flat: Scalar
    """e, the mean straight length on one side: (e_1 + e_2)/2 when offset."""
    stretch: Scalar
    """lambda_1 of the free arc, theta_m / sin(theta_m)."""
    sunk: Scalar
    """r (1 - cos theta_c): how much deeper than at first contact the edge of the contact lies, m."""


class OnCylinder(NamedTuple):
    """The membrane on a cylinder, explicit in the contact angle: what every scene of one holds."""

    shell: FlatShell
    radius: Scalar
    """r, m."""
    gap: Scalar
    """d - r, m."""
    reach: Scalar
    """Horizontal distance from the axis of the cylinder to the end of the nearest spherical end, at e = 0, m."""

    def approach(self, scene: ShellScene) -> Approach:
        """The free membrane inflates until it reaches the cylinder."""
        touch = 2 * jnp.arctan(self.gap / self.shell.a)
        return Approach(Free(self.shell), touch, scene.load(jnp.zeros_like(touch)))

    def angles(self) -> tuple[Scalar, Scalar]:
        """theta_c from first contact to where the membrane is used up or covered."""
        return jnp.zeros_like(self.gap), smaller(*self.ends())

    def end_reason(self, scene: ShellScene) -> Int[Array, ""]:
        """Whether the membrane is used up or covered first, or the material locked."""
        used_up, covered = self.ends()
        own = jnp.where(used_up <= covered, Reason.MEMBRANE_USED_UP, Reason.MEMBRANE_COVERED)
        return jnp.where(scene.locks(), Reason.MATERIAL_LOCKED, own)

    def ends(self) -> tuple[Scalar, Scalar]:
        """theta_c where a straight length is used up, and where the contact is as wide as the membrane (or no less)."""
        a, r, gap = self.shell.a, self.radius, self.gap
        used_up = taut_angle(self.reach, a, r, gap)
        # c_a = a at theta_ma = pi, where (3.11) gives lambda_1 = 1 + pi gap / (2 a); then (3.22), (3.26) backwards.
        theta_me = angle_of_stretch(1 + 0.5 * jnp.pi * gap / a)
        sine2 = (a * jnp.tan(0.5 * theta_me) - gap) / (2 * r)  # sin^2(theta_c / 2)
        covered = 2 * jnp.arcsin(jnp.sqrt(jnp.clip(sine2, 0, ALMOST_ONE)))
        return used_up, jnp.where(sine2 < ALMOST_ONE, covered, used_up)

    def state(self, theta_c: Scalar) -> CylinderState:
        """Everything that follows from the contact angle without a solve."""
        a, b, r = self.shell.a, self.shell.b, self.radius
        s, c = jnp.sin(theta_c), jnp.cos(theta_c)
        # gap + r (1 - cos th_c) = R (cos th_c - cos th_m): 1 - cos written so that small angles lose no digits.
        sunk = r * s**2 / (1 + c)
        depth = self.gap + sunk
        t = (depth + jnp.sqrt(depth**2 + (a * s) ** 2)) / (a * (1 + c))  # tan(theta_m / 2)
        theta_m, over_sine = 2 * jnp.arctan(t), 0.5 * (t + 1 / t)
        big_r = a * over_sine
        flat = b - (r + big_r) * s - a
        return CylinderState(theta_m, theta_c, big_r, flat, theta_m * over_sine, sunk)

    def stretches(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """lambda_1 (3.19) and lambda_2 (3.14)."""
        state = self.state(angle)
        arcs = (self.radius + state.radius) * angle + state.radius * state.theta_m
        return state.stretch, (arcs + state.flat) / self.shell.b

    def curvatures(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """kappa_1 = 1 / R and kappa_2 (3.30), 1/m."""
        state = self.state(angle)
        turned = state.theta_m + angle
        return 1 / state.radius, turned / (state.radius * turned + state.flat)

    def half_width(self, state: CylinderState) -> Scalar:
        """c_a: half width of the contact, m."""
        a = self.shell.a
        return a * contact_half_width(self.gap / a, state.sunk / a)

    def observables(self, angle: Scalar, pressure: Scalar) -> dict[str, Scalar]:
        """What is observed of every contact with a cylinder."""
        state = self.state(angle)
        c_a, c_b = self.half_width(state), self.radius * angle
        area = jnp.pi * c_a * c_b
        return {
            "force": pressure * area,
            "force_z": pressure * jnp.pi * c_a * self.radius * jnp.sin(angle),
            "contact_angle": angle,
            "flat_length": state.flat,
            "contact_area": area,
            "contact_half_width": c_a,
            "contact_half_length": c_b,
            "stretch": state.stretch,
            "clamp_angle": state.theta_m,
        }

    def profile(self, angle: Scalar, flat_lengths: tuple[Scalar, Scalar], n: int):
        """x, z across the width at the middle of the contact; y, z_length along the length over the cylinder, m."""
        a, b = self.shell.a, self.shell.b
        state = self.state(angle)
        e_1, e_2 = flat_lengths
        big_r, r, zero = state.radius, self.radius, jnp.zeros_like(angle)
        arcs = [big_r * state.theta_m, e_1, big_r * angle, 2 * r * angle, big_r * angle, e_2, big_r * state.theta_m]
        bends = [-1 / big_r, zero, -1 / big_r, 1 / r, -1 / big_r, zero, -1 / big_r]
        c_a = self.half_width(state)
        theta_ma = 2 * jnp.arctan2(self.gap, a - c_a)
        r_a = self.gap / (2 * jnp.sin(0.5 * theta_ma) ** 2)
        width = jnp.stack([r_a * theta_ma, 2 * c_a, r_a * theta_ma])
        x, z = arc_chain(width, jnp.stack([-1 / r_a, zero, -1 / r_a]), theta_ma, n)
        y, z_length = arc_chain(jnp.stack(arcs), jnp.stack(bends), state.theta_m, n)
        return {"x": x - a, "z": z, "y": y - b, "z_length": z_length}


class CylinderContact(ShellScene):
    """The membrane in symmetric contact with a rigid frictionless cylinder that lies across its length.

    The unknown is the contact angle theta_c. With R = a / sin(theta_m) (3.18), (3.16) is a quadratic in tan(theta_m /
    2); then e from (3.15), lambda_2 (3.14), lambda_1 (3.19), kappa_2 (3.30) and p (2.4). The half width c_a of the
    contact follows from one more scalar root: (3.27) with (3.20), (3.21) is (3.11) with d replaced by the gap and with
    the stretch (3.22) of the contact's edge, an arc of tan(theta_me / 2) = (gap + r (1 - cos theta_c)) / a, (3.26).

    Args:
        shell: the actuator, longer than wide (b > a).
        radius: r of the cylinder, m.
        gap: d - r, its distance from the membrane, m.
        model: "arc" for these equations, "energy" for the energy membrane, which is nearer to finite elements.

    Observables:
        - force: p A_c along the normal, N, zero before contact.
        - force_z: its projection on the axis of inflation (3.29), N.
        - contact_angle: theta_c, rad.
        - flat_length: e, the straight length on one side, m.
        - contact_area: A_c of the ellipse (3.28), m^2.
        - contact_half_width, contact_half_length: c_a and c_b, m.
        - stretch: lambda_1, dimensionless.
        - clamp_angle: theta_m, rad.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 3.4.1 to 3.4.3. The model ends where e = 0 or c_a = a, whichever comes first.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> contact = sg.solve(sg.shell.CylinderContact(shell, radius=20 * mm, gap=5 * mm), 15 * kPa)
        >>> print(f"{contact.force_z:.5f} N, {contact.contact_angle:.5f} rad, {contact.flat_length / mm:.5f} mm")
        5.75451 N, 0.59433 rad, 6.30491 mm
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")

    OBSERVABLES: ClassVar = {
        "force": "force",
        "force_z": "force",
        "contact_angle": "angle",
        "flat_length": "length",
        "contact_area": "area",
        "contact_half_width": "length",
        "contact_half_length": "length",
        "stretch": "number",
        "clamp_angle": "angle",
    }

    def energy_scene(self) -> Scene:
        return EnergyCylinder(self.shell, Cylinder(self.radius, self.gap), symmetry="both", bending=self.bending)

    def arcs(self) -> OnCylinder:
        return OnCylinder(self.shell, self.radius, self.gap, self.shell.b - self.shell.a)

    def approach(self):
        return self.arcs().approach(self)

    def end_reason(self):
        return self.arcs().end_reason(self)

    def is_possible(self):
        return super().is_possible() & (self.arcs().reach > 0)

    def observe(self, angle, pressure):
        return self.arcs().observables(angle, pressure)

    def profile(self, angle, pressure, n):
        flat = self.arcs().state(angle).flat
        return self.arcs().profile(angle, (flat, flat), n)


class AxialOffset(ShellScene):
    """The membrane in contact with a cylinder whose axis is nearer to one of its ends.

    Adding (3.32) and (3.33) gives e_1 + e_2 = 2 e of (3.15), so (3.31) is (3.14). With kappa_2 (3.30) from the mean
    straight length (the thesis does not say which) the pressure does not depend on h; only e_1 and e_2 do. The grasp is
    stable while e_2 >= 0, so the model ends where e_1 or e_2 is used up. An offset with e_2 < 0 from the start is
    IMPOSSIBLE.

    Args:
        shell: the actuator, longer than wide (b > a).
        radius: r of the cylinder, m.
        gap: d - r, its distance from the membrane, m.
        model: "arc" or "energy", as in CylinderContact.
        height: h, from one end of the membrane to the axis of the cylinder, m; b is the symmetric state.

    Observables:
        - force: p A_c along the normal, N, zero before contact.
        - force_z: its projection on the axis of inflation (3.29), N.
        - contact_angle: theta_c, rad.
        - flat_length: e, the mean straight length on one side, m.
        - contact_area: A_c of the ellipse (3.28), m^2.
        - contact_half_width, contact_half_length: c_a and c_b, m.
        - stretch: lambda_1, dimensionless.
        - clamp_angle: theta_m, rad.
        - flat_length_far, flat_length_near: e_1 and e_2, m.

    Raises:
        InputError: where a field breaks its rule (outside of jit).

    Source: thesis 3.4.4.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> offset = sg.shell.AxialOffset(shell, radius=20 * mm, gap=5 * mm, height=40 * mm)
        >>> far, near = offset.flat_lengths(offset.state(jnp.asarray(0.594327)))  # theta_c at 15 kPa
        >>> print(f"{far / mm:.3f} mm + {near / mm:.3f} mm")  # twice e of the symmetric state, 6.305 mm
        9.305 mm + 3.305 mm
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")
    height: Scalar = positive("length")

    OBSERVABLES: ClassVar = CylinderContact.OBSERVABLES | {"flat_length_far": "length", "flat_length_near": "length"}

    def energy_scene(self) -> Scene:
        rod = Cylinder(self.radius, self.gap, offset_y=self.shell.b - self.height)
        return EnergyCylinder(self.shell, rod, symmetry="across", bending=self.bending)

    def arcs(self) -> OnCylinder:
        reach = smaller(self.height, 2 * self.shell.b - self.height) - self.shell.a
        return OnCylinder(self.shell, self.radius, self.gap, reach)

    def approach(self):
        return self.arcs().approach(self)

    def end_reason(self):
        return self.arcs().end_reason(self)

    def is_possible(self):
        return super().is_possible() & (self.arcs().reach > 0)

    def state(self, theta_c: Scalar) -> CylinderState:
        """Everything that follows from the contact angle (rad) without a solve."""
        return self.arcs().state(theta_c)

    def flat_lengths(self, state: CylinderState) -> tuple[Scalar, Scalar]:
        """e_1, e_2: the straight lengths on the far and the near side of the cylinder, m."""
        b = self.shell.b
        used = (self.radius + state.radius) * jnp.sin(state.theta_c) + self.shell.a
        return 2 * b - self.height - used, self.height - used

    def observe(self, angle, pressure):
        far, near = self.flat_lengths(self.state(angle))
        observed = self.arcs().observables(angle, pressure)
        return observed | {"flat_length_far": far, "flat_length_near": near}

    def profile(self, angle, pressure, n):
        return self.arcs().profile(angle, self.flat_lengths(self.state(angle)), n)


def taut_angle(reach: Scalar, a: Scalar, radius: Scalar, gap: Scalar) -> Scalar:
    """theta_c where a straight length e is used up: reach = (r + R) sin theta_c with (3.16), (3.18).

    With t = tan(theta_m / 2), (r + R)^2 = reach^2 + (gap + r + R cos theta_m)^2 becomes the quadratic
    a (2 r + gap) t^2 - k t - a gap = 0, k = reach^2 + gap^2 + 2 gap r - a^2, with one positive root.
    """
    first = a * (2 * radius + gap)
    k = reach**2 + gap**2 + 2 * gap * radius - a**2
    root = jnp.sqrt(k**2 + 4 * first * a * gap)
    # The form without cancellation for either sign of k.
    t = jnp.where(k > 0, (k + root) / (2 * first), 2 * a * gap / (root - jnp.where(k > 0, 0.0, k)))
    return jnp.arctan2(reach, gap + radius + a * (1 - t**2) / (2 * t))
