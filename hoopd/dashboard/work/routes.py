"""What a browser may ask of the bench: everybody may look and plot, who is logged in may work.

Rules of this file: what waits waits in a thread; files leave as what they are, with the rights of a stranger; every
order is written down.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar
from urllib.parse import quote

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.guards import RESULT_HEADERS
from hoopd.dashboard.operators import Login, Operators
from hoopd.dashboard.orders import WrittenOrders
from hoopd.dashboard.requests import BODY_BYTES
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.forms import JobOrder
from hoopd.dashboard.work.jobs import FILES
from hoopd.dashboard.work.recordings import Remark
from hoopd.files.reading import InputError

REMARK_BYTES, ORDER_BYTES = 20_000, 20_000
Wanted = TypeVar("Wanted")
NO_BENCH = "this server was started without --recordings"


class JobNumber(msgspec.Struct, forbid_unknown_fields=True):
    """Which job."""

    number: int


class WorkRoutes:
    """Routes over a bench, or over none."""

    def __init__(self, bench: Bench | None, operators: Operators, audit: Audit) -> None:
        self._bench, self._orders = bench, WrittenOrders(operators, audit)

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/api/work", self.work),
            Route("/api/work/recording", self.recording),
            Route("/api/work/plot", self.plot),
            Route("/api/work/file", self.file),
            Route("/api/work/controllers", self.controllers),
            Route("/api/work/hand_over", self.hand_over, methods=["POST"]),
            Route("/api/work/remark", self.remark, methods=["POST"]),
            Route("/api/work/ask", self.ask, methods=["POST"]),
            Route("/api/work/again", self.again, methods=["POST"]),
            Route("/api/work/cancel", self.cancel, methods=["POST"]),
            Route("/api/work/remove", self.remove, methods=["POST"]),
        ]

    async def work(self, request: Request) -> Response:
        """Recordings, jobs, and what may be asked for."""
        if self._bench is None:
            return JSONResponse({"offered": False, "reason": NO_BENCH})
        return JSONResponse(await asyncio.to_thread(self._bench.told))

    async def recording(self, request: Request) -> Response:
        """A recording as a file."""
        name = request.query_params.get("name", "")
        try:
            path = await asyncio.to_thread(self._own.recordings.path, name)
        except InputError as error:
            return _missing(error)
        disposition = f"attachment; filename*=UTF-8''{quote(name, safe='')}"
        return FileResponse(path, media_type="application/octet-stream", headers={"content-disposition": disposition})

    async def plot(self, request: Request) -> Response:
        """A page that plots recordings."""
        names = request.query_params.getlist("name")
        try:
            path = await asyncio.to_thread(self._own.plots.page, names)
        except InputError as error:
            return _missing(error)
        return HTMLResponse(await asyncio.to_thread(path.read_bytes), headers=RESULT_HEADERS)

    async def file(self, request: Request) -> Response:
        """Something that a job wrote."""
        name, number = request.query_params.get("name", ""), request.query_params.get("job", "")
        try:
            if not (number.isascii() and number.isdigit() and len(number) < 10):
                raise InputError("job", number[:40], "no such job")
            path = await asyncio.to_thread(self._own.jobs.file, int(number), name)
        except InputError as error:
            return _missing(error)
        return FileResponse(path, media_type=FILES[name], headers=RESULT_HEADERS)

    async def controllers(self, request: Request) -> Response:
        """What a daemon could load, as NAME.yaml@SHA256."""
        folder = None if self._bench is None else self._bench.controllers
        listed = [] if folder is None else await asyncio.to_thread(folder.listed)
        return JSONResponse([one._asdict() for one in listed])

    async def hand_over(self, request: Request) -> Response:
        """Lay a job's controller where the daemon can load it."""

        def laid_in(bench: Bench, job: JobNumber, name: str) -> dict[str, Any]:
            return {
                "command": f"controller of job {job.number} to the daemon's folder",
                "value": bench.hand_over(job.number),
            }

        return await self._changed(request, JobNumber, laid_in)

    async def remark(self, request: Request) -> Response:
        """Keep tags and a note of a recording."""

        def kept(bench: Bench, wanted: Remark, name: str) -> dict[str, Any]:
            bench.recordings.remark(wanted)
            return {"command": "remark", "value": wanted.name}

        return await self._changed(request, Remark, kept, REMARK_BYTES)

    async def ask(self, request: Request) -> Response:
        """Put a job in the queue."""

        def asked(bench: Bench, order: JobOrder, name: str) -> dict[str, Any]:
            return {"command": f"job {order.kind}", "value": bench.ask(order, name).number, "queued": True}

        return await self._changed(request, JobOrder, asked, ORDER_BYTES)

    async def again(self, request: Request) -> Response:
        """The same job once more."""

        def asked(bench: Bench, job: JobNumber, name: str) -> dict[str, Any]:
            return {"command": f"job {job.number} again", "value": bench.again(job.number, name).number, "queued": True}

        return await self._changed(request, JobNumber, asked)

    async def cancel(self, request: Request) -> Response:
        """End a job."""

        def ended(bench: Bench, job: JobNumber, name: str) -> dict[str, Any]:
            bench.jobs.cancel(job.number)
            return {"command": "job cancelled", "value": job.number}

        return await self._changed(request, JobNumber, ended)

    async def remove(self, request: Request) -> Response:
        """Throw a job's results away."""

        def gone(bench: Bench, job: JobNumber, name: str) -> dict[str, Any]:
            bench.jobs.remove(job.number)
            return {"command": "job removed", "value": job.number}

        return await self._changed(request, JobNumber, gone)

    @property
    def _own(self) -> Bench:
        if self._bench is None:
            raise InputError("bench", "", NO_BENCH)
        return self._bench

    async def _changed(
        self,
        request: Request,
        kind: type[Wanted],
        change: Callable[[Bench, Wanted, str], dict[str, Any]],
        most_bytes: int = BODY_BYTES,
    ) -> Response:
        """Let somebody who is logged in change something on the bench."""

        def done(login: Login, _: str, content: Wanted) -> dict[str, Any]:
            return change(self._own, content, login.user)

        return await self._orders.done(request, kind, done, most_bytes)


def _missing(error: InputError) -> Response:
    """One line, which may stand where a page of results would."""
    return PlainTextResponse(f"{error}\n", 404, headers=RESULT_HEADERS)
