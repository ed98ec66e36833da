"""The cheapest model and numerics that meet a wanted error, found by comparing the models of a ladder.

A model is the given scene with some physics left out and with cheaper numerics. The dearest model leaves nothing out
and has the finest numerics, so the errors of all models follow from comparing an observable v with its value there:

    error = (|v - v_dearest| + own) / (|v_dearest| - own),    own = |v_dearest - v_second| / gain

`own` bounds the error of the dearest model by what its last refinement changed; v_second has everything in, too.

This is the error of leaving out and of computing, never the error against reality: the dearest model is the given
scene, solved well. How far that is from finite elements is told where `softgrip verify` has verified a design nearby
(`against_elements`), and stands in the README for some others. Every model is a program of its own,
compiled once: choosing pays before a sweep, a search or a large batch, not before a single solve.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from . import pneunet, shell
from .errors import InputError
from .fields import require
from .model_error import model_error
from .names import listing
from .pneunet.finger_scene import PART_POINTS, FingerScene
from .questions import pressure_for, solve
from .results import Solution, Status
from .scene import RESIDUAL_EPS, Scene
from .shell.energy.scene import EnergyScene
from .shell.flat_shell import ShellScene
from .verify.kept import FOLDER, Nearby, nearby

ROUNDING = RESIDUAL_EPS * float(np.finfo(float).eps)
"""No error is claimed to be smaller than what `solve` accepts as a residual."""
FEWEST_POINTS, FINEST_POINTS = 4, 16
"""Gauss points along a finger on the cheapest model, and at least on the dearest: its own where those are more."""
MORE_POINTS, POINT_GAIN = 1.5, 16.0
"""From model to model: 4 to 6 points leave one part in 40 of the error, more leave less; one in 16 is claimed. The cell
law bends sharply where walls begin to touch: more points may leave all of the error there, and no gain is claimed."""
BASES = ((2, 3), (3, 4), (4, 6))
"""(across, along) polynomials of the energy membrane, the last its default; the dearest model has one and two more."""

# What models cost: time per design relative to `pneunet.Linear`, measured in batches of 256 on one core (type A, 12 to
# 30 kPa; energy membranes alone, 12 kPa). These numbers order the models, and hold within a factor of three.
ARC_COST, COUPLED_ARC_COST = 0.2, 4.0
PATH_COST, POINT_COST = 1.2, 0.016
"""Following a path, and the square of the points along the finger on top."""
WEIGHT_COST = 5.0
"""Loads are a path of their own, before the pressure."""
SECTION_COST = {"exact": 1.0, "thesis": 1.7, "inextensible": 0.9}
DRIVE_COST = {"cell": 3.0}
"""Of a drive, beside the thesis's."""
SHELL_COST = 2.0
ENERGY_COST = 18.0
"""Per product of polynomials."""
CELL_LEFT_OUT = "rims and walls that press on each other (the thesis's drive instead)"


class LadderModel(NamedTuple):
    """One model of a ladder: a way to compute the observables of a scene.

    Args:
        scene: the model.
        left_out: physics of the given scene that this one does without, in words.
        numerics: how finely it is solved, in words.
        cost: time per design in a batch, relative to an explicit finger, dimensionless.
        gain: how much less than from the model before, with coarser numerics, the error is at least, dimensionless.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.fidelity.model_ladder(sg.shell.Free(shell), ["inflation"])[0].left_out
        ('large strains',)
    """

    scene: Scene
    left_out: tuple[str, ...]
    numerics: str
    cost: float
    gain: float = 1.0


class Trial(NamedTuple):
    """One model of a ladder that was solved.

    Args:
        model: the model.
        solution: its solution.
        error: estimated relative error of the observable, dimensionless; inf where there is nothing to compare.

    Examples:
        >>> sg.fidelity.Trial._fields
        ('model', 'solution', 'error')
    """

    model: LadderModel
    solution: Solution
    error: float


UNVERIFIED = "(of leaving out and of computing; how far models are from reality is another matter: see the README)"


