"""How a command ends: Ctrl-C is heard wherever it falls, and the process leaves without Python's teardown.

Where Ctrl-C falls while XLA compiles, Python raises it as soon as the compiler returns, out of frames that hold what
jaxlib has just made. To free these frames is what ends in a segmentation fault (jaxlib 0.10.1, Python 3.11): seldom at
the end of the `except` clause that caught it, nearly always in the interpreter's teardown, when nanobind, which made
jaxlib's modules, has taken its own tables down (in nb_module_free). So the exception is kept until the end, and the
process leaves before the teardown. By then a command has written and closed all of its files: nothing is lost.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
from typing import Any, NoReturn

AGAIN_SECONDS = 0.05
"""Until Ctrl-C is raised again that fell where Python cannot raise it; the call that it fell into has ended by then."""

_default_hook = sys.unraisablehook
_raised: list[KeyboardInterrupt] = []
"""Every Ctrl-C until now, and with it the frames that it passed through."""


def hear_ctrl_c() -> None:
    """Remember Ctrl-C from now on. A shell's job in the background, which begins with Ctrl-C ignored, ignores it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _note)
        sys.unraisablehook = _raise_again


def heard() -> bool:
    """Whether Ctrl-C was pressed, whatever became of the exception: an import makes an ImportError of it."""
    return bool(_raised)


def _note(number: int, frame: Any) -> NoReturn:
    _raised.append(KeyboardInterrupt())
    raise _raised[-1]


def _raise_again(fault: Any) -> None:
    """Where Ctrl-C falls into a destructor or into a callback of the garbage collector Python drops the exception."""
    if not issubclass(fault.exc_type, KeyboardInterrupt):
        _default_hook(fault)
        return
    timer = threading.Timer(AGAIN_SECONDS, _thread.interrupt_main)
    timer.daemon = True
    timer.start()


def leave(code: int) -> NoReturn:
    """End the process with this exit code once all that was printed has left."""
    for stream in (sys.stdout, sys.stderr):
        # Who reads a part of the output and closes the pipe, as `head` does, has had what was wanted.
        with contextlib.suppress(BrokenPipeError):
            stream.flush()
    os._exit(code)
