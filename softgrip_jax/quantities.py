"""What can be asked of scenes, as one vector of numbers: quantities in states.

A quantity is an observable of one scene in one state. A state is named by what is asked of the library:

    at=31e3               sg.solve(scene, 31e3): at that pressure, Pa
    at="required"         sg.pressure_for(scene): at the pressure that the scene's own task needs
    at=("force", 2.0)     sg.pressure_for(scene, force=2.0)

Besides the scene's own observables each state has "pressure" and "limit_margin" (limit pressure over pressure), and
each scene, without a state, "limit_pressure". Of an observable that is a point there are its components, "tip.x" and
"tip.y"; of the line that a finger bends to there are "shape.x" and "shape.y" at a part `along` of it.

The margin of a rule (see `reasons`), in metres and negative where the rule is broken, is "margins.walls_fit". Rules of
the undeformed parts need no state (their state is called "rest", whatever is given); those of a bent finger need one.
"""

from __future__ import annotations

import copy
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .errors import InputError
from .fields import admissible
from .parameters import Scenes
from .questions import limit_pressure, pressure_for, solve, to_reach
from .reasons import RULE_NAMES, Reason
from .results import Solution, Status, in_units
from .scene import Scene

Scalar = Float[Array, ""]
State = float | str | tuple[str, float] | None

REQUIRED = "required"
LIMIT_PRESSURE = "limit_pressure"
LIMIT_MARGIN = "limit_margin"
SHAPE = "shape"
MARGINS = "margins."
"""It stands before the name of a rule whose margin is meant."""
AT_REST = "rest"
"""The state of the margins that undeformed parts have."""

NO_LIMIT_MARGIN = 1e6
"""`limit_margin` of a scene without a limit pressure: larger than any bound, and finite, as a search needs it. Studies
have inf there."""

MOST_DIGITS = 9
"""Of the per cent along a line in a label."""

