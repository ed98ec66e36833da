"""The answers to a state of the sliders, stage by stage: the state with its picture, the curve, what would help.

Everything is values in, plain data out; a page draws it. Programs are compiled once per kind of scene and kept.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
import time
from collections import defaultdict
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..commands.programs import program
from ..compiler import MANY_CALLS, QUICKLY, SIDE_BY_SIDE
from ..geometry import Section, has_sections, sections
from ..model_error import model_error, of_material
from ..questions import equilibrium_reaching, to_reach, to_solve
from ..reasons import Reason
from ..results import Solution, Status, in_units
from ..scene import Found, Scene, equilibrium
from ..units import DISPLAY, kPa
from .ahead import Ahead

CURVE_POINTS = 60
"""Points of a curve through its limit."""
BEYOND = 1.3
"""A curve without a limit is shown to this many times the pressure of the state."""
LONG = 0.01
"""Seconds of a run from which it is worth to compile a program once more, with all of LLVM's optimisation."""


@jax.jit
def curve_to_limit(scene: Scene) -> tuple[Any, Solution]:
    """The limit pressure, and the branch through it."""
    solver = scene.solver()
    limit = solver.find_limit(scene)
    pressure = jnp.where(limit.status == Status.OK, limit.pressure, jnp.nan)
    return pressure, solver.branch(scene, CURVE_POINTS, limit)


@jax.jit
def slopes_at(scene: Scene, unknowns: Any, pressure: Any) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Observables of a state whose unknowns are known, their derivatives by every number of the scene, in the order of
    its leaves, and by the pressure."""
    leaves, structure = jax.tree.flatten(scene)

    def observed(leaves, pressure):
        known = Found(unknowns, pressure, jnp.asarray(Status.OK), jnp.asarray(0))
        return jax.tree.unflatten(structure, leaves).solution_of(known).observables

    slopes = jax.jacfwd(observed, argnums=(0, 1))(leaves, pressure)
    by_pressure = {name: by[1] for name, by in slopes.items()}
    flat = {
        name: jnp.concatenate([jnp.reshape(d, (*jnp.shape(by[1]), -1)) for d in by[0]], axis=-1)
        for name, by in slopes.items()
    }
    return observed(leaves, pressure), flat, by_pressure


class Programs:
    """Compiled programs by question and kind of scene; one for all browsers."""

    def __init__(self) -> None:
        self.ahead: Ahead | None = None
        """What compiles beside this process, where programs are kept."""
        self._kept: dict[Any, Any] = {}
        self._locks: defaultdict[Any, threading.Lock] = defaultdict(threading.Lock)
        self._runs: defaultdict[Any, list[float]] = defaultdict(list)
        """Seconds of the runs of a program, its compiling left out."""
        self._improved: set[Any] = set()

    def traced(self, function: Any, *args: Any) -> Any:
        """The program for arguments like these; XLA compiles it when it is first called."""
        key = _key(function, args)
        if key not in self._kept:
            # One lock a program: a state never waits for the curve, which compiles for seconds.
            with self._locks[key]:
                if key not in self._kept:
                    self._kept[key] = program(function, *args, options=_options(function))
        return self._kept[key]

    def __call__(self, function: Any, *args: Any) -> Any:
        key, found = _key(function, args), self.traced(function, *args)
        is_first = key not in self._runs
        begun = time.perf_counter()
        answer = jax.block_until_ready(found(*args))
        runs = self._runs[key]
        if not is_first:
            runs.append(time.perf_counter() - begun)
        return answer

    def is_ready(self, function: Any, *args: Any) -> bool:
        """Whether the program has run."""
        return _key(function, args) in self._runs

    def prepare(self, function: Any, *args: Any) -> None:
        """Wait until the process beside this one, if there is one, has compiled the program."""
        if self.ahead is not None and _key(function, args) not in self._kept:
            self.ahead.compiled(function, args, _options(function)).result()

    def improve(self, function: Any, *args: Any) -> None:
        """Have a program that runs for long compiled again beside this process, to run faster; it is then used."""
        key = _key(function, args)
        if self.ahead is None or key in self._improved:
            return
        self._improved.add(key)
        if not self._runs[key]:  # it has run once, which is mostly compiling
            self(function, *args)
        if min(self._runs[key]) < LONG:
            return

        def use(made: Future[bool]) -> None:
            if made.result():
                better = program(function, *args, options=SIDE_BY_SIDE)
                jax.block_until_ready(better(*args))
                self._kept[key] = better

        self.ahead.compiled(function, args, SIDE_BY_SIDE).add_done_callback(use)


def _key(function: Any, args: tuple[Any, ...]) -> Any:
    leaves, structure = jax.tree.flatten(args)
    words = tuple(leaf for leaf in leaves if isinstance(leaf, str))
    return function, structure, words, tuple(np.shape(leaf) for leaf in leaves)


def _options(function: Any) -> dict[str, Any]:
    """A first picture waits for its program; what follows runs after it and is larger."""
    return MANY_CALLS if function in (curve_to_limit, slopes_at) else QUICKLY


programs = Programs()


def _beside(function: Any, *args: Any) -> Any:
    """An answer that nobody's hand waits for: compiled elsewhere, and once more where it takes long."""
    programs.prepare(function, *args)
    answer = programs(function, *args)
    programs.improve(function, *args)
    return answer


