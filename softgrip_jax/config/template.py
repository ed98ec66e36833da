"""`softgrip new`: a commented config for any scene, from the fields, rules and docstrings of its class.

Numbers are the thesis's where it has a scene of that type, and otherwise small ones that keep the field's rule. What
has a default stands in a comment, so that the file says all that could be said.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import config as configs
from ..errors import InputError
from ..fields import documented, wanted
from ..objects.friction import Friction
from ..pneunet.finger import PRESETS as FINGERS
from ..pneunet.finger import PneuNet
from ..scene import Scene
from ..shell.arc.cylinder import AxialOffset
from ..thesis import printed as thesis
from ..units import DISPLAY, degree, gram, kPa, mm, unit_key

PRESSURE = 15 * kPa
"""A starter that needs a pressure has this one: shells and fingers are well inflated and far from their limits."""
NUMBERS = {"length": 10 * mm, "angle": 10 * degree, "mass": 100 * gram, "pressure": 100 * kPa}
"""Values in SI, by kind of quantity, of fields that no scene of the thesis has; other kinds have 1."""
LESS, MORE = 0.7, 1.4
"""A search may move a number between these parts of it, to begin with."""
TOLERANCE = 0.02
"""A mould or a printer may miss a number by this part of it."""
COMMENT = 40
"""Column at which comments begin."""


@functools.cache
def examples() -> dict[type, Any]:
    """Scenes of the thesis and their parts by class."""
    blocked, free = thesis.blocked_finger("A"), thesis.free_finger("A")
    # A first config keeps all rules, and the faces of its fingers touch.
    blocked = dataclasses.replace(blocked, ignored_rules=())
    held = dataclasses.replace(thesis.finger_grasp("A", 26 * gram, 18 * mm), ignored_rules=())
    held = dataclasses.replace(held, gripper=dataclasses.replace(held.gripper, touch="face"))
    scenes = [
        thesis.cylinder_contact(),
        thesis.free_shell(),
        thesis.flat_contact(),
        thesis.shell_grasp(mass=563 * gram, friction=0.96),
        # Nearer than the thesis's, which touches its plane at more than PRESSURE.
        dataclasses.replace(thesis.square_membrane(10 * degree), distance=1.5 * mm),
        AxialOffset(thesis.shell(), radius=thesis.ROD, gap=thesis.GAP, height=38 * mm),
        dataclasses.replace(blocked, weight=None, section="exact"),
        dataclasses.replace(free, section="exact"),
        dataclasses.replace(held, section="exact"),
    ]
    found: dict[type, Any] = {}
    for scene in scenes:
        _collect(scene, found)
    return found


def _collect(module: Any, found: dict[type, Any]) -> None:
    found.setdefault(type(module), module)
    for key in configs.keys_of(type(module)).values():
        if "types" in key.field.metadata:
            _collect(getattr(module, key.name), found)


def example(cls: type) -> Any:
    """A module of a class: the thesis's, or one whose numbers keep their rules."""
    known = examples()
    if cls in known:
        return known[cls]
    like = next((known[base] for base in cls.__mro__ if base in known), None)
    given = {}
    for key in configs.keys_of(cls).values():
        if like is not None and hasattr(like, key.name):
            given[key.name] = getattr(like, key.name)
        elif key.required:
            given[key.name] = _value(key)
    return cls(**given)


def _value(key: configs.Key) -> Any:
    meta = key.field.metadata
    if "types" in meta:
        options = list(configs.classes_of(meta["types"]).values())
        return example(next((cls for cls in options if cls in examples()), options[0]))
    if meta.get("friction"):
        return 1.0
    if "rule" not in meta:
        return meta["allowed"][0] if "allowed" in meta else {int: 1, bool: False, str: ""}[key.annotation]
    shapes = [str(meta["size"])] if "size" in meta else configs.shapes_of(key.annotation)
    # A term of a material may have any sign, but a material of one term must be stiff.
    is_term = "" not in shapes and meta["kind"] == "pressure"
    is_none = meta["rule"] == "nonnegative" or (meta["rule"] == "finite" and not is_term)
    number = 0.0 if is_none else NUMBERS.get(meta["kind"], 1.0)
    return number if "" in shapes else jnp.full(int(shapes[0]) if shapes[0].isdigit() else 1, number)


