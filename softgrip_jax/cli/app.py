"""The command and what all of its parts share, exit codes among it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

NO_ANSWER, MISTAKE, FAULT, STOPPED = 1, 2, 70, 130

app = typer.Typer(
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="""Models of pneumatic soft grippers that can be differentiated, and their design by gradient.

Begin with a config of your own and ask it something; what design and sweep need stands at its end, in comments:

- softgrip new shell.Grasp mine.toml
- softgrip solve mine.toml --plot mine.png
- softgrip path mine.toml --plot curve.png --csv curve.csv
- softgrip design mine.toml

softgrip COMMAND --help tells more, with examples; softgrip --install-completion lets the shell complete.
Exit codes: 0 done, 1 there is no answer, 2 a mistake in what was typed or in a file, 70 a fault of
softgrip itself, 130 stopped by Ctrl-C.""",
)

ConfigFile = Annotated[Path, typer.Argument(help="A TOML file with a [scene]; softgrip new writes one.")]
SceneName = Annotated[str | None, typer.Option(help="Which of several scenes, by its name in the config.")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes on this machine that compute.")]
Scheduler = Annotated[str | None, typer.Option(help="A running Dask scheduler whose workers compute: tls://host:8786.")]
Insecure = Annotated[bool, typer.Option(help="Allow tcp:// to a scheduler on another machine.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON in SI units and nothing else.")]


def _print_version(wanted: bool) -> bool:
    if wanted:
        from .._version import __version__

        typer.echo(__version__)
        raise typer.Exit
    return wanted


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", is_eager=True, callback=_print_version)
    ] = False,
    profile: Annotated[bool, typer.Option("--profile", help="Say at the end where the time went.")] = False,
) -> None:
    pass  # of the profile `run` takes care: it begins before typer is asked
