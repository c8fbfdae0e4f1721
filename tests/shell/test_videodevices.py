"""Capture devices, video files and picamera2 against devices that repeat, fail and miss."""

from __future__ import annotations

import os
import sys
import time
import types
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from harness.timing import on_the_clock
from shell.cameras import FakeCapture, H, W, read, v4l2

from hoopd.files.reading import InputError
from hoopd.shell.camera import make_backend
from hoopd.shell.config import Camera
from hoopd.shell.pictures import DOUBTFUL_PICTURES, CameraError


def test_v4l2_repeated_stamp_or_picture_is_no_new_one(clock, opened) -> None:
    now_ms = time.monotonic() * 1e3
    script = [(True, 1, now_ms), (True, 2, now_ms), (True, 2, now_ms + 1), (True, 3, now_ms + 2)]
    backend = opened(v4l2(FakeCapture(script), clock))
    assert [read(backend).number for _ in range(4)] == [0, 0, 0, 1]


def test_v4l2_stamp_is_used_where_it_is_sane(clock, opened) -> None:
    time.sleep(0.03)
    stamp_ms = (time.monotonic() - 0.02) * 1e3
    backend = opened(v4l2(FakeCapture([(True, 1, stamp_ms), *[(True, 2, 12.0)] * DOUBTFUL_PICTURES]), clock))
    assert read(backend).t == pytest.approx(stamp_ms * 1e-3 - clock.t0 + 0.0025, abs=1e-4)
    frame = read(backend)
    assert frame.t_arrival - frame.t == pytest.approx(0.04)
    assert backend.note == ""  # one of them says nothing of the clock
    for _ in range(DOUBTFUL_PICTURES - 1):
        read(backend)
    assert "stamp" in backend.note


def test_v4l2_single_failures_pass_many_are_an_error(clock, opened) -> None:
    now_ms = time.monotonic() * 1e3
    backend = opened(v4l2(FakeCapture([(False, 0, 0.0), (True, 1, now_ms)]), clock))
    assert read(backend).number == 0
    with pytest.raises(CameraError, match="gives no picture"):
        backend.read()


def test_video_file_plays_at_the_cameras_rate_and_ends(tmp_path: Path, clock, opened) -> None:
    path = tmp_path / "ball.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (W, H))
    for level in range(0, 100, 10):
        writer.write(np.full((H, W, 3), level, np.uint8))
    writer.release()
    backend = opened(make_backend(Camera(backend="video", file=str(path), fps=100.0), clock, clock.t0))
    started = time.monotonic()
    frames = list(iter(backend.read, None))
    assert len(frames) == 10
    with on_the_clock():
        assert 0.09 < time.monotonic() - started < 0.3
    assert frames[0].kind == "bgr"
    assert frames[0].data.shape == (H, W, 3)


def fake_picamera2(stamps: list[int]) -> types.ModuleType:
    class Request:
        def __init__(self, stamp: int) -> None:
            self.stamp = stamp

        def get_metadata(self) -> dict[str, int]:
            return {"SensorTimestamp": self.stamp, "ExposureTime": 4000}

        def make_array(self, name: str) -> Any:
            return np.zeros((H * 3 // 2, 128), np.uint8)

        def release(self) -> None:
            pass

    class Picamera2:
        def create_video_configuration(self, **settings: Any) -> dict[str, Any]:
            assert settings["controls"]["AeEnable"] is False
            return settings

        def configure(self, configuration: dict[str, Any]) -> None:
            assert configuration["main"] == {"size": (W, H), "format": "YUV420"}

        def start(self) -> None:
            pass

        def capture_request(self) -> Request:
            return Request(stamps.pop(0))

        def close(self) -> None:
            pass

    module = types.ModuleType("picamera2")
    module.Picamera2 = Picamera2  # type: ignore[attr-defined]
    return module


def test_picamera2_planes_and_stamps(monkeypatch: pytest.MonkeyPatch, clock, opened) -> None:
    stamp = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 20_000_000
    monkeypatch.setitem(sys.modules, "picamera2", fake_picamera2([stamp, stamp, stamp + 1]))
    backend = opened(make_backend(Camera(backend="picamera2", width_px=W, height_px=H), clock, clock.t0))
    frames = [read(backend) for _ in range(3)]
    assert [frame.number for frame in frames] == [0, 0, 1]
    assert frames[0].size == (W, H, 128)
    assert frames[0].data.ndim == 1
    assert frames[0].t_arrival - frames[0].t == pytest.approx(0.022, abs=0.01)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"command": ("no-such-program",)}, "camera.command"),
        ({"command": ()}, "camera.command"),
        ({"backend": "v4l2", "device": "/dev/no-such-video"}, "camera.device"),
        ({"backend": "v4l2", "device": os.devnull}, "camera.device"),
        ({"backend": "video", "file": "no-such-file.avi"}, "camera.file"),
        ({"backend": "video", "file": __file__}, "camera.file"),
        ({"backend": "picamera2"}, "camera.backend"),
        ({"backend": "direct"}, "camera.backend"),
    ],
)
def test_a_missing_camera_is_one_clear_line(
    settings: dict[str, Any], key: str, clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "picamera2", None)
    with pytest.raises(InputError) as error:
        make_backend(Camera(**settings), clock, clock.t0).open()
    assert error.value.key == key
    assert "\n" not in str(error.value)
