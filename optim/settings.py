"""The section [design] of a config: what may move, what is wanted, how to search.

    [[design.variables]]                  [[design.goals]]              [[design.constraints]]
    name = "shell.a_mm"                   minimise = "pressure_kPa"     keep = "limit_margin"
    low = 8                               at = "required"               at = "required"
    high = 24                                                           low = 1.25

Names carry their unit, and the numbers beside them are in it. A variable may tie several numbers: a list of names.
A goal is `minimise`, `maximise` or `reach` (with `target`). `at` is "required" (the pressure that the scene's own
task needs) or asks as [solve] does: {pressure_kPa = 31} or {force_N = 2}; "limit_pressure_kPa" needs none.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import pydantic

from softgrip_jax import config as configs
from softgrip_jax.config import ConfigError
from softgrip_jax.quantities import LIMIT_MARGIN, LIMIT_PRESSURE, REQUIRED, Quantity, State
from softgrip_jax.scene import Scene
from softgrip_jax.units import DISPLAY

from .objectives import Goal, Limits, Problem
from .search import OPTIMISERS
from .variables import Space, Variable

SCENE = "scene"
"""What the one scene of a config is called."""


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class VariableTable(_Table):
    name: str | list[str]
    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"


class GoalTable(_Table):
    minimise: str | None = None
    maximise: str | None = None
    reach: str | None = None
    at: str | dict[str, float] | None = None
    target: float | None = None
    weight: float = pydantic.Field(default=1.0, gt=0)
    scale: float | None = pydantic.Field(default=None, gt=0)


class ConstraintTable(_Table):
    keep: str
    at: str | dict[str, float] | None = None
    low: float | None = None
    high: float | None = None
    scale: float | None = pydantic.Field(default=None, gt=0)


class DesignTable(_Table):
    variables: list[VariableTable] = pydantic.Field(min_length=1)
    goals: list[GoalTable] = pydantic.Field(min_length=1)
    constraints: list[ConstraintTable] = []
    starts: int = pydantic.Field(default=256, ge=1, le=1_000_000)
    steps: int = pydantic.Field(default=100, ge=1, le=1_000_000)
    optimiser: Literal[OPTIMISERS] = "adam"  # type: ignore[valid-type]
    learning_rate: float = pydantic.Field(default=0.1, gt=0)
    seed: int = pydantic.Field(default=0, ge=0)


@dataclasses.dataclass(frozen=True)
class Settings:
    """[design] as read: the problem, and the arguments of `search`."""

    problem: Problem
    arguments: dict[str, Any]


def read(config: configs.Config) -> Settings:
    """The section [design] of a config; raises ConfigError for anything that is wrong in it."""
    where = f"{config.path}, [design]"
    if "design" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [design], which says what to search for.")
    table = configs.validated(DesignTable, config.tables["design"], where)
    scene = config.scene
    try:
        problem = Problem(
            Space({SCENE: scene}, [_variable(scene, v, where) for v in table.variables]),
            [_goal(scene, g, where) for g in table.goals],
            [_limits(scene, c, where) for c in table.constraints],
        )
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None
    names = ("starts", "steps", "optimiser", "learning_rate", "seed")
    return Settings(problem, {name: getattr(table, name) for name in names})


def question(at: State, scene: Scene) -> dict[str, dict[str, float]]:
    """The section [solve] that asks for a state, as `config.dump` takes it."""
    if isinstance(at, tuple):
        kind = scene.OBSERVABLES[at[0]]
        return {"solve": {configs.unit_key(at[0], kind): at[1] / DISPLAY[kind][1]}}
    return {} if at is None or isinstance(at, str) else {"solve": {"pressure_kPa": at / DISPLAY["pressure"][1]}}


def _variable(scene: Scene, table: VariableTable, where: str) -> Variable:
    keys = [table.name] if isinstance(table.name, str) else table.name
    leaves = [configs.leaf(scene, key, where) for key in keys]
    if len({leaf.kind for leaf in leaves}) != 1:
        raise ConfigError(f"{where}: {' and '.join(keys)} are tied; they must be of the same unit.")
    unit = leaves[0].unit
    for name, bound in (("low", table.low), ("high", table.high)):
        configs.read_numbers(bound, f"{where}: {name} of {keys[0]}", leaves[0].rule, leaves[0].kind, [""])
    names = " = ".join(".".join(leaf.names) for leaf in leaves)
    if not table.low < table.high:
        raise ConfigError(f"{where}: {keys[0]} goes from {table.low:g} to {table.high:g}; low must be below high.")
    return Variable(names, table.low * unit, table.high * unit, table.scale)


def _goal(scene: Scene, table: GoalTable, where: str) -> Goal:
    kinds = [kind for kind in ("minimise", "maximise", "reach") if getattr(table, kind) is not None]
    if len(kinds) != 1:
        raise ConfigError(f"{where}: a goal has {len(kinds)} of minimise, maximise and reach; it must have one.")
    quantity, unit = _quantity(scene, getattr(table, kinds[0]), table.at, where)
    return Goal(kinds[0], quantity, _times(table.target, unit), table.weight, _times(table.scale, unit))


def _limits(scene: Scene, table: ConstraintTable, where: str) -> Limits:
    quantity, unit = _quantity(scene, table.keep, table.at, where)
    return Limits(quantity, _times(table.low, unit), _times(table.high, unit), _times(table.scale, unit))


def _quantity(scene: Scene, key: str, at: Any, where: str) -> tuple[Quantity, float]:
    """A quantity from its key with unit, and the unit in SI."""
    kinds = dict(type(scene).OBSERVABLES) | {"pressure": "pressure", LIMIT_MARGIN: "number", LIMIT_PRESSURE: "pressure"}
    keys = {configs.unit_key(name, kind): name for name, kind in kinds.items()}
    if key not in keys:
        raise ConfigError(f"{where}: there is no quantity {key!r}; it must be one of {', '.join(keys)}.")
    name = keys[key]
    if name == LIMIT_PRESSURE and at is not None:
        raise ConfigError(f"{where}: {key} belongs to the scene, not to a state of it; leave out at.")
    return Quantity(name, None if name == LIMIT_PRESSURE else _state(scene, key, at, where), SCENE), DISPLAY[
        kinds[name]
    ][1]


def _state(scene: Scene, key: str, at: Any, where: str) -> State:
    if at == REQUIRED:
        try:
            scene.target()
        except ValueError as error:
            raise ConfigError(f"{where}: {key} at 'required': {error}") from None
        return REQUIRED
    kinds = dict(type(scene).OBSERVABLES) | {"pressure": "pressure"}
    keys = {configs.unit_key(name, kind): (name, kind) for name, kind in kinds.items()}
    if not isinstance(at, dict) or len(at) != 1 or next(iter(at)) not in keys:
        raise ConfigError(
            f"{where}: {key} is asked at {at!r}; at must be 'required', {{ pressure_kPa = 31 }}, or one observable "
            f"and its value ({', '.join(keys)})."
        )
    [(name, value)] = at.items()
    name, kind = keys[name]
    rule = "positive" if name == "pressure" else "finite"
    wanted = float(configs.read_numbers(value, f"{where}: at", rule, kind, [""]))
    return wanted if name == "pressure" else (name, wanted)


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit
