"""What is told of a finding's numbers: intervals of what can be, and the recording in which something was."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from diagnose.test_step_in_time import MOTOR, recorded

from hoopd.diagnose import findings
from hoopd.diagnose.findings import _possible, _when, parameters_of
from hoopd.plants.effects.base import EffectParameter, phase
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

WIDTH = EffectParameter("w", "s", 1.0, 1e-9, 1e9, "shape")
PLACE = EffectParameter("v0", "s", 1.0, -1e9, 1e9, "shape")
PUSH = library(MOTOR)["external.disturbance"]


@pytest.mark.parametrize(
    ("parameter", "found", "told"),
    [
        (WIDTH, (-2.2, 5.7), (0.0, 5.7)),
        (PLACE, (-2.2, 5.7), (-2.2, 5.7)),
        (phase(), (-8.0, 8.0), None),
        (phase(), (pi - 0.2, pi + 0.2), (pi - 0.2, pi + 0.2)),
        (WIDTH, None, None),
        (PLACE, (-7.6e139, 7.6e139), None),
    ],
)
def test_an_interval_holds_what_can_be(
    parameter: EffectParameter, found: tuple[float, float] | None, told: tuple[float, float] | None
) -> None:
    assert _possible(found, parameter) == told


def pushed(seconds: float) -> HypothesisFit:
    """As a search ends where something was in the second recording alone."""
    train = [recorded(f"day{seed}", seed, changes_s=99.0) for seed in (1, 2)]
    times = {f"{PUSH.key(name)}@day1": 0.0 for name in ("t0", "t1")}
    times |= {f"{PUSH.key('t0')}@day2": 1.24, f"{PUSH.key('t1')}@day2": 1.24 + seconds}
    return fit(train, [PUSH], {**MOTOR.values, **times, PUSH.key("A"): 0.1}, move=False)


def test_what_is_over_before_two_samples_see_it_is_no_hand() -> None:
    assert "a command that was lost or came late" in _when(PUSH, pushed(0.015))
    assert _when(PUSH, pushed(0.4)) == ""


def test_the_recording_in_which_it_was_is_told_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings, "interval", lambda found, name: None)
    told = parameters_of(PUSH, pushed(0.4))
    assert [*told] == ["t0", "t0@day2", "t0@day1", "t1", "t1@day2", "t1@day1", "A"]
    assert np.allclose([one.value for one in (told["t0"], told["t1"])], [1.24, 1.64])  # type: ignore[arg-type, misc]
