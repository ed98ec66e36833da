"""The page of the explorer: sliders, pictures, curve and bars around a `Session`, filled by a thread of its own."""

from __future__ import annotations

import dataclasses
import importlib
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from html import escape
from io import BytesIO, StringIO
from typing import Any

import panel as pn
import param
from bokeh.models import ColumnDataSource, CustomJS, Slider
from panel.models.plotly import PlotlyPlot

from .. import plugins
from ..errors import InputError
from ..progress import Tell
from ..reasons import Reason
from ..scene import Scene
from ..units import kPa
from .answers import CurveData, Helps, State, part_of
from .controls import Choice, Number
from .latest import Latest
from .looks import CurveView, HelpView, View, space_figure
from .session import PRESSURE, Question, Session, first_answer, further_answers

TABS = "softgrip_jax.explorer_tabs"
"""The group of entry points of further tabs, named by their titles: functions from a `Page` to what Panel shows."""
PAUSE = 0.15
"""Seconds after the last picture, while a hand is on a slider, until all that follows it: the browser draws pictures
first."""
STEPS = 1000
"""Places of a slider."""
TURN = 2 * STEPS
"""From the first place of a slider to its first place with its next range: a place says which range it was meant on."""
SPACE = 350
"""Pixels of the height of the picture in space: as high as one view from the side, which has the place first."""
AS_IS = -1
"""Of the menu of models: the scene as the sliders have it."""
CSS = """
:host, body { font-family: system-ui, sans-serif; color: #1b1b1b; }
.sg-key { font-size: 13px; font-weight: 600; color: #1b1b1b; }
.sg-doc { font-size: 12px; color: #4a4a4a; }
.sg-told { font-size: 14px; min-height: 21px; padding: 4px 8px; border-radius: 4px; }
.sg-told { background: #eef4f8; color: #12384f; }
.sg-wrong { background: #fdecea; color: #8a1c0c; }
table.sg { border-collapse: collapse; font-size: 13px; width: 100%; }
table.sg td, table.sg th { text-align: left; padding: 2px 8px; border-bottom: 1px solid #e3e3e3; vertical-align: top; }
table.sg td.n { font-weight: 600; white-space: nowrap; }
table.sg td.e { color: #4a4a4a; font-size: 12px; }
pre.sg { white-space: pre-wrap; font-size: 12px; background: #f4f4f4; padding: 8px; }
"""
PLACES = """
@media (min-width: 1000px) { .sg-stays { position: sticky; top: 0; } }
@media (max-width: 700px) { .sg-picture { order: -1; } }
"""
"""A picture stays in sight while the sliders below it are moved; on a telephone it comes first."""
READ = """
const {name, scripts} = cb_obj.data;
Promise.all(scripts.flat().map(window.softgrip.library)).then(() => { read.data = {name}; });
"""
"""Reads the scripts of libraries in the browser, and tells when they are there."""


