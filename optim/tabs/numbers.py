"""What search and calibration have in common: numbers to be ticked, with the ends of their sliders as bounds."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import panel as pn

from softgrip_jax.errors import InputError
from softgrip_jax.explorer.controls import NUMBER, Number
from softgrip_jax.explorer.page import CSS, Page
from softgrip_jax.explorer.session import Session
from softgrip_jax.units import DISPLAY

from ..space import Variable

SCENE = "scene"
"""What the one scene of a page is called in a search or a fit."""
WRAPPED = ".bk-input-group { flex-wrap: wrap; }"
"""Boxes beside each other go on in the next line, as words do."""


def movable(session: Session) -> dict[str, list[Number]]:
    """What may move, by its key: the one number of it, or those of an array, which move together."""
    found: dict[str, list[Number]] = {}
    for number in session.numbers.values():
        if number.names:  # the pressure belongs to the question, not to the scene
            found.setdefault(number.key.partition("[")[0], []).append(number)
    return found


def variables(session: Session, keys: Iterable[str]) -> list[Variable]:
    """The ticked numbers as variables between the ends of their sliders; InputError where there is none."""
    known = movable(session)
    found = []
    for key in keys:
        if key not in known:
            raise InputError(f"The scene has no number {key!r} any more; tick others.")
        own = known[key]
        low, high = min(number.low for number in own), max(number.high for number in own)
        scale = "log" if all(number.is_log for number in own) else "linear"
        found.append(Variable(".".join(own[0].names), low, high, scale, kind=own[0].kind))
    if not found:
        raise InputError("Nothing may move; tick at least one number.")
    return found


def typed(text: str, kind: str, what: str) -> float:
    """A number as typed, in the unit that people read, as SI; InputError where it is none."""
    label, unit = DISPLAY[kind]
    given = text.strip().replace("\N{MINUS SIGN}", "-").removesuffix(label).strip()
    if not NUMBER.fullmatch(given):
        raise InputError(f"{what} is {text!r}; it must be a finite number{f' in {label}' if label else ''}.")
    return float(given) * unit


class Ticks:
    """Boxes of the numbers that may move, and beneath them the ranges of the ticked ones."""

    def __init__(self, page: Page, title: str):
        self.session = page.session
        self.boxes = pn.widgets.CheckBoxGroup(
            options=list(movable(self.session)),
            inline=True,
            name=title,
            sizing_mode="stretch_width",
            stylesheets=[WRAPPED],
        )
        self.ranges = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.boxes.param.watch(lambda event: self.show_ranges(), "value")
        page.after_opening.append(self.refill)
        head = pn.pane.HTML(f"<b>{escape(title)}</b>", margin=(4, 10, 0, 10))
        self.panel = pn.Column(head, self.boxes, self.ranges, sizing_mode="stretch_width")

    @property
    def keys(self) -> list[str]:
        """What is ticked."""
        return list(self.boxes.value)

    def refill(self) -> None:
        """Another scene may have other numbers; what it has, too, stays ticked."""
        known = list(movable(self.session))
        if known != list(self.boxes.options):
            self.boxes.param.update(options=known, value=[key for key in self.boxes.value if key in known])
        self.show_ranges()

    def show_ranges(self) -> None:
        """The bounds, which are those of the sliders."""
        known = movable(self.session)
        words = []
        for key in self.keys:
            own = known[key]
            low, high = min(number.low for number in own), max(number.high for number in own)
            words.append(f"{key} from {own[0].shown(low)} to {own[0].shown(high)}")
        text = "between the ends of the sliders: " + "; ".join(words) if words else ""
        self.ranges.object = f'<span class="sg-doc">{escape(text)}</span>'
