"""What every request that changes something has: somebody who is logged in, and small JSON.

Rules of this file: the cookie alone is never enough; what is too large is not read to its end.
"""

from __future__ import annotations

from typing import TypeVar

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from hoopd.dashboard.operators import Login, LoginError, Operators

COOKIE = "hoopd_login"
PROOF = "x-hoopd-proof"
BODY_BYTES = 4096
Content = TypeVar("Content")


def who(request: Request, operators: Operators) -> Login:
    """Who sends it, from the page that he logged in with; LoginError for everybody else."""
    return operators.find(request.cookies.get(COOKIE, ""), request.headers.get(PROOF, ""))


async def read(request: Request, kind: type[Content], most_bytes: int = BODY_BYTES) -> Content:
    """The request's content; LoginError, with its status, for what is something else."""
    body = b""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise LoginError("expected JSON", 415)
    async for part in request.stream():
        body += part
        if len(body) > most_bytes:
            raise LoginError(f"more than {most_bytes} bytes", 413)
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        raise LoginError("not what is expected here", 400) from None


def refused(error: LoginError) -> Response:
    """The answer to somebody who is not let in."""
    return JSONResponse({"ok": False, "reason": str(error)}, error.status)


def address_of(request: Request) -> str:
    """Where somebody asks from."""
    return request.client.host if request.client else ""