def table_html(head: list[str], rows: list[list[str]], classes: tuple[str, ...] = ("n",)) -> str:
    """A table; nothing in it is taken for HTML."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    top = f"<tr>{top}</tr>" if any(head) else ""
    body = []
    for row in rows:
        cells = [
            f'<td class="{classes[k] if k < len(classes) else ""}">{escape(cell)}</td>' for k, cell in enumerate(row)
        ]
        body.append(f"<tr>{''.join(cells)}</tr>")
    return f'<table class="sg">{top}{"".join(body)}</table>'


def list_html(sentences: Sequence[str]) -> str:
    """Sentences one below the other, or nothing; nothing in them is taken for HTML."""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f'<ul class="sg-doc">{items}</ul>' if items else ""


def place_of(number: Number, value: float) -> float:
    """Where a value (SI) is on a slider, in places."""
    return float(round(STEPS * min(max(number.place(value), 0.0), 1.0)))


class Control:
    """The row of one number: what it means, a slider, a box to type in."""

    def __init__(self, number: Number, value: float, moved: Callable, typed: Callable, later: Callable):
        """moved, typed: called with what a user does. later: acts on models of Bokeh's, as `Page.later`."""
        self._later = later
        self.key = number.key
        self._turn = 0
        self._numbers = [number, number]
        """With the range that the slider has, at its turn; and the range before, that a hand may just have seen."""
        # Bokeh's own: Panel's tells a few milliseconds later.
        self.slider = Slider(
            title=number.key,
            start=0,
            end=STEPS,
            step=1,
            value=place_of(number, value),
            show_value=False,
            tooltips=False,
            sizing_mode="stretch_width",
            margin=(2, 12, 0, 10),
        )
        self.box = pn.widgets.TextInput(
            value=number.shown(value), width=86, margin=(2, 4), placeholder=number.label, name=number.label or "value"
        )
        self._meant = self._meaning(number)
        self.words = pn.pane.HTML(self._meant, stylesheets=[CSS], margin=(0, 10), sizing_mode="stretch_width")
        self._own = False
        self._set: float | None = None
        """Where the page itself has put the slider. Bokeh tells of that only when its whole message is written."""

        def slid(attribute: str, old: Any, new: Any) -> None:  # a browser sends 127, not 127.0
            if new != self._set:
                self._set = None
                turn, place = divmod(new, TURN)
                moved(self, place / STEPS, self._numbers[int(turn)], turn == self._turn)

        def entered(event: Any) -> None:
            if not self._own:
                typed(self, event.new)

        self.slider.on_change("value", slid)
        self.box.param.watch(entered, "value")
        self.row = pn.Column(
            pn.Row(pn.pane.Bokeh(self.slider, sizing_mode="stretch_width"), self.box, sizing_mode="stretch_width"),
            self.words,
            sizing_mode="stretch_width",
            margin=(0, 0, 4, 0),
        )

    @staticmethod
    def _meaning(number: Number) -> str:
        doc = f"{number.doc}; " if number.doc else ""
        ends = f"{number.shown(number.low)} to {number.shown(number.high)} {number.label}"
        return f'<span class="sg-doc">{escape(doc + ends)}</span>'

    def show(
        self, number: Number, value: float, wrong: str = "", with_slider: bool = True, with_box: bool = True
    ) -> None:
        """Show a value without asking again, and what is wrong with it."""
        self._own = True
        try:
            if with_slider:
                self._later(partial(self._slide, number, value))
            if with_box:
                self.box.value = number.shown(value)
        finally:
            self._own = False
        self._meant = self._meaning(number)
        self.say(wrong)

    def _slide(self, number: Number, value: float) -> None:
        """The range and the place on it. Another range has other places, so that a key on its way is known by its own:
        the slider grows to both ranges, goes to its new place, and shrinks."""
        if not number.has_range_of(self._numbers[self._turn]):
            self._turn = 1 - self._turn
        self._numbers[self._turn] = number
        start = self._turn * TURN
        self._set = start + place_of(number, value)
        self.slider.update(start=min(start, self.slider.start), end=max(start + STEPS, self.slider.end))
        self.slider.value = self._set
        self.slider.update(start=start, end=start + STEPS)

    def say(self, sentence: str) -> None:
        """What is wrong with this number, beneath it."""
        wrong = f'<div class="sg-told sg-wrong" role="alert">{escape(sentence)}</div>' if sentence else ""
        if self.words.object != self._meant + wrong:
            self.words.object = self._meant + wrong


@dataclasses.dataclass(frozen=True)
class Words:
    """What is said of a state beside its picture."""

    state: State


@dataclasses.dataclass(frozen=True)
class Together:
    """Answers that the browser is told at once, so that it draws once."""

    stages: tuple[CurveData | Helps, ...]


def _further(asked: tuple[Question, State], are_known: Callable[[], bool]) -> Iterator[Any]:
    """What follows a picture. Once a scene has had its curve and bars they come together: they no longer wait for a
    compiler."""
    yield Words(asked[1])
    if are_known():
        yield Together(tuple(further_answers(asked)))
    else:
        yield from further_answers(asked)


