"""The shell gripper's pad: a silicone membrane with a beaded rim, a printed frame with its port, a printed ring.

The membrane lies from z = 0 to t_m on the frame, its bead in a groove; the ring presses the rim on the frame. The
opening 2a x 2b of frame and ring is what the model calls the clamped edge.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..shell import FlatShell
from ..shell.obstacles import Obstacle
from ..units import mm
from .limits import at_least, check_common
from .moulding import mould_of
from .parts import Export, Probe, corners, piece, ring, rods
from .rules import ManufactureTable
from .solids import Block, Number, Shape

STEP = 0.25
"""mm between the places of the ring at which the distance of the object is asked, along x, y and z."""
TOUCHES = 1e-9 * mm
"""A distance (m) that is none: an object that ends where the ring does touches it, whichever way places are rounded."""
BATCH = 1 << 14
"""So many places at once."""


def shell_export(shell: FlatShell, table: ManufactureTable, with_moulds: bool) -> Export:
    """The parts of a shell and their mould."""
    a, b, t = (float(value) / mm for value in (shell.a, shell.b, shell.t_m))
    rim, bead, wall, gap = table.rim_mm, table.bead_mm, table.least_wall_mm, table.clearance_mm
    check(table, t, a)
    outer = a + rim, b + rim
    body = half_sizes(shell, table)
    inner = outer[0] - bead, outer[1] - bead

    sheet = Block((-outer[0], -outer[1], 0), (*outer, t))
    edge = ring(inner, outer, -bead, 0)
    membrane = piece("membrane", "cast", [sheet, *edge], [])

    x, y = body[0] - table.frame_mm / 2, body[1] - table.frame_mm / 2
    screws = [*corners((-x, x), (-y, y)), (-x, 0.0), (x, 0.0)]
    floor = -table.cavity_mm - table.floor_mm
    groove = ring((inner[0] - gap, inner[1] - gap), (outer[0] + gap, outer[1] + gap), -bead - gap, 0)
    cavity: list[Shape] = [Block((-a, -b, -table.cavity_mm), (a, b, 0))]
    port = rods([(0.0, 0.0)], table.port_mm, floor, -table.cavity_mm)
    holes = rods(screws, table.screw_mm, floor, 0)
    frame = piece(
        "frame", "printed", [Block((-body[0], -body[1], floor), (*body, 0))], [*cavity, *groove, *port, *holes]
    )
    top = t + table.ring_mm
    cover = piece(
        "ring",
        "printed",
        [Block((-body[0], -body[1], t), (*body, top))],
        [Block((-a, -b, t), (a, b, top)), *rods(screws, table.screw_mm, t, top)],
    )
    moulds = []
    if with_moulds:
        middle = rim / 2
        places = corners((middle - outer[0], outer[0] - middle), (middle - outer[1], outer[1] - middle))
        moulds.append(mould_of("membrane", "membrane", [sheet, *edge], (-bead, t), places[:1], places[1:], table))
    up, x_axis = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    probes = [
        Probe("membrane", "membrane, in the middle", (0, 0, t / 2), up, t),
        Probe("membrane", "membrane, near its clamp", (0.9 * a, 0.9 * b, t / 2), up, t),
        Probe("membrane", "rim with bead", (outer[0] - bead / 2, 0.1, t / 2), up, t + bead),
        Probe("membrane", "bead, across", (outer[0] - bead / 2, 0.1, -bead / 2), x_axis, bead),
        Probe("frame", "floor of the frame", (0.9 * a, 0.9 * b, floor + table.floor_mm / 2), up, table.floor_mm),
        Probe(
            "frame",
            "frame between cavity and groove",
            (a + (rim - bead - gap) / 2, 0.1, -min(bead, table.cavity_mm) / 2),
            x_axis,
            rim - bead - gap,
        ),
        Probe("ring", "ring", (0.1, body[1] - table.frame_mm / 2, t + table.ring_mm / 2), up, table.ring_mm),
    ]
    facts = {
        "opening, 2a x 2b": f"{2 * a:.6g} x {2 * b:.6g} mm",
        "membrane, t_m": f"{t:.6g} mm",
        "screws": f"{len(screws)} holes of {table.screw_mm:g} mm through ring and frame",
    }
    at_least("the rim within the bead", rim - bead - gap, wall, "raise rim_mm or lower bead_mm")
    return Export("shell", [membrane, frame, cover], moulds, probes, facts)


def half_sizes(shell: FlatShell, table: ManufactureTable) -> tuple[float, float]:
    """Of frame and ring, mm."""
    around = table.rim_mm + table.clearance_mm + table.frame_mm
    return float(shell.a) / mm + around, float(shell.b) / mm + around


def check_ring(body: Obstacle | None, shell: FlatShell, table: ManufactureTable) -> None:
    """The ring stays clear of the object that the membrane is to touch; an InputError in one sentence."""
    if body is None:
        return
    begins = lowest_touch(body, ring_places(shell, table), table.ring_mm)
    if begins is None:
        return
    if begins <= table.least_wall_mm:
        raise InputError(
            f"ring_mm is {table.ring_mm:.4g} mm, and the object touches even a ring of {table.least_wall_mm:.4g} mm "
            "(least_wall_mm) before it touches the membrane; keep the object farther from the frame."
        )
    raise InputError(
        f"ring_mm is {table.ring_mm:.4g} mm; it must be less than {math.floor(100 * begins) / 100:g} mm, where the "
        "object begins over the ring: the membrane must touch it first; or keep the object farther from the frame."
    )


def ring_places(shell: FlatShell, table: ManufactureTable) -> np.ndarray:
    """(x, y) of places on the ring, mm, STEP apart at most, edges and corners among them; screw holes are left out of
    account."""

    def along(inner: float, outer: float) -> np.ndarray:
        border = np.linspace(inner, outer, math.ceil((outer - inner) / STEP) + 1)
        middle = np.linspace(-inner, inner, math.ceil(2 * inner / STEP) + 1)
        return np.concatenate([-border[:0:-1], middle, border[1:]])

    (a, b), (c, d) = (float(shell.a) / mm, float(shell.b) / mm), half_sizes(shell, table)
    x, y = (part.ravel() for part in np.meshgrid(along(a, c), along(b, d)))
    on = (np.abs(x) >= a) | (np.abs(y) >= b)
    return np.stack([x[on], y[on]], axis=-1)


def lowest_touch(body: Obstacle, places: np.ndarray, top: Number) -> float | None:
    """The least height z up to `top`, mm, at which an object is at one of the places (x, y); None where it is at none.

    Planes of equal z are asked upwards, STEP apart at most, and the first that the object meets is then halved in. Only
    the sign of the distance counts: the function of a user need not be right far from its surface.
    """

    @jax.jit
    def distances(places: jax.Array, z: jax.Array | float) -> jax.Array:
        def distance(place: jax.Array) -> jax.Array:
            return body.distance(jnp.append(place, z) * mm)

        return jax.lax.map(distance, places, batch_size=BATCH)

    def is_clear(z: float) -> bool:
        found = float(np.min(np.asarray(distances(places, z))))  # NumPy would ask JAX for the least
        if math.isnan(found):
            raise InputError(
                f"The distance of the object is not a number at some place of the ring, {z:.4g} mm above the membrane; "
                "it must be one there, too, so that the ring can be kept clear of the object."
            )
        return found > TOUCHES

    heights = np.linspace(0.0, top, math.ceil(top / STEP) + 1)
    low = 0.0
    for high in map(float, heights):
        if not is_clear(high):
            break
        low = high
    else:
        return None
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if is_clear(middle) else (low, middle)
    return high


def check(table: ManufactureTable, t: Number, a: Number) -> None:
    """The rules of a shell; an InputError in one sentence."""
    check_common(table)
    at_least("t_m_mm", t, table.least_silicone_mm, "liquid silicone does not fill a thinner sheet (least_silicone_mm)")
    wall, gap, bead = table.least_wall_mm, table.clearance_mm, table.bead_mm
    least = bead + gap + wall
    at_least("rim_mm", table.rim_mm, least, "the bead and a wall of the printer stand below it")
    at_least("rim_mm", table.rim_mm, max(table.pour_mm, table.vent_mm), "pour and vent holes end on it")
    at_least("bead_mm", bead, table.least_silicone_mm, "liquid silicone does not fill less (least_silicone_mm)")
    least = bead + gap + wall - table.floor_mm
    at_least("cavity_mm", table.cavity_mm, least, "the groove of the bead must not open below the frame")
    if table.port_mm > 2 * a:
        raise InputError(
            f"port_mm is {table.port_mm:.4g} mm, wider than the membrane ({2 * a:.4g} mm): the air has no way in; "
            "lower port_mm or raise a_mm."
        )
