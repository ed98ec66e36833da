"""`softgrip new TYPE FILE.toml`: a commented config for any scene, or the list of all scenes."""

from __future__ import annotations

import shlex
from pathlib import Path

import typer
from rich.console import Console

from ..config.modules import classes_of
from ..config.template import starter
from ..errors import ConfigError
from ..folders import write_whole
from ..scene import Scene
from ..tables import Table
from .files import check_file


def run_new(kind: str | None, file: Path | None) -> None:
    """Print the list of scenes, print a config, or write it, as the options say."""
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
    write_whole(file, text.encode())
    typer.echo(f"The config is in {file}. Next: {shlex.join(['softgrip', 'solve', str(file)])}")
