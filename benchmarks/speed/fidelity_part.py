"""`fidelity.choose` at a thousand random fingers: is its estimate a bound, and is the dearest model taken needlessly?

The comparison itself is that of tests/test_fidelity.py, which makes it at a few fingers.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

FINGERS, SEED = 1000, 4
FIELDS = (
    "fingers",
    "with_equilibrium",
    "models",
    "estimates",
    "bounds",
    "share",
    "over_tolerance",
    "needlessly_dearest",
)


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """One row."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "tests"))
    import test_fidelity as tested
    from fingers import stacked

    cases = tested.random_fingers(np.random.default_rng(SEED), 8 if quick else FINGERS)
    truth, status = tested.forces(stacked([dataclasses.replace(scene, points=32) for scene, *_ in cases]), cases)
    truth = np.where(status == 0, truth, np.nan)
    kept = tested.few if quick else lambda _: True
    bounded, total, missed, needless, models = tested.compared(cases, kept, truth)
    found = (len(cases), int(np.sum(status == 0)), models, total, bounded, bounded / total, len(missed), len(needless))
    yield dict(zip(FIELDS, found, strict=True))
