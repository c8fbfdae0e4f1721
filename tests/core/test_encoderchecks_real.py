"""What the rows of the encoder say of the real device's recordings, and of lies told about its encoder."""

from __future__ import annotations

import pytest
from shared import ROOT, shared_path

from hoopd.core.encoderchecks import EncoderChecks
from hoopd.core.faulttable import BY_NAME
from hoopd.core.records import DriverSample
from hoopd.files.controller import load_controller, settings_of
from hoopd.plants.hoop.loop.writeback import hoop_motion
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.slices import read_recording

CONFIG = ROOT / "config"
MOTION = hoop_motion(
    effects_of(load_model(CONFIG / "models" / "hoop.yaml")),
    settings_of(load_controller(CONFIG / "controllers" / "lqg.yaml")),
)
DRIVEN = ("meas_hoop01_f05_a01", "meas_hoop01_prbs", "meas_hoop02_chirp", "meas_hoopAndBall2_01")
NO_ANGLE_OF_A_BALL = ("meas_hoop01_f05_a01", "meas_hoop02_chirp")
LIES_FROM = 150  # 3 s


def fired(name: str, lie: str = "") -> dict[str, float]:
    """By row: s from the beginning of the lie to the fault."""
    recording = read_recording(str(shared_path(f"recordings/{name}.mat")))
    checks, held, found = EncoderChecks(MOTION, 6.0, 0.02), dict[str, int](), dict[str, float]()
    factor = {"": 1.0, "reversed": -1.0, "frozen": 0.0}[lie]
    since, from_t = recording.theta[LIES_FROM], recording.t[LIES_FROM]
    for k, t in enumerate(recording.t):
        theta, speed = recording.theta[k], recording.dtheta[k]
        if k >= LIES_FROM:
            theta, speed = since + factor * (theta - since), factor * speed
        psi = 0.0 if name in NO_ANGLE_OF_A_BALL else recording.psi[k]
        driver = DriverSample(t, k % 256, 1, 0, theta, speed, 0.0, 0)
        for row, weight in checks.update(t, driver, recording.u[k - 1] if k else 0.0, psi).items():
            held[row] = held.get(row, 0) + weight if weight else 0
            if held[row] >= BY_NAME[row].on:
                found.setdefault(row, t - from_t)
    return found


@pytest.mark.parametrize("name", [*DRIVEN, "meas_ballOnly01"])
def test_the_real_encoder_is_left_alone(name: str) -> None:
    assert not fired(name)


@pytest.mark.parametrize("name", DRIVEN)
def test_a_frozen_one_is_told(name: str) -> None:
    assert 0.0 <= fired(name, "frozen")["torque_without_motion"] < 3.0


def test_a_reversed_one_is_told_by_a_torque_that_goes_on() -> None:
    # The other recordings reverse 0.1 N m too often; there, the ball tells (test_picturechecks_real.py).
    assert 0.0 <= fired("meas_hoop01_f05_a01", "reversed")["hoop_innovation"] < 3.0
