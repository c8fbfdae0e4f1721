"""An independent witness of this machine's freezes: one process on each core that only looks at the clock.

`python tools/bench/witness.py OUT.json` runs until its standard input closes; then it writes every gap of the
monotonic clock above the threshold as [core, start, end] in seconds. It asks for real-time priority above everything
that it watches; without it a gap may also be another process's time slice, and the file says so.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import select
import sys
import time
from pathlib import Path

PERIOD_S = 0.001
PRIORITY = 90


def watch(core: int, threshold_s: float, stop: object, results: object) -> None:
    """Look at the clock every millisecond."""
    os.sched_setaffinity(0, {core})
    granted = True
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        granted = False
    gaps, last = [], time.monotonic()
    while not stop.is_set():  # type: ignore[attr-defined]
        time.sleep(PERIOD_S)
        now = time.monotonic()
        if now - last - PERIOD_S > threshold_s:
            gaps.append((core, last, now))
        last = now
    results.put((granted, gaps))  # type: ignore[attr-defined]


def main() -> None:
    """Watch every core until told to stop."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--threshold-ms", type=float, default=2.0)
    options = parser.parse_args()
    context = multiprocessing.get_context("fork")
    stop, results = context.Event(), context.Queue()
    cores = sorted(os.sched_getaffinity(0))
    children = [
        context.Process(target=watch, args=(core, options.threshold_ms / 1e3, stop, results), daemon=True)
        for core in cores
    ]
    for child in children:
        child.start()
    select.select([sys.stdin], [], [])
    stop.set()
    found = [results.get(timeout=5.0) for _ in children]
    gaps = sorted((gap for _, part in found for gap in part), key=lambda gap: gap[1])
    options.out.write_text(json.dumps({"realtime": all(granted for granted, _ in found), "gaps": gaps}))


if __name__ == "__main__":
    main()
