"""The server of the explorer: on this machine alone, or on another host with a token; offline.

One port, two servers behind it. The first is there at once: it gives the browser the frame of the page and its scripts,
which the browser reads while Python imports Panel. The second, Panel's, takes all that is about one browser as soon as
it has been made, while the first picture is being compiled.
"""

from __future__ import annotations

import asyncio
import gc
import hmac
import importlib.util
import logging
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.routing import AnyMatches, PathMatches, Rule, RuleRouter
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from ..commands.programs import is_used
from ..errors import InputError
from .ahead import Ahead
from .answers import programs
from .session import Session, first_answer, prepare_drawing, trace

LOCAL = ("localhost", "127.0.0.1")
EXPLORER = "/explorer"
"""Beneath this is what Panel serves; the rest is the frame of the page."""
LARGEST_MESSAGE = 4 * 1024 * 1024
"""Bytes that a browser may send at once: uploads are no larger."""
COOKIE = "softgrip_token"
SCRIPTS = (
    ("bokeh", "js/bokeh.min.js"),
    ("bokeh", "js/bokeh-widgets.min.js"),
    ("bokeh", "js/bokeh-tables.min.js"),
    ("panel", "extensions/panel/panel.min.js"),
)
"""What every page needs, in this order: package and place beneath its address of files."""
SWITCH = 1e-3
"""Seconds after which a thread lets others in, 5 ms by default: what follows a picture must not delay the next one."""

COLLECTED = (50_000, 20, 100)
"""New objects between two looks for what nobody holds any more, and looks between two wider ones: with a million, as
for commands, a picture waits for a tenth of a second now and then."""


def check_free(host: str, port: int) -> None:
    """InputError where nobody can listen at a port; 0 is any."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(
                f"The explorer cannot listen at {host}, port {port}: {reason}; give another --port."
            ) from None


def check_token(handler: Any, token: str) -> None:
    """HTTPError for a browser that does not know the token, in the address or in the cookie that this leaves there.

    Scripts cannot read that cookie.
    """
    if not token:
        return
    given = handler.get_argument("token", "") or handler.get_cookie(COOKIE, "")
    if not hmac.compare_digest(given.encode(), token.encode()):
        raise HTTPError(403, "The token is missing from the address.")
    with suppress(Exception):  # a WebSocket has sent its headers already
        handler.set_cookie(COOKIE, token, httponly=True, samesite="Strict")


def _folder(package: str, *within: str) -> Path:
    """A folder of a package that is not imported for that."""
    found = importlib.util.find_spec(package)
    assert found is not None, package
    assert found.submodule_search_locations is not None, package
    return Path(found.submodule_search_locations[0], *within)


def _frame() -> str:
    """The frame of the page, with its scripts: browsers keep them for as long as their version stays."""
    tags = [f'<script defer src="static/{place}?v={version(package)}"></script>' for package, place in SCRIPTS]
    text = Path(__file__).with_name("index.html").read_text(encoding="utf-8")
    return text.replace("{{ scripts }}", "\n".join(tags))


class Frame(RequestHandler):
    """The frame of the page."""

    def initialize(self, token: str, text: str) -> None:
        self.token, self.text = token, text

    def get(self) -> None:
        check_token(self, self.token)
        self.set_header("Cache-Control", "no-store")
        self.write(self.text)


class Alive(RequestHandler):
    """A sign of life, with the name of this server: a page loads again from another one, and waits for a slow one."""

    def initialize(self, name: str) -> None:
        self.name = name

    def get(self) -> None:
        self.write(self.name)


class Waiting(RequestHandler):
    """Before Panel's server is there, a browser waits for it and is then sent to it."""

    def initialize(self, is_ready: asyncio.Event) -> None:
        self.is_ready = is_ready

    async def get(self) -> None:
        await self.is_ready.wait()
        self.redirect(self.request.uri or EXPLORER)


