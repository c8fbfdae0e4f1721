"""The line to the driver board: a port that may vanish and come back, and what its bytes mean.

Rules of this file: nothing here waits; it is read beside the loop, and a write that cannot be done now is a lost frame,
not a pause; any error or end of file means the port is lost, once, and is closed and opened again on a helper thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
import threading
from collections.abc import Callable
from typing import cast

from hoopd.core.frames import Decoder, Layout, encode_request
from hoopd.core.linkstate import AnswerFilter
from hoopd.core.records import DriverSample, LinkCounts, TorqueCommand
from hoopd.files.reading import InputError, PortMissingError
from hoopd.shell.descriptors import opened
from hoopd.shell.helpers import start_helper
from hoopd.shell.serialreader import Port, SerialReader, close_quietly

DESCRIPTORS = 5  # of an open port: itself, and the pipes that the library makes to interrupt its own waits
BITS_PER_BYTE = 10  # start, eight data, stop
# The board drops a partial frame after this silence; the host does the same, so that both start afresh together.
SILENCE_S = 0.002
FLOOD_BYTES = 1024  # between two ticks; more where the line is fast
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
    """A serial port that is read beside the loop."""

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
        self._reader: SerialReader | None = None
        self._fd = -1
        self._loop: asyncio.AbstractEventLoop | None = None
        self._say, self._closing = say, threading.Event()
        self.reason = "not opened yet"

    def open(self) -> None:
        """Open now (unless it is), or InputError; it is read from then on."""
        if self._reader is not None:
            return
        self._loop = asyncio.get_running_loop()
        try:
            self._adopt(open_port(self._port_name, self._baud))
        except OSError as error:
            kind = PortMissingError if is_missing(error) else InputError
            raise kind(self._port_name, "serial.port", (error.strerror or str(error)).lower()) from None

    def take(self) -> tuple[DriverSample | None, LinkCounts]:
        """Newest answer and what else came since the last tick."""
        self._feed()
        if self._reader is not None:
            self._reader.tick()
        return self._codec.take(self._clock(), lost=self._reader is None)

    def write(self, command: TorqueCommand) -> None:
        """Write one request; a full or lost port loses it."""
        # An answer that came while a slow tick computed belongs to the request before this one: take it first, or a
        # slow host would look like a lost link.
        self._feed()
        if self._reader is None:
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

    def _feed(self) -> None:
        """Hand on what came."""
        reader = self._reader
        if reader is None:
            return
        for t, data in reader.take():
            self._codec.feed(t, data)
        if reader.failure is not None:
            self._lose(reader.failure)

    def _adopt(self, port: Port) -> None:
        self._codec.reset()
        self._fd = port.fileno()
        os.set_blocking(self._fd, False)
        # A port that brings more between two ticks (a USB adapter knows no baud rate) is flushed, not decoded.
        self._reader = SerialReader(port, self._clock, max(FLOOD_BYTES, self._baud // 100))

    def _drop(self) -> None:
        reader, self._reader, self._fd = self._reader, None, -1
        if reader is not None:
            reader.close()

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

    def _adopt_or_close(self, port: Port) -> None:
        if self._closing.is_set():
            close_quietly(port)
        else:
            self._adopt(port)
            self._say(f"{self._port_name} is open again")


def is_missing(error: OSError) -> bool:
    """The port cannot be had now, but may be later."""
    return error.errno in MISSING


def open_port(name: str, baud: int) -> Port:
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
        close_quietly(port)
        raise OSError(*error.args) from None
    return cast(Port, port)
