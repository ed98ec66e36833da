"""Which numbers of which scenes vary: from a vector to scenes, and the names of its entries.

A search and a parameter study both move float leaves of scenes. They are named by a dotted path,

    "shell.a"                               of the one scene, or of every scene that has it
    "grasp.shell.a"                         of the scene called grasp
    "grasp.gripper.finger.L = free.finger.L"    several that move as one: tied

or found by a function from the dictionary of scenes. An array leaf has one entry per element.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .errors import InputError

Scenes = Mapping[str, Any]
"""Scenes by name; a fit of measured curves also moves the leaves of its material tests."""

Getter = Callable[[Any], tuple[Any, ...]]

SCALES = ("linear", "log")


@runtime_checkable
class Named(Protocol):
    """What says which leaf is meant."""

    @property
    def name(self) -> str: ...
    @property
    def where(self) -> Callable[[Any], Any] | None: ...
    @property
    def kind(self) -> str: ...


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A leaf by name (see above), or by a function `where`, whose kind of quantity must then be said for display."""

    name: str
    where: Callable[[Any], Any] | None = None
    kind: str = ""


def ready(scenes: Scenes, parameters: Sequence[Named]) -> dict[str, Any]:
    """The scenes with choices made that need known numbers (the symmetry of an object), where none of these numbers
    varies; the other scenes as they are."""
    within = [part for one in parameters for part in one.name.replace("=", ".").split(".")]
    if "obstacle" in map(str.strip, within) or any(one.where is not None for one in parameters):
        return dict(scenes)

    def of_one(scene: Any) -> Any:
        prepared = scene.prepared() if hasattr(scene, "prepared") else scene
        return prepared if type(prepared) is type(scene) else scene  # another class has other names for its numbers

    return {name: of_one(scene) for name, scene in scenes.items()}