@dataclasses.dataclass(frozen=True)
class Choice:
    """The cheapest model that meets the tolerance, and what it was compared with.

    Args:
        scene: what to solve from now on.
        solution: of it.
        left_out: physics of the given scene that it does without, in words.
        numerics: how finely it is solved, in words.
        cost: time per design in a batch, relative to an explicit finger, dimensionless.
        error: estimated relative error of the observable, dimensionless; inf where the scene has no equilibrium.
        observable: whose error counts.
        tolerance: largest relative error that was asked for, dimensionless.
        trials: all that was solved, cheapest first. What is cheaper than the choice is not good enough; what is dearer,
            and was not needed for comparison, is not here.
        verified: errors against finite elements of designs nearby, by the name of the quantity, dimensionless; empty
            where none is near.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.fidelity.choose(sg.shell.Free(shell), 15 * kPa).met
        True
    """

    scene: Scene
    solution: Solution
    left_out: tuple[str, ...]
    numerics: str
    cost: float
    error: float
    observable: str
    tolerance: float
    trials: tuple[Trial, ...]
    verified: dict[str, Nearby] = dataclasses.field(default_factory=dict)

    @property
    def met(self) -> bool:
        """Whether the estimated error is within the tolerance; the dearest model, too, may miss a very small one."""
        return self.error <= self.tolerance

    def as_data(self) -> dict[str, Any]:
        """What was chosen and tried, as plain data; an error that is not known is None."""

        def described(model: LadderModel, error: float) -> dict[str, Any]:
            known = error if np.isfinite(error) else None
            return {"left_out": list(model.left_out), "numerics": model.numerics, "error": known, "cost": model.cost}

        trials = [described(trial.model, trial.error) for trial in self.trials]
        chosen = {"observable": self.observable, "tolerance": self.tolerance, "met": self.met}
        taken = LadderModel(self.scene, self.left_out, self.numerics, self.cost)
        near = {name: one.as_data() for name, one in self.verified.items()}
        return chosen | described(taken, self.error) | {"tried": trials, "verified": near}

    def _unverified(self) -> str:
        """What is known of the model itself where no design nearby was verified."""
        known = model_error(self.scene, self.observable)
        return f"model error of {self.observable.replace('_', ' ')}: {known}" if known else UNVERIFIED

    def __str__(self) -> str:
        name = self.observable.replace("_", " ")
        if not np.isfinite(self.error):
            return f"nothing is left out: {name} has no value to compare ({Status(int(self.solution.status)).name})."
        dearest = self.trials[-1].model.cost
        lines = [
            f"left out for {_percent(self.tolerance)} of {name}: {_listed(self.left_out)} ({self.numerics})",
            f"estimated error in {name}: {_percent(self.error)}" + ("" if self.met else ", the least of all models"),
            *([f"{quantity}: {near}" for quantity, near in self.verified.items()] or [self._unverified()]),
            "",
            f"  {'error':>9} {'time':>7}  left out",
        ]
        for model, _, error in self.trials:
            chosen = model.left_out == self.left_out and model.numerics == self.numerics
            mark, share, rest = "*" if chosen else " ", model.cost / dearest, _listed(model.left_out)
            lines.append(f"{mark} {_percent(error):>9} {share:7.2g}  {rest} ({model.numerics})")
        return "\n".join(lines)


def _listed(words: tuple[str, ...]) -> str:
    return " and ".join(words) or "nothing"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if np.isfinite(share) else "-"


