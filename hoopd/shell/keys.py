"""Keys of a terminal as they are pressed.

Rules of this file: the terminal gets its own settings back whatever happens; without a terminal there are no keys.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def pressed(act: Callable[[str], None]) -> Iterator[None]:
    """While the running loop runs, `act` gets each key; Ctrl-C stays the terminal's own."""
    try:
        descriptor = sys.stdin.fileno()
        before = termios.tcgetattr(descriptor)
    except (OSError, ValueError, termios.error):  # no terminal, or no standard input at all
        yield
        return
    running = asyncio.get_running_loop()

    def read() -> None:
        try:
            data = os.read(descriptor, 64)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:  # the terminal is gone
            running.remove_reader(descriptor)
        for key in data.decode(errors="replace"):
            act(key)

    tty.setcbreak(descriptor)
    running.add_reader(descriptor, read)
    try:
        yield
    finally:
        running.remove_reader(descriptor)
        with contextlib.suppress(OSError, termios.error):  # it is gone
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
