"""`python -m benchmarks.studies [DESIGNS]`: how much longer a study takes than the compiled batched solve alone.

Three studies on one core, everything written to a store: free fingers of closed form, shells on a plane, held fingers
with 8 points. The solve alone is the study's own program on designs that are in memory, without reading anything back.
The ratio is that of processor time, which other programs on the machine change less.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time

CORE = 0


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


def main() -> None:
    """Print a table in Markdown."""
    os.sched_setaffinity(0, {CORE})
    import jax

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
        began, used = time.perf_counter(), time.process_time()
        for part in full:
            jax.block_until_ready(study.compiled(part))
        alone = (time.perf_counter() - began) / (len(full) * study.call)
        alone_used = (time.process_time() - used) / (len(full) * study.call)
        with tempfile.TemporaryDirectory() as folder:
            began, used = time.perf_counter(), time.process_time()
            run_in(folder, study, name)
            whole = (time.perf_counter() - began) / count
            whole_used = (time.process_time() - used) / count
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        cells = (f"{alone * 1e6:.2f}", f"{whole * 1e6:.2f}", f"{whole_used / alone_used:.2f}", f"{memory:.0f}")
        print(f"| {name} | {count:,} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
