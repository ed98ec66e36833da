"""The design searches of configs/ against differential evolution (SciPy), CMA-ES (cma) and NSGA-II (pymoo).

    python -m benchmarks.search_peers [config.toml ...] [--budget SOLVES] [--seconds S] [--plain] [--out FILE.json]

One run, one machine, the same physics for all: a peer asks for whole populations at once, solved in chunks by a
compiled program without the derivatives that it has no use for. With --plain it asks, too, as it comes out of the box:
for one design at a time of our compiled physics; and for the first search it is told what the thesis's algorithms in
SciPy make of designs around ours, which is what there is without us. Constraints and designs without equilibrium cost
it a penalty of their size. A peer stops when it has a feasible design within TOLERANCE of ours, when its budget or time
is spent, or when it gives up. "solves" are designs evaluated (ours each with all derivatives); seconds are without
compilation, which is given beside them. Ours counts until it had a feasible design within TOLERANCE of its end, too,
and to its end, where it knows its optima to the last digits.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import time
from pathlib import Path
from typing import Any, ClassVar

import cma
import jax
import jax.numpy as jnp
import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.problem import Problem as Rivals
from pymoo.indicators.hv import HV
from pymoo.optimize import minimize
from scipy.optimize import differential_evolution

from benchmarks.speed import thesis_peer
from optim.design import settings
from optim.design.descent import CPU_CHUNK, FEASIBLE, Evaluator
from optim.design.pareto import pareto
from optim.problem import Problem
from softgrip_jax import config as configs

searching = importlib.import_module("optim.design.descent")
CONFIGS = Path(__file__).resolve().parent.parent / "configs"
SEARCHES = {
    "a": "finger_tip_force.toml",
    "b": "finger_lift.toml",
    "c": "shell_grasp.toml",
    "d": "finger_shape.toml",
    "e": "shell_trade_off.toml",
}
TOLERANCE = 1e-3
"""Of the objective, whose size is of order one: a peer need not find the last digits."""
PENALTY, NO_EQUILIBRIUM = 10.0, 1e3
NEAR = 50
"""Designs around ours for which the thesis's algorithms are timed."""


class Enough(Exception):
    """A peer has what it was asked for, or has used up its budget."""


class Peer:
    """What a peer minimises, and how it is doing."""

    def __init__(self, problem: Problem, goal: float, budget: int, seconds: float, chunk: int = CPU_CHUNK):
        self.problem, self.goal, self.budget, self.seconds, self.chunk = problem, goal, budget, seconds, chunk
        scales = self.scales = problem.scales(_at_start(problem))
        self.compiled = jax.jit(jax.vmap(lambda t: self._measure(t, scales)))
        began = time.perf_counter()
        self.compiled(jnp.zeros((chunk, problem.space.size)) + 0.5)
        self.compile = time.perf_counter() - began
        self.restart()

    def _measure(self, t, scales):
        found = self.problem.measure(t)
        judged = self.problem.score(found.values, scales)
        return judged.objective, jnp.max(judged.violations, initial=0.0), found.shortfall, found.values

    def restart(self) -> None:
        self.solves, self.best, self.began = 0, np.inf, time.perf_counter()

    def measured(self, t: np.ndarray) -> tuple[np.ndarray, ...]:
        t = np.clip(np.atleast_2d(t), 0.0, 1.0)
        self.solves += len(t)
        parts = []
        for start in range(0, len(t), self.chunk):
            rows = t[start : start + self.chunk]
            filled = np.concatenate([rows, np.repeat(rows[-1:], self.chunk - len(rows), axis=0)])
            parts.append([np.asarray(v)[: len(rows)] for v in self.compiled(jnp.asarray(filled))])
        return tuple(np.concatenate(column) for column in zip(*parts, strict=True))

    def cost(self, t: np.ndarray) -> np.ndarray:
        objective, violation, shortfall, _ = self.measured(t)
        lost = shortfall > 0
        feasible = ~lost & (violation <= FEASIBLE)
        self.best = min(self.best, np.min(objective[feasible], initial=np.inf))
        if self.best <= self.goal + TOLERANCE or self.solves >= self.budget or self.elapsed() > self.seconds:
            raise Enough
        return np.where(lost, NO_EQUILIBRIUM + shortfall, objective + PENALTY * violation)

    def elapsed(self) -> float:
        return time.perf_counter() - self.began

    def told(self) -> dict[str, Any]:
        reached = bool(self.best <= self.goal + TOLERANCE)
        return {"solves": self.solves, "seconds": self.elapsed(), "objective": float(self.best), "reached": reached}


