"""Folders and files of runs: complete or not there, and never in place of others."""

from __future__ import annotations

import errno
import itertools
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


NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
"""What a system says of a file that it has opened and cannot write on; it names no file then."""


@contextmanager
def new_folder(out: Path | None, name: str) -> Iterator[tuple[Path, Path]]:
    """(folder to write to, its final name): a hidden sibling, renamed when the block ends well, removed when not.

    Where another run has taken the name meanwhile, this one goes beside it, and a ConfigError says so."""
    if out is not None and out.exists():
        raise ConfigError(f"{out} exists already; give --out a new name.")
    final = free_name(name) if out is None else out
    check_folder(final)
    final.parent.mkdir(parents=True, exist_ok=True)
    unfinished = final.parent / f".{final.name}-{uuid.uuid4().hex}"
    unfinished.mkdir()
    try:
        yield unfinished, final
        if final.exists():
            beside = _free(final.parent, final.name)
            os.rename(unfinished, beside)
            raise ConfigError(f"{final} has come to exist during the run, which is in {beside} instead.")
        os.rename(unfinished, final)
    except OSError as error:
        if error.filename is None and error.errno in NO_ROOM:
            raise ConfigError(f"{final} cannot be written: {_reason(error)}; nothing of it is kept.") from None
        if not str(error.filename).startswith(str(unfinished)):
            raise
        own = final / Path(error.filename).relative_to(unfinished)
        raise ConfigError(f"{own} cannot be written: {_reason(error)}.") from None
    except ConfigError as error:
        error.args = (str(error).replace(str(unfinished), str(final)),)
        raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def check_folder(folder: Path) -> None:
    """A ConfigError where a folder that need not exist yet can be neither made nor written to."""
    absolute = folder.absolute()
    place = next(path for path in (absolute, *absolute.parents) if path.exists())
    if not place.is_dir():
        here = "that is a file" if place == absolute else f"{place} is a file"
        raise ConfigError(f"A folder {folder} cannot be made: {here}; give --out another place.")
    reason = why_unwritable(place)
    if reason:
        raise ConfigError(f"A folder {folder} cannot be made: {place}: {reason}; give --out another place.")


def why_unwritable(folder: Path) -> str:
    """Why no file can be written to a folder, and '' where one can: found by trying, since root may write anywhere
    that is not written to at all."""
    probe = folder / f".{uuid.uuid4().hex}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        return _reason(error)
    return ""


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def contents(folder: Path) -> str:
    """The names of the files in a folder, and for a folder in it how many it holds."""
    names = []
    for path in sorted(folder.iterdir()):
        if not path.name.startswith("."):
            names.append(f"{path.name}/ ({len(list(path.iterdir()))} files)" if path.is_dir() else path.name)
    return ", ".join(names)


class DeferInterrupt:
    """Ctrl-C within the block waits until its end and is then known as `asked`: what was found is written whole.

    A second one does not wait. Where Ctrl-C is ignored, as by what a script runs in the background, it stays so.
    """

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> DeferInterrupt:
        # Python hands signals to the main thread alone, and lets no other one choose what they do.
        is_main = threading.current_thread() is threading.main_thread()
        self._waits = is_main and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
        if self._waits:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, number: int, frame: Any) -> None:
        if self.asked:
            if callable(self._before):
                self._before(number, frame)
            raise KeyboardInterrupt
        self.asked = True

    def __exit__(self, *exception: object) -> None:
        if self._waits:
            signal.signal(signal.SIGINT, self._before)


def free_name(name: str) -> Path:
    """The next name in RUNS that is not taken."""
    return _free(RUNS, name)


def _free(folder: Path, name: str) -> Path:
    """The next name in a folder that no run has, nor one that is under way (see `new_folder`)."""
    taken = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    names = (f"{name}-{number:03d}" for number in itertools.count(1))
    return folder / next(one for one in names if not any(n == one or n.startswith(f".{one}-") for n in taken))


def write_whole(path: Path, content: bytes | Callable[[Path], Any]) -> None:
    """A file that is complete or not there: written beside its place, brought to the disk, then renamed.

    ConfigError with the name of the file itself where that fails.
    """
    unfinished = path.with_name(f".unfinished-{os.getpid()}-{path.name}")
    try:
        if isinstance(content, bytes):
            unfinished.write_bytes(content)
        else:
            content(unfinished)
        with unfinished.open("r+b") as file:
            os.fsync(file.fileno())
        unfinished.replace(path)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {_reason(error)}.") from None
    finally:
        unfinished.unlink(missing_ok=True)
