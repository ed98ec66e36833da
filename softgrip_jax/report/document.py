"""One self-contained HTML file: tables, pictures and interactive plots in it, nothing from a network.

Interactive plots need Bokeh (pip install 'softgrip_jax[explore]'); without it the tables and pictures are there.
"""

from __future__ import annotations

import base64
import importlib.util
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

CSS = """
body { font-family: system-ui, sans-serif; color: #1b1b1b; max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; font-size: 0.85rem; margin: 0.5rem 0; }
td, th { text-align: left; padding: 0.15rem 0.6rem; border-bottom: 1px solid #e3e3e3; vertical-align: top; }
.wide { overflow-x: auto; } pre { background: #f4f4f4; padding: 0.6rem; white-space: pre-wrap; font-size: 0.8rem; }
img { max-width: 100%; } .note { color: #4a4a4a; font-size: 0.85rem; } .differs td { background: #fff6e0; }
@media print {
  body { max-width: none; margin: 0; } h2 { break-after: avoid; } tr, img, figure, .plot { break-inside: avoid; }
  .wide { overflow: visible; } .wide table { font-size: 0.6rem; } .wide td, .wide th { overflow-wrap: anywhere; }
  .wide td, .wide th { padding: 0.1rem 0.25rem; } .bk-toolbar { display: none; }
  pre { font-size: 0.62rem; } select { border: none; appearance: none; }
}
"""
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

    def picture(self, path: Path) -> None:
        """A PNG of the run."""
        data = base64.b64encode(path.read_bytes()).decode()
        words = escape(path.stem.replace("_", " "))
        self._parts.append(f'<figure><img alt="{words}" src="data:image/png;base64,{data}"></figure>')

    def scatter(self, columns: dict[str, np.ndarray], colour_by: np.ndarray | None = None) -> bool:
        """An interactive plot of any column over any other; False where Bokeh is missing or there is nothing."""
        if len(columns) < 2 or importlib.util.find_spec("bokeh") is None:
            return False
        self._plots.append(_scatter(columns, colour_by))
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


def _scatter(columns: dict[str, np.ndarray], colour_by: np.ndarray | None) -> Any:
    from bokeh.layouts import column, row
    from bokeh.models import ColumnDataSource, CustomJS, HoverTool, Select
    from bokeh.plotting import figure

    names = list(columns)
    count = len(columns[names[0]])
    kept = slice(None, None, -(-count // MOST_POINTS) or 1)
    data = {name: [None if not np.isfinite(v) else float(v) for v in values[kept]] for name, values in columns.items()}
    first, second = names[0], names[1]
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
    plot.scatter("x", "y", source=source, size=7, color="colour", alpha=0.7)
    tips = [(name, f"@{{{name}}}") for name in names[:12]]
    plot.add_tools(HoverTool(tooltips=[*tips, ("status", "@status")]))
    menus = []
    for axis, title, value in (("x", "across", first), ("y", "up", second)):
        menu = Select(title=title, options=names, value=value)
        code = f"source.data.{axis} = source.data[menu.value]; label.axis_label = menu.value; source.change.emit();"
        label = plot.xaxis[0] if axis == "x" else plot.yaxis[0]
        menu.js_on_change("value", CustomJS(args={"source": source, "menu": menu, "label": label}, code=code))
        menus.append(menu)
    return column(row(*menus), plot, sizing_mode="stretch_width")
