"""The sheet that goes to the bench with an exported design: what stands in it, and the HTML page of it.

The content is a list of blocks. It is written as HTML here, without anything from outside, and as PDF in `pdf`.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

from . import solids
from .checks import Check
from .parts import Export
from .rules import ManufactureTable
from .solids import Number


class Heading(NamedTuple):
    """Of a section."""

    text: str


class Text(NamedTuple):
    """A paragraph; `bad` where it tells of a mistake."""

    text: str
    bad: bool = False


class Rows(NamedTuple):
    """A table; floats are numbers and stand on the right."""

    header: Sequence[str]
    rows: Sequence[Sequence[object]]


class Picture(NamedTuple):
    """A picture by the name of its file, which stands beside the sheet."""

    name: str


class Steps(NamedTuple):
    """A numbered list."""

    steps: Sequence[str]


class Expected(NamedTuple):
    """What the model says of a design, in words."""

    rows: Sequence[Sequence[str]]
    """(quantity, its value by each law)."""
    header: Sequence[str] = ("quantity", "value")
    sentences: Sequence[str] = ()
    """Below the table: what must be known of these values."""


Content = Sequence[Heading | Text | Rows | Picture | Steps]

STYLE = """body{font:15px/1.45 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.6em 0 1.4em}td,th{border:1px solid #bbb;padding:.25em .6em;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}img{max-width:100%}.bad{color:#b00;font-weight:bold}
@media print{body{margin:0}}"""

STEPS = {
    "shell": (
        "Print the tray and the lid of the membrane's mould, the frame and the ring.",
        "Mix parts A and B, draw the air out, pour the tray full, press the lid on its pins: what is too much leaves "
        "by the holes.",
        "Cut the sprues off the rim after curing; pull the lid up and the membrane out.",
        "Lay the bead into the groove of the frame, screw the ring on, glue the air tube into the port.",
    ),
    "finger": (
        "Print tray and lid of the body's mould, the tray of the base layer, clamp and end cap.",
        "Mix parts A and B, draw the air out, pour the body's tray full, press the lid with its cores on the pins: air "
        "and what is too much leave by the holes over the side walls.",
        "Pour the tray of the base layer and level it with a straight edge.",
        "After curing pull the lid straight off, then the body out of its tray; cut the sprues off.",
        "Bond the open side of the body to the base layer with a thin film of fresh silicone; keep the channel free.",
        "Push the foot into the clamp and the nipple of the end cap into the channel, screw both together, glue in the "
        "tube.",
    ),
}


def silicone(export: Export, table: ManufactureTable) -> list[tuple[str, float, float, float, float]]:
    """(part, volume in cm^3, its mass, part A, part B) of every pour, masses in g; A and B with what is spare. All of
    one finger."""
    rows = []
    for piece in export.pieces:
        if piece.made == "cast":
            mass = piece.volume / 1000 * table.density_g_per_cm3
            mixed = mass * (1 + table.spare_percent / 100)
            share = table.parts_a_to_b / (1 + table.parts_a_to_b)
            rows.append((piece.name, piece.volume / 1000, mass, mixed * share, mixed * (1 - share)))
    return rows


def silicone_of_all(export: Export, table: ManufactureTable) -> str:
    """How often the silicone of one finger is needed, and what that is in all."""
    if export.fingers == 1:
        return "The masses are of one piece each."
    rows = silicone(export, table)
    part_a, part_b = export.fingers * sum(row[3] for row in rows), export.fingers * sum(row[4] for row in rows)
    return (
        f"The masses are of one piece each; the {export.fingers} fingers need {export.fingers} of each, {part_a:.1f} g "
        f"of A and {part_b:.1f} g of B in all."
    )


def sheet(
    export: Export,
    table: ManufactureTable,
    checks: Sequence[Check],
    expected: Expected,
    pictures: Sequence[str],
    scale: Number,
) -> Content:
    """What stands in the sheet; `expected` is what the model says of the design, `pictures` are names of files."""
    printed = [(one, "part", 1.0) for one in export.pieces if one.made == "printed"]
    printed += [(one, f"mould of the {mould.casts}", scale) for mould in export.moulds for one in mould.pieces]

    def size(solid: Any, factor: Number) -> str:
        return " x ".join(f"{factor * length:.5g}" for length in solids.extent(solid))

    sizes = [(one.name, what, size(one.solid, by), one.volume * by**3 / 1000) for one, what, by in printed]
    thick = [check for check in checks if check.unit == "mm"]
    others = [check for check in checks if check.unit != "mm"]
    bad = [check for check in checks if not check.good]
    verdict = f"All {len(checks)} checks hold." if not bad else f"{len(bad)} of {len(checks)} checks fail."
    return [
        Text(verdict, bool(bad)),
        Rows(("dimension", "value"), list(export.facts.items())),
        *(Picture(name) for name in pictures),
        Heading("Silicone"),
        Rows(
            ("pour", "volume (cm^3)", "mass (g)", "part A to weigh (g)", "part B to weigh (g)"), silicone(export, table)
        ),
        Text(
            f"{silicone_of_all(export, table)} Density {table.density_g_per_cm3:g} g/cm^3; "
            f"{table.spare_percent:g} % is added for cups and holes. "
            f"Moulds are larger by {100 * (scale - 1):.3g} % for a shrinkage of {table.shrinkage_percent:g} %."
        ),
        Heading("To print"),
        Rows(("piece", "for", "size (mm)", "volume (cm^3)"), sizes),
        *([Heading("Steps"), Steps(STEPS[export.kind])] if export.moulds else []),
        Heading("What the model expects"),
        Rows(expected.header, expected.rows),
        *map(Text, expected.sentences),
        Heading("Thicknesses, measured in the solids"),
        Rows(
            ("where", "part", "asked (mm)", "measured (mm)"),
            [(c.what, c.piece, float(c.expected), float(c.found)) for c in thick],
        ),
        Heading("Checks"),
        Rows(
            ("check", "of", "expected", "found", "allowed difference", "holds"),
            [
                (c.what, c.piece, float(c.expected), float(c.found), float(c.allowed), "yes" if c.good else "NO")
                for c in others
            ],
        ),
    ]


KIND = ("", ' class="n"')
"""Of a cell with words, and of one with a number."""


def cell_text(value: object) -> str:
    """A cell of a table, as both sheets write it."""
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def as_html(title: str, content: Content) -> str:
    """The page."""
    return "\n".join(
        [
            f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style>",
            f"<h1>{escape(title)}</h1>",
            *(_html(block) for block in content),
            "</html>",
        ]
    )


def _html(block: Heading | Text | Rows | Picture | Steps) -> str:
    match block:
        case Heading(text):
            return f"<h2>{escape(text)}</h2>"
        case Text(text, bad):
            return f"<p{' class=bad' if bad else ''}>{escape(text)}</p>"
        case Picture(name):
            return f'<p><img src="{escape(name)}" alt=""></p>'
        case Steps(steps):
            return "<ol>" + "".join(f"<li>{escape(step)}</li>" for step in steps) + "</ol>"
        case Rows(header, rows):
            head = "".join(f"<th>{escape(word)}</th>" for word in header)
            body = "".join(f"<tr>{''.join(map(_html_cell, row))}</tr>" for row in rows)
            return f"<table><tr>{head}</tr>{body}</table>"


def _html_cell(value: object) -> str:
    return f"<td{KIND[isinstance(value, float)]}>{escape(cell_text(value))}</td>"
