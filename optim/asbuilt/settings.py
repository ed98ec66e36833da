"""The file of `softgrip measure`: what was measured of the parts that were cast from a design.

    [[numbers]]                        [[masses]]
    name = "shell.t_m_mm"              part = "membrane"
    values = [1.17, 1.21, 1.18]        value_g = 6.3
    uncertainty = 0.02                 uncertainty_g = 0.05
    tolerance = 0.08

`values` are readings in the unit of the name, `uncertainty` the standard deviation of one; `tolerance` is how far,
relative to the drawing (one standard deviation), the workshop may be off. A number without values is known
by its tolerance and by the masses alone. `[calibrate]`, as in a config, has the parameters and the curves of a first
inflation.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pydantic

from softgrip_jax import config as configs
from softgrip_jax.cad import ManufactureTable, actuator_of
from softgrip_jax.config.keys import Table, Varied, varied
from softgrip_jax.errors import ConfigError, located

from ..calibration import settings as calibrate_settings
from ..calibration.settings import CalibrateTable
from ..space import Space, Variable

TOLERANCE = 0.05
"""Of a casting, relative, one standard deviation, where nothing is said: printed moulds and shrinkage do that."""
REACH = 0.5
"""A number lies between this part of what was drawn and its inverse."""


class NumberTable(Table):
    name: str | list[str]
    values: list[float] = pydantic.Field(default=[])
    uncertainty: float | None = pydantic.Field(default=None, gt=0)
    tolerance: float = pydantic.Field(default=TOLERANCE, gt=0, le=0.3)


class MassTable(Table):
    part: str
    value_g: float = pydantic.Field(gt=0)
    uncertainty_g: float = pydantic.Field(gt=0)


class MeasuredTable(Table):
    numbers: list[NumberTable] = pydantic.Field(min_length=1)
    masses: list[MassTable] = []
    density_spread: float = pydantic.Field(default=0.01, ge=0, le=0.2)
    scene: str | None = None
    calibrate: CalibrateTable | None = None


@dataclasses.dataclass(frozen=True)
class Settings:
    """A config and what was measured of its parts."""

    config: configs.Config
    path: Path
    table: MeasuredTable
    numbers: list[Varied]
    space: Space
    """The numbers in the scenes."""
    manufacture: ManufactureTable
    scene: Any
    """Whose actuator was cast."""
    calibration: calibrate_settings.Settings | None


def read(config: configs.Config, path: Path) -> Settings:
    """The file of what was measured; ConfigError for anything that is wrong in it."""
    where = str(path)
    table: MeasuredTable = configs.validated(MeasuredTable, configs.read_toml(path), where)
    scenes = config.scenes
    numbers = [varied(scenes, one.name, where) for one in table.numbers]
    names = [number.name for number in numbers]
    for one, number in zip(table.numbers, numbers, strict=True):
        if names.count(number.name) > 1:
            raise ConfigError(f"{where}: {number.key} is given twice; put all its readings into one list of values.")
        if one.values and one.uncertainty is None:
            raise ConfigError(f"{where}: {number.key} has values, but no uncertainty (of one reading).")
        for value in one.values:
            number.checked(value, "a value", where)
    variables = []
    for number in numbers:
        drawn = number.positive(scenes, number.name, where)
        variables.append(Variable(number.name, drawn * REACH, drawn / REACH))
    with located(where):
        space = Space(scenes, variables)
    name = table.scene or next(iter(scenes))
    if name not in scenes:
        raise ConfigError(f"{where}: scene is {name!r}; it must be one of {', '.join(scenes)}.")
    if table.masses and actuator_of(scenes[name]) is None:
        raise ConfigError(f"{where}: the scene {name} has neither a shell nor a finger that could be weighed.")
    manufacture = configs.validated(
        ManufactureTable, config.tables.get("manufacture", {}), f"{config.path}, [manufacture]"
    )
    calibration = None
    if table.calibrate is not None:
        own = dataclasses.replace(
            config, path=path, tables={"calibrate": table.calibrate.model_dump(exclude_none=True, exclude_unset=True)}
        )
        calibration = calibrate_settings.read(own)
        varies = {name for variable in calibration.fitting.space.variables for name in variable.name.split(" = ")}
        both = [number.key for number in numbers if set(number.name.split(" = ")) & varies]
        if both:
            raise ConfigError(f"{where}: {' and '.join(both)} is measured and calibrated; it must be one of them.")
    return Settings(config, path, table, numbers, space, manufacture, scenes[name], calibration)
