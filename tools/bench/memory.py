"""Does the daemon's memory stay flat? `python tools/bench/memory.py --minutes 30 [--direct]`.

Runs the daemon in real time against the rig, recording, telemetry open and a subscriber attached; reads the resident
memory of the daemon's own process (its rig is processes of their own) every 5 s after a warm-up of 60 s and prints the
Theil-Sen slope with its 95 % interval. Exit code 1 when the slope is above 10 MiB an hour.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import processes
from scipy.stats import theilslopes

EVERY_S = 5.0
LIMIT_MIB_PER_H = 10.0
START_S = 3.0  # until telemetry answers
FEWEST = 3  # samples for a slope
SUBSCRIBER = processes.ROOT / "tools" / "subscriber.py"


def measure(seconds: float, warm_up_s: float, every_s: float, *, direct: bool) -> list[tuple[float, float]]:
    """(time in h, resident memory in MiB) of a running daemon."""
    with tempfile.TemporaryDirectory(prefix="hoopd-bench-") as folder:
        arguments = ("--record", folder, *(("--camera", "direct") if direct else ()))
        command = processes.daemon_command(seconds + 2.0 * START_S, *arguments)
        endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
        listen = [sys.executable, str(SUBSCRIBER), "--endpoint", endpoint, "--seconds", str(seconds)]
        with processes.daemon(command) as daemon:
            time.sleep(START_S)
            with processes.process(listen, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
                return list(_samples(daemon, seconds, warm_up_s, every_s))


def _samples(
    daemon: subprocess.Popen[bytes], seconds: float, warm_up_s: float, every_s: float
) -> Iterator[tuple[float, float]]:
    begun = time.monotonic()
    while (elapsed := time.monotonic() - begun) < seconds:
        if daemon.poll() is not None:
            raise RuntimeError(f"the daemon ended with code {daemon.returncode}")
        mib = resident_mib(daemon.pid)
        processes.progress(f"{elapsed:6.0f} of {seconds:.0f} s, {mib:.1f} MiB")
        if elapsed >= warm_up_s:
            yield elapsed / 3600.0, mib
        time.sleep(every_s)
    processes.progress("")


def resident_mib(pid: int) -> float:
    """Resident memory of one process without its children, as the kernel reports it."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError("the daemon's memory cannot be read")


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--warm-up", type=float, default=60.0, metavar="S")
    parser.add_argument("--every", type=float, default=EVERY_S, metavar="S")
    parser.add_argument("--direct", action="store_true", help="without pictures")
    parser.add_argument("--csv", type=Path, help="also write the samples here")
    options = parser.parse_args()
    samples = measure(60.0 * options.minutes, options.warm_up, options.every, direct=options.direct)
    if len(samples) < FEWEST:
        print("too short: no samples after the warm-up")
        return 1
    hours, mib = zip(*samples, strict=True)
    if options.csv:
        rows = "".join(f"{3600 * t:.1f},{value:.3f}\n" for t, value in samples)
        options.csv.write_text("t_s,rss_mib\n" + rows)
    slope, _, low, high = theilslopes(mib, hours, 0.95)
    print(f"resident memory {mib[0]:.1f} MiB at first, {mib[-1]:.1f} MiB at last, at most {max(mib):.1f} MiB")
    print(f"{len(samples)} samples, every {options.every:g} s after a warm-up of {options.warm_up:g} s")
    print(f"Theil-Sen slope {slope:+.2f} MiB/h (95 %: {low:+.2f} to {high:+.2f}), limit {LIMIT_MIB_PER_H:.0f}")
    return int(slope > LIMIT_MIB_PER_H)


if __name__ == "__main__":
    sys.exit(main())
