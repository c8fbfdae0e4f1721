"""Telemetry on loopback: late, curious, flooding and foreign peers, and what becomes of their commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import zenoh
from shell.peers import (
    OPERATOR,
    Ticks,
    ask,
    client,
    controlled,
    free_endpoint,
    receive,
    running,
    tick,
    wait_until,
)

from hoopd.core.records import Command
from hoopd.recording.rows import decode_tick
from hoopd.shell.commands import ALWAYS, NAMES
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import send
from hoopd.shell.telemetry import TelemetrySettings


def test_late_subscriber_gets_ticks_events_and_status() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint)) as telemetry:
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
    with running(TelemetrySettings(endpoint=endpoint)) as telemetry, client(endpoint) as session:
        events = session.declare_subscriber("hoopd/hoop/event", zenoh.handlers.RingChannel(10))
        assert wait_until(lambda: telemetry._publishers["event"].matching_status.matching)
        telemetry.event(1.0, "stopped")
        assert telemetry.close(10.0)
        assert json.loads(receive(events, 1)[0])["event"] == "stopped"


def test_snapshot_and_config() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint), config_text="a: 1\npassword: abc\n") as telemetry:
        telemetry.put(tick(7))
        with client(endpoint) as session:
            assert wait_until(lambda: telemetry._summary.last is not None)
            snapshot = json.loads(ask(session, "hoopd/hoop/snapshot")[0] or "")
            assert snapshot["tick"]["id"] == 7 and snapshot["tick"]["psi"] is None
            assert json.loads(ask(session, "hoopd/hoop/config")[0] or "") == {"config": "a: 1\npassword: '***'\n"}


def test_commands_taken_and_refused_are_answered_with_what_became_of_them(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with running(settings) as telemetry, Ticks(telemetry.gate, {"clear": "link_lost"}) as ticks:

        def order(command: str, value: float | None = None, key: str = "") -> dict[str, Any]:
            return send(command, value, settings.control_endpoint, key=key, extras=OPERATOR)

        answer = order("reference", 0.25)
        assert (answer["ok"], answer["command"], answer["value"], answer["key"]) == (True, "reference", 0.25, "")
        assert order("tune", 2.0, "q_psi")["key"] == "q_psi"
        assert order("arm")["mode"] == "READY"
        assert order("disarm")["mode"] == "DISARMED"
        assert ticks.take() == (
            Command("reference", 0.25),
            Command("tune", 2.0, "q_psi"),
            Command("arm"),
            Command("disarm"),
        )
        with pytest.raises(CommandError, match=r"reference: refused: 9 is outside -1 to 1"):
            order("reference", 9.0)
        assert ticks.take() == ()
        with pytest.raises(CommandError, match=r"^clear: refused: link_lost$"):
            order("clear")


def test_without_a_password_only_disarm_and_stop_are_taken(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with running(settings) as telemetry, Ticks(telemetry.gate) as ticks:
        for name in set(NAMES) - set(ALWAYS):
            with pytest.raises(CommandError, match=r"over zenoh this needs telemetry\.control"):
                send(name, 0.1, settings.endpoint)
            with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
                send(name, 0.1, settings.control_endpoint, timeout_s=0.5)
        assert send("disarm", endpoint=settings.endpoint)["mode"] == "DISARMED"
        assert send("stop", endpoint=settings.endpoint)["mode"] == "STOPPING"
        assert ticks.take() == (Command("disarm"), Command("stop"))


def test_curious_wildcard_commands_nothing(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with running(settings) as telemetry, client(settings.control_endpoint, **OPERATOR) as session:
        replies = list(session.get("hoopd/**", timeout=5.0))
        assert replies and all(reply.err is not None for reply in replies)
        assert telemetry.gate.take() == ()


def test_a_command_too_large_to_be_one_is_refused_before_it_is_copied(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with running(settings) as telemetry, client(settings.control_endpoint, **OPERATOR) as session:
        says = ask(session, "hoopd/hoop/cmd/reference", "1" + " " * 1000)
        assert says == (None, "more than 1000 bytes")
        assert telemetry.gate.take() == ()


def test_every_message_tells_of_which_run_it_is() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint, session="0123abcd")) as telemetry, client(endpoint) as session:
        ring = session.declare_subscriber("hoopd/hoop/*", zenoh.handlers.RingChannel(100))
        assert wait_until(lambda: telemetry._publishers["tick"].matching_status.matching)
        telemetry.put(tick(1))
        telemetry.event(0.1, "fact")
        seen: dict[str, Any] = {}

        def all_kinds() -> bool:
            while (sample := ring.try_recv()) is not None:
                seen[str(sample.key_expr)] = sample
            return len(seen) == 3

        assert wait_until(all_kinds)
        assert {sample.attachment.to_string() for sample in seen.values()} == {"0123abcd"}
        assert json.loads(seen["hoopd/hoop/status"].payload.to_bytes())["session"] == "0123abcd"
        assert json.loads(ask(session, "hoopd/hoop/snapshot")[0] or "")["session"] == "0123abcd"


def test_no_daemon_and_other_device_are_one_clear_line() -> None:
    endpoint = free_endpoint()
    with pytest.raises(CommandError, match=r"no daemon answers at tcp/127\.0\.0\.1") as caught:
        send("arm", endpoint=endpoint, timeout_s=0.5)
    assert "\n" not in str(caught.value)
    with (
        running(TelemetrySettings(endpoint=endpoint)),
        pytest.raises(CommandError, match="no daemon of device 'other' answers"),
    ):
        send("arm", endpoint=endpoint, device="other")


def test_raising_answer_is_told_to_the_asker() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint)) as telemetry, client(endpoint) as session:
        telemetry._peer.answers["config"] = lambda _query: json.loads("{")
        assert ask(session, "hoopd/hoop/config") == (None, "internal error: JSONDecodeError")
        assert telemetry.counts.errors == 1
        assert ask(session, "hoopd/hoop/snapshot")[0] is not None


def test_flood_of_commands_is_bounded_and_keeps_no_disarm_out(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with running(settings) as telemetry, client(settings.control_endpoint, **OPERATOR) as session:
        pending = [session.get("hoopd/hoop/cmd/arm", timeout=5.0) for _ in range(400)]
        pending += [session.get("hoopd/hoop/cmd/disarm", timeout=5.0) for _ in range(400)]
        with client(settings.endpoint) as other:
            last = other.get("hoopd/hoop/cmd/stop", timeout=5.0)
            assert wait_until(lambda: "stop" in telemetry.gate._always)
        taken = telemetry.gate.take()
        assert len(taken) <= 18 and {"disarm", "stop"} <= {command.name for command in taken}
        assert len([reply for handler in (*pending, last) for reply in handler]) < len(pending)  # most were thrown away
