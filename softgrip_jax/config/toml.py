"""A config: its sections, its scenes, and what [solve] asks.

In goes a TOML file, out comes a `Config`; `dump` is the way back. A mistake is a ConfigError: one sentence that says
where it is, what was found, and what is allowed.
"""

from __future__ import annotations

import codecs
import dataclasses
import inspect
import tomllib
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pydantic
import tomli_w

from .. import plugins
from ..errors import ConfigError, InputError
from ..scene import Scene
from ..units import unit_key
from .modules import read_module, read_numbers, to_table
from .sentences import shown, unknown

OWN_SECTIONS = ("scene", "scenes", "solve", "sweep", "sensitivity")
"""The sections that this package reads; others may read more of them, see `plugins`."""

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


def section_names() -> tuple[str, ...]:
    """The sections that a config may have."""
    return (*OWN_SECTIONS, *plugins.found(plugins.SECTIONS))


def read_sections(path: Path) -> dict[str, dict[str, Any]]:
    """The sections of a config, with the parts that stand in files of their own."""
    tables, known = read_toml(path), section_names()
    for name, table in tables.items():
        if name not in known:
            raise ConfigError(f"{path}: {unknown(f'section [{name}]', name, known)}")
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: {name} is {shown(table)}; it must be a section, [{name}].")
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
    given = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    tables = read_sections(path)
    if tables == tomllib.loads(given.decode()):
        return given
    return f"# {path.name}, with the parts that stood in other files.\n{tomli_w.dumps(tables)}".encode()


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
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
            raise ConfigError(f"{where}: {unknown(f'key {key}', key, keys)}")
    if len(table) > 1:
        raise ConfigError(f"{where}: {' and '.join(table)} are both given; one pressure can meet one of them.")
    if table:
        key, value = next(iter(table.items()))
        name, kind = keys[key]
        rule = "nonnegative" if name == "pressure" else "finite"
        return {name: float(read_numbers(value, f"{where}: {key}", rule, kind, [""]))}
    pressure, *others = keys
    if not config.scene.has_target():
        raise ConfigError(
            f"{config.path}: there is nothing to solve for; give {pressure} or an observable, for instance "
            f"{others[0]}, in [solve]."
        )
    try:
        config.scene.target()
    except InputError as error:
        raise ConfigError(
            f"{config.path}: there is nothing to solve for: {str(error).rstrip('.')}; give {pressure} or an observable "
            "in [solve]."
        ) from None
    return {}


def validated(model: type[pydantic.BaseModel], table: dict[str, Any], where: str) -> Any:
    """A table as a pydantic model, its first mistake as a ConfigError."""
    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        # A misspelt key is two errors, one unknown and one missing: the first says more.
        # Of a key that may be several things, that a number in it is not finite says more than that it is no text.
        ranks = {"extra_forbidden": 0, "finite_number": 1}
        first = min(error.errors(), key=lambda e: ranks.get(e["type"], 2))
        place = _place(model, first["loc"])
        if first["type"] == "finite_number":
            place = (*place, *first["loc"][len(place) + 1 :])
            first["loc"] = place
        key = ".".join(str(part + 1) if isinstance(part, int) else part for part in place)
        if first["type"] == "extra_forbidden":
            *parents, name = first["loc"]
            known = _keys_within(model, parents)
            raise ConfigError(f"{where}: {unknown(f'key {key}', str(name), known)}") from None
        if first["type"] == "missing":
            raise ConfigError(f"{where}: the key {key} is missing.") from None
        reason = first["msg"].removeprefix("Value error, ").removeprefix("Input ").rstrip(".")
        if first["type"] == "model_type":
            reason = "must be a table"
        elif first["type"] in ("too_short", "too_long"):
            words, limit = ("at least", "min_length") if first["type"] == "too_short" else ("at most", "max_length")
            sizes = first.get("ctx", {})
            entries = "entry" if sizes.get(limit) == 1 else "entries"
            reason = f"must have {words} {sizes.get(limit)} {entries} and has {sizes.get('actual_length')}"
        elif len(place) < len(first["loc"]):
            kinds = [e["loc"][len(place)] for e in error.errors() if e["loc"][: len(place)] == place]
            reason = f"must be {' or '.join(dict.fromkeys(KINDS.get(str(kind), str(kind)) for kind in kinds))}"
            first = {"input": _within(table, place)}
        raise ConfigError(f"{where}: {key} is {shown(first['input'])}; it {reason}.") from None


KINDS = {
    "str": "a text",
    "list[str]": "a list of texts",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "list[float]": "a list of numbers",
    "dict[str,float]": "a table of numbers",
    "dict[str,union[float,list[float]]]": "a table of numbers",
}
"""What a key may be, where it may be several things, by pydantic's names."""


def _place(model: type[pydantic.BaseModel], loc: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """The part of a place that says where: behind it pydantic says which of several kinds it has tried."""
    for k, part in enumerate(loc):
        if part in KINDS and part not in _keys_within(model, loc[:k]):
            return loc[:k]
    return loc


def _within(table: Any, place: Iterable[str | int]) -> Any:
    for part in place:
        table = table[part]
    return table


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


# --- modules to tables ------------------------------------------------------------------------------------------------


def dump(scenes: Scene | dict[str, Scene], comment: str = "", **tables: dict[str, Any]) -> str:
    """A config that `load` reads back as the same scene or scenes; `tables` are its other sections, as they stand."""
    scenes = {SCENE: scenes} if isinstance(scenes, Scene) else scenes
    found = {name: to_table(scene, (Scene,)) for name, scene in scenes.items()}
    text = tomli_w.dumps((found if list(found) == [SCENE] else {"scenes": found}) | tables)
    return "".join(f"# {line}\n" for line in comment.splitlines()) + text
