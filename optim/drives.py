"""What the designs of a search do by the other of the two laws that push a finger.

The thesis's chambers and the cell law differ by a factor of about four (`softgrip_jax.pneunet.drives`). A search that
uses one of them reports its designs by the other, too; with `drive = "both"` its constraints hold by both.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from softgrip_jax.commands.programs import QUICKLY, program
from softgrip_jax.errors import CellRangeWarning, InputError
from softgrip_jax.pneunet.drives import remarks, with_other_drive
from softgrip_jax.quantities import AT_REST, LIMIT_MARGIN, Quantity, QuantitySet
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Status, in_units

from .problem import Goal, Limits, Problem
from .rules import without_rules
from .space import Space, Variable

SUFFIX = "_other"
"""Of the scenes that `drive = "both"` adds: blocked and blocked_other."""

BOTH = (
    f'Every constraint and rule holds by both drives; scenes that end in "{SUFFIX}" have the other one of their finger.'
)


class Beside(NamedTuple):
    """Quantities by the other drive."""

    quantities: list[Quantity]
    kinds: list[str]
    drives: list[str]
    """Of every quantity."""
    values: np.ndarray
    """SI, one row per design; NaN where there is no such state."""
    reasons: list[list[str]]
    """Of every design, in words, for its states that are not there."""
    remarks: list[str]

    def rows(self, problem: Problem) -> list[tuple[str, list[str]]]:
        """(label, values of the designs in words) of every quantity."""
        return [
            (f"{problem.label(q)}, drive {drive}", [in_units(v, kind) for v in column])
            for q, kind, drive, column in zip(self.quantities, self.kinds, self.drives, self.values.T, strict=True)
        ]


def by_other_drive(problem: Problem, x: Sequence[Any]) -> Beside | None:
    """The quantities of a problem's fingers by their other drive, at SI values of designs; None where there are none,
    and where the problem has both drives already."""
    scenes = problem.space.scenes
    if any(_is_twin(scenes, name) for name in scenes):
        return None
    others = {name: other for name, scene in scenes.items() if (other := with_other_drive(scene)) is not None}
    asked = [
        q
        for q in problem.quantities
        if q.scene in others and q.at not in (None, AT_REST) and q.along is None and q.observable != LIMIT_MARGIN
    ]
    if not asked:
        return None
    asked_set = QuantitySet(scenes, asked)

    def other_values(x):
        moved = without_rules(problem.space.scenes_at(x))
        changed = {name: with_other_drive(scene) if name in others else scene for name, scene in moved.items()}
        return asked_set.measure(changed)

    rows, batched = jnp.stack([jnp.asarray(row) for row in x]), jax.jit(jax.vmap(other_values))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)  # it is among the remarks
        kept = program(batched, rows, about=problem.about, options=QUICKLY) if problem.about else batched
        found = jax.tree.map(np.asarray, kept(rows))
    drives = [others[q.scene].drive for q in asked_set.quantities]
    best = problem.scenes_at(x[-1])
    said = dict.fromkeys(sentence for name in others for sentence in remarks(best[name]))
    labels = asked_set.state_labels()
    reasons = [
        [
            f"{label}: {Reason(int(reason)).text(float(detail))}"
            for label, status, reason, detail in zip(labels, *of_design, strict=True)
            if status != Status.OK
        ]
        for of_design in zip(found.statuses, found.reasons, found.details, strict=True)
    ]
    return Beside(asked_set.quantities, asked_set.kinds, drives, found.values, reasons, list(said))


def _is_twin(scenes: dict[str, Any], name: str) -> bool:
    """Whether a scene is one that `by_both_drives` has added."""
    other = with_other_drive(scenes.get(name.removesuffix(SUFFIX)))
    return name.endswith(SUFFIX) and other is not None and getattr(scenes[name], "drive", None) == other.drive


def by_both_drives(
    space: Space, goals: Sequence[Goal], limits: Sequence[Limits]
) -> tuple[Space, list[Limits], list[Quantity]]:
    """A space with a second scene for each of a finger, by its other drive and moved by the same variables; the limits,
    those of fingers for both of them; and what the goals are about by the other drive, to be reported.

    Raises:
        InputError: where no scene has the choice.
    """
    others = {name: other for name, scene in space.scenes.items() if (other := with_other_drive(scene)) is not None}
    taken = [name + SUFFIX for name in others if name + SUFFIX in space.scenes]
    if taken:
        raise InputError(f'drive is "both" and adds a scene {taken[0]!r}; there is one already: give it another name.')
    if not others:
        kinds = ", ".join(sorted({type(scene).__name__ for scene in space.scenes.values()}))
        raise InputError(f'drive is "both", but no scene is a finger pushed by "thesis" or "cell": there is {kinds}.')

    def tied(variable: Variable) -> Variable:
        """A variable of one scene is that of its twin, too."""
        names = []
        for name in variable.name.split(" = "):
            scene, _, rest = name.partition(".")
            if len(space.scenes) == 1 and scene not in space.scenes:
                scene, rest = next(iter(space.scenes)), name
            names += [f"{scene}.{rest}", *([f"{scene}{SUFFIX}.{rest}"] if scene in others else [])]
        return dataclasses.replace(variable, name=" = ".join(names))

    def twin(quantity: Quantity) -> Quantity:
        whole = dataclasses.replace(quantity, scene=quantity.scene + SUFFIX)
        # Of a curve along the finger its state is what must exist.
        return whole if quantity.along is None else dataclasses.replace(whole, observable="pressure", along=None)

    twins = [dataclasses.replace(c, quantity=twin(c.quantity)) for c in limits if c.quantity.scene in others]
    reported = [twin(goal.quantity) for goal in goals if goal.quantity.scene in others]
    scenes = space.scenes | {name + SUFFIX: other for name, other in others.items()}
    return Space(scenes, [tied(variable) for variable in space.variables]), [*limits, *twins], reported
