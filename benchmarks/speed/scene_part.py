"""Free fingers under their weight, and grasps: what the diagrams of the tip contact leave out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from . import cases
from .finger_part import CHUNK, FINE_STEPS, _with_steps, reference
from .shell_part import ours

PROGRAMS = (("exact", (2, 4, 12)), ("thesis", (4,)), ("inextensible", (4,)))
SCENES = {"finger free": cases.free_finger, "finger grasp": cases.grasp}
LANES = 256


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """All rows of these scenes."""
    for name, make in SCENES.items():
        if quick and name != "finger free":
            continue
        for law, steps in PROGRAMS[:1] if quick else PROGRAMS:
            fine = make(law, FINE_STEPS)
            batch = cases.batch_of(fine, 16 if quick else LANES)
            true = reference(fine, batch.lanes(cases.JUDGED))
            for count in steps[1:2] if quick else steps:
                case = make(law, count)
                lanes = cases.Batch(_with_steps(batch.scene, case.scene), batch.pressure)
                yield ours(name, case, lanes, true, chunk=CHUNK) | {"setting": f"{law}, Dopri8, {count} steps"}
