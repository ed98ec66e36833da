"""What all scenes of the finger share: chambers that bend a cover, as equations for a path.

Signs: x runs along the finger from the clamp, the chambers bend it towards -y. `weight` = (g_x, g_y) is a force per
length (N/m): (0, -2) for the thesis's horizontal finger, (2, 0) for one that hangs. Moments and angles of the bending
direction are reported as positive numbers.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..equations import PathEquations
from ..errors import InputError
from ..fields import choice, choice_or, is_concrete, to_float_array
from ..load_path import LATER, GentlePath, LoadPath
from ..numerics.choice import larger, largest, smallest
from ..numerics.quadrature import Points, gauss_points
from ..numerics.xla import materialised
from ..reasons import Reason
from ..results import Solution, Status
from ..scene import RESIDUAL_EPS, ROUNDING_EPS, Found, Scene
from ..solvers.arc_length import ArcLength
from .beam.collocation import Cover, Line, Loads, Part, at_place, bend, corrected, pushed_over_stiffness, states_of
from .beam.method import POINTS, BeamMethod, Collocation, Shooting
from .beam.shooting import Arrived, Segments, look, segments_of, shoot, unknown_count
from .cell.law import LARGEST_PRESSURE, cell_section, range_margin, warn_outside
from .finger import SEGMENT_FIELDS, PneuNet
from .own_parts import require_law, require_walls
from .rules import chambers_apart, margins_of_parts
from .section.base import SectionLaw
from .section.choice import section_law
from .wall.arc import within
from .wall.base import WallModel
from .wall.pressures import end_moment, gap_moment, pressure_of_moment, touching_angle, wall_limit
from .wall.small_strain import SmallStrainWalls

Scalar = Float[Array, ""]

PART_POINTS = 3
"""At least so many in each of several parts: order 6."""
SMOOTH_GROWTH = 4.0
"""Under strong tension bending decays like e^-growth along a finger, in a layer at each end; up to e^4 the points that
are there know it. Beyond, one more point for each unit of growth does."""
ROUGH = 0.05
"""Of the curvature's spectrum: tip forces are then right to about a thousandth (4 points, type A at two thirds of its
limit: up to 0.04, and 8e-4), what is integrated being right to the square."""
EARLY = 1e-3
"""See LoadPath.early: of fingers without loads, whose way begins with the pressure."""
AT_THE_END = 1e-12
"""A path ends this part of the walls' largest pressure before it: rounding leads beyond, where there is no wall."""
SLOWLY = 4.0
"""See MomentSpan: of fingers with other loads. The less, the sharper the path turns where the chambers begin."""
GROWTH_PER_SEGMENT = 6.0
"""Rounding at a segment's beginning is multiplied by e^6 = 400 on the way to its end: what is left is far below the
tolerance of any steps."""
PART_OF_TOLERANCE = 0.01
"""Of the tolerance of adaptive steps: what may be left of the equations of shooting; rounding grows on the way."""
SURE = 1e-3
"""Of equal steps: what their error estimates may add up to, as much as ROUGH leaves of the tip force."""
LEAST_GAP = 1e-9
"""Of h_x over h_L, where the moment of chambers is taken without the root of (4.39)."""
INCLINATION_PARTS = 13
"""Parts of a uniform finger that each keep their own inclination: the thesis's finger has 12.8 chambers."""


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


INCLINATIONS = ("segment", "gap", "none")
DRIVES = ("thesis", "cell", "small_strain")
SPREADS = ("root", "none")


SNAPPING, MANY_STEPS = 0.0005, 2000
"""Of 3,072 held fingers by the cell law it misses no first limit point (from where Newton's method is not sure any more
on it is a fifth of this); five times as much misses one in a thousand, and 0.02 one in ten, up to 49 % too high.
Less loses fingers under heavy loads: 0.0003 12 of 500."""
SURELY_HELD = 15.0
"""Pushes, over the least stiffness over L^2, that buckle no beam whose tip is held: 20.2 buckles a column."""
LIGHT_LOADS = 5.0
"""Loads, over EI / L^2, beside the pressure and the force at a held tip, under which Newton's method finds no loops: of
8,192 held fingers under loads of any size it found 15, with loads of 7.4 and more."""
LIGHT = 7.0
"""Forces, over EI / L^2, the one at a held tip among them, that buckle no finger of several segments: limit points of
8,192 held fingers by the cell law, half of them with weight and offset, lie at 7.7 and more in all."""
FREE_LOADS = 1.2
"""Half of what buckles a column with a free tip, over EI / L^2; weight counts a third (7.8 buckles it). Of 8,192 free
fingers by the cell law, pushed along, Newton's method led to wrong states from 1.59 on."""


