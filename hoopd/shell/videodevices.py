"""Pictures of a V4L2 device and of a video file.

Rules of this file: a `read` that claims success is not evidence of a new picture, its stamp or its content is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hoopd.files.reading import InputError
from hoopd.shell.config import Camera
from hoopd.shell.pictures import CANCEL_STEP_S, NO_STAMP, CameraError, Clock, Frame, Image, Stamps

# A USB camera's stamp is the start of the exposure, where its driver says so; most do.
USB_STAMP_TO_MIDDLE = 0.5  # of the exposure time
# V4L2_EXPOSURE_MANUAL of the menu that CAP_PROP_AUTO_EXPOSURE hands through, and the unit of its exposure time.
_EXPOSURE_MANUAL = 1
_EXPOSURE_UNIT_S = 100e-6
# Single pictures may fail to decode; so many in a row are a camera that is gone.
FAILURES = 5
# Every 16th pixel of every 16th row: two pictures of a real sensor never agree in all of them.
_SAMPLE = np.s_[::16, ::16]


class V4l2Backend:
    """A USB camera."""

    def __init__(self, camera: Camera, clock: Clock, t0: float, capture: Callable[..., Any] = cv2.VideoCapture) -> None:
        self.note = ""
        self._camera = camera
        self._clock = clock
        self._stamps = Stamps(t0, camera.delay_s)
        self._open_capture = capture
        self._capture: Any = None
        self._number = -1
        self._last_stamp_s: float | None = None
        self._last_sample: Image | None = None
        self._cancelled = False

    def open(self) -> None:
        """Open and set the device up; InputError when it is not there."""
        device = self._camera.device
        if not Path(device).exists():
            raise InputError("configuration", "camera.device", f"no device {device}")
        self._capture = self._open_capture(device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            self.close()
            raise InputError("configuration", "camera.device", f"{device} does not open (in use, or no camera)")
        self._set_up()

    def read(self) -> Frame | None:
        """The next picture; one with the stamp, or without stamp the content, of the last keeps its number."""
        for _ in range(FAILURES):
            if self._cancelled:
                return None
            claimed, picture = self._capture.read()
            if claimed and picture is not None and picture.size:
                return self._frame(picture)
        raise CameraError(f"{self._camera.device} gives no picture")

    def waiting(self) -> bool:
        """Never: the driver keeps one picture."""
        return False

    def cancel(self) -> None:
        """No further read; one that waits in the driver cannot be interrupted."""
        self._cancelled = True

    def close(self) -> None:
        """Release the device."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _frame(self, picture: Image) -> Frame:
        t_arrival = self._clock()
        stamp_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3 or None
        t, _ = self._stamps.mid_exposure(stamp_s, USB_STAMP_TO_MIDDLE * self._camera.exposure_s, t_arrival)
        if not self._repeated(picture, stamp_s):
            self._number += 1
        self.note = self.note or (NO_STAMP if self._stamps.unusable else "")
        height, width = picture.shape[:2]
        return Frame(self._number, t, t_arrival, picture, "bgr", (width, height, width))

    def _repeated(self, picture: Image, stamp_s: float | None) -> bool:
        sample = picture[_SAMPLE].copy()
        last_stamp_s, last_sample = self._last_stamp_s, self._last_sample
        self._last_stamp_s, self._last_sample = stamp_s, sample
        if stamp_s is not None and stamp_s == last_stamp_s:
            return True
        # The same picture under a new stamp counts as old, too: a sensor's noise never repeats.
        return last_sample is not None and np.array_equal(sample, last_sample)

    def _set_up(self) -> None:
        camera = self._camera
        wanted = {
            cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"MJPG"),
            cv2.CAP_PROP_FRAME_WIDTH: camera.width_px,
            cv2.CAP_PROP_FRAME_HEIGHT: camera.height_px,
            cv2.CAP_PROP_FPS: camera.fps,
            cv2.CAP_PROP_BUFFERSIZE: 1,
            cv2.CAP_PROP_AUTO_EXPOSURE: _EXPOSURE_MANUAL,
            cv2.CAP_PROP_EXPOSURE: round(camera.exposure_s / _EXPOSURE_UNIT_S),
            cv2.CAP_PROP_GAIN: camera.gain,
            cv2.CAP_PROP_AUTO_WB: 0,
        }
        for key, value in wanted.items():
            self._capture.set(key, value)  # what a camera does not know it refuses; the picture's size is checked
        size = tuple(round(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if size != (camera.width_px, camera.height_px):
            self.close()
            reason = f"{camera.device} gives {size[0]} x {size[1]}, not {camera.width_px} x {camera.height_px}"
            raise InputError("configuration", "camera.width_px", reason)


class VideoFile:
    """A recorded video, at the camera's rate."""

    def __init__(self, camera: Camera, clock: Clock, t0: float) -> None:
        self.note = ""
        self._camera = camera
        self._clock = clock
        self._stamps = Stamps(t0, camera.delay_s)
        self._capture: cv2.VideoCapture | None = None
        self._number = 0
        self._start_t = 0.0
        self._cancelled = False

    def open(self) -> None:
        """Open the file; InputError when it is no video."""
        path = Path(self._camera.file)
        if not path.is_file():
            raise InputError("configuration", "camera.file", f"no such file: {path}")
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            self.close()
            raise InputError("configuration", "camera.file", f"{path} is not a video")
        self._start_t = self._clock()

    def read(self) -> Frame | None:
        """The next picture when its time has come; None after the last."""
        if self._capture is None or self._cancelled:
            return None
        found, picture = self._capture.read()
        if not found or not self._wait_until(self._start_t + (self._number + 1) / self._camera.fps):
            return None
        t_arrival = self._clock()
        t, _ = self._stamps.mid_exposure(None, 0.0, t_arrival)
        height, width = picture.shape[:2]
        frame = Frame(self._number, t, t_arrival, np.asarray(picture, np.uint8), "bgr", (width, height, width))
        self._number += 1
        return frame

    def waiting(self) -> bool:
        """The next picture is due already."""
        return self._clock() >= self._start_t + (self._number + 1) / self._camera.fps

    def cancel(self) -> None:
        """End a waiting read at its next look."""
        self._cancelled = True

    def close(self) -> None:
        """Close the file."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()

    def _wait_until(self, t: float) -> bool:
        while (left_s := t - self._clock()) > 0.0:
            if self._cancelled:
                return False
            time.sleep(min(left_s, CANCEL_STEP_S))
        return True
