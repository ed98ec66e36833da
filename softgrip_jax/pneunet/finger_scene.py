"""What all scenes of the finger share: chambers that bend a cover, as equations for a path.

Signs: x runs along the finger from the clamp, the chambers bend it towards -y. `weight` = (g_x, g_y) is a force per
length (N/m): (0, -2) for the thesis's horizontal finger, (2, 0) for one that hangs. Moments and angles of the bending
direction are reported as positive numbers.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..checked import is_concrete, to_float_array
from ..materials import NeoHookean
from ..numerics.paths import Fine
from ..path_scene import PathScene, Span
from .beam import Cover, Loads, Part, Shot, State, beginning, shoot, slopes
from .chamber import LEAST_ANGLE, Chamber, end_moment, wall_limit
from .finger import SEGMENT_FIELDS, PneuNet
from .section import section_law

Scalar = Float[Array, ""]

STEPS = 12
"""Dopri8 steps along a finger: 1e-10 of the tip force at half the fold's moment, 3e-9 at the fold, 1e-7 in tests of
random fingers under weights and pulls; 4 steps: 1e-7, 5e-6; 8 steps: 1e-9, 6e-8."""
ROUGH_STEPS = 2
"""In each part. Two steps know the tip force to 1e-8 at half the fold's moment, to 1e-3 at the fold, and find the way.
One would do at half the fold, but has folds of its own near it."""
INCLINATION_PARTS = 13
"""Parts of a uniform finger that each keep their own inclination: the thesis's finger has 12.8 chambers."""
LARGEST_GROWTH = 4.0
"""Single shooting up to e^4 = 55: rounding then stays near 1e-14 at the tip."""
RESTARTS = 8
"""Parts of multiple shooting: under 1 N, L = 300 mm a perturbation grows by e^28 along the beam, e^3.5 in a part."""


def to_weight(value: Any) -> Any:
    """(g_x, g_y) as an array; a written (0, 0) is no weight at all, so that nothing is computed for it."""
    if value is None or (isinstance(value, np.ndarray) and not np.any(value)):
        return None
    if isinstance(value, tuple | list) and all(type(v) in (int, float) and v == 0 for v in value):
        return None
    return to_float_array(np.asarray(value) if isinstance(value, tuple | list) else value)


LOADING = 4.0
"""Loads (over EI/L^2) per unit of the path: the longest step, 4, at twice the mean slope then adds 32. From one load
that buckles a finger with its tip held to the next it is 39.5 (20.2, 59.7, ...); a step across two goes unseen."""


class PartChamber(NamedTuple):
    """One part's chamber: its own dimensions, and how much of the part's turn is its inclination."""

    fields: dict[str, Scalar]
    share: Scalar


class Bent(NamedTuple):
    """A beam as integrated from given unknowns."""

    cover: Cover
    parts: Part
    start: State
    shot: Shot
    gaps: Array
    """Mismatches: where parts meet, in multiple shooting; of the inclinations, where they couple."""

    @property
    def end(self) -> State:
        """The state at the tip."""
        return jax.tree.map(lambda v: v[-1], self.shot.ends)


