"""Does the page disturb control? `python tools/bench/undisturbed.py --seconds 20 --turns 6`.

Runs the rig in real time, with the real-time priority that the unit grants, and in turns of one run beside it

    page    a browser that draws, nine WebSocket clients of which one takes nothing, and a diagnosis as a job
    dummy   as much work that has nothing to do with the page: a process that burns the processor time which browser,
            server and clients took in the turn before, and one that takes what nobody else wants, as a job does

Prints execution and lateness of the ticks of each, p50 and p99, and the ratios. Exit code 1 when a ratio is above 1.1,
or when there was nothing to compare: no diagnosis ran, the browser drew nothing, or no client got frames.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import processes
import psutil
import zenoh
from live_picture import RING
from web_page import Reader, page_server, read
from websockets.sync.client import connect

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.browser import CHROMIUM, Page, opened  # noqa: E402

from hoopd.dashboard.work.background import background  # noqa: E402
from hoopd.shell.session import connecting  # noqa: E402

START_S, SETTLE_S = 10.0, 2.0
CLIENTS, STALLED = 8, 1
MOST = 1.1
HIDDEN = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.008}}]"
# Works for a share of every ten milliseconds, until the bench is gone.
SHARE = (
    "import os, sys, time\nparent, share = os.getppid(), float(sys.argv[1])\n"
    "while os.getppid() == parent:\n"
    "    end = time.perf_counter() + 0.01 * min(1.0, share)\n"
    "    while time.perf_counter() < end: pass\n"
    "    time.sleep(0.01 * max(0.0, 1.0 - share))\n"
)


@dataclass
class Beside:
    """Ticks of all turns of a kind."""

    execution_ms: list[float] = field(default_factory=list)
    lateness_ms: list[float] = field(default_factory=list)


def follow(session: zenoh.Session, kind: Beside, seconds: float) -> None:
    """Take ticks for a while."""
    until = time.monotonic() + seconds
    with session.declare_subscriber("hoopd/hoop/tick", zenoh.handlers.RingChannel(RING)) as ticks:
        while time.monotonic() < until:
            time.sleep(0.05)
            while sample := ticks.try_recv():
                row = json.loads(sample.payload.to_bytes())
                kind.execution_ms.append(1e3 * row["execution_s"])
                kind.lateness_ms.append(1e3 * row["lateness_s"])


def used(tree: psutil.Process) -> float:
    """Processor time of a process and those below it, s."""
    total = 0.0
    for one in (tree, *tree.children(recursive=True)):
        with contextlib.suppress(psutil.Error):
            total += sum(one.cpu_times()[:2])
    return total


@contextlib.contextmanager
def clients(origin: str, readers: list[Reader]) -> Iterator[None]:
    """WebSockets that read, and one that does not."""
    over, live = threading.Event(), origin.replace("http", "ws") + "/api/live"
    quiet: dict[str, Any] = {"origin": origin, "max_queue": 1, "ping_interval": None, "close_timeout": 0.1}
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(connect(live, **quiet)) for _ in range(CLIENTS + STALLED)]
        threads = [
            threading.Thread(target=read, args=(socket, reader, over))
            for socket, reader in zip(sockets, readers, strict=False)
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            over.set()
            for thread in threads:
                thread.join()


@contextlib.contextmanager
def diagnosis(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A diagnosis as the page's server starts one, again and again."""
    words = [sys.executable, "-m", "hoopd", "diagnose", str(folder / "a.mcap"), "--model", "models/hoop.yaml"]
    line = " ".join(f"'{one}'" for one in (*background(), *words))
    with processes.process(["sh", "-c", f"while true; do {line}; done"], **QUIETLY) as child:
        yield child


QUIETLY: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}


def ended(child: subprocess.Popen[bytes]) -> None:
    """A shell and what it started."""
    for one in psutil.Process(child.pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):
            one.kill()


