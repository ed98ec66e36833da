"""The JSON schema of the configs: editors complete keys by it and underline what cannot be meant.

Scenes and their parts are described by the same fields, rules and docstrings that read them (`config.keys_of`), the
other sections by the pydantic models that validate them.
"""

from __future__ import annotations

from typing import Any

import pydantic

from .. import config as configs
from ..objects.friction import Friction
from ..scene import Scene
from ..units import DISPLAY, unit_key
from .template import documented

DRAFT = "https://json-schema.org/draft/2020-12/schema"
FILE = {"type": "string", "pattern": r"\.toml$", "description": "a file beside the config that has this section"}


def schema(sections: dict[str, type[pydantic.BaseModel]]) -> dict[str, Any]:
    """The schema of a config whose sections other than scenes and [solve] are described by these models."""
    defs: dict[str, Any] = {}
    scene = _place((Scene,), defs)
    properties: dict[str, Any] = {
        "scene": scene | {"description": "what to solve"},
        "scenes": {"type": "object", "additionalProperties": scene, "description": "several scenes by name"},
        "solve": _question(),
    }
    for name, model in sections.items():
        table = model.model_json_schema(ref_template=f"#/$defs/{name}.{{model}}")
        defs |= {f"{name}.{inner}": described for inner, described in table.pop("$defs", {}).items()}
        properties[name] = table
    return {
        "$schema": DRAFT,
        "title": "config of softgrip",
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
        "$defs": defs,
    }


def _question() -> dict[str, Any]:
    """[solve]: a pressure, or a value of any observable of any scene."""
    kinds = {"pressure": "pressure"}
    for cls in configs.classes_of((Scene,)).values():
        kinds |= {name: kind for name, kind in cls.OBSERVABLES.items() if kind != "position"}
    keys = {unit_key(name, kind): {"type": "number"} for name, kind in kinds.items()}
    return {"type": "object", "properties": keys, "additionalProperties": False, "maxProperties": 1}


def _place(bases: tuple[type, ...], defs: dict[str, Any]) -> dict[str, Any]:
    """What may stand where a module of one of `bases` is wanted; describes every class of them in `defs`."""
    classes = configs.classes_of(bases)
    presets = {name: type(make()) for name, make in configs.presets_of(bases).items()}
    ways: list[dict[str, Any]] = []
    for name, cls in classes.items():
        if _place_of(cls) not in defs:
            defs[_place_of(cls)] = {}  # parts may hold each other
            defs[_place_of(cls)] = _table(name, cls, [p for p, made in presets.items() if made is cls], defs)
        keys = [key.key for key in configs.keys_of(cls).values() if key.required]
        ways.append({"$ref": f"#/$defs/{_place_of(cls)}", "required": keys if len(classes) == 1 else ["type", *keys]})
    ways += [{"$ref": f"#/$defs/{_place_of(cls)}", "required": ["preset"]} for cls in dict.fromkeys(presets.values())]
    return {"anyOf": ways if bases == (Scene,) else [*ways, FILE]}


def _place_of(cls: type) -> str:
    """Of a class among the definitions: the objects of grippers and of membranes both have a Cylinder."""
    return f"{cls.__module__.partition('.')[2]}.{cls.__name__}"


def _table(name: str, cls: type, presets: list[str], defs: dict[str, Any]) -> dict[str, Any]:
    docs = documented(cls)
    properties: dict[str, Any] = {"type": {"const": name}}
    if presets:
        properties["preset"] = {"enum": presets}
    for key in configs.keys_of(cls).values():
        field = _field(key, defs)
        if key.name in docs:
            field = {"description": docs[key.name]} | field
        properties[key.key] = field
    words = (cls.__doc__ or "").split("\n\n")[0].split()
    return {
        "type": "object",
        "description": " ".join(words),
        "properties": properties,
        "additionalProperties": False,
    }


def _field(key: configs.Key, defs: dict[str, Any]) -> dict[str, Any]:
    meta = key.field.metadata
    if "types" in meta:
        return _place(meta["types"], defs)
    if meta.get("friction"):
        return {"anyOf": [_number("positive", "number"), _place((Friction,), defs)]}
    if "allowed" in meta:
        return {"enum": list(meta["allowed"])}
    if "methods" in meta:
        names = {"enum": list(meta["methods"])}
        table = {"type": "object", "properties": {"type": names}, "additionalProperties": {"type": "number"}}
        return {"anyOf": [names, table | {"required": ["type"]}]}
    if "names" in meta:
        return {"type": "array", "items": {"enum": list(meta["names"])}}
    if "rule" in meta:
        number = _number(meta["rule"], meta["kind"])
        if "size" in meta:
            return {"type": "array", "items": number, "minItems": meta["size"], "maxItems": meta["size"]}
        shapes = configs.shapes_of(key.annotation)
        ways = [number] if "" in shapes else []
        ways += [{"type": "array", "items": number, "minItems": 1}] if any(shapes) else []
        return ways[0] if len(ways) == 1 else {"anyOf": ways}
    least = {"minimum": meta["least"]} if "least" in meta else {}
    return {"type": {int: "integer", bool: "boolean", str: "string"}[key.annotation]} | least


def _number(rule: str, kind: str) -> dict[str, Any]:
    """A number that keeps a rule of `checked.RULES`, in the unit of its key."""
    _, unit = DISPLAY[kind]
    quarter = float(f"{0.5 * 3.141592653589793 / unit:.12g}")
    limits = {
        "positive": {"exclusiveMinimum": 0},
        "nonnegative": {"minimum": 0},
        "nonzero": {"not": {"const": 0}},
        "finite": {},
        "right_angle": {"minimum": 0, "exclusiveMaximum": quarter},
    }
    return {"type": "number"} | limits[rule]
