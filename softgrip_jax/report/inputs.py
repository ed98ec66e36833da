"""What a run was given, kept in its folder: the config, and the files of measured data or designs that it names."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import tomli_w

from .. import config as configs
from ..folders import write_whole

KEYS = ("file", "posterior")
"""Keys of configs whose words name files."""
MOVED = "data"
"""Where a file goes whose own name leads out of the folder, or is that of a file of the run."""


def named_files(value: Any, key: str = "") -> list[str]:
    """The files that a table names, each once."""
    if isinstance(value, dict):
        found = [name for own, one in value.items() for name in named_files(one, own)]
    elif isinstance(value, list):
        found = [name for one in value for name in named_files(one, key)]
    else:
        found = [value] if key in KEYS and isinstance(value, str) else []
    return list(dict.fromkeys(found))


def renamed(value: Any, names: dict[str, str], key: str = "") -> Any:
    """The same table with other names of files in it."""
    if isinstance(value, dict):
        return {own: renamed(one, names, own) for own, one in value.items()}
    if isinstance(value, list):
        return [renamed(one, names, key) for one in value]
    return names.get(value, value) if key in KEYS and isinstance(value, str) else value


def keep_inputs(folder: Path, config: Path, taken: Collection[str] = ()) -> None:
    """Write config.toml into the folder of a run, and the files that it names to where it then finds them.

    A file keeps its name, so that the config stays as it was given. One that lies outside the folder of the config, or
    has a name that is `taken` by a file of the run, goes to data/, and the config says so.
    """
    tables, names = configs.read_sections(config), {}
    files = [name for name in named_files(tables) if not Path(name).is_absolute()]
    used = {*taken, "config.toml", *files}
    for name in files:
        is_fit = ".." not in Path(name).parts and Path(name).as_posix() not in taken
        names[name] = name if is_fit else _free(Path(name), used)
        used.add(names[name])
    given = configs.standalone(config)
    if any(name != new for name, new in names.items()):
        text = f"# {config.name}, with the files that it names beside it.\n{tomli_w.dumps(renamed(tables, names))}"
        given = text.encode()
    contents = {new: (config.parent / name).read_bytes() for name, new in names.items()}
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(folder / name, content)
    write_whole(folder / "config.toml", given)


def _free(name: Path, used: Collection[str]) -> str:
    """A name in data/ that no other file has."""
    number, found = 1, f"{MOVED}/{name.name}"
    while found in used:
        number += 1
        found = f"{MOVED}/{name.stem}_{number}{name.suffix}"
    return found
