"""The command `softgrip`: thin, everything it does is in the other rooms.

Exit codes: 0, done; 1, the question has no answer (the report says why); 2, a mistake in what was typed or in a file,
told in one sentence on stderr; 130, stopped by Ctrl-C.

The rooms are imported inside the commands, so that `softgrip --help` answers at once.
"""

from __future__ import annotations

import json
import os
import sys
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console

from .errors import ConfigError

if TYPE_CHECKING:
    from .results import Solution

NO_ANSWER, MISTAKE, STOPPED = 1, 2, 130

app = typer.Typer(
    add_completion=True,
    pretty_exceptions_enable=False,
    help="Models of pneumatic soft grippers that can be differentiated, and their design by gradient.",
)


def _print_version(wanted: bool) -> bool:
    if wanted:
        from ._version import __version__

        typer.echo(__version__)
        raise typer.Exit
    return wanted


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    pass


@app.command()
def solve(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene].")],
    pressure_kpa: Annotated[
        float | None, typer.Option("--pressure-kPa", help="Solve at this pressure, whatever [solve] asks.")
    ] = None,
    scene: Annotated[str | None, typer.Option(help="Which of several scenes, by its name in the config.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON in SI units and nothing else.")] = False,
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

        softgrip solve configs/shell_cylinder.toml --plot cylinder.png
        softgrip solve configs/finger_tip_contact.toml --tolerance 1%
    """
    from . import config as configs
    from .fidelity import choose
    from .scene import pressure_for
    from .scene import solve as solve_scene

    if plot is not None:
        _check_picture(plot)
    if observable is not None and tolerance is None:
        raise ConfigError("--observable says whose error --tolerance is about; give --tolerance too.")
    allowed = _share(tolerance) if tolerance is not None else None
    read = configs.load(config)
    if scene is not None:
        if scene not in read.scenes:
            raise ConfigError(f"--scene is {scene!r}; {config} has {', '.join(read.scenes)}.")
        read = configs.Config(read.path, {scene: read.scenes[scene]}, read.tables)
    elif len(read.scenes) > 1:
        raise ConfigError(f"{config} has several scenes; say which with --scene, one of {', '.join(read.scenes)}.")
    if pressure_kpa is None:
        asked = configs.question(read)
    else:
        asked = {"pressure": configs.read_numbers(pressure_kpa, "--pressure-kPa", "nonnegative", "pressure", [""])}
    choice = None
    with Console(stderr=True).status("solving"):
        try:
            if allowed is not None:
                choice = choose(read.scene, tolerance=allowed, observable=observable, **asked)
                solution = choice.solution
            else:
                solution = (solve_scene if "pressure" in asked else pressure_for)(read.scene, **asked)
        except ValueError as error:  # what the scene itself cannot take as a question
            raise ConfigError(f"{config}, [solve]: {error}") from None
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
        _draw(solution, plot)


@app.command()
def design(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [design].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
) -> None:
    """Search for a better design by gradient, from many starts at once.

    softgrip design configs/shell_grasp.toml
    """
    # optim stands above this package: this is the one place that looks up to it.
    from optim.run import run_design

    run_design(config, out, Console())


@app.command()
def calibrate(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [calibrate], or with a [tension].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
) -> None:
    """Fit mu, or any other numbers, to measured curves; or materials to a tension test.

    softgrip calibrate configs/calibrate_shell.toml
    """
    from optim.calibrate_run import run_calibrate

    run_calibrate(config, out, Console())


@app.command()
def sweep(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [sweep].")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; a study that was stopped there goes on.")
    ] = None,
) -> None:
    """Solve many designs: a grid, a Latin hypercube, a Sobol set, or a CSV file of them.

    A study that was stopped, even killed, goes on with the same --out.

        softgrip sweep configs/shell_sweep.toml
    """
    from .sweep import run_sweep

    run_sweep(config, out, Console())


@app.command()
def sensitivity(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
) -> None:
    """Say which numbers of a design matter for what: elasticities, and what manufacturing tolerances do.

    softgrip sensitivity configs/shell_grasp.toml
    """
    from .sensitivity import run_sensitivity

    run_sensitivity(config, out, Console())


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


def as_data(solution: Solution) -> dict[str, Any]:
    """A solution as plain data in SI; what is not a finite number is None."""
    from .config import type_name
    from .results import Status
    from .units import SI

    status = Status(int(solution.status))
    kinds = type(solution.scene).OBSERVABLES
    return {
        "scene": type_name(type(solution.scene)),
        "status": status.name,
        "message": status.message,
        "pressure": _plain(solution.pressure),
        "residual": _plain(solution.residual),
        "iterations": int(solution.iterations),
        "observables": {name: _plain(solution.observables[name]) for name in kinds},
        "units": {"pressure": SI["pressure"]} | {name: SI[kind] for name, kind in kinds.items()},
    }


def _plain(value: Any) -> Any:
    import numpy as np

    array = np.asarray(value)
    if array.ndim:
        return [_plain(v) for v in array]
    return float(array) if np.isfinite(array) else None


def report(solution: Solution, console: Console, given_pressure: bool = True) -> None:
    """The state as a table for people; at a given pressure with what a gripper could hold at most."""
    from rich.table import Table

    from . import pneunet
    from .config import type_name
    from .results import Status, in_units
    from .scene import limit_pressure

    table = Table(title=type_name(type(solution.scene)), show_header=False, title_justify="left")
    table.add_column(no_wrap=True)
    table.add_column()
    for name, value in solution.rows():
        good = int(solution.status) == Status.OK
        table.add_row(name, value, style="bold" if name == "status" and not good else None)
    scene = solution.scene
    if given_pressure and isinstance(scene, pneunet.Grasp) and int(solution.status) == Status.OK:
        heaviest = pneunet.largest_mass(scene, solution.pressure)
        table.add_row("largest mass", in_units(heaviest, "mass"))
    if int(solution.status) == Status.BEYOND_LIMIT:
        table.add_row("limit pressure", in_units(limit_pressure(solution.scene), "pressure"))
    console.print(table)


def _check_picture(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise ConfigError(f"--plot is {str(path)!r}; it must be a file that ends in .png, .pdf or .svg.")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise ConfigError(f"--plot is {str(path)!r}; a file cannot be written there.")


def _draw(solution: Solution, path: Path) -> None:
    from .plots import draw

    # Complete or not there at all: a picture that was stopped half way never has the wanted name.
    unfinished = path.with_name(f".{uuid.uuid4().hex}{path.suffix}")
    try:
        draw(solution).savefig(unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def run(arguments: Sequence[str]) -> int:
    """The command with these arguments; returns the exit code."""
    # Every mistake in what was typed is a subclass of typer's own, which has no public name.
    usage_error: Any = typer.BadParameter.__mro__[1]
    try:
        return app(args=list(arguments) or ["--help"], prog_name="softgrip", standalone_mode=False) or 0
    except usage_error as error:
        command = error.ctx.command_path if error.ctx else "softgrip"
        message = f"{error.format_message().rstrip('.')}; see {command} --help."
    except (ConfigError, OSError) as error:
        message = str(error)
    except (KeyboardInterrupt, typer.Abort):
        print("stopped.", file=sys.stderr)
        return STOPPED
    print(" ".join(message.split()), file=sys.stderr)
    return MISTAKE


def _keep_compiled_programs() -> None:
    """Let JAX keep what it compiles, so that the second run of a command does not compile again."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "softgrip_jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    # XLA calls two of its own settings (prefer-no-gather, prefer-no-scatter) CPU features that the machine lacks, in
    # long lines on stderr, for every program that it takes from the cache; nothing is wrong.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def main() -> NoReturn:
    """Entry point of the console script."""
    _keep_compiled_programs()
    sys.exit(run(sys.argv[1:]))
