"""What the model expects of a design, for the sheet that goes to the bench: by each law of what pushes its finger, with
the pressure up to which the rules of the scene hold."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import CellRangeWarning, InputError
from ..reasons import BROKEN, Reason
from .asked import solving
from .path import why_no_limit
from .programs import program
from .solve import ranges_left

if TYPE_CHECKING:
    from ..cad.sheet import Expected
    from ..results import Solution
    from ..scene import Scene

LOOKED_AT = 24
"""Pressures, evenly spaced from zero to the limit, at which a scene's rules are looked at ..."""
HALVED = 12
"""... and how often the gap is halved in which the first of them breaks: to 1e-5 of the limit pressure."""
BELOW = 1 - 1e-6
"""Of the limit pressure: the last state that is looked at."""
BEYOND_ASKED = 2.0
"""Of the pressure that is asked for: up to there rules are looked at where there is no limit."""


@dataclasses.dataclass(frozen=True)
class Column:
    """What a scene is expected to do, by one law of what pushes it."""

    scene: Scene
    rows: dict[str, str]
    """Name -> value in words."""
    ends: list[str]
    """Sentences about where its rules end to hold, and where ranges of its states end."""


class Asked:
    """The questions to a scene. Their programs are compiled, or read, from now on."""

    def __init__(self, scene: Scene, read: Any):
        from .. import config as configs
        from ..compiler import QUICKLY
        from ..questions import pressure_at_limit, to_limit, to_solve
        from ..scene import equilibrium

        self.scene, self.why_none = scene, ""
        self.given, first = to_solve(scene, 0.0)
        self.state = program(equilibrium, self.given, first, options=QUICKLY)
        self.limit = partial(program(pressure_at_limit, to_limit(scene), options=QUICKLY), to_limit(scene))
        try:
            asked = configs.question(read)
            self.solved = partial(self.at, asked["pressure"]) if "pressure" in asked else solving(scene, asked)
        except InputError as error:
            self.why_none = f"none: {error}"

    def at(self, pressure: float) -> Solution:
        """The state at a pressure, Pa."""
        from ..questions import to_solve

        return self.state(*to_solve(self.given, pressure))


def expectations(read: Any) -> Expected:
    """What the model says of the design of a config: its state as [solve] asks, where it does, its limit pressure, and
    the pressure up to which its rules hold; of a finger by both of its drives, with what must be known of them."""
    from ..cad.sheet import Expected
    from ..pneunet.cell.law import range_remarks
    from ..pneunet.drives import remarks, with_other_drive
    from ..quantities import margins_at_rest, rules_at_rest

    other = with_other_drive(read.scene)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CellRangeWarning)  # said in words of our own
        questions = [Asked(scene, read) for scene in (read.scene, other) if scene is not None]
        columns = [_column(asked) for asked in questions]
        at_rest = [margins_at_rest(column.scene) for column in columns]
    names = list(dict.fromkeys(name for column in columns for name in column.rows))
    drives = [getattr(column.scene, "drive", "") for column in columns]
    header = ("quantity", "value") if other is None else ("quantity", *(f'by "{drive}"' for drive in drives))
    said = [sentence for margins in at_rest for sentence in ranges_left(margins)]
    for column, drive in zip(columns, drives, strict=True):
        said += [f"{end[0].upper()}{end[1:]}" if other is None else f'By "{drive}", {end}' for end in column.ends]
    if other is not None:
        said += remarks(read.scene)
    elif "cell_law_range" in rules_at_rest(read.scene):
        said += range_remarks(read.scene.finger)
    rows = [(name, *(column.rows.get(name, "-") for column in columns)) for name in names]
    return Expected(rows, header, list(dict.fromkeys(said)))


def as_data(expected: Expected) -> dict[str, Any]:
    """The same for result.json: "expected" by the law of the config, "expected_by" by each law, and the sentences."""
    laws = expected.header[1:]
    each = {law: {row[0]: row[k] for row in expected.rows if row[k] != "-"} for k, law in enumerate(laws, 1)}
    found: dict[str, Any] = {"expected": each[laws[0]]}
    if len(laws) > 1:
        found["expected_by"] = {law.removeprefix("by ").strip('"'): rows for law, rows in each.items()}
    return found | {"remarks": list(expected.sentences)}


