"""The laws of what pushes a finger, one beside the other.

The thesis's chambers and the cell law differ by a factor of about four in moment and tip force (docs/theory/cell.md):
whoever reports what a finger does by one of them reports what it does by the other, too.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from .beam.method import POINTS, Shooting
from .cell.law import range_remarks
from .finger_scene import FingerScene

OTHER = {"thesis": "cell", "cell": "thesis", "small_strain": "cell"}

SENTENCE = (
    'Two laws push this finger: "thesis", its chambers as the thesis models them, near to the tip forces measured '
    'there, and "cell", near to finite elements of chamber, walls, rims and cover. Nobody knows yet why they differ: '
    "calibrate to what you built (docs/limits.md)."
)
SMALL_STRAIN = (
    'Two laws push this finger: "small_strain", its walls as plates of small strain, the simplest one, and "cell", '
    "near to finite elements of chamber, walls, rims and cover, with several times its force (docs/limits.md)."
)


def with_other_drive(scene: Any) -> FingerScene | None:
    """The same finger under the same loads, pushed by the cell law, or by the thesis's where it is pushed by that; None
    where a scene has no such choice.

    The cell law is solved by collocation only: a beam by shooting becomes one by collocation.
    """
    if not isinstance(scene, FingerScene) or scene.drive not in OTHER:
        return None
    beam, points = scene.beam, scene.points
    if isinstance(beam, Shooting):
        beam, points = None, POINTS
    return dataclasses.replace(scene, drive=OTHER[scene.drive], beam=beam, points=points)


def sentence_of(drive: str) -> str:
    """What a drive and its other one are."""
    return SMALL_STRAIN if drive == "small_strain" else SENTENCE


def remarks(scene: FingerScene) -> list[str]:
    """What people must know who see both: what they are, and the dimensions to which the cell law was not fitted."""
    return [sentence_of(scene.drive), *range_remarks(scene.finger)]
