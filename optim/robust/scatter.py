"""Which numbers scatter and how, and the space of a design together with the deviations of one part.

A part deviates from its design by s, one pure number for each number that scatters: the part has

    v (1 + deviation s)     where the deviation is relative, v the number of the design (an array scatters as one)
    v + deviation s         where it is absolute

    normal       s = z                                  with z a standard normal score
    uniform      s = 2 Phi(z) - 1                       the deviation is half of the width
    lognormal    s = (exp(deviation z) - 1) / deviation     the deviation is that of the logarithm; always relative
    posterior    s = (draw - mean) / standard deviation, jointly, row by row of the draws

Scores are correlated by a Gaussian copula. A part is linear in s whatever the distribution, so that only samples know
distributions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from softgrip_jax.errors import InputError
from softgrip_jax.parameters import Parameter, Parameters
from softgrip_jax.quantities import State

from ..space import Space

PRESSURE = "pressure"
"""The name under which the pressure of every state that is asked for at a pressure scatters: a regulator's."""
DISTRIBUTIONS = ("normal", "uniform", "lognormal")


@dataclasses.dataclass(frozen=True)
class Scatter:
    """A number that scatters from part to part.

    Args:
        name: of the number, see `softgrip_jax.parameters`; "pressure" for that of every state at a given pressure.
        deviation: the standard deviation (half of the width of a uniform number): in SI, or dimensionless where it is
            relative.
        relative: whether the deviation is a part of the number itself.
        distribution: "normal", "uniform" or "lognormal" (relative: the deviation is that of the logarithm).

    Raises:
        InputError: for another distribution, a deviation that is not above zero, and a lognormal number whose deviation
            is not relative.

    Examples:
        >>> optim.Scatter("shell.t_m", 0.05).distribution
        'normal'
    """

    name: str
    deviation: float
    relative: bool = True
    distribution: str = "normal"

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            raise InputError(
                f"The distribution of {self.name!r} is {self.distribution!r}; it must be one of "
                f"{', '.join(DISTRIBUTIONS)}."
            )
        if not (np.isfinite(self.deviation) and self.deviation > 0):
            raise InputError(f"The deviation of {self.name!r} is {self.deviation:g}; it must be above zero.")
        if self.distribution == "lognormal" and not self.relative:
            raise InputError(f"{self.name!r} is lognormal: its deviation must be relative.")

    def deviations(self, z: Any) -> np.ndarray:
        """s of normal scores z."""
        if self.distribution == "uniform":
            return 2 * ndtr(z) - 1
        return np.expm1(self.deviation * np.asarray(z)) / self.deviation if self.is_log else np.asarray(z)

    @property
    def is_log(self) -> bool:
        """Whether it is the logarithm that is normal."""
        return self.distribution == "lognormal"


@dataclasses.dataclass(frozen=True)
class Draws:
    """Numbers whose joint scatter is known by draws, as those of a posterior.

    Args:
        names: of the numbers, see `softgrip_jax.parameters`.
        values: in SI, one row per draw.

    Raises:
        InputError: for values that are not finite or do not vary.

    Examples:
        >>> draws = optim.Draws(("shell.t_m",), np.array([[1.0], [1.2]]) * mm)
        >>> print(f"{draws.mean[0] / mm:.2f} mm, {draws.deviation[0] / mm:.3f} mm")
        1.10 mm, 0.100 mm
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "d k"]

    def __post_init__(self) -> None:
        for name, column in zip(self.names, self.values.T, strict=True):
            if not np.all(np.isfinite(column)) or not np.std(column) > 0:
                raise InputError(f"The draws of {name!r} must be finite numbers that vary.")

    @property
    def mean(self) -> np.ndarray:
        """Of every number, SI."""
        return np.mean(self.values, axis=0)

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of every number, SI."""
        return np.std(self.values, axis=0)

    @cached_property
    def ordered(self) -> np.ndarray:
        """s of every draw, along the direction in which they vary most: draws that are neighbours are alike."""
        s = (self.values - self.mean) / self.deviation
        return s[np.argsort(s @ np.linalg.svd(s, full_matrices=False)[2][0], kind="stable")]


