"""The server beside a daemon's telemetry: who may ask for what, what STOP does, and what a stranger's names become."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import zenoh
from dashboard.served import Served, served
from shell.peers import Ticks, client, free_endpoint, running, tick, wait_until
from websockets.exceptions import InvalidHandshake, InvalidStatus
from websockets.sync.client import connect

from hoopd.core.records import Command
from hoopd.dashboard.feed import DEVICES, Feed
from hoopd.dashboard.process import ServerAddress, bind
from hoopd.files.reading import InputError
from hoopd.shell.session import listening
from hoopd.shell.telemetry import TelemetrySettings


@pytest.fixture
def web() -> Iterator[Served]:
    """Without any daemon."""
    with served(Feed([free_endpoint()], {})) as web:
        yield web


def test_the_page_may_run_its_own_files_and_nothing_else(web: Served) -> None:
    for path in ("/", "/static/js/main.js", "/api/channels", "/nothing"):
        answer = web.ask(path)
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "script-src 'self';" in policy and "unsafe" not in policy
        assert answer.headers["x-frame-options"] == "DENY" and "server" not in answer.headers
    page = web.ask("/").body.decode()
    assert re.search(r"://|<style|style=|\son\w+=", page) is None
    assert web.ask("/static/uplot/LICENSE").status == 200
    assert web.ask("/static/../server.py").status == 404 and web.ask("/static/%2e%2e/server.py").status == 404


@pytest.mark.parametrize(
    "headers", [{}, {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "http://127.0.0.1"}]
)
def test_another_page_stops_nothing(web: Served, headers: dict[str, str]) -> None:
    answer = web.ask("/api/stop", "POST", {}, **headers)
    assert answer.status == 403 and "another page" in answer.json["reason"]
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{web.port}/api/live", origin=headers.get("origin"), open_timeout=5.0)  # type: ignore[arg-type]
    assert refused.value.response.status_code == 403


def test_a_foreign_name_that_leads_here_is_refused(web: Served) -> None:
    for host in ("evil.example", f"evil.example:{web.port}", "127.0.0.1.evil.example", "[", ""):
        assert web.ask("/", host=host).status in (400, 403)
        assert web.ask("/api/stop", "POST", {}, host=host, origin=f"http://{host}").status in (400, 403)
    assert web.ask("/", host=f"localhost:{web.port}").status == 200
    assert web.post("/api/stop").status == 200


def test_without_a_device_nothing_was_stopped(web: Served) -> None:
    assert web.post("/api/stop").json == {"ok": False, "answers": []}
    assert web.ask("/api/history?device=hoop").status == 404
    with connect(f"ws://127.0.0.1:{web.port}/api/live", origin=web.origin) as socket:  # type: ignore[arg-type]
        (trouble,) = json.loads(socket.recv(5.0))["endpoints"].values()
    assert trouble.startswith(("no daemon answers", "not connected yet"))


def test_rows_come_live_and_stop_disarms_whoever_asks() -> None:
    settings = TelemetrySettings(endpoint=free_endpoint(), session="0123456789abcdef")
    with served(Feed([settings.endpoint], {})) as web, running(settings) as telemetry, Ticks(telemetry.gate) as ticks:
        assert wait_until(lambda: any(device.alive for device in web.feed.devices.values()))
        with connect(f"ws://127.0.0.1:{web.port}/api/live", origin=web.origin) as socket:  # type: ignore[arg-type]
            news: dict[str, object] = {}
            for k in range(50):
                telemetry.put(tick(k))
                news |= json.loads(socket.recv(5.0))["devices"].get(f"hoop@{settings.endpoint}", {})
                if "rows" in news and "names" in news:
                    break
            assert {"wall", "u", "x_hat_3", "mode"} <= {*news["names"]}  # type: ignore[misc]
            assert news["words"]["mode"] == ["RUNNING"]  # type: ignore[index]
        answer = web.post("/api/stop").json
        assert answer["ok"] and answer["answers"][0]["mode"] == "DISARMED"
        assert ticks.take() == (Command("disarm"),)


@pytest.mark.parametrize("reply", [b"nonsense", b"[]", b"{}", b'{"ok": "yes"}'])
def test_a_device_that_answers_nonsense_keeps_no_other_from_being_stopped(reply: bytes) -> None:
    settings, elsewhere = TelemetrySettings(endpoint=free_endpoint()), free_endpoint()
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        zenoh.open(listening(elsewhere, {})) as forger,
        served(Feed([settings.endpoint, elsewhere], {})) as web,
    ):
        ring = zenoh.handlers.RingChannel(4)
        queryable = forger.declare_queryable("hoopd/evil/cmd/disarm", ring)
        token = forger.liveliness().declare_token("hoopd/evil/alive")
        assert wait_until(lambda: len([one for one in web.feed.devices.values() if one.alive]) == 2)
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(web.post, "/api/stop")
            wait_until(lambda: answered(queryable, reply) or asked.done())
            answer = asked.result(10.0).json
        told = {one["device"].partition("@")[0]: one["ok"] for one in answer["answers"]}
        assert told == {"hoop": True, "evil": False} and not answer["ok"]
        assert Command("disarm") in ticks.take()
        token.undeclare()  # type: ignore[no-untyped-call]


def answered(queryable: Any, reply: bytes) -> bool:
    """A question was there, and has its reply."""
    query = queryable.try_recv()
    if query is None:
        return False
    with query:
        query.reply(query.key_expr, reply)
    return True


def test_a_daemon_that_comes_back_is_heard_again() -> None:
    settings = TelemetrySettings(endpoint=free_endpoint(), session="first")
    with served(Feed([settings.endpoint], {})) as web:
        for run in ("first", "second"):
            with running(TelemetrySettings(endpoint=settings.endpoint, session=run)) as telemetry:

                def heard(telemetry: object = telemetry, run: str = run) -> bool:
                    telemetry.put(tick(1))  # type: ignore[attr-defined]
                    return any(device.run == run and device.alive for device in web.feed.devices.values())

                assert wait_until(heard)
            assert wait_until(lambda: not any(device.alive for device in web.feed.devices.values()))
        (device,) = web.feed.devices.values()
        assert device.runs == 2
        answer = web.post("/api/stop").json
        assert not answer["ok"] and "no daemon" in answer["answers"][0]["reason"]


def test_names_that_are_no_keys_and_more_devices_than_there_is_room_for_are_left_out() -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    with running(settings), client(settings.endpoint) as forger, served(Feed([settings.endpoint], {})) as web:
        (connection,) = web.feed.connections
        assert wait_until(lambda: not connection.trouble)

        def forged() -> bool:
            for name in ("<img src=x onerror=alert(1)>", "ü", "x" * 65, *(f"d{k}" for k in range(DEVICES + 5))):
                forger.put(f"hoopd/{name}/tick", b'{"t": 1}', congestion_control=zenoh.CongestionControl.BLOCK)
            return len(connection.devices) == DEVICES and connection.refused > 0

        assert wait_until(forged)
        assert all(name.isascii() and name.isalnum() for name in connection.devices)


@pytest.mark.parametrize("listen", ["0.0.0.0:8765", "192.168.1.2:8765", "nowhere", "127.0.0.1:99999", "[::]:8765"])
def test_only_this_machine_is_listened_to(listen: str) -> None:
    with pytest.raises(InputError, match="--listen"):
        bind(ServerAddress(listen=listen))


def test_a_port_that_is_taken_is_one_line() -> None:
    with bind(ServerAddress(listen="127.0.0.1:0")) as taken, pytest.raises(InputError, match="address already in use"):
        bind(ServerAddress(listen=f"127.0.0.1:{taken.getsockname()[1]}"))


def test_a_handshake_of_another_name_is_refused(web: Served) -> None:
    with pytest.raises(InvalidHandshake):
        connect(f"ws://localhost:{web.port}/api/live", origin=web.origin, open_timeout=5.0)  # type: ignore[arg-type]
