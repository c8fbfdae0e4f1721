"""What is unusual again and again is how the plant behaves, and stays: play before an encoder, at every reversal."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import accumulate

import numpy as np
import pytest
from diagnose.motor import SAMPLE_S, levels, sampled, turned
from diagnose.test_sizes import PLANT

from hoopd.diagnose.quality import excluded_stretches
from hoopd.diagnose.quality.excluded_stretches import often_notes, set_aside
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

MOTOR = parse_plant(PLANT.replace("bounds: [1.0e-3, 1]}", "held: true}"), "motor.yaml")
HALF, PARTS = 0.026, 20  # rad


@cache
def behind_play() -> Stretch:
    """Fast turns to and fro; the encoder follows behind its play."""
    random, n = np.random.default_rng(5), 1501
    t, u = np.arange(n) * SAMPLE_S, levels(random, [-2.0, -1.0, 1.0, 2.0], 50, n)
    angle, _ = turned(n, lambda k, part, w: float(0.05 * u[k] - 1e-3 * w), 2.1e-4, PARTS)
    shown = list(accumulate(angle.ravel(), lambda y, th: min(max(y, th - HALF), th + HALF), initial=0.0))
    y = np.array(shown[::PARTS])
    return stretch_of("day1", MOTOR, t, u, {"th": (np.arange(n), y + 1e-3 * random.normal(size=n))})


def refit(stretches: Sequence[Stretch]) -> HypothesisFit:
    return fit(stretches, (), MOTOR.values)


def test_play_at_every_reversal_is_not_set_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    made = behind_play()
    kept, out, found, often = set_aside([made], refit)
    assert out == [] and [one.t[-1] for one in kept] == [made.t[-1]]
    assert [track.stretch for track in found.tracks] == kept
    assert len(often) > 4 and f"day1: something unusual happens {len(often)} times" in often_notes(often)[0]
    monkeypatch.setattr(excluded_stretches, "MOST_TIMES", 99)
    assert len(set_aside([made], refit)[1]) > 4


def test_a_push_now_and_then_in_a_long_recording_is_set_aside() -> None:
    random, n, pushes = np.random.default_rng(5), 6001, np.linspace(5.0, 55.0, 6)
    t, u = np.arange(n) * SAMPLE_S, levels(random, [-2.0, -1.0, 1.0, 2.0], 50, n)
    pushing = [0.3 * any(a <= at < a + 0.15 for a in pushes) for at in t]
    y = sampled(turned(n, lambda k, part, w: float(0.05 * u[k] + pushing[k] - 1e-3 * w), 2.1e-4, PARTS)[0])
    pushed = stretch_of("day1", MOTOR, t, u, {"th": (np.arange(n), y + 1e-3 * random.normal(size=n))})
    _, out, found, often = set_aside([pushed], refit)
    assert [round(one.t0) for one in out] == pushes.tolist() and often == []
    assert found.values["b"] == pytest.approx(1e-3, rel=0.01)
