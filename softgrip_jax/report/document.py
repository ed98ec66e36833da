"""One self-contained HTML file: tables, pictures and interactive plots in it, nothing from a network.

Interactive plots need Bokeh (pip install 'softgrip_jax[explore]'); without it the tables and pictures are there.
"""

from __future__ import annotations

import base64
import importlib.util
import itertools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

CSS = """
body { font-family: system-ui, sans-serif; color: #1b1b1b; max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin-top: 2rem; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; font-size: 0.85rem; margin: 0.5rem 0; }
td, th { text-align: left; padding: 0.15rem 0.6rem; border-bottom: 1px solid #e3e3e3; vertical-align: top; }
.wide { overflow-x: auto; } pre { background: #f4f4f4; padding: 0.6rem; white-space: pre-wrap; font-size: 0.8rem; }
p, pre { overflow-wrap: anywhere; } figure { margin: 0.5rem 0; } figcaption { margin: 1rem 0 0.5rem; }
pre .drawn { display: block; white-space: pre; overflow-x: auto; }
img { max-width: 100%; } .plot { max-width: 100%; overflow: hidden; }
.note { color: #4a4a4a; font-size: 0.85rem; } .differs td { background: #fff6e0; }
@media print {
  body { max-width: none; margin: 0; } h2 { break-after: avoid; }
  tr, img, figure, .plot, .together { break-inside: avoid; } img { max-height: 23cm; }
  .plot { zoom: 0.68; }
  .wide { overflow: visible; } .wide table { font-size: 0.6rem; } .wide td, .wide th { overflow-wrap: anywhere; }
  .wide td, .wide th { padding: 0.1rem 0.25rem; } pre { font-size: 0.62rem; }
}
"""
NOT_PRINTED = "@media print { :host { display: none !important; } }"
"""For parts of Bokeh's plots, which the style of the page does not reach."""
MOST_ROWS = 60
"""Rows of a table that are shown."""
MOST_POINTS = 5000
"""Points of an interactive plot; of more rows every so many are drawn."""


class Document:
    """A page that is filled from above."""

    def __init__(self, title: str):
        self.title = title
        self._parts: list[str] = []
        self._plots: list[Any] = []

    def heading(self, text: str) -> None:
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def text(self, sentence: str, note: bool = False) -> None:
        look = ' class="note"' if note else ""
        self._parts.append(f"<p{look}>{escape(sentence)}</p>")

    def code(self, text: str) -> None:
        self._parts.append(f"<pre>{escape(text)}</pre>")

    def printed(self, text: str) -> None:
        """What a command has printed; on a narrow screen its tables are scrolled: lines of theirs cannot be broken."""
        groups = itertools.groupby(text.splitlines(), key=lambda line: "\u2500" <= line[:1] <= "\u257f")
        parts = []
        for is_drawn, lines in groups:
            words = escape("\n".join(lines))
            parts.append(f'<span class="drawn">{words}</span>' if is_drawn else f"{words}\n")
        self._parts.append(f"<pre>{''.join(parts)}</pre>")

    def table(self, head: list[str], rows: list[list[Any]], marked: Iterable[int] = ()) -> None:
        """A table of cells; marked rows stand out."""
        top = "".join(f"<th>{escape(str(cell))}</th>" for cell in head)
        body = []
        for k, row in enumerate(rows[:MOST_ROWS]):
            cells = "".join(f"<td>{escape(shown(cell))}</td>" for cell in row)
            look = ' class="differs"' if k in marked else ""
            body.append(f"<tr{look}>{cells}</tr>")
        self._parts.append(f'<div class="wide"><table><tr>{top}</tr>{"".join(body)}</table></div>')
        if len(rows) > MOST_ROWS:
            self.text(f"{MOST_ROWS} of {len(rows)} rows are shown.", note=True)

    @contextmanager
    def together(self) -> Iterator[None]:
        """What is added within the block stays on one sheet of paper."""
        self._parts.append('<div class="together">')
        try:
            yield
        finally:
            self._parts.append("</div>")

    def picture(self, path: Path, caption: str = "") -> None:
        """A PNG of the run, below its caption."""
        data = base64.b64encode(path.read_bytes()).decode()
        words = escape(path.stem.replace("_", " "))
        above = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
        self._parts.append(f'<figure>{above}<img alt="{words}" src="data:image/png;base64,{data}"></figure>')

    def scatter(
        self,
        columns: dict[str, np.ndarray],
        colour_by: np.ndarray | None = None,
        across: str | None = None,
        up: str | None = None,
    ) -> bool:
        """An interactive plot of any column over any other, at first of `up` over `across`, or of the second over the
        first; False where Bokeh is missing or there is nothing."""
        if len(columns) < 2 or importlib.util.find_spec("bokeh") is None:
            return False
        first = across if across in columns else next(iter(columns))
        second = up if up in columns and up != first else next(name for name in columns if name != first)
        self._plots.append(_scatter(columns, colour_by, first, second))
        self._parts.append(f"\0{len(self._plots) - 1}\0")
        return True

    def html(self) -> str:
        """The file."""
        body, scripts = "\n".join(self._parts), ""
        if self._plots:
            from bokeh.embed import components
            from bokeh.resources import INLINE

            script, places = components(self._plots)
            for k, place in enumerate(places):
                body = body.replace(f"\0{k}\0", f'<div class="plot">{place}</div>')
            # Bokeh's own files alone: where Panel was imported it adds addresses of its own.
            scripts = "".join(f"<script>{text}</script>" for text in INLINE.js_raw) + script
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{CSS}</style>{scripts}</head>\n"
            f"<body><h1>{escape(self.title)}</h1>\n{body}\n</body></html>\n"
        )


