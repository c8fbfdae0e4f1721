"""Does the page's memory stay bounded? `python tools/bench/page_memory.py --minutes 12`.

Runs the rig in real time without pictures and the page in Debian's chromium, headless, without a graphics card. Every
half minute it prints the page's JavaScript heap and its buffers after a collection, the browser's own count of nodes
and listeners, and the frames a second that were drawn since. The page keeps ten minutes: from then on nothing may grow.
Exit code 1 when heap and buffers at the end are above 1.25 times what they were after two minutes, or above 200 MB,
when nodes or listeners doubled, or when fewer than five frames a second were drawn.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import processes
from web_page import page_server

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.browser import CHROMIUM, Page, opened  # noqa: E402

START_S, EVERY_S, FIRST_S = 8.0, 30.0, 120.0
GROWTH, MOST_MB, LEAST_HZ = 1.25, 200.0, 5.0
COUNTING = "window.frames = 0; (function count() { window.frames += 1; requestAnimationFrame(count); })()"


class PageMemory(NamedTuple):
    """One look."""

    t: float  # s since the page was opened
    memory_mb: float  # heap and buffers
    nodes: float
    listeners: float
    frames_hz: float


def look(page: Page, began: float, before: tuple[float, float]) -> tuple[PageMemory, tuple[float, float]]:
    """What the browser tells; `before`: time and frames of the look before."""
    page.call("HeapProfiler.collectGarbage")
    heap = page.call("Runtime.getHeapUsage")
    counts = page.call("Memory.getDOMCounters")
    now, frames = time.monotonic(), float(page.ask("window.frames"))
    memory_mb = (heap["usedSize"] + heap.get("backingStorageSize", 0.0)) / 1e6
    rate_hz = (frames - before[1]) / (now - before[0])
    return PageMemory(now - began, memory_mb, counts["nodes"], counts["jsEventListeners"], rate_hz), (now, frames)


def measure(page: Page, minutes: float) -> list[PageMemory]:
    """All looks, printed as they come."""
    page.ask(COUNTING)
    began = time.monotonic()
    before, looks = (began, 0.0), list[PageMemory]()
    print(f"{'min':>6} {'MB':>8} {'nodes':>8} {'listeners':>10} {'frames/s':>9}")
    while time.monotonic() - began < 60.0 * minutes:
        time.sleep(EVERY_S)
        one, before = look(page, began, before)
        looks.append(one)
        print(
            f"{one.t / 60:6.1f} {one.memory_mb:8.1f} {one.nodes:8.0f} {one.listeners:10.0f} {one.frames_hz:9.1f}",
            flush=True,
        )
    return looks


def judged(looks: list[PageMemory]) -> list[str]:
    """What does not hold."""
    first, last = next((one for one in looks if one.t >= FIRST_S), looks[0]), looks[-1]
    wrong = [f"{last.memory_mb:.0f} MB"] if last.memory_mb > MOST_MB else []
    if last.memory_mb > GROWTH * first.memory_mb:
        wrong.append(f"{first.memory_mb:.0f} MB grew to {last.memory_mb:.0f} MB")
    wrong += ["more nodes"] if last.nodes > 2.0 * first.nodes else []
    wrong += ["more listeners"] if last.listeners > 2.0 * first.listeners else []
    slowest = min(one.frames_hz for one in looks)
    return wrong + ([f"{slowest:.1f} frames a second"] if slowest < LEAST_HZ else [])


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=12.0)
    minutes = parser.parse_args().minutes
    if CHROMIUM is None:
        print("chromium is not installed (Debian's package of that name)")
        return 1
    command = processes.daemon_command(
        START_S + 60.0 * minutes + 60.0, "--camera", "direct", fifo=processes.fifo_granted()
    )
    endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
    with tempfile.TemporaryDirectory() as name, processes.daemon(command), page_server(endpoint) as (_, origin):
        time.sleep(START_S)
        with opened(Path(name), origin, 1440, 900) as page:
            page.wait_for("document.querySelectorAll('.u-wrap canvas').length >= 4")
            looks = measure(page, minutes)
    wrong = judged(looks)
    print("every bound holds" if not wrong else f"it does not hold: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