class Parameters:
    """Leaves of scenes as one vector of SI values."""

    def __init__(self, scenes: Scenes, parameters: Sequence[Named]):
        if not parameters:
            raise InputError("There is no variable; name at least one leaf to vary.")
        self.scenes = dict(scenes)
        self.names: list[str] = []
        """One per entry of the vector."""
        self.tied: list[str] = []
        """The same with all that moves as one, joined by '='."""
        self.kinds: list[str] = []
        self.sizes: list[int] = []
        """Entries of each leaf."""
        self._getters: list[Getter] = []
        self._shapes: list[tuple[int, ...]] = []
        reference: list[float] = []
        # The same scenes with a number in place of every leaf: it tells which leaves a parameter moves.
        leaves, tree = jax.tree.flatten(self.scenes)
        numbered, moved_by = jax.tree.unflatten(tree, range(len(leaves))), dict[int, str]()
        for leaf in parameters:
            getter, kind = self._getter(leaf)
            found = getter(self.scenes)
            for value in found:
                if not eqx.is_inexact_array(value):
                    raise InputError(f"Variable {leaf.name!r} is {value!r}; it must be a number that a scene holds.")
                if value.shape != found[0].shape:
                    raise InputError(f"The tied leaves of {leaf.name!r} have different shapes.")
            values = np.asarray(found[0], dtype=float).ravel()
            all_tied = [part.strip() for part in leaf.name.split("=")]
            places = [""] if found[0].ndim == 0 else [f"[{i}]" for i in range(values.size)]
            names = [all_tied[0] + place for place in places]
            for name in names:
                if name in self.names:
                    raise InputError(f"Variable {name!r} is given twice.")
            for place in getter(numbered):
                if place in moved_by:
                    raise InputError(
                        f"Variable {leaf.name!r} moves a number that variable {moved_by[place]!r} moves, too; "
                        "name the scenes of both, or leave one out."
                    )
                moved_by[place] = leaf.name
            self.names += names
            self.tied += [" = ".join(part + place for part in all_tied) for place in places]
            self.kinds += [kind] * values.size
            self.sizes.append(values.size)
            self._getters.append(getter)
            self._shapes.append(found[0].shape)
            reference += values.tolist()
        self.reference = np.array(reference)
        """SI values of the scenes as they were given."""

    @property
    def size(self) -> int:
        return len(self.names)

    def scenes_at(self, x: Float[Array, " n"]) -> dict[str, Any]:
        """The scenes with the leaves at SI values x."""
        start, replacements = 0, []
        for getter, shape, size in zip(self._getters, self._shapes, self.sizes, strict=True):
            value = jnp.reshape(x[start : start + size], shape)
            replacements += [value] * len(getter(self.scenes))
            start += size
        return eqx.tree_at(lambda s: [leaf for g in self._getters for leaf in g(s)], self.scenes, replacements)

    def leaves_of(self, scenes: Scenes) -> list[tuple[Any, ...]]:
        """Of every parameter, its tied leaves in scenes built like those that were given."""
        return [getter(scenes) for getter in self._getters]

    def _getter(self, leaf: Named) -> tuple[Getter, str]:
        if leaf.where is not None:
            where = leaf.where

            def get(scenes):
                found = where(scenes)
                return tuple(found) if isinstance(found, tuple | list) else (found,)

            return get, leaf.kind or "number"
        paths = [path for part in leaf.name.split("=") for path in self._paths(part.strip(), leaf.name)]
        kind = leaf.kind or _kind(self.scenes, paths[0])
        return lambda scenes: tuple(_walk(scenes, path) for path in paths), kind

    def _paths(self, name: str, whole: str) -> list[tuple[str, ...]]:
        """Scene name and attribute names of a leaf; without a scene's name, of every scene that has it."""
        path = tuple(name.split("."))
        if path[0] in self.scenes:
            candidates = [path]
        else:
            candidates = [(scene, *path) for scene in self.scenes]
        faults = [self._fault(candidate, whole) for candidate in candidates]
        found = [path for path, fault in zip(candidates, faults, strict=True) if not fault]
        if not found:
            if len(candidates) == 1:
                raise InputError(faults[0])
            raise InputError(f"Variable {whole!r} is in no scene; name one of {_list(self.scenes)} before it.")
        return found

    def _fault(self, path: tuple[str, ...], whole: str) -> str:
        """A sentence where a path leads nowhere."""
        node: Any = self.scenes[path[0]]
        for i, part in enumerate(path[1:], start=1):
            fields = [f.name for f in dataclasses.fields(node)] if dataclasses.is_dataclass(node) else []
            if part not in fields:
                return f"Variable {whole!r}: {'.'.join(path[:i])} has no field {part!r}; it has {_list(fields)}."
            node = getattr(node, part)
        return ""


def between(t: Any, low: Any, high: Any, is_log: Any, xp: Any = np) -> Any:
    """Values from unit values t: low + t (high - low), or low (high / low)^t where `is_log`."""
    if is_log is False:
        return low + t * (np.asarray(high) - low)
    ratio = np.where(is_log, np.asarray(high) / np.where(is_log, low, 1.0), 1.0)
    return xp.where(is_log, low * xp.exp(t * np.log(ratio)), low + t * (np.asarray(high) - low))


def require_range(name: str, low: float, high: float, scale: str) -> None:
    """A ValueError in one sentence for bounds that cannot be meant."""
    if scale not in SCALES:
        raise InputError(f"The scale of variable {name!r} is {scale!r}; it must be 'linear' or 'log'.")
    if any(end is None or isinstance(end, str) or np.ndim(end) for end in (low, high)):
        raise InputError(f"The bounds of {name!r} are {low!r} and {high!r}; they must be numbers.")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError(f"The bounds of {name!r} are {low} and {high}; low must be below high.")
    if scale == "log" and low <= 0:
        raise InputError(f"The lower bound of {name!r} is {low}; on a log scale it must be positive.")


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


def _list(names: Iterable[Any]) -> str:
    return ", ".join(map(str, names)) or "none"
