"""What is learned and healed beside a daemon: campaigns and versions that other processes keep, for everybody to see;
who is logged in says what becomes of a proposed version.

Rules of this file: folders are read as their writers left them, and nothing in them is changed but a person's decision;
pages out of them have the rights of a stranger.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.guards import RESULT_HEADERS
from hoopd.dashboard.operators import Login, Operators
from hoopd.dashboard.orders import WrittenOrders
from hoopd.files import campaign_progress
from hoopd.files.folder_lock import is_taken
from hoopd.files.heal_versions import HealDecision, HealVersion, VersionFolder
from hoopd.files.reading import InputError

# Pages of a folder that a browser may have.
_PAGE = re.compile(r"story\.html|run_\d{2,4}/report\.html|\d{4}/report\.html", re.ASCII)
MOST_VERSIONS = 30  # the newest ones
KINDS = LEARN, HEAL = ("learn", "heal")


class VersionDecision(msgspec.Struct, forbid_unknown_fields=True):
    """What somebody says of a proposed version."""

    folder: int
    number: int
    accept: bool


class FollowedFolders:
    """Routes over folders of `hoopd learn` and `hoopd heal`."""

    def __init__(self, folders: Sequence[Path], operators: Operators, audit: Audit) -> None:
        self._folders, self._orders = tuple(folders), WrittenOrders(operators, audit)

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/api/follow", self.look),
            Route("/api/follow/decide", self.decide, methods=["POST"]),
            Route("/followed/{folder:int}/{name:path}", self.page),
        ]

    async def look(self, request: Request) -> Response:
        """What is done and known in each."""
        return JSONResponse(await asyncio.to_thread(lambda: [_told(folder) for folder in self._folders]))

    async def page(self, request: Request) -> Response:
        """The story of a campaign, or a report."""
        number, name = request.path_params["folder"], request.path_params["name"]
        path = self._folders[number] / name if number < len(self._folders) and _PAGE.fullmatch(name) else None
        if path is None or not await asyncio.to_thread(path.is_file):
            return PlainTextResponse("no such page\n", 404, headers=RESULT_HEADERS)
        return FileResponse(path, media_type="text/html", headers=RESULT_HEADERS)

    async def decide(self, request: Request) -> Response:
        """Lay a decision beside a version; whoever follows the loop takes it up."""

        def decided(login: Login, _: str, wanted: VersionDecision) -> dict[str, Any]:
            if not 0 <= wanted.folder < len(self._folders):
                raise InputError("folder", str(wanted.folder), "no such folder")
            versions = VersionFolder(self._folders[wanted.folder])
            versions.decide(wanted.number, HealDecision(accept=wanted.accept, who=login.user))
            word = "goes on trial" if wanted.accept else "is left"
            later = "" if versions.is_watched else ", once a hoopd heal runs there"
            return {"command": f"version {wanted.number} {word}{later}", "value": wanted.number}

        return await self._orders.done(request, VersionDecision, decided)


def _told(folder: Path) -> dict[str, Any]:
    """Of one folder; what cannot be read is said."""
    told: dict[str, Any] = {"name": folder.name, "kind": "", "running": False, "reason": ""}
    try:
        if (folder / "heal.json").exists():
            return told | {"kind": HEAL} | _healed(VersionFolder(folder))
        if (folder / "learn.json").exists():
            return told | {"kind": LEARN} | _learned(folder)
    except InputError as error:
        return told | {"reason": str(error).replace(f"{folder}/", "")}
    return told | {"reason": "neither hoopd learn nor hoopd heal has begun here"}


def _learned(folder: Path) -> dict[str, Any]:
    progress: dict[str, Any] = msgspec.to_builtins(campaign_progress.read_progress(folder))
    running = is_taken(folder, campaign_progress.LOCK)
    if not running and not progress["ended"]:
        progress["ended"] = "It was broken off; the same command goes on with it."
    pages = ["story.html"] if (folder / "story.html").is_file() else []
    return progress | {"running": running, "asks": progress["asks"] if running else "", "pages": pages}


def _healed(versions: VersionFolder) -> dict[str, Any]:
    loop, every = versions.loop(), list(versions.every())[-MOST_VERSIONS:]
    waiting = [one.number for one in every if one.state == "proposed" and versions.decision(one.number) is None]
    asks = f"version {waiting[-1]} is proposed: accept it, which puts it on trial, or leave it" if waiting else ""
    rows = [_version(one, versions) for one in reversed(every)]
    return {
        "running": versions.is_watched,
        "device": loop.device,
        "acting": loop.acting,
        "asks": asks,
        "waiting": waiting[-1:],
        "versions": rows,
    }


def _version(one: HealVersion, versions: VersionFolder) -> dict[str, Any]:
    gain, promise = one.evidence.get("gain", {}), one.evidence.get("promise", {})
    return {
        "number": one.number,
        "state": one.state.replace("_", " "),
        "kind": one.kind,
        "reason": one.reason,
        "begun": one.begun,
        "decided_by": one.decided_by,
        "key": one.key,
        "nats": gain.get("nats"),
        "promised": [promise.get(name) for name in ("before", "new")],
        "measured": [costs.get("measured") for costs in one.evidence.get("rounds", [])],
        "history": [what for _, what in one.history],
        "report": (versions.of(one.number) / "report.html").is_file(),
    }
