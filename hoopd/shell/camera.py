"""The camera beside the loop: a thread of its own reads and analyses pictures, the loop takes the newest sample.

Rules of this file: nothing of the camera can block or end the loop. A camera that stops is restarted with growing
pauses; a reader that hangs in a library is left behind, one at most.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2

from hoopd.core.records import CameraSample
from hoopd.files.reading import InputError
from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import Camera
from hoopd.shell.helpers import start_helper
from hoopd.shell.pictures import Analysed, Backend, CameraError, Clock, Frame, Image
from hoopd.shell.rpicam import RpicamVid

PAUSES_S = (0.5, 1.0, 2.0, 5.0)  # before the restarts; the last one repeats
# A camera may take seconds to start (libcamera about one); only then is silence a stall that a restart might mend.
FIRST_FRAME_S = 5.0
# Beside a load a start may take longer than that, and being cut short it would for ever: wait this much longer after
# each start that gave no picture.
PATIENCE = (1.0, 2.0, 4.0)
OPEN_S = 5.0
STOP_S = 2.0
# At most so many pictures of a backlog are skipped in a row: a source that is always ahead must not starve the loop.
SKIP_AT_MOST = 8
# A read that lies may return at once, for ever.
LIE_PAUSE_S = 0.002


def make_backend(camera: Camera, clock: Clock, t0: float) -> Backend:
    """The configured back end, not yet open; t0 is time.monotonic() at run time zero."""
    if camera.backend == "rpicam":
        return RpicamVid(camera, clock, t0)
    # Imported on need: the rpicam way needs no capture library.
    from hoopd.shell.picamera import Picamera2Backend
    from hoopd.shell.videodevices import V4l2Backend, VideoFile

    if camera.backend == "picamera2":
        return Picamera2Backend(camera, clock, t0)
    if camera.backend == "v4l2":
        return V4l2Backend(camera, clock, t0)
    if camera.backend == "video":
        return VideoFile(camera, clock, t0)
    raise InputError("configuration", "camera.backend", f"{camera.backend!r} has no pictures; it belongs to --sim")


def analysis(analyser: Analyser) -> Callable[[Frame], CameraSample]:
    """The way from a frame of any kind to a sample."""

    def analyse(frame: Frame) -> CameraSample:
        if frame.kind == "i420":
            return analyser.i420(frame.number, frame.t, frame.t_arrival, frame.data, frame.size)
        return analyser.bgr(frame.number, frame.t, frame.t_arrival, frame.data)

    return analyse


@dataclass
class CameraCounts:
    """What happened since the start."""

    frames: int = 0  # new pictures read
    overwritten: int = 0  # samples that the loop never took
    skipped: int = 0  # pictures of a backlog, read but not analysed
    lies: int = 0  # reads that claimed success and brought the last picture again
    restarts: int = 0


class CameraThread:
    """Reader thread and the supervisor that restarts it."""

    def __init__(
        self,
        make: Callable[[], Backend],
        analyse: Callable[[Frame], CameraSample],
        clock: Clock,
        stall_s: float,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.counts = CameraCounts()
        self.reason = "not started"  # of the last stop or stall, "" while pictures come
        self.ended = False  # the pictures came to their regular end
        self._make = make
        self._analyse = analyse
        self._clock = clock
        self._stall_s = stall_s
        self._say = say
        self._lock = threading.Lock()
        self._sample: CameraSample | None = None
        self._picture: Frame | None = None
        self._analysed: Analysed | None = None
        self._last_t = 0.0  # run time at which the last new picture came
        self._number = -1
        self._stop = threading.Event()
        self._reader: _Reader | None = None
        self._stuck: _Reader | None = None
        self._failures = 0  # starts in a row without a picture
        self._supervisor: threading.Thread | None = None

    def start(self) -> None:
        """Start the camera; InputError when it cannot be opened at all."""
        cv2.setNumThreads(1)  # more threads cost more than they gain on one small window, and disturb the loop
        self._last_t = self._clock()
        self.reason = "no picture yet"
        first = self._reader = _Reader(self)
        first.opened.wait(OPEN_S)
        if isinstance(first.error, InputError):
            raise first.error
        self._supervisor = start_helper("camera-watch", self._supervise)

    def take(self) -> CameraSample | None:
        """The newest sample since the last call."""
        with self._lock:
            sample, self._sample = self._sample, None
        return sample

    @property
    def stalled(self) -> bool:
        """No new picture for longer than stall_s."""
        return self._clock() - self._last_t > self._stall_s

    def analysed(self) -> Analysed | None:
        """The last picture that was analysed, itself: without the lock, for which the loop would have to wait. Who
        takes longer than three pictures sees it change."""
        return self._analysed

    def latest_picture(self) -> Frame | None:
        """A copy of the last picture that was read."""
        with self._lock:
            frame = self._picture
        return frame if frame is None else frame._replace(data=frame.data.copy())

    def stop(self) -> None:
        """End the threads; bounded by 2 STOP_S, a reader that hangs in a library is left behind."""
        self._stop.set()
        if self._reader is not None:
            self._reader.cancel()
        if self._supervisor is not None:
            self._supervisor.join(STOP_S)
        for reader in (self._reader, self._stuck):
            if reader is not None:
                reader.cancel()
                reader.thread.join(STOP_S / 2)

    def accept(self, frame: Frame, first: int, backlog: bool) -> None:
        """A picture from the reader; `first` is the number of its reader's picture 0."""
        number = first + frame.number
        self._last_t = self._clock()
        self.counts.frames += 1
        frame = frame._replace(number=number)
        with self._lock:
            self._number = number
            self._picture = frame
        self.reason = ""
        if backlog:
            self.counts.skipped += 1
            return
        sample = self._analyse(frame)._replace(t_arrival=self._clock())
        self._analysed = Analysed(frame, sample)
        with self._lock:
            self.counts.overwritten += self._sample is not None
            self._sample = sample

    def next_number(self) -> int:
        """Number of the first picture of a new reader."""
        with self._lock:
            return self._number + 1

    def make(self) -> Backend:
        """A new back end."""
        return self._make()

    def say(self, text: str) -> None:
        """One line for the log."""
        self._say(text)

    def _supervise(self) -> None:
        while not self._stop.is_set():
            reader = self._reader
            if reader is None:
                return
            reader.finished.wait(self._patience_s(reader))
            if self._stop.is_set():
                return
            if reader.finished.is_set() and reader.error is None:
                self.ended, self.reason = True, "the pictures came to their end"
                return
            if not self._failed(reader):
                continue
            self._say(f"camera: {self.reason}")
            self._failures = 0 if reader.frames > 0 else self._failures
            if not self._replace(reader, PAUSES_S[min(self._failures, len(PAUSES_S) - 1)]):
                return
            self._failures += 1

    def _patience_s(self, reader: _Reader) -> float:
        """How long the reader may still be silent, in steps in which a stop is noticed."""
        left_s = max(reader.started_t, reader.last_t) + self._limit_s(reader) - self._clock()
        return min(max(left_s, 0.01), 0.1)

    def _limit_s(self, reader: _Reader) -> float:
        """Silence that fails a reader."""
        if reader.frames > 0:
            return self._stall_s
        return max(self._stall_s, FIRST_FRAME_S * PATIENCE[min(self._failures, len(PATIENCE) - 1)])

    def _failed(self, reader: _Reader) -> bool:
        if reader.error is not None:
            self.reason = " ".join(str(reader.error).split()) or type(reader.error).__name__
            return True
        silent_s = self._clock() - max(reader.started_t, reader.last_t)
        if silent_s <= self._limit_s(reader):
            return False
        self.reason = f"no new picture for {silent_s:.2f} s"
        return True

    def _replace(self, reader: _Reader, pause_s: float) -> bool:
        """Another reader after a pause; waits while two would hang. False when stopped meanwhile."""
        reader.cancel()
        reader.thread.join(STOP_S / 2)
        while reader.thread.is_alive() and self._stuck is not None and self._stuck.thread.is_alive():
            if self._stop.wait(0.1):
                return False
        if reader.thread.is_alive():
            self._stuck = reader
        if self._stop.wait(pause_s):
            return False
        self.counts.restarts += 1
        self._reader = _Reader(self)
        return True


