"""What a peer may cost the daemon: messages of any size, connections of any number."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from harness.neighbours import HUGE, IDLE
from shell.peers import OPERATOR, ROOT, Ticks, controlled, free_endpoint, running, wait_until

from hoopd.shell.remote import send
from hoopd.shell.session import MESSAGE_BYTES
from hoopd.shell.telemetry import TelemetrySettings

MB = 2**20


@contextlib.contextmanager
def peer(script: str, *arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    """A program that is ended with the block."""
    process = subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait(10)


def memory_bytes() -> int:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@contextlib.contextmanager
def largest(measure: object) -> Iterator[list[int]]:
    """The largest value seen meanwhile, looked for every 5 ms."""
    seen, done = [0], threading.Event()

    def look() -> None:
        while not done.wait(0.005):
            seen[0] = max(seen[0], measure())  # type: ignore[operator]

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        done.set()
        thread.join(5.0)


@pytest.mark.parametrize("commands", [False, True], ids=["commands off", "commands on"])
def test_a_query_of_100_mb_is_thrown_away_as_it_comes(tmp_path: Path, commands: bool) -> None:
    settings = controlled(tmp_path) if commands else TelemetrySettings(endpoint=free_endpoint())
    endpoint = settings.control_endpoint if commands else settings.endpoint
    proof = json.dumps(OPERATOR if commands else {})
    with running(settings) as telemetry, Ticks(telemetry.gate) as ticks:
        before = memory_bytes()
        with largest(memory_bytes) as seen, peer(HUGE, endpoint, 100 * 10**6, proof) as process:
            out, _ = process.communicate(timeout=120)
        assert set(out.decode().splitlines()) == {"arm Timeout", "disarm Timeout"}  # of the asker's own
        assert seen[0] - before < 60 * MB
        assert ticks.take() == ()
        assert send("disarm", endpoint=settings.endpoint)["ok"]


def test_the_largest_message_is_still_answered() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint)), peer(HUGE, endpoint, MESSAGE_BYTES // 2, "{}") as process:
        out, _ = process.communicate(timeout=120)
        assert out.decode().splitlines() == ["arm more than 1000 bytes", "disarm more than 1000 bytes"]


def test_2000_idle_connections_take_no_descriptor_for_long() -> None:
    endpoint = free_endpoint()
    with running(TelemetrySettings(endpoint=endpoint)) as telemetry, Ticks(telemetry.gate):
        before = descriptors()
        with peer(IDLE, endpoint.rpartition(":")[2], 2000) as process:
            assert process.stdout is not None and int(process.stdout.readline()) > 0
            assert wait_until(lambda: descriptors() <= before + 4, 30.0)
            assert send("disarm", endpoint=endpoint)["ok"]


def test_more_sessions_than_there_is_room_for_keep_their_bound() -> None:
    endpoint = free_endpoint()
    script = """
import sys, time, zenoh
from hoopd.shell.session import connecting
held = []
for _ in range(60):
    try:
        held.append(zenoh.open(connecting(sys.argv[1], {}, 1.0)))
    except zenoh.ZError:
        break
print(len(held), flush=True)
time.sleep(60)
"""
    with running(TelemetrySettings(endpoint=endpoint)):
        before = descriptors()
        with largest(descriptors) as seen, peer(script, endpoint) as process:
            assert process.stdout is not None
            process.stdout.readline()
        assert seen[0] - before < 64
