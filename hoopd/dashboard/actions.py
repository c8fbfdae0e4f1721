"""What a browser may ask for that changes something: STOP for everybody, the rest for who is logged in.

Rules of this file: every answer of a daemon goes to the browser and into the audit; a request is small JSON; the cookie
alone is never enough.
"""

from __future__ import annotations

import asyncio
import math
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from hoopd.core.operator import SPEED
from hoopd.core.succession import ALIVE
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import LONGEST_S, Login, LoginError, Operators
from hoopd.dashboard.requests import COOKIE, address_of, read, refused, who
from hoopd.shell.operator import CommandError

STOPPERS = 32
PAUSE_S = 1.0  # a hand that was silent for longer begins anew
EVERYBODY = "everybody"  # who stops needs no name


class Credentials(msgspec.Struct, forbid_unknown_fields=True):
    """What a login brings."""

    user: str
    password: str


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """What a command brings."""

    device: str
    command: str
    value: float | None = None
    key: str = ""


class Actions:
    """Routes that change something."""

    def __init__(self, feed: Feed, operators: Operators, audit: Audit) -> None:
        self._feed, self._operators, self._audit = feed, operators, audit
        self._hands: dict[tuple[str, str], float] = {}  # by login and device: when a hand drove last
        # Threads of its own: whoever guesses passwords, or waits for a daemon that is gone, delays no STOP.
        self._stoppers = ThreadPoolExecutor(STOPPERS, "stop")

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/api/me", self.me),
            Route("/api/stop", self.stop, methods=["POST"]),
            Route("/api/login", self.login, methods=["POST"]),
            Route("/api/logout", self.logout, methods=["POST"]),
            Route("/api/command", self.command, methods=["POST"]),
        ]

    async def me(self, request: Request) -> Response:
        """Who looks, and whether one can log in at all; does not prolong anything."""
        try:
            login = self._operators.find(request.cookies.get(COOKIE, ""))
        except LoginError:
            return JSONResponse({"possible": self._operators.possible, "user": None})
        return JSONResponse({"possible": True, "user": login.user, "proof": login.proof})

    async def stop(self, request: Request) -> Response:
        """Disarm every device that the page shows, all at once, without a login: everybody may stop."""
        devices = list(self._feed.devices.values())
        loop, name = asyncio.get_running_loop(), self._name(request)
        sent = [loop.run_in_executor(self._stoppers, self._feed.send, one, "disarm") for one in devices]
        answers = await asyncio.gather(*sent)
        for answer in answers:
            await loop.run_in_executor(self._stoppers, self._audit.note, name, address_of(request), answer)
        return JSONResponse({"ok": bool(answers) and all(one["ok"] for one in answers), "answers": answers})

    async def login(self, request: Request) -> Response:
        """Let somebody in whom a daemon lets in."""
        try:
            wanted = await read(request, Credentials)
            login = await asyncio.to_thread(self._operators.login, wanted.user, wanted.password, address_of(request))
        except LoginError as error:
            await self._note("", request, {"command": "login", "ok": False, "reason": str(error)})
            return refused(error)
        await self._note(login.user, request, {"command": "login", "ok": True})
        answer = JSONResponse({"ok": True, "user": login.user, "proof": login.proof})
        secure = request.url.scheme == "https"
        answer.set_cookie(COOKIE, login.token, int(LONGEST_S), httponly=True, samesite="strict", secure=secure)
        return answer

    async def logout(self, request: Request) -> Response:
        """Let somebody go."""
        try:
            login = who(request, self._operators)
        except LoginError as error:
            return refused(error)
        await asyncio.to_thread(self._operators.logout, login)
        await self._note(login.user, request, {"command": "logout", "ok": True})
        answer = JSONResponse({"ok": True})
        answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
        return answer

    async def command(self, request: Request) -> Response:
        """Hand somebody's command to a device; the answer is the device's."""
        try:
            login = who(request, self._operators)
            order = await read(request, Order)
        except LoginError as error:
            return refused(error)
        told: dict[str, Any] = {"device": order.device, "command": order.command, "value": order.value}
        told |= {"key": order.key} if order.key else {}
        device = self._feed.devices.get(order.device)
        answer = {**await asyncio.to_thread(self._answer, login, device, order), **told}
        if self._is_news(login, order, answer):
            await self._note(login.user, request, answer)
        return JSONResponse(answer)

    def _is_news(self, login: Login, order: Order, answer: dict[str, Any]) -> bool:
        """Worth a line: a trial's watcher and a hand that drives say the same again and again, and are written down
        when they begin and when they end."""
        if order.command != SPEED or not answer["ok"]:
            return order.command != ALIVE
        hand, now = (login.token, order.device), time.monotonic()
        before, self._hands[hand] = self._hands.get(hand, 0.0), now
        if not order.value:
            del self._hands[hand]
        return not order.value or now - before > PAUSE_S

    def _answer(self, login: Login, device: ShownDevice | None, order: Order) -> dict[str, Any]:
        if device is None:
            return {"ok": False, "reason": "no such device"}
        if order.value is not None and not math.isfinite(order.value):
            return {"ok": False, "reason": "expected a finite number"}
        try:
            where = (device.endpoint, device.name)
            return self._operators.command(login, *where, order.command, order.value, order.key)
        except CommandError as error:
            return {"ok": False, "reason": str(error)}

    def _name(self, request: Request) -> str:
        try:
            return self._operators.find(request.cookies.get(COOKIE, "")).user
        except LoginError:
            return EVERYBODY

    async def _note(self, name: str, request: Request, told: dict[str, Any]) -> None:
        await asyncio.to_thread(self._audit.note, name, address_of(request), told)
