"""What the sections of a config that vary scenes have in common: numbers and quantities by keys with their unit.

    "shell.a_mm"             the a of the shell, in mm; of every scene that has it, where there are several scenes
    "grasp.shell.a_mm"       of the scene [scenes.grasp]
    ["grasp.gripper.finger.L_mm", "free.finger.L_mm"]      several that move as one

    "force_N", "tip.x_mm"        a quantity of the one scene; "grasp.force_N" where there are several
    "pressure_kPa", "limit_margin", "limit_pressure_kPa"    see `softgrip_jax.quantities`
    "margins.walls_fit_mm"       how far a rule is kept (of a bent state, "margins.chambers_apart_mm", with `at`)

The state of a quantity, `at`: "required" (the pressure that the scene's own task needs), or as [solve] asks,
{ pressure_kPa = 31 } or { force_N = 2 }; "limit_pressure_kPa" needs none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import pydantic

from .. import config as configs
from ..errors import ConfigError, InputError, located
from ..parameters import Parameter, Parameters, Scenes
from ..quantities import (
    AT_REST,
    LIMIT_PRESSURE,
    MARGINS,
    REQUIRED,
    Quantity,
    State,
    named,
    observables_of,
    rules_at_rest,
)
from ..reasons import RULE_NAMES
from ..scene import Scene
from ..units import DISPLAY, unit_key


class Table(pydantic.BaseModel):
    """A table of a config: no unknown keys, no conversions."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


Seed = Annotated[int, pydantic.Field(ge=0, lt=2**32)]
"""Of random numbers: what every generator takes."""


class Varied(NamedTuple):
    """A number that varies, as a config names it."""

    key: str
    name: str
    """As `softgrip_jax.parameters` takes it, tied ones joined by '='."""
    kind: str
    rule: str
    keys: tuple[str, ...] = ()
    """All keys of tied numbers."""

    @property
    def unit(self) -> float:
        """Of the key, in SI."""
        return DISPLAY[self.kind][1]

    def checked(self, value: Any, what: str, where: str) -> float:
        """A number in the unit of the key as SI; a ConfigError where the field does not take it."""
        return float(configs.read_numbers(value, f"{where}: {what} of {self.key}", self.rule, self.kind, [""]))

    def bounds(self, low: float, high: float, scale: str, where: str) -> tuple[float, float]:
        """Two bounds in the unit of the key as SI; a ConfigError, in that unit, where they cannot be meant."""
        found = self.checked(low, "low", where), self.checked(high, "high", where)
        if not found[0] < found[1]:
            raise ConfigError(f"{where}: {self.key} goes from {low:g} to {high:g}; low must be below high.")
        if scale == "log" and found[0] <= 0:
            raise ConfigError(f"{where}: {self.key} begins at {low:g}; on a log scale low must be above zero.")
        return found

    def positive(self, scenes: Scenes, name: str, where: str, why: str = "") -> float:
        """Its value in scenes where it is called `name`, SI; a ConfigError, which may say why, where it is not one
        number above zero."""
        values = Parameters(scenes, [Parameter(name)]).reference
        if np.size(values) != 1 or not values[0] > 0:
            said = " ".join(f"{value / self.unit:g}" for value in values)
            raise ConfigError(f"{where}: {self.key} is {said}; it must be one number above zero{why}.")
        return float(values[0])


def varied(scenes: Scenes, keys: str | list[str], where: str) -> Varied:
    """The number that a key names, or several tied ones."""
    keys = [keys] if isinstance(keys, str) else keys
    if not keys:
        raise ConfigError(f"{where}: a list of tied numbers is empty.")
    found = [leaf for key in keys for leaf in _leaves(scenes, key, where)]
    if len({leaf.kind for _, leaf in found}) != 1:
        raise ConfigError(f"{where}: {' and '.join(keys)} are tied; they must be of the same unit.")
    names = [".".join(leaf.names if len(scenes) == 1 else (scene, *leaf.names)) for scene, leaf in found]
    return Varied(keys[0], " = ".join(names), found[0][1].kind, found[0][1].rule, tuple(keys))


def _leaves(scenes: Scenes, key: str, where: str) -> list[tuple[str, configs.NumberKey]]:
    head, _, rest = key.partition(".")
    if len(scenes) > 1 and head in scenes and rest:
        return [(head, configs.leaf(scenes[head], rest, where))]
    found, faults = [], []
    for name, scene in scenes.items():
        try:
            found.append((name, configs.leaf(scene, key, where)))
        except ConfigError as error:
            faults.append(error)
    if not found:
        if len(scenes) == 1:
            raise faults[0]
        allowed = [number for scene in scenes.values() for number in configs.number_keys(scene, zeros=True)]
        meant = configs.closest(key, allowed)
        hint = f"did you mean {meant}?" if meant else f"the scenes are {', '.join(scenes)}."
        raise ConfigError(f"{where}: no scene has a number {key!r}; {hint}")
    return found


