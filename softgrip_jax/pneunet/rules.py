"""What the parts of a finger and of a gripper keep to, as margins in metres: positive where a rule is kept.

The names of the margins are the names of the rules in `reasons`. Each margin has derivatives, also where its rule is
broken, so that a search can climb back.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics.choice import larger, largest, smaller, smallest
from ..numerics.quadrature import Points, between, integrals
from ..units import mm
from .beam.collocation import AtPoints, Line, Part, at_place
from .finger import PneuNet

Scalar = Float[Array, ""]

LEAST_CORE, LEAST_SIDE_WALL = 1 * mm, 0.5 * mm
"""Of a chamber's air, where a fin of the mould stands, and of silicone beside it: as `softgrip export` has them."""


def margins_of_parts(finger: PneuNet) -> dict[str, Scalar]:
    """Margins of the undeformed finger; of a nonuniform one the least.

    walls_fit: room - 2 t_m, what two walls leave of a chamber's length. The room is h_L; of a nonuniform finger whose
    segments are squeezed onto the cover it is what they keep beside their gaps. chamber_on_cover: B - 2b, what a
    chamber leaves of the cover for both of its side walls. one_segment: L - (2 h_x + h_L).

    Then those that searches keep, and other states may be beyond. wall_law_range: the less of b - a and a/2 - t_m, for
    the laws of walls take the height for the shorter side, and walls for thin. mould_range: the less of walls_fit
    beside LEAST_CORE, and of a side wall, B/2 - b, beside LEAST_SIDE_WALL.
    """
    room = finger.h_L
    if finger.segments is not None:
        room = smaller(room, finger.segment_lengths - 2 * finger.h_x)
    return {
        "walls_fit": smallest(room - 2 * finger.t_m),
        "chamber_on_cover": smallest(finger.B - 2 * finger.b),
        "one_segment": finger.L - largest(finger.pitch),
        "wall_law_range": smallest(smaller(finger.b - finger.a, 0.5 * finger.a - finger.t_m)),
        "mould_range": smallest(
            smaller(room - 2 * finger.t_m - LEAST_CORE, 0.5 * finger.B - finger.b - LEAST_SIDE_WALL)
        ),
    }


def gap_over(turn: Array, pitch: Array, length: Array, height: Array, foot: Scalar) -> Array:
    """The least gap (m) between two neighbouring chambers, rigid boxes on a cover that turns by `turn` (rad) from the
    middle of one to the middle of the next; a positive turn bends backwards and closes the gap at the top.

        gap = pitch sin(f) / f - 2 z sin(f) - length cos(f),   f = turn / 2

    with z the distance from the cover's mid-line of the place where the gap is least: the top, foot + height, where the
    finger bends backwards, and the foot, H/2, where it bends as the chambers push. The mid-line between the two is a
    circular arc; its stretch, under a percent or two, is neglected. Half of the gap is what one chamber keeps from the
    plane of symmetry, whether a neighbour is behind it or a wall.

    The gap is smallest where tan(f) = 2 z / length; boxes that turn further are as far in each other as there.
    """
    half = 0.5 * turn
    z = jnp.where(half > 0, foot + height, foot)
    half = smaller(half, jnp.arctan2(2 * z, length))
    return pitch * jnp.sinc(half / jnp.pi) - 2 * z * jnp.sin(half) - length * jnp.cos(half)


def chambers_apart(finger: PneuNet, parts: Part, curvature: AtPoints, points: Points) -> Scalar:
    """The least gap (m) between neighbouring chambers of a bent finger, which has the curvatures L theta'.

    Neighbours of a uniform finger are taken to meet anywhere from one pitch after the clamp to one before the tip: a
    mould that leaves more cover at either end has them within that. Those of a nonuniform finger meet where its
    segments do; there the turn is the mean of the two, and the gap is the sum of what each keeps from the plane between
    them, below the lower of the two tops. Within a segment of several chambers neighbours are one pitch apart, and the
    largest curvature of it counts.
    """

    def at(values: Array, place: Scalar) -> Scalar:
        return between(values[None], place, 0, points)[0]

    def most_between(values: Array, low: Scalar, high: Scalar) -> Scalar:
        first, last = at(values, low), at(values, high)
        inside = (points.places > low) & (points.places < high)
        return larger(largest(jnp.where(inside, values, first)), last)

    fields, foot = parts.chamber.fields, 0.5 * finger.H
    widths = parts.high - parts.low
    pitch = (2 * fields["h_x"] + fields["h_L"]) / finger.L
    if finger.segments is not None and finger.segments > 1:
        count = larger(finger.whole_chambers, 1.0)
        several = count > 1
        # Twice what is between the middle of the last chamber and the end of its segment; one that is squeezed keeps
        # its gap.
        last = larger(widths - (count - 1) * pitch, pitch)
        mean, ends = curvature @ points.weights, (jnp.zeros_like(finger.L), jnp.ones_like(finger.L))
        after, before = (jnp.where(several, jax.vmap(at, (0, None))(curvature, end), mean) * last for end in ends)
        turn = 0.5 * (after[1:] + before[:-1])
        height = 2 * smaller(fields["a"][1:], fields["a"][:-1])
        sides = [
            gap_over(turn, finger.L * last[side], fields["h_L"][side], height, foot)
            for side in (slice(1, None), slice(-1))
        ]
        first = jnp.where(several, (0.5 * last + 0.5 * pitch) / widths, 0.5)
        most = jax.vmap(most_between)(curvature, first, 1 - first)
        within = gap_over(most * pitch, finger.L * pitch, fields["h_L"], 2 * fields["a"], foot)
        return smaller(0.5 * smallest(sides[0] + sides[1]), smallest(jnp.where(several, within, jnp.inf)))
    first = smaller(pitch[0], 1.0)
    last = larger(1 - first, first)
    if len(widths) == 1:
        most = most_between(curvature[0], first, last)
    else:
        places = (parts.low[:, None] + widths[:, None] * points.places[None]).reshape(-1)
        ends = [jnp.interp(place, places, curvature.reshape(-1)) for place in (first, last)]
        inside = (places > first) & (places < last)
        most = larger(largest(jnp.where(inside, curvature.reshape(-1), ends[0])), ends[1])
    return gap_over(most * pitch[0], finger.pitch.reshape(-1)[0], fields["h_L"][0], 2 * fields["a"][0], foot)


