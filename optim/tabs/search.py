"""The tab "Search from here": tick what may move, say what is wanted, and see a batch of designs converge.

It is `optim.search` in a thread of the explorer's process, with an evaluator that shows what it finds.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource

from softgrip_jax.errors import InputError
from softgrip_jax.explorer.answers import state_of, with_unit
from softgrip_jax.explorer.looks import BLUE, VERMILION
from softgrip_jax.explorer.page import CSS, Page, list_html, table_html
from softgrip_jax.explorer.session import PRESSURE
from softgrip_jax.explorer.tabs import Line, Newest, Shape, chart, ended, told
from softgrip_jax.parameters import between
from softgrip_jax.progress import Tell
from softgrip_jax.quantities import LIMIT_MARGIN, LIMIT_PRESSURE, REQUIRED, Quantity
from softgrip_jax.results import in_units
from softgrip_jax.scene import Scene
from softgrip_jax.units import DISPLAY, kPa

from ..design.descent import LOOSELY_FEASIBLE, Design, Evaluated, Evaluator, SearchResult, search
from ..problem import KINDS, Goal, Limits, Problem
from ..records import unsolved
from ..space import Space
from .numbers import SCENE, Ticks, typed, variables

MARGIN = 1.2
"""Of the limit pressure over the pressure, where a margin is kept: the models' own errors are smaller."""
NOTHING = "nothing else"
KEEPS = 2
"""Rows of what is to be kept."""
STARTS, MOST_STARTS = 128, 4096
STEPS = 100
"""As `softgrip design` does."""
POINTS_SECONDS = 0.1
"""Between two pictures of the points: more often nobody sees."""
STEP_SECONDS = 0.025
"""A step takes so long at least. A shell's takes 5 ms, and a search that is over in half a second is not seen."""
SHAPE_SECONDS = 1.0
"""Between two pictures of the best shape, which is solved for it."""
SAME = 1e-9
"""Values of the goal that differ by no more, relative to the largest, are one value."""
UNANSWERED, BREAKING, KEEPING = 0, 1, 2
"""What is known of a design of the batch: no equilibrium; a limit or a rule is broken; all are kept."""
COLOURS = {BREAKING: "#B8860B", KEEPING: BLUE}
MOST_PROGRAMS = 4
"""Kinds of searches whose programs stay in memory."""
PROGRAMS: dict[str, dict[Any, Any]] = {}
"""The programs of the last searches by what they hold: a search that goes on from the best of another one, or asks for
another target, compiles nothing."""


@dataclasses.dataclass(frozen=True)
class SearchRequest:
    """A search that is asked for: the state of the boxes when run was pressed."""

    scene: Scene
    keys: tuple[str, ...]
    goal: str
    observable: str
    kind: str
    target: float | None
    at: Any
    pressure: float | None
    keeps_margin: bool
    starts: int
    variables: tuple[Any, ...]
    kept: tuple[Limits, ...] = ()
    """Bounds of other observables."""

    @property
    def task(self) -> dict[str, float]:
        """The observable that has a value (SI) at every design, as the explorer's states take it."""
        return dict([self.at]) if isinstance(self.at, tuple) else {}

    def problem(self) -> Problem:
        """What `optim.search` takes."""
        at = None if self.observable == LIMIT_PRESSURE else self.at
        goal = Goal(self.goal, Quantity(self.observable, at), target=self.target)
        limits = [Limits(Quantity(LIMIT_MARGIN, self.at), low=MARGIN)] if self.keeps_margin else []
        found = Problem(Space({SCENE: self.scene}, self.variables), [goal], [*limits, *self.kept])
        found.about = self.about()
        if found.about:
            # Which rules are kept is told by the starting design, whose numbers may move and are no part of the words.
            found.about += repr(found.rules)
            found._programs = PROGRAMS.setdefault(found.about, {})
            while len(PROGRAMS) > MOST_PROGRAMS:
                del PROGRAMS[next(iter(PROGRAMS))]
        return found

    def about(self) -> str:
        """All that the compiled programs of a search hold, in words: the scene but for what may move, the bounds, what
        is measured at which state. Nothing where words cannot tell it, for a function of the user's for instance."""
        space = Space({SCENE: self.scene}, self.variables)
        leaves, structure = jax.tree.flatten(space.scenes_at(jnp.zeros(space.size)))
        numbers = [np.asarray(leaf).tolist() for leaf in leaves]
        words = repr((str(structure), numbers, self.variables, self.observable, self.at, self.keeps_margin, self.kept))
        return "" if " at 0x" in words else words


