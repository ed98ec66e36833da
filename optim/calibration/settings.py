"""The section [calibrate] of a config: which numbers are sought, and the measured curves that they shall explain.

    [[calibrate.parameters]]                  [[calibrate.curves]]
    name = "shell.material.mu_kPa"            name = "free inflation"
    low = 50                                  file = "free.csv"       # beside the config; a list: several specimens
    high = 500                                pressure = { column = "p", unit = "bar" }
    scale = "log"                             measured = { quantity = "inflation", column = "h", unit = "mm" }

Bounds are in the unit of the name. `scene` names the scene of a curve where there are several ([scenes.NAME]);
`noise` in `measured` states a standard deviation, in the column's unit, and without it the noise is estimated;
`fit = false` predicts a curve from the others. A tension test has `strain` in place of `pressure`, and the quantity
"stress": its material is that of the scene.

    [calibrate.posterior]           [calibrate.priors]
    chains = 4                      "shell.material.mu_kPa" = { median = 175, spread = 0.2 }     # lognormal
    draws = 1000                    "shell.t_m_mm" = { mean = 1.1, deviation = 0.05 }            # normal
    discrepancy = 0.1               "contact.distance_mm" = { distribution = "uniform" }         # between the bounds

`posterior = true` samples with the defaults. A parameter without a prior of its own has a weak one around its value as
given, or around the bound next to that.
"""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic

from softgrip_jax import config as configs
from softgrip_jax.config.keys import Seed, Table, Varied, varied
from softgrip_jax.errors import ConfigError, InputError, located

from ..posterior.priors import BETWEEN, DISCREPANCY, Prior, Sampling, require_proper, weak
from ..space import Space, Variable
from ..tension.test import Tension, material_of
from .data import UNITS, Column, Curve, check_pressures, falls_again, heading_of, read_columns
from .fit import STARTS
from .intervals import METHODS, REPEATS
from .model import LOSSES, Fitting

TEST = "tension test"
"""What the model of a tension test is called, with the name of its scene: no attribute has such a name."""


class ColumnTable(Table):
    column: str
    unit: str


class MeasuredTable(ColumnTable):
    quantity: str
    noise: float | None = pydantic.Field(default=None, gt=0)


class CurveTable(Table):
    name: str
    file: str | list[str]
    scene: str | None = None
    pressure: ColumnTable | None = None
    strain: ColumnTable | None = None
    measured: MeasuredTable
    fit: bool = True


class ParameterTable(Table):
    name: str | list[str]
    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"


class PriorTable(Table):
    distribution: str | None = None
    median: float | None = None
    spread: float | None = None
    mean: float | None = None
    deviation: float | None = None


class PosteriorTable(Table):
    chains: int = pydantic.Field(default=4, ge=2, le=64)
    draws: int = pydantic.Field(default=1000, ge=100, le=100_000)
    warmup: int = pydantic.Field(default=500, ge=100, le=100_000)
    discrepancy: float = pydantic.Field(default=DISCREPANCY, ge=0, le=1)
    between: float = pydantic.Field(default=BETWEEN, ge=0, le=1)
    seed: Seed = 0


def _posterior(given: Any) -> Any:
    """posterior = true is a table of defaults; a union of the two would name the wrong mistake."""
    return {True: {}, False: None}[given] if isinstance(given, bool) else given


class CalibrateTable(Table):
    parameters: list[ParameterTable] = pydantic.Field(min_length=1)
    curves: list[CurveTable] = pydantic.Field(min_length=1)
    loss: Literal[tuple(LOSSES)] = "linear"  # type: ignore[valid-type]
    intervals: list[Literal[METHODS]] = ["gauss_newton"]  # type: ignore[valid-type]
    repeats: int = pydantic.Field(default=REPEATS, ge=100, le=100_000)
    starts: int = pydantic.Field(default=STARTS, ge=1, le=1024)
    seed: Seed = 0
    posterior: Annotated[PosteriorTable | None, pydantic.BeforeValidator(_posterior)] = None
    priors: dict[str, PriorTable] = {}


