"""The web server: the page, its files, the live frames and the history.

Rules of this file: routes that only read; what a request costs is bounded, what waits waits in a thread.
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

from hoopd.dashboard.actions import Actions
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.calibration import Calibration
from hoopd.dashboard.comparisons import Comparisons
from hoopd.dashboard.experiments import Experiments
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.followed import FollowedFolders
from hoopd.dashboard.guards import RequestGuard
from hoopd.dashboard.guide.guide import NOT_KEPT, Guide, KeptCalibrations
from hoopd.dashboard.guide.routes import GuideRoutes
from hoopd.dashboard.live import Live
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.pictures import Pictures
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.routes import WorkRoutes
from hoopd.recording.schemas import TICK

SWEEP_S = 30.0
STATIC = Path(__file__).parent / "static"


def application(
    feed: Feed,
    operators: Operators,
    audit: Audit,
    names: Sequence[str],
    bench: Bench | None = None,
    kept: KeptCalibrations = NOT_KEPT,
    followed: Sequence[Path] = (),
) -> Starlette:
    """The server's routes over a feed.

    names : hosts that it answers to
    bench : what work it offers
    kept : where accepted calibrations go
    followed : folders of `hoopd learn` and `hoopd heal`
    """
    pages, comparisons = Pages(feed), Comparisons(feed, operators, audit, bench)
    routes = [
        Route("/", pages.page),
        Route("/api/channels", pages.channels),
        Route("/api/history", pages.history),
        *Actions(feed, operators, audit).routes,
        *Calibration(feed).routes,
        *comparisons.routes,
        *Experiments(feed, operators, audit, bench).routes,
        *GuideRoutes(Guide(feed, bench, kept), feed, operators, audit).routes,
        *WorkRoutes(bench, operators, audit).routes,
        *FollowedFolders(followed, operators, audit).routes,
        WebSocketRoute("/api/live", Live(feed, audit).serve),
        WebSocketRoute("/api/picture", Pictures(feed).serve),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]

    @contextlib.asynccontextmanager
    async def listening(app: Starlette) -> AsyncIterator[None]:
        feed.start()
        if bench is not None:
            bench.start()
        sweeping = asyncio.create_task(_sweep(operators))
        yield
        sweeping.cancel()
        await asyncio.to_thread(comparisons.close)
        if bench is not None:
            await asyncio.to_thread(bench.close)
        await asyncio.to_thread(operators.close)
        await asyncio.to_thread(feed.close)

    return Starlette(routes=routes, middleware=[Middleware(RequestGuard, names=names)], lifespan=listening)


async def _sweep(operators: Operators) -> None:
    """End logins that nobody uses any more, whether or not somebody asks."""
    while True:
        await asyncio.sleep(SWEEP_S)
        await asyncio.to_thread(operators.sweep)


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
