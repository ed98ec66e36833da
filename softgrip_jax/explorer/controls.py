"""What of a scene can be moved and chosen: its numbers with range, rule and unit, and its choices by name.

All follows from the fields of the scene's classes, as the keys of configs do: "shell.a_mm", "shell.material.type".
"""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import config as configs
from ..config.modules import Key, classes_of, keys_of, read_module, to_table, type_name
from ..config.template import example
from ..errors import ConfigError, InputError, located
from ..fields import RULES, Checked, documented, wanted
from ..plausible import units_are_stated
from ..scene import Scene
from ..units import DISPLAY, degree, gram, kPa, mm

DOWN, UP = 0.25, 4.0
"""A slider of a positive number goes from and to these parts of it, which is more than a decade: on a log scale."""
AROUND = 2.0
"""One of a number of either sign goes to this many times its size, on both sides of zero."""
FROM_ZERO = {"length": 20 * mm, "angle": 60 * degree, "mass": gram * 500, "pressure": 100 * kPa, "force": 1.0}
"""SI, by kind: how far the slider of a number goes that is zero now; others go to 1."""
RIGHT_ANGLE = 89 * degree
MOST_ENTRIES = 24
"""An array of more numbers is not shown one by one."""
MOST_FINGERS = 8
STAND, FROM_GROUND = "stand_distance_mm", 1.25
"""What a grasp of an object that tapers needs: its gripper's base is so many lengths of a finger from the ground."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of a scene that can be moved."""

    key: str
    """As configs name it, "shell.a_mm"; one of an array "finger.a_mm[2]"."""
    names: tuple[str, ...]
    """Attributes from the scene down to it."""
    entry: int | None
    kind: str
    rule: str
    doc: str
    value: float
    """SI, as are low and high."""
    low: float
    high: float

    @property
    def is_log(self) -> bool:
        """Whether the slider is on a log scale: where its range spans a decade."""
        return self.low > 0 and self.high / self.low >= 10

    def has_range_of(self, other: Number) -> bool:
        """Whether places on both sliders mean the same."""
        return (self.low, self.high) == (other.low, other.high)

    @property
    def unit(self) -> float:
        """Of the key, in SI."""
        return DISPLAY[self.kind][1]

    @property
    def label(self) -> str:
        """Of the unit."""
        return DISPLAY[self.kind][0]

    def shown(self, value: float) -> str:
        """A value in SI as the box beside the slider has it: in the unit of the key, without the unit."""
        return f"{value / self.unit:.6g}"

    def read(self, text: str) -> float:
        """What was typed, in the unit of the key, as SI; ConfigError in one sentence where it cannot be meant."""
        given = text.strip().replace("\N{MINUS SIGN}", "-").removesuffix(self.label).strip()
        if not NUMBER.fullmatch(given):
            raise ConfigError(f"{self.key} is {text!r}; it must be {wanted(self.rule, self.label)}.")
        return self.checked(float(given) * self.unit)

    def checked(self, value: float) -> float:
        """A value in SI that keeps the rule of the field; ConfigError where it does not."""
        if not bool(RULES[self.rule][1](np.asarray(value))):
            raise ConfigError(f"{self.key} is {self.shown(value)}; it must be {wanted(self.rule, self.label)}.")
        return value

    def place(self, value: float) -> float:
        """Where a value is on the slider, from 0 to 1, or beyond it."""
        if self.is_log:
            return math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def at(self, place: float) -> float:
        """The value (SI) at a place of the slider, with as many digits as people would type."""
        if self.is_log:
            value = self.low * (self.high / self.low) ** place
        else:
            value = self.low + place * (self.high - self.low)
        return float(f"{value / self.unit:.5g}") * self.unit

    def holding(self, value: float) -> Number:
        """The same with a range that holds a value: around it, where it was beyond the one of before."""
        if self.low <= value <= self.high:
            return self
        low, high = value_range(value, self.rule, self.kind)
        return dataclasses.replace(self, low=low, high=high)


