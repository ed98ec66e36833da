"""Folders and files of runs: complete or not there, and never in place of others."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import ConfigError

RUNS = Path("runs")
"""Where runs go that are given no folder: runs/<name of the config>-001 and so on."""


@contextmanager
def new_folder(out: Path | None, name: str) -> Iterator[tuple[Path, Path]]:
    """(folder to write to, its final name): a hidden sibling, renamed when the block ends well, removed when not."""
    if out is not None and out.exists():
        raise ConfigError(f"{out} exists already; give --out a new name.")
    final = free_name(name) if out is None else out
    final.parent.mkdir(parents=True, exist_ok=True)
    unfinished = final.parent / f".{final.name}-{uuid.uuid4().hex}"
    unfinished.mkdir()
    try:
        yield unfinished, final
        if final.exists():
            raise ConfigError(f"{final} has come to exist during the run, which was given up so as not to replace it.")
        os.rename(unfinished, final)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


class Undisturbed:
    """Ctrl-C within the block waits until its end and is then known as `asked`: what was found is written whole.

    A second one does not wait.
    """

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> Undisturbed:
        # Python hands signals to the main thread alone, and lets no other one choose what they do.
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, number: int, frame: Any) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def __exit__(self, *exception: object) -> None:
        if self._is_main:
            signal.signal(signal.SIGINT, self._before)


def free_name(name: str) -> Path:
    """The next name in RUNS that is not taken."""
    number = 1
    while (RUNS / f"{name}-{number:03d}").exists():
        number += 1
    return RUNS / f"{name}-{number:03d}"


def write_whole(path: Path, content: bytes | Callable[[Path], Any]) -> None:
    """A file that is complete or not there: written beside its place, brought to the disk, then renamed."""
    unfinished = path.with_name(f".unfinished-{path.name}")
    if isinstance(content, bytes):
        unfinished.write_bytes(content)
    else:
        content(unfinished)
    with unfinished.open("rb") as file:
        os.fsync(file.fileno())
    unfinished.replace(path)
