"""Faults that no script of the rig can make: signals, a full disk, neighbours who flood the daemon.

Rules of this file: real time alone; each does its deed to a running daemon and tells when it began, on the monotonic
clock; what it started it ends.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

import psutil
from harness.neighbours import FLOOD, HUGE, IDLE, SUBSCRIBER, neighbour
from harness.realrun import Daemon

DISTURB_S: Final = 2.0
IDLE_CONNECTIONS: Final = 2000
HUGE_BYTES: Final = 400 * 10**6
GROWTH_BYTES: Final = 100 * 2**20  # that a neighbour may cost the daemon

# Connections that say nothing and connections that say too much, for ever anew.
SOCKET_FLOOD: Final = """
import socket, sys, time
held, line = [], b"x" * 10**6
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    one = socket.socket(socket.AF_UNIX)
    one.settimeout(0.2)
    try:
        one.connect(sys.argv[1])
        if len(held) % 4 == 0:
            one.sendall(line)
    except OSError:
        pass
    held.append(one)
    if len(held) > 500:
        held.pop(0).close()
"""


def stop_and_continue(daemon: Daemon) -> float:
    at = daemon.signal(signal.SIGSTOP)
    time.sleep(0.5)
    daemon.signal(signal.SIGCONT)
    return at


def terminate(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGTERM)


def kill(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGKILL)


def disarm_arm_terminate(daemon: Daemon) -> float:
    """An arm that was obeyed a moment ago bars no end."""
    at = time.monotonic()
    daemon.command("disarm")
    daemon.command("arm")
    daemon.signal(signal.SIGTERM)
    return at


def fill_disk(daemon: Daemon) -> float:
    """No file of the daemon may grow: its writes fail as on a full disk."""
    size = max(path.stat().st_size for path in daemon.record.iterdir())
    resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return time.monotonic()


def kill_camera(daemon: Daemon) -> float:
    for camera in daemon.family("hoopd.sim.camera"):
        camera.kill()
    return time.monotonic()


@contextmanager
def _frugal(daemon: Daemon) -> Iterator[None]:
    """The daemon must not grow much meanwhile."""
    process = psutil.Process(daemon.process.pid)
    before = process.memory_info().rss
    yield
    grown = process.memory_info().rss - before
    assert grown < GROWTH_BYTES, f"the daemon grew by {grown / 2**20:.0f} MiB"


def _disturbed(daemon: Daemon, script: str, *arguments: object) -> float:
    with _frugal(daemon), neighbour(script, *map(str, arguments)) as other:
        at = time.monotonic()
        time.sleep(DISTURB_S)
        assert not other.poll(), f"what was to disturb ended with exit code {other.returncode}"
        assert daemon.process.poll() is not None or daemon.command("status")["ok"], "no operator gets in"
    return at


def flood_commands(daemon: Daemon) -> float:
    return _disturbed(daemon, FLOOD, daemon.endpoint, daemon.socket, DISTURB_S)


def idle_connections(daemon: Daemon) -> float:
    """2,000 to the port of telemetry that say nothing."""
    return _disturbed(daemon, IDLE, daemon.endpoint.rpartition(":")[2], IDLE_CONNECTIONS)


def huge_queries(daemon: Daemon) -> float:
    """400 MB on a command's key."""
    return _disturbed(daemon, HUGE, daemon.endpoint, HUGE_BYTES, "{}")


def flood_socket(daemon: Daemon) -> float:
    return _disturbed(daemon, SOCKET_FLOOD, daemon.socket, DISTURB_S)


def disarm_in_all_floods(daemon: Daemon) -> float:
    """An operator's disarm while all of them go on; the time at which he asked."""
    floods = (
        (FLOOD, daemon.endpoint, daemon.socket, DISTURB_S),
        (IDLE, daemon.endpoint.rpartition(":")[2], IDLE_CONNECTIONS),
        (SOCKET_FLOOD, daemon.socket, DISTURB_S),
    )
    with ExitStack() as stack:
        for script, *arguments in floods:
            stack.enter_context(neighbour(script, *map(str, arguments)))
        time.sleep(0.7)
        at = time.monotonic()
        assert daemon.command("disarm")["mode"] == "DISARMED"
        time.sleep(0.3)
    return at


def freeze_subscriber(daemon: Daemon) -> float:
    with neighbour(SUBSCRIBER, daemon.endpoint) as subscriber:
        assert subscriber.stdout is not None
        subscriber.stdout.readline()
        subscriber.send_signal(signal.SIGSTOP)
        at = time.monotonic()
        time.sleep(DISTURB_S)
    return at
