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
        is_log = np.array([r.scale == "log" for r in self.ranges])
        # The same numbers, without an exponential of each where none is asked for.
        return between(self.unit(start, stop), low, high, is_log if is_log.any() else False)

    @abc.abstractmethod
    def unit(self, start: int, stop: int) -> np.ndarray:
        """Points start to stop - 1 in the unit cube."""


SOBOL_BITS = 30
"""Binary digits of a Sobol point: SciPy's own, enough for a thousand million points."""
SOBOL_TABLE = 16
"""The first 2^16 points are kept: every later run of as many is the same points with some digits flipped."""


class Sobol(Samples):
    """A scrambled Sobol sequence: even in every projection, best at powers of two.

    Any part of it costs what its own points cost. Point n is the exclusive or of what belongs to each binary digit of
    n (its Gray code is linear in them), so that points start + i, with start a multiple of 2^16, are points i with the
    digits flipped in which point start differs from point 0.

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

    def __init__(self, ranges: Sequence[Range], count: int, seed: int = 0):
        super().__init__(ranges, count, seed)
        self._table: np.ndarray | None = None
        self._flips: list[np.ndarray] = []

    def unit(self, start, stop):
        size = 1 << SOBOL_TABLE
        if self._table is None:
            self._table = self._digits(qmc.Sobol(self.columns, rng=self.seed, bits=SOBOL_BITS), min(size, self.count))
        parts = []
        for high in range(start >> SOBOL_TABLE, ((stop - 1) >> SOBOL_TABLE) + 1):
            first = high << SOBOL_TABLE
            part = self._table[max(start - first, 0) : min(stop - first, size)]
            parts.append(part ^ self._flip(high))
        return np.concatenate(parts) * 2.0**-SOBOL_BITS

    def _flip(self, high: int) -> np.ndarray:
        """The digits in which point high * 2^16 differs from point 0."""
        assert self._table is not None
        if high >> len(self._flips):
            # SciPy goes through all points up to the one that is wanted: 1 s for 1e8, once.
            sequence = qmc.Sobol(self.columns, rng=self.seed, bits=SOBOL_BITS)
            for k in range(high.bit_length()):
                sequence.fast_forward((1 << (SOBOL_TABLE + k)) - sequence.num_generated)
                flip = self._digits(sequence, 1)[0] ^ self._table[0]
                if k >= len(self._flips):
                    self._flips.append(flip)
        found = np.zeros_like(self._table[0])
        for k, flip in enumerate(self._flips):
            if high >> k & 1:
                found ^= flip
        return found

    @staticmethod
    def _digits(sequence: qmc.Sobol, count: int) -> np.ndarray:
        with warnings.catch_warnings():
            # A part of the sequence is never a power of two long; the whole is what counts.
            warnings.filterwarnings("ignore", message="The balance properties of Sobol")
            return (sequence.random(count) * 2**SOBOL_BITS).astype(np.uint32)


class LatinHypercube(Samples):
    """Each variable is cut into as many slices as there are samples, and each slice is hit once.

    Any part of it costs what its own points cost. Which slice a design has is a permutation that is computed for the
    design alone: a Feistel network on the pairs of digits (l, r) of its number in mixed base, l < a and r < b with
    a b >= count, whose ROUNDS rounds add a hash of one digit to the other. Where that leads beyond the last slice it is
    applied again, until it does not (cycle walking), which keeps it a permutation.

    Args:
        ranges: a `Range` per varied number.
        count: number of designs, 1 or more.
        seed: of the permutations, and of the places within the slices.

    Raises:
        InputError: where count is less than 1.

    Source: McKay, Beckman and Conover 1979; Black and Rogaway 2002 for permutations of any size; the hash is SplitMix64
        (Steele, Lea and Flood 2014).

    Examples:
        >>> points = sg.study.LatinHypercube([sg.study.Range(0.0, 4.0)], 4).rows(0, 4)
        >>> sorted(int(x) for x in points[:, 0])  # one in each quarter
        [0, 1, 2, 3]
    """

    ROUNDS = 6

    def unit(self, start, stop):
        number = np.arange(start, stop, dtype=np.uint64)
        keys = np.random.SeedSequence(self.seed).generate_state(self.columns * (self.ROUNDS + 1), np.uint64)
        points = np.empty((stop - start, self.columns))
        for k, (*rounds, inside) in enumerate(keys.reshape(self.columns, -1)):
            places = self._slices(number, rounds)
            within = (_hashed(number, inside) >> np.uint64(9)) * 2.0**-53
            points[:, k] = (places + within) / self.count
        return points

    def _slices(self, number: np.ndarray, keys: Sequence[np.uint64]) -> np.ndarray:
        """The slices of designs, one per design."""
        a = np.uint64(math.isqrt(self.count - 1) + 1)
        b = np.uint64(-(-self.count // int(a)))
        left, right = number % a, number // a
        for k, key in enumerate(keys):
            if k % 2:
                right = (right + _hashed(left, key)) % b
            else:
                left = (left + _hashed(right, key)) % a
        found = left + a * right
        beyond = found >= self.count
        if beyond.any():
            found[beyond] = self._slices(found[beyond], keys)
        return found


def _hashed(number: np.ndarray, key: np.uint64) -> np.ndarray:
    """SplitMix64: 62 bits that look like nothing of the numbers."""
    mixed = (number + key) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (mixed ^ (mixed >> np.uint64(31))) >> np.uint64(2)


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
