"""One function, called many times on the workers of Dask, its answers in the order of the calls.

A search and a calibration spread their work so: each call is computed by the program that one process would have used,
from the same numbers, so that the answers are the same, to the bit, on the same kind of processor.
"""

from __future__ import annotations

import pickle
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from ..commands import programs
from ..errors import ConfigError
from .cluster import connected, lost_is_one_sentence

Calls = Callable[[Sequence[tuple[Any, ...]]], list[Any]]
"""Takes the arguments of many calls and gives their answers."""


WORK, AGAIN = "The work was not finished", "run it again"


class Spread:
    """The workers of a client; `on` has them compute something."""

    def __init__(self, client: Any, pinned: bool):
        self.client, self.pinned = client, pinned

    @contextmanager
    def on(self, make: Callable[..., Callable[..., Any]], *args: Any) -> Iterator[Calls]:
        """Calls of the function make(*args), which every worker makes for itself once."""
        import cloudpickle

        from .worker import Plugin, call

        name = f"softgrip-{uuid.uuid4().hex}"
        content = cloudpickle.dumps((programs.is_used(), make, args))
        with lost_is_one_sentence(WORK, AGAIN):
            self.client.register_plugin(Plugin(name, content, self.pinned))

        def run(calls: Sequence[tuple[Any, ...]]) -> list[Any]:
            with lost_is_one_sentence(WORK, AGAIN):
                futures = [self.client.submit(call, name, pickle.dumps(given), pure=False) for given in calls]
                try:
                    return self.client.gather(futures)
                except BaseException:
                    self.client.cancel(futures)
                    raise

        try:
            yield run
        finally:
            with suppress(Exception):  # a scheduler that is gone has no workers to tell
                self.client.unregister_worker_plugin(name)


@contextmanager
def spread_over(workers: int | None, scheduler: str | None, insecure: bool = False) -> Iterator[Spread | None]:
    """The workers that are asked for; None where none are.

    Raises: ConfigError as `cluster.client`, and where --insecure is given alone.
    """
    if workers is None and scheduler is None:
        if insecure:
            raise ConfigError("--insecure is given without --scheduler, to which it belongs.")
        yield None
        return
    with connected(workers, scheduler, insecure) as client:
        yield Spread(client, workers is not None)
