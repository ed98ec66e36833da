"""Signs of life of what takes long: words that change where there is a terminal, else a line now and then."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

LINE_SECONDS = 10.0
"""Between two lines about one stage where there is no terminal."""

Tell = Callable[..., None]
"""tell(stage) or tell(stage, done, total)."""


def silent(stage: str, done: int = 0, total: int = 0) -> None:
    """For those who want no progress."""


@contextmanager
def stages(console: Console) -> Iterator[Tell]:
    """What the work tells of itself: the name of a stage, and how much of it is done where that is known."""
    if console.is_terminal:
        with console.status("") as status:
            yield lambda stage, done=0, total=0: status.update(_words(stage, done, total))
        return
    last: dict[str, float] = {}

    def tell(stage: str, done: int = 0, total: int = 0) -> None:
        now = time.monotonic()
        if now - last.get(stage, -LINE_SECONDS) >= LINE_SECONDS:
            last[stage] = now
            console.print(_words(stage, done, total), soft_wrap=True, highlight=False)

    yield tell


def _words(stage: str, done: int, total: int) -> str:
    return f"{stage}: {done} of {total}" if total else stage
