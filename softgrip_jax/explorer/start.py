"""The explorer from Python: a server in a thread of its own."""

from __future__ import annotations

import asyncio
import copy
import threading
import webbrowser
from collections.abc import Callable
from typing import Any

from ..commands.explore import require_extra
from ..errors import InputError
from ..fields import require
from ..scene import Scene


class Explorer:
    """A running explorer.

    Args:
        address: of the page.
        stop: what ends its server.

    Examples:
        >>> Explorer("http://localhost:5006/", lambda: None).address
        'http://localhost:5006/'
    """

    def __init__(self, address: str, stop: Callable[[], None]):
        self.address = address
        self._stop = stop
        self._ended = threading.Event()

    def __repr__(self) -> str:
        return f"Explorer at {self.address}"

    def stop(self) -> None:
        """End the server; pages that are open say so."""
        self._stop()
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
    from .front import Front
    from .session import FIRST_PRESSURE, Session

    asked = None if pressure is None else float(require("pressure", pressure, "nonnegative", "pressure"))
    first = Session(scene, FIRST_PRESSURE if asked is None else asked)
    if pressure is None and first.has_task:
        first = Session(scene, None)
    front = Front(lambda: copy.deepcopy(first), host, port)
    found = Explorer(front.address, front.stop)

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            front.run()
        finally:
            found._ended.set()

    threading.Thread(target=run, name="softgrip explorer", daemon=True).start()
    if opens:
        webbrowser.open(found.address)
    return found