@dataclasses.dataclass(frozen=True)
class Row:
    """An observable of a state, as people read it."""

    name: str
    text: str
    error: str
    """How far the model is from finite elements, where that is known."""


@dataclasses.dataclass(frozen=True)
class State:
    """A state with its picture."""

    ok: bool
    message: str
    """Where it is not OK, why and by how much."""
    pressure: float
    """Pa."""
    margins: tuple[tuple[str, float], ...]
    """Rule and margin, m, the least first."""
    sections: tuple[Section, ...]
    solution: Solution
    scene: Scene

    @functools.cached_property
    def rows(self) -> tuple[Row, ...]:
        """The observables."""
        known, kinds = jax.device_get(self.solution.observables), self.solution.scene.OBSERVABLES
        said = of_material(self.solution)
        return tuple(
            Row(n, in_units(known[n], kind), said.get(n) or model_error(self.scene, n)) for n, kind in kinds.items()
        )


@dataclasses.dataclass(frozen=True)
class CurveData:
    """An observable over the pressure, from no pressure through the limit: Pa and SI; NaN where there is no state."""

    observable: str
    pressure: np.ndarray
    value: np.ndarray
    stable: np.ndarray
    """Before the limit."""
    limit: float
    """Pa; inf where there is none."""
    contact: float | None
    """The first pressure, Pa, with a state that touches; None where that is no pressure at all."""
    end: str
    """What the curve ends with before its limit: that, or the rule that the next states break."""
    scene: Scene


@dataclasses.dataclass(frozen=True)
class Helps:
    """Elasticities of an observable: how many per cent it changes for one per cent of each number; largest first."""

    observable: str
    bars: tuple[tuple[str, float], ...]


def asked_of(scene: Scene, pressure: float | None, task: dict[str, float]) -> tuple[Any, ...]:
    """A program and its arguments, that find the state of a scene at a pressure (Pa), or that of a task."""
    if pressure is None:
        return equilibrium_reaching, *to_reach(scene, **task)
    return equilibrium, *to_solve(scene, pressure)


def state_of(scene: Scene, pressure: float | None, task: dict[str, float]) -> State:
    """The state of a scene at a pressure (Pa); without one, where an observable has a value (SI), as task says, or
    where the scene does a task of its own."""
    solution = programs(*asked_of(scene, pressure, task))
    status = Status(int(solution.status))
    ok = status is Status.OK
    found = ((n, float(m)) for n, m in jax.device_get(solution.margins).items() if np.isfinite(m))
    # Of the range that a law is known for only that it is left is worth a word.
    known = sorted(((n, m) for n, m in found if Reason[n.upper()].forbids or m < 0), key=lambda pair: pair[1])
    drawn = sections(solution) if ok and has_sections(solution.scene) else ()
    message = "" if ok else f"{status.name}: {solution.reason_text()}"
    return State(ok, message, float(solution.pressure), tuple(known), drawn, solution, scene)


def prepare_drawing(scene: Scene, pressure: float | None, task: dict[str, float]) -> None:
    """Have what draws a state compiled, while XLA compiles the state's own program: a state of zeros is drawn."""
    asked = asked_of(scene, pressure, task)
    shapes = getattr(programs.traced(*asked), "shapes", None)
    if shapes is None or not has_sections(scene):
        return
    blank = jax.tree.map(_zero, shapes)
    known = jax.tree.map(lambda aval, leaf: jnp.asarray(leaf, aval.dtype), shapes.scene, asked[1])
    # On a device of their own choice, as what a program has found: XLA compiles for that.
    state = jax.device_put(dataclasses.replace(blank, scene=known), jax.devices()[0])
    with suppress(Exception):  # it is no state, and may not be drawn to its end
        sections(state)


