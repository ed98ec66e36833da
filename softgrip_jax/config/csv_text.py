"""Tables as people keep them: the rules that readers of measured curves and of designs share."""

from __future__ import annotations

import csv

from ..errors import InputError

MARKS = ",;\t"
"""What parts the columns."""


def uncommented(text: str) -> list[str]:
    """The lines of a table, empty where they begin with #: each keeps its number.

    Args:
        text: of the file.
    """
    return ["" if line.startswith("#") else line for line in text.splitlines()]


SHOWN = 40
"""So many characters of a cell that cannot be read are shown."""


def cells_of(line: str, mark: str) -> list[str]:
    """The cells of one line of a table.

    Args:
        line: of the file.
        mark: what parts the columns.

    Raises:
        InputError: where a quotation mark is not closed on the line, which would take what follows into its cell, or
            a cell is too long for a table.
    """
    reader = csv.reader([line, ""], delimiter=mark)
    try:
        cells = next(reader)
    except csv.Error:
        raise InputError(f"A cell has more than {csv.field_size_limit()} characters; is this a table?") from None
    if reader.line_num > 1:
        opened = " ".join(cells[-1].split())[:SHOWN]
        raise InputError(f"The quotation mark before {opened!r} is not closed on this line; close it, or leave it out.")
    return cells