@dataclasses.dataclass(frozen=True)
class Frame:
    """The batch at one moment: SI, a row for each start."""

    x: np.ndarray
    value: np.ndarray
    state: np.ndarray
    """UNANSWERED, BREAKING or KEEPING."""
    best: int
    """The row of the best that is keeping; -1 where none is."""


class Batch:
    """What is known of the designs of a search, step by step.

    Args:
        asked: the search.
        problem: the same as a problem.
    """

    def __init__(self, asked: SearchRequest, problem: Problem):
        self.asked, self.problem = asked, problem
        count, size = asked.starts, problem.space.size
        self.t = np.full((count, size), np.nan)
        self.value = np.full(count, np.nan)
        self.state = np.full(count, UNANSWERED)
        self.best_value, self.best_x = np.nan, np.zeros(0)
        self._goal = problem.quantities.index(problem.goals[0].quantity)
        self._rules = [problem.measured.index(rule) for rule in problem.rules]

    def saw(self, rows: np.ndarray, t: np.ndarray, found: Evaluated) -> None:
        """A step of some of the starts."""
        keeps = np.ones(len(t), bool)
        for place, sign, bound, _ in self.problem.sides:
            keeps &= sign * (found.values[:, place] - bound) <= LOOSELY_FEASIBLE * abs(bound)
        for place in self._rules:
            keeps &= found.values[:, place] >= 0
        answered = found.shortfall == 0
        self.t[rows] = t
        self.value[rows] = np.where(answered, found.values[:, self._goal], np.nan)
        self.state[rows] = np.where(answered, np.where(keeps, KEEPING, BREAKING), UNANSWERED)
        best = self._best()
        if best >= 0 and not self._cost(self.value[best]) >= self._cost(self.best_value):
            self.best_value, self.best_x = self.value[best], self._x(self.t[best])

    def frame(self) -> Frame:
        """A copy for the page."""
        return Frame(self._x(self.t), self.value.copy(), self.state.copy(), self._best())

    def _x(self, t: np.ndarray) -> np.ndarray:
        space = self.problem.space
        return between(t, space.low, space.high, space.is_log)

    def _cost(self, value: Any) -> Any:
        goal = self.problem.goals[0]
        return value if self.asked.goal == "minimise" else -value if goal.target is None else abs(value - goal.target)

    def _best(self) -> int:
        cost = np.where(self.state == KEEPING, self._cost(self.value), np.inf)
        return int(np.argmin(cost)) if np.isfinite(cost).any() else -1


class WatchedEvaluator(Evaluator):
    """An evaluator that shows what it finds to a batch, and ends the search where it is told to."""

    def __init__(self, batch: Batch, stop: threading.Event, problem: Problem, chunk: int):
        super().__init__(problem, chunk)
        self.batch, self.stop = batch, stop

    def __call__(self, t: Any) -> Evaluated:
        if self.stop.is_set():
            raise KeyboardInterrupt
        found = super().__call__(t)
        if self.moving is not None:
            self.batch.saw(self.moving, np.atleast_2d(np.asarray(t, dtype=float)), found)
        return found


