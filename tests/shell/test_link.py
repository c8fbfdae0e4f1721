"""The host's side of the line: bytes to samples, and a port that goes and comes back."""

from __future__ import annotations

import asyncio
import os
import termios
import threading
import time
import tty
from pathlib import Path

import pytest
import serial

from hoopd.core.frames import DEFAULT_LAYOUT, Answer, encode_answer
from hoopd.core.records import TorqueCommand
from hoopd.files.reading import PortMissingError
from hoopd.shell.link import Codec, SerialDrive, open_port, wire_time

COMMAND = TorqueCommand(7, True, False, 0.25)


def answer(seq: int, theta: float = 0.5) -> bytes:
    return encode_answer(DEFAULT_LAYOUT, Answer(seq, 1, 0, theta, 0.1, 0.2, 40))


def test_wire_time_of_the_frames() -> None:
    assert wire_time(8, 115200) == pytest.approx(0.694e-3, abs=1e-6)
    assert wire_time(20, 115200) == pytest.approx(1.736e-3, abs=1e-6)


def test_an_answer_carries_the_time_at_which_the_board_had_the_request() -> None:
    codec = Codec(DEFAULT_LAYOUT, 115200)
    codec.request(1.0, COMMAND)
    codec.feed(1.003, answer(7))
    sample, counts = codec.take(1.02, lost=False)
    assert sample is not None
    assert sample.t == pytest.approx(1.0 + codec.request_s)
    assert counts.good == 1


def test_an_answer_to_an_older_request_is_no_measurement() -> None:
    codec = Codec(DEFAULT_LAYOUT, 115200)
    codec.request(1.0, COMMAND)
    codec.feed(1.003, answer(6))
    sample, counts = codec.take(1.02, lost=False)
    assert sample is None
    assert counts.unexpected_seq == 1


def test_after_silence_a_partial_frame_is_forgotten() -> None:
    codec = Codec(DEFAULT_LAYOUT, 115200)
    codec.request(1.0, COMMAND)
    codec.feed(1.003, answer(7)[:11])
    assert codec.take(1.02, lost=False)[1].garbage_bytes == 11
    codec.request(1.02, COMMAND._replace(seq=8))
    codec.feed(1.023, answer(8))
    assert codec.take(1.04, lost=False)[0] is not None


def test_a_missing_port_is_one_clear_line() -> None:
    async def run() -> None:
        SerialDrive("/dev/no-such-port", 115200, Codec(DEFAULT_LAYOUT, 115200), lambda: 0.0, 0.05).open()

    with pytest.raises(PortMissingError, match=r"/dev/no-such-port: serial\.port: no such file"):
        asyncio.run(run())


def test_the_port_may_vanish_and_come_back(tmp_path: Path) -> None:
    link = tmp_path / "port"

    def plug() -> int:
        master, slave = os.openpty()
        tty.setraw(slave)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        os.close(slave)
        return master

    async def run() -> None:
        clock = asyncio.get_running_loop().time
        codec = Codec(DEFAULT_LAYOUT, 115200)
        drive = SerialDrive(str(link), 115200, codec, clock, 0.02)
        master = plug()
        drive.open()
        drive.write(COMMAND)
        assert len(os.read(master, 100)) == 8
        os.write(master, answer(7))
        await _until(lambda: drive.take()[0] is not None)
        os.close(master)
        await _until(lambda: drive.take()[1].lost)
        drive.write(COMMAND)  # lost, not an error
        master = plug()
        await _until(lambda: not drive.take()[1].lost)
        drive.write(COMMAND._replace(seq=9))
        assert len(os.read(master, 100)) == 8
        os.write(master, answer(9))
        await _until(lambda: drive.take()[0] is not None)
        drive.close()
        os.close(master)

    asyncio.run(asyncio.wait_for(run(), 10.0))


def test_an_answer_that_came_while_a_slow_tick_computed_still_counts(tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)

    async def run() -> None:
        drive = SerialDrive(os.ttyname(slave), 115200, Codec(DEFAULT_LAYOUT, 115200), lambda: 0.0, 0.05)
        drive.open()
        drive.write(COMMAND)
        os.write(master, answer(7))  # the loop has no turn before the next request
        time.sleep(0.2)
        drive.write(COMMAND._replace(seq=8))
        sample, counts = drive.take()
        assert sample is not None and sample.seq == 7
        assert counts.unexpected_seq == 0
        drive.close()

    asyncio.run(run())
    os.close(master)
    os.close(slave)


def test_a_kernel_that_does_not_hand_on_what_came_holds_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A read of a terminal waits for a worker of the kernel, which waits for its turn among ordinary processes."""
    master, slave = os.openpty()
    tty.setraw(slave)
    slow, waited, read = threading.Event(), [], os.read

    def stuck(descriptor: int, count: int) -> bytes:
        if descriptor not in (master, slave) and os.ttyname(descriptor) == os.ttyname(slave):
            waited.append(slow.wait(5.0))
        return read(descriptor, count)

    async def run() -> None:
        drive = SerialDrive(os.ttyname(slave), 115200, Codec(DEFAULT_LAYOUT, 115200), lambda: 0.0, 0.05)
        drive.open()
        monkeypatch.setattr(os, "read", stuck)
        os.write(master, answer(6))
        await asyncio.sleep(0.1)
        for seq in (7, 8):
            drive.write(COMMAND._replace(seq=seq))
            assert drive.take()[1].lost is False
            assert len(read(master, 100)) == 8
        assert waited == []  # nobody waited in vain, and the ticks are through
        slow.set()
        drive.close()

    asyncio.run(run())
    os.close(master)
    os.close(slave)


async def _until(condition: object) -> None:
    for _ in range(400):
        if condition():  # type: ignore[operator]
            return
        await asyncio.sleep(0.01)
    raise AssertionError("did not happen within 4 s")


def test_an_adapter_that_goes_while_it_is_opened_is_an_ordinary_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        closed = False

        def __init__(self, *args: object, **options: object) -> None:
            pass

        def reset_input_buffer(self) -> None:
            raise termios.error(5, "Input/output error")

        def close(self) -> None:
            Port.closed = True

    monkeypatch.setattr(serial, "Serial", Port)
    with pytest.raises(OSError, match="Input/output error"):
        open_port("/dev/ttyUSB0", 115200)
    assert Port.closed
