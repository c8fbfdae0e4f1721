"""The live frames: nobody waits for a browser that is slow, and it gets the newest when it is back."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from starlette.websockets import WebSocket

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.live import READERS, ROWS, Live

ENDPOINT = "tcp/127.0.0.1:1"


class Browser:
    """The other end of a WebSocket: takes a frame whenever it is let."""

    def __init__(self) -> None:
        self.frames: list[dict[str, Any]] = []
        self.closed: dict[str, Any] = {}
        self.reads = asyncio.Event()
        self.gone = asyncio.Event()
        self._asked = 0

    async def receive(self) -> dict[str, Any]:
        self._asked += 1
        if self._asked == 1:
            return {"type": "websocket.connect"}
        await self.gone.wait()
        return {"type": "websocket.disconnect", "code": 1000}

    async def send(self, message: Any) -> None:
        if message["type"] == "websocket.close":
            self.closed = message
        elif message["type"] == "websocket.send":
            await self.reads.wait()
            self.frames.append(json.loads(message["text"]))

    def rows(self) -> list[int]:
        """Numbers of the rows that came."""
        news = [frame["devices"][f"hoop@{ENDPOINT}"] for frame in self.frames if frame["devices"]]
        return [one["first"] + place for one in news for place in range(len(one.get("rows", [])))]


def feed_with_a_device() -> tuple[Feed, ShownDevice]:
    """A feed that was never started, and its one device."""
    feed = Feed([ENDPOINT], {})
    device = feed.connections[0].devices["hoop"] = ShownDevice("hoop", ENDPOINT)
    return feed, device


def tick(device: ShownDevice, rows: int) -> None:
    for _ in range(rows):
        device.take("tick", json.dumps({"t": device.history.count * 0.02}).encode(), "run")


async def until(condition: Any) -> None:
    async with asyncio.timeout(10.0):
        while not condition():
            await asyncio.sleep(0.01)


def test_a_browser_that_takes_nothing_holds_up_no_other_and_misses_the_oldest() -> None:
    async def run() -> tuple[Browser, Browser]:
        feed, device = feed_with_a_device()
        live, quick, slow = Live(feed, Audit()), Browser(), Browser()
        quick.reads.set()
        scope = {"type": "websocket"}
        served = [asyncio.create_task(live.serve(WebSocket(scope, one.receive, one.send))) for one in (quick, slow)]
        await until(lambda: live.readers == 2)
        for _ in range(4):
            rows = device.history.count + 100
            tick(device, 100)
            await until(lambda rows=rows: quick.rows()[-1:] == [rows - 1])
        assert slow.frames == []
        slow.reads.set()
        await until(lambda: slow.rows()[-1:] == [399])
        for one in (quick, slow):
            one.gone.set()
        await asyncio.gather(*served)
        assert live.readers == 0
        return quick, slow

    quick, slow = asyncio.run(run())
    assert quick.rows() == list(range(400))
    assert len(slow.rows()) <= ROWS and slow.rows()[-1] == 399


def test_there_is_room_for_so_many_browsers_and_the_next_is_told() -> None:
    async def run() -> Browser:
        live, browser = Live(Feed([], {}), Audit()), Browser()
        live.readers = READERS
        await live.serve(WebSocket({"type": "websocket"}, browser.receive, browser.send))
        return browser

    assert asyncio.run(run()).closed["reason"] == f"{READERS} pages look already"
