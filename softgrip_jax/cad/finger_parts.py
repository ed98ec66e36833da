"""The finger: a body of hollow chambers and a base layer, both cast, bonded; a printed clamp and end cap.

x runs from the clamp (x = 0) to the tip, z from the outer face of the cover. The body begins at z = H:
chambers, open below, and the tunnel of the air channel where it crosses gaps. The base layer is the cover, H thick, and
closes both. So the core of the body comes out downwards, and every wall is as thick as the config says.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..errors import InputError
from ..pneunet import Gripper
from ..pneunet.finger import ROUNDING, SEGMENT_FIELDS, PneuNet
from ..units import mm
from .limits import at_least, at_most, check_common, check_core
from .moulding import mould_of, open_mould
from .parts import Export, Mould, Piece, Probe, corners, piece, rods
from .rules import ManufactureTable
from .solids import Block, Number, Rod, Shape, joined

MOST_CHAMBERS = 200


@dataclasses.dataclass(frozen=True)
class Chamber:
    """One chamber, mm: where it begins along the finger, its dimensions, its segment (from 1)."""

    start: Number
    length: Number
    a: Number
    b: Number
    t: Number
    gap: Number
    segment: int

    @property
    def end(self) -> float:
        """Where it ends along the finger."""
        return self.start + self.length


def segments_of(finger: PneuNet) -> list[tuple[float, ...]]:
    """(its length, a, b, h_x, t, h_L) of every segment, mm."""
    count = finger.segments or 1
    columns = [
        np.broadcast_to(np.asarray(getattr(finger, name), dtype=float) / mm, (count,)) for name in SEGMENT_FIELDS
    ]
    pitches = 2 * columns[2] + columns[4]
    lengths = float(finger.L) / mm * pitches / pitches.sum()
    return [tuple(map(float, values)) for values in zip(lengths, *columns, strict=True)]


def counts_of(finger: PneuNet) -> list[int]:
    """How many whole chambers fit into each segment."""
    counts: list[int] = []
    for number, (room, _, _, h_x, _, h_L) in enumerate(segments_of(finger), start=1):
        pitch = 2 * h_x + h_L
        fits = math.floor(room / pitch + ROUNDING)
        if fits < 1:
            raise InputError(
                f"Segment {number} is {room:.4g} mm long, shorter than its chamber with its gap ({pitch:.4g} mm); "
                "raise L_mm or lower h_L_mm."
            )
        counts.append(fits)
    if sum(counts) > MOST_CHAMBERS:
        raise InputError(f"The finger has more than {MOST_CHAMBERS} chambers; raise h_L_mm or lower L_mm.")
    return counts


def chambers_of(finger: PneuNet, counts: Sequence[int] | None = None) -> list[Chamber]:
    """The chambers of a finger. Each segment holds as many whole ones as fit, or `counts` of them where a mould has
    fixed that; what is left is cover alone, half of it at either end of the segment."""
    found: list[Chamber] = []
    start = 0.0
    segments = zip(segments_of(finger), counts or counts_of(finger), strict=True)
    for number, ((room, a, b, h_x, t, h_L), fits) in enumerate(segments, start=1):
        pitch = 2 * h_x + h_L
        first = start + (room - fits * pitch) / 2 + h_x
        found += [Chamber(first + k * pitch, h_L, a, b, t, 2 * h_x, number) for k in range(fits)]
        start += room
    return found


def finger_export(
    finger: PneuNet, table: ManufactureTable, with_moulds: bool, counts: Sequence[int] | None = None
) -> Export:
    """The parts of a finger and their moulds; `counts` as in `chambers_of`."""
    H, B, L = (float(value) / mm for value in (finger.H, finger.B, finger.L))
    chambers = chambers_of(finger, counts)
    top_wall = B / 10 if table.top_wall_mm is None else table.top_wall_mm
    sides = [(B - 2 * one.b) / 2 if table.side_wall_mm is None else table.side_wall_mm for one in chambers]
    c, w = table.channel_mm, table.channel_wall_mm
    back = -table.foot_mm
    front = min(0.0, chambers[0].start - max(chambers[0].gap, table.least_core_mm))  # a fin of the mould stands there
    check(chambers, sides, top_wall, H, B, front, table)
    foot = H + c + 2 * w

    # The outside of the body: foot, chambers, tunnels between them.
    outside = [Block((back, -B / 2, H), (front, B / 2, foot))]
    cores: list[Block] = []
    ridges: list[Block] = []
    x = front
    for one, side in zip(chambers, sides, strict=True):
        if one.start > x + 1e-9:
            outside.append(Block((x, -c / 2 - w, H), (one.start, c / 2 + w, H + c + w)))
        half = one.b + side
        outside.append(Block((one.start, -half, H), (one.end, half, H + 2 * one.a + top_wall)))
        cores.append(Block((one.start + one.t, -one.b, H), (one.end - one.t, one.b, H + 2 * one.a)))
        ridges.append(
            Block((cores[-2].high[0] if len(cores) > 1 else back, -c / 2, H), (cores[-1].low[0], c / 2, H + c))
        )
        x = one.end
    body = piece("body", "cast", [*outside], [*cores, *ridges])
    slab = Block((back, -B / 2, 0), (L, B / 2, H))
    base = piece("base layer", "cast", [slab], [])
    whole = Piece("finger", joined([body.solid, base.solid]), body.volume + base.volume, "bonded")

    clamp, cap = clamp_parts(B, foot, H + c / 2, table)
    moulds = []
    if with_moulds:
        moulds = [
            body_mould(outside, cores, ridges, chambers, sides, table),
            open_mould("base", base.name, slab, table),
        ]
    facts = {
        "chambers": f"{len(chambers)}",
        "cover, H x B x L": f"{H:.6g} x {B:.6g} x {L:.6g} mm, and {table.foot_mm:g} mm in the clamp",
        "top wall, side walls": f"{top_wall:.4g} mm, {min(sides):.4g} mm"
        + ("" if min(sides) == max(sides) else f" to {max(sides):.4g} mm"),
        "length of the cover without whole chambers": f"{L - sum(one.length + one.gap for one in chambers):.4g} mm",
    }
    probes = probes_of(chambers, sides, top_wall, H, B, L, (back + front) / 2, table)
    return Export("finger", [whole, body, base, clamp, cap], moulds, probes, facts)


def clamp_parts(B: Number, foot: Number, port_height: Number, table: ManufactureTable) -> tuple[Piece, Piece]:
    """(clamp, end cap): a printed box around the foot, and a plate behind it whose nipple goes into the air channel."""
    gap, frame, c = table.clearance_mm, table.frame_mm, table.channel_mm
    back, y, low, high = -table.foot_mm, B / 2 + gap + frame, -gap - frame, foot + gap + frame
    places = corners((-y + frame / 2, y - frame / 2), (low + frame / 2, high - frame / 2))
    to_edges = min(y, port_height - low, high - port_height)
    to_screws = min(math.hypot(py, pz - port_height) for py, pz in places) - table.screw_mm / 2
    most = 2 * (min(to_edges, to_screws) - table.least_wall_mm)
    at_most("port_mm", table.port_mm, most, "least_wall_mm of the end cap stands around the tube; or raise frame_mm")

    def screws(start: Number, length: Number) -> list[Shape]:
        return [Rod((start, py, pz), table.screw_mm / 2, length, "x") for py, pz in places]

    clamp = piece(
        "clamp",
        "printed",
        [Block((back, -y, low), (0, y, high))],
        [Block((back, -B / 2 - gap, -gap), (0, B / 2 + gap, foot + gap)), *screws(back, table.foot_mm)],
    )
    # The nipple fills the square channel up to its corners; the tube is glued into the plate behind it.
    nipple = c / math.sqrt(2)
    bore = nipple - table.least_wall_mm
    reach = min(table.foot_mm / 2, 3 * c)
    depth = table.floor_mm
    start = back - 2 * depth
    cap = piece(
        "end cap",
        "printed",
        [
            Block((start, -y, low), (back, y, high)),
            Rod((back, 0.0, port_height), nipple, reach, "x"),
        ],
        [
            Rod((start, 0.0, port_height), table.port_mm / 2, depth, "x"),
            Rod((start + depth, 0.0, port_height), bore, depth + reach, "x"),
            *screws(start, 2 * depth),
        ],
    )
    return clamp, cap


def gripper_base(gripper: Gripper, table: ManufactureTable) -> Piece:
    """A round plate that the end caps of all fingers are screwed on, with a hole for each tube.

    The covers' faces stand on the circle that the scene means, and look towards the axis.
    """
    finger = gripper.finger
    H, B = float(finger.H) / mm, float(finger.B) / mm
    gap, frame, c, n = table.clearance_mm, table.frame_mm, table.channel_mm, gripper.n
    face = float(gripper.midline_radius()) / mm - H / 2
    y, low, high = B / 2 + gap + frame, -gap - frame, H + c + 2 * table.channel_wall_mm + gap + frame
    least = y / math.tan(math.pi / n) - low if n > 2 else -low
    base = float(gripper.base_radius) / mm
    at_least("base_radius_mm", base, least + base - face, f"the clamps of {n} fingers would overlap; or lower frame_mm")
    radius = math.hypot(face + high, y) + table.least_wall_mm
    places = corners((face + low + frame / 2, face + high - frame / 2), (-y + frame / 2, y - frame / 2))
    screws: list[tuple[Number, Number]] = []
    ports: list[tuple[Number, Number]] = []
    for number in range(n):
        cos, sin = math.cos(2 * math.pi * number / n), math.sin(2 * math.pi * number / n)

        def turned(place: tuple[Number, Number], cos: Number = cos, sin: Number = sin) -> tuple[Number, Number]:
            return place[0] * cos - place[1] * sin, place[0] * sin + place[1] * cos

        screws += [turned(place) for place in places]
        ports.append(turned((face + H + c / 2, 0.0)))
    to_edge = radius - ports[0][0]
    to_screws = min(math.dist(ports[0], screw) for screw in screws) - table.screw_mm / 2
    to_ports = (min(math.dist(ports[0], port) for port in ports[1:]) - table.least_wall_mm) / 2
    most = 2 * (min(to_edge - table.least_wall_mm, to_screws - table.least_wall_mm, to_ports) - gap)
    why = "a hole for it, with clearance_mm and then least_wall_mm around it, stands in the gripper base"
    at_most("port_mm", table.port_mm, most, why)
    floor = table.floor_mm
    holes = [*rods(screws, table.screw_mm, 0.0, floor), *rods(ports, table.port_mm + 2 * gap, 0.0, floor)]
    return piece("gripper base", "printed", [Rod((0.0, 0.0, 0.0), radius, floor)], holes)


def body_mould(
    outside: list[Block],
    cores: list[Block],
    ridges: list[Block],
    chambers: list[Chamber],
    sides: list[Number],
    table: ManufactureTable,
) -> Mould:
    """The body's mould, turned over: the tray holds the outside, the lid the comb of cores and the channel's ridge."""

    def turned(block: Block) -> Block:
        (x0, y0, z0), (x1, y1, z1) = block.low, block.high
        return Block((x0, -y1, -z1), (x1, -y0, -z0))

    H = outside[0].low[2]
    vents = []
    for one, side in zip(chambers, sides, strict=True):
        vents += [((one.start + one.end) / 2, sign * (one.b + side / 2)) for sign in (1, -1)]
    foot = outside[0]
    x, y = (foot.low[0] + foot.high[0]) / 2, (foot.high[1] + table.channel_mm / 2) / 2
    vent = min(table.vent_mm, 0.8 * min(sides), 0.8 * min(one.length for one in chambers))
    highest = max(block.high[2] for block in outside)
    return mould_of(
        "body",
        "body",
        [turned(block) for block in outside],
        (-highest, -H),
        [(x, y), (x, -y)],
        vents,
        table,
        [turned(block) for block in (*cores, *ridges)],
        vent,
        is_turned=True,
    )


def probes_of(
    chambers: list[Chamber],
    sides: list[Number],
    top_wall: Number,
    H: Number,
    B: Number,
    L: Number,
    foot: Number,
    table: ManufactureTable,
) -> list[Probe]:
    """Every wall of every chamber, the gaps' lengths by the chambers' outer lengths, cover, tunnel, and the foot, whose
    middle is at `foot`."""
    along, across, up = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    c, w = table.channel_mm, table.channel_wall_mm
    probes = [
        Probe("finger", "cover", (chambers[0].start / 2 + chambers[0].end / 2, 0.1, H / 2), up, H),
        Probe("finger", "cover, across", (L - 1e-3, 0.0, H / 2), across, B),
        Probe("finger", "foot above the air channel", (foot, 0.0, H + c + w), up, 2 * w),
    ]
    for number, (one, side) in enumerate(zip(chambers, sides, strict=True), start=1):
        middle, height, y = (one.start + one.end) / 2, H + one.a + (c + w) / 2, 0.3 * one.b
        words = f"chamber {number}, "
        probes += [
            Probe("finger", f"{words}wall towards the clamp", (one.start + one.t / 2, y, height), along, one.t),
            Probe("finger", f"{words}wall towards the tip", (one.end - one.t / 2, y, height), along, one.t),
            Probe("finger", f"{words}side wall", (middle, one.b + side / 2, height), across, side),
            Probe("finger", f"{words}top wall", (middle, y, H + 2 * one.a + top_wall / 2), up, top_wall),
            Probe("finger", f"{words}outer length", (middle, one.b + side / 2, height), along, one.length),
        ]
    return probes


def check(
    chambers: list[Chamber],
    sides: list[Number],
    top_wall: Number,
    H: Number,
    B: Number,
    front: Number,
    table: ManufactureTable,
) -> None:
    """The rules of a finger whose foot ends at `front`; an InputError in one sentence."""
    check_common(table)
    c, w = table.channel_mm, table.channel_wall_mm
    thin = table.least_silicone_mm
    why = "liquid silicone does not fill a thinner wall (least_silicone_mm)"
    at_least("H_mm", H, thin, why)
    at_least("top_wall_mm", top_wall, thin, why)
    at_least("channel_wall_mm", w, thin, why)
    for one, side in zip(chambers, sides, strict=True):
        where = f" of segment {one.segment}"
        at_least(f"t_m_mm{where}", one.t, thin, why)
        at_least(f"the side wall{where}, (B_mm - 2 b_mm)/2 or side_wall_mm,", side, thin, why)
        if 2 * (one.b + side) > B + 1e-9:
            raise InputError(
                f"The chambers{where} are {2 * (one.b + side):.4g} mm wide with their side walls, wider than the cover "
                f"(B_mm = {B:.4g}); lower side_wall_mm or b_mm."
            )
        check_core(f"The core{where}, h_L_mm - 2 t_m_mm,", one.length - 2 * one.t, 2 * one.a, table, "raise h_L_mm")
        if not 0 < c < 2 * min(one.a, one.b):
            raise InputError(
                f"channel_mm is {c:.4g} mm: the chambers{where} would have no way for air; it must be positive and "
                f"less than {2 * min(one.a, one.b):.4g} mm, their height and width."
            )
        if c + w >= 2 * one.a or c / 2 + w > one.b + side:
            raise InputError(
                f"channel_wall_mm is {w:.4g} mm: the air channel's tunnel would be higher than the air (2 a_mm) or "
                f"wider than the chambers{where}; lower it, or channel_mm."
            )
    # The tray is solid beside the lower of two hollows: above it the fin stands free.
    for one, other in pairwise(chambers):
        where = f"of segment {one.segment}, 2 h_x_mm,"
        if one.segment != other.segment:
            where = f"between segments {one.segment} and {other.segment}"
        height = 2 * min(one.a, other.a) + top_wall
        check_core(f"The fin of the mould {where}", other.start - one.end, height, table, "raise h_x_mm")
    first, where = chambers[0], "The fin of the mould behind the first chamber, h_x_mm,"
    height = min(2 * first.a + top_wall, c + 2 * w)
    check_core(where, first.start - front, height, table, "raise h_x_mm")
    check_core("The ridge of the air channel, channel_mm,", c, c, table, "raise channel_mm")
    bore = math.sqrt(2) * c - 2 * table.least_wall_mm
    at_least("the bore of the end cap's nipple, 1.41 channel_mm - 2 least_wall_mm,", bore, 0.5, "raise channel_mm")
    at_least("port_mm", table.port_mm, bore, "the tube must not be narrower than the bore of the nipple")
    at_least("the foot beside the air channel", (B - c) / 2, table.pour_mm, "lower pour_mm or raise B_mm")
    where = "the foot between its end (foot_mm) and the fin behind the first chamber (h_x_mm)"
    foot = front + table.foot_mm
    at_least(where, foot, table.pour_mm, "a pour hole ends on it; raise foot_mm, or lower h_x_mm or pour_mm")
