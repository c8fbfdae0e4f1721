"""Who may ask this server: names it answers to, pages that may send to it, and what its own page may do.

Rules of this file: a request that does not say where it comes from is refused wherever it could change something; the
page may run its own files and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self'",
        "connect-src 'self'",
        "frame-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-cache",
}
# Of a page or picture that a command wrote, perhaps about somebody else's file: it runs with the rights of a stranger,
# fetches nothing, and is shown inside our own page alone.
RESULT_HEADERS = {
    "content-security-policy": "; ".join(
        (
            "sandbox allow-scripts",
            "default-src 'none'",
            "script-src 'unsafe-inline'",
            "style-src 'unsafe-inline'",
            "img-src data:",
            "font-src data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'self'",
        )
    ),
    "x-frame-options": "SAMEORIGIN",
}
SAFE = ("GET", "HEAD")
FOREIGN = "this comes from another page, or does not say from which"
UNKNOWN_NAME = "this server is not known by that name (--name)"
FORBIDDEN = 1008  # RFC 6455, 7.4.1: policy violation


class RequestGuard:
    """Around the whole application, its WebSocket included."""

    def __init__(self, app: ASGIApp, names: Iterable[str]) -> None:
        """`names`: hosts that the server answers to; a foreign name that leads here is somebody else's page."""
        self._app, self._names = app, frozenset(name.lower() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or let through with the headers that every answer has."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        wrong = self._wrong(scope)
        if wrong and scope["type"] == "websocket":
            await WebSocketClose(FORBIDDEN, wrong)(scope, receive, send)
            return
        answer = JSONResponse({"ok": False, "reason": wrong}, 403) if wrong else self._app

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await answer(scope, receive, guarded)

    def _wrong(self, scope: Scope) -> str:
        """Why it is refused; empty when it is not."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _name(f"//{host}") not in self._names:
            return UNKNOWN_NAME
        if scope["type"] == "http" and scope["method"] in SAFE:
            return ""
        scheme = "https" if scope["scheme"] in ("https", "wss") else "http"
        return "" if headers.get("origin", "") == f"{scheme}://{host}" else FOREIGN


def _name(address: str) -> str:
    """The host of an address without its port, in small letters; empty when there is none."""
    try:
        return urlsplit(address).hostname or ""
    except ValueError:
        return ""
