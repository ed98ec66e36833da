"""One row of the comparison, and what is said of it."""

from __future__ import annotations

import enum
import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..questions import solve
from ..results import Solution, in_units
from .printed import Printed


class Verdict(enum.Enum):
    """Of a number or a statement."""

    REPRODUCED = "reproduced"
    """Within one unit of the last printed digit (the thesis cuts some numbers and rounds others); or the statement
    holds for what we computed."""
    EXPLAINED = "explained"
    """Further away, for a reason that was itself computed."""
    NOT_IN_TEXT = "not reproducible from the text"
    """The text leaves out what the number depends on, or it was measured and its data are only in a figure."""
    DIFFERS = "differs"
    """Further away, and we do not know why."""


class Row(NamedTuple):
    """A number or a statement of the thesis beside ours."""

    source: str
    quantity: str
    printed: str
    ours: str
    deviation: str
    verdict: Verdict
    reason: str
    cell: str = ""
    """What the cell law gives in place of `ours`; empty for shells and where the law has no part."""
    ratio: str = ""
    """The cell law's number over that of the thesis's chambers."""
    cell_remark: str = ""
    """Whether a statement holds by the cell law, too, or why there is no state."""


def number(source: str, quantity: str, printed: Printed, ours: Any, reason: str = "", explained: bool = False) -> Row:
    """A printed number beside ours (SI); `explained`: whether the reason was found to hold where it is needed."""
    ours = float(ours)
    agrees = abs(ours - printed.value) <= printed.digit * (1 + 1e-9)
    verdict = Verdict.REPRODUCED if agrees else Verdict.EXPLAINED if explained else Verdict.DIFFERS
    return Row(
        source,
        quantity,
        str(printed),
        in_units(ours, printed.kind),
        deviation(printed, ours),
        verdict,
        "" if agrees else reason,
    )


def deviation(printed: Printed, ours: Any) -> str:
    """Ours over the printed number, less one."""
    return f"{100 * (float(ours) / printed.value - 1):+.1f} %"


def statement(source: str, says: str, ours: str, holds: Any, reason: str = "") -> Row:
    """A trend or a bound that the text states."""
    return Row(source, says, "", ours, "", Verdict.REPRODUCED if bool(holds) else Verdict.DIFFERS, reason)


def missing(source: str, quantity: str, printed: str, reason: str, ours: str = "", deviation: str = "") -> Row:
    """What cannot be recomputed."""
    return Row(source, quantity, printed, ours, deviation, Verdict.NOT_IN_TEXT, reason)


def stacked(scenes: Sequence[Any]) -> Any:
    """Scenes of one kind as one with a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)


class Batch:
    """Scenes of one kind at pressures, in named groups that are solved as one program."""

    def __init__(self) -> None:
        self._scenes: list[Any] = []
        self._pressures: list[float] = []
        self._groups: dict[str, slice] = {}
        self.seconds = 0.0
        """That one state of the batch took, without compilation; known where it was solved as `timed`."""

    def add(self, name: str, scenes: Sequence[Any], pressures: Iterable[Any]) -> None:
        first = len(self._scenes)
        self._scenes += scenes
        self._pressures += [float(p) for p in pressures]
        self._groups[name] = slice(first, len(self._scenes))

    def solve(self, timed: bool = False) -> dict[str, Solution]:
        program, arguments = jax.jit(jax.vmap(solve)), (stacked(self._scenes), jnp.array(self._pressures))
        found = jax.block_until_ready(program(*arguments))
        if timed:
            began = time.perf_counter()
            jax.block_until_ready(program(*arguments))
            self.seconds = (time.perf_counter() - began) / len(self._scenes)
        return {name: jax.tree.map(lambda x, g=group: x[g], found) for name, group in self._groups.items()}


def member(solution: Solution, k: int) -> Solution:
    """Solution k of a batch."""
    return jax.tree.map(lambda x: x[k], solution)