def opening(inclinations: Array) -> Array:
    """Inclinations of walls that open, zero where they would close."""
    return larger(0.0, inclinations)


class PartChamber(NamedTuple):
    """One part's chamber: its own dimensions, and how it inclines."""

    fields: dict[str, Scalar]
    inclining: Scalar
    """Its inclination over the turn of the part."""


class Moment(NamedTuple):
    """What parallel chambers, all alike, do to the cover, in place of the pressure in them."""

    active: Scalar
    """M_T over mu B H^2."""


class MomentPath(LoadPath):
    """The way of a finger whose chambers are all alike and keep parallel walls: its coordinate is their moment.

    The moment alone acts on the cover, so the chambers are solved for at the ends of the way and not on it. After other
    loads it begins with zero slope, as x^2 / (x + early) in units of EI / L: no kink for the tangent.
    """

    finger: PneuNet
    most: Scalar
    """M_T at `end`, N m."""

    def _unit(self) -> Scalar:
        """EI / L, N m."""
        return self.finger.moment_scale() * self.finger.H / (3 * self.finger.L)

    def coordinate_of(self, pressure):
        moment = end_moment(self.finger, jnp.minimum(pressure, self.end), jnp.zeros_like(self.end))
        # Rounding may put the end itself beyond the end, where there is no moment.
        return self._place(jnp.fmin(moment, self.most)) + jnp.maximum(pressure - self.end, 0) / self.step

    def last(self):
        return self._place(self.most)

    def _place(self, moment: Scalar) -> Scalar:
        moment = moment / self._unit()
        return self.loading + 0.5 * (moment + jnp.sqrt(moment * (moment + 4 * self.early)))

    def _moment_at(self, u: Array) -> Scalar:
        """In units of EI / L."""
        x = jnp.maximum(u[-1] - self.loading, 0)
        return x * x / jnp.where(x > 0, x + self.early, 1.0)

    def pressure_at(self, u, wanted=True):
        return pressure_of_moment(self.finger, self._moment_at(u) * self._unit(), wanted)

    def load_at(self, u):
        return Moment(self._moment_at(u) * self.finger.H / (3 * self.finger.L))


class Bent(NamedTuple):
    """A beam with given unknowns."""

    cover: Cover
    parts: Part
    line: Line | Arrived
    """With all of its points by collocation; by shooting with the ends of its parts, see `FingerScene.seen`."""
    active: Array
    """The active moment of every part."""
    gaps: Array
    """Mismatches of moments, over EI / L; by shooting of angles, too."""
    turned: Array
    """The turn of every part, positive where it bends as the chambers push."""