def starter(name: str) -> str:
    """The text of a config for the scene type `name` ("shell.Grasp"); ConfigError where there is none of that name."""
    cls = configs.pick(name, configs.classes_of((Scene,)), "TYPE")
    scene = example(cls)
    words = (inspect.getdoc(cls) or "").split("\n\n")[0].split()
    lines = [*_wrapped(" ".join(words)), "#   softgrip solve FILE.toml", ""]
    lines += _table("scene", scene, (Scene,))
    try:
        scene.target()
        lines += [
            "",
            "# Without [solve] the pressure is found that does the scene's own task. Other questions:",
            "# [solve]",
        ]
        mark = "# "
    except InputError:
        lines += ["", "[solve]"]
        mark = ""
    lines.append(_line(f"{mark}pressure_kPa = {PRESSURE / kPa:g}", "what is the state at this pressure?"))
    kinds, fixed = scene.prepared().OBSERVABLES, scene.prepared().SAME_AT_ALL_PRESSURES
    others = [unit_key(name, kind) for name, kind in kinds.items() if kind != "position" and name not in fixed]
    lines += _wrapped("Instead of pressure_kPa, the value that the pressure shall reach: " + ", ".join(others) + ".")
    return "\n".join(lines + _searches(scene, mark == "# ")) + "\n"


def _searches(scene: Scene, has_task: bool) -> list[str]:
    """The sections [design], [sweep] and [sensitivity] in comments, of the first number of the scene: it moves from
    LESS to MORE of itself, and is made to within TOLERANCE of itself."""
    number = configs.leaf(scene, configs.number_keys(scene)[0], "")
    value = float(np.ravel(number.get(scene))[0]) / number.unit
    name = ".".join([*number.names[:-1], unit_key(number.names[-1], number.kind)])
    at = '"required"' if has_task else f"{{ pressure_kPa = {PRESSURE / kPa:g} }}"
    first = next(unit_key(name, kind) for name, kind in scene.prepared().OBSERVABLES.items() if kind != "position")
    goal = 'minimise = "pressure_kPa"' if has_task else f'maximise = "{first}"'
    words = "Better designs: take the lines from [design] on out of their comments, add what else may move, and say"
    spread = [f"low = {_decimals(LESS * value)}", f"high = {_decimals(MORE * value)}"]
    design = ["[design]", "", "[[design.goals]]", goal, f"at = {at}", ""]
    design += ["[[design.variables]]", f'name = "{name}"', *spread, ""]
    design += ["[[design.constraints]]", 'keep = "limit_margin"', f"at = {at}", "low = 1.2"]
    sweep = ["[sweep]", 'method = "grid"', "", "[[sweep.variables]]", f'name = "{name}"', *spread, "points = 21", ""]
    sweep += ["[[sweep.observables]]", f'name = "{"pressure_kPa" if has_task else first}"', f"at = {at}"]
    matters = ["[sensitivity]", "samples = 10000", "", "[[sensitivity.variables]]", f'name = "{name}"']
    matters += [f"tolerance = {_decimals(TOLERANCE * value)}", "", "[[sensitivity.observables]]", *sweep[-2:]]
    lines = ["", *_wrapped(words), "#   softgrip design FILE.toml"]
    lines += [f"# {line}".rstrip() for line in design]
    lines += ["", "# Many designs:", "#   softgrip sweep FILE.toml"]
    lines += [f"# {line}".rstrip() for line in sweep]
    lines += ["", "# Which numbers matter (all of them, without this section), and what a tolerance up and down does:"]
    lines += ["#   softgrip sensitivity FILE.toml"]
    return lines + [f"# {line}".rstrip() for line in matters]


