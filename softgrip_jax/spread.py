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

from .cache import enable_cache
from .commands import programs
from .errors import ConfigError

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

        from .study.cluster import lost_is_one_sentence
        from .study.worker import Plugin

        name = f"softgrip-{uuid.uuid4().hex}"
        content = cloudpickle.dumps((programs.is_used(), make, args))
        with lost_is_one_sentence(WORK, AGAIN):
            self.client.register_plugin(Plugin(name, content, self.pinned, _forget))

        def run(calls: Sequence[tuple[Any, ...]]) -> list[Any]:
            with lost_is_one_sentence(WORK, AGAIN):
                futures = [self.client.submit(_call, name, pickle.dumps(given), pure=False) for given in calls]
                try:
                    return self.client.gather(futures)
                finally:  # after Ctrl-C or a fault nobody waits for the rest
                    self.client.cancel([future for future in futures if not future.done()])

        try:
            yield run
        finally:
            with suppress(Exception):  # a scheduler that is gone has no workers to tell
                self.client.unregister_worker_plugin(name)


@contextmanager
def spread_over(workers: int | None, scheduler: str | None, insecure: bool = False) -> Iterator[Spread | None]:
    """The workers that are asked for; None where none are.

    Raises: ConfigError as `study.cluster.connected`, and where --insecure is given alone.
    """
    if workers is None and scheduler is None:
        if insecure:
            raise ConfigError("--insecure is given without --scheduler, to which it belongs.")
        yield None
        return
    from .study.cluster import connected

    with connected(workers, scheduler, insecure) as client:
        yield Spread(client, workers is not None)


# --- on a worker ------------------------------------------------------------------------------------------------------

_functions: dict[str, Any] = {}


def _call(name: str, given: bytes) -> Any:
    """One call of a function, whose arguments are pickled."""
    from .study.worker import received

    if name not in _functions:
        is_command, make, args = pickle.loads(received[name])
        if is_command:
            programs.settings()
        enable_cache()
        _functions[name] = make(*args)
    return _functions[name](*pickle.loads(given))


def _forget(name: str) -> None:
    _functions.pop(name, None)