class Scatters:
    """All that scatters: numbers, their correlations, and numbers that are known by draws.

    Args:
        numbers: what scatters by a distribution of its own.
        correlation: of the normal scores of `numbers`, a dimensionless matrix; None where they are independent.
        draws: further numbers, which scatter jointly as their draws do.

    Raises:
        InputError: where nothing scatters, a number is given twice, or the matrix is no correlation.

    Examples:
        >>> optim.Scatters([optim.Scatter("shell.t_m", 0.05)]).quasi_random(4, seed=0).shape
        (4, 1)
    """

    def __init__(
        self,
        numbers: Sequence[Scatter],
        correlation: Float[np.ndarray, "k k"] | None = None,
        draws: Draws | None = None,
    ):
        self.numbers, self.draws = tuple(numbers), draws
        self.names = (*(n.name for n in numbers), *(draws.names if draws else ()))
        if not self.names:
            raise InputError("Nothing scatters; name at least one number.")
        for name in self.names:
            if self.names.count(name) > 1:
                raise InputError(f"{name!r} scatters twice.")
        self.correlation = np.eye(len(numbers)) if correlation is None else np.asarray(correlation, float)
        try:
            self._root = np.linalg.cholesky(self.correlation) if len(numbers) else np.zeros((0, 0))
        except np.linalg.LinAlgError:
            raise InputError("The correlations contradict each other: no numbers have all of them.") from None

    @property
    def size(self) -> int:
        """How many numbers scatter."""
        return len(self.names)

    def of_uniform(self, u: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n m"]:
        """s of points of the unit cube; the last coordinate picks the draw."""
        u = np.clip(u, 1e-12, 1 - 1e-12)
        count = len(self.numbers)
        z = ndtri(u[:, :count]) @ self._root.T
        columns = [number.deviations(z[:, k])[:, None] for k, number in enumerate(self.numbers)]
        if self.draws is not None:
            rows = self.draws.ordered
            columns.append(rows[np.minimum((u[:, count] * len(rows)).astype(int), len(rows) - 1)])
        return np.concatenate(columns, axis=1)

    @property
    def _coordinates(self) -> int:
        return len(self.numbers) + (self.draws is not None)

    def quasi_random(self, count: int, seed: int) -> Float[np.ndarray, "n m"]:
        """s of `count` parts (a power of two is best) by a scrambled Sobol set."""
        power = int(np.ceil(np.log2(count)))
        return self.of_uniform(qmc.Sobol(self._coordinates, scramble=True, rng=seed).random_base2(power))[:count]

    def fresh(self, count: int, seed: int) -> Float[np.ndarray, "n m"]:
        """s of `count` parts drawn independently of each other."""
        return self.of_uniform(np.random.default_rng(seed).random((count, self._coordinates)))

    def box(self, scores: float) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest s of every number within so many standard normal scores of its middle, each by itself."""
        ends = np.array([-scores, scores])
        found = [number.deviations(ends) for number in self.numbers]
        if self.draws is not None:
            found += list(np.quantile(self.draws.ordered, ndtr(ends), axis=0).T)
        low, high = np.array(found).T
        return low, high


class ScatteredSpace(Space):
    """Designs and parts as one vector: the numbers of a design, then the deviations s of one of its parts.

    Unit values are those of the design, with s as it is behind them. At s = 0 a part is what its design says.

    Args:
        space: of the designs.
        scatters: what scatters around them.
    """

    def __init__(self, space: Space, scatters: Scatters):
        super().__init__(space.scenes, space.variables)
        self.designed, self.scatters = space.size, scatters
        numbers, draws = scatters.numbers, scatters.draws
        deviations = [n.deviation for n in numbers] + (list(draws.deviation) if draws else [])
        relative = [n.relative for n in numbers] + [False] * (len(deviations) - len(numbers))
        self._of_pressure = None
        self._moved: list[tuple[int, float, bool]] = []
        """(place in s, deviation, whether it is relative) of every number of the scenes that scatters."""
        for k, (name, deviation, part) in enumerate(zip(scatters.names, deviations, relative, strict=True)):
            if name == PRESSURE:
                self._of_pressure = (k, deviation, part)
            else:
                self._moved.append((k, deviation, part))
        names = [Parameter(name) for name in scatters.names if name != PRESSURE]
        self._scattered = Parameters(space.scenes, names) if names else None
        self.names += [f"scatter of {name}" for name in scatters.names]
        self.kinds += ["number"] * scatters.size
        self.reference = np.append(self.reference, np.zeros(scatters.size))

    def scatter_held(self) -> str:
        """What compiled programs hold of how numbers scatter, in words."""
        return repr((self._moved, self._of_pressure, self.scatters.names))

    def from_unit(self, t: Float[Array, " n"]) -> Float[Array, " n"]:
        """SI values of the design, then s, from unit values of the design, then s."""
        return jnp.concatenate([super().from_unit(t[: self.designed]), t[self.designed :]])

    def to_unit(self, x: Any) -> np.ndarray:
        """The other way."""
        x = np.asarray(x, dtype=float)
        return np.concatenate([super().to_unit(x[..., : self.designed]), x[..., self.designed :]], axis=-1)

    def inside(self, t: Any) -> np.ndarray:
        """Unit values of the design moved off the bounds."""
        t = np.asarray(t, dtype=float)
        return np.concatenate([super().inside(t[..., : self.designed]), t[..., self.designed :]], axis=-1)

    def scenes_at(self, x: Float[Array, " n"]) -> dict[str, Any]:
        """The scenes of a part."""
        scenes, s = super().scenes_at(x[: self.designed]), x[self.designed :]
        known = self._scattered
        if known is None:
            return scenes
        moved = [
            leaf * (1 + deviation * s[k]) if relative else leaf + deviation * s[k]
            for (k, deviation, relative), of_one in zip(self._moved, known.leaves_of(scenes), strict=True)
            for leaf in of_one
        ]
        return eqx.tree_at(lambda scenes: [leaf for of in known.leaves_of(scenes) for leaf in of], scenes, moved)

    def state_at(self, at: State, x: Float[Array, " n"]) -> Any:
        """A state as a part has it: its pressure may scatter, too."""
        if self._of_pressure is None or isinstance(at, tuple | str) or at is None:
            return at
        k, deviation, relative = self._of_pressure
        s = x[self.designed + k]
        return at * (1 + deviation * s) if relative else at + deviation * s