class Page:
    """One browser's page around its own session."""

    def __init__(self, session: Session):
        self.session = session
        self.document = pn.state.curdoc
        self._lock = threading.Lock()
        self._waiting: list[Callable[[], None]] | None = []
        if self.document is not None:
            pn.state.onload(self._loaded)
        self.controls: dict[str, Control] = {}
        self.refused = ""
        """Why what was given last is not asked; what comes meanwhile is of the state before."""
        self._unfilled: set[str] = set()
        self.views: list[View] = []
        self._drawn: State | None = None
        """Whose picture and numbers stand there; of a scene that is open no more, perhaps."""
        self.told = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.rows = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.pictures = pn.Column(sizing_mode="stretch_width", min_height=340)
        self.numbers = pn.Column(sizing_mode="stretch_width")
        self.choices = pn.FlexBox(sizing_mode="stretch_width")
        self.curve = CurveView(self._dragged)
        self.helps = HelpView(self._clicked)
        self.curves: Any = pn.Column(
            pn.pane.Bokeh(self.curve.figure, sizing_mode="stretch_width"), sizing_mode="stretch_width"
        )
        self.bars: Any = pn.Column(
            pn.pane.HTML(
                "<b>What would help</b>: click a bar to move its slider so that the value grows", margin=(4, 10)
            ),
            pn.pane.Bokeh(self.helps.figure, sizing_mode="stretch_width"),
            sizing_mode="stretch_width",
        )
        self.space: Any = pn.Column(sizing_mode="stretch_width", height=SPACE)
        self.observable = pn.widgets.Select(
            name="curve and elasticities of", options=list(session.observables), value=session.observable, width=220
        )
        self.observable.param.watch(self._looked, "value")
        self.task = pn.widgets.Checkbox(value=session.own_task)
        self.task.param.watch(self._task_set, "value")
        self.compared = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.code = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.models = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.model = pn.widgets.Select(name="use the model", options={"as it is": AS_IS}, value=AS_IS, width=240)
        self.after_opening: list[Callable[[], None]] = []
        """Called whenever another scene is shown: its numbers and choices may be others."""
        self._unread: dict[int, tuple[Any, Any]] = {}
        """Tabs that nobody has opened yet, by their place: what makes them, and where that goes."""
        self.tabs = self._tabs()
        self._ladder: list[Any] = []
        self._answered: set[Any] = set()
        """Forms of questions whose programs have run."""
        self._fill_controls()
        self.say("compiling the first picture ...")
        # Two threads: while the first curve is being compiled, which takes seconds, pictures go on.
        self.work: Latest[Question] = Latest(first_answer, self._deliver, self._failed)
        self.further: Latest[tuple[Question, State]] = Latest(
            lambda asked: _further(asked, lambda: None not in (session.curve, session.helps)),
            lambda asked, stage: self._deliver(asked[0], stage),
            lambda asked, error: self._failed(asked[0], error),
            PAUSE,
        )
        self._libraries: set[Any] = set()
        self._wanted: dict[Any, list[Callable[[], None]]] = {}
        self.wanted, self.read_now = ColumnDataSource({"name": [], "scripts": []}), ColumnDataSource({"name": []})
        self.wanted.js_on_change("data", CustomJS(args={"read": self.read_now}, code=READ))
        self.read_now.on_change("data", lambda attribute, old, new: self._library_read(new["name"]))
        self.curve.figure.tags = [self.wanted]  # what nothing of the page refers to does not reach the browser
        self.layout = self._layout()
        self.ask()

    # --- the parts ----------------------------------------------------------------------------------------------------

    def _layout(self) -> Any:
        left = pn.Column(
            self.choices,
            self.task,
            self.numbers,
            sizing_mode="stretch_width",
            styles={"flex": "1 1 300px"},
            min_width=280,
        )
        self.picture_tabs: Any = pn.Tabs(
            ("side", self.pictures), ("space", self.space), sizing_mode="stretch_width", dynamic=False
        )
        self.picture_tabs.param.watch(self._turned, "active")
        middle = pn.Column(
            self.picture_tabs,
            self.rows,
            sizing_mode="stretch_width",
            styles={"flex": "2 1 420px"},
            css_classes=["sg-picture", "sg-stays"],
            min_width=280,
        )
        right = pn.Column(
            self.observable,
            self.curves,
            self.bars,
            sizing_mode="stretch_width",
            styles={"flex": "1 1 320px"},
            css_classes=["sg-stays"],
            min_width=280,
        )
        title = pn.pane.HTML(f"<h1 style='font-size:20px;margin:4px 8px'>{escape(self.session.title())}</h1>")
        self.title = title
        body = pn.FlexBox(
            left, middle, right, sizing_mode="stretch_width", align_items="flex-start", stylesheets=[PLACES]
        )
        page = pn.Column(title, self.told, body, self.tabs, sizing_mode="stretch_width", max_width=1900)
        return page

    def _tabs(self) -> Any:
        pin, unpin = pn.widgets.Button(name="pin this design"), pn.widgets.Button(name="forget all pins")
        pin.on_click(lambda event: self._pin(True))
        unpin.on_click(lambda event: self._pin(False))
        out = [
            pn.widgets.FileDownload(
                callback=partial(self._file, kind), filename=name, label=name, button_type="default"
            )
            for kind, name in (
                ("toml", "explored.toml"),
                ("csv", "curve.csv"),
                ("png", "explored.png"),
                ("svg", "explored.svg"),
                ("py", "explored.py"),
            )
        ]
        compare = pn.widgets.Button(name="compare the models")
        compare.on_click(lambda event: self.in_background(partial(self._compare_models, self.session.question())))
        self.model.param.watch(self._model_chosen, "value")
        tabs = pn.Tabs(
            ("Pins", pn.Column(pn.FlexBox(pin, unpin), self.compared, sizing_mode="stretch_width")),
            ("Out", pn.Column(pn.FlexBox(*out), self.code, sizing_mode="stretch_width")),
            ("Models", pn.Column(pn.FlexBox(compare, self.model), self.models, sizing_mode="stretch_width")),
            sizing_mode="stretch_width",
        )
        for name, point in plugins.found(TABS).items():
            empty = pn.Column(pn.pane.HTML("reading ...", stylesheets=[CSS]), sizing_mode="stretch_width")
            self._unread[len(tabs)] = (point, empty)
            tabs.append((name, empty))
        tabs.param.watch(lambda event: self._turned_to(event.new), "active")
        return tabs

    def _turned_to(self, place: int) -> None:
        self._show_code()
        self.later(self._show_pins)
        if place == 1:  # a picture file is made while the page waits, Matplotlib need not be read then
            self.in_background(lambda tell: importlib.import_module("softgrip_jax.plots"))
        point, empty = self._unread.pop(place, (None, None))
        if point is None or empty is None:
            return

        def work(tell: Tell) -> None:
            made = point.load()

            def shown() -> None:
                empty.objects = [made(self)]

            self.later(shown)

        self.in_background(work)

    def _fill_controls(self) -> None:
        session = self.session
        self.controls = {
            key: Control(number, session.values[key], self._moved, self._typed, self.later)
            for key, number in session.numbers.items()
        }
        self.numbers.objects = [control.row for control in self.controls.values()]
        self.choices.objects = [self._menu(choice) for choice in session.choices.values()]
        self.task.visible = session.has_task
        self.task.name = session.task_words()
        self.task.value = session.own_task
        if list(self.observable.options) != list(session.observables):
            self.observable.param.update(options=list(session.observables), value=session.observable)

    def _menu(self, choice: Choice) -> Any:
        menu = pn.widgets.Select(name=choice.key, options=list(choice.options), value=choice.value, width=150)
        menu.param.watch(lambda event: self._chosen(choice.key, event.new), "value")
        return menu

    # --- what a user does ---------------------------------------------------------------------------------------------

    def ask(self) -> None:
        """Ask for what the sliders say now."""
        question = self.session.question()
        if self._answered and question.form not in self._answered:
            self.say("compiling ...")
            self._grey(True)
            self._show_last_rows()
        self.work.ask(question)

    def _done(self, control: Control, sentence: str) -> None:
        control.say(sentence)
        self.refused = sentence
        if sentence:
            self._grey(True)
            self.say(sentence, True)
            self._show_last_rows()
        else:
            if control.key == PRESSURE and self.task.value:
                self.task.value = False
            self.ask()

    def _moved(self, control: Control, place: float, meant: Number, is_shown: bool) -> None:
        """meant: with the range that a hand saw, which the slider may have no more."""
        sentence = self.session.move(control.key, place, meant)
        if not sentence:
            self._unfilled.add(control.key)
            if not is_shown:
                control.show(self.session.numbers[control.key], self.session.values[control.key], with_box=False)
        self._done(control, sentence)

    def _fill_boxes(self) -> None:
        """What was moved as a number, once its picture is on its way."""
        for key in self._unfilled & set(self.controls):
            self.controls[key].show(self.session.numbers[key], self.session.values[key], with_slider=False)
        self._unfilled.clear()

    def _typed(self, control: Control, text: str) -> None:
        sentence = self.session.type_in(control.key, text)
        if not sentence:
            control.show(self.session.numbers[control.key], self.session.values[control.key], with_box=False)
        self._done(control, sentence)

    def _dragged(self, pressure: float) -> None:
        self._typed_pressure(f"{pressure / kPa:.5g}")

    def _typed_pressure(self, text: str) -> None:
        control = self.controls[PRESSURE]
        sentence = self.session.type_in(PRESSURE, text)
        if not sentence:
            control.show(self.session.numbers[PRESSURE], self.session.values[PRESSURE])
        self._done(control, sentence)

    def _clicked(self, key: str, elasticity: float) -> None:
        if key not in self.session.numbers and key != "pressure":
            self.say(f"{key} is a number of the scene before; these bars are not of the scene that is open.", True)
            return
        sentence = self.session.nudge(key, elasticity > 0)
        key = PRESSURE if key == "pressure" else key
        self.controls[key].show(self.session.numbers[key], self.session.values[key])
        self._done(self.controls[key], sentence)

    def _chosen(self, key: str, option: Any) -> None:
        if self.session.choices.get(key) is None or self.session.choices[key].value == option:
            return
        sentence = self.session.choose(key, option)
        self._after_opening(sentence)

    def _after_opening(self, sentence: str) -> None:
        self._fill_controls()
        for act in self.after_opening:
            act()
        self.title.object = f"<h1 style='font-size:20px;margin:4px 8px'>{escape(self.session.title())}</h1>"
        self.refused = sentence
        if sentence:
            self.say(sentence, True)
            return
        self.say("compiling ...")
        self.later(self._clear)
        self.ask()

    def open_scene(self, scene: Scene, at: float | dict[str, float] | None = None) -> None:
        """Show another scene, or the same with other numbers: a model, the best of a search, a design of a study.
        at: a pressure (Pa) or a task, as `Session` takes it; without it, what is asked now."""
        self.session.open(scene, at)
        self._after_opening("")

    def _looked(self, event: Any) -> None:
        sentence = self.session.look_at(event.new)
        if sentence:
            self.say(sentence, True)
        else:
            self.ask()

    def _task_set(self, event: Any) -> None:
        if event.new == self.session.own_task:
            return
        sentence = self.session.set_own_task(event.new)
        if sentence:
            self.say(sentence, True)
        else:
            self.ask()

    def _pin(self, wanted: bool) -> None:
        if not wanted:
            self.session.unpin()
        elif sentence := self.session.pin():
            self.say(sentence, True)
        self.later(self._show_pins)

    def _turned(self, event: Any) -> None:
        if event.new == 1:
            self.with_library(PlotlyPlot, self._show_space)

    def _file(self, kind: str) -> Any:
        """A file for the browser; where there is none, the page says why, and Panel sends nothing."""
        session = self.session
        try:
            if kind in ("png", "svg"):
                return BytesIO(session.picture(kind))
            return StringIO({"toml": session.toml, "csv": session.table, "py": session.python}[kind]())
        except InputError as error:
            self.say(str(error), True)
            raise param.Skip from None

    # --- models -------------------------------------------------------------------------------------------------------

    def _compare_models(self, question: Question, tell: Tell) -> None:
        from .models import compared, model_words

        found, ladder = compared(question, tell)
        options = {"as it is": AS_IS} | {model_words(k, model): k for k, model in enumerate(ladder)}

        def shown() -> None:
            self._ladder = ladder
            self.models.object = table_html(*found)
            self.model.param.update(options=options, value=AS_IS)
            self.say(f"{len(ladder)} models are compared below.")

        self.later(shown)

    def _model_chosen(self, event: Any) -> None:
        if event.new != AS_IS:
            self.open_scene(self._ladder[event.new].scene)

    # --- libraries of the browser -------------------------------------------------------------------------------------

    def with_library(self, model: Any, act: Callable[[], None]) -> None:
        """Do something with the page once the browser has the scripts of a model of Panel's, which few pages need."""
        if self.document is None or model in self._libraries:
            act()
            return
        self._wanted.setdefault(model, []).append(act)
        names, scripts = [m.__name__ for m in self._wanted], [m.__javascript__ for m in self._wanted]
        self.wanted.data = {"name": names, "scripts": scripts}

    def _library_read(self, names: list[str]) -> None:
        for model in [model for model in self._wanted if model.__name__ in names]:
            self._libraries.add(model)
            for act in self._wanted.pop(model):
                act()

    # --- from other threads -------------------------------------------------------------------------------------------

    def later(self, act: Callable[[], None]) -> None:
        """Do something with the page, from any thread.

        Until the browser has the whole page this waits: what changes while a page is on its way may be lost.
        """
        document = self.document
        if document is None:
            return
        with self._lock:
            if self._waiting is not None:
                self._waiting.append(act)
                return
        document.add_next_tick_callback(partial(_at_once, act))

    def _loaded(self) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting or [], None
        for act in waiting:
            _at_once(act)

    def in_background(self, work: Callable[[Tell], None]) -> threading.Thread:
        """Run work(tell) in a thread of its own; what goes wrong is told."""

        def tell(stage: str, done: int = 0, total: int = 0) -> None:
            words = f"{stage}: {done} of {total}" if total else stage
            self.later(lambda: self.say(words))

        def run() -> None:
            try:
                work(tell)
            except Exception as error:  # told to the user: a thread has nobody else to tell
                sentence = str(error) if isinstance(error, InputError) else fault(error)
                self.later(lambda: self.say(sentence, True))

        thread = threading.Thread(target=run, name="softgrip explorer work", daemon=True)
        thread.start()
        return thread

    def _deliver(self, question: Question, stage: Any) -> None:
        # What else is said of a state waits for no hand while there is none, and for no compiler of curve and bars.
        is_awaited = None in (self.session.good, self.session.curve, self.session.helps)
        self.later(partial(self._show, question, stage))
        if isinstance(stage, State | str):
            self.later(self._fill_boxes)
        if isinstance(stage, State):
            if is_awaited:
                self.later(partial(self._show, question, Words(stage)))
            self.later(partial(self.further.ask, (question, stage)))

    def _failed(self, question: Question, error: Exception) -> None:
        sentence = fault(error)
        self.later(lambda: self.say(sentence, True))

    # --- what is shown ------------------------------------------------------------------------------------------------

    def say(self, sentence: str, is_wrong: bool = False) -> None:
        """The line above the pictures."""
        classes = "sg-told sg-wrong" if is_wrong else "sg-told"
        self.told.object = f'<div class="{classes}" role="status">{escape(sentence) or "&nbsp;"}</div>'

    def _show(self, question: Question, stage: Any) -> None:
        """Take a stage of an answer and show it; what is of a scene that is open no more is dropped."""
        if question.scene is not self.session.scene:
            return
        if isinstance(stage, Together):
            for part in stage.stages:
                self._show(question, part)
            return
        if not isinstance(stage, Words):
            self.session.take(question, stage)
        kind = self.session.observables[question.observable][2]
        if isinstance(stage, str):
            self._grey(True)
            self.say(stage, True)
            self._show_last_rows()
            self._show_pins()
            self._show_code()
        elif isinstance(stage, State):
            self._answered.add(question.form)
            self._show_state(stage)
        elif isinstance(stage, Words):
            self._show_words(stage.state, question, kind)
        elif isinstance(stage, CurveData):
            self.curve.show(stage, kind)
            self.controls[PRESSURE].show(
                self.session.numbers[PRESSURE], self.session.values[PRESSURE], with_box=False
            ) if not self._is_moving(question) else None
            self._show_pins()
        elif isinstance(stage, Helps):
            self.helps.show(stage)

    def _is_moving(self, question: Question) -> bool:
        """Whether something was asked after this question."""
        return question.number != self.session.asked

    def _grey(self, is_grey: bool, has_curve: bool = False) -> None:
        """Whether what is drawn is of another state than what is asked. A browser keeps a look that is left out.

        has_curve: whether the curve is of what is asked, though its point is not: a design without a state has one.
        """
        self.later(partial(self.curve.dim_point, is_grey))
        for part in (self.pictures, self.space, self.rows, self.bars, self.curves):
            is_last = is_grey and not (has_curve and part is self.curves)
            looks = {"opacity": "0.35", "filter": "grayscale(1)"} if is_last else {"opacity": "1", "filter": "none"}
            if part.styles != looks and (is_last or part.styles):
                part.styles = looks

    def _show_state(self, state: State) -> None:
        self._grey(not state.ok or bool(self.refused), has_curve=not self.refused)
        if not state.ok:
            self.say(self.refused or state.message, True)
            self._show_last_rows()  # at once: what follows a picture may wait for a compiler
            return
        self._drawn = state
        if len(state.sections) != len(self.views) or not self.views or self._labels != _labels(state):
            self._labels = _labels(state)
            self.views = [View(section, k == 0) for k, section in enumerate(state.sections)]
            self.pictures.objects = [pn.pane.Bokeh(view.figure, sizing_mode="stretch_width") for view in self.views]
        else:
            for view, section in zip(self.views, state.sections, strict=True):
                view.show(section)
        if self.picture_tabs.active == 1:
            self.with_library(PlotlyPlot, self._show_space)

    def _show_words(self, state: State, question: Question, kind: str) -> None:
        """The numbers of the picture that is shown: of the last good one where this state is none."""
        if state.ok and not self.refused:
            self.say(f"{state.pressure / kPa:.5g} kPa{''.join(map(near_words, state.margins[:1]))}")
        self._show_pins()
        self._show_code()
        shown = state if state.ok else self.session.good
        name, component, _ = self.session.observables[question.observable]
        if shown is None:
            self._show_last_rows()
            return
        self._show_rows(shown, not state.ok or bool(self.refused))
        value = float(part_of(shown.solution.observables, name, component))
        self.curve.show_state(shown.pressure, value, kind)
        if self.session.own_task and state.ok:
            number = self.session.numbers[PRESSURE].holding(state.pressure)
            self.controls[PRESSURE].show(number, state.pressure)

    def _show_last_rows(self) -> None:
        """The numbers of what is drawn, which is not what is asked."""
        if self._drawn is not None:
            self._show_rows(self._drawn, True)

    def _show_rows(self, shown: State, is_last: bool) -> None:
        """The numbers of a state; is_last: which is not what is asked, but was the last."""
        of_last = f" of the last state, at {shown.pressure / kPa:.5g} kPa" if is_last else ""
        self.rows.object = table_html(
            ["", f"value{of_last}", "model error"],
            [[r.name.replace("_", " "), r.text, r.error] for r in shown.rows],
            ("n", "", "e"),
        )

    def _show_space(self) -> None:
        if self.session.good is None:
            return
        try:
            shown = space_figure(self.session.good.solution.mesh(), self.session.good.sections)
            if self.space.objects:
                self.space[0].object = shown
            else:
                self.space.append(pn.pane.Plotly(shown, sizing_mode="stretch_width", height=SPACE))
        except InputError as error:
            self.say(str(error), True)

    def _clear(self) -> None:
        """What is left of the scene before when another one was opened: the pins."""
        self.curve.clear()
        self.helps.show(Helps(self.session.observable, ()))
        self._show_pins()

    def _show_pins(self) -> None:
        kind = self.session.observables[self.session.observable][2]
        curves = [(p.name, p.curve) for p in self.session.pins if p.curve is not None]
        self.curve.show_pins([(n, c) for n, c in curves if c.observable == self.session.observable], kind)
        if self.tabs.active != 0:
            return
        if self.session.pins:
            self.compared.object = table_html(*self.session.differences())
        elif self.compared.object:
            self.compared.object = ""

    def _show_code(self) -> None:
        if self.tabs.active != 1:
            return
        try:
            self.code.object = (
                f'<pre class="sg">{escape(self.session.command())}</pre>'
                f'<pre class="sg">{escape(self.session.python())}</pre>'
                f'<pre class="sg">{escape(self.session.toml())}</pre>'
            )
        except InputError as error:
            self.code.object = f'<div class="sg-told sg-wrong">{escape(str(error))}</div>'


def _at_once(act: Callable[[], None]) -> None:
    """Do something with a page, and tell its browser in one message: it then draws once."""
    with pn.io.hold():
        act()


def near_words(nearest: tuple[str, float]) -> str:
    """Of a state, what its nearest rule leaves, or how far it is from what a law is known for."""
    name, margin = nearest
    reason = Reason[name.upper()]
    return f"; nearest rule {name}: {margin * 1e3:.4g} mm left" if reason.forbids else f"; {reason.text(margin)}"


def fault(error: Exception) -> str:
    """What is said of an error that is no mistake of the user's."""
    return f"This is a fault of softgrip_jax: {type(error).__name__}: {error}"


def _labels(state: State) -> list[str]:
    return [section.horizontal for section in state.sections]


def page_of(make: Callable[[], Session]) -> Any:
    """A page with a session of its own, for one browser."""
    page = Page(make())
    document = pn.state.curdoc
    if document is not None:

        def end(context: Any) -> None:
            page.document = None  # what is still computed is for nobody
            page.work.close()
            page.further.close()

        document.on_session_destroyed(end)
    return page.layout
