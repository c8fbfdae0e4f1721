"""Telemetry on loopback: late, frozen, flooding and foreign peers, and an end that always comes."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import zenoh

from hoopd.core.records import Command, TickRecord
from hoopd.files import InputError
from hoopd.recording.rows import decode_tick
from hoopd.shell import telemetry as module
from hoopd.shell.commands import CommandError, Ranges, operate, send
from hoopd.shell.session import connecting
from hoopd.shell.telemetry import Settings, Telemetry

ROOT = Path(__file__).resolve().parents[2]
RANGES = Ranges((-1.0, 1.0), {"q_psi": (0.0, 10.0)})


def free_endpoint() -> str:
    """A loopback port that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def tick(k: int) -> TickRecord:
    """Row k of a made-up run."""
    t = k * 0.02
    return TickRecord(t, k, "RUNNING", 0.1, t, 0.3, 0.2, math.nan, t, t, (t, 0.0, 0.0, 0.0), 0.0, 1, 0, 1e-4 * k, 0.0)


def wait_until(condition: Any, timeout_s: float = 10.0) -> bool:
    """True as soon as the condition holds."""
    end = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return bool(condition())


@contextlib.contextmanager
def running(settings: Settings, **options: Any) -> Iterator[Telemetry]:
    """Telemetry that is open, and closed in time."""
    telemetry = Telemetry(settings, **options)
    telemetry.start()
    try:
        assert wait_until(lambda: telemetry.counts.open)
        yield telemetry
    finally:
        assert telemetry.close(10.0)


@contextlib.contextmanager
def client(endpoint: str, **extras: Any) -> Iterator[zenoh.Session]:
    """A client session that is closed."""
    with zenoh.open(connecting(endpoint, extras, 2.0)) as session:
        yield session


def receive(subscriber: Any, count: int, timeout_s: float = 10.0) -> list[bytes]:
    """The next messages, as many as come in time."""
    got: list[bytes] = []
    end = time.monotonic() + timeout_s
    while len(got) < count and time.monotonic() < end:
        sample = subscriber.try_recv()
        if sample is None:
            time.sleep(0.005)
        else:
            got.append(sample.payload.to_bytes())
    return got


def ask(session: zenoh.Session, key: str, payload: str | None = None) -> tuple[str | None, str | None]:
    """Reply and refusal of one query."""
    for reply in session.get(key, payload=payload, timeout=5.0):
        if reply.ok is not None:
            return reply.ok.payload.to_string(), None
        assert reply.err is not None
        return None, reply.err.payload.to_string()
    return None, None


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
    with running(Settings(endpoint=endpoint, commands=True, ranges=RANGES)) as telemetry:
        assert json.loads(send("reference", 0.25, endpoint)) == {
            "ok": True,
            "command": "reference",
            "value": 0.25,
            "key": "",
        }
        send("tune", 2.0, endpoint, key="q_psi")
        send("disarm", endpoint=endpoint)
        assert telemetry.take_commands() == (
            Command("reference", 0.25),
            Command("tune", 2.0, "q_psi"),
            Command("disarm"),
        )
        with pytest.raises(CommandError, match=r"refused: reference: 9 is outside -1 to 1"):
            send("reference", 9.0, endpoint)
        assert telemetry.take_commands() == ()


def test_commands_are_off_by_default_but_disarm_works() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry:
        with pytest.raises(CommandError, match="refused: commands are off"):
            send("arm", endpoint=endpoint)
        send("disarm", endpoint=endpoint)
        send("stop", endpoint=endpoint)
        assert telemetry.take_commands() == (Command("disarm"), Command("stop"))


def test_curious_wildcard_commands_nothing() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint, commands=True)) as telemetry, client(endpoint) as session:
        assert len(list(session.get("hoopd/**", timeout=5.0))) >= 3
        assert telemetry.take_commands() == ()


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
        taken = telemetry.take_commands()
        assert len(taken) <= 17 and taken[-1] == Command("disarm")
        replies = [reply for handler in pending for reply in handler]
        assert any(reply.err is not None and "busy" in reply.err.payload.to_string() for reply in replies)


def test_taken_port_is_one_warning_and_heals() -> None:
    endpoint, told = free_endpoint(), []

    def on_event(event: str, level: str, fields: Mapping[str, Any]) -> None:
        told.append((event, level, fields.get("reason")))

    with running(Settings(endpoint=endpoint)):
        second = Telemetry(Settings(endpoint=endpoint, retry_s=0.1), on_event=on_event)
        second.start()
        assert wait_until(lambda: second.counts.errors >= 3)
        for k in range(1000):
            second.put(tick(k))
        assert not second.counts.open
    assert wait_until(lambda: second.counts.open)
    assert second.close(10.0)
    assert told == [
        (
            "telemetry_unavailable",
            "warning",
            "the address is already in use: commands sent there go to another program, not here",
        ),
        ("telemetry_open", "info", None),
    ]


def test_full_slot_drops_the_oldest(monkeypatch: pytest.MonkeyPatch) -> None:
    gate, hanging = threading.Event(), threading.Event()

    def hang(_config: object) -> None:
        hanging.set()
        gate.wait(20.0)
        raise RuntimeError("too late")

    monkeypatch.setattr(module.zenoh, "open", hang)
    telemetry = Telemetry(Settings(endpoint=free_endpoint()))
    telemetry.start()
    assert hanging.wait(10.0)
    for k in range(500):
        telemetry.put(tick(k))
    assert len(telemetry._slot) == module.SLOT_ROWS
    assert telemetry.counts.dropped == 500 - module.SLOT_ROWS
    assert telemetry.trouble
    begin = time.monotonic()
    assert not telemetry.close(0.3)  # zenoh hangs: the end comes all the same
    assert time.monotonic() - begin < 2.0
    gate.set()