def _column(asked: Asked) -> Column:
    """What a scene does as the [solve] of a config asks, and where that ends."""
    from ..results import Status, in_units

    rows: dict[str, str] = {}
    pressure = np.nan
    if asked.why_none:
        rows["state"] = asked.why_none
    else:
        solution = asked.solved()
        solved = int(solution.status) == Status.OK
        rows |= {
            name: value for name, value in solution.rows() if value != "-" and (solved or name != "scaled residual")
        }
        pressure = float(solution.pressure)
    limit = float(asked.limit())
    if np.isnan(limit):
        rows["limit pressure"] = f"unknown: {why_no_limit(asked.scene)}"
        return Column(asked.scene, rows, [])
    rows["limit pressure"] = "none" if np.isinf(limit) else in_units(limit, "pressure")
    last = BEYOND_ASKED * pressure if np.isinf(limit) else BELOW * limit
    ends = []
    if last > 0:
        forbidding, ranges, known = ends_of_rules(asked, last)
        if known == 0:
            rows[UP_TO] = f"unknown: no state was found up to {in_units(last, 'pressure')}"
        elif forbidding is None and known < last:
            rows[UP_TO] = f"{in_units(known, 'pressure')} at least"
        elif forbidding is None:
            rows[UP_TO] = "the limit pressure" if np.isfinite(limit) else f"{in_units(last, 'pressure')} at least"
        elif forbidding.pressure == 0:
            rows[UP_TO] = "none: they are broken from the first on"
            ends.append(f"the rules of the scene hold at no pressure: {forbidding.rule.text()}.")
        else:
            rows[UP_TO] = in_units(forbidding.pressure, "pressure")
            ends.append(f"the rules of the scene hold only up to {rows[UP_TO]}; beyond it {forbidding.rule.text()}.")
        ends += [f"from {in_units(end.pressure, 'pressure')} on {end.rule.text()}." for end in ranges]
    return Column(asked.scene, rows, ends)


UP_TO = "rules hold up to"
"""The row of the pressure up to which a scene keeps its rules."""


@dataclasses.dataclass(frozen=True)
class End:
    """The largest pressure (Pa) up to which a rule is kept, on the way up from the first state that keeps it."""

    pressure: float
    rule: Reason


def ends_of_rules(asked: Asked, last: float) -> tuple[End | None, list[End], float]:
    """(where the first rule breaks that forbids something, also one that the scene ignores; where ranges of states are
    left; the largest pressure, Pa, at which it is known whether rules are kept, 0 where there is none), at pressures up
    to the last one, Pa. Nothing is said of rules that are kept up to there. Where there is no state, as before a tip
    presses, margins are NaN: such a pressure says nothing."""
    from ..quantities import rules_at_rest

    pressures = np.linspace(0.0, last, LOOKED_AT + 1)[1:]
    margins = [asked.at(pressure).margins for pressure in pressures]
    names = list(margins[0])
    forbidding = [name for name in names if Reason[name.upper()].forbids]
    at_rest = rules_at_rest(asked.scene)
    ranges = [name for name in names if name not in forbidding and name not in at_rest]

    def broken(of: list[str], found: Any) -> list[tuple[float, str]]:
        return sorted((float(found[name]), name) for name in of if float(found[name]) < -BROKEN)

    def end(of: list[str]) -> tuple[End | None, float]:
        here = [k for k, m in enumerate(margins) if broken(of, m) or not any(np.isnan(float(m[name])) for name in of)]
        if not here:
            return None, 0.0
        known = [pressures[k] for k in here], [margins[k] for k in here]
        return _end(*known, partial(broken, of), lambda pressure: asked.at(pressure).margins), float(known[0][-1])

    first, known = end(forbidding)
    return first, [found for name in ranges if (found := end([name])[0]) is not None], known


def _end(pressures: Any, margins: list[Any], broken: Callable[..., Any], at: Callable[[float], Any]) -> End | None:
    """Where something breaks first behind the first pressure that keeps it; 0 where none does."""
    bad = [broken(found) for found in margins]
    good = next((k for k, found in enumerate(bad) if not found), None)
    if good is None:
        return End(0.0, Reason[bad[0][0][1].upper()])
    last = next((k for k in range(good, len(bad)) if bad[k]), None)
    if last is None:
        return None
    low, high, worst = pressures[last - 1], pressures[last], bad[last]
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        found = broken(at(middle))
        low, high, worst = (low, middle, found) if found else (middle, high, worst)
    return End(float(low), Reason[worst[0][1].upper()])
