"""report: a run as a page, and two runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .app import app


@app.command()
def report(
    first: Annotated[Path, typer.Argument(help="The folder of a run.")],
    second: Annotated[Path | None, typer.Argument(help="The folder of another.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where the comparison goes, a file that ends in .html.")] = None,
) -> None:
    """Compare two runs on one page: inputs that differ, results side by side. Of one run, write its report.html again.

    - softgrip report runs/finger_tip_force-001 runs/finger_tip_force-002
    """
    from ..commands.report import run_report

    run_report(first, second, out)