class Keep:
    """A row of boxes: another observable that is to be at least, or at most, a value."""

    def __init__(self, tab: SearchTab):
        self.tab = tab
        self.observable = pn.widgets.Select(name="and keep", options=[NOTHING, *tab._observables()], width=180)
        self.side = pn.widgets.Select(name="at", options=["least", "most"], width=90, visible=False)
        self.bound = pn.widgets.TextInput(name="value", width=100, visible=False)
        self.observable.param.watch(lambda event: self._set(), "value")

    def _set(self) -> None:
        self.side.visible = self.bound.visible = self.observable.value != NOTHING
        if self.observable.value != NOTHING:
            label = DISPLAY[self.tab._kind(self.observable.value)][0]
            self.bound.name = f"value ({label})" if label else "value"

    def refill(self) -> None:
        """Another scene may have other observables."""
        known = [NOTHING, *self.tab._observables()]
        if known != list(self.observable.options):
            kept = self.observable.value if self.observable.value in known else NOTHING
            self.observable.param.update(options=known, value=kept)

    def limits(self, at: Any) -> list[Limits]:
        """What is to be kept: one limit, or none; InputError for a bound that is no number."""
        name = self.observable.value
        if name == NOTHING:
            return []
        bound = typed(self.bound.value, self.tab._kind(name), f"The bound of {name.replace('_', ' ')}")
        quantity = Quantity(name, None if name == LIMIT_PRESSURE else at)
        return [Limits(quantity, low=bound) if self.side.value == "least" else Limits(quantity, high=bound)]


