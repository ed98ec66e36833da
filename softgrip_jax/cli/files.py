"""new, schema: configs to begin with, and help for editors."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from ..errors import ConfigError
from ..tables import Table
from .app import app, check_file, write_file


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
    from ..config import classes_of
    from ..scene import Scene
    from ..starter import starter

    if kind is None:
        table = Table(show_header=False, box=None)
        for name, cls in classes_of((Scene,)).items():
            table.add_row(name, " ".join((cls.__doc__ or "").split("\n\n")[0].split()))
        Console().print(table)
        return
    text = starter(kind)
    if file is None:
        typer.echo(text, nl=False)
        return
    check_file(file, "FILE", (".toml",))
    if file.exists():
        raise ConfigError(f"{file} exists already; give another name.")
    write_file(file, lambda path: path.write_text(text, encoding="utf-8"))
    typer.echo(f"The config is in {file}. Next: {shlex.join(['softgrip', 'solve', str(file)])}")


@app.command()
def schema() -> None:
    """Print the JSON schema of the configs, by which editors complete and check them.

    - softgrip schema > softgrip.schema.json

    Editors with the Taplo language server (VS Code: Even Better TOML) take it from the first line of a config,
    `#:schema ./softgrip.schema.json`.
    """
    from optim.calibration.settings import CalibrateTable
    from optim.design.settings import DesignTable
    from optim.tension.run import TensionTable

    from ..schema import schema as described
    from ..sensitivity import SensitivityTable
    from ..sweep import SweepTable

    sections = {
        "design": DesignTable,
        "sweep": SweepTable,
        "sensitivity": SensitivityTable,
        "calibrate": CalibrateTable,
        "tension": TensionTable,
    }
    typer.echo(json.dumps(described(sections), indent=2))
