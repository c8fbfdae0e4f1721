"""`hoopd watch`: what is shown of a daemon's messages, in 80 columns; that it goes and comes back; how it ends."""

from __future__ import annotations

import contextlib
import io
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from shell.peers import free_endpoint, running, tick, wait_until

from hoopd.commands.options.watch import WatchOptions
from hoopd.commands.watch import DaemonWatch, watch
from hoopd.commands.watch_view import WIDTH, fault_lines, line, view
from hoopd.commands.watched import SILENT_S, WatchedDaemon
from hoopd.core.faulttable import FAULTS
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Connection
from hoopd.files.reading import InputError
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

NOW = 1000.0
ROW = {
    "t": 12.5, "id": 625, "mode": "RUNNING", "u": -0.0123, "theta": 123.456, "dtheta": -7.89, "current": 0.25,
    "psi": 0.0456, "psi_t": 12.45, "x_hat": [123.4, -7.9, 0.04, 1.5], "reference": 0.05,
}  # fmt: skip
STATUS = {
    "t": 12.5, "mode": "RUNNING", "tick_rate_hz": 50.0, "lateness_worst_s": 0.0012, "lateness_p99_s": 0.0004,
    "execution_worst_s": 0.002, "execution_p99_s": 0.001, "missed_ticks": 3, "faults": [], "causes": {},
    "arming": "possible", "deviation": [0.001, 0.05, 0.0005, 0.01], "camera": {"frames": 600},
    "telemetry": {"dropped": 7}, "recorder": {"dropped": 0},
}  # fmt: skip


def watched(*messages: tuple[str, Mapping[str, Any]], now_s: float = NOW, run: str = "a") -> WatchedDaemon:
    """A daemon of which this was heard."""
    device, daemon = ShownDevice("hoop", "tcp/127.0.0.1:7447"), WatchedDaemon()
    device.presence(True)
    for kind, message in messages:
        device.take(kind, json.dumps(message).encode(), run, NOW)
        daemon.update(device, now_s)
    return daemon


def drawn(daemon: WatchedDaemon, news: str = "") -> str:
    console = Console(width=WIDTH, record=True, file=io.StringIO())
    console.print(view(daemon, "tcp/127.0.0.1:7447", news))
    return console.export_text()


def test_the_tables_have_angles_with_units_rates_and_lateness() -> None:
    later = {**STATUS, "t": 13.5, "camera": {"frames": 650}}
    unseen = {**ROW, "psi": None, "psi_t": None}
    text = drawn(watched(("tick", ROW), ("status", STATUS), ("tick", unseen), ("status", later)))
    cells = [[cell.strip() for cell in row.strip("│").split("│")] for row in text.splitlines() if row.startswith("│")]
    rows = {name: others for name, *others in cells}
    assert rows["ball angle"] == ["rad", "0.0456", "0.0400", "0.0005"]  # the newest one that was seen
    assert rows["hoop speed"] == ["rad/s", "-7.890", "-7.900", "0.050"]
    assert rows["torque"][:2] == ["N m", "-0.0123"]
    assert rows["ticks"] == ["50.0 a second", "3 missed"]
    assert rows["lateness"] == ["1.2 ms at worst", "99 % below 0.4 ms"]
    assert rows["pictures"][0] == "50.0 a second" and rows["age of the newest picture"][0] == "50.0 ms"
    assert rows["telemetry, lost rows"][1] == "7"
    assert "RUNNING" in text and "no faults" in text and "armed" not in text


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_no_fault_s_words_are_cut_at_80_columns(fault: Any) -> None:
    clears = "it is over: `hoopd clear` or `hoopd arm`"
    causes = {fault.name: {"meaning": fault.meaning, "clears": clears}}
    status = {**STATUS, "faults": [fault.name], "causes": causes}
    daemon = watched(("tick", {**ROW, "mode": "FAULT"}), ("status", status))
    text = drawn(daemon)
    assert max(map(len, text.splitlines())) <= WIDTH and "…" not in text
    assert {fault.name, *fault.meaning.split(), *clears.split()} <= set(text.replace("│", " ").split())
    lines = fault_lines(daemon)
    assert max(map(len, lines)) <= WIDTH
    assert " ".join(" ".join(lines).split()) == f"{fault.name}: {fault.meaning}; {clears}"


