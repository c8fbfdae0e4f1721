"""What does the web page cost, and whom? `python tools/bench/web_page.py --seconds 20`.

Runs the rig in real time without pictures and `hoopd dashboard` beside it, with no page, one, and sixteen of which half
take nothing. Prints for each what the page's server takes of a core and of the memory, the frames that a
page gets, and the daemon's lateness and execution; then how long STOP takes from a browser's question to the daemon's
answer. Exit code 1 when a bound below does not hold; lateness and execution are the machine's, too, and are not judged.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median, quantiles

import processes
import psutil
from websockets.sync.client import ClientConnection, connect

START_S = 12.0  # until the rig controls
STOPS = 20
CASES = ((0, 0), (1, 0), (8, 8))  # pages that read, and pages that take nothing
# A Raspberry Pi's core is three to four times slower than a desk's: there it may be a third of one.
CORE_LIMIT = 0.10
MEMORY_LIMIT_MB = 150.0
STOP_LIMIT_MS = 200.0  # as quick as a hand; the daemon's part is a tick and two turns of its telemetry
LEAST_FRAMES_HZ = 10.0  # beside any other page


@dataclass
class Reader:
    """A page that takes every frame."""

    frames: int = 0
    late_ms: list[float] = field(default_factory=list)
    exec_ms: list[float] = field(default_factory=list)
    dropped: int = 0

    def take(self, text: str) -> None:
        """One frame."""
        self.frames += 1
        for news in json.loads(text)["devices"].values():
            status = news.get("state", {}).get("status", {})
            if "lateness_worst_s" in status:
                self.late_ms.append(1e3 * status["lateness_worst_s"])
                self.exec_ms.append(1e3 * status["execution_worst_s"])
                self.dropped = status["telemetry"]["dropped"]


def read(socket: ClientConnection, reader: Reader, over: threading.Event) -> None:
    """Take frames until it is over."""
    with contextlib.suppress(TimeoutError):
        while not over.is_set():
            reader.take(str(socket.recv(2.0)))


@contextlib.contextmanager
def page_server(endpoint: str) -> Iterator[tuple[psutil.Process, str]]:
    """`hoopd dashboard`, and where it is."""
    command = [sys.executable, "-m", "hoopd", "dashboard", "--connect", endpoint, "--listen", "127.0.0.1:0"]
    with processes.process(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        assert server.stdout is not None
        line = server.stdout.readline().decode()
        yield psutil.Process(server.pid), line.removeprefix("dashboard: ").strip().rstrip("/")


def measure(server: psutil.Process, origin: str, case: tuple[int, int], seconds: float) -> dict[str, float]:
    """Figures of one case."""
    over, readers = threading.Event(), [Reader() for _ in range(case[0])]
    live = origin.replace("http", "ws") + "/api/live"
    quiet = {"origin": origin, "max_queue": 1, "ping_interval": None, "close_timeout": 0.1}
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(connect(live, **quiet)) for _ in range(sum(case))]  # type: ignore[arg-type]
        pairs = zip(sockets, readers, strict=False)
        threads = [threading.Thread(target=read, args=(socket, reader, over)) for socket, reader in pairs]
        for thread in threads:
            thread.start()
        began, before = time.monotonic(), sum(server.cpu_times()[:2])
        time.sleep(seconds)
        elapsed, used = time.monotonic() - began, sum(server.cpu_times()[:2]) - before
        over.set()
        for thread in threads:
            thread.join()
    first = readers[0] if readers else Reader()
    return {
        "core": used / elapsed,
        "memory_mb": server.memory_info().rss / 1e6,
        "frames_hz": min((reader.frames for reader in readers), default=0) / elapsed,
        "late_ms": max(first.late_ms, default=float("nan")),
        "exec_ms": max(first.exec_ms, default=float("nan")),
        "dropped": first.dropped,
    }


def stops(origin: str) -> list[float]:
    """How long STOP takes, ms."""
    took = []
    for _ in range(STOPS):
        began = time.monotonic()
        request = urllib.request.Request(f"{origin}/api/stop", b"{}", {"Origin": origin})
        with urllib.request.urlopen(request, timeout=10.0) as answer:
            assert json.load(answer)["ok"]
        took.append(1e3 * (time.monotonic() - began))
    return took


def judged(rows: Sequence[dict[str, float]], took: Sequence[float]) -> list[str]:
    """Bounds that do not hold."""
    wrong = [f"{row['core']:.0%} of a core" for row in rows if row["core"] > CORE_LIMIT]
    wrong += [f"{row['memory_mb']:.0f} MB" for row in rows if row["memory_mb"] > MEMORY_LIMIT_MB]
    wrong += [f"{row['frames_hz']:.1f} frames a second" for row in rows[1:] if row["frames_hz"] < LEAST_FRAMES_HZ]
    wrong += [f"{row['dropped']:.0f} rows dropped by the daemon" for row in rows if row["dropped"]]
    return wrong + ([f"STOP took {median(took):.0f} ms"] if median(took) > STOP_LIMIT_MS else [])


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each case")
    seconds = parser.parse_args().seconds
    command = processes.daemon_command(START_S + 20.0 + len(CASES) * (seconds + 5.0), "--camera", "direct")
    endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
    rows = []
    with processes.daemon(command), page_server(endpoint) as (server, origin):
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+", origin), origin
        time.sleep(START_S)
        print(f"{'pages':>14} {'core':>7} {'MB':>6} {'frames/s':>9} {'worst lateness, execution ms':>30}")
        for case in CASES:
            row = measure(server, origin, case, seconds)
            rows.append(row)
            late = f"{row['late_ms']:.2f}, {row['exec_ms']:.2f}"
            shown = f"{case[0]} + {case[1]} stalled"
            print(
                f"{shown:>14} {row['core']:7.1%} {row['memory_mb']:6.0f} {row['frames_hz']:9.1f} {late:>30}", flush=True
            )
        took = stops(origin)
    print(f"STOP to the answer: median {median(took):.0f} ms, 95 % {quantiles(took, n=20)[-1]:.0f} ms of {STOPS}")
    wrong = judged(rows, took)
    print("every bound holds" if not wrong else f"too much: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
