"""Only the newest question is answered: those that came in while another was computed, but one, are never looked at."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

T = TypeVar("T")
PATIENCE = 4
"""Pauses that a stream of questions may hold up an answer."""


class Latest(Generic[T]):
    """A thread that answers the newest of many questions in stages, and gives an answer up when a newer one is there.

    answer: gives the stages of an answer one after the other. deliver: takes each stage, in that thread. failed: takes
    an exception of either. pause: seconds that have to pass without a newer question; PATIENCE times that is enough.
    """

    def __init__(
        self,
        answer: Callable[[T], Iterator[Any]],
        deliver: Callable[[T, Any], None],
        failed: Callable[[T, Exception], None],
        pause: float = 0.0,
    ):
        self._answer, self._deliver, self._failed, self._pause = answer, deliver, failed, pause
        self._news = threading.Condition()
        self._next: list[T] = []
        self._asked = 0
        self._open = True
        self._busy = False
        self.given_up = self.never_begun = 0
        """How many answers were given up, and how many questions were replaced before they were begun."""
        self._thread = threading.Thread(target=self._run, name="softgrip explore", daemon=True)
        self._thread.start()

    def ask(self, question: T) -> None:
        """Ask; a question that waits is replaced."""
        with self._news:
            self.never_begun += len(self._next)
            self._next = [question]
            self._asked += 1
            self._news.notify_all()

    def close(self) -> None:
        """End the thread once its stage is done."""
        with self._news:
            self._open, self._next = False, []
            self._news.notify_all()

    def settle(self, seconds: float) -> bool:
        """Wait until nothing is asked and nothing computed; False where that takes longer."""
        with self._news:
            return self._news.wait_for(lambda: not (self._next or self._busy), seconds)

    def _wait_for_quiet(self) -> None:
        latest = time.monotonic() + PATIENCE * self._pause
        quiet = False
        while self._open and not quiet and time.monotonic() < latest:
            asked = self._asked
            quiet = not self._news.wait_for(lambda n=asked: not self._open or self._asked > n, self._pause)

    def _run(self) -> None:
        while True:
            with self._news:
                self._busy = False
                self._news.notify_all()
                self._news.wait_for(lambda: self._next or not self._open)
                self._wait_for_quiet()
                if not self._open:
                    return
                question, self._next, self._busy = self._next.pop(), [], True
            try:
                for stage in self._answer(question):
                    self._deliver(question, stage)
                    if self._next or not self._open:
                        self.given_up += 1
                        break
            except Exception as error:  # told to the user: the thread goes on with the next question
                self._failed(question, error)
