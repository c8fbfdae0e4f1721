"""What a browser may ask for that changes something: STOP for everybody, the rest for who is logged in.

Rules of this file: every answer of a daemon goes to the browser and into the audit; a request is small JSON; the cookie
alone is never enough.
"""

from __future__ import annotations

import asyncio
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import msgspec
import zenoh
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import LONGEST_S, Login, LoginError, Operators
from hoopd.shell.operator import CommandError
from hoopd.shell.session import reason

COOKIE = "hoopd_login"
PROOF = "x-hoopd-proof"
BODY_BYTES = 4096
STOPPERS = 32
EVERYBODY = "everybody"  # who stops needs no name
Content = TypeVar("Content")


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
        loop, who = asyncio.get_running_loop(), self._name(request)
        sent = [loop.run_in_executor(self._stoppers, self._feed.send, one, "disarm") for one in devices]
        answers = await asyncio.gather(*sent)
        for answer in answers:
            await loop.run_in_executor(self._stoppers, self._audit.note, who, _address(request), answer)
        return JSONResponse({"ok": bool(answers) and all(one["ok"] for one in answers), "answers": answers})

    async def login(self, request: Request) -> Response:
        """Let somebody in whom a daemon lets in."""
        try:
            wanted = await _read(request, Credentials)
            login = await asyncio.to_thread(self._operators.login, wanted.user, wanted.password, _address(request))
        except LoginError as error:
            await self._note("", request, {"command": "login", "ok": False, "reason": str(error)})
            return _refused(error)
        await self._note(login.user, request, {"command": "login", "ok": True})
        answer = JSONResponse({"ok": True, "user": login.user, "proof": login.proof})
        secure = request.url.scheme == "https"
        answer.set_cookie(COOKIE, login.token, int(LONGEST_S), httponly=True, samesite="strict", secure=secure)
        return answer

    async def logout(self, request: Request) -> Response:
        """Let somebody go."""
        try:
            login = self._who(request)
        except LoginError as error:
            return _refused(error)
        await asyncio.to_thread(self._operators.logout, login)
        await self._note(login.user, request, {"command": "logout", "ok": True})
        answer = JSONResponse({"ok": True})
        answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
        return answer

    async def command(self, request: Request) -> Response:
        """Hand somebody's command to a device; the answer is the device's."""
        try:
            login = self._who(request)
            order = await _read(request, Order)
        except LoginError as error:
            return _refused(error)
        told: dict[str, Any] = {"device": order.device, "command": order.command, "value": order.value}
        told |= {"key": order.key} if order.key else {}
        device = self._feed.devices.get(order.device)
        answer = {**await asyncio.to_thread(self._answer, login, device, order), **told}
        await self._note(login.user, request, answer)
        return JSONResponse(answer)

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
        except zenoh.ZError as error:  # the connection went meanwhile
            return {"ok": False, "reason": f"no answer: {reason(error)}"}

    def _who(self, request: Request) -> Login:
        return self._operators.find(request.cookies.get(COOKIE, ""), request.headers.get(PROOF, ""))

    def _name(self, request: Request) -> str:
        try:
            return self._operators.find(request.cookies.get(COOKIE, "")).user
        except LoginError:
            return EVERYBODY

    async def _note(self, who: str, request: Request, told: dict[str, Any]) -> None:
        await asyncio.to_thread(self._audit.note, who, _address(request), told)


async def _read(request: Request, kind: type[Content]) -> Content:
    """The request's content; LoginError, with status 400, for what is something else."""
    body = b""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise LoginError("expected JSON", 415)
    async for part in request.stream():
        body += part
        if len(body) > BODY_BYTES:
            raise LoginError(f"more than {BODY_BYTES} bytes", 413)
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        raise LoginError("not what is expected here", 400) from None


def _refused(error: LoginError) -> Response:
    return JSONResponse({"ok": False, "reason": str(error)}, error.status)


def _address(request: Request) -> str:
    return request.client.host if request.client else ""
