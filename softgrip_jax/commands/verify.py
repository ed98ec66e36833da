"""`softgrip verify CONFIG.toml`: the error of our models for THIS design, by finite elements of it.

Reads the scene of a config and the pressure that [solve] asks for; writes a folder with the table, the numbers and a
picture of both shapes, and keeps the errors where `softgrip_jax.fidelity` finds them for designs nearby.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import io
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from ..errors import ConfigError, InputError, located
from ..folders import contents, new_folder, write_whole
from ..progress import Tell, stages
from ..tables import Table
from .files import check_file, one_scene, tell_file

SHARES = (1 / 3, 2 / 3, 1.0)
"""Of the pressure, at which a shell is compared."""


def require_elements() -> None:
    """A ConfigError where scikit-fem is not installed."""
    import importlib.util

    from ..verify.boxes import MISSING

    if importlib.util.find_spec("skfem") is None:
        raise ConfigError(MISSING)


def run_verify(
    config: Path,
    pressure_kpa: float | None,
    scene: str | None,
    fine: bool,
    out: Path | None,
    keep: Path | None,
    as_json: bool,
    console: Console,
) -> Path:
    """Compare the scene of a config with finite elements; returns the folder. The arguments are the options.

    Ctrl-C keeps what is there, in the folder and in the report, and is raised again.
    """
    from ..verify import kept as memory
    from ..verify import run as elements
    from ..verify.rows import rows_of as part_rows

    require_elements()
    kept_in = keep or memory.FOLDER
    memory.require_place(kept_in)
    read = one_scene(config, scene)
    pressure = asked_pressure(read, config, pressure_kpa)
    began, stopped = time.monotonic(), False
    with located(f"{config}"):
        case = case_of(read.scene, pressure)
    found: list[list[Any]] = []
    with new_folder(out, f"{config.stem}_verified") as (folder, final):
        with stages(Console(stderr=True)) as tell:
            try:
                tell("our models")
                models = [part.models() for part in case.parts]
                meshes = elements.FINE_PARTS if fine else elements.PARTS
                for part in case.parts:
                    found.append([])
                    for now in elements.compare(part.build, part.targets, meshes, watched(tell)):
                        found[-1] = now
            except KeyboardInterrupt:
                if not any(one.values for part in found for one in part):
                    raise
                stopped = True
        rows = [
            row
            for part, seen, said in zip(case.parts, found, models, strict=False)
            for row in part_rows(seen, part.quantities, said)
        ]
        spent = time.monotonic() - began
        if not rows:
            raise ConfigError(
                f"{config}: finite elements found no equilibrium up to {pressure / 1e3:.4g} kPa; give a smaller "
                "--pressure-kPa."
            )
        said = case.remarks if stopped else (*case.remarks, *remarks(found))
        data = {
            "config": str(config),
            "scene": case.name,
            "stopped": stopped,
            "remarks": said,
            "seconds": spent,
            "states": [state_data(one) for part in found for one in part],
            "rows": [row.as_data() for row in rows],
        }
        write_whole(folder / "result.json", json.dumps(data, indent=2, allow_nan=False).encode())
        write_whole(folder / "table.csv", table_of(rows).encode())
        picture = case.picture(found[0])
        if picture is not None:
            write_whole(folder / "shapes.png", functools.partial(picture.savefig, bbox_inches="tight", dpi=200))
    kept = memory.keep(read.scene, data["rows"], kept_in)
    if as_json:
        print(json.dumps({"folder": str(final), "kept": str(kept)} | data, indent=2, allow_nan=False))
    else:
        report(case.name, rows, console)
        for sentence in said:
            console.print(sentence, soft_wrap=True, markup=False)
        console.print(
            f"The comparison, {spent:.0f} s of work, is in {final}: {contents(final)}. From now on `softgrip solve` "
            f"reports these errors for designs nearby, from {kept}.",
            soft_wrap=True,
        )
    if stopped:
        raise KeyboardInterrupt
    return final


ENDINGS = {"abaqus": ".inp", "calculix": ".inp", "febio": ".feb"}


def run_deck(config: Path, pressure_kpa: float | None, scene: str | None, format: str, out: Path | None) -> Path:
    """Write the input deck of the same finite elements for another program; returns the file."""
    require_elements()
    if format not in ENDINGS:
        raise ConfigError(f"--fe is {format!r}; it must be one of {', '.join(ENDINGS)}.")
    path = out or Path(f"{config.stem}{ENDINGS[format]}")
    if path.exists():
        raise ConfigError(f"{path} exists already; give --out a new name.")
    check_file(path, "--out", (ENDINGS[format],))
    read = one_scene(config, scene)
    pressure = asked_pressure(read, config, pressure_kpa)
    from ..verify.decks import write_deck

    with located(f"{config}"):
        write_deck(read.scene, pressure, format, path)
    tell_file("The deck", path, False)
    return path


def asked_pressure(read: Any, config: Path, pressure_kpa: float | None) -> float:
    """The pressure in Pa: the option's, that of [solve], or what reaches the target of [solve] by our model."""
    from .. import config as configs
    from ..questions import pressure_for
    from ..results import Status

    if pressure_kpa is not None:
        pressure = float(configs.read_numbers(pressure_kpa, "--pressure-kPa", "positive", "pressure", [""]))
        return pressure
    asked = configs.question(read)
    if "pressure" in asked:
        if asked["pressure"] <= 0:
            raise ConfigError(f"{config}, [solve]: pressure_kPa is 0; finite elements need a pressure.")
        return float(asked["pressure"])
    with located(f"{config}, [solve]"):
        solution = pressure_for(read.scene, **asked)
    if int(solution.status) != Status.OK:
        raise ConfigError(f"{config}, [solve]: there is no pressure to verify at: {solution.reason_text()}.")
    return float(solution.pressure)


