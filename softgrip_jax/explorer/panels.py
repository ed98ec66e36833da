"""Panel's part of the server: a page with a session of its own for every browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn
from bokeh.core.validation import silence
from bokeh.core.validation.warnings import EMPTY_LAYOUT
from bokeh.server.auth_provider import AuthProvider
from bokeh.server.tornado import BokehTornado
from jinja2 import Template
from panel.io.application import build_applications

from .page import page_of
from .session import Session

EXPIRES = 3600
"""Seconds in which a browser may use the page that it was given."""
ITEM = Template("{{ docs[0].to_json() | tojson }}")
"""What Panel answers: not a whole page, but what the frame needs to show one."""


class Checked(AuthProvider):
    """Who may ask: check(handler) raises for all others."""

    def __init__(self, check: Callable[[Any], None]):
        self.check = check
        super().__init__()

    @property
    def get_user(self) -> Any:
        def user(handler: Any) -> str:
            self.check(handler)
            return "explorer"

        return user

    get_user_async: Any = None
    login_url: Any = "/"
    get_login_url: Any = None
    login_handler: Any = None
    logout_url: Any = None
    logout_handler: Any = None


def server_of(
    make: Callable[[], Session], place: str, origins: list[str], check: Callable[[Any], None], largest: int
) -> BokehTornado:
    """The application beneath an address.

    origins: of the pages that may open a WebSocket. check: raises for a request that may not be answered. largest:
    bytes of a message.
    """
    pn.extension("plotly", notifications=False)
    silence(EMPTY_LAYOUT, True)  # some parts are filled later

    def page() -> Any:  # Panel takes plain functions only
        found = page_of(make)
        document: Any = pn.state.curdoc
        document.template = ITEM
        return found

    return BokehTornado(
        build_applications({place: page}, title="softgrip explore", location=False),
        extra_websocket_origins=origins,
        websocket_max_message_size_bytes=largest,
        session_token_expiration=EXPIRES,
        auth_provider=Checked(check),
    )
