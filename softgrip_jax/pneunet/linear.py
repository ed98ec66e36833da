"""The simplest model of a finger: linear, of constant curvature (the Euler-Bernoulli models of thesis table 1.1)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..curve_scene import CurveScene
from ..errors import InputError
from ..fields import part
from ..reasons import RULE_NAMES
from .finger import SEGMENT_FIELDS, PneuNet
from .rules import margins_of_parts
from .wall.arc import one_chamber
from .wall.small_strain import PLATE_END, SmallStrainChamber


class Linear(CurveScene):
    """A linear finger of constant curvature: free bending and blocked force, both explicit.

    EI = mu B H^3 / 3 (plane strain, E / (1 - nu^2) = 4 mu) and phi = M_T L / EI. The tip of the free finger lies on a
    circle, x = L sin(phi) / phi, y = -L (1 - cos(phi)) / phi. Held at y = 0 the finger presses with 3 M_T / (2 L), the
    prop of a cantilever under an end moment. M_T is that of `SmallStrainChamber`; below contact it is zero and the
    finger is straight. M_T steps up at contact, so no pressure gives a value inside that step.

    Args:
        finger: a uniform finger.

    Observables:
        - tip: (x, y) of the free finger, m, shape (2,).
        - tip_angle: phi, rad, positive in the bending direction.
        - tip_force: of the blocked finger, N, positive when the tip pushes towards -y.
        - end_moment: M_T, N m, positive in the bending direction.

    Raises:
        InputError: for a finger with segments.

    Source: Euler-Bernoulli, the models of thesis table 1.1. It knows no limit, weight or offset, and is within a few
    percent of `TipContact` up to about a third of its limit moment.

    Examples:
        >>> line = sg.solve(sg.pneunet.Linear(sg.PneuNet.table_5_1("A")), 15 * kPa)
        >>> print(f"{line.tip_force * 77 * mm / line.end_moment:.3f}")  # 3/2
        1.500
    """

    finger: PneuNet = part(PneuNet)

    OBSERVABLES: ClassVar[dict[str, str]] = {
        "tip": "position",
        "tip_angle": "angle",
        "tip_force": "force",
        "end_moment": "moment",
    }
    CONTACT: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if self.finger.segments is not None:
            raise InputError(
                f"Linear.finger has {self.finger.segments} segments ({', '.join(SEGMENT_FIELDS)} as arrays); a finger "
                "of constant curvature is uniform."
            )

    def chamber(self) -> SmallStrainChamber:
        """Its chambers, which push it."""
        return SmallStrainChamber(self.finger, ignored_rules=RULE_NAMES)  # pyright: ignore[reportCallIssue]

    def prepared(self):
        return one_chamber(self)

    def margins_at_rest(self):
        return margins_of_parts(self.finger)

    def unbounded(self):
        return jnp.asarray(True)

    def load(self, angle):
        return self.chamber().load(angle)

    def pressure_scale(self):
        return self.chamber().pressure_scale()

    def interval(self):
        start = jnp.zeros_like(self.finger.a)
        return start, start + PLATE_END

    def observe(self, angle, pressure):
        f = self.finger
        chamber = self.chamber()
        touching = angle > chamber.interval()[0]
        moment = jnp.where(touching, chamber.observe(angle, pressure)["end_moment"], 0.0)
        turn = 3 * moment * f.L / (f.moment_scale() * f.H)
        half = 0.5 * turn
        chord = f.L * jnp.sinc(half / jnp.pi)  # of the circular arc, at half the angle
        return {
            "tip": jnp.stack([chord * jnp.cos(half), -chord * jnp.sin(half)]),
            "tip_angle": turn,
            "tip_force": 1.5 * moment / f.L,
            "end_moment": moment,
        }

    def profile(self, unknowns, pressure, n):
        """X, x, y (m), theta (rad) and stretch of the free finger."""
        turn = self.observe(unknowns, pressure)["tip_angle"] * jnp.linspace(0.0, 1.0, n)
        X = self.finger.L * jnp.linspace(0.0, 1.0, n)
        chord = X * jnp.sinc(0.5 * turn / jnp.pi)
        x, y = chord * jnp.cos(0.5 * turn), -chord * jnp.sin(0.5 * turn)
        return {"X": X, "x": x, "y": y, "theta": -turn, "stretch": jnp.ones_like(X)}
