"""sweep, sensitivity, reproduce: runs that write a folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..commands.files import console_for, tell_folder
from .app import NO_ANSWER, AsJson, app


@app.command()
def sweep(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [sweep].")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; a study that was stopped there goes on.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Solve many designs: a grid, a Latin hypercube, a Sobol set, or a CSV file of them.

    A study that was stopped, even killed, goes on with the same --out. Exit code 1 where no design has an answer.

    - softgrip sweep configs/shell_sweep.toml
    """
    from ..commands.sweep import run_sweep, spread

    folder, reasons = run_sweep(config, out, console_for(as_json))
    if as_json:
        tell_folder(as_json, folder, {"quantities": spread(folder)})
    for sentence in reasons:
        print(sentence, file=sys.stderr)
    if reasons:
        raise typer.Exit(NO_ANSWER)


@app.command()
def sensitivity(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say which numbers of a design matter for what: elasticities, and what manufacturing tolerances do.

    - softgrip sensitivity configs/shell_grasp.toml

    - softgrip sensitivity configs/shell_tolerances.toml
    """
    from ..commands.sensitivity import as_data, run_sensitivity

    folder = run_sensitivity(config, out, console_for(as_json))
    if as_json:
        tell_folder(as_json, folder, {"quantities": as_data(folder)})


@app.command()
def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Recompute every number and trend of the thesis beside what it prints; a few minutes, less the second time.

    Exit code 1 where a number differs and nobody knows why. Ctrl-C keeps what is done until then.

    - softgrip reproduce --out reproduction
    """
    from ..commands.reproduce import run_reproduce

    if run_reproduce(out, console_for(as_json), as_json):
        raise typer.Exit(NO_ANSWER)
