"""The server as a process: an address that is bound before anything starts, and an orderly end.

Rules of this file: it listens on loopback; what cannot be had is one line.
"""

from __future__ import annotations

import asyncio
import re
import socket
from collections.abc import Callable, Mapping, Sequence
from ipaddress import ip_address
from typing import Any

import uvicorn

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.server import application
from hoopd.files.reading import InputError

LISTEN = "127.0.0.1:8765"
REQUEST_BYTES = 16384  # of a browser's WebSocket message: we read none
CONNECTIONS = 128
END_S = 2  # for open pages, when the server ends
_ADDRESS = re.compile(r"(?P<host>\[[0-9a-fA-F:]+\]|[^\s:\[\]/]+):(?P<port>\d{1,5})")


def bind(listen: str, *, option: str = "--listen") -> socket.socket:
    """A listening socket at HOST:PORT of this machine; InputError for any other place."""
    match = _ADDRESS.fullmatch(listen)
    if match is None or int(match["port"]) > 65535:
        raise InputError(option, "", f"{listen!r}: expected something like {LISTEN}")
    host = match["host"].strip("[]")
    if not _is_loopback(host):
        raise InputError(option, "", f"{host!r} is not this machine alone: use 127.0.0.1, localhost or [::1]")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, int(match["port"])), family=family)
    except OSError as error:
        raise InputError(option, "", f"{listen}: {(error.strerror or str(error)).lower()}") from None


def server_of(feed: Feed, listening: socket.socket) -> uvicorn.Server:
    """The server of a feed at a socket, not yet running; it answers to that address and to localhost."""
    names = ("localhost", listening.getsockname()[0])
    config = uvicorn.Config(
        application(feed, names),
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws_max_size=REQUEST_BYTES,
        ws_per_message_deflate=False,
        limit_concurrency=CONNECTIONS,
        timeout_graceful_shutdown=END_S,
    )
    return uvicorn.Server(config)


def address(listening: socket.socket) -> str:
    """What a person opens."""
    host, port = listening.getsockname()[:2]
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def serve(endpoints: Sequence[str], extras: Mapping[str, Any], listen: str, say: Callable[[str], None]) -> None:
    """Serve until the process is told to end; `say` is told the page's address."""
    feed = Feed(endpoints, extras)
    with bind(listen) as listening:
        say(address(listening))
        asyncio.run(server_of(feed, listening).serve(sockets=[listening]))


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