def shown(value: Any) -> str:
    """A cell as people read it."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


def _scatter(columns: dict[str, np.ndarray], colour_by: np.ndarray | None, first: str, second: str) -> Any:
    """Points, and menus of what is drawn over what; a point without one of the two numbers is not drawn."""
    from bokeh.layouts import column, row
    from bokeh.models import ColumnDataSource, CustomJS, HoverTool, Select
    from bokeh.plotting import figure

    names = list(columns)
    count = len(columns[names[0]])
    kept = slice(None, None, -(-count // MOST_POINTS) or 1)
    # Arrays: in a list a missing number is null, and Bokeh draws null at zero.
    data: dict[str, Any] = {
        name: np.where(np.isfinite(values), values, np.nan)[kept].astype(float) for name, values in columns.items()
    }
    words = ["OK"] * count if colour_by is None else [str(word) for word in colour_by]
    data |= {"x": data[first], "y": data[second], "status": words[kept]}
    data["colour"] = ["#0072B2" if word in ("OK", "True", "") else "#D55E00" for word in data["status"]]
    source = ColumnDataSource(data)
    plot: Any = figure(
        height=360,
        sizing_mode="stretch_width",
        tools="pan,wheel_zoom,box_zoom,reset,save",
        x_axis_label=first,
        y_axis_label=second,
    )
    plot.toolbar.logo = None
    plot.toolbar.stylesheets = [NOT_PRINTED]
    plot.scatter("x", "y", source=source, size=7, color="colour", alpha=0.7)
    tips = [(name, f"@{{{name}}}") for name in names[:12]]
    plot.add_tools(HoverTool(tooltips=[*tips, ("status", "@status")]))
    menus = []
    for axis, title, value in (("x", "across", first), ("y", "up", second)):
        menu = Select(title=title, options=names, value=value, sizing_mode="stretch_width", min_width=80)
        code = f"source.data.{axis} = source.data[menu.value]; label.axis_label = menu.value; source.change.emit();"
        label = plot.xaxis[0] if axis == "x" else plot.yaxis[0]
        menu.js_on_change("value", CustomJS(args={"source": source, "menu": menu, "label": label}, code=code))
        menus.append(menu)
    choice = row(*menus, sizing_mode="stretch_width", stylesheets=[NOT_PRINTED])
    return column(choice, plot, sizing_mode="stretch_width")
