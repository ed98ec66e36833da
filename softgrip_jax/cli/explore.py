"""explore: the scene of a config in the browser."""

from __future__ import annotations

from typing import Annotated

import typer

from .app import ConfigFile, SceneName, app


@app.command()
def explore(
    config: ConfigFile,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where to listen; 0 takes a free port.")] = 0,
    opens: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    host: Annotated[
        str, typer.Option(help="Where to listen; another host than localhost needs the token that is printed.")
    ] = "localhost",
    scene: SceneName = None,
) -> None:
    """See the scene in the browser while its numbers move: picture, curve, what would help.

    Served by this machine alone, without a network, until Ctrl-C. Needs pip install softgrip_jax[explore].

    - softgrip explore configs/finger_tip_contact.toml
    """
    from ..commands.explore import run_explore

    run_explore(config, scene, host, port, opens)
