"""`softgrip report A B`: two runs side by side; `softgrip report A`: the report of one run, written again."""

from __future__ import annotations

from pathlib import Path

import typer

from ..errors import ConfigError
from ..report.run import compare_runs, write_report
from .files import check_file, tell_file


def run_report(first: Path, second: Path | None, out: Path | None) -> None:
    """Write the page. The arguments are those of the command."""
    for folder in filter(None, (first, second)):
        if not folder.is_dir():
            raise ConfigError(f"{folder} is not a run: there is no such folder.")
    if second is None:
        if out is not None:
            raise ConfigError("--out is for two runs; the report of one goes into its folder.")
        typer.echo(f"The report is in {write_report(first)}.")
        return
    file = out or Path(f"{first.resolve().name}-{second.resolve().name}.html")
    check_file(file, "--out", (".html",))
    tell_file("The comparison", compare_runs(first, second, file), False)