SHAPE_POINTS = 101
"""Points of a shape, straight between two of them: a finger that is curled to a circle loses 1e-4 of its length."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """An observable of a scene in a state, by name.

    Args:
        observable: its name; also "pressure", "limit_pressure", "limit_margin", "tip.x", "shape.y" and
            "margins.walls_fit".
        at: the state: a pressure (Pa), "required" (`pressure_for` of the scene's own task), or a pair such as ("force",
            2.0) with the wanted value in SI.
        scene: name of the scene, needed where there are several.
        along: for "shape.x" and "shape.y", the part of the way from the clamp (0) to the tip (1), dimensionless.
        at_kind: of the observable that `at` gives the value of, a key of `units.DISPLAY`; found by whoever knows the
            scene.
        along_digits: of the per cent in the label; found by whoever knows what else is asked for.

    Examples:
        >>> sg.Quantity("force", at=31 * kPa).label()
        'force at 31 kPa'
    """

    observable: str
    at: State = None
    scene: str = ""
    along: float | None = None
    at_kind: str = dataclasses.field(default="number", compare=False, repr=False)
    along_digits: int = dataclasses.field(default=0, compare=False, repr=False)

    def label(self, with_scene: bool = True) -> str:
        """For tables: 'lift.pressure at required', 'tip_angle at 31 kPa'."""
        name = f"{self.scene}.{self.observable}" if self.scene and with_scene else self.observable
        name += "" if self.along is None else f" {self.along:.{self.along_digits}%} along"
        return name if self.at is None or self.at == AT_REST else f"{name} at {self.state_label()}"

    def state_label(self) -> str:
        """'31 kPa', 'required', 'force 2 N'."""
        if isinstance(self.at, tuple):
            return f"{self.at[0]} {in_units(self.at[1], self.at_kind)}"
        return self.at if isinstance(self.at, str) else in_units(self.at, "pressure")

    @property
    def rule(self) -> str | None:
        """The rule that the quantity is the margin of, where it is one."""
        return self.observable.removeprefix(MARGINS) if self.observable.startswith(MARGINS) else None

    @property
    def state(self) -> tuple[str, State]:
        """The scene and the state, which is solved once for all quantities of it."""
        return self.scene, self.at


def shown(value: Any, kind: str) -> str:
    """A value in SI as people read it; "none" for a limit that a scene has not (inf)."""
    return "none" if np.isinf(value) else in_units(value, kind)


class Observed(NamedTuple):
    """What one design does."""

    values: Float[Array, " q"]
    """Every quantity in SI as the library reports it: NaN where there is no equilibrium, zeros without contact."""
    statuses: Int[Array, " s"]
    """Of every state."""
    reasons: Int[Array, " s"]
    """Of every state, the number of a `Reason`: why it is not OK."""
    details: Float[Array, " s"]
    """The number (SI) that belongs to each reason, NaN where there is none."""


class QuantitySet:
    """A list of quantities of given scenes, checked: what a study or a search wants to know of every design."""

    def __init__(self, scenes: Scenes, quantities: Sequence[Quantity]):
        self.quantities = _told_apart(list(dict.fromkeys(named(q, scenes) for q in quantities)))
        self.kinds = [kind_of(q, scenes) for q in self.quantities]
        """Kinds of quantity, keys of units.DISPLAY."""
        self.states = list(dict.fromkeys(q.state for q in self.quantities))
        self.state_of = [self.states.index(q.state) for q in self.quantities]
        """The place of each quantity's state among them."""
        self.several = len(scenes) > 1

    def only(self, states: Sequence[tuple[str, State]]) -> QuantitySet:
        """The part of the list that is about some of its states."""
        part = copy.copy(self)
        kept = [k for k, q in enumerate(self.quantities) if q.state in states]
        part.quantities, part.kinds = [self.quantities[k] for k in kept], [self.kinds[k] for k in kept]
        part.states = [state for state in self.states if state in states]
        part.state_of = [part.states.index(q.state) for q in part.quantities]
        return part

    def index(self, quantity: Quantity) -> int:
        return self.quantities.index(quantity)

    def labels(self) -> list[str]:
        """One per quantity; the scene is named only where there are several."""
        return [q.label(self.several) for q in self.quantities]

    def state_labels(self) -> list[str]:
        """One per state: 'lift at required', '31 kPa'; a scene without a state: 'limit'."""
        labels = []
        for place, (scene, at) in enumerate(self.states):
            words = "limit" if at is None else self.quantities[self.state_of.index(place)].state_label()
            labels.append(f"{scene} at {words}" if self.several else words)
        return labels

    def measure(
        self,
        scenes: Scenes,
        limits: Mapping[str, Scalar] | None = None,
        solutions: Mapping[tuple[str, State], Solution] | None = None,
    ) -> Observed:
        """All quantities of one design, each state solved once; `limits`, `solutions`: what is known already, limit
        pressures by the scene's name and solutions by state."""
        limits, solutions = dict(limits or {}), dict(solutions or {})
        for q in self.quantities:
            if q.observable in (LIMIT_PRESSURE, LIMIT_MARGIN) and q.scene not in limits:
                limits[q.scene] = limit_pressure(scenes[q.scene])
        for name, scene in scenes.items():
            own = [at for of, at in self.states if of == name and isinstance(at, float)]
            pressures = [at for at in own if (name, at) not in solutions]
            if len(pressures) > 1 and scene.prepared().solver().in_turn():
                # Compiled once, and each begins where the one before has led.
                together = jax.vmap(lambda at, scene=scene: solve(scene, at))(jnp.asarray(pressures))
                for k, at in enumerate(pressures):
                    solutions[name, at] = jax.tree.map(lambda leaf, k=k: leaf[k], together)
        values: list[Any] = [None] * len(self.quantities)
        statuses, reasons, details = [], [], []
        for state in self.states:
            name, at = state
            limit = limits.get(name)
            solution = solutions.get(state)
            if solution is None and at is not None and at != AT_REST:
                solution = solution_at(scenes[name], at)
            margins: Mapping[str, Scalar] = {}
            if solution is not None:
                status, reason, detail = solution.status, solution.reason, solution.detail
                margins = solution.margins
            else:
                if at == AT_REST:
                    # A margin says by how much a rule is kept or broken: it is an answer either way.
                    margins, good = scenes[name].prepared().margins_at_rest(), admissible(scenes[name])
                else:
                    assert limit is not None  # what is asked without a state is the limit
                    good = limit > 0
                status = jnp.where(good, Status.OK, Status.IMPOSSIBLE)
                reason, detail = jnp.where(good, Reason.NONE, Reason.PARTS_DO_NOT_FIT), jnp.asarray(jnp.nan)
            statuses.append(status)
            reasons.append(reason)
            details.append(detail)
            shape = None
            for k, q in enumerate(self.quantities):
                if q.state != state:
                    continue
                if q.along is None:
                    values[k] = margins[q.rule] if q.rule else _value(q, solution, limit)
                    continue
                assert solution is not None
                shape = solution.shape(SHAPE_POINTS) if shape is None else shape
                values[k] = jnp.where(status == Status.OK, _along(shape[_component(q)[1]], q.along), jnp.nan)
        return Observed(*(jnp.stack(column) for column in (values, statuses, reasons, details)))


