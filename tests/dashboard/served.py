"""A web server of the page in this process, and what a program may ask of it."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn
from shell.peers import wait_until

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guide.guide import NOT_KEPT, KeptCalibrations
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.process import ServerAddress, bind, server_of
from hoopd.dashboard.work.bench import Bench


class Answer(NamedTuple):
    """Of the server to one request."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        """Its content."""
        return json.loads(self.body)


class Served:
    """A server that runs, and its feed."""

    def __init__(self, feed: Feed, port: int, server: uvicorn.Server, thread: threading.Thread) -> None:
        self.feed, self.port = feed, port
        self.origin = f"http://127.0.0.1:{port}"
        self._server, self._thread = server, thread

    def stop(self) -> None:
        """End it in order."""
        self._server.should_exit = True
        self._thread.join(10.0)
        assert not self._thread.is_alive()

    def ask(self, path: str, method: str = "GET", content: Any = None, **headers: str) -> Answer:
        """A request with these headers alone; `host` is the server's own unless it is given."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60.0)
        body = None if content is None else json.dumps(content).encode()
        with contextlib.closing(connection):
            connection.request(method, path, body, {key.replace("_", "-"): value for key, value in headers.items()})
            answer = connection.getresponse()
            return Answer(answer.status, {key.lower(): value for key, value in answer.getheaders()}, answer.read())

    def post(self, path: str, content: Any = None, **headers: str) -> Answer:
        """A request as the page itself sends it."""
        return self.ask(path, "POST", {} if content is None else content, **{"origin": self.origin, **headers})


@contextlib.contextmanager
def served(
    feed: Feed,
    operators: Operators | None = None,
    audit: Audit | None = None,
    bench: Bench | None = None,
    *,
    port: int = 0,
    kept: KeptCalibrations = NOT_KEPT,
    followed: Sequence[Path] = (),
) -> Iterator[Served]:
    """The page's server on a free port, or on one that is known, until the block ends."""
    with bind(ServerAddress(listen=f"127.0.0.1:{port}")) as listening:
        server = server_of(
            feed, operators or Operators({}), audit or Audit(), listening, bench=bench, kept=kept, followed=followed
        )
        thread = threading.Thread(target=lambda: asyncio.run(server.serve(sockets=[listening])))
        thread.start()
        web = Served(feed, listening.getsockname()[1], server, thread)
        try:
            assert wait_until(lambda: server.started)
            yield web
        finally:
            web.stop()
