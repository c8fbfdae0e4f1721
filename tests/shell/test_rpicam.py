"""The program rpicam-vid: pictures, rows, stamps and its end, against a program that delivers, lies, hangs and dies."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from harness.timing import on_the_clock
from shell.cameras import H, W, read, until

from hoopd.shell.metadata import MetadataStream
from hoopd.shell.pictures import DOUBTFUL_PICTURES, CameraError, Stamps
from hoopd.shell.rpicam import RpicamVid


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
    with on_the_clock():
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
    with on_the_clock():
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


def aged(stamps: Stamps, ages_s: list[float]) -> list[tuple[float, bool]]:
    """What becomes of pictures of these ages: age that was taken, and whether the stamp gave it."""
    start = time.monotonic() - stamps._t0
    taken = []
    for number, age in enumerate(ages_s):
        t_arrival = start + 0.02 * number
        t, stamped = stamps.mid_exposure(stamps._t0 + t_arrival - age, 0.0, t_arrival)
        taken.append((round(t_arrival - t, 6), stamped))
    return taken


def test_a_stamp_of_another_clock_is_not_believed() -> None:
    for off_s in (1e4, -0.5, -1.7e9):
        stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
        assert set(aged(stamps, [off_s] * DOUBTFUL_PICTURES)) == {(0.04, False)}
        assert stamps.unusable


def test_late_scheduling_is_not_another_clock() -> None:
    """A computer that stands still for seconds hands over old pictures: their stamps are right, and say so."""
    stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
    late = [0.03, 0.05, 1.8, 1.7, 2.9, 1.2, 0.04]
    assert aged(stamps, late) == [(age, True) for age in late]
    assert not stamps.unusable


def test_a_slow_start_is_not_another_clock() -> None:
    """The first pictures may have waited for the daemon; the clock is known with the first one that has not."""
    stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
    taken = aged(stamps, [1.6, 1.4, 0.06, 1.3])
    assert taken == [(0.04, False), (0.04, False), (0.06, True), (1.3, True)]
    assert not stamps.unusable


def test_a_picture_from_the_future_or_of_ages_ago_is_not_timed_by_its_stamp() -> None:
    stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
    assert aged(stamps, [0.03, -0.5, 60.0, 0.03]) == [(0.03, True), (0.04, False), (0.04, False), (0.03, True)]
    assert not stamps.unusable


def test_a_clock_that_is_lost_for_good_is_no_longer_believed() -> None:
    stamps = Stamps(t0=time.monotonic() - 10.0, delay_s=0.04)
    taken = aged(stamps, [0.03, *[3.0] * (DOUBTFUL_PICTURES + 1)])
    assert taken[1] == (3.0, True) and taken[-1] == (0.04, False)
    assert stamps.unusable
