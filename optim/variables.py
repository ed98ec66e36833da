"""Which leaves of which scenes may move, between which bounds, and their smooth maps.

Three spaces: SI values x (what a scene holds), unit values t in [0, 1] between the bounds (linear or logarithmic), and
free values u on the whole real line, t = (1 + sin u) / 2. The sine is the map of MINUIT: bounds hold by construction,
and unlike a sigmoid it reaches them at a finite u, so an optimum on a bound is an ordinary stationary point.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softgrip_jax.scene import Scene

Scenes = Mapping[str, Scene]

SCALES = ("linear", "log")

REFERENCE_INSET = 1e-3
"""A start on a bound is moved this part of the range inwards: exactly on it the sine map passes no gradient."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """A float leaf that may move (or several that move as one: tied).

    Args:
        name: dotted name of the leaf, "shell.a", or "scene.shell.a" where there are several scenes; several separated
            by "=" are tied: "free.shell.a = grasp.shell.a".
        low, high: bounds in SI; an array leaf has one variable per element, all between the same bounds.
        scale: "linear" or "log" (for quantities that matter by their ratio; bounds above zero).
        where: instead of looking `name` up, a function from the dictionary of scenes to the leaf or a tuple of leaves.
        kind: kind of quantity for display; found by itself for a leaf that is looked up by name.
    """

    name: str
    low: float
    high: float
    scale: str = "linear"
    where: Callable[[Any], Any] | None = None
    kind: str = ""

    def __post_init__(self) -> None:
        if self.scale not in SCALES:
            raise ValueError(f"The scale of variable {self.name!r} is {self.scale!r}; it must be 'linear' or 'log'.")
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"The bounds of {self.name!r} are {self.low} and {self.high}; low must be below high.")
        if self.scale == "log" and self.low <= 0:
            raise ValueError(f"The lower bound of {self.name!r} is {self.low}; on a log scale it must be positive.")


class Space:
    """The variables of one problem: from vectors to scenes and back. Vectors have one entry per varied number."""

    def __init__(self, scenes: Scenes, variables: Sequence[Variable]):
        if not variables:
            raise ValueError("There is no variable; name at least one leaf to vary.")
        self.scenes = dict(scenes)
        self.variables = tuple(variables)
        self.names: list[str] = []
        self.kinds: list[str] = []
        self._getters: list[Callable[[Any], tuple[Any, ...]]] = []
        self._shapes: list[tuple[int, ...]] = []
        reference: list[float] = []
        low: list[float] = []
        high: list[float] = []
        is_log: list[bool] = []
        for variable in self.variables:
            getter, kind = self._getter(variable)
            leaves = getter(self.scenes)
            for leaf in leaves:
                if not eqx.is_inexact_array(leaf):
                    raise ValueError(f"Variable {variable.name!r} is {leaf!r}; it must be a number that a scene holds.")
                if leaf.shape != leaves[0].shape:
                    raise ValueError(f"The tied leaves of {variable.name!r} have different shapes.")
            values = np.asarray(leaves[0], dtype=float).ravel()
            short = variable.name.split("=")[0].strip()
            names = [short] if values.size == 1 else [f"{short}[{i}]" for i in range(values.size)]
            for name in names:
                if name in self.names:
                    raise ValueError(f"Variable {name!r} is given twice.")
            self.names += names
            self.kinds += [kind] * values.size
            self._getters.append(getter)
            self._shapes.append(leaves[0].shape)
            reference += values.tolist()
            low += [variable.low] * values.size
            high += [variable.high] * values.size
            is_log += [variable.scale == "log"] * values.size
        self.low, self.high, self.is_log = np.array(low), np.array(high), np.array(is_log)
        self.reference = np.array(reference)
        """SI values of the design that the search starts from."""

    @property
    def size(self) -> int:
        return len(self.names)

    def _getter(self, variable: Variable) -> tuple[Callable[[Any], tuple[Any, ...]], str]:
        if variable.where is not None:
            where = variable.where

            def get(scenes):
                found = where(scenes)
                return tuple(found) if isinstance(found, tuple | list) else (found,)

            return get, variable.kind or "number"
        paths = [self._path(part.strip(), variable.name) for part in variable.name.split("=")]
        kind = variable.kind or _kind(self.scenes, paths[0])
        return lambda scenes: tuple(_walk(scenes, path) for path in paths), kind

    def _path(self, name: str, whole: str) -> tuple[str, ...]:
        """Scene name and attribute names of a leaf; a single scene need not be named."""
        path = tuple(name.split("."))
        if path[0] not in self.scenes:
            if len(self.scenes) > 1:
                raise ValueError(f"Variable {whole!r} names no scene; it must begin with {_list(self.scenes)}.")
            path = (next(iter(self.scenes)), *path)
        node: Any = self.scenes[path[0]]
        for i, part in enumerate(path[1:], start=1):
            fields = [f.name for f in dataclasses.fields(node)] if dataclasses.is_dataclass(node) else []
            if part not in fields:
                owner = ".".join(path[:i])
                raise ValueError(f"Variable {whole!r}: {owner} has no field {part!r}; it has {_list(fields)}.")
            node = getattr(node, part)
        return path

    def scenes_at(self, x: Float[Array, " n"]) -> dict[str, Scene]:
        """The scenes with the variables at SI values x."""
        start, replacements, getters = 0, [], []
        for getter, shape in zip(self._getters, self._shapes, strict=True):
            size = int(np.prod(shape))
            value = jnp.reshape(x[start : start + size], shape)
            count = len(getter(self.scenes))
            replacements += [value] * count
            getters.append(getter)
            start += size
        return eqx.tree_at(lambda s: [leaf for g in getters for leaf in g(s)], self.scenes, replacements)

    def from_unit(self, t: Float[Array, " n"]) -> Float[Array, " n"]:
        """SI values from unit values: low + t (high - low), or low (high / low)^t on a log scale."""
        ratio = np.where(self.is_log, self.high / np.where(self.is_log, self.low, 1.0), 1.0)
        low = jnp.asarray(self.low)
        return jnp.where(self.is_log, low * jnp.exp(t * np.log(ratio)), low + t * (self.high - self.low))

    def to_unit(self, x: Any) -> np.ndarray:
        """Unit values from SI values (outside of [0, 1] where a bound is broken)."""
        x = np.asarray(x, dtype=float)
        safe = np.where(self.is_log, np.maximum(x, np.finfo(float).tiny), 1.0)
        low, high = np.where(self.is_log, self.low, 1.0), np.where(self.is_log, self.high, 2.0)
        return np.where(self.is_log, np.log(safe / low) / np.log(high / low), (x - self.low) / (self.high - self.low))

    def inside(self, t: Any) -> np.ndarray:
        """Unit values moved off the bounds, as a start needs them."""
        return np.clip(t, REFERENCE_INSET, 1 - REFERENCE_INSET)


def to_free(t: Any) -> Any:
    """u = arcsin(2 t - 1)."""
    return jnp.arcsin(2 * jnp.asarray(t) - 1)


def to_unit(u: Any) -> Any:
    """t = (1 + sin u) / 2."""
    return 0.5 * (1 + jnp.sin(u))


def _walk(scenes: Any, path: tuple[str, ...]) -> Any:
    node = scenes[path[0]]
    for part in path[1:]:
        node = getattr(node, part)
    return node


def _kind(scenes: Any, path: tuple[str, ...]) -> str:
    owner = _walk(scenes, path[:-1])
    for field in dataclasses.fields(owner):
        if field.name == path[-1]:
            return field.metadata.get("kind", "number")
    return "number"


def _list(names: Any) -> str:
    return ", ".join(map(str, names)) or "none"