class FingerScene(PathScene):
    """A finger under pressure with the loads that a subclass names.

    section: law of the cover: "exact", "thesis" or "inextensible". inclination: how the chambers' walls incline as the
    finger bends (thesis algorithm 5): "segment", theta_s = theta' (2 h_x + h_L) / 2, half the angle between adjacent
    chambers; "gap", theta_s = theta' h_x, the turn over the gap alone; "none", theta_s = 0.
    """

    if TYPE_CHECKING:  # every subclass has these, as fields of its own or from its gripper

        @property
        def finger(self) -> PneuNet: ...

        weight: Array | None
        section: str
        inclination: str
        shooting: str
        steps: int

    def has_rough_way(self):
        # Inclinations that couple are found part by part, with steps of their own.
        return self.inclination == "none" and self.chambers()[1] > ROUGH_STEPS

    def prepared(self):
        """Multiple shooting where a perturbation would grow too much along the beam (needs known numbers)."""
        known = jax.tree.leaves(self)
        if self.shooting != "auto" or not is_concrete(*known):
            return self
        finger = self.finger
        with jax.ensure_compile_time_eval():  # known numbers stay numbers inside somebody's jit
            growth = np.sqrt(float(np.max(np.asarray(self.largest_force() * finger.L**2 / self.stiffness()))))
        return dataclasses.replace(self, shooting="multiple" if growth > LARGEST_GROWTH else "single")

    def stiffness(self) -> Scalar:
        """EI = mu B H^3 / 3 (plane strain), N m^2."""
        return self.finger.moment_scale() * self.finger.H / 3

    def largest_force(self) -> Scalar:
        """A bound of the force along the beam from the external loads, N."""
        return jnp.zeros_like(self.finger.L)

    def tip_loads(self, held: Scalar, share: Scalar) -> Loads:
        """The loads on the cover over mu B H; `held` is the unknown force at a held tip."""
        raise NotImplementedError

    def beam(self, unknowns: Array, held: Scalar | None, share: Scalar, pressure: Scalar, fine: Fine) -> Bent:
        """The beam from its unknowns.

        unknowns: M(0) in units of EI/L; for multiple shooting (theta, M) where each further part begins; where it
        couples, the inclination of every part.
        """
        parts, steps = self.chambers()
        count, restarted = parts.low.shape[0], 1 + self.restart_unknowns()
        if fine is not True:
            steps = jnp.where(fine, steps, ROUGH_STEPS)
        cover = Cover(self.finger.H / self.finger.L, self.law(), self.tip_loads(held, share))
        unit = cover.slenderness / 3
        start = beginning(self.clamp() + 0 * unknowns[0], unknowns[0] * unit)
        inclinations = unknowns[restarted:] if self.inclination != "none" else jnp.zeros(count)
        # A part that bends backwards keeps parallel walls.
        active = -jax.vmap(self.push, in_axes=(0, None, 0))(parts.chamber, pressure, jnp.maximum(inclinations, 0.0))
        if self.shooting != "multiple":
            shot, gaps = shoot(cover, start, parts, active, steps, None), jnp.zeros(0)
        else:
            theta, moment = unknowns[1:restarted].reshape(2, -1)
            shot = shoot(cover, start, parts, active, steps, jax.vmap(beginning)(theta, moment * unit))
            gaps = jnp.concatenate([shot.ends.theta[:-1] - theta, shot.ends.moment[:-1] / unit - moment])
            # Nothing depends on x and y along the way: parts that began at the origin move to where the last ended.
            x, y = jnp.cumsum(shot.ends.x), jnp.cumsum(shot.ends.y)
            before_x, before_y = (jnp.concatenate([jnp.zeros(1), v[:-1]]) for v in (x, y))
            states = shot.states
            if states is not None:
                states = states._replace(x=states.x + before_x[:, None], y=states.y + before_y[:, None])
            starts, ends = shot.starts._replace(x=before_x, y=before_y), shot.ends._replace(x=x, y=y)
            shot = Shot(starts, ends, states, shot.active)
        if self.inclination != "none":
            turned = shot.starts.theta - shot.ends.theta
            gaps = jnp.concatenate([gaps, inclinations - parts.chamber.share * turned])
        return Bent(cover, parts, start, shot, gaps)

    def clamp(self) -> Scalar:
        """theta(0), rad."""
        return jnp.zeros_like(self.finger.L)

    def law(self):
        """The section law of the cover."""
        return section_law(self.section, self.finger.material)

    def restart_unknowns(self) -> int:
        """How many unknowns multiple shooting adds."""
        if self.shooting != "multiple":
            return 0
        return 2 * (self.chambers()[0].low.shape[0] - 1)

    def resting(self, held: int) -> Array:
        """The unknowns of a straight finger without load: zeros, and the clamp angle in every part."""
        half = self.restart_unknowns() // 2
        inclinations = 0 if self.inclination == "none" else self.chambers()[0].low.shape[0]
        angles = jnp.broadcast_to(self.clamp(), (half,))
        return jnp.concatenate([jnp.zeros(1 + held), angles, jnp.zeros(half + inclinations)])

    def chambers(self) -> tuple[Part, int]:
        """The parts of the beam and the steps in each: one part where all chambers push alike."""
        finger = self.finger
        count = finger.segments or (1 if self.inclination == "none" else INCLINATION_PARTS)
        steps = max(1, -(-self.steps // count))
        if self.shooting == "multiple":
            # The boundary layers of the finger above are 1/28 of its length: all steps in every part.
            steps = self.steps
            count = RESTARTS if count == 1 else count
        fields = {name: jnp.broadcast_to(getattr(finger, name), (count,)) for name in SEGMENT_FIELDS}
        pitch = 2 * fields["h_x"] + fields["h_L"]
        lengths = pitch / jnp.sum(pitch)
        bounds = jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)])
        # theta_s from the turn of the whole part: half of it over one pitch, or what the gap has of it.
        share = {"segment": 0.5 * pitch, "gap": fields["h_x"], "none": 0 * pitch}[self.inclination]
        return Part(bounds[:-1], bounds[1:], PartChamber(fields, share / (lengths * finger.L))), steps

    def with_chamber(self, chamber: PartChamber) -> PneuNet:
        """The finger with one part's dimensions."""
        return dataclasses.replace(self.finger, **chamber.fields)

    def push(self, chamber: PartChamber, pressure: Scalar, inclination: Scalar) -> Scalar:
        """M_T over mu B H^2, in the bending direction."""
        finger = self.with_chamber(chamber)
        return end_moment(finger, pressure, inclination) / finger.moment_scale()

    def pressure_span(self):
        finger = self.finger
        fields = {name: jnp.broadcast_to(getattr(finger, name), (finger.segments or 1,)) for name in SEGMENT_FIELDS}

        def of(fields):
            wall = Chamber(dataclasses.replace(finger, **fields), jnp.zeros_like(finger.L))
            one = wall.finger
            # On a whole wall this pressure bends the cover by about one radian.
            scale = one.moment_scale() * one.H / (3 * one.L * one.a * one.b * (0.5 * one.H + one.a))
            # Parallel walls touch where the free arc reaches the plane, (4.15), (4.16).
            touch = wall.load(jnp.maximum(2 * jnp.arctan(wall.finger.h_x / wall.finger.a), LEAST_ANGLE))
            if isinstance(finger.material, NeoHookean):
                return touch, scale, wall.load(jnp.pi + jnp.zeros_like(scale))
            return touch, scale, wall_limit(wall.finger)

        begin, scale, end = jax.vmap(of)(fields)
        loads = self.largest_force() * finger.L**2 / self.stiffness()
        return Span(jnp.maximum(loads / LOADING, 1.0), jnp.min(begin), jnp.min(scale), jnp.min(end))

    def weights(self, share: Scalar) -> tuple[Scalar, Scalar]:
        """(g_x, g_y) over mu B H, times L."""
        if self.weight is None:
            zero = jnp.zeros_like(self.finger.L)
            return zero, zero
        scale = share * self.finger.L / self.finger.force_scale()
        return self.weight[0] * scale, self.weight[1] * scale

    def beam_observables(self, bent: Bent) -> dict[str, Array]:
        """What every finger reports."""
        finger, end = self.finger, bent.end
        return {
            "tip": jnp.stack([end.x, end.y]) * finger.L,
            "tip_angle": self.clamp() - end.theta,
            "end_moment": -bent.shot.active[-1] * finger.moment_scale(),
        }

    def beam_profile(self, bent: Bent, n: int) -> dict[str, Array]:
        """X, x, y (m), theta (rad) and stretch at n points, by cubic Hermite interpolation between the steps."""
        assert bent.shot.states is not None  # a number of steps that is known
        count, steps = bent.shot.states.theta.shape
        nodes = jax.tree.map(lambda s, v: jnp.concatenate([s[:, None], v], axis=1), bent.shot.starts, bent.shot.states)
        places = bent.parts.low[:, None] + (bent.parts.high - bent.parts.low)[:, None] * jnp.linspace(0, 1, steps + 1)
        at_nodes = jax.vmap(jax.vmap(lambda s, state, active: slopes(s, state, (bent.cover, active)), (0, 0, None)))
        rates = at_nodes(places, nodes, bent.shot.active)

        def at(s):
            part = jnp.clip(jnp.searchsorted(bent.parts.high, s), 0, count - 1)
            local = (s - bent.parts.low[part]) / (bent.parts.high[part] - bent.parts.low[part]) * steps
            k = jnp.clip(jnp.floor(local).astype(int), 0, steps - 1)
            width = (bent.parts.high[part] - bent.parts.low[part]) / steps
            return jax.tree.map(
                lambda v, r: _cubic(v[part, k], v[part, k + 1], r[part, k] * width, r[part, k + 1] * width, local - k),
                nodes,
                rates,
            )

        s = jnp.linspace(0.0, 1.0, n)
        state = jax.vmap(at)(s)
        length = self.finger.L
        return {
            "X": s * length,
            "x": state.x * length,
            "y": state.y * length,
            "theta": state.theta,
            "stretch": state.stretch,
        }


def _cubic(y0: Scalar, y1: Scalar, d0: Scalar, d1: Scalar, t: Scalar) -> Scalar:
    """The cubic with values y0, y1 and slopes d0, d1 (per unit t) at t = 0 and 1."""
    return y0 + t * (d0 + t * (3 * (y1 - y0) - 2 * d0 - d1 + t * (2 * (y0 - y1) + d0 + d1)))
