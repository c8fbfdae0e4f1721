"""An independent witness of the machine: a process on each core that notes gaps of the clock longer than 50 ms.

Rules of this file: it shares nothing with what it judges; a test in real time may be repeated only when the witness saw
the machine stand still; one that is late every time while it stood still is skipped, and says for how long.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple
from unittest import SkipTest

GAP_S = 0.05
SLEEP_S = 0.005
ATTEMPTS = 3


class Gap(NamedTuple):
    """The machine stood still, in s of the monotonic clock."""

    start: float
    stop: float


class Witness:
    """A running witness; `gaps` any time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Witness:
        self._path.write_text("")
        for core in sorted(os.sched_getaffinity(0)):
            self._processes.append(subprocess.Popen([sys.executable, "-S", __file__, str(self._path), str(core)]))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self._processes:
            process.terminate()
            process.wait()

    def gaps(self, start: float = 0.0, stop: float = float("inf")) -> list[Gap]:
        """Gaps that touch [start, stop]."""
        rows = [line.split() for line in self._path.read_text().splitlines()]
        found = [Gap(float(a), float(b)) for a, b in rows]
        return [gap for gap in found if gap.stop >= start and gap.start <= stop]


def witnessed(folder: Path, check: Callable[[Path, Witness], None]) -> None:
    """Run a check in a fresh folder; again, a few times, when it failed while the machine stood still."""
    from harness.timing import is_late  # not of the process on each core, whose file this is too

    for attempt in range(ATTEMPTS):
        mine = folder / f"attempt-{attempt}"
        mine.mkdir(parents=True)
        with Witness(mine / "gaps.txt") as witness:
            try:
                check(mine, witness)
                return
            except AssertionError as error:
                gaps = witness.gaps()
                if not gaps or (attempt + 1 == ATTEMPTS and not is_late(error)):
                    raise
                last = f"{standstill(gaps)}: {str(error).partition(chr(10))[0]}"
    raise SkipTest(f"the machine stood still in each of {ATTEMPTS} attempts, nothing can be judged; {last}")


def standstill(gaps: Sequence[Gap]) -> str:
    """How often and how long, in words."""
    return f"{len(gaps)} gaps, up to {1e3 * max(gap.stop - gap.start for gap in gaps):.0f} ms"


def watch(path: Path, core: int) -> None:
    """Sleep briefly, look at the clock, note what is too long; until ended."""
    os.sched_setaffinity(0, {core})
    with path.open("a", buffering=1) as out:
        before = time.monotonic()
        while True:
            time.sleep(SLEEP_S)
            now = time.monotonic()
            if now - before > GAP_S:
                out.write(f"{before:.6f} {now:.6f}\n")
            before = now


if __name__ == "__main__":
    watch(Path(sys.argv[1]), int(sys.argv[2]))
