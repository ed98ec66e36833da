"""The section [design.uncertain] of a config: what scatters from part to part, and what is wanted of all parts.

    [design.uncertain]                [[design.uncertain.numbers]]       [[design.uncertain.requirements]]
    yield = 0.95                      name = "shell.t_m_mm"              keep = "pressure_kPa"
    goal = "nominal"                  relative = 0.05                    at = "required"
                                                                         high = 30

A number scatters by `relative` (of its own value) or `deviation` (in the unit of its key): the standard deviation, of a
"uniform" number half of the width, of a "lognormal" one that of the logarithm. `pressure_kPa` is the pressure of every
state that is asked for at a pressure. `correlations = [{ between = ["a", "b"], value = 0.5 }]` joins two numbers;
`posterior = "posterior.nc"` adds those of a calibration, jointly.

`goal` is what is wanted of the goals: "nominal", "expected", "quantile" (with `quantile = 0.9`) or "worst" (within
`box` standard deviations). With `yield = 0.95` so many of all parts must have an equilibrium and keep every requirement
and rule; without it every constraint holds as the goal does, in the mean, at the quantile or at the worst. Without
requirements the constraints of the design are what a part must keep; with them the constraints hold for the design
itself.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

import jax.numpy as jnp
import numpy as np
import pydantic

from softgrip_jax.config.keys import Seed, Table, varied
from softgrip_jax.draws import Drawn, other_laws, read_draws
from softgrip_jax.errors import ConfigError, InputError, located
from softgrip_jax.parameters import Parameter, Parameters, Scenes
from softgrip_jax.results import in_units
from softgrip_jax.units import DISPLAY

from ..problem import Limits, Problem
from ..space import Space
from .evaluate import SAMPLES
from .scatter import DISTRIBUTIONS, PRESSURE, Draws, Scatter, Scatters
from .statistics import Wanted

WIDEST = 4.0
"""Standard deviations that a normal number must keep its rule within: one part in 30,000 is farther out."""
PRESSURE_KEY = "pressure_kPa"


class UncertainNumber(Table):
    name: str | Annotated[list[str], pydantic.Field(min_length=1)]
    deviation: float | None = None
    relative: float | None = None
    distribution: Literal[DISTRIBUTIONS] = "normal"  # type: ignore[valid-type]


class CorrelationTable(Table):
    between: list[str] = pydantic.Field(min_length=2, max_length=2)
    value: float


class RequirementTable(Table):
    keep: str
    at: str | dict[str, float] | None = None
    low: float | None = None
    high: float | None = None
    scale: float | None = pydantic.Field(default=None, gt=0)


class UncertainTable(Table):
    numbers: list[UncertainNumber] = []
    correlations: list[CorrelationTable] = []
    posterior: str | None = None
    goal: Literal["nominal", "expected", "quantile", "worst"] = "nominal"
    quantile: float | None = None
    yield_: float | None = pydantic.Field(default=None, alias="yield")
    box: float = pydantic.Field(default=2.0, gt=0, le=6)
    requirements: list[RequirementTable] = []
    method: Literal["auto", "derivatives", "samples"] = "auto"
    samples: int = pydantic.Field(default=SAMPLES, ge=64, le=65536)
    seed: Seed = 0
    front: list[float] = []
    budget: bool = True


@dataclasses.dataclass(frozen=True)
class Uncertain:
    """[design.uncertain] as read.

    Args:
        scatters: what scatters.
        labels: the key of every number that scatters, with its deviation in words.
        wanted: of all parts.
        limits: requirements of a part; None where they are the limits of the design.
        box: of worst cases, standard deviations.
        method: "auto", "derivatives" or "samples".
        samples, seed: of the samples.
        front: yields of a front.
        budget: whether the tolerances are compared.
    """

    scatters: Scatters
    labels: tuple[str, ...]
    wanted: Wanted
    limits: tuple[Limits, ...] | None
    box: float
    method: str
    samples: int
    seed: int
    front: tuple[float, ...]
    budget: bool


def scenes_of_posterior(
    scenes: Scenes, table: UncertainTable, folder: Path, where: str
) -> tuple[Scenes, Draws | None, tuple[str, ...]]:
    """The scenes with the numbers of a posterior at their means, its draws, and a sentence for every number that is not
    as the config says, and for laws that are not those of the posterior."""
    if table.posterior is None:
        return scenes, None, ()
    draws, found = _draws(scenes, folder / table.posterior, where)
    known = Parameters(scenes, [Parameter(name) for name in draws.names])
    said = [
        f"{name} is at its mean of the posterior, {in_units(mean, kind)}; the config says {in_units(given, kind)}."
        for name, kind, mean, given in zip(known.tied, known.kinds, draws.mean, known.reference, strict=True)
        if in_units(mean, kind) != in_units(given, kind)
    ]
    return known.scenes_at(jnp.asarray(draws.mean)), draws, (*said, *other_laws(scenes, found))


def read(table: UncertainTable, space: Space, draws: Draws | None, limits: list[Limits], where: str) -> Uncertain:
    """What the section says; raises ConfigError for anything that is wrong in it."""
    where = f"{where[:-1]}.uncertain]" if where.endswith("]") else where
    numbers, labels = (
        zip(*(_number(space, n, where) for n in table.numbers), strict=True) if table.numbers else ((), ())
    )
    keys = [n.name if isinstance(n.name, str) else n.name[0] for n in table.numbers]
    with located(where):
        scatters = Scatters(numbers, _correlation(keys, table, where), draws)
    if draws is not None:
        labels = (*labels, *(f"{name} (posterior)" for name in draws.names))
    _require_share("yield", table.yield_, where)
    _require_share("quantile", table.quantile, where)
    if (table.goal == "quantile") != (table.quantile is not None):
        raise ConfigError(f'{where}: goal = "quantile" and quantile = 0.9, for instance, belong together.')
    if table.goal == "nominal" and table.yield_ is None:
        raise ConfigError(
            f'{where}: nothing is wanted of the parts; give yield, or goal = "expected", "quantile" or "worst".'
        )
    if table.goal == "worst" and table.yield_ is not None:
        raise ConfigError(f'{where}: goal = "worst" keeps every constraint at its worst; leave out yield.')
    if table.requirements and table.yield_ is None:
        raise ConfigError(f"{where}: requirements are what a yield counts; give yield, too.")
    if table.front and table.yield_ is None:
        raise ConfigError(f"{where}: a front is one of performance against yield; give yield, too.")
    for share in table.front:
        _require_share("front", share, where)
    return Uncertain(
        scatters,
        labels,
        Wanted(table.goal, table.quantile or 0.5, table.yield_),
        tuple(limits) if table.requirements else None,
        table.box,
        table.method,
        table.samples,
        table.seed,
        tuple(sorted(table.front)),
        table.budget,
    )


def require_counted(problem: Problem, uncertain: Uncertain, where: str) -> None:
    """A ConfigError where a yield has nothing to count, and where a pressure scatters that no state is asked at."""
    require_felt(problem, uncertain, where)
    if uncertain.wanted.promised is not None and not (uncertain.limits or problem.limits) and not problem.rules:
        raise ConfigError(f"{where}: a yield needs something to keep; give requirements or constraints.")


def require_felt(problem: Problem, uncertain: Uncertain, where: str) -> None:
    """A ConfigError where the pressure scatters but no state is asked for at one, or where it may fall to zero."""
    scatter = next((number for number in uncertain.scatters.numbers if number.name == PRESSURE), None)
    if scatter is None:
        return
    pressures = [at for _, at in problem.asked.states if isinstance(at, float)]
    if not pressures:
        raise ConfigError(
            f"{where}: {PRESSURE_KEY} scatters, but nothing is asked for at a pressure; leave it out, or ask at = "
            "{ pressure_kPa = 31 }, for instance."
        )
    least = min(pressures) + scatter.deviation * scatter.deviations(np.array([-WIDEST]))[0]
    if not scatter.relative and least <= 0:
        value = least / DISPLAY["pressure"][1]
        raise ConfigError(f"{where}: {PRESSURE_KEY} scatters as far as {value:.4g} kPa; it must stay above zero.")


def _require_share(name: str, share: float | None, where: str) -> None:
    if share is not None and not 0 < share < 1:
        raise ConfigError(f"{where}: {name} is {share:g}; it must be between 0 and 1, both excluded.")


def _number(space: Space, table: UncertainNumber, where: str) -> tuple[Scatter, str]:
    key = table.name if isinstance(table.name, str) else table.name[0]
    if (table.deviation is None) == (table.relative is None):
        raise ConfigError(f"{where}: {key} must have one of deviation and relative.")
    relative = table.relative is not None
    given = float(table.relative if table.relative is not None else table.deviation or 0.0)
    if not given > 0:
        name = "relative" if relative else "deviation"
        raise ConfigError(f"{where}: {name} of {key} is {given:g}; it must be above zero.")
    if table.name == PRESSURE_KEY:
        name, unit, label = PRESSURE, DISPLAY["pressure"][1], DISPLAY["pressure"][0]
        checked, lows = None, [1.0]
    else:
        number = varied(space.scenes, table.name, where)
        name, unit, label = number.name, number.unit, DISPLAY[number.kind][0]
        checked, lows = number, _ends_of(space, number.name)
    try:
        scatter = Scatter(name, given if relative else given * unit, relative, table.distribution)
    except InputError as error:
        raise ConfigError(f"{where}: {str(error).replace(repr(name), key)}") from None
    ends = scatter.deviations(np.array([-WIDEST, WIDEST]))
    for low in lows:
        for end in ends:
            value = low * (1 + scatter.deviation * end) if relative else low + scatter.deviation * end
            if checked is not None:
                _require_allowed(checked, value / unit, scatter, where)
            elif relative and value <= 0:
                raise ConfigError(f"{where}: {key} scatters as far as {value - 1:+.0%}; it must stay above zero.")
    words = f"{given:.3g} relative" if relative else f"{given:g} {label}".strip()
    return scatter, f"{key} ({table.distribution}, {words})"


def _require_allowed(number: Any, value: float, scatter: Scatter, where: str) -> None:
    """A ConfigError where a scatter reaches values that the rule of its number does not allow."""
    try:
        number.checked(value, "value", where)
    except ConfigError as error:
        reach = "its ends" if scatter.distribution == "uniform" else f"{WIDEST:g} standard deviations"
        allowed = str(error).rpartition("; ")[2]
        raise ConfigError(f"{where}: {number.key} scatters as far as {value:.4g} within {reach}; {allowed}") from None


def _ends_of(space: Space, name: str) -> list[float]:
    """The least and the largest value that a design gives to a number, SI."""
    known = Parameters(space.scenes, [Parameter(name)])
    paths = set(name.split(" = "))
    for k, own in enumerate(space.names):
        of_variable = next((v.name for v in space.variables if v.name.split("=")[0].strip() == own), own)
        parts = {part.strip() for part in of_variable.split("=")}
        if paths & parts or any(a.endswith(f".{b}") or b.endswith(f".{a}") for a in paths for b in parts):
            return [float(np.asarray(space.low)[k]), float(np.asarray(space.high)[k])]
    return [float(v) for v in known.reference]


def _correlation(keys: list[str], table: UncertainTable, where: str) -> np.ndarray:
    matrix = np.eye(len(keys))
    for one in table.correlations:
        for key in one.between:
            if key not in keys:
                raise ConfigError(f"{where}: {key!r} is correlated but does not scatter; name it among the numbers.")
        if one.between[0] == one.between[1]:
            raise ConfigError(f"{where}: {one.between[0]!r} is correlated with itself; name two numbers.")
        if not -1 < one.value < 1:
            pair = " and ".join(one.between)
            raise ConfigError(
                f"{where}: the correlation of {pair} is {one.value:g}; it must be between -1 and 1, both excluded."
            )
        i, j = (keys.index(key) for key in one.between)
        matrix[i, j] = matrix[j, i] = one.value
    return matrix


def _draws(scenes: Scenes, path: Path, where: str) -> tuple[Draws, list[Drawn]]:
    """The draws of a posterior's file whose names are keys of the scenes, jointly and one by one."""
    found = read_draws(scenes, path, where)
    names, values = [one.number.name for one in found], [one.values for one in found]
    try:
        return Draws(tuple(names), np.stack(values, axis=1)), found
    except InputError as error:
        raise ConfigError(f"{where}: {error}") from None