def test_one_line_has_80_characters_at_most() -> None:
    large = {**ROW, "t": 99999.9, "psi": -12.345, "dtheta": -199.99, "u": -0.7, "mode": "DISARMED"}
    text = line(watched(("tick", large), ("status", {**STATUS, "lateness_worst_s": 0.9999})))
    assert len(text) <= WIDTH
    wanted = "99999.9 s DISARMED ball -12.345 rad hoop -199.99 rad/s -0.700 N m 999.9 ms"
    assert " ".join(text.split()) == wanted
    assert len(line(watched())) <= WIDTH


def test_what_is_in_the_way_of_arming_is_told_while_it_is_off() -> None:
    off = {**STATUS, "arming": "link_lost, camera_lost"}
    text = drawn(watched(("tick", {**ROW, "mode": "DISARMED"}), ("status", off)))
    assert "in the way of arming: link_lost, camera_lost" in text


def test_words_from_the_network_are_no_markup() -> None:
    text = drawn(watched(("tick", {**ROW, "mode": "[red]\x1b[2J"}), ("status", {**STATUS, "faults": ["[bold]x\x07"]})))
    assert "[red]" in text and "[bold]x" in text and "\x1b" not in text and "\x07" not in text


def test_what_is_silent_is_not_there_and_another_run_begins_anew() -> None:
    assert not watched(("tick", ROW), now_s=NOW + SILENT_S + 0.1).there
    device, daemon = ShownDevice("hoop", "tcp/127.0.0.1:7447"), WatchedDaemon()
    device.presence(True)
    for run, message in (("a", ROW), ("b", {"t": 0.0})):
        device.take("tick", json.dumps(message).encode(), run, NOW)
        daemon.update(device, NOW)
    assert daemon.run == "b" and daemon.numbers.keys() == {"wall", "t"}
    device.presence(False)
    daemon.update(device, NOW)
    assert not daemon.there


# --- beside telemetry that is open -----------------------------------------------------------------------------------


def said_until(shown: DaemonWatch, condition: Callable[[], bool], telemetry: Telemetry | None = None) -> list[str]:
    """What was said until it held, while a daemon goes on ticking."""
    said: list[str] = []

    def look() -> bool:
        if telemetry is not None:
            telemetry.put(tick(5))
        said.append(shown.look())
        return condition()

    assert wait_until(look)
    return [text for text in said if text]


def test_it_says_when_the_daemon_is_gone_and_back() -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    connection = Connection(settings.endpoint, {})
    connection.start()
    shown = DaemonWatch(connection, "hoop")
    try:
        shown.look()
        assert shown.news.startswith("no daemon for 0 s, waiting: ")
        for run, told in (("a", []), ("b", ["the daemon is back, another run"])):
            with running(replace(settings, session=run)) as telemetry:
                assert (
                    said_until(shown, lambda: shown.daemon.there and shown.daemon.mode == "RUNNING", telemetry) == told
                )
            (gone,) = said_until(shown, lambda: not shown.daemon.there)
            assert gone.startswith("the daemon is gone: ")
    finally:
        connection.close()


def test_once_without_a_daemon_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hoopd.commands.watch.FIRST_S", 0.3)
    endpoint = free_endpoint()
    with pytest.raises(InputError, match=f"{endpoint}: no daemon answers"):
        watch(WatchOptions(connect=endpoint, once=True))
    with pytest.raises(InputError, match="--json: only with --once"):
        watch(WatchOptions(connect=endpoint, json_path=Path("x.json")))


def test_once_shows_a_daemon_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    with running(settings) as telemetry, ticking(telemetry):
        watch(WatchOptions(connect=settings.endpoint, once=True, json_path=tmp_path / "now.json"))
    told = json.loads((tmp_path / "now.json").read_text())
    assert (told["device"], told["alive"], told["mode"], told["endpoint"]) == (
        "hoop",
        True,
        "RUNNING",
        settings.endpoint,
    )
    assert told["numbers"]["theta"] == 0.1 and told["status"]["mode"] == "RUNNING"
    assert "ball angle" in capsys.readouterr().out


def test_ctrl_c_is_its_ordinary_end() -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    command = [sys.executable, "-m", "hoopd", "watch", "--connect", settings.endpoint]
    with (
        running(settings) as telemetry,
        ticking(telemetry),
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        assert process.stdout is not None
        assert "RUNNING" in process.stdout.readline()  # no terminal: one line a second
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0


@contextlib.contextmanager
def ticking(telemetry: Telemetry) -> Iterator[None]:
    """A loop that ticks until the block ends."""
    done = threading.Event()

    def run() -> None:
        while not done.wait(0.02):
            telemetry.put(tick(5))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(5.0)
