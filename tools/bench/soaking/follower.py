"""Keeps the kernel's accounts of a running daemon: every 4 ms, what its loop had of the cores and what it waited for.

`python follower.py PID OUT` runs until its standard input closes, then writes its rows. Rules of this file: standard
library only, no code of the daemon's; it reads /proc and touches nothing; FIFO priority 90 where it is granted, so
that neither loop nor load keeps it from looking.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from array import array
from collections.abc import Iterable
from pathlib import Path

PERIOD_S = 0.004
REFRESH_S = 0.5  # threads and children come and go
PRIORITY = 90
NS_PER_S = 1e9
# A row: time in s of CLOCK_MONOTONIC; sums since each thread's start, of the loop's thread, of the helpers that run
# Python, of the rig's processes; page faults of the loop; where the loop is at this moment, and on which core.
COLUMNS = (
    "t",
    "loop_run_s",
    "loop_wait_s",
    "helpers_run_s",
    "helpers_wait_s",
    "rig_run_s",
    "rig_wait_s",
    "faults_minor",
    "faults_disk",
    "place",
    "core",
)
# Where a thread is, beside the number of the system call that it sleeps in.
RUNNABLE = -2  # on a core, or waiting for one
FETCHING = -1  # asleep outside of system calls: a page comes from the disk


class Threads:
    """Time on a core and time waited for one, summed over threads that may end."""

    def __init__(self) -> None:
        self._open: dict[str, int] = {}
        self._last: dict[str, tuple[float, float]] = {}
        self._gone = (0.0, 0.0)

    def follow(self, paths: Iterable[str]) -> None:
        """These threads from now on; those that are followed stay until they end."""
        for path in paths:
            if path not in self._open:
                with contextlib.suppress(OSError):
                    self._open[path] = os.open(f"{path}/schedstat", os.O_RDONLY)

    def read(self) -> tuple[float, float]:
        """Seconds run and seconds waited until now."""
        for path, descriptor in list(self._open.items()):
            try:
                self._last[path] = times_of(os.pread(descriptor, 100, 0))
            except (OSError, ValueError):
                self._forget(path)
        return (
            self._gone[0] + sum(run for run, _ in self._last.values()),
            self._gone[1] + sum(wait for _, wait in self._last.values()),
        )

    def _forget(self, path: str) -> None:
        os.close(self._open.pop(path))
        run, wait = self._last.pop(path, (0.0, 0.0))
        self._gone = (self._gone[0] + run, self._gone[1] + wait)


def times_of(text: bytes) -> tuple[float, float]:
    """Seconds run and waited, of a thread's schedstat."""
    run, wait = text.split()[:2]
    return int(run) / NS_PER_S, int(wait) / NS_PER_S


def place_of(text: bytes) -> int:
    """Where a thread is, of its file `syscall`."""
    word = text.split(None, 1)[0]
    return RUNNABLE if word == b"running" else max(FETCHING, int(word))


def faults_and_core(text: bytes) -> tuple[int, int, int]:
    """Page faults without and with the disk, and the core, of a thread's file `stat`."""
    fields = text[text.rindex(b")") + 2 :].split()
    return int(fields[7]), int(fields[9]), int(fields[36])


class Follower:
    """One daemon and its rig."""

    def __init__(self, pid: int) -> None:
        self._pid = str(pid)
        loop = f"/proc/{pid}/task/{pid}"
        self._loop, self._helpers, self._rig = Threads(), Threads(), Threads()
        self._loop.follow([loop])
        self._stat = os.open(f"{loop}/stat", os.O_RDONLY)
        self._call = os.open(f"{loop}/syscall", os.O_RDONLY)

    def refresh(self) -> None:
        """Look for threads and children that are new."""
        threads = tasks(self._pid)
        mine = [path for path in threads if not path.endswith(f"/{self._pid}")]
        name = _text(f"/proc/{self._pid}/comm")
        # threads of libraries have names of their own, and no hand on the interpreter
        self._helpers.follow(path for path in mine if _text(f"{path}/comm") == name)
        for path in threads:
            for child in _text(f"{path}/children").split():
                self._rig.follow(tasks(child))

    def row(self) -> tuple[float, ...]:
        """One row now; OSError when the daemon is gone."""
        t = time.monotonic()
        place = place_of(os.pread(self._call, 200, 0))
        minor, disk, core = faults_and_core(os.pread(self._stat, 600, 0))
        return (t, *self._loop.read(), *self._helpers.read(), *self._rig.read(), minor, disk, place, core)


def tasks(pid: str) -> list[str]:
    """Folders of a process's threads."""
    with contextlib.suppress(OSError):
        return [str(path) for path in Path(f"/proc/{pid}/task").iterdir()]
    return []


def _text(path: str) -> str:
    with contextlib.suppress(OSError):
        return Path(path).read_text(encoding="ascii", errors="replace")
    return ""


def follow(pid: int, out: Path) -> None:
    """Rows until the daemon or our standard input ends."""
    follower, rows = Follower(pid), array("d")
    refreshed = float("-inf")
    while not select.select([sys.stdin], [], [], PERIOD_S)[0]:
        if time.monotonic() - refreshed > REFRESH_S:
            follower.refresh()
            refreshed = time.monotonic()
        try:
            rows.extend(follower.row())
        except (OSError, ValueError, IndexError):
            break
    out.write_bytes(rows.tobytes())


if __name__ == "__main__":
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    follow(int(sys.argv[1]), Path(sys.argv[2]))
