"""A study on the workers of Dask: ranges of blocks, each written by the worker that computes it.

The scheduler is told numbers of blocks and hears counts; designs and results never pass through it. Every worker gets
the study once, when it joins, and compiles once. What a worker that dies had not written is given to another; where the
scheduler or this process dies the store keeps what was written, and the next run goes on.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import ipaddress
import logging
import queue
import signal
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from ..errors import ConfigError
from .store import AGAIN, Store

RANGE_SECONDS = 3.0
"""Of work in a range: a thousand times what it costs to hand one out, and what is lost with a worker."""
QUEUED = 2
"""Ranges that every worker has: one at work and one that waits."""
REACHED_SECONDS = 10
"""Until a scheduler that does not answer is said to be none."""
LOOK_SECONDS = 1.0
"""Between two looks at how many workers there are."""
PATIENCE = 120.0
"""Seconds without any worker until the run is given up."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "PJRT_NPROC": "1"}
"""Each worker is a process with one thread of XLA on a core of its own. The flag xla_cpu_multi_thread_eigen would do so
too, but its products of matrices differ in their last digits from those of a process that does without it."""


@contextmanager
def client(workers: int | None, scheduler: str | None, insecure: bool = False) -> Iterator[Any]:
    """What computes a study on workers, see `connected`."""
    with connected(workers, scheduler, insecure) as found:
        yield partial(compute_on, found, workers is not None)


@contextmanager
def connected(workers: int | None, scheduler: str | None, insecure: bool = False) -> Iterator[Any]:
    """A client of Dask: of processes of this machine, which end with it, or of a scheduler that runs.

    Certificates for a scheduler (tls://) are those of Dask's own configuration, `distributed.comm.tls`.

    Raises: ConfigError where dask is not installed, where both or none are asked for, where a scheduler on another
        machine would be talked to in the clear, and where there is none.
    """
    if (workers is None) == (scheduler is None):
        raise ConfigError("--workers starts processes and --scheduler uses those of a cluster; give one of them.")
    if scheduler is not None:
        refuse_plain(scheduler, insecure)
    try:
        import distributed
        from distributed.security import Security
    except ImportError:
        raise ConfigError("--workers and --scheduler need Dask; pip install softgrip_jax[cluster].") from None
    for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what is wrong is said in one sentence
    if workers is not None:
        # Only who holds these certificates, which are in the memory of these processes alone, can send work.
        with without_ctrl_c():
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host="tls://127.0.0.1",
                dashboard_address=None,
                # What is left of it without pages, at any port of this machine: another cluster may have the usual one.
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                security=Security.temporary(),
                env=ONE_THREAD,
                silence_logs=logging.CRITICAL,
            )
        with cluster, distributed.Client(cluster) as found:
            yield found
        return
    try:
        found = distributed.Client(scheduler, security=Security(), timeout=REACHED_SECONDS)
    except (OSError, TypeError, ValueError, RuntimeError) as error:
        words = " ".join(str(error).split()).rstrip(".") or "it does not answer"
        raise ConfigError(f"The scheduler {scheduler} cannot be reached: {words}.") from None
    with found:
        yield found


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """The threads that are begun here, and all the processes that they begin, never hear Ctrl-C, which a terminal sends
    to every process of a command: this one alone ends the others."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would let the signal through again as it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def refuse_plain(address: str, insecure: bool) -> None:
    """A ConfigError for an address in the clear that is not of this machine: who can reach a Dask scheduler can run
    anything on its workers and its clients."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    host = parts.hostname or ""
    try:
        is_local = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        is_local = False
    if parts.scheme not in ("tls", "tcp") or not host:
        raise ConfigError(f"--scheduler is {address!r}; it must be an address such as tls://host:8786.")
    if parts.scheme == "tcp" and not is_local and not insecure:
        raise ConfigError(
            f"--scheduler is {address!r}, another machine without encryption, and whoever reaches it can run programs "
            "here; use tls://, or --insecure in a network that you trust."
        )


def compute_on(client: Any, pinned: bool, store: Store, todo: Sequence[int], tell: Callable[[int, str], None]) -> None:
    """Have the workers of a client compute blocks and write them; tell(designs, kind of device) after every range."""
    import cloudpickle

    from .worker import Plugin, run_range

    name = f"softgrip-{uuid.uuid4().hex}"
    content = cloudpickle.dumps((store.address, store.study))
    with lost_is_one_sentence("The study was not finished", AGAIN):
        client.register_plugin(Plugin(name, content, pinned))
        ranges, done = _Ranges(todo), queue.SimpleQueue()
        pending: dict[Any, list[int]] = {}
        seen, looked, threads = time.monotonic(), -LOOK_SECONDS, 0
        while len(ranges) or pending:
            if time.monotonic() - looked > LOOK_SECONDS:  # workers may have joined or left
                threads, looked = sum(client.nthreads().values()), time.monotonic()
                if threads:
                    seen = looked
                elif looked - seen > PATIENCE:
                    raise ConfigError(
                        f"The scheduler has had no workers for {PATIENCE:.0f} s; {AGAIN} when it has some."
                    )
            while len(ranges) and len(pending) < QUEUED * max(threads, 1):
                blocks = ranges.next()
                future = client.submit(run_range, name, blocks, pure=False)
                pending[future] = blocks
                future.add_done_callback(done.put)
            with suppress(queue.Empty):
                future = done.get(timeout=LOOK_SECONDS)
                blocks = pending.pop(future)
                count, seconds, kind = future.result()
                ranges.learn(len(blocks), seconds)
                tell(count, kind)
        client.unregister_worker_plugin(name)


@contextmanager
def lost_is_one_sentence(what: str, again: str) -> Iterator[None]:
    """A ConfigError, which begins with what happened and says what to do, where workers or their scheduler are lost."""
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        yield
    except KilledWorker:
        raise ConfigError(f"{what}: the same work ended several workers; {again}.") from None
    except (asyncio.CancelledError, concurrent.futures.CancelledError, CommClosedError, TimeoutError):
        raise ConfigError(f"{what}: the scheduler was lost; when it is back, {again}.") from None


class _Ranges:
    """Blocks in ranges that take RANGE_SECONDS, as far as is known."""

    def __init__(self, todo: Sequence[int]):
        self.todo, self.start, self.length = list(todo), 0, 1

    def __len__(self) -> int:
        return len(self.todo) - self.start

    def next(self) -> list[int]:
        blocks = self.todo[self.start : self.start + self.length]
        self.start += len(blocks)
        return blocks

    def learn(self, blocks: int, seconds: float) -> None:
        self.length = max(1, min(round(RANGE_SECONDS * blocks / max(seconds, 1e-6)), 2 * self.length))
