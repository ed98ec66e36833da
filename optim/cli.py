"""The commands design and calibrate. pyproject.toml names them as entry points, by which `softgrip` finds them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from softgrip_jax.cli.app import NO_ANSWER, AsJson
from softgrip_jax.commands.files import console_for, tell_folder


def design(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [design].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Search for a better design by gradient, from many starts at once.

    Exit code 1 where no design that keeps every constraint is found.

    - softgrip design configs/shell_grasp.toml
    """
    from .design.run import run_design

    folder = run_design(config, out, console_for(as_json))
    tell_folder(as_json, folder)
    found = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if not found.get("best", {"feasible": True})["feasible"]:
        raise typer.Exit(NO_ANSWER)


def calibrate(
    config: Annotated[Path, typer.Argument(help="A TOML file with a [scene] and a [calibrate], or with a [tension].")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit mu, or any other numbers, to measured curves; or materials to a tension test.

    - softgrip calibrate configs/calibrate_shell.toml
    """
    from .calibration.run import run_calibrate

    tell_folder(as_json, run_calibrate(config, out, console_for(as_json)))
