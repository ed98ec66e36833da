"""The section [plan] of a config: what is known of some numbers, and what could be measured.

    [plan]                                     [[plan.measurements]]
    points = 5                                 name = "free inflation"
                                               scene = "free"
    [[plan.parameters]]                        quantity = "inflation"
    name = "shell.material.mu_kPa"             pressures_kPa = [2, 4, 6, 8, 10, 12]
    spread = 0.15                              noise = 0.1
                                               unit = "mm"

`spread` is a relative standard deviation (the logarithm of the number is normal); `posterior` takes what is known from
a file of `softgrip calibrate --posterior` instead. A measurement is a quantity of a scene at each of the pressures, the
stress of its material at each of `strains`, or a number itself (`number = "shell.t_m_mm"`, for a calliper).

`[plan.decision]` says what is decided: whether a `quantity` keeps `low` and `high`, or, with `yield = 0.95`, whether so
many parts keep the `requirements` when the `numbers` scatter from part to part, both as `[design.uncertain]` has them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydantic

from softgrip_jax import config as configs
from softgrip_jax.config.keys import Seed, Table, Varied, quantity, varied
from softgrip_jax.errors import ConfigError, located
from softgrip_jax.quantities import Quantity, kind_of

from ..calibration.data import UNITS, Curve
from ..calibration.model import Fitting
from ..calibration.settings import measured_of, model_name
from ..design.settings import limits_of
from ..problem import Limits
from ..robust.evaluate import SAMPLES
from ..robust.settings import CorrelationTable, RequirementTable, Uncertain, UncertainNumber, UncertainTable
from ..robust.settings import read as read_uncertain
from ..space import Space, Variable
from .information import CRITERIA

REACH = 5.0
"""Standard deviations either way that a number is taken to lie within."""


class ParameterTable(Table):
    name: str | list[str]
    spread: float | None = pydantic.Field(default=None, gt=0, le=1)


class MeasurementTable(Table):
    name: str
    scene: str | None = None
    quantity: str | None = None
    number: str | None = None
    pressures_kPa: list[float] | None = pydantic.Field(default=None, min_length=1)
    strains: list[float] | None = pydantic.Field(default=None, min_length=1)
    noise: float = pydantic.Field(gt=0)
    unit: str
    cost: float = pydantic.Field(default=1.0, gt=0)
    repeats: int = pydantic.Field(default=1, ge=1)


class DecisionTable(Table):
    quantity: str | None = None
    at: Any = None
    low: float | None = None
    high: float | None = None
    yield_: float | None = pydantic.Field(default=None, alias="yield")
    numbers: list[UncertainNumber] = []
    correlations: list[CorrelationTable] = []
    requirements: list[RequirementTable] = []
    samples: int = pydantic.Field(default=SAMPLES, ge=64, le=65536)


class PlanTable(Table):
    parameters: list[ParameterTable] = pydantic.Field(min_length=1)
    measurements: list[MeasurementTable] = pydantic.Field(min_length=1)
    points: int = pydantic.Field(default=5, ge=1, le=1000)
    budget: float | None = pydantic.Field(default=None, gt=0)
    criterion: Literal[CRITERIA] | None = None  # type: ignore[valid-type]
    decision: DecisionTable | None = None
    posterior: str | None = None
    draws: int = pydantic.Field(default=32, ge=1, le=4096)
    seed: Seed = 0


@dataclasses.dataclass(frozen=True)
class Measurement:
    """One kind of measurement."""

    table: MeasurementTable
    curve: Curve | None
    """What is asked of the models, at every candidate; None for a number itself."""
    index: int = -1
    """Of the number that is measured itself."""


@dataclasses.dataclass(frozen=True)
class Decision:
    """What decides: a quantity, in SI, or the scaled violation that a share of all parts stays below."""

    key: str
    """Of the quantity, or "the yield"."""
    low: float
    high: float
    quantity: Quantity | None = None
    uncertain: Uncertain | None = None
    """What scatters from part to part."""
    limits: tuple[Limits, ...] = ()
    """What a part must keep."""
    kind: str = ""
    """Of the quantity, a key of units.DISPLAY; empty for the yield."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """[plan] as read."""

    table: PlanTable
    fitting: Fitting
    numbers: list[Varied]
    spreads: np.ndarray | None
    """Relative standard deviations; None where a posterior says them."""
    measurements: list[Measurement]
    decision: Decision | None
    criterion: str
    folder: Path
    where: str
    scenes: dict[str, Any]
    space: Space
    """The numbers in the scenes, without the tension tests beside them."""

    def factor(self, measurement: Measurement) -> float:
        """The unit of a measurement and of its noise, in SI."""
        curve = measurement.curve
        kind = self.numbers[measurement.index].kind if curve is None else curve.kind
        return _factor(measurement.table, kind, self.where)


def read(config: configs.Config) -> Settings:
    """The section [plan]; ConfigError for anything that is wrong in it."""
    where = f"{config.path}, [plan]"
    if "plan" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [plan], which says what could be measured.")
    table: PlanTable = configs.validated(PlanTable, config.tables["plan"], where)
    names = [m.name for m in table.measurements]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{where}: two measurements are called {name!r}; give each a name of its own.")
    numbers = [varied(config.scenes, parameter.name, where) for parameter in table.parameters]
    for parameter, number in zip(table.parameters, numbers, strict=True):
        if parameter.spread is None and table.posterior is None:
            raise ConfigError(
                f"{where}: {number.key} has no spread and there is no posterior; say what is known of it, for instance "
                "spread = 0.1."
            )
        if parameter.spread is not None and table.posterior is not None:
            raise ConfigError(f"{where}: {number.key} has a spread beside the posterior; leave one of them out.")
    models: dict[str, Any] = dict(config.scenes)
    measurements = [_measurement(config, models, one, numbers, where) for one in table.measurements]
    curves = [one.curve for one in measurements if one.curve is not None]
    if not curves:
        raise ConfigError(f"{where}: every measurement is of a number itself; there is nothing to plan.")
    with located(where):
        fitting = Fitting(models, _variables(config, models, table, numbers, where), curves)
        space = Space(
            config.scenes,
            [
                Variable(number.name, one.low, one.high, one.scale)
                for number, one in zip(numbers, fitting.space.variables, strict=True)
            ],
        )
    criterion = table.criterion or ("decision" if table.decision else "D")
    if criterion == "decision" and table.decision is None:
        raise ConfigError(f'{where}: criterion is "decision", and there is no [plan.decision] that says which.')
    decision = None
    if table.decision is not None:
        place = f"{where}, decision"
        is_yield = table.decision.yield_ is not None
        decision = (_yield if is_yield else _quantity)(config, table.decision, space, place)
    spreads = None if table.posterior else np.array([parameter.spread for parameter in table.parameters], float)
    return Settings(
        table,
        fitting,
        numbers,
        spreads,
        measurements,
        decision,
        criterion,
        config.path.parent,
        where,
        dict(config.scenes),
        space,
    )


def _variables(
    config: configs.Config, models: dict[str, Any], table: PlanTable, numbers: list[Varied], where: str
) -> list[Variable]:
    """The numbers, between bounds that lie far from what is known of them."""
    pairs = zip(table.parameters, numbers, strict=True)
    names = [model_name(config.scenes, models, parameter.name, number) for parameter, number in pairs]
    found = []
    for parameter, number, name in zip(table.parameters, numbers, names, strict=True):
        value = number.positive(models, name, where, ", since its spread is relative")
        reach = float(np.exp(REACH * (parameter.spread or 1.0)))
        found.append(Variable(name, value / reach, value * reach, "log"))
    return found


def _measurement(
    config: configs.Config, models: dict[str, Any], table: MeasurementTable, numbers: list[Varied], where: str
) -> Measurement:
    place = f"{where}: measurement {table.name!r}"
    given = [name for name in ("pressures_kPa", "strains", "number") if getattr(table, name) is not None]
    if len(given) != 1:
        raise ConfigError(
            f"{place} must have one of pressures_kPa, strains and number; it has {' and '.join(given) or 'none'}."
        )
    if table.number is not None:
        keys = [number.key for number in numbers]
        if table.number not in keys:
            raise ConfigError(
                f"{place} measures {table.number!r}; it must be one of the parameters: {', '.join(keys)}."
            )
        index = keys.index(table.number)
        _factor(table, numbers[index].kind, place)
        return Measurement(table, None, index)
    if table.quantity is None:
        raise ConfigError(f"{place} says no quantity.")
    is_test = table.strains is not None
    model, (observable, kind, component) = measured_of(
        config.scenes, models, table.scene, table.quantity, is_test, place
    )
    x = np.array(table.strains if is_test else [1e3 * p for p in table.pressures_kPa or []], float)
    typed = table.strains if is_test else table.pressures_kPa or []
    if np.any(x <= 0) or not np.all(np.isfinite(x)):
        unit = "" if is_test else " kPa"
        raise ConfigError(f"{place}: every pressure and strain must be above zero; the least is {min(typed):g}{unit}.")
    if len(np.unique(x)) < len(x):
        raise ConfigError(f"{place} names a pressure or strain twice; say repeats = 2 to measure each twice.")
    noise = table.noise * _factor(table, kind, place)
    return Measurement(table, Curve(table.name, model, observable, kind, np.sort(x), np.ones(len(x)), component, noise))


def _factor(table: MeasurementTable, kind: str, place: str) -> float:
    """The unit of the noise in SI."""
    units = _units(kind, place)
    if table.unit not in units:
        raise ConfigError(f"{place}: its unit is {table.unit!r}; it must be one of {', '.join(units)}.")
    return units[table.unit]


def _units(kind: str, place: str) -> dict[str, float]:
    """The units of a kind in SI."""
    kind = "length" if kind == "position" else kind  # a component of a position
    if kind not in UNITS:
        raise ConfigError(f"{place} is of the kind {kind!r}, which has no unit; it must be one of {', '.join(UNITS)}.")
    return UNITS[kind]


def _quantity(config: configs.Config, table: DecisionTable, space: Space, where: str) -> Decision:
    if table.quantity is None:
        raise ConfigError(f"{where}: there is neither quantity nor yield; say what is decided on.")
    for name in ("numbers", "correlations", "requirements"):
        if getattr(table, name):
            raise ConfigError(f"{where}: {name} belong to a yield; give yield = 0.95, for instance, or leave them out.")
    found, unit = quantity(config.scenes, table.quantity, table.at, where)
    if table.low is None and table.high is None:
        raise ConfigError(
            f"{where}: {table.quantity} has neither low nor high; what is decided is whether it keeps them."
        )
    low = -np.inf if table.low is None else table.low * unit
    high = np.inf if table.high is None else table.high * unit
    if not low < high:
        raise ConfigError(f"{where}: low is {table.low:g} and high {table.high:g}; low must be below high.")
    return Decision(table.quantity, low, high, found, kind=kind_of(found, config.scenes))


def _yield(config: configs.Config, table: DecisionTable, space: Space, where: str) -> Decision:
    for name in ("quantity", "at", "low", "high"):
        if getattr(table, name) is not None:
            raise ConfigError(f"{where}: there are yield and {name}; what a part must keep are its requirements.")
    for name in ("numbers", "requirements"):
        if not getattr(table, name):
            raise ConfigError(f"{where}: a yield has {name}; see [design.uncertain].")
    limits = [limits_of(config.scenes, one, where) for one in table.requirements]
    own = {"yield": table.yield_} | {
        name: getattr(table, name) for name in ("numbers", "correlations", "requirements", "samples")
    }
    uncertain = read_uncertain(UncertainTable.model_validate(own), space, None, limits, where)
    return Decision("the yield", -np.inf, 0.0, None, uncertain, tuple(limits))
