"""The live picture on zenoh: nothing without a looker, decodable and bounded with one."""

from __future__ import annotations

import json
import time
from math import nan

import cv2
import numpy as np
import zenoh
from shell.peers import client, free_endpoint, receive, running, wait_until

from hoopd.core.records import CameraSample
from hoopd.shell.config import Vision
from hoopd.shell.live_picture import PERIOD_S, LivePicture, reduced
from hoopd.shell.pictures import Analysed, Frame
from hoopd.shell.telemetry import TelemetrySettings


class Camera:
    """A new picture whenever it is asked."""

    def __init__(self, side: int = 480, *, ball: bool = True) -> None:
        self.asked, self._side, self._ball = 0, side, ball

    def __call__(self) -> Analysed:
        """A grey picture with a red ball."""
        self.asked += 1
        bgr = np.full((self._side, self._side, 3), 90, np.uint8)
        cv2.circle(bgr, (240, 422), 22, (30, 30, 220), -1)
        frame = Frame(self.asked, 0.02 * self.asked, 0.0, bgr, "bgr", (self._side, self._side, self._side))
        x, y = (240.0, 422.0) if self._ball else (nan, nan)
        return Analysed(frame, CameraSample(self.asked, frame.t, 0.0, 0.0, 0.9, x, y, 0))


def test_nobody_looks_nothing_is_encoded_and_pictures_end_with_their_looker() -> None:
    endpoint, camera = free_endpoint(), Camera()
    picture = LivePicture(camera, Vision())
    with running(TelemetrySettings(endpoint=endpoint, session="run"), picture=picture), client(endpoint) as session:
        with session.declare_subscriber("hoopd/*/*", zenoh.handlers.RingChannel(9)) as others:
            assert receive(others, 1)  # a status has come: who follows all the rest is no looker
            assert (camera.asked, picture.encoded) == (0, 0)
        with session.declare_subscriber("hoopd/hoop/picture/camera", zenoh.handlers.RingChannel(99)) as looker:
            began = time.monotonic()
            assert wait_until(lambda: picture.encoded >= 8)
            assert picture.encoded <= (time.monotonic() - began) / PERIOD_S + 1
            sample = looker.try_recv()
            assert sample is not None and sample.attachment is not None
            shown = cv2.imdecode(np.frombuffer(sample.payload.to_bytes(), np.uint8), cv2.IMREAD_COLOR)
            assert shown is not None and shown.shape == (480, 480, 3)
            assert shown[422, 240, 2] > 180 > 90 > shown[422, 240, 0]
            about = json.loads(sample.attachment.to_bytes())
            assert (about["session"], about["ball_px"], about["size_px"]) == ("run", [240.0, 422.0], [480, 480])
        assert wait_until(lambda: not any(one.matching_status.matching for one in picture._publishers.values()))
        time.sleep(2 * PERIOD_S)  # the last one that was asked for
        encoded = picture.encoded
        time.sleep(3 * PERIOD_S)
        assert picture.encoded == encoded


def test_the_thresholded_view_is_encoded_for_its_own_lookers_alone() -> None:
    endpoint, camera = free_endpoint(), Camera(ball=False)
    picture = LivePicture(camera, Vision())
    with (
        running(TelemetrySettings(endpoint=endpoint), picture=picture),
        client(endpoint) as session,
        session.declare_subscriber("hoopd/hoop/picture/threshold", zenoh.handlers.RingChannel(99)) as looker,
    ):
        assert wait_until(lambda: picture.encoded >= 2)
        assert picture.encoded <= camera.asked
        sample = looker.recv()
        grey = cv2.imdecode(np.frombuffer(sample.payload.to_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
        assert grey is not None and grey[422, 240] > 230 and grey[10, 10] < 20
        assert sample.attachment is not None and json.loads(sample.attachment.to_bytes())["ball_px"] is None


def test_a_large_picture_is_reduced() -> None:
    assert reduced(np.zeros((960, 1280, 3), np.uint8)).shape == (360, 480, 3)
    assert reduced(np.zeros((64, 64, 3), np.uint8)).shape == (64, 64, 3)
