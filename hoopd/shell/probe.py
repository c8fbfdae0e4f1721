"""Probes of the machine for `hoopd check`: each asks one thing of the board, the kernel or the firmware.

Rules of this file: a probe reports what it found or raises OSError; it judges nothing; the torque asked of the board
is zero in every frame.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import shutil
import socket
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

from hoopd.core.frames import Layout
from hoopd.core.records import DriverSample, TorqueCommand
from hoopd.shell.clock import TickTimer
from hoopd.shell.link import Codec, open_port
from hoopd.shell.service import granted_realtime, lock_memory, raise_thread_priority

# One tick: an answer takes 2.4 ms on the line at 115200 baud; whoever needs longer than a tick is too late anyway.
ANSWER_S = 0.02
THROTTLED_FILE = Path("/sys/devices/platform/soc/soc:firmware/get_throttled")
_TIME_ERROR = 5  # adjtimex: the clock is not synchronised
_TIMEX_BYTES = 512  # struct timex has 208


class BoardLine:
    """The driver board, asked one question at a time; the torque is always zero."""

    def __init__(self, port: str, baud: int, layout: Layout) -> None:
        port_object: Any = open_port(port, baud)
        self._port, self._fd = port_object, int(port_object.fileno())
        self._codec = Codec(layout, baud)
        self._seq = 0
        self.round_trip_s: list[float] = []

    def exchange(self, enable: bool, clear: bool) -> DriverSample | None:
        """One request with zero torque and its answer, one tick long; None when none came in time."""
        start = time.monotonic()
        self._seq = (self._seq + 1) % 256
        os.write(self._fd, self._codec.request(start, TorqueCommand(self._seq, enable, clear, 0.0)))
        answer = self._read_until(start + ANSWER_S)
        if answer is not None:
            self.round_trip_s.append(time.monotonic() - start)
        self.silence(start + ANSWER_S - time.monotonic())
        return answer

    def silence(self, seconds: float) -> None:
        """Say nothing."""
        time.sleep(max(seconds, 0.0))

    def close(self) -> None:
        """Switch the drive off and close the port."""
        with contextlib.suppress(OSError):
            self.exchange(False, False)
        self._port.close()

    def _read_until(self, deadline: float) -> DriverSample | None:
        while (left := deadline - time.monotonic()) > 0:
            if not select.select([self._fd], [], [], left)[0]:
                return None
            data = os.read(self._fd, 4096)
            if not data:
                raise OSError("end of file")
            self._codec.feed(time.monotonic(), data)
            sample, _ = self._codec.take(time.monotonic(), lost=False)
            if sample is not None:
                return sample
        return None


def throttled_word() -> int | None:
    """The Raspberry Pi firmware's word about voltage and temperature; None when there is no such firmware."""
    with contextlib.suppress(OSError, ValueError):
        return int(THROTTLED_FILE.read_text(encoding="ascii"), 16)
    if shutil.which("vcgencmd") is None:
        return None
    answer = subprocess.run(["vcgencmd", "get_throttled"], capture_output=True, text=True, timeout=5, check=False)
    with contextlib.suppress(ValueError):
        return int(answer.stdout.strip().removeprefix("throttled="), 16)
    return None


def service_pid(unit: str = "hoopd.service") -> int:
    """Process of the running service; 0 when it does not run."""
    if shutil.which("systemctl") is None:
        return 0
    command = ["systemctl", "show", "--property=MainPID", "--value", unit]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False).stdout.strip()
    return int(answer) if answer.isdigit() else 0


def try_realtime(priority: int) -> dict[str, Any]:
    """What a thread of this process is given when it asks for a FIFO priority."""
    found: dict[str, Any] = {}

    def ask() -> None:
        raise_thread_priority(priority)
        found.update(granted_realtime())

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    return found


def try_memory_lock() -> tuple[str, int]:
    """Reason of a refusal (empty when granted) and the bytes that are locked then."""
    reason = lock_memory()
    return reason, granted_realtime()["locked_bytes"]


def clock_resolution_s() -> float:
    """Resolution of CLOCK_MONOTONIC."""
    return time.clock_getres(time.CLOCK_MONOTONIC)


def timer_lateness_s(period_s: float, ticks: int) -> list[float]:
    """Lateness of a thread that sleeps on the tick's timer."""
    late = []
    with TickTimer(period_s) as timer:
        k = 0
        while k < ticks:
            select.select([timer], [], [])
            k += timer.expirations()
            late.append(timer.now() - timer.deadline(k))
    return late


def core_lateness_s(cores: set[int], priority: int, period_s: float, ticks: int) -> dict[int, list[float]]:
    """Lateness of a thread on each of these cores, at the loop's priority when that is granted; one after the other."""
    found: dict[int, list[float]] = {}

    def tick(core: int) -> None:
        with contextlib.suppress(OSError):  # not ours to run on: no entry
            os.sched_setaffinity(0, {core})
            raise_thread_priority(priority)
            found[core] = timer_lateness_s(period_s, ticks)

    for core in sorted(cores):
        thread = threading.Thread(target=tick, args=(core,))
        thread.start()
        thread.join()
    return found


def clock_synchronised() -> bool | None:
    """The kernel's word about the wall clock; None when it cannot be asked."""
    libc = ctypes.CDLL(None, use_errno=True)
    state = libc.adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    return None if state < 0 else state != _TIME_ERROR


def claim_endpoint(endpoint: str) -> None:
    """Bind a zenoh endpoint (tcp/HOST:PORT) for a moment; OSError when it is taken or cannot be had."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.split("?")[0].split("#")[0].rpartition(":")
    if protocol not in ("tcp", "tls", "quic", "udp") or not port.isdigit():
        raise OSError(f"cannot be probed: {endpoint}")
    kind = socket.SOCK_DGRAM if protocol in ("quic", "udp") else socket.SOCK_STREAM
    family, _, _, _, target = socket.getaddrinfo(host.strip("[]"), int(port), type=kind)[0]
    with socket.socket(family, kind) as listener:
        if kind == socket.SOCK_STREAM:
            # As servers do: the remains of closed connections do not count as taken.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(target)
        if kind == socket.SOCK_STREAM:
            listener.listen(1)
