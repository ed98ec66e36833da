"""What a worker of Dask does: it gets a study, or a function, when it joins, and then computes ranges of its blocks, or
calls."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable
from typing import Any

from distributed import WorkerPlugin

from ..cache import enable_cache
from .store import Store, compute, device

received: dict[str, bytes] = {}
_stores: dict[str, Store] = {}


def _forget(name: str) -> None:
    _stores.pop(name, None)


class Plugin(WorkerPlugin):
    """Brings a study, or a function, to every worker, to those that join later too."""

    def __init__(self, name: str, content: bytes, pinned: bool, forget: Callable[[str], None] = _forget):
        self.name, self.content, self.pinned, self.forget = name, content, pinned, forget
        """content: the address of the store and the study, pickled, or what `spread` sends; it is opened where it is
        asked for, since to open it starts JAX. forget: what is left of it on a worker."""

    def setup(self, worker: Any) -> None:
        if self.pinned and isinstance(worker.name, int) and hasattr(os, "sched_setaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            os.sched_setaffinity(0, {cores[worker.name % len(cores)]})
        received[self.name] = self.content

    def teardown(self, worker: Any) -> None:
        received.pop(self.name, None)
        self.forget(self.name)


def run_range(name: str, blocks: list[int]) -> tuple[int, float, str]:
    """Compute blocks and write them; (designs, seconds, kind of device)."""
    if name not in _stores:
        enable_cache()
        address, study = pickle.loads(received[name])
        study.evaluate(study.rows(blocks[0]))  # compiles, which is not counted
        _stores[name] = Store(address, study)
    start, done = time.monotonic(), []
    compute(_stores[name], blocks, lambda count, _: done.append(count))
    return sum(done), time.monotonic() - start, device()
