"""How long the machine had others waiting while a test ran: a failure on the clock counts only where it did not.

Rules of this file: the kernel's own account is asked (the share of time in which something that could run had no core);
where there is none, every failure counts. Only what is judged by the clock is excused, and it is said why.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

import pytest

PRESSURE = Path("/proc/pressure/cpu")
# With three busy processes to a core the account says 85 to 100 %.
BUSY = 0.5


class Waited(NamedTuple):
    """Seconds of the monotonic clock, and of them those in which somebody waited for a core."""

    t: float
    waited_s: float

    def share_since(self, before: Waited) -> float:
        """Of the time in between."""
        return (self.waited_s - before.waited_s) / max(self.t - before.t, 1e-9)


def waited(path: Path = PRESSURE) -> Waited:
    """The account until now; nobody waits where there is none."""
    try:
        (some,) = (line for line in path.read_text(encoding="ascii").splitlines() if line.startswith("some "))
        total_us = float(some.rpartition("total=")[2])
    except (OSError, ValueError):
        total_us = 0.0
    return Waited(time.monotonic(), 1e-6 * total_us)


def excuse(report: pytest.TestReport, share: float) -> None:
    """Make a failure a skip that tells of it, where others had the machine."""
    if report.failed and report.when in ("setup", "call") and share >= BUSY:
        first = str(report.longreprtext).strip().splitlines()
        error = next((line for line in reversed(first) if line.startswith("E  ")), first[-1] if first else "")
        path, line, _ = report.location
        told = f"failed, but for {share:.0%} of its time somebody waited for a core, so nothing can be judged: {error}"
        report.outcome, report.longrepr = "skipped", (path, line or 0, told)
