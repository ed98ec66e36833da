"""Tables for people that lose nothing in a narrow terminal.

rich cuts what does not fit, and twelve numbers of a vector become twelve rows of one name. Here the first column, which
says what a row is, is never cut; columns that do not fit beside it follow in a further table with the names again; and
words that are longer than the terminal is wide go on in the next line.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions
from rich.markup import escape
from rich.table import Column
from rich.table import Table as RichTable
from rich.text import Text

NAMES = 0.6
"""Of the width, at most, for the first column: longer names are broken, so that a value fits beside them."""

PHRASE = 20
"""Names of several words stay in one line up to this many letters, longer ones where there is room."""

NUMBER = 26
"""Numbers with their unit, or intervals, up to this many letters stay in one line."""

WORD = 14
"""Text columns get this much at least, and longer words are broken."""

BREAKS = "._=- "
"""Letters after which a long name is broken."""


class Table(RichTable):
    """A rich table with a first column of names, which is printed in as many parts as the width asks for.

    What stands in brackets is text, as in t_m[0], and no markup: style a cell by giving a Text.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RichTable]:
        # A space on each side of every column, and a border around each where there are borders.
        beside, around = (3, 1) if self.box else (2, 0)
        width = options.max_width - around
        least = [self._least(column, k) + beside for k, column in enumerate(self.columns)]
        least[:1] = [min(one, max(int(NAMES * width), 1)) for one in least[:1]]
        for k, part in enumerate(_parts(least, width)):
            most = [_widest(self._lines(self.columns[j])) + beside for j in part]
            widths = _spread([least[j] for j in part], most, width)
            yield self._part(part, [w - beside for w in widths], k > 0)

    def _lines(self, column: Column) -> list[str]:
        """Every line that stands in a column."""
        heading = [column.header] if self.show_header else []
        return [line for cell in [*heading, *column.cells] for line in _plain(cell).split("\n")]

    def _least(self, column: Column, k: int) -> int:
        """The narrowest that a column can be read in."""
        lines = self._lines(column)
        words = _widest(word for line in lines for word in line.split())
        if k == 0:
            return max(words, min(_widest(lines), PHRASE))
        if column.no_wrap:
            return _widest(lines)
        if column.justify != "right":
            return min(words, WORD)
        cells = lines[len(_plain(column.header).split("\n")) if self.show_header else 0 :]
        return max(words, _widest(line for line in cells if cell_len(line) <= NUMBER))

    def _part(self, places: list[int], widths: list[int], continued: bool) -> RichTable:
        """Some of the columns as a table of their own."""
        title = self.title and escape(f"{self.title} (continued)" if continued else str(self.title))
        part = RichTable(
            title=title, title_justify=self.title_justify, show_header=self.show_header, box=self.box, style=self.style
        )
        for j, width in zip(places, widths, strict=True):
            column = self.columns[j]
            part.add_column(_text(column.header), justify=column.justify, width=max(width, 1), overflow="fold")
        columns = [list(self.columns[j].cells) for j in places]
        for row, cells in zip(self.rows, zip(*columns, strict=True), strict=True):
            first, *rest = cells
            part.add_row(_broken(first, widths[0]), *map(_text, rest), style=row.style, end_section=row.end_section)
        return part


def _plain(cell: Any) -> str:
    return cell if isinstance(cell, str) else getattr(cell, "plain", str(cell))


def _text(cell: Any) -> Any:
    return Text(cell) if isinstance(cell, str) else cell


def _widest(texts: Iterable[str]) -> int:
    return max(map(cell_len, texts), default=0)


def _parts(least: list[int], width: int) -> list[list[int]]:
    """Numbers of the columns of every part: the first one in each, and as many others as fit, one at least."""
    parts: list[list[int]] = [[0] if least else []]
    for j in range(1, len(least)):
        if len(parts[-1]) > 1 and sum(least[i] for i in parts[-1]) + least[j] > width:
            parts.append([0])
        parts[-1].append(j)
    return parts


def _spread(least: list[int], most: list[int], width: int) -> list[int]:
    """Widths of columns: each its least, and what is left over to those that want more, in proportion to that."""
    left = width - sum(least)
    if left < 0:  # one column beside the names, and too long for both: it is broken
        return [*least[:-1], max(least[-1] + left, 2)]
    more = [max(high - low, 0) for low, high in zip(least, most, strict=True)]
    share = min(1.0, left / max(sum(more), 1))
    return [low + int(share * one) for low, one in zip(least, more, strict=True)]


def _broken(cell: Any, width: int) -> Any:
    """A long name in lines, broken where its parts meet."""
    text = _plain(cell)
    if not isinstance(cell, str) or _widest(text.split("\n")) <= width:
        return _text(cell)
    lines, line = [], ""
    for letter in text:
        if letter == "\n" or cell_len(line + letter) > width:
            cut = max((line.rfind(mark) for mark in BREAKS), default=-1) + 1
            cut = cut if cut > 0 and letter != "\n" else len(line)
            lines.append(line[:cut])
            line = line[cut:]
        line += "" if letter == "\n" else letter
    return Text("\n".join([*lines, line]))
