"""The state that a config asks for, by a program that is kept for the next command."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from ..compiler import QUICKLY
from .programs import program

if TYPE_CHECKING:
    from ..results import Solution
    from ..scene import Scene


def solving(scene: Scene, asked: dict[str, Any]) -> Callable[[], Solution]:
    """What solves a scene for what is asked of it, as `config.question` says it.

    Its program is compiled, or read, from now on: who solves several scenes asks for all of them first.

    Raises:
        InputError: where the scene cannot be asked that.
    """
    from ..questions import equilibrium_reaching, to_reach, to_solve
    from ..scene import equilibrium

    function: Callable[..., Solution]
    if "pressure" in asked:
        function, given = equilibrium, to_solve(scene, **asked)
    else:
        function, given = equilibrium_reaching, to_reach(scene, **asked)
    return partial(program(function, *given, options=QUICKLY), *given)
