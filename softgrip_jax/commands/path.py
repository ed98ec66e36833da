"""`softgrip path CONFIG.toml`: one scene through a range of pressures.

Reads the scene of a config; prints or writes a table with a row per pressure, and draws the curve or an animation.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import shlex
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from ..errors import ConfigError
from ..folders import contents, new_folder, write_whole
from ..progress import Tell, silent
from ..report.inputs import keep_inputs
from ..report.run import NAME
from .files import PICTURES, check_file, one_scene, plain, require_picture, tell_file

if TYPE_CHECKING:
    from ..results import Solution


@dataclasses.dataclass(frozen=True)
class WantedCurve:
    """Which curve, by the options of the command."""

    from_kpa: float
    to_kpa: float | None
    points: int
    through_limit: bool
    observable: str | None
    scene: str | None

    def command(self, config: str) -> list[str]:
        """The words of the command that finds the same curve again."""
        options = ["--from-kPa", f"{self.from_kpa:.12g}"]
        options += [] if self.to_kpa is None else ["--to-kPa", f"{self.to_kpa:.12g}"]
        options += ["--points", str(self.points), *(["--through-limit"] if self.through_limit else [])]
        options += [] if self.observable is None else ["--observable", self.observable]
        return ["softgrip", "path", config, *options, *(["--scene", self.scene] if self.scene else [])]


def run_path(
    config: Path,
    wanted: WantedCurve,
    as_json: bool = False,
    csv_file: Path | None = None,
    plot: Path | None = None,
    animate: Path | None = None,
    page: Path | None = None,
    tell_of: Callable[[str, Path, bool], None] = tell_file,
) -> bool:
    """Follow the scene of a config and report; returns whether any row has a state. The arguments are the options.
    tell_of: says where a file is."""
    import numpy as np

    from .. import config as configs
    from ..progress import stages
    from ..questions import branch, limit_pressure
    from ..units import kPa

    for file, option, endings in (
        (csv_file, "--csv", (".csv",)),
        (plot, "--plot", PICTURES),
        (animate, "--animate", (".gif",)),
        (page, "--report", (".html",)),
    ):
        if file is not None:
            check_file(file, option, endings)
    from_kpa, to_kpa, points, through_limit = wanted.from_kpa, wanted.to_kpa, wanted.points, wanted.through_limit
    asked = one_scene(config, wanted.scene).scene
    if animate is not None:
        require_picture(asked, "--animate")
    shown = observable_of(asked, wanted.observable)
    aside = Console(stderr=True)
    stopped = False
    # Without a terminal nobody waits for words, and what is written to a log is what was asked for.
    with stages(aside) if aside.is_terminal else nullcontext(silent) as tell:
        tell("compiling, then solving")
        first = configs.read_numbers(from_kpa, "--from-kPa", "nonnegative", "pressure", [""])
        limit = float(limit_pressure(asked)) if through_limit or to_kpa is None else None
        if to_kpa is None:
            if limit is None or np.isnan(limit):
                raise ConfigError(f"{config}: this scene has no curve up to a limit pressure: {why_no_limit(asked)}.")
            if np.isinf(limit):
                raise ConfigError(f"{config}: this scene has no limit pressure; say how far to go with --to-kPa.")
            last = limit if through_limit else just_below(limit)
        else:
            last = configs.read_numbers(to_kpa, "--to-kPa", "positive", "pressure", [""])
        if through_limit and limit is not None and limit <= last:
            last, through = limit, True
        else:
            through = False  # nothing behind the limit is asked for
        if last <= first:
            raise ConfigError(f"--from-kPa is {from_kpa:g}, the curve ends at {last / kPa:g} kPa; it must rise.")
        if through:
            curve = from_pressure(branch(asked, points), first)
        else:
            curve, stopped = followed(asked, np.linspace(first, last, points), tell)
        header, rows = table_of(curve)
    if csv_file is not None:

        def write(path: Path) -> None:
            with path.open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows([header, *rows])

        write_whole(csv_file, write)
        tell_of("The table", csv_file, as_json)
    if as_json:
        typer.echo(json.dumps(batch_as_data(curve), indent=2, allow_nan=False))
    elif csv_file is None and plot is None and animate is None and page is None:
        csv.writer(sys.stdout, lineterminator="\n").writerows([header, *rows])
    good = np.asarray(curve.status) == 0
    if page is not None:
        text = page_of(curve, shown, limit, config, wanted)
        write_whole(page, text.encode())
        tell_of("The report", page, as_json)
    if not good.any() and not stopped:
        print("There is no state on this curve; the columns status and reason say why.", file=sys.stderr)
        return False
    for sentence in [*lost(curve), *out_of_range(curve)]:
        print(sentence, file=sys.stderr)
    if plot is not None and good.any():
        from ..plots import curve_of

        write_whole(plot, lambda path: curve_of(curve, shown, limit).savefig(path))
        tell_of("The picture", plot, as_json)
    if stopped:
        print(f"{good.size} of {points} pressures are kept.", file=sys.stderr)
        raise KeyboardInterrupt
    if animate is not None:
        from ..plots import animate as animated

        pressures = np.asarray(curve.pressure)[good]
        rising = pressures[: int(np.argmax(pressures)) + 1]
        with aside.status("drawing") as status:
            write_whole(
                animate,
                lambda path: animated(asked, rising, path, lambda k, n: status.update(f"drawing: {k} of {n}")),
            )
        tell_of("The animation", animate, as_json)
    return True


def why_no_limit(scene: Any) -> str:
    """Why the limit pressure of a scene is NaN, in words."""
    from ..questions import solve

    state = solve(scene, 0.0)
    return "it was not found" if int(state.status) == 0 else state.reason_text()


def run_path_into(out: Path, config: Path, wanted: WantedCurve, as_json: bool = False) -> bool:
    """The same with all its files in a new folder: the config, curve.csv, curve.png where there is a state to draw,
    report.html, and result.json with the command. Stopped by Ctrl-C it holds the rows until then."""
    stopped = False
    with new_folder(out, config.stem) as (folder, final):
        keep_inputs(folder, config, ["curve.csv", "result.json"])
        command = {"command": wanted.command("config.toml")}
        (folder / "result.json").write_text(json.dumps(command, indent=2), encoding="utf-8")
        table = folder / "curve.csv"
        plot, page = folder / "curve.png", folder / NAME
        try:
            found = run_path(config, wanted, as_json, csv_file=table, plot=plot, page=page, tell_of=lambda *words: None)
        except KeyboardInterrupt:
            if not table.is_file():
                raise
            found, stopped = True, True
    print(f"The curve is in {final}: {contents(final)}.", file=sys.stderr if as_json else sys.stdout)
    if stopped:
        raise KeyboardInterrupt
    return found


def page_of(curve: Solution, shown: str, limit: float | None, config: Path, wanted: WantedCurve) -> str:
    """The report of a curve, with its picture where there is a state to draw."""
    import numpy as np

    from ..plots import curve_of
    from ..reasons import Reason
    from ..report.run import Curve, report_of_curve
    from ..units import unit_key

    asked = one_scene(config, wanted.scene)
    command = shlex.join(wanted.command(str(config)))
    sentences = {reason.name: reason.text() for reason in Reason}
    up = unit_key(shown, type(curve.scene).OBSERVABLES[shown])
    found = Curve(*table_of(curve), asked.scenes, unit_key("pressure", "pressure"), up, sentences)
    with TemporaryDirectory() as folder:
        picture = Path(folder) / f"{shown}.png"
        if (np.asarray(curve.status) == 0).any():
            curve_of(curve, shown, limit).savefig(picture)
        return report_of_curve(found, config, command, picture if picture.is_file() else None)


DIGITS = 9
"""Of the last pressure of a curve up to a limit, behind its first one."""
CHUNK, MARKS = 16, 20
"""Pressures that are solved together between two looks at whether to go on, and how often there are such at most."""


def followed(scene: Any, pressures: Any, tell: Tell) -> tuple[Solution, bool]:
    """(the states at the pressures, whether Ctrl-C cut them short): in parts of one size, by one program."""
    import jax
    import numpy as np

    from ..questions import path

    size = min(len(pressures), max(CHUNK, -(-len(pressures) // MARKS)))
    parts, stopped = [], False
    try:
        for first in range(0, len(pressures), size):
            own = pressures[first : first + size]
            count = len(own)
            filled = np.append(own, np.full(size - count, own[-1]))
            parts.append(jax.tree.map(lambda x, n=count: np.asarray(x)[:n], path(scene, filled)))
            tell("pressures solved", first + count, len(pressures))
    except KeyboardInterrupt:
        if not parts:
            raise
        stopped = True
    return jax.tree.map(lambda *x: np.concatenate(x), *parts), stopped


def just_below(limit: float) -> float:
    """A pressure of so many digits that a table shows it, at which there is still a state."""
    rounded = float(f"{limit:.{DIGITS}e}")
    unit = 10.0 ** (math.floor(math.log10(limit)) - DIGITS)
    return rounded if rounded <= limit else float(f"{rounded - unit:.{DIGITS}e}")


def lost(curve: Solution) -> list[str]:
    """A sentence for each reason, but a limit, why points of a curve have no state: a picture is without them."""
    from ..reasons import Reason
    from ..results import Status

    reasons = [Reason(int(r)) for r, s in zip(curve.reason, curve.status, strict=True) if s > Status.BEYOND_LIMIT]
    return [
        f"{count} of {len(curve.status)} points have no state: {reason.text()}."
        for reason, count in Counter(reasons).items()
    ]


def out_of_range(curve: Solution) -> list[str]:
    """A sentence for each range, which forbids nothing, that states of a curve are out of, with the worst of them."""
    import numpy as np

    from ..reasons import BROKEN, Reason
    from ..results import Status, in_units

    told = []
    for name, margins in curve.margins.items():
        out = (np.asarray(curve.status) == Status.OK) & (np.asarray(margins) < -BROKEN)
        if out.any() and not Reason[name.upper()].forbids:
            first = float(np.asarray(curve.pressure)[out][0])
            words = Reason[name.upper()].text(float(np.asarray(margins)[out].min()))
            told.append(f"{out.sum()} of {len(out)} states, from {in_units(first, 'pressure')} on: {words}.")
    return told


def from_pressure(curve: Solution, first: float) -> Solution:
    """A branch without the points on its way up that are below a pressure, Pa."""
    import dataclasses

    import jax
    import numpy as np

    pressures = np.asarray(curve.pressure)
    wanted = (pressures >= first) | (np.arange(len(pressures)) > int(np.nanargmax(pressures)))

    # The scene may be one for all states.
    states = {f.name: getattr(curve, f.name) for f in dataclasses.fields(curve) if f.name != "scene"}
    return dataclasses.replace(curve, **jax.tree.map(lambda x: x[wanted], states))


def observable_of(scene: Any, key: str | None) -> str:
    """The observable that a key with its unit names; the first of the scene that is a number where none is given."""
    from ..units import unit_key

    names = {unit_key(name, kind): name for name, kind in scene.prepared().OBSERVABLES.items() if kind != "position"}
    if key is None:
        return next(iter(names.values()))
    if key not in names:
        raise ConfigError(f"--observable is {key!r}; it must be one of {', '.join(names)}.")
    return names[key]


def table_of(curve: Solution) -> tuple[list[str], list[list[Any]]]:
    """(header, rows) of a curve; keys as in configs, empty cells where there is no state."""
    import numpy as np

    from ..reasons import Reason
    from ..results import Status
    from ..units import DISPLAY, unit_key

    columns = {unit_key("pressure", "pressure"): np.asarray(curve.pressure) / DISPLAY["pressure"][1]}
    for name, kind in type(curve.scene).OBSERVABLES.items():
        values = np.asarray(curve.observables[name]) / DISPLAY[kind][1]
        if kind == "position":
            columns |= {unit_key(f"{name}.{axis}", kind): values[:, k] for k, axis in enumerate("xy")}
        else:
            columns[unit_key(name, kind)] = values
    cells = [[f"{v:.10g}" if np.isfinite(v) else "" for v in column] for column in columns.values()]
    status = [Status(int(s)).name for s in np.asarray(curve.status)]
    reason = [Reason(int(r)).name for r in np.asarray(curve.reason)]
    rows = zip(*cells, status, reason, strict=True)
    return [*columns, "status", "reason"], [list(row) for row in rows]


def batch_as_data(curve: Solution) -> dict[str, Any]:
    """A curve as plain data in SI."""
    import numpy as np

    from ..config.modules import type_name
    from ..results import Status
    from ..units import SI

    kinds = type(curve.scene).OBSERVABLES
    return {
        "scene": type_name(type(curve.scene)),
        "status": [Status(int(s)).name for s in np.asarray(curve.status)],
        "reason": [str(text) for text in curve.reason_text()],
        "margins": {name: plain(margin) for name, margin in curve.margins.items()},
        "pressure": plain(curve.pressure),
        "observables": {name: plain(curve.observables[name]) for name in kinds},
        "units": {"pressure": SI["pressure"]} | {name: SI[kind] for name, kind in kinds.items()},
    }
