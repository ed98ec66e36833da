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
import numpy as np

from softgrip_jax.commands.programs import program
from softgrip_jax.compiler import QUICKLY
from softgrip_jax.errors import CellRangeWarning, InputError
from softgrip_jax.numerics.xla import traced_once
from softgrip_jax.pneunet.cell.law import range_remarks
from softgrip_jax.pneunet.drives import remarks, with_other_drive
from softgrip_jax.quantities import AT_REST, LIMIT_MARGIN, Observed, Quantity, QuantitySet, all_rules, rules_at_rest
from softgrip_jax.questions import solve
from softgrip_jax.reasons import Reason
from softgrip_jax.results import Status, in_units

from .problem import Goal, Limits, Problem
from .space import Space, Variable

SUFFIX = "_other"
"""Of the scenes that `drive = "both"` adds: blocked and blocked_other."""

BOTH = (
    f'Every constraint and rule holds by both drives; scenes that end in "{SUFFIX}" have the other one of their finger.'
)


class Beside(NamedTuple):
    """Quantities by the other drive. Where a design has no state at a pressure by that drive, the quantities there come
    once more, at a lower pressure at which all of the designs have one; but not the points of a shape, which is to be
    followed at its own pressure."""

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
        """(label, values of the designs in words) of every quantity but the points of shapes."""
        return [
            (f"{problem.label(q)}, drive {drive}", [in_units(v, kind) for v in column])
            for q, kind, drive, column in zip(self.quantities, self.kinds, self.drives, self.values.T, strict=True)
            if q.along is None
        ]

    def of_goals(self, goals: Sequence[Goal]) -> list[tuple[str, list[Goal], np.ndarray]]:
        """(drive, those of the goals whose quantity is known by it, their values with a row per design), per drive."""
        places = [(self.quantities.index(g.quantity), g) for g in goals if g.quantity in self.quantities]
        found = []
        for drive in dict.fromkeys(self.drives[place] for place, _ in places):
            own = [(place, goal) for place, goal in places if self.drives[place] == drive]
            found.append((drive, [goal for _, goal in own], self.values[:, [place for place, _ in own]]))
        return found

    def compared(self, quantity: Quantity) -> tuple[Quantity, str, np.ndarray] | None:
        """A quantity at a pressure at which all designs have a state by the other drive, that drive, and its values."""
        known = zip(self.quantities, self.drives, self.values.T, strict=True)
        same = [it for it in known if (it[0].scene, it[0].observable) == (quantity.scene, quantity.observable)]
        return same[-1] if same else None  # those at lower pressures come last


class OtherDrive(NamedTuple):
    """What is asked of a problem's fingers by their other drive, and the program that answers."""

    scenes: dict[str, Any]
    """Those that have another drive, by it."""
    asked: QuantitySet
    pressures: np.ndarray
    """Of its states; NaN where one is sought, and of what has no state: a limit pressure."""
    program: Any
    """(rows of SI values, pressures) -> what was asked of each. Pressures are data: it serves for lower ones, too."""
    designs: int
    """Rows of a call."""


def other_drive(problem: Problem, designs: int) -> OtherDrive | None:
    """What `by_other_drive` needs for up to so many designs: a command has it compiled while it searches. None where
    there are no fingers, and where the problem has both drives already."""
    scenes = problem.space.scenes
    if any(_is_twin(scenes, name) for name in scenes):
        return None
    others = {name: other for name, scene in scenes.items() if (other := with_other_drive(scene)) is not None}
    quantities = [
        q
        for q in problem.quantities
        if q.scene in others and q.at != AT_REST and q.observable != LIMIT_MARGIN
        if _has(others[q.scene], q)
    ]
    if not quantities:
        return None
    asked = QuantitySet(scenes, quantities)
    given = np.array([np.nan if isinstance(at, str | tuple) else at for _, at in asked.states], dtype=float)

    def other_values(x, pressures):
        moved = problem.scenes_at(x)
        changed = {name: with_other_drive(scene) if name in others else scene for name, scene in moved.items()}
        known = {
            state: solve(changed[state[0]], p)
            for state, p in zip(asked.states, pressures, strict=True)
            if state[1] is not None and not isinstance(state[1], str | tuple)
        }
        return asked.measure(changed, solutions=known)

    kept = traced_once(jax.vmap(other_values, in_axes=(0, None)))
    if problem.about:
        rows = np.repeat(np.asarray(problem.space.reference)[None], designs, axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CellRangeWarning)  # it is among the remarks
            kept = program(kept, rows, given, about=problem.about, options=QUICKLY)
    return OtherDrive(others, asked, given, kept, designs)


