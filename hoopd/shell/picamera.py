"""Pictures of picamera2.

Rules of this file: the library is imported on opening, because it may be missing or not fit this environment.
"""

from __future__ import annotations

import importlib
from typing import Any

from hoopd.files.reading import InputError
from hoopd.shell.config import Camera
from hoopd.shell.pictures import NO_STAMP, STAMP_TO_MIDDLE, Clock, Frame, Stamps


class Picamera2Backend:
    """The camera through libcamera's Python binding (a package of the distribution, for its own Python)."""

    def __init__(self, camera: Camera, clock: Clock, t0: float) -> None:
        self.note = ""
        self._camera = camera
        self._clock = clock
        self._stamps = Stamps(t0, camera.delay_s)
        self._number = -1
        self._last_stamp = 0
        self._device: Any = None
        self._cancelled = False

    def open(self) -> None:
        """Configure and start the camera; InputError when the package or the camera is missing."""
        try:
            library = importlib.import_module("picamera2")
        except Exception as error:  # a binary package of another numpy raises ValueError, not ImportError
            reason = f"picamera2 does not import ({type(error).__name__}: {_one_line(error)})"
            raise InputError("configuration", "camera.backend", reason) from None
        try:
            self._device = library.Picamera2()
            self._device.configure(self._configuration(self._device))
            self._device.start()
        except (IndexError, RuntimeError) as error:
            self.close()
            raise InputError("configuration", "camera.backend", f"picamera2: {_one_line(error)}") from None

    def read(self) -> Frame | None:
        """The next picture; a repeated stamp keeps the number."""
        if self._cancelled:
            return None
        request = self._device.capture_request()
        try:
            metadata = request.get_metadata()
            planes = request.make_array("main")
        finally:
            request.release()
        t_arrival = self._clock()
        stamp = int(metadata.get("SensorTimestamp", 0))
        if stamp == 0 or stamp != self._last_stamp:
            self._number += 1
        self._last_stamp = stamp
        exposure_s = metadata.get("ExposureTime", self._camera.exposure_s * 1e6) * 1e-6
        t, _ = self._stamps.mid_exposure(stamp * 1e-9 or None, STAMP_TO_MIDDLE * exposure_s, t_arrival)
        self.note = self.note or (NO_STAMP if self._stamps.unusable else "")
        size = (self._camera.width_px, self._camera.height_px, int(planes.shape[1]))
        return Frame(self._number, t, t_arrival, planes.reshape(-1), "i420", size)

    def waiting(self) -> bool:
        """Never: the library keeps one request ready at most."""
        return False

    def cancel(self) -> None:
        """No further read; one that waits cannot be interrupted."""
        self._cancelled = True

    def close(self) -> None:
        """Stop and release the camera."""
        device, self._device = self._device, None
        if device is not None:
            device.close()

    def _configuration(self, device: Any) -> Any:
        camera = self._camera
        period_us = round(1e6 / camera.fps)
        controls = {
            "FrameDurationLimits": (period_us, period_us),
            "AeEnable": False,
            "ExposureTime": round(camera.exposure_s * 1e6),
            "AnalogueGain": camera.gain,
            "AwbEnable": False,
            "ColourGains": camera.awb_gains,
            "NoiseReductionMode": 0,
        }
        main = {"size": (camera.width_px, camera.height_px), "format": "YUV420"}
        # With a queue a picture is ready when it is asked for; its stamp tells its age.
        return device.create_video_configuration(main=main, controls=controls, buffer_count=4, queue=True)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
