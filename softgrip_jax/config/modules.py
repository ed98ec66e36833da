"""Tables to modules and back: the keys of a table follow from the fields of the class that it describes.

Nothing here is written per scene. The unit of a key becomes SI in `read_numbers`, and nowhere else:

    a = positive("length")            a_mm = 16             the key carries the unit of its kind (units.DISPLAY)
    friction = friction()             friction = 0.96       or a table [scene.friction] with force_N, coefficient
    lever = choice("exact", "rim")    lever = "rim"
    beam = beam_method()              beam = "shooting", or a table { type = "shooting", rtol = 1e-6 }
    ignored_rules = rule_names()      ignored_rules = ["chambers_apart"]
    shell = part(FlatShell)           [scene.shell]         `type` chooses where several classes fit, `preset` a
    fingers: int (static)             fingers = 2           ready one, whose other keys may be overridden;
                                                            shell = "mine.toml" is the section [shell] of that file

so a new scene, material or object can be used in a config without a line here. A mistake is a ConfigError: one
sentence that says where it is, what was found, and what is allowed.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import sys
import typing
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from .. import pneunet as pneunet  # a class has a key once it is known
from .. import shell as shell
from ..errors import ConfigError as ConfigError
from ..errors import InputError, located
from ..fields import RULES, Checked, wanted
from ..objects.friction import Friction
from ..plausible import units_are_stated, warn_of_key
from ..scene import Scene, type_name
from ..units import DISPLAY
from ..units import unit_key as unit_key
from .sentences import pick, shown, unknown

PACKAGE = __name__.partition(".")[0]


class Key(NamedTuple):
    """How one field of a class is written in a table."""

    name: str
    """Of the field."""
    key: str
    """In the table: the name, with the unit."""
    field: Any
    annotation: Any
    required: bool


class NumberKey(NamedTuple):
    """A number of a scene, as named in a config: 'shell.a_mm'."""

    names: tuple[str, ...]
    """Attributes from the scene down to the number."""
    kind: str
    """Kind of quantity, a key of units.DISPLAY."""
    rule: str

    @property
    def unit(self) -> float:
        """The unit of the key in SI."""
        return DISPLAY[self.kind][1]

    def get(self, scene: Any) -> Any:
        """The number, in SI."""
        return functools.reduce(getattr, self.names, scene)


def leaf(scene: Scene, dotted: str, where: str) -> NumberKey:
    """The number of a scene that a dotted key with its unit names, for instance 'shell.a_mm'."""
    found = _leaves(scene)
    if dotted not in found:
        raise ConfigError(f"{where}: {unknown(f'number {dotted!r}', dotted, found)}")
    return found[dotted]


def number_keys(module: Any, zeros: bool = False) -> list[str]:
    """The dotted keys of all numbers of a module, of those that are zero if asked."""
    return [
        dotted
        for dotted, key in _leaves(module).items()
        if zeros or (key.get(module) is not None and np.any(np.asarray(key.get(module)) != 0))
    ]


def _leaves(module: Any) -> dict[str, NumberKey]:
    """All numbers of a module and of its parts, by their dotted keys."""
    found: dict[str, NumberKey] = {}
    for key in keys_of(type(module)).values():
        value, rule = getattr(module, key.name), _rule(key, module)
        if isinstance(value, Checked):
            found |= {
                f"{key.name}.{dotted}": inner._replace(names=(key.name, *inner.names))
                for dotted, inner in _leaves(value).items()
            }
        elif rule is not None:
            found[key.key] = NumberKey((key.name,), rule[1], rule[0])
    return found


def _rule(key: Key, module: Any) -> tuple[str, str] | None:
    if key.field.metadata.get("friction"):
        return None if callable(getattr(module, key.name)) else ("positive", "number")
    return (key.field.metadata["rule"], key.field.metadata["kind"]) if "rule" in key.field.metadata else None


# --- tables to modules ------------------------------------------------------------------------------------------------


def read_module(bases: tuple[type, ...], table: Any, where: str) -> Any:
    """The module that a table describes: an instance of one of `bases` or of a subclass."""
    if not isinstance(table, dict):
        known = isinstance(table, str) and table in presets_of(bases)
        hint = f', for instance {{ preset = "{table}" }}' if known else ""
        raise ConfigError(f"{where} is {shown(table)}; it must be a table{hint}.")
    table = dict(table)
    classes = classes_of(bases)
    given: dict[str, Any] = {}
    if "preset" in table:
        preset = pick(table.pop("preset"), presets_of(bases), f"{where}: preset")()
        cls = type(preset)
        if table.pop("type", type_name(cls)) != type_name(cls):
            raise ConfigError(f"{where}: the preset is a {type_name(cls)}; leave out type.")
        given = {key.name: getattr(preset, key.name) for key in keys_of(cls).values()}
    elif "type" in table:
        cls = pick(table.pop("type"), classes, f"{where}: type")
    elif len(classes) == 1:
        cls = next(iter(classes.values()))
    else:
        raise ConfigError(f"{where}: the key type is missing; it must be one of {', '.join(classes)}.")
    keys = keys_of(cls)
    for name, value in table.items():
        if name not in keys:
            raise ConfigError(f"{where}: {unknown(f'key {name} of {type_name(cls)}', name, keys)}")
        given[keys[name].name] = read_field(keys[name], value, where)
    for key in keys.values():
        if key.required and key.name not in given:
            raise ConfigError(f"{where}: the key {key.key} of {type_name(cls)} is missing.")
    with located(where), units_are_stated():
        return cls(**given)


def read_field(key: Key, value: Any, where: str) -> Any:
    """The value of one field from what stands in the table."""
    meta, place = key.field.metadata, f"{where}: {key.key}"
    if "rule" in meta:
        shapes = [str(meta["size"])] if "size" in meta else shapes_of(key.annotation)
        numbers = read_numbers(value, place, meta["rule"], meta["kind"], shapes)
        if not isinstance(value, list):
            warn_of_key(place, float(value), meta["kind"], meta["rule"])
        return numbers
    if meta.get("friction"):
        if isinstance(value, dict):
            return read_module((Friction,), value, f"{where[:-1]}.{key.key}]")
        return read_numbers(value, place, "positive", "number", [""])
    if "types" in meta:
        return read_module(meta["types"], value, f"{where[:-1]}.{key.key}]")
    if "allowed" in meta:
        return pick(value, {name: name for name in meta["allowed"]}, place)
    if "methods" in meta:
        # A name or a table of numbers; what is wrong with it is said where the scene is made.
        if not isinstance(value, str | dict):
            raise ConfigError(f"{place} is {shown(value)}; it must be one of {', '.join(map(repr, meta['methods']))}.")
        return value
    if "names" in meta:
        if not isinstance(value, list):
            raise ConfigError(f"{place} is {shown(value)}; it must be a list of names from {', '.join(meta['names'])}.")
        return tuple(pick(name, {name: name for name in meta["names"]}, place) for name in value)
    if type(value) is not key.annotation:
        kind = {int: "a whole number", bool: "true or false", str: "a text"}[key.annotation]
        raise ConfigError(f"{place} is {shown(value)}; it must be {kind}.")
    return value


def read_numbers(value: Any, place: str, rule: str, kind: str, shapes: list[str]) -> Any:
    """A number, or a list of numbers where one of the shapes has an axis, in SI."""
    label, unit = DISPLAY[kind]
    fits = [shape for shape in shapes if _fits(value, shape)]
    values = value if isinstance(value, list) else [value]
    if fits and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        try:
            numbers = np.asarray(value, dtype=float) * unit
        except OverflowError:
            numbers = np.asarray(np.inf)
        if np.all(RULES[rule][1](numbers)):
            return numbers
    words = wanted(rule, label)
    if not any(shape == "" for shape in shapes):
        count = next((f"{shape} " for shape in shapes if shape.isdigit()), "")
        words = f"a list of {count}numbers, each {words}"
    elif any(shapes):
        words += ", or a list of such numbers"
    raise ConfigError(f"{place} is {shown(value)}; it must be {words}.")


def _fits(value: Any, shape: str) -> bool:
    if shape == "":
        return not isinstance(value, list)
    return isinstance(value, list) and len(value) > 0 and (not shape.isdigit() or len(value) == int(shape))


def to_table(module: Any, bases: tuple[type, ...]) -> dict[str, Any]:
    """The table that describes a module; `bases` are the classes that its place accepts."""
    table: dict[str, Any] = {} if len(classes_of(bases)) == 1 else {"type": type_name(type(module))}
    if type(module) not in classes_of(bases).values():
        raise ConfigError(f"A {type(module).__name__} cannot be written to a config: it holds more than numbers.")
    for key in keys_of(type(module)).values():
        value, meta = getattr(module, key.name), key.field.metadata
        if value is None and "size" in meta and key.field.default is not None:
            value = np.zeros(meta["size"])  # left out it would be the default
        if value is None or ("names" in meta and not value):
            continue
        if "types" in meta or isinstance(value, Friction):
            table[key.key] = to_table(value, meta.get("types", (Friction,)))
        elif "rule" in meta or meta.get("friction"):
            table[key.key] = _in_unit(np.asarray(value), DISPLAY[meta.get("kind", "number")][1])
        elif "methods" in meta:
            table[key.key] = _method_table(key, value)
        else:
            if isinstance(value, meta.get("instance", ())):
                raise ConfigError(f"{key.key} is a {type(value).__name__}, and a config can hold a name there only.")
            table[key.key] = list(value) if "names" in meta else str(value) if "instance" in meta else value
    return table


def _method_table(key: Key, method: Any) -> dict[str, Any]:
    """The table of a method: its name, and the fields in which it is not what the name alone stands for."""
    name, read = type(method).__name__.lower(), key.field.metadata["converter"]
    try:
        plain = read(name)
        own = {field.name: getattr(method, field.name) for field in dataclasses.fields(method)}
        table = {"type": name} | {field: value for field, value in own.items() if value != getattr(plain, field, None)}
        read(table)
    except InputError as error:
        raise ConfigError(f"{key.key} is a {type(method).__name__} that no config can say: {error}") from None
    return table


def _in_unit(value: Any, unit: float) -> Any:
    """The value in its unit, with the shortest decimals that read back as the same float where there are such."""
    if np.ndim(value):
        return [_in_unit(v, unit) for v in value]
    number = float(value) / unit
    short = float(f"{number:.15g}")
    return short if short * unit == float(value) else number


# --- classes and their keys -------------------------------------------------------------------------------------------


@functools.cache
def keys_of(cls: type) -> dict[str, Key]:
    """The keys that describe a class, in the order of its fields."""
    hints = typing.get_type_hints(cls)
    keys = []
    for field in dataclasses.fields(cls):
        meta, annotation = field.metadata, hints[field.name]
        known = any(word in meta for word in ("rule", "types", "allowed", "names", "methods")) or meta.get("friction")
        if not known and annotation not in (int, bool, str):
            continue
        if "rule" in meta and "size" not in meta and not shapes_of(annotation):
            name = str(getattr(annotation, "__name__", annotation)).rpartition(".")[2]
            raise ConfigError(
                f"{cls.__name__}.{field.name} is annotated {name}, which does not say whether it is one number or a "
                "list; write Float[Array, ''] (softgrip_jax.scene.Scalar) for a number, Float[Array, 'n'] for a list."
            )
        key = unit_key(field.name, meta["kind"]) if "rule" in meta else field.name
        keys.append(Key(field.name, key, field, annotation, _is_required(field)))
    return {key.key: key for key in keys}


def _is_required(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def shapes_of(annotation: Any) -> list[str]:
    """The shapes that an annotation allows: '' for a number, 'n' or '2' for a list."""
    options = typing.get_args(annotation) or (annotation,)
    return [option.dim_str.strip() for option in options if hasattr(option, "dim_str")]


def classes_of(bases: Iterable[type]) -> dict[str, type]:
    """Every class that a table can describe: the concrete ones whose fields all have a key; scenes room by room."""
    found: dict[str, type] = {}
    for cls in bases:
        described = [key.name for key in keys_of(cls).values()]
        whole = all(f.name in described or not _is_required(f) for f in dataclasses.fields(cls))
        if whole and not inspect.isabstract(cls) and _is_offered(cls):
            found.setdefault(type_name(cls), cls)
        for name, subclass in classes_of(cls.__subclasses__()).items():
            found.setdefault(name, subclass)
    return dict(sorted(found.items(), key=lambda item: item[0].startswith("pneunet.")))


def _is_offered(cls: type) -> bool:
    """True for what a room of the package shows to its users, and for everybody's own classes."""
    package, _, rooms = cls.__module__.partition(".")
    if package != PACKAGE or not issubclass(cls, Scene):
        return True
    return getattr(sys.modules[f"{package}.{rooms.split('.')[0]}"], cls.__name__, None) is cls


def presets_of(bases: Iterable[type]) -> dict[str, Any]:
    """Ready modules: the dictionary PRESETS of a file that defines such a class, or of its folder."""
    bases, found = tuple(bases), {}
    for cls in (*bases, *classes_of(bases).values()):
        for place in (cls.__module__, cls.__module__.rpartition(".")[0]):
            found |= getattr(sys.modules.get(place), "PRESETS", {})
    return found
