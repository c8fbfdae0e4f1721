"""A child process and its pipes.

Rules of this file: every wait is bounded.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import shutil
import signal
import struct
import subprocess
import termios

KILL_AFTER_S = 0.5
PIPE_BYTES = 1 << 20  # the most that an ordinary user may ask for
_F_SETPIPE_SZ, _F_GETPIPE_SZ = 1031, 1032
# The kernel ends the child together with the thread that started it, however that ends. Python's own way (preexec_fn)
# would fork the whole daemon, whose locked memory makes that a pause of every thread.
_SETPRIV = "setpriv"


def end_with_parent(signal_name: str = "KILL") -> tuple[str, ...]:
    """Prefix of a command that is sent this signal when its parent dies; empty where the system has no setpriv."""
    return (_SETPRIV, "--pdeathsig", signal_name, "--") if shutil.which(_SETPRIV) else ()


def readable(descriptor: int, timeout_s: float) -> bool:
    """Something to read, or the end, within that time."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(timeout_s * 1e3))


def pending(pipe: int) -> int:
    """Bytes that wait in a pipe."""
    count = fcntl.ioctl(pipe, termios.FIONREAD, b"\0\0\0\0")
    return int(struct.unpack("i", count)[0])


def widen(pipe: int) -> int:
    """Make room for some pictures in the pipe; its size in bytes."""
    with contextlib.suppress(OSError):
        fcntl.fcntl(pipe, _F_SETPIPE_SZ, PIPE_BYTES)
    return int(fcntl.fcntl(pipe, _F_GETPIPE_SZ))


def end(child: subprocess.Popen[bytes]) -> None:
    """Ask the child's process group to end, force it after KILL_AFTER_S; bounded by twice that."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(OSError):
            os.killpg(child.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(KILL_AFTER_S)
            break
    with contextlib.suppress(OSError):
        os.killpg(child.pid, signal.SIGKILL)  # what the program may have left behind in its group
