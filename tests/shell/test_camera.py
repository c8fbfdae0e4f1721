"""Camera back ends against programs and devices that deliver, lie, hang and die."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from hoopd.core.records import CameraSample
from hoopd.files import InputError
from hoopd.shell import camera as camera_module
from hoopd.shell.camera import CameraThread, make_backend
from hoopd.shell.config import Camera
from hoopd.shell.metadata import MetadataStream
from hoopd.shell.pictures import Backend, CameraError, Frame, Stamps
from hoopd.shell.rpicam import RpicamVid
from hoopd.shell.videodevices import V4l2Backend

W, H = 64, 64

# Writes as rpicam-vid does: pixels, then the metadata whose closing brace stays in the stream's buffer.
FAKE = """
import argparse, os, sys, time
mode = sys.argv[1]
p = argparse.ArgumentParser()
for flag in "width height framerate shutter gain awbgains denoise codec metadata metadata-format t o".split():
    p.add_argument(("-" if len(flag) == 1 else "--") + flag)
p.add_argument("--flush", action="store_true"); p.add_argument("-n", action="store_true")
a = p.parse_args(sys.argv[2:])
assert (a.codec, a.o, a.t, a.n, a.flush, a.metadata_format) == ("yuv420", "-", "0", True, True, "json")
if mode == "error":
    sys.stderr.write("starting\\nERROR: *** no cameras available ***\\n"); sys.exit(1)
if mode == "deaf":
    import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)
