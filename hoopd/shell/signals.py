"""What SIGTERM, Ctrl-C and a terminal that hangs up (SIGHUP) do in each part of the daemon's life.

Rules of this file: before the loop listens they unwind what is open, while it runs they ask it to stop, and at the end
they change nothing; without the main thread signals are not ours. Who was started with SIGHUP ignored (nohup) outlives
the terminal.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
# Signals that came while unwinding: an exception raised in a destructor or in a weak reference's callback goes nowhere.
_asked: list[int] = []


def _ours() -> list[signal.Signals]:
    return [name for name in SIGNALS if name != signal.SIGHUP or signal.getsignal(name) is not signal.SIG_IGN]


@contextmanager
def unwinding() -> Iterator[None]:
    """Asked to end before the loop listens: whatever is open already is closed in order."""

    def end(number: int, frame: object) -> None:
        _asked.append(number)
        raise SystemExit(0)

    if threading.current_thread() is not threading.main_thread():  # signals are not ours
        yield
        return
    _asked.clear()
    before = {name: signal.signal(name, end) for name in _ours()}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


def ignore() -> None:
    """The end has begun and every step of it is bounded: asking again must not leave half of it undone."""
    if threading.current_thread() is threading.main_thread():
        for name in SIGNALS:
            signal.signal(name, signal.SIG_IGN)


def handle(stop: Callable[[], None]) -> None:
    """From now on the running loop is asked to stop."""
    running = asyncio.get_running_loop()
    for name in _ours():
        with contextlib.suppress(NotImplementedError, ValueError, RuntimeError):  # not the main thread
            running.add_signal_handler(name, stop)
    if _asked:  # and yet we are here
        stop()