def _told_apart(quantities: list[Quantity]) -> list[Quantity]:
    """The same, with more digits where parts of a line are so near to each other that their labels are the same."""
    for digits in range(1, MOST_DIGITS + 1):
        counts = Counter(q.label() for q in quantities)
        same = [q.along is not None and counts[q.label()] > 1 for q in quantities]
        if not any(same):
            break
        quantities = [
            dataclasses.replace(q, along_digits=digits) if is_same else q
            for q, is_same in zip(quantities, same, strict=True)
        ]
    return quantities


def solution_at(scene: Scene, at: State | Scalar) -> Solution:
    """What the library answers to the question of a state (a pressure, "required", or an observable's value)."""
    if isinstance(at, tuple):
        return pressure_for(scene, **{at[0]: at[1]})
    return pressure_for(scene) if isinstance(at, str) else solve(scene, at)


def observables_of(scene: Scene) -> dict[str, str]:
    """What can be asked of a state, with its kind; points by their components."""
    kinds: dict[str, str] = {}
    for name, kind in scene.prepared().OBSERVABLES.items():
        kinds |= {f"{name}.x": "length", f"{name}.y": "length"} if kind == "position" else {name: kind}
    return kinds | {"pressure": "pressure", LIMIT_MARGIN: "number"}


def rules_at_rest(scene: Scene) -> tuple[str, ...]:
    """Names of the rules that the undeformed parts of a scene keep."""
    return _in_order(jax.eval_shape(_at_rest, _minding_all(scene)))


def all_rules(scene: Scene) -> tuple[str, ...]:
    """Names of all rules that the states of a scene keep, and its undeformed parts; nothing is solved."""
    return _in_order(jax.eval_shape(_of_any_state, _minding_all(scene)))


# JAX knows a function again that stands here, and traces it once for scenes of one kind.


def _minding_all(scene: Scene) -> Scene:
    """The scene without ignored rules, which have names all the same."""
    return dataclasses.replace(scene, ignored_rules=()) if scene.ignored_rules else scene


def _at_rest(scene: Scene) -> dict[str, Scalar]:
    return scene.prepared().margins_at_rest()


def _of_any_state(scene: Scene) -> dict[str, Scalar]:
    scene = scene.prepared()
    unknowns, pressure = jnp.zeros(scene.unknown_shape()), jnp.asarray(0.0)
    return scene.margins_at_rest() | scene.margins_of_state(unknowns, pressure)


margins_at_rest = jax.jit(_at_rest)
"""scene -> the margins (m) of its undeformed parts, by rule: one program, where JAX would compile every operation."""


