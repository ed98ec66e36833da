"""Wide random checks, outside of `make test`: `make check`, or `python tests/wide --shells 100000`.

Prints, for every kind of scene and material, how many designs were looked at, what came back, and how many break which
invariant. Exit code 1 where any does.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parent.parent)]

import numpy as np  # noqa: E402

import softgrip_jax  # noqa: E402, F401  switches float64 on

BATCH, FINGER_BATCH = 8192, 1024


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shells", type=int, default=1_000_000, help="how many shells, over all scenes and materials")
    parser.add_argument("--fingers", type=int, default=100_000, help="how many fingers, over all scenes")
    parser.add_argument("--cells", type=int, default=10_000, help="how many cells of the cell law")
    parser.add_argument("--no-gradients", action="store_true", help="leave the catalogue of derivatives out")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="kinds and materials whose name has this in it")
    parser.add_argument("--show", action="store_true", help="print a design for each kind of violation")
    asked = parser.parse_args()
    bad = 0 if asked.no_gradients else run_gradients(asked.only)
    bad += run_shells(asked.shells, asked.seed, asked.only) if asked.shells else 0
    bad += run_fingers(asked.fingers, asked.seed, asked.only) if asked.fingers else 0
    bad += run_cells(asked.cells, asked.seed) if asked.cells and asked.only in "cell" else 0
    print(f"{bad:,} violations")
    if asked.show:
        from cells import WORST as CELLS
        from fingers_check import WORST as FINGERS
        from shells import WORST as SHELLS

        for what, design in (SHELLS | FINGERS | CELLS).items():
            print(what, *design, sep="\n    ")
    return 1 if bad else 0


def run_shells(total: int, seed: int, only: str) -> int:
    """The number of violations."""
    from random_shells import KINDS, LAWS
    from shells import measured, violations

    pairs = [(k, m) for k in KINDS for m in LAWS if only in f"{k} {m}"]
    each, bad = -(-total // len(KINDS) // len(LAWS)), 0
    for kind, law in pairs:
        began, compiled, counts = time.perf_counter(), measured(KINDS[kind], LAWS[law]), Counter()
        draw = np.random.default_rng([seed, *kind.encode(), *law.encode()])
        while counts["designs"] < each:
            counts += violations(kind, law, draw, min(BATCH, each), compiled)
        bad += report(f"{kind} {law}", counts, time.perf_counter() - began)
    return bad


def run_fingers(total: int, seed: int, only: str) -> int:
    """The number of violations."""
    from fingers_check import KINDS, measured, violations

    kinds, bad = [k for k in KINDS if only in k], 0
    shares = sum(KINDS[k].share for k in KINDS)
    for kind in kinds:
        began, compiled, counts = time.perf_counter(), measured(KINDS[kind]), Counter()
        draw = np.random.default_rng([seed, *kind.encode()])
        each = max(1, round(total * KINDS[kind].share / shares))
        while counts["designs"] < each:
            counts += violations(kind, draw, min(FINGER_BATCH, each), compiled)
        bad += report(f"pneunet {kind}", counts, time.perf_counter() - began)
    return bad


def run_cells(total: int, seed: int) -> int:
    """The number of violations."""
    from cells import compiled, violations

    began, states, draw = time.perf_counter(), compiled(), np.random.default_rng(seed)
    return report("cells", violations(draw, total, states), time.perf_counter() - began)


def run_gradients(only: str) -> int:
    """The number of questions whose derivatives are off."""
    from gradients import WORST, catalogue, worst_errors

    bad = 0
    for name, material, scene in catalogue():
        if only in f"{name} {material}":
            began, errors = time.perf_counter(), worst_errors(name, scene)
            seconds = time.perf_counter() - began
            said = ", ".join(f"{question} {error:.0e}" for question, error in errors.items())
            print(f"gradients of {name}, {material}: {said} ({seconds:.0f} s)", flush=True)
            bad += sum(not error < WORST for error in errors.values())
    return bad


def report(name: str, counts: Counter, seconds: float) -> int:
    """One line on what was seen, one on each kind of violation."""
    said = ", ".join(f"{n:,} {what}" for what, n in counts.items() if not what.startswith("!"))
    print(f"{name}: {said} ({seconds:.0f} s)", flush=True)
    broken = {what: n for what, n in counts.items() if what.startswith("!") and n}
    for what, n in broken.items():
        print(f"    {n:,} {what[2:]}", flush=True)
    return sum(broken.values())


if __name__ == "__main__":
    sys.exit(main())
