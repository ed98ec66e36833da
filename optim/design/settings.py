"""The section [design] of a config: what may move, what is wanted, how to search.

    [[design.variables]]                  [[design.goals]]              [[design.constraints]]
    name = "shell.a_mm"                   minimise = "pressure_kPa"     keep = "limit_margin"
    low = 8                               at = "required"               at = "required"
    high = 24                                                           low = 1.25

Names and states are those of `softgrip_jax.config.keys`; the numbers beside a name are in its unit. A goal is
`minimise`, `maximise`, `reach` (with `target`), or `follow`: points [x, y] (mm) from the clamp, [0, 0], to the tip that
the finger's shape shall go through, of the scene named by `scene` where there are several. The distances between the
points tell how far along the finger each of them is.

Every design keeps the rules of its scenes (walls fit, chambers do not overlap, nothing is inside the object, ...);
`ignore_rules = ["chambers_apart"]` in [design] gives up some by name. Scenes that share a finger must treat it by the
same laws, unless `different_laws = true` says otherwise.

With `drive = "both"` every constraint and every rule of a finger holds by both laws of what pushes it, the thesis's
chambers and the cell law; the goals are about the drive that a scene names itself.

With `front = 21` two or three goals are not added up but traded off: the result is about so many designs of which none
is better in every goal than another.

With `[design.uncertain]` numbers scatter from part to part, and a robust design is searched for: see
`optim.robust.settings`.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np
import pydantic

from softgrip_jax import config as configs
from softgrip_jax.config.keys import Seed, Table, quantity, state_of, varied
from softgrip_jax.errors import ConfigError, located
from softgrip_jax.parameters import Scenes
from softgrip_jax.pneunet.drives import sentence_of
from softgrip_jax.pneunet.finger_scene import FingerScene
from softgrip_jax.quantities import AT_REST, SHAPE, Quantity, State
from softgrip_jax.scene import Scene
from softgrip_jax.units import DISPLAY, mm, unit_key

from ..drives import BOTH, by_both_drives
from ..laws import differing_laws, require_one_law
from ..problem import Goal, Limits, Problem
from ..robust.settings import RequirementTable, Uncertain, UncertainTable, require_counted, scenes_of_posterior
from ..robust.settings import read as read_uncertain
from ..space import Space, Variable
from .descent import FINISHED, OPTIMISERS


class DesignVariable(Table):
    name: str | list[str]
    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"


def _either(key: str, other: str) -> Any:
    """A key that may be spelt in two ways, and is named by the first."""
    return pydantic.Field(default=None, validation_alias=pydantic.AliasChoices(key, other))


class GoalTable(Table):
    minimise: str | None = _either("minimise", "minimize")
    maximise: str | None = _either("maximise", "maximize")
    reach: str | None = None
    follow: list[list[float]] | None = None
    scene: str | None = None
    at: str | dict[str, float] | None = None
    target: float | None = None
    weight: float = pydantic.Field(default=1.0, gt=0)
    scale: float | None = pydantic.Field(default=None, gt=0)


class ConstraintTable(Table):
    keep: str
    at: str | dict[str, float] | None = None
    low: float | None = None
    high: float | None = None
    scale: float | None = pydantic.Field(default=None, gt=0)


class DesignTable(Table):
    variables: list[DesignVariable] = pydantic.Field(min_length=1)
    goals: list[GoalTable] = pydantic.Field(min_length=1)
    constraints: list[ConstraintTable] = []
    starts: int = pydantic.Field(default=256, ge=1, le=1_000_000)
    steps: int = pydantic.Field(default=100, ge=1, le=1_000_000)
    optimiser: Literal[OPTIMISERS] = "adam"  # type: ignore[valid-type]
    learning_rate: float = pydantic.Field(default=0.3, gt=0)
    finishes: int = pydantic.Field(default=FINISHED, ge=0, le=1000)
    seed: Seed = 0
    ignore_rules: list[str] = []
    different_laws: bool = False
    drive: Literal["both"] | None = None
    front: int | None = pydantic.Field(default=None, ge=3, le=10_000)
    uncertain: UncertainTable | None = None


@dataclasses.dataclass(frozen=True)
class Settings:
    """[design] as read: the problem, and the arguments of `search`, or of `pareto` where a front is wanted."""

    problem: Problem
    arguments: dict[str, Any]
    is_front: bool
    uncertain: Uncertain | None = None
    """What scatters, where a robust design is wanted."""
    of_search: dict[str, Any] = dataclasses.field(default_factory=dict)
    """The arguments of `search` where `arguments` are those of a front."""
    remarks: tuple[str, ...] = ()
    """Sentences about numbers that are not as the config says."""

    def without_front(self) -> Settings:
        """One search of all goals, added up."""
        return dataclasses.replace(self, arguments=self.of_search, is_front=False)


def read(config: configs.Config) -> Settings:
    """The section [design] of a config; raises ConfigError for anything that is wrong in it."""
    where = f"{config.path}, [design]"
    if "design" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [design], which says what to search for.")
    table = configs.validated(DesignTable, config.tables["design"], where)
    scenes, draws, remarks, uncertain = config.scenes, None, (), table.uncertain
    if uncertain is not None:
        _require_alone(table, where)
        scenes, draws, remarks = scenes_of_posterior(scenes, uncertain, config.path.parent, where)
    with located(where):
        variables = [_variable(scenes, v, where) for v in table.variables]
        goals = [goal for g in table.goals for goal in _goals(scenes, g, where)]
        limits = [limits_of(scenes, c, where) for c in table.constraints]
        required = [limits_of(scenes, r, where) for r in uncertain.requirements] if uncertain else []
        space, both = Space(scenes, variables), table.drive == "both"
        if not table.different_laws:
            require_one_law(space)
        sentences, reported = differing_laws(space), [limit.quantity for limit in required]
        if both:
            own = [scene.drive for scene in space.scenes.values() if isinstance(scene, FingerScene)]
            sentences = [*sentences, BOTH, *dict.fromkeys(map(sentence_of, own))]
            space, limits, reported = by_both_drives(space, goals, limits)
        problem = Problem(
            space,
            goals,
            limits,
            ignore_rules=table.ignore_rules,
            different_laws=both or table.different_laws,
            reported=reported,
        )
        if both:
            problem.different_laws = tuple(sentences)
    of_search = {n: getattr(table, n) for n in ("starts", "steps", "optimiser", "learning_rate", "finishes", "seed")}
    if table.front is None:
        scattered = None
        if uncertain is not None:
            scattered = read_uncertain(uncertain, space, draws, required, where)
            require_counted(problem, scattered, where)
        return Settings(problem, of_search, False, scattered, remarks=remarks)
    if len(problem.goals) not in (2, 3):
        raise ConfigError(f"{where}: a front is between two or three goals; there are {len(problem.goals)}.")
    of_front = {"points": table.front, "starts": table.starts, "seed": table.seed}
    return Settings(problem, of_front, True, of_search=of_search)


def asked_first(problem: Problem) -> tuple[str, State]:
    """(scene, state) of the first goal or limit that is about a loaded state; the first goal's scene and None where
    none is."""
    wanted = [item.quantity for item in (*problem.goals, *problem.limits)]
    of_states = (quantity.state for quantity in wanted if quantity.at not in (None, AT_REST))
    return next(of_states, (wanted[0].scene, None))


def question(at: State, scene: Scene) -> dict[str, dict[str, float]]:
    """The section [solve] that asks for a state, as `config.dump` takes it."""
    if isinstance(at, tuple):
        kind = scene.prepared().OBSERVABLES[at[0]]
        return {"solve": {unit_key(at[0], kind): at[1] / DISPLAY[kind][1]}}
    return {} if at is None or isinstance(at, str) else {"solve": {"pressure_kPa": at / DISPLAY["pressure"][1]}}


def _variable(scenes: Scenes, table: DesignVariable, where: str) -> Variable:
    number = varied(scenes, table.name, where)
    low, high = number.bounds(table.low, table.high, table.scale, where)
    return Variable(number.name, low, high, table.scale)


UNUSED = {
    "target": "the points are what is to be reached",
    "scale": "the length of the curve is the scale",
    "scene": "of several scenes the key of the quantity begins with the one that is meant",
}
"""Why a goal has no use for a key."""


def _goals(scenes: Scenes, table: GoalTable, where: str) -> list[Goal]:
    kinds = [kind for kind in ("minimise", "maximise", "reach", "follow") if getattr(table, kind) is not None]
    if len(kinds) != 1:
        raise ConfigError(
            f"{where}: a goal has {len(kinds)} of minimise, maximise, reach and follow; it must have one."
        )
    for key in ("target", "scale") if table.follow is not None else ("scene",):
        if getattr(table, key) is not None:
            raise ConfigError(f"{where}: a goal has {key} beside {kinds[0]}; {UNUSED[key]}; leave out {key}.")
    if table.follow is not None:
        return _followed(scenes, table, table.follow, where)
    key = getattr(table, kinds[0])
    if (kinds[0] == "reach") != (table.target is not None):
        needs = "takes no target; leave it out" if kinds[0] != "reach" else "needs a target"
        raise ConfigError(f"{where}: the goal {kinds[0]} = {key!r} {needs}.")
    wanted, unit = quantity(scenes, key, table.at, where)
    return [Goal(kinds[0], wanted, _times(table.target, unit), table.weight, _times(table.scale, unit))]


def _followed(scenes: Scenes, table: GoalTable, points: list[list[float]], where: str) -> list[Goal]:
    """One goal per coordinate: the mean over the points of the squared distance, in units of the curve's length."""
    name = table.scene or next(iter(scenes))
    if name not in scenes or (table.scene is None and len(scenes) > 1):
        raise ConfigError(f"{where}: a goal follows a curve in scene {name!r}; name one of {', '.join(scenes)}.")
    if len(points) < 2 or any(len(point) != 2 for point in points):
        raise ConfigError(f"{where}: follow must be a list of two points or more, each [x, y] in mm.")
    at = state_of(scenes[name], "the shape", table.at, where)
    curve = np.array(points) * mm
    passed = np.append(0.0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T)))
    length = float(passed[-1])
    first = f"[{points[0][0]:g}, {points[0][1]:g}]"
    if not length > 0:
        raise ConfigError(f"{where}: the points of follow are all {first}; two must differ.")
    if np.any(curve[0]):
        raise ConfigError(f"{where}: the first point of follow is {first}; it must be [0, 0], where the clamp is.")
    parts, weight = passed / length, table.weight / len(curve)
    # At the clamp the finger does not move.
    return [
        Goal("reach", Quantity(f"{SHAPE}.{axis}", at, name, float(part)), float(value), weight, length)
        for part, point in list(zip(parts, curve, strict=True))[1:]
        for axis, value in zip("xy", point, strict=True)
    ]


def _require_alone(table: DesignTable, where: str) -> None:
    """A ConfigError for what a robust design is not searched with."""
    if table.front is not None:
        raise ConfigError(
            f"{where}: a front of goals is not robust; leave out front, or give uncertain.front its yields."
        )
    if table.drive is not None:
        raise ConfigError(f'{where}: drive = "both" and [design.uncertain] do not go together; leave out one of them.')


def limits_of(scenes: Scenes, table: ConstraintTable | RequirementTable, where: str) -> Limits:
    """What a constraint or a requirement says."""
    wanted, unit = quantity(scenes, table.keep, table.at, where)
    if table.low is None and table.high is None:
        raise ConfigError(f"{where}: keep = {table.keep!r} has no bound; give low, high or both.")
    if table.low is not None and table.high is not None and not table.low < table.high:
        raise ConfigError(
            f"{where}: keep = {table.keep!r} goes from {table.low:g} to {table.high:g}; low must be below high."
        )
    return Limits(wanted, _times(table.low, unit), _times(table.high, unit), _times(table.scale, unit))


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit
