"""The explorer from Python: a server in a thread of its own."""

from __future__ import annotations

import asyncio
import copy
import threading
import webbrowser
from typing import Any

from ..commands.explore import require_extra
from ..errors import InputError
from ..fields import require
from ..scene import Scene


class Explorer:
    """A running explorer.

    Args:
        address: of the page.

    Examples:
        >>> Explorer("http://localhost:5006/").address
        'http://localhost:5006/'
    """

    def __init__(self, address: str):
        self.address = address
        self._server: Any = None
        self._loop: Any = None
        self._ended = threading.Event()

    def __repr__(self) -> str:
        return f"Explorer at {self.address}"

    def stop(self) -> None:
        """End the server; pages that are open say so."""
        if self._loop is not None:
            self._loop.add_callback(self._loop.stop)
            self._ended.wait(5)

    def wait(self) -> None:
        """Wait until somebody ends the server, in a script for instance."""
        self._ended.wait()


def explore(
    scene: Scene, pressure: Any = None, *, port: int = 0, host: str = "localhost", opens: bool = True
) -> Explorer:
    """See a scene in the browser while its numbers move: picture, curve, what would help.

    The page is served by this process alone, in a thread of its own, and needs no network; each browser has sliders of
    its own. Needs pip install 'softgrip_jax[explore]'.

    Args:
        scene: what to begin with.
        pressure: gauge pressure in the actuator, Pa; without it, the pressure of the scene's own task, or 15 kPa.
        port: where to listen; 0 takes a free one.
        host: another one than localhost needs the token in the address.
        opens: whether to open the page in the browser.

    Returns:
        The `Explorer`, with its address; it ends with the process, or by `stop()`.

    Raises:
        InputError: where the scene or the pressure cannot be meant, a package is missing or the port is taken.

    Examples:
        >>> shell = sg.FlatShell(a=16 * mm, b=43 * mm, t_m=1.1 * mm, material=sg.NeoHookean(mu=175 * kPa))
        >>> page = sg.explore(sg.shell.Free(shell), 10 * kPa, opens=False)  # doctest: +SKIP
        >>> page.stop()  # doctest: +SKIP
    """
    if not isinstance(scene, Scene):
        raise InputError(f"scene is {scene!r}; it must be a Scene, for instance sg.shell.Free(...).")
    require_extra()
    from .serve import LOCAL, free_port, server_of, warm
    from .session import FIRST_PRESSURE, Session

    asked = None if pressure is None else float(require("pressure", pressure, "nonnegative", "pressure"))
    first = Session(scene, FIRST_PRESSURE if asked is None else asked)
    if pressure is None and first.has_task:
        first = Session(scene, None)
    if host not in LOCAL or port:
        free_port(host, port)  # an InputError here, not in the thread

    def make() -> Session:
        return copy.deepcopy(first)

    started: list[Any] = []
    ready = threading.Event()
    found = Explorer("")

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            server, found.address = server_of(make, host, port)
            found._server, found._loop = server, server.io_loop
            server.start()
        except Exception as error:
            started.append(error)
            ready.set()
            return
        ready.set()
        server.io_loop.start()
        server.stop()
        found._ended.set()

    warm(make)
    threading.Thread(target=run, name="softgrip explorer", daemon=True).start()
    ready.wait()
    if started:
        raise started[0]
    if opens:
        webbrowser.open(found.address)
    return found
