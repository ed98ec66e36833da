"""export: a design as solids and moulds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..commands.files import console_for
from .app import NO_ANSWER, AsJson, ConfigFile, SceneName, app


@app.command()
def export(
    config: ConfigFile,
    step: Annotated[bool, typer.Option("--step", help="Write STEP files; without --step and --stl, both.")] = False,
    stl: Annotated[bool, typer.Option("--stl", help="Write STL files, and plates for the printer as 3MF.")] = False,
    mould: Annotated[bool, typer.Option("--mould", help="Write the moulds, too.")] = False,
    fe: Annotated[
        str | None,
        typer.Option("--fe", help="Write an input deck of finite elements instead: abaqus, calculix or febio."),
    ] = None,
    pressure_kpa: Annotated[
        float | None, typer.Option("--pressure-kPa", help="Pressure of the deck, whatever [solve] asks.")
    ] = None,
    scene: SceneName = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the files, or the deck's file; it must not exist yet.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the parts of a design and its moulds as solids, with a sheet for the bench; all of it is checked.

    The section [manufacture] of the config says what the physics does not know. Exit code 1 where a check fails; what
    cannot be cast is a mistake, told in one sentence. Needs pip install "softgrip_jax[cad]" (for --fe: [verify]).

    - softgrip export configs/shell_grasp.toml --step --stl --mould --out gripper

    - softgrip export configs/finger_free.toml --mould

    - softgrip export configs/shell_free.toml --fe calculix --out shell_free.inp
    """
    if fe is not None:
        from ..commands.verify import run_deck

        if step or stl or mould or as_json:
            raise typer.BadParameter("--fe writes a deck alone; leave out --step, --stl, --mould and --json.")
        run_deck(config, pressure_kpa, scene, fe, out)
        return
    if pressure_kpa is not None:
        raise typer.BadParameter("--pressure-kPa is for --fe; solids have no pressure.")
    from ..commands.export import run_export

    if not run_export(config, step, stl, mould, scene, out, console_for(as_json), as_json):
        raise typer.Exit(NO_ANSWER)
