"""`softgrip solve CONFIG.toml --posterior P.nc`: one scene by the draws of a posterior, an interval for every value.

Each draw moves the numbers of the scene that the posterior knows, jointly; the others stay as the config gives them.
Draws without equilibrium, and those that touch nothing yet, are counted and named: the intervals are those of the
others.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Console

from ..errors import ConfigError, located
from .files import one_scene

DRAWS = 1000
"""Draws that are solved, evenly taken from all: the ends of a 95 % interval then stand on 25 each."""
ENDS = (0.025, 0.5, 0.975)


def run_predict(
    config: Path,
    posterior: Path,
    pressure_kpa: float | None,
    scene: str | None,
    as_json: bool,
    draws: int | None = None,
) -> bool:
    """Solve by so many draws of a posterior, DRAWS by default, and report; returns whether any has an answer."""
    import jax
    import jax.numpy as jnp

    from .. import config as configs
    from ..draws import other_laws, read_draws
    from ..parameters import Parameter, Parameters, ready
    from ..questions import pressure_for, solve

    read = one_scene(config, scene)
    if pressure_kpa is None:
        asked = configs.question(read)
    else:
        asked = {"pressure": configs.read_numbers(pressure_kpa, "--pressure-kPa", "nonnegative", "pressure", [""])}
    found = read_draws(read.scenes, posterior, "--posterior")
    values = np.stack([one.values for one in found], axis=1)
    values = values[np.linspace(0, len(values) - 1, min(draws or DRAWS, len(values))).astype(int)]
    if not np.all(np.isfinite(values)):
        raise ConfigError(f"--posterior: a draw in {str(posterior)!r} is not a finite number.")
    name = next(iter(read.scenes))
    varied = [Parameter(one.number.name) for one in found]
    known = Parameters(ready({name: read.scene}, varied), varied)
    at_pressure = "pressure" in asked

    def one(x):
        given = known.scenes_at(x)[name]
        state = solve(given, asked["pressure"]) if at_pressure else pressure_for(given, **asked)
        return state.status, state.reason, state.detail, state.pressure, state.observables

    with Console(stderr=True).status(f"solving by {len(values)} draws"), located(f"{config}, [solve]"):
        one(jnp.asarray(values[0]))  # what cannot be asked of the scene is said before anything is compiled
        states = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(jnp.asarray(values)))
    told = _summary(read.scene, found, values, states, at_pressure)
    told["remarks"] = other_laws(read.scenes, found)
    if as_json:
        typer.echo(json.dumps({k: v for k, v in told.items() if k != "kinds"}, indent=2, allow_nan=False))
    else:
        _report(read.scene, told, posterior, Console())
    return told["solved"] > 0


def _summary(scene: Any, found: Any, values: np.ndarray, states: Any, given_pressure: bool) -> dict[str, Any]:
    """Plain data in SI, its numbers by their names without unit, as the result.json of a calibration has them."""
    from ..config.modules import type_name
    from ..reasons import Reason
    from ..results import Status
    from ..units import SI

    status, reason, detail, pressure, observables = states
    solved = status == Status.OK
    kinds = {"pressure": "pressure"} | dict(scene.prepared().OBSERVABLES)
    columns = ({} if given_pressure else {"pressure": pressure}) | {
        n: observables[n] for n in kinds if n in observables
    }
    numbers = {one.number.name.split(" = ")[0]: one.number.kind for one in found}
    told: dict[str, Any] = {}
    for name, column in columns.items():
        for part, own in zip((".x", ".y"), column.T, strict=True) if column.ndim == 2 else (("", column),):
            told[name + part] = interval(own[solved])
    # One sentence per kind of reason: its number is that of the draw in the middle.
    words = {}
    for k in np.unique(reason[~solved]):
        own = ~solved & (reason == k)
        middle = np.nanmedian(detail[own]) if np.isfinite(detail[own]).any() else np.nan
        words[Reason(int(k)).text(float(middle))] = int(own.sum())
    return {
        "scene": type_name(type(scene)),
        "draws": len(values),
        "solved": int(solved.sum()),
        "statuses": {Status(int(k)).name: count for k, count in Counter(status.tolist()).items()},
        "reasons": words,
        "pressure": float(pressure[0]) if given_pressure else None,
        "parameters": {name: interval(values[:, k]) for k, name in enumerate(numbers)},
        "observables": told,
        "units": {n: SI[kind] for n, kind in (numbers | kinds).items()},
        "kinds": numbers | kinds,
    }


def interval(values: np.ndarray) -> dict[str, float] | None:
    """Median and ends of the 95 % interval of what is finite; None of nothing."""
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    return dict(zip(("low", "median", "high"), map(float, np.quantile(values, ENDS)), strict=True))


def _report(scene: Any, told: dict[str, Any], posterior: Path, console: Console) -> None:
    from ..model_error import model_error
    from ..pneunet.drives import remarks
    from ..pneunet.finger_scene import FingerScene
    from ..results import in_units
    from ..tables import Table

    table = Table(title=f"{told['scene']} by {told['draws']} draws of {posterior.name}", title_justify="left")
    for heading in ("", "median", "95 % interval"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=not heading)
    if told["pressure"] is not None:
        table.add_row("pressure", in_units(told["pressure"], "pressure"), "given")
    for name, ends in (told["parameters"] | told["observables"]).items():
        kind = told["kinds"].get(name) or told["kinds"][name.rpartition(".")[0]]
        words = name if name in told["parameters"] else name.replace("_", " ").replace(".", " ")
        if ends is None:
            table.add_row(words, "-", "-")
        else:
            low, high = in_units(ends["low"], kind), in_units(ends["high"], kind)
            table.add_row(words, in_units(ends["median"], kind), f"{low} to {high}")
    console.print(table)
    if told["solved"] < told["draws"]:
        console.print(
            f"{told['draws'] - told['solved']} of {told['draws']} draws have no equilibrium or touch nothing, and the "
            "intervals are those of the others:",
            soft_wrap=True,
            highlight=False,
        )
        for words, count in told["reasons"].items():
            console.print(f"  {count}: {words} (in the middle of them)", soft_wrap=True, highlight=False, markup=False)
    else:
        console.print(f"All {told['draws']} draws have an equilibrium.", highlight=False)
    console.print(
        "The intervals are those of the parameters; the model's own error comes on top.",
        soft_wrap=True,
        highlight=False,
    )
    for sentence in told["remarks"]:
        console.print(sentence, soft_wrap=True, markup=False, highlight=False)
    # Numbers that were fitted by another law make up for the errors of that one.
    made_up = "" if told["remarks"] else "; those of a calibration make up for part of that"
    for name in told["observables"]:
        known = model_error(scene, name)
        if known:
            console.print(
                f"{name.replace('_', ' ')}: {known}, with numbers as they are{made_up}.",
                soft_wrap=True,
                highlight=False,
            )
    if isinstance(scene, FingerScene):
        for sentence in remarks(scene):
            console.print(sentence, soft_wrap=True, markup=False, highlight=False)
