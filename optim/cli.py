"""The commands that `optim` adds. pyproject.toml names them as entry points: so `softgrip` finds them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from softgrip_jax.cli.app import NO_ANSWER, AsJson, Insecure, Scheduler, Workers
from softgrip_jax.commands.files import console_for, tell_folder


def design(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [design].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Search for a better design by gradient, from many starts at once.

    Exit code 1 where no design keeps every constraint, none is robust, or its parts do not keep what was promised.
    --workers and --scheduler need pip install softgrip_jax[cluster]; the answer is the same without them.

    - softgrip design configs/shell_grasp.toml
    """
    from softgrip_jax.spread import spread_over

    from .design.run import run_design

    with spread_over(workers, scheduler, insecure) as spread:
        folder = run_design(config, out, console_for(as_json), spread)
    tell_folder(as_json, folder)
    _require_design(folder)


def _require_design(folder: Path) -> None:
    """The exit code of a question without an answer where a search found no design that keeps what was asked."""
    found = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    is_robust = "no_robust_design" not in found and found.get("robust", {}).get("promise_holds", True)
    if not (found.get("best", {"feasible": True})["feasible"] and is_robust):
        raise typer.Exit(NO_ANSWER)


def calibrate(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [calibrate], or with a [tension].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    insecure: Insecure = False,
    posterior: Annotated[
        bool, typer.Option("--posterior", help="Sample the posterior too, as [calibrate.posterior] says or by default.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Fit mu, or any other numbers, to measured curves; or materials to a tension test.

    With --posterior the draws of NUTS are kept as posterior.nc, for `softgrip solve --posterior` and for the section
    [design.uncertain] of a search; of a tension test every material gets its leave-one-out score. It needs
    pip install softgrip_jax[bayes].

    --workers and --scheduler spread the fits of a bootstrap; they need pip install softgrip_jax[cluster].

    - softgrip calibrate configs/calibrate_shell.toml

    - softgrip calibrate configs/calibrate_shell.toml --posterior
    """
    from softgrip_jax.spread import spread_over

    from .calibration.run import run_calibrate

    with spread_over(workers, scheduler, insecure) as spread:
        tell_folder(as_json, run_calibrate(config, out, console_for(as_json), spread, posterior))


def evidence(
    runs: Annotated[list[Path], typer.Argument(help="Folders of calibrations with a posterior, or their files.")],
    as_json: AsJson = False,
) -> None:
    """Compare models that were calibrated to the same data: which predicts each point best from the others.

    Every run needs a posterior: softgrip calibrate CONFIG --posterior.

    - softgrip evidence runs/neo_hookean-001 runs/gent-001
    """
    from .posterior.compare import run_evidence

    found = run_evidence(runs, as_json, console_for(as_json))
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))


def plan(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [plan].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say which measurements tell most about some numbers, or about a decision, before any of them is made.

    - softgrip plan configs/plan_shell.toml
    """
    from .plan.run import run_plan

    tell_folder(as_json, run_plan(config, out, console_for(as_json)))


def measure(
    config: Annotated[Path, typer.Argument(help="The config of the design that was cast.")],
    measured: Annotated[Path, typer.Argument(help="A TOML file with readings, masses and curves of the parts.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    search: Annotated[bool, typer.Option("--search", help="Search again from the design as it was built.")] = False,
    as_json: AsJson = False,
) -> None:
    """Update a design by what was measured of its parts: dimensions as built with intervals, moduli from first curves.

    Exit code of --search as of `softgrip design`.

    - softgrip measure configs/shell_cast.toml configs/data/shell_cast_measured.toml
    """
    from .asbuilt.run import run_measure

    folder = run_measure(config, measured, out, console_for(as_json), search)
    tell_folder(as_json, folder)
    if search:
        _require_design(folder / "search")
