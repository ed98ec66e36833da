"""The command and what all of its parts share: exit codes and pictures."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import ConfigError
from ..folders import why_unwritable

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
) -> None:
    pass


def one_scene(config: Path, scene: str | None) -> Any:
    """The config with the one scene that is meant."""
    from .. import config as configs

    read = configs.load(config)
    if scene is not None:
        if scene not in read.scenes:
            raise ConfigError(f"--scene is {scene!r}; {config} has {', '.join(read.scenes)}.")
        return configs.Config(read.path, {scene: read.scenes[scene]}, read.tables)
    if len(read.scenes) > 1:
        raise ConfigError(f"{config} has several scenes; say which with --scene, one of {', '.join(read.scenes)}.")
    return read


def check_file(path: Path, option: str, endings: tuple[str, ...]) -> None:
    """A ConfigError where a file of these kinds cannot be written."""
    if path.suffix.lower() not in endings:
        words = " or ".join(filter(None, [", ".join(endings[:-1]), endings[-1]]))
        raise ConfigError(f"{option} is {str(path)!r}; it must be a file that ends in {words}.")
    why = "that is a folder" if path.is_dir() else ""
    if not path.parent.is_dir():
        why = f"there is no folder {path.parent}"
    why = why or why_unwritable(path.parent)
    if why:
        raise ConfigError(f"{option} is {str(path)!r}; a file cannot be written there: {why}.")


PICTURES = (".png", ".pdf", ".svg")


def write_file(path: Path, write: Callable[[Path], Any]) -> None:
    """Complete or not there at all: a file that was stopped half way never has the wanted name.

    ConfigError with the name of the file itself where it cannot be written.
    """
    unfinished = path.with_name(f".{uuid.uuid4().hex}{path.suffix}")
    try:
        write(unfinished)
        unfinished.replace(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ConfigError(f"{path} cannot be written: {reason}.") from None
    finally:
        unfinished.unlink(missing_ok=True)


def tell_file(what: str, path: Path, as_json: bool) -> None:
    """Name a file that was written; where programs read the output, not there."""
    typer.echo(f"{what} is in {path}.", err=as_json)
