"""`python -m benchmarks.studies [DESIGNS]`: how much longer a study takes than the compiled batched solve alone.

Three studies on one core, everything written to a store: free fingers of closed form, shells on a plane, held fingers
with 8 points. The solve alone is the study's own program on designs that are in memory, without reading anything back.
Both are measured ROUNDS times, one after the other, and medians are given. The ratio is that of processor time, which
other programs on the machine change less. To import the packages and to compile is not counted.
"""

from __future__ import annotations

import os
import resource
import statistics
import sys
import tempfile
import time

CORE = 0
ROUNDS = 3


def studies(count: int):
    """(name, study) of every case."""
    import softgrip_jax as sg
    from softgrip_jax.study import Range, Sobol
    from softgrip_jax.units import kPa, mm

    ranges = [(4, 7), (7.5, 10), (0.6, 1.2), (0.9, 1.6), (3.5, 7)]
    fingers = Sobol([Range(low * mm, high * mm) for low, high in ranges], count)
    names = ["finger.a", "finger.b", "finger.h_x", "finger.t_m", "finger.H"]
    finger = sg.PneuNet.table_5_1("A")
    free = sg.pneunet.Free(finger, weight=(0.0, 0.0), inclination="none")
    asked = [sg.Quantity("tip_angle", 20 * kPa), sg.Quantity("end_moment", 20 * kPa)]
    yield "free finger, closed form", sg.Study(free, names, asked, fingers)
    shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
    ranges = [(12, 20), (30, 50), (0.8, 1.6), (3, 7)]
    designs = Sobol([*(Range(low * mm, high * mm) for low, high in ranges), Range(150 * kPa, 250 * kPa)], count)
    names_of_shell = ["shell.a", "shell.b", "shell.t_m", "distance", "shell.material.mu"]
    flat = sg.shell.FlatContact(shell, distance=5 * mm)
    yield "shell on a plane", sg.Study(flat, names_of_shell, [sg.Quantity("force", 10 * kPa)], designs)
    held = sg.pneunet.TipContact(finger, beam=sg.pneunet.Collocation(points=8))
    yield "held finger, 8 points", sg.Study(held, names, [sg.Quantity("tip_force", 20 * kPa)], fingers)


class Clock:
    """Seconds of the wall and of the processor since it was made."""

    def __init__(self):
        self.began, self.used = time.perf_counter(), time.process_time()

    def per(self, count: int) -> tuple[float, float]:
        return (time.perf_counter() - self.began) / count, (time.process_time() - self.used) / count


def main() -> None:
    """Print a table in Markdown."""
    os.sched_setaffinity(0, {CORE})
    import jax
    import xarray  # noqa: F401
    import zarr  # noqa: F401

    from softgrip_jax.study import run_in

    count = int(sys.argv[1]) if sys.argv[1:] else 1_000_000
    print("| study | designs | solve alone, us a design | study, us a design | ratio | peak memory, MB |")
    print("|---|---|---|---|---|---|")
    for name, study in studies(count):
        # As many blocks alone as in the study, spread over it, so that both meet the same machine.
        rows = [study.rows(k) for k in range(len(study.blocks))][: 1 + 2_000_000 // study.blocks.size]
        full = [jax.numpy.asarray(part) for part in rows if len(part) == study.call] or [
            jax.numpy.asarray(study.designs.rows(0, study.call))
        ]
        jax.block_until_ready(study.compiled(full[0]))
        alone, whole = [], []
        for _ in range(ROUNDS):
            clock = Clock()
            for part in full:
                jax.block_until_ready(study.compiled(part))
            alone.append(clock.per(len(full) * study.call))
            with tempfile.TemporaryDirectory() as folder:
                clock = Clock()
                run_in(folder, study, name)
                whole.append(clock.per(count))
        wall = [statistics.median(seconds for seconds, _ in times) for times in (alone, whole)]
        ratio = statistics.median(used for _, used in whole) / statistics.median(used for _, used in alone)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        cells = (*(f"{seconds * 1e6:.2f}" for seconds in wall), f"{ratio:.2f}", f"{memory:.0f}")
        print(f"| {name} | {count:,} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
