"""The centre of a ball that a lamp lights from one side, at rest and smeared, in the rig's pictures."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import load
from hoopd.sim.scene import Scene, SceneSettings
from hoopd.vision.blobs import blob_mask, measure_blob
from hoopd.vision.shading import evenly_lit_centre

SIZE, CENTRE, RADIUS = 64, (31.3, 32.6), 20.0


# With one threshold over all of the ball 1.2, 3.1 and 5.7 mrad.
@pytest.mark.parametrize(("speed_rad_s", "limit_rad"), [(0.0, 0.6e-3), (10.0, 1.5e-3), (20.0, 2.8e-3)])
def test_light_from_one_side_moves_no_centre_however_fast_the_ball(speed_rad_s: float, limit_rad: float) -> None:
    config, scene = load(None, sim=True, overrides=[]), Scene(SceneSettings())
    eye = Analyser(config.vision, config.faults.minimum_confidence)
    errors = []
    for frame in range(60):
        psi = 0.4 * frame  # as fast as 20 rad/s
        sample = eye.bgr(frame, 0.0, 0.0, scene.render(frame, (0.7 * psi, 0.0, psi, speed_rad_s)))
        errors.append(math.remainder(sample.psi - psi, math.tau))
    assert np.sqrt(np.mean(np.square(errors))) < limit_rad


def covered(smear_px: float) -> np.ndarray:
    """Share of each pixel that a disc covers which moves to the right."""
    y, x = np.mgrid[:SIZE, :SIZE]
    places = CENTRE[0] + smear_px * (np.arange(33) / 32 - 0.5)
    return np.mean([np.clip(RADIUS + 0.5 - np.hypot(x - at, y - CENTRE[1]), 0.0, 1.0) for at in places], axis=0)


def found(level: np.ndarray) -> tuple[float, float] | None:
    picture = np.rint(level).astype(np.uint8)
    binary = cv2.threshold(picture, 70, 255, cv2.THRESH_BINARY)[1]
    contours = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    mask = blob_mask(np.asarray(max(contours, key=cv2.contourArea), np.int32), picture.shape)
    soft = np.clip((level - 35.0) / 70.0 * 255.0, 0.0, 255.0).astype(np.uint8)
    return evenly_lit_centre(picture, mask, measure_blob(soft, mask))


def by_one_threshold(level: np.ndarray) -> float:
    """Along the smear, with weights that rise from half the threshold to one and a half of it."""
    weight = np.clip((level - 35.0) / 70.0, 0.0, 1.0)
    return float((weight * np.arange(SIZE)).sum() / weight.sum())


@pytest.mark.parametrize("smear_px", [0.0, 6.0, 18.0])
@pytest.mark.parametrize("slope", [0.6, 1.2, -1.2])
def test_a_slope_of_the_light_along_the_smear_is_half_the_error_at_most(smear_px: float, slope: float) -> None:
    light = 160.0 + slope * (np.arange(SIZE) - CENTRE[0])
    level = covered(smear_px) * np.clip(light, 0.0, 255.0)[None, :]
    centre, before = found(level), by_one_threshold(level)
    assert centre is not None
    assert abs(centre[0] - CENTRE[0]) < max(0.1, 0.5 * abs(before - CENTRE[0]))
    assert centre[1] == pytest.approx(CENTRE[1], abs=0.05)


def test_even_light_moves_nothing() -> None:
    assert found(covered(18.0) * 160.0) == pytest.approx(CENTRE, abs=0.05)


def test_a_white_highlight_beside_the_middle_is_no_error() -> None:
    level = covered(0.0) * 160.0
    cv2.circle(level, (27, 28), 3, 20.0, cv2.FILLED)
    assert found(level) == pytest.approx(CENTRE, abs=0.1)
