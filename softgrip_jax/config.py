"""TOML in, scenes out, and back: the one place where units of people become SI.

Nothing here is written per scene. The keys of a table follow from the fields of the class that it describes:

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
import difflib
import functools
import inspect
import sys
import tomllib
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pydantic
import tomli_w

from . import pneunet as pneunet
from . import shell as shell
from .checked import RULES, Checked, wanted
from .errors import ConfigError as ConfigError
from .errors import InputError, located
from .objects import Friction
from .plausible import units_are_stated
from .scene import Scene
from .units import DISPLAY
from .units import unit_key as unit_key

SECTIONS = ("scene", "scenes", "solve", "design", "sweep", "sensitivity", "calibrate", "tension")
"""The tables that a config may have."""

SCENE = "scene"
"""What the one scene of a config is called."""


@dataclasses.dataclass(frozen=True)
class Config:
    """A config as read: its scenes by name, and the other tables for those who run them."""

    path: Path
    scenes: dict[str, Scene]
    tables: dict[str, dict[str, Any]]

    @property
    def scene(self) -> Scene:
        """The one scene; a ConfigError where there are several."""
        if len(self.scenes) > 1:
            raise ConfigError(f"{self.path} has several scenes ({', '.join(self.scenes)}); this needs one of them.")
        return next(iter(self.scenes.values()))


class Key(NamedTuple):
    """How one field of a class is written in a table."""

    name: str
    """Of the field."""
    key: str
    """In the table: the name, with the unit."""
    field: Any
    annotation: Any
    required: bool


class Leaf(NamedTuple):
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


def load(path: str | Path) -> Config:
    """Read a config. Raises ConfigError for anything that is wrong in it."""
    path = Path(path)
    tables = read_sections(path)
    if "scene" in tables and "scenes" in tables:
        raise ConfigError(f"{path}: there are [scene] and [scenes]; one scene is [scene], several are [scenes.NAME].")
    found = {SCENE: tables["scene"]} if "scene" in tables else tables.get("scenes", {})
    if not found:
        raise ConfigError(f"{path}: there is no section [scene], which says what to solve.")
    scenes = {}
    for name, table in found.items():
        where = f"{path}, [scene]" if "scene" in tables else f"{path}, [scenes.{name}]"
        scenes[name] = read_module((Scene,), table, where)
    return Config(path, scenes, {name: table for name, table in tables.items() if name not in ("scene", "scenes")})


def read_sections(path: Path) -> dict[str, dict[str, Any]]:
    """The sections of a config, with the parts that stand in files of their own."""
    tables = read_toml(path)
    for name, table in tables.items():
        if name not in SECTIONS:
            raise ConfigError(f"{path}: {_unknown(f'section [{name}]', name, SECTIONS)}")
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: {name} is {_show(table)}; it must be a section, [{name}].")
    return {name: _with_parts(table, path, f"[{name}") for name, table in tables.items()}


def _with_parts(table: dict[str, Any], path: Path, where: str) -> dict[str, Any]:
    """The table with every `key = "file.toml"` replaced by the section [key] of that file beside the config."""
    whole = {}
    for key, value in table.items():
        if isinstance(value, str) and value.endswith(".toml"):
            file = path.parent / value
            try:
                sections = read_toml(file)
            except ConfigError as error:
                raise ConfigError(f"{path}, {where}]: {key} is {value!r}: {error}") from None
            if not isinstance(sections.get(key), dict):
                raise ConfigError(f"{path}, {where}]: {key} is {value!r}; that file has no section [{key}].")
            value = sections[key]
        elif isinstance(value, dict):
            value = _with_parts(value, path, f"{where}.{key}")
        whole[key] = value
    return whole


def standalone(path: Path) -> bytes:
    """A config as it was given, or, where parts of it stand in other files, with those parts in it."""
    given = path.read_bytes()
    tables = read_sections(path)
    if tables == tomllib.loads(given.decode()):
        return given
    return f"# {path.name}, with the parts that stood in other files.\n{tomli_w.dumps(tables)}".encode()


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: this is not TOML: {error}.") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: this is not a text file in UTF-8 (byte {error.start}).") from None
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}.") from None


def question(config: Config) -> dict[str, float]:
    """What [solve] asks, in SI: {"pressure": p}, {observable: value}, or {} for a scene that knows its own target."""
    table, where = config.tables.get("solve", {}), f"{config.path}, [solve]"
    observables = config.scene.prepared().OBSERVABLES
    keys = {unit_key("pressure", "pressure"): ("pressure", "pressure")}
    keys |= {unit_key(name, kind): (name, kind) for name, kind in observables.items() if kind != "position"}
    for key in table:
        if key not in keys:
            raise ConfigError(f"{where}: {_unknown(f'key {key}', key, keys)}")
    if len(table) > 1:
        raise ConfigError(f"{where}: {' and '.join(table)} are both given; one pressure can meet one of them.")
    if table:
        key, value = next(iter(table.items()))
        name, kind = keys[key]
        rule = "nonnegative" if name == "pressure" else "finite"
        return {name: float(read_numbers(value, f"{where}: {key}", rule, kind, [""]))}
    try:
        config.scene.target()
    except InputError as error:
        raise ConfigError(
            f"{config.path}: there is nothing to solve for: {str(error).rstrip('.')}; "
            f"give {unit_key('pressure', 'pressure')} or an observable in [solve]."
        ) from None
    return {}


def validated(model: type[pydantic.BaseModel], table: dict[str, Any], where: str) -> Any:
    """A table as a pydantic model, its first mistake as a ConfigError."""
    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        # A misspelt key is two errors, one unknown and one missing: the first says more.
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        key = ".".join(str(part + 1) if isinstance(part, int) else part for part in first["loc"])
        if first["type"] == "extra_forbidden":
            *parents, name = first["loc"]
            known = _keys_within(model, parents)
            raise ConfigError(f"{where}: {_unknown(f'key {key}', str(name), known)}") from None
        if first["type"] == "missing":
            raise ConfigError(f"{where}: the key {key} is missing.") from None
        reason = first["msg"].removeprefix("Value error, ").removeprefix("Input ").rstrip(".")
        raise ConfigError(f"{where}: {key} is {_show(first['input'])}; it {reason}.") from None


def _keys_within(model: type[pydantic.BaseModel], place: Iterable[str | int]) -> Iterable[str]:
    """The keys of the table at a place within the table of a model: ("goals", 0) is the first of [[design.goals]]."""
    for part in place:
        if isinstance(part, int):
            continue
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        inner = next((a for a in typing.get_args(annotation) or (annotation,) if inspect.isclass(a)), None)
        if inner is None or not issubclass(inner, pydantic.BaseModel):
            return ()
        model = inner
    return model.model_fields


def leaf(scene: Scene, dotted: str, where: str) -> Leaf:
    """The number of a scene that a dotted key with its unit names, for instance 'shell.a_mm'."""
    *parents, last = dotted.split(".")
    module: Any = scene
    for parent in parents:
        fields = [key.name for key in keys_of(type(module)).values() if isinstance(getattr(module, key.name), Checked)]
        if parent not in fields:
            raise ConfigError(f"{where}: {_unknown(f'part {parent} in {dotted!r}', parent, fields)}")
        module = getattr(module, parent)
    numbers = {key.key: key for key in keys_of(type(module)).values() if _rule(key, module) is not None}
    if last not in numbers:
        raise ConfigError(f"{where}: {_unknown(f'number {dotted!r}', last, numbers)}")
    rule, kind = _rule(numbers[last], module) or ("", "")
    return Leaf((*parents, numbers[last].name), kind, rule)


def number_keys(module: Any) -> list[str]:
    """The dotted keys of all numbers of a module that are not zero."""
    keys: list[str] = []
    for key in keys_of(type(module)).values():
        value = getattr(module, key.name)
        if isinstance(value, Checked):
            keys += [f"{key.name}.{inner}" for inner in number_keys(value)]
        elif value is not None and _rule(key, module) is not None and np.any(np.asarray(value) != 0):
            keys.append(key.key)
    return keys


def _rule(key: Key, module: Any) -> tuple[str, str] | None:
    if key.field.metadata.get("friction"):
        return None if callable(getattr(module, key.name)) else ("positive", "number")
    return (key.field.metadata["rule"], key.field.metadata["kind"]) if "rule" in key.field.metadata else None


# --- tables to modules ------------------------------------------------------------------------------------------------


def read_module(bases: tuple[type, ...], table: Any, where: str) -> Any:
    """The module that a table describes: an instance of one of `bases` or of a subclass."""
    if not isinstance(table, dict):
        raise ConfigError(f"{where} is {_show(table)}; it must be a table.")
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
            raise ConfigError(f"{where}: {_unknown(f'key {name} of {type_name(cls)}', name, keys)}")
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
        return read_numbers(value, place, meta["rule"], meta["kind"], shapes)
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
            raise ConfigError(f"{place} is {_show(value)}; it must be one of {', '.join(map(repr, meta['methods']))}.")
        return value
    if "names" in meta:
        if not isinstance(value, list):
            raise ConfigError(f"{place} is {_show(value)}; it must be a list of names from {', '.join(meta['names'])}.")
        return tuple(pick(name, {name: name for name in meta["names"]}, place) for name in value)
    if type(value) is not key.annotation:
        kind = {int: "a whole number", bool: "true or false", str: "a text"}[key.annotation]
        raise ConfigError(f"{place} is {_show(value)}; it must be {kind}.")
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
    raise ConfigError(f"{place} is {_show(value)}; it must be {words}.")


def _fits(value: Any, shape: str) -> bool:
    if shape == "":
        return not isinstance(value, list)
    return isinstance(value, list) and len(value) > 0 and (not shape.isdigit() or len(value) == int(shape))


# --- modules to tables ------------------------------------------------------------------------------------------------


def dump(scenes: Scene | dict[str, Scene], comment: str = "", **tables: dict[str, Any]) -> str:
    """A config that `load` reads back as the same scene or scenes; `tables` are its other sections, as they stand."""
    scenes = {SCENE: scenes} if isinstance(scenes, Scene) else scenes
    found = {name: to_table(scene, (Scene,)) for name, scene in scenes.items()}
    text = tomli_w.dumps((found if list(found) == [SCENE] else {"scenes": found}) | tables)
    return "".join(f"# {line}\n" for line in comment.splitlines()) + text


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
        else:
            table[key.key] = list(value) if "names" in meta else value
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
    """Every class that a table can describe: the concrete ones whose fields all have a key."""
    found: dict[str, type] = {}
    for cls in bases:
        described = [key.name for key in keys_of(cls).values()]
        whole = all(f.name in described or not _is_required(f) for f in dataclasses.fields(cls))
        if whole and not inspect.isabstract(cls) and _is_offered(cls):
            found.setdefault(type_name(cls), cls)
        for name, subclass in classes_of(cls.__subclasses__()).items():
            found.setdefault(name, subclass)
    return found


def _is_offered(cls: type) -> bool:
    """True for what a room of the package shows to its users, and for everybody's own classes."""
    package, _, rooms = cls.__module__.partition(".")
    if package != __package__ or not issubclass(cls, Scene):
        return True
    return getattr(sys.modules[f"{package}.{rooms.split('.')[0]}"], cls.__name__, None) is cls


