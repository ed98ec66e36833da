"""design, calibrate, sweep, sensitivity, reproduce: runs that write a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from .app import NO_ANSWER, AsJson, app


@app.command()
def design(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [design].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
) -> None:
    """Search for a better design by gradient, from many starts at once.

    - softgrip design configs/shell_grasp.toml
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

    - softgrip calibrate configs/calibrate_shell.toml
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

    - softgrip sweep configs/shell_sweep.toml
    """
    from ..sweep import run_sweep

    run_sweep(config, out, Console())


@app.command()
def sensitivity(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
) -> None:
    """Say which numbers of a design matter for what: elasticities, and what manufacturing tolerances do.

    - softgrip sensitivity configs/shell_grasp.toml
    """
    from ..sensitivity import run_sensitivity

    run_sensitivity(config, out, Console())


@app.command()
def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Recompute every number and trend of the thesis beside what it prints; a few minutes, less the second time.

    Exit code 1 where a number differs and nobody knows why. Ctrl-C keeps what is done until then.

    - softgrip reproduce --out reproduction
    """
    from ..reproduce import run_reproduce

    if run_reproduce(out, Console(), as_json):
        raise typer.Exit(NO_ANSWER)
