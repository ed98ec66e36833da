"""The shell pressed against a cylinder whose axis lies across its length (thesis 3.4), symmetric and offset."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from ..checked import positive
from ..membrane import angle_over_sine, arc_chain, flat_contact_stretch
from ..numerics.roots import bracketed_root, implicit
from .flat_shell import Scalar, ShellScene
from .free import two_sections


class CylinderState(NamedTuple):
    """The deformed membrane on a cylinder, explicit in the contact angle theta_c."""

    theta_m: Scalar
    theta_c: Scalar
    radius: Scalar
    """R of the free arcs."""
    flat: Scalar
    """e, the mean straight length on one side: (e_1 + e_2)/2 when offset."""
    edge_stretch: Scalar
    """lambda_1 at the edge of the contact, (3.22)."""


class CylinderContact(ShellScene):
    """Symmetric contact with a rigid frictionless cylinder (thesis 3.4.1-3.4.3). The angle is theta_c.

    radius: r of the cylinder, m; gap: d - r, its distance from the membrane, m.

    Given theta_c, (3.16) with R = a / sin(theta_m) (3.18) is a quadratic in tan(theta_m / 2); then e from (3.15),
    lambda_2 (3.14), lambda_1 (3.19), kappa_2 (3.30), p (2.4). The half width c_a of the contact follows from one more
    scalar root: (3.27) with (3.20), (3.21) is (3.11) with d := gap. Elliptical area (3.28); force p A_c along the
    normal, force_z its projection (3.29). The model ends where e or a - c_a is used up.
    """

    radius: Scalar = positive("length")
    gap: Scalar = positive("length")

    OBSERVABLES = {
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

    def geometry(self):
        zero = jnp.zeros_like(self.gap)
        return zero, zero + jnp.pi * (1 - 1e-9)

    def state(self, theta_c: Scalar) -> CylinderState:
        """Everything that follows from the contact angle without a solve."""
        a, b, r = self.shell.a, self.shell.b, self.radius
        s, c = jnp.sin(theta_c), jnp.cos(theta_c)
        # gap + r (1 - cos th_c) = R (cos th_c - cos th_m): 1 - cos written so that small angles lose no digits.
        depth = self.gap + 2 * r * jnp.sin(0.5 * theta_c) ** 2
        theta_m = 2 * jnp.arctan((depth + jnp.sqrt(depth**2 + (a * s) ** 2)) / (a * (1 + c)))
        big_r = a / jnp.sin(theta_m)
        flat = b - (r + big_r) * s - a
        theta_me = 2 * jnp.arctan(depth / a)  # (3.26): R (cos th_c - cos th_m) = depth
        return CylinderState(theta_m, theta_c, big_r, flat, angle_over_sine(theta_me))

    def stretches(self, angle):
        state = self.state(angle)
        arcs = (self.radius + state.radius) * angle + state.radius * state.theta_m
        return angle_over_sine(state.theta_m), (arcs + state.flat) / self.shell.b

    def curvatures(self, angle):
        state = self.state(angle)
        turned = state.theta_m + angle
        return 1 / state.radius, turned / (state.radius * turned + state.flat)

    def margins(self, angle):
        state = self.state(angle)
        # c_a = a at theta_ma = pi, where (3.11) gives 1 + pi gap / (2 a).
        room = 1 + 0.5 * jnp.pi * self.gap / self.shell.a - state.edge_stretch
        return jnp.stack([state.flat / self.shell.b, room])

    def is_possible(self):
        return super().is_possible() & (self.shell.b > self.shell.a)

    def half_width(self, state: CylinderState) -> Scalar:
        """c_a: half width of the contact, m."""
        a, ratio = self.shell.a, self.gap / self.shell.a
        begin = lax.stop_gradient(2 * jnp.arctan(ratio))

        def excess(theta, args):
            ratio, stretch = args
            return flat_contact_stretch(theta, ratio) - stretch

        frozen = lax.stop_gradient((ratio, state.edge_stretch))
        root = bracketed_root(lambda theta: excess(theta, frozen), begin, jnp.pi + jnp.zeros_like(begin)).x
        theta_ma = implicit(excess, root, (ratio, state.edge_stretch))
        return a - self.gap / jnp.tan(0.5 * theta_ma)

    def observe(self, angle, pressure):
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
            "stretch": angle_over_sine(state.theta_m),
            "clamp_angle": state.theta_m,
        }

    def flat_lengths(self, state: CylinderState) -> tuple[Scalar, Scalar]:
        """e_1, e_2: the straight lengths on the far and the near side of the cylinder, m."""
        return state.flat, state.flat

    def profile(self, angle, pressure, n):
        """x, z across the width at the middle of the contact; y, z_length along the length over the cylinder, m."""
        a, b = self.shell.a, self.shell.b
        state = self.state(angle)
        e_1, e_2 = self.flat_lengths(state)
        big_r, r, zero = state.radius, self.radius, jnp.zeros_like(angle)
        arcs = [big_r * state.theta_m, e_1, big_r * angle, 2 * r * angle, big_r * angle, e_2, big_r * state.theta_m]
        bends = [-1 / big_r, zero, -1 / big_r, 1 / r, -1 / big_r, zero, -1 / big_r]
        c_a = self.half_width(state)
        theta_ma = 2 * jnp.arctan2(self.gap, a - c_a)
        r_a = self.gap / (2 * jnp.sin(0.5 * theta_ma) ** 2)
        across = two_sections(
            (-a, jnp.stack([r_a * theta_ma, 2 * c_a, r_a * theta_ma]), jnp.stack([-1 / r_a, zero, -1 / r_a])),
            (-b, jnp.stack(arcs), jnp.stack(bends)),
            state.theta_m,
            n,
        )
        x, z = arc_chain(
            jnp.stack([r_a * theta_ma, 2 * c_a, r_a * theta_ma]), jnp.stack([-1 / r_a, zero, -1 / r_a]), theta_ma, n
        )
        return across | {"x": x - a, "z": z}


class AxialOffset(CylinderContact):
    """Contact with a cylinder whose axis is at `height` h (m) from one end of the membrane (thesis 3.4.4).

    h = b is the symmetric state. By (3.32), (3.33) e_1 + e_2 = 2 e, and with kappa_2 from the mean straight length the
    pressure does not depend on h (see `docs/theory.md`): only e_1 and e_2 do. The grasp is stable while e_2 >= 0, so
    the model ends where e_1 or e_2 is used up; an offset with e_2 < 0 from the start is IMPOSSIBLE.
    """

    height: Scalar = positive("length")

    OBSERVABLES = CylinderContact.OBSERVABLES | {"flat_length_far": "length", "flat_length_near": "length"}

    def flat_lengths(self, state):
        b = self.shell.b
        reach = (self.radius + state.radius) * jnp.sin(state.theta_c) + self.shell.a
        return 2 * b - self.height - reach, self.height - reach

    def margins(self, angle):
        _, room = super().margins(angle)
        far, near = self.flat_lengths(self.state(angle))
        return jnp.stack([far / self.shell.b, near / self.shell.b, room])

    def is_possible(self):
        far, near = self.flat_lengths(self.state(self.geometry()[0]))
        return super().is_possible() & (far > 0) & (near > 0)

    def observe(self, angle, pressure):
        far, near = self.flat_lengths(self.state(angle))
        return super().observe(angle, pressure) | {"flat_length_far": far, "flat_length_near": near}
