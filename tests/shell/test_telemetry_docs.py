"""docs/reference/telemetry.md and the example subscriber, run as they are written."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from shell.peers import Ticks

from hoopd.core.records import Command, TickRecord
from hoopd.files.reading import load_yaml
from hoopd.shell.commands import ALWAYS, NAMES, Gate, Ranges
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import send
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "telemetry.md").read_text(encoding="utf-8")


def free_port() -> int:
    """A loopback port that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def ticking(settings: TelemetrySettings) -> Iterator[Telemetry]:
    """Telemetry with 50 ticks a second from a thread."""
    telemetry, stop = Telemetry(settings, Gate(Ranges())), threading.Event()

    def feed() -> None:
        k = 0
        while not stop.wait(0.02):
            k += 1
            telemetry.put(TickRecord(k * 0.02, k, "RUNNING", 0.1, 0, 0, 0, 0.2, 0, 0, (0, 0, 0, 0), 0, 1, 0, 0, 0))

    telemetry.start()
    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    try:
        end = time.monotonic() + 10.0
        while not telemetry.counts.open and time.monotonic() < end:
            time.sleep(0.02)
        assert telemetry.counts.open
        yield telemetry
    finally:
        stop.set()
        thread.join(5.0)
        assert telemetry.close(10.0)


def block(language: str) -> str:
    """The only fenced block of that language."""
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(text)


def subscriber(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The example, bounded in time."""
    command = [sys.executable, str(ROOT / "tools" / "subscriber.py"), "--endpoint", endpoint, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, timeout=40, check=False, env=environment)


def certificates(folder: Path) -> None:
    """A certificate for 127.0.0.1 and its authority."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here to make a certificate with")
    (folder / "san.txt").write_text("subjectAltName=IP:127.0.0.1\n", encoding="utf-8")
    new = ["openssl", "req", "-newkey", "rsa:2048", "-nodes", "-subj"]
    steps = [
        [*new, "/CN=lab", "-x509", "-days", "2", "-keyout", "ca.key", "-out", "ca.pem"],
        [*new, "/CN=hoop", "-keyout", "server.key", "-out", "server.csr"],
        ["openssl", "x509", "-req", "-in", "server.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial"],
    ]
    steps[2] += ["-days", "2", "-extfile", "san.txt", "-out", "server.pem"]
    for step in steps:
        subprocess.run(step, cwd=folder, check=True, capture_output=True, timeout=30)


def at_home(text: str, folder: Path) -> str:
    """Paths of the page, moved into a test's folder."""
    return text.replace("/etc/hoopd", str(folder))


def test_example_with_tls_users_and_access_rules(tmp_path: Path) -> None:
    certificates(tmp_path)
    (tmp_path / "users.txt").write_text("viewer:look\noperator:turn\n", encoding="utf-8")
    example: dict[str, Any] = load_yaml(at_home(block("yaml"), tmp_path), PAGE)["telemetry"]
    keys: dict[str, Any] = json.loads(at_home(block("json"), tmp_path))
    (tmp_path / "client.json").write_text(json.dumps(keys), encoding="utf-8")
    operator = {**keys, "transport/auth/usrpwd/user": "operator", "transport/auth/usrpwd/password": "turn"}
    own = TelemetrySettings(
        endpoint=example["endpoint"],
        zenoh=example["zenoh"],
        commands=example["commands"],
        control_endpoint=example["control"]["endpoint"],
        control_zenoh=example["control"]["zenoh"],
    )
    Telemetry(own, Gate(Ranges()))  # the page's own: accepted
    endpoint, control = f"tls/127.0.0.1:{free_port()}", f"tls/127.0.0.1:{free_port()}"
    with ticking(dataclasses.replace(own, endpoint=endpoint, control_endpoint=control)) as telemetry:
        done = subscriber(
            endpoint, "--count", "5", "--seconds", "15", "--json", "--zenoh", str(tmp_path / "client.json")
        )
        assert done.returncode == 0, done.stderr
        assert subscriber(endpoint, "--seconds", "2").returncode != 0  # nobody
        for extras in (keys, {}):
            with pytest.raises(CommandError):
                send("arm", endpoint=control, extras=extras, timeout_s=1.0)
        with pytest.raises(CommandError, match=r"needs telemetry\.control"):
            send("arm", endpoint=endpoint, extras=operator, timeout_s=1.0)
        assert telemetry.gate.take() == ()
        with Ticks(telemetry.gate) as ticks:
            send("arm", endpoint=control, extras=operator)
            assert ticks.take() == (Command("arm"),)


def test_subscriber_prints_lines_and_ends() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ticking(TelemetrySettings(endpoint=endpoint, session="0123abcd")):
        live = subscriber(endpoint, "--seconds", "2.5")
        assert live.returncode == 0, live.stderr
        assert re.search(r"0123abcd  \d\d\.\d ticks/s  RUNNING +psi +\+0\.200 rad  torque +\+0\.100 N m", live.stdout)
        rows = [json.loads(line) for line in subscriber(endpoint, "--count", "5", "--json").stdout.splitlines()]
        assert sum(row["key"] == "tick" for row in rows) == 5
        assert {row["session"] for row in rows} == {"0123abcd"}


def test_subscriber_without_daemon_is_one_line() -> None:
    done = subscriber(f"tcp/127.0.0.1:{free_port()}", "--seconds", "1")
    assert done.returncode == 2
    assert done.stderr.startswith("no daemon answers at") and done.stderr.count("\n") == 1


def test_every_command_is_documented() -> None:
    page = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| (yes|no) \|$", page, re.MULTILINE))
    assert set(rows) == set(NAMES)
    assert {name for name, always in rows.items() if always == "yes"} == set(ALWAYS)
