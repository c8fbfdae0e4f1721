"""The web server: the page, its files, the live frames, the history, and the buttons.

Rules of this file: routes alone; what a request costs is bounded; a call that waits for a daemon waits in a thread.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guards import RequestGuard
from hoopd.dashboard.live import Live
from hoopd.recording.schemas import TICK

STATIC = Path(__file__).parent / "static"


def application(feed: Feed, names: Sequence[str]) -> Starlette:
    """The server's routes over a feed; `names` are the hosts that it answers to."""
    pages = Pages(feed)
    routes = [
        Route("/", pages.page),
        Route("/api/channels", pages.channels),
        Route("/api/history", pages.history),
        Route("/api/stop", pages.stop, methods=["POST"]),
        WebSocketRoute("/api/live", Live(feed).serve),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]

    @contextlib.asynccontextmanager
    async def listening(app: Starlette) -> AsyncIterator[None]:
        feed.start()
        yield
        await asyncio.to_thread(feed.close)

    return Starlette(routes=routes, middleware=[Middleware(RequestGuard, names=names)], lifespan=listening)


class Pages:
    """What is answered to a request."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed

    async def page(self, request: Request) -> Response:
        """The page itself."""
        return FileResponse(STATIC / "index.html")

    async def channels(self, request: Request) -> Response:
        """Unit and meaning of what a tick tells."""
        return JSONResponse({name: {"unit": one.unit, "meaning": one.meaning} for name, one in TICK.items()})

    async def history(self, request: Request) -> Response:
        """All that is kept of one device."""
        device = self._feed.devices.get(request.query_params.get("device", ""))
        if device is None:
            return JSONResponse({"ok": False, "reason": "no such device"}, 404)
        return Response(await asyncio.to_thread(device.packed), media_type="application/octet-stream")

    async def stop(self, request: Request) -> Response:
        """Disarm every device that the page shows, all at once, without a login: everybody may stop."""
        devices = list(self._feed.devices.values())
        answers = await asyncio.gather(*(asyncio.to_thread(self._feed.send, one, "disarm") for one in devices))
        return JSONResponse({"ok": bool(answers) and all(one["ok"] for one in answers), "answers": answers})
