"""Pictures of rpicam-vid (or of a program with its flags): raw planes through a pipe, metadata through a FIFO.

Rules of this file: the child never outlives its thread, and no wait is longer than CANCEL_STEP_S. The command prefix is
the only difference between a Raspberry Pi and the simulated rig.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np

from hoopd.files.reading import InputError
from hoopd.shell.child import KILL_AFTER_S, end, end_with_parent, pending, readable, widen
from hoopd.shell.config import Camera
from hoopd.shell.cores import off_isolated_cores
from hoopd.shell.metadata import MetadataStream
from hoopd.shell.pictures import CANCEL_STEP_S, STAMP_TO_MIDDLE, CameraError, Clock, Frame, Stamps
from hoopd.shell.service import settle_helper_thread

# The program writes a picture's metadata right after its pixels: wait this long for it, and after so many pictures in
# a row without it no longer.
METADATA_PATIENCE_S = 0.004
PATIENT_FRAMES = 10
FIRST_PATIENCE_S = 0.012  # the first one also shows where a picture ends; less than a period
# The Raspberry Pi's image processors lengthen the rows of YUV 4:2:0 pictures to a multiple of this (480 to 512).
STRIDE_STEP = 64  # px
SETTLE_S = 0.003  # in which the rest of a picture follows
SETTLE_TRIES = 12  # looks at the pipe: more than a period of 20 ms, so one of them falls between two pictures
STDERR_LINES = 5
STDERR_LINE_BYTES = 4096
STDERR_PAUSE_S = 0.002  # between lines: a program that complains without end must not hold the interpreter
BUFFERS = 4


class RpicamVid:
    """The camera program as a child process."""

    def __init__(self, camera: Camera, clock: Clock, t0: float) -> None:
        self.note = ""
        self._camera = camera
        self._clock = clock
        self._stamps = Stamps(t0, camera.delay_s)
        self._use_stride(camera.stride_px or camera.width_px)
        self._number = 0
        self._child: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._fifo = -1
        self._metadata = MetadataStream()
        self._patience = PATIENT_FRAMES
        self._stderr: deque[str] = deque(maxlen=STDERR_LINES)
        self._stderr_reader: threading.Thread | None = None
        self._cancelled = False
        self._pipe_bytes = self._full_bytes = self._frame_bytes

    def arguments(self, metadata: Path) -> list[str]:
        """The whole command line."""
        camera = self._camera
        red, blue = camera.awb_gains
        return [
            *end_with_parent(),
            *off_isolated_cores(),
            *camera.command,
            *("-n", "-t", "0", "--codec", "yuv420", "--flush", "-o", "-"),
            *("--width", str(camera.width_px), "--height", str(camera.height_px), "--framerate", f"{camera.fps:g}"),
            *("--shutter", str(round(camera.exposure_s * 1e6)), "--gain", f"{camera.gain:g}"),
            *("--awbgains", f"{red:g},{blue:g}", "--denoise", "cdn_off"),
            *("--metadata", str(metadata), "--metadata-format", "json"),
        ]

    def open(self) -> None:
        """Start the program; InputError when there is none."""
        program = self._camera.command[0] if self._camera.command else ""
        if shutil.which(program) is None:
            raise InputError(
                "configuration",
                "camera.command",
                f"no program {program!r} on this computer (without hardware: hoopd --sim)",
            )
        self._folder = tempfile.TemporaryDirectory(prefix="hoopd-camera-")
        path = Path(self._folder.name) / "metadata"
        os.mkfifo(path, 0o600)
        # Opened first: the program's own opening waits for a reader.
        self._fifo = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            self._child = subprocess.Popen(
                self.arguments(path),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                process_group=0,
            )
        except OSError as error:
            raise InputError("configuration", "camera.command", f"{program}: {error.strerror}") from None
        self._pipe_bytes = widen(self._stdout)
        self._full_bytes = min(self._frame_bytes, self._pipe_bytes)
        self._stderr_reader = threading.Thread(target=self._drain_stderr, name="camera-stderr", daemon=True)
        self._stderr_reader.start()

    def read(self) -> Frame | None:
        """The next whole picture with its time."""
        data = self._buffers[self._number % BUFFERS]
        if not self._fill(memoryview(data)):
            if self._cancelled:
                return None
            raise CameraError(self._obituary())
        t_arrival = self._clock()
        t = self._time_of(self._number, t_arrival)
        if self._number == 0 and self._camera.stride_px == 0:
            data = self._find_stride(data)
        frame = Frame(self._number, t, t_arrival, np.frombuffer(data, np.uint8), "i420", self._size)
        self._number += 1
        return frame

    def waiting(self) -> bool:
        """The pipe holds another whole picture, or as much of one as it can."""
        return pending(self._stdout) >= self._full_bytes

    def cancel(self) -> None:
        """End a waiting read at its next look."""
        self._cancelled = True

    def close(self) -> None:
        """End the program: asked first, forced after KILL_AFTER_S."""
        self._cancelled = True
        child, self._child = self._child, None
        if child is not None:
            end(child)
            if self._stderr_reader is not None:
                self._stderr_reader.join(KILL_AFTER_S)
            if child.stdout is not None:
                child.stdout.close()
        if self._fifo >= 0:
            os.close(self._fifo)
            self._fifo = -1
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    @property
    def _size(self) -> tuple[int, int, int]:
        return self._camera.width_px, self._camera.height_px, self._stride

    @property
    def _stdout(self) -> int:
        if self._child is None or self._child.stdout is None:
            raise CameraError("the camera program is not running")
        return self._child.stdout.fileno()

    def _use_stride(self, stride: int) -> None:
        self._stride = stride
        self._frame_bytes = stride * self._camera.height_px * 3 // 2
        self._buffers = [bytearray(self._frame_bytes) for _ in range(BUFFERS)]

    def _find_stride(self, data: bytearray) -> bytearray:
        """The first picture whole, once what came so far is a whole number of pictures of either kind.

        The second one may be in the pipe already, whole or in part, when this computer is busy; between two pictures
        the pipe rests. 16 pictures of 480 px rows are as long as 15 of 512 px: more than the pipe holds.
        """
        aligned = -(-self._camera.width_px // STRIDE_STEP) * STRIDE_STEP
        if aligned == self._camera.width_px:
            return data
        short, long = self._frame_bytes, aligned * self._camera.height_px * 3 // 2
        for _ in range(SETTLE_TRIES):
            time.sleep(SETTLE_S)
            came = short + pending(self._stdout)
            if came % short == 0:
                return data
            if came % long == 0:
                break
        else:
            raise CameraError(f"cannot tell the length of a row; set camera.stride_px ({aligned} on a Raspberry Pi)")
        rest = bytearray(long - short)
        self._fill(memoryview(rest))
        self._use_stride(aligned)
        self._full_bytes = min(self._frame_bytes, self._pipe_bytes)
        return data + rest

    def _fill(self, view: memoryview) -> bool:
        """Read a whole picture; false at the end of the stream (a torn picture is dropped) or when cancelled."""
        pipe, filled = self._stdout, 0
        while filled < len(view):
            if self._cancelled:
                return False
            if not readable(pipe, CANCEL_STEP_S):
                continue
            count = os.readv(pipe, [view[filled:]])
            if count == 0:
                return False
            filled += count
        return True

    def _time_of(self, number: int, t_arrival: float) -> float:
        """Middle of the exposure of a picture: from its metadata, else from its arrival."""
        stamp = self._metadata.take(number)
        if stamp is None:
            patience_s = METADATA_PATIENCE_S if number > 0 else FIRST_PATIENCE_S
            self._drain_metadata(patience_s if self._patience > 0 else 0.0, number)
            stamp = self._metadata.take(number)
        if stamp is None or stamp.t is None:
            self._patience -= 1
            t, _ = self._stamps.mid_exposure(None, 0.0, t_arrival)
        else:
            self._patience = PATIENT_FRAMES
            exposure_s = stamp.exposure_s or self._camera.exposure_s
            t, _ = self._stamps.mid_exposure(stamp.t, STAMP_TO_MIDDLE * exposure_s, t_arrival)
        if not self.note and (self._patience <= 0 or self._stamps.unusable):
            what = "carry no metadata in time" if self._patience <= 0 else "carry stamps of another clock"
            self.note = f"pictures {what}; their time is taken as arrival less camera.delay_s"
        return t

    def _drain_metadata(self, patience_s: float, number: int) -> None:
        """Take in what waits in the FIFO; wait a moment while the metadata of that picture is not among it."""
        while self._fifo >= 0:
            try:
                chunk = os.read(self._fifo, 65536)
            except BlockingIOError:
                if self._metadata.has(number) or patience_s <= 0 or not readable(self._fifo, patience_s):
                    return
                patience_s /= 2  # parts of one record may come one by one; the sum stays bounded
                continue
            if not chunk:  # no writer: not yet, or no longer
                return
            self._metadata.feed(chunk.decode("ascii", errors="replace"))

    def _drain_stderr(self) -> None:
        settle_helper_thread()
        child = self._child
        if child is None or child.stderr is None:
            return
        with child.stderr as stream:
            while line := stream.readline(STDERR_LINE_BYTES):  # a line without end must not fill the memory
                text = line.decode(errors="replace").strip()
                if text:
                    self._stderr.append(text[:200])
                time.sleep(STDERR_PAUSE_S)

    def _obituary(self) -> str:
        child = self._child
        code: int | None = None
        if child is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = child.wait(KILL_AFTER_S)
        if self._stderr_reader is not None:
            self._stderr_reader.join(KILL_AFTER_S)
        how = f"exit {code}" if code is not None else "still running"
        last = self._stderr[-1] if self._stderr else "no message"
        return f"the camera program closed its output ({how}): {last}"
