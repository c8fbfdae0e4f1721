"""The real device's pictures, replayed: what is true fires nothing, what is not does."""

from __future__ import annotations

import numpy as np
import pytest
from shared import ROOT, shared_path

from hoopd.core.ballresponse import ENOUGH_S, BallResponse
from hoopd.core.picturechecks import PictureChecks
from hoopd.core.records import CameraSample, DriverSample, Inputs, LinkCounts, Vector
from hoopd.plants.hoop.loop.writeback import ball_motion
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.recording import Recording
from hoopd.recording.slices import read_recording

# The camera of the first loses its ball soon after 48 s and repeats the angle to the end.
WITH_BALL = {"meas_hoop01_prbs": 48.0, "meas_hoopAndBall2_01": 20.0}
MOTION = ball_motion(effects_of(load_model(ROOT / "config" / "models" / "hoop.yaml")))


def most_against(name: str, end_s: float, lie: str = "", turned: float = 1.0) -> float:
    """Most evidence against a ball in s; `turned`: what the encoder makes of a radian."""
    recording = read_recording(str(shared_path(f"recordings/{name}.mat")))
    response, most = BallResponse(MOTION), 0.0
    told = _told(recording, lie)
    for k, t in enumerate(recording.t):
        if t > end_s:
            break
        driver = DriverSample(t, k % 256, 1, 0, turned * recording.theta[k], turned * recording.dtheta[k], 0.0, 0)
        response.update(driver, CameraSample(k, t, t, told[k], 1.0, 0.0, 0.0), acting=True)
        most = max(most, response.against_s)
    return most


def _told(recording: Recording, lie: str) -> Vector:
    t, psi = recording.t, recording.psi
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    return {
        "": psi,
        "half": 0.5 * psi,
        "mirrored": -psi,
        "rests": 0.1 + noise,
        "swings": 0.05 * np.sin(8.5 * t) + noise,
    }[lie]


@pytest.mark.parametrize("name", WITH_BALL)
def test_the_true_ball_is_left_alone(name: str) -> None:
    assert most_against(name, WITH_BALL[name]) < 0.5 * ENOUGH_S


@pytest.mark.parametrize("lie", ["half", "mirrored", "rests", "swings"])
@pytest.mark.parametrize("name", WITH_BALL)
def test_a_lie_about_it_is_told(name: str, lie: str) -> None:
    assert most_against(name, WITH_BALL[name], lie) >= ENOUGH_S


@pytest.mark.parametrize("turned", [-1.0, 1 / 3, 0.5])
@pytest.mark.parametrize("name", WITH_BALL)
def test_the_ball_tells_of_an_encoder_that_lies(name: str, turned: float) -> None:
    assert most_against(name, WITH_BALL[name], turned=turned) >= ENOUGH_S


def test_a_column_that_is_no_angle_of_a_ball_is_told() -> None:
    # The fourth column of this one is the motor's current.
    assert most_against("meas_hoop02_chirp", 20.0) >= ENOUGH_S


@pytest.mark.parametrize("name", [*WITH_BALL, "meas_ballOnly01"])
def test_all_four_rows_on_what_the_camera_really_said(name: str) -> None:
    recording = read_recording(str(shared_path(f"recordings/{name}.mat")))
    checks, fired = PictureChecks(MOTION), dict[str, float]()
    for k, t in enumerate(recording.t):
        camera = CameraSample(k, t, t, recording.psi[k], 1.0, 0.0, 0.0)
        driver = DriverSample(t, k % 256, 1, 0, recording.theta[k], recording.dtheta[k], 0.0, 0)
        inputs = Inputs(k, t, camera, driver, LinkCounts(1), (), 0.0, 0.0, False, 0)
        for row, weight in checks.update(inputs, recording.u[k - 1] if k else 0.0).items():
            if weight:
                fired.setdefault(row, t)
    if name == "meas_hoop01_prbs":
        assert 48.0 < fired.pop("angle_stuck") < 49.0
    assert not fired
