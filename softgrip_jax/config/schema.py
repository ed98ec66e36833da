"""The JSON schema of the configs: editors complete keys by it and underline what cannot be meant.

One system describes everything, pydantic's. The other sections have models that validate them; the models of scenes and
their parts are made here, of the same fields, rules and docs by which they are read (`config.keys_of`).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from .. import config as configs
from ..fields import documented
from ..objects.friction import Friction
from ..scene import Scene
from ..units import DISPLAY, unit_key
from .keys import Table

DRAFT = "https://json-schema.org/draft/2020-12/schema"
FILE = Annotated[str, Field(pattern=r"\.toml$", description="a file beside the config that has this section")]


class Question(Table):
    """A pressure, or a value of any observable of any scene."""

    model_config = pydantic.ConfigDict(json_schema_extra={"maxProperties": 1})


class Method(pydantic.BaseModel):
    """A method by its name, and its numbers."""

    model_config = pydantic.ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = pydantic.Field(init=False)


def schema(sections: dict[str, type[pydantic.BaseModel]]) -> dict[str, Any]:
    """The schema of a config whose sections other than scenes and [solve] are described by these models."""
    models: dict[str, Any] = {}
    scene = _place((Scene,), models)
    whole = _model(
        "config",
        {
            "scene": (scene, _optional("what to solve")),
            "scenes": (f"dict[str, {scene}]", _optional("several scenes by name")),
            "solve": (_question(), _optional()),
        }
        | {name: (model, _optional()) for name, model in sections.items()},
    )
    for model in (*models.values(), whole):
        if isinstance(model, type):
            model.model_rebuild(_types_namespace=models | {"FILE": FILE})
    return {"$schema": DRAFT} | whole.model_json_schema() | {"title": "config of softgrip"}


def _model(name: str, fields: dict[str, Any], words: str = "", base: Any = Table) -> Any:
    return pydantic.create_model(name, __base__=base, __doc__=words or None, __module__=__name__, **fields)


def _optional(words: str | None = None) -> Any:
    """What may be left out. TOML has no null, so that the schema names no default."""
    return Field(default_factory=lambda: None, description=words)


def _question() -> Any:
    kinds = {"pressure": "pressure"}
    for cls in configs.classes_of((Scene,)).values():
        kinds |= {name: kind for name, kind in cls.OBSERVABLES.items() if kind != "position"}
    return _model("solve", {unit_key(name, kind): (float, _optional()) for name, kind in kinds.items()}, base=Question)


def _place(bases: tuple[type, ...], models: dict[str, Any]) -> str:
    """What may stand where a module of one of `bases` is wanted, by the names of its models; makes those that are not
    yet known. Names, for parts may hold each other."""
    classes = configs.classes_of(bases)
    presets = {name: type(make()) for name, make in configs.presets_of(bases).items()}
    ways = []
    for type_name, cls in classes.items():
        name = f"{cls.__module__.partition('.')[2]}.{cls.__name__}".replace(".", "_")
        own = tuple(preset for preset, made in presets.items() if made is cls)
        ways += [name, f"{name}_preset"] if own else [name]
        if name not in models:
            models[name] = None  # it is under way
            kind: Any = Literal[type_name]
            given = {"type": (kind, ... if len(classes) > 1 else _optional())}
            models[name] = _table(name, cls, given, models)
            if own:
                given = {"type": (kind, _optional()), "preset": (Literal[own], ...)}
                models[f"{name}_preset"] = _table(f"{name}_preset", cls, given, models, all_optional=True)
    return " | ".join(ways if bases == (Scene,) else [*ways, "FILE"])


def _table(name: str, cls: type, given: dict[str, Any], models: dict[str, Any], all_optional: bool = False) -> Any:
    """The model of a class: its keys, and those that are given."""
    docs = documented(cls)
    fields = dict(given)
    for key in configs.keys_of(cls).values():
        words = docs.get(key.name)
        described = Field(description=words) if key.required and not all_optional else _optional(words)
        fields[key.key] = (_type(key, models), described)
    return _model(name, fields, " ".join((cls.__doc__ or "").split("\n\n")[0].split()))


def _type(key: configs.Key, models: dict[str, Any]) -> Any:
    """What may stand at a key."""
    meta = key.field.metadata
    if "types" in meta:
        return _place(meta["types"], models)
    if meta.get("friction"):
        models["PositiveNumber"] = _number("positive", "number")
        return f"PositiveNumber | {_place((Friction,), models)}"
    if "allowed" in meta:
        return Literal[tuple(meta["allowed"])]
    if "methods" in meta:
        names = Literal[tuple(meta["methods"])]
        return names | _model(f"{key.name}_method", {"type": (names, ...)}, base=Method)
    if "names" in meta:
        return list[Literal[tuple(meta["names"])]]
    if "rule" in meta:
        number = _number(meta["rule"], meta["kind"])
        if "size" in meta:
            return Annotated[list[number], Field(min_length=meta["size"], max_length=meta["size"])]
        shapes = configs.shapes_of(key.annotation)
        several = Annotated[list[number], Field(min_length=1)]
        return number | several if "" in shapes and any(shapes) else number if "" in shapes else several
    return Annotated[key.annotation, Field(ge=meta["least"])] if "least" in meta else key.annotation


def _number(rule: str, kind: str) -> Any:
    """A number that keeps a rule of `fields.RULES`, in the unit of its key."""
    quarter = float(f"{0.5 * math.pi / DISPLAY[kind][1]:.12g}")
    limits = {
        "positive": Field(gt=0),
        "nonnegative": Field(ge=0),
        "nonzero": Field(json_schema_extra={"not": {"const": 0}}),
        "finite": Field(),
        "right_angle": Field(ge=0, lt=quarter),
    }
    return Annotated[float, limits[rule]]
