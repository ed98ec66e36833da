"""`python -m benchmarks.scaling [DESIGNS]`: two workers against one, and what it costs to hand out a range.

Shells on a plane, on worker processes of this machine, one and two of them in turn, ROUNDS times. The time begins when
every worker has compiled. On a machine that does other work too, the processor time of the workers says more than the
wall: it would be the same for one and two workers if they did not disturb one another.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time

from .studies import studies

ROUNDS, TASKS = 5, 2000


def used() -> float:
    """Processor time of a worker, s."""
    return time.process_time()


def nothing(number: int) -> tuple[int, float, str]:
    """What a range answers."""
    return number, 0.0, "cpu"


def one_round(spread, study) -> tuple[float, float]:
    """Microseconds a design: of the wall, and of the workers' processors."""
    from softgrip_jax.study import run_in

    client = spread.args[0]
    with tempfile.TemporaryDirectory() as folder:
        before, began = sum(client.run(used).values()), time.perf_counter()
        run_in(folder, study, "scaling", spread=spread)
        wall = time.perf_counter() - began
        after = sum(client.run(used).values())
    return wall / study.designs.count * 1e6, (after - before) / study.designs.count * 1e6


def main() -> None:
    """Print what was measured."""
    from softgrip_jax.study.cluster import client

    count = int(sys.argv[1]) if sys.argv[1:] else 10_000_000
    _, (_, study), _ = [*studies(count)]
    _, (_, small), _ = [*studies(1 << 18)]
    times: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
    with client(1, None) as alone, client(2, None) as both:
        for spread in (alone, both):
            one_round(spread, small)
        for _ in range(ROUNDS):
            for workers, spread in ((1, alone), (2, both)):
                times[workers].append(one_round(spread, study))
                wall, processor = times[workers][-1]
                print(f"{workers} workers: {wall:.2f} us a design, {processor:.2f} us of processor", flush=True)
        for k, name in enumerate(("wall", "processor")):
            one, two = (statistics.median(round[k] for round in times[workers]) for workers in (1, 2))
            print(f"{name}: {one / two:.2f} times")
        dask, began, here = both.args[0], time.perf_counter(), time.process_time()
        dask.gather([dask.submit(nothing, k, pure=False) for k in range(TASKS)])
        wall, here = (time.perf_counter() - began) / TASKS, (time.process_time() - here) / TASKS
        print(f"a range: {wall * 1e3:.2f} ms, {here * 1e3:.2f} ms of the processor of client and scheduler")


if __name__ == "__main__":
    main()
