"""The models of a scene, each solved: what it leaves out, what it says, and how far that is from the dearest."""

from __future__ import annotations

import numpy as np

from ..fidelity import LadderModel, model_ladder
from ..progress import Tell
from ..questions import pressure_for, solve
from ..results import Status, in_units
from .answers import components
from .session import Question, scene_of


def compared(question: Question, tell: Tell) -> tuple[tuple[list[str], list[list[str]]], list[LadderModel]]:
    """((heads, rows) of a table, the models, cheapest first), at a state of the sliders."""
    name, component, kind = components(question.scene)[question.observable]
    ladder = model_ladder(scene_of(question), [name])
    values, words = [], []
    for k, model in enumerate(ladder):
        tell("models solved", k, len(ladder))
        if question.pressure is None:
            found = pressure_for(model.scene, **question.task)
        else:
            found = solve(model.scene, question.pressure)
        status = Status(int(found.status))
        good = status is Status.OK
        value = np.asarray(found.observables[name])
        values.append(float(value if component is None else value[component]) if good else np.nan)
        words.append(in_units(values[-1], kind) if good else f"{status.name}: {found.reason_text()}")
    rows = []
    for k, (model, value, text) in enumerate(zip(ladder, values, words, strict=True)):
        has_none = value == values[-1] or values[-1] == 0 or np.isnan(value + values[-1])
        change = "" if has_none else f"{100 * (value / values[-1] - 1):+.3g} %"
        left_out = " and ".join(model.left_out) or "nothing"
        rows.append([str(k + 1), left_out, model.numerics, f"{model.cost:.3g}", text, change])
    head = ["", "left out", "numerics", "time", question.observable.replace("_", " "), "beside the dearest"]
    return (head, rows), ladder


def model_words(k: int, model: LadderModel) -> str:
    """A line of the menu: '4: 6 points along the finger, without stretch of the cover'."""
    without = f", without {' and '.join(model.left_out)}" if model.left_out else ""
    return f"{k + 1}: {model.numerics}{without}"
