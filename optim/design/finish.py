"""The last digits: second-order methods with exact slopes on a few designs, all in step.

Sequential quadratic programming (Kraft's SLSQP) lands on the active constraints and bounds; where every goal is a
`reach` and nothing is constrained but by rules, the trust-region least squares of Branch, Coleman and Li come first:
they know the curvature from the first step, and only where they end with a broken rule does the other method go on.
Both are SciPy's, and both ask for one design at a time, while a batch of designs costs little more than one: so each
design is finished in a thread of its own, and what all of them ask for is solved together. Optimistix, whose solvers
run inside one compiled program, would compile the physics once more.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares, minimize

from ..problem import Problem, Scales, finite

ROUNDING = 1e-9
"""A finished variable this near to a bound (of its range) is put on it."""

ITERATIONS = 60
"""SLSQP and least squares are done in ten to thirty from where the descent ends."""

NO_EQUILIBRIUM_RANK = 1e30
"""What a design without equilibrium deviates by: a step of least squares that led there is taken back. In the descent
infeasible designs rank from it on, and those without equilibrium from twice as much: it is more than any objective, so
that feasible ones come first."""

BOX, SHRINK, BOXES = 0.25, 0.3, 16
"""SLSQP has no trust region: its first step may cross the whole range, to where nothing has an equilibrium, and it then
creeps. It is held within this part of every range around where it begins, within less of it after such a step, and
begins anew where it comes to the wall, so many times at most."""

Look = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, float]]
"""t -> (values of the quantities, their slopes by t, shortfall)."""


class InStep:
    """Answers to many askers, given together: once every asker that is still there waits for one."""

    def __init__(self, evaluate: Any, askers: int):
        self.evaluate, self.askers = evaluate, askers
        self.asked: dict[int, np.ndarray] = {}
        self.answers: dict[int, Any] = {}
        self.is_over = False
        self.changed = threading.Condition()

    def look(self, k: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """The answer to asker k."""
        with self.changed:
            self.asked[k] = np.array(t)
            self._answer_if_all_wait()
            self.changed.wait_for(lambda: self.is_over or k in self.answers)
            answer = self.answers.pop(k, KeyboardInterrupt())
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def leave(self) -> None:
        """One asker has no more questions."""
        with self.changed:
            self.askers -= 1
            self._answer_if_all_wait()

    def give_up(self) -> None:
        """No further answers: every asker is interrupted at its next question."""
        with self.changed:
            self.is_over = True
            self.changed.notify_all()

    def _answer_if_all_wait(self) -> None:
        if self.is_over or len(self.asked) < self.askers or not self.asked:
            return
        # In the order of the askers, not of the threads: the same batches every time.
        order = sorted(self.asked)
        try:
            found = self.evaluate(np.stack([self.asked[k] for k in order]))
            for row, k in enumerate(order):
                self.answers[k] = (found.values[row], found.value_slopes[row], float(found.shortfall[row]))
        except BaseException as error:
            self.answers |= dict.fromkeys(order, error)
        self.asked.clear()
        self.changed.notify_all()


def in_step(evaluate: Any, count: int, work: Callable[[int, Look], np.ndarray]) -> list[np.ndarray]:
    """work(k, look) for k < count, each in its own thread, their questions answered together."""
    together = InStep(evaluate, count)

    def one(k: int) -> np.ndarray:
        try:
            return work(k, lambda t: together.look(k, t))
        finally:
            together.leave()

    with ThreadPoolExecutor(count) as pool:
        try:
            return list(pool.map(one, range(count)))
        except KeyboardInterrupt:
            together.give_up()  # the pool waits for its threads
            raise


def finish(candidates: np.ndarray, evaluate: Any, problem: Problem, scales: Scales, score: Any) -> np.ndarray:
    """The local optimum near each row of unit values.

    Args:
        candidates: where the descent ended.
        evaluate: the search's Evaluator.
        problem: what is searched.
        scales: of its goals.
        score: values -> (Score, its derivatives by the values).
    """
    squares = all(goal.kind == "reach" for goal in problem.goals) and not problem.limits

    def one(k: int, look: Look) -> np.ndarray:
        start = candidates[k]
        if squares:
            # Most ends keep the rules by themselves; the others are a good start for what makes them keep the rules.
            start = _least_squares(start, look, problem, scales)
            if not problem.constrained:
                return start
            values, _, shortfall = look(start)
            if shortfall == 0 and np.max(score(values)[0].violations, initial=0.0) <= 0:
                return start
        return _programmed(start, look, score, bool(problem.constrained))

    return on_bounds(np.stack(in_step(evaluate, len(candidates), one)))


def on_bounds(t: np.ndarray) -> np.ndarray:
    """Unit values within [0, 1], those next to a bound on it."""
    return np.where(np.abs(t - np.round(t)) < ROUNDING, np.round(t), np.clip(t, 0.0, 1.0))


def remembered(function: Callable[[np.ndarray], Any]) -> Callable[[np.ndarray], Any]:
    """SciPy asks for a value and for its slope one after the other: both come from one solution."""
    seen: dict[bytes, Any] = {}

    def call(t):
        key = t.tobytes()
        if key not in seen:
            seen[key] = function(t)
        return seen[key]

    return call


class Lost(Exception):
    """A step led to a design without equilibrium."""


def boxed(run: Callable[[np.ndarray, list[tuple[float, float]]], np.ndarray], t: np.ndarray) -> np.ndarray:
    """The result of run(t, bounds) from one box to the next."""
    size = BOX
    for _ in range(BOXES):
        low, high = np.maximum(t - size, 0.0), np.minimum(t + size, 1.0)
        try:
            found = np.clip(run(t, list(zip(low, high, strict=True))), low, high)
        except Lost:
            # Back to where the box began: what was accepted on the way may break constraints.
            size *= SHRINK
            continue
        at_wall = ((found < low + ROUNDING) & (low > 0)) | ((found > high - ROUNDING) & (high < 1))
        t = found
        if not np.any(at_wall):
            break
    return t


def _programmed(t: np.ndarray, look: Look, score: Any, constrained: bool) -> np.ndarray:
    """By SLSQP: objective under constraints."""

    @remembered
    def judged(t):
        values, by_t, shortfall = look(t)
        worth, slopes = score(values)
        violations, pushes = np.asarray(worth.violations), np.asarray(slopes.violations)
        if shortfall > 0:
            raise Lost
        return float(worth.objective), np.asarray(slopes.objective) @ by_t, violations, pushes @ by_t

    # SLSQP counts the objective against constraints of order one: a large weight would drown them.
    size = 1.0
    with contextlib.suppress(Lost):
        size = max(size, abs(judged(t)[0]))
    constraint = {"type": "ineq", "fun": lambda t: -judged(t)[2], "jac": lambda t: -judged(t)[3]}

    def run(t, bounds):
        return minimize(
            lambda t: judged(t)[0] / size,
            t,
            jac=lambda t: judged(t)[1] / size,
            bounds=bounds,
            constraints=[constraint] if constrained else [],
            method="SLSQP",
            options={"maxiter": ITERATIONS, "ftol": 1e-12},
        ).x

    return boxed(run, t)


def _least_squares(t: np.ndarray, look: Look, problem: Problem, scales: Scales) -> np.ndarray:
    """By trust-region least squares over the goals' deviations."""

    @remembered
    def deviations(t):
        values, by_t, shortfall = look(t)
        if shortfall > 0:
            return np.full(len(problem.goals), NO_EQUILIBRIUM_RANK), np.zeros((len(problem.goals), len(t)))
        places = [problem.asked.index(goal.quantity) for goal in problem.goals]
        targets = np.array([goal.target for goal in problem.goals])
        sizes = np.array(scales.goals)
        factors = np.sqrt([goal.weight for goal in problem.goals]) / sizes
        slopes = np.where(np.isinf(values[places])[:, None], 0.0, by_t[places])
        missed = np.asarray(finite(jnp.asarray(values[places]), sizes)) - targets
        return factors * missed, factors[:, None] * slopes

    return least_squares(
        lambda t: deviations(t)[0],
        np.clip(t, 1e-9, 1 - 1e-9),
        jac=lambda t: deviations(t)[1],
        bounds=(0.0, 1.0),
        x_scale=1.0,
        ftol=1e-12,
        xtol=1e-10,
        gtol=1e-12,
        max_nfev=ITERATIONS,
    ).x
