"""`hoopd dashboard` as a process: where it listens, over what, and how it ends."""

from __future__ import annotations

import http.client
import json
import signal
import ssl
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from harness.realrun import ENVIRONMENT, ROOT
from inprocess import call
from shell.peers import free_endpoint
from websockets.sync.client import connect

LICENCE = str(ROOT / "LICENSE")  # a file that is no certificate


@contextmanager
def started(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process and the address that it prints; ended with the block."""
    process = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    try:
        assert process.stdout is not None
        line = next((line for line in process.stdout if line.startswith("dashboard: ")), "")
        yield process, line.removeprefix("dashboard: ").strip()
    finally:
        process.kill()
        process.communicate()


def page(*words: str) -> tuple[str, ...]:
    return ("-m", "hoopd", "dashboard", "--connect", free_endpoint(), "--listen", "127.0.0.1:0", *words)


def test_it_prints_where_it_is_and_ends_when_it_is_told_to() -> None:
    with started(*page()) as (process, address):
        assert urllib.request.urlopen(address, timeout=10.0).status == 200
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) in (0, -signal.SIGTERM)
        assert process.stderr is not None and process.stderr.read() == ""


def test_over_tls_page_and_frames_are_encrypted(tmp_path: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    made = (
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:P-256",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=page.test",
    )
    names = ("-addext", "subjectAltName=DNS:page.test,IP:127.0.0.1")
    subprocess.run(["openssl", *made, *names, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    words = ("--certificate", str(certificate), "--key", str(key), "--name", "page.test")
    with started(*page(*words)) as (_, address):
        assert address.startswith("https://page.test:")
        port = int(address.rpartition(":")[2].strip("/"))
        trusted = ssl.create_default_context(cafile=str(certificate))
        connection = http.client.HTTPSConnection("127.0.0.1", port, context=trusted, timeout=10.0)
        origin = f"https://page.test:{port}"
        connection.request("POST", "/api/stop", "{}", {"host": f"page.test:{port}", "origin": origin})
        assert json.load(connection.getresponse())["answers"] == []
        connection.request(
            "POST", "/api/stop", "{}", {"host": f"page.test:{port}", "origin": origin.replace("s:", ":")}
        )
        assert connection.getresponse().status == 403
        connection.close()
        here = f"https://127.0.0.1:{port}"
        with connect(f"wss://127.0.0.1:{port}/api/live", ssl=trusted, origin=here) as socket:  # type: ignore[arg-type]
            assert "endpoints" in json.loads(socket.recv(10.0))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--listen", "0.0.0.0:8765"), "--listen: 0.0.0.0: other machines reach it: give --certificate and --key"),
        (("--certificate", "none.pem"), "--certificate: goes with --key"),
        (("--certificate", "none.pem", "--key", "none.key"), "none.pem: --certificate: no such file"),
        (
            ("--certificate", str(ROOT / "LICENSE"), "--key", str(ROOT / "LICENSE")),
            "LICENSE: --certificate: cannot be used",
        ),
        (("--connect", "nowhere"), "telemetry.endpoint: 'nowhere': expected something like tcp/127.0.0.1:7447"),
        (("--control", "a", "--control", "b"), "--control: 2 endpoints of control beside 1 of telemetry"),
        (("--control", "nowhere"), "'nowhere': expected something like"),
        (("--audit", "nothing/audit.jsonl"), "nothing/audit.jsonl: --audit: no such file or directory"),
        (("--config", "none.yaml"), "none.yaml"),
    ],
)
def test_what_cannot_be_served_is_one_line(words: tuple[str, ...], says: str) -> None:
    code, _, errors = call(("dashboard", *words))
    assert code == 2 and says in errors and errors.count("\n") == 1, errors


@pytest.mark.realtime
def test_rig_and_page_in_one_command() -> None:
    with started("tools/sim_web.py", "--listen", "127.0.0.1:0", "--seconds", "100") as (process, address):
        assert urllib.request.urlopen(address, timeout=10.0).status == 200
        me = urllib.request.urlopen(f"{address}api/me", timeout=10.0)
        assert json.load(me) == {"possible": True, "user": None}
        process.send_signal(signal.SIGTERM)
        assert process.wait(30.0) == 0
