"""The one WebSocket: what is new of every device, in one frame at most twenty times a second.

Rules of this file: a browser that is slow gets the newest rows and misses the ones between; nobody waits for it. What
it sends is not read.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Any

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import Seen
from hoopd.dashboard.feed import Feed

FRAME_S = 0.05
ROWS = 250  # in one frame, five seconds: who was away for longer asks for the history
HEARTBEAT_S = 1.0
STALLED_S = 10.0  # a browser that has taken nothing for so long is let go
READERS = 32
BUSY = 1013  # RFC 6455's registry: try again later


class Live:
    """All browsers that look."""

    def __init__(self, feed: Feed, audit: Audit) -> None:
        self._feed, self._audit = feed, audit
        self.readers = 0

    async def serve(self, socket: WebSocket) -> None:
        """One browser, until it goes."""
        if self.readers >= READERS:
            await socket.close(BUSY, f"{READERS} pages look already")
            return
        await socket.accept()
        self.readers += 1
        gone = asyncio.ensure_future(_gone(socket))
        try:
            with contextlib.suppress(WebSocketDisconnect, TimeoutError, RuntimeError):
                await self._tell(socket, gone)
        finally:
            self.readers -= 1
            gone.cancel()

    async def _tell(self, socket: WebSocket, gone: asyncio.Future[None]) -> None:
        seen: dict[str, Seen] = {}
        troubles: dict[str, str] | None = None
        told_at, audited = 0.0, 0
        while not gone.done():
            frame: dict[str, Any] = {"devices": self._news(seen)}
            if troubles != self._feed.troubles():
                frame["endpoints"] = troubles = self._feed.troubles()
            if audited != self._audit.count:
                audited, frame["audit"] = self._audit.count, self._audit.latest
            now = time.monotonic()
            if len(frame) > 1 or frame["devices"] or now - told_at >= HEARTBEAT_S:
                frame["now"], told_at = time.time(), now
                await asyncio.wait_for(socket.send_text(msgspec.json.encode(frame).decode()), STALLED_S)
            await asyncio.wait([gone], timeout=max(0.0, FRAME_S - (time.monotonic() - now)))

    def _news(self, seen: dict[str, Seen]) -> dict[str, Any]:
        """By device, those with something new alone."""
        news = {}
        for identity, device in self._feed.devices.items():
            told = device.news(seen.setdefault(identity, Seen(row=device.history.count)), ROWS)
            if told:
                news[identity] = told
        return news


async def _gone(socket: WebSocket) -> None:
    """Until the browser hangs up."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await socket.receive_bytes()