SUBSCRIBER = """
import sys, time, zenoh
from hoopd.shell.session import connecting
with zenoh.open(connecting(sys.argv[1], {}, 2.0)) as session:
    ring = session.declare_subscriber("hoopd/**", zenoh.handlers.RingChannel(1000))
    print("ready", flush=True)
    time.sleep(60)
"""


def test_frozen_subscriber_delays_nothing() -> None:
    endpoint = free_endpoint()
    with running(Settings(endpoint=endpoint)) as telemetry:
        process = subprocess.Popen(
            [sys.executable, "-c", SUBSCRIBER, endpoint],
            stdout=subprocess.PIPE,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        try:
            assert process.stdout is not None and process.stdout.readline() == b"ready\n"
            process.send_signal(signal.SIGSTOP)
            for k in range(2000):  # 40 s of ticks in 2 s
                telemetry.put(tick(k))
                time.sleep(0.001)
            assert wait_until(lambda: len(telemetry._slot) == 0)
            assert telemetry.counts.published >= 2000 - telemetry.counts.dropped
            assert telemetry.counts.errors == 0
        finally:
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait(10)


OPEN_ENDED = """
import sys, time
from hoopd.shell.telemetry import Settings, Telemetry
telemetry = Telemetry(Settings(endpoint=sys.argv[1]))
telemetry.start()
while not telemetry.counts.open:
    time.sleep(0.01)
if sys.argv[2] == "raise":
    raise SystemExit(3)
print("closed", telemetry.close())
"""


@pytest.mark.parametrize(("way", "code"), [("raise", 3), ("close", 0)])
def test_process_ends_closed_or_not(way: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", OPEN_ENDED, free_endpoint(), way],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=30,
        capture_output=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    assert b"Traceback" not in done.stderr


def users(folder: Path) -> Path:
    """zenoh's own file of users."""
    path = folder / "users.txt"
    path.write_text("viewer:look\noperator:turn\n", encoding="utf-8")
    return path


WATCHING = ["put", "declare_subscriber", "liveliness_token", "declare_liveliness_subscriber", "liveliness_query"]

ACCESS = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [
        {
            "id": "watch",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": WATCHING,
            "key_exprs": ["hoopd/**"],
        },
        {
            "id": "command",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": ["query", "reply", "declare_queryable"],
            "key_exprs": ["hoopd/*/cmd/*"],
        },
    ],
    "subjects": [{"id": "all", "usernames": ["viewer", "operator"]}, {"id": "operators", "usernames": ["operator"]}],
    "policies": [{"rules": ["watch"], "subjects": ["all"]}, {"rules": ["command"], "subjects": ["operators"]}],
}


def who(user: str, password: str) -> dict[str, Any]:
    """zenoh's keys of a client that says who it is."""
    return {"transport/auth/usrpwd/user": user, "transport/auth/usrpwd/password": password}


def test_users_and_access_rules(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    extras = {
        "transport": {"auth": {"usrpwd": {"user": "hoop", "password": "x", "dictionary_file": str(users(tmp_path))}}},
        "access_control": ACCESS,
    }
    with running(Settings(endpoint=endpoint, commands=True, zenoh=extras)) as telemetry:
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=endpoint, timeout_s=1.0)
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=endpoint, timeout_s=1.0, extras=who("operator", "wrong"))
        with pytest.raises(CommandError, match="access rules"):
            send("arm", endpoint=endpoint, timeout_s=1.0, extras=who("viewer", "look"))
        assert telemetry.take_commands() == ()
        send("arm", endpoint=endpoint, extras=who("operator", "turn"))
        assert telemetry.take_commands() == (Command("arm"),)
        with client(endpoint, **who("viewer", "look")) as session:
            rows = session.declare_subscriber("hoopd/hoop/tick", zenoh.handlers.RingChannel(10))
            assert wait_until(lambda: telemetry._publishers["tick"].matching_status.matching)
            telemetry.put(tick(1))
            assert len(receive(rows, 1)) == 1


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (Settings(zenoh={"scouting/typo": 1}), r"telemetry\.zenoh\.scouting/typo: zenoh refuses it"),
        (Settings(endpoint="foo"), r"telemetry\.endpoint: 'foo': expected something like tcp/127\.0\.0\.1:7447"),
        (Settings(endpoint="tcp/127.0.0.1:99999"), r"telemetry\.endpoint"),
        (Settings(device="a/b"), r"device\.name: 'a/b'"),
        (
            Settings(endpoint="tcp/0.0.0.0:7447", commands=True),
            r"telemetry\.commands: tcp/0\.0\.0\.0:7447 is open to other",
        ),
        (Settings(commands=True, zenoh={"listen/endpoints": ["tls/[::]:7447"]}), "is open to other machines"),
    ],
)
def test_unsafe_settings_are_refused_before_anything_opens(settings: Settings, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Telemetry(settings)


def test_operate_says_what_became_of_a_command() -> None:
    seen = {"mode": "DISARMED", "reference": 0.0}
    settings = Settings(endpoint=free_endpoint(), commands=True)
    done = threading.Event()

    def ticks() -> None:
        while not done.wait(0.01):
            for command in telemetry.take_commands():
                if command.name == "reference":
                    seen["reference"] = command.value
            telemetry.put(tick(1)._replace(mode=seen["mode"], reference=seen["reference"]))

    with running(settings) as telemetry:
        thread = threading.Thread(target=ticks)
        thread.start()
        try:
            assert "reference 0.25 rad" in operate("reference", 0.25, settings.endpoint)
            with pytest.raises(CommandError, match="the daemon stays DISARMED"):
                operate("arm", None, settings.endpoint, timeout_s=0.5)
        finally:
            done.set()
            thread.join()