def _at_start(problem: Problem) -> np.ndarray:
    t = problem.space.to_unit(problem.space.reference)
    return np.asarray(jax.jit(problem.measure)(jnp.asarray(t)).values)


def differential(peer: Peer, seed: int) -> dict[str, Any]:
    n = peer.problem.space.size
    peer.restart()
    with contextlib.suppress(Enough):
        differential_evolution(
            lambda x: peer.cost(x.T) if peer.chunk > 1 else peer.cost(x)[0],
            [(0.0, 1.0)] * n,
            rng=seed,
            vectorized=peer.chunk > 1,
            updating="deferred" if peer.chunk > 1 else "immediate",
            polish=False,
            maxiter=100_000,
            tol=1e-8,
        )
    return peer.told()


def evolution_strategy(peer: Peer, seed: int) -> dict[str, Any]:
    n = peer.problem.space.size
    peer.restart()
    rng = np.random.default_rng(seed)
    with contextlib.suppress(Enough):
        while True:  # with restarts, as its author advises
            options = {"bounds": [0, 1], "seed": int(rng.integers(1, 2**31)), "verbose": -9}
            options |= {"popsize": peer.chunk} if peer.chunk > 1 else {}
            strategy = cma.CMAEvolutionStrategy(rng.uniform(0.2, 0.8, n), 0.3, options)
            while not strategy.stop():
                asked = strategy.ask()
                strategy.tell(asked, list(peer.cost(np.array(asked))))
    return peer.told()


class Watched(Evaluator):
    """Notes when what was found."""

    seen: ClassVar[list[tuple[int, float, Any]]] = []

    def __call__(self, t: Any) -> Any:
        found = super().__call__(t)
        self.seen.append((self.solves, time.perf_counter(), found))
        return found


def first_within(problem: Problem, goal: float, scales: Any) -> tuple[int, float]:
    """Solves and time of the first feasible design within TOLERANCE of `goal` among what was watched."""
    judge = jax.jit(lambda values: problem.score(values, scales))
    for solves, at, found in Watched.seen:
        for values, shortfall in zip(found.values, found.shortfall, strict=True):
            judged = judge(values)
            feasible = shortfall == 0 and np.max(judged.violations, initial=0.0) <= FEASIBLE
            if feasible and judged.objective <= goal + TOLERANCE:
                return solves, at
    raise ValueError("the search saw no design like its best")


def by_scipy(problem: Problem, designs: np.ndarray) -> dict[str, Any]:
    """Search a by the thesis's algorithms: how many designs have their blocked and their free state at 31 kPa, how many
    of those the blocked one at 1.2 times that (the margin), and the median seconds of the first two where they are."""
    times, margins = [], 0
    for t in designs:
        finger = jax.tree.map(float, problem.space.scenes_at(problem.space.from_unit(jnp.asarray(t)))["blocked"].finger)
        lengths = {name: getattr(finger, name) * 1e3 for name in ("a", "b", "h_x", "t_m", "h_L", "H", "B", "L")}
        given = lengths | {"mu": float(finger.material.mu) * 1e-6}
        began = time.perf_counter()
        if all(thesis_peer.finger(given, 0.031, held).converged for held in (0.0, None)):
            times.append(time.perf_counter() - began)
            margins += thesis_peer.finger(given, 1.2 * 0.031, 0.0).converged
    middle = float(np.median(times)) if times else float("nan")
    return {"designs": len(designs), "with both states": len(times), "with the margin": margins, "seconds": middle}


