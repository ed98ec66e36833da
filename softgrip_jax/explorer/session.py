"""What one browser looks at: a scene with its sliders, what was asked last, the last good answer, pinned designs.

Nothing of a browser is in here. The page calls `move`, `type_in`, `choose` and so on; each returns a sentence where
something is wrong. The page hands `question()` to a thread, which takes the stages of `answer`.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..config.modules import type_name
from ..errors import InputError
from ..plausible import units_are_stated
from ..results import in_units
from ..scene import Scene
from ..units import DISPLAY, kPa, unit_key
from . import answers
from .answers import (
    CurveData,
    Helps,
    State,
    asked_of,
    components,
    curve_of,
    helps_of,
    prepare_state,
    programs,
    state_of,
)
from .code import solving
from .controls import Number, as_config, choices_of, chosen, leaf_index, numbers_of, value_range, with_numbers

PRESSURE = "pressure_kPa"
FIRST_PRESSURE = 15 * kPa
"""Where nothing says another: shells and fingers are well inflated and far from their limits."""
STEP = 1.05
"""A click on an elasticity changes a number by this factor."""
ABOVE_LIMIT = 1.25
"""The slider of the pressure goes to so many times the limit pressure."""
ROUND_LIMIT = (1.05, 2.0)
"""While it ends between so many times the limit it stays as it is: a handle that moves by itself slips away."""


@dataclasses.dataclass(frozen=True)
class Question:
    """A state of the sliders: all that an answer needs."""

    number: int
    scene: Scene
    """With the numbers that it was made with; `values` are those of the sliders."""
    numbers: tuple[Number, ...]
    values: dict[str, float]
    pressure: float | None
    """Pa; None for the task."""
    task: dict[str, float]
    """The observable that is to have a value (SI); {} for what the scene itself is to do."""
    observable: str

    @property
    def form(self) -> Any:
        """What a program is made for: all but the numbers."""
        return jax.tree.structure(self.scene), self.pressure is None, tuple(self.task)


@dataclasses.dataclass(frozen=True)
class Pin:
    """A design that is kept for comparison."""

    name: str
    inputs: dict[str, str]
    """Choices, pressure and numbers, by key."""
    rows: dict[str, str]
    scene: Scene
    curve: CurveData | None
    """None until it is known."""


class Session:
    """One scene that is explored.

    Args:
        scene: what to begin with.
        pressure: gauge pressure, Pa; None for the task.
        task: the observable that is to have a value (SI), as `pressure_for` takes it; {} where the scene itself knows
            what it is to do, if anything.
    """

    def __init__(self, scene: Scene, pressure: float | None = FIRST_PRESSURE, task: dict[str, float] | None = None):
        self.asked = 0
        self.task = task or {}
        self.pins: list[Pin] = []
        self._open(scene, pressure)

    def _open(self, scene: Scene, pressure: float | None) -> None:
        self.scene = scene
        self.good: State | None = None
        """The last answer that has a state; of the scene that is open, as the next three are."""
        self.curve: CurveData | None = None
        self.helps: Helps | None = None
        self.message = ""
        first = FIRST_PRESSURE if pressure is None else pressure
        doc = "gauge pressure in the actuator"
        low, high = value_range(first, "nonnegative", "pressure")
        own = Number(PRESSURE, (), None, "pressure", "nonnegative", doc, first, low, high)
        self.numbers = {number.key: number for number in [own, *numbers_of(scene)]}
        self.values = {key: number.value for key, number in self.numbers.items()}
        self.choices = {choice.key: choice for choice in choices_of(scene)}
        self.own_task = pressure is None
        known = components(scene)
        self.observables = known
        if getattr(self, "observable", None) not in known:
            self.observable = next(iter(known))

    @property
    def has_task(self) -> bool:
        """Whether a pressure can be looked for: of a task that was given, or that the scene itself knows, as a grasp
        with a mass does."""
        if self.task:
            return next(iter(self.task)) in self.scene.prepared().OBSERVABLES
        try:
            self.scene.target()
        except InputError:
            return False
        return True

    def task_words(self) -> str:
        """What the task is."""
        for name, value in self.task.items():
            kind = self.scene.prepared().OBSERVABLES.get(name)
            return f"at the pressure with {name.replace('_', ' ')} {in_units(value, kind)}" if kind else ""
        return "at the pressure that its own task needs"

    # --- what a user does; each returns a sentence where that cannot be -----------------------------------------------

    def move(self, key: str, place: float, shown: Number | None = None) -> str:
        """A slider to a place from 0 to 1. shown: the number with the range that the slider has, where it is not that
        of now: a curve that comes while a hand is on it sets another one."""
        value = (shown or self.numbers[key]).at(min(max(place, 0.0), 1.0))
        self.numbers[key] = self.numbers[key].holding(value)
        return self._set(key, value)

    def type_in(self, key: str, text: str) -> str:
        """A number as typed, in the unit of its key; the range grows where the number is beyond it."""
        try:
            value = self.numbers[key].read(text)
        except InputError as error:
            return str(error)
        self.numbers[key] = self.numbers[key].holding(value)
        return self._set(key, value)

    def nudge(self, key: str, up: bool) -> str:
        """A number by one step up or down."""
        key = PRESSURE if key == "pressure" else key
        value = self.values[key] * (STEP if up else 1 / STEP)
        self.numbers[key] = self.numbers[key].holding(value)
        return self._set(key, value)

    def _set(self, key: str, value: float) -> str:
        try:
            self.values[key] = self.numbers[key].checked(value)
            if key == PRESSURE:
                self.own_task = False
        except InputError as error:
            return str(error)
        return ""

    def set_own_task(self, wanted: bool) -> str:
        """Look for the pressure of the task, or look at a given pressure."""
        if wanted and not self.has_task:
            return f"{type(self.scene).__name__} has no task of its own: it needs a mass, or a force."
        self.own_task = wanted
        return ""

    def choose(self, key: str, option: Any) -> str:
        """Another material, section law, object, ...; numbers that both have stay."""
        try:
            with units_are_stated():
                scene = chosen(self.current(), self.choices[key], option)
        except InputError as error:
            return str(error)
        self.open(scene)
        return ""

    def open(self, scene: Scene, at: float | dict[str, float] | None = None) -> None:
        """Another scene, or the same with other numbers; at: a pressure (Pa) or a task, without it what is now."""
        pressure = None if self.own_task else self.values[PRESSURE]
        if isinstance(at, dict):
            self.task, pressure = at, None
        elif at is not None:
            pressure = at
        ranges = self.numbers
        self._open(scene, pressure)
        if pressure is None and not self.has_task:
            self.own_task = False
        for key, number in self.numbers.items():
            if key in ranges and ranges[key].kind == number.kind:
                kept = dataclasses.replace(number, low=ranges[key].low, high=ranges[key].high)
                self.numbers[key] = kept.holding(number.value)

    def look_at(self, observable: str) -> str:
        """Another observable for the curve and the elasticities."""
        if observable not in self.observables:
            return f"There is no observable {observable!r}; it must be one of {', '.join(self.observables)}."
        self.observable = observable
        return ""

    def pin(self) -> str:
        """Keep the present design for comparison."""
        if self.message:
            return f"Nothing is pinned, because this design is not OK: {self.message}"
        if self.good is None:
            return "Nothing is pinned, because the state is still being computed."
        self.pins.append(self._pinned(f"pin {len(self.pins) + 1}", self.good))
        return ""

    def _pinned(self, name: str, state: State) -> Pin:
        """With the numbers of the state: those of the sliders may be others already."""
        values = {number.key: number.value for number in numbers_of(state.scene)} | {PRESSURE: state.pressure}
        curve = self.curve if self.curve is not None and self.curve.scene is state.scene else None
        inputs = {"scene": self.title()} | {key: str(choice.value) for key, choice in self.choices.items()}
        inputs |= {key: number.shown(values[key]) for key, number in self.numbers.items()}
        return Pin(name, inputs, {row.name: row.text for row in state.rows}, state.scene, curve)

    def unpin(self) -> None:
        """Forget all pinned designs."""
        self.pins = []

    # --- questions and answers ----------------------------------------------------------------------------------------

    def question(self) -> Question:
        """What the sliders ask now."""
        self.asked += 1
        pressure = None if self.own_task else self.values[PRESSURE]
        numbers = tuple(number for number in self.numbers.values() if number.names)
        return Question(self.asked, self.scene, numbers, dict(self.values), pressure, self.task, self.observable)

    def current(self) -> Scene:
        """The scene at the sliders; InputError where its numbers do not go together."""
        return scene_of(self.question())

    def take(self, question: Question, stage: State | CurveData | Helps | str) -> None:
        """A stage of the answer to a question about the scene that is open; a sentence is a message. A state that is
        none leaves the last good one."""
        if question.scene is not self.scene:
            return
        if isinstance(stage, str):
            self.message = stage
        elif isinstance(stage, State):
            self.message = stage.message
            if stage.ok:
                self.good = stage
                if self.own_task:
                    self.numbers[PRESSURE] = self.numbers[PRESSURE].holding(stage.pressure)
                    self.values[PRESSURE] = stage.pressure
        elif isinstance(stage, CurveData):
            self.curve = stage
            for k, pin in enumerate(self.pins):  # pinned before its curve was there
                if pin.curve is None and pin.scene is stage.scene:
                    self.pins[k] = dataclasses.replace(pin, curve=stage)
            if np.isfinite(stage.limit) and stage.limit > 0:
                number = self.numbers[PRESSURE]
                least, most = ROUND_LIMIT
                if not least * stage.limit <= number.high <= most * stage.limit:
                    other = dataclasses.replace(number, low=0.0, high=float(f"{ABOVE_LIMIT * stage.limit:.3g}"))
                    self.numbers[PRESSURE] = other.holding(self.values[PRESSURE])
        else:
            self.helps = stage

    def differences(self) -> tuple[list[str], list[list[str]]]:
        """(heads, rows): in what the pinned designs and the present one differ, and all observables."""
        name = "last state" if self.message else "now"
        designs = self.pins + ([] if self.good is None else [self._pinned(name, self.good)])
        table = []
        for key in dict.fromkeys(key for one in designs for key in one.inputs):
            shown = [one.inputs.get(key, "") for one in designs]
            if len(set(shown)) > 1:
                table.append([key, *shown])
        for name in dict.fromkeys(name for one in designs for name in one.rows):
            table.append([name.replace("_", " "), *(one.rows.get(name, "") for one in designs)])
        return ["", *(one.name for one in designs)], table

    # --- what can be taken along --------------------------------------------------------------------------------------

    def toml(self) -> str:
        """The scene as a config that `softgrip` reads."""
        kinds = self.scene.prepared().OBSERVABLES
        asked = self.task.items() if self.own_task else [("pressure", self.values[PRESSURE])]
        units = {name: (kinds | {"pressure": "pressure"})[name] for name, _ in asked}
        return as_config(self.current(), {unit_key(n, units[n]): v / DISPLAY[units[n]][1] for n, v in asked})

    def python(self) -> str:
        """A program that gives the same state."""
        return solving(self.current(), None if self.own_task else self.values[PRESSURE], self.task)

    def command(self, file: str = "explored.toml") -> str:
        """The command that gives the same from the config."""
        return f"softgrip solve {file}"

    def _require_present(self, scene: Scene | None, name: str) -> None:
        """InputError where a picture or a curve that is to be taken along is not of the numbers of the sliders: its
        file would not say so."""
        known, now = jax.tree.leaves(scene), jax.tree.leaves(self.current())
        if len(known) != len(now) or not all(map(np.array_equal, known, now)):
            raise InputError(f"The {name} of this design is still being computed.")

    def table(self) -> str:
        """The curve as CSV, in the units of configs; InputError where that of the present design is not known."""
        out = io.StringIO()
        self._require_present(None if self.curve is None else self.curve.scene, "curve")
        rows = csv.writer(out, lineterminator="\n")
        if self.curve is not None:
            _, _, kind = self.observables[self.curve.observable]
            rows.writerow([PRESSURE, unit_key(self.curve.observable, kind), "before_limit"])
            unit = DISPLAY[kind][1]
            for p, value, stable in zip(self.curve.pressure, self.curve.value, self.curve.stable, strict=True):
                if np.isfinite(value):
                    rows.writerow([f"{p / kPa:.10g}", f"{value / unit:.10g}", int(stable)])
        return out.getvalue()

    def picture(self, ending: str) -> bytes:
        """The state as a picture file: "png", "svg" or "pdf"; InputError where there is none."""
        from ..plots import draw

        self.current()  # where numbers do not go together this says so
        if self.message:
            raise InputError(f"There is no picture of this design: {self.message}")
        if self.good is None:
            raise InputError("There is no state to draw yet.")
        self._require_present(self.good.scene, "picture")
        out = io.BytesIO()
        draw(self.good.solution).savefig(out, format=ending)
        return out.getvalue()

    def title(self) -> str:
        """The type of the scene."""
        return type_name(type(self.scene))


def scene_of(question: Question) -> Scene:
    """The scene with the numbers of the sliders."""
    return with_numbers(question.scene, list(question.numbers), question.values)


def trace(question: Question) -> None:
    """Have Python do its part of the first answer, so that XLA's is left."""
    with suppress(InputError):  # it will be told as the answer
        programs.traced(*asked_of(scene_of(question), question.pressure, question.task))


