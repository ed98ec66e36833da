"""A search whose designs are solved by the workers of Dask.

The search itself stays in one process, which knows every design that any start has come to: at every step the starts
are dealt out in the batches in which one process would have solved them, each from the nearest designs that are known,
whoever found them. So the answer is that of one process for the same seed, to the bit on the same kind of processor,
however many workers there are; a step has one batch for every 64 starts, and more workers than that have nothing to do.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import jax
import numpy as np

from softgrip_jax.spread import Calls, Spread

from ..problem import Problem
from .descent import Evaluator


@contextmanager
def evaluator_on(spread: Spread | None, problem: Problem) -> Iterator[Any]:
    """What takes the place of `Evaluator` in a search: itself where there are no workers."""
    if spread is None:
        yield Evaluator
        return
    with spread.on(_solver, sent(problem)) as calls:
        yield partial(SpreadEvaluator, calls)


def sent(problem: Problem) -> Problem:
    """The problem without its compiled programs: a worker compiles for itself."""
    alone = copy.copy(problem)
    alone._programs, alone._kept = {}, {}
    return alone


def _solver(problem: Problem) -> Any:
    """What a worker calls: a program of the problem, by its name, for a batch."""

    def solve(name: str, further: dict[str, Any], rows: Any) -> Any:
        return jax.tree.map(np.asarray, getattr(problem, name)(*rows, **further))

    return solve


class SpreadEvaluator(Evaluator):
    """An evaluator whose batches are solved by workers."""

    def __init__(self, calls: Calls, problem: Problem, chunk: int):
        super().__init__(problem, chunk)
        self.calls = calls

    def prepare(self) -> None:
        """Each worker makes its own."""

    def _run(self, program: Any, batches: list[Any]) -> list[Any]:
        function = program.func if isinstance(program, partial) else program
        further = program.keywords if isinstance(program, partial) else {}
        return self.calls([(function.__name__, further, rows) for rows in batches])