@dataclasses.dataclass(frozen=True)
class Settings:
    """[calibrate] as read."""

    fitting: Fitting
    table: CalibrateTable
    numbers: tuple[Varied, ...] = ()
    """Of the parameters, as the config names them; an array has one entry, as it has one parameter table."""
    priors: tuple[Prior, ...] = ()
    """One for each entry of the parameters' vector."""

    def sampling(self, wanted: bool = False) -> Sampling | None:
        """How a posterior is sampled; None where none is wanted."""
        table = self.table.posterior
        if table is not None:
            return Sampling(**table.model_dump())
        return Sampling() if wanted else None


def read(config: configs.Config) -> Settings:
    """The section [calibrate] with its data; raises ConfigError for anything that is wrong in it."""
    where = f"{config.path}, [calibrate]"
    if "calibrate" not in config.tables:
        raise ConfigError(f"{config.path}: there is no section [calibrate] (or [tension]), which says what to fit.")
    table: CalibrateTable = configs.validated(CalibrateTable, config.tables["calibrate"], where)
    models: dict[str, Any] = dict(config.scenes)
    curves = [_curve(models, curve, config, where) for curve in table.curves]
    names = [curve.name for curve in curves]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{where}: two curves are called {name!r}; give each a name of its own.")
    variables = [_variable(config, models, parameter, where) for parameter in table.parameters]
    with located(where):
        fitting = Fitting(models, variables, curves, table.loss)
    numbers = tuple(varied(config.scenes, parameter.name, where) for parameter in table.parameters)
    return Settings(fitting, table, numbers, _priors(table, fitting.space, numbers, where))


def _priors(table: CalibrateTable, space: Space, numbers: tuple[Varied, ...], where: str) -> tuple[Prior, ...]:
    """The prior of every entry: as given, or weak."""
    of_entry = [k for k, size in enumerate(space.sizes) for _ in range(size)]
    found = [weak(space, j) for j in range(space.size)]
    place = where.replace("[calibrate]", "[calibrate.priors]")
    keys = [number.key for number in numbers]
    for key, given in table.priors.items():
        if key not in keys:
            raise ConfigError(f"{place}: {key!r} is not among the parameters; it must be one of {', '.join(keys)}.")
        k = keys.index(key)
        prior = _prior(key, given, numbers[k].unit, place)
        for j in np.flatnonzero(np.array(of_entry) == k):
            try:
                require_proper(key, prior, float(space.low[j]), float(space.high[j]), numbers[k].unit)
            except InputError as error:
                raise ConfigError(f"{place}: {error}") from None
            found[j] = prior
    return tuple(found)


def _prior(key: str, table: PriorTable, unit: float, place: str) -> Prior:
    given = {name for name, value in table.model_dump().items() if value is not None} - {"distribution"}
    for distribution, names in NUMBERS.items():
        if table.distribution in (None, distribution) and given == set(names):
            centre, spread = (getattr(table, name) for name in names) if names else (0.0, 0.0)
            if distribution == UNIFORM and table.distribution is None:
                break  # nothing is said at all
            return Prior(distribution, centre * unit, spread * (1 if distribution == LOGNORMAL else unit))
    if table.distribution not in (None, *NUMBERS):
        raise ConfigError(
            f"{place}: the distribution of {key} is {table.distribution!r}, which is no proper prior here; it must be "
            f"one of {', '.join(NUMBERS)}."
        )
    raise ConfigError(
        f"{place}: {key} must have median and spread (lognormal), mean and deviation (normal), or distribution = "
        f"'uniform' alone; it has {', '.join(sorted(given)) or 'nothing'}."
    )


UNIFORM, LOGNORMAL = "uniform", "lognormal"
NUMBERS: dict[str, tuple[str, ...]] = {LOGNORMAL: ("median", "spread"), "normal": ("mean", "deviation"), UNIFORM: ()}
"""What each distribution of a prior is given by."""


