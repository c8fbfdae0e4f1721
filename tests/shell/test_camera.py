"""The thread of the camera: the newest sample once, restarts, and an end that always comes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from harness.timing import on_the_clock
from shell.cameras import FakeCapture, H, RunTime, W, plain, until, v4l2

from hoopd.core.records import CameraSample
from hoopd.files.reading import InputError
from hoopd.shell import camera as camera_module
from hoopd.shell.camera import CameraThread, make_backend
from hoopd.shell.config import Camera
from hoopd.shell.pictures import Backend, Frame
from hoopd.shell.rpicam import RpicamVid


@pytest.fixture
def running(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., CameraThread]]:
    monkeypatch.setattr(camera_module, "PAUSES_S", (0.05,))
    threads: list[CameraThread] = []

    def start(make: Callable[[], Backend], clock: RunTime, stall_s: float = 0.15, **more: Any) -> CameraThread:
        thread = CameraThread(make, more.pop("analyse", plain), clock, stall_s, **more)
        threads.append(thread)
        thread.start()
        return thread

    yield start
    for thread in threads:
        started = time.monotonic()
        thread.stop()
        with on_the_clock():
            assert time.monotonic() - started < 4.0


def test_thread_gives_the_newest_sample_once(fake, clock, running) -> None:
    eye = running(lambda: RpicamVid(fake("good"), clock, clock.t0), clock)
    assert until(lambda: eye.counts.frames >= 5)
    sample = eye.take()
    assert sample is not None
    assert sample.frame >= 3
    assert sample.t < sample.t_arrival <= clock()
    assert eye.counts.overwritten >= 3
    assert eye.latest_picture() is not None
    assert not eye.stalled


def test_thread_restarts_a_camera_that_stalls(fake, clock, running) -> None:
    lines: list[str] = []
    eye = running(lambda: RpicamVid(fake("stall"), clock, clock.t0), clock, say=lines.append)
    assert until(lambda: eye.stalled and eye.counts.frames == 4)
    assert until(lambda: eye.counts.restarts >= 1 and eye.counts.frames > 4)
    sample = eye.take()
    assert sample is not None
    assert sample.frame >= 4  # numbers go on
    assert any("no new picture" in line for line in lines)


def test_thread_waits_longer_for_a_start_that_was_cut_short(fake, clock, running, monkeypatch) -> None:
    """As beside a load: a patience that never grows would begin anew for ever."""
    monkeypatch.setattr(camera_module, "FIRST_FRAME_S", 0.4)
    camera = fake("good")
    slow = msgspec.structs.replace(camera, command=("sh", "-c", 'sleep 0.8; exec "$@"', "sh", *camera.command))
    eye = running(lambda: RpicamVid(slow, clock, clock.t0), clock)
    assert until(lambda: eye.counts.frames > 0, 20.0)
    assert eye.counts.restarts >= 1


def test_thread_names_the_programs_last_words(fake, clock, running) -> None:
    eye = running(lambda: RpicamVid(fake("error"), clock, clock.t0), clock)
    assert until(lambda: "no cameras available" in eye.reason)
    assert eye.take() is None


def test_thread_start_reports_a_missing_camera(clock) -> None:
    eye = CameraThread(lambda: RpicamVid(Camera(command=("no-such-program",)), clock, 0.0), plain, clock, 0.1)
    with pytest.raises(InputError):
        eye.start()


def test_thread_counts_lies_and_takes_them_for_a_stall(clock, running) -> None:
    class Liar(FakeCapture):
        def read(self) -> tuple[bool, Any]:
            time.sleep(0.01)
            if self.script:
                return super().read()
            return True, np.full((H, W, 3), 1, np.uint8)

    captures: list[Liar] = []

    def make() -> Backend:
        captures.append(Liar([(True, 1, time.monotonic() * 1e3)]))
        return v4l2(captures[-1], clock)

    eye = running(make, clock)
    assert until(lambda: eye.counts.restarts >= 1)
    assert eye.counts.lies >= 5
    assert eye.counts.frames <= len(captures)


def test_thread_leaves_one_hanging_reader_behind_and_no_more(clock, running, monkeypatch) -> None:
    monkeypatch.setattr(camera_module, "STOP_S", 0.1)
    hang = threading.Event()
    made: list[Backend] = []

    def make() -> Backend:
        made.append(v4l2(FakeCapture([(True, 1, time.monotonic() * 1e3)], hang), clock))
        return made[-1]

    eye = running(make, clock)
    assert until(lambda: len(made) == 2)
    time.sleep(0.5)
    assert len(made) == 2
    assert eye.stalled
    hang.set()
    assert until(lambda: len(made) >= 3)


def test_thread_skips_a_backlog_after_its_own_pause(fake, clock, running) -> None:
    slow = threading.Event()

    def analyse(frame: Frame) -> CameraSample:
        if frame.number == 2 and not slow.is_set():
            slow.set()
            time.sleep(0.1)
        return plain(frame)

    eye = running(lambda: RpicamVid(fake("good"), clock, clock.t0), clock, analyse=analyse)
    assert until(lambda: eye.counts.frames >= 20)
    assert eye.counts.skipped >= 3


def test_thread_takes_the_end_of_a_video_for_an_end(tmp_path: Path, clock, running) -> None:
    path = tmp_path / "short.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (W, H))
    for level in (10, 20, 30):
        writer.write(np.full((H, W, 3), level, np.uint8))
    writer.release()
    eye = running(lambda: make_backend(Camera(backend="video", file=str(path)), clock, clock.t0), clock)
    assert until(lambda: eye.ended)
    assert eye.counts.restarts == 0
    assert "end" in eye.reason
