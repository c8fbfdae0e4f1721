"""The line to the driver board: a port that may vanish and come back, and what its bytes mean.

Rules of this file: nothing here waits; a write that cannot be done now is a lost frame, not a pause; any error or
end of file means the port is lost, once, and is closed and opened again on a helper thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
import threading
from collections.abc import Callable

from hoopd.core.frames import Decoder, Layout, encode_request
from hoopd.core.linkstate import AnswerFilter
from hoopd.core.records import DriverSample, LinkCounts, TorqueCommand
from hoopd.files import InputError, PortMissingError
from hoopd.shell.descriptors import opened
from hoopd.shell.helpers import start_helper

DESCRIPTORS = 5  # of an open port: itself, and the pipes that the library makes to interrupt its own waits
BITS_PER_BYTE = 10  # start, eight data, stop
# The board drops a partial frame after this silence; the host does the same, so that both start afresh together.
SILENCE_S = 0.002
# More than the line brings in one tick (230 bytes), little enough that decoding the worst of it, sync bytes only (2 us
# each), leaves the tick its time.
READ_BYTES = 512
# A port that brings more than this between two ticks (a USB adapter knows no baud rate) is flushed, not decoded.
FLOOD_BYTES = 1024
# What waiting or plugging in mends: no such device, one that goes as it is opened, one that another program holds, one
# whose rights udev has not set yet. Everything else (no serial port at all, a rate it has not) is unusable input.
MISSING = frozenset(
    {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM}
)


def wire_time(count: int, baud: int) -> float:
    """Seconds that bytes take on the line."""
    return count * BITS_PER_BYTE / baud


class Codec:
    """Bytes in, newest sample out; requests out. Knows no port and no clock."""

    def __init__(self, layout: Layout, baud: int) -> None:
        self.layout = layout
        self.request_s = wire_time(layout.request.length, baud)
        self._decoder = Decoder(layout, "answer")
        self._filter = AnswerFilter(has_seq=layout.answer.has_seq)
        self._last_byte_t = 0.0

    def feed(self, t: float, data: bytes) -> None:
        """Bytes that arrived at run time t."""
        self._last_byte_t = t
        self._filter.take(self._decoder.feed(data))

    def request(self, t: float, command: TorqueCommand) -> bytes:
        """The frame to write at run time t; its answer is expected from now on."""
        self._filter.expect(command.seq, t + self.request_s)
        return encode_request(self.layout, *command)

    def take(self, t: float, *, lost: bool) -> tuple[DriverSample | None, LinkCounts]:
        """Newest answer and what else came since the last call."""
        if t - self._last_byte_t > SILENCE_S:
            self._filter.take(self._decoder.silence())
        return self._filter.collect(lost)

    def reset(self) -> None:
        """Forget everything: the port was opened again."""
        self._decoder = Decoder(self.layout, "answer")
        self._filter.reset()


class SerialDrive:
    """A serial port on the event loop's selector."""

    def __init__(
        self,
        port: str,
        baud: int,
        codec: Codec,
        clock: Callable[[], float],
        reopen_s: float,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._port_name, self._baud, self._codec, self._clock, self._reopen_s = port, baud, codec, clock, reopen_s
        self._port: object | None = None
        self._fd = -1
        self._loop: asyncio.AbstractEventLoop | None = None
        self._say, self._closing = say, threading.Event()
        self._empty = False  # the last read of a port that was said to be ready
        self._brought = 0  # bytes since the last tick
        self._deaf = False  # until the next tick
        self.reason = "not opened yet"

    def open(self) -> None:
        """Open now (unless it is), or InputError; the running loop reads from then on."""
        if self._fd >= 0:
            return
        self._loop = asyncio.get_running_loop()
        try:
            self._adopt(open_port(self._port_name, self._baud))
        except OSError as error:
            kind = PortMissingError if is_missing(error) else InputError
            raise kind(self._port_name, "serial.port", (error.strerror or str(error)).lower()) from None

    def take(self) -> tuple[DriverSample | None, LinkCounts]:
        """Newest answer and what else came since the last tick."""
        self._brought = 0
        if self._deaf:
            self._listen_again()
        return self._codec.take(self._clock(), lost=self._fd < 0)

    def write(self, command: TorqueCommand) -> None:
        """Write one request; a full or lost port loses it."""
        # An answer that came while a slow tick computed belongs to the request before this one: take it first, or a
        # slow host would look like a lost link.
        if self._fd >= 0:
            self._read(ready=False)
        if self._fd < 0:
            return
        data = self._codec.request(self._clock(), command)
        try:
            os.write(self._fd, data)
        except BlockingIOError:
            self.reason = "the port takes no bytes"
        except OSError as error:
            self._lose(error)

    def close(self) -> None:
        """Close the port and stop trying to open it."""
        self._closing.set()
        self._drop()

    def _readable(self) -> None:
        self._read(ready=True)

    def _read(self, *, ready: bool) -> None:
        """Hand on what came; the end of the file is `ready` but empty twice in a row (once: a write was faster)."""
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error)
            return
        if data:
            self._codec.feed(self._clock(), data)
            self._brought += len(data)
        elif ready and self._empty:
            self._lose(OSError("end of file"))
            return
        self._empty = ready and not data
        if self._brought > max(FLOOD_BYTES, self._baud // 100) and not self._deaf and self._loop is not None:
            self._deaf = True
            self._loop.remove_reader(self._fd)

    def _listen_again(self) -> None:
        """After a flood: what waits is as worthless as what came."""
        self._deaf = False
        if self._fd < 0 or self._loop is None:
            return
        try:
            termios.tcflush(self._fd, termios.TCIFLUSH)
        except termios.error as error:
            self._lose(OSError(*error.args))
            return
        self._loop.add_reader(self._fd, self._readable)

    def _adopt(self, port: object) -> None:
        assert self._loop is not None
        self._codec.reset()
        self._deaf = self._empty = False
        self._port, self._fd = port, port.fileno()  # type: ignore[attr-defined]
        os.set_blocking(self._fd, False)
        self._loop.add_reader(self._fd, self._readable)

    def _drop(self) -> None:
        if self._fd < 0 or self._loop is None:
            return
        self._loop.remove_reader(self._fd)
        port, self._port, self._fd = self._port, None, -1
        # Closing a vanished USB adapter can block for a third of a second.
        start_helper("close", lambda: _close_quietly(port))

    def _lose(self, error: OSError) -> None:
        self.reason = (error.strerror or str(error)).lower()
        self._say(f"{self._port_name} is lost: {self.reason}")
        self._drop()
        if not self._closing.is_set():
            start_helper("reopen", self._reopen)

    def _reopen(self) -> None:
        while not self._closing.wait(self._reopen_s):
            try:
                port = opened(lambda: open_port(self._port_name, self._baud), DESCRIPTORS)
            except OSError:
                continue
            with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
                assert self._loop is not None
                self._loop.call_soon_threadsafe(self._adopt_or_close, port)
            return

    def _adopt_or_close(self, port: object) -> None:
        if self._closing.is_set():
            _close_quietly(port)
        else:
            self._adopt(port)
            self._say(f"{self._port_name} is open again")


def is_missing(error: OSError) -> bool:
    """The port cannot be had now, but may be later."""
    return error.errno in MISSING


def open_port(name: str, baud: int) -> object:
    """An exclusive raw serial port, or OSError."""
    import serial

    try:
        port = serial.Serial(name, baud, timeout=0, write_timeout=0, exclusive=True)
    except (serial.SerialException, ValueError) as error:
        number = getattr(error, "errno", None)
        raise OSError(number or 0, os.strerror(number) if number else str(error)) from None
    try:
        port.reset_input_buffer()
    except termios.error as error:  # no OSError: the adapter went while it was opened
        _close_quietly(port)
        raise OSError(*error.args) from None
    return port


def _close_quietly(port: object) -> None:
    with contextlib.suppress(OSError):
        port.close()  # type: ignore[attr-defined]