def _in_order(margins: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(name for name in RULE_NAMES if name in margins)


def _require_margin(quantity: Quantity, scene: Scene) -> None:
    """A ValueError where a scene has no such margin in that state."""
    rule, kind = quantity.rule, type(scene).__name__
    if rule not in RULE_NAMES:
        raise InputError(f"There is no rule {rule!r}; the rules are {', '.join(RULE_NAMES)}.")
    if quantity.at == AT_REST:
        return
    if quantity.at is None:
        raise InputError(
            f"{quantity.observable} of {kind} is not known at rest: say in which state, for instance at which pressure."
        )
    if isinstance(quantity.at, str | tuple):  # what cannot be sought is told before anything is compiled
        target = {} if isinstance(quantity.at, str) else {quantity.at[0]: quantity.at[1]}
        jax.eval_shape(lambda scene: to_reach(scene, **target)[2], scene)
    known = all_rules(scene)
    if rule not in known:
        raise InputError(f"{kind} has no rule {rule!r}; it has: {', '.join(known) or 'none'}.")


def kind_of(quantity: Quantity, scenes: Scenes) -> str:
    """Kind of quantity (key of units.DISPLAY); a ValueError where the scene has no such observable in that state."""
    name, scene = quantity.observable, scenes[quantity.scene]
    if quantity.rule is not None:
        _require_margin(quantity, scene)
        return "length"
    if quantity.at is None:
        if name == LIMIT_PRESSURE:
            return "pressure"
        raise InputError(f"{name} needs a state: say at which pressure, or at {REQUIRED!r}.")
    if name in (f"{SHAPE}.x", f"{SHAPE}.y"):
        if "tip" not in scene.prepared().OBSERVABLES:
            raise InputError(f"{type(scene).__name__} is no finger; only the line that a finger bends to has {name}.")
        if quantity.along is None or not 0 <= quantity.along <= 1:
            raise InputError(f"{name} needs along, a number from 0 (the clamp) to 1 (the tip).")
        return "length"
    known = observables_of(scene)
    if name not in known:
        raise InputError(f"{type(scene).__name__} has no observable {name!r}; it has: {', '.join(known)}.")
    return known[name]


def named(quantity: Quantity, scenes: Scenes) -> Quantity:
    """The same with its scene and observable checked, and the scene filled in."""
    if not quantity.scene and len(scenes) == 1:
        quantity = dataclasses.replace(quantity, scene=next(iter(scenes)))
    if quantity.scene not in scenes:
        raise InputError(
            f"{quantity.label()} asks for scene {quantity.scene!r}; it must be one of {', '.join(scenes)}."
        )
    if quantity.rule is not None and quantity.rule in rules_at_rest(scenes[quantity.scene]):
        return dataclasses.replace(quantity, at=AT_REST)
    kind_of(quantity, scenes)
    at = quantity.at
    if isinstance(at, str) and at != REQUIRED:
        raise InputError(f"{quantity.label()}: the state must be a pressure, {REQUIRED!r} or an observable's value.")
    if isinstance(at, int | float) and not 0 <= at < np.inf:
        raise InputError(f"{quantity.label()}: the pressure must be a finite number, zero or more (Pa).")
    if isinstance(at, tuple):
        kinds = scenes[quantity.scene].prepared().OBSERVABLES
        return dataclasses.replace(quantity, at_kind=kinds.get(at[0], "number"))
    return quantity


def _component(quantity: Quantity) -> tuple[str, str]:
    name, _, component = quantity.observable.partition(".")
    return name, component


def _value(quantity: Quantity, solution: Solution | None, limit: Any) -> Array:
    if quantity.observable == LIMIT_PRESSURE:
        return limit
    assert solution is not None
    if quantity.observable == LIMIT_MARGIN:
        endless = limit == jnp.inf  # NaN, a limit that is not known, is no room at all
        return jnp.where(endless, NO_LIMIT_MARGIN, jnp.where(endless, 1.0, limit) / solution.pressure)
    if quantity.observable == "pressure":
        return solution.pressure
    name, component = _component(quantity)
    value = solution.observables[name]
    return value["xy".index(component)] if component else value


def _along(points: Float[Array, " n"], part: float) -> Scalar:
    """The value at a part of the way along evenly spaced points."""
    place = part * (SHAPE_POINTS - 1)
    k = min(int(place), SHAPE_POINTS - 2)
    return points[k] + (place - k) * (points[k + 1] - points[k])