@dataclasses.dataclass(frozen=True)
class Choice:
    """Something of a scene that is chosen by name."""

    key: str
    path: tuple[str, ...]
    """Keys from the table of the scene down to it."""
    options: tuple[Any, ...]
    value: Any
    doc: str


def value_range(value: float, rule: str, kind: str) -> tuple[float, float]:
    """From where to where the slider of a number goes, SI."""
    far = FROM_ZERO.get(kind, 1.0)
    if rule == "right_angle":
        return 0.0, RIGHT_ANGLE
    if rule in ("positive", "nonnegative"):
        if value > 0:
            return (DOWN * value, UP * value) if rule == "positive" else (0.0, UP * value)
        return 0.0, far
    if rule == "nonzero":  # it keeps its sign: half of its range would break the rule
        return (DOWN * value, UP * value) if value > 0 else (UP * value, DOWN * value)
    far = AROUND * abs(value) if value else far
    return -far, far


def numbers_of(module: Any, before: str = "", names: tuple[str, ...] = ()) -> list[Number]:
    """Every number of a module and of its parts; what is None (no weight, say) is none."""
    found, docs = [], documented(type(module))
    for key in keys_of(type(module)).values():
        value, meta = getattr(module, key.name), key.field.metadata
        if isinstance(value, Checked):
            found += numbers_of(value, f"{before}{key.name}.", (*names, key.name))
            continue
        friction = meta.get("friction") and not callable(value)
        if value is None or not ("rule" in meta or friction) or np.size(value) > MOST_ENTRIES:
            continue
        rule, kind = (meta["rule"], meta["kind"]) if "rule" in meta else ("positive", "number")
        entries = [None] if np.ndim(value) == 0 else list(range(np.size(value)))
        for entry in entries:
            now = float(np.ravel(np.asarray(value))[entry or 0])
            mark = "" if entry is None else f"[{entry}]"
            low, high = value_range(now, rule, kind)
            name = (*names, key.name)
            found.append(
                Number(f"{before}{key.key}{mark}", name, entry, kind, rule, docs.get(key.name, ""), now, low, high)
            )
    return found


def with_numbers(scene: Scene, numbers: list[Number], values: dict[str, float]) -> Scene:
    """The scene with its numbers at values (SI, by key), made by its constructors, which check what joins them."""
    changed: dict[tuple[str, ...], dict[int | None, float]] = {}
    for number in numbers:
        if values[number.key] != number.value:
            changed.setdefault(number.names, {})[number.entry] = values[number.key]

    def rebuilt(module: Any, names: tuple[str, ...]) -> Any:
        given = {}
        for field in dataclasses.fields(module):
            path, value = (*names, field.name), getattr(module, field.name)
            if path in changed:
                array = np.array(value, dtype=float)
                for entry, one in changed[path].items():
                    array[() if entry is None else entry] = one
                given[field.name] = jnp.asarray(array)
            elif isinstance(value, Checked) and any(p[: len(path)] == path for p in changed):
                given[field.name] = rebuilt(value, path)
        return dataclasses.replace(module, **given) if given else module

    with units_are_stated(), located("this scene"):
        return rebuilt(scene, ())


def leaf_index(scene: Scene, numbers: list[Number]) -> list[int]:
    """The place of every number among all numbers of the scene's leaves in their order."""
    leaves, structure = jax.tree.flatten(scene)
    starts = np.concatenate([[0], np.cumsum([np.size(leaf) for leaf in leaves])])
    numbered = jax.tree.unflatten(structure, list(range(len(leaves))))
    found = []
    for number in numbers:
        node: Any = numbered
        for name in number.names:
            node = getattr(node, name)
        found.append(int(starts[node]) + (number.entry or 0))
    return found


def choices_of(scene: Scene) -> list[Choice]:
    """Every choice of a scene that a config could hold; none for a scene that holds more than a config can."""
    try:
        to_table(scene, (Scene,))
    except ConfigError:
        return []
    return _choices(scene, (), ())


