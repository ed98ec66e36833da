"""`softgrip explore CONFIG.toml`: the scene of a config in the browser, live.

Reads the scene and what [solve] asks; serves a page on this machine until Ctrl-C. Nothing is written.
"""

from __future__ import annotations

import copy
import importlib.util
import os
from pathlib import Path

import typer

from ..errors import ConfigError

NEEDED = ("panel", "bokeh", "plotly")
LEAST_THREADS = 8
"""Of XLA for one program. jaxlib (0.10.1) solves a batch of linear systems in parts and waits for them in one of these
threads: where two such batches waited in the only two, a search begun from the sliders never came to its first step."""


def require_extra() -> None:
    """A ConfigError where the packages of the page are missing."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigError(f"The explorer needs {', '.join(missing)}: pip install 'softgrip_jax[explore]'.")


def run_explore(config: Path, scene: str | None, host: str, port: int, opens: bool) -> None:
    """Serve the explorer. The arguments are the options."""
    require_extra()
    os.environ.setdefault("PJRT_NPROC", str(max(LEAST_THREADS, os.cpu_count() or 1)))
    from ..explorer.session import session_of_config

    first = session_of_config(config, scene)
    typer.echo(f"{config}: {first.title()}; the first picture is being compiled", err=True)
    from ..explorer.front import serve

    def tell(address: str) -> None:
        typer.echo(f"The explorer is at {address} (Ctrl-C ends it).")

    serve(lambda: copy.deepcopy(first), host, port, opens, tell)
