"""The comparison of one scene: finite elements on two meshes or three, our models beside them.

The first mesh follows the states from rest. Each further mesh begins with the states of the one before and divides its
cells; the last states that were asked for come first there, so that a run that is stopped has them.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

from .equilibrium import PATIENCE, Model, NoStateError, State
from .transfer import transferred

PARTS, FINE_PARTS = (1, 2), (1, 2, 3)
"""Into how many each cell of the first mesh is divided along each axis, mesh by mesh."""
COST = 1.3
"""Time of an iteration goes about with the number of elements to this power."""
MOST_ELEMENTS = 3200
"""Of a mesh: finer ones are left out, so that the memory stays near two gigabytes."""
FIRST, NEXT = 60, 14
"""Iterations to expect on the first mesh for all states together, and on further ones for each."""


class Target(NamedTuple):
    """A state that is asked for.

    Args:
        pressure: Pa.
        curvature: of a finger's cell, 1/m; None elsewhere, and where it is asked for.
        free: of a finger's cell, whether it bends until no moment is needed.
    """

    pressure: float
    curvature: float | None = None
    free: bool = False


class Discrete(Protocol):
    """A scene on one mesh."""

    model: Model
    most: float

    def follow(self, targets: list[Target]) -> Iterator[State]:
        """States from rest through all targets, in their order; fewer where there are none."""
        ...

    def settle(self, target: Target, state: State) -> State:
        """The state of a target from one near it."""
        ...

    def observe(self, state: State) -> dict[str, float]:
        """What is compared, in SI."""
        ...


@dataclasses.dataclass
class Found:
    """What finite elements say of one target.

    Args:
        target: the state.
        values: of each mesh that was solved, from the first to the finest, in SI.
        seconds: that each mesh took for it.
    """

    target: Target
    values: list[dict[str, float]] = dataclasses.field(default_factory=list)
    seconds: list[float] = dataclasses.field(default_factory=list)
    state: State | None = None
    mesh: Any = None
    parts: tuple[int, ...] = ()

    def mesh_error(self, name: str) -> float | None:
        """What the finest mesh may be off by, in SI: what it would be if the error fell only in proportion to the
        cells' length, |v - v_coarser| / (ratio - 1). None with one mesh."""
        if len(self.values) < 2 or name not in self.values[-1]:
            return None
        ratio = self.parts[len(self.values) - 1] / self.parts[len(self.values) - 2]
        return abs(self.values[-1][name] - self.values[-2][name]) / (ratio - 1)


Watch = Callable[[float, float], None]
"""watch(share that is done, seconds that are left)."""


class Clock:
    """How much of the work is done, in iterations weighed by what they cost."""

    def __init__(self, watch: Watch, parts: tuple[int, ...], targets: int):
        self.watch, self.began, self.done = watch, time.monotonic(), 0.0
        cost = [float(part) ** (3 * COST) for part in parts]
        self.shares = [FIRST * cost[0], *(NEXT * targets * one for one in cost[1:])]
        self.cost = cost

    def on(self, mesh: int, through: Callable[[], float]) -> Callable[[float], None]:
        """What an iteration tells on a mesh, of which through() says how much is done."""
        before, total = sum(self.shares[:mesh]), sum(self.shares)

        def tick(pressure: float) -> None:
            done = (before + self.shares[mesh] * min(through(), 1.0)) / total
            spent = time.monotonic() - self.began
            if done > 0.01:
                self.watch(done, spent * (1 - done) / done)

        return tick


def compare(
    build: Callable[[int], Discrete], targets: list[Target], parts: tuple[int, ...], watch: Watch
) -> Iterator[list[Found]]:
    """Solve the targets on all meshes; yields what there is whenever there is more.

    Args:
        build: the scene with each cell divided in so many parts along each axis.
        targets: in the order in which they are followed.
        parts: mesh by mesh.
        watch: is told how far it is.
    """
    clock = Clock(watch, parts, len(targets))
    found = [Found(target, parts=parts) for target in targets]
    coarse = build(parts[0])
    top = max(target.pressure for target in targets) or 1.0
    solved = 0

    def through() -> float:
        return (solved + now[0] / top) / (len(targets) + 1)

    now = [0.0]
    tick = clock.on(0, through)

    def first(pressure: float) -> None:
        now[0] = pressure
        tick(pressure)

    coarse.model.watch = first
    began = time.monotonic()
    for one, state in zip(found, coarse.follow(targets), strict=False):
        solved += 1
        one.state, one.mesh = state, coarse
        one.values.append(coarse.observe(state))
        one.seconds.append(time.monotonic() - began)
        began = time.monotonic()
        yield found
    first_mesh = len(coarse.model.solid.cells)
    for k, part in enumerate(parts[1:], start=1):
        if first_mesh * part**3 > MOST_ELEMENTS:
            return
        reached = [one for one in found if len(one.values) == k]
        if not reached:
            return
        began = time.monotonic()
        fine = build(part)
        count = [0]

        def along(done: list[int] = count, all_of: int = len(reached)) -> float:
            return done[0] / (NEXT * all_of)

        tick = clock.on(k, along)
        for place, one in enumerate(reversed(reached)):
            count[0] = NEXT * place

            def step(pressure: float, count: list[int] = count, end: int = NEXT * (place + 1) - 1, tick: Any = tick):
                count[0] = min(count[0] + 1, end)
                tick(pressure)

            fine.model.watch = step
            assert one.state is not None
            try:
                state, _ = fine.model.newton(transferred(one.mesh.model, one.state, fine.model), fine.most, PATIENCE)
                state = fine.settle(one.target, fine.model.augmented(state, fine.most))
            except NoStateError:
                before = [other.target for other in found[: found.index(one) + 1]]
                followed = list(fine.follow(before))
                if len(followed) < len(before):
                    continue
                state = followed[-1]
            one.state, one.mesh = state, fine
            one.values.append(fine.observe(state))
            one.seconds.append(time.monotonic() - began)
            began = time.monotonic()
            yield found
