"""Draws of the numbers of scenes from a file: the posterior that `softgrip calibrate --posterior` writes.

The file is netCDF with the group `posterior`, as ArviZ reads and writes it. Its variables of the dimensions chain and
draw whose names are keys of the config at hand ("shell.material.mu_kPa") are numbers in the unit of the key. What a
calibration has written says more: which class a number belongs to, so that one of another material is not taken for it,
the laws of the scenes that it was fitted with, and whether the diagnostics allow its use.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .config.keys import Varied, varied
from .errors import ConfigError
from .laws import laws_of
from .parameters import Scenes

GROUP = "posterior"
OWNER, TIED, LAWS, USABLE, VERDICT = "owner", "keys", "laws", "usable", "verdict"
"""Attributes: of a variable, the class that its number belongs to, all of its keys, and the laws that it was found by
(JSON; files of before have none); of the group, 0 where the diagnostics forbid its use, and why."""

Laws = dict[str, list[Any]]
"""Values of choices, by the name of the choice."""


class Drawn(NamedTuple):
    """The draws of one number."""

    number: Varied
    values: np.ndarray
    """In SI, all chains one after the other."""
    laws: Laws = {}
    """Of the scenes that it was fitted with; nothing where the file does not say."""


def read_draws(scenes: Scenes, path: Path, where: str) -> list[Drawn]:
    """The draws of a posterior's file whose names are keys of the scenes; ConfigError where it cannot be meant."""
    import xarray as xr

    if not path.is_file():
        raise ConfigError(f"{where}: there is no posterior {str(path)!r}.")
    try:
        with xr.open_dataset(path, group=GROUP, engine="h5netcdf") as data:
            about: dict[str, Any] = dict(data.attrs)
            columns = {
                str(name): (np.asarray(v, float).ravel(), dict(v.attrs))
                for name, v in data.data_vars.items()
                if set(v.dims) == {"chain", "draw"}
            }
    except (OSError, KeyError, ValueError) as error:
        raise ConfigError(
            f"{where}: {str(path)!r} holds no group 'posterior' ({' '.join(str(error).split())})."
        ) from None
    if not int(about.get(USABLE, 1)):
        raise ConfigError(f"{where}: {str(path)!r} says of itself: {about.get(VERDICT, 'do not use')}")
    found = []
    for key, (column, own) in columns.items():
        tied = str(own[TIED]).split() if TIED in own else [key]
        keys = [one for one in tied if _is_key(scenes, one, where)]
        if not keys:
            continue
        number = varied(scenes, keys, where)
        owner = owner_of(scenes, number.name)
        if own.get(OWNER, owner) != owner:
            raise ConfigError(
                f"{where}: the posterior {str(path)!r} is of another scene: its {key} is a number of {own[OWNER]}, and "
                f"here it is one of {owner}."
            )
        found.append(Drawn(number, column * number.unit, json.loads(own.get(LAWS, "{}"))))
    if not found:
        raise ConfigError(
            f"{where}: the posterior {str(path)!r} is of another scene: it holds {', '.join(columns) or 'nothing'}, "
            "and none of it is a number here."
        )
    return found


def owner_of(scenes: Scenes, name: str) -> str:
    """The class of what holds a number: "NeoHookean" of "shell.material.mu"."""
    path = name.split("=")[0].strip().split(".")
    scene = scenes[path.pop(0)] if path[0] in scenes else next(s for s in scenes.values() if hasattr(s, path[0]))
    return type(reduce(getattr, path[:-1], scene)).__name__


def other_laws(scenes: Scenes, found: Sequence[Drawn]) -> list[str]:
    """A sentence for every scene that treats numbers of a posterior by other laws than those they were found with."""
    said = []
    for name, scene in scenes.items():
        own = laws_of(scene)
        theirs: dict[str, dict[Any, None]] = {}
        for one in found:
            heads = [path.strip().split(".")[0] for path in one.number.name.split("=")]
            if len(scenes) == 1 or name in heads:
                for law, values in one.laws.items():
                    theirs.setdefault(law, {}).update(dict.fromkeys(values))
        differing = [law for law in theirs if law in own and own[law] not in theirs[law]]
        if differing:
            that = " and ".join(f"{law} = {' or '.join(map(json.dumps, theirs[law]))}" for law in differing)
            this = " and ".join(f"{law} = {json.dumps(own[law])}" for law in differing)
            which = "this scene" if len(scenes) == 1 else f"the scene {name}"
            said.append(f"The numbers were found with {that}; {which} has {this}: they belong to that model.")
    return said


def _is_key(scenes: Scenes, key: str, where: str) -> bool:
    try:
        varied(scenes, key, where)
    except ConfigError:
        return False
    return True
