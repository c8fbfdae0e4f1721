"""Who may drive: the daemons' own users, from the page that logged in, for a while; and what is written down of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from dashboard.served import Answer, Served, served
from shell.peers import Ticks, controlled, running, wait_until

from hoopd.core.records import Command
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import ALL_GUESSES, GUESSES, GUESSES_S, HOLD_S, IDLE_S, LONGEST_S, LoginError, Operators
from hoopd.dashboard.requests import BODY_BYTES, COOKIE, PROOF
from hoopd.files.reading import InputError
from hoopd.shell.telemetry import TelemetrySettings


class Clock:
    """A monotonic clock that somebody sets."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@dataclass
class Driven:
    """A server beside a daemon that takes commands."""

    web: Served
    ticks: Ticks
    clock: Clock
    operators: Operators
    settings: TelemetrySettings
    audit: Path

    @property
    def device(self) -> str:
        return f"hoop@{self.settings.endpoint}"

    def login(self, user: str = "operator", password: str = "turn") -> tuple[Answer, dict[str, str]]:
        """The answer, and the headers of who is in."""
        answer = self.web.post("/api/login", {"user": user, "password": password}, content_type=JSON)
        cookie = answer.headers.get("set-cookie", "").partition(";")[0]
        return answer, {"cookie": cookie, PROOF: answer.json.get("proof", ""), "content_type": JSON}

    def order(self, command: str, headers: dict[str, str], **more: Any) -> Answer:
        return self.web.post("/api/command", {"device": self.device, "command": command, **more}, **headers)

    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.audit.read_text().splitlines()]


JSON = "application/json"


@pytest.fixture
def driven(tmp_path: Path) -> Iterator[Driven]:
    settings, clock, audit = controlled(tmp_path), Clock(), tmp_path / "audit.jsonl"
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)}, clock)
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        served(Feed([settings.endpoint], {}), operators, Audit(audit)) as web,
    ):
        assert wait_until(lambda: any(device.alive for device in web.feed.devices.values()))
        yield Driven(web, ticks, clock, operators, settings, audit)


def test_a_users_commands_reach_the_daemon_and_are_written_down(driven: Driven) -> None:
    assert driven.web.ask("/api/me").json == {"possible": True, "user": None}
    answer, who = driven.login()
    assert answer.status == 200 and answer.json["user"] == "operator"
    kept = answer.headers["set-cookie"].lower()
    assert "httponly" in kept and "samesite=strict" in kept and "path=/" in kept
    assert driven.web.ask("/api/me", cookie=who["cookie"]).json["user"] == "operator"
    assert driven.order("arm", who).json["mode"] == "READY"
    assert driven.order("reference", who, value=0.25).json["ok"]
    refused = driven.order("reference", who, value=9.0).json
    assert not refused["ok"] and "outside -1 to 1" in refused["reason"]
    assert driven.ticks.take() == (Command("arm"), Command("reference", 0.25))
    assert driven.web.post("/api/stop", cookie=who["cookie"]).json["ok"]
    assert driven.web.post("/api/stop").json["ok"]
    told = [(line["who"], line["command"], line.get("value"), line["ok"]) for line in driven.lines()]
    assert told == [
        ("operator", "login", None, True),
        ("operator", "arm", None, True),
        ("operator", "reference", 0.25, True),
        ("operator", "reference", 9.0, False),
        ("operator", "disarm", 0.0, True),
        ("everybody", "disarm", 0.0, True),
    ]
    assert all(line["time"].endswith("+00:00") and line["from"] == "127.0.0.1" for line in driven.lines())
    assert "turn" not in driven.audit.read_text()


@pytest.mark.parametrize("who", [("operator", "wrong"), ("nobody", "turn"), ("", ""), ("operator", "x" * 10_000)])
def test_a_wrong_login_is_refused(driven: Driven, who: tuple[str, str]) -> None:
    answer, headers = driven.login(*who)
    assert answer.status in (401, 413) and "set-cookie" not in answer.headers and not answer.json["ok"]
    assert driven.order("arm", headers).status == 401
    assert driven.ticks.take() == ()
    assert driven.lines()[0]["ok"] is False


def test_the_cookie_alone_is_not_enough(driven: Driven) -> None:
    _, who = driven.login()
    cookie = {"cookie": who["cookie"], "content_type": JSON}
    assert driven.order("arm", cookie).status == 403
    assert driven.order("arm", {**cookie, PROOF: "guess"}).status == 403
    assert driven.order("arm", {PROOF: who[PROOF], "content_type": JSON}).status == 401
    assert driven.order("arm", {**who, "origin": "http://evil.example"}).status == 403
    assert driven.order("arm", {**who, "content_type": "text/plain"}).status == 415
    assert driven.order("x" * BODY_BYTES, who).status == 413
    for content in ([], {"device": "x"}, {"device": driven.device, "command": "arm", "more": 1}):
        assert driven.web.post("/api/command", content, **who).status == 400
    assert driven.ticks.take() == ()


