"""What the operating system gives the daemon: systemd's notices, real-time priority, locked memory, quiet garbage.

Rules of this file: standard library only; nothing here waits in the tick; what was granted is read back from the
kernel, never assumed; without systemd and without privileges every call is harmless.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import socket
from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

# systemd reads one line; a longer one only hides the rest of `systemctl status`.
STATUS_CHARS = 200
# READY and STOPPING must arrive: they may wait for room in systemd's queue. Everything else is dropped instead.
PATIENCE_S = 1.0
_SCHED_RESET_ON_FORK = 0x40000000
# Real-time priority of helper threads beside a FIFO loop: above all ordinary processes, below everything else.
HELPER_PRIORITY = 1
_POLICIES = {
    os.SCHED_OTHER: "other",
    os.SCHED_FIFO: "fifo",
    os.SCHED_RR: "rr",
    os.SCHED_BATCH: "batch",
    os.SCHED_IDLE: "idle",
}
# sys/mman.h. ON_FAULT locks what is touched instead of every mapping: libraries' thread stacks and reserves would all
# become resident (measured with zenoh open and ten threads: 575 MB instead of 64 MB).
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


class Notifier:
    """Tells systemd about the service; does nothing where there is no NOTIFY_SOCKET."""

    def __init__(self, environ: MutableMapping[str, str] | None = None) -> None:
        environ = os.environ if environ is None else environ
        # Removed, so that a child process can neither notify nor feed the watchdog.
        address = environ.pop("NOTIFY_SOCKET", "")
        usec, pid = environ.pop("WATCHDOG_USEC", ""), environ.pop("WATCHDOG_PID", "")
        self._socket = _connect(address)
        self.interval_s = _watchdog_interval(usec, pid) if self._socket is not None else None
        self._next_beat_t = float("-inf")

    @property
    def active(self) -> bool:
        """Somebody listens."""
        return self._socket is not None

    def ready(self, status: str = "") -> bool:
        """Start-up is done; false when nobody was told."""
        return self._send(_lines("READY=1", status), PATIENCE_S)

    def status(self, text: str) -> bool:
        """One line for `systemctl status`."""
        return self._send(_lines("", text), 0.0)

    def stopping(self, status: str = "") -> bool:
        """The end has begun."""
        return self._send(_lines("STOPPING=1", status), PATIENCE_S)

    def watchdog_due(self, t: float) -> bool:
        """Half of the watchdog's time has passed since the last beat (t: run time in s)."""
        return self.interval_s is not None and t >= self._next_beat_t

    def beat(self, t: float) -> None:
        """Feed the watchdog when it is due; to be called from the tick and from nowhere else."""
        if self.interval_s is not None and t >= self._next_beat_t and self._send("WATCHDOG=1", 0.0):
            self._next_beat_t = t + self.interval_s

    def close(self) -> None:
        """Close the socket; later calls do nothing."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str, patience_s: float) -> bool:
        if self._socket is None or not text:
            return False
        try:
            self._socket.settimeout(patience_s)
            self._socket.send(text.encode())
        except OSError:
            return False
        return True


def is_under_systemd(environ: MutableMapping[str, str] | None = None) -> bool:
    """This process is the main process of a unit, not a child of a desktop session's unit."""
    environ = os.environ if environ is None else environ
    if "NOTIFY_SOCKET" in environ:
        return True
    # SYSTEMD_EXEC_PID (systemd 248) tells a service from a terminal whose INVOCATION_ID was inherited.
    pid = environ.get("SYSTEMD_EXEC_PID")
    return pid == str(os.getpid()) if pid else "INVOCATION_ID" in environ


def lower_thread_priority() -> None:
    """Ordinary scheduling for the calling thread; helper threads must not keep the loop's FIFO priority."""
    for policy in (os.SCHED_OTHER, os.SCHED_OTHER | _SCHED_RESET_ON_FORK):
        # Without privileges the kernel refuses to take the reset-on-fork flag away: keep it then.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, policy, os.sched_param(0))
            return


def settle_helper_thread() -> None:
    """Scheduling of a helper thread: below the loop, never behind ordinary processes with the interpreter in hand.

    A helper at ordinary priority that is preempted with the interpreter lock in its hand stops a FIFO loop for a whole
    time slice of somebody else. So helpers follow the loop's policy at the lowest priority; what they start does not.
    """
    if not (fifo_priority() and raise_thread_priority(HELPER_PRIORITY)):
        lower_thread_priority()


def fifo_priority() -> int:
    """FIFO priority of the loop's thread, 0 when it runs at an ordinary one."""
    main = os.getpid()  # the main thread's id is the process's
    fifo = os.sched_getscheduler(main) & ~_SCHED_RESET_ON_FORK == os.SCHED_FIFO
    return os.sched_getparam(main).sched_priority if fifo else 0


def raise_thread_priority(priority: int) -> bool:
    """FIFO priority for the calling thread; false when the system refuses."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | _SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        return False
    return True


def lock_memory() -> str:
    """Keep touched pages in memory; empty when granted, else the reason."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0:
        return ""
    return os.strerror(ctypes.get_errno()).lower()


def granted_realtime(pid: int = 0) -> dict[str, Any]:
    """Scheduling, limits and locked memory of the calling thread (0) or a process, as the kernel reports them."""
    policy = os.sched_getscheduler(pid)
    return {
        "policy": _POLICIES.get(policy & ~_SCHED_RESET_ON_FORK, str(policy)),
        "priority": os.sched_getparam(pid).sched_priority,
        "rtprio_limit": _limit(resource.prlimit(pid, _RLIMIT_RTPRIO)[0]),
        "memlock_limit_bytes": _limit(resource.prlimit(pid, resource.RLIMIT_MEMLOCK)[0]),
        "locked_bytes": _locked_bytes(pid),
    }


def freeze_garbage() -> int:
    """Collect once, keep what is left out of every later collection, and switch the automatic ones off."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return gc.get_freeze_count()


_RLIMIT_RTPRIO = getattr(resource, "RLIMIT_RTPRIO", 14)


def _limit(value: int) -> int | None:
    """A resource limit; None is unlimited."""
    return None if value == resource.RLIM_INFINITY else value


def _locked_bytes(pid: int) -> int:
    # Pages locked on fault count in VmLck as whole mappings; Locked in smaps would walk every page.
    for line in Path(f"/proc/{pid or 'self'}/status").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("VmLck:"):
            return int(line.split()[1]) * 1024
    return 0


def _connect(address: str) -> socket.socket | None:
    """Datagram socket to a path or an abstract name (leading @); None when there is nobody."""
    if not address.startswith(("/", "@")):
        return None
    target = "\0" + address[1:] if address.startswith("@") else address
    notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    try:
        notify.connect(target)
    except OSError:
        notify.close()
        return None
    return notify


def _watchdog_interval(usec: str, pid: str) -> float | None:
    """Half of the watchdog's time in s, or None when there is none for this process."""
    if not usec.isdigit() or int(usec) == 0 or (pid and pid != str(os.getpid())):
        return None
    return int(usec) / 2e6


def _lines(state: str, status: str) -> str:
    text = sanitise(status)
    return "\n".join(part for part in (state, f"STATUS={text}" if text else "") if part)


def sanitise(text: str) -> str:
    """One printable line: a line break would start an assignment of its own."""
    line = "".join(char if char.isprintable() else " " for char in text)
    return " ".join(line.split())[:STATUS_CHARS]
