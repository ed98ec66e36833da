"""What a study of any size comes to: quantiles and the best designs, read in parts that take little memory."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from ..errors import InputError
from ..reasons import Reason
from ..results import Status
from ..units import DISPLAY, number_of, unit_key
from .dataset import (
    answers,
    blocks_of,
    column_of,
    pieces,
    quantities_of,
    read,
    reason_of,
    states_of,
    tied_in,
    varied_in,
)

DIGIT = 16
"""Binary digits of a number that are counted in one pass over the study: four passes, and 65536 counts for each."""


def quantiles(data: xr.Dataset, names: Sequence[str], parts: Sequence[float]) -> dict[str, tuple[int, np.ndarray]]:
    """For every quantity how many answers it has, and their quantiles, those of `numpy.quantile` (linear between
    neighbours), NaN where there are none. A limit that is not there (inf) is the largest answer.

    It is a radix selection: each pass counts the next binary digits of those values whose first digits are known to be
    those of a wanted one. The study is read four times, and none of it is kept.
    """
    counts: dict[str, int] = {}
    ranks: dict[str, np.ndarray] = {}
    """The wanted places among the values, sorted, that have the same first digits."""
    prefixes: dict[str, np.ndarray] = {}
    states = {data[name].attrs["status"] for name in names}
    for shift in range(64 - DIGIT, -1, -DIGIT):
        seen = {name: {} for name in names}
        for part in pieces(data, [*names, *states]):
            for name in names:
                keys = _keys(part[name][answers(data, part, name)])
                digits, first = (keys >> np.uint64(shift)).astype(np.uint16), shift + DIGIT == 64
                heads = keys >> np.uint64(min(shift + DIGIT, 63))
                for prefix in [0] if first else np.unique(prefixes[name]).tolist():
                    chosen = digits if first else digits[heads == np.uint64(prefix)]
                    found = np.bincount(chosen, minlength=1 << DIGIT)
                    seen[name][prefix] = seen[name].get(prefix, 0) + found
        for name in names:
            if shift + DIGIT == 64:
                counts[name] = int(np.sum(seen[name].get(0, 0)))
                last = max(counts[name] - 1, 0)
                place = np.asarray(parts) * last
                ranks[name] = np.concatenate([np.floor(place), np.ceil(place)]).astype(np.int64)
                prefixes[name] = np.zeros(len(ranks[name]), dtype=np.uint64)
            for k in range(len(ranks[name]) if counts[name] else 0):
                sums = np.cumsum(seen[name][int(prefixes[name][k])])
                digit = int(np.searchsorted(sums, ranks[name][k], side="right"))
                ranks[name][k] -= sums[digit - 1] if digit else 0
                prefixes[name][k] = (prefixes[name][k] << np.uint64(DIGIT)) | np.uint64(digit)
    found = {}
    for name in names:
        low, high = np.split(_values(prefixes[name]), 2)
        place = np.asarray(parts) * max(counts[name] - 1, 0)
        with np.errstate(invalid="ignore"):  # between two that are inf
            between = low + (place - np.floor(place)) * (high - low)
        found[name] = counts[name], np.where(low == high, low, between) if counts[name] else np.full(len(parts), np.nan)
    return found


SIGN = np.uint64(1 << 63)


def _keys(values: np.ndarray) -> np.ndarray:
    """Numbers as integers of the same order."""
    bits = np.ascontiguousarray(values, dtype=float).view(np.uint64)
    return np.where(bits & SIGN, ~bits, bits | SIGN)


def _values(keys: np.ndarray) -> np.ndarray:
    return np.where(keys & SIGN, keys & ~SIGN, ~keys).view(float)


def reason_counts(data: xr.Dataset) -> dict[str, dict[str, dict[str, int]]]:
    """For every state, how many designs have which status, and for which reason."""
    names = states_of(data)
    width = max(int(reason) for reason in Reason) + 1
    totals = {name: np.zeros((len(Status), width), dtype=np.int64) for name in names}
    for part in pieces(data, [*names, *map(reason_of, names)]):
        for name in names:
            both = part[name].astype(np.int64) * width + part[reason_of(name)]
            totals[name] += np.bincount(both, minlength=len(Status) * width).reshape(len(Status), width)
    return {
        name: {
            status.name: {reason.name: int(total[status, reason]) for reason in Reason if total[status, reason]}
            for status in Status
            if total[status].any()
        }
        for name, total in totals.items()
    }


class Condition(NamedTuple):
    """What a design must keep: a variable against a number in SI."""

    name: str
    holds: Callable[[np.ndarray, float], np.ndarray]
    value: float


COMPARISONS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}


def keys_of(data: xr.Dataset) -> dict[str, tuple[str, float]]:
    """The names of columns as CSV has them, with their unit: (name of the variable, that unit in SI)."""
    names = [*varied_in(data), *quantities_of(data)]
    return {column_of(data, name): (name, DISPLAY[data[name].attrs["kind"]][1]) for name in names}


def _other_keys(data: xr.Dataset) -> dict[str, str]:
    """What else a varied number is called: by each of the names that are tied, and by the key of a config that moves it
    in several scenes, which names none of them. A name of two numbers is left out."""
    found: dict[str, set[str]] = {}
    for name in varied_in(data):
        tied, kind = tied_in(data, name).split(" = "), data[name].attrs["kind"]
        within = [part.partition(".")[2] for part in tied]
        for other in (*tied, *(part for part in within if within.count(part) > 1)):
            found.setdefault(unit_key(other, kind), set()).add(name)
    return {key: next(iter(names)) for key, names in found.items() if len(names) == 1}


def known_key(data: xr.Dataset, key: str) -> tuple[str, float]:
    """(the variable that a key names, the unit of the key in SI)."""
    keys, plain = keys_of(data), " = ".join(part.strip() for part in key.split("="))
    if plain in keys:
        return keys[plain]
    name = _other_keys(data).get(plain)
    if name is None:
        raise InputError(f"There is no column {key!r} in the study; it has {', '.join(keys)}.")
    return name, DISPLAY[data[name].attrs["kind"]][1]


def condition(data: xr.Dataset, words: str) -> Condition:
    """'shell.a_mm < 16' as a condition."""
    parts = re.fullmatch(r"\s*(.*?)\s*(<=|>=|<|>)\s*(.*?)\s*", words, re.DOTALL)
    if parts is None:
        raise _no_condition(data, words, "it has none of <, <=, > and >=")
    key, comparison, text = parts.groups()
    value = number_of(text)
    if not key:
        raise _no_condition(data, words, f"no column is named before {comparison}")
    if number_of(key) is not None and value is None:
        raise _no_condition(data, words, f"{key!r} stands where the name of a column must be")
    if value is None or not np.isfinite(value):
        raise _no_condition(data, words, f"{text!r} is not a finite number{_hint(text)}")
    name, unit = known_key(data, key)
    return Condition(name, COMPARISONS[comparison], value * unit)


def _hint(text: str) -> str:
    """What to do about a number that is none."""
    if number_of(text.replace(",", ".", 1)) is not None and "," in text:
        return " (write decimals with a point)"
    head = re.fullmatch(r"(\S*\d)\s*[^\d\s.,<>=][^<>=]*", text)
    return " (leave out the unit)" if head and number_of(head[1]) is not None else ""


def _no_condition(data: xr.Dataset, words: str, why: str) -> InputError:
    return InputError(
        f"{words!r} is no condition: {why}; a condition is NAME <, <=, > or >= NUMBER, in the unit of the column, for "
        f'instance --where "{next(iter(keys_of(data)))} < 1.5".'
    )


def best(
    data: xr.Dataset, name: str, most: bool, count: int, conditions: Sequence[Condition] = ()
) -> tuple[np.ndarray, int]:
    """(numbers of the designs with the least or largest values of a variable, best first; how many designs may be
    chosen at all): those that keep the conditions, and whose states are all OK where a quantity is asked of them."""
    asked = [name, *(c.name for c in conditions)]
    quantities = [n for n in asked if "status" in data[n].attrs]
    states = sorted({data[n].attrs["status"] for n in quantities})
    chosen, values, allowed = np.zeros(0, dtype=np.int64), np.zeros(0), 0
    for block in blocks_of(data):
        part = read(data, block, list(dict.fromkeys([*asked, *states])))
        good = np.ones(block.stop - block.start, bool)
        for n in quantities:
            good &= answers(data, part, n)
        for c in conditions:
            good &= c.holds(part[c.name], c.value)
        rows = np.flatnonzero(good)
        allowed += len(rows)
        chosen = np.concatenate([chosen, block.start + rows])
        values = np.concatenate([values, -part[name][rows] if most else part[name][rows]])
        order = np.argsort(values, kind="stable")[:count]
        chosen, values = chosen[order], values[order]
    return chosen, allowed
