"""An independent witness of a machine's freezes: processes that do nothing but look at the clock.

`python tools/bench/witness.py OUT.json [--threshold-ms 2]` runs until its standard input closes; then it writes every
gap of the monotonic clock above the threshold. One watcher sits on each core and asks for FIFO priority 90, above
everything that the benches run, so that only the machine itself (its hypervisor, its kernel) can stop it; one more
wanders between the cores at ordinary priority and also sees when ordinary processes have to wait for their turn. It
shares no code with the daemon. The file: {"watchers": [{"core": 0 or null, "policy": "fifo" or "other",
"gaps": [[begin, end], ...], "cpu_share": 0.01}]}, times in s of CLOCK_MONOTONIC.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

PERIOD_S = 0.001
PRIORITY = 90
ANSWER_PATIENCE_S = 5.0


def watch(core: int | None, threshold_s: float, stop: Event, ready: Event, results: Any) -> None:
    """Look at the clock every millisecond until told to stop (or until the parent is gone)."""
    policy = _settle(core)
    parent, gaps = os.getppid(), []
    begun = last = time.monotonic()
    ready.set()
    while not stop.is_set() and os.getppid() == parent:
        time.sleep(PERIOD_S)
        now = time.monotonic()
        if now - last > PERIOD_S + threshold_s:
            gaps.append((last, now))
        last = now
    share = time.process_time() / (last - begun)
    results.put({"core": core, "policy": policy, "gaps": gaps, "cpu_share": round(share, 4)})


def _settle(core: int | None) -> str:
    """Take the core and the priority that this watcher is for; the policy that was granted."""
    if core is None:
        return "other"
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return "other"
    return "fifo"


def main() -> None:
    """Watch until standard input closes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--threshold-ms", type=float, default=2.0)
    options = parser.parse_args()
    context = multiprocessing.get_context("fork")
    stop, results = context.Event(), context.Queue()
    watchers = []
    for core in (*sorted(os.sched_getaffinity(0)), None):
        ready = context.Event()
        arguments = (core, options.threshold_ms / 1e3, stop, ready, results)
        watchers.append(context.Process(target=watch, args=arguments, daemon=True))
        watchers[-1].start()
        ready.wait(ANSWER_PATIENCE_S)
    print("watching", flush=True)
    sys.stdin.buffer.read()
    stop.set()
    found = [results.get(timeout=ANSWER_PATIENCE_S) for _ in watchers]
    options.out.write_text(json.dumps({"watchers": sorted(found, key=lambda row: str(row["core"]))}))


if __name__ == "__main__":
    main()
