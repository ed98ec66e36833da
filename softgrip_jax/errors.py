"""The exceptions of the user's mistakes; apart from the rooms that raise them, so that the command line starts at once.

Whatever else is raised, a plain ValueError of NumPy or JAX included, is a fault of this package and is seen as one: no
room catches it and calls it a mistake of the user's.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """What somebody gives cannot be meant: a value, a name, a question or data, in one sentence for people."""


class ConfigError(InputError):
    """A mistake in a config or on the command line, in one sentence for people that says where it stands."""


@contextmanager
def located(where: str) -> Iterator[None]:
    """An InputError from within becomes a ConfigError that begins with its place; one that has a place keeps it."""
    try:
        yield
    except ConfigError:
        raise
    except InputError as error:
        raise ConfigError(f"{where}: {' '.join(str(error).split())}") from None


class UnitWarning(UserWarning):
    """A number that can be meant, but was probably given in another unit than the SI unit that was asked for."""
