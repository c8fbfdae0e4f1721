"""Telemetry under a taken port, a full slot and frozen peers: nothing is delayed, and the end always comes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

import pytest
from harness.timing import on_the_clock
from shell.peers import ROOT, free_endpoint, running, tick, wait_until

from hoopd.shell import telemetry as module
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.telemetry import Telemetry, TelemetrySettings


def test_taken_port_is_one_warning_and_heals() -> None:
    endpoint, told = free_endpoint(), []

    def on_event(event: str, level: str, fields: Mapping[str, Any]) -> None:
        told.append((event, level, fields.get("reason")))

    with running(TelemetrySettings(endpoint=endpoint)):
        second = Telemetry(TelemetrySettings(endpoint=endpoint, retry_s=0.1), Gate(Ranges()), on_event=on_event)
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
    telemetry = Telemetry(TelemetrySettings(endpoint=free_endpoint()), Gate(Ranges()))
    telemetry.start()
    assert hanging.wait(10.0)
    for k in range(500):
        telemetry.put(tick(k))
    assert len(telemetry._slot) == module.SLOT_ROWS
    assert telemetry.counts.dropped == 500 - module.SLOT_ROWS
    assert telemetry.trouble
    begin = time.monotonic()
    assert not telemetry.close(0.3)  # zenoh hangs: the end comes all the same
    with on_the_clock():
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
    with running(TelemetrySettings(endpoint=endpoint)) as telemetry:
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
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.telemetry import TelemetrySettings, Telemetry
telemetry = Telemetry(TelemetrySettings(endpoint=sys.argv[1]), Gate(Ranges()))
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
