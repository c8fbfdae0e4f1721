"""Telemetry on loopback: late, curious, flooding and foreign peers, and what becomes of their commands."""

from __future__ import annotations

import json

import pytest
import zenoh
from shell.peers import ask, client, free_endpoint, receive, running, tick, wait_until

from hoopd.core.records import Command
from hoopd.recording.rows import decode_tick
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import send
from hoopd.shell.telemetry import Settings


def test_late_subscriber_gets_ticks_events_and_status() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry:
        for k in range(20):
            telemetry.put(tick(k))
        assert wait_until(lambda: telemetry.counts.published >= 20)
        with client(endpoint) as session:
            rows = session.declare_subscriber("hoopd/hoop/tick", zenoh.handlers.RingChannel(100))
            events = session.declare_subscriber("hoopd/hoop/event", zenoh.handlers.RingChannel(10))
            status = session.declare_subscriber("hoopd/hoop/status", zenoh.handlers.RingChannel(10))
            publishers = telemetry._publishers.values()
            assert wait_until(lambda: all(publisher.matching_status.matching for publisher in publishers))
            for k in range(20, 30):
                telemetry.put(tick(k))
            telemetry.event(0.6, "camera_lost", "warning", age_s=0.2)
            telemetry.set_status({"faults": ["CAMERA_STALE"]})
            got = [decode_tick(data) for data in receive(rows, 10)]
            assert repr(got) == repr([tick(k) for k in range(20, 30)])
            event = json.loads(receive(events, 1)[0])
            assert event == {"t": 0.6, "event": "camera_lost", "level": "warning", "fields": {"age_s": 0.2}}
            state = [json.loads(data) for data in receive(status, 2)][-1]
            assert (state["mode"], state["faults"]) == ("RUNNING", ["CAMERA_STALE"])
            assert state["telemetry"]["dropped"] == 0
            tokens = [
                str(reply.ok.key_expr) for reply in session.liveliness().get("hoopd/*/alive", timeout=5.0) if reply.ok
            ]
            assert tokens == ["hoopd/hoop/alive"]


def test_last_event_is_published_before_the_end() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry, client(endpoint) as session:
        events = session.declare_subscriber("hoopd/hoop/event", zenoh.handlers.RingChannel(10))
        assert wait_until(lambda: telemetry._publishers["event"].matching_status.matching)
        telemetry.event(1.0, "stopped")
        assert telemetry.close(10.0)
        assert json.loads(receive(events, 1)[0])["event"] == "stopped"


def test_snapshot_and_config() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint), config_text="a: 1\npassword: abc\n") as telemetry:
        telemetry.put(tick(7))
        with client(endpoint) as session:
            assert wait_until(lambda: telemetry._summary.last is not None)
            snapshot = json.loads(ask(session, "hoopd/hoop/snapshot")[0] or "")
            assert snapshot["tick"]["id"] == 7 and snapshot["tick"]["psi"] is None
            assert json.loads(ask(session, "hoopd/hoop/config")[0] or "") == {"config": "a: 1\npassword: '***'\n"}


def test_commands_taken_and_refused() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint, commands=True)) as telemetry:
        assert json.loads(send("reference", 0.25, endpoint)) == {
            "ok": True,
            "command": "reference",
            "value": 0.25,
            "key": "",
        }
        send("tune", 2.0, endpoint, key="q_psi")
        send("disarm", endpoint=endpoint)
        assert telemetry.gate.take() == (
            Command("reference", 0.25),
            Command("tune", 2.0, "q_psi"),
            Command("disarm"),
        )
        with pytest.raises(CommandError, match=r"refused: reference: 9 is outside -1 to 1"):
            send("reference", 9.0, endpoint)
        assert telemetry.gate.take() == ()


def test_commands_are_off_by_default_but_disarm_works() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry:
        with pytest.raises(CommandError, match="refused: commands are off"):
            send("arm", endpoint=endpoint)
        send("disarm", endpoint=endpoint)
        send("stop", endpoint=endpoint)
        assert telemetry.gate.take() == (Command("disarm"), Command("stop"))


def test_curious_wildcard_commands_nothing() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint, commands=True)) as telemetry, client(endpoint) as session:
        assert len(list(session.get("hoopd/**", timeout=5.0))) >= 3
        assert telemetry.gate.take() == ()


def test_no_daemon_and_other_device_are_one_clear_line() -> None:
    endpoint = free_endpoint()
    with pytest.raises(CommandError, match=r"no daemon answers at tcp/127\.0\.0\.1") as caught:
        send("arm", endpoint=endpoint, timeout_s=0.5)
    assert "\n" not in str(caught.value)
    with running(Settings(endpoint=endpoint)), pytest.raises(CommandError, match="no daemon of device 'other' answers"):
        send("arm", endpoint=endpoint, device="other")


def test_raising_answer_is_told_to_the_asker() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry, client(endpoint) as session:
        telemetry._answers["config"] = lambda _query: json.loads("{")
        assert ask(session, "hoopd/hoop/config") == (None, "internal error: JSONDecodeError")
        assert telemetry.counts.errors == 1
        assert ask(session, "hoopd/hoop/snapshot")[0] is not None


def test_flood_of_commands_is_bounded() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint, commands=True)) as telemetry, client(endpoint) as session:
        pending = [session.get("hoopd/hoop/cmd/arm", timeout=5.0) for _ in range(400)]
        send("disarm", endpoint=endpoint)
        taken = telemetry.gate.take()
        assert len(taken) <= 17 and taken[-1] == Command("disarm")
        replies = [reply for handler in pending for reply in handler]
        assert any(reply.err is not None and "busy" in reply.err.payload.to_string() for reply in replies)
