"""What holds of every route that there is, whoever adds the next one: nobody changes anything by another's browser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from urllib.parse import quote

import pytest
from dashboard.served import Served, served
from shell.peers import Ticks, controlled, running
from starlette.routing import Route, WebSocketRoute
from websockets.exceptions import InvalidHandshake
from websockets.sync.client import connect

from hoopd.core.records import Command
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.requests import PROOF
from hoopd.dashboard.server import application
from hoopd.dashboard.work.bench import Bench

JSON = "application/json"
EVERYBODY = {"/api/stop", "/api/login"}  # who stops needs no name; who logs in has none yet
WITHOUT_CONTENT = {"/api/stop", "/api/logout", "/api/calibration"}  # nothing of the request is read
ROUTES = application(Feed([], {}), Operators({}), Audit(), ["localhost"]).routes
CHANGING = sorted(one.path for one in ROUTES if isinstance(one, Route) and "POST" in (one.methods or ()))
SOCKETS = sorted(one.path for one in ROUTES if isinstance(one, WebSocketRoute))
READING = sorted(one.path for one in ROUTES if isinstance(one, Route) and "POST" not in (one.methods or ()))
LISTS = {"/api/work/controllers"}  # take no name
CLIMBING = ("../../etc/passwd", "..%2f..%2fetc%2fpasswd", "/etc/passwd", "notes.json", ".", "", "x" * 5000, "a\x00b")


class Stranger:
    """A server beside a daemon, and somebody who is logged in elsewhere."""

    def __init__(self, web: Served, ticks: Ticks) -> None:
        self.web, self.ticks = web, ticks
        login = web.post("/api/login", {"user": "operator", "password": "turn"}, content_type=JSON)
        self.cookie = login.headers["set-cookie"].partition(";")[0]
        self.proof: str = login.json["proof"]


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stranger]:
    folder = tmp_path_factory.mktemp("routes")
    settings = controlled(folder)
    (folder / "recordings").mkdir()
    bench = Bench(folder / "recordings", folder / "results")
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        served(Feed([settings.endpoint], {}), operators, Audit(folder / "audit.jsonl"), bench) as web,
    ):
        yield Stranger(web, ticks)


def test_there_are_such_routes() -> None:
    assert {"/api/command", "/api/compare/begin", "/api/experiment/begin", "/api/work/ask"} <= {*CHANGING}
    assert len(SOCKETS) >= 2 and "/api/work/file" in READING


@pytest.mark.parametrize("path", CHANGING)
@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1"])
def test_another_page_changes_nothing(stranger: Stranger, path: str, origin: str | None) -> None:
    headers = {"cookie": stranger.cookie, PROOF: stranger.proof, "content_type": JSON}
    answer = stranger.web.ask(path, "POST", {}, **headers, **({} if origin is None else {"origin": origin}))
    assert answer.status == 403 and stranger.ticks.take() == ()


@pytest.mark.parametrize("path", [one for one in CHANGING if one not in EVERYBODY | {"/api/calibration"}])
def test_neither_a_stranger_nor_the_cookie_alone_changes_anything(stranger: Stranger, path: str) -> None:
    assert stranger.web.post(path, {}, content_type=JSON).status == 401
    assert stranger.web.post(path, {}, cookie=stranger.cookie, content_type=JSON).status == 403
    assert stranger.web.post(path, {}, cookie=stranger.cookie, content_type=JSON, **{PROOF: "guess"}).status == 403
    assert stranger.ticks.take() == ()


@pytest.mark.parametrize("path", [one for one in CHANGING if one not in WITHOUT_CONTENT])
def test_what_is_too_large_or_something_else_is_not_read(stranger: Stranger, path: str) -> None:
    who: dict[str, Any] = {"cookie": stranger.cookie, PROOF: stranger.proof}
    assert stranger.web.post(path, {"x": "y" * 100_000}, content_type=JSON, **who).status == 413
    assert stranger.web.post(path, {}, content_type="text/plain", **who).status == 415
    assert stranger.web.post(path, ["x"], content_type=JSON, **who).status == 400
    assert stranger.web.post(path, {"unheard": 1}, content_type=JSON, **who).status == 400


@pytest.mark.parametrize("path", SOCKETS)
@pytest.mark.parametrize("origin", [None, "null", "http://evil.example"])
def test_no_other_page_listens(stranger: Stranger, path: str, origin: str | None) -> None:
    with pytest.raises(InvalidHandshake):
        connect(f"ws://127.0.0.1:{stranger.web.port}{path}", origin=origin, open_timeout=5.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("path", [one for one in READING if one.startswith("/api/work/") and one not in LISTS])
@pytest.mark.parametrize("name", CLIMBING)
def test_nothing_outside_of_the_folders_is_handed_out(stranger: Stranger, path: str, name: str) -> None:
    for query in (f"name={quote(name)}", f"job=1&name={quote(name)}", f"job={quote(name)}&name=report.html"):
        answer = stranger.web.ask(f"{path}?{query}")
        assert answer.status in (400, 404) and b"root:" not in answer.body


def test_a_page_with_a_stop_reaches_the_daemon_all_the_same(stranger: Stranger) -> None:
    stranger.ticks.take()
    assert stranger.web.post("/api/stop").json["ok"]
    assert stranger.ticks.take() == (Command("disarm"),)
