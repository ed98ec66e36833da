"""`softgrip summary STORE`: what a study comes to, whatever its size: statuses with their reasons, quantiles, the best
designs by a quantity under conditions, and a picture with parallel axes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console

from ..errors import ConfigError
from ..folders import write_whole
from ..quantities import shown
from ..reasons import Reason
from ..study.dataset import designs_in, loaded, quantities_of, rows_of, tied_in, varied_in
from ..study.store import opened
from ..study.summary import best, condition, known_key, quantiles, reason_counts
from ..tables import Table
from .files import PICTURES, check_file, plain, tell_file

PARTS = {"least": 0.0, "5 %": 0.05, "25 %": 0.25, "median": 0.5, "75 %": 0.75, "95 %": 0.95, "most": 1.0}
BEST = 10
"""Designs that are named as the best, where nothing is said."""
LINES = 400
"""Designs in the picture."""


def run_summary(
    place: str,
    by: str | None,
    most: bool,
    where: Sequence[str],
    count: int | None,
    plot: Path | None,
    as_json: bool,
    console: Console,
) -> dict[str, Any]:
    """Print what a study comes to; returns the same in SI. count: of the best designs, BEST by default."""
    if plot is not None:
        check_file(plot, "--plot", PICTURES)
    if by is None:
        for option, given in (("--where", where), ("--most", most), ("--count", count)):
            if given:
                raise ConfigError(f"{option} is given without --best, which says what the best designs are chosen by.")
    with opened(place) as data:
        conditions = [condition(data, words) for words in where]
        name = None if by is None else known_key(data, by)[0]
        found: dict[str, Any] = {"designs": designs_in(data), "states": reason_counts(data)}
        tell_states(found["states"], console)
        found["quantities"] = tell_quantities(data, PARTS, console)
        if name is not None:
            chosen, allowed = best(data, name, most, count or BEST, conditions)
            found["best"] = _tell_best(data, rows_of(data, chosen), chosen, allowed, console)
        if plot is not None:
            draw(data, plot)
            tell_file("The picture", plot, as_json)
    return found


def tell_states(states: dict[str, dict[str, dict[str, int]]], console: Console) -> None:
    for name, statuses in states.items():
        label = name.removeprefix("status_").replace("_", " ")
        words = ", ".join(f"{sum(reasons.values())} {status}" for status, reasons in statuses.items())
        console.print(f"{label}: {words}", soft_wrap=True)
        for status, reasons in statuses.items():
            for reason, number in sorted(reasons.items(), key=lambda pair: -pair[1]):
                if reason != Reason.NONE.name:
                    console.print(f"  {status}: {number} {reason}", soft_wrap=True)


def tell_quantities(data: xr.Dataset, parts: dict[str, float], console: Console) -> dict[str, Any]:
    """Print a table of quantiles of the values that there are; returns it in SI."""
    names = quantities_of(data)
    table = Table(title=f"{designs_in(data)} designs; of each quantity those that are OK", title_justify="left")
    for head in ("", *parts):
        table.add_column(head, justify="right" if head else "left")
    found: dict[str, Any] = {}
    for name, (answered, values) in quantiles(data, names, list(parts.values())).items():
        words = data[name].attrs
        table.add_row(words["long_name"], *(shown(v, words["kind"]) for v in values))
        found[name] = {"unit": words["units"], "answered": answered}
        found[name] |= dict(zip(parts, map(plain, values), strict=True))
    console.print(table)
    return found


def _tell_best(
    data: xr.Dataset, rows: xr.Dataset, chosen: np.ndarray, allowed: int, console: Console
) -> list[dict[str, Any]]:
    if not allowed:
        console.print("No design may be chosen: none has a state that keeps what is asked.", soft_wrap=True)
        return []
    names = [*varied_in(data), *quantities_of(data)]
    table = Table(title=f"The best of {allowed} designs that may be chosen", title_justify="left")
    for head in ("design", *(data[n].attrs["long_name"] if n in data.data_vars else tied_in(data, n) for n in names)):
        table.add_column(head, justify="right")
    found = []
    for k, number in enumerate(chosen.tolist()):
        values = [float(rows[name].values[k]) for name in names]
        cells = [shown(v, data[n].attrs["kind"]) for v, n in zip(values, names, strict=True)]
        table.add_row(str(number), *cells)
        found.append({"design": number} | {n: plain(v) for n, v in zip(names, values, strict=True)})
    console.print(table)
    return found


def draw(data: xr.Dataset, path: Path) -> None:
    """The picture of a study; of a large one some designs, drawn at random."""
    from .. import plots

    count, dims = designs_in(data), data[quantities_of(data)[0]].dims
    if count > LINES and (len(dims) != 1 or dims[0] not in data.coords) and sum(data.sizes[d] > 1 for d in dims) != 2:
        chosen = np.sort(np.random.default_rng(0).choice(count, LINES, replace=False))
        data = rows_of(data, chosen).assign_attrs(designs=count)
    write_whole(path, plots.study(loaded(data)).savefig)
