"""Sets of designs: any rows of a set on demand, so that a set of any size takes little memory."""

from __future__ import annotations

import abc
import dataclasses
import math
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from ..errors import InputError
from ..parameters import SCALES, between, require_range


@dataclasses.dataclass(frozen=True)
class Range:
    """Bounds of one variable of a study.

    Args:
        low, high: the bounds, in SI.
        scale: "linear", or "log" to fill it evenly in the logarithm.

    Raises:
        InputError: where low is not below high, or a logarithmic bound is not positive.

    Examples:
        >>> sg.study.Range(1.0, 100.0, scale="log").points(3).round(9).tolist()
        [1.0, 10.0, 100.0]
    """

    low: float
    high: float
    scale: str = "linear"

    def __post_init__(self) -> None:
        require_range("a variable of the study", self.low, self.high, self.scale)

    def points(self, n: int) -> np.ndarray:
        """n values from low to high, both included."""
        return between(np.linspace(0.0, 1.0, n), self.low, self.high, self.scale == SCALES[1])


class Designs(abc.ABC):
    """A set of designs: rows of SI values, one column per varied number.

    Rows are made on demand, so that a set of any size takes little memory. A subclass gives `rows`, `shape` and
    `columns`.

    Examples:
        >>> isinstance(sg.study.Grid([np.array([1.0, 2.0])]), sg.study.Designs)
        True
    """

    shape: tuple[int, ...]
    """(number of designs,), or the lengths of the axes of a grid."""
    columns: int

    @property
    def count(self) -> int:
        """Number of designs."""
        return math.prod(self.shape)

    @abc.abstractmethod
    def rows(self, start: int, stop: int) -> np.ndarray:
        """Designs start to stop - 1; the same numbers whatever was asked before."""


class Grid(Designs):
    """Every combination of the values of each axis; the last axis runs fastest.

    Args:
        axes: one list of values in SI per varied number, shapes (n_1,), (n_2,), ...

    Raises:
        InputError: where an axis is empty.

    Examples:
        >>> sg.study.Grid([np.array([1.0, 2.0]), np.array([5.0, 6.0, 7.0])]).rows(2, 4).tolist()
        [[1.0, 7.0], [2.0, 5.0]]
    """

    def __init__(self, axes: Sequence[np.ndarray]):
        self.axes = [np.asarray(axis, dtype=float) for axis in axes]
        if not self.axes or any(axis.ndim != 1 or axis.size == 0 for axis in self.axes):
            raise InputError("A grid needs a list of values for every variable.")
        self.shape, self.columns = tuple(axis.size for axis in self.axes), len(self.axes)

    def rows(self, start, stop):
        places = np.unravel_index(np.arange(start, stop), self.shape)
        return np.stack([axis[place] for axis, place in zip(self.axes, places, strict=True)], axis=1)


class Samples(Designs):
    """Points of the unit cube, spread over ranges.

    Args:
        ranges: a `Range` per varied number.
        count: number of designs, 1 or more.
        seed: of the random numbers.

    Raises:
        InputError: where count is less than 1.
    """

    def __init__(self, ranges: Sequence[Range], count: int, seed: int = 0):
        if count < 1:
            raise InputError(f"The number of samples is {count}; it must be 1 or more.")
        self.ranges, self.seed = list(ranges), seed
        self.shape, self.columns = (count,), len(self.ranges)

    def rows(self, start, stop):
        low, high = np.array([(r.low, r.high) for r in self.ranges]).T
        return between(self.unit(start, stop), low, high, np.array([r.scale == "log" for r in self.ranges]))

    @abc.abstractmethod
    def unit(self, start: int, stop: int) -> np.ndarray:
        """Points start to stop - 1 in the unit cube."""


class Sobol(Samples):
    """A scrambled Sobol sequence: even in every projection, best at powers of two.

    Args:
        ranges: a `Range` per varied number.
        count: number of designs, 1 or more.
        seed: of the scrambling.

    Raises:
        InputError: where count is less than 1.

    Source: Owen 1995, by `scipy.stats.qmc`.

    Examples:
        >>> sg.study.Sobol([sg.study.Range(1.0, 2.0)], 4).rows(0, 4).shape
        (4, 1)
    """

    def unit(self, start, stop):
        sequence = qmc.Sobol(self.columns, rng=self.seed)
        if start:
            sequence.fast_forward(start)
        with warnings.catch_warnings():
            # A part of the sequence is never a power of two long; the whole is what counts.
            warnings.filterwarnings("ignore", message="The balance properties of Sobol")
            return sequence.random(stop - start)


class LatinHypercube(Samples):
    """Each variable is cut into as many slices as there are samples, and each slice is hit once.

    The permutations of all slices are made at once and kept: 8 bytes per number.

    Args:
        ranges: a `Range` per varied number.
        count: number of designs, 1 or more.
        seed: of the permutations.

    Raises:
        InputError: where count is less than 1.

    Source: McKay, Beckman and Conover 1979, by `scipy.stats.qmc`.

    Examples:
        >>> points = sg.study.LatinHypercube([sg.study.Range(0.0, 4.0)], 4).rows(0, 4)
        >>> sorted(int(x) for x in points[:, 0])  # one in each quarter
        [0, 1, 2, 3]
    """

    _points: np.ndarray | None = None

    def unit(self, start, stop):
        if self._points is None:
            self._points = qmc.LatinHypercube(self.columns, rng=self.seed).random(self.count)
        return self._points[start:stop]


class Table(Designs):
    """Designs as they are given, one per row.

    Args:
        values: in SI, shape (designs, varied numbers).

    Raises:
        InputError: where the table is empty.

    Examples:
        >>> sg.study.Table(np.array([[1.0, 5.0], [2.0, 6.0]])).count
        2
    """

    def __init__(self, values: np.ndarray):
        self.values = np.atleast_2d(np.asarray(values, dtype=float))
        if self.values.size == 0:
            raise InputError("The table of designs is empty.")
        self.shape, self.columns = (len(self.values),), self.values.shape[1]

    def rows(self, start, stop):
        return self.values[start:stop]
