"""What a worker of Dask does: it gets a study, or a function, when it joins, and then computes ranges of its blocks, or
calls."""

from __future__ import annotations

import os
import pickle
import time
from typing import Any

from distributed import WorkerPlugin

from ..cache import enable_cache
from ..commands import programs
from .store import Store, compute, device

_received: dict[str, bytes] = {}
_stores: dict[str, Store] = {}
_functions: dict[str, Any] = {}


class Plugin(WorkerPlugin):
    """Brings a study, or a function, to every worker, to those that join later too."""

    def __init__(self, name: str, content: bytes, pinned: bool):
        self.name, self.content, self.pinned = name, content, pinned
        """content: the address of the store and the study, pickled, or what `calls` sends: it is opened where something
        is asked for, since to open it starts JAX."""

    def setup(self, worker: Any) -> None:
        if self.pinned and isinstance(worker.name, int) and hasattr(os, "sched_setaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            os.sched_setaffinity(0, {cores[worker.name % len(cores)]})
        _received[self.name] = self.content

    def teardown(self, worker: Any) -> None:
        _received.pop(self.name, None)
        _stores.pop(self.name, None)
        _functions.pop(self.name, None)


def run_range(name: str, blocks: list[int]) -> tuple[int, float, str]:
    """Compute blocks and write them; (designs, seconds, kind of device)."""
    if name not in _stores:
        enable_cache()
        address, study = pickle.loads(_received[name])
        study.evaluate(study.rows(blocks[0]))  # compiles, which is not counted
        _stores[name] = Store(address, study)
    start, done = time.monotonic(), []
    compute(_stores[name], blocks, lambda count, _: done.append(count))
    return sum(done), time.monotonic() - start, device()


def call(name: str, given: bytes) -> Any:
    """One call of a function, whose arguments are pickled."""
    if name not in _functions:
        is_command, make, args = pickle.loads(_received[name])
        if is_command:
            programs.settings()
        enable_cache()
        _functions[name] = make(*args)
    return _functions[name](*pickle.loads(given))
