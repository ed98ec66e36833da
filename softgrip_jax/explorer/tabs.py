"""What tabs of the explorer are made of: a line that says things, the newest of a working thread, a picture."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

import panel as pn
from bokeh.models import PanTool, ResetTool, SaveTool, WheelZoomTool
from bokeh.plotting import figure

from ..errors import InputError
from ..geometry import Section
from .looks import View, plain_figure
from .page import CSS, Page, fault

READ_SECONDS = 3.0
"""A sentence about something wrong stays so long before progress takes its place."""


@contextmanager
def told(page: Page, end: Callable[[str, bool], None], stopped: str) -> Iterator[None]:
    """Around the work of a thread: how it ended, other than well, is told by end(sentence, whether it is wrong)."""
    try:
        yield
    except KeyboardInterrupt:
        page.later(lambda: end(stopped, False))
    except InputError as error:
        sentence = str(error)
        page.later(lambda: end(sentence, True))
    except Exception as error:  # told to the user: a thread has nobody else to tell
        sentence = fault(error)
        page.later(lambda: end(sentence, True))


class Line:
    """A line that says how far the work is, or what is wrong."""

    def __init__(self) -> None:
        self.pane = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.text = ""
        self.is_wrong = False
        self._read_until = 0.0

    def progress(self, sentence: str) -> None:
        """Say how far the work is, but where people still read what was wrong."""
        if not (self.is_wrong and time.monotonic() < self._read_until):
            self.say(sentence)

    def say(self, sentence: str, is_wrong: bool = False) -> None:
        """Show a sentence."""
        self.text, self.is_wrong, self._read_until = sentence, is_wrong, time.monotonic() + READ_SECONDS
        classes = "sg-told sg-wrong" if is_wrong else "sg-told"
        self.pane.object = f'<div class="{classes}" role="status">{escape(sentence) or "&nbsp;"}</div>'


class Newest:
    """Hands things of a working thread to the page: only the newest, where the page is slower than the work."""

    def __init__(self, page: Page, show: Callable[[Any], None]):
        self._page, self._show = page, show
        self._lock = threading.Lock()
        self._waiting: list[Any] = []

    def put(self, what: Any) -> None:
        """Show this, in place of what was not shown yet."""
        with self._lock:
            is_asked = bool(self._waiting)
            self._waiting = [what]
        if not is_asked:
            self._page.later(self._deliver)

    def _deliver(self) -> None:
        with self._lock:
            found, self._waiting = self._waiting, []
        for what in found:
            self._show(what)


class Shape:
    """The picture of a design, filled again and again."""

    def __init__(self) -> None:
        self.views: list[View] = []
        self._labels: list[str] = []
        self.panel = pn.Column(sizing_mode="stretch_width")

    def show(self, sections: tuple[Section, ...]) -> None:
        """Draw it again."""
        labels = [section.horizontal for section in sections]
        if labels != self._labels:
            self._labels = labels
            self.views = [View(section, False) for section in sections]
            self.panel.objects = [pn.pane.Bokeh(view.figure, sizing_mode="stretch_width") for view in self.views]
            return
        for view, section in zip(self.views, sections, strict=True):
            view.show(section)


def ended(page: Page, stop: Callable[[], None]) -> None:
    """Stop the work of a page whose browser has gone."""
    if page.document is not None:
        page.document.on_session_destroyed(lambda context: stop())


def chart(x_label: str, y_label: str, height: int = 330, **further: Any) -> Any:
    """An empty figure in the look of the page."""
    made: Any = figure(
        tools=[PanTool(), WheelZoomTool(), ResetTool(), SaveTool()],
        active_scroll=None,
        x_axis_label=x_label,
        y_axis_label=y_label,
        sizing_mode="stretch_width",
        height=height,
        min_width=200,
        toolbar_location="above",
        **further,
    )
    plain_figure(made)
    return made


def side_by_side(made: Any) -> Any:
    """A figure that stands beside others where there is room, and beneath them on a telephone."""
    shown = pn.pane.Bokeh(made, sizing_mode="stretch_width")
    return pn.Column(shown, sizing_mode="stretch_width", styles={"flex": "1 1 380px"}, min_width=260)
