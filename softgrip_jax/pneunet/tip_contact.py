"""A finger whose tip presses on something."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..fields import choice, count, finite, part, vector
from ..numerics.choice import larger, smaller
from ..reasons import Reason
from ..results import Status
from ..scene import Found
from .beam.collocation import Loads
from .beam.method import POINTS, BeamMethod, beam_method
from .finger import PneuNet
from .finger_scene import INCLINATIONS, FingerScene, Scalar, to_weight
from .section.base import SectionLaw
from .section.choice import section
from .section.exact import axial_stretch


class HeldTip(NamedTuple):
    """How the tip of a `FingerScene` is held at some y: by a force across it, which is one more unknown.

    Equations (4.49), (4.50), (4.59)-(4.63).
    """

    pull: Scalar
    """H_ext, the force on the tip along +x, N."""
    offset_at: Callable[[Scalar, Scalar | float], Scalar]
    """(x of the tip, m; its direction theta, rad) -> the y (m) at which it is held."""
    only_presses: bool
    """Whether nothing can pull at the tip: what would need that is NO_CONTACT."""

    def largest_force(self, scene: FingerScene) -> Scalar:
        """A bound of the force along the beam from the external loads, N."""
        weight = 0.0 if scene.weight is None else jnp.sum(jnp.abs(scene.weight)) * scene.finger.L
        return jnp.abs(self.pull) + weight + self.sideways(scene)

    def way_aside(self, length: Scalar) -> Scalar:
        """The least |y| (m) at which the tip may be held, wherever along a finger of this length (m) that is."""
        here, there = self.offset_at(jnp.zeros_like(length), 0.0), self.offset_at(length, 0.0)
        nearest = smaller(jnp.abs(here), jnp.abs(there))
        return jnp.where(here * there > 0, nearest, 0.0)

    def sideways(self, scene: FingerScene) -> Scalar:
        """About the force (N) that brings the tip to where it is held, where that is far aside: UPRIGHT / (1 - |y|/L)
        is the square root of it over EI / L^2, or less where the cover stretches first."""
        finger = scene.finger
        slack = 1 - self.way_aside(finger.L) / finger.L
        growth = UPRIGHT / jnp.maximum(slack, LEAST_SLACK)
        if scene.law().stretches_at_all:
            growth = smaller(growth, 2 * jnp.cbrt(12 * (finger.L / finger.H) ** 2 * UPRIGHT))
        is_far = (slack < FAR_ASIDE) & ((slack > 0) | ("tip_in_reach" in scene.ignored_rules))
        return jnp.where(is_far, growth**2 * scene.held_unit(), 0.0)

    def margins_at_rest(self, scene: FingerScene) -> dict[str, Scalar]:
        """tip_in_reach and, where the cover stretches, cover_bears_pull: see `reasons`."""
        length = scene.finger.L
        own = {"tip_in_reach": length - self.way_aside(length)}
        if scene.law().stretches_at_all:
            stretch = axial_stretch(larger(self.pull, 0.0) / scene.finger.force_scale())
            own["cover_bears_pull"] = (MOST_STRETCH - stretch) * length
        return own

    def verified(self, scene: FingerScene, found: Found) -> Found:
        """NO_CONTACT where only a pull would keep the tip there; the force that is missing is its detail."""
        if not self.only_presses:
            return found
        held = lax.stop_gradient(found.unknowns[0])
        apart = (found.status == Status.OK) & ~(held > TOUCHING)
        missing = jnp.where(held < -TOUCHING, -held * lax.stop_gradient(scene.held_unit()), jnp.nan)
        return found._replace(
            status=jnp.where(apart, Status.NO_CONTACT, found.status),
            reason=jnp.where(apart, int(Reason.TIPS_APART), found.reason),
            detail=jnp.where(apart, missing, found.detail),
        )

    def loads(self, scene: FingerScene, held: Scalar, load_factor: Scalar) -> Loads:
        """The loads on the cover over mu B H; `held` is the unknown force over EI / L^2."""
        scale = scene.finger.force_scale()
        along, across = load_factor * self.pull / scale, held * scene.held_unit() / scale
        return Loads(along, across, *scene.weights(load_factor))

    def residual_and_observables(
        self, scene: FingerScene, unknowns: Array, load_factor: Scalar, pressure: Any
    ) -> tuple[Array, dict[str, Array]]:
        """Where the tip is less where it is held, and the equations of the beam; with what is observed."""
        bent = scene.bent(unknowns, load_factor, pressure)
        length = scene.finger.L
        x, y = (end[-1] for end in bent.line.ends)
        away = y - load_factor * self.offset_at(x * length, bent.line.angles[-1]) / length
        observed = {"tip_force": unknowns[0] * scene.held_unit()} | scene.beam_observables(bent)
        n = len(bent.gaps)  # put together by products: of what is concatenated XLA computes entry by entry
        return bent.gaps @ np.eye(n, n + 1, 1) + np.eye(n + 1)[0] * away, observed


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


class TipContact(FingerScene):
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

    def tip(self):
        return HeldTip(self.tip_pull, lambda x, angle: self.tip_offset, self.hold == "press")
