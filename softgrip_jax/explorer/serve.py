"""The server of the explorer: on this machine alone, or on another host with a token; offline."""

from __future__ import annotations

import gc
import hmac
import logging
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import panel as pn
from bokeh.server.auth_provider import AuthProvider
from tornado.web import HTTPError

from ..errors import InputError
from .page import page_of
from .session import Session, first_answer

LOCAL = ("localhost", "127.0.0.1")
LARGEST_MESSAGE = 4 * 1024 * 1024
"""Bytes that a browser may send at once: uploads are no larger."""
COOKIE = "softgrip_token"
SWITCH = 1e-3
"""Seconds after which a thread lets others in, 5 ms by default: what follows a picture must not delay the next one."""

COLLECTED = (50_000, 20, 100)
"""New objects between two looks for what nobody holds any more, and looks between two wider ones: with a million, as
for commands, a picture waits for a tenth of a second now and then."""


class Token(AuthProvider):
    """A browser needs the token of the address once; it is kept in a cookie that scripts cannot read."""

    def __init__(self, token: str):
        self.token = token
        super().__init__()

    @property
    def get_user(self) -> Any:
        def user(handler: Any) -> str:
            given = handler.get_argument("token", "") or handler.get_cookie(COOKIE, "")
            if not hmac.compare_digest(given.encode(), self.token.encode()):
                raise HTTPError(403, "The token is missing from the address.")
            with suppress(Exception):  # a WebSocket has sent its headers already
                handler.set_cookie(COOKIE, self.token, httponly=True, samesite="Strict")
            return "explorer"

        return user

    get_user_async: Any = None
    login_url: Any = "/"
    get_login_url: Any = None
    login_handler: Any = None
    logout_url: Any = None
    logout_handler: Any = None


def free_port(host: str, port: int) -> int:
    """The port that is asked for, or a free one where that is 0; InputError where it is taken."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(
                f"The explorer cannot listen at {host}, port {port}: {reason}; give another --port."
            ) from None
        return probe.getsockname()[1]


def warm(make: Callable[[], Session]) -> threading.Thread:
    """Compile what the first picture needs, and nothing else, while the browser is on its way."""

    def run() -> None:
        for _ in first_answer(make().question()):
            pass

    thread = threading.Thread(target=run, name="softgrip explorer warm", daemon=True)
    thread.start()
    return thread


def server_of(make: Callable[[], Session], host: str, port: int) -> tuple[Any, str]:
    """(a server that is not started, its address): `make` gives every browser a session of its own."""
    pn.extension("plotly", notifications=False)
    port = free_port(host, port)
    is_local = host in LOCAL
    shown = f"[{host}]" if ":" in host else "localhost" if is_local else host
    origins = [f"{name}:{port}" for name in (LOCAL if is_local else [host, socket.gethostname()])]
    options: dict[str, Any] = {"websocket_max_message_size": LARGEST_MESSAGE, "session_token_expiration": 3600}
    address = f"http://{shown}:{port}/"
    if not is_local:
        token = secrets.token_urlsafe(24)
        options["auth_provider"] = Token(token)
        address += f"?token={token}"

    def page() -> Any:  # Panel takes plain functions only
        return page_of(make)

    server = pn.io.server.get_server(
        {"/": page},
        port=port,
        address=host,
        websocket_origin=origins,
        title="softgrip explore",
        show=False,
        liveness="alive",
        start=False,
        **options,
    )
    return server, address


def serve(make: Callable[[], Session], host: str, port: int, opens: bool, tell: Callable[[str], None]) -> None:
    """Serve until Ctrl-C."""
    sys.setswitchinterval(SWITCH)
    gc.set_threshold(*COLLECTED)
    logging.getLogger("bokeh.server.views.ws").setLevel(logging.ERROR)  # a page that was closed is no news
    warm(make)
    server, address = server_of(make, host, port)
    server.start()
    tell(address)
    if opens:
        webbrowser.open(address)
    try:
        server.io_loop.start()
    finally:
        server.stop()
