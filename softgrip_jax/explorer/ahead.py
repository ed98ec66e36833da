"""A process beside the explorer that compiles what the page will need, so that no picture waits for a compiler.

Tracing holds Python's lock and XLA takes all processors, for seconds. This process does both at the lowest priority,
and leaves the program in the folder where commands keep theirs (see `commands.programs`); the explorer reads it there.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, BinaryIO

from ..commands import programs

NICENESS = 19
"""The lowest priority that Unix has."""


class Ahead:
    """The process, which begins with the first program that is asked for and ends with this one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._asked: dict[int, Future[bool]] = {}
        self._count = 0

    def compiled(self, function: Callable[..., Any], args: tuple, options: dict[str, Any]) -> Future[bool]:
        """Whether the program for arguments like these has been kept; False where this process is to compile it."""
        found: Future[bool] = Future()
        try:
            order = pickle.dumps((function.__module__, function.__qualname__, args, options))
        except Exception:  # a scene of the user's own that cannot travel
            found.set_result(False)
            return found
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                self._begin()
            assert self._process is not None
            assert self._process.stdin is not None
            self._count += 1
            self._asked[self._count] = found
            try:
                pickle.dump((self._count, order), self._process.stdin)
                self._process.stdin.flush()
            except OSError:  # it has just ended
                self._asked.pop(self._count)
                found.set_result(False)
        return found

    def _begin(self) -> None:
        self._close()
        self._asked = {}
        order = [sys.executable, "-c", f"from {__name__} import main; main()"]
        self._process = subprocess.Popen(
            order, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, env=os.environ | _paths()
        )
        assert self._process.stdout is not None
        threading.Thread(
            target=self._read, args=(self._process.stdout, self._asked), name="softgrip ahead", daemon=True
        ).start()

    def _read(self, answers: BinaryIO, asked: dict[int, Future[bool]]) -> None:
        with answers, contextlib.suppress(EOFError, pickle.UnpicklingError, OSError):
            while True:
                number, is_kept = pickle.load(answers)
                asked.pop(number).set_result(is_kept)
        with self._lock:
            if self._asked is asked:
                self._close()
            left = [asked.pop(number) for number in list(asked)]
        for future in left:
            future.set_result(False)

    def end(self) -> None:
        """End the process."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            with contextlib.suppress(OSError):  # what it has not read
                self._process.stdin.close()  # type: ignore[union-attr]
            self._process = None


def _paths() -> dict[str, str]:
    """Where this process finds its modules, for one that does not run the same script."""
    return {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}


def main() -> None:
    """Compile what is asked for on standard input, until that ends; each answer is a number and whether it worked."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    answers, orders = os.fdopen(os.dup(1), "wb"), sys.stdin.buffer
    os.dup2(2, 1)  # what a library prints is no answer
    programs.settings()
    lock = threading.Lock()

    def work(number: int, order: bytes) -> None:
        is_kept = True
        try:
            module, name, args, options = pickle.loads(order)
            programs.program(getattr(importlib.import_module(module), name), *args, options=options)(*args)
        except Exception:  # the explorer meets it, too, and tells it
            is_kept = False
        with lock:
            pickle.dump((number, is_kept), answers)
            answers.flush()

    while True:
        try:
            order = pickle.load(orders)
        except EOFError:
            os._exit(0)  # whatever is still being compiled is for nobody
        threading.Thread(target=work, args=order, daemon=True).start()
