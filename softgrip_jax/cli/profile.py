"""Where the time of a command goes: `softgrip --profile COMMAND ...`.

Importing is counted where Python looks for a module, tracing and compiling by what JAX reports of itself; what is left
is running the programs, reading and writing. An import while a function is traced counts for both.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..commands.programs import WAITED

EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "trace",
    "/jax/core/compile/backend_compile_duration": "compile",
    WAITED: "compile",
}
"""What JAX calls them -> what we do; a program that comes from the cache counts as compiled, for as long as it took.
What is compiled while the command does something else counts where it has to be waited for."""

WORDS = {
    "import": "importing Python, JAX and this package",
    "trace": "tracing functions and lowering them",
    "compile": "compiling, or reading compiled programs",
    "run": "running, reading and writing",
}

FLAG = "--profile"


class Profile:
    """The seconds of this process by what they were spent on."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(WORDS, 0.0)
        self.begin = time.time() - age()
        self._importing = self._listening = False
        self._bootstrap: Any = importlib._bootstrap  # pyright: ignore[reportAttributeAccessIssue]
        self._find = self._bootstrap._find_and_load

    def __enter__(self) -> Profile:
        """Listen from now on. What came before was importing."""
        self.seconds["import"] = time.time() - self.begin
        self._bootstrap._find_and_load = self._timed(self._find)
        self._listen()
        return self

    def __exit__(self, *_: object) -> None:
        self._bootstrap._find_and_load = self._find
        if self._listening:
            sys.modules["jax"].monitoring.unregister_event_duration_listener(self._heard)

    def _timed(self, find: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any) -> Any:
            if self._importing:
                return find(*args)
            self._importing, begin = True, time.time()
            try:
                return find(*args)
            finally:
                self._importing = False
                self.seconds["import"] += time.time() - begin
                self._listen()

        return timed

    def _listen(self) -> None:
        """To JAX, once it is there."""
        monitoring = getattr(sys.modules.get("jax"), "monitoring", None)
        if monitoring is not None and not self._listening:
            self._listening = True
            monitoring.register_event_duration_secs_listener(self._heard)

    def _heard(self, event: str, seconds: float, **_: Any) -> None:
        what = EVENTS.get(event)
        if what and threading.current_thread() is threading.main_thread():
            self.seconds[what] += seconds

    def lines(self) -> list[str]:
        """One per kind, with its share, and the sum."""
        total = time.time() - self.begin
        known = sum(value for what, value in self.seconds.items() if what != "run")
        self.seconds["run"] = max(total - known, 0.0)
        rows = [f"{self.seconds[what]:7.2f} s {self.seconds[what] / total:4.0%}  {WORDS[what]}" for what in WORDS]
        return [*rows, f"{total:7.2f} s       in all"]


def age() -> float:
    """Seconds since this process began; 0 where the system does not tell."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        up = Path("/proc/uptime").read_text().split()
    except OSError:
        return 0.0
    return max(float(up[0]) - int(fields[19]) / os.sysconf("SC_CLK_TCK"), 0.0)