class FingerScene(PathEquations, Scene):
    """A finger under pressure with the loads that a subclass names, and a tip that is free or, see `tip`, held.

    The unknowns are those of the beam; of a held tip the force that holds it comes first.

    Args:
        section: law of the cover: "exact", "thesis" or "inextensible", or a `SectionLaw` of your own.
        inclination: how the chambers' walls incline as the finger bends (thesis algorithm 5): "segment", theta_s =
            theta' (2 h_x + h_L) / 2, half the angle between adjacent chambers, "gap", theta_s = theta' h_x, the turn
            over the gap alone, or "none", theta_s = 0.
        drive: what pushes the finger: "thesis", arcs in the walls and M_T of (4.39) on a bare cover, the thesis's
            model, or "cell", the cell law (`cell.law`), near to finite elements of chamber, walls, rims and cover
            together, at every point of the beam. With it section and inclination have no part, and end_moment is that
            of a straight segment at the tip. The forces of the two differ by a factor of about four:
            docs/theory/cell.md. "small_strain" are the walls as plates of small strain, the simplest law
            (`SmallStrainWalls`): it knows no inclination, either. A `WallModel` of your own may stand there, too.
        moment_spread: of the drives "thesis" and "small_strain": "root" as printed, "none" without the root
            sqrt(2 h_x / (2 h_x + h_L)).
        loading: the way on which a state is reached, which decides which one it is: "first", weight and pulls grow from
            nothing to their full size, then the pressure, or "proportional", weight, pulls and tip offset grow in
            proportion to the pressure. A light finger arrives at the same state; one that is too heavy to be held
            without pressure may be held with it. Questions without a pressure of their own (`limit_pressure`,
            `pressure_for`, `branch`) then begin at all loads and a moderate pressure, reached in proportion.
        beam: how the beam's equations are solved, `Collocation(points=...)` or `Shooting(...)`; with `points` given,
            too, it is an InputError.
        points: Gauss points of the collocation where no `beam` is given.
    """

    SOLVERS: ClassVar[tuple[str, ...]] = ("ArcLength", "Newton")

    if TYPE_CHECKING:  # every subclass has these, as fields of its own or from its gripper

        @property
        def finger(self) -> PneuNet: ...

        weight: Array | None  # pyright: ignore[reportGeneralTypeIssues]
        section: str | SectionLaw  # pyright: ignore[reportGeneralTypeIssues]
        inclination: str  # pyright: ignore[reportGeneralTypeIssues]
        points: int  # pyright: ignore[reportGeneralTypeIssues]
        beam: BeamMethod | None  # pyright: ignore[reportGeneralTypeIssues]

    def __check_init__(self) -> None:
        if not isinstance(self.beam, BeamMethod | None):
            raise InputError(
                f"{type(self).__name__}.beam is {self.beam!r}; it must be sg.pneunet.Collocation(...) or "
                "sg.pneunet.Shooting(...)."
            )
        if self.beam is not None and self.points != POINTS:
            raise InputError(
                f"{type(self).__name__}.points is {self.points} and its beam is {self.beam!r}; points is short for "
                "beam=Collocation(points=...), so give one of them."
            )
        if self.drive == "cell" and isinstance(self.beam, Shooting):
            raise InputError(
                f"{type(self).__name__}.beam is {self.beam!r} and its drive 'cell'; the cell law is solved by "
                "sg.pneunet.Collocation(...) only."
            )
        require_law(self.section)
        require_walls(self.drive, self.finger)

    def method(self) -> Any:
        """How the beam's equations are solved."""
        return Collocation(self.points) if self.beam is None else self.beam

    def with_method(self, method: BeamMethod) -> Any:
        """The same scene solved in another way."""
        if isinstance(method, Collocation):
            return dataclasses.replace(self, beam=None, points=method.points)
        return dataclasses.replace(self, beam=method, points=POINTS)

    def searched(self):
        method = self.method()
        if not isinstance(method, Shooting) or method.searching:
            return self
        return self.with_method(dataclasses.replace(method, searching=True))

    loading: str = choice("first", "proportional", default="first", kw_only=True)
    drive: str | WallModel = choice_or(WallModel, *DRIVES, default="thesis", kw_only=True)
    moment_spread: str = choice(*SPREADS, default="root", kw_only=True)

    def prepared(self):
        """With more points, or more segments, where loads that are known numbers bend the beam in thin layers."""
        if self.is_cell():
            warn_outside(self.finger, stacklevel=4)
        if not is_concrete(*jax.tree.leaves(self)):
            return self
        with jax.ensure_compile_time_eval():  # known numbers stay numbers inside somebody's jit
            growth = np.sqrt(float(np.max(np.asarray(_tension(self)))))
        if not (np.isfinite(growth) and growth > SMOOTH_GROWTH):
            return self
        method = self.method()
        if isinstance(method, Shooting):
            needed = int(np.ceil(growth / GROWTH_PER_SEGMENT))
            return self.with_method(dataclasses.replace(method, segments=max(method.segments, needed)))
        return self.with_method(Collocation(max(method.points, POINTS + int(np.ceil(growth - SMOOTH_GROWTH)))))

    def is_cell(self) -> bool:
        """True where the cell law drives the finger, and is its section law, too."""
        return self.drive == "cell"

    def walls(self) -> WallModel | None:
        """The model of one chamber that drives the finger; None for the thesis's arcs and for the cell law."""
        if self.drive == "small_strain":
            return SmallStrainWalls()
        return self.drive if isinstance(self.drive, WallModel) else None

    def inclines(self) -> bool:
        """True where what a chamber does depends on the turn of its own part of the beam."""
        return self.inclination != "none" and self.drive not in ("cell", "small_strain")

    def stiffness(self) -> Scalar:
        """EI = mu B H^3 / 3 (plane strain), N m^2."""
        return self.finger.moment_scale() * self.finger.H / 3

    def held_unit(self) -> Scalar:
        """EI / L^2, N: the scale of the force at a held tip."""
        return self.stiffness() / self.finger.L**2

    def has_close_limits(self):
        """By the cell law a held tip bends the chambers near the clamp backwards, until they snap, one by one."""
        return self.is_cell() and self.tip() is not None

    def solver(self):
        return ArcLength(detour=SNAPPING, max_steps=MANY_STEPS) if self.has_close_limits() else ArcLength()

    def grows_together(self):
        return self.loading == "proportional"

    def tip(self) -> Any:
        """How the tip is held, a `HeldTip`; None where it is free."""
        return None

    def largest_force(self) -> Scalar:
        """A bound of the force along the beam from the external loads, N."""
        return self.tip().largest_force(self)

    def tip_loads(self, held: Scalar, load_factor: Scalar) -> Loads:
        """The loads on the cover over mu B H; `held` is the unknown force at a held tip."""
        return self.tip().loads(self, held, load_factor)

    def unloaded_state(self):
        return jnp.append(0.0, self.straight())

    def residual_and_observables(self, unknowns, load_factor, pressure):
        return self.tip().residual_and_observables(self, unknowns, load_factor, pressure)

    def profile(self, unknowns, pressure, n):
        return self.beam_profile(self.seen(unknowns, pressure), n)

    def touches_where_positive(self):
        tip = self.tip()
        return "tip_force" if tip is not None and tip.only_presses else None

    def bend(self, unknowns: Array, held: Scalar | None, load_factor: Scalar, pressure: Scalar | Moment) -> Bent:
        """The beam from its unknowns. By collocation they are the curvatures L theta' at all points, each times the
        root of its weight, so that their norm is that of the curvature along the beam; by shooting see
        `shooting.segments_of`."""
        method = self.method()
        if isinstance(method, Shooting):
            return self._shot(method, unknowns, held, load_factor, pressure)
        parts, points = self.chambers()
        widths = parts.high - parts.low
        curvature = self._at_points(unknowns)
        cover, line = self.line(curvature, held, load_factor, pressure)
        turned = -widths * (curvature @ points.weights)
        active = self._active(parts, turned, pressure)
        gaps = materialised(line.gaps(active).reshape(-1) * 3 / cover.slenderness)
        return Bent(cover, parts, line, active, gaps, turned)

    def _active(self, parts: Part, turned: Array, pressure: Scalar | Moment) -> Array:
        """The active moments of parts that have turned so far, over mu B H^2."""
        if self.is_cell():  # the law of the section holds what the chambers do
            return jnp.zeros(len(turned))
        if isinstance(pressure, Moment):
            return -pressure.active + jnp.zeros(len(turned))
        # A part that bends backwards keeps parallel walls.
        parallel = not self.inclines()
        inclinations = jnp.zeros_like(turned) if parallel else opening(parts.chamber.inclining * turned)
        return -jax.vmap(self.push, in_axes=(0, None, 0))(parts.chamber, pressure, inclinations)

    def cover(self, held: Scalar | None, load_factor: Scalar, pressure: Any = None) -> Cover:
        """What bends, and the loads on it; the pressure acts where the cell law is the section's."""
        law = self.law()
        if self.is_cell():
            parts, _ = self.chambers()
            law = jax.vmap(lambda chamber: cell_section(self.with_chamber(chamber), pressure))(parts.chamber)
        return Cover(self.finger.H / self.finger.L, law, self.tip_loads(held, load_factor))

    def _cut(self, method: Shooting, unknowns: Array) -> tuple[Part, Points, Segments]:
        parts, points = self.chambers()
        coupled = self.inclines()
        own = unknowns[-unknown_count(method, len(parts.low), coupled) :]
        return parts, points, segments_of(method, parts, self.clamp(), own, coupled)

    def _shot(
        self, method: Shooting, unknowns: Array, held: Scalar | None, load_factor: Scalar, pressure: Scalar | Moment
    ) -> Bent:
        """`bend` by shooting."""
        parts, _, segments = self._cut(method, unknowns)
        parallel = segments.last is None
        active = self._active(parts, jnp.zeros_like(parts.low) if parallel else segments.turned(), pressure)
        cover = self.cover(held, load_factor)
        arrived = shoot(method, cover, segments, active)
        turned = -jnp.diff(arrived.angles, prepend=self.clamp())
        return Bent(cover, parts, arrived, active, arrived.missed, turned)

    def curvatures(self, unknowns: Array) -> Array:
        """L theta' at the points of every part, under all of the loads."""
        method = self.method()
        if not isinstance(method, Shooting):
            return self._at_points(unknowns)
        return self._look(method, unknowns)[0]

    def _look(self, method: Shooting, unknowns: Array) -> tuple[Array, Scalar]:
        """See `shooting.look`."""
        _, points, segments = self._cut(method, unknowns)
        return look(method, self.cover(self.held(unknowns), jnp.ones_like(self.finger.L)), segments, points)

    def held(self, unknowns: Array) -> Scalar | None:
        """The unknown force at a held tip, over EI / L^2."""
        return None if self.tip() is None else unknowns[0]

    def seen(self, unknowns: Array, pressure: Scalar) -> Bent:
        """The beam under all of its loads, with all of its line."""
        one = jnp.ones_like(pressure)
        bent = self.bent(unknowns, one, pressure)
        if isinstance(bent.line, Line):
            return bent
        return bent._replace(line=self.line(self.curvatures(unknowns), self.held(unknowns), one, pressure)[1])

    def _at_points(self, unknowns: Array) -> Array:
        """The curvatures of the collocation; they are the last of the unknowns."""
        parts, points = self.chambers()
        widths, count = parts.high - parts.low, len(points.places)
        unknowns = unknowns[-len(widths) * count :].reshape(-1, count)
        return unknowns / jnp.sqrt(widths[:, None] * points.weights[None])

    def line(
        self, curvature: Array, held: Scalar | None, load_factor: Scalar, pressure: Scalar | Moment
    ) -> tuple[Cover, Line]:
        """The beam with these curvatures under its loads; the pressure acts on it where the cell law is its law."""
        parts, points = self.chambers()
        cover = self.cover(held, load_factor, pressure)
        return cover, bend(cover, self.clamp(), parts, curvature, points)

    def margins_at_rest(self):
        tip = self.tip()
        known = {"cell_law_range": range_margin(self.finger)} if self.is_cell() else {}
        return margins_of_parts(self.finger) | ({} if tip is None else tip.margins_at_rest(self)) | known

    def margins_of_state(self, unknowns, pressure):
        """chambers_apart: see `rules`. Arcs only bend as the chambers push, which moves their tops apart; the cell law
        knows what chambers do that meet."""
        if self.is_arcs() or self.is_cell():
            return {}
        parts, points = self.chambers()
        return {"chambers_apart": chambers_apart(self.finger, parts, self.curvatures(unknowns), points)}

    def is_arcs(self) -> bool:
        """True where each part is a circular arc: nothing but moments acts on the cover."""
        return False

    def is_one_arc(self) -> bool:
        """True where all parts of a uniform finger are the same arc: they end at the same pressure, too."""
        return False

    def bends_evenly(self) -> bool:
        """True where every part has one curvature, which is then all that is looked for."""
        return False

    def clamp(self) -> Scalar:
        """theta(0), rad."""
        return jnp.zeros_like(self.finger.L)

    def law(self):
        """The section law of the cover."""
        return section_law(self.section, self.finger.material)

    def straight(self) -> Array:
        """The unknowns of the beam of a finger without load."""
        parts, points = self.chambers()
        method = self.method()
        if isinstance(method, Shooting):
            return jnp.zeros(unknown_count(method, len(parts.low), self.inclines()))
        return jnp.zeros(len(parts.low) * len(points.places))

    def chambers(self) -> tuple[Part, Points]:
        """The parts of the beam and the points in each: one part where all chambers push alike."""
        finger = self.finger
        one = not self.inclines() or self.is_one_arc()
        count = finger.segments or (1 if one else INCLINATION_PARTS)
        wanted = self.method().points
        if self.bends_evenly():
            points = gauss_points(1)
        else:
            points = gauss_points(wanted if count == 1 else max(PART_POINTS, 1 - (-wanted // count)))
        fields = {name: jnp.broadcast_to(getattr(finger, name), (count,)) for name in SEGMENT_FIELDS}
        pitch = 2 * fields["h_x"] + fields["h_L"]
        lengths = pitch / jnp.sum(pitch) if count > 1 else np.ones(1)
        bounds = jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)])
        # theta_s from the turn of the whole part: half of it over one pitch, or what the gap has of it.
        inclining = {"segment": 0.5 * pitch, "gap": fields["h_x"], "none": 0 * pitch}[self.inclination]
        return Part(bounds[:-1], bounds[1:], PartChamber(fields, inclining / (lengths * finger.L))), points

    def with_chamber(self, chamber: PartChamber) -> PneuNet:
        """The finger with one part's dimensions."""
        return dataclasses.replace(self.finger, **chamber.fields)

    def is_lightly_loaded(self):
        """With the cell law: where other loads than the pressure buckle no finger."""
        if not self.is_cell():
            return None
        loads = _tension(self)
        if self.tip() is not None:
            return loads < LIGHT_LOADS
        weight = 0.0 if self.weight is None else jnp.sum(jnp.abs(self.weight)) * self.finger.L / self.held_unit()
        return loads - 2 / 3 * weight < FREE_LOADS

    def is_the_only_state(self, unknowns, pressure):
        """With the cell law: where no push buckles the finger, since the moments of its cells rise with their
        curvatures."""
        held = self.held(unknowns)
        if held is None:
            return jnp.asarray(True)
        parts, points = self.chambers()
        if len(parts.low) > 1:
            return _tension(self) + jnp.abs(held) < LIGHT
        cover = self.cover(held, jnp.ones_like(pressure), pressure)
        return pushed_over_stiffness(cover, self.clamp(), self.curvatures(unknowns)[0], points) < SURELY_HELD

    def push(self, chamber: PartChamber, pressure: Scalar, inclination: Scalar) -> Scalar:
        """M_T over mu B H^2, in the bending direction."""
        finger = self.with_chamber(chamber)
        walls = self.walls()
        on_gap = self.moment_spread == "none" and not isinstance(self.drive, WallModel)
        if on_gap:  # walls without any gap could not incline; the derivatives are those by the gap that is given
            short = lax.stop_gradient(larger(LEAST_GAP * finger.h_L - finger.h_x, 0.0))
            finger = dataclasses.replace(finger, h_x=finger.h_x + short)
        if on_gap and self.drive == "small_strain":
            moment = SmallStrainWalls().gap_moment(finger, pressure)
        elif walls is not None:
            moment = walls.end_moment(finger, pressure, inclination)
        else:
            moment = (gap_moment if on_gap else end_moment)(finger, pressure, inclination)
        if walls is not None:
            moment = jnp.where(pressure <= walls.largest_pressure(finger), moment, jnp.nan)
        return moment / finger.moment_scale()

    def pressure_span(self):
        finger, walls = self.finger, self.walls()
        fields = {name: jnp.broadcast_to(getattr(finger, name), (finger.segments or 1,)) for name in SEGMENT_FIELDS}

        def of(fields):
            wall = within(dataclasses.replace(finger, **fields), jnp.zeros_like(finger.L))
            one = wall.finger
            # On a whole wall this pressure bends the cover by about one radian.
            scale = one.moment_scale() * one.H / (3 * one.L * one.a * one.b * (0.5 * one.H + one.a))
            if walls is not None:
                return walls.contact_pressure(one), scale, walls.largest_pressure(one)
            # Parallel walls touch where the free arc reaches the plane, (4.15), (4.16).
            touch = wall.load(touching_angle(one))
            if finger.material.closed_forms().has_rising_wall:
                return touch, scale, wall.load(jnp.pi + jnp.zeros_like(scale))
            return touch, scale, wall_limit(one)

        begin, scale, end = jax.vmap(of)(fields)
        loads = _tension(self)
        loading = jnp.where(self.is_unloaded(), 0.0, jnp.maximum(loads / LOADING, 1.0))
        if self.is_cell():
            end = LARGEST_PRESSURE * finger.material.shear_modulus()
            return GentlePath(loading, 0 * loading, smallest(scale), end, jnp.where(self.is_unloaded(), 0.0, SLOWLY))
        numbers = (loading, smallest(begin), smallest(scale), (1 - AT_THE_END) * smallest(end))
        if self.is_driven_by_moment():
            wall = within(finger, jnp.zeros_like(finger.L))
            most = wall.observe(jnp.pi + jnp.zeros_like(finger.L), numbers[-1])["end_moment"]
            return MomentPath(*numbers, jnp.where(self.is_unloaded(), 0.0, SLOWLY), finger, most)
        return LoadPath(*numbers, jnp.where(self.is_unloaded(), EARLY, LATER))

    def spent(self, unknowns, pressure):
        return self._spent_walls(unknowns, pressure) | self._spent_cover(unknowns, pressure)

    def _spent_cover(self, unknowns: Array, pressure: Scalar) -> dict[Reason, Scalar]:
        """How near to its lock the cover is where it is bent most."""
        law = self.law()
        if self.is_cell() or self.is_arcs() or not law.locks():
            return {}
        bent = self.seen(unknowns, pressure)
        line = bent.line
        assert isinstance(line, Line)
        every = (jnp.ravel(v) for v in (line.moment, bent.cover.slenderness * line.curvature, line.stretch))
        return {Reason.SECTION_FULL: largest(jax.vmap(law.used_up)(*every))}

    def _spent_walls(self, unknowns: Array, pressure: Scalar) -> dict[Reason, Scalar]:
        """The pressure over what the walls hold where they are most inclined."""
        if not self.inclines() or isinstance(self.drive, WallModel):
            return {}
        parts, _ = self.chambers()
        inclinations = opening(parts.chamber.inclining * self.turned(unknowns))

        def most(chamber, inclination):
            wall = within(self.with_chamber(chamber), inclination)
            if self.finger.material.closed_forms().has_rising_wall:
                return wall.load(jnp.pi + jnp.zeros_like(inclination))
            return wall_limit(wall.finger, inclination)

        shares = pressure / jax.vmap(most)(parts.chamber, inclinations)
        return {Reason.INCLINED_WALL: shares[jnp.argmax(shares)] - 1}

    def turned(self, unknowns: Array) -> Array:
        """The turn of every part, rad, positive where it bends as the chambers push."""
        parts, points = self.chambers()
        method = self.method()
        if isinstance(method, Shooting) and self.inclines():
            return self._cut(method, unknowns)[2].turned()
        return -(parts.high - parts.low) * (self.curvatures(unknowns) @ points.weights)

    def end_reason(self):
        if self.is_cell():
            return Reason.CELL_LAW_ENDS
        if self.walls() is not None:
            return Reason.NO_EQUILIBRIUM
        closed = self.finger.material.closed_forms().has_rising_wall
        return Reason.WALL_CLOSED if closed else Reason.LIMIT_POINT

    def is_driven_by_moment(self) -> bool:
        """True where the chambers do one thing to the whole beam, whatever its shape: see `MomentPath`."""
        alike = self.finger.segments is None and self.inclination == "none" and not self.is_arcs()
        alike = alike and self.drive == "thesis" and self.moment_spread == "root"
        # Loads that grow with the pressure ask for the pressure itself on the way.
        alike = alike and self.loading == "first"
        return alike and self.finger.material.closed_forms().has_rising_wall

    def load_of(self, pressure):
        if not self.is_driven_by_moment():
            return pressure
        return Moment(end_moment(self.finger, pressure, jnp.zeros_like(self.finger.L)) / self.finger.moment_scale())

    def weights(self, load_factor: Scalar) -> tuple[Scalar, Scalar]:
        """(g_x, g_y) over mu B H, times L."""
        if self.weight is None:
            zero = jnp.zeros_like(self.finger.L)
            return zero, zero
        scale = load_factor * self.finger.L / self.finger.force_scale()
        return self.weight[0] * scale, self.weight[1] * scale

    def verified(self, found):
        found, tip = self.solved(found), self.tip()
        return found if tip is None else tip.verified(self, found)

    def solved(self, found):
        """Not converged, too, where the curvatures vary by more between the points than the points can tell."""
        found = super().verified(self._with_rounding(found))
        unsure = (found.status == Status.OK) & ~self.is_resolved(lax.stop_gradient(found.unknowns))
        return found._replace(
            status=jnp.where(unsure, Status.NOT_CONVERGED, found.status),
            reason=jnp.where(unsure, int(Reason.SHAPE_NOT_RESOLVED), found.reason),
        )

    def _with_rounding(self, found: Found) -> Found:
        """What is right to the tolerance of adaptive steps is solved where a small part of that is left."""
        method = self.method()
        if not isinstance(method, Shooting) or method.steps is not None:
            return found
        eps = jnp.finfo(found.pressure.dtype).eps
        left = (PART_OF_TOLERANCE * method.tolerances()[0] / eps - RESIDUAL_EPS) / ROUNDING_EPS
        return found._replace(rounding=jnp.maximum(found.rounding, left))

    def is_resolved(self, unknowns: Array) -> Bool[Array, ""]:
        """False where the points, or the equal steps, along the beam are too few for its shape."""
        method = self.method()
        if not isinstance(method, Shooting):
            return ~(self.roughness(unknowns) > ROUGH)
        return jnp.asarray(True) if method.steps is None else self._look(method, unknowns)[1] < SURE

    def roughness(self, unknowns: Array) -> Scalar:
        """The last part of the curvatures' spectrum over all of it: an estimate of their error from above."""
        points = self.chambers()[1]
        spectrum = jnp.abs(self._at_points(unknowns) @ points.spectrum.T)
        last = -max(1, len(points.places) // 4)
        return largest(spectrum[:, last:]) / jnp.maximum(largest(spectrum), 1.0)

    def is_loop(self, observed):
        """A held tip that has turned by more than half a turn: up to its limit point it turns by two thirds of that."""
        return jnp.asarray(False) if self.tip() is None else jnp.abs(observed["tip_angle"]) > np.pi

    def held_at(self, x: Scalar, angle: Scalar) -> Scalar | None:
        """The y (over L) at which a tip at x (over L) and of this direction is held; None where the tip is free."""
        return None if self.tip() is None else self.tip().offset_at(x * self.finger.L, angle) / self.finger.L

    def shooting_error(self, unknowns: Array, pressure: Scalar, tolerance: float) -> Scalar:
        """See `shooting_error`."""
        whole = jnp.ones_like(pressure)
        bent = self.seen(unknowns, pressure)
        assert isinstance(bent.line, Line)
        tip = self.held_at(bent.line.ends[0][-1], bent.line.angles[-1])
        held = self.held(unknowns)

        def cover_of(force):
            return bent.cover._replace(loads=self.tip_loads(force, whole))

        found = states_of(bent.cover, bent.line, self.clamp(), bent.parts, self.chambers()[1])
        (turn, _, x, y), force = corrected(cover_of, held, tip, found, bent.active, tolerance)
        return largest(jnp.abs(jnp.stack([turn, x, y, force])))

    def bent(self, unknowns: Array, load_factor: Scalar, pressure: Scalar | Moment) -> Bent:
        """The beam from all the unknowns of the scene."""
        if self.tip() is None:
            return self.bend(unknowns, None, load_factor, pressure)
        return self.bend(unknowns[1:], unknowns[0], load_factor, pressure)

    def beam_observables(self, bent: Bent) -> dict[str, Array]:
        """What every finger reports."""
        finger, line = self.finger, bent.line
        pushed = -bent.active[-1]
        if self.is_cell():
            pushed = jax.tree.map(lambda leaf: leaf[-1], bent.cover.law).straight_moment()
        return {
            "tip": jnp.stack([end[-1] for end in line.ends]) * finger.L,
            "tip_angle": self.clamp() - line.angles[-1],
            "end_moment": pushed * finger.moment_scale(),
        }

    def beam_profile(self, bent: Bent, n: int) -> dict[str, Array]:
        """X, x, y (m), theta (rad) and stretch at n places; of a beam that is `seen`."""
        points, line = self.chambers()[1], bent.line
        assert isinstance(line, Line)
        s, length = jnp.linspace(0.0, 1.0, n), self.finger.L
        x, y, theta, stretch = jax.vmap(lambda s: at_place(line, bent.parts, self.clamp(), s, points))(s)
        return {"X": s * length, "x": x * length, "y": y * length, "theta": theta, "stretch": stretch}


@jax.jit
def _tension(scene: FingerScene) -> Scalar:
    """What may pull along the beam, over EI / L^2."""
    return scene.largest_force() * scene.finger.L**2 / scene.stiffness()


SHOOTING_TOLERANCE = 1e-10


@jax.jit
def _shooting_error(scene: FingerScene, unknowns: Array, pressure: Scalar) -> Scalar:
    return scene.shooting_error(unknowns, pressure, SHOOTING_TOLERANCE)


def shooting_error(solution: Solution) -> Scalar:
    """How far the tip moves when the same equations are solved once more by multiple shooting.

    diffrax's adaptive steps (Dopri8, tolerance 1e-10) lead from the clamp and from every point along the finger to the
    next one, and one Newton step closes the jumps between them. One shot from the clamp to the tip would be no check,
    since what rounding leaves at the clamp grows by e^sqrt(P L^2 / EI) on the way under a tension P.

    It checks the numerics, not the model. It is small where the points along the finger tell its shape, and about as
    large as the error where they do not, or where the state is wrong.

    Args:
        solution: of a finger that bends as a beam.

    Returns:
        The largest change at the tip, dimensionless: of its place over L, its angle (rad) and, where it is held, its
            force over EI / L^2. NaN where there is no state.

    Raises:
        InputError: for another scene, and for arcs in closed form (`Free` without loads).

    Source: own; Keller 1968 for multiple shooting.

    Examples:
        >>> held = sg.pneunet.TipContact(sg.PneuNet.table_5_1("A"), points=8)
        >>> bool(sg.pneunet.shooting_error(sg.solve(held, 31 * kPa)) < 1e-5)
        True
    """
    scene = solution.scene
    if not isinstance(scene, FingerScene) or scene.is_arcs():
        raise InputError(
            f"shooting_error needs the solution of a finger that bends as a beam, not {type(scene).__name__}."
        )
    error = _shooting_error(scene, solution.unknowns, solution.pressure)
    return jnp.where(solution.status == Status.OK, error, jnp.nan)