def watched(tell: Tell) -> Callable[[float, float], None]:
    """What tells the share that is done and the seconds that are left."""
    return lambda share, left: tell("finite elements", note=f"{100 * share:.0f} %, about {max(left, 1):.0f} s left")


@dataclasses.dataclass
class Part:
    """One solid of a scene, with what is compared of it."""

    targets: list[Any]
    build: Callable[[int], Any]
    models: Callable[[], Any]
    quantities: dict[str, str]


@dataclasses.dataclass
class Case:
    """What is compared of one scene; the picture is of its first part, and the remarks say what is not compared."""

    name: str
    parts: list[Part]
    picture: Callable[[list[Any]], Any]
    remarks: tuple[str, ...] = ()


def state_data(one: Any) -> dict[str, Any]:
    """All that finite elements say of one state, on all meshes, in SI."""
    target = one.target
    place = {"pressure": target.pressure, "curvature": target.curvature, "free": target.free}
    return place | {"meshes": one.values, "seconds": one.seconds}


def remarks(found: list[list[Any]]) -> list[str]:
    """What people must know."""
    from ..verify import run as elements

    said = []
    missing = [one.target for part in found for one in part if not one.values]
    if missing:
        least = min(target.pressure for target in missing) / 1e3
        said.append(f"Finite elements found no equilibrium for {len(missing)} states, the first at {least:.4g} kPa.")
    if any(0 < len(one.values) < len(one.parts) for part in found for one in part):
        said.append(
            "A finer mesh was left out where it would have more elements than memory is given for "
            f"({elements.MOST_ELEMENTS}), or found no equilibrium."
        )
    return said


def case_of(scene: Any, pressure: float) -> Case:
    """What is compared of a scene, and how.

    Raises:
        InputError: for a scene that finite elements are not there for.
    """
    from ..config.modules import type_name
    from ..verify.finger import is_finger
    from ..verify.shell import is_shell

    if is_finger(scene):
        return finger_case(scene, pressure, type_name(type(scene)))
    if is_shell(scene):
        return shell_case(scene, pressure, type_name(type(scene)))
    raise InputError(f"{type_name(type(scene))} has no finite elements; shells and uniform fingers have.")


def shell_case(scene: Any, pressure: float, name: str) -> Case:
    """A membrane at three pressures."""
    from ..plots.elements import elements_and_models
    from ..questions import solve
    from ..verify import rows
    from ..verify.run import Target
    from ..verify.shell import Plate

    targets = [Target(share * pressure) for share in SHARES]
    models = rows.shell_models(scene)

    def picture(found: list[Any]) -> Any:
        known = [one for one in found if one.values]
        if not known:
            return None
        last = known[-1]
        shape = last.mesh.profile(last.state)
        solids = []
        for s, z in (("x", "z"), ("y", "z_length")):
            low, high = (np.stack([shape[s + face], shape[z + face]], axis=1) for face in ("_inner", "_outer"))
            solids.append(np.concatenate([low, high[::-1]]))
        lines: dict[str, Any] = {}
        for model, one in models.items():
            if name == "pneunet.Chamber":
                continue
            profile = {k: np.asarray(v) for k, v in solve(one, last.target.pressure).shape(201).items()}
            pair = [("x_face", "z_face"), ("y_face", "z_length_face")]
            if "x_face" not in profile:
                pair = [("x", "z"), ("y", "z_length")]
            lines[model] = [
                np.stack([profile[s], profile[z]], axis=1) if s in profile and z in profile else None for s, z in pair
            ]
        views = ["across the width, x (mm)", "along the length, y (mm)"]
        title = f"{name} at {last.target.pressure / 1e3:.4g} kPa"
        return elements_and_models(views, solids, lines, last.mesh.objects(), title)

    plate = Part(
        targets, lambda parts: Plate(scene, parts), lambda: rows.model_values(models, targets), rows.QUANTITIES
    )
    return Case(name, [plate], picture)


