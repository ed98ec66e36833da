"""verify: finite elements of a scene beside our models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..commands.files import console_for
from .app import AsJson, ConfigFile, SceneName, app


@app.command()
def verify(
    config: ConfigFile,
    pressure_kpa: Annotated[
        float | None, typer.Option("--pressure-kPa", help="Verify up to this pressure, whatever [solve] asks.")
    ] = None,
    scene: SceneName = None,
    fine: Annotated[bool, typer.Option("--fine", help="A third, finer mesh; some minutes instead of one.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; it must not exist yet.")] = None,
    keep: Annotated[
        Path | None,
        typer.Option(help="Folder of verifications for designs nearby; by default ./verified."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare our models of this design with finite elements of it: a table, a picture, and the models' errors.

    The mesh error comes from two meshes, with --fine from the finer two of three. Ctrl-C keeps what is there. Needs
    pip install "softgrip_jax[verify]".

    - softgrip verify configs/shell_free.toml

    - softgrip verify configs/shell_flat.toml --pressure-kPa 10 --fine
    """
    from ..commands.verify import run_verify

    run_verify(config, pressure_kpa, scene, fine, out, keep, as_json, console_for(as_json))