def _choices(module: Any, path: tuple[str, ...], bases: tuple[type, ...]) -> list[Choice]:
    found, docs = [], documented(type(module))
    options = tuple(classes_of(bases)) if bases else ()
    if len(options) > 1:
        found.append(Choice(".".join((*path, "type")), (*path, "type"), options, type_name(type(module)), ""))
    for key in keys_of(type(module)).values():
        value, own = getattr(module, key.name), (*path, key.key)
        allowed = _options(module, key)
        if isinstance(value, Checked) and "types" in key.field.metadata:
            found += _choices(value, own, key.field.metadata["types"])
        elif allowed:
            now = type(value).__name__.lower() if isinstance(value, Checked) else value
            now = allowed[0] if now is None else (str(now) if isinstance(now, str) else now)
            found.append(Choice(".".join(own), own, allowed, now, docs.get(key.name, "")))
    return found


def _options(module: Any, key: Key) -> tuple[Any, ...]:
    meta, value = key.field.metadata, getattr(module, key.name)
    if "allowed" in meta or "methods" in meta:
        return tuple(meta.get("allowed", meta.get("methods")))
    if key.annotation is bool:
        return (False, True)
    if key.annotation is int:
        return tuple(k for k in range(1, max(MOST_FINGERS, int(value) + 2) + 1) if _keeps_rules(module, key.name, k))
    return ()


def _keeps_rules(module: Any, name: str, value: Any) -> bool:
    """Whether a part can be made with another value of one field."""
    try:
        with units_are_stated():
            dataclasses.replace(module, **{name: value})
    except InputError:
        return False
    return True


def chosen(scene: Scene, choice: Choice, option: Any) -> Scene:
    """The scene with another choice; a part of another type keeps the numbers that both types have."""
    table = to_table(scene, (Scene,))
    node = table
    for key in choice.path[:-1]:
        node = node[key]
    if choice.path[-1] == "type":
        bases = _bases_at(type(scene), choice.path[:-1])
        before, made = read_module(bases, dict(node), "[scene]"), example(classes_of(bases)[option])
        kept = {key: value for key, value in node.items() if key != "type"}
        if hasattr(before, "shear_modulus"):
            made = _as_stiff(made, before)
            kept = {key: value for key, value in kept.items() if key in _numbers_alone(before) & _numbers_alone(made)}
        fresh = to_table(made, bases)
        node.clear()
        node.update(fresh | {key: value for key, value in kept.items() if key in fresh})
        if getattr(made, "tapers", False) and not {"tip_offset_mm", STAND} & set(table):
            table[STAND] = FROM_GROUND * table["gripper"]["finger"]["L_mm"]
    else:
        node[choice.path[-1]] = option
    with located(choice.key):
        return read_module((Scene,), table, "[scene]")


def _as_stiff(material: Any, other: Any) -> Any:
    """A material whose moduli are stretched until its shear modulus is that of another one."""
    factor = other.shear_modulus() / material.shear_modulus()
    moduli = [key.name for key in keys_of(type(material)).values() if key.field.metadata.get("kind") == "pressure"]
    return dataclasses.replace(material, **{name: factor * getattr(material, name) for name in moduli})


def _numbers_alone(material: Any) -> set[str]:
    """Keys of the numbers of a material that are no moduli, and no arrays."""
    keys = [key for key in keys_of(type(material)).values() if key.field.metadata.get("kind") != "pressure"]
    return {key.key for key in keys if np.ndim(getattr(material, key.name)) == 0}


def _bases_at(cls: type, path: tuple[str, ...]) -> tuple[type, ...]:
    """The classes that the part at a path of keys accepts; of several, those of the first class that has the path."""
    bases: tuple[type, ...] = (cls,)
    for name in path:
        for one in classes_of(bases).values():
            key = keys_of(one).get(name)
            if key is not None and "types" in key.field.metadata:
                bases = key.field.metadata["types"]
                break
        else:
            raise InputError(f"There is no part {name!r}.")
    return bases


def as_config(scene: Scene, asked: dict[str, float]) -> str:
    """The scene as a config, with what is asked of it in [solve], by keys with their unit."""
    solve = {"solve": {key: float(f"{value:.12g}") for key, value in asked.items()}} if asked else {}
    return configs.dump(scene, "From softgrip explore.", **solve)
