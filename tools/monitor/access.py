"""Who may use the page: a token in the printed address, then a cookie; no other site's pages.

The Host check keeps out DNS rebinding, the Origin check and SameSite=Strict keep out pages of other
sites, the token keeps out everybody else (OWASP cross-site request forgery cheat sheet).
"""

import contextlib
import secrets
import socket
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tools.monitor import LOOPBACK_NAMES

BODY_LIMIT_BYTES = 1 << 16  # some hundred marks
SAFE_METHODS = ("GET", "HEAD")
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
# A page of our own leads on to the monitor, because a Strict cookie does not travel with a
# redirect that another program or site began.
ENTER = (
    '<!doctype html><title>duckpilot</title><link rel="icon" href="data:,">'
    '<meta http-equiv="refresh" content="0;url=/">'
)
NO_TOKEN = "Open the address that the monitor printed when it started: it holds the token.\n"


class AccessGate:
    """ASGI middleware around the whole application; ``host`` is where the server listens."""

    def __init__(self, app: ASGIApp, token: str, host: str) -> None:
        self._app, self._token = app, token
        self._any_address = host in ("0.0.0.0", "::")
        self._hosts = {*LOOPBACK_NAMES, host}
        if self._any_address:
            name = socket.gethostname().lower()
            self._hosts |= {name, f"{name}.local"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed, answer 400, 401 or 403 to the rest."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        response = self._answer(connection) or _size_problem(connection)
        if response is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await response(scope, receive, _with_headers(send))

    def _answer(self, connection: HTTPConnection) -> Response | None:
        """None to pass on, else what to answer."""
        host = connection.headers.get("host", "")
        if not self._known_host(host):
            return PlainTextResponse(f"unknown host {host!r}\n", 400)
        method = connection.scope.get("method", "WEBSOCKET")
        origin = connection.headers.get("origin", "").lower()
        ours = origin in (f"http://{host}".lower(), f"https://{host}".lower())
        if method not in SAFE_METHODS and not ours:
            return PlainTextResponse("this request came from another site\n", 403)
        cookie = f"duckpilot_{urlsplit(f'//{host}').port or 80}"
        given = connection.query_params.get("token")
        if given is not None and method == "GET" and self._right(given):
            response = HTMLResponse(ENTER)
            response.set_cookie(cookie, self._token, httponly=True, samesite="strict")
            return response
        if not self._right(connection.cookies.get(cookie, "")):
            return PlainTextResponse(NO_TOKEN, 401)
        return None

    def _right(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._token.encode())

    def _known_host(self, host: str) -> bool:
        with contextlib.suppress(ValueError):  # of what is no address
            named = urlsplit(f"//{host}")
            name = "" if named.port == 0 else named.hostname or ""  # a port that is none raises
            return name in self._hosts or (self._any_address and bool(ip_address(name)))
        return False


def _size_problem(connection: HTTPConnection) -> Response | None:
    """A refusal of a body that is larger than anything the page sends, or does not say its size."""
    if connection.scope.get("method", "GET") in SAFE_METHODS:
        return None
    size = connection.headers.get("content-length", "")
    if not (size.isascii() and size.isdigit() and len(size) < 9 and int(size) <= BODY_LIMIT_BYTES):
        told = f"expected Content-Length, at most {BODY_LIMIT_BYTES} bytes\n"
        return PlainTextResponse(told, 413)
    return None


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(HEADERS)
        await send(message)

    return sending