def _curve(models: dict[str, Any], table: CurveTable, config: configs.Config, where: str) -> Curve:
    place = f"{where}: curve {table.name!r}"
    if (table.pressure is None) == (table.strain is None):
        raise ConfigError(f"{place} must have either pressure (of a scene) or strain (of a tension test).")
    is_test = table.strain is not None
    model, (quantity, kind, component) = measured_of(
        config.scenes, models, table.scene, table.measured.quantity, is_test, place
    )
    x_table = table.pressure or table.strain
    assert x_table is not None
    x = column(x_table, "number" if table.strain else "pressure", place)
    y = column(table.measured, kind, place)
    noise = None if table.measured.noise is None else table.measured.noise * y.factor
    with located(f"{config.path}, [calibrate]"):
        found = read_specimens(config.path.parent, table.file, table.name, x, y)
    return Curve(table.name, model, quantity, kind, component=component, noise=noise, fit=table.fit, **found)


def measured_of(
    scenes: dict[str, Any], models: dict[str, Any], scene: str | None, wanted: str, is_test: bool, place: str
) -> tuple[str, tuple[str, str, int | None]]:
    """(model, (observable, kind, component)) of what is measured of a scene, or of a tension test of its material,
    which is added to the models."""
    name = scene or next(iter(scenes))
    if name not in scenes or (scene is None and len(scenes) > 1):
        given = "names no scene" if scene is None else f"names the scene {scene!r}"
        raise ConfigError(f"{place} {given}; it must be one of {', '.join(scenes)}.")
    if is_test:
        material = material_of(scenes[name])
        if material is None:
            raise ConfigError(f"{place}: the scene {name} has no material that a tension test could be of.")
        kinds: dict[str, tuple[str, str, int | None]] = {"stress": ("stress", "pressure", None)}
        model = f"{TEST} {name}"
        models[model] = Tension(material)
    else:
        kinds, model = _quantities(scenes[name]), name
    if wanted not in kinds:
        raise ConfigError(f"{place} measures {wanted!r}; it must be one of {', '.join(kinds)}.")
    return model, kinds[wanted]


def _quantities(scene: Any) -> dict[str, tuple[str, str, int | None]]:
    """What can be measured of a scene: name in the config -> (observable, kind, component)."""
    found: dict[str, tuple[str, str, int | None]] = {}
    for name, kind in scene.prepared().OBSERVABLES.items():
        if kind == "position":
            found |= {f"{name}.x": (name, "length", 0), f"{name}.y": (name, "length", 1)}
        else:
            found[name] = (name, kind, None)
    return found


def column(table: ColumnTable, kind: str, place: str) -> Column:
    """The column that a table names; a ConfigError for a unit that its kind of quantity cannot have."""
    if kind not in UNITS:
        raise ConfigError(
            f"{place}: column {table.column!r} is of the kind {kind!r}; a column must be of one of {', '.join(UNITS)}."
        )
    if table.unit not in UNITS[kind]:
        allowed = ", ".join(UNITS[kind])
        raise ConfigError(
            f"{place}: the unit of column {table.column!r} is {table.unit!r}; it must be one of {allowed}."
        )
    return Column(table.column, kind, table.unit)


