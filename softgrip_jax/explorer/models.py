"""The models of a scene, each solved: what it leaves out, what it says, and how far that is from the dearest."""

from __future__ import annotations

import numpy as np

from ..fidelity import LadderModel
from ..progress import Tell
from ..questions import pressure_for, solve
from ..results import Status, in_units
from .session import PRESSURE, Session


def compared(session: Session, tell: Tell) -> tuple[tuple[list[str], list[list[str]]], list[LadderModel]]:
    """((heads, rows) of a table, the models, cheapest first), at the state of the sliders."""
    ladder = session.ladder()
    name, component, kind = session.observables[session.observable]
    values = []
    for k, model in enumerate(ladder):
        tell("models solved", k, len(ladder))
        if session.own_task:
            found = pressure_for(model.scene, **session.task)
        else:
            found = solve(model.scene, session.values[PRESSURE])
        good = int(found.status) == Status.OK
        value = np.asarray(found.observables[name])
        values.append(float(value if component is None else value[component]) if good else np.nan)
    rows = []
    for k, (model, value) in enumerate(zip(ladder, values, strict=True)):
        change = "" if value == values[-1] else f"{100 * (value / values[-1] - 1):+.3g} %"
        left_out = " and ".join(model.left_out) or "nothing"
        rows.append([str(k + 1), left_out, model.numerics, f"{model.cost:.3g}", in_units(value, kind), change])
    head = ["", "left out", "numerics", "time", session.observable.replace("_", " "), "beside the dearest"]
    return (head, rows), ladder


def model_words(k: int, model: LadderModel) -> str:
    """A line of the menu: '4: 6 points along the finger, without stretch of the cover'."""
    without = f", without {' and '.join(model.left_out)}" if model.left_out else ""
    return f"{k + 1}: {model.numerics}{without}"
