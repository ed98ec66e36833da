"""A finger whose tip presses on something."""

from __future__ import annotations

import abc

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..fields import choice, count, finite, part, vector
from ..numerics.choice import larger, smaller
from ..reasons import Reason
from ..results import Status
from .beam.collocation import Loads
from .beam.method import POINTS, BeamMethod, beam_method
from .finger import PneuNet
from .finger_scene import INCLINATIONS, FingerScene, Scalar, to_weight
from .section.base import SectionLaw
from .section.choice import section
from .section.exact import axial_stretch


class HeldTip(FingerScene):
    """A finger whose tip is held at some y: the unknowns are the force that holds it and the curvatures.

    Equations (4.49), (4.50), (4.59)-(4.63).
    """

    @abc.abstractmethod
    def pull(self) -> Scalar:
        """H_ext, the force on the tip along +x, N."""

    @abc.abstractmethod
    def offset_at(self, x: Scalar, angle: Scalar | float = 0.0) -> Scalar:
        """The y (m) at which a tip at x (m) is held, whose direction is theta = `angle` (rad)."""

    def only_presses(self) -> bool:
        """True where nothing can pull at the tip: what would need that is NO_CONTACT."""
        return False

    def unloaded_state(self):
        return jnp.append(0.0, self.straight())

    def largest_force(self):
        weight = 0.0 if self.weight is None else jnp.sum(jnp.abs(self.weight)) * self.finger.L
        return jnp.abs(self.pull()) + weight + self.sideways()

    def way_aside(self) -> Scalar:
        """The least |y| (m) at which the tip may be held, wherever along the finger that is."""
        here, there = self.offset_at(jnp.zeros_like(self.finger.L)), self.offset_at(self.finger.L)
        nearest = smaller(jnp.abs(here), jnp.abs(there))
        return jnp.where(here * there > 0, nearest, 0.0)

    def sideways(self) -> Scalar:
        """About the force (N) that brings the tip to where it is held, where that is far aside: UPRIGHT / (1 - |y|/L)
        is the square root of it over EI / L^2, or less where the cover stretches first."""
        slack = 1 - self.way_aside() / self.finger.L
        growth = UPRIGHT / jnp.maximum(slack, LEAST_SLACK)
        if self.law().stretches_at_all:
            growth = smaller(growth, 2 * jnp.cbrt(12 * (self.finger.L / self.finger.H) ** 2 * UPRIGHT))
        is_far = (slack < FAR_ASIDE) & ((slack > 0) | ("tip_in_reach" in self.ignored_rules))
        return jnp.where(is_far, growth**2 * self.held_unit(), 0.0)

    def margins_at_rest(self):
        length = self.finger.L
        own = {"tip_in_reach": length - self.way_aside()}
        if self.law().stretches_at_all:
            stretch = axial_stretch(larger(self.pull(), 0.0) / self.finger.force_scale())
            own["cover_bears_pull"] = (MOST_STRETCH - stretch) * length
        return super().margins_at_rest() | own

    def verified(self, found):
        found = super().verified(found)
        if not self.only_presses():
            return found
        held = lax.stop_gradient(found.unknowns[0])
        apart = (found.status == Status.OK) & ~(held > TOUCHING)
        return found._replace(
            status=jnp.where(apart, Status.NO_CONTACT, found.status),
            reason=jnp.where(apart, int(Reason.TIPS_APART), found.reason),
            detail=jnp.where(apart, -held * lax.stop_gradient(self.held_unit()), found.detail),
        )

    def onset(self):
        if not self.only_presses():
            return super().onset()
        # Where the force rises through zero; where the tip presses already, the pressure begins to act.
        point, found = self._sought("tip_force", jnp.zeros_like(self.finger.L), super().verified)
        pressed = found.reason == Reason.VALUE_PASSED
        never = jnp.where(found.status == Status.BEYOND_LIMIT, jnp.inf, jnp.nan)
        touched = jnp.where(found.status == Status.OK, point[-1], never)
        return jnp.where(pressed, super().onset(), touched)

    def held_unit(self) -> Scalar:
        """EI / L^2, N: the scale of the tip force."""
        return self.stiffness() / self.finger.L**2

    def held_at(self, x, angle):
        return self.offset_at(x * self.finger.L, angle) / self.finger.L

    def tip_loads(self, held, load_factor):
        scale = self.finger.force_scale()
        return Loads(load_factor * self.pull() / scale, held * self.held_unit() / scale, *self.weights(load_factor))

    def held(self, unknowns):
        return unknowns[0]

    def bent(self, unknowns, load_factor, pressure):
        return self.bend(unknowns[1:], unknowns[0], load_factor, pressure)

    def residual_and_observables(self, unknowns, load_factor, pressure):
        bent = self.bent(unknowns, load_factor, pressure)
        length = self.finger.L
        x, y = (end[-1] for end in bent.line.ends)
        away = y - load_factor * self.offset_at(x * length, bent.line.angles[-1]) / length
        observed = {"tip_force": unknowns[0] * self.held_unit()} | self.beam_observables(bent)
        n = len(bent.gaps)  # put together by products: of what is concatenated XLA computes entry by entry
        return bent.gaps @ np.eye(n, n + 1, 1) + np.eye(n + 1)[0] * away, observed

    def profile(self, unknowns, pressure, n):
        return self.beam_profile(self.seen(unknowns, pressure), n)


