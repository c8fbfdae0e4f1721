"""Looks around from inside the service's sandbox: what it must reach and what it must not.

Rules of this file: standard library only; runs in the place of the daemon, with every other line of the unit as it is;
prints one JSON object: what is wrong, what was reached, what was refused and how.
"""

from __future__ import annotations

import ctypes
import errno
import json
import mmap
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

STATE = Path("/var/lib/hoopd")
# Documentation's own network (RFC 5737): nobody is there, and a packet to it must not even leave.
ELSEWHERE = ("192.0.2.1", 9)


def open_device(path: str) -> None:
    """Read and write, without becoming its terminal."""
    os.close(os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))


def reach_loopback() -> None:
    """A connection to oneself."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        client.sendall(b"x")


def reach_elsewhere() -> None:
    """A packet to another machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"x", ELSEWHERE)


def write_file(path: Path) -> None:
    """A file of one's own there."""
    path.write_text("x")
    path.unlink()


def call(name: str, *arguments: object) -> None:
    """A function of the C library that returns 0 when it succeeds."""
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*arguments) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def use_priority(priority: int) -> None:
    """FIFO at this priority, as a helper thread asks for it."""
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def make_executable_memory() -> None:
    """Memory that can be written and run."""
    mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)


MUST: dict[str, Callable[[], object]] = {
    "port": lambda: open_device("/dev/hoop-driver"),
    "loopback": reach_loopback,
    "recordings": lambda: write_file(STATE / "probe"),
    "temporary files": lambda: write_file(Path("/tmp/probe")),
    "command socket's folder": lambda: write_file(Path("/run/hoopd/probe")),
    "configuration": lambda: Path("/etc/hoopd/hoop.yaml").read_text(),
}
MUST_REALTIME: dict[str, Callable[[], object]] = {
    "fifo 1": lambda: use_priority(1),
    "fifo 50": lambda: use_priority(50),
    "locked memory": lambda: call("mlockall", 3),
}
# Attempts that must fail, and for no other reason than that they are not allowed: a thing that is not there proves
# nothing. (A hidden process is one that is not there.)
REFUSED = (errno.EPERM, errno.EACCES, errno.EROFS, errno.EAFNOSUPPORT)
HIDDEN = {"process 1": (errno.ENOENT,)}
MUST_NOT: dict[str, Callable[[], object]] = {
    "fifo 99": lambda: use_priority(99),
    "other machines": reach_elsewhere,
    "raw packets": lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW),
    "another device": lambda: open_device("/dev/probe-kmsg"),
    "configuration, writing": lambda: write_file(Path("/etc/hoopd/probe")),
    "program, writing": lambda: write_file(Path("/opt/hoopd/probe")),
    "home of root": lambda: list(Path("/root").iterdir()),
    "process 1": lambda: Path("/proc/1/status").read_text(),
    "another user": lambda: os.setuid(0),
    "mounts": lambda: call("mount", b"none", b"/tmp", b"tmpfs", 0, None),
    "executable memory": make_executable_memory,
    "kernel settings": lambda: Path("/proc/sys/kernel/hostname").write_text("x"),
    "clock": lambda: call("clock_settime", 0, (ctypes.c_long * 2)(0, 0)),
}


def outcome(attempt: Callable[[], object]) -> int:
    """0 when it succeeded, else the error's number."""
    try:
        attempt()
    except OSError as error:
        return error.errno or errno.EIO
    return 0


def main() -> None:
    """Try everything, or with the word `realtime` what needs limits that a container may not be able to give."""
    must, must_not = (MUST_REALTIME, {}) if sys.argv[1:] == ["realtime"] else (MUST, MUST_NOT)
    found = {name: outcome(attempt) for name, attempt in (must | must_not).items()}
    wrong = [f"cannot reach {name}: {os.strerror(found[name])}" for name in must if found[name]]
    wrong += [f"can reach {name}" for name in must_not if not found[name]]
    for name in must_not:
        if found[name] and found[name] not in HIDDEN.get(name, REFUSED):
            wrong.append(f"{name}: not refused, but {os.strerror(found[name])}")
    reasons = {name: errno.errorcode.get(found[name], "none") for name in must_not}
    print(json.dumps({"wrong": wrong, "must": list(must), "must_not": reasons}))
    sys.exit(int(bool(wrong)))


if __name__ == "__main__":
    main()
