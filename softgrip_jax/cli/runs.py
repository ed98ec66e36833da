"""sweep, summary, sensitivity, reproduce: runs that write a folder."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..commands.files import console_for, tell_folder
from .app import NO_ANSWER, AsJson, Insecure, SceneName, Scheduler, Workers, app


@app.command()
def sweep(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [sweep].")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; a study that was stopped there goes on.")
    ] = None,
    to: Annotated[
        str | None, typer.Option(help="Where the store goes: a path that ends in .zarr, or an address (s3://...).")
    ] = None,
    table: Annotated[bool, typer.Option("--csv", help="Write study.csv too, from the store.")] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Solve many designs: a grid, a Latin hypercube, a Sobol set, or a CSV file of them.

    A study that was stopped, even killed, goes on with the same --out or --to. Exit code 1 where no design has an
    answer. --workers and --scheduler need pip install softgrip_jax[cluster].

    - softgrip sweep configs/shell_sweep.toml

    - softgrip sweep configs/finger_sweep.toml --workers 8
    """
    from ..commands.sweep import Where, run_sweep

    where = Where(out, to, table, workers, scheduler, insecure)
    found, reasons = run_sweep(config, where, console_for(as_json))
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))
    for sentence in reasons:
        print(sentence, file=sys.stderr)
    if reasons:
        raise typer.Exit(NO_ANSWER)


@app.command()
def summary(
    study: Annotated[str, typer.Argument(help="A folder of softgrip sweep, its store, or the address of one.")],
    best: Annotated[str | None, typer.Option(help="A column of study.csv: its least values are best.")] = None,
    most: Annotated[bool, typer.Option("--most", help="With --best: the largest values are best.")] = False,
    where: Annotated[
        list[str] | None, typer.Option(help="What the best must keep: 'shell.a_mm < 16'; may be given several times.")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, max=100_000, help="How many of the best; 10 by default.")] = None,
    plot: Annotated[Path | None, typer.Option(help="A picture of designs: .png, .pdf or .svg.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a study comes to, whatever its size: statuses, reasons, quantiles, and the best designs.

    Exit code 1 where no design may be the best.

    - softgrip summary runs/shell_sweep-001 --best pressure_at_required_kPa --where "limit_margin_at_required >= 2"
    """
    from ..commands.summary import run_summary

    found = run_summary(study, best, most, where or [], count, plot, as_json, console_for(as_json))
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))
    if best is not None and not found["best"]:
        raise typer.Exit(NO_ANSWER)


@app.command()
def sensitivity(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene].")],
    scene: SceneName = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say which numbers of a design matter for what: elasticities, and what manufacturing tolerances do.

    Exit code 1 where no quantity has a value. Of several scenes --scene names one; without it [sensitivity] names the
    scenes of its numbers and observables.

    - softgrip sensitivity configs/shell_grasp.toml

    - softgrip sensitivity configs/shell_tolerances.toml
    """
    from ..commands.sensitivity import as_data, run_sensitivity

    folder, answered = run_sensitivity(config, out, console_for(as_json), scene)
    if as_json:
        tell_folder(as_json, folder, as_data(folder))
    if not answered:
        raise typer.Exit(NO_ANSWER)


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
