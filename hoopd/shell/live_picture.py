"""The live picture: JPEGs on keys of their own while somebody subscribes, and nothing at all while nobody does.

Rules of this file: the tick takes no part. Telemetry's thread asks zenoh who looks and puts what is ready; a thread
of its own, which begins with the first looker, encodes. It takes no lock that the loop takes, and runs as every
helper does: at a lower priority still it could be held up with the interpreter in its hand.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from math import isfinite
from typing import Any, Literal, NamedTuple

import cv2
import msgspec
import numpy as np
import zenoh

from hoopd.shell.ball_detection import detector_settings
from hoopd.shell.config import Vision
from hoopd.shell.helpers import start_helper
from hoopd.shell.pictures import Analysed, Frame, Image
from hoopd.shell.session import device_key
from hoopd.vision.threshold_view import ThresholdView

View = Literal["camera", "threshold"]
VIEWS: tuple[View, ...] = ("camera", "threshold")
PERIOD_S = 0.1  # ten a second are enough to see a ball roll
LONGEST_PX = 480  # a larger picture is reduced: it is looked at, not measured
QUALITY = 75  # of the JPEG
CLOSE_S = 0.5


class Encoded(NamedTuple):
    """What goes out on the key of a view."""

    view: View
    jpeg: bytes
    about: dict[str, Any]


class LivePicture:
    """Lookers of both views, and the thread that works for them."""

    def __init__(self, newest: Callable[[], Analysed | None], vision: Vision) -> None:
        """`newest`: the newest analysed picture, from any thread, without waiting."""
        self.encoded = 0  # pictures so far
        self._newest, self._vision = newest, vision
        self._threshold = ThresholdView(detector_settings(vision, 0.0))
        self._publishers: dict[View, zenoh.Publisher] = {}
        self._wanted: queue.SimpleQueue[tuple[View, ...]] = queue.SimpleQueue()
        self._ready: queue.SimpleQueue[Encoded] = queue.SimpleQueue()
        self._busy, self._due, self._number = False, 0.0, -1
        self._thread: threading.Thread | None = None

    # ---- telemetry's thread ----

    def declare(self, session: zenoh.Session, device: str) -> None:
        """Keys of a new session."""
        self._publishers = {
            view: session.declare_publisher(
                device_key(device, "picture", view),
                encoding=zenoh.Encoding.IMAGE_JPEG,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW,
            )
            for view in VIEWS
        }

    def serve(self, run: str) -> None:
        """Put what is ready, and ask for the next one when it is time and somebody looks."""
        with contextlib.suppress(queue.Empty):
            while True:
                self._put(self._ready.get_nowait(), run)
        now = time.monotonic()
        if now < self._due or self._busy:
            return
        self._due = now + PERIOD_S
        views = tuple(view for view, publisher in self._publishers.items() if _is_looked_at(publisher))
        if views:
            self._ask(views)

    def close(self) -> None:
        """End the thread; one that hangs is left behind."""
        if self._thread is not None:
            self._wanted.put(())
            self._thread.join(CLOSE_S)

    def _ask(self, views: tuple[View, ...]) -> None:
        self._busy = True
        if self._thread is None:
            self._thread = start_helper("live-picture", self._run)
        self._wanted.put(views)

    def _put(self, picture: Encoded, run: str) -> None:
        about = msgspec.json.encode({"session": run, **picture.about})
        self._publishers[picture.view].put(picture.jpeg, attachment=about)

    # ---- its own thread ----

    def _run(self) -> None:
        while views := self._wanted.get():
            try:
                self._encode(views)
            except Exception:  # a picture that cannot be shown is not worth a thread; the next one comes
                time.sleep(PERIOD_S)
            finally:
                self._busy = False

    def _encode(self, views: tuple[View, ...]) -> None:
        seen = self._newest()
        if seen is None or seen.frame.number == self._number:
            return
        self._number = seen.frame.number
        for view in views:
            picture = self._camera_view(seen.frame) if view == "camera" else self._threshold_view(seen.frame)
            jpeg = cv2.imencode(".jpg", reduced(picture), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
            self.encoded += 1
            self._ready.put(Encoded(view, jpeg, self._about(seen, picture)))

    def _camera_view(self, frame: Frame) -> Image:
        if frame.kind == "bgr":
            return frame.data
        width, height, stride = frame.size
        rows = frame.data.reshape(-1)[: stride * height * 3 // 2].reshape(height * 3 // 2, stride)
        return np.asarray(cv2.cvtColor(rows, cv2.COLOR_YUV2BGR_I420), np.uint8)[:, :width]

    def _threshold_view(self, frame: Frame) -> Image:
        if frame.kind == "bgr":
            return self._threshold.of_bgr(frame.data)
        return self._threshold.of_i420(frame.data, frame.size)

    def _about(self, seen: Analysed, picture: Image) -> dict[str, Any]:
        """What belongs on the picture, in pixels of the camera."""
        vision, sample = self._vision, seen.sample
        circle = vision.circle_px
        return {
            "t": seen.frame.t,
            "number": seen.frame.number,
            "size_px": [picture.shape[1], picture.shape[0]],
            "circle_px": [*circle.centre, circle.radius],
            "zero_angle_rad": vision.zero_angle_rad,
            "ball_px": [sample.x_px, sample.y_px] if isfinite(sample.x_px) else None,
            "ball_radius_px": vision.ball_radius_px,
            "confidence": sample.confidence,
            "threshold": vision.threshold,
        }


def _is_looked_at(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # zenoh's stubs take it for a bool
    return bool(status.matching)


def reduced(picture: Image) -> Image:
    """The picture with its longer side at LONGEST_PX, or as it is when it is smaller."""
    height, width = picture.shape[:2]
    share = LONGEST_PX / max(width, height)
    if share >= 1.0:
        return picture
    size = (max(1, round(width * share)), max(1, round(height * share)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
