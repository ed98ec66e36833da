"""Signs of life of what takes long: where there is a terminal, words or a bar; else a line now and then.

Two kinds of work: `stages`, which have names, and `counted`, of which a number is done. Both draw with rich.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINE_SECONDS = 10.0
"""Between two lines about one stage where there is no terminal."""
SPEED_SECONDS = 300.0
"""The time left is estimated from the speed of so many seconds: a chunk of slow designs may take a while."""

Tell = Callable[..., None]
"""tell(stage), tell(stage, done, total) or tell(stage, note=words)."""
Count = Callable[..., None]
"""count(done) or count(done, words), done growing from what was done before to the total."""


def silent(stage: str, done: int = 0, total: int = 0, note: str = "") -> None:
    """For those who want no progress."""


@contextmanager
def stages(console: Console) -> Iterator[Tell]:
    """What the work tells of itself: the name of a stage, and how much of it is done where that is known."""
    if console.is_terminal:
        with console.status("") as status:
            yield lambda stage, done=0, total=0, note="": status.update(_words(stage, done, total, note))
        return
    last: dict[str, float] = {}

    def tell(stage: str, done: int = 0, total: int = 0, note: str = "") -> None:
        now = time.monotonic()
        if now - last.get(stage, -LINE_SECONDS) >= LINE_SECONDS:
            last[stage] = now
            console.print(_words(stage, done, total, note), soft_wrap=True, highlight=False)

    yield tell


def _words(stage: str, done: int, total: int, note: str) -> str:
    told = note or (f"{done} of {total}" if total else "")
    return f"{stage}: {told}" if told else stage


@contextmanager
def counted(console: Console, unit: str, total: int) -> Iterator[Count]:
    """What is counted: the number that is done, of `total` units, words about it, and the time that is left.

    The first call says how many are done already; the first unit compiles, so the speed is that of what follows it.
    """
    if not console.is_terminal:
        yield _lines(console, unit, total)
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
    bar = Progress(TextColumn("{task.description}"), *columns, console=console, speed_estimate_period=SPEED_SECONDS)
    with bar:
        task = bar.add_task(f"{unit}, compiling", total=total)
        yield lambda done, words="": bar.update(task, completed=done, description=words or unit)


def _lines(console: Console, unit: str, total: int) -> Count:
    before: list[int] = []
    first: list[tuple[float, int]] = []
    last = [0.0]

    def count(done: int, words: str = "") -> None:
        now = time.monotonic()
        told = f": {words}" if words else ""
        if not before:
            before.append(done)
            start = f"going on with {done} of {total} {unit}" if done else f"compiling, then {total} {unit}"
            console.print(f"all {unit} are done already" if done == total else start, soft_wrap=True)
            return
        if done == total or now - last[0] >= LINE_SECONDS:
            left = ""
            if first and total > done > first[0][1]:
                left = f", {(now - first[0][0]) * (total - done) / (done - first[0][1]):.0f} s left"
            console.print(f"{done} of {total} {unit}{told}{left}", soft_wrap=True)
            last[0] = now
        if done > before[0] and not first:
            first.append((now, done))

    return count