def finger_case(scene: Any, pressure: float, name: str) -> Case:
    """A finger's cell: straight, bent as the solution is, and free."""
    from ..plots.elements import cells_and_walls
    from ..pneunet import TipContact
    from ..questions import solve
    from ..results import Status
    from ..verify import finger as fingers
    from ..verify.cell import CellSolid
    from ..verify.cover import CoverSolid
    from ..verify.run import Target

    targets = fingers.targets_of(scene, pressure)
    CellSolid(scene.finger)  # says what is wrong with the dimensions before anything takes long

    def picture(found: list[Any]) -> Any:
        drawn = []
        for one in found:
            if not one.values or one.target.pressure != pressure:
                continue
            bend = one.state.bend
            thesis = fingers.drives_of(scene)["thesis"]
            wall = solve(fingers.chamber_at(thesis, bend), pressure)
            words = "free" if one.target.free else "straight" if bend == 0 else "bent"
            title = f"{words}, {bend:.3g} 1/m"
            known = wall if int(wall.status) in (Status.OK, Status.NO_CONTACT) else None
            drawn.append((title, one.mesh.section(one.state), one.mesh.plane(one.state), known))
        return cells_and_walls(drawn, f"{name}: a cell at {pressure / 1e3:.4g} kPa") if drawn else None

    cell = Part(
        targets,
        lambda parts: CellSolid(scene.finger, parts),
        lambda: fingers.model_values(scene, targets),
        fingers.QUANTITIES,
    )
    held = fingers.held_cover(scene, pressure)
    if held is None:
        one_moment = not (isinstance(scene, TipContact) and scene.inclines())
        return Case(name, [cell], picture, () if one_moment else (fingers.MANY_MOMENTS,))
    moment, values = held
    cover = Part(
        [Target(pressure)],
        lambda parts: CoverSolid(scene.finger, moment, parts),
        lambda: {"thesis": [values], "cell": [{}]},
        fingers.OF_COVER,
    )
    return Case(name, [cell, cover], picture)


def report(name: str, rows: list[Any], console: Console) -> None:
    """The table for people."""
    from ..results import in_units
    from ..units import DISPLAY, kPa

    names = list(rows[0].models)
    table = Table(title=f"{name} and its finite elements", title_justify="left")
    table.add_column("", no_wrap=True)
    table.add_column("kPa", justify="right")
    if any(row.curvature is not None for row in rows):
        table.add_column("1/m", justify="right")
    heads = (*names, "finite elements", *(f"{model}, difference" for model in names), "mesh error", "seconds")
    for head in heads:
        table.add_column(head, justify="right")
    for place, row in enumerate(rows):
        unit = DISPLAY[row.kind][1]
        small = row.mesh_error is None
        mesh = "-" if small else f"{abs(row.mesh_error) / unit:.2g} {DISPLAY[row.kind][0]}".strip()
        bent = [f"{row.curvature:.4g}"] if row.curvature is not None else []
        state = (row.pressure, row.curvature)
        before = rows[place - 1] if place else None
        same = before is not None and (before.pressure, before.curvature) == state
        table.add_row(
            row.quantity.replace("_", " "),
            f"{row.pressure / kPa:.4g}",
            *bent,
            *(in_units(row.models[name], row.kind) for name in names),
            in_units(row.elements, row.kind),
            *(
                f"{100 * row.difference(name):+.3g} %" if row.difference(name) == row.difference(name) else "-"
                for name in names
            ),
            mesh,
            "" if same else f"{row.seconds:.1f}",
        )
    console.print(table)


def table_of(rows: list[Any]) -> str:
    """The rows as CSV, in SI."""
    from ..units import SI

    text = io.StringIO()
    writer = csv.writer(text)
    names = list(rows[0].models)
    head = ["quantity", "unit", "pressure_Pa", "curvature_per_m", *names, "finite_elements"]
    writer.writerow([*head, *(f"{name}_difference" for name in names), "mesh_error", "seconds"])
    for row in rows:
        bent = "" if row.curvature is None else row.curvature
        values = [row.quantity, SI[row.kind], row.pressure, bent, *row.models.values(), row.elements]
        mesh = "" if row.mesh_error is None else row.mesh_error
        writer.writerow([*values, *(row.difference(name) for name in names), mesh, round(row.seconds, 2)])
    return text.getvalue()
