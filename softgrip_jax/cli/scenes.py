"""solve, path: questions to one scene."""

from __future__ import annotations

import csv
import json
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from ..errors import ConfigError, located
from ..progress import Tell, silent
from .app import NO_ANSWER, PICTURES, AsJson, ConfigFile, SceneName, app, check_file, one_scene, tell_file, write_file
from .programs import kept

if TYPE_CHECKING:
    from ..results import Solution


@app.command()
def solve(
    config: ConfigFile,
    pressure_kpa: Annotated[
        float | None, typer.Option("--pressure-kPa", help="Solve at this pressure, whatever [solve] asks.")
    ] = None,
    scene: SceneName = None,
    as_json: AsJson = False,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the scene to this file.")] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Leave out what changes --observable by less than this, for instance 1%.")
    ] = None,
    observable: Annotated[
        str | None, typer.Option(help="With --tolerance: whose error counts; by default the first of the scene.")
    ] = None,
) -> None:
    """Solve one scene and report its state.

    [solve] in the config gives the pressure (pressure_kPa) or one observable that the pressure shall reach (force_N);
    a grasp with a mass needs neither. Exit code 1 where there is no answer.

    With --tolerance the cheapest model and numerics are chosen that answer within it, and what they leave out is told.
    Every one that is tried is compiled, so that takes longer than to solve once.

    - softgrip solve configs/shell_cylinder.toml --plot cylinder.png

    - softgrip solve configs/shell_cylinder.toml --pressure-kPa 12 --json

    - softgrip solve configs/finger_tip_contact.toml --tolerance 1%
    """
    from .. import config as configs
    from ..fidelity import choose
    from ..scene import _pressure_for, _solve, to_reach, to_solve

    if plot is not None:
        check_file(plot, "--plot", PICTURES)
    if observable is not None and tolerance is None:
        raise ConfigError("--observable says whose error --tolerance is about; give --tolerance too.")
    allowed = _share(tolerance) if tolerance is not None else None
    read = one_scene(config, scene)
    if pressure_kpa is None:
        asked = configs.question(read)
    else:
        asked = {"pressure": configs.read_numbers(pressure_kpa, "--pressure-kPa", "nonnegative", "pressure", [""])}
    choice = None
    # A scene itself may not take what is asked as a question.
    with Console(stderr=True).status("solving"), located(f"{config}, [solve]"):
        if allowed is not None:
            choice = choose(read.scene, tolerance=allowed, observable=observable, **asked)
            solution = choice.solution
        elif "pressure" in asked:
            solution = kept(_solve, *to_solve(read.scene, **asked))
        else:
            solution = kept(_pressure_for, *to_reach(read.scene, **asked))
    if as_json:
        chosen = {"fidelity": choice.as_data()} if choice is not None else {}
        typer.echo(json.dumps(as_data(solution) | chosen, indent=2, allow_nan=False))
    else:
        report(solution, Console(), "pressure" in asked)
        if choice is not None:
            typer.echo(choice)
    if int(solution.status) != 0:
        if plot is not None:
            print("No picture: there is no state to draw.", file=sys.stderr)
        raise typer.Exit(NO_ANSWER)
    if plot is not None:
        from ..plots import draw

        with located("--plot"):  # a scene that nothing is drawn of
            picture = draw(solution)
        write_file(plot, picture.savefig)
        tell_file("The picture", plot, as_json)


