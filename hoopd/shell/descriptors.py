"""File descriptors of the process: as many as it may have, and a few kept back for what must go on.

Rules of this file: a process has one table of descriptors, so there is one reserve; it is taken at the start, lent when
the table is full to who opens the next recording, the serial port or an operator's connection, and taken again as soon
as there is room. Who is not in this list may fail.
"""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import threading
from collections.abc import Callable
from typing import TypeVar

# More than the connections that one address of this machine can have to one port (28,000 by the kernel's default): who
# opens so many is stopped by the ports, not by our table. Where the hard limit is lower, it is that one.
WANTED = 65536
# A serial port takes 5, a recording 3, an operator 1; twice that, because who floods us takes what is let go.
KEPT = 20
_FULL = (errno.EMFILE, errno.ENFILE)

T = TypeVar("T")


class Reserve:
    """Descriptors that are held for nothing until they are needed."""

    def __init__(self) -> None:
        self._held: list[int] = []
        self._wanted = 0
        self._lock = threading.Lock()  # between helper threads only: the loop opens nothing

    def fill(self, count: int) -> None:
        """Hold so many from now on."""
        self._wanted = count
        self.refill()

    def refill(self) -> None:
        """Hold again what was lent, as far as there is room."""
        with self._lock, contextlib.suppress(OSError):
            while len(self._held) < self._wanted:
                self._held.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))

    def lend(self, count: int) -> None:
        """Let so many go."""
        with self._lock:
            for _ in range(min(count, len(self._held))):
                os.close(self._held.pop())

    def empty(self) -> None:
        """Let all go, for good."""
        self._wanted = 0
        self.lend(len(self._held))


RESERVE = Reserve()


def opened(open_it: Callable[[], T], needed: int) -> T:
    """What `open_it` opens; when the table is full, once more with `needed` descriptors of the reserve."""
    try:
        return open_it()
    except OSError as error:
        if error.errno not in _FULL:
            raise
    RESERVE.lend(needed)
    try:
        return open_it()
    finally:
        RESERVE.refill()


def raise_limit() -> int:
    """As many descriptors as are wanted and allowed; how many there may be now."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]
