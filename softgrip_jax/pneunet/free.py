"""A finger that bends in free space."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..fields import choice, count, finite, part, vector
from ..membrane import arc_chain
from ..numerics.choice import larger, largest
from ..reasons import Reason
from . import arcs
from .beam.collocation import Loads, Part
from .beam.method import POINTS, BeamMethod, beam_method
from .beam.shooting import Shooting
from .finger import PneuNet
from .finger_scene import INCLINATIONS, FingerScene, Scalar, opening, to_weight
from .rules import one_turn
from .section.base import SectionLaw
from .section.choice import section

MOST_TURN = 4 * np.pi
"""Between clamp and tip of a free finger, rad: two full turns. It would lie on itself; without this end the model of a
finger with parallel walls has it roll up without end."""


class Free(FingerScene):
    """The finger bends in free space, under its weight and forces on its tip.

    M' = lambda (P sin theta - Q cos theta) with P, Q the external loads beyond a section; M and N give theta' and
    lambda by the section law; M(L) = -M_T of the chambers. Without weight and tip load every part bends to a
    circular arc, in closed form; where the inclination couples each part is followed alone, up to its own limit.

    Args:
        finger: the actuator.
        weight: (g_x, g_y), N/m, (0, 0) for none; shape (2,). The default is the thesis's horizontal finger.
        tip_load: (F_x, F_y) on the tip, N; shape (2,).
        clamp_angle: theta(0), rad: the finger's direction at the clamp (weight keeps its own).
        section: law of the cover, "exact", "thesis" or "inextensible".
        inclination: how the walls incline as the finger bends: "segment", theta_s = theta' (2 h_x + h_L) / 2, "gap",
            theta_s = theta' h_x, or "none".
        combination: "sum", one beam with the chambers' moment and the weight together, or "larger", the thesis's rule
            (4.42) for nonuniform fingers, M_T = max(M_p, M_g) per segment with (4.40), in the bending direction.
        points: Gauss points along the beam, at least 3 in each of several parts.
        beam, drive, moment_spread, loading: as in FingerScene.

    Observables:
        - tip: (x, y), m, shape (2,); the finger bends towards -y.
        - tip_angle: turn of the tip, rad, positive in the bending direction.
        - end_moment: M_T, N m, positive in the bending direction.
        - inclination: mean theta_s of the chambers, rad.

    Raises:
        InputError: where a field breaks its rule, or choices exclude each other (outside of jit).

    Source: thesis 4.4.1, 5.2.1, with the exact section law. The thesis's drive gives a quarter of the moment of finite
    elements; see docs/theory/cell.md.

    Examples:
        >>> free = sg.pneunet.Free(sg.PneuNet.table_5_1("A"), weight=None, inclination="none")
        >>> print(f"{sg.solve(free, 31 * kPa).end_moment / N_mm:.4f} N mm")
        5.9326 N mm
    """

    finger: PneuNet = part(PneuNet)
    weight: Float[Array, "*batch 2"] | None = vector("force_per_length", to_weight, default=(0.0, -2.0))
    tip_load: Float[Array, "*batch 2"] | None = vector("force", to_weight, default=None)
    clamp_angle: Scalar = finite("angle", default=0.0)
    section: str | SectionLaw = section(default="exact")
    inclination: str = choice(*INCLINATIONS, default="segment")
    combination: str = choice("sum", "larger", default="sum")
    points: int = count(default=POINTS)
    beam: BeamMethod | None = beam_method()

    OBSERVABLES = {"tip": "position", "tip_angle": "angle", "end_moment": "moment", "inclination": "angle"}

    def __check_init__(self) -> None:
        if self.is_cell() and self.combination == "larger":
            raise InputError(
                'Free.combination is "larger", the thesis\'s rule for its own chambers; with drive = "cell" it must be '
                '"sum".'
            )

        if self.combination == "larger" and self.tip_load is not None:
            raise InputError(
                'Free.combination is "larger", the thesis\'s rule for chambers and weight; leave out tip_load, or take '
                '"sum".'
            )

    def is_arcs(self):
        if self.is_cell():
            return False
        return self.combination == "larger" or (self.weight is None and self.tip_load is None)

    def is_one_arc(self):
        return self.is_arcs() and self.combination == "sum"

    def bends_evenly(self):
        # More points would all end at the same pressure: no path goes through so many limits at once.
        unloaded = self.weight is None and self.tip_load is None
        return self.is_cell() and unloaded and not isinstance(self.method(), Shooting)

    def clamp(self):
        return self.clamp_angle

    def largest_force(self):
        loads = [(self.weight, self.finger.L), (self.tip_load, 1.0)]
        sizes = [jnp.sum(jnp.abs(force)) * length for force, length in loads if force is not None]
        return sum(sizes, jnp.zeros_like(self.finger.L))

    def tip_loads(self, held, load_factor):
        tip = jnp.zeros(2) if self.tip_load is None else self.tip_load * load_factor / self.finger.force_scale()
        return Loads(tip[0], tip[1], *self.weights(load_factor))

    def is_resolved(self, unknowns):
        return jnp.asarray(True) if self.is_arcs() or self.bends_evenly() else super().is_resolved(unknowns)

    def is_unloaded(self):
        if self.is_arcs():
            return jnp.asarray(self.combination == "sum")
        given = [jnp.all(v == 0) for v in (self.weight, self.tip_load) if v is not None]
        return jnp.all(jnp.stack(given)) if given else jnp.asarray(True)

    def unloaded_state(self):
        parts, _ = self.chambers()
        return self.ruled(jnp.zeros_like(parts.low), parts) if self.is_arcs() else self.straight()

    def begun_state(self, unknowns, load):
        """The moment of narrow chambers falls too steeply as they begin to incline for Newton's method to begin at
        parallel walls."""
        return arcs.begun_state(self, load) if self.is_alone() and self.inclines() else unknowns

    def residual_and_observables(self, unknowns, load_factor, pressure):
        if self.is_arcs():
            return self.arcs_residual_and_observables(unknowns, pressure)
        bent = self.bent(unknowns, load_factor, pressure)
        inclination = opening(bent.parts.chamber.inclining * bent.turned)
        gaps = bent.gaps @ np.eye(len(bent.gaps))  # a product: XLA would compute the beam in every loop that uses them
        return gaps, self.beam_observables(bent) | {"inclination": jnp.mean(inclination)}

    def passed(self, observed):
        """A finger that has turned by more than MOST_TURN lies on itself, and the model says nothing of that."""
        return jnp.abs(observed["tip_angle"]) / MOST_TURN - 1

    def margins_of_state(self, unknowns, pressure):
        """one_turn forbids nothing: see `rules`."""
        return super().margins_of_state(unknowns, pressure) | {"one_turn": one_turn(self.finger, self.turned(unknowns))}

    def spent(self, unknowns, pressure):
        if not self.is_arcs():
            return super().spent(unknowns, pressure)
        moments, law = unknowns * self.finger.H / self.finger.L / 3, self.law()
        used = jax.vmap(lambda m: law.used_up(m, *law(m, jnp.zeros_like(m))))(moments)
        return super().spent(unknowns, pressure) | {Reason.SECTION_FULL: largest(used)}

    def turned(self, unknowns):
        return self.turns(unknowns)[0] if self.is_arcs() else super().turned(unknowns)

    # --- circular arcs: the unknowns are the moments of the parts, in units of EI/L, positive in the bending direction

    def turns(self, unknowns: Array) -> tuple[Array, Array, Array]:
        """(angle turned, stretch, reference length over L) of every part."""
        parts, _ = self.chambers()
        slenderness = self.finger.H / self.finger.L
        law = self.law()
        z, stretch = jax.vmap(lambda y: law(y * slenderness / 3, jnp.zeros_like(y)))(unknowns)
        lengths = parts.high - parts.low
        return z / slenderness * lengths, stretch, lengths

    def arcs_residual_and_observables(self, unknowns: Array, pressure: Scalar) -> tuple[Array, dict[str, Array]]:
        """What the parts carry minus what their chambers apply, and the observables."""
        parts, _ = self.chambers()
        turned, stretch, lengths = self.turns(unknowns)
        inclination = parts.chamber.inclining * opening(turned)
        x, y = self.arcs(turned, stretch, lengths, 2)
        unit = self.finger.moment_scale() * self.finger.H / self.finger.L / 3
        observed = {
            "tip": jnp.stack([x[-1], y[-1]]),
            "tip_angle": jnp.sum(turned),
            "end_moment": unknowns[-1] * unit,
            "inclination": jnp.mean(inclination),
        }
        return unknowns - self.applied(parts.chamber, inclination, pressure), observed

    def applied(self, chamber, inclination: Array, pressure: Scalar) -> Array:
        """The moments of all parts at given inclinations, in units of EI/L."""
        unit = self.finger.H / self.finger.L / 3
        pushes = jax.vmap(self.push, in_axes=(0, None, 0))(chamber, pressure, inclination) / unit
        return self.ruled(pushes, self.chambers()[0])

    def ruled(self, pushes: Array, parts: Part) -> Array:
        """The moments of all parts from those of their chambers; by the thesis's rule of the weight, where larger."""
        if self.combination == "sum" or self.weight is None:
            return pushes
        lever = (1 - 0.5 * (parts.low + parts.high)) * self.finger.L
        hanging = -0.5 * self.weight[1] * lever**2
        return larger(pushes, hanging * self.finger.L / self.stiffness())

    def explicit(self, pressure):
        # Where the inclination couples, the moment of one arc may have a largest pressure: it is followed up to there.
        if not self.is_arcs() or (self.is_alone() and self.inclines()):
            return None
        return arcs.found(self, pressure)

    def explicit_limit(self):
        return arcs.limit(self) if self.is_arcs() and not self.is_alone() else None

    def is_alone(self) -> bool:
        """True where the whole finger is one arc."""
        return self.is_one_arc() and self.finger.segments is None

    def arcs(self, turned: Array, stretch: Array, lengths: Array, n: int) -> tuple[Array, Array]:
        """x, y (m) of n points on the chain of arcs."""
        arc = stretch * lengths * self.finger.L
        return arc_chain(arc, -turned / arc, self.clamp_angle, n)

    def profile(self, unknowns, pressure, n):
        if not self.is_arcs():
            return super().profile(unknowns, pressure, n)
        turned, stretch, lengths = self.turns(unknowns)
        x, y = self.arcs(turned, stretch, lengths, n)
        # The points are evenly spaced along the deformed line: their reference place and angle follow part by part.
        bounds = jnp.concatenate([jnp.zeros(1), jnp.cumsum(stretch * lengths)])
        s = jnp.linspace(0.0, 1.0, n) * bounds[-1]
        reference = jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)])
        angle = self.clamp_angle - jnp.concatenate([jnp.zeros(1), jnp.cumsum(turned)])
        part = jnp.clip(jnp.searchsorted(bounds[1:], s), 0, lengths.shape[0] - 1)
        return {
            "X": jnp.interp(s, bounds, reference) * self.finger.L,
            "x": x,
            "y": y,
            "theta": jnp.interp(s, bounds, angle),
            "stretch": stretch[part],
        }
