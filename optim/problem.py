"""What is wanted of the solutions: goals and limits on quantities, all scaled to pure numbers.

Quantities and the states that they are asked in: see `softgrip_jax.quantities`.

Every rule of the scenes is a limit, too, unless it is ignored by name: see `rules`.

A design without equilibrium has no observables. It has a shortfall instead: a positive pure number, differentiable,
that says how far the design is from an equilibrium, so that a search can climb back (see `_shortfall`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property, partial, wraps
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

import softgrip_jax as sg
from softgrip_jax.commands.programs import files_of, program
from softgrip_jax.compiler import MANY_CALLS, QUICKLY, SIDE_BY_SIDE
from softgrip_jax.errors import InputError
from softgrip_jax.numerics.nearby import Equations, Known, KnownFold, root_by_chords, root_nearby
from softgrip_jax.numerics.xla import traced_once
from softgrip_jax.own import are_numbers, outcome
from softgrip_jax.quantities import (
    AT_REST,
    LIMIT_MARGIN,
    Observed,
    Quantity,
    QuantitySet,
    State,
    named,
    solution_at,
)
from softgrip_jax.reasons import RULE_NAMES
from softgrip_jax.results import Solution, Status, in_units
from softgrip_jax.scene import Scene
from softgrip_jax.units import DISPLAY

from .laws import differing_laws, require_one_law
from .nearby import (
    PRESSURE,
    begins_by_formula,
    can_begin_nearby,
    is_covered,
    is_sought,
    known_states,
    limit_nearby,
    limit_of,
    snaps,
    state_at,
)
from .rules import SCALE, ignoring, is_held, label, require_rules, rules_of, with_rules_on, without_rules
from .space import Space

ENDLESS = 100.0
"""Of its scale, what a value counts as that has no end."""

Scalar = Float[Array, ""]

NEAR_LIMIT = 0.95
"""Where a task is out of reach, what the scene can do is judged at this part of its limit pressure: at the limit itself
the derivatives are infinite. It also makes shortfalls jump above zero, so that they push up to the last step."""


AMERICAN = {"minimize": "minimise", "maximize": "maximise"}
"""Other spellings of the kinds of goals, which are understood."""


@dataclasses.dataclass(frozen=True)
class GoalKind:
    """What a goal wants, as a term of the objective.

    Args:
        name: for messages and tables.
        term: term(goal, value, scale) is the pure number that is minimised, `goal.weight` included; value and scale in
            SI.
        has_target: whether a goal of this kind has a target.

    Examples:
        >>> kind = optim.GoalKind("at least zero", lambda goal, value, scale: jnp.maximum(-value, 0) / scale)
        >>> goal = optim.Goal(kind, optim.Quantity("inflation", at=15 * kPa))
        >>> print(goal.term(jnp.asarray(-3.0), 2.0))
        1.5
    """

    name: str
    term: Callable[[Goal, Scalar, float | Scalar], Scalar]
    has_target: bool = False


def _square_of_distance(goal: Goal, value: Scalar, scale: float | Scalar) -> Scalar:
    assert goal.target is not None
    return goal.weight * ((value - goal.target) / scale) ** 2


KINDS = {
    kind.name: kind
    for kind in (
        GoalKind("minimise", lambda goal, value, scale: goal.weight * value / scale),
        GoalKind("maximise", lambda goal, value, scale: goal.weight * -1 * value / scale),
        GoalKind("reach", _square_of_distance, has_target=True),
    )
}


def _require_scale(quantity: Quantity, scale: float | None) -> None:
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise InputError(f"The scale for {quantity.label()} is {scale}; it must be above zero.")


@dataclasses.dataclass(frozen=True)
class Goal:
    """One term of the objective.

    It is weight * sense * value / scale, or weight * ((value - target) / scale)^2 for "reach".

    Args:
        kind: "minimise", "maximise", "reach", or a `GoalKind` of your own.
        quantity: what it is about.
        target: of "reach", in SI.
        weight: of the term, dimensionless.
        scale: in SI; by default the size of the value at the starting design (of the target, for "reach"), so that
            weights compare relative changes. Where the starting design has no value, that of the first design of the
            search that has one counts, see `Scaling`.

    Raises:
        InputError: for another kind, where "reach" has no target or another kind has one, and where the term of a kind
            of your own is no number that JAX can differentiate.

    Examples:
        >>> goal = optim.Goal("reach", optim.Quantity("inflation", at=15 * kPa), target=12 * mm)
        >>> print(f"{goal.term(jnp.asarray(9 * mm), 12 * mm):.4f}")  # (1/4)^2
        0.0625
    """

    kind: str | GoalKind
    quantity: Quantity
    target: float | None = None
    weight: float = 1.0
    scale: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.kind, str):
            object.__setattr__(self, "kind", AMERICAN.get(self.kind, self.kind))
        elif not isinstance(self.kind, GoalKind):
            raise InputError(f"The kind of a goal is {self.kind!r}; it must be a name or a GoalKind.")
        if isinstance(self.kind, str) and self.kind not in KINDS:
            raise InputError(f"A goal of kind {self.kind!r} is not known; use 'minimise', 'maximise' or 'reach'.")
        if self.how.has_target != (self.target is not None):
            needs = "needs a target" if self.how.has_target else "takes no target; leave it out"
            raise InputError(f"The goal for {self.quantity.label()}: {self.how.name!r} {needs}.")
        if self.target is not None and not np.isfinite(self.target):
            raise InputError(f"The target for {self.quantity.label()} is {self.target}; it must be a finite number.")
        if not (np.isfinite(self.weight) and self.weight >= 0):
            raise InputError(f"The weight for {self.quantity.label()} is {self.weight}; it must be zero or more.")
        _require_scale(self.quantity, self.scale)
        if isinstance(self.kind, GoalKind):
            where = f"The term of the goal kind {self.kind.name!r}"
            are_numbers(where, outcome(where, partial(self.kind.term, self), jnp.ones(()), jnp.ones(())))

    @property
    def how(self) -> GoalKind:
        """What the kind means."""
        return KINDS[self.kind] if isinstance(self.kind, str) else self.kind

    def term(self, value: Scalar, scale: float | Scalar) -> Scalar:
        """The term at a value and with a scale, both in SI; dimensionless."""
        return self.how.term(self, value, scale)


@dataclasses.dataclass(frozen=True)
class Limits:
    """A constraint that keeps a quantity between bounds, low <= value <= high.

    Args:
        quantity: what it is about.
        low, high: bounds in SI; either may be left out.
        scale: in SI; by default the size of each bound (where the bound is zero, of the value as for a goal).

    Raises:
        InputError: where there is no bound, or low is not below high.

    Examples:
        >>> optim.Limits(optim.Quantity("inflation", at=15 * kPa), high=12 * mm).sides()
        [(1, 0.012)]
    """

    quantity: Quantity
    low: float | None = None
    high: float | None = None
    scale: float | None = None

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise InputError(f"The constraint on {self.quantity.label()} has no bound; give low, high or both.")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise InputError(f"The constraint on {self.quantity.label()}: low must be below high.")
        for _, bound in self.sides():
            if not np.isfinite(bound):
                raise InputError(f"A bound of {self.quantity.label()} is {bound}; it must be a finite number.")
        _require_scale(self.quantity, self.scale)

    def sides(self) -> list[tuple[int, float]]:
        """(sign, bound) of each one-sided constraint sign * (value - bound) / scale <= 0."""
        return [(sign, bound) for sign, bound in ((-1, self.low), (1, self.high)) if bound is not None]


class Scales(NamedTuple):
    """SI values that make goals and limits pure numbers; traced where a program takes them."""

    goals: tuple[Any, ...]
    limits: tuple[Any, ...]


class Measured(NamedTuple):
    """What one design does, before anything is wanted of it."""

    values: Float[Array, " q"]
    """Every quantity in SI, in the order of `Problem.quantities`, then the margins of rules that are not among them;
    NaN where there is none."""
    shortfall: Scalar
    """0 where every state has its equilibrium; else how far it is missing, summed over the states."""
    statuses: Int[Array, " s"]
    """Of every state in the order of `Problem.asked.states`, with the rules on."""
    reasons: Any = None
    """Of every state, the number of a `Reason`."""
    details: Any = None
    """The number that belongs to it, SI."""
    solutions: Any = ()
    """Of the states that were solved for, in the order of `Problem.solved_states`."""
    limit_margins: Any = None
    """Of every state that is asked for, the limit pressure over its pressure, NaN where it has none; None where limits
    were not sought."""


def finite(value: Array, scale: Any) -> Array:
    """Values that can be counted with: what is endless, as the largest pressure of a design that has none, is ENDLESS
    scales."""
    return jnp.where(jnp.isinf(value), jnp.sign(value) * ENDLESS * scale, value)


class Score(NamedTuple):
    """What the quantities of a design are worth: pure numbers."""

    objective: Scalar
    violations: Float[Array, " m"]
    """Of the limits, then of the rules: positive where one is broken, 0 where its state has no equilibrium."""


class Problem:
    """Variables, goals and limits over some scenes.

    `measure` holds the physics and is what takes time, to compile and to run; `score` holds what is wanted and is
    cheap, so that bounds, targets and weights can change without a new compilation.

    Args:
        space: the scenes and what may vary of them.
        goals: what is wanted.
        limits: what must be kept beside the rules.
        ignore_rules: names of rules that designs need not keep, beside those that a scene ignores itself.
        different_laws: whether scenes may treat the finger that they share by different laws.
        reported: further quantities that designs are reported with; their states must exist in every design.

    Raises:
        InputError: where there is no goal, for an unknown quantity or rule, for scenes with different laws, and for
            limits on one quantity that contradict each other.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> space = optim.Space({"free": sg.shell.Free(shell)}, [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        >>> problem = optim.Problem(space, [optim.Goal("maximise", optim.Quantity("inflation", at=15 * kPa))])
        >>> [quantity.label() for quantity in problem.quantities]
        ['free.inflation at 15 kPa']
    """

    def __init__(
        self,
        space: Space,
        goals: Sequence[Goal],
        limits: Sequence[Limits] = (),
        *,
        ignore_rules: Sequence[str] = (),
        different_laws: bool = False,
        reported: Sequence[Quantity] = (),
    ):
        if not goals:
            raise InputError("There is no goal; say what to minimise, maximise or reach.")
        self.ignored_rules = require_rules(ignore_rules)
        if not different_laws:
            require_one_law(space)
        self.different_laws = tuple(differing_laws(space))
        """Sentences about scenes that treat what they share by different laws."""
        self.about = ""
        """Everything that the problem is made of, in words, where its programs are to be kept for the next process."""
        self._programs: dict[Any, Any] = {}
        self._kept: dict[Any, Any] = {}
        """What searches make of goals and limits: problems that differ in these alone may share `_programs`."""
        self.space, scenes = space, without_rules(space.scenes)
        self.goals = tuple(dataclasses.replace(g, quantity=named(g.quantity, scenes)) for g in goals)
        self.limits = tuple(dataclasses.replace(c, quantity=named(c.quantity, scenes)) for c in limits)
        self.asked = QuantitySet(scenes, [item.quantity for item in (*self.goals, *self.limits)] + list(reported))
        self.quantities, self.kinds = self.asked.quantities, self.asked.kinds
        self.sides = [(self.quantities.index(c.quantity), *side, c.scale) for c in self.limits for side in c.sides()]
        """(index of the quantity, sign, bound, scale) of every limit's one-sided constraints."""
        self.require_room("constraints", self.sides)

    def require_room(self, what: str, sides: Sequence[tuple[int, int, float, float | None]]) -> None:
        """An InputError where two one-sided constraints (as in `sides`; what they are called) on one quantity leave
        nothing between them."""
        for k, quantity in enumerate(self.quantities):
            low = max((bound for of, sign, bound, _ in sides if of == k and sign < 0), default=-np.inf)
            high = min((bound for of, sign, bound, _ in sides if of == k and sign > 0), default=np.inf)
            if low > high:
                at_least, at_most = in_units(low, self.kinds[k]), in_units(high, self.kinds[k])
                raise InputError(
                    f"The {what} on {self.label(quantity)} contradict each other: at least {at_least} and at most "
                    f"{at_most}."
                )

    def held_numbers(self) -> str:
        """What compiled programs hold beside what the words of a config say: numbers of the scenes, which may come from
        a posterior, the files that their classes are made of, and what is measured, as where along a curve that is
        read."""
        leaves, tree = jax.tree.flatten(self.space.scenes)
        return repr(([np.asarray(leaf).tolist() for leaf in leaves], files_of(tree), self.quantities))

    @property
    def ignored(self) -> tuple[str, ...]:
        """Names of the rules that designs may break, in the search or as a scene says itself."""
        own = {name for scene in self.space.scenes.values() for name in scene.ignored_rules}
        return tuple(name for name in RULE_NAMES if name in own | set(self.ignored_rules))

    @cached_property
    def rules(self) -> list[Quantity]:
        """The margins that every design keeps at zero or more. Fingers are traced to tell them: once, when needed."""
        found = rules_of(without_rules(self.space.scenes), self.asked.states)
        own = {name: scene.ignored_rules for name, scene in self.space.scenes.items()}
        asked = [rule for rule in found if rule.rule not in (*own[rule.scene], *self.ignored_rules)]
        return [rule for rule in asked if is_held(self.space.scenes[str(rule.scene)], rule)]

    @cached_property
    def measured(self) -> QuantitySet:
        """All that is measured: the quantities, then the margins of rules that are not among them."""
        return QuantitySet(without_rules(self.space.scenes), [*self.quantities, *self.rules])

    @cached_property
    def constrained(self) -> list[int]:
        """Where among the measured values the quantity of every constraint is: of the limits, then of the rules."""
        return [side[0] for side in self.sides] + [self.measured.index(rule) for rule in self.rules]

    def scenes_at(self, x: Any) -> dict[str, Scene]:
        """The scenes of a design at SI values x, with the rules that the search keeps."""
        return ignoring(self.space.scenes_at(jnp.asarray(x)), self.ignored_rules)

    def _bare(self, t: Float[Array, " n"]) -> dict[str, Scene]:
        """The scenes of a design at unit values t, without rules."""
        return without_rules(self.space.scenes_at(self.space.from_unit(t)))

    def margins(self, values: Any) -> np.ndarray:
        """The margins (m) of all rules, in the order of `rules`, from measured values."""
        return np.asarray(values)[[self.measured.index(rule) for rule in self.rules]]

    def measure(self, t: Float[Array, " n"], home: Float[Array, " n"] | None = None) -> Measured:
        """The design at unit values t: every quantity that any goal or limit needs, each state solved once.

        home: unit values of a design towards which one goes that knows no other way back; by default the starting one.
        """
        scenes = self._bare(t)
        asked_for = [name for name, at in self.measured.states if at != AT_REST]
        limits = {name: sg.limit_pressure(scenes[name]) for name in dict.fromkeys(asked_for)}
        given = [name for name, at in self.solved_states if not is_sought(at) and begins_by_formula(scenes[name])]
        contacts = {name: sg.contact_pressure(scenes[name]) for name in dict.fromkeys(given)}
        solutions = self._solutions(scenes, t)
        found = self.measured.measure(scenes, limits, solutions)
        shortfalls = [
            _shortfall(scenes[name], self._asked_at(at, t), status, limits.get(name), contacts.get(name))
            for (name, at), status in zip(self.measured.states, found.statuses, strict=True)
        ]
        # A scene that cannot exist at all, or can never touch anything, has no pressure to go by.
        home = jnp.asarray(self.home()) if home is None else home
        judged = self._judged(found, jnp.stack(shortfalls), _from_home(t, home), solutions)
        margins = [
            jnp.nan if at is None or is_sought(at) else limits[name] / self._asked_at(at, t)
            for name, at in self.asked.states
        ]
        return judged._replace(limit_margins=jnp.stack(margins))

    def _solutions(self, scenes: dict[str, Scene], t: Float[Array, " n"]) -> dict[tuple[str, State], Solution]:
        return {(name, at): solution_at(scenes[name], self._asked_at(at, t)) for name, at in self.solved_states}

    def _asked_at(self, at: State, t: Float[Array, " n"]) -> Any:
        """A state as it is asked for at unit values t."""
        return self.space.state_at(at, self.space.from_unit(t))

    def _judged(
        self,
        found: Observed,
        missing: Float[Array, " s"],
        lost: Scalar,
        solutions: dict[tuple[str, State], Solution] | None = None,
    ) -> Measured:
        """What was found, with rules. missing: by how much each state is, `lost` where that is not known."""
        states, statuses = self.measured.states, found.statuses
        good = statuses == Status.OK
        missing = jnp.where(good, 0.0, jnp.where(jnp.isfinite(missing), missing, lost))
        # A quantity that is not known of a solved state (a limit that was not found) is no kept constraint.
        state_of = np.array(self.measured.state_of)
        unknown = jnp.zeros(len(states), bool).at[state_of].max(jnp.isnan(found.values))
        missing = jnp.where(good & unknown, lost, missing)
        # At a pressure too low to touch there are zeros to report, but nothing to improve by.
        values = jnp.where(good[state_of], found.values, jnp.nan)
        margins = values[np.array([self.measured.index(rule) for rule in self.rules], int)]
        reported = with_rules_on(found, states, self.rules, jax.lax.stop_gradient(margins))
        own = np.array([states.index(state) for state in self.asked.states])
        columns = (column[own] for column in reported[1:])
        return Measured(values, jnp.sum(missing), *columns, solutions=tuple((solutions or {}).values()))

    @cached_property
    def solved_states(self) -> list[tuple[str, State]]:
        """The states that have a pressure: neither parts at rest nor limits alone."""
        return [(name, at) for name, at in self.measured.states if at is not None and at != AT_REST]

    @cached_property
    def followed(self) -> list[tuple[str, State]]:
        """The states that a design nearby gives a good guess of."""
        return [(name, at) for name, at in self.solved_states if can_begin_nearby(self.space.scenes[name])]

    @cached_property
    def doubted(self) -> list[tuple[str, State]]:
        """The `followed` states that may lie beyond limit points though a design nearby led to them."""
        return [(name, at) for name, at in self.followed if snaps(self.space.scenes[name])]

    def solve(self, t: Float[Array, " n"]) -> Measured:
        """`measure` along the whole way from zero load, without derivatives and without the limits that only a design
        without equilibrium needs: its shortfall is just positive."""
        scenes = self._bare(t)
        solutions = self._solutions(scenes, t)
        found = self.measured.measure(scenes, solutions=solutions)
        return self._judged(found, jnp.ones(len(found.statuses)), jnp.ones(()), solutions)

    def stand(self, t: Float[Array, " n"]) -> Bool[Array, " d"]:
        """Which of the `doubted` states are there along the whole way from zero load."""
        scenes = self._bare(t)
        found = [solution_at(scenes[name], self._asked_at(at, t)).status for name, at in self.doubted]
        return jnp.stack(found) == Status.OK

    def known(self, t: Any, solutions: Sequence[Solution]) -> tuple[Known, ...]:
        """The `followed` ones of the solutions of `solved_states`, of a batch of designs t, as places to begin from."""
        of = dict(zip(self.solved_states, solutions, strict=True))
        return tuple(known_states(state[1], of[state], t) for state in self.followed)

    @cached_property
    def apart(self) -> QuantitySet:
        """What is asked of no `followed` state."""
        return self.measured.only([state for state in self.measured.states if state not in self.followed])

    def solve_nearby(self, t: Float[Array, " n"], known: tuple[Known, ...]) -> tuple[Measured, Any, tuple[Known, ...]]:
        """As `solve`, from the states of a design nearby, with the derivatives of the values by t; and those states."""

        def elsewhere(t):
            found = self.apart.measure(self._bare(t))
            return found.values, found

        by_t, found = jax.jacfwd(elsewhere, has_aux=True)(t)
        values, slopes, statuses, after = [found.values], [by_t], [*found.statuses], []
        for state, place in zip(self.followed, known, strict=True):
            near = root_nearby(self._equations(state), after_all(t, after), place)
            values.append(near.observed)
            slopes.append(near.slopes)
            statuses.append(self._status_of(state, t, near.told, near.good))
            after.append(near.known)
        return self._together(values, statuses), self._in_order(slopes), tuple(after)

    def solve_by_chords(self, t: Float[Array, " n"], known: tuple[Known, ...]) -> Measured:
        """As `solve_nearby`, without derivatives and with the Jacobians of the known states: a fraction of its time."""
        found = self.apart.measure(self._bare(t))
        values, statuses, before = [found.values], [*found.statuses], []
        for state, place in zip(self.followed, known, strict=True):
            observed, u, good, told = root_by_chords(self._equations(state), after_all(t, before), place)
            values.append(observed)
            statuses.append(self._status_of(state, t, told, good))
            before.append(place._replace(u=u))
        return self._together(values, statuses)

    def _equations(self, state: tuple[str, State]) -> Equations:
        """(u, t) -> (the residual of a `followed` state, what is asked of it), the state."""
        (name, at), own = state, self.measured.only([state])

        def equations(u, t):
            scenes = self._bare(t)
            residual, solution = state_at(scenes[name], self._asked_at(at, t), u)
            return (residual, own.measure(scenes, solutions={state: solution}).values), solution

        return equations

    def _status_of(self, state: tuple[str, State], t: Float[Array, " n"], solution: Solution, is_root: Any) -> Array:
        """OK where a solution is one that the scene's model covers."""
        scene, at = self._bare(t)[state[0]], self._asked_at(state[1], t)
        good = is_root & is_covered(scene, at, solution)
        return jnp.where(good, int(Status.OK), int(Status.NOT_CONVERGED))

    def _in_order(self, parts: Sequence[Array]) -> Array:
        """Rows of `apart`, then of each `followed` state, in the order of `measured`."""
        quantities = [
            q
            for part in (self.apart, *(self.measured.only([state]) for state in self.followed))
            for q in part.quantities
        ]
        return jnp.concatenate(parts)[np.array([quantities.index(q) for q in self.measured.quantities], int)]

    def _together(self, values: Sequence[Array], statuses: Sequence[Array]) -> Measured:
        """What was found `apart` and of each `followed` state; a shortfall is just positive."""
        states = [*self.apart.states, *self.followed]
        status = jnp.stack([statuses[states.index(state)] for state in self.measured.states])
        number, ones = jnp.zeros(len(status), int), jnp.ones(len(status))
        return self._judged(Observed(self._in_order(values), status, number, number * jnp.nan), ones, ones[0])

    @cached_property
    def pressed(self) -> list[tuple[str, State]]:
        """The `followed` states at a pressure that is given: beyond the limit point it says by how much."""
        return [(name, at) for name, at in self.followed if not is_sought(at)]

    def end(self, t: Float[Array, " n"], place: int) -> tuple[KnownFold, Any, Scalar]:
        """(where the branch of a `pressed` state's scene ends, whether that is a limit point, its pressure over that of
        the state)."""
        found, is_fold = limit_of(self._scene_of(place, t), t)
        return found, is_fold, found.u[-1] * PRESSURE / self._asked_at(self.pressed[place][1], t)

    def lost_nearby(self, t: Float[Array, " n"], known: KnownFold, place: int) -> tuple[Scalar, Any, KnownFold, Any]:
        """(the shortfall of a `pressed` state, its derivatives by t, the limit point, whether that is one) from the
        limit point of a design nearby. The shortfall is not positive where the state is there."""
        found, good = limit_nearby(lambda t: self._scene_of(place, t), t, known)
        limit, slopes = found.u[-1] * PRESSURE, found.moved[-1] * PRESSURE
        at, at_slopes = jax.value_and_grad(lambda t: jnp.asarray(self._asked_at(self.pressed[place][1], t), t.dtype))(t)
        shortfall = jnp.where(limit < at, 1 / NEAR_LIMIT - limit / at, 0.0)
        return shortfall, (limit * at_slopes / at - slopes) / at, found, good

    def short(self, t: Float[Array, " n"], home: Float[Array, " n"], place: int) -> tuple[Scalar, Any]:
        """(the shortfall of one of the states that a design lacks, its derivatives by t), along the whole way from zero
        load. home: as of `measure`."""
        name, at = self.measured.states[place]

        def shortfall(t):
            lost = _from_home(t, home)
            if (name, at) not in self.solved_states:
                return lost, lost
            scene, asked = self._bare(t)[name], self._asked_at(at, t)
            limit = sg.limit_pressure(scene)
            is_beyond = True if is_sought(asked) else limit < asked
            status = jnp.where(is_beyond, int(Status.BEYOND_LIMIT), int(Status.NOT_CONVERGED))
            by = _shortfall(scene, asked, status, limit)
            by = jnp.where(by > 0, by, lost)
            return by, by

        slopes, by = jax.jacfwd(shortfall, has_aux=True)(t)
        return by, slopes

    def _scene_of(self, place: int, t: Float[Array, " n"]) -> Scene:
        """The scene of a `pressed` state."""
        return self._bare(t)[self.pressed[place][0]]

    def columns_of(self, state: tuple[str, State]) -> np.ndarray:
        """Where among the measured values those of a state are."""
        return np.array([k for k, q in enumerate(self.measured.quantities) if q.state == state], int)

    def home(self) -> np.ndarray:
        """Unit values of the starting design, moved off the bounds."""
        return self.space.inside(self.space.to_unit(self.space.reference))

    def solved(self, t: Any) -> Measured:
        """`solve` of a batch."""
        return self._program(self.solve, QUICKLY, t)

    def standing(self, t: Any) -> Any:
        """`stand` of a batch: a search asks it of every design that has an answer, so that it is optimised."""
        return self._program(self.stand, SIDE_BY_SIDE, t)

    def solved_nearby(self, t: Any, known: tuple[Known, ...]) -> tuple[Measured, Any, tuple[Known, ...]]:
        """`solve_nearby` of a batch."""
        return self._program(self.solve_nearby, SIDE_BY_SIDE, t, known)

    def solved_by_chords(self, t: Any, known: tuple[Known, ...]) -> Measured:
        """`solve_by_chords` of a batch."""
        return self._program(self.solve_by_chords, SIDE_BY_SIDE, t, known)

    def ends(self, t: Any, place: int) -> tuple[KnownFold, Any, Any]:
        """`end` of a batch."""
        return self._program(self.end, SIDE_BY_SIDE, t, place=place)

    def all_lost_nearby(self, t: Any, known: KnownFold, place: int) -> tuple[Any, Any, KnownFold, Any]:
        """`lost_nearby` of a batch."""
        return self._program(self.lost_nearby, SIDE_BY_SIDE, t, known, place=place)

    def all_short(self, t: Any, home: Any, place: int) -> tuple[Any, Any]:
        """`short` of a batch, all with one home."""
        return self._program(self.short, MANY_CALLS, t, jnp.broadcast_to(home, jnp.shape(t)), place=place)

    def _program(self, function: Any, options: dict[str, Any], *rows: Any, **fixed: Any) -> Any:
        """function of every row, by a program that is compiled once. fixed: what is the same for all rows, numbers."""
        return self._made(function, options, *rows, **fixed)(*rows)

    def _made(self, function: Any, options: dict[str, Any], *rows: Any, **fixed: Any) -> Any:
        """That program, for rows of these shapes."""
        key = function.__name__, *fixed.items(), tuple(jnp.shape(leaf) for leaf in jax.tree.leaves(rows))
        if key not in self._programs:
            batched = traced_once(jax.vmap(wraps(function)(partial(function, **fixed))))
            about = f"{self.about}{fixed or ''}"
            kept = program(batched, *rows, about=about, options=options) if self.about else batched
            self._programs[key] = kept
        return self._programs[key]

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """What `make` makes of a search's own work, once for every key: another search of this problem uses it, too."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def prepare(self, chunk: int, nearby: int, checked: int) -> None:
        """Have the programs for batches of `solved`, of `solved_nearby` and of `standing` made, where a command keeps
        them: the one is compiled while the other is traced."""
        t = np.zeros((chunk, self.space.size))
        found = getattr(self._made(self.solve, QUICKLY, t), "shapes", None)
        if found is None:
            return
        known = jax.eval_shape(self.known, t, found.solutions)
        t, known = jax.tree.map(lambda v: np.zeros((nearby, *v.shape[1:]), v.dtype), (t, known))
        self._made(self.solve_nearby, SIDE_BY_SIDE, t, known)
        if self.doubted:
            self._made(self.stand, SIDE_BY_SIDE, np.zeros((checked, self.space.size)))

    def measured_with_slopes(self, t: Any, home: Any = None) -> tuple[Measured, Measured]:
        """`measure_with_slopes` of a batch, all with one home."""
        home = jnp.asarray(self.home() if home is None else home)
        return self._program(self.measure_with_slopes, MANY_CALLS, t, jnp.broadcast_to(home, jnp.shape(t)))

    def measure_with_slopes(self, t: Float[Array, " n"], home: Float[Array, " n"]) -> tuple[Measured, Measured]:
        """`measure` and its derivatives by t (of values and shortfall), all variables in one forward pass.

        Finding an equilibrium costs far more than differentiating it, and forward mode shares the finding.
        """

        def split(t):
            found = self.measure(t, home)
            return (found.values, found.shortfall), found

        (values, shortfall), found = jax.jacfwd(split, has_aux=True)(t)
        return found, Measured(values, shortfall, found.statuses)

    def terms(self, values: Float[Array, " q"], scales: Scales) -> Float[Array, " g"]:
        """The term of every goal: what `score` adds up, and what a trade-off keeps apart."""
        return jnp.stack(
            [
                goal.term(finite(values[self.asked.index(goal.quantity)], scale), scale)
                for goal, scale in zip(self.goals, scales.goals, strict=True)
            ]
        )

    def score(self, values: Float[Array, " q"], scales: Scales) -> Score:
        """Goals and limits from the quantities."""
        known = ~jnp.isnan(values)
        safe = jnp.where(known, values, 1.0)
        objective = jnp.asarray(0.0)
        for goal, scale in zip(self.goals, scales.goals, strict=True):
            k = self.quantities.index(goal.quantity)
            objective += jnp.where(known[k], goal.term(finite(safe[k], scale), scale), 0.0)
        violations = [
            jnp.where(known[k], sign * (finite(safe[k], scale) - bound) / scale, 0.0)
            for (k, sign, bound, _), scale in zip(self.sides, scales.limits, strict=True)
        ]
        rules = self.constrained[len(self.sides) :]
        violations += [jnp.where(known[k], -finite(safe[k], SCALE) / SCALE, 0.0) for k in rules]
        return Score(objective, jnp.stack(violations) if violations else jnp.zeros(0))

    def scales(self, sizes: Any) -> Scales:
        """What makes every goal and limit a pure number; `sizes`: of the quantities, SI, NaN where none is known."""

        def size(k: int) -> float:
            value = abs(float(sizes[k]))
            if np.isfinite(value) and value > 0:
                return value
            bounds = [abs(bound) for other, _, bound, _ in self.sides if other == k and bound]
            return bounds[0] if bounds else DISPLAY[self.kinds[k]][1]

        return Scales(
            tuple(g.scale or abs(g.target or 0.0) or size(self.asked.index(g.quantity)) for g in self.goals),
            tuple(scale or abs(bound) or size(k) for k, _, bound, scale in self.sides),
        )

    def unscaled(self) -> list[int]:
        """The quantities whose size is the scale of a goal or a limit, because nothing else says it."""
        goals = [self.asked.index(g.quantity) for g in self.goals if not (g.scale or g.target)]
        return list(dict.fromkeys(goals + [k for k, _, bound, scale in self.sides if not (scale or bound)]))

    def label(self, quantity: Quantity) -> str:
        """Names the scene only where there are several."""
        return quantity.label(len(self.space.scenes) > 1)

    def constraint_labels(self) -> list[str]:
        """One name per violation: 'limit_margin at required at least 1.25'."""
        labels = []
        for k, sign, bound, _ in self.sides:
            quantity = self.quantities[k]
            relation = "at least" if sign < 0 else "at most"
            labels.append(f"{self.label(quantity)} {relation} {in_units(bound, self.kinds[k])}")
        return labels + [label(rule, len(self.space.scenes) > 1) for rule in self.rules]

    def always_kept(self) -> list[str]:
        """A sentence per limit that holds for every state that exists."""
        return [
            f"{label} holds for every state that exists: the margin is the limit pressure over the pressure, 1 at the "
            "limit."
            for label, (k, sign, bound, _) in zip(self.constraint_labels(), self.sides, strict=False)
            if self.quantities[k].observable == LIMIT_MARGIN and sign < 0 and bound < 1
        ]

    def at_limits(self, values: Any, within: float) -> list[str]:
        """Which of the states are at the limit pressure of their scene, as far as the quantities tell it: 'required: at
        its limit pressure'. within: of the pressure."""
        known = {(q.state, q.observable): value for q, value in zip(self.quantities, values, strict=False)}
        labels = zip(self.asked.states, self.asked.state_labels(), strict=True)
        return [at_limit(words) for state, words in labels if known.get((state, LIMIT_MARGIN), np.nan) < 1 + within]


def at_limit(state: str) -> str:
    """What is said of a state, by its label, that is at its limit pressure."""
    return f"{state}: at its limit pressure"


def after_all(t: Float[Array, " n"], known: Sequence[Known]) -> Float[Array, " n"]:
    """t, not before these are known.

    XLA runs what does not depend on each other side by side, in as many threads as there are processors; four roots on
    two processors were seen to wait for each other for ever (jaxlib 0.10.1).
    """
    for one in known:
        t = t + 0.0 * jnp.where(jnp.isfinite(one.u[0]), one.u[0], 0.0)
    return t


class Scaling:
    """The scales of a problem: from the starting design where it has an answer, else from the first design that has.

    Where no design has given a quantity a size yet, a bound on it counts, or the unit in which people read it.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self._needed = problem.unscaled()
        self._sizes = np.full(len(problem.quantities), np.nan)
        self.scales = problem.scales(self._sizes)
        self.from_start: set[int] = set()
        """The quantities whose size is that of the starting design, which is the first that is learned from."""
        self._has_seen = False

    def learn(self, values: Any) -> None:
        """Take the sizes that are still unknown from designs, one per row, the first that gives one."""
        missing = self.missing()
        if missing:
            sizes = np.abs(np.atleast_2d(np.asarray(values)))
            for k in missing:
                known = sizes[np.isfinite(sizes[:, k]) & (sizes[:, k] > 0), k]
                if known.size:
                    self._sizes[k] = known[0]
            self.scales = self.problem.scales(self._sizes)
        if not self._has_seen:
            self._has_seen = True
            self.from_start = set(self._needed) - set(self.missing())

    def missing(self) -> list[int]:
        """The quantities whose size no design has given."""
        return [k for k in self._needed if np.isnan(self._sizes[k])]

    def remarks(self) -> list[str]:
        """A sentence per quantity whose scale is not that of the starting design, with the key that sets another."""
        problem, found = self.problem, []
        for k in self._needed:
            if k in self.from_start:
                continue
            where = "no design gives it one" if k in self.missing() else "its size at the first design that has one"
            quantity = problem.quantities[k]
            items = [(g.quantity, value) for g, value in zip(problem.goals, self.scales.goals, strict=True)]
            items += [(problem.quantities[s[0]], v) for s, v in zip(problem.sides, self.scales.limits, strict=True)]
            scale = in_units(next(v for q, v in items if q == quantity), problem.kinds[k])
            found.append(
                f"{problem.label(quantity)} has no size at the starting design: its scale is {scale}, {where}; "
                "the key scale beside it sets another."
            )
        return found


def _from_home(t: Float[Array, " n"], home: Float[Array, " n"]) -> Scalar:
    """The shortfall of a design of which no limit tells how far it is from an answer: the way back is the way home."""
    return 1 + jnp.mean((t - home) ** 2)


def _shortfall(
    scene: Scene, at: State | Scalar, status: Array, limit: Scalar | None, contact: Scalar | None = None
) -> Scalar:
    """How far a state is beyond the limit of its scene or below its contact, a pure number; NaN where neither says
    anything about it.

    At a pressure p: 1 / NEAR_LIMIT - limit / p, the part of the pressure that the limit pressure must still rise by, or
    contact / p - NEAR_LIMIT, the part of it that the pressure at which contact begins must still fall by.
    For a task: 1 - y / target, with y what the scene reaches at NEAR_LIMIT times its limit pressure.
    """
    if limit is None or at is None or (isinstance(at, str) and at == AT_REST):
        return jnp.where(status == Status.OK, 0.0, jnp.nan)
    beyond = (status == Status.BEYOND_LIMIT) & jnp.isfinite(limit)
    safe = jnp.where(beyond, limit, 1.0)
    if not isinstance(at, tuple | str):
        short = jnp.where(beyond, 1 / NEAR_LIMIT - safe / at, jnp.nan)
        if contact is None:
            return short
        below = (status == Status.NO_CONTACT) & jnp.isfinite(contact) & (at > 0)
        return jnp.where(below, jnp.where(below, contact, 1.0) / jnp.where(below, at, 1.0) - NEAR_LIMIT, short)
    name, target = at if isinstance(at, tuple) else scene.target()
    # Lanes that are not in need solve at no pressure, which costs nothing and passes no gradient.
    near = sg.solve(scene, jnp.where(beyond, NEAR_LIMIT * safe, 0.0))
    reached = beyond & (near.status == Status.OK)
    return jnp.where(reached, 1 - jnp.where(reached, near.observables[name], 0.0) / target, jnp.nan)
