"""The server as a process: an address that is bound before anything starts, and an orderly end.

Rules of this file: it listens on loopback, and to other machines with TLS alone; what cannot be had is
one line.
"""

from __future__ import annotations

import asyncio
import re
import socket
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

import uvicorn

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guide.guide import NOT_KEPT, KeptCalibrations
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.server import application
from hoopd.dashboard.work.bench import Bench
from hoopd.files.reading import InputError

LISTEN = "127.0.0.1:8765"
REQUEST_BYTES = 16384  # of a browser's WebSocket message: we read none
CONNECTIONS = 128
END_S = 2  # for open pages, when the server ends
_ADDRESS = re.compile(r"(?P<host>\[[0-9a-fA-F:]+\]|[^\s:\[\]/]+):(?P<port>\d{1,5})")


@dataclass(frozen=True, kw_only=True)
class ServerAddress:
    """Where the page is served, and under which names."""

    listen: str = LISTEN
    names: tuple[str, ...] = ()  # beside the address itself and localhost
    certificate: Path | None = None
    key: Path | None = None


def bind(where: ServerAddress) -> socket.socket:
    """A listening socket; InputError for a place that is no place of this machine, or reaches others without TLS."""
    match = _ADDRESS.fullmatch(where.listen)
    if match is None or int(match["port"]) > 65535:
        raise InputError("--listen", "", f"{where.listen!r}: expected something like {LISTEN}")
    host = match["host"].strip("[]")
    if (where.certificate is None) != (where.key is None):
        raise InputError("--certificate", "", "goes with --key")
    for option, path in (("--certificate", where.certificate), ("--key", where.key)):
        if path is not None and not path.is_file():
            raise InputError(path, option, "no such file")
    if where.certificate is None and not _is_loopback(host):
        raise InputError("--listen", "", f"{host}: other machines reach it: give --certificate and --key, or 127.0.0.1")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, int(match["port"])), family=family)
    except OSError as error:
        raise InputError("--listen", "", f"{where.listen}: {(error.strerror or str(error)).lower()}") from None


def server_of(
    feed: Feed,
    operators: Operators,
    audit: Audit,
    listening: socket.socket,
    where: ServerAddress | None = None,
    bench: Bench | None = None,
    kept: KeptCalibrations = NOT_KEPT,
    followed: Sequence[Path] = (),
) -> uvicorn.Server:
    """The server of a feed at a socket, not yet running; it answers to that address, to localhost and to its names."""
    where = where or ServerAddress()
    config = uvicorn.Config(
        application(
            feed, operators, audit, ("localhost", listening.getsockname()[0], *where.names), bench, kept, followed
        ),
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws_max_size=REQUEST_BYTES,
        ws_per_message_deflate=False,
        limit_concurrency=CONNECTIONS,
        timeout_graceful_shutdown=END_S,
        ssl_certfile=where.certificate,
        ssl_keyfile=where.key,
    )
    return uvicorn.Server(config)


def address(listening: socket.socket, where: ServerAddress) -> str:
    """What a person opens."""
    host, port = listening.getsockname()[:2]
    shown = where.names[0] if where.names else f"[{host}]" if ":" in host else host
    return f"{'http' if where.certificate is None else 'https'}://{shown}:{port}/"


def serve(
    feed: Feed,
    operators: Operators,
    audit: Audit,
    where: ServerAddress,
    say: Callable[[str], None],
    bench: Bench | None = None,
    kept: KeptCalibrations = NOT_KEPT,
    followed: Sequence[Path] = (),
) -> None:
    """Serve until the process is told to end; `say` is told the page's address."""
    with bind(where) as listening:
        try:
            server = server_of(feed, operators, audit, listening, where, bench, kept, followed)
            server.config.load()
        except (ssl.SSLError, OSError) as error:
            raise InputError(where.certificate or "", "--certificate", f"cannot be used: {error}") from None
        say(address(listening, where))
        asyncio.run(server.serve(sockets=[listening]))


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
