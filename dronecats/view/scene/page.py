"""The web server of a page. It prints nothing, listens on the loopback address, and requires a token."""

import contextlib
import functools
import hmac
import http
import logging
import secrets
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from urllib.parse import parse_qs, urlsplit

import rich
import viser
import websockets.asyncio.server as websocket_server
from websockets import Headers, Request, Response
from websockets.asyncio.server import ServerConnection

from dronecats.report.kit import palette
from dronecats.view.scene.page_hosts import LOOPBACK_NAMES

HOST = "127.0.0.1"  # this machine only, since users of a page can control dronecats
FORBIDDEN = (
    "This page opens only at the full address that dronecats printed, with its token, on the same machine.\n"
    "To open it under another host name, start dronecats with --host NAME (with --view: --view-host NAME).\n"
)
_STARTING = threading.Lock()  # held while `websockets` is patched

ProcessRequest = Callable[[ServerConnection, Request], Response | None]


class Gate:
    """Admits requests that come from this page's own address with the page's token.

    A web site in the same browser can send requests to a loopback address, and the site's host name can resolve to
    that address (DNS rebinding). So the Host header must be a loopback name or one of `names`, and an Origin header
    must name the same host. The token must be in the address, or in the cookie that the first answer sets. The cookie
    has the port in its name, since browsers share the cookies of a host between ports.
    """

    def __init__(self, names: Sequence[str] = ()) -> None:
        """`names`: admitted host names in addition to the loopback names, such as the name of an HTTPS proxy."""
        self.token = secrets.token_urlsafe(16)
        self._names = frozenset(name.lower() for name in names)

    def admits(self, request: Request, port: int) -> bool:
        """Return whether a request to the server on `port` is admitted."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or len(origins) > 1:
            return False
        name = _name(hosts[0])
        schemes = ("http", "https") if name in self._names else ("http",) if name in LOOPBACK_NAMES else ()
        if not schemes or (origins and origins[0] not in [f"{scheme}://{hosts[0]}" for scheme in schemes]):
            return False
        shown = [*self._in_address(request), *self._in_cookies(request, port)]
        return any(hmac.compare_digest(value.encode(), self.token.encode()) for value in shown)

    def guarded(self, answer: ProcessRequest | None) -> ProcessRequest:
        """Return a server's `process_request`. It calls `answer` for admitted requests, and returns 403 for others."""

        def process(connection: ServerConnection, request: Request) -> Response | None:
            port = int(connection.local_address[1])
            if not self.admits(request, port):
                body = FORBIDDEN.encode()
                headers = Headers([("Content-Type", "text/plain"), ("Content-Length", str(len(body)))])
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, body)
            response = answer(connection, request) if answer else None
            if response is not None and self._in_address(request):
                cookie = f"{_cookie(port)}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                response.headers["Set-Cookie"] = cookie
            return response

        return process

    @staticmethod
    def _in_address(request: Request) -> list[str]:
        return parse_qs(urlsplit(request.path).query).get("token", [])

    @staticmethod
    def _in_cookies(request: Request, port: int) -> Iterator[str]:
        for header in request.headers.get_all("Cookie"):
            for pair in header.split(";"):
                name, _, value = pair.strip().partition("=")
                if name == _cookie(port):
                    yield value


def _cookie(port: int) -> str:
    return f"dronecats-{port}"


def _name(host: str) -> str:
    """Return the host name in a Host header, without the port; empty if the header is malformed."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


class LoopbackServer(viser.ViserServer):
    """viser's server behind a gate. It never requests a public address."""

    def __init__(self, label: str, port: int, hosts: Sequence[str] = ()) -> None:
        """Serve a page with the title `label` on `port`, or on the next free port. Raises OSError if no port is free.

        `hosts`: host names that may open the page, in addition to the loopback names. The server listens on the
        loopback address only.
        """
        self._gate = Gate(hosts)
        rich.get_console().quiet = True  # viser prints to it, in threads as well
        with _gated(self._gate):
            super().__init__(host=HOST, port=port, label=label, verbose=False)
        accent = palette.rgb(palette.LIGHT["accent"])
        self.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=accent)
        logging.getLogger("websockets").setLevel(logging.CRITICAL)

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        return f"http://{HOST}:{self.get_port()}/?token={self._gate.token}"

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing, since a page has no public address."""


def by_user(act: Callable[[], object]) -> Callable[[Any], Any]:
    """Return a callback that calls `act` for events from browsers and ignores updates by the program."""

    async def changed(event: Any) -> None:  # async: viser then calls it in the order of the events
        if event.client is not None:
            act()

    return changed


@contextlib.contextmanager
def _gated(gate: Gate) -> Iterator[None]:
    """Put a gate in front of the server that starts in this context.

    This patches `websockets`, since viser has no option for `process_request`.
    """
    serve = websocket_server.serve

    def guarded_serve(*args: object, process_request: ProcessRequest | None = None, **settings: object) -> object:
        return serve(*args, process_request=gate.guarded(process_request), **settings)  # type: ignore[arg-type]

    with _STARTING:
        websocket_server.serve = functools.wraps(serve)(guarded_serve)  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websocket_server.serve = serve  # type: ignore[misc]
