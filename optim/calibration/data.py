"""Measured curves from CSV files: named columns with stated units become arrays in SI.

The header is the first line that has every named column, so a preamble does no harm; commas, semicolons or tabs part
the columns; lines that begin with # are comments. Rows with a missing value, and rows that stand there twice, are left
out and counted. Whatever else cannot be meant is a ConfigError in one sentence with the line.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softgrip_jax.config import ConfigError
from softgrip_jax.config.csv_text import MARKS, cells_of, uncommented
from softgrip_jax.errors import InputError
from softgrip_jax.results import in_units
from softgrip_jax.units import DISPLAY, degree, number_of

UNITS: dict[str, dict[str, float]] = {
    "length": {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "um": 1e-6},
    "area": {"mm^2": 1e-6, "cm^2": 1e-4, "m^2": 1.0},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "pressure": {"kPa": 1e3, "Pa": 1.0, "MPa": 1e6, "bar": 1e5, "mbar": 100.0, "psi": 6894.757293168},
    "moment": {"N mm": 1e-3, "N m": 1.0},
    "angle": {"deg": degree, "rad": 1.0},
    "number": {"1": 1.0, "%": 1e-2},
    "mass": {"g": 1e-3, "kg": 1.0},
    "curvature": {"1/m": 1.0},
    "force_per_length": {"N/m": 1.0},
}
"""Kind of quantity -> the units that a column may be in, and their value in SI."""

SAME = {"°": "deg", "degree": "deg", "degrees": "deg", "µm": "um", "μm": "um", "psig": "psi", "barg": "bar", "-": "1"}
"""Other ways to write some of these units; pressures are those above the air's."""

CASED = ("mpa", "mn", "mnm", "mnmm", "mn/m")
"""Units that m or M alone tells apart (millipascal and megapascal): their first letter must stand as in the unit."""

OTHERS = (
    *(
        "hPa",
        "GPa",
        "mPa",
        "atm",
        "torr",
        "mmHg",
        "inHg",
        "cmHg",
        "inH2O",
        "cmH2O",
        "mmH2O",
        "psf",
        "ksi",
        "psia",
        "bara",
    ),
    *("lbf", "lbs", "lb", "ozf", "oz", "kgf", "gf", "kp", "dyn", "MN", "inch", "inches", "ft", "mil", "nm", "km", "dm"),
    *("Nm", "Nmm", "lbfin", "ftlb", "grad", "gon", "mrad", "mg", "mm2", "cm2", "m2"),
)
"""Units that a heading may end with without brackets, and that no column may be in."""

MISSING = ("", "-", "na", "n/a", "nan", "null")
"""What stands for no value, in any case of letters."""

FALL = 0.05
"""A pressure that falls by more than this part of its range goes down; less is the noise of its sensor."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a file: its name, the kind of quantity, and its unit."""

    name: str
    kind: str
    unit: str

    @property
    def factor(self) -> float:
        """The unit in SI."""
        return UNITS[self.kind][self.unit]


