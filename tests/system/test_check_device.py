"""The whole of `hoopd check` for the shipped configuration, with the rig's board and a camera of our own."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.records import CameraSample
from hoopd.daemon import device_checks as device
from hoopd.files.reading import InputError
from hoopd.shell import config as configuration

ROOT = Path(__file__).resolve().parents[2]


class SteadyEye:
    """A picture every 20 ms, with the ball."""

    stalled = False

    def __init__(self) -> None:
        self.start, self.frame = time.monotonic(), 0

    def take(self) -> CameraSample | None:
        frame = int((time.monotonic() - self.start) / 0.02)
        if frame == self.frame:
            return None
        self.frame = frame
        return CameraSample(frame, 0.02 * frame, 0.02 * frame + 0.04, 0.1, 0.9, 240.0, 400.0)


class BlindEye(SteadyEye):
    def take(self) -> CameraSample | None:
        return None


@contextlib.contextmanager
def camera(config, timer) -> Iterator[SteadyEye]:
    yield SteadyEye()


@contextlib.contextmanager
def no_camera(config, timer) -> Iterator[SteadyEye]:
    raise InputError("camera", "command", "rpicam-vid is not installed")
    yield SteadyEye()


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    from hoopd.sim.boardprocess import ProcessConfig, start

    (tmp_path / "stillstub.py").write_text(
        "import math\n"
        "class Still:\n"
        "    t = theta = dtheta = 0.0\n"
        "    state = (0.0, 0.0, 0.0, 0.0)\n"
        "    def advance(self, t, torque_nm): self.t = max(self.t, t)\n"
        "    def sample(self): return 0.0, 0.0, math.nan\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    config = ProcessConfig(plant="stillstub:Still", torque_log=str(tmp_path / "torque.jsonl"))
    process = start(tmp_path / "port", config)
    yield tmp_path
    assert process.stdin is not None
    process.stdin.close()
    process.wait(5.0)
    assert process.stderr is not None
    process.stderr.close()


def load(*overrides: str) -> configuration.Config:
    return configuration.load(None, sim=False, overrides=list(overrides))


def verdicts(path: Path) -> dict[str, str]:
    return {row["name"]: row["verdict"] for row in json.loads(path.read_text())["checks"]}


def test_a_device_that_is_well(rig: Path, capsys: pytest.CaptureFixture[str]):
    config = load(f"serial.port={rig / 'port'}", f"recording.directory={rig}", "recording.min_free_bytes=1")
    assert device.check_device(config, None, DEFAULT_LAYOUT, camera, rig / "check.json") == 0
    found = verdicts(rig / "check.json")
    for name in ("files", "serial port", "board time-out", "camera", "ball"):
        assert found[name] == "ok", capsys.readouterr().out
    assert "fail" not in found.values()


def test_nothing_is_plugged_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    config = load(f"serial.port={tmp_path / 'nowhere'}", f"recording.directory={tmp_path / 'none'}")
    assert device.check_device(config, None, DEFAULT_LAYOUT, no_camera, tmp_path / "check.json") == 3
    found = verdicts(tmp_path / "check.json")
    assert (found["serial port"], found["camera"], found["disk"]) == ("fail", "fail", "fail")
    assert found["board time-out"] == "skipped"
    assert "rpicam-vid" in capsys.readouterr().out


def test_a_port_that_is_none_is_no_missing_one(tmp_path: Path):
    config = load("serial.port=/dev/null", f"recording.directory={tmp_path / 'none'}")
    assert device.check_device(config, None, DEFAULT_LAYOUT, no_camera) == 1


def test_a_camera_that_gives_nothing_ends_in_time(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(device, "FIRST_PICTURE_S", 0.1)
    assert device.collect(BlindEye(), 1.0) == []


def test_unusable_files_are_unusable_input(tmp_path: Path):
    config = load("device.model=nowhere.yaml")
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        device.check_device(config, None, DEFAULT_LAYOUT, no_camera)


def test_pictures_are_counted_after_the_camera_has_settled():
    samples = device.collect(SteadyEye(), 0.3)
    assert samples[0].frame >= device.SETTLING_PICTURES
    assert all(math.isfinite(sample.psi) for sample in samples)