def prepare_drawing(question: Question) -> None:
    """Have what draws the first answer compiled, while the answer itself is."""
    with suppress(InputError):
        answers.prepare_drawing(scene_of(question), question.pressure, question.task)


def first_answer(question: Question) -> Iterator[State | str]:
    """The state with its picture, or a sentence where the numbers do not go together."""
    try:
        yield state_of(scene_of(question), question.pressure, question.task)
    except InputError as error:
        yield str(error)


def further_answers(asked: tuple[Question, State]) -> Iterator[CurveData | Helps]:
    """What follows a state: the curve, then what would help."""
    question, state = asked
    scene = state.scene
    yield curve_of(scene, question.observable)
    if state.ok:
        if question.pressure is None:  # a hand on the slider of the pressure asks for what no task has asked yet
            prepare_state(scene, state.pressure)
        numbers = list(question.numbers)
        keys = [number.key for number in numbers]
        yield helps_of(scene, state, question.observable, keys, leaf_index(scene, numbers))
    programs.improve(*asked_of(scene, question.pressure, question.task))


def answer(question: Question) -> Iterator[State | CurveData | Helps | str]:
    """All stages of an answer, one after the other."""
    for stage in first_answer(question):
        yield stage
        if isinstance(stage, State):
            yield from further_answers((question, stage))


def session_of_config(path: Path, name: str | None = None) -> Session:
    """A session that begins with what a config says; ConfigError for anything that is wrong in it."""
    from .. import config as configs
    from ..commands.files import one_scene

    read = one_scene(path, name)
    try:
        asked = configs.question(read)
    except InputError:
        if "solve" in read.tables:
            raise
        # It asks nothing: a sweep, say.
        return Session(read.scene)
    pressure = asked.pop("pressure", None)
    return Session(read.scene, pressure, asked)