@dataclasses.dataclass(frozen=True)
class Curve:
    """Measured points of one quantity of one model.

    Args:
        name: of the curve.
        model: which of the models it belongs to.
        quantity: an observable of a scene; "stress" of a tension test.
        kind: of the quantity, a key of `units.DISPLAY`.
        x: pressure, Pa, or engineering strain of a tension test, dimensionless, shape (n,).
        y: the measured quantity, in SI, shape (n,).
        component: of a position: 0 for x, 1 for y.
        noise: standard deviation of y, in SI; None where it shall be estimated from the residuals.
        fit: False where it is predicted and compared, but not fitted.
        specimen: a number for each point, shape (n,), where there are several specimens or repeats; None for one.
        specimens: their names.
        notes: what was left out or looks odd, in sentences.

    Raises:
        InputError: where noise is not positive, x and y are not as many finite numbers each, or an x can not be set:
            a pressure below zero, a strain of -1 or less.

    Examples:
        >>> strain = np.linspace(0.1, 1.0, 10)
        >>> stress = 100 * kPa * (1 + strain - (1 + strain) ** -2)
        >>> curve = optim.Curve("test", "strip", "stress", "pressure", strain, stress)
        >>> print(f"{curve.size / kPa:.0f} kPa")
        175 kPa
    """

    name: str
    model: str
    quantity: str
    kind: str
    x: np.ndarray
    y: np.ndarray
    component: int | None = None
    noise: float | None = None
    fit: bool = True
    specimen: np.ndarray | None = None
    specimens: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.noise is not None and not (np.isfinite(self.noise) and self.noise > 0):
            raise InputError(f"The noise of curve {self.name!r} is {self.noise:g}; it must be a positive number.")
        for name in ("x", "y"):
            object.__setattr__(self, name, self._numbers(name))
        counts = {name: len(getattr(self, name)) for name in ("x", "y", "specimen") if getattr(self, name) is not None}
        if len(set(counts.values())) > 1:
            said = ", ".join(f"{name} has {count}" for name, count in counts.items())
            raise InputError(f"The points of curve {self.name!r} do not match: {said}; there must be one of each.")
        is_test = self.quantity == "stress"
        least = int(np.argmin(self.x))
        if self.x[least] <= -1 if is_test else self.x[least] < 0:
            must = "a strain must be above -1" if is_test else "a gauge pressure must be zero or more"
            raise InputError(f"x[{least}] of curve {self.name!r} is {self.x[least]:g}; {must}.")

    def _numbers(self, name: str) -> np.ndarray:
        """x or y, checked."""
        values = np.asarray(getattr(self, name), dtype=float)
        if values.ndim != 1 or not values.size:
            raise InputError(
                f"{name} of curve {self.name!r} has the shape {values.shape}; it must be a list of numbers, one for "
                "each point."
            )
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            raise InputError(
                f"{name}[{wrong[0]}] of curve {self.name!r} is {values[wrong[0]]}; it must be a finite number: leave "
                "out points without one."
            )
        return values

    @property
    def labels(self) -> np.ndarray:
        """The name of the specimen of every point; '' where there is none."""
        if self.specimen is None:
            return np.full(len(self.x), "")
        return np.array([self.specimens[int(k)] for k in self.specimen])

    @property
    def label(self) -> str:
        """'tip y', 'force'."""
        part = "" if self.component is None else f" {'xy'[self.component]}"
        return self.quantity.replace("_", " ") + part

    @property
    def unit(self) -> tuple[str, float]:
        """(label, value in SI) of the unit that the curve is shown in."""
        return DISPLAY[self.kind]

    def share(self, error: float, of: str = "") -> str:
        """An error in per cent of the largest value, ' (0.3 %)'; nothing of a curve of zeros."""
        return f" ({error / self.size:.1%}{of})" if np.any(self.y) else ""

    @property
    def size(self) -> float:
        """The largest |y|: what a residual of this curve is compared with."""
        return float(np.max(np.abs(self.y))) or 1.0


def read_columns(path: Path, columns: Sequence[Column]) -> tuple[np.ndarray, list[str]]:
    """(the columns in SI, shape (rows, columns); what was left out) of one file."""
    return columns_of(_text(path), path, columns)


def columns_of(text: str, path: Path, columns: Sequence[Column]) -> tuple[np.ndarray, list[str]]:
    """(the columns in SI, shape (rows, columns); what was left out) of the text of a file; path is for messages."""
    header, lines = _table(text, path, [c.name for c in columns])
    rows: list[list[float]] = []
    for number, cells in lines:
        values = []
        if any(cell.strip() for cell in cells[len(header) :]):
            raise ConfigError(
                f"{path}, line {number}: there are {len(cells)} cells, and the header has {len(header)}; write "
                "decimals with a point, and one cell for each column."
            )
        for column in columns:
            place = header.index(column.name)
            text = cells[place].strip() if place < len(cells) else ""
            values.append(_number(text, column, path, number) * column.factor)
        rows.append(values)
    data = np.array(rows).reshape(-1, len(columns))
    whole = np.all(np.isfinite(data), axis=1)
    notes = []
    if not whole.all():
        notes.append(f"{path.name}: {_count(int(np.sum(~whole)), 'row')} with a missing value left out.")
    data = data[whole]
    _, first = np.unique(data, axis=0, return_index=True)
    if len(first) < len(data):
        notes.append(f"{path.name}: {_count(len(data) - len(first), 'row')} that stood there twice left out.")
    data = data[np.sort(first)]
    if not len(data):
        raise ConfigError(f"{path}: there is no row with a number in {' and '.join(repr(c.name) for c in columns)}.")
    return data, notes


def _text(path: Path) -> str:
    try:
        return decoded(path.read_bytes(), path)
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}.") from None


