"""`python -m benchmarks.speed`: measure, write the tables as CSV, draw the pictures, write the page.

Parts run as processes of their own, pinned to one core each, two beside each other where there are two cores. On a GPU
(JAX_PLATFORMS=cuda, or wherever JAX finds one) parts of their own compile at once, on all cores, and time in turn;
their tables go to a folder of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from . import gpu_part, measure

ROOT = Path(__file__).resolve().parent.parent.parent
TOGETHER = (
    *("fingers", "fidelity", "peers", "scenes", "shells", "models"),
    *("energy", "methods", "arcs", "hard", "drives", "elastica"),
)
"""Longest first."""
ALONE = ("explorer", "start")
"""Parts with processes of their own, which nothing runs beside."""
PARTS = (*TOGETHER, *ALONE)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small sample of everything, for tests")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "benchmarks", help="folder of the CSV files")
    every = (*PARTS, *gpu_part.PARTS)
    parser.add_argument("--only", nargs="*", choices=every, default=[], help="measure these parts again")
    parser.add_argument("--part", choices=every, help=argparse.SUPPRESS)
    parser.add_argument("--core", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--page", type=Path, help="the page to write; docs/speed-and-error.md, none with --quick")
    asked = parser.parse_args()
    if asked.part:
        run_part(asked.part, asked.out, asked.quick, asked.core)
        return
    began = time.perf_counter()
    folder, on_gpu = asked.out, gpu()
    if on_gpu:
        folder = asked.out / "gpu"
        os.environ["SOFTGRIP_BENCH_WALL"] = "1"
    parts = [part for part in every if part in asked.only] or list(gpu_part.PARTS if on_gpu else PARTS)
    together = [part for part in parts if part not in ALONE]
    failed = run_all(together, folder, asked.quick, on_gpu)
    for part in ALONE:
        if part in parts:
            failed += run_all([part], folder, asked.quick, on_gpu)
    seconds = time.perf_counter() - began
    print(f"{seconds:.0f} s for {', '.join(parts)}", flush=True)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}; the tables of the others are in {folder}")
    page = asked.page or (None if asked.quick else ROOT / "docs" / "speed-and-error.md")
    if page:
        from .page import write_page

        write_page(page, asked.out)
        write_page(page.with_name("hard-cases.md"), asked.out)


def gpu() -> bool:
    """Whether JAX finds anything but a CPU; asked in a process of its own, which lets go of it."""
    answer = subprocess.run(
        [sys.executable, "-c", "import jax; print(jax.default_backend())"], capture_output=True, text=True, check=True
    )
    return answer.stdout.split()[-1] != "cpu"


def run_all(parts: list[str], folder: Path, quick: bool, on_gpu: bool) -> list[str]:
    """Run parts on all cores (two at most; on a GPU all at once); returns those that failed."""
    cores = sorted(os.sched_getaffinity(0))[:2] if hasattr(os, "sched_getaffinity") else [None]
    cores = [None] * len(parts) if on_gpu else cores
    free, waiting, busy, failed = list(cores), list(parts), {}, []
    while waiting or busy:
        while waiting and free:
            part, core = waiting.pop(0), free.pop()
            order = [sys.executable, "-m", "benchmarks.speed", "--part", part, "--out", str(folder)]
            order += ["--quick"] * quick + ([] if core is None else ["--core", str(core)])
            busy[subprocess.Popen(order, cwd=ROOT, env=environment(on_gpu))] = (part, core, time.perf_counter())
        for process in [p for p in busy if p.poll() is not None]:
            part, core, began = busy.pop(process)
            free.append(core)
            print(f"{part}: {time.perf_counter() - began:.0f} s", flush=True)
            if process.returncode:
                failed.append(part)
        time.sleep(0.2)
    return failed


def environment(on_gpu: bool) -> dict[str, str]:
    """One thread on a CPU; nothing compiled before is used."""
    changed = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    changed.pop("JAX_COMPILATION_CACHE_DIR", None)
    if on_gpu:
        changed |= {"XLA_PYTHON_CLIENT_PREALLOCATE": "false"}  # all parts share its memory
    else:
        changed |= {"XLA_FLAGS": measure.ONE_THREAD, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return changed


def run_part(part: str, folder: Path, quick: bool, core: int | None) -> None:
    """One part in this process: its table, and what it was measured on."""
    if core is not None:
        os.sched_setaffinity(0, {core})
    from importlib import import_module

    began = time.perf_counter()
    if part in gpu_part.PARTS:
        source, fields = gpu_part.measure(part, quick), gpu_part.FIELDS[part]
    else:
        module = import_module(f".{part.removesuffix('s')}_part", __package__)
        source, fields = module.measure(quick), getattr(module, "FIELDS", measure.FIELDS)
    rows, stopped = [], True
    try:
        for one in source:
            rows.append(one)
            measure.write(folder / f"{part}.csv", rows, fields)
        stopped = False
    finally:  # a run that is stopped keeps what it has, and says so
        told = measure.machine() | {
            "seconds": round(time.perf_counter() - began),
            "peak_memory_MB": round(measure.peak_memory() / 1e6),
            "sample": "stopped" if stopped else "small" if quick else "whole",
        }
        if rows:
            (folder / f"{part}.json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