def by_other_drive(problem: Problem, x: Sequence[Any], other: OtherDrive | None = None) -> Beside | None:
    """The quantities of a problem's fingers by their other drive, at SI values of designs: the start, the best one, and
    others; None where there are none, and where the problem has both drives already.

    other: `other_drive` for as many designs or more; for those that there are by itself.
    """
    other = other or other_drive(problem, len(x))
    if other is None:
        return None
    scenes, others, asked_set, given = problem.space.scenes, other.scenes, other.asked, other.pressures
    rows = np.stack([*x, *[x[-1]] * (other.designs - len(x))])

    def at(pressures: np.ndarray) -> Observed:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CellRangeWarning)
            return jax.tree.map(lambda v: np.asarray(v)[: len(x)], other.program(rows, pressures))

    found = at(given)
    shared = shared_pressures(given, found)
    lower = np.flatnonzero(shared < given)
    of_lower = [k for k, of in enumerate(asked_set.state_of) if of in lower and asked_set.quantities[k].along is None]
    again = at(shared) if of_lower else found
    lowered = [dataclasses.replace(asked_set.quantities[k], at=float(shared[asked_set.state_of[k]])) for k in of_lower]
    # Several pressures of one scene may come down to the same one.
    at_lower = QuantitySet(scenes, lowered)
    columns = [of_lower[lowered.index(q)] for q in at_lower.quantities]
    states = [asked_set.state_of[of_lower[[q.state for q in lowered].index(state)]] for state in at_lower.states]
    both = [
        (asked_set, found),
        (at_lower, Observed(again.values[:, columns], *(part[:, states] for part in again[1:]))),
    ]
    quantities = [q for part, _ in both for q in part.quantities]
    best = problem.scenes_at(x[min(1, len(x) - 1)])
    return Beside(
        quantities,
        [kind for part, _ in both for kind in part.kinds],
        [others[q.scene].drive for q in quantities],
        np.concatenate([seen.values for _, seen in both], axis=1),
        [[words for part, seen in both for words in _lost(part, seen, k)] for k in range(len(x))],
        list(dict.fromkeys(sentence for name in others for sentence in remarks(best[name]))),
    )


def beyond_law(problem: Problem, x: Any) -> list[str]:
    """Of a design at SI values x, the dimensions to which the cell law that pushes it was not fitted, in words."""
    scenes: list[Any] = [one for one in problem.scenes_at(x).values() if "cell_law_range" in rules_at_rest(one)]
    return list(dict.fromkeys(sentence for scene in scenes for sentence in range_remarks(scene.finger)))


def _lost(asked: QuantitySet, seen: Observed, k: int) -> list[str]:
    """Why design k is without some of its states."""
    each = zip(asked.state_labels(), seen.statuses[k], seen.reasons[k], seen.details[k], strict=True)
    return [f"{label}: {Reason(int(why)).text(float(at))}" for label, status, why, at in each if status != Status.OK]


BELOW_LIMIT = 0.97
"""Of the smallest limit pressure among the designs: at most there they are compared."""


def shared_pressures(given: np.ndarray, found: Observed) -> np.ndarray:
    """For each state the pressure (Pa) at which all designs have it: the given one, or two digits of a little less than
    the smallest limit pressure; NaN where a design is without that state for another reason."""
    lost = found.statuses != Status.OK
    limits = np.where(found.statuses == Status.BEYOND_LIMIT, found.details, np.where(lost, np.nan, np.inf))
    most = BELOW_LIMIT * limits.min(axis=0)
    unit = 10.0 ** (np.floor(np.log10(np.where((most > 0) & (most < np.inf), most, 1.0))) - 1)
    return np.where(lost.any(axis=0), np.floor(most / unit) * unit, given)


def _has(other: Any, quantity: Quantity) -> bool:
    """Whether a scene by the other drive has what is asked: the cell law knows no chambers that overlap."""
    return quantity.rule is None or quantity.rule in all_rules(other)


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

    def has_twin(quantity: Quantity) -> bool:
        return quantity.scene in others and _has(others[quantity.scene], quantity)

    twins = [dataclasses.replace(c, quantity=twin(c.quantity)) for c in limits if has_twin(c.quantity)]
    reported = [twin(goal.quantity) for goal in goals if has_twin(goal.quantity)]
    scenes = space.scenes | {name + SUFFIX: other for name, other in others.items()}
    return Space(scenes, [tied(variable) for variable in space.variables]), [*limits, *twins], reported
