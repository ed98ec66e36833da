"""Modules that say at once when a value cannot be meant.

A field declares its rule where it is defined (``t_m = positive("length")``). Outside of jit a value that breaks
it is a ValueError in one sentence; inside jit, where nothing can be raised, the same rules become a boolean
(:func:`admissible`) and the scene is IMPOSSIBLE.

What a field means is said once: beside its rule, ``positive("length", doc="thickness")``, or, as in all classes of the
package, in the section Args of the docstring. :func:`documented` hands it to the schema and to `softgrip new`.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import numbers
import re
import typing
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from .display import describe, is_readable
from .errors import InputError, require_whole
from .plausible import Doubt, doubts, warn
from .reasons import RULE_NAMES
from .units import SI

# rule -> (what is allowed, in words; the test, for NumPy and for traced arrays alike)
RULES = {
    "positive": ("a positive finite number", lambda x: (x > 0) & (x < np.inf)),
    "nonnegative": ("a finite number, zero or more", lambda x: (x >= 0) & (x < np.inf)),
    "nonzero": ("a finite number other than zero", lambda x: (x != 0) & (x > -np.inf) & (x < np.inf)),
    "finite": ("a finite number", lambda x: (x > -np.inf) & (x < np.inf)),
    "right_angle": ("an angle from zero to less than a right angle", lambda x: (x >= 0) & (x < np.pi / 2)),
}


def wanted(rule: str, unit: str) -> str:
    """What a field accepts, in words: 'a positive finite number in mm'."""
    return RULES[rule][0] + (f" in {unit}" if unit else "")


def to_float_array(value: Any) -> Any:
    """Numbers, arrays and lists of numbers become float arrays; anything else is left for the check to name."""
    listed = isinstance(value, list | tuple) and len(value) > 0 and all(_is_number(v) for v in value)
    if listed or _is_number(value):
        # A type that is named is not weak: a scene made of Python numbers and one made of arrays share one program.
        return jnp.asarray(value, dtype=float)
    return value


def _is_number(value: Any) -> bool:
    if isinstance(value, np.ndarray | jax.Array):
        return jnp.issubdtype(value.dtype, jnp.floating) or jnp.issubdtype(value.dtype, jnp.integer)
    return isinstance(value, numbers.Real) and not isinstance(value, bool | np.bool)


def _declared(metadata: dict[str, Any], doc: str = "", **kwargs: Any) -> Any:
    """A field with what is known of it; doc: what it means, in a few words and without its unit."""
    return eqx.field(metadata=metadata | ({"doc": doc} if doc else {}), **kwargs)


def _rule_field(rule: str, kind: str, **kwargs: Any) -> Any:
    return _declared({"rule": rule, "kind": kind}, converter=to_float_array, **kwargs)


def positive(kind: str, **kwargs: Any) -> Any:
    """A float leaf greater than zero, in SI."""
    return _rule_field("positive", kind, **kwargs)


def nonnegative(kind: str, **kwargs: Any) -> Any:
    """A float leaf, zero or more, in SI."""
    return _rule_field("nonnegative", kind, **kwargs)


def finite(kind: str, **kwargs: Any) -> Any:
    """A float leaf of either sign, in SI."""
    return _rule_field("finite", kind, **kwargs)


def nonzero(kind: str, **kwargs: Any) -> Any:
    """A float leaf of either sign, but not zero, in SI."""
    return _rule_field("nonzero", kind, **kwargs)


def right_angle(**kwargs: Any) -> Any:
    """A float leaf in [0, pi/2)."""
    return _rule_field("right_angle", "angle", **kwargs)


def vector(kind: str, converter: Any, **kwargs: Any) -> Any:
    """A leaf of two components (x, y), or None; `converter` says what a written value becomes."""
    return _declared({"rule": "finite", "kind": kind, "size": 2}, converter=converter, **kwargs)


def choice(*allowed: str, **kwargs: Any) -> Any:
    """A static choice by name."""
    return _declared({"allowed": allowed}, static=True, **kwargs)


@jax.tree_util.register_static
class Name(str):
    """A name that may stand in a field beside modules: JAX takes it for a part of the tree without numbers."""


def choice_or(kind: type[eqx.Module], *allowed: str, **kwargs: Any) -> Any:
    """A choice by name, or a module of a kind that a user wrote; its float leaves vary as those of any part do."""
    return _declared({"allowed": allowed, "instance": kind}, converter=_to_name, **kwargs)


def _to_name(value: Any) -> Any:
    return Name(value) if type(value) is str else value


def count(**kwargs: Any) -> Any:
    """A static whole number, one or more."""
    return _declared({"least": 1}, static=True, **kwargs)


def to_names(value: Any) -> Any:
    """A name or a list of names as a tuple of names."""
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


def rule_names(**kwargs: Any) -> Any:
    """A static tuple of names of rules (see `reasons`)."""
    return _declared({"names": RULE_NAMES}, static=True, converter=to_names, **kwargs)


def part(*types: type, **kwargs: Any) -> Any:
    """Another module (a shell in a scene, a material in a shell)."""
    return _declared({"types": types}, **kwargs)


def is_concrete(*values: Any) -> bool:
    """True where the values are known numbers (not traced by jit, vmap or grad)."""
    return all(isinstance(v, jax.Array) and not isinstance(v, Tracer) for v in values)


def require(name: str, value: Any, rule: str, kind: str) -> Any:
    """`value` as a float array, or a ValueError that names the field, the value and the rule."""
    test, words = RULES[rule][1], wanted(rule, SI[kind])
    array = to_float_array(value)
    if not (isinstance(array, jax.Array) and jnp.issubdtype(array.dtype, jnp.floating)):
        raise InputError(f"{name} is {value!r}; it must be {words}.")
    if is_concrete(array):
        seen = np.asarray(array)
        if not np.all(test(seen)):
            raise InputError(f"{name} is {_first_bad(seen, test)}; it must be {words}.")
    return array


def _first_bad(values: np.ndarray, test: Any) -> str:
    bad = np.atleast_1d(values)[~np.atleast_1d(test(values))]
    return f"{bad.flat[0]:.6g}" + (f" (in an array of {values.size})" if values.size > 1 else "")


class Checked(eqx.Module):
    """A module whose fields are checked by the rule they declare."""

    def __check_init__(self) -> None:
        warn(check_fields(self))

    def __repr__(self) -> str:
        return describe(self, has_units=_holds_quantities(self))


def check_fields(module: Checked) -> list[Doubt]:
    """A ValueError where a field breaks its rule; returned is what can be meant but is in doubt."""
    owner, found = type(module).__name__, []
    for field in dataclasses.fields(module):
        meta, value = field.metadata, getattr(module, field.name)
        where = f"{owner}.{field.name}"
        if "rule" in meta:
            # Placeholders that JAX puts into trees while it rebuilds them carry no numbers to check.
            if type(value) is object or (value is None and (field.default is None or "size" in meta)):
                continue
            array = require(where, value, meta["rule"], meta["kind"])
            if "size" in meta and jnp.shape(value)[-1:] != (meta["size"],):
                raise InputError(f"{where} is {value!r}; it must be a pair of numbers (x, y).")
            if is_concrete(array):
                found += doubts(where, np.asarray(array), meta["kind"], meta["rule"])
        elif meta.get("friction") and not callable(value):
            require(where, value, "positive", "number")
        elif "allowed" in meta and not _is_allowed(value, meta):
            words = f"{', '.join(map(repr, meta['allowed']))}" + (
                f", or a {meta['instance'].__name__}" if "instance" in meta else ""
            )
            raise InputError(f"{where} is {value!r}; it must be one of {words}.")
        elif "names" in meta and not (isinstance(value, tuple) and set(value) <= set(meta["names"])):
            raise InputError(f"{where} is {value!r}; it must be a list of names from {', '.join(meta['names'])}.")
        elif "least" in meta:
            require_whole(where, value, meta["least"])
        elif "types" in meta and not isinstance(value, meta["types"]):
            names = " or ".join(t.__name__ for t in meta["types"])
            raise InputError(f"{where} is {value!r}; it must be a {names}.")
    return found


def _is_allowed(value: Any, meta: Mapping[str, Any]) -> bool:
    return value in meta["allowed"] if isinstance(value, str) else isinstance(value, meta.get("instance", ()))


def admissible(tree: Any) -> Bool[Array, ""]:
    """True where every field of every checked module in `tree` keeps its rule (for use inside jit)."""
    good = jnp.asarray(True)
    nodes = jax.tree.leaves(tree, is_leaf=lambda node: isinstance(node, Checked))
    for node in nodes:
        if not isinstance(node, Checked):
            continue
        for field in dataclasses.fields(node):
            value = getattr(node, field.name)
            if "rule" in field.metadata:
                if value is None:
                    continue
                good &= jnp.all(RULES[field.metadata["rule"]][1](value))
            elif field.metadata.get("friction") and not callable(value):
                good &= jnp.all(RULES["positive"][1](value))
            elif isinstance(value, eqx.Module):
                good &= admissible(value)
    return good


FAR_TOO_LONG = 100.0
"""m. Derivatives by lengths, in N/m or Pa/m, are larger."""


def _holds_quantities(module: Checked) -> bool:
    """False where numbers cannot be what their fields are for: derivatives by a scene come as a scene, too."""
    for field in dataclasses.fields(module):
        value, meta = vars(module).get(field.name), field.metadata
        if isinstance(value, Checked) and not _holds_quantities(value):
            return False
        if "rule" in meta and is_readable(value):
            seen = np.asarray(value)
            if not np.all(RULES[meta["rule"]][1](seen)) or (meta["kind"] == "length" and np.any(seen > FAR_TOO_LONG)):
                return False
    return True


def batched_field(module: Checked) -> tuple[str, tuple[int, ...]] | None:
    """The first field in a tree of modules that holds an array where one scene has one number: its name and its shape.

    None where all of it is one scene, inside vmap too, where each member has its own numbers.
    """
    for name, rank in _ranks(type(module)):
        value = getattr(module, name)
        if rank is None:
            inner = batched_field(value) if isinstance(value, Checked) else None
            if inner is not None:
                return inner
        elif getattr(value, "ndim", 0) > rank:
            return f"{type(module).__name__}.{name}", value.shape
    return None


@functools.cache
def _ranks(cls: type) -> tuple[tuple[str, int | None], ...]:
    """(name, most axes of its value by its annotation) of every field of numbers, and (name, None) of every part."""
    found: list[tuple[str, int | None]] = []
    try:
        hints = typing.get_type_hints(cls)
    except NameError:  # a class of the user's own may name types that only a type checker knows
        hints = {}
    for field in dataclasses.fields(cls):
        meta, annotation = field.metadata, hints.get(field.name)
        options = typing.get_args(annotation) or (annotation,)
        shapes = [dims.split() for dims in (getattr(option, "dim_str", None) for option in options) if dims is not None]
        if "types" in meta:
            found.append((field.name, None))
        elif "size" in meta:
            found.append((field.name, 1))
        elif (
            ("rule" in meta or "friction" in meta)
            and shapes
            and not any("*" in axis or axis == "..." for shape in shapes for axis in shape)
        ):
            found.append((field.name, max(map(len, shapes))))
    return tuple(found)


ARGUMENT = re.compile(r"^ {4}((?:\w+, )*\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)
"""One entry of a section Args: names, and what is said of them."""
SI_UNITS = re.compile(r"(?:^|, )(?:m|rad|N/m|N|Pa|kg)(?=$|[,:;.])")
"""Units of constructors, as docstrings have them; the keys of a config have units of their own."""


@functools.cache
def documented(cls: type) -> dict[str, str]:
    """What the fields of a class mean: `doc` of the field, or the section Args of its class or of one above it."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, below = inspect.cleandoc(base.__dict__.get("__doc__") or "").partition("\nArgs:\n")
        for names, text in ARGUMENT.findall(below.split("\n\n")[0]):
            # "as in OtherScene" says less than what a class above has said.
            for name in names.split(", "):
                if not (name in found and text.startswith("as in ")):
                    found[name] = SI_UNITS.sub("", re.split(r"; |\. ", " ".join(text.split()))[0]).rstrip(".,;")
    for field in dataclasses.fields(cls):
        if "doc" in field.metadata:
            if field.name in found:
                raise TypeError(f"{cls.__name__}.{field.name} is described twice: in its field and under Args.")
            found[field.name] = field.metadata["doc"]
    return found
