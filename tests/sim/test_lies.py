"""A camera that lies with fresh stamps: what the rig's pictures and angles show then."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.runs import run

from hoopd.core.records import CameraSample
from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import load
from hoopd.sim import parts
from hoopd.sim.camera import Painter
from hoopd.sim.faults import FaultScript, fault_from_table
from hoopd.sim.lies import Past
from hoopd.sim.truth import read
from hoopd.sim.watchers import Watcher

AT_S, FRAME_S = 1.0, 0.02
PICTURE_RAD = 0.002  # the shipped analysis of a rendered picture is better than this


def watcher(direct: bool, kind: str, **params: Any) -> Watcher:
    config = load(None, sim=True, overrides=["sim.psi_noise_rad=0.0005"])
    script = FaultScript([fault_from_table({"kind": kind, "at_s": AT_S, "params": params})])
    return parts.make_watcher(config, script, 0, direct=direct)


def look(eye: Watcher, psi: Callable[[float], float], start_s: float, pictures: int) -> list[CameraSample]:
    """Samples of a ball that is at `psi(t)`, picture after picture."""
    first = round(start_s / FRAME_S)
    return [eye.see(k, k * FRAME_S, (0.1 * k, 5.0, psi(k * FRAME_S), 0.0)) for k in range(first, first + pictures)]


def swinging(t: float) -> float:
    return 0.3 * math.sin(8.0 * t)


@pytest.mark.parametrize("direct", [True, False])
def test_frozen_pictures_repeat_one_angle_with_fresh_stamps(direct: bool) -> None:
    samples = look(watcher(direct, "pictures_frozen"), swinging, AT_S, 8)
    assert len({sample.psi for sample in samples}) == 1
    assert samples[0].psi == pytest.approx(swinging(AT_S), abs=4 * PICTURE_RAD)
    assert [sample.frame for sample in samples] == list(range(50, 58))
    assert np.diff([sample.t for sample in samples]) == pytest.approx(FRAME_S)
    assert all(sample.t_arrival == sample.t for sample in samples)


@pytest.mark.parametrize("direct", [True, False])
def test_before_its_time_no_lie_is_told(direct: bool) -> None:
    samples = look(watcher(direct, "pictures_frozen"), swinging, 0.5, 8)
    assert [s.psi for s in samples] == pytest.approx([swinging(s.t) for s in samples], abs=4 * PICTURE_RAD)


@pytest.mark.parametrize("direct", [True, False])
def test_a_painted_ball_takes_the_place_of_the_real_one(direct: bool) -> None:
    samples = look(watcher(direct, "picture_ball_painted", psi_rad=-0.4), swinging, AT_S, 5)
    assert [sample.psi for sample in samples] == pytest.approx([-0.4] * 5, abs=PICTURE_RAD)


@pytest.mark.parametrize("direct", [True, False])
def test_a_painted_ball_may_swing(direct: bool) -> None:
    eye = watcher(direct, "picture_ball_painted", psi_rad=0.1, swing_rad=0.2, period_s=0.8)
    samples = look(eye, swinging, AT_S, 40)
    expected = [0.1 + 0.2 * math.sin(2 * math.pi * (s.t - AT_S) / 0.8) for s in samples]
    assert [sample.psi for sample in samples] == pytest.approx(expected, abs=PICTURE_RAD)


@pytest.mark.parametrize("direct", [True, False])
@pytest.mark.parametrize("turns", [0, 3])
def test_a_scale_is_a_scale_of_the_angle_in_the_picture(direct: bool, turns: int) -> None:
    samples = look(watcher(direct, "picture_scale", factor=2.0), lambda t: swinging(t) + turns * math.tau, AT_S, 8)
    assert [s.psi for s in samples] == pytest.approx([2 * swinging(s.t) for s in samples], abs=4 * PICTURE_RAD)


def test_the_past_is_a_line_between_pictures_and_its_beginning_before_it() -> None:
    past = Past()
    for k in range(60):
        past.add(k * FRAME_S, (0.0, 0.0, float(k), 0.0))
    assert past.at(50.25 * FRAME_S)[2] == pytest.approx(50.25)
    assert past.at(59 * FRAME_S)[2] == 59.0
    assert past.at(0.0)[2] == pytest.approx(59 - 25, abs=1.0)  # half a second is remembered


@pytest.mark.parametrize("direct", [True, False])
def test_aged_pictures_carry_the_stamps_of_fresh_ones(tmp_path: Path, direct: bool) -> None:
    """A ball that a hand let go: in lock-step, seen five pictures late with nothing in the stamps to tell it."""
    faults = [{"kind": "pictures_aged", "at_s": AT_S, "params": {"delay_s": 0.1}}]
    found = run(tmp_path, duration_s=2.0, direct=direct, faults=faults, psi_noise_rad=0.0)
    true = read(tmp_path / "truth.csv")
    errors: dict[float, list[float]] = {0.0: [], 0.1: []}
    for row in found.inputs:
        if row.camera is not None and row.camera.t > AT_S:
            assert 0.04 < row.t - row.camera.t < 0.07
            for delay, list_ in errors.items():
                list_.append(row.camera.psi - float(np.interp(row.camera.t - delay, true.t, true.psi)))
    assert np.abs(errors[0.1]).max() < 0.01 < 0.05 < np.abs(errors[0.0]).max()


def test_raw_pictures_of_a_frozen_camera_are_equal_to_the_byte() -> None:
    config = load(None, sim=True, overrides=[])
    row = {"kind": "pictures_frozen", "at_s": AT_S, "for_s": 1.0}
    told = parts.camera_config(config, 0, ring="", start=0.0)
    painter = Painter(told, FaultScript([fault_from_table(row)]))
    pictures = [painter.paint(k, k * FRAME_S, (0.0, 0.0, 0.01 * k, 0.0), FRAME_S) for k in (49, 50, 51, 60, 100, 101)]
    same = [np.array_equal(a, b) for a, b in pairwise(pictures)]
    assert same == [False, True, True, False, False]
    assert isinstance(Analyser(config.vision, 0.3).bgr(50, 1.0, 1.0, pictures[1]).psi, float)


@pytest.mark.parametrize(
    ("row", "word"),
    [
        ({"kind": "pictures_aged", "params": {"delay_s": 0.6}}, "at most 0.5"),
        ({"kind": "picture_scale", "params": {"factor": "much"}}, "factor"),
        ({"kind": "picture_ball_painted", "params": {"period_s": 0}}, "period_s"),
    ],
)
def test_a_lie_that_cannot_be_told_is_one_line(row: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word) as told:
        fault_from_table({"at_s": 0.0, **row})
    assert "\n" not in str(told.value)
