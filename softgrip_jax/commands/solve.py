"""`softgrip solve CONFIG.toml`: one scene at one state.

Reads the scene of a config and what [solve] asks; prints the state, for people or as JSON, and writes a picture.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from ..errors import CellRangeWarning, ConfigError, located
from ..folders import write_whole
from .asked import solving
from .files import PICTURES, check_file, one_scene, plain, require_picture, tell_file
from .programs import kept

if TYPE_CHECKING:
    from ..results import Solution


def run_solve(
    config: Path,
    pressure_kpa: float | None,
    scene: str | None,
    as_json: bool,
    plot: Path | None,
    tolerance: str | None,
    observable: str | None,
) -> bool:
    """Solve the scene of a config and report; returns whether there is an answer. The arguments are the options."""
    from .. import config as configs
    from ..fidelity import against_elements, choose
    from ..model_error import model_error, of_material, of_shell
    from ..pneunet.drives import with_other_drive

    if plot is not None:
        check_file(plot, "--plot", PICTURES)
    if observable is not None and tolerance is None:
        raise ConfigError("--observable says whose error --tolerance is about; give --tolerance too.")
    allowed = _share(tolerance) if tolerance is not None else None
    read = one_scene(config, scene)
    if plot is not None:
        require_picture(read.scene, "--plot")
    if pressure_kpa is None:
        asked = configs.question(read)
    else:
        asked = {"pressure": configs.read_numbers(pressure_kpa, "--pressure-kPa", "nonnegative", "pressure", [""])}
    choice, given = None, read.scene
    # A scene itself may not take what is asked as a question.
    with Console(stderr=True).status("solving"), located(f"{config}, [solve]"):
        if allowed is not None:
            choice = choose(read.scene, tolerance=allowed, observable=observable, **asked)
            # What was chosen for a tolerance holds for the drive that was asked for: the other one is as it stands.
            if hasattr(given, "drive"):
                given = dataclasses.replace(given, drive=choice.solution.scene.drive)
        solved = solving(read.scene, asked) if choice is None else partial(getattr, choice, "solution")
        other = with_other_drive(given)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CellRangeWarning)  # said in words of our own
            other_solved = solving(other, asked) if other is not None else None
        solution = solved()
    verified = against_elements(solution.scene, solution.pressure) if int(solution.status) == 0 else {}
    if not as_json:
        report(solution, Console(), "pressure" in asked)
        if choice is not None:
            typer.echo(choice)
        for name, near in verified.items() if choice is None else ():
            typer.echo(f"{name.replace('_', ' ')}: {near}")
        if choice is None and int(solution.status) == 0:
            for sentence in of_shell(given, [name for name in _told(given, asked) if name not in verified]):
                Console().print(sentence, soft_wrap=True, markup=False)
        for name, words in of_material(solution).items():
            Console().print(f"{name}: {words}.", soft_wrap=True, markup=False)
    beside = None
    if other is not None and other_solved is not None and int(solution.status) == 0:
        with Console(stderr=True).status(f'solving with the drive "{other.drive}", too'):
            beside = other_solved()
    if as_json:
        chosen = {"fidelity": choice.as_data()} if choice is not None else {}
        if verified:
            chosen |= {"verified": {name: near.as_data() for name, near in verified.items()}}
        known = {name: model_error(given, name) for name in _told(given, asked)} if int(solution.status) == 0 else {}
        known |= of_material(solution)
        if any(known.values()):
            chosen |= {"model_error": {name: words for name, words in known.items() if words}}
        if beside is not None:
            chosen |= {"other_drive": {"drive": beside.scene.drive} | as_data(beside)}
        typer.echo(json.dumps(as_data(solution) | chosen, indent=2, allow_nan=False))
    elif beside is not None:
        report_drives(solution, beside, Console())
    if int(solution.status) != 0:
        if plot is not None:
            print("No picture: there is no state to draw.", file=sys.stderr)
        return False
    if plot is not None:
        from ..plots import draw

        write_whole(plot, draw(solution).savefig)
        tell_file("The picture", plot, as_json)
    return True


def _told(scene: Any, asked: Mapping[str, Any]) -> list[str]:
    """The numbers of a solution that a model finds: a pressure that the scene requires, too."""
    return [*scene.prepared().OBSERVABLES, *([] if asked else ["pressure"])]


def _share(text: str) -> float:
    """'1%' or '0.01' as a number."""
    import math

    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = math.nan
    if not 0 < share < 1:
        raise ConfigError(f"--tolerance is {text!r}; it must be between 0 and 100 %, for instance 1% or 0.01.")
    return share


def as_data(solution: Solution) -> dict[str, Any]:
    """A solution as plain data in SI; what is not a finite number is None."""
    from ..config.modules import type_name
    from ..results import Status
    from ..units import SI

    status = Status(int(solution.status))
    kinds = type(solution.scene).OBSERVABLES
    return {
        "scene": type_name(type(solution.scene)),
        "status": status.name,
        "message": status.message,
        "reason": solution.reason_text(),
        "margins": {name: plain(margin) for name, margin in solution.margins.items()},
        "pressure": plain(solution.pressure),
        "residual": plain(solution.residual),
        "iterations": int(solution.iterations),
        "observables": {name: plain(solution.observables[name]) for name in kinds},
        "units": {"pressure": SI["pressure"]} | {name: SI[kind] for name, kind in kinds.items()},
    }


def nearest_rule(solution: Solution) -> tuple[str, str] | None:
    """(rule, margin) of the one that is nearest to being broken, or broken by most where that is ignored."""
    from ..reasons import BROKEN, Reason
    from ..results import in_units

    known = {
        name: float(margin)
        for name, margin in solution.margins.items()
        if float(margin) == float(margin) and Reason[name.upper()].forbids
    }
    if not known:
        return None
    name = min(known, key=lambda name: known[name])
    words = "" if known[name] >= -BROKEN else " (broken, and ignored)"
    return name, f"{in_units(known[name], 'length')}{words}"


def report(solution: Solution, console: Console, given_pressure: bool = True) -> None:
    """The state as a table for people; at a given pressure with what a gripper could hold at most."""
    from ..config.modules import type_name
    from ..pneunet.grasp import Grasp, heaviest_held
    from ..questions import pressure_at_limit, to_limit
    from ..results import Status, in_units
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
    if given_pressure and isinstance(scene, Grasp) and int(solution.status) == Status.OK:
        heaviest = kept(heaviest_held, scene, solution.pressure)
        table.add_row("largest mass", in_units(heaviest, "mass"))
    if int(solution.status) == Status.BEYOND_LIMIT:
        table.add_row("limit pressure", in_units(kept(pressure_at_limit, to_limit(scene)), "pressure"))
    console.print(table)
    for sentence in ranges_left(solution.margins):
        console.print(sentence, soft_wrap=True, markup=False)


def ranges_left(margins: Mapping[str, Any]) -> list[str]:
    """A sentence for every range that is left by margins (m) of a state, or of parts at rest; but for that of the cell
    law, which `pneunet.drives.remarks` tells with the dimension."""
    from ..reasons import BROKEN, Reason

    said = []
    for name, margin in margins.items():
        if name != "cell_law_range" and not Reason[name.upper()].forbids and float(margin) < -BROKEN:
            sentence = Reason[name.upper()].text(float(margin))
            said.append(f"{sentence[0].upper()}{sentence[1:]}.")
    return said


def report_drives(solution: Solution, beside: Solution, console: Console) -> None:
    """A finger's state by both of its drives, side by side, and what people must know about that."""
    from ..pneunet.drives import remarks
    from ..results import Status
    from ..tables import Table

    table = Table(title="by both drives of the finger", title_justify="left")
    columns = [{name: value for name, value in one.rows() if value != "-"} for one in (solution, beside)]
    table.add_column("", no_wrap=True)
    for one in (solution, beside):
        table.add_column(one.scene.drive, justify="right")
    for name in columns[0]:
        if name not in ("status", "scaled residual"):
            table.add_row(name, *(column.get(name, "-") for column in columns))
    console.print(table)
    if int(beside.status) != Status.OK:
        console.print(f'With the drive "{beside.scene.drive}": {beside.reason_text()}.', soft_wrap=True, markup=False)
    for sentence in remarks(solution.scene):
        console.print(sentence, soft_wrap=True, markup=False)
