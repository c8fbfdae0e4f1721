"""What somebody who is logged in asks for: read, done in a thread, written down, answered.

Rules of this file: every order that was understood is written down, refused or not, before its answer leaves; a refusal
is an answer with its reason and no mistake of HTTP, as a daemon's is.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.operators import Login, LoginError, Operators
from hoopd.dashboard.requests import BODY_BYTES, address_of, read, refused, who
from hoopd.files.reading import InputError

Wanted = TypeVar("Wanted")
# Who, from where, what -> what was done; InputError with the reason why not.
Change = Callable[[Login, str, Wanted], Mapping[str, Any]]


class WrittenOrders:
    """Orders of those who are logged in."""

    def __init__(self, operators: Operators, audit: Audit) -> None:
        self._operators, self._audit = operators, audit

    async def done(
        self, request: Request, kind: type[Wanted], change: Change[Wanted], most_bytes: int = BODY_BYTES
    ) -> Response:
        """Let who is logged in change something."""
        try:
            login = who(request, self._operators)
            wanted = await read(request, kind, most_bytes)
        except LoginError as error:
            return refused(error)
        self._operators.seen(login)
        address, device = address_of(request), getattr(wanted, "device", None)
        told: dict[str, Any] = {"command": request.url.path.removeprefix("/api/").replace("/", " ")}
        told |= {} if device is None else {"device": device}
        try:
            told = {**told, **await asyncio.to_thread(change, login, address, wanted), "ok": True}
        except InputError as error:
            told = {**told, "ok": False, "reason": str(error)}
        except Exception as error:
            told = {**told, "ok": False, "reason": f"a mistake of the page's server: {error}"}
            await asyncio.to_thread(self._audit.note, login.user, address, told)
            raise
        await asyncio.to_thread(self._audit.note, login.user, address, told)
        return JSONResponse({**told, "who": login.user})
