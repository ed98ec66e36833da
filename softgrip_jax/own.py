"""What a user wrote, looked at before it is used: a mistake in it is one sentence, and no trace-back of JAX."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .errors import InputError

PACKAGE = __name__.partition(".")[0]
LIBRARIES = ("jax", "jaxlib", "jaxtyping", "numpy", "equinox", "optim", PACKAGE)
"""Whose lines are not the user's."""
HINT = "use jax.numpy in place of math and NumPy, and jnp.where in place of if."
TRACED = (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError)
"""What JAX raises where a function needs the value of a number that has none yet."""
MANY = 1000
"""Kinds of parts that are remembered."""
_LOOKED_AT: dict[Any, bool] = {}
"""What `require_numbers` found, by the kind of part."""


def is_own(part: Any) -> bool:
    """True where the class of something is no part of this package."""
    return type(part).__module__.partition(".")[0] != PACKAGE


def is_known(part: Any) -> bool:
    """True where all numbers of something are known, and none is traced or a placeholder of JAX."""
    known = jax.Array | np.ndarray | np.generic | float | int
    return all(isinstance(leaf, known) and not isinstance(leaf, Tracer) for leaf in jax.tree.leaves(part))


def is_one(part: Any) -> bool:
    """True where something holds single numbers, and no arrays: those of several, made for vmap, or of a table."""
    return all(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(part))


def outcome(where: str, function: Callable[..., Any], *given: Any) -> Any:
    """The shapes of what a user's function gives, or an InputError that begins with `where`; nothing is computed."""
    try:
        return jax.eval_shape(function, *given)
    except InputError:
        raise
    except TRACED as error:
        said = f"{where} cannot be differentiated by JAX{_line(error)}: {_first(error)}; {HINT}"
    except Exception as error:
        said = f"{where} raises {type(error).__name__}{_line(error)}: {_first(error)}; it must be a function for JAX."
    raise InputError(said)


def require_numbers(
    where: str, part: Any, function: Callable[..., Any], *given: Any, names: tuple[str, ...] = ()
) -> bool:
    """An InputError where a function of a user's part does not give one number, or as many as have `names`.

    Where the numbers of the part are arrays, of several parts in one or of a table, what it gives may be arrays, too.
    Returned is whether it gives single numbers. Parts that differ by their numbers alone are looked at once.
    """
    leaves, kind = jax.tree.flatten((part, given))
    key = where, kind, tuple((np.shape(leaf), getattr(leaf, "dtype", type(leaf))) for leaf in leaves)
    if key not in _LOOKED_AT:
        if len(_LOOKED_AT) >= MANY:
            _LOOKED_AT.clear()
        _LOOKED_AT[key] = are_numbers(where, outcome(where, function, *given), names, not is_one(part))
    return _LOOKED_AT[key]


def are_numbers(where: str, found: Any, names: tuple[str, ...] = (), batched: bool = False) -> bool:
    """Of what `outcome` gave: whether it is single numbers; an InputError where it is none, or too few."""
    if not names:
        return _is_number(f"{where} gives", found, batched)
    if not isinstance(found, tuple | list) or len(found) != len(names):
        raise InputError(f"{where} gives {said_of(found)}; it must give {len(names)} numbers: {', '.join(names)}.")
    said = [f"{where} gives ({', '.join(names)}), and {name} is" for name in names]
    return all([_is_number(begins, value, batched) for begins, value in zip(said, found, strict=True)])


def _is_number(begins: str, value: Any, batched: bool) -> bool:
    """Whether it is a single number; an InputError where it must be and is not."""
    if not _is_real(value) or (value.shape != () and not batched):
        raise InputError(f"{begins} {said_of(value)}; it must be one number, of the shape ().")
    return value.shape == ()


def _is_real(value: Any) -> bool:
    kinds = jnp.floating, jnp.integer
    return isinstance(value, jax.ShapeDtypeStruct) and any(jnp.issubdtype(value.dtype, kind) for kind in kinds)


def said_of(value: Any) -> str:
    """What a function gave, in words."""
    if isinstance(value, jax.ShapeDtypeStruct):
        kind = "" if _is_real(value) else f" of the type {value.dtype}"
        return (f"an array of the shape {value.shape}" if value.shape else "one number") + kind
    if isinstance(value, tuple | list):
        return f"{len(value)} values"
    return "None" if value is None else f"a {type(value).__name__}"


def _first(error: Exception) -> str:
    """The first line of an error, without a full stop."""
    return (str(error).strip().splitlines() or [""])[0].rstrip(".:; ")


def _line(error: Exception) -> str:
    """Where in the user's own file an error arose, in brackets."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] not in LIBRARIES:
            return f" (line {line} of {frame.f_code.co_filename.rpartition('/')[2]})"
    return ""