MOST_STRETCH = 2.0
"""Of a cover that is pulled at its tip. Silicones are trusted to less; and a cover that is stretched to many times its
length bends in layers far thinner than it is thick, where no beam means anything."""
UPRIGHT = 2 - np.sqrt(2)
"""A force F across a cantilever turns it upright, but for a layer at the clamp: the tip stays short of the length L by
this times L / sqrt(F L^2 / EI). It is 2 (1 - cos(pi / 4)), from the elastica."""
FAR_ASIDE = 0.3
"""Of the length: up to 0.7 aside the force is a few EI / L^2, and the way there as gentle as without it."""
LEAST_SLACK = 0.01
"""Nearer to the finger's length than this the points along it are no longer adapted to the layer."""
TOUCHING = 1e-12
"""A tip presses where its force is more than this, over EI / L^2: rounding leaves 1e-15 where there is none."""


class TipContact(HeldTip):
    """The finger presses with its tip on something that holds it at a given y.

    The beam of `Free` with y(L) = y_c as one more equation and the force Lambda across the tip as one more unknown:
    (4.49), (4.50), (4.59) to (4.63).

    Args:
        finger: the actuator.
        tip_offset: y_c, the y at which the tip is held, m; negative is further along the bending.
        tip_pull: H_ext, force on the tip along +x, N.
        weight: (g_x, g_y), N/m, None or (0, 0) for none; shape (2,).
        section, inclination: as in FingerScene; the thesis keeps theta_s = 0 here, which is the default.
        points: Gauss points along the beam, at least 3 in each of several parts. More are taken where loads that are
            known numbers pull so strongly that the beam bends in thin layers; under vmap or jit of the loads that is
            for the caller, and NOT_CONVERGED comes back where the points do not tell the beam's shape.
        hold: "both", the tip is held from both sides, as in the thesis's test stand, and a negative tip_force pulls, or
            "press", the tip leans on a face and nothing can pull. NO_CONTACT then says that only a pull would keep it
            there, with the force that is missing as its detail.
        beam: how the beam's equations are solved, Collocation(points=16) by default, or Shooting(...), see there.
        drive, moment_spread, loading: as in FingerScene.

    Observables:
        - tip_force: Lambda, N, positive when the tip pushes towards -y on what holds it.
        - tip: (x, y), m, shape (2,).
        - tip_angle: turn of the tip, rad, positive in the bending direction.
        - end_moment: M_T, N m, positive in the bending direction.

    Raises:
        InputError: where a field breaks its rule, or choices exclude each other (outside of jit).

    Source: thesis 4.4.2, 5.2.2, with the exact section law. It ends in a fold: past a largest M_T there is no
    equilibrium.

    Examples:
        >>> held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=8)
        >>> pressed = sg.solve(held, 31 * kPa)
        >>> print(f"{pressed.tip_force:.4f} N, {pressed.tip_angle:.4f} rad")
        0.1266 N, 1.0834 rad
    """

    finger: PneuNet = part(PneuNet)
    tip_offset: Scalar = finite("length", default=0.0)
    tip_pull: Scalar = finite("force", default=0.0)
    weight: Float[Array, "*batch 2"] | None = vector("force_per_length", to_weight, default=None)
    section: str | SectionLaw = section(default="exact")
    inclination: str = choice(*INCLINATIONS, default="none")
    points: int = count(default=POINTS)
    hold: str = choice("both", "press", default="both", kw_only=True)
    beam: BeamMethod | None = beam_method()

    OBSERVABLES = {"tip_force": "force", "tip": "position", "tip_angle": "angle", "end_moment": "moment"}

    def is_unloaded(self):
        light = True if self.weight is None else jnp.all(self.weight == 0)
        return light & (self.tip_offset == 0) & (self.tip_pull == 0)

    def only_presses(self):
        return self.hold == "press"

    def pull(self):
        return self.tip_pull

    def offset_at(self, x, angle=0.0):
        return self.tip_offset