@app.command()
def path(
    config: ConfigFile,
    from_kpa: Annotated[float, typer.Option("--from-kPa", help="First pressure.")] = 0.0,
    to_kpa: Annotated[
        float | None, typer.Option("--to-kPa", help="Last pressure; without it, the limit pressure of the scene.")
    ] = None,
    points: Annotated[
        int, typer.Option(min=2, max=100_000, help="How many pressures, evenly spaced; or points along the curve.")
    ] = 41,
    through_limit: Annotated[
        bool,
        typer.Option(
            help="The curve of equilibria instead, through the limit and behind it to half of it. It ends before, "
            "with --to-kPa below the limit; what is below --from-kPa on the way up is left out."
        ),
    ] = False,
    observable: Annotated[
        str | None,
        typer.Option(help="What the picture shows over the pressure, with its unit; the first of the scene."),
    ] = None,
    scene: SceneName = None,
    as_json: AsJson = False,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write a table: one row per pressure.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the curve to this file.")] = None,
    animate: Annotated[Path | None, typer.Option(help="Write the scene under rising pressure to this GIF.")] = None,
) -> None:
    """Follow one scene through a range of pressures: a table, a picture, an animation.

    Rows without equilibrium keep their place and say so in the columns status and reason. Exit code 1 where no row has
    a state. Ctrl-C keeps the rows until then: they are printed and written as if the curve ended there.

    - softgrip path configs/shell_cylinder.toml --to-kPa 20 --csv curve.csv --plot curve.png

    - softgrip path configs/finger_tip_contact.toml --through-limit --plot fold.png

    - softgrip path configs/shell_cylinder.toml --from-kPa 3 --to-kPa 20 --points 30 --animate inflation.gif
    """
    import numpy as np

    from .. import config as configs
    from ..progress import stages
    from ..scene import branch, limit_pressure
    from ..units import kPa

    for file, option, endings in (
        (csv_file, "--csv", (".csv",)),
        (plot, "--plot", PICTURES),
        (animate, "--animate", (".gif",)),
    ):
        if file is not None:
            check_file(file, option, endings)
    asked = one_scene(config, scene).scene
    if animate is not None:
        from ..plots import has_picture

        if not has_picture(asked):
            raise ConfigError(f"--animate: there is no picture of a {type(asked).__name__} yet.")
    shown = observable_of(asked, observable)
    aside = Console(stderr=True)
    stopped = False
    # Without a terminal nobody waits for words, and what is written to a log is what was asked for.
    with stages(aside) if aside.is_terminal else nullcontext(silent) as tell:
        tell("compiling, then solving")
        first = configs.read_numbers(from_kpa, "--from-kPa", "nonnegative", "pressure", [""])
        limit = float(limit_pressure(asked)) if through_limit or to_kpa is None else None
        if to_kpa is None:
            if limit is None or not np.isfinite(limit):
                raise ConfigError(f"{config}: this scene has no limit pressure; say how far to go with --to-kPa.")
            last = limit
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

        write_file(csv_file, write)
        tell_file("The table", csv_file, as_json)
    if as_json:
        typer.echo(json.dumps(batch_as_data(curve), indent=2, allow_nan=False))
    elif csv_file is None and plot is None and animate is None:
        csv.writer(sys.stdout, lineterminator="\n").writerows([header, *rows])
    good = np.asarray(curve.status) == 0
    if not good.any() and not stopped:
        print("There is no state on this curve; the columns status and reason say why.", file=sys.stderr)
        raise typer.Exit(NO_ANSWER)
    if plot is not None and good.any():
        from ..plots import curve_of

        write_file(plot, lambda path: curve_of(curve, shown, limit).savefig(path))
        tell_file("The picture", plot, as_json)
    if stopped:
        print(f"{good.size} of {points} pressures are kept.", file=sys.stderr)
        raise KeyboardInterrupt
    if animate is not None:
        from ..plots import animate as animated

        pressures = np.asarray(curve.pressure)[good]
        rising = pressures[: int(np.argmax(pressures)) + 1]
        with aside.status("drawing") as status:
            write_file(
                animate,
                lambda path: animated(asked, rising, path, lambda k, n: status.update(f"drawing: {k} of {n}")),
            )
        tell_file("The animation", animate, as_json)


CHUNK, MARKS = 16, 20
"""Pressures that are solved together between two looks at whether to go on, and how often there are such at most."""