def choose(
    scene: Scene, pressure: Any = None, tolerance: float = 0.01, observable: str | None = None, **target: Any
) -> Choice:
    """The cheapest model of a scene whose estimated error of an observable is within a tolerance.

    Models are tried from the cheapest up, and the first that is good enough is taken. The dearest two are always
    solved, since all are compared with them. Where none is good enough the dearest is returned, with its error.

    Args:
        scene: one scene of known numbers (not traced by jit or vmap).
        pressure: gauge pressure, Pa; without it, a target as in `pressure_for` (none for a grasp, which has its own).
        tolerance: largest relative error, dimensionless, for instance 0.01. For a point (x, y): distance over distance
            from (0, 0).
        observable: whose error counts; by default the first in the scene's OBSERVABLES, or "pressure" for a target.
        target: as in `pressure_for`.

    Raises:
        InputError: for an observable that the scene does not have, and for numbers that cannot be meant.

    Source: own; the module says how errors are estimated.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.fidelity.choose(sg.shell.Free(shell), 15 * kPa, tolerance=0.01).left_out
        ()
    """
    if not isinstance(scene, Scene):
        raise InputError(f"scene is {scene!r}; it must be a Scene, for instance sg.shell.Free(...).")
    if isinstance(pressure, Tracer) or np.ndim(pressure) > 0:
        raise InputError("choose compares numbers: it takes one known pressure, outside of jit and vmap.")
    if pressure is not None and target:
        raise InputError(f"choose got a pressure and a target ({', '.join(target)}); it takes one of them.")
    if isinstance(tolerance, Tracer) or np.ndim(tolerance) > 0:
        raise InputError("choose takes one tolerance, a number.")
    tolerance = float(require("tolerance", tolerance, "positive", "number"))
    name = _observable(scene, observable, pressure is None)
    ladder = model_ladder(scene, [*target, name])
    solved: dict[int, Solution] = {}

    def read(k: int) -> Reading:
        if k not in solved:
            model = ladder[k].scene
            solved[k] = pressure_for(model, **target) if pressure is None else solve(model, pressure)
        value = np.ravel(solved[k].pressure if name == "pressure" else solved[k].observables[name])
        return Reading(value, int(solved[k].status))

    chosen, errors = decide(ladder, read, tolerance)
    model = ladder[chosen]
    trials = tuple(Trial(ladder[k], solved[k], errors[k]) for k in sorted(errors))
    solution = solved[chosen]
    near = against_elements(model.scene, float(solution.pressure)) if int(solution.status) == Status.OK else {}
    return Choice(
        *(model.scene, solution, model.left_out, model.numerics, model.cost),
        *(errors[chosen], name, tolerance, trials, near),
    )


def against_elements(scene: Scene, pressure: Any, folder: Path = FOLDER) -> dict[str, Nearby]:
    """The errors of a model against finite elements, from verified designs near to the scene's.

    A verified design is near where it is of the same kind, material and settings (`moment_spread`, the polynomials of
    an energy membrane, ...) and every number of it (lengths, angles, moduli) is within 10 % of the scene's; it speaks
    about the pressures that it was verified at, and between them. Of a finger the errors are those of its straight
    cell: the moment with which the chambers push, and the force of their walls.

    Args:
        scene: the scene, with its model.
        pressure: gauge pressure, Pa.
        folder: of `softgrip verify`.

    Returns:
        By the name of the quantity; empty where no design is near.

    Raises:
        InputError: for a file in the folder that is no verification.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> sg.fidelity.against_elements(sg.shell.Free(shell), 15 * kPa)  # nothing was verified yet
        {}
    """
    if isinstance(scene, FingerScene | pneunet.Cell):
        model, names, curvature = str(getattr(scene, "drive", "cell")), ("moment", "contact_force"), 0.0
    elif isinstance(scene, pneunet.Chamber):
        model, names, curvature = "thesis", ("force",), None
    else:
        model, names, curvature = getattr(scene, "model", "energy"), tuple(scene.prepared().OBSERVABLES), None
    found = {name: nearby(scene, float(pressure), name, model, curvature, folder) for name in names}
    return {name: one for name, one in found.items() if one is not None}


def _observable(scene: Scene, wanted: str | None, inverse: bool) -> str:
    known = [*(["pressure"] if inverse else []), *scene.prepared().OBSERVABLES]
    if wanted is None:
        return known[0]
    if wanted not in known:
        raise InputError(f"{type(scene).__name__} has no observable {wanted!r}; it has: {', '.join(known)}.")
    return wanted


# --- errors -----------------------------------------------------------------------------------------------------------


class Reading(NamedTuple):
    """What one model of a ladder says.

    Args:
        value: the observable in SI, shape (1,), or (2,) for a point.
        status: number of a `Status`.

    Examples:
        >>> sg.fidelity.Reading(np.array([0.1]), 0).status
        0
    """

    value: np.ndarray
    status: int


