"""What a user waits for: imports, and `softgrip solve` the first and the second time."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent.parent
IMPORTS = {
    "import jax, diffrax": "import jax, diffrax",
    "import softgrip_jax": "import softgrip_jax",
    "import softgrip_jax, all that solve needs": "import softgrip_jax as sg; sg.solve, sg.shell, sg.pneunet",
}
COMMAND = "from softgrip_jax.cli import main; main()"
CONFIGS = ("shell_free", "shell_cylinder", "finger_tip_contact", "finger_grasp")
REPEATS = 5
FIELDS = ("what", "time", "seconds", "cpu_seconds", "peak_memory_MB")


SMALL = """
import json, os, subprocess, sys, time
began = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, use = os.wait4(process.pid, 0)
seconds = time.perf_counter() - began
print(json.dumps([os.waitstatus_to_exitcode(status), seconds, use.ru_utime + use.ru_stime, use.ru_maxrss / 1024]))
"""
"""What starts a command: the peak memory of a process begins at that of the one that started it."""


def run(order: list[str], environment: dict[str, str]) -> tuple[float, float, float]:
    """(seconds on the wall, CPU seconds, peak memory in MB) of a command."""
    starter = [sys.executable, "-S", "-c", SMALL, *order]
    done = subprocess.run(starter, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    code, *numbers = json.loads(done.stdout)
    if code:
        raise RuntimeError(f"{' '.join(order)} ended with {code}")
    return tuple(numbers)


def measure(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of their own kind: medians of several imports, and of several times that a config was new."""
    os.sched_setaffinity(0, range(os.cpu_count() or 1))  # what a user has
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    taken: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    for _ in range(1 if quick else REPEATS):
        for words, code in IMPORTS.items():
            taken.setdefault((words, ""), []).append(run([sys.executable, "-c", code], environment))
        for config in CONFIGS[:1] if quick else CONFIGS:
            cache = tempfile.mkdtemp(prefix="softgrip-bench-")
            order = [sys.executable, "-c", COMMAND, "solve", f"configs/{config}.toml"]
            try:
                for when in ("first", "second", "third"):
                    numbers = run(order, environment | {"XDG_CACHE_HOME": cache})
                    taken.setdefault((f"softgrip solve {config}.toml", when), []).append(numbers)
            finally:
                shutil.rmtree(cache)
    for (what, when), runs in taken.items():
        numbers = [statistics.median(column) for column in zip(*runs, strict=True)]
        yield dict(zip(FIELDS, (what, when, *numbers), strict=True))