class _Reader:
    """One life of a back end, in one thread."""

    def __init__(self, owner: CameraThread) -> None:
        self.opened = threading.Event()
        self.finished = threading.Event()
        self.error: Exception | None = None
        self.frames = 0
        self.started_t = self.last_t = owner._clock()
        self._owner = owner
        self._cancelled = False
        self._backend: Backend | None = None
        self.thread = start_helper("camera", self._run)

    def cancel(self) -> None:
        """No further picture of this reader counts."""
        self._cancelled = True
        if self._backend is not None:
            self._backend.cancel()

    def _run(self) -> None:
        try:
            backend = self._backend = self._owner.make()
            try:
                backend.open()
                self.opened.set()
                self._read_all(backend)
            finally:
                backend.close()
        except Exception as error:  # whatever a camera library raises: the supervisor restarts it
            self.error = error
        finally:
            self.opened.set()
            self.finished.set()

    def _read_all(self, backend: Backend) -> None:
        first, last, noted, skipped = self._owner.next_number(), -1, "", 0
        while not self._cancelled:
            frame = backend.read()
            if frame is None or self._cancelled:
                return
            if frame.number == last:
                self._owner.counts.lies += 1
                time.sleep(LIE_PAUSE_S)
                continue
            last = frame.number
            self.frames += 1
            self.last_t = self._owner._clock()
            backlog = skipped < SKIP_AT_MOST and backend.waiting()
            skipped = skipped + 1 if backlog else 0
            self._owner.accept(frame, first, backlog)
            if backend.note != noted:
                noted = backend.note
                self._owner.say(f"camera: {noted}")


__all__ = ["Backend", "CameraCounts", "CameraError", "CameraThread", "Frame", "Image", "analysis", "make_backend"]
