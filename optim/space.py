"""Which leaves of which scenes may move, between which bounds, and their smooth maps.

Three spaces: SI values x (what a scene holds), unit values t in [0, 1] between the bounds (linear or logarithmic), and
free values u on the whole real line, t = (1 + sin u) / 2. The sine is the map of MINUIT: bounds hold by construction,
and unlike a sigmoid it reaches them at a finite u, so an optimum on a bound is an ordinary stationary point.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softgrip_jax.parameters import Parameters, Scenes, between, require_range
from softgrip_jax.quantities import State

REFERENCE_INSET = 1e-3
"""A start on a bound is moved this part of the range inwards: exactly on it the sine map passes no gradient."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """A float leaf of a scene that may move, or several that move as one.

    Args:
        name: of the leaf, see `softgrip_jax.parameters`: "shell.a", "grasp.shell.a", "free.shell.a = grasp.shell.a"
            (tied).
        low, high: bounds in SI; an array leaf has one variable per element, all between the same bounds.
        scale: "linear" or "log" (for quantities that matter by their ratio; bounds above zero).
        where: instead of looking `name` up, a function from the dictionary of scenes to the leaf or a tuple of leaves.
        kind: kind of quantity for display; found by itself for a leaf that is looked up by name.

    Raises:
        InputError: where low is not below high, or a logarithmic bound is not positive.

    Examples:
        >>> optim.Variable("shell.t_m", 0.8 * mm, 2 * mm).scale
        'linear'
    """

    name: str
    low: float
    high: float
    scale: str = "linear"
    where: Callable[[Any], Any] | None = None
    kind: str = ""

    def __post_init__(self) -> None:
        require_range(self.name, self.low, self.high, self.scale)


class Space(Parameters):
    """The variables of one problem: from vectors to scenes and back.

    Vectors have one entry per varied number. SI values x are what a scene holds; unit values t in [0, 1] lie between
    the bounds (linear or logarithmic); free values u cover the real line, t = (1 + sin u) / 2.

    Args:
        scenes: a dictionary of scenes by name.
        variables: what may move.

    Raises:
        InputError: for a name that no scene has.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> space = optim.Space({"free": sg.shell.Free(shell)}, [optim.Variable("shell.t_m", 0.8 * mm, 2 * mm)])
        >>> print(f"{space.from_unit(jnp.array([0.5]))[0] / mm:.1f} mm")
        1.4 mm
    """

    def __init__(self, scenes: Scenes, variables: Sequence[Variable]):
        super().__init__(scenes, variables)
        self.variables = tuple(variables)
        self.low = np.repeat([v.low for v in variables], self.sizes)
        self.high = np.repeat([v.high for v in variables], self.sizes)
        self.is_log = np.repeat([v.scale == "log" for v in variables], self.sizes)

    def from_unit(self, t: Float[Array, " n"]) -> Float[Array, " n"]:
        """SI values from unit values: low + t (high - low), or low (high / low)^t on a log scale."""
        return between(t, self.low, self.high, self.is_log, jnp)

    def to_unit(self, x: Any) -> np.ndarray:
        """Unit values from SI values (outside of [0, 1] where a bound is broken)."""
        x = np.asarray(x, dtype=float)
        safe = np.where(self.is_log, np.maximum(x, np.finfo(float).tiny), 1.0)
        low, high = np.where(self.is_log, self.low, 1.0), np.where(self.is_log, self.high, 2.0)
        return np.where(self.is_log, np.log(safe / low) / np.log(high / low), (x - self.low) / (self.high - self.low))

    def state_at(self, at: State, x: Float[Array, " n"]) -> Any:
        """A state as the design at SI values x is asked for it."""
        return at

    def inside(self, t: Any) -> np.ndarray:
        """Unit values moved off the bounds, as a start needs them."""
        return np.clip(t, REFERENCE_INSET, 1 - REFERENCE_INSET)


def to_free(t: Any) -> Any:
    """u = arcsin(2 t - 1)."""
    return jnp.arcsin(2 * jnp.asarray(t) - 1)


def to_unit(u: Any) -> Any:
    """t = (1 + sin u) / 2."""
    return 0.5 * (1 + jnp.sin(u))
