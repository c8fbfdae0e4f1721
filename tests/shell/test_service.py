"""Notices to systemd, priorities and locked memory: right where they are granted, harmless where not."""

from __future__ import annotations

import gc
import os
import socket
import subprocess
import sys
import threading
import uuid

import pytest

from hoopd.shell.service import (
    STATUS_CHARS,
    Notifier,
    freeze_garbage,
    granted_realtime,
    is_under_systemd,
    lower_thread_priority,
    sanitise,
)


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """The other end: a socket as systemd makes it, and its address as it is handed over."""
    name = f"hoopd-test-{uuid.uuid4().hex}"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.settimeout(2.0)
    address = str(tmp_path / "notify") if request.param == "path" else "@" + name
    listener.bind(address if request.param == "path" else "\0" + name)
    yield listener, address
    listener.close()


def test_ready_status_stopping(manager):
    listener, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address})
    assert notifier.active
    assert notifier.ready("DISARMED")
    assert listener.recv(999) == b"READY=1\nSTATUS=DISARMED"
    assert notifier.status("RUNNING, worst lateness 0.3 ms")
    assert listener.recv(999) == b"STATUS=RUNNING, worst lateness 0.3 ms"
    assert notifier.stopping()
    assert listener.recv(999) == b"STOPPING=1"
    notifier.close()
    assert not notifier.ready()


def test_watchdog_is_fed_at_half_its_time(manager):
    listener, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())})
    beats = []
    for tick in range(200):  # 4 s of ticks
        t = tick * 0.02
        if notifier.watchdog_due(t):
            beats.append(t)
        notifier.beat(t)
    assert beats == [0.0, 1.0, 2.0, 3.0]
    assert [listener.recv(99) for _ in beats] == [b"WATCHDOG=1"] * 4


@pytest.mark.parametrize(
    "extra",
    [{}, {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}],
)
def test_no_watchdog_for_this_process(manager, extra):
    notifier = Notifier({"NOTIFY_SOCKET": manager[1], **extra})
    assert notifier.interval_s is None
    assert not notifier.watchdog_due(100.0)


def test_variables_are_not_inherited(manager):
    environ = {"NOTIFY_SOCKET": manager[1], "WATCHDOG_USEC": "1", "WATCHDOG_PID": str(os.getpid()), "HOME": "/"}
    Notifier(environ)
    assert environ == {"HOME": "/"}


@pytest.mark.parametrize("address", ["", "/nowhere/notify", "vsock:2:1234", "@hoopd-nobody-there"])
def test_no_socket_no_effect(address):
    notifier = Notifier({"NOTIFY_SOCKET": address} if address else {})
    assert not notifier.active
    assert not notifier.ready()
    notifier.beat(0.0)
    notifier.close()


def test_full_queue_never_blocks_the_tick(manager):
    _, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2000000"})
    for _ in range(10_000):
        if not notifier.status("x" * STATUS_CHARS):
            break
    else:
        pytest.skip("the queue has no end here")
    notifier.beat(0.0)
    assert notifier.watchdog_due(0.02)  # the lost beat is due again in the next tick


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a\nWATCHDOG=1", "a WATCHDOG=1"),
        ("\x1b[31mred\x00", "[31mred"),
        ("  a \t b ", "a b"),
        ("µ" * 500, "µ" * STATUS_CHARS),
    ],
)
def test_status_is_one_printable_line(text, line):
    assert sanitise(text) == line


def test_under_systemd_or_not():
    pid = str(os.getpid())
    assert is_under_systemd({"NOTIFY_SOCKET": "/run/x"})
    assert is_under_systemd({"INVOCATION_ID": "ab", "SYSTEMD_EXEC_PID": pid})
    assert not is_under_systemd({"INVOCATION_ID": "ab", "SYSTEMD_EXEC_PID": "1"})  # a terminal in a session's unit
    assert is_under_systemd({"INVOCATION_ID": "ab"})  # systemd before 248
    assert not is_under_systemd({})


def test_helper_thread_is_lowered_and_the_caller_is_not():
    seen = {}

    def helper() -> None:
        lower_thread_priority()
        seen.update(granted_realtime())

    before = granted_realtime()["policy"]
    thread = threading.Thread(target=helper)
    thread.start()
    thread.join()
    assert (seen["policy"], seen["priority"]) == ("other", 0)
    assert granted_realtime()["policy"] == before


def test_fifo_stays_with_the_thread_that_asked():
    """With reset-on-fork threads start with ordinary scheduling: what CPUSchedulingResetOnFork=yes relies on."""
    code = """
import threading
from hoopd.shell.service import granted_realtime, lower_thread_priority, raise_thread_priority
if not raise_thread_priority(1):
    print("refused")
    raise SystemExit
seen = []
thread = threading.Thread(target=lambda: seen.append(granted_realtime()["policy"]))
thread.start(); thread.join()
print(granted_realtime()["policy"], *seen)
lower_thread_priority()
print(granted_realtime()["policy"])
"""
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=20
    ).stdout.split()
    if out == ["refused"]:
        pytest.skip("no right to real-time priority here")
    assert out == ["fifo", "other", "other"]


def test_memory_lock_is_reported_as_granted():
    code = (
        "from hoopd.shell.service import lock_memory, granted_realtime\n"
        "before = granted_realtime()['locked_bytes']; why = lock_memory()\n"
        "print(why == '', granted_realtime()['locked_bytes'] > before)"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=20
    ).stdout.split()
    assert out[0] == out[1]


def test_garbage_is_frozen_and_automatic_collections_are_off():
    try:
        assert freeze_garbage() > 1000
        assert not gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()