def decide(ladder: list[LadderModel], read: Callable[[int], Reading], tolerance: float) -> tuple[int, dict[int, float]]:
    """The first model of a ladder that meets the tolerance, and the errors of all that were solved.

    Args:
        ladder: the models, cheapest first.
        read: solves the model of an index when asked.
        tolerance: largest relative error, dimensionless.

    Returns:
        The index of the model, and index -> estimated relative error.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> ladder = sg.fidelity.model_ladder(sg.shell.Free(shell), ["inflation"])
        >>> said = [sg.fidelity.Reading(np.array([value]), 0) for value in (0.99, 1.0)]
        >>> sg.fidelity.decide(ladder, said.__getitem__, tolerance=0.02)[0]
        0
    """
    last = len(ladder) - 1
    second = max((k for k in range(last) if not ladder[k].left_out), default=last)
    best, status = read(last)
    own = own_error(best, read(second).value, ladder[last].gain)
    errors: dict[int, float] = {}

    def error(k: int) -> float:
        if k not in errors:
            errors[k] = error_of(read(k).value, best, own) if read(k).status == status else np.inf
        return errors[k]

    chosen, coarser, hopeless = last, dict[tuple[str, ...], np.ndarray](), set[tuple[str, ...]]()
    for k in range(last if status in (Status.OK, Status.NO_CONTACT) else 0):
        left_out = ladder[k].left_out
        if left_out in hopeless:
            continue
        if error(k) <= tolerance:
            chosen = k
            break
        # More points do not help where what the last refinement changed is small beside what is missing. (Where nothing
        # is left out they always do, even if two coarse ones happen to agree.)
        if left_out and left_out in coarser and np.isfinite(error(k)):
            still = np.linalg.norm(read(k).value - coarser[left_out]) / np.linalg.norm(best)
            if error(k) - still > tolerance:
                hopeless.add(left_out)
        coarser[left_out] = read(k).value
    for k in (second, last):
        error(k)
    return chosen, errors


def own_error(dearest: np.ndarray, second: np.ndarray, gain: float) -> float:
    """A bound of the absolute error of the dearest model, from what its last refinement changed.

    Args:
        dearest, second: values of the dearest two models, in SI, shape (n,).
        gain: how much less the error of the dearest is at least, dimensionless.

    Examples:
        >>> print(f"{sg.fidelity.own_error(np.array([1.0]), np.array([1.16]), 16.0):.3f}")
        0.010
    """
    return float(np.linalg.norm(dearest - second) / gain + ROUNDING * np.linalg.norm(dearest))


def error_of(value: np.ndarray, dearest: np.ndarray, own: float) -> float:
    """The estimated relative error of a model's value: a bound of |value - truth| / |truth| if `own` is one.

    Args:
        value, dearest: values of the model and of the dearest one, in SI, shape (n,).
        own: bound of the absolute error of the dearest one, in SI.

    Examples:
        >>> print(f"{sg.fidelity.error_of(np.array([0.99]), np.array([1.0]), 0.0):.3f}")
        0.010
    """
    gap, size = float(np.linalg.norm(value - dearest)) + own, float(np.linalg.norm(dearest)) - own
    if gap == 0:  # nothing is touched: the force is zero on both models
        return 0.0
    return gap / size if size > 0 and np.isfinite(gap) else np.inf


# --- the ladder -------------------------------------------------------------------------------------------------------


def model_ladder(scene: Scene, observables: list[str]) -> list[LadderModel]:
    """The model ladder of a scene, cheapest first, without models that lack one of the observables.

    The last model leaves nothing out and has the finest numerics.

    Args:
        scene: the given scene.
        observables: names that every model must know.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> [model.numerics for model in sg.fidelity.model_ladder(sg.shell.Free(shell), ["inflation"])]
        ['explicit', 'one angle']
    """
    kinds = {FingerScene: _finger, EnergyScene: _energy, ShellScene: _shell, pneunet.Chamber: _chamber}
    make = next((make for kind, make in kinds.items() if isinstance(scene, kind)), _alone)
    *cheaper, dearest = make(scene)
    names = set(observables) - {"pressure"}
    ordered = [*sorted(cheaper, key=lambda model: model.cost), dearest]
    return [model for model in ordered if names <= _shared(model.scene, scene)]


def _shared(simpler: Scene, scene: Scene) -> set[str]:
    """Observables that mean the same in both."""
    known = set(simpler.prepared().OBSERVABLES)
    # A linear finger reports the tip of the free finger beside the force of the blocked one.
    mixed = isinstance(simpler, pneunet.Linear) and isinstance(scene, pneunet.TipContact)
    return known - {"tip", "tip_angle"} if mixed else known


def _alone(scene: Scene) -> Iterator[LadderModel]:
    yield LadderModel(scene, (), "as given", SHELL_COST)


def _chamber(scene: pneunet.Chamber) -> Iterator[LadderModel]:
    small = pneunet.SmallStrainChamber(scene.finger, ignored_rules=scene.ignored_rules)  # pyright: ignore[reportCallIssue]
    yield LadderModel(small, ("large strains", "inclination of the walls"), "explicit", 1.0)
    yield LadderModel(scene, (), "one angle", SHELL_COST)