class SearchTab:
    """The tab: what is asked, the points, the best shape, what came out.

    Args:
        page: of the explorer.
    """

    def __init__(self, page: Page):
        self.page, self.session = page, page.session
        self.asked: SearchRequest | None = None
        self.problem: Problem | None = None
        self.found: SearchResult | None = None
        self.first: Frame | None = None
        self.frame: Frame | None = None
        """The batch at its first step, and as it is shown now."""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.ticks = Ticks(page, "what may move")
        self.goal = pn.widgets.Select(name="goal", options=list(KINDS), value="maximise", width=120)
        self.observable = pn.widgets.Select(name="of", options=self._observables(), width=180)
        if self.session.own_task and self.session.has_task:  # it fixes what a task asks for: the force of a grasp, say
            self.goal.value, self.observable.value = "minimise", "pressure"
        elif self.session.observable in self.observable.options:
            self.observable.value = self.session.observable
        self.target = pn.widgets.TextInput(name="target", width=100, visible=False)
        self.margin = pn.widgets.Checkbox(name=f"keep a limit margin of {MARGIN:g}", value=True)
        self.keeps = [Keep(self) for _ in range(KEEPS)]
        self.starts = pn.widgets.IntInput(name="starts", value=STARTS, start=1, end=MOST_STARTS, width=90)
        self.run_button = pn.widgets.Button(name="run", button_type="primary", width=80)
        self.stop_button = pn.widgets.Button(name="stop", disabled=True, width=80)
        self.open_button = pn.widgets.Button(name="open best", disabled=True, width=110)
        self.across = pn.widgets.Select(name="points over", options=[], width=200, visible=False)
        self.line = Line()
        self.shape = Shape()
        self.table = pn.pane.HTML("", stylesheets=[CSS], sizing_mode="stretch_width")
        self.points = ColumnDataSource({"x": [], "y": [], "colour": []})
        self.first_points = ColumnDataSource({"x": [], "y": []})
        self.best_point = ColumnDataSource({"x": [], "y": []})
        self.chart = pn.Column(sizing_mode="stretch_width", styles={"flex": "1 1 380px"}, min_width=260)
        self.shape.panel.styles = {"flex": "1 1 380px"}
        self.goal.param.watch(lambda event: self._goal_set(), "value")
        self.observable.param.watch(lambda event: self._goal_set(), "value")
        self.across.param.watch(lambda event: self._chart_again(), "value")
        self.run_button.on_click(lambda event: self.run())
        self.stop_button.on_click(lambda event: self.stop())
        self.open_button.on_click(lambda event: self.open_best())
        page.after_opening.append(self._refill)
        ended(page, self._stop.set)
        wanted = pn.FlexBox(self.goal, self.observable, self.target, self.starts, sizing_mode="stretch_width")
        buttons = pn.FlexBox(self.run_button, self.stop_button, self.open_button, self.across)
        pictures = pn.FlexBox(self.chart, self.shape.panel, sizing_mode="stretch_width", align_items="flex-start")
        self.panel = pn.Column(
            self.ticks.panel,
            wanted,
            pn.FlexBox(*(box for row in self.keeps for box in (row.observable, row.side, row.bound))),
            self.margin,
            buttons,
            self.line.pane,
            pictures,
            self.table,
            sizing_mode="stretch_width",
        )

    # --- what a user does ---------------------------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Whether a search is under way."""
        return self._thread is not None and self._thread.is_alive()

    def run(self) -> None:
        """Begin a search from the state of the sliders."""
        if self.is_running:
            self.line.say("A search runs already; stop it first.", True)
            return
        try:
            self.asked = asked = self.ask()
            self.problem = problem = asked.problem()
        except InputError as error:
            self.line.say(str(error), True)
            return
        self.found, self.first, self.frame = None, None, None
        self._stop.clear()
        self.stop_button.disabled, self.open_button.disabled = False, True
        self.table.object = ""
        self.across.param.update(options=problem.space.names, value=problem.space.names[0], visible=True)
        self.chart.objects = []
        self.line.say(f"compiling {asked.starts} designs at once; the first step comes after it ...")
        self._thread = self.page.in_background(partial(self._search, asked, problem))

    def stop(self) -> None:
        """End the search; the best until then is kept."""
        if self.is_running:
            self._stop.set()
            self.line.say("stopping; the best design until now is kept ...")

    def open_best(self) -> None:
        """Set the sliders to the best design."""
        if self.found is not None and self.asked is not None:
            at = self.asked.task if self.asked.pressure is None else self.asked.pressure
            self.page.open_scene(scene_at(self.found.problem, self.found.best.x), at)

    def ask(self) -> SearchRequest:
        """What the boxes say; InputError for what cannot be meant."""
        session, observable = self.session, self.observable.value
        kind = self._kind(observable)
        target = typed(self.target.value, kind, "The target") if KINDS[self.goal.value].has_target else None
        pressure = None if session.own_task else session.values[PRESSURE]
        at = next(iter(session.task.items()), REQUIRED) if pressure is None else pressure
        if observable == "pressure" and pressure is not None:
            raise InputError("The pressure is that of its slider; tick the box below the menus to search for it.")
        return SearchRequest(
            session.current(),
            tuple(self.ticks.keys),
            self.goal.value,
            observable,
            kind,
            target,
            at,
            pressure,
            self.margin.value,
            self.starts.value,
            tuple(variables(session, self.ticks.keys)),
            tuple(limit for row in self.keeps for limit in row.limits(at)),
        )

    # --- the boxes ----------------------------------------------------------------------------------------------------

    def _observables(self) -> list[str]:
        return [*self.session.observables, *(["pressure"] if self.session.has_task else []), LIMIT_PRESSURE]

    def _kind(self, observable: str) -> str:
        return self.session.observables[observable][2] if observable in self.session.observables else "pressure"

    def _goal_set(self) -> None:
        self.target.visible = KINDS[self.goal.value].has_target
        label = DISPLAY[self._kind(self.observable.value)][0]
        self.target.name = f"target ({label})" if label else "target"

    def _refill(self) -> None:
        known = self._observables()
        if known != list(self.observable.options):
            kept = self.observable.value if self.observable.value in known else known[0]
            self.observable.param.update(options=known, value=kept)
        for row in self.keeps:
            row.refill()

    # --- in the thread of the search ----------------------------------------------------------------------------------

    def _search(self, asked: SearchRequest, problem: Problem, tell: Tell) -> None:
        show, draw, say = (
            Newest(self.page, self._show_frame),
            Newest(self.page, self.shape.show),
            Newest(self.page, self._say),
        )
        began, drawn = time.monotonic(), {"step": 0.0, "points": 0.0, "shape": 0.0, "value": np.nan}
        batch: list[Batch] = []

        def make(problem: Problem, chunk: int) -> Evaluator:
            batch.append(Batch(asked, problem))
            return WatchedEvaluator(batch[0], self._stop, problem, chunk)

        def report(step: int, best: float, feasible: int, moving: int) -> None:
            time.sleep(max(0.0, STEP_SECONDS - (time.monotonic() - drawn["step"])))
            drawn["step"] = now = time.monotonic()
            seen = batch[0]
            if step == 1:  # later they may all have come to one best corner
                check_moves(asked, seen.value)
            if now - drawn["points"] < POINTS_SECONDS and moving and step < STEPS:
                return
            drawn["points"] = now
            show.put(seen.frame())
            value = in_units(seen.best_value, asked.kind) if np.isfinite(seen.best_value) else "none yet"
            say.put(
                f"step {step} of {STEPS}: best {asked.observable.replace('_', ' ')} {value}; "
                f"{feasible} of {asked.starts} have kept all limits, {moving} still move"
            )
            if now - drawn["shape"] > SHAPE_SECONDS and seen.best_x.size and drawn["value"] != seen.best_value:
                drawn["shape"], drawn["value"] = now, seen.best_value
                state = state_of(scene_at(problem, seen.best_x), asked.pressure, asked.task)
                if state.ok:
                    draw.put(state.sections)

        with told(self.page, self._end, "The search was stopped before its first step; there is no best yet."):
            found = search(problem, starts=asked.starts, steps=STEPS, report=report, evaluator=make)
            state = state_of(scene_at(problem, found.best.x), asked.pressure, asked.task)
            sections = state.sections if state.ok else ()
            seconds = time.monotonic() - began
            frame = batch[0].frame()
            self.page.later(lambda: self._show_end(asked, found, frame, sections, seconds))

    # --- what is shown ------------------------------------------------------------------------------------------------

    def _say(self, sentence: str) -> None:
        if not self._stop.is_set() and self.found is None:
            self.line.progress(sentence)

    def _end(self, sentence: str, is_wrong: bool = False) -> None:
        self.stop_button.disabled = True
        self.line.say(sentence, is_wrong)

    def _show_end(self, asked: SearchRequest, found: SearchResult, frame: Frame, sections: Any, seconds: float) -> None:
        self.found, self.frame = found, frame
        best, problem = found.best, found.problem
        self._end(said_of(found, asked, seconds), not best.feasible)
        self.open_button.disabled = False
        if sections:
            self.shape.show(sections)
        self._show_frame(frame)
        rows = [
            [name, in_units(a, kind), in_units(b, kind)]
            for name, kind, a, b in zip(
                problem.space.names, problem.space.kinds, found.reference.x, best.x, strict=True
            )
        ]
        for quantity, kind, a, b in zip(
            problem.quantities, problem.kinds, found.reference.values, best.values, strict=True
        ):
            rows.append([problem.label(quantity), in_units(a, kind), in_units(b, kind)])
        self.table.object = table_html(["", "start", "best"], rows) + list_html(found.remarks)

    def _chart_again(self) -> None:
        """A figure over another variable."""
        if self.asked is None or self.problem is None or self.first is None or self.frame is None:
            return
        asked, space = self.asked, self.problem.space
        place = list(self.across.options).index(self.across.value)
        self._place, self._unit = place, DISPLAY[space.kinds[place]][1]
        made = chart(
            with_unit(self.across.value, space.kinds[place]),
            with_unit(asked.observable, asked.kind),
            x_axis_type="log" if space.is_log[place] else "linear",
            x_range=(space.low[place] / self._unit, space.high[place] / self._unit),
        )
        self.first_points.data = dict(zip("xy", self._places(self.first), strict=True))
        self._fill(self.frame)
        made.scatter("x", "y", source=self.first_points, size=5, color="#C4C4C4")
        made.scatter("x", "y", source=self.points, size=6, color="colour", alpha=0.6)
        made.scatter("x", "y", source=self.best_point, size=14, marker="star", color=VERMILION)
        words = pn.pane.HTML(
            '<span class="sg-doc">grey: the first step; blue: keeps all limits and rules; ochre: breaks one; star: '
            "the best now. A design without equilibrium is not drawn.</span>",
            stylesheets=[CSS],
            sizing_mode="stretch_width",
        )
        self.chart.objects = [pn.pane.Bokeh(made, sizing_mode="stretch_width"), words]

    def _show_frame(self, frame: Frame) -> None:
        self.frame = frame
        if self.first is None:
            self.first = frame
            self._chart_again()
        else:
            self._fill(frame)

    def _places(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the designs that have a value, in the units of the axes."""
        assert self.asked is not None
        shown = np.isfinite(frame.value)
        return frame.x[shown, self._place] / self._unit, frame.value[shown] / DISPLAY[self.asked.kind][1]

    def _fill(self, frame: Frame) -> None:
        assert self.asked is not None
        x, y = self._places(frame)
        states = frame.state[np.isfinite(frame.value)]
        self.points.data = {"x": x, "y": y, "colour": [COLOURS[int(k)] for k in states]}
        x, y = frame.x[:, self._place] / self._unit, frame.value / DISPLAY[self.asked.kind][1]
        best = [frame.best] if frame.best >= 0 else []
        where: Any = {"x": x[best], "y": y[best]}
        if self.found is not None and self.found.best.answered:
            goal = self.found.problem.quantities.index(self.found.problem.goals[0].quantity)
            value = self.found.best.values[goal] / DISPLAY[self.asked.kind][1]
            where = {"x": [self.found.best.x[self._place] / self._unit], "y": [value]}
        self.best_point.data = where


def scene_at(problem: Problem, x: np.ndarray) -> Scene:
    """The scene of a design at SI values."""
    return problem.space.scenes_at(jnp.asarray(x))[SCENE]


def check_moves(asked: SearchRequest, values: np.ndarray) -> None:
    """InputError where the goal is the same at all designs of a batch: no search improves it."""
    known = values[np.isfinite(values)]
    if known.size > 1 and np.ptp(known) <= SAME * np.max(np.abs(known)):
        value = f"{asked.observable.replace('_', ' ')} is {in_units(known[0], asked.kind)}"
        if asked.pressure is None:
            raise InputError(
                f"{value} at the pressure that the task needs, whatever is ticked; choose another goal, the pressure "
                "for instance, or untick the box below the menus and search at one pressure."
            )
        raise InputError(f"{value}, and nothing that is ticked changes it; tick other numbers or choose another goal.")


def said_of(found: SearchResult, asked: SearchRequest, seconds: float) -> str:
    """What came out of a search, in sentences."""
    best, problem = found.best, found.problem
    goal = problem.quantities.index(problem.goals[0].quantity)

    def value(design: Design) -> str:
        return in_units(design.values[goal], asked.kind) if np.isfinite(design.values[goal]) else "no answer"

    where = "" if asked.pressure is None else f" at {asked.pressure / kPa:.5g} kPa"
    words = [
        f"{asked.observable.replace('_', ' ')}{where}: {value(best)}; at the start it was {value(found.reference)}."
    ]
    if not best.answered:
        words = [f"No design has an answer: {'; '.join(unsolved(best)) or 'none was found'}."]
    elif not best.feasible:
        words.insert(0, f"No design keeps every limit and rule; the nearest breaks one by {best.violation:.2g} of it.")
    if best.active:
        words.append(f"It is held by {', '.join(best.active)}.")
    ending = "Stopped, and not finished," if found.stopped else "Done"
    words.append(f"{ending} after {seconds:.1f} s and {found.solves:,} designs.")
    return " ".join(words)


def search_tab(page: Page) -> Any:
    """What Panel shows in the tab."""
    return SearchTab(page).panel
