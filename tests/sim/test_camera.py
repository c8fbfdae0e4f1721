"""The rig's camera as a process: what it writes, when, and how it ends; read by the back end of the Raspberry Pi."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.timing import on_the_clock

from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import Camera, load
from hoopd.shell.pictures import Frame
from hoopd.shell.rpicam import RpicamVid
from hoopd.sim.statering import StateRingWriter

ROOT = Path(__file__).resolve().parents[2]
DPSI = 1.5  # rad/s: the ball goes evenly round, so that an error of 10 ms in time is 0.015 rad
DELAY_S = 0.04
# A shared machine may freeze for tens of ms: only limits that a freeze cannot break are tight.
SLACK_S = 0.3


def psi_at(age_s: float) -> float:
    return DPSI * age_s


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[tuple[str, ...], float]]:
    """Command of the camera on a plant whose next 6 s are known, and the monotonic time of run time zero."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    def prepare(*flags: str, **config: Any) -> tuple[tuple[str, ...], float]:
        start = time.monotonic()
        writer = StateRingWriter(tmp_path / "ring", rows=3050)
        for k in range(-50, 3000):
            age_s = 0.002 * k
            writer.push(start + age_s, (0.5 * age_s, 0.5, psi_at(age_s), DPSI))
        writer.close()
        row = {"ring": str(tmp_path / "ring"), "start": start, "phase_s": 0.0, "delay_s": DELAY_S, **config}
        (tmp_path / "camera.json").write_text(json.dumps(row))
        return (sys.executable, "-m", "hoopd.sim.camera", "--rig", str(tmp_path / "camera.json"), *flags), start

    return prepare


@pytest.fixture
def opened() -> Iterator[Callable[[tuple[str, ...], float], RpicamVid]]:
    backends: list[RpicamVid] = []

    def open_it(command: tuple[str, ...], start: float) -> RpicamVid:
        backend = RpicamVid(Camera(command=command), lambda: time.monotonic() - start, start)
        backends.append(backend)
        backend.open()
        return backend

    yield open_it
    for backend in backends:
        backend.close()


def analyser() -> Analyser:
    config = load(None, sim=True, overrides=[])
    return Analyser(config.vision, config.faults.minimum_confidence)


def frames(backend: RpicamVid, count: int) -> list[Frame]:
    """That many pictures; their pixels are copied, because the back end uses its buffers again."""
    taken = []
    for _ in range(count):
        frame = backend.read()
        assert frame is not None
        taken.append(frame._replace(data=frame.data.copy()))
    return taken


@pytest.mark.parametrize("stride", [480, 512])
def test_pictures_show_the_plant_at_their_own_time(rig: Any, opened: Any, stride: int) -> None:
    command, start = rig("--stride", str(stride))
    backend, eye = opened(command, start), analyser()
    errors = []
    for frame in frames(backend, 25):
        assert frame.size == (480, 480, stride)
        sample = eye.i420(frame.number, frame.t, frame.t_arrival, frame.data, frame.size)
        errors.append(math.remainder(sample.psi - psi_at(frame.t), math.tau))
    assert backend.note == ""  # every time came from the metadata
    assert np.abs(errors).max() < 0.008  # as for a picture that is rendered in this process
    assert abs(float(np.mean(errors))) < DPSI * 0.002  # a wrong sign of the exposure's half would be 5 ms


def test_pictures_come_on_the_cameras_grid_after_its_delay(rig: Any, opened: Any) -> None:
    command, start = rig()
    taken = frames(opened(command, start), 25)
    times = np.array([frame.t for frame in taken])
    with on_the_clock():
        np.testing.assert_allclose(times * 50.0, np.rint(times * 50.0), atol=0.05)
    assert np.all(np.diff(times) > 0.0)
    ages = np.array([frame.t_arrival - frame.t for frame in taken])
    assert ages.min() > DELAY_S - 0.002
    with on_the_clock():
        assert np.median(ages) < DELAY_S + 0.02


def test_metadata_follow_the_pixels_and_their_brace_comes_late(rig: Any, tmp_path: Path) -> None:
    """What makes rpicam-vid awkward to read: without it the rig would be milder than the device."""
    command, _ = rig("--metadata", str(tmp_path / "metadata"))
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as child:
        assert child.stdout is not None
        size = 480 * 480 * 3 // 2
        for _ in range(3):
            assert len(child.stdout.read(size)) == size
        deadline = time.monotonic() + 3.0
        while (text := (tmp_path / "metadata").read_text()).count("SensorTimestamp") < 3:
            with on_the_clock():
                assert time.monotonic() < deadline
        child.kill()
    assert text.startswith("[\n{\n") and text.count("SensorTimestamp") >= 3
    assert text.count("}") == text.count("{") - 1
    rows = json.loads(text + "}]")
    assert all(set(row) == {"SensorTimestamp", "ExposureTime"} and row["ExposureTime"] == 5000 for row in rows)
    assert len(re.findall(r"\n},\n{\n", text)) == len(rows) - 1


def test_black_pictures_and_a_missing_ball_give_no_angle(rig: Any, opened: Any) -> None:
    for kind in ("black_pictures", "ball_gone"):
        command, start = rig(faults=[{"kind": kind, "at_s": 0.0}])
        eye = analyser()
        for frame in frames(opened(command, start), 5):
            assert math.isnan(eye.i420(frame.number, frame.t, frame.t_arrival, frame.data, frame.size).psi)


def test_a_stalled_camera_leaves_a_gap_and_no_late_pictures(rig: Any, opened: Any) -> None:
    command, start = rig(faults=[{"kind": "camera_stall", "at_s": 1.0, "for_s": 0.4}])
    backend = opened(command, start)
    times = [frame.t for frame in frames(backend, 3)]
    with on_the_clock():  # it has begun before the stall
        assert times[0] < 1.0
    while times[-1] < 1.5:
        times += [frame.t for frame in frames(backend, 1)]
    assert not [t for t in times if 1.0 <= t < 1.39]
    assert max(np.diff(times)) >= 0.4


def test_close_ends_the_program(rig: Any, opened: Any) -> None:
    command, start = rig()
    backend = opened(command, start)
    frames(backend, 1)
    child = backend._child
    assert child is not None
    began = time.monotonic()
    backend.close()
    assert child.poll() is not None
    with on_the_clock():
        assert time.monotonic() - began < 1.0 + SLACK_S


def test_it_ends_when_nobody_reads(rig: Any) -> None:
    command, _ = rig()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT) as child:
        assert child.stdout is not None and child.stderr is not None
        child.stdout.read(1)
        child.stdout.close()
        try:
            child.wait(3.0)
            assert child.stderr.read() == b""
        finally:
            child.kill()


def test_a_wrong_configuration_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text('{"ring": "x", "start": 0, "phase_s": 0, "delay_s": 0.04, "colour": 3}')
    command = (sys.executable, "-m", "hoopd.sim.camera", "--rig", str(tmp_path / "camera.json"))
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, timeout=20, check=False)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1 and b"colour" in done.stderr
