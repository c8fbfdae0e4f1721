"""What a browser may ask of the guided calibration: everybody may look, who is logged in may do.

Rules of this file: what waits waits in a thread; every answer that changed something is written down.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from hoopd.core.succession import EXPERIMENT
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guards import RESULT_HEADERS
from hoopd.dashboard.guide.guide import Guide
from hoopd.dashboard.guide.motion import SETTLE_S, now_s
from hoopd.dashboard.operators import Login, Operators
from hoopd.dashboard.orders import WrittenOrders
from hoopd.files.calibration_signal import SECONDS
from hoopd.files.reading import InputError

TYPES = {"jpg": "image/jpeg", "svg": "image/svg+xml", "json": "application/json"}
Wanted = TypeVar("Wanted", bound="ForDevice")


class ForDevice(msgspec.Struct):
    """Which device is meant."""

    device: str


class StepOrder(ForDevice, forbid_unknown_fields=True):
    """A step to do."""

    step: str


class Acceptance(ForDevice, forbid_unknown_fields=True):
    """Steps whose results are accepted."""

    steps: list[str]
    why: str = ""


class Restoration(ForDevice, forbid_unknown_fields=True):
    """A version to take again."""

    number: int


class GuideRoutes:
    """Routes over a guide."""

    def __init__(self, guide: Guide, feed: Feed, operators: Operators, audit: Audit) -> None:
        self._guide, self._feed, self._operators = guide, feed, operators
        self._orders = WrittenOrders(operators, audit)
        self._finishing: set[asyncio.Task[None]] = set()

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/api/guide", self.told),
            Route("/api/guide/picture", self.picture),
            Route("/api/guide/evidence", self.evidence),
            Route("/api/guide/step", self.step, methods=["POST"]),
            Route("/api/guide/play", self.play, methods=["POST"]),
            Route("/api/guide/accept", self.accept, methods=["POST"]),
            Route("/api/guide/restore", self.restore, methods=["POST"]),
        ]

    async def told(self, request: Request) -> Response:
        """Steps, results, versions."""
        device = self._feed.devices.get(request.query_params.get("device", ""))
        if device is None:
            return JSONResponse({"ok": False, "reason": "no such device"}, 404)
        try:
            return JSONResponse({"ok": True, **await asyncio.to_thread(self._guide.told, device)})
        except InputError as error:
            return JSONResponse({"ok": False, "reason": str(error)}, 500)

    async def picture(self, request: Request) -> Response:
        """What a step looked at."""
        device = self._feed.devices.get(request.query_params.get("device", ""))
        try:
            if device is None:
                raise InputError("device", "", "no such device")
            data = self._guide.picture(device, request.query_params.get("step", ""))
        except InputError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(data, media_type="image/jpeg")

    async def evidence(self, request: Request) -> Response:
        """A file of a version."""
        number, name = request.query_params.get("number", ""), request.query_params.get("name", "")
        try:
            if not (number.isascii() and number.isdigit() and len(number) <= 4):
                raise InputError("number", number[:10], "no such version")
            data = await asyncio.to_thread(self._guide.evidence, int(number), name)
        except InputError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(data, media_type=TYPES[name.rpartition(".")[2]], headers=RESULT_HEADERS)

    async def step(self, request: Request) -> Response:
        """Look at pictures."""

        def done(device: ShownDevice, wanted: StepOrder, login: Login) -> dict[str, Any]:
            found = self._guide.look(device, wanted.step)
            return {"command": f"calibration step {wanted.step}", "value": "good" if found.good else "doubtful"}

        return await self._changed(request, StepOrder, done)

    async def accept(self, request: Request) -> Response:
        """Make a version."""

        def done(device: ShownDevice, wanted: Acceptance, login: Login) -> dict[str, Any]:
            version = self._guide.accept(device, wanted.steps, wanted.why.strip(), login.user)
            return {"command": f"calibration of {', '.join(wanted.steps)}", "value": version.number}

        return await self._changed(request, Acceptance, done)

    async def restore(self, request: Request) -> Response:
        """Take a version again."""

        def done(device: ShownDevice, wanted: Restoration, login: Login) -> dict[str, Any]:
            version = self._guide.restore(device, wanted.number, login.user)
            return {"command": f"calibration restored from {wanted.number}", "value": version.number}

        return await self._changed(request, Restoration, done)

    async def play(self, request: Request) -> Response:
        """Play the test signal, and compute what it tells once it is over."""

        def done(device: ShownDevice, wanted: ForDevice, login: Login) -> dict[str, Any]:
            key = self._guide.signal(device)
            place = (device.endpoint, device.name)
            answer = self._operators.command(login, *place, EXPERIMENT, None, key)
            self._guide.begun(device)
            return {"command": EXPERIMENT, "key": key, "value": None, "t": answer["t"], "mode": answer["mode"]}

        since = now_s()
        answer = await self._changed(request, ForDevice, done)
        told = msgspec.json.decode(bytes(answer.body))
        if told.get("ok"):
            task = asyncio.create_task(self._finish(self._feed.devices[told["device"]], told["t"], since, told["who"]))
            self._finishing.add(task)
            task.add_done_callback(self._finishing.discard)
        return answer

    async def _finish(self, device: ShownDevice, begun_t: float, since: float, who_: str) -> None:
        run = device.run
        await asyncio.sleep(SECONDS + SETTLE_S)
        await asyncio.to_thread(self._guide.finish, device, run, begun_t, since, who_)

    async def _changed(
        self, request: Request, kind: type[Wanted], change: Callable[[ShownDevice, Wanted, Login], dict[str, Any]]
    ) -> Response:
        """Let somebody who is logged in do something with a device that is there."""

        def done(login: Login, _: str, wanted: Wanted) -> dict[str, Any]:
            device = self._feed.devices.get(wanted.device)
            if device is None:
                raise InputError("device", "", "no such device")
            return change(device, wanted, login)

        return await self._orders.done(request, kind, done)
