"""`softgrip reproduce`: every number and trend of the thesis beside ours, as a table, pictures and a page.

A folder comes of it: reproduction.md, reproduction.csv and images/reproduction_*.png.
"""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from ..folders import contents, new_folder, write_whole
from ..progress import stages
from ..tables import Table
from ..thesis.rows import Row, Verdict

PAGE = "reproduction.md"
STYLES = {
    Verdict.REPRODUCED: "green",
    Verdict.EXPLAINED: "cyan",
    Verdict.NOT_IN_TEXT: "dim",
    Verdict.DIFFERS: "bold red",
}


def run_reproduce(out: Path | None, console: Console, as_json: bool = False) -> int:
    """Recompute everything, write the folder and report; returns how many rows differ without a reason.

    Ctrl-C keeps the rows that are done, in the folder and in the report, and is raised again. What was compiled is kept
    by JAX's cache, so that the next run is soon as far.
    """
    from ..thesis import cell, cell_rows, finger_rows, fingers, pictures, shells

    rows: list[Row] = []
    drawn: list[tuple[str, str]] = []
    about_cell = ""
    began, stopped = time.monotonic(), False
    with new_folder(out, "reproduction") as (folder, final):
        (folder / "images").mkdir()
        with stages(Console(stderr=True)) as tell:
            try:
                tell("the shell: a dozen seconds")
                found_shells = shells.compute()
                rows += shells.rows(found_shells)
                tell("fingers and grippers: a few minutes the first time, most of it compilation")
                found_fingers = fingers.compute(tell)
                rows += finger_rows.rows(found_fingers)
                by_cell = cell.compute(found_fingers, tell)
                rows = cell_rows.beside(rows, found_fingers, by_cell)
                about_cell = cell_rows.text(by_cell)
                tell("pictures")
                for name, caption, figure in pictures.pictures(found_shells, found_fingers, by_cell):
                    figure.savefig(folder / "images" / f"reproduction_{name}.png")
                    drawn.append((name, caption))
            except KeyboardInterrupt:
                if not rows:
                    raise
                stopped = True
        note = f"{STOPPED}\n\n" if stopped else ""
        write_whole(folder / PAGE, page(rows, drawn, note + shells.tilt_text(found_shells), about_cell).encode())
        write_whole(folder / "reproduction.csv", table_of(rows).encode())
    if as_json:
        plain = [row._asdict() | {"verdict": row.verdict.value} for row in rows]
        print(json.dumps(plain, indent=2, ensure_ascii=False))
    else:
        report(rows, console)
        spent = time.monotonic() - began
        console.print(f"The comparison, {spent:.0f} s of work, is in {final}: {contents(final)}.", soft_wrap=True)
    if stopped:
        raise KeyboardInterrupt
    return counts(rows)[Verdict.DIFFERS]


STOPPED = "The run was stopped: these are the rows and pictures until then."


def counts(rows: Sequence[Row]) -> dict[Verdict, int]:
    return {verdict: sum(row.verdict is verdict for row in rows) for verdict in Verdict}


def count_text(rows: Sequence[Row]) -> str:
    """The last line of the report."""
    parts = [f"{n} {verdict.value}" for verdict, n in counts(rows).items() if n or verdict is not Verdict.DIFFERS]
    return f"{len(rows)} numbers and statements: {', '.join(parts)}."


def report(rows: Sequence[Row], console: Console) -> None:
    """The comparison as a table for people."""
    table = Table(title="The thesis and this package", title_justify="left")
    for name in ("source", "what", "printed", "ours", "deviation", "verdict"):
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row[:5], row.verdict.value, style=STYLES[row.verdict])
        if row.reason:
            table.add_row("", Text(row.reason, style="dim"))
    console.print(table)
    if by_cell := beside(rows):
        table = Table(title=CELL_TITLE, title_justify="left")
        for name in CELL_COLUMNS:
            table.add_column(name, overflow="fold")
        for row in by_cell:
            table.add_row(*cells(row))
            if row.cell_remark:
                table.add_row("", Text(row.cell_remark, style="dim"))
        console.print(table)
    console.print(count_text(rows), soft_wrap=True)


CELL_TITLE = "The same fingers by the cell law"
CELL_COLUMNS = ("source", "what", "printed", "by the thesis's chambers", "by the cell law", "ratio")


def beside(rows: Sequence[Row]) -> list[Row]:
    """The rows about which the cell law says something."""
    return [row for row in rows if row.cell]


def cells(row: Row) -> tuple[str, ...]:
    """A row of the table of the cell law, without its remark."""
    return row.source, row.quantity, row.printed, row.ours, row.cell, row.ratio


def table_of(rows: Sequence[Row]) -> str:
    """The comparison as CSV."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(Row._fields)
    writer.writerows(row._replace(verdict=row.verdict.value) for row in rows)
    return text.getvalue()


def page(rows: Sequence[Row], drawn: Sequence[tuple[str, str]], tilt_text: str, about_cell: str = "") -> str:
    """The comparison as a page of the documentation; `about_cell` says what the table of the cell law means."""
    lines = [
        "# The thesis, recomputed",
        "",
        "Every number and trend that the text and the tables of *Analytical Modeling of Pneumatic Soft Grippers Based "
        "on "
        "Finite-Strain Membrane and Beam Theories* print, beside what this package computes from the same equations "
        "(for fingers: with the section law as printed). Written by `softgrip reproduce`; do not edit by hand.",
        "",
        f"**{count_text(rows)}**",
        "",
        *(f"- *{verdict.value}*: {MEANINGS[verdict]}" for verdict, n in counts(rows).items() if n),
        "",
        "| source | what | printed | ours | deviation | verdict | reason |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_line(*row[:5], row.verdict.value, row.reason) for row in rows]
    lines += ["", tilt_text, ""]
    if by_cell := beside(rows):
        lines += [f"## {CELL_TITLE}", "", about_cell, "", _line(*CELL_COLUMNS, "remark"), "|---" * 7 + "|"]
        lines += [*(_line(*cells(row), row.cell_remark) for row in by_cell), ""]
    lines += ["## Pictures", ""]
    for name, caption in drawn:
        lines += [f"![{caption}](images/reproduction_{name}.png)", "", caption, ""]
    return "\n".join(lines)


def _line(*columns: str) -> str:
    """A line of a table."""
    return "| " + " | ".join(column.replace("|", "\\|") for column in columns) + " |"


MEANINGS = {
    Verdict.REPRODUCED: "within one unit of the last printed digit (the thesis cuts some numbers and rounds others), "
    "or a statement that holds for what we computed",
    Verdict.EXPLAINED: "further away, for a reason that was itself computed",
    Verdict.NOT_IN_TEXT: "the text leaves out what the number depends on, or it was measured and the data are only in "
    "a figure",
    Verdict.DIFFERS: "further away; where we know why, it is said",
}