class Front:
    """A port that listens, and what is behind it.

    Args:
        make: gives every browser a session of its own.
        host: where to listen; another one than localhost gets a token.
        port: 0 takes a free one.

    Raises:
        InputError: where the port is taken.
    """

    def __init__(self, make: Callable[[], Session], host: str, port: int):
        self.make = make
        check_free(host, port)
        self.sockets = bind_sockets(port, address=host)
        self.port = self.sockets[0].getsockname()[1]
        is_local = host in LOCAL
        shown = f"[{host}]" if ":" in host else "localhost" if is_local else host
        self.token = "" if is_local else secrets.token_urlsafe(24)
        self.address = f"http://{shown}:{self.port}/" + (f"?token={self.token}" if self.token else "")
        self.origins = [f"{name}:{self.port}" for name in (LOCAL if is_local else [host, socket.gethostname()])]
        self._loop: Any = None
        self._is_ended = False
        self._fault: list[Exception] = []

    def run(self, on_ready: Callable[[], None] | None = None) -> None:
        """Serve in this thread, which has an event loop, until `stop`; raises what went wrong with the explorer.

        on_ready: is called when browsers get their pages.
        """
        self._loop = loop = IOLoop.current()
        if self._is_ended:
            loop.add_callback(loop.stop)
        is_ready = asyncio.Event()
        waiting = Application([(".*", Waiting, {"is_ready": is_ready})])
        frame = Application(
            [
                ("/", Frame, {"token": self.token, "text": _frame()}),
                ("/alive", Alive, {"name": secrets.token_hex(8)}),
                ("/static/extensions/panel/(.*)", StaticFileHandler, {"path": _folder("panel", "dist")}),
                ("/static/(.*)", StaticFileHandler, {"path": _folder("bokeh", "server", "static")}),
            ]
        )
        router = RuleRouter([Rule(PathMatches(f"{EXPLORER}.*"), waiting), Rule(AnyMatches(), frame)])
        http = HTTPServer(router, max_buffer_size=LARGEST_MESSAGE)
        http.add_sockets(self.sockets)
        started: list[Any] = []

        def take(explorer: Any) -> None:
            explorer.initialize(loop)
            explorer.start()
            started.append(explorer)
            router.rules[0] = Rule(PathMatches(f"{EXPLORER}.*"), explorer)
            is_ready.set()
            if on_ready is not None:
                on_ready()

        def prepare() -> None:
            try:
                explorer = self._explorer()
            except Exception as error:  # raised again in the thread that serves
                self._fault.append(error)
                self.stop()
                return
            loop.add_callback(take, explorer)

        threading.Thread(target=prepare, name="softgrip explorer", daemon=True).start()
        try:
            loop.start()
        finally:
            for explorer in started:
                explorer.stop()
            http.stop()
        if self._fault:
            raise self._fault[0]

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._is_ended = True
        if self._loop is not None:
            self._loop.add_callback(self._loop.stop)

    def _explorer(self) -> Any:
        """Panel's server. Python traces the first picture, and what draws it, before it imports Panel, which takes less
        long than XLA takes to compile that picture meanwhile."""
        question = self.make().question()
        trace(question)
        for work in (lambda: list(first_answer(question)), partial(prepare_drawing, question)):
            threading.Thread(target=work, name="softgrip warm", daemon=True).start()
        from .panels import server_of

        return server_of(self.make, EXPLORER, self.origins, partial(check_token, token=self.token), LARGEST_MESSAGE)


def serve(make: Callable[[], Session], host: str, port: int, opens: bool, tell: Callable[[str], None]) -> None:
    """Serve until Ctrl-C."""
    front = Front(make, host, port)
    if is_used():
        programs.ahead = Ahead()
    logging.getLogger("bokeh.server.views.ws").setLevel(logging.ERROR)  # a page that was closed is no news
    tell(front.address)
    if opens:
        webbrowser.open(front.address)
    try:
        front.run(on_ready=for_pictures)
    finally:
        if programs.ahead is not None:
            programs.ahead.end()


def for_pictures() -> None:
    """What this process does from now on is to answer sliders."""
    sys.setswitchinterval(SWITCH)
    gc.freeze()
    gc.set_threshold(*COLLECTED)