def _wrapped(text: str, width: int = 116) -> list[str]:
    lines, line = [], "#"
    for word in text.split():
        if len(line) + 1 + len(word) > width:
            lines.append(line)
            line = "#"
        line += f" {word}"
    return [*lines, line]


def _table(path: str, module: Any, bases: tuple[type, ...]) -> list[str]:
    """The table of a module and, under it, those of its parts."""
    cls, classes, presets = type(module), configs.classes_of(bases), configs.presets_of(bases)
    lines = [f"[{path}]"]
    preset = next(
        (f"table_5_1_{kind}" for kind in thesis.KINDS if cls is PneuNet and f"table_5_1_{kind}" in FINGERS), None
    )
    if preset:
        others = ", ".join(name for name in presets if name != preset)
        lines.append(_line(f'preset = "{preset}"', f"or {others}; the keys below override it"))
    elif len(classes) > 1:
        words = f"or {', '.join(name for name in classes if name != configs.type_name(cls))}"
        lines.append(_line(f'type = "{configs.type_name(cls)}"', words if bases != (Scene,) else ""))
        if presets:
            lines.append(
                f"# preset = {' or '.join(map(repr, presets))}   # instead of type and numbers".replace("'", '"')
            )
    docs, below = documented(cls), []
    for key in configs.keys_of(cls).values():
        value, meta = getattr(module, key.name), key.field.metadata
        if "types" in meta or isinstance(value, Friction):
            below += ["", *_table(f"{path}.{key.key}", value, meta.get("types", (Friction,)))]
            continue
        left_out = bool(preset) or (not key.required and _same(value, key.field.default))
        text = f"{key.key} = {_written(key, value)}"
        lines.append(_line(f"# {text}" if left_out else text, _words(key, docs.get(key.name, ""))))
    return lines + below


def _line(text: str, comment: str) -> str:
    return f"{text:<{COMMENT}}# {comment}" if comment else text


def _words(key: configs.Key, doc: str) -> str:
    """What a key means and what it may be."""
    meta = key.field.metadata
    if "allowed" in meta:
        rule = "one of " + ", ".join(f'"{name}"' for name in meta["allowed"])
    elif meta.get("friction"):
        rule = "a positive number, or a table with force_N and coefficient"
    elif "methods" in meta:
        rule = "one of " + ", ".join(f'"{name}"' for name in meta["methods"])
    elif "names" in meta:
        rule = "names of rules that designs may break"
    elif "rule" in meta:
        rule = wanted(meta["rule"], DISPLAY[meta["kind"]][0])
    else:
        rule = {int: "a whole number", bool: "true or false", str: "a text"}[key.annotation]
    return f"{doc.lstrip(', ')}; {rule}" if doc.strip(", ") else rule


def _same(value: Any, default: Any) -> bool:
    if value is None or default is None:
        return value is default
    if isinstance(default, int | float | tuple | list) and not isinstance(default, bool):
        return np.shape(value) == np.shape(default) and bool(np.all(np.asarray(value) == np.asarray(default)))
    return value == default


def _written(key: configs.Key, value: Any) -> str:
    """A value as TOML, in the unit of its key."""
    meta = key.field.metadata
    if "rule" in meta or meta.get("friction"):
        if value is None:
            value = np.zeros(meta["size"]) if "size" in meta else 0.0
        return _decimals(np.asarray(value) / DISPLAY[meta.get("kind", "number")][1])
    if "methods" in meta:
        return f'"{meta["methods"][0] if value is None else type(value).__name__.lower()}"'
    return (
        {True: "true", False: "false"}.get(value, "")
        if isinstance(value, bool)
        else f'"{value}"'
        if isinstance(value, str)
        else f"[{', '.join(map(_quoted, value))}]"
        if "names" in meta
        else str(value)
    )


def _quoted(name: str) -> str:
    return f'"{name}"'


def _decimals(value: Any) -> str:
    if np.ndim(value):
        return "[" + ", ".join(_decimals(v) for v in value) + "]"
    return f"{float(value):.12g}"
