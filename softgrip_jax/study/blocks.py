"""How the designs of a study are cut into blocks: each is a run of designs, and a box of the grid at the same time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np


class Block(NamedTuple):
    """Designs start to stop - 1, which fill the box of these slices."""

    start: int
    stop: int
    box: tuple[slice, ...]
    place: tuple[int, ...]
    """Which block it is along every axis."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(side.stop - side.start for side in self.box)


class Blocks:
    """A shape cut into boxes of equal size, each a contiguous run of its C order: boxes are whole in the last axes, cut
    along one axis, and one wide in the axes before it. The last box along an axis may be smaller."""

    def __init__(self, shape: Sequence[int], chunk: Sequence[int]):
        self.shape, self.chunk = tuple(shape), tuple(chunk)
        self.counts = tuple(-(-n // c) for n, c in zip(self.shape, self.chunk, strict=True))

    @classmethod
    def of(cls, shape: Sequence[int], most: int, multiple: int = 1) -> Blocks:
        """Boxes of at most so many designs, and nearly equal ones: of a multiple of so many where there is one axis."""
        chunk, inner = [1] * len(shape), 1
        for k in reversed(range(len(shape))):
            if inner * shape[k] <= most:
                chunk[k] = shape[k]
                inner *= shape[k]
                continue
            parts = -(-shape[k] // max(most // inner, 1))
            chunk[k] = -(-shape[k] // parts)
            if len(shape) == 1:
                chunk[k] = -(-chunk[k] // multiple) * multiple
            break
        return cls(shape, chunk)

    @property
    def size(self) -> int:
        """Designs of a whole block."""
        return math.prod(self.chunk)

    def __len__(self) -> int:
        return math.prod(self.counts)

    def __getitem__(self, k: int) -> Block:
        if not 0 <= k < len(self):
            raise IndexError(k)
        place = []
        for count in reversed(self.counts):
            k, i = divmod(k, count)
            place.append(i)
        place = tuple(reversed(place))
        box = tuple(slice(i * c, min((i + 1) * c, n)) for i, c, n in zip(place, self.chunk, self.shape, strict=True))
        start = 0
        for side, n in zip(box, self.shape, strict=True):
            start = start * n + side.start
        return Block(start, start + math.prod(side.stop - side.start for side in box), box, place)

    def __iter__(self) -> Iterator[Block]:
        return (self[k] for k in range(len(self)))

    def joined(self, most: int) -> Blocks:
        """Larger blocks, each of whole ones of these, of at most so many designs where one of these is not larger."""
        chunk = list(self.chunk)
        for k in reversed(range(len(chunk))):
            factor = max(min(most // math.prod(chunk), self.counts[k]), 1)
            chunk[k] = min(chunk[k] * factor, self.shape[k])
            if chunk[k] < self.shape[k]:
                break
        return Blocks(self.shape, chunk)


def spread_over(block: Block, axis: np.ndarray, k: int) -> np.ndarray:
    """The values of axis k of a grid, one per design of a block."""
    shape = [1] * len(block.box)
    shape[k] = -1
    return np.broadcast_to(axis[block.box[k]].reshape(shape), block.shape).ravel()
