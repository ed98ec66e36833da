"""What is wrong with a config, in one sentence: what was found and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from ..errors import ConfigError


def pick(name: Any, options: dict[str, Any], place: str) -> Any:
    if isinstance(name, str) and name in options:
        return options[name]
    close = difflib.get_close_matches(str(name), options, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"it must be one of {', '.join(map(repr, options))}."
    raise ConfigError(f"{place} is {shown(name)}; {hint}")


def unknown(what: str, name: str, allowed: Iterable[str]) -> str:
    allowed = list(allowed)
    close = closest(name, allowed)
    if close:
        return f"there is no {what}; did you mean {close}?"
    return f"there is no {what}; allowed are {', '.join(allowed)}." if allowed else f"there is no {what}."


def closest(name: str, allowed: list[str]) -> str | None:
    """What was meant by a name that is not allowed. 'a_mm' for 'shell.a_mm', 'radius' and 'radius_cm' for 'radius_mm':
    the same name in a part, then the same quantity in another unit, come before similar spelling."""
    inside = [key for key in allowed if "." in key and key.rpartition(".")[2] == name.rpartition(".")[2]]
    same = [key for key in allowed if key.split("_")[0] == name.split("_")[0] and key.startswith(_stem(name))]
    return next(iter(inside or same or difflib.get_close_matches(name, allowed, 1)), None)


def _stem(name: str) -> str:
    return name.rsplit("_", 1)[0]


def shown(value: Any) -> str:
    """A value as it stands in a config, cut where it is long."""
    text = {True: "true", False: "false"}.get(value, "") if isinstance(value, bool) else repr(value)
    text = f"{value:.12g}" if isinstance(value, float) else text
    text = "a table" if isinstance(value, dict) else text
    return text if len(text) <= 60 else text[:57] + "..."
