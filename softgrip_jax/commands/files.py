"""What commands share: which scene is meant, and how files and folders that were written are told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from ..errors import ConfigError
from ..folders import why_unwritable


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


def require_picture(scene: Any, option: str) -> None:
    """A ConfigError where nothing is drawn of a kind of scene: before it is solved."""
    from ..plots import has_picture

    if not has_picture(scene):
        raise ConfigError(f"{option}: there is no picture of a {type(scene).__name__} yet.")


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


def tell_file(what: str, path: Path, as_json: bool) -> None:
    """Name a file that was written; where programs read the output, not there."""
    typer.echo(f"{what} is in {path}.", err=as_json)


def console_for(as_json: bool) -> Console:
    """Where a run talks to people: not where programs read."""
    return Console(stderr=as_json)


def tell_folder(as_json: bool, folder: Path, found: dict[str, Any] | None = None) -> None:
    """The result.json of a run's folder, or what was found instead, with the name of the folder."""
    if as_json:
        if found is None:
            text = (folder / "result.json").read_text(encoding="utf-8")
            found = dict(json.loads(text, parse_constant=lambda _: None))
        typer.echo(json.dumps({"folder": str(folder)} | found, indent=2, allow_nan=False))


def plain(value: Any) -> Any:
    """A number, or lists of numbers, as JSON has them: null for what is not finite."""
    import numpy as np

    array = np.asarray(value)
    if array.ndim:
        return [plain(v) for v in array]
    return float(array) if np.isfinite(array) else None
