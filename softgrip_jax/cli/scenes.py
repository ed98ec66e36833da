"""solve, path: questions to one scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .app import NO_ANSWER, AsJson, ConfigFile, SceneName, app


@app.command()
def solve(
    config: ConfigFile,
    pressure_kpa: Annotated[
        float | None, typer.Option("--pressure-kPa", help="Solve at this pressure, whatever [solve] asks.")
    ] = None,
    scene: SceneName = None,
    as_json: AsJson = False,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the scene to this file.")] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Leave out what changes --observable by less than this, for instance 1%.")
    ] = None,
    observable: Annotated[
        str | None, typer.Option(help="With --tolerance: whose error counts; by default the first of the scene.")
    ] = None,
    posterior: Annotated[
        Path | None, typer.Option(help="The posterior.nc of a calibration: every value with its 95 % interval.")
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(min=20, max=100_000, help="With --posterior: how many draws are solved; 1000 by default."),
    ] = None,
) -> None:
    """Solve one scene and report its state.

    [solve] in the config gives the pressure (pressure_kPa) or one observable that the pressure shall reach (force_N);
    a grasp with a mass needs neither. Exit code 1 where there is no answer.

    With --tolerance the cheapest model and numerics are chosen that answer within it, and what they leave out is told.
    Every one that is tried is compiled, so that takes longer than to solve once.

    With --posterior the scene is solved by the draws of a calibration, and draws without equilibrium are counted.

    - softgrip solve configs/shell_cylinder.toml --plot cylinder.png

    - softgrip solve configs/shell_cylinder.toml --pressure-kPa 12 --json

    - softgrip solve configs/finger_tip_contact.toml --tolerance 1%

    - softgrip solve configs/shell_flat.toml --posterior runs/calibrate_shell-001/posterior.nc
    """
    from ..errors import ConfigError

    if posterior is not None:
        from ..commands.predict import run_predict

        for option, given in (("--plot", plot), ("--tolerance", tolerance), ("--observable", observable)):
            if given is not None:
                raise ConfigError(f"--posterior gives intervals of one model; leave out {option}.")
        if not run_predict(config, posterior, pressure_kpa, scene, as_json, draws):
            raise typer.Exit(NO_ANSWER)
        return
    if draws is not None:
        raise ConfigError("--draws are those of a posterior; give --posterior too.")
    from ..commands.solve import run_solve

    if not run_solve(config, pressure_kpa, scene, as_json, plot, tolerance, observable):
        raise typer.Exit(NO_ANSWER)


@app.command()
def path(
    config: ConfigFile,
    from_kpa: Annotated[float, typer.Option("--from-kPa", help="First pressure.")] = 0.0,
    to_kpa: Annotated[
        float | None, typer.Option("--to-kPa", help="Last pressure; without it, the limit pressure of the scene.")
    ] = None,
    points: Annotated[
        int, typer.Option(min=2, max=100_000, help="How many pressures, evenly spaced; or points along the curve.")
    ] = 41,
    through_limit: Annotated[
        bool,
        typer.Option(
            help="The curve of equilibria instead, through the limit and behind it to half of it. It ends before, "
            "with --to-kPa below the limit; what is below --from-kPa on the way up is left out."
        ),
    ] = False,
    observable: Annotated[
        str | None,
        typer.Option(help="What the picture shows over the pressure, with its unit; the first of the scene."),
    ] = None,
    scene: SceneName = None,
    as_json: AsJson = False,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write a table: one row per pressure.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the curve to this file.")] = None,
    animate: Annotated[Path | None, typer.Option(help="Write the scene under rising pressure to this GIF.")] = None,
    page: Annotated[Path | None, typer.Option("--report", help="Write a report to this HTML file.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write table, picture and report into a new folder of this name instead.")
    ] = None,
) -> None:
    """Follow one scene through a range of pressures: a table, a picture, an animation.

    Rows without equilibrium keep their place and say so in the columns status and reason. Exit code 1 where no row has
    a state. Ctrl-C keeps the rows until then: they are printed and written as if the curve ended there.

    - softgrip path configs/shell_cylinder.toml --to-kPa 20 --csv curve.csv --plot curve.png

    - softgrip path configs/finger_tip_contact.toml --through-limit --plot fold.png

    - softgrip path configs/finger_tip_contact.toml --through-limit --out curve

    - softgrip path configs/shell_cylinder.toml --from-kPa 3 --to-kPa 20 --points 30 --animate inflation.gif
    """
    from ..commands.path import WantedCurve, run_path, run_path_into

    wanted = WantedCurve(from_kpa, to_kpa, points, through_limit, observable, scene)
    files = (csv_file, plot, animate, page)
    if out is None:
        found = run_path(config, wanted, as_json, *files)
    elif any(file is not None for file in files):
        from ..errors import ConfigError

        raise ConfigError("--out is given beside --csv, --plot, --animate or --report; it writes the files itself.")
    else:
        found = run_path_into(out, config, wanted, as_json)
    if not found:
        raise typer.Exit(NO_ANSWER)