def presets_of(bases: Iterable[type]) -> dict[str, Any]:
    """Ready modules: the dictionary PRESETS of the room that defines a class."""
    return {name: make for cls in bases for name, make in getattr(sys.modules[cls.__module__], "PRESETS", {}).items()}


def type_name(cls: type) -> str:
    """How `type` names a class: the package's scenes by room and class ('shell.Grasp'), all else by class alone."""
    package, _, rooms = cls.__module__.partition(".")
    if not issubclass(cls, Scene) or package != __package__:
        return cls.__name__
    return f"{rooms.split('.')[0]}.{cls.__name__}"


# --- sentences --------------------------------------------------------------------------------------------------------


def pick(name: Any, options: dict[str, Any], place: str) -> Any:
    if isinstance(name, str) and name in options:
        return options[name]
    close = difflib.get_close_matches(str(name), options, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"it must be one of {', '.join(map(repr, options))}."
    raise ConfigError(f"{place} is {_show(name)}; {hint}")


def _unknown(what: str, name: str, allowed: Iterable[str]) -> str:
    allowed = list(allowed)
    # 'radius' and 'radius_cm' for 'radius_mm': the same quantity in another unit comes before similar spelling.
    same = [key for key in allowed if key.split("_")[0] == name.split("_")[0] and key.startswith(_stem(name))]
    close = same[:1] or difflib.get_close_matches(name, allowed, 1)
    if close:
        return f"there is no {what}; did you mean {close[0]}?"
    return f"there is no {what}; allowed are {', '.join(allowed)}." if allowed else f"there is no {what}."


def _stem(name: str) -> str:
    return name.rsplit("_", 1)[0]


def _show(value: Any) -> str:
    """A value as it stands in a config, cut where it is long."""
    text = {True: "true", False: "false"}.get(value, "") if isinstance(value, bool) else repr(value)
    text = f"{value:.12g}" if isinstance(value, float) else text
    text = "a table" if isinstance(value, dict) else text
    return text if len(text) <= 60 else text[:57] + "..."
