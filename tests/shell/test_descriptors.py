"""A table of descriptors that is full: what must go on goes on, with those that were kept back."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from shell.peers import Ticks, tick

from hoopd.core.records import Inputs, LinkCounts
from hoopd.recording.mcap import Header, read
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.commandserver import CommandServer
from hoopd.shell.descriptors import KEPT, RESERVE, WANTED, opened, raise_limit
from hoopd.shell.link import DESCRIPTORS, open_port
from hoopd.shell.recorder import Recorder
from hoopd.shell.socketfile import listening_socket


@contextlib.contextmanager
def full(kept: int) -> Iterator[list[int]]:
    """A table without room but for what is kept; room is made again with the block."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard))
    RESERVE.fill(kept)
    taken: list[int] = []
    try:
        with contextlib.suppress(OSError):
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY))
        yield taken
    finally:
        for descriptor in taken:
            os.close(descriptor)
        RESERVE.empty()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_without_a_reserve_nothing_can_be_opened() -> None:
    with full(0), pytest.raises(OSError, match="Too many open files"):
        opened(lambda: os.open(os.devnull, os.O_RDONLY), 1)


def test_what_is_lent_is_taken_again() -> None:
    with full(2) as taken:
        first = opened(lambda: os.open(os.devnull, os.O_RDONLY), 1)
        second = opened(lambda: os.open(os.devnull, os.O_RDONLY), 1)
        with pytest.raises(OSError, match="Too many open files"):
            opened(lambda: os.open(os.devnull, os.O_RDONLY), 1)
        os.close(first)
        os.close(second)
        RESERVE.refill()
        with pytest.raises(OSError, match="Too many open files"):
            taken.append(os.open(os.devnull, os.O_RDONLY))


def test_another_error_lends_nothing() -> None:
    with full(1):
        with pytest.raises(FileNotFoundError) as caught:
            opened(lambda: os.open("/nowhere", os.O_RDONLY), 1)
        assert caught.value.errno == errno.ENOENT
        os.close(opened(lambda: os.open(os.devnull, os.O_RDONLY), 1))


def test_the_recorder_opens_its_next_file(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Header(), synchronous=True)
    with full(KEPT):
        record = tick(1)
        recorder.put(record, Inputs(1, record.t, None, None, LinkCounts(), (), 0.0, 0.0, False, 0))
        assert recorder.counts.failures == 0
    assert recorder.close()
    assert len(read(tmp_path / "run-0001.mcap")) == 1


def test_the_serial_port_opens_again() -> None:
    master, slave = os.openpty()
    name = os.ttyname(slave)
    try:
        with full(KEPT):
            opened(lambda: open_port(name, 115200), DESCRIPTORS).close()
    finally:
        os.close(master)
        os.close(slave)


def test_an_operator_comes_in(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    gate = Gate(Ranges())
    server = CommandServer(listening_socket("hoop", str(path)), gate, lambda ticket: None)
    server.start()
    client = socket.socket(socket.AF_UNIX)  # made before: the operator has a table of its own
    with client, Ticks(gate), full(KEPT):
        client.settimeout(10.0)
        client.connect(str(path))
        client.sendall(b'{"command": "disarm"}\n')
        assert b'"ok":true' in client.recv(4096)
    assert server.close(5.0)


def test_the_limit_is_raised_as_far_as_it_goes() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard))
        assert raise_limit() == (WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
