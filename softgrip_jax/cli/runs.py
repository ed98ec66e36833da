"""design, calibrate, sweep, sensitivity, reproduce: runs that write a folder."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from .app import NO_ANSWER, AsJson, app


def _console(as_json: bool) -> Console:
    """Where a run talks to people: not where programs read."""
    return Console(stderr=as_json)


def _tell(as_json: bool, folder: Path, found: dict[str, Any] | None = None) -> None:
    """The result.json of a run's folder, or what was found instead, with the name of the folder."""
    if as_json:
        if found is None:
            text = (folder / "result.json").read_text(encoding="utf-8")
            found = dict(json.loads(text, parse_constant=lambda _: None))
        typer.echo(json.dumps({"folder": str(folder)} | found, indent=2, allow_nan=False))


def _plain(value: Any) -> float | None:
    """A number as JSON has it."""
    from math import isfinite

    return float(value) if isfinite(value) else None


@app.command()
def design(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [design].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Search for a better design by gradient, from many starts at once.

    Exit code 1 where no design that keeps every constraint is found.

    - softgrip design configs/shell_grasp.toml
    """
    # optim stands above this package: this is the one place that looks up to it.
    from optim.design.run import run_design

    folder = run_design(config, out, _console(as_json))
    _tell(as_json, folder)
    found = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if not found.get("best", {"feasible": True})["feasible"]:
        raise typer.Exit(NO_ANSWER)


@app.command()
def calibrate(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [calibrate], or with a [tension].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit mu, or any other numbers, to measured curves; or materials to a tension test.

    - softgrip calibrate configs/calibrate_shell.toml
    """
    from optim.calibration.run import run_calibrate

    _tell(as_json, run_calibrate(config, out, _console(as_json)))


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
    from ..sweep import run_sweep

    folder, reasons = run_sweep(config, out, _console(as_json))
    if as_json:
        _tell(as_json, folder, {"quantities": _spread(folder)})
    for sentence in reasons:
        print(sentence, file=sys.stderr)
    if reasons:
        raise typer.Exit(NO_ANSWER)


def _spread(folder: Path) -> dict[str, Any]:
    """How far the quantities of a study spread, in SI."""
    import numpy as np

    from ..study import load_study

    found: dict[str, Any] = {}
    with load_study(folder) as data:
        for name, values in data.data_vars.items():
            if "status" in values.attrs:
                known = np.asarray(values)[np.isfinite(values)]
                ends = [known.min(), np.median(known), known.max()] if known.size else [np.nan] * 3
                found[str(name)] = {"unit": values.attrs["units"], "answered": int(known.size)}
                found[str(name)] |= dict(zip(("least", "median", "most"), map(_plain, ends), strict=True))
    return found


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
    from ..sensitivity import run_sensitivity

    folder = run_sensitivity(config, out, _console(as_json))
    if not as_json:
        return
    import xarray as xr

    found: dict[str, Any] = {}
    with xr.open_dataset(folder / "sensitivity.nc", engine="h5netcdf") as data:
        for one in map(str, data["quantity"].values):
            row = data.sel(quantity=one)
            slopes = zip(map(str, row["by"].values), map(_plain, row["elasticity"].values), strict=True)
            unit = str(row["unit"].values)
            found[one] = {"value": _plain(row["value"]), "unit": unit, "elasticity": dict(slopes)}
    _tell(as_json, folder, {"quantities": found})


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

    if run_reproduce(out, _console(as_json), as_json):
        raise typer.Exit(NO_ANSWER)