def test_only_what_a_person_may_command_is_handed_on(driven: Driven) -> None:
    _, who = driven.login()
    for name in ("experiment", "shutdown", "../config", "*"):
        assert not driven.order(name, who).json["ok"]
    assert not driven.web.post("/api/command", {"device": "other", "command": "arm"}, **who).json["ok"]
    assert driven.ticks.take() == ()


def test_who_guesses_has_to_wait_and_stop_does_not(driven: Driven) -> None:
    for _ in range(GUESSES):
        assert driven.login("operator", "wrong")[0].status == 401
    assert driven.login()[0].status == 429  # not even with the right one
    assert driven.web.post("/api/stop").json["ok"]
    driven.clock.now += GUESSES_S
    assert driven.login()[0].status == 200


def test_many_guessers_have_to_wait_together() -> None:
    operators = Operators({"tcp/127.0.0.1:1": ("tcp/127.0.0.1:1", {})}, Clock())
    for guess in range(ALL_GUESSES):
        with pytest.raises(LoginError, match="no daemon lets"):
            operators.login("operator", "x", f"10.0.0.{guess}")
    with pytest.raises(LoginError, match="too many tries"):
        operators.login("operator", "x", "10.0.1.1")


@pytest.mark.parametrize(("step_s", "steps"), [(IDLE_S + 1.0, 1), (IDLE_S - 1.0, int(LONGEST_S / IDLE_S) + 1)])
def test_a_login_ends_unused_and_at_the_end_of_the_day(driven: Driven, step_s: float, steps: int) -> None:
    _, who = driven.login()
    for _ in range(steps - 1):
        driven.clock.now += step_s
        assert driven.order("clear", who).status == 200
    driven.clock.now += step_s
    assert driven.order("arm", who).status == 401
    assert driven.web.ask("/api/me", cookie=who["cookie"]).json["user"] is None
    assert Command("arm") not in driven.ticks.take()


def test_a_second_login_drives_only_when_the_first_has_let_go_and_stops_at_any_time(driven: Driven) -> None:
    (_, first), (_, second) = driven.login(), driven.login()
    assert driven.order("arm", first).json["ok"]
    refused = driven.order("reference", second, value=0.1).json
    assert not refused["ok"] and "operator drives it from another login" in refused["reason"]
    assert driven.order("stop", second).json["ok"] and driven.order("disarm", second).json["ok"]
    assert driven.order("clear", first).json["ok"]  # a refusal takes nothing away
    driven.clock.now += HOLD_S
    assert driven.order("clear", second).json["ok"]
    assert not driven.order("clear", first).json["ok"]
    driven.web.post("/api/logout", {}, **second)
    assert driven.order("arm", first).json["ok"]
    assert Command("reference", 0.1) not in driven.ticks.take()


def test_who_logs_out_is_out(driven: Driven) -> None:
    _, who = driven.login()
    assert driven.web.post("/api/logout", {}, **who).status == 200
    assert driven.order("arm", who).status == 401
    assert driven.web.post("/api/logout", {}, **who).status == 401


def test_a_login_outlasts_a_restart_of_the_daemon(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    with running(settings) as telemetry, Ticks(telemetry.gate):
        login = operators.login("operator", "turn", "here")
        assert operators.command(login, settings.endpoint, "hoop", "clear")["ok"]
    with running(settings) as telemetry, Ticks(telemetry.gate) as ticks:
        assert operators.command(login, settings.endpoint, "hoop", "arm")["ok"]
        assert ticks.take() == (Command("arm"),)
    operators.close()


def test_without_control_nobody_logs_in_and_says_so() -> None:
    with served(Feed([], {})) as web:
        assert web.ask("/api/me").json == {"possible": False, "user": None}
        answer = web.post("/api/login", {"user": "operator", "password": "turn"}, content_type=JSON)
        assert answer.status == 403 and "telemetry.control" in answer.json["reason"]
        assert web.ask("/api/me", cookie=f"{COOKIE}=x").json["user"] is None


def test_an_audit_that_cannot_be_written_is_one_line_before_anything_happens(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--audit: no such file or directory"):
        Audit(tmp_path / "nothing" / "audit.jsonl")