def _zero(aval: Any) -> jax.Array:
    """An array of zeros like one that a program gives: a status made of Python's numbers is weakly typed, and JAX would
    compile anew for another type."""
    if aval.weak_type and not aval.shape:
        return jnp.asarray(np.zeros((), aval.dtype).item())
    return jnp.zeros(aval.shape, aval.dtype)


def prepare_state(scene: Scene, pressure: float) -> None:
    """Have the program of a state at a pressure (Pa) ready, before somebody asks for it."""
    asked = asked_of(scene, pressure, {})
    if not programs.is_ready(*asked):
        _beside(*asked)


def components(scene: Scene) -> dict[str, tuple[str, int | None, str]]:
    """What curves can show: key -> (observable, component of a point, kind)."""
    found: dict[str, tuple[str, int | None, str]] = {}
    for name, kind in scene.prepared().OBSERVABLES.items():
        if kind == "position":
            found |= {f"{name}.x": (name, 0, "length"), f"{name}.y": (name, 1, "length")}
        else:
            found[name] = (name, None, kind)
    return found


def part_of(observables: dict[str, Any], name: str, component: int | None) -> np.ndarray:
    """An observable, or a component of a point, over a batch."""
    value = np.asarray(observables[name])
    return value if component is None else value[..., component]


def curve_of(scene: Scene, observable: str) -> CurveData:
    """The curve of an observable through the limit."""
    name, component, _ = components(scene)[observable]
    limit, branch = _beside(curve_to_limit, to_solve(scene, 0.0)[0])
    status, pressure = np.asarray(branch.status), np.asarray(branch.pressure)
    value = part_of(branch.observables, name, component)
    shown = (status <= Status.NO_CONTACT) & np.isfinite(value)
    touching = shown & (status == Status.OK)
    # A branch begins where something is first touched, or where pressure begins to act.
    contact = float(pressure[touching][0]) if touching.any() and pressure[touching][0] > 0 else None
    far = np.where(np.isfinite(pressure), np.abs(pressure - limit), np.inf)
    stable = np.arange(len(pressure)) <= (np.argmin(far) if np.isfinite(limit) else len(pressure))
    end = ""
    if (shown & stable).any():
        last = int(np.flatnonzero(shown & stable)[-1])
        if np.isclose(pressure[last], limit, rtol=1e-3):
            end = f"limit {float(limit) / kPa:.4g} kPa"
        elif last + 1 < len(status) and status[last + 1] > Status.NO_CONTACT:
            reason = Reason(int(np.asarray(branch.reason)[last + 1]))
            end = f"{reason.name.lower()} between {pressure[last] / kPa:.4g} and {pressure[last + 1] / kPa:.4g} kPa"
    drawn = np.flatnonzero(shown)
    part = slice(drawn[0], drawn[-1] + 1) if len(drawn) else slice(0)
    pressure, value = (np.where(shown, column, np.nan)[part] for column in (pressure, value))
    return CurveData(observable, pressure, value, stable[part], float(limit), contact, end, scene)


def helps_of(scene: Scene, state: State, observable: str, keys: list[str], places: list[int]) -> Helps:
    """Elasticities at a state by the numbers of these keys, whose places among the scene's leaves are given."""
    name, component, _ = components(scene)[observable]
    known = state.solution.unknowns, state.solution.pressure
    values, slopes, by_pressure = _beside(slopes_at, to_solve(scene, 0.0)[0], *known)
    value = float(part_of(values, name, component))
    if not np.isfinite(value) or value == 0:
        return Helps(observable, ())
    slope = np.asarray(slopes[name])
    slope = slope if component is None else slope[component]
    now = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(scene)])
    bars = [(key, float(slope[k] * now[k] / value)) for key, k in zip(keys, places, strict=True) if now[k] != 0]
    bars.append(("pressure", float(part_of(by_pressure, name, component)) * state.pressure / value))
    bars = [bar for bar in bars if np.isfinite(bar[1])]
    return Helps(observable, tuple(sorted(bars, key=lambda bar: -abs(bar[1]))))


def with_unit(observable: str, kind: str) -> str:
    """'tip force (N)'."""
    label = DISPLAY[kind][0]
    words = observable.replace("_", " ")
    return f"{words} ({label})" if label else words
