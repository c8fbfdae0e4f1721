"""Does the daemon's memory stay flat? `python tools/bench/memory.py --minutes 30`.

Runs the daemon in real time against the full rig, recording, with a subscriber attached, samples its resident
memory every 5 s after a warm-up of 60 s and prints the Theil-Sen slope with its 95 % interval. Exit code 1 above
10 MiB an hour.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
from realtime import free_port, process
from scipy.stats import theilslopes

WARM_UP_S, EVERY_S, LIMIT_MIB_H = 60.0, 5.0, 10.0
MIB = 2**20
TOOLS = Path(__file__).resolve().parents[1]


def sample(seconds: float) -> list[tuple[float, float]]:
    """(hours, MiB) of the daemon's own process."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-m", "hoopd", "--sim", "--duration", str(seconds + 5.0), "--record", name]
        command += ["--set", f"telemetry.endpoint={endpoint}"]
        with process(command, **quiet) as daemon:
            time.sleep(3.0)
            watcher = [sys.executable, str(TOOLS / "subscriber.py"), "--endpoint", endpoint, "--seconds", str(seconds)]
            with process(watcher, **quiet):
                return list(_rows(psutil.Process(daemon.pid), seconds))


def _rows(daemon: psutil.Process, seconds: float):  # type: ignore[no-untyped-def]
    begun = time.monotonic()
    while (elapsed := time.monotonic() - begun) < seconds:
        rss = daemon.memory_info().rss / MIB
        if elapsed > WARM_UP_S:
            yield elapsed / 3600.0, rss
        sys.stderr.write(f"\r{elapsed:6.0f} of {seconds:.0f} s, {rss:.1f} MiB ")
        time.sleep(EVERY_S)
    sys.stderr.write("\r")


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    rows = sample(60.0 * parser.parse_args().minutes)
    hours, mib = [row[0] for row in rows], [row[1] for row in rows]
    slope, _, low, high = theilslopes(mib, hours)
    print(f"resident memory {mib[0]:.1f} MiB at first, {mib[-1]:.1f} MiB at last, {len(rows)} samples")
    print(f"Theil-Sen slope {slope:+.2f} MiB/h, 95 % interval {low:+.2f} to {high:+.2f}; limit {LIMIT_MIB_H:.0f}")
    return int(slope > LIMIT_MIB_H)


if __name__ == "__main__":
    sys.exit(main())
