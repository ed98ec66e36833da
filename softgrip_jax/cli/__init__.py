"""The command `softgrip`: thin, everything it does is in the other rooms.

Exit codes: 0, done; 1, the question has no answer (the report says why); 2, a mistake in what was typed or in a file,
told in one sentence on stderr; 70, a fault of this package, with Python's lines about it; 130, stopped by Ctrl-C.

The rooms are imported inside the commands, so that `softgrip --help` answers at once.
"""

from __future__ import annotations

import functools
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

import typer

from .. import plugins
from ..commands import programs
from ..errors import DesignWarning, InputError
from ..plausible import units_are_stated
from . import ending, profile
from . import explore as explore
from . import export as export
from . import files as files
from . import report as report
from . import runs as runs
from . import scenes as scenes
from . import verify as verify
from .app import FAULT as FAULT
from .app import MISTAKE as MISTAKE
from .app import NO_ANSWER as NO_ANSWER
from .app import STOPPED as STOPPED
from .app import app as app

ORDER = (
    "new",
    "solve",
    "path",
    "explore",
    "sweep",
    "summary",
    "sensitivity",
    "design",
    "verify",
    "export",
    "calibrate",
    "report",
    "reproduce",
    "schema",
)
"""Of the commands in `softgrip --help`: from the first steps on; others follow."""


@functools.cache
def find_commands() -> None:
    """Add the commands of other packages, and sort them all. One that cannot be imported is named and left out."""
    for name, point in plugins.found(plugins.COMMANDS).items():
        try:
            app.command(name)(point.load())
        except Exception as error:
            print(f"the command {name} cannot be used: {point.value}: {error}", file=sys.stderr)
    places = {name: place for place, name in enumerate(ORDER)}
    app.registered_commands.sort(key=lambda command: places.get(_name(command), len(places)))


def _name(command: Any) -> str:
    return command.name or command.callback.__name__


def run(arguments: Sequence[str]) -> int:
    """The command with these arguments; returns the exit code."""
    if profile.FLAG in arguments:
        with profile.Profile() as measured:
            code = run([word for word in arguments if word != profile.FLAG])
        print(*measured.lines(), sep="\n", file=sys.stderr)
        return code
    find_commands()
    # Every mistake in what was typed is a subclass of typer's own, which has no public name.
    usage_error: Any = typer.BadParameter.__mro__[1]
    try:
        code = app(args=list(arguments) or ["--help"], prog_name="softgrip", standalone_mode=False) or 0
        if code == STOPPED:  # typer makes this of Ctrl-C, without a word
            raise KeyboardInterrupt
        return code
    except usage_error as error:
        command = error.ctx.command_path if error.ctx else "softgrip"
        message = f"{error.format_message().rstrip('.')}; see {command} --help."
    except (InputError, OSError) as error:
        message = str(error)
    except (KeyboardInterrupt, typer.Abort):
        print("stopped.", file=sys.stderr)
        return STOPPED
    print(" ".join(message.split()), file=sys.stderr)
    return MISTAKE


def _in_a_line(message: Any, category: type[Warning], filename: str, lineno: int, line: str | None = None) -> str:
    """A warning for those who typed a command: without a line of ours, where the sentence is for them."""
    if issubclass(category, DesignWarning):
        return f"{message}\n"
    return _as_python_does(message, category, filename, lineno, line)


_as_python_does = warnings.formatwarning


def main() -> NoReturn:
    """Entry point of the console script."""
    programs.settings()
    warnings.formatwarning = _in_a_line
    ending.hear_ctrl_c()
    try:
        with units_are_stated():
            code = run(sys.argv[1:])
    except Exception:
        if ending.heard():
            print("stopped.", file=sys.stderr)
            code = STOPPED
        else:
            traceback.print_exc()
            words = "This is a fault of softgrip_jax and not of what was typed: please report it with the lines above."
            print(words, file=sys.stderr)
            code = FAULT
    ending.leave(code)