def all_numbers(scenes: Scenes) -> list[str]:
    """The key of every number of the scenes that is not zero, once where several scenes have it."""
    keys: dict[str, None] = {}
    for scene in scenes.values():
        keys |= dict.fromkeys(configs.number_keys(scene))
    return list(keys)


def quantity(scenes: Scenes, key: str, at: Any, where: str) -> tuple[Quantity, float]:
    """The quantity that a key and a state name, and the unit of the key in SI."""
    scene_name, key = _scene_of(scenes, key, where)
    scene = scenes[scene_name]
    kinds = observables_of(scene) | {LIMIT_PRESSURE: "pressure"}
    if key.startswith(MARGINS):
        return _margin(scene, scene_name, key, at, where), DISPLAY["length"][1]
    keys = {unit_key(name, kind): name for name, kind in kinds.items()}
    if key not in keys:
        raise ConfigError(
            f"{where}: there is no quantity {key!r}; it must be one of {', '.join(keys)}, or {MARGINS} and a rule."
        )
    name = keys[key]
    if name == LIMIT_PRESSURE and at is not None:
        raise ConfigError(f"{where}: {key} belongs to the scene, not to a state of it; leave out at.")
    state = None if name == LIMIT_PRESSURE else state_of(scene, key, at, where)
    return Quantity(name, state, scene_name), DISPLAY[kinds[name]][1]


def _margin(scene: Scene, scene_name: str, key: str, at: Any, where: str) -> Quantity:
    """The margin of a rule; of undeformed parts whatever the state."""
    keys = {unit_key(MARGINS + rule, "length"): rule for rule in RULE_NAMES}
    rule = configs.pick(key, keys, f"{where}: the margin of a rule")
    at_rest = rule in rules_at_rest(scene)
    state = AT_REST if at_rest else None if at is None else state_of(scene, key, at, where)
    with located(where):
        return named(Quantity(MARGINS + rule, state, scene_name), {scene_name: scene})


def _scene_of(scenes: Scenes, key: str, where: str) -> tuple[str, str]:
    """(scene, key without it)."""
    if len(scenes) == 1:
        return next(iter(scenes)), key
    head, _, rest = key.partition(".")
    if head not in scenes or not rest:
        raise ConfigError(f"{where}: {key!r} names no scene; begin it with one of {', '.join(scenes)} and a dot.")
    return head, rest


def state_of(scene: Scene, key: str, at: Any, where: str) -> State:
    """A state as a config gives it."""
    if at == REQUIRED:
        try:
            scene.target()
        except InputError:
            raise ConfigError(
                f"{where}: {key} is asked at 'required', and the scene requires nothing by itself, as a grasp does "
                "whose object has a mass; at must be { pressure_kPa = 31 }, or one observable and its value."
            ) from None
        return REQUIRED
    kinds = {name: kind for name, kind in scene.prepared().OBSERVABLES.items() if kind != "position"}
    keys = {unit_key(name, kind): (name, kind) for name, kind in (kinds | {"pressure": "pressure"}).items()}
    if not isinstance(at, dict) or len(at) != 1 or next(iter(at)) not in keys:
        words = "without at" if at is None else f"at {at!r}"
        raise ConfigError(
            f"{where}: {key} is asked {words}; at must be 'required', {{ pressure_kPa = 31 }}, or one observable and "
            f"its value ({', '.join(keys)})."
        )
    [(name, value)] = at.items()
    name, kind = keys[name]
    rule = "positive" if name == "pressure" else "finite"
    wanted = float(configs.read_numbers(value, f"{where}: at", rule, kind, [""]))
    return wanted if name == "pressure" else (name, wanted)


class ObservableTable(Table):
    """Quantities of a section, in one or several states."""

    name: str | list[str]
    at: str | dict[str, float | list[float]] | None = None

    def states(self) -> list[Any]:
        """{ pressure_kPa = [10, 20] } as two states; others as they are."""
        if isinstance(self.at, dict) and len(self.at) == 1:
            [(name, value)] = self.at.items()
            if isinstance(value, list):
                return [{name: one} for one in value]
        return [self.at]


def observed(scenes: Scenes, tables: Sequence[ObservableTable], where: str) -> list[Quantity]:
    """All quantities that tables name."""
    return [
        quantity(scenes, name, at, where)[0]
        for table in tables
        for name in ([table.name] if isinstance(table.name, str) else table.name)
        for at in table.states()
    ]