def compare_search(path: Path, budget: int, seconds: float, plain: bool) -> dict[str, Any]:
    wanted = settings.read(configs.load(path))
    Watched.seen.clear()
    searching.Evaluator = Watched
    began = time.perf_counter()
    ours = searching.search(wanted.problem, **wanted.arguments)
    whole = time.perf_counter() - began
    compile_seconds = ours.seconds["compile"]
    peer = Peer(wanted.problem, ours.best.objective, budget, seconds)
    solves, at = first_within(wanted.problem, ours.best.objective, peer.scales)
    result: dict[str, Any] = {
        "ours": {
            "solves": solves,
            "seconds": at - began - compile_seconds,
            "solves to the end": ours.solves,
            "seconds to the end": whole - compile_seconds,
            "compile": compile_seconds,
            "objective": ours.best.objective,
            "violation": ours.best.violation,
        }
    }
    seed = wanted.arguments["seed"] + 1
    result["compile of the peers"] = peer.compile
    result["differential evolution"] = differential(peer, seed)
    result["CMA-ES"] = evolution_strategy(peer, seed)
    if plain:
        single = Peer(wanted.problem, ours.best.objective, budget, seconds, chunk=1)
        result["differential evolution, one at a time"] = differential(single, seed)
        result["CMA-ES, one at a time"] = evolution_strategy(single, seed)
        if path.name == SEARCHES["a"]:
            rng = np.random.default_rng(seed)
            near = np.clip(ours.best.t + rng.uniform(-0.3, 0.3, (NEAR, len(ours.best.t))), 0, 1)
            result["the thesis's algorithms"] = by_scipy(wanted.problem, near)
    return result


def compare_front(path: Path) -> dict[str, Any]:
    wanted = settings.read(configs.load(path))
    problem = wanted.problem
    front = pareto(problem, **wanted.arguments)
    peer = Peer(problem, -np.inf, 10**9, np.inf)
    terms_of = jax.jit(jax.vmap(problem.terms, in_axes=(0, None)))

    class Wrapped(Rivals):
        def _evaluate(self, x, out, *args, **kwargs):
            _, violation, shortfall, values = peer.measured(x)
            lost = shortfall > 0
            terms = np.asarray(terms_of(values, peer.scales))
            out["F"] = np.where(lost[:, None], NO_EQUILIBRIUM, terms)
            out["G"] = np.where(lost, 1 + shortfall, violation - FEASIBLE)[:, None]

    wrapped = Wrapped(n_var=problem.space.size, n_obj=len(problem.goals), n_ieq_constr=1, xl=0.0, xu=1.0)
    peer.restart()
    # As many designs as ours: more of them would fill the same front more densely, and so enclose more.
    population = len(front.designs)
    generations = max(1, 10 * front.solves // population)
    other = minimize(wrapped, NSGA2(pop_size=population), ("n_gen", generations), seed=1).F
    told = {"solves": peer.solves, "seconds": peer.elapsed(), "designs": len(other)}
    low, high = np.minimum(front.terms.min(0), other.min(0)), np.maximum(front.terms.max(0), other.max(0))
    volume = HV(ref_point=low + 1.1 * (high - low))
    unit = float(np.prod(1.1 * (high - low)))
    return {
        "ours": {
            "solves": front.solves,
            "seconds": front.seconds["front"],
            "compile": front.seconds["compile"],
            "designs": len(front.designs),
            "hypervolume": float(volume(front.terms)) / unit,
        },
        "NSGA-II": told | {"hypervolume": float(volume(other)) / unit},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configs", nargs="*", type=Path, default=[CONFIGS / name for name in SEARCHES.values()])
    parser.add_argument("--budget", type=int, default=20_000, help="solves of each peer at most")
    parser.add_argument("--seconds", type=float, default=300.0, help="of each peer at most")
    parser.add_argument("--plain", action="store_true", help="the peers one design at a time, too")
    parser.add_argument("--out", type=Path, help="where to write the numbers as JSON")
    arguments = parser.parse_args()
    results = {}
    for path in arguments.configs:
        front = configs.load(path).tables["design"].get("front")
        result = (
            compare_front(path) if front else compare_search(path, arguments.budget, arguments.seconds, arguments.plain)
        )
        results[path.stem] = result
        print(path.stem)
        ours = result["ours"]
        for name, told in result.items():
            if not isinstance(told, dict) or "solves" not in told:
                print(f"  {name}: {told if isinstance(told, dict) else round(told, 3)}")
                continue
            numbers = ", ".join(f"{k} {v:.5g}" if isinstance(v, float) else f"{k} {v}" for k, v in told.items())
            solves, seconds = told["solves"] / ours["solves"], told["seconds"] / ours["seconds"]
            ratios = f"  ({solves:.1f} x the solves, {seconds:.1f} x the time)"
            print(f"  {name}: {numbers}{ratios if name != 'ours' else ''}", flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