def _shell(scene: ShellScene) -> Iterator[LadderModel]:
    if type(scene) is shell.Free:
        plate = shell.Plate(scene.shell, ignored_rules=scene.ignored_rules)  # pyright: ignore[reportCallIssue]
        yield LadderModel(plate, ("large strains",), "explicit", 1.0)
    if scene.model == "arc":
        yield LadderModel(scene, (), "one angle", SHELL_COST)
        return
    arc = dataclasses.replace(scene, model="arc")
    yield LadderModel(arc, ("the membrane's own shape (arcs instead)",), "one angle", SHELL_COST)
    yield from _energy(scene.prepared())


def _energy(scene: Any) -> Iterator[LadderModel]:
    given = (scene.across, scene.lengthwise)
    finer = (scene.across + 1, scene.lengthwise + 2)
    bases = [basis for basis in BASES if basis[0] < given[0] and basis[1] < given[1]] + [given, finer]
    for across, along in bases:
        sized = dataclasses.replace(scene, across=across, lengthwise=along)
        yield LadderModel(sized, (), f"{across} x {along} polynomials", ENERGY_COST * across * along)


def _finger(scene: Any) -> Iterator[LadderModel]:
    """Every subset of the simplifications with every number of points."""
    without_cell = (CELL_LEFT_OUT,) if scene.is_cell() else ()
    if scene.finger.segments is None and type(scene) in (pneunet.Free, pneunet.TipContact):
        linear = pneunet.Linear(scene.finger, ignored_rules=scene.ignored_rules)  # pyright: ignore[reportCallIssue]
        left_out = ("large deflections and strains", "all loads", *without_cell)
        yield LadderModel(linear, left_out, "explicit", 1.0)
    simpler: list[tuple[Any, tuple[str, ...]]] = [(scene, ())]
    if scene.weight is not None:
        # Free of loads, parts are arcs. Elsewhere zeros do: they share the program, and compiling is what takes long.
        arcs = isinstance(scene, pneunet.Free) and scene.tip_load is None
        weightless = dataclasses.replace(scene, weight=None if arcs else jnp.zeros(2))
        simpler.append((weightless, ("weight of the finger",)))
    # The cell law has neither a section of its own nor walls that incline: there is nothing of them to leave out.
    if scene.section != "inextensible" and not scene.is_cell():
        simpler += [
            (dataclasses.replace(one, section="inextensible"), (*o, "stretch of the cover")) for one, o in simpler
        ]
    if scene.inclines():
        simpler += [
            (dataclasses.replace(one, inclination="none"), (*o, "inclination of the walls")) for one, o in simpler
        ]
    if without_cell:
        yield from _resolved(dataclasses.replace(scene, drive="thesis"), without_cell, 1.0)
    dear = DRIVE_COST.get(str(scene.drive), 1.0)
    for one, left_out in reversed(simpler):
        yield from _resolved(one, left_out, dear * (WEIGHT_COST if one.weight is scene.weight is not None else 1.0))


def _resolved(scene: Any, left_out: tuple[str, ...], share: float) -> Iterator[LadderModel]:
    """The same finger with more and more points: up to FINEST_POINTS or its own, and at least once more."""
    coupled = scene.inclines()
    if isinstance(scene, pneunet.Free) and scene.is_arcs():
        yield LadderModel(scene, left_out, "arcs", COUPLED_ARC_COST if coupled else ARC_COST)
        return
    parts = scene.chambers()[0].low.shape[0]
    cost = SECTION_COST.get(str(scene.section), SECTION_COST["exact"]) * share
    gain = 1.0 if scene.is_cell() else POINT_GAIN
    each, finest, count = (FEWEST_POINTS if parts == 1 else PART_POINTS), max(FINEST_POINTS, scene.method().points), 0
    # Under strong loads `solve` takes more: models with fewer would all be the same one.
    fewest = scene.with_method(pneunet.Collocation(each * parts)).prepared().method().points
    each = max(each, math.ceil(fewest / parts))
    while True:
        every = each * parts
        finer = scene.with_method(pneunet.Collocation(every))
        yield LadderModel(
            finer, left_out, f"{every} points along the finger", cost * (PATH_COST + POINT_COST * every**2), gain
        )
        count += 1
        if every >= finest and count > 1:
            return
        each = math.ceil(MORE_POINTS * each)


__dir__ = listing(globals())
