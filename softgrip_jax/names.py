"""What `dir()` of a public module shows: its own names, and not those that it was made with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any


def listing(namespace: Mapping[str, Any], *more: str) -> Callable[[], list[str]]:
    """The `__dir__` of a module: `__dir__ = listing(globals())` at its end.

    Its own names are the classes and functions that are defined in it, or in a package below it, and have no underscore
    before them. Constants and modules do not say where they are from: those that are public are named in `more`.
    """
    own = namespace["__name__"]

    def is_own(value: Any) -> bool:
        origin = getattr(value, "__module__", None)
        return isinstance(origin, str) and (origin == own or origin.startswith(f"{own}."))

    def names() -> list[str]:
        return sorted({name for name, value in namespace.items() if name[0] != "_" and is_own(value)} | set(more))

    return names