def read_specimens(folder: Path, file: str | list[str], name: str, x: Column, y: Column) -> dict[str, Any]:
    """x, y, specimen, specimens and notes of a Curve from one file, or from one per specimen."""
    files = [file] if isinstance(file, str) else file
    if not files:
        raise InputError(f"The list of files of curve {name!r} is empty; it must name one or more.")
    if len({(folder / one).resolve() for one in files}) < len(files):
        raise InputError(f"Curve {name!r} names a file twice; a specimen counts once.")
    if x.name == y.name:
        raise InputError(f"Curve {name!r} takes the column {x.name!r} twice, for what is set and for what is measured.")
    parts, notes = [], unlike_headings(name, [x, y])
    for one in files:
        data, said = read_columns(folder / one, [x, y])
        if x.kind == "pressure":
            said += check_pressures(name, data[:, 0], folder / one)
        elif np.any(data[:, 0] <= -1):
            raise ConfigError(
                f"{folder / one}: a strain of curve {name!r} is {data[:, 0].min():.4g}; it must be above -1."
            )
        else:
            said += falls_again("strain", data[:, 0], folder / one)
        parts.append(data)
        notes += said
    whole = np.concatenate(parts)
    found: dict[str, Any] = {"x": whole[:, 0], "y": whole[:, 1], "notes": tuple(notes)}
    if len(files) > 1:
        found["specimen"] = np.repeat(np.arange(len(files)), [len(part) for part in parts])
        found["specimens"] = _names(files)
    return found


def unlike_headings(name: str, columns: list[Column]) -> list[str]:
    """A sentence for each column of a curve whose name says another unit than the config does, or of a tension test
    another measure of strain or stress. A name that ends with 1 says no unit."""
    said = []
    for column in columns:
        found = heading_of(column.name, column.kind)
        unit = found.unit or found.unknown
        if unit not in ("", "1", column.unit):
            said.append(
                f"{name}: the name of the column {column.name!r} says {unit}, and the config takes its numbers as "
                f"{column.unit}; is that unit right?"
            )
    if columns[0].kind == "number":  # a tension test
        for column, taken in zip(columns, ("strain", "stress"), strict=True):
            other = OTHER_MEASURES[taken] & set(re.split(r"[\W_]+", column.name.casefold()))
            if other:
                said.append(
                    f"{name}: the column {column.name!r} is taken as engineering {taken}, and its name says "
                    f"{min(other)}; is it that?"
                )
    return said


OTHER_MEASURES = {
    "strain": {"stretch", "lambda", "λ", "true", "log", "logarithmic", "hencky"},
    "stress": {"true", "cauchy"},
}
"""Words in the name of a column that is neither change of length over length nor force over undeformed section."""


def _names(files: list[str]) -> tuple[str, ...]:
    """What the specimens of a curve are called: the stem of the file, with as many of its folders, and at last its
    suffix, as tell it from the other files of that stem."""
    paths = [Path(one) for one in files]
    return tuple(_name(path, {other for other in paths if other.stem == path.stem}) for path in paths)


def _name(path: Path, alike: set[Path]) -> str:
    for count in range(1, max(len(one.parts) for one in alike) + 1):
        names = {one: Path(*one.with_suffix("").parts[-count:]).as_posix() for one in alike}
        if len(set(names.values())) == len(alike):
            return names[path]
    return path.as_posix()


def _variable(config: configs.Config, models: dict[str, Any], table: ParameterTable, where: str) -> Variable:
    number = varied(config.scenes, table.name, where)
    low, high = number.bounds(table.low, table.high, table.scale, where)
    with located(where):
        return Variable(model_name(config.scenes, models, table.name, number), low, high, table.scale)


def model_name(scenes: dict[str, Any], models: dict[str, Any], keys: str | list[str], number: Varied) -> str:
    """The name of a number among the models: that of its scenes, and of the tension tests that go with them."""
    name = number.name
    if len(scenes) > 1 and isinstance(keys, str) and keys.split(".")[0] not in scenes:
        # A number without a scene is that of every scene that has it: its name needs none.
        name = name.split(" = ")[0].partition(".")[2]
    # A tension test is of the material of its scene: it moves with it.
    tied = []
    for path in number.name.split(" = "):
        parts = path.split(".")
        scene = parts[0] if parts[0] in scenes else next(iter(scenes))
        test = f"{TEST} {scene}"
        if test in models and "material" in parts:
            tied.append(".".join([test, *parts[parts.index("material") :]]))
    return " = ".join([name, *tied])