def followed(scene: Any, pressures: Any, tell: Tell) -> tuple[Solution, bool]:
    """(the states at the pressures, whether Ctrl-C cut them short): in parts of one size, by one program."""
    import jax
    import numpy as np

    from ..scene import path

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


def _share(text: str) -> float:
    """'1%' or '0.01' as a number."""
    import math

    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = math.nan
    if not 0 < share < math.inf:
        raise ConfigError(f"--tolerance is {text!r}; it must be a positive share, for instance 1% or 0.01.")
    return share


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

    from ..config import type_name
    from ..results import Status
    from ..units import SI

    kinds = type(curve.scene).OBSERVABLES
    return {
        "scene": type_name(type(curve.scene)),
        "status": [Status(int(s)).name for s in np.asarray(curve.status)],
        "reason": [str(text) for text in curve.reason_text()],
        "margins": {name: _plain(margin) for name, margin in curve.margins.items()},
        "pressure": _plain(curve.pressure),
        "observables": {name: _plain(curve.observables[name]) for name in kinds},
        "units": {"pressure": SI["pressure"]} | {name: SI[kind] for name, kind in kinds.items()},
    }


def as_data(solution: Solution) -> dict[str, Any]:
    """A solution as plain data in SI; what is not a finite number is None."""
    from ..config import type_name
    from ..results import Status
    from ..units import SI

    status = Status(int(solution.status))
    kinds = type(solution.scene).OBSERVABLES
    return {
        "scene": type_name(type(solution.scene)),
        "status": status.name,
        "message": status.message,
        "reason": solution.reason_text(),
        "margins": {name: _plain(margin) for name, margin in solution.margins.items()},
        "pressure": _plain(solution.pressure),
        "residual": _plain(solution.residual),
        "iterations": int(solution.iterations),
        "observables": {name: _plain(solution.observables[name]) for name in kinds},
        "units": {"pressure": SI["pressure"]} | {name: SI[kind] for name, kind in kinds.items()},
    }


def nearest_rule(solution: Solution) -> tuple[str, str] | None:
    """(rule, margin) of the one that is nearest to being broken, or broken by most where that is ignored."""
    from ..reasons import BROKEN
    from ..results import in_units

    known = {name: float(margin) for name, margin in solution.margins.items() if float(margin) == float(margin)}
    if not known:
        return None
    name = min(known, key=lambda name: known[name])
    words = "" if known[name] >= -BROKEN else " (broken, and ignored)"
    return name, f"{in_units(known[name], 'length')}{words}"


def _plain(value: Any) -> Any:
    import numpy as np

    array = np.asarray(value)
    if array.ndim:
        return [_plain(v) for v in array]
    return float(array) if np.isfinite(array) else None


def report(solution: Solution, console: Console, given_pressure: bool = True) -> None:
    """The state as a table for people; at a given pressure with what a gripper could hold at most."""
    from .. import pneunet
    from ..config import type_name
    from ..results import Status, in_units
    from ..scene import limit_pressure
    from ..tables import Table

    table = Table(title=type_name(type(solution.scene)), show_header=False, title_justify="left")
    table.add_column(no_wrap=True)
    table.add_column()
    for name, value in solution.rows():
        good = int(solution.status) == Status.OK
        table.add_row(name, value, style="bold" if name == "status" and not good else None)
    rule = nearest_rule(solution) if int(solution.status) == Status.OK else None
    if rule is not None:
        table.add_row("least margin of a rule", f"{rule[0]}: {rule[1]}")
    scene = solution.scene
    if given_pressure and isinstance(scene, pneunet.Grasp) and int(solution.status) == Status.OK:
        heaviest = pneunet.largest_mass(scene, solution.pressure)
        table.add_row("largest mass", in_units(heaviest, "mass"))
    if int(solution.status) == Status.BEYOND_LIMIT:
        table.add_row("limit pressure", in_units(limit_pressure(solution.scene), "pressure"))
    console.print(table)