stride = 512 if mode == "stride" else int(a.width)
if mode.endswith("pi"):
    stride = -(-int(a.width) // 64) * 64
size = stride * int(a.height) * 3 // 2
meta = open(a.metadata, "w"); meta.write("[\\n"); meta.flush()
count = {"torn": 2, "stall": 4, "deaf": 1}.get(mode, 40)
held = ""
for n in range(count):
    exposure = int(a.shutter)
    stamp = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 30_000_000
    os.write(1, bytes([n]) * size)
    text = (",\\n" if n else "") + '{\\n    "SensorTimestamp": %d,\\n    "ExposureTime": %d,\\n    "Lux": 4.5\\n' % (
        stamp, exposure)
    if mode != "buffered":
        meta.write(held + text); meta.flush(); held = "}"
    if not (mode.startswith("eager") and n == 0):  # else the second picture waits already
        time.sleep(0.01)
if mode == "torn":
    os.write(1, b"x" * (size // 2)); sys.exit(3)
if mode in ("stall", "deaf"):
    time.sleep(60)
time.sleep(0.05)
"""


class RunTime:
    """Run time since now."""

    def __init__(self) -> None:
        self.t0 = time.monotonic()

    def __call__(self) -> float:
        return time.monotonic() - self.t0


@pytest.fixture
def clock() -> RunTime:
    return RunTime()


@pytest.fixture
def fake(tmp_path: Path) -> Callable[..., Camera]:
    script = tmp_path / "fake_rpicam.py"
    script.write_text(FAKE)

    def settings(mode: str, **changes: Any) -> Camera:
        return Camera(command=(sys.executable, "-I", str(script), mode), width_px=W, height_px=H, **changes)

    return settings


@pytest.fixture
def opened() -> Iterator[Callable[[Backend], Backend]]:
    backends: list[Backend] = []

    def open_it(backend: Backend) -> Backend:
        backends.append(backend)
        backend.open()
        return backend

    yield open_it
    for backend in backends:
        backend.close()


def read(backend: Backend) -> Frame:
    frame = backend.read()
    assert frame is not None
    return frame


def plain(frame: Frame) -> CameraSample:
    return CameraSample(frame.number, frame.t, frame.t_arrival, nan, 0.0, nan, nan)


def until(condition: Callable[[], bool], timeout_s: float = 3.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


# --- rpicam-vid


def test_rpicam_frames_carry_the_time_of_the_sensor(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("good", exposure_s=0.004), clock, clock.t0))
    frames = [read(backend)._replace(data=np.empty(0, np.uint8)) for _ in range(10)]
    assert [frame.number for frame in frames] == list(range(10))
    assert frames[0].kind == "i420"
    assert frames[0].size == (W, H, W)
    for frame in frames:
        # Stamp 30 ms before the write; the middle of the exposure lies half of 4 ms before the stamp.
        assert 0.0315 < frame.t_arrival - frame.t < 1.0
    assert backend.note == ""


def test_rpicam_rows_may_be_longer_than_the_picture(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("stride", stride_px=512), clock, clock.t0))
    for number in range(5):
        frame = read(backend)
        assert frame.data.size == 512 * H * 3 // 2
        assert (frame.data == number).all()
        assert frame.size == (W, H, 512)


def test_rpicam_finds_the_rows_of_a_raspberry_pi_by_itself(fake, clock, opened) -> None:
    backend = opened(RpicamVid(msgspec.structs.replace(fake("pi"), width_px=72), clock, clock.t0))
    for number in range(8):
        frame = read(backend)
        assert frame.size == (72, H, 128)
        assert (frame.data == number).all()
        assert frame.data.size == 128 * H * 3 // 2


def test_rpicam_rows_without_padding_stay(fake, clock, opened) -> None:
    backend = opened(RpicamVid(msgspec.structs.replace(fake("good"), width_px=72), clock, clock.t0))
    for number in range(8):
        frame = read(backend)
        assert frame.size == (72, H, 72)
        assert (frame.data == number).all()


@pytest.mark.parametrize(("mode", "row"), [("eager", 72), ("eager-pi", 128)])
def test_rpicam_finds_the_rows_though_it_reads_late(fake, clock, opened, mode: str, row: int) -> None:
    """A busy computer: the second picture is in the pipe before the first one has been looked at."""
    backend = opened(RpicamVid(msgspec.structs.replace(fake(mode), width_px=72), clock, clock.t0))
    for number in range(4):
        frame = read(backend)
        assert frame.size == (72, H, row)
        assert len(frame.data) == row * H * 3 // 2 and (frame.data == number).all()


def test_rpicam_without_timely_metadata_falls_back_to_the_arrival_and_says_so(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("buffered", delay_s=0.05), clock, clock.t0))
    for _ in range(12):
        frame = read(backend)
        assert frame.t_arrival - frame.t == pytest.approx(0.05)
    assert "metadata" in backend.note


def test_rpicam_torn_picture_is_the_end(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("torn"), clock, clock.t0))
    read(backend), read(backend)
    with pytest.raises(CameraError, match="exit 3"):
        backend.read()


def test_rpicam_last_words_are_the_reason(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("error"), clock, clock.t0))
    with pytest.raises(CameraError, match=r"exit 1.*no cameras available"):
        backend.read()


def test_rpicam_child_that_ignores_the_request_is_killed(fake, clock) -> None:
    backend = RpicamVid(fake("deaf"), clock, clock.t0)
    backend.open()
    read(backend)
    child, folder = backend._child, backend._folder
    assert child is not None
    assert folder is not None
    started = time.monotonic()
    backend.close()
    assert time.monotonic() - started < 1.5
    assert child.poll() is not None
    assert not Path(folder.name).exists()


@pytest.mark.skipif(shutil.which("setpriv") is None, reason="no setpriv (util-linux) here")
def test_rpicam_child_dies_with_a_killed_daemon(fake, tmp_path: Path) -> None:
    parent = tmp_path / "parent.py"
    parent.write_text(
        "import sys, time\n"
        "from hoopd.shell.config import Camera\n"
        "from hoopd.shell.rpicam import RpicamVid\n"
        f"camera = Camera(command={fake('deaf').command!r}, width_px={W}, height_px={H})\n"
        "backend = RpicamVid(camera, time.monotonic, 0)\n"
        "backend.open(); backend.read(); print(backend._child.pid, flush=True); time.sleep(60)\n"
    )
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen([sys.executable, str(parent)], stdout=subprocess.PIPE, env=environment) as daemon:
        assert daemon.stdout is not None
        child = int(daemon.stdout.readline())
        daemon.kill()
    assert until(lambda: gone(child))


def gone(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rsplit(")", 1)[1].split()[0] == "Z"


def test_rpicam_backlog_is_seen_in_the_pipe(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("good"), clock, clock.t0))
    read(backend)
    time.sleep(0.06)
    assert backend.waiting()


def test_cancel_ends_a_waiting_read(fake, clock, opened) -> None:
    backend = opened(RpicamVid(fake("deaf"), clock, clock.t0))
    read(backend)
    threading.Timer(0.05, backend.cancel).start()
    started = time.monotonic()
    assert backend.read() is None
    assert time.monotonic() - started < 0.5


# --- metadata and stamps


def test_metadata_is_complete_before_its_brace() -> None:
    stream = MetadataStream()
    stream.feed('[\n{\n    "SensorTimestamp": 1000000000,\n    "Lux": 3.5,\n    "ExposureTime": 5000')
    assert stream.take(0) is None  # more digits may follow
    stream.feed("\n")
    stamp = stream.take(0)
    assert stamp is not None
    assert (stamp.t, stamp.exposure_s) == pytest.approx((1.0, 0.005))


@pytest.mark.parametrize("step", [1, 7, 1000])
@pytest.mark.parametrize("form", ["json", "compact", "txt", "no exposure"])
def test_metadata_records_are_counted_however_they_are_cut(form: str, step: int) -> None:
    records = {
        "json": '{\n    "ExposureTime": 5000,\n    "AfState": 0,\n    "SensorTimestamp": %d000000000\n}',
        "compact": '{"SensorTimestamp":%d000000000,"ExposureTime":5000}',
        "txt": "SensorTimestamp=%d000000000\nExposureTime=5000\nScalerCrop=(0, 0)/480x480\n\n",
        "no exposure": '{\n    "SensorTimestamp": %d000000000\n}',
    }
    text = "".join(["[\n" if form == "json" else ""] + [records[form] % n + ",\n" for n in range(1, 6)])
    if form == "txt":
        text = text.replace(",\n", "")
    stream = MetadataStream()
    for start in range(0, len(text), step):
        stream.feed(text[start : start + step])
    for number in range(5):
        stamp = stream.take(number)
        assert stamp is not None
        assert stamp.t == pytest.approx(number + 1)
    assert stream.take(5) is None


def test_a_stamp_of_another_clock_is_not_believed() -> None:
    stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
    assert stamps.mid_exposure(5.0, 0.0, 10.0) == (pytest.approx(9.96), False)
    t, stamped = stamps.mid_exposure(time.monotonic() - 0.02, 0.0, 10.0)
    assert stamped
    assert t == pytest.approx(9.98, abs=0.005)


# --- the other back ends


class FakeCapture:
    """A V4L2 capture whose every read is scripted: (claimed, brightness, stamp in ms)."""

    def __init__(self, script: list[tuple[bool, int, float]], hang: threading.Event | None = None) -> None:
        self.script = script
        self.hang = hang
        self.stamp_ms = 0.0
        self.wanted: dict[int, float] = {}

    def __call__(self, device: str, api: int) -> FakeCapture:
        assert api == cv2.CAP_V4L2
        return self

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        self.wanted[key] = value
        return True

    def get(self, key: int) -> float:
        return self.stamp_ms if key == cv2.CAP_PROP_POS_MSEC else self.wanted[key]

    def read(self) -> tuple[bool, Any]:
        if not self.script:
            if self.hang is not None:
                self.hang.wait(5.0)
            return False, None
        claimed, level, self.stamp_ms = self.script.pop(0)
        return claimed, np.full((H, W, 3), level, np.uint8) if claimed else None

    def release(self) -> None:
        self.wanted = {}


def v4l2(capture: FakeCapture, clock: RunTime, device: str = os.devnull) -> V4l2Backend:
    return V4l2Backend(Camera(backend="v4l2", device=device, width_px=W, height_px=H), clock, clock.t0, capture)


def test_v4l2_repeated_stamp_or_picture_is_no_new_one(clock, opened) -> None:
    now_ms = time.monotonic() * 1e3
    script = [(True, 1, now_ms), (True, 2, now_ms), (True, 2, now_ms + 1), (True, 3, now_ms + 2)]
    backend = opened(v4l2(FakeCapture(script), clock))
    assert [read(backend).number for _ in range(4)] == [0, 0, 0, 1]


def test_v4l2_stamp_is_used_where_it_is_sane(clock, opened) -> None:
    time.sleep(0.03)
    stamp_ms = (time.monotonic() - 0.02) * 1e3
    backend = opened(v4l2(FakeCapture([(True, 1, stamp_ms), (True, 2, 12.0)]), clock))
    assert read(backend).t == pytest.approx(stamp_ms * 1e-3 - clock.t0 + 0.0025, abs=1e-4)
    frame = read(backend)
    assert frame.t_arrival - frame.t == pytest.approx(0.04)
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


# --- the thread


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
