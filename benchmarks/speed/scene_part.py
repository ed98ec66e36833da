"""Free fingers under their weight, and grasps: what the diagrams of the tip contact leave out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from . import cases
from .finger_part import CHUNK, ENOUGH, FINE_POINTS, reference, with_choices
from .shell_part import ours

PROGRAMS = (("exact", (6, ENOUGH, 16)), ("thesis", (ENOUGH,)), ("inextensible", (ENOUGH,)))
SCENES = {"finger free": cases.free_finger, "finger grasp": cases.grasp}
LANES = 256


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of these scenes."""
    for name, make in SCENES.items():
        if quick and name != "finger free":
            continue
        for law, points in PROGRAMS[:1] if quick else PROGRAMS:
            fine = make(law, FINE_POINTS)
            batch = cases.batch_of(fine, 16 if quick else LANES)
            true = reference(fine, batch.lanes(cases.JUDGED))
            for count in [ENOUGH] if quick else points:
                case = make(law, count)
                lanes = cases.Batch(with_choices(batch.scene, case.scene), batch.pressure)
                yield ours(name, case, lanes, true, chunk=CHUNK) | {"setting": f"{law}, {count} points"}
