"""The clock of the tick: a timerfd on CLOCK_MONOTONIC, absolute and periodic.

Rules of this file: deadlines are absolute, so that nothing drifts; the kernel counts what was missed, nothing
is skipped in silence. asyncio's own timers are not used: its selector rounds them up to whole milliseconds.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import os
import sys
import time
from collections.abc import Callable
from types import TracebackType

NS_PER_S = 1_000_000_000
# linux/time.h, sys/timerfd.h
_CLOCK_MONOTONIC = 1
_TFD_NONBLOCK = os.O_NONBLOCK
_TFD_CLOEXEC = os.O_CLOEXEC
_TFD_TIMER_ABSTIME = 1
_COUNT_BYTES = 8  # a read returns one unsigned 64-bit count in native byte order


class TickTimer:
    """Deadlines start + k period (k = 1, 2, ...), `start` in s of CLOCK_MONOTONIC; run time counts from `start`."""

    def __init__(self, period_s: float, start: float | None = None) -> None:
        self.period_ns = round(period_s * NS_PER_S)
        if self.period_ns <= 0:
            raise ValueError(f"period must be positive, got {period_s} s")
        self.start_ns = time.monotonic_ns() if start is None else round(start * NS_PER_S)
        self._fd = _create_timer(self.start_ns + self.period_ns, self.period_ns)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiter: asyncio.Future[None] | None = None
        self._pending = 0

    def fileno(self) -> int:
        """File descriptor for a selector; -1 when closed."""
        return self._fd

    def now(self) -> float:
        """Run time in s."""
        return (time.monotonic_ns() - self.start_ns) / NS_PER_S

    def deadline(self, k: int) -> float:
        """Run time in s of the k-th deadline."""
        return k * self.period_ns / NS_PER_S

    def expirations(self) -> int:
        """Deadlines passed since the last call; 0 when none. Never blocks."""
        try:
            return int.from_bytes(os.read(self._fd, _COUNT_BYTES), sys.byteorder)
        except BlockingIOError:
            return 0

    async def wait(self) -> int:
        """Sleep until the next deadline; how many have passed (1 when none was missed)."""
        if self._waiter is not None:
            raise RuntimeError("another task waits for this timer")
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
            self._loop.add_reader(self._fd, self._expired)
        # Waits even when the count is there already, so that other descriptors get their turn in every tick.
        self._waiter = self._loop.create_future()
        if self._pending:
            self._loop.call_soon(self._wake)
        try:
            await self._waiter
        finally:
            self._waiter = None
        # Taken after the await: a cancelled wait leaves its count to the next one.
        count, self._pending = self._pending, 0
        return count

    def close(self) -> None:
        """Free the descriptor; a waiting task is cancelled."""
        if self._fd < 0:
            return
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed before
                self._loop.remove_reader(self._fd)
        if self._waiter is not None and not self._waiter.done():
            self._waiter.cancel()
        os.close(self._fd)
        self._fd = -1

    def __enter__(self) -> TickTimer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _expired(self) -> None:
        self._pending += self.expirations()
        if self._pending:
            self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


def wall_zero_ns(now: Callable[[], float]) -> int:
    """Wall clock in ns at run time 0, when `now` gives the run time in s."""
    return time.time_ns() - round(now() * NS_PER_S)


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))

    @classmethod
    def of(cls, ns: int) -> _Timespec:
        return cls(ns // NS_PER_S, ns % NS_PER_S)


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


def _create_timer(first_ns: int, period_ns: int) -> int:
    """Armed timerfd, by the standard library where it has one (Python 3.13), else by the C library."""
    create = _create_by_os if hasattr(os, "timerfd_create") else _create_by_libc
    return create(first_ns, period_ns)


def _create_by_os(first_ns: int, period_ns: int) -> int:
    # Called by name: the type stubs of Python 3.11 do not know them.
    fd: int = getattr(os, "timerfd_create")(time.CLOCK_MONOTONIC, flags=_TFD_NONBLOCK | _TFD_CLOEXEC)  # noqa: B009
    settime = getattr(os, "timerfd_settime_ns")  # noqa: B009
    settime(fd, flags=_TFD_TIMER_ABSTIME, initial=first_ns, interval=period_ns)
    return fd


def _create_by_libc(first_ns: int, period_ns: int) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    fd = libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_NONBLOCK | _TFD_CLOEXEC)
    if fd < 0:
        raise _os_error("timerfd_create")
    spec = _Itimerspec(_Timespec.of(period_ns), _Timespec.of(first_ns))
    if libc.timerfd_settime(fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None) != 0:
        error = _os_error("timerfd_settime")
        os.close(fd)
        raise error
    return int(fd)


def _os_error(call: str) -> OSError:
    number = ctypes.get_errno()
    return OSError(number, f"{call}: {os.strerror(number)}")
