"""The sheet for the bench as PDF, by reportlab: the same blocks as the HTML page, on A4."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from .sheet import Content, Heading, Picture, Rows, Steps, Text, cell_text

MARGIN = 50.0
"""Around the page, points (1/72 inch)."""
SIZE = 8.5
"""Of the letters in tables, points."""
PADDING = 4.0
"""Beside the words of a cell, points."""
TALLEST = 220.0
"""Height of a picture, points: three stand on a page."""
RULE = "#bbbbbb"


def write_pdf(path: Path, title: str, content: Content) -> bool:
    """Write the sheet beside its pictures; returns False, and writes nothing, where reportlab is missing.

    Args:
        path: of the file, in the folder of the pictures.
        title: of the sheet.
        content: its blocks.
    """
    try:
        from reportlab.lib.pagesizes import A4
        from reportlab.lib.styles import getSampleStyleSheet
        from reportlab.platypus import Paragraph, SimpleDocTemplate
    except ImportError:
        return False
    styles = getSampleStyleSheet()
    width, height = A4[0] - 2 * MARGIN, A4[1] - 2 * MARGIN
    story: list[Any] = [Paragraph(escape(latin(title)), styles["Title"])]
    for block in content:
        story += flowables(block, path.parent, styles, width)

    def number(canvas: Any, document: Any) -> None:
        canvas.setFont("Helvetica", 8)
        canvas.drawRightString(MARGIN + width, MARGIN / 2, f"{latin(title)}, page {document.page}")

    document = SimpleDocTemplate(
        str(path),
        pagesize=(width + 2 * MARGIN, height + 2 * MARGIN),
        leftMargin=MARGIN,
        rightMargin=MARGIN,
        topMargin=MARGIN,
        bottomMargin=MARGIN,
        title=title,
        invariant=1,  # the same design gives the same file
    )
    document.build(story, onFirstPage=number, onLaterPages=number)
    return True


def latin(text: str) -> str:
    """The text in the letters that the fonts of every PDF reader have."""
    return text.encode("latin-1", "replace").decode("latin-1")


def flowables(block: Any, folder: Path, styles: Any, width: float) -> list[Any]:
    """What reportlab lays out for one block."""
    from reportlab.lib.utils import ImageReader
    from reportlab.platypus import Image, KeepTogether, ListFlowable, Paragraph, Spacer

    match block:
        case Heading(text):
            return [Paragraph(escape(latin(text)), styles["Heading2"])]  # stays with what follows
        case Text(text, bad):
            words = escape(latin(text))
            return [Paragraph(f'<font color="#bb0000"><b>{words}</b></font>' if bad else words, styles["BodyText"])]
        case Picture(name):
            across, up = ImageReader(str(folder / name)).getSize()
            scale = min(width / across, TALLEST / up)
            return [Spacer(0, 8), Image(str(folder / name), across * scale, up * scale)]
        case Steps(steps):
            words = [Paragraph(escape(latin(step)), styles["BodyText"]) for step in steps]
            return [KeepTogether(ListFlowable(words))]
        case Rows():
            return [Spacer(0, 4), table_of(block, styles, width), Spacer(0, 8)]
    raise TypeError(block)


def widths_of(texts: list[list[str]], width: float) -> list[float]:
    """Of the columns, points: as their longest words need; where the page is narrower, wide columns give way."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    longest = [max(stringWidth(row[k], "Helvetica-Bold", SIZE) for row in texts) for k in range(len(texts[0]))]
    needed = [one + 2 * PADDING + 1 for one in longest]
    if sum(needed) > width:
        # Columns below an equal share keep what they need; the others share the rest in proportion.
        wide = [one > width / len(needed) for one in needed]
        kept = sum(one for one, is_wide in zip(needed, wide, strict=True) if not is_wide)
        share = (width - kept) / (sum(needed) - kept)
        needed = [one * share if is_wide else one for one, is_wide in zip(needed, wide, strict=True)]
    return needed


def table_of(block: Rows, styles: Any, width: float) -> Any:
    """A table that breaks between rows, its header on every page."""
    from reportlab.lib.enums import TA_RIGHT
    from reportlab.lib.styles import ParagraphStyle
    from reportlab.platypus import Paragraph, Table, TableStyle

    left = ParagraphStyle("cell", styles["BodyText"], fontSize=SIZE, leading=1.2 * SIZE, spaceBefore=0)
    right = ParagraphStyle("number", left, alignment=TA_RIGHT)
    texts = [[latin(cell_text(value)) for value in row] for row in [block.header, *block.rows]]
    cells: list[list[Any]] = [[Paragraph(f"<b>{escape(word)}</b>", left) for word in texts[0]]]
    for row, words in zip(block.rows, texts[1:], strict=True):
        aligned = [right if isinstance(value, float) else left for value in row]
        cells.append([Paragraph(escape(word), style) for word, style in zip(words, aligned, strict=True)])
    grid = TableStyle(
        [
            ("GRID", (0, 0), (-1, -1), 0.5, RULE),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
            ("LEFTPADDING", (0, 0), (-1, -1), PADDING),
            ("RIGHTPADDING", (0, 0), (-1, -1), PADDING),
            ("TOPPADDING", (0, 0), (-1, -1), 1.5),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5),
        ]
    )
    return Table(cells, colWidths=widths_of(texts, width), repeatRows=1, hAlign="LEFT", style=grid)
