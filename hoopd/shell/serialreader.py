"""What a serial port brings, read on a thread of its own.

Rules of this file: a read of a terminal waits in the kernel for a worker of ordinary priority, also when the port does
not block: on a busy machine for half a second. So the loop never reads; it takes what has come, without a lock. The
thread owns the port and closes it.
"""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from hoopd.shell.helpers import start_helper

# More than the line brings in one tick (230 bytes), little enough that decoding the worst of it, sync bytes only (2 us
# each), leaves the tick its time.
READ_BYTES = 512
LOOK_S = 0.05  # whether the port is still wanted
WAIT_S = 0.002  # for the next tick, in a flood


class Port(Protocol):
    """An open port."""

    def fileno(self) -> int: ...

    def close(self) -> None: ...


class SerialReader:
    """Reads a port until it is closed or fails."""

    def __init__(self, port: Port, clock: Callable[[], float], flood_bytes: int) -> None:
        """`flood_bytes`: what comes beyond it between two ticks is thrown away."""
        self.failure: OSError | None = None  # why no more will come
        self._port, self._clock, self._flood_bytes = port, clock, flood_bytes
        self._fd = port.fileno()
        self._came: deque[tuple[float, bytes]] = deque()
        self._brought = 0  # bytes since the last tick
        self._closed = False
        start_helper("serial", self._run)

    def take(self) -> list[tuple[float, bytes]]:
        """What came since the last call, with its run times."""
        return [self._came.popleft() for _ in range(len(self._came))]

    def tick(self) -> None:
        """Another tick: a flood may go on."""
        self._brought = 0

    def close(self) -> None:
        """Let the thread close the port; returns at once (a vanished adapter takes a third of a second)."""
        self._closed = True

    # ---- helper thread ----

    def _run(self) -> None:
        try:
            self._read()
        except OSError as error:
            self.failure = error
        except termios.error as error:
            self.failure = OSError(*error.args)
        while not self._closed:  # the loop still writes to it
            time.sleep(LOOK_S)
        close_quietly(self._port)

    def _read(self) -> None:
        """Until it is closed; OSError at the end of the file, which is ready but empty twice in a row."""
        ready, empty = select.poll(), False
        ready.register(self._fd, select.POLLIN)
        while not self._closed:
            if not ready.poll(LOOK_S * 1e3):
                continue
            try:
                data = os.read(self._fd, READ_BYTES)
            except BlockingIOError:
                continue
            if not data and empty:
                raise OSError("end of file")
            empty = not data
            if data:
                self._came.append((self._clock(), data))
                self._brought += len(data)
            if self._brought > self._flood_bytes:
                self._sit_out()

    def _sit_out(self) -> None:
        """Until the next tick: what waits then is as worthless as what came."""
        while self._brought > self._flood_bytes and not self._closed:
            time.sleep(WAIT_S)
        termios.tcflush(self._fd, termios.TCIFLUSH)


def close_quietly(port: Port) -> None:
    """Close a port that may be gone already."""
    with contextlib.suppress(OSError):
        port.close()