def decoded(content: bytes, path: Path) -> str:
    """What is in a file as text; a ConfigError where it is none. path is for messages."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: this is not a text file in UTF-8 (byte {error.start}).") from None


def _table(text: str, path: Path, names: Sequence[str]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """(names of the columns, numbered rows under them)."""
    lines = [(n, line) for n, line in enumerate(uncommented(text), 1) if line.strip()]
    if not lines:
        raise ConfigError(f"{path}: the file is empty.")
    unread = ""
    for k, (number, line) in enumerate(lines):
        for mark in MARKS:
            try:
                header = [cell.strip() for cell in cells_of(line, mark)]
            except InputError as error:
                # Of a preamble it does no harm.
                if all(name in line for name in names):
                    unread = unread or f"{path}, line {number}: {error}"
                continue
            if all(header.count(name) == 1 for name in names):
                return header, [(n, _cells(text, mark, path, n)) for n, text in lines[k + 1 :]]
            twice = next((name for name in names if header.count(name) > 1), None)
            if twice is not None and all(name in header for name in names):
                raise ConfigError(
                    f"{path}, line {lines[k][0]}: {header.count(twice)} columns are called {twice!r}; it must be one: "
                    "give the others another name."
                )
    if unread:
        raise ConfigError(unread)
    found = " ".join(lines[0][1].split())[:60]
    wanted = " and ".join(map(repr, names))
    raise ConfigError(f"{path}: there is no header line with the columns {wanted}; the first line is {found!r}.")


def _cells(line: str, mark: str, path: Path, number: int) -> list[str]:
    try:
        return cells_of(line, mark)
    except InputError as error:
        raise ConfigError(f"{path}, line {number}: {error}") from None


class Heading(NamedTuple):
    """What the name of a column says of its unit."""

    unit: str | None
    """One of `UNITS`; None where there is none that is known."""
    unknown: str = ""
    """The unit that stands there and is not known."""


def heading_of(name: str, kind: str) -> Heading:
    """The unit in the name of a column, "Pressure (PSI)" or "p_kPa", for its kind of quantity.

    Case does not matter where only one unit can be meant. What stands in brackets is a unit; without brackets the last
    words are one if they are a unit of any kind.
    """
    bracketed = [(first or second).strip() for first, second in BRACKETS.findall(name)]
    bare = BRACKETS.sub(" ", name)
    words = [word for word in re.split(r"[\s_,;:()\[\]-]+", bare) if word]
    endings = [" ".join(words[-count:]) for count in (3, 2, 1) if count < len(words)]
    endings += [bare.strip()] * (bare.strip() in UNITS.get(kind, {}))
    parts = [part for part in re.split(r"[\W_]+", bare) if part]
    endings += parts[-1:] if len(parts) > 1 else []
    for text in [*reversed(bracketed), *endings]:
        if (found := _unit_named(text, kind)) is not None:
            return Heading(found)
    if bracketed and bracketed[-1]:
        return Heading(None, bracketed[-1])
    others = {one.casefold() for one in OTHERS} | ({"in"} if kind == "length" else set())
    for text in endings:
        is_other = text not in ("1", "m") and any(_unit_named(text, other) for other in UNITS)
        if is_other or text.casefold() in others:
            return Heading(None, text)
    return Heading(None)


BRACKETS = re.compile(r"\(([^()]*)\)|\[([^\[\]]*)\]")


def _unit_named(text: str, kind: str) -> str | None:
    """The unit of this kind that a text is, however its letters and dots are set; None where it is none of them."""

    def plain(unit: str) -> str:
        return re.sub(r"[\s^*·.]", "", unit.replace("²", "2").replace(" per ", "/"))

    text = plain(SAME.get(text.strip().casefold(), text))
    known = {plain(unit): unit for unit in UNITS.get(kind, {})}
    alike = [unit for bare, unit in known.items() if bare.casefold() == text.casefold()]
    if text in known or not alike:
        return known.get(text)
    return None if len(alike) > 1 or (text.casefold() in CASED and text[0] != alike[0][0]) else alike[0]


LARGEST = 1e30
"""No number that was measured is larger, in no unit; squares of larger ones could not be added."""


def _number(text: str, column: Column, path: Path, line: int) -> float:
    if text.lower() in MISSING:
        return np.nan
    value = number_of(text)
    if value is None or not abs(value) < LARGEST:
        hint = f" below {LARGEST:g}" if value is not None and np.isfinite(value) else ""
        hint += "; write decimals with a point" if text.replace(",", "", 1).lstrip("+-").isdigit() else ""
        raise ConfigError(f"{path}, line {line}: {column.name} is {text!r}; it must be a finite number{hint}.")
    return value


def check_pressures(name: str, x: np.ndarray, path: Path) -> list[str]:
    """Sentences about pressures that look odd; a ConfigError for negative ones."""
    if np.any(x < 0):
        worst = float(np.min(x)) / UNITS["pressure"]["kPa"]
        raise ConfigError(f"{path}: a pressure of curve {name!r} is {worst:.6g} kPa; gauge pressures are zero or more.")
    return falls_again("pressure", x, path)


def falls_again(what: str, x: np.ndarray, path: Path) -> list[str]:
    """A sentence where what is set rises and falls again, or falls from the first point on."""
    fall = float(np.max(np.maximum.accumulate(x) - x))
    rise = float(np.max(x - np.minimum.accumulate(x)))
    if fall > FALL * np.ptp(x) >= rise:
        return [
            f"{path.name}: the {what} falls from the first point to the last; every point is used, and if the specimen "
            "was unloaded on the way, hysteresis, which the models do not have, counts as an error of the model."
        ]
    if fall > FALL * np.ptp(x):
        return [
            f"{path.name}: the {what} rises and falls again; every point is used, and hysteresis, which the models "
            "do not have, counts as noise."
        ]
    return []


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" + ("" if n == 1 else "s")


def rounded(value: float, kind: str) -> str:
    """A value in SI to three digits, in the unit that people read."""
    return in_units(float(f"{value:.3g}"), kind)
