"""The exceptions of the user's mistakes; apart from the rooms that raise them, so that the command line starts at once.

Whatever else is raised, a plain ValueError of NumPy or JAX included, is a fault of this package and is seen as one: no
room catches it and calls it a mistake of the user's.
"""

from __future__ import annotations

import numbers
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .units import DISPLAY, SI


class InputError(ValueError):
    """What somebody gives cannot be meant: a value, a name, a question or data, in one sentence for people."""


class JoinedRuleError(InputError):
    """Numbers that each keep their own rule, but not one that joins them.

    The sentence has a place, '{b}', for each number, which is given in SI with its kind (a key of units.DISPLAY). It
    reads in SI, as Python takes the numbers; `as_typed` says it in the units of configs.
    """

    def __init__(self, sentence: str, **numbers: tuple[float, str]):
        self.sentence, self.numbers = sentence, numbers
        shown = {name: f"{value:.6g} {SI[kind]}".strip() for name, (value, kind) in numbers.items()}
        super().__init__(sentence.format(**shown))

    def as_typed(self) -> str:
        """The sentence in the units of config keys."""
        shown = {}
        for name, (value, kind) in self.numbers.items():
            label, unit = DISPLAY[kind]
            shown[name] = f"{value / unit:.6g} {label}".strip()
        return self.sentence.format(**shown)


class ConfigError(InputError):
    """A mistake in a config or on the command line, in one sentence for people that says where it stands."""


def require_whole(name: str, value: Any, least: int) -> None:
    """An InputError where what is called `name` is not a whole number from `least` on."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
        raise InputError(f"{name} is {value!r}; it must be a whole number, {least} or more.")


@contextmanager
def located(where: str) -> Iterator[None]:
    """An InputError from within becomes a ConfigError that begins with its place and speaks in the units of configs;
    one that has a place keeps it."""
    try:
        yield
    except ConfigError:
        raise
    except InputError as error:
        sentence = error.as_typed() if isinstance(error, JoinedRuleError) else str(error)
        raise ConfigError(f"{where}: {' '.join(sentence.split())}") from None


class DesignWarning(UserWarning):
    """What people should know of what they gave, in one sentence; it says itself where that stands.

    Examples:
        >>> issubclass(sg.CellRangeWarning, sg.errors.DesignWarning)
        True
    """


class UnitWarning(DesignWarning):
    """A number that can be meant, but was probably given in another unit than SI.

    Examples:
        >>> issubclass(sg.UnitWarning, UserWarning)
        True
    """


class CellRangeWarning(DesignWarning):
    """A finger whose dimensions are outside of what the cell law was fitted to."""
