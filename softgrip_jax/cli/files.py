"""new, schema: configs to begin with, and help for editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .app import app


@app.command()
def new(
    kind: Annotated[
        str | None, typer.Argument(metavar="[TYPE]", help="Type of the scene; without it, all are listed.")
    ] = None,
    file: Annotated[Path | None, typer.Argument(help="Where to write the config; without it, it is printed.")] = None,
) -> None:
    """Write a commented config for any scene, to be changed and solved.

    - softgrip new

    - softgrip new shell.Grasp mine.toml

    - softgrip solve mine.toml --plot mine.png
    """
    from ..commands.new import run_new

    run_new(kind, file)


@app.command()
def schema() -> None:
    """Print the JSON schema of the configs, by which editors complete and check them.

    - softgrip schema > softgrip.schema.json

    Editors with the Taplo language server (VS Code: Even Better TOML) take it from the first line of a config,
    `#:schema ./softgrip.schema.json`.
    """
    from ..commands.schema import schema_text

    typer.echo(schema_text())
