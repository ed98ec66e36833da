"""Tables as people keep them: the rules that readers of measured curves and of designs share."""

from __future__ import annotations

MARKS = ",;\t"
"""What parts the columns."""


def uncommented(text: str) -> list[str]:
    """The lines of a table, empty where they begin with #: each keeps its number.

    Args:
        text: of the file.
    """
    return ["" if line.startswith("#") else line for line in text.splitlines()]