def clear_of_clamp(finger: PneuNet, parts: Part, line: Line, points: Points) -> Scalar:
    """The least x (m) of the first chamber, which may lean back, and of the outer half of the mid-line.

    It is half a pitch from the clamp; of a nonuniform finger also half of what its segment has beside whole chambers.
    """
    fields, foot = parts.chamber.fields, 0.5 * finger.H
    widths = parts.high - parts.low
    pitch = 2 * fields["h_x"][0] + fields["h_L"][0]
    if finger.segments is not None:
        count = larger(jnp.reshape(finger.whole_chambers, (-1,))[0], 1.0)
        pitch = larger(finger.L * widths[0] - (count - 1) * pitch, pitch)
    local = smaller(0.5 * pitch / (finger.L * widths[0]), 1.0)
    turn = widths[0] * between(line.curvature, local, 0, points)[1]
    first = 0.5 * gap_over(2 * turn, pitch, fields["h_L"][0], 2 * fields["a"][0], foot)
    x = integrals(line.slopes[0], widths, points)[0]
    outer = (parts.low[:, None] + widths[:, None] * points.places[None]) >= 0.5
    return smaller(first, finger.L * smallest(jnp.where(outer, x, jnp.inf)))


def line_inside(
    line: Line, parts: Part, depth: Array | float, points: Points
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """x and y, over L, of the line at the distance `depth` (over L; shape () or (parts,)) from the mid-line on the side
    of the bending, at the Gauss points: (x + depth sin(theta), y - depth cos(theta))."""
    widths, depth = parts.high - parts.low, jnp.reshape(jnp.asarray(depth), (-1, 1))
    x, y = (integrals(slope, widths, points)[0] for slope in line.slopes)
    cosine, sine = (slope / line.stretch for slope in line.slopes)
    return (x + depth * sine).reshape(-1), (y - depth * cosine).reshape(-1)


def end_inside(line: Line, depth: Scalar) -> tuple[Scalar, Scalar]:
    """The end of the line that `line_inside` follows, over L; a negative depth is on the side of the chambers."""
    x, y, theta = line.ends[0][-1], line.ends[1][-1], line.angles[-1]
    return x + depth * jnp.sin(theta), y - depth * jnp.cos(theta)


def lowest_of_chambers(finger: PneuNet, parts: Part, line: Line, points: Points) -> Scalar:
    """The largest x (m) of the tops of the chambers, as a line at z = H/2 + 2a up to the end of the last chamber, of a
    finger that leaves its clamp along x."""
    fields, widths = parts.chamber.fields, parts.high - parts.low
    top, last = -(0.5 * finger.H + 2 * fields["a"]) / finger.L, 1 - after_chambers(finger) / finger.L
    x = line_inside(line, parts, top, points)[0]
    places = (parts.low[:, None] + widths[:, None] * points.places[None]).reshape(-1)
    foot, _, theta, _ = at_place(line, parts, jnp.zeros_like(last), last, points)
    corner = foot + top[-1] * jnp.sin(theta)
    return finger.L * larger(largest(jnp.where(places < last, x, corner)), corner)


def after_chambers(finger: PneuNet) -> Scalar:
    """Length of the cover (m) between the last chamber and the tip; a chamber that is squeezed keeps its share of the
    gap."""
    h_x, h_L = (value if jnp.ndim(value) == 0 else value[-1] for value in (finger.h_x, finger.h_L))
    pitch, room = 2 * h_x + h_L, finger.segment_lengths[-1]
    whole = 0.5 * (room - finger.whole_chambers[-1] * pitch) + h_x
    return jnp.where(finger.whole_chambers[-1] >= 1, whole, room * h_x / pitch)


def one_turn(finger: PneuNet, turns: Float[Array, " parts"]) -> Scalar:
    """(1 - turn / 2 pi) L (m), with the most that the directions of two places differ by: a ring closes at 0. The
    turns of the parts, rad."""
    angles = jnp.concatenate([jnp.zeros(1), jnp.cumsum(turns)])
    return finger.L * (1 - (largest(angles) - smallest(angles)) / (2 * np.pi))


def side_by_side(radius: Scalar, n: int, width: Scalar) -> Scalar:
    """How much room (m) n fingers of a width leave beside each other, whose flat faces stand at a radius: the side of
    the polygon around the circle, 2 r tan(pi / n), less the width; of two fingers the distance between their faces."""
    return 2 * radius if n == 2 else 2 * radius * np.tan(np.pi / n) - width