def beside_page(
    session: zenoh.Session, kind: Beside, seconds: float, folder: Path, server: psutil.Process, origin: str, page: Page
) -> tuple[float, dict[str, float]]:
    """One turn with everything; cores that page, server and clients took, and what shows that they worked."""
    readers = [Reader() for _ in range(CLIENTS)]
    browsers = [one for one in psutil.Process().children() if "chrom" in one.name()]
    page.open(origin)
    page.ask("window.frames = 0; (function count() { window.frames += 1; requestAnimationFrame(count); })()")
    trees = [server, *browsers]
    with clients(origin, readers), diagnosis(folder) as job:
        time.sleep(SETTLE_S)
        own = psutil.Process()
        began = time.monotonic(), sum(map(used, trees)), sum(own.cpu_times()[:2])
        follow(session, kind, seconds)
        elapsed = time.monotonic() - began[0]
        cores = (sum(map(used, trees)) - began[1] + sum(own.cpu_times()[:2]) - began[2]) / elapsed
        worked = {
            "frames drawn": float(page.ask("window.frames")),
            "frames of the slowest client": float(min(one.frames for one in readers)),
            "diagnoses running": float(len(psutil.Process(job.pid).children())),
        }
        ended(job)
    page.open("about:blank")
    return cores, worked


def beside_dummy(session: zenoh.Session, kind: Beside, seconds: float, cores: float) -> None:
    """One turn with as much work of no use."""
    with contextlib.ExitStack() as stack:
        burning = [sys.executable, "-c", SHARE]
        stack.enter_context(processes.process([*burning, f"{min(1.0, cores):.3f}"]))
        if cores > 1.0:
            stack.enter_context(processes.process([*burning, f"{cores - 1.0:.3f}"]))
        stack.enter_context(processes.process([*background(), sys.executable, "-c", processes.BUSY]))
        time.sleep(SETTLE_S)
        follow(session, kind, seconds)


def figures(kind: Beside) -> list[float]:
    """p50 and p99 of execution and of lateness, ms."""
    return [float(np.percentile(of, q)) for of in (kind.execution_ms, kind.lateness_ms) for q in (50, 99)]


def judged(page: Beside, dummy: Beside, worked: dict[str, float], fifo: bool) -> list[str]:
    """What does not hold."""
    wrong = [f"{name}: none" for name, count in worked.items() if count < 1.0]
    names = ("execution p50", "execution p99", "lateness p50", "lateness p99")
    pairs = zip(names, figures(page), figures(dummy), strict=True)
    wrong += [f"{name} {a / b:.2f} times" for name, a, b in pairs if a > MOST * b]
    return wrong if fifo else [*wrong, "no real-time priority is granted here"]


def record(folder: Path) -> None:
    """What the diagnosis works on."""
    words = ["experiment", "prbs", "--sim", "--speed", "max", "--camera", "direct", "--set", HIDDEN]
    subprocess.run(
        [sys.executable, "-m", "hoopd", *words, "--out", str(folder / "a.mcap")], check=True, capture_output=True
    )


def measure(folder: Path, seconds: float, turns: int) -> tuple[Beside, Beside, dict[str, float]]:
    """All turns of one run."""
    page_kind, dummy = Beside(), Beside()
    length = START_S + 40.0 + turns * (seconds + 15.0)
    command = processes.daemon_command(length, "--camera", "direct", fifo=processes.fifo_granted())
    endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
    with processes.daemon(command), page_server(endpoint) as (server, origin), opened(folder, origin) as page:
        time.sleep(START_S)
        with zenoh.open(connecting(endpoint, {}, 5.0)) as session:
            cores, worked = 0.0, dict[str, float]()
            for turn in range(turns):
                if turn % 2:
                    beside_dummy(session, dummy, seconds, cores)
                else:
                    cores, worked = beside_page(session, page_kind, seconds, folder, server, origin, page)
                    print(f"turn {turn + 1}: page, server and clients took {cores:.2f} cores; {worked}", flush=True)
    return page_kind, dummy, worked


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each turn")
    parser.add_argument("--turns", type=int, default=6, help="an even number")
    options = parser.parse_args()
    if CHROMIUM is None:
        print("chromium is not installed (Debian's package of that name)")
        return 1
    with tempfile.TemporaryDirectory() as name:
        record(Path(name))
        page, dummy, worked = measure(Path(name), options.seconds, options.turns)
    print(f"{'beside':>8} {'ticks':>6} {'execution p50, p99 ms':>22} {'lateness p50, p99 ms':>22}")
    for label, kind in (("page", page), ("dummy", dummy)):
        print(f"{label:>8} {len(kind.execution_ms):6} " + " ".join(f"{one:10.3f}" for one in figures(kind)))
    ratios = [a / b for a, b in zip(figures(page), figures(dummy), strict=True)]
    print(f"{'ratio':>8} {'':6} " + " ".join(f"{one:10.2f}" for one in ratios))
    wrong = judged(page, dummy, worked, processes.fifo_granted())
    print("every bound holds" if not wrong else f"it does not hold: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
