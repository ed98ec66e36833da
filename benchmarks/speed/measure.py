"""Clocks and rows: what every part of the benchmark measures with and writes.

On a CPU the clock is the CPU time of one process that is pinned to one core and runs XLA with one thread: the time of
one core, whatever else the machine does beside. On another device it is the clock on the wall.
"""

from __future__ import annotations

import csv
import os
import platform
import resource
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

REPEATS, LEAST = 7, 0.05
"""Medians of so many calls; each is repeated until it takes LEAST seconds, so that the clock's grain does not show."""

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
FIELDS = ("scene", "method", "setting", "precision", "batch", "error", "gradient_error", "seconds", "gradient_seconds",
          "compile_seconds", "first_seconds", "memory_MB")  # fmt: skip
"""Columns of every table of measurements; seconds are per design."""


ON_GPU = bool(os.environ.get("SOFTGRIP_BENCH_WALL"))
"""Set by the main process where JAX finds another device than the CPU."""


def clock() -> float:
    """Seconds: of this process on a CPU, on the wall elsewhere."""
    return time.perf_counter() if ON_GPU else time.process_time()


@contextmanager
def alone() -> Iterator[None]:
    """While this lasts no other part of the benchmark times anything: on a GPU, where all parts compile at once."""
    import fcntl

    with (Path(tempfile.gettempdir()) / "softgrip_bench.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def median_seconds(call: Callable[[], Any], repeats: int = REPEATS, least: float = LEAST) -> float:
    """Median time of a call that has been made once before."""
    begin = clock()
    call()
    once = clock() - begin
    inner = max(1, int(least / max(once, 1e-6)))
    if once > 20 * least:
        repeats = 3
    times = []
    for _ in range(repeats):
        begin = clock()
        for _ in range(inner):
            call()
        times.append((clock() - begin) / inner)
    return statistics.median(times)


class Compiled(NamedTuple):
    """A program with what it took to make it."""

    call: Callable[..., Any]
    seconds: float
    """Tracing and compiling."""
    first: float
    """From the function to its first result."""
    memory: float
    """Bytes of arguments, results and what lies between."""


def compiled(function: Callable[..., Any], *arguments: Any, called: bool = True) -> Compiled:
    """A function compiled for these arguments, and called once."""
    import jax

    begin = clock()
    program = jax.jit(function).lower(*arguments).compile()
    made = clock() - begin
    if called:
        jax.block_until_ready(program(*arguments))
    first = clock() - begin
    use = program.memory_analysis()
    memory = float("nan")
    if use is not None:
        memory = use.argument_size_in_bytes + use.output_size_in_bytes + use.temp_size_in_bytes
    return Compiled(lambda *args: jax.block_until_ready(program(*args)), made, first, memory)


def peak_memory() -> float:
    """Bytes that this process held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def row(scene: str, method: str, setting: str, **values: Any) -> dict[str, Any]:
    """A line of a table of measurements."""
    return {"scene": scene, "method": method, "setting": setting, "precision": "float64", "batch": 1} | values


def write(path: Path, rows: list[dict[str, Any]], fields: tuple[str, ...] = FIELDS) -> None:
    """A CSV, complete or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, fields, lineterminator="\n")
        table.writeheader()
        for one in rows:
            table.writerow({name: _plain(one.get(name, "")) for name in fields})
    unfinished.replace(path)


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a CSV; numbers are numbers."""
    with path.open(encoding="utf-8") as file:
        return [{name: _number(value) for name, value in line.items()} for line in csv.DictReader(file)]


def _plain(value: Any) -> Any:
    return f"{float(value):.6g}" if hasattr(value, "__float__") and not isinstance(value, str | int) else value


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    import jax

    device = jax.devices()[0]
    return {
        "date": date.today().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores",
        "device": f"{device.platform}: {device.device_kind}",
        "load": f"{os.getloadavg()[0]:.1f}",
        "python": platform.python_version(),
        "jax": jax.__version__,
        "commit": subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
        ).stdout.strip(),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor()
